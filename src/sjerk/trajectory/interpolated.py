"""Way-points in their cycles by one jerk each (three with given velocities), in C (``_follow.c``).

What ``follow`` takes where no limit binds: microseconds per way-point. ``docs/explanation/
trajectories.md`` has the method. Never here: times that are stretched, windows.
"""

from __future__ import annotations

import numpy as np

from sjerk._binding import ffi, lib
from sjerk.profile import FloatArray
from sjerk.trajectory.segments import PHASES, Followed, IntArray, Knot, Passed, doubles


class Interpolated:
    """Segments through way-points at their cycles; of which limits may be passed.

    ``good``: how many of them, from the first on, keep the limits of velocity, acceleration, jerk.
    """

    def __init__(
        self,
        names: tuple[str, ...],
        T: float,
        state: Knot,
        points: FloatArray,
        cycle: IntArray,
        speeds: FloatArray | None,
        table: FloatArray,
    ) -> None:
        """From a state to ``points`` (n, N) in ``cycle`` (n,), to rest there; speeds per cycle."""
        self._names, self._T = names, T
        self._position = np.vstack([state.position, points])
        self._cycles: IntArray = np.diff(cycle, prepend=[0, 0])
        n, joints = self._position.shape
        given = None if speeds is None else np.vstack([state.velocity * T, speeds])
        self._rows = np.empty(n * lib.sj_follow_row(joints))
        self._keep = (given, table)
        self._task = ffi.new("sj_follow *")
        self._task.points, self._task.joints = n, joints
        self._task.position = doubles(self._position)
        self._task.velocity = ffi.NULL if given is None else doubles(given)
        self._task.cycles = ffi.from_buffer("int64_t[]", self._cycles)
        self._task.limits, self._task.rows = doubles(table), doubles(self._rows)
        share = np.empty(n)
        begin = state.velocity * T, state.acceleration * T**2, state.last_jerk * T**3
        lib.sj_follow_shares(self._task, *map(doubles, begin), doubles(share))
        wrong = np.flatnonzero(~(share[1:] <= 1.0))
        self.good = int(wrong[0]) if len(wrong) else n - 1

    def read(self, count: int) -> Followed:
        """The first so many segments."""
        T, joints = self._T, self._position.shape[1]
        lengths = np.empty((count, PHASES), dtype=np.int64)
        jerk = np.empty((count, PHASES, joints))
        v, a, j = (np.empty((count + 1, joints)) for _ in range(3))
        lib.sj_follow_read(
            self._task, count, ffi.from_buffer("int64_t[]", lengths), *map(doubles, (jerk, v, a, j))
        )
        taken: IntArray = lengths.sum(axis=1)
        point: IntArray = np.arange(count + 1, dtype=np.int64)
        ends = np.concatenate([[0], np.cumsum(taken)])
        return Followed(
            self._names, T, 0, 0, taken, np.zeros_like(taken), lengths, jerk / T**3,
            self._position[: count + 1].copy(), v / T, a / T**2, j / T**3, point[1:],
            Passed(point, ends * float(T), np.zeros((count + 1, joints))),
        )  # fmt: skip
