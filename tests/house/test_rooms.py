"""The order of the house: a violation of each kind, seeded into a copy, is found by its check."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from helpers.root import ROOT

#: What lint-imports is, but on the sources below the working directory instead of the installed.
LINT_IMPORTS = """
import sys
sys.meta_path = [f for f in sys.meta_path if "Redirecting" not in type(f).__name__]
sys.path.insert(0, "src")
from importlinter.cli import lint_imports_command
lint_imports_command(["--no-cache"])
"""


def copied(to: Path) -> Path:
    """The sources, their tools and settings, without what was built."""
    for folder in ("src", "tools"):
        shutil.copytree(ROOT / folder, to / folder, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", to)
    return to


def add(checkout: Path, file: str, text: str) -> None:
    """Lines at the end of a file of the house, which may be a new one."""
    path = checkout / "src" / "sjerk" / file
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a") as out:
        out.write(text)


def check(checkout: Path, *command: str) -> tuple[int, list[str]]:
    """Exit code and lines of a check."""
    run = subprocess.run(
        [sys.executable, *command], cwd=checkout, capture_output=True, text=True, check=False
    )
    return run.returncode, (run.stdout + run.stderr).splitlines()


# ---- C -------------------------------------------------------------------------------------------

#: Symbols by their file: who defines, who calls.
CALLS = {
    "seeded_above": ("cycle/_group.c", "drive/_units.c"),
    "seeded_there": ("drive/_servo.c", "drive/_master.c"),
    "seeded_back": ("drive/_master.c", "drive/_servo.c"),
    "seeded_port": ("ports/one/_one.c", "ports/two/_two.c"),
    "seeded_attic": ("base/_attic.c", "attic/_box.c"),
}
FOUND = {
    "include upward": 'planner/_ramp.c includes "cycle/_state.h" of cycle/_state.h: upward, '
    "planner -> cycle",
    "call upward": "drive/_units.c calls seeded_above of cycle/_group.c: upward, drive -> cycle",
    "circle": "circle of 2 files in drive: drive/_master.c -> drive/_servo.c (seeded_there), "
    "drive/_servo.c -> drive/_master.c (seeded_back)",
    "ports": "ports/two/_two.c calls seeded_port of ports/one/_one.c: between peers, "
    "ports/two -> ports/one",
    "no such room": "attic/_box.c calls seeded_attic of base/_attic.c: no floor for attic",
}


HEAP_AND_STATIC = """
#include <stdlib.h>
static int times;
void *seeded(void);
void *seeded(void) { times++; return malloc(8); }
"""
IMPURE = {
    "cycle/_stops.c needs malloc of the system: only kernel, ports may",
    "cycle/_stops.c has data that changes, times: pass state in",
}


def test_each_violation_in_c_is_found_and_nothing_else(tmp_path: Path) -> None:
    """Include and call upward, a circle in a room, two ports, a room without a floor."""
    checkout = copied(tmp_path)
    _, before = check(checkout, "tools/rooms.py")
    add(checkout, "planner/_ramp.c", '#include "cycle/_state.h"\n')
    for symbol, (here, there) in CALLS.items():
        add(checkout, here, f"void {symbol}(void);\nvoid {symbol}(void) {{}}\n")
        add(checkout, there, f"void {symbol}(void);\nvoid to_{symbol}(void);\n")
        add(checkout, there, f"void to_{symbol}(void) {{ {symbol}(); }}\n")
    add(checkout, "cycle/_stops.c", HEAP_AND_STATIC)
    code, after = check(checkout, "tools/rooms.py")
    assert code == 1
    assert set(after[:-1]) - set(before[:-1]) == set(FOUND.values()) | IMPURE
    assert set(before[:-1]) <= set(after[:-1])


# ---- Python --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("file", "text", "told"),
    [
        ("planner/planning.py", "from sjerk import host\n", "sjerk.planner is not allowed to"),
        ("errors.py", "def f():\n    import sjerk.host\n", "sjerk.errors is not allowed to"),
        ("ports/other/__init__.py", "import sjerk.ports.canopen\n", "sjerk.ports.other is not"),
    ],
)
def test_imports_upward_and_between_ports_are_found(
    tmp_path: Path, file: str, text: str, told: str
) -> None:
    """By import-linter, which has the order of the rooms; also where the import is hidden."""
    checkout = copied(tmp_path)
    add(checkout, file, text)
    code, lines = check(checkout, "-c", LINT_IMPORTS)
    assert code == 1
    assert any(line.startswith(told) for line in lines), "\n".join(lines)


def test_late_imports_and_long_files_are_found(tmp_path: Path) -> None:
    """In Python and C; and a name that an exempt list does not need any more."""
    checkout = copied(tmp_path)
    assert check(checkout, "tools/manners.py") == (0, ["manners: 0 violations"])
    add(checkout, "errors.py", "def f():\n    if f:\n        from sjerk import host\n")
    line = len((checkout / "src/sjerk/errors.py").read_text().splitlines())
    add(checkout, "drive/_units.c", "\n" * 501)
    long = len((checkout / "src/sjerk/drive/_units.c").read_text().splitlines())
    settings = checkout / "pyproject.toml"
    settings.write_text(
        re.sub(
            r"^long-files = \[", 'long-files = ["base/_types.h",', settings.read_text(), flags=re.M
        )
    )
    code, lines = check(checkout, "tools/manners.py")
    assert code == 1
    assert set(lines[:-1]) == {
        f"drive/_units.c: {long} lines, at most 500",
        f"errors.py:{line}: 'from sjerk import host' inside a function",
        "base/_types.h: has no need to be in long-files any more: remove it",
    }


def test_a_private_access_above_the_limit_is_found(tmp_path: Path) -> None:
    """As many as there are pass, one more does not, and is told with file and line."""
    checkout = copied(tmp_path)
    _, lines = check(checkout, "tools/private_access.py", "--brief")
    count = int(re.findall(r"\d+", lines[-1])[0])
    assert check(checkout, "tools/private_access.py", f"--limit={count}")[0] == 0
    add(checkout, "errors.py", "def f(x):\n    return x._secret\n")
    line = len((checkout / "src/sjerk/errors.py").read_text().splitlines())
    code, lines = check(checkout, "tools/private_access.py", f"--limit={count}", "--brief")
    assert code == 1
    assert any(text.endswith(f"errors.py:{line}: x._secret") for text in lines)


@pytest.mark.parametrize(
    ("text", "count"),
    [
        ("class A:\n def f(self): return self._x + self.__y", 0),
        ("class A:\n def f(self): return self.b._x", 1),
        ("class A:\n def __eq__(self, other): return self._x == other._x", 0),
        ("class A:\n def f(self, other): return other._x", 1),
        ("class A:\n def f(self, other: A | None): return other._x", 0),
        ("class A:\n @classmethod\n def f(cls):\n  a = cls()\n  a._x = 1\n  return a", 0),
        ("class A:\n def f(self):\n  b = B()\n  b._x = 1", 1),
        ("class A:\n def f(self): return super()._x", 0),
        ("class A:\n def __init__(self, o: A): self.o = o\n def f(self): return self.o._x", 0),
        ("from m import _x, y", 1),
        ("from m import y as _y", 0),
        ("x = row._replace(a=1)._asdict()", 0),
        ("def f(a): return a.b()._c._d", 2),
        ("def f(a): return getattr(a, '_b')", 1),
        ("class A:\n def f(self, n): return getattr(self, '_b') + getattr(self.c, n)", 0),
    ],
)
def test_what_counts_as_a_private_access(tmp_path: Path, text: str, count: int) -> None:
    """Another object's, not one's own or that of another instance of the same class."""
    file = tmp_path / "module.py"
    file.write_text(text)
    tool = str(ROOT / "tools" / "private_access.py")
    code, lines = check(tmp_path, tool, "--limit=0", str(file))
    assert lines[-1] == f"private accesses: {count}, at most 0"
    assert code == (count > 0)
