"""A spline of constant jerk per goal period, tried at paces: what streams are made of.

Never here: shared memory, drives.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sjerk._binding import ffi, lib
from sjerk.profile import FloatArray
from sjerk.trajectory.segments import Followed, IntArray, doubles
from sjerk.trajectory.window import limits_per_cycle

__all__ = ["Trial", "Window", "limits_per_cycle"]


class Window:
    """Way-points not handed out yet, the state at the first of them, and its index and cycle.

    ``cycle`` (n,) as asked, ``position`` (n, N), ``state``: velocity, acceleration and last jerk
    (N,) at the first of them, per cycle.
    """

    def __init__(self, joints: int, velocities: bool) -> None:
        self.cycle: IntArray = np.empty(0, dtype=np.int64)  # as asked, from the start
        self.position = np.empty((0, joints))
        self.velocity = np.empty((0, joints)) if velocities else None
        self.state = tuple(np.zeros(joints) for _ in range(3))
        self.before: IntArray = np.empty(0, dtype=np.int64)  # cycles of the plan before
        self.first = self.first_cycle = 0

    def __len__(self) -> int:
        return len(self.cycle)

    def add(self, cycle: IntArray, position: FloatArray, velocity: FloatArray | None) -> None:
        self.cycle = np.concatenate([self.cycle, cycle])
        self.position = np.concatenate([self.position, position])
        if self.velocity is not None:
            assert velocity is not None
            self.velocity = np.concatenate([self.velocity, velocity])


def _task(window: Window, table: FloatArray, T: float, cycles: IntArray) -> tuple[Any, list[Any]]:
    """The ``sj_follow`` of a window's first points, and what keeps its memory."""
    n, joints = len(cycles), window.position.shape[1]
    least = np.diff(window.cycle[:n], prepend=window.cycle[0])
    rows = np.empty(n * lib.sj_follow_row(joints))
    spare = np.empty(lib.sj_follow_spare(joints))
    task = ffi.new("sj_follow *")
    given = None if window.velocity is None else np.ascontiguousarray(window.velocity[:n] * T)
    position = np.ascontiguousarray(window.position[:n])
    keep = [least, rows, spare, given, position, cycles, table]
    task.points, task.joints = n, joints
    task.shorter = 4
    task.position = doubles(position)
    task.velocity = ffi.NULL if given is None else doubles(given)
    task.least = ffi.from_buffer("int64_t[]", least)
    task.cycles = ffi.from_buffer("int64_t[]", cycles)
    task.limits = doubles(table)
    task.rows, task.spare = doubles(rows), doubles(spare)
    lib.sj_follow_begin(task, *(doubles(x) for x in window.state))
    return task, keep


def _read(
    window: Window, names: tuple[str, ...], T: float, task: Any, count: int
) -> tuple[Followed, list[FloatArray]]:
    """The first segments of a plan, and the states at their knots per cycle."""
    joints = window.position.shape[1]
    lengths = np.empty((count, 4), dtype=np.int64)
    jerk = np.empty((count, 4, joints))
    states = [np.empty((count + 1, joints)) for _ in range(3)]
    lib.sj_follow_read(
        task, count, ffi.from_buffer("int64_t[]", lengths), doubles(jerk), *map(doubles, states)
    )
    taken: IntArray = lengths.sum(axis=1)
    made = Followed(
        names,
        T,
        window.first,
        window.first_cycle,
        taken,
        taken - np.diff(window.cycle[: count + 1]),
        lengths,
        jerk / T**3,
        window.position[: count + 1].copy(),
        states[0] / T,
        states[1] / T**2,
        states[2] / T**3,
    )
    return made, states


class Trial:
    """All of a window planned at once, for whoever chooses the cycles: nothing is handed out."""

    def __init__(
        self, window: Window, names: tuple[str, ...], table: FloatArray, cycle_time: float
    ) -> None:
        """``table`` (N, 3): limits per cycle. The window must not change any more."""
        self._window, self._names, self._T = window, names, cycle_time
        self._cycles = np.diff(window.cycle, prepend=window.cycle[0])
        self._share = np.empty(len(window))
        self._task, self._keep = _task(window, table, cycle_time, self._cycles)

    def shares(self, cycles: ArrayLike) -> FloatArray:
        """Largest use of any limit per segment (n,), if the segments take so many ``cycles``."""
        self._cycles[1:] = cycles
        lib.sj_follow_shares(self._task, doubles(self._share))
        return self._share[1:]

    def stretched(self, begin: ArrayLike) -> Followed | None:
        """Limits kept, from these cycles on, as ``follow`` does it; None: that leads nowhere."""
        self._cycles[1:] = begin
        if lib.sj_follow_plan(self._task) != lib.SJ_FOLLOW_OK:
            return None
        return self.read()

    def read(self) -> Followed:
        """The segments of what was solved last; ``stretch`` counts from the window's cycles."""
        return _read(self._window, self._names, self._T, self._task, len(self._cycles) - 1)[0]
