"""A kernel of three axes with three units, and a node on it as a program, for the judges of ROS."""

from __future__ import annotations

import math
import os
import secrets
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Self

import numpy as np

from sjerk import Monitor, Recorder, Recording, SjerkError

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


#: Of a Panda: velocity and acceleration in rad/s and rad/s^2; the jerk is the same for all.
PANDA = (
    [2.175] * 4 + [2.61] * 3,
    [3.75, 1.875, 2.5, 3.125, 3.75, 5.0, 5.0],
    500.0,
)


def panda(folder: Path, name: str, start: Sequence[float] = (0.0,) * 7) -> Path:
    """A kernel of seven axes in radians, which begin at ``start``."""
    rows = [f'name = "{name}"', "cycle_time = 1e-3"]
    for k, at in enumerate(start):
        rows += [
            "[[axes]]",
            f'name = "panda_joint{k + 1}"',
            'unit = "rad"',
            f"counts_per_unit = {2**24 / math.tau!r}",
            f"start = {float(at)!r}",
            'drive = "ideal"',
            f"limits = {{ velocity = {PANDA[0][k]}, acceleration = {PANDA[1][k]}, "
            f"jerk = {PANDA[2]} }}",
        ]
    file = folder / "panda.toml"
    file.write_text("\n".join(rows))
    return file


class Program:
    """``sjerk ros1`` or ``sjerk ros2`` in a process of its own, with the kernel as its child."""

    def __init__(
        self,
        folder: Path,
        ros: str,
        node: str,
        more: Sequence[str],
        described: Callable[[Path, str], Path],
        python: str = sys.executable,
        environment: Mapping[str, str] = os.environ,
    ) -> None:
        self.kernel = f"ros-{secrets.token_hex(4)}"
        file = described(folder, self.kernel)
        self.log = folder / "log"
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(
                [python, "-m", "sjerk", ros, node, str(file), *more],
                stdout=log,
                stderr=subprocess.STDOUT,
                env={**environment, "ROS_LOG_DIR": str(folder)},
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
def running(
    folder: Path,
    ros: str,
    node: str,
    *more: str,
    described: Callable[[Path, str], Path] = robot,
    python: str = sys.executable,
    environment: Mapping[str, str] = os.environ,
) -> Iterator[Program]:
    """A node until the end of the test, on the kernel described; nothing of it may be left."""
    program = Program(folder, ros, node, more, described, python, environment)
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


class Commands:
    """What a kernel has commanded, cycle by cycle, in radians and metres; a context manager."""

    def __init__(self, kernel: str, scale: Sequence[float] = tuple(SCALE)) -> None:
        self._kernel, self._scale = kernel, np.asarray(scale)
        self._recorder, self._first = Recorder(kernel, None), 0

    def __enter__(self) -> Self:
        self._recorder.__enter__()  # it has some seconds of cycles from before, too
        with Monitor.attach(self._kernel) as monitor:
            self._first = monitor.feedback().cycle
        return self

    def __exit__(self, *error: object) -> None:
        self._recorder.__exit__(*error)
        assert self._recorder.missed == 0

    @cached_property
    def _found(self) -> Recording:
        return self._recorder.recording

    @cached_property
    def _rows(self) -> np.ndarray:
        return self._found.cycle >= self._first

    @property
    def cycle(self) -> np.ndarray:
        """Numbers of the cycles (n,)."""
        return self._found.cycle[self._rows].astype(np.int64)

    @property
    def time(self) -> np.ndarray:
        """When they began (n,), s of CLOCK_MONOTONIC."""
        return self._found.all.frames["time_ns"][self._rows] * 1e-9

    @property
    def position(self) -> np.ndarray:
        """Commanded (n, N)."""
        return self._found.position[self._rows] / self._scale

    @property
    def velocity(self) -> np.ndarray:
        """Commanded (n, N), per second."""
        return self._found.velocity[self._rows] / self._scale

    @property
    def acceleration(self) -> np.ndarray:
        """Commanded (n, N), per square second."""
        return self._found.acceleration[self._rows] / self._scale

    @property
    def jerk(self) -> np.ndarray:
        """Commanded (n, N), per cube second."""
        return self._found.jerk[self._rows] / self._scale

    def moving(self) -> slice:
        """From the last cycle at rest before the first motion to the first one after the last."""
        changed = np.flatnonzero((np.diff(self.position, axis=0) != 0.0).any(axis=1))
        return slice(int(changed[0]), int(changed[-1]) + 2)

    def motion(self) -> np.ndarray:
        """Positions (n, N) in axis units, from rest to rest: to be compared bit by bit."""
        return self._found.position[self._rows][self.moving()]

    def within(self, share: float = 1.0 + 1e-9) -> bool:
        """Whether velocity, acceleration and jerk have kept LIMITS."""
        return all(
            np.abs(getattr(self, name)).max() <= most * share for name, most in LIMITS.items()
        )
