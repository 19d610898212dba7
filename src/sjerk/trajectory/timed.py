"""How a window of way-points with times is passed: in its own time, or as little later as it must.

``docs/explanation/trajectories.md`` has the method. Never here: windows, what is handed out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sjerk.errors import PlanError
from sjerk.planner import plan
from sjerk.profile import FloatArray, Limits, State
from sjerk.trajectory.fastest import (
    ROUNDS,
    at_pace,
    evenly,
    fastest,
    feasible,
    in_cycles,
    in_time,
    places,
    resolution,
)
from sjerk.trajectory.parameterization import gaps_between, stops_between
from sjerk.trajectory.programme import Answer, Task
from sjerk.trajectory.spline import IntArray, Knots, among, going_on, scaled, split
from sjerk.trajectory.window import KEPT, Plan, Window, stop_of, units

#: Fewest segments of a motion from rest to rest, and of one at all.
_FEWEST = 8
#: Finer knots, and cycles more: what is tried where the own time nearly keeps the limits.
_LADDER = ((2.0, 1), (4.0, 1), (4.0, 2), (8.0, 2), (4.0, 4), (4.0, 10))
#: Segments of a stop: with more of them a kernel that takes four per cycle slows until it knows the
#: way to a stop.
_KNOWN = 240.0
#: A pace that is no start: way-points that these knots cannot tell apart.
_LOST = 1e3
#: Way-points that are this many knots apart can all be met by these knots.
_APART = 2.0
#: A stretch for which finer knots are worth trying.
_NEARLY = 0.05
#: A uniform stretch that leaves too little to gain by another.
_LITTLE = 0.005
#: Unknowns times rounds of a search for the fastest, and its fewest rounds.
_WORK, _LEAST_ROUNDS = 2e4, 3
#: A uniform stretch that is not looked for.
_EVENLY = 3.0
#: Slowed each by itself way-points are no start where they take more than this share of stopping.
_MUCH = 0.4
#: Where ten times the tolerance saves more than this share of a uniform stretch, it is noise.
_NOISE = 0.05
#: Shares of a way-point's velocity with which it is gone to.
_SHARES = (1.0, 0.0)
#: By how much a tolerance may be raised: by default to half of the fastest cycle, as times in whole
#: cycles are wrong by.
_RAISED = 10.0


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
        self._kept = False  # a motion within the tolerance that was given is known
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
        self._order = list(range(len(task.unit)))
        knots, answer = self._own_time(task, asked, window.left, length, 1.0) or self._best(
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
            lengths = split(lengths, max(most / finer, 2.0, self._stop / _KNOWN))
        if len(lengths) < _FEWEST:  # what was left is coarse
            lengths = split(lengths, length / (2.0 * _FEWEST))
        return Knots(lengths)

    def _own_time(
        self, task: Task, asked: FloatArray, left: IntArray, length: int, finer: float
    ) -> tuple[Knots, Answer] | None:
        """All way-points at these moments, within the tolerance."""
        knots = self._knots(left, length, finer)
        made = in_time(task, knots, asked, self._order)
        return None if made is None else (knots, made)

    def _nearly(
        self, task: Task, asked: FloatArray, left: IntArray, length: int
    ) -> tuple[float, Knots, Answer] | None:
        """With finer knots, or all slowed alike; first, the share of it that is stretch."""
        # a sample lags behind the plan by half a cycle: of so much more at once, or by and by
        half = 0.5 * asked / length if task.start[1:].any() else np.full(len(asked), 0.5)
        later, longer = asked + half, length + 1
        knots = self._knots(left, longer, 1.0)
        pace = evenly(task, knots, later, _EVENLY, self._order)
        apart = float(np.diff(asked, prepend=-0.5).min(initial=np.inf))
        if pace is None and apart >= _APART * float(knots.lengths.mean()):
            return None  # too fast, and not too close for these knots
        for finer, late in _LADDER if pace is None or pace <= 1.0 + _NEARLY else ():
            if finer <= 2.0 * float(knots.lengths.mean()):
                exact = self._own_time(task, asked + late * half, left, length + late, finer)
                if exact is not None:
                    return 0.0, *exact
        fine = self._knots(left, longer, _LADDER[-1][0])
        for own in (fine, knots):
            pace = evenly(task, own, later, _EVENLY, self._order)
            least = longer if pace is None else int(np.ceil(pace * longer - 1e-6))
            for cycles in range(least, least + 3) if pace is not None else ():
                final = Knots(scaled(own, cycles))
                made = in_time(task, final, later * (cycles / longer), self._order)
                if made is not None:
                    return cycles / longer - 1.0, final, made
        return None

    def _best(
        self, task: Task, asked: FloatArray, window: Window, length: int
    ) -> tuple[Knots, Answer]:
        """All slowed alike, if that costs little or is the soonest; else moments of their own."""
        even = self._nearly(task, asked, window.left, length)
        if even is not None and even[0] <= _LITTLE:
            return even[1:]
        self._kept = even is not None and self._tolerance is not None
        try:
            own = self._later(task, asked, window, length)
        except PlanError:
            if even is None:
                raise
            return even[1:]
        if even is None or _arrival(task, *own) <= _arrival(task, *even[1:]):
            return own
        return even[1:]

    def _later(
        self, task: Task, asked: FloatArray, window: Window, length: int
    ) -> tuple[Knots, Answer]:
        """The fastest, never faster than asked."""
        rows = [0.0 * task.start[:1], task.points]
        rows += [] if task.end is None else [task.end[None]]
        way = np.concatenate(rows)
        stops = self._stops(task, way, window)
        best: tuple[float, Knots, Answer] | None = None
        dense = len(asked) > len(self._knots(window.left, length, 1.0))
        gaps = np.diff(stops, prepend=0.0)
        if window.state.moving and not len(window.begun) and task.end is not None:
            best = self._entering(task, asked, window, way)
        elif self._passes(task, way, gaps, dense):
            best = self._smooth(task, asked, window, length, way)
        slow = best is None or best[1].duration > stops[-1] + self._tail(task)
        if best is None or (not dense and (best[0] > 1.0 or slow)):
            made = self._finished(task, asked, self._exact(task, stops, window.left))
            if made is not None and (
                best is None or best[0] > 1.0 or made[1].duration < best[1].duration
            ):
                best = made
        if best is None:
            raise PlanError("way-points: no motion was found that keeps the limits")
        return best[1], best[2]

    def _tail(self, task: Task) -> float:
        """Cycles behind the last way-point, to come to rest."""
        return 0.0 if task.end is not None else 1.5 * self._stop

    def _smooth(
        self, task: Task, asked: FloatArray, window: Window, length: int, way: FloatArray
    ) -> tuple[float, Knots, Answer] | None:
        """Where the times asked are a start, or these slowed each by itself."""
        assert task.least is not None
        left = window.left
        share = 1.0 if task.end is None else length / float(task.least.sum())
        moments = np.maximum((asked + 0.5) * share, 1e-3)
        start = self._start(task, moments, left, length)
        best: tuple[float, Knots, Answer] | None = None
        if start.answer is not None and start.answer.pace <= 1.0 + _NEARLY:
            best = self._finished(task, asked, start)
            starts = []
        else:
            starts = [start]
        if best is None or best[0] > 1.0:
            ends = np.cumsum(np.maximum(gaps_between(way, self._table), task.least))
            ends = window.going_on(ends)
            total = float(ends[-1]) + (0.0 if task.end is not None else length - float(asked[-1]))
            starts.append(self._start(task, ends[: len(asked)], left, int(np.ceil(total))))
        for start in sorted(starts, key=lambda x: x.length):
            made = self._finished(task, asked, start)
            if made is not None and (best is None or made[0] < best[0]):
                best = made
            if best is not None and best[0] <= 1.0:
                break
        return best

    def _entering(
        self, task: Task, asked: FloatArray, window: Window, way: FloatArray
    ) -> tuple[float, Knots, Answer] | None:
        """From a state in motion: the first way-point as soon as a plan gets there, then on."""
        assert task.least is not None
        found = []
        for share in _SHARES:
            gaps = np.maximum(gaps_between(way, self._table), task.least)
            gaps[0] = max(self._reach(task, way, gaps, share), task.least[0])
            ends = np.cumsum(gaps)
            start = self._start(task, ends[: len(asked)], window.left, int(np.ceil(ends[-1])))
            if start.answer is not None:
                found.append(start)
        for start in sorted(found, key=lambda x: x.length):
            made = self._finished(task, asked, start)
            if made is not None:
                return made
        return None

    def _reach(self, task: Task, way: FloatArray, gaps: FloatArray, share: float) -> float:
        """Cycles to the first way-point, at a share of the velocity to the next one."""
        velocity = np.zeros(way.shape[1])
        if len(way) > 2:
            velocity = share * (way[2] - way[1]) / gaps[1]
        most = (1.0 - 1e-9) * self._table[:, 0]
        targets = [State(*row) for row in zip(way[1], np.clip(velocity, -most, most), strict=True)]
        starts = [State(*row) for row in task.start.T.tolist()]
        limits = [Limits(*row) for row in self._table.tolist()]
        return float(plan(starts, targets, limits, 1.0, synchronization="time").cycles)

    def _raised(self, task: Task, dense: bool) -> FloatArray:
        """How far off a joint may be (J,) at most where that is noise.

        A tolerance that is given is not raised where a slower motion keeps it.
        """
        if self._kept:
            return task.unit
        assert task.least is not None
        most = task.unit if self._tolerance is not None and not dense else _RAISED * task.unit
        if dense:  # as far as times in whole samples are wrong by
            most = np.maximum(most, 0.5 * float(np.median(task.least)) * self._table[:, 0])
        return most

    def _passes(self, task: Task, way: FloatArray, stops: FloatArray, dense: bool) -> bool:
        """Whether times slowed, all alike or each as those around it need, beat stopping (gaps).

        Somewhere between k + 1 of them a k-th derivative is k! times their divided difference, and
        slowing by p divides it by p^k; from stop to stop (``stops``, gaps) always suffices.
        """
        assert task.least is not None
        at = np.concatenate([[0.0], np.cumsum(task.least)])
        table, noise = way, np.broadcast_to(self._raised(task, dense), way.shape)
        pace = np.ones(len(task.least))
        for k in range(1, min(4, len(way))):
            gap = (at[k:] - at[:-k])[:, None] / k
            table, noise = np.diff(table, axis=0) / gap, (noise[1:] + noise[:-1]) / gap
            over = ((np.abs(table) - noise) / self._table[:, k - 1]).max(axis=1)
            slow = np.maximum(over, 0.0) ** (1.0 / k)
            for shift in range(k):
                some = slice(shift, len(pace) - k + 1 + shift)
                pace[some] = np.maximum(pace[some], slow)
        alike = float(pace.max()) * float(task.least.sum())
        each = float(np.minimum(pace * task.least, stops).sum())
        return min(alike, each / _MUCH) <= float(stops.sum())

    def _stops(self, task: Task, way: FloatArray, window: Window) -> FloatArray:
        """Moments of the way-points (n,) from stop to stop, or as they were planned before."""
        assert task.least is not None
        gaps = stops_between(way, self._table)
        _, v, a = task.start
        if window.state.moving:
            _, A, J = self._table.T
            gaps[0] += float((np.abs(v) / A + A / J + np.abs(a) / J).max())
        return window.going_on(np.cumsum(np.maximum(gaps, task.least)))

    def _exact(self, task: Task, moments: FloatArray, left: IntArray) -> _Start:
        """From stop to stop: knots as dense as these way-points need, a motion that always is."""
        length = max(int(np.ceil(moments[-1] + self._tail(task))), 2 * _FEWEST)
        if task.end is not None:
            moments = moments[:-1]
        knots = Knots(among(moments, left, length, self._spacing, KEPT * self._stop))
        task = replace(task, speed=None)
        answer = None
        for pace in (1.0, 1.5, 4.0):
            answer = answer or feasible(task, knots, moments, pace, 1.0)
        return _Start(task, knots, moments, np.arange(len(moments)), 1.0, answer)

    def _finished(
        self, task: Task, asked: FloatArray, start: _Start
    ) -> tuple[float, Knots, Answer] | None:
        """In whole cycles, past all way-points; first, how much further off than it should be."""
        if start.answer is None or start.answer.pace > _LOST:
            return None
        few, keep = start.few, start.keep
        unknowns = len(start.knots) * len(start.task.unit)
        rounds = int(np.clip(_WORK / unknowns, _LEAST_ROUNDS, ROUNDS))
        found = fastest(start.task, start.knots, start.answer, keep, rounds)
        made = in_cycles(start.task, start.knots, found, keep)
        if made is None:
            return None
        final, answer = made
        if len(few) == len(asked):
            return 0.0, final, answer
        ends = start.knots.duration, final.duration
        every = _between(start.moments, few, answer.moments, asked, ends)
        answer = replace(answer, moments=every)
        answer = at_pace(task, final, answer, keep) or answer
        far = np.abs(places(final, answer) - task.points) / (task.unit * keep)
        return float(far.max()) / 3.0, final, answer

    def _start(self, task: Task, moments: FloatArray, left: IntArray, length: int) -> _Start:
        """A motion to begin with; the tolerance is raised, tenfold at most, if it is noise."""
        knots = self._knots(left, length, 1.0)
        own = Knots(among(moments, left, length, self._spacing, KEPT * self._stop))
        few: IntArray = np.arange(len(moments))
        if len(own) <= len(knots):  # none for each way-point, or not everywhere as many
            knots = own
        else:
            few = _apart(
                moments,
                0.7 * float(knots.lengths.mean()),
                np.inf if task.end is None else knots.duration,
            )
        least = _sums(task.least, few, task.end is not None)
        thin = replace(task, points=task.points[few], speed=None, least=least)
        keep = np.ones((1, len(task.unit)))
        if float(knots.lengths.mean()) > 2.0:  # with the finest knots only time helps
            keep = keep * resolution(thin, knots, moments[few], 1.0)
        most = self._raised(task, len(few) < len(moments)) / task.unit[None]
        answer = None
        if (keep <= most).all():
            for pace in (1.0, 4.0):  # from nearer the optimum where that is far
                answer = answer or feasible(thin, knots, moments[few], pace, keep)
            while (keep < most).any() and (answer is None or answer.pace > 1.0 + _NOISE):
                more = np.minimum(10.0 * keep, most)
                other = feasible(thin, knots, moments[few], 1.0, more)
                slow = np.inf if answer is None else (1.0 - _NOISE) * answer.pace
                if other is not None and other.pace <= slow:
                    answer, keep = other, more
                elif answer is not None:
                    break
                else:
                    keep = more
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


def _arrival(task: Task, knots: Knots, answer: Answer) -> float:
    """When the last way-point is reached."""
    return knots.duration if task.end is not None else float(answer.moments[-1])


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
