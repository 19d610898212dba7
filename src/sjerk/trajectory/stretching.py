"""Way-points met in their cycles by one segment each, which is stretched where it has to be.

``stretched`` passes every way-point at its exact position, with continuous acceleration and within
all limits. It plans in microseconds per way-point what ``follow`` needs milliseconds for, and takes
longer where times ask too much. The work is done in C (``_follow.c``), window by window, in
constant memory; ``docs/explanation/trajectories.md`` has the method. Never here: shared memory,
drives.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from sjerk._binding import ffi, lib
from sjerk.errors import InputError, PlanError, positive
from sjerk.limits import jerk_limited
from sjerk.profile import CYCLES_MAX, FloatArray, Limits
from sjerk.trajectory.faults import FaultKind, TrajectoryError, TrajectoryFault
from sjerk.trajectory.segments import Followed, IntArray, Knot, Passed, doubles
from sjerk.trajectory.trajectory import Trajectory

#: Way-points known beyond what is handed out, and way-points handed out at a time.
LOOKAHEAD = 1024
BLOCK = 4096


def stretched(
    source: Trajectory | Iterable[Trajectory],
    limits: Limits | Sequence[Limits] | Mapping[str, Limits],
    cycle_time: float,
    *,
    use_velocities: bool = True,
    lookahead: int = LOOKAHEAD,
    block: int = BLOCK,
    begin: Knot | None = None,
) -> Iterator[Followed]:
    """Follow a trajectory with its own times, from rest to rest; yield blocks of segments.

    Every way-point is passed in its cycle (its time from the first point, rounded to whole cycles)
    at its exact position. Velocities are those of the trajectory (of the samples, in its cycle) if
    it has them and ``use_velocities``; else they are chosen so that the jerk is constant in each
    segment. Acceleration is continuous; velocity, acceleration and jerk limits (the smaller one,
    where braking has its own) are kept in every cycle. A segment whose times ask too much takes
    more cycles, ``stretch`` says how many; none of them could be given back with the others fixed.
    It takes at least 2 cycles, 3 with given velocities, and 1 more at the end.

    ``begin``: in motion instead, at the first way-point; what such a state leaves no room for takes
    long, or is a PlanError. ``source``: a trajectory, or pieces of one that follow each other in
    time, consumed as needed: memory is that of ``block + lookahead`` way-points. ``limits``: one
    for all joints or one each, in order or by name. Raises TrajectoryError for way-points outside
    ``Limits.position``, for given velocities
    above their limit and for pieces that do not fit; InputError; PlanError (from rest: a fault of
    sjerk).

    >>> way = Trajectory(["a"], [0.0, 0.5, 1.0], [[0.0], [0.2], [0.3]])
    >>> (all_of_it,) = stretched(way, [Limits(2.0, 4.0, 50.0)], 1e-3)
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
    return windows(pieces, limits, T, use_velocities, lookahead, block, begin=begin)


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


