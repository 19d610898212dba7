"""Dense way-points within a tolerance: few of them met exactly, the others passed near by.

A planner that samples its motion every few milliseconds leaves no freedom between way-points:
meeting each exactly repeats every jump of its acceleration in the jerk. ``follow_within`` keeps as
few as the tolerance needs. ``docs/explanation/trajectories.md``. Never here: shared memory, drives.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sjerk.errors import positive
from sjerk.profile import FloatArray, Limits
from sjerk.trajectory.segments import Followed, Knot
from sjerk.trajectory.stretching import stretched
from sjerk.trajectory.trajectory import Trajectory

#: Time between the way-points to begin with, seconds.
_SPARSE = 0.2
_ROUNDS = 24
#: Cycles about a way-point's time in which the path is looked for.
_ABOUT = 25


@dataclass(frozen=True, eq=False)
class Thinned:
    """A motion near all way-points: its ``blocks``, and the ``kept`` ones (indices) that are met.

    ``deviation`` (n, N): from each way-point to the commanded path, within 25 cycles of when it is
    due by the times of the trajectory, stretches included.
    """

    blocks: tuple[Followed, ...]
    kept: NDArray[np.intp]
    deviation: FloatArray

    @property
    def largest(self) -> float:
        """Largest deviation of any joint from any way-point, axis units."""
        return float(np.abs(self.deviation).max())

    @property
    def stretch(self) -> int:
        """Cycles more than the times ask for."""
        return sum(int(block.stretch.sum()) for block in self.blocks)


def follow_within(
    way: Trajectory,
    limits: Limits | Sequence[Limits] | Mapping[str, Limits],
    cycle_time: float,
    *,
    tolerance: float,
    begin: Knot | None = None,
) -> Thinned:
    """Follow a trajectory with its own times, from rest to rest, near its way-points.

    Every way-point is passed within ``tolerance`` (axis units, each joint) about its time; the
    first, the last and those of the ``kept`` exactly, in their cycles. All limits are kept as by
    ``follow``, which it uses; a segment that is stretched takes the times of the way-points in it
    along. Where a tolerance needs all way-points, all are kept. The whole trajectory is in memory.
    ``begin``: as for ``follow``. Raises InputError, TrajectoryError, PlanError.

    >>> t = np.arange(0.0, 1.001, 0.002)
    >>> wave = Trajectory(["a"], t, 0.1 * (1.0 - np.cos(np.pi * t))[:, None])
    >>> made = follow_within(wave, [Limits(2.0, 4.0, 500.0)], 1e-3, tolerance=1e-3)
    >>> len(made.kept) < 20, made.largest <= 1e-3, made.stretch < 20
    (True, True, True)
    """
    tolerance, T = positive("tolerance", tolerance), positive("cycle_time", cycle_time)
    n = len(way)
    steps = max(1, round(way.duration / _SPARSE))
    moments = np.linspace(way.time[0], way.time[-1], steps + 1)
    kept = np.unique(np.clip(np.searchsorted(way.time, moments), 0, n - 1))
    kept = np.union1d(kept, [0, n - 1])
    for _ in range(_ROUNDS):
        blocks = tuple(stretched(way.take(kept), limits, T, use_velocities=False, begin=begin))
        deviation = _deviation(way, kept, blocks, T)
        far = np.flatnonzero((np.abs(deviation) > tolerance).any(axis=1))
        if not len(far):
            break
        # in each gap that is left too far: its middle by time, so that no two knots are close
        gaps = np.unique(np.searchsorted(kept, far))
        middle = 0.5 * (way.time[kept[gaps - 1]] + way.time[kept[gaps]])
        new = np.clip(np.searchsorted(way.time, middle), kept[gaps - 1] + 1, kept[gaps] - 1)
        kept = np.union1d(kept, new)
    return Thinned(blocks, kept, deviation)


def _deviation(
    way: Trajectory, kept: NDArray[np.intp], blocks: Sequence[Followed], T: float
) -> FloatArray:
    """From each way-point to the nearest place of the commanded path about its time (n, N)."""
    position = np.concatenate([block.sample().position for block in blocks])
    ends = np.concatenate([[0], np.cumsum(np.concatenate([block.cycles for block in blocks]))])
    due = np.rint(np.interp(way.time, way.time[kept], ends)).astype(np.int64)
    nearest = np.full(len(way), np.inf)
    found = np.empty_like(way.position)
    for shift in range(-_ABOUT, _ABOUT):
        low = np.clip(due + shift, 0, len(position) - 2)
        step, gap = position[low + 1] - position[low], way.position - position[low]
        square = np.maximum((step**2).sum(axis=1), 1e-300)
        along = np.clip((gap * step).sum(axis=1) / square, 0.0, 1.0)
        left = along[:, None] * step - gap
        distance = np.abs(left).max(axis=1)
        better = distance < nearest
        nearest[better], found[better] = distance[better], left[better]
    found[kept] = position[ends] - way.position[kept]
    return found
