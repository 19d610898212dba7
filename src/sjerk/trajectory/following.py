"""Following way-points in their own time, or in as little more as the limits need.

``follow`` plans windows of way-points: in their own times where the limits and the tolerance allow
it, else as the fastest spline that passes them no sooner than asked;
``docs/explanation/trajectories.md`` has the method. Never here: shared memory, drives.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from sjerk.errors import InputError, PlanError, positive
from sjerk.profile import CYCLES_MAX, FloatArray, Limits
from sjerk.trajectory.fastest import (
    NONE,
    at_pace,
    fastest,
    feasible,
    first_answer,
    in_cycles,
    places,
    resolution,
)
from sjerk.trajectory.faults import FaultKind, TrajectoryError, TrajectoryFault
from sjerk.trajectory.parameterization import moments_of
from sjerk.trajectory.programme import Answer, Task
from sjerk.trajectory.segments import Followed, Knot, in_blocks
from sjerk.trajectory.spline import IntArray, Knots, going_on, split
from sjerk.trajectory.trajectory import Trajectory
from sjerk.trajectory.window import (
    HAND_OUT,
    LOOKAHEAD,
    Plan,
    Window,
    limits_per_cycle,
    ranges,
    stop_of,
    tolerances,
    units,
)

#: Fewest segments of a motion from rest to rest, and of one at all.
_FEWEST = 8
#: Finer knots, and cycles more: what is tried where the own time nearly keeps the limits.
_LADDER = ((2.0, 1), (4.0, 1), (4.0, 2), (8.0, 2), (4.0, 4), (4.0, 10))
#: Way-points that are looked at together, to begin with.
_SOME = 64
#: A window that was too short is so many times as long, at most.
_MOST = 16.0
#: A pace that is no start: way-points that these knots cannot tell apart.
_LOST = 1e3
#: A stretch for which finer knots are worth trying.
_NEARLY = 0.05
#: Where ten times the tolerance saves more than this share of a uniform stretch, it is noise.
_NOISE = 0.05


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
    ``stretch`` says how many cycles, ``passed`` when each way-point is passed and how near. A
    tolerance below the noise of the way-points would cost much time; it is exceeded instead, by as
    little as it takes. Velocities of the trajectory, with ``use_velocities``, are met as well as
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
    made = _windows(pieces, limits, T, tolerance, use_velocities, ahead, begin)
    return in_blocks(made, block)


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
        """Way-points of so many cycles from here on, if there are so many.

        By the time that they take: what was asked, or what the limits need where that is more.
        """
        window = self.window
        last, known = window.state.position, -window.over
        if len(window):
            known += self._cycles(np.concatenate([last[None], window.points]), window.gaps).sum()
            last = window.points[-1]
        more = _SOME
        while not self.done and known < cycles:
            piece = self._next()
            if piece is None:
                self.done = True
                self._end()
                return
            some = slice(self._used, self._used + more)
            time, points = piece.time[some], piece.position[some]
            gaps = np.diff(time, prepend=self._latest) / self._T
            taken = known + np.cumsum(self._cycles(np.concatenate([last[None], points]), gaps))
            count = min(int(np.searchsorted(taken, cycles)) + 1, len(time))
            self._used += count
            if (time[-1] - self._start) / self._T > CYCLES_MAX:
                raise InputError("time", piece.duration, f"lasts more than {CYCLES_MAX} cycles")
            speeds = None if piece.velocity is None else piece.velocity[some][:count]
            self._speed = None if speeds is None else speeds[-1]
            speeds = speeds * self._T if self.velocities and speeds is not None else None
            window.add(points[:count], gaps[:count], speeds)
            self._latest = float(time[count - 1])
            known, last = float(taken[count - 1]), points[count - 1]
            more *= 2

    def _cycles(self, rows: FloatArray, asked: FloatArray) -> FloatArray:
        return np.maximum(_least_gaps(rows, self.table), asked)

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
        source.fill(more * (keep + lookahead * stop))
        if not len(window):
            return
        plan = planner.plan(window, source.done)
        cut = plan.knots.duration - (lookahead + 1.5) * stop
        if not source.done and (cut < keep / 3.0 or plan.moments[-1] <= cut + 1.0):
            # more of them are to be known, the last of them behind what is handed out
            had = max(cut, 0.0) + lookahead * stop
            more *= min(max(1.2 * (keep + lookahead * stop) / had, 1.2), _MOST)
            continue
        yield window.hand_out(plan, np.inf if source.done else cut)


class Timed:
    """How way-points are passed that have times."""

    def __init__(
        self,
        table: FloatArray,
        box: FloatArray | None,
        tolerance: FloatArray | None,
        *,
        use_velocities: bool,
    ) -> None:
        """``table`` (N, 3): limits per cycle; ``tolerance``: per joint, or None: by their ways."""
        self._table, self._box, self._tolerance = table, box, tolerance
        self._use_velocities = use_velocities
        self._stop = stop_of(table)
        soft = float((table[:, 1] / table[:, 2]).min())
        self._spacing = max(2.0, soft / 3.0, self._stop / 60.0)

    def plan(self, window: Window, ends: bool) -> Plan:
        """A motion past all way-points of a window; ``ends``: to rest at the last one."""
        task, asked = self._task(window, ends)
        total = float(window.gaps.sum()) - window.over
        if ends:
            length = max(int(np.ceil(total - 1e-6)) - 1, _FEWEST)
        else:
            length = max(int(np.ceil(asked[-1] + 1.5 * self._stop)), _FEWEST)
        knots, answer = self._own_time(task, asked, window.left, length, 1.0) or self._later(
            task, asked, window, length
        )
        moments, due = answer.moments + 0.5, asked + 0.5
        if ends:
            moments, due = np.append(moments, knots.duration + 1.0), np.append(due, total)
        return Plan(knots, answer, due, moments, ends)

    def _task(self, window: Window, ends: bool) -> tuple[Task, FloatArray]:
        """The way-points relative to the state, and the moments of the plan that are asked."""
        origin = window.state.position
        points = window.points - origin
        least = window.gaps.copy()
        least[0] -= window.over
        moments = np.cumsum(least) - 0.5
        speed = window.speeds if self._use_velocities else None
        way = np.ptp(np.concatenate([points, np.zeros((1, len(origin)))]), axis=0)
        unit = units(self._table, way, self._tolerance)
        end = None
        if ends:
            end, points, moments = points[-1], points[:-1], moments[:-1]
            speed = None if speed is None else speed[:-1]
        box = None if self._box is None else self._box - origin[:, None]
        return Task(self._table, unit, points, window.start, end, box, least, speed), moments

    def _knots(self, left: IntArray, length: int, finer: float) -> Knots:
        most = max(min(self._spacing, length / 40.0), 2.0)
        lengths = going_on(left, length, min(most, length / _FEWEST))
        if finer > 1.0:
            lengths = split(lengths, max(most / finer, 2.0))
        if len(lengths) < _FEWEST:  # what was left is coarse
            lengths = split(lengths, length / (2.0 * _FEWEST))
        return Knots(lengths)

    def _own_time(
        self,
        task: Task,
        asked: FloatArray,
        left: IntArray,
        length: int,
        finer: float,
        late: float = 0.0,
    ) -> tuple[Knots, Answer] | None:
        """All way-points at their moments, ``late`` by so much, within the tolerance."""
        knots = self._knots(left, length, finer)
        answer = first_answer(task, knots, asked + late, 1.0)
        made = at_pace(task, knots, answer, NONE, most=1.0)
        return None if made is None or made.excess > 1.0 else (knots, made)

    def _later(
        self, task: Task, asked: FloatArray, window: Window, length: int
    ) -> tuple[Knots, Answer]:
        """Nearly in time, with finer knots; else the fastest, never faster than asked."""
        assert task.least is not None
        left = window.left
        share = 1.0 if task.end is None else length / float(task.least.sum())
        moments = np.maximum((asked + 0.5) * share, 1e-3)
        start = self._start(task, moments, left, length)
        if start.answer is None or start.answer.pace < 1.0 + _NEARLY:
            for finer, more in _LADDER:
                late = more if task.end is not None else 0
                if finer > 2.0 * float(start.knots.lengths.mean()):
                    continue
                exact = self._own_time(task, asked, left, length + late, finer, 0.5 * late)
                if exact is not None:
                    return exact
        best: tuple[float, Knots, Answer] | None = None
        if start.answer is not None and start.answer.pace <= 1.0 + _NEARLY:
            best = self._finished(task, asked, length, start)
            starts = []
        else:
            starts = [start]
        if best is None or best[0] > 1.0:
            rows = [0.0 * task.start[:1], task.points]
            rows += [] if task.end is None else [task.end[None]]
            ends = np.cumsum(np.maximum(_least_gaps(np.concatenate(rows), self._table), task.least))
            ends = window.going_on(ends)
            total = float(ends[-1]) + (0.0 if task.end is not None else length - float(asked[-1]))
            starts.append(self._start(task, ends[: len(asked)], left, int(np.ceil(total))))
        for start in sorted(starts, key=lambda x: x.length):
            made = self._finished(task, asked, length, start)
            if made is not None and (best is None or made[0] < best[0]):
                best = made
            if best is not None and best[0] <= 1.0:
                break
        if best is None:
            raise PlanError("way-points: no motion was found that keeps the limits")
        return best[1], best[2]

    def _finished(
        self, task: Task, asked: FloatArray, length: int, start: _Start
    ) -> tuple[float, Knots, Answer] | None:
        """In whole cycles, past all way-points; first, how much further off than it should be."""
        if start.answer is None or start.answer.pace > _LOST:
            return None
        few, keep = start.few, start.keep
        found = fastest(start.task, start.knots, start.answer, keep)
        final, answer = in_cycles(start.task, start.knots, found, keep)
        every = answer.moments
        if len(few) < len(asked):
            ends = start.knots.duration, final.duration
            every = _between(start.moments, few, answer.moments, asked, ends)
        answer = replace(answer, moments=every)
        if len(few) == len(asked):
            return 0.0, final, answer
        answer = at_pace(task, final, answer, keep) or answer
        far = float((np.abs(places(final, answer) - task.points) / task.unit).max())
        least = keep
        if float(np.diff(asked, prepend=-0.5).min()) >= 1.0:  # sampled no denser than cycles
            least = resolution(task, final, every, keep)
        return far / (3.0 * float(np.max(least))), final, answer

    def _start(self, task: Task, moments: FloatArray, left: IntArray, length: int) -> _Start:
        """A motion to begin with; the tolerance is raised where it is below the noise."""
        knots = self._knots(left, length, 1.0)
        few = _apart(
            moments,
            0.7 * float(knots.lengths.mean()),
            np.inf if task.end is None else knots.duration,
        )
        least = _sums(task.least, few, task.end is not None)
        thin = replace(task, points=task.points[few], speed=None, least=least)
        keep: float | FloatArray = 1.0
        if float(knots.lengths.mean()) > 2.0:  # with the finest knots only time helps
            keep = resolution(thin, knots, moments[few], 1.0)
        answer = None
        for pace in (1.0, 4.0):  # from nearer the optimum where that is far
            answer = answer or feasible(thin, knots, moments[few], pace, keep)
        while np.max(keep) < 1e7 and (answer is None or answer.pace > 1.0 + _NOISE):
            other = feasible(thin, knots, moments[few], 1.0, 10.0 * keep)
            if answer is not None and (other is None or other.pace > (1.0 - _NOISE) * answer.pace):
                break
            answer, keep = other, 10.0 * keep
        return _Start(thin, knots, moments, few, keep, answer)


@dataclass(frozen=True, eq=False)
class _Start:
    """A motion past ``few`` of the way-points, within so many tolerances."""

    task: Task
    knots: Knots
    moments: FloatArray
    few: IntArray
    keep: float | FloatArray
    answer: Answer | None

    @property
    def length(self) -> float:
        return np.inf if self.answer is None else self.answer.pace * self.knots.duration


def _between(
    begun: FloatArray,
    few: IntArray,
    found: FloatArray,
    asked: FloatArray,
    ends: tuple[float, float],
) -> FloatArray:
    """Moments of all way-points between those found for ``few``: none sooner than asked."""
    known = np.concatenate([[0.0], begun[few], ends[:1]])
    every = np.interp(begun, known, np.concatenate([[0.0], found, ends[1:]]))
    at, latest = dict(zip(few.tolist(), found.tolist(), strict=True)), ends[1]
    gaps = np.diff(asked, append=asked[-1]).tolist()
    row = every.tolist()
    for i in range(len(row) - 1, -1, -1):
        latest = at.get(i, min(row[i], latest - gaps[i]))
        row[i] = latest
    for i in range(1, len(row)):
        if i not in at:
            row[i] = max(row[i], row[i - 1] + gaps[i - 1])
    return np.array(row)


def _least_gaps(rows: FloatArray, table: FloatArray) -> FloatArray:
    """Cycles from row to row (n - 1,), roughly, where there are no times."""
    way = (np.diff(rows, axis=0) != 0.0).any(axis=1)
    gaps = np.zeros(len(rows) - 1)
    if way.any():
        gaps[way] = np.diff(moments_of(rows[np.concatenate([[True], way])], table))
    return gaps


def _apart(moments: FloatArray, least: float, end: float) -> IntArray:
    """Indices of moments so far apart, from 0 to ``end``, both without a way-point."""
    kept, at = [], 0.0
    for i, moment in enumerate(moments.tolist()):
        if moment - at >= least and end - moment >= least:
            kept.append(i)
            at = moment
    return np.array(kept, dtype=np.int64)


def _sums(least: FloatArray | None, kept: IntArray, ends: bool) -> FloatArray:
    """Gaps between the kept way-points only."""
    assert least is not None
    at = np.cumsum(least)
    some = np.append(at[kept], at[-1]) if ends else at[kept]
    gaps: FloatArray = np.diff(some, prepend=0.0)
    return gaps
