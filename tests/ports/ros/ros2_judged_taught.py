"""The programs of the tutorials run against the nodes that their pages start: ``./run test-ros2``.

A block ``py`` of a page needs a ROS 2; a block ``python`` needs none, and runs in ``./run test``.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from helpers.ros2_clients import Client
from helpers.ros_robot import LONGEST_S, monitor_of, running

pytest_plugins = ["helpers.ros2_fixtures"]
ROOT = Path(__file__).resolve().parents[3]
PAGES = sorted(p for p in (ROOT / "docs" / "tutorials").glob("*.md") if "```py\n" in p.read_text())
#: What a page without a command of its own needs.
ELSE = "sjerk ros2 controller examples/robot.toml --joints joint1 joint2"


def robot(folder: Path, name: str) -> Path:
    """The shipped file, under another name."""
    file = folder / "robot.toml"
    text = (ROOT / "examples" / "robot.toml").read_text()
    file.write_text(text.replace('name = "robot"', f'name = "{name}"'))
    return file


def test_there_are_pages_to_be_tried() -> None:
    """All five."""
    taught = {"moveit_to_motors", "servoing", "policies", "ros2_control_by_topics"}
    assert taught | {"several_machines"} == {page.stem for page in PAGES}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_program_of_a_tutorial_does_what_its_page_says(
    page: Path, tmp_path: Path, client: Client
) -> None:
    """The node as started there, then each block; what it prints, and that something moved."""
    text = page.read_text()
    line = next((x for x in text.splitlines() if "examples/robot.toml" in x and "ros2" in x), ELSE)
    _, ros, node, _, *more = shlex.split(line.strip())
    with (
        running(tmp_path, ros, node, *more, described=robot) as program,
        monitor_of(program.kernel) as monitor,
    ):
        client.until(lambda: all(axis.follows for axis in monitor.feedback().axes))
        for block in re.findall(r"```py\n(.*?)```", text, re.DOTALL):
            script = tmp_path / "block.py"
            script.write_text(block)
            run = subprocess.run(
                [sys.executable, str(script)],
                capture_output=True,
                text=True,
                timeout=LONGEST_S,
                cwd=tmp_path,
            )
            assert run.returncode == 0, run.stderr
            promised = re.findall(r"# prints: (.*)", block)
            assert not promised or run.stdout.splitlines() == promised
        client.until(lambda: not monitor.feedback().moving)
        moved = monitor.feedback().axes[0].position != 0.0
        assert moved == (page.stem != "several_machines")
