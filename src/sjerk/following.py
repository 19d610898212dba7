"""Following way-points with look-ahead: whole trajectories as segments of constant jerk.

``follow`` passes every way-point at its time, at its exact position, with continuous acceleration
and within all limits, and stretches segments only where the times ask too much. The work is done in
C (``_follow.c``), window by window, in constant memory; ``docs/explanation/trajectories.md`` has
the method. Never here: shared memory, drives.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sjerk._binding import ffi, lib
from sjerk.errors import InputError, PlanError, positive
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
        time = (self.first_cycle + 1 - start + np.arange(start + rows)) * T
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


class _Window:
    """Way-points not handed out yet, the state at the first of them, and its index and cycle."""

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


def _windows(
    pieces: Iterator[Trajectory],
    limits: Sequence[Limits] | Mapping[str, Limits],
    T: float,
    use_velocities: bool,
    lookahead: int,
    block: int,
) -> Iterator[Followed]:
    names: tuple[str, ...] | None = None
    window, table, begin, latest, total = _Window(0, False), np.empty((0, 3)), 0.0, 0.0, 0
    for piece in pieces:
        if names is None:
            names, begin = piece.joint_names, float(piece.time[0])
            window = _Window(len(names), use_velocities and piece.velocity is not None)
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
    if len(window) > 1:
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


def _task(window: _Window, table: FloatArray, T: float, cycles: IntArray) -> tuple[Any, list[Any]]:
    """The ``sj_follow`` of a window, and what keeps its memory."""
    n, joints = window.position.shape
    least = np.diff(window.cycle, prepend=window.cycle[0])
    rows = np.empty(n * lib.sj_follow_row(joints))
    spare = np.empty(lib.sj_follow_spare(joints))
    task = ffi.new("sj_follow *")
    given = None if window.velocity is None else np.ascontiguousarray(window.velocity * T)
    position = np.ascontiguousarray(window.position)
    keep = [least, rows, spare, given, position, cycles, table]
    task.points, task.joints = n, joints
    task.position = _doubles(position)
    task.velocity = ffi.NULL if given is None else _doubles(given)
    task.least = ffi.from_buffer("int64_t[]", least)
    task.cycles = ffi.from_buffer("int64_t[]", cycles)
    task.limits = _doubles(table)
    task.rows, task.spare = _doubles(rows), _doubles(spare)
    lib.sj_follow_begin(task, *(_doubles(x) for x in window.state))
    return task, keep


def _hand_out(
    window: _Window, names: tuple[str, ...], table: FloatArray, T: float, count: int
) -> Followed:
    """Plan all of the window, hand out its first segments, go on from where they end."""
    n, joints = window.position.shape
    asked = np.diff(window.cycle, prepend=window.cycle[0])
    # where the plan before looked far enough it is the one to go on with; all of it, if need be
    status = lib.SJ_FOLLOW_STUCK
    for known in (len(window.before) // 2, len(window.before)):
        cycles = asked.copy()
        cycles[1 : known + 1] = window.before[:known]
        task, keep = _task(window, table, T, cycles)
        status = lib.sj_follow_plan(task)
        if status != lib.SJ_FOLLOW_STUCK:
            break
    if status == lib.SJ_FOLLOW_TOO_LONG:
        raise InputError("limits", table.tolist(), f"takes more than {CYCLES_MAX} cycles")
    if status:
        raise PlanError(f"way-points {window.first} .. {window.first + n - 1}: status {status}")
    lengths = np.empty((count, 4), dtype=np.int64)
    jerk = np.empty((count, 4, joints))
    states = [np.empty((count + 1, joints)) for _ in range(3)]
    lib.sj_follow_read(
        task, count, ffi.from_buffer("int64_t[]", lengths), _doubles(jerk), *map(_doubles, states)
    )
    del keep
    taken = cycles[1 : count + 1]
    made = Followed(
        names,
        T,
        window.first,
        window.first_cycle,
        taken.copy(),
        taken - asked[1 : count + 1],
        lengths,
        jerk / T**3,
        window.position[: count + 1].copy(),
        states[0] / T,
        states[1] / T**2,
        states[2] / T**3,
    )
    window.state = tuple(state[-1].copy() for state in states)
    window.before = cycles[count + 1 :].copy()
    window.cycle, window.position = window.cycle[count:], window.position[count:]
    if window.velocity is not None:
        window.velocity = window.velocity[count:]
    window.first += count
    window.first_cycle += int(taken.sum())
    return made
