"""``tools/same_motion``: the same checkout is equal to itself, another constant is found."""

from __future__ import annotations

import importlib.util
import re
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path
from types import ModuleType

import pytest

from helpers.root import ROOT
from sjerk import _core

TOOL = ROOT / "tools" / "same_motion"
#: What a checkout's own interpreter is: its sources, and the extension that is installed here.
PYTHON = """#!/bin/sh
exec {python} -c 'import os, runpy, sys
sys.meta_path = [f for f in sys.meta_path if "Redirecting" not in type(f).__name__]
sys.argv = sys.argv[1:]
sys.path[:0] = [os.path.dirname(sys.argv[0]), "{checkout}/src"]
runpy.run_path(sys.argv[0], run_name="__main__")' "$@"
"""


def checkout(to: Path) -> Path:
    """The Python of this one, with the extension beside it, and its interpreter."""
    shutil.copytree(
        ROOT / "src", to / "src", ignore=shutil.ignore_patterns("__pycache__", "*.[ch]", "data")
    )
    shutil.copy(str(_core.__file__), to / "src" / "sjerk")
    python = to / ".venv" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text(PYTHON.format(python=sys.executable, checkout=to))
    python.chmod(0o755)
    return to


def compared(old: Path, new: Path, *more: str) -> tuple[int, str]:
    """Exit code, and what is told."""
    run = subprocess.run(
        [sys.executable, TOOL, old, new, *more], capture_output=True, text=True, check=False
    )
    return run.returncode, run.stdout + run.stderr


def test_a_checkout_is_equal_to_itself_in_every_family(tmp_path: Path) -> None:
    """Nothing hangs on the clock, on addresses or on the order of a set."""
    same = checkout(tmp_path / "same")
    code, told = compared(same, same, "--seeds=1")
    assert code == 0, told
    rows = [line.split() for line in told.replace("\r", "\n").splitlines()]
    families = {row[0]: row[1:] for row in rows if len(row) == 4 and row[1].isdigit()}
    assert len(families) == 8
    assert all(counts == ["1", "1", "1"] for counts in families.values())


def test_another_constant_is_found_with_seed_column_and_row(tmp_path: Path) -> None:
    """How smooth a stream is: only streams differ, the first difference is shown."""
    old, new = checkout(tmp_path / "old"), checkout(tmp_path / "new")
    streaming = new / "src" / "sjerk" / "trajectory" / "streaming.py"
    text = streaming.read_text()
    streaming.write_text(text.replace("SMOOTHING = 0.1\n", "SMOOTHING = 0.2\n"))
    assert streaming.read_text() != text
    code, told = compared(old, new, "--seeds=3", "--families", "planner", "streams")
    assert code == 1, told
    assert "motion differs first at seed" in told
    assert re.search(r"part \d+ row \d+ \w+: .+ -> .+", told)
    assert "planner         3        3        3" in told


def test_a_checkout_with_the_sjerk_of_another_is_refused(tmp_path: Path) -> None:
    """Two checkouts that are one would always be equal."""
    old, new = checkout(tmp_path / "old"), checkout(tmp_path / "new")
    shutil.copy(old / ".venv" / "bin" / "python", new / ".venv" / "bin" / "python")
    code, told = compared(old, new, "--seeds=1", "--families", "drive")
    assert code == 1
    assert f"the environment of {new} has the sjerk of {old}" in told


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    """The comparing half."""
    spec = importlib.util.spec_from_file_location("same_motion", TOOL / "__main__.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["same_motion"] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("old", "new", "kinds"),
    [
        (["a 1", "b 1"], ["a 1", "b 1"], {}),
        (["a 1", "b 1"], ["b 1", "a 1"], {"order: a / b": 1, "order: b / a": 1}),
        (["a 1", "a 1"], ["a 1"], {"a: only OLD": 1}),
        (["a 1", "b 1"], ["a 1", "c 2", "b 1"], {"c: only NEW": 1}),
        (["a 1", "b 1"], ["a 2", "b 1"], {"a: only OLD": 1, "a: only NEW": 1}),
    ],
)
def test_differences_of_events_by_kind(
    tool: ModuleType, old: list[str], new: list[str], kinds: dict[str, int]
) -> None:
    """Missing, more, other, and in another order."""
    assert tool._kinds(old, new) == Counter(kinds)
