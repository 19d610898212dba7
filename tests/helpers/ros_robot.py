"""A kernel of three axes with three units, and a node on it as a program, for the judges of ROS."""

from __future__ import annotations

import math
import os
import secrets
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from sjerk import Monitor, SjerkError

LIMITS = {"velocity": 2.175, "acceleration": 3.75, "jerk": 500.0}
NAMES = ["panda_joint1", "panda_joint2", "panda_joint3"]
#: In degrees, radians and millimetres: each joint has another unit.
SCALE = np.array([180 / math.pi, 1.0, 1000.0])
UNITS = ["deg", "rad", "mm"]
LONGEST_S = 60.0


def robot(folder: Path, name: str) -> Path:
    """A kernel of three axes with the same limits in rad or m, in three units."""
    rows = [f'name = "{name}"', "cycle_time = 1e-3"]
    for joint, unit, scale in zip(NAMES, UNITS, SCALE.tolist(), strict=True):
        limits = ", ".join(f"{key} = {value * scale!r}" for key, value in LIMITS.items())
        position = f"position = [{-3.0 * scale!r}, {3.0 * scale!r}]"
        rows += [
            "[[axes]]",
            f'name = "{joint}"',
            f'unit = "{unit}"',
            f"counts_per_unit = {2**24 / math.tau / scale!r}",
            'drive = "ideal"',
            f"limits = {{ {limits}, {position} }}",
        ]
    file = folder / "robot.toml"
    file.write_text("\n".join(rows))
    return file


class Program:
    """``sjerk ros1`` or ``sjerk ros2`` in a process of its own, with the kernel as its child."""

    def __init__(self, folder: Path, ros: str, node: str, more: Sequence[str]) -> None:
        self.kernel = f"ros-{secrets.token_hex(4)}"
        file = robot(folder, self.kernel)
        self.log = folder / "log"
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "sjerk", ros, node, str(file), *more],
                stdout=log,
                stderr=subprocess.STDOUT,
                env=os.environ | {"ROS_LOG_DIR": str(folder)},
            )

    def end(self, number: int = signal.SIGTERM) -> int:
        """Its exit code after a signal."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        try:
            return self.process.wait(LONGEST_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise


@contextmanager
def running(folder: Path, ros: str, node: str, *more: str) -> Iterator[Program]:
    """A node until the end of the test; nothing of it may be left."""
    program = Program(folder, ros, node, more)
    try:
        yield program
    finally:
        try:
            program.end()
        finally:
            print(program.log.read_text(errors="replace"))
    assert list(Path("/dev/shm").glob(f"sjerk-{program.kernel}*")) == []


@contextmanager
def monitor_of(kernel: str) -> Iterator[Monitor]:
    """Of a kernel that is starting."""
    end = time.monotonic() + LONGEST_S
    while True:
        try:
            monitor = Monitor.attach(kernel)
            break
        except SjerkError:
            assert time.monotonic() < end
            time.sleep(0.05)
    with monitor:
        yield monitor


@contextmanager
def kernel_apart(folder: Path) -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """A kernel in a program of its own: its name and its process; nothing of it is left."""
    name = f"apart-{secrets.token_hex(4)}"
    words = [sys.executable, "-m", "sjerk", "kernel", str(robot(folder, name)), "--json"]
    process = subprocess.Popen(words)
    try:
        with monitor_of(name):
            pass
        yield name, process
    finally:
        process.terminate()
        process.wait(LONGEST_S)
        for left in Path("/dev/shm").glob(f"sjerk-{name}*"):
            left.unlink()  # of a kernel that was killed
