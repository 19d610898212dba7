"""Where things are: every test and program finds the repository from here."""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TESTS = ROOT / "tests"
SOURCES = ROOT / "src" / "sjerk"
#: Programs for people and for tests that run for minutes.
STRESS = TESTS / "stress"


def program(module: str, *arguments: str) -> list[str]:
    """The command that starts a module of ``tests/`` in a process of its own."""
    return ["env", f"PYTHONPATH={TESTS}", sys.executable, "-m", module, *arguments]
