"""The examples and the README's lines run as they stand."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from helpers.root import ROOT

EXAMPLES = sorted((ROOT / "examples").glob("*.py"))


def blocks(document: Path) -> list[str]:
    """Its Python blocks."""
    return re.findall(r"```python\n(.*?)```", document.read_text(), re.DOTALL)


TAUGHT = [d for d in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))] if blocks(d)]


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_each_example_runs_and_draws(example: Path, tmp_path: Path) -> None:
    """No error, something to read, and a picture."""
    picture = tmp_path / "picture.png"
    run = subprocess.run(
        [sys.executable, str(example), str(picture)], capture_output=True, text=True, timeout=120
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("document", TAUGHT, ids=lambda path: path.stem)
def test_the_blocks_of_a_document_work(document: Path, tmp_path: Path) -> None:
    """Every Python block of the README and of docs, as a script of its own; what it promises."""
    for i, block in enumerate(blocks(document)):
        script = tmp_path / f"block_{i}.py"
        script.write_text(block)
        run = subprocess.run(
            [sys.executable, str(script)], capture_output=True, text=True, timeout=120, cwd=tmp_path
        )
        assert run.returncode == 0, run.stderr
        promised = re.findall(r"# prints: (.*)", block)
        assert not promised or run.stdout.split("\n")[:-1] == promised


def test_there_is_something_to_try() -> None:
    """The README, tutorials and how-to guides teach by programs."""
    assert {"README", "first_move", "planner_to_motors", "streaming"} <= {d.stem for d in TAUGHT}