def windows(
    pieces: Iterator[Trajectory],
    limits: Limits | Sequence[Limits] | Mapping[str, Limits],
    T: float,
    use_velocities: bool,
    lookahead: int,
    block: int,
    *,
    begin: Knot | None = None,
) -> Iterator[Followed]:
    """Blocks of segments."""
    names: tuple[str, ...] | None = None
    window, table, start, latest, total = Window(0, False), np.empty((0, 3)), 0.0, 0.0, 0
    for piece in pieces:
        if names is None:
            names, start = piece.joint_names, float(piece.time[0])
            window = Window(len(names), use_velocities and piece.velocity is not None)
            if begin is not None:
                window.state = (
                    begin.velocity * T,
                    begin.acceleration * T**2,
                    begin.last_jerk * T**3,
                )
            table = limits_per_cycle(piece.limits_in_order(limits), T)
        elif piece.joint_names != names:
            raise TrajectoryError(
                [TrajectoryFault(FaultKind.JOINTS, f"not {', '.join(names)}", total)]
            )
        elif not piece.time[0] > latest:
            why = f"time = {piece.time[0]} s does not follow {latest} s"
            raise TrajectoryError([TrajectoryFault(FaultKind.TIME, why, total)])
        if window.velocity is not None and piece.velocity is None:
            raise TrajectoryError([TrajectoryFault(FaultKind.SIZE, "has no velocities", total)])
        _refuse(piece, limits, total, window.velocity is not None)
        latest = float(piece.time[-1])
        total += len(piece)
        if (latest - start) / T > CYCLES_MAX:
            raise InputError("time", latest, f"lasts more than {CYCLES_MAX} cycles")
        cycle = np.floor((piece.time - start) / T * (1.0 + 1e-12) + 0.5).astype(np.int64)
        for i in range(0, len(piece), block):
            part = slice(i, i + block)
            given = None if piece.velocity is None else piece.velocity[part]
            window.add(cycle[part], piece.position[part], given)
            while len(window) > block + lookahead:
                yield _hand_out(window, names, table, T, block)
    if names is None:
        raise TrajectoryError([TrajectoryFault(FaultKind.EMPTY, "no points")])
    while len(window) > 1:
        yield _hand_out(window, names, table, T, len(window) - 1)


def _refuse(
    piece: Trajectory,
    limits: Limits | Sequence[Limits] | Mapping[str, Limits],
    total: int,
    velocities: bool,
) -> None:
    wrong = [
        TrajectoryFault(fault.kind, fault.why, (fault.point or 0) + total, fault.joint)
        for fault in piece.faults(limits, end_velocity_allowed=True)
        if fault.kind is FaultKind.POSITION_LIMIT
        or (velocities and fault.kind is FaultKind.VELOCITY_LIMIT)
    ]
    if wrong:
        raise TrajectoryError(wrong)


class Interpolated:
    """Segments through way-points at their cycles, none stretched; of which limits may be passed.

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
        """From a state to ``points`` (n, N) in ``cycle`` (n,), to rest there; the rest per cycle.

        Segments are not stretched.
        """
        window = Window(len(names), speeds is not None)
        window.state = state.velocity * T, state.acceleration * T**2, state.last_jerk * T**3
        window.add(
            np.append(0, cycle),
            np.vstack([state.position, points]),
            None if speeds is None else np.vstack([state.velocity, speeds / T]),
        )
        self._names, self._T, self._window = names, T, window
        cycles: IntArray = np.diff(window.cycle, prepend=0)
        self._task, self._keep = _task(window, table, T, cycles)
        share = np.empty(len(window))
        lib.sj_follow_shares(self._task, doubles(share))
        wrong = np.flatnonzero(~(share[1:] <= 1.0))
        self.good = int(wrong[0]) if len(wrong) else len(cycle)

    def read(self, count: int) -> Followed:
        """The first so many segments."""
        return _read(self._window, self._names, self._T, self._task, count)[0]


def limits_per_cycle(limits: Sequence[Limits], T: float) -> FloatArray:
    """Velocity, acceleration and jerk per cycle (N, 3), the smaller ones of driving and braking.

    Raises ``InputError`` where a jerk is infinite.
    """
    return np.array(
        [
            (
                limit.velocity * T,
                min(limit.acceleration, limit.braking[0]) * T**2,
                min(limit.jerk, limit.braking[1]) * T**3,
            )
            for limit in jerk_limited(limits)
        ]
    )


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
        task, count, ffi.from_buffer("int64_t[]", lengths), doubles(jerk), *map(doubles, states)
    )
    taken: IntArray = lengths.sum(axis=1)
    first = 0 if window.first == 0 else 1  # the start is a way-point too
    point: IntArray = window.first + np.arange(first, count + 1, dtype=np.int64)
    ends = window.first_cycle + np.concatenate([[0], np.cumsum(taken)])
    passed = Passed(point, ends[first:] * float(T), np.zeros((len(point), joints)))
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
        window.first + 1 + np.arange(count, dtype=np.int64),
        passed,
    )
    return made, states
