"""What each file of src keeps by itself: no imports inside functions, no more lines than agreed.

    python tools/manners.py [CHECKOUT]

``[tool.sjerk]`` in pyproject.toml has ``lines``, and the files that are exempt today,
``long-files`` and ``late-imports``, by their path from ``src/sjerk``. One that has become good must
leave its list. Each violation is a line; the exit code is 1 if there are any.
"""

from __future__ import annotations

import ast
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

_FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)


def late_imports(file: Path) -> Iterator[tuple[int, str]]:
    """Line and text of every import inside a function."""
    for function in ast.walk(ast.parse(file.read_text(), str(file))):
        if not isinstance(function, _FUNCTIONS):
            continue
        for node in ast.walk(function):
            if _imports(node):
                yield getattr(node, "lineno", 0), ast.unparse(node)


def _imports(node: ast.AST) -> bool:
    """Also ``import_module`` of a name that stands there; a variable is the package of an extra."""
    if isinstance(node, ast.Call):
        fixed = bool(node.args) and isinstance(node.args[0], ast.Constant)
        return fixed and ast.unparse(node.func).endswith("import_module")
    return isinstance(node, ast.Import | ast.ImportFrom)


def violations(checkout: Path) -> Iterator[str]:
    """What is wrong, file by file."""
    root = checkout / "src" / "sjerk"
    own = tomllib.loads((checkout / "pyproject.toml").read_text())["tool"]["sjerk"]
    exempt = {name: set(own.get(name, ())) for name in ("long-files", "late-imports")}
    found: dict[str, set[str]] = {name: set() for name in exempt}
    for file in sorted([*root.rglob("*.py"), *root.rglob("*.[ch]")]):
        name = file.relative_to(root).as_posix()
        lines = len(file.read_text().splitlines())
        if lines > own["lines"]:
            found["long-files"].add(name)
            if name not in exempt["long-files"]:
                yield f"{name}: {lines} lines, at most {own['lines']}"
        for line, text in sorted(set(late_imports(file))) if file.suffix == ".py" else ():
            found["late-imports"].add(name)
            if name not in exempt["late-imports"]:
                yield f"{name}:{line}: {text!r} inside a function"
    for kind, names in exempt.items():
        for name in sorted(names - found[kind]):
            yield f"{name}: has no need to be in {kind} any more: remove it"


def main() -> int:
    """1 where something is wrong."""
    here = Path(__file__).resolve().parent.parent
    wrong = list(violations(Path(sys.argv[1]) if len(sys.argv) > 1 else here))
    print(*wrong, f"manners: {len(wrong)} violations", sep="\n")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
