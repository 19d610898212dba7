"""Accesses to private members of other objects, and of other modules, in the Python of src.

    python tools/private_access.py [--limit N] [FILE or FOLDER ...]

Counted are ``x._name`` where x is neither ``self`` nor ``cls`` nor an instance that a method of the
same class has made or compares itself with, and ``from module import _name``. Names of two
underscores, and the fields of the language's own (``_replace`` of a named tuple), are public. More
than ``--limit`` of them fail; the limit is that of ``[tool.sjerk]`` in pyproject.toml.
"""

from __future__ import annotations

import argparse
import ast
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
#: Of named tuples, structures and enums: underscores against clashes, documented all the same.
PUBLIC = {"_replace", "_asdict", "_fields", "_make", "_missing_", "_value_"}
#: Private by name, shared by decision: the extension module and its one importer.
SHARED_MODULES = {"_binding", "_core"}


class Access(NamedTuple):
    """One access."""

    file: Path
    line: int
    text: str


def _is_private(name: str) -> bool:
    return name.startswith("_") and not name.startswith("__") and name not in PUBLIC


class _Finder(ast.NodeVisitor):
    """Accesses in one module; ``own``: expressions for the class at hand and its instances."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self.found: list[Access] = []
        self.own: set[str] = set()
        self.cls: ast.ClassDef | None = None

    def _add(self, node: ast.AST, text: str) -> None:
        self.found.append(Access(self.file, getattr(node, "lineno", 0), text))

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        for alias in node.names:
            if _is_private(alias.name) and alias.name not in SHARED_MODULES:
                self._add(node, f"from {'.' * node.level}{node.module or ''} import {alias.name}")

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        before = self.cls, self.own
        self.cls, self.own = node, {"self", "cls", "super()", node.name}
        for method in node.body:  # first which members hold another instance
            if isinstance(method, ast.FunctionDef):
                self.own |= {name for name in self._instances(method) if name.startswith("self.")}
        self.generic_visit(node)
        self.cls, self.own = before

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        before = self.own
        if self.cls is not None:
            self.own = self.own | self._instances(node)
        self.generic_visit(node)
        self.own = before

    def visit_Attribute(self, node: ast.Attribute) -> None:
        if _is_private(node.attr) and ast.unparse(node.value) not in self.own:
            self._add(node, ast.unparse(node))
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        """``getattr(x, "_name")`` is the same access."""
        if ast.unparse(node.func) in ("getattr", "setattr", "hasattr", "delattr"):
            owner, name = ast.unparse(node.args[0]), node.args[1]
            private = isinstance(name, ast.Constant) and _is_private(str(name.value))
            if private and owner not in self.own:
                self._add(node, ast.unparse(node))
        self.generic_visit(node)

    def _instances(self, method: ast.FunctionDef) -> set[str]:
        """What stands for an instance of the class in one of its methods."""
        assert self.cls is not None
        own = set(self.own)
        arguments = [*method.args.posonlyargs, *method.args.args, *method.args.kwonlyargs]
        if method.name in ("__eq__", "__lt__", "__le__"):
            own |= {argument.arg for argument in arguments}
        for argument in arguments:
            if argument.annotation is not None:
                kinds = ast.unparse(argument.annotation).split(" | ")
                if not {self.cls.name, "Self"}.isdisjoint(kinds):
                    own.add(argument.arg)
        for node in ast.walk(method):
            if isinstance(node, ast.Assign) and self._is_own(node.value, own):
                own |= {ast.unparse(target) for target in node.targets}
        return own

    def _is_own(self, value: ast.expr, own: set[str]) -> bool:
        """A known instance, or one that is made: ``cls(...)``, ``Class(...)``."""
        assert self.cls is not None
        if isinstance(value, ast.Call):
            made = ast.unparse(value.func).removesuffix(".__new__")
            return made in ("cls", self.cls.name) or (
                made == "object" and ast.unparse(value.args[0]) == "cls"
            )
        return ast.unparse(value) in own


def accesses(paths: list[Path]) -> Iterator[Access]:
    """All of them, file by file."""
    for path in paths:
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            finder = _Finder(file)
            finder.visit(ast.parse(file.read_text(), str(file)))
            yield from finder.found


def main() -> int:
    """1 above the limit."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"].get("sjerk", {})
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("paths", nargs="*", type=Path, default=[ROOT / "src"])
    parser.add_argument("--limit", type=int, default=settings.get("private-accesses"))
    parser.add_argument("--brief", action="store_true", help="list them above the limit only")
    given = parser.parse_args()
    found = list(accesses(given.paths))
    over = given.limit is not None and len(found) > given.limit
    if over or not given.brief:
        for access in found:
            print(f"{access.file}:{access.line}: {access.text}")
        for file, count in Counter(access.file for access in found).most_common():
            print(f"{count:5d} {file}")
    print(f"private accesses: {len(found)}, at most {given.limit}")
    return 1 if over else 0


if __name__ == "__main__":
    sys.exit(main())
