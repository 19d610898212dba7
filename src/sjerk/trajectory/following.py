"""Following way-points in their own time, or in as little more as the limits need.

``follow`` plans windows of way-points: in their own times where the limits and the tolerance allow
it, else as the fastest spline that passes them no sooner than asked;
``docs/explanation/trajectories.md`` has the method. Never here: shared memory, drives.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from sjerk.errors import InputError, PlanError, SjerkError, positive
from sjerk.profile import CYCLES_MAX, FloatArray, Limits
from sjerk.trajectory.faults import FaultKind, TrajectoryError, TrajectoryFault
from sjerk.trajectory.joining import brake
from sjerk.trajectory.parameterization import gaps_between
from sjerk.trajectory.segments import Followed, Knot, in_blocks
from sjerk.trajectory.stretching import Interpolated, limits_per_cycle
from sjerk.trajectory.timed import Timed
from sjerk.trajectory.trajectory import Trajectory
from sjerk.trajectory.window import (
    HAND_OUT,
    LOOKAHEAD,
    Window,
    ranges,
    stop_of,
    tolerances,
)

#: Way-points that are looked at together, to begin with.
_SOME = 64
#: Way-points known at a time, if there are so many; of these many may be handed out at once.
_MANY = 1024
#: A time is one of whole cycles if it is off by no more, in cycles.
_WHOLE = 1e-6
#: A window that was too short is so many times as long, at most.
_MOST = 16.0


def follow(
    source: Trajectory | Iterable[Trajectory],
    limits: Limits | Sequence[Limits] | Mapping[str, Limits],
    cycle_time: float,
    *,
    tolerance: float | ArrayLike | None = None,
    use_velocities: bool = True,
    lookahead: float = LOOKAHEAD,
    block: int | None = None,
    begin: Knot | None = None,
) -> Iterator[Followed]:
    """Follow a trajectory with its own times, from rest to rest; yield blocks of segments.

    Where the limits allow it the commanded motion passes every way-point at its time, exactly, or
    within ``tolerance`` (axis units, one for all or one per joint; default: a ten-thousandth of the
    joint's way, at most a twentieth of what it goes in a cycle at its velocity limit). Else the
    motion takes as little longer as it must, never shorter from way-point to way-point than asked:
    ``stretch`` says how many cycles, ``passed`` when each way-point is passed and how near. The
    default tolerance is raised tenfold at most where that saves time, for way-points denser than
    knots up to what a joint goes at full velocity in half the time between two; a given one only
    where no uniform stretch of up to three times keeps it.
    Velocities of the trajectory, with ``use_velocities``, are met as well as
    the way-points leave room. The motion ends a cycle after its time, settled. Limits of velocity,
    acceleration and jerk (the smaller one, where braking has its own) and positions are kept.

    ``begin``: in motion instead, at the first way-point. ``source``: a trajectory, or pieces of one
    that follow each other in time, consumed as needed: memory is that of a window of twice
    ``lookahead`` stops (V/A + A/J of the slowest joint); ``block``: most segments at a time.
    ``limits``: one per joint, in order or by name, or one for all. Raises TrajectoryError for
    way-points outside ``Limits.position``, for given velocities above their limit, for one at the
    start or the end that is not rest, and for pieces that do not fit; InputError; PlanError (from
    rest: a fault of sjerk).

    >>> way = Trajectory(["a"], [0.0, 0.5, 1.0], [[0.0], [0.2], [0.3]])
    >>> (all_of_it,) = follow(way, [Limits(2.0, 4.0, 50.0)], 1e-3)
    >>> int(all_of_it.cycles.sum()), int(all_of_it.stretch.sum()), all_of_it.passed.point.tolist()
    (1000, 0, [0, 1, 2])
    >>> samples = all_of_it.sample()
    >>> samples.position[[0, 500, 1000], 0].round(9).tolist()
    [0.0, 0.2, 0.3]
    """
    T = positive("cycle_time", cycle_time)
    ahead = positive("lookahead", lookahead)
    pieces = iter((source,) if isinstance(source, Trajectory) else source)
    found = _windows(pieces, limits, T, tolerance, use_velocities, ahead, begin)
    return in_blocks(found, block)


class _Source:
    """Way-points of the pieces of a trajectory, checked as they come."""

    def __init__(
        self,
        pieces: Iterator[Trajectory],
        limits: Limits | Sequence[Limits] | Mapping[str, Limits],
        T: float,
        use_velocities: bool,
        begin: Knot | None,
    ) -> None:
        self._pieces, self._limits, self._T, self._total = pieces, limits, T, 0
        first = next(pieces, None)
        if first is None:
            raise TrajectoryError([TrajectoryFault(FaultKind.EMPTY, "no points")])
        self.names = first.joint_names
        self.limits = first.limits_in_order(limits)
        self.velocities = use_velocities and first.velocity is not None
        self._start = self._latest = float(first.time[0])
        self.done = False
        self._speed: FloatArray | None = None  # of the last way-point
        self.table = limits_per_cycle(self.limits, T)
        self._check(first, begin is not None)
        state = Knot.rest(first.position[0]) if begin is None else begin
        self.window = Window(self.names, T, state)
        self._piece, self._used = first, 1
        self._total = len(first)

    def fill(self, cycles: float) -> None:
        """Way-points of so many cycles from here on, and many, if there are so many."""
        window, more = self.window, _SOME
        while not self.done and (len(window) < _MANY or self.among(cycles) == len(window)):
            piece = self._next()
            if piece is None:
                self.done = True
                self._end()
                return
            some = slice(self._used, self._used + more)
            time, points = piece.time[some], piece.position[some]
            gaps = np.diff(time, prepend=self._latest) / self._T
            count = len(time)
            self._used += count
            if (time[-1] - self._start) / self._T > CYCLES_MAX:
                raise InputError("time", piece.duration, f"lasts more than {CYCLES_MAX} cycles")
            speeds = None if piece.velocity is None else piece.velocity[some][:count]
            self._speed = None if speeds is None else speeds[-1]
            speeds = speeds * self._T if self.velocities and speeds is not None else None
            window.add(points[:count], gaps[:count], speeds)
            self._latest = float(time[count - 1])
            more *= 2

    def among(self, cycles: float) -> int:
        """How many of the way-points known take so many cycles: as asked, or as the limits need."""
        window = self.window
        if not len(window):
            return 0
        rows = np.concatenate([window.state.position[None], window.points])
        taken = np.cumsum(np.maximum(gaps_between(rows, self.table), window.gaps)) - window.over
        return min(int(np.searchsorted(taken, cycles)) + 1, len(window))

    def _next(self) -> Trajectory | None:
        """The piece of which way-points are left, else the next one, checked."""
        if self._used == len(self._piece):
            piece = next(self._pieces, None)
            if piece is None:
                return None
            self._check(piece, True)
            self._piece, self._used = piece, 0
            self._total += len(piece)
        return self._piece

    def _check(self, piece: Trajectory, moving: bool) -> None:
        total = self._total
        if piece.joint_names != self.names:
            raise TrajectoryError(
                [TrajectoryFault(FaultKind.JOINTS, f"not {', '.join(self.names)}", total)]
            )
        if total and not piece.time[0] > self._latest:
            why = f"time = {piece.time[0]} s does not follow {self._latest} s"
            raise TrajectoryError([TrajectoryFault(FaultKind.TIME, why, total)])
        if self.velocities and piece.velocity is None:
            raise TrajectoryError([TrajectoryFault(FaultKind.SIZE, "has no velocities", total)])
        wrong = [
            TrajectoryFault(fault.kind, fault.why, (fault.point or 0) + total, fault.joint)
            for fault in piece.faults(self._limits, end_velocity_allowed=True)
            if fault.kind is FaultKind.POSITION_LIMIT
            or (self.velocities and fault.kind is FaultKind.VELOCITY_LIMIT)
        ]
        if piece.velocity is not None and not moving:
            wrong += self._motion(piece.velocity[0], 0, "start")
        if wrong:
            raise TrajectoryError(wrong)

    def _motion(self, velocity: FloatArray, point: int, where: str) -> list[TrajectoryFault]:
        """Velocities that are no rest, where a motion begins or ends."""
        return [
            TrajectoryFault(
                FaultKind.END_VELOCITY, f"velocity = {v} at the {where}, must be 0", point, joint
            )
            for joint, v, limit in zip(self.names, velocity, self.limits, strict=True)
            if abs(v) > 1e-4 * limit.velocity
        ]

    def _end(self) -> None:
        if self._speed is not None:
            wrong = self._motion(self._speed, self._total - 1, "end")
            if wrong:
                raise TrajectoryError(wrong)


def _windows(
    pieces: Iterator[Trajectory],
    limits: Limits | Sequence[Limits] | Mapping[str, Limits],
    T: float,
    tolerance: float | ArrayLike | None,
    use_velocities: bool,
    lookahead: float,
    begin: Knot | None,
) -> Iterator[Followed]:
    source = _Source(pieces, limits, T, use_velocities, begin)
    window, table = source.window, source.table
    box, stop = ranges(source.limits), stop_of(table)
    near = tolerances(tolerance, len(table))
    planner = Timed(table, box, near, use_velocities=source.velocities)
    keep = max(HAND_OUT * stop, 64.0)
    more = 1.0  # the estimate is rough: by so much the windows are longer
    while True:
        try:
            source.fill(more * (keep + lookahead * stop))
        except SjerkError:
            if window.state.moving:  # the motion goes on to rest before it is told
                yield _to_rest(source)
            raise
        if not len(window):
            return
        soon = _interpolated(source, lookahead * stop, keep)
        if soon is not None:
            yield window.take(soon)
            continue
        count = source.among(more * (keep + lookahead * stop))
        ends = source.done and count == len(window)
        try:
            plan = planner.plan(window.head(count), ends)
        except (PlanError, InputError):
            if not window.first:
                raise
            yield _to_rest(source)
            continue
        cut = plan.knots.duration - (lookahead + 1.5) * stop
        if not ends and (cut < keep / 3.0 or plan.moments[-1] <= cut + 1.0):
            # more of them are to be known, the last of them behind what is handed out
            had = max(cut, 0.0) + lookahead * stop
            more *= min(max(1.2 * (keep + lookahead * stop) / had, 1.2), _MOST)
            continue
        yield window.hand_out(plan, np.inf if ends else cut)


def _interpolated(source: _Source, margin: float, keep: float) -> Followed | None:
    """Way-points at whole cycles where no limit binds for so long: one segment each, met exactly.

    None: there are none, or few cycles of them (``keep``).
    """
    window = source.window
    exact = np.cumsum(window.gaps) - window.over
    exact += np.ceil(exact[0] - _WHOLE) - exact[0]  # less than a cycle later, where it is late
    cycle = np.rint(exact).astype(np.int64)
    least = np.full(len(cycle), 3 if source.velocities else 2)
    least[-1] += 1
    short = np.flatnonzero((np.diff(cycle, prepend=0) < least) | (np.abs(exact - cycle) > _WHOLE))
    count = int(short[0]) if len(short) else len(cycle)
    if count == 0 or cycle[count - 1] > CYCLES_MAX:
        return None
    speeds = window.speeds[:count].copy() if source.velocities else None
    ends = source.done and count == len(cycle)
    if speeds is not None and ends:
        speeds[-1] = 0.0
    made = Interpolated(
        window.names, window.T, window.state, window.points[:count], cycle[:count], speeds,
        source.table,
    )  # fmt: skip
    if made.good < count or not ends:
        last = cycle[min(made.good, count - 1)] - margin
        count = int(np.searchsorted(cycle[:count], last, side="right"))
        if count == 0 or cycle[count - 1] < keep / 3.0:
            return None
    blocks = made.read(count)
    box = ranges(source.limits)
    if box is not None:
        position = blocks.sample().position
        if not ((position >= box[:, 0]) & (position <= box[:, 1])).all():
            return None
    return blocks


def _to_rest(source: _Source) -> Followed:
    """What was planned before, to rest; else the shortest stop."""
    window = source.window
    if window.remainder is not None:
        return window.hand_out(window.remainder, np.inf)
    return window.rest(brake(window.state, source.limits, window.T, joint_names=window.names))
