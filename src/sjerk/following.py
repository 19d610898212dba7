"""Following way-points with look-ahead: whole trajectories as segments of constant jerk.

``follow`` passes every way-point at its time, at its exact position, with continuous acceleration
and within all limits, and stretches segments only where the times ask too much. The work is done in
C (``_follow.c``), window by window, in constant memory; ``docs/explanation/trajectories.md`` has
the method. Never here: shared memory, drives.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sjerk._binding import ffi, lib
from sjerk.errors import InputError, PlanError, positive
from sjerk.planning import Motion, plan
from sjerk.profile import CYCLES_MAX, FloatArray, Limits, Samples
from sjerk.trajectory import Fault, FaultKind, Trajectory, TrajectoryError

IntArray = NDArray[np.int64]

#: Way-points known beyond what is handed out, and way-points handed out at a time.
LOOKAHEAD = 1024
BLOCK = 4096


class Segment(NamedTuple):
    """The way from way-point ``point - 1`` to ``point``.

    ``cycles`` it takes, of which ``stretch`` more than its times asked; ``lengths`` (4,) of its
    phases in cycles (some 0) and ``jerk`` (4, N) in them.
    """

    point: int
    cycles: int
    stretch: int
    lengths: IntArray
    jerk: FloatArray


@dataclass(frozen=True, eq=False)
class Followed:
    """Consecutive segments of a followed trajectory, m of them, for N joints.

    ``first``: index of the way-point where they begin; ``first_cycle``: its cycle from the start of
    the motion. ``cycles``, ``stretch`` (m,): length of each segment, and how many cycles of it the
    times did not ask for. ``lengths`` (m, 4): phases in cycles; ``jerk`` (m, 4, N) per second^3.
    ``position`` (m + 1, N): the way-points; ``velocity``, ``acceleration`` (m + 1, N): of the
    continuous motion in their cycles; ``last_jerk`` (m + 1, N): of the cycle before.
    """

    joint_names: tuple[str, ...]
    cycle_time: float
    first: int
    first_cycle: int
    cycles: IntArray
    stretch: IntArray
    lengths: IntArray
    jerk: FloatArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    last_jerk: FloatArray

    def __len__(self) -> int:
        return len(self.cycles)

    def __iter__(self) -> Iterator[Segment]:
        for i in range(len(self)):
            yield Segment(
                self.first + i + 1,
                int(self.cycles[i]),
                int(self.stretch[i]),
                self.lengths[i],
                self.jerk[i],
            )

    def sample(self) -> Samples:
        """Return what the drives get: ``time`` (rows,), the rest (rows, N).

        One row per cycle, the first way-point's included only at the start of the motion. In its
        cycle a way-point is met bit for bit.
        """
        start, rows, joints = int(self.first == 0), int(self.cycles.sum()), self.position.shape[1]
        T = self.cycle_time
        columns: list[FloatArray] = [np.zeros((start + rows, joints)) for _ in range(4)]
        table = ffi.new("sj_follow_samples *")
        table.position, table.velocity, table.acceleration, table.jerk = (
            _doubles(column[start:]) for column in columns
        )
        per_cycle = (self.velocity * T, self.acceleration * T**2, self.last_jerk * T**3)
        jerk = self.jerk * T**3
        lib.sj_follow_sample(
            len(self),
            joints,
            *map(_doubles, (self.position, *per_cycle)),
            ffi.from_buffer("int64_t[]", self.lengths),
            _doubles(jerk),
            table,
        )
        position, velocity, acceleration, jerks = columns
        if start:
            position[0] = self.position[0]
        for column, unit in ((velocity, T), (acceleration, T**2), (jerks, T**3)):
            np.divide(column, unit, out=column)
        time: FloatArray = T * np.arange(
            self.first_cycle + 1 - start, self.first_cycle + 1 + rows, dtype=np.float64
        )
        return Samples(time, position, velocity, acceleration, jerks)


def follow(
    source: Trajectory | Iterable[Trajectory],
    limits: Sequence[Limits] | Mapping[str, Limits],
    cycle_time: float,
    *,
    use_velocities: bool = True,
    lookahead: int = LOOKAHEAD,
    block: int = BLOCK,
) -> Iterator[Followed]:
    """Follow a trajectory with its own times, from rest to rest; yield blocks of segments.

    Every way-point is passed in its cycle (its time from the first point, rounded to whole cycles)
    at its exact position. Velocities are those of the trajectory (of the samples, in its cycle) if
    it has them and ``use_velocities``; else they are chosen so that the jerk is constant in each
    segment. Acceleration is continuous; velocity, acceleration and jerk limits (the smaller one,
    where braking has its own) are kept in every cycle. A segment whose times ask too much takes
    more cycles, ``stretch`` says how many; none of them could be given back with the others fixed.
    It takes at least 2 cycles, 3 with given velocities, and 1 more at the end.

    ``source``: a trajectory, or pieces of one that follow each other in time, consumed as needed:
    memory is that of ``block + lookahead`` way-points. ``limits``: one per joint, in order or by
    name. Raises TrajectoryError for way-points outside ``Limits.position``, for given velocities
    above their limit and for pieces that do not fit; InputError; PlanError (a fault of sjerk).

    >>> way = Trajectory(["a"], [0.0, 0.5, 1.0], [[0.0], [0.2], [0.3]])
    >>> (all_of_it,) = follow(way, [Limits(2.0, 4.0, 50.0)], 1e-3)
    >>> all_of_it.cycles.tolist(), all_of_it.stretch.tolist()
    ([500, 500], [0, 0])
    >>> samples = all_of_it.sample()
    >>> samples.position[[0, 500, 1000], 0].tolist()
    [0.0, 0.2, 0.3]
    """
    T = positive("cycle_time", cycle_time)
    for name, value, least in (("lookahead", lookahead, 8), ("block", block, 1)):
        if isinstance(value, bool) or not isinstance(value, int) or value < least:
            raise InputError(name, value, f"must be an int, at least {least}")
    pieces = iter((source,) if isinstance(source, Trajectory) else source)
    return _windows(pieces, limits, T, use_velocities, lookahead, block)


def follow_path(
    points: ArrayLike,
    limits: Sequence[Limits],
    cycle_time: float,
    *,
    joint_names: Sequence[str] | None = None,
    tolerance: float | None = None,
    lookahead: int = LOOKAHEAD,
    block: int = BLOCK,
) -> Iterator[Followed]:
    """Follow way-points without times as fast as the limits allow, from rest to rest.

    ``points`` (n, N). Without ``tolerance`` every way-point is met bit for bit and the path between
    is smooth. With a ``tolerance`` (Euclidean, in the joints' unit) the path is the straight lines
    between the way-points with their corners cut: commanded positions stay within the tolerance of
    the lines, and the lines' corners within it of them; neighbouring points on one line still are
    met. For exact stops at every point see ``follow_stops``. Look-ahead: a forward and a backward
    pass over the window's segments give the times to begin with, then no segment can lose a cycle
    with the others fixed. ``stretch`` counts the cycles above what the velocity limits need; a
    block's way-points are those of the cut path. Raises InputError, TrajectoryError, PlanError.

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


def _fast(
    path: FloatArray,
    names: Sequence[str],
    limits: Sequence[Limits],
    T: float,
    lookahead: int,
    block: int,
) -> Iterator[Followed]:
    """Through every point, timed by what the velocity limits need at least."""
    if len(limits) != path.shape[1]:
        raise InputError("limits", len(limits), f"must be one per joint: {path.shape[1]}")
    table = limits_per_cycle(limits, T)
    least = np.ceil((np.abs(np.diff(path, axis=0)) / table[:, 0]).max(axis=1) * (1.0 - 1e-9))
    time = np.concatenate([[0.0], np.cumsum(np.maximum(least, 2.0))]) * T
    return _windows(
        iter([Trajectory(names, time, path)]), limits, T, False, lookahead, block, fast=True
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
    limits: Sequence[Limits],
    T: float,
    tolerance: float,
    lookahead: int,
    block: int,
) -> Iterator[Followed]:
    """Corners cut; where the recording shows that the tolerance is left, more points and closer."""
    if len(limits) != path.shape[1]:
        raise InputError("limits", len(limits), f"must be one per joint: {path.shape[1]}")
    table = limits_per_cycle(limits, T)
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
        self.fast = False  # without times: begin from a guess of the fastest

    def __len__(self) -> int:
        return len(self.cycle)

    def add(self, cycle: IntArray, position: FloatArray, velocity: FloatArray | None) -> None:
        self.cycle = np.concatenate([self.cycle, cycle])
        self.position = np.concatenate([self.position, position])
        if self.velocity is not None:
            assert velocity is not None
            self.velocity = np.concatenate([self.velocity, velocity])


def _windows(
    pieces: Iterator[Trajectory],
    limits: Sequence[Limits] | Mapping[str, Limits],
    T: float,
    use_velocities: bool,
    lookahead: int,
    block: int,
    *,
    fast: bool = False,
) -> Iterator[Followed]:
    names: tuple[str, ...] | None = None
    window, table, begin, latest, total = Window(0, False), np.empty((0, 3)), 0.0, 0.0, 0
    for piece in pieces:
        if names is None:
            names, begin = piece.joint_names, float(piece.time[0])
            window = Window(len(names), use_velocities and piece.velocity is not None)
            window.fast = fast
            table = limits_per_cycle(piece.limits_in_order(limits), T)
        elif piece.joint_names != names:
            raise TrajectoryError([Fault(FaultKind.JOINTS, f"not {', '.join(names)}", total)])
        elif not piece.time[0] > latest:
            why = f"time = {piece.time[0]} s does not follow {latest} s"
            raise TrajectoryError([Fault(FaultKind.TIME, why, total)])
        if window.velocity is not None and piece.velocity is None:
            raise TrajectoryError([Fault(FaultKind.SIZE, "has no velocities", total)])
        _refuse(piece, limits, total, window.velocity is not None)
        latest = float(piece.time[-1])
        total += len(piece)
        if (latest - begin) / T > CYCLES_MAX:
            raise InputError("time", latest, f"lasts more than {CYCLES_MAX} cycles")
        cycle = np.floor((piece.time - begin) / T * (1.0 + 1e-12) + 0.5).astype(np.int64)
        for i in range(0, len(piece), block):
            part = slice(i, i + block)
            given = None if piece.velocity is None else piece.velocity[part]
            window.add(cycle[part], piece.position[part], given)
            while len(window) > block + lookahead:
                yield _hand_out(window, names, table, T, block)
    if names is None:
        raise TrajectoryError([Fault(FaultKind.EMPTY, "no points")])
    while len(window) > 1:
        yield _hand_out(window, names, table, T, len(window) - 1)


def _refuse(
    piece: Trajectory,
    limits: Sequence[Limits] | Mapping[str, Limits],
    total: int,
    velocities: bool,
) -> None:
    wrong = [
        Fault(fault.kind, fault.why, (fault.point or 0) + total, fault.joint)
        for fault in piece.faults(limits, end_velocity_allowed=True)
        if fault.kind is FaultKind.POSITION_LIMIT
        or (velocities and fault.kind is FaultKind.VELOCITY_LIMIT)
    ]
    if wrong:
        raise TrajectoryError(wrong)


def limits_per_cycle(limits: Sequence[Limits], T: float) -> FloatArray:
    """Velocity, acceleration and jerk per cycle (N, 3), the smaller ones of driving and braking."""
    return np.array(
        [
            (
                limit.velocity * T,
                min(limit.acceleration, limit.braking[0]) * T**2,
                min(limit.jerk, limit.braking[1]) * T**3,
            )
            for limit in limits
        ]
    )


def _doubles(array: FloatArray) -> Any:
    return ffi.from_buffer("double[]", np.ascontiguousarray(array), require_writable=False)


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
    # with given times it is the short one that is wrong; the pieces of a cut corner are short
    task.shorter = 20 if window.fast else 4
    task.position = _doubles(position)
    task.velocity = ffi.NULL if given is None else _doubles(given)
    task.least = ffi.from_buffer("int64_t[]", least)
    task.cycles = ffi.from_buffer("int64_t[]", cycles)
    task.limits = _doubles(table)
    task.rows, task.spare = _doubles(rows), _doubles(spare)
    lib.sj_follow_begin(task, *(_doubles(x) for x in window.state))
    return task, keep


def _hand_out(
    window: Window, names: tuple[str, ...], table: FloatArray, T: float, count: int
) -> Followed:
    """Plan all of the window, hand out its first segments, go on from where they end."""
    n, _joints = window.position.shape
    asked = np.diff(window.cycle, prepend=window.cycle[0])
    # Where the plan before looked far enough it is the one to go on with; all of it, if need be; in
    # the end it is a legal motion to a stop, however little lies between the points known.
    status, known = lib.SJ_FOLLOW_STUCK, len(window.before)
    for taken_over, points in ((known // 2, n), (known, n), (known, known + 1)):
        if points < 2:
            break
        cycles = asked.copy()
        if window.fast:
            cycles = np.maximum(cycles, _guess(window.position, table))
        cycles[1 : taken_over + 1] = window.before[:taken_over]
        cycles = cycles[:points].copy()
        task, keep = _task(window, table, T, cycles)
        status = lib.sj_follow_plan(task)
        if status in (lib.SJ_FOLLOW_OK, lib.SJ_FOLLOW_INVALID):
            break
    count = min(count, len(cycles) - 1)
    if status == lib.SJ_FOLLOW_TOO_LONG:
        raise InputError("limits", table.tolist(), f"takes more than {CYCLES_MAX} cycles")
    if status:
        raise PlanError(f"way-points {window.first} .. {window.first + n - 1}: status {status}")
    made, states = _read(window, names, T, task, count)
    del keep
    window.state = tuple(state[-1].copy() for state in states)
    window.before = cycles[count + 1 :].copy()
    window.cycle, window.position = window.cycle[count:], window.position[count:]
    if window.velocity is not None:
        window.velocity = window.velocity[count:]
    window.first += count
    window.first_cycle += int(made.cycles.sum())
    return made


def _read(
    window: Window, names: tuple[str, ...], T: float, task: Any, count: int
) -> tuple[Followed, list[FloatArray]]:
    """The first segments of a plan, and the states at their knots per cycle."""
    joints = window.position.shape[1]
    lengths = np.empty((count, 4), dtype=np.int64)
    jerk = np.empty((count, 4, joints))
    states = [np.empty((count + 1, joints)) for _ in range(3)]
    lib.sj_follow_read(
        task, count, ffi.from_buffer("int64_t[]", lengths), _doubles(jerk), *map(_doubles, states)
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
        lib.sj_follow_shares(self._task, _doubles(self._share))
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
