"""The last piece of a stream whose goals are all known: to rest on the last one, in whole cycles.

Control points end on a knot. Where nothing but the end binds, the planner from any state to any
target is sooner there, and as exact. Never here: control points, what was handed out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sjerk.profile import FloatArray, Limits
from sjerk.trajectory.joining import join
from sjerk.trajectory.segments import Followed, Knot, rows

#: Goals that are looked at, of those ahead.
_GOALS = 48


@dataclass(frozen=True, eq=False)
class Arrival:
    """``pieces`` of one segment each, ``way`` (n, N) of their ``cycles`` to rest.

    Of the goals looked at (g,), in the order of time: ``passed``, so many cycles from now, and
    ``late``, so many after they were due; ``deviation`` (g, N), so far off; ``ahead``, how many
    come behind each.
    """

    pieces: tuple[Followed, ...]
    way: FloatArray
    cycles: int
    passed: FloatArray
    late: FloatArray
    deviation: FloatArray
    ahead: NDArray[np.int64]


def arrive(
    knot: Knot,
    due: FloatArray,
    position: FloatArray,
    allowed: FloatArray,
    near: FloatArray,
    limits: Sequence[Limits],
    cycle_time: float,
) -> Arrival | None:
    """The shortest motion to rest on the last goal, not before it is due; None if it cuts one.

    ``due`` (g,): in how many cycles each goal is, ``position`` (g, N), ``allowed`` (N,): how far
    off, ``near`` (N,): how close a goal counts as passed. Each is passed when it is due, or later.
    """
    if not _inside(knot, limits):
        return None
    made = join(knot, position[-1], limits, cycle_time, least=max(0, math.ceil(due[-1] - 1e-6)))
    way = replace(made, first=1).sample().position
    chosen = np.unique(np.linspace(0, len(due) - 1, _GOALS).astype(np.int64))
    whole = np.vstack([knot.position, way])
    passed, deviation = _passing(whole, due[chosen], position[chosen], near)
    if (np.abs(deviation) > allowed).any() or (np.diff(passed) < 0.0).any():
        return None
    low = np.minimum(position.min(axis=0), knot.position)
    high = np.maximum(position.max(axis=0), knot.position)
    room = 4.0 * np.spacing(np.maximum(np.abs(low), np.abs(high)))
    if ((way < low - room) | (way > high + room)).any():
        return None
    pieces = tuple(rows(made, i, i + 1) for i in range(len(made)))
    late, ahead = passed - due[chosen], len(due) - 1 - chosen
    return Arrival(pieces, way, len(way), passed, late, deviation, ahead)


def _inside(knot: Knot, limits: Sequence[Limits]) -> bool:
    """Whether the state keeps the limits, and the velocity that it leads to does."""
    V, A, J = np.array([(x.velocity, x.acceleration, x.jerk) for x in limits]).T * (1.0 + 1e-12)
    v, a = knot.velocity, knot.acceleration
    leads = v + a * np.abs(a) / (2.0 * J)
    return bool((np.maximum(np.abs(v), np.abs(leads)) <= V).all() and (np.abs(a) <= A).all())


def _passing(
    way: FloatArray, due: FloatArray, goal: FloatArray, near: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """When goals (g, N) are passed on a way (n + 1, N) from cycle 0, and how far off (g, N).

    Where it is closest to them from when they are due on, between samples also; passed where it is
    ``near`` at first.
    """
    size = np.ptp(way, axis=0) + 1e-300
    gap = np.abs((way[None] - goal[:, None]) / size).max(axis=2)
    gap[np.arange(len(way)) < np.floor(due)[:, None]] = np.inf
    at = gap.argmin(axis=1)
    best, passed = way[at] - goal, at.astype(np.float64)
    for side in (-1, 1):
        other = np.clip(at + side, 0, len(way) - 1)
        step = (way[other] - way[at]) / size
        square = (step * step).sum(axis=1)
        share = ((goal - way[at]) / size * step).sum(axis=1) / np.where(square > 0, square, 1.0)
        share = np.clip(share, 0.0, 1.0)
        off = way[at] + share[:, None] * (way[other] - way[at]) - goal
        nearer = np.abs(off / size).max(axis=1) < np.abs(best / size).max(axis=1)
        best[nearer], passed[nearer] = off[nearer], (at + side * share)[nearer]
    there = (np.abs(way[None] - goal[:, None]) <= near).all(axis=2) & (gap < np.inf)
    first = there.argmax(axis=1)
    return np.where(there.any(axis=1), np.minimum(passed, first), passed), best
