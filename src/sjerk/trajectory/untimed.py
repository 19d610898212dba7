"""Following way-points without times, as fast as the limits allow.

``follow_path`` finds the fastest spline past the way-points, window by window; ``follow_stops`` is a
planned motion per line. ``docs/explanation/trajectories.md``. Never here: shared memory, drives.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import ArrayLike

from sjerk.errors import InputError, positive
from sjerk.planner.planning import Motion, plan
from sjerk.profile import FloatArray, Limits
from sjerk.trajectory.segments import Followed


def follow_path(
    points: ArrayLike,
    limits: Sequence[Limits],
    cycle_time: float,
    *,
    joint_names: Sequence[str] | None = None,
    tolerance: float | None = None,
    corridor: float | None = None,
) -> Iterator[Followed]:
    """To come."""
    raise NotImplementedError


def follow_stops(
    points: ArrayLike, limits: Sequence[Limits], cycle_time: float
) -> Iterator[Motion]:
    """Follow straight lines between way-points with an exact stop at each; one ``Motion`` per line.

    ``points`` (n, N). All joints share the phases of each motion, so the way is the line itself.
    Raises InputError.

    >>> [motion.cycles for motion in follow_stops([[0.0], [1.0], [0.5]], [Limits(2, 4, 500)], 1e-3)]
    [1009, 716]
    """
    path = _path(points)
    for one, two in itertools.pairwise(path.tolist()):
        if one != two:
            yield plan(one, two, limits, cycle_time, synchronization="phase")


def _path(points: ArrayLike) -> FloatArray:
    path = np.array(points, dtype=np.float64)
    if path.ndim != 2 or 0 in path.shape:
        raise InputError("points", path.shape, "must have shape (n, N)")
    wrong = np.flatnonzero(~np.isfinite(path).all(axis=1))
    if len(wrong):
        raise InputError(f"points[{wrong[0]}]", path[wrong[0]].tolist(), "must be finite")
    return path
