"""The command line: what scripts depend on."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from sjerk.handshake import Layout, Segment

LEAVE = (
    "import os, sys; from sjerk.handshake import *; "
    "s = Segment.create(sys.argv[1], Layout(command_bytes=8, feedback_bytes=8)); "
    "os._exit(0)"
)


def sjerk(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "sjerk", *arguments], capture_output=True, text=True, timeout=60
    )


def test_clean_removes_the_segments_of_the_dead_and_never_one_in_use() -> None:
    """A dead creator's segment is listed, then removed; a living one is left alone."""
    dead, living = f"dead-{os.getpid()}", f"living-{os.getpid()}"
    subprocess.run([sys.executable, "-c", LEAVE, dead], check=True)
    with Segment.create(living, Layout(command_bytes=8, feedback_bytes=8)):
        dry = sjerk("clean", "--dry-run")
        assert f"{dead}:" in dry.stdout
        done = sjerk("clean")
        assert done.returncode == 0
        lines = {line.split(":")[0]: line for line in done.stdout.splitlines()}
        assert lines[dead].endswith("removed")
        assert lines[living].endswith("in use")
        names = [entry.name for entry in Path("/dev/shm").iterdir()]
        assert not [name for name in names if dead in name]
        assert [name for name in names if living in name]


def test_wrong_arguments_exit_with_2() -> None:
    """No job, or one that does not exist."""
    assert sjerk().returncode == 2
    assert sjerk("dance").returncode == 2
