"""A whole trajectory near its way-points, with the distances to all of them.

Never here: how, shared memory, drives.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sjerk.errors import positive
from sjerk.profile import FloatArray, Limits
from sjerk.trajectory.following import follow
from sjerk.trajectory.segments import Followed, Knot
from sjerk.trajectory.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Thinned:
    """A motion near all way-points: its ``blocks``.

    ``deviation`` (n, N): of the commanded motion from each way-point when it is passed.
    """

    blocks: tuple[Followed, ...]
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
    """Follow a trajectory as ``follow`` does, all of it at once, within one ``tolerance``.

    The tolerance is in axis units, of each joint. Raises what ``follow`` raises.

    >>> t = np.arange(0.0, 1.001, 0.002)
    >>> wave = Trajectory(["a"], t, 0.1 * (1.0 - np.cos(np.pi * t))[:, None])
    >>> made = follow_within(wave, [Limits(2.0, 4.0, 500.0)], 1e-3, tolerance=1e-3)
    >>> made.largest <= 1e-3, made.stretch
    (True, 0)
    """
    near = positive("tolerance", tolerance)
    blocks = tuple(
        follow(way, limits, cycle_time, tolerance=near, use_velocities=False, begin=begin)
    )
    if not blocks:
        return Thinned((), np.zeros(way.position.shape))
    return Thinned(blocks, np.concatenate([block.passed.deviation for block in blocks]))
