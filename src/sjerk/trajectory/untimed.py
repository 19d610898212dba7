"""Following way-points without times, as fast as the limits allow.

``follow_path`` finds times and corners to begin with, ``follow`` does the rest; ``follow_stops`` is
a planned motion per line. ``docs/explanation/trajectories.md``. Never here: shared memory, drives.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sjerk.errors import InputError, PlanError, positive
from sjerk.limits import limits_of_each
from sjerk.planner import Motion, plan
from sjerk.profile import FloatArray, Limits
from sjerk.trajectory.following import BLOCK, LOOKAHEAD, limits_per_cycle, windows
from sjerk.trajectory.segments import Followed, IntArray
from sjerk.trajectory.trajectory import Trajectory


def follow_path(
    points: ArrayLike,
    limits: Limits | Sequence[Limits],
    cycle_time: float,
    *,
    joint_names: Sequence[str] | None = None,
    tolerance: float | None = None,
    lookahead: int = LOOKAHEAD,
    block: int = BLOCK,
) -> Iterator[Followed]:
    """Follow way-points without times as fast as the limits allow, from rest to rest.

    ``points`` (n, N); ``limits``: one for all joints or one each. Without ``tolerance`` every
    way-point is met bit for bit and the path between is smooth. With a ``tolerance`` (Euclidean, in
    the joints' unit) the path is the straight lines between the way-points with their corners cut:
    commanded positions stay within the tolerance of the lines, and the lines' corners within it of
    them; neighbouring points on one line still are met. For exact stops at every point see
    ``follow_stops``. Look-ahead: a forward and a backward pass over the window's segments give the
    times to begin with, then no segment can lose a cycle with the others fixed. ``stretch`` counts
    the cycles above what the velocity limits need; a block's way-points are those of the cut path.
    Raises InputError, TrajectoryError, PlanError.

    >>> corner = [[0.0, 0.0], [0.5, 0.0], [0.5, 0.5]]
    >>> limits = [Limits(2.0, 4.0, 500.0)] * 2
    >>> narrow, wide = (
    ...     sum(int(b.cycles.sum()) for b in follow_path(corner, limits, 1e-3, tolerance=near))
    ...     for near in (0.01, 0.05)
    ... )
    >>> wide < narrow
    True
    """
    T, path = positive("cycle_time", cycle_time), _path(points)
    names = [f"joint{i}" for i in range(path.shape[1])] if joint_names is None else joint_names
    kept = path[np.concatenate([[True], (np.diff(path, axis=0) != 0.0).any(axis=1)])]
    if len(kept) < 2:
        return iter(())
    if tolerance is None:
        return _fast(kept, names, limits, T, lookahead, block)
    return _blended(kept, names, limits, T, positive("tolerance", tolerance), lookahead, block)


def follow_stops(
    points: ArrayLike, limits: Limits | Sequence[Limits], cycle_time: float
) -> Iterator[Motion]:
    """Follow straight lines between way-points with an exact stop at each; one ``Motion`` per line.

    ``points`` (n, N). All joints share the phases of each motion, so the way is the line itself.
    Raises InputError.

    >>> [motion.cycles for motion in follow_stops([[0.0], [1.0], [0.5]], [Limits(2, 4, 500)], 1e-3)]
    [1009, 716]
    """
    path = _path(points)
    each = limits_of_each(limits, path.shape[1])
    for one, two in itertools.pairwise(path.tolist()):
        if one != two:
            yield plan(one, two, each, cycle_time, synchronization="phase")


def _path(points: ArrayLike) -> FloatArray:
    path = np.array(points, dtype=np.float64)
    if path.ndim != 2 or 0 in path.shape:
        raise InputError("points", path.shape, "must have shape (n, N)")
    wrong = np.flatnonzero(~np.isfinite(path).all(axis=1))
    if len(wrong):
        raise InputError(f"points[{wrong[0]}]", path[wrong[0]].tolist(), "must be finite")
    return path


def _table(path: FloatArray, limits: Limits | Sequence[Limits], T: float) -> FloatArray:
    return limits_per_cycle(limits_of_each(limits, path.shape[1]), T)


def _fast(
    path: FloatArray,
    names: Sequence[str],
    limits: Limits | Sequence[Limits],
    T: float,
    lookahead: int,
    block: int,
) -> Iterator[Followed]:
    """Through every point, timed by what the velocity limits need at least."""
    table = _table(path, limits, T)
    least = np.ceil((np.abs(np.diff(path, axis=0)) / table[:, 0]).max(axis=1) * (1.0 - 1e-9))
    time = np.concatenate([[0.0], np.cumsum(np.maximum(least, 2.0))]) * T
    return windows(
        iter([Trajectory(names, time, path)]), limits, T, False, lookahead, block, guess=_guess
    )


class _Speeds(NamedTuple):
    """Along the chords of a path, per cycle: lengths, caps of speed and push, knots' speeds."""

    length: FloatArray
    cap: FloatArray
    push: FloatArray
    knot: FloatArray
    peak: FloatArray


def _speeds(path: FloatArray, table: FloatArray) -> _Speeds:
    """A forward and a backward pass over the speed along the chords of a path."""
    way = np.diff(path, axis=0)
    length = np.sqrt((way**2).sum(axis=1))
    length[length == 0.0] = 1e-300
    direction = way / length[:, None]
    cap = (table[:, 0] / np.maximum(np.abs(direction), 1e-12)).min(axis=1)
    push = (table[:, 1] / np.maximum(np.abs(direction), 1e-12)).min(axis=1)
    # the turn at a knot takes |u2 - u1| v^2 / (half of both segments) of acceleration
    turn = np.abs(np.diff(direction, axis=0)) / (0.5 * (length[1:] + length[:-1]))[:, None]
    corner = np.sqrt((table[:, 1] / np.maximum(turn, 1e-300)).min(axis=1))
    v = [0.0, *np.minimum(corner, np.minimum(cap[1:], cap[:-1])).tolist(), 0.0]
    gain = (2.0 * push * length).tolist()
    for i in range(1, len(v)):
        v[i] = min(v[i], math.sqrt(v[i - 1] ** 2 + gain[i - 1]))
    for i in range(len(v) - 2, -1, -1):
        v[i] = min(v[i], math.sqrt(v[i + 1] ** 2 + gain[i]))
    knot = np.array(v)
    peak = np.minimum(cap, np.sqrt(0.5 * (knot[1:] ** 2 + knot[:-1] ** 2) + push * length))
    return _Speeds(length, cap, push, knot, peak)


def _guess(path: FloatArray, table: FloatArray) -> IntArray:
    """Cycles per segment (n,) to begin with."""
    speeds = _speeds(path, table)
    mean = 0.5 * speeds.peak + 0.25 * (speeds.knot[1:] + speeds.knot[:-1])
    cycles = np.minimum(speeds.length / np.maximum(mean, 1e-300), 1e12)
    return np.concatenate([[0], np.ceil(cycles)]).astype(np.int64)


def _spread(path: FloatArray, owner: IntArray, least: IntArray, table: FloatArray) -> Any:
    """More way-points on long lines, at equal times of a trapezoidal motion; with their owners.

    ``least``: how many parts the line that ends at a way-point has at least.
    """
    speeds = _speeds(path, table)
    ramp = float((table[:, 0] / table[:, 1]).max())  # to full speed, at constant push
    every = max(30.0, 4.0 * float((table[:, 1] / table[:, 2]).max()), 0.4 * ramp)
    rows, owners = [path[:1]], [owner[:1]]
    for i in range(len(path) - 1):
        v0, v1, peak, a = (
            float(x) for x in (*speeds.knot[i : i + 2], speeds.peak[i], speeds.push[i])
        )
        up, down = (peak - v0) / a, (peak - v1) / a
        cruise = max(
            0.0,
            (float(speeds.length[i]) - 0.5 * (v0 + peak) * up - 0.5 * (v1 + peak) * down) / peak,
        )
        total = up + cruise + down
        parts = max(int(total / every + 0.5) if total > 4.0 * every else 1, int(least[i + 1]))
        t = np.arange(1, parts) * (total / parts)
        first, last = np.minimum(t, up), np.maximum(t - up - cruise, 0.0)
        s = v0 * first + 0.5 * a * first**2 + peak * (t - first) - 0.5 * a * last**2
        share = s / float(speeds.length[i])
        rows.append(path[i] + share[:, None] * (path[i + 1] - path[i]))
        rows.append(path[i + 1 : i + 2])
        owners.append(np.full(parts, owner[i + 1]))
    return np.concatenate(rows), np.concatenate(owners)


def _corners(path: FloatArray, tolerance: float) -> FloatArray:
    """The fewest points (Douglas and Peucker) whose straight lines stay within the tolerance."""
    keep = np.zeros(len(path), dtype=np.bool_)
    keep[[0, -1]] = True
    todo = [(0, len(path) - 1)]
    while todo:
        low, high = todo.pop()
        if high - low < 2:
            continue
        d, rest = path[high] - path[low], path[low + 1 : high] - path[low]
        square = float(d @ d)
        along = np.clip(rest @ d / square, 0.0, 1.0) if square > 0.0 else np.zeros(len(rest))
        gap = ((rest - along[:, None] * d) ** 2).sum(axis=1)
        # a point passed twice or out of order is a turn
        turn = np.diff(along, prepend=0.0, append=1.0).min() < 0.0
        i = int(np.argmax(gap))
        if gap[i] > tolerance**2 or turn:
            i = i if gap[i] > tolerance**2 else int(np.argmax((rest**2).sum(axis=1)))
            keep[low + 1 + i] = True
            todo += [(low, low + 1 + i), (low + 1 + i, high)]
    found: FloatArray = path[keep]
    different = np.concatenate([[True], (np.diff(found, axis=0) != 0.0).any(axis=1)])
    return np.ascontiguousarray(found[different])


#: How often corners that leave the tolerance are cut closer.
_CUTS = 14


def _blended(
    path: FloatArray,
    names: Sequence[str],
    limits: Limits | Sequence[Limits],
    T: float,
    tolerance: float,
    lookahead: int,
    block: int,
) -> Iterator[Followed]:
    """Corners cut; where the recording shows that the tolerance is left, more points and closer."""
    table = _table(path, limits, T)
    path, tolerance = _corners(path, 0.25 * tolerance), 0.75 * tolerance
    way = np.diff(path, axis=0)
    length = np.sqrt((way**2).sum(axis=1))
    u = way / length[:, None]
    bend = np.sqrt((np.diff(u, axis=0) ** 2).sum(axis=1))
    share, between = np.ones(len(path)), np.zeros(len(way), dtype=np.int64)
    for attempt in range(_CUTS):
        rows, owner, least = [path[0]], [0], [0]
        for i in range(1, len(path)):
            cut = 0.0
            if i < len(path) - 1 and bend[i - 1] <= 1.95:
                room = min(length[i - 1], length[i])
                if bend[i - 1] * room >= 0.1 * tolerance:
                    cut = share[i] * min(2.0 * tolerance / bend[i - 1], 0.3 * room)
            least.append(int(between[i - 1]) + 1)
            if cut == 0.0:
                rows.append(path[i])
                owner.append(i)
            else:
                for at, line in ((-1.5, i - 1), (-1.0, i - 1), (1.0, i), (1.5, i)):
                    rows.append(path[i] + at * cut * u[line])
                    owner.append(i)
                least += [1, 1, 1]
        points, owners = _spread(np.array(rows), np.array(owner), np.array(least), table)
        made = list(_fast(points, names, limits, T, lookahead, block))
        far = _left(path, made, owners, tolerance)
        if not far.any():
            return iter(made)
        if attempt % 2:
            share[far] *= 0.5
        near = far[:-1] | far[1:]
        between[near] = 2 * between[near] + 1
    raise PlanError(f"corners {np.flatnonzero(far).tolist()} leave the tolerance {tolerance}")


def _left(
    path: FloatArray, made: Sequence[Followed], owner: IntArray, tolerance: float
) -> NDArray[np.bool_]:
    """Which corners' neighbourhood is left by more than the tolerance, or not come near to."""
    position = np.concatenate([block.sample().position for block in made])
    cycles = np.concatenate([block.cycles for block in made])
    point = np.concatenate([[0], np.repeat(owner[1:], cycles)])  # the corner ahead of a sample
    nearest = np.full(len(position), np.inf)
    for shift in (-2, -1, 0, 1):
        i = np.clip(point + shift, 0, len(path) - 2)
        start, way = path[i], path[i + 1] - path[i]
        along = ((position - start) * way).sum(axis=1) / (way**2).sum(axis=1)
        gap = position - start - np.clip(along, 0.0, 1.0)[:, None] * way
        nearest = np.minimum(nearest, np.sqrt((gap**2).sum(axis=1)))
    far = np.zeros(len(path), dtype=np.bool_)
    outside = np.unique(point[nearest > tolerance])
    far[outside] = far[np.maximum(outside - 1, 0)] = True
    corner = np.full(len(path), np.inf)
    for shift in (0, 1):
        i = np.clip(point - shift, 0, len(path) - 1)
        np.minimum.at(corner, i, np.sqrt(((position - path[i]) ** 2).sum(axis=1)))
    return far | (corner > tolerance)
