"""The examples and the README's lines run as they stand."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from helpers.root import ROOT

EXAMPLES = sorted((ROOT / "examples").glob("*.py"))


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


def test_the_lines_of_the_readme_work(tmp_path: Path) -> None:
    """Every Python block of the README, as a script of its own."""
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    assert blocks
    for i, block in enumerate(blocks):
        script = tmp_path / f"readme_{i}.py"
        script.write_text(block)
        run = subprocess.run(
            [sys.executable, str(script)], capture_output=True, text=True, timeout=120, cwd=tmp_path
        )
        assert run.returncode == 0, run.stderr
        promised = re.findall(r"# prints: (.*)", block)
        assert run.stdout.split("\n")[:-1] == promised


def test_the_lines_of_the_page_on_own_loops_work(tmp_path: Path) -> None:
    """Every Python block of it, as a script of its own."""
    page = (ROOT / "docs" / "explanation" / "own_loop.md").read_text()
    for i, block in enumerate(re.findall(r"```python\n(.*?)```", page, re.DOTALL)):
        script = tmp_path / f"page_{i}.py"
        script.write_text(block)
        run = subprocess.run(
            [sys.executable, str(script)], capture_output=True, text=True, timeout=120, cwd=tmp_path
        )
        assert run.returncode == 0, run.stderr
