"""Statements of src, by room: what a change has added or saved.

    python tools/statements.py [CHECKOUT] [--without ROOM ...] [--files]

Python: statements of the syntax tree without docstrings. C: every ``;`` and ``{`` outside comments
and strings.
"""

from __future__ import annotations

import argparse
import ast
import re
from collections import Counter
from pathlib import Path

_NO_CODE = re.compile(r"/\*.*?\*/|//[^\n]*|\"(?:\\.|[^\"\\\n])*\"|'(?:\\.|[^'\\\n])*'", re.DOTALL)


def of_python(text: str) -> int:
    """Statements without docstrings."""
    tree = ast.parse(text)
    docstrings = sum(
        ast.get_docstring(node, clean=False) is not None
        for node in ast.walk(tree)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
    )
    return sum(isinstance(node, ast.stmt) for node in ast.walk(tree)) - docstrings


def of_c(text: str) -> int:
    """Semicolons and opening braces of the code."""
    code = _NO_CODE.sub(" ", text)
    return code.count(";") + code.count("{")


def count(root: Path) -> dict[Path, int]:
    """Statements of every file below a folder."""
    found = {file: of_python(file.read_text()) for file in root.rglob("*.py")}
    return found | {file: of_c(file.read_text()) for file in root.rglob("_*.[ch]")}


def main() -> None:
    """Print the counts."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    here = Path(__file__).resolve().parent.parent
    parser.add_argument("checkout", nargs="?", type=Path, default=here)
    parser.add_argument("--without", nargs="+", default=[], metavar="ROOM")
    parser.add_argument("--files", action="store_true", help="each file, too")
    given = parser.parse_args()
    root = given.checkout / "src" / "sjerk"
    rooms: dict[str, Counter[str]] = {}
    for file, statements in sorted(count(root).items()):
        inside = file.relative_to(root)
        room = "(top)" if len(inside.parts) == 1 else inside.parts[0]
        if room in given.without:
            continue
        rooms.setdefault(room, Counter())["Python" if file.suffix == ".py" else "C"] += statements
        if given.files:
            print(f"{statements:6d} {inside}")
    print(f"{'room':12s} {'Python':>7s} {'C':>7s} {'all':>7s}")
    for room, counts in sorted(rooms.items()):
        print(f"{room:12s} {counts['Python']:7d} {counts['C']:7d} {counts.total():7d}")
    whole = sum(rooms.values(), Counter())
    print(f"{'all':12s} {whole['Python']:7d} {whole['C']:7d} {whole.total():7d}")


if __name__ == "__main__":
    main()
