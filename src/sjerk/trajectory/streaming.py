"""Streamed goals with look-ahead: goals come one by one, the motion goes through them.

Commanding each goal as it comes makes it interrupt the one before. ``GoalStream`` runs a delay
behind its goals instead and plans through all that are known, anew with each knot, as control
points of a spline that ends at rest. It hands out segments as ``follow`` does.
``docs/explanation/trajectories.md`` has the method. A pure library: cycles are told, not read from
a clock. Never here: shared memory, drives.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sjerk.errors import InputError, positive, real
from sjerk.planner.planning import plan_velocity
from sjerk.profile import FloatArray, Limits, State
from sjerk.trajectory.horizon import Aims, Horizon, Plan, numbered
from sjerk.trajectory.joining import both
from sjerk.trajectory.segments import Followed

#: Periods that a goal's time may lie beyond what is known: more is another clock.
FURTHEST = 100
#: Longest delay, in periods.
_LONGEST = 256
#: Knots in the time of a stop from full velocity.
KNOTS = 12
#: How far ahead goals are looked at, in stops.
_AHEAD = 3.0
#: Goals closer to a turn than this share of what a knot covers at full velocity are no turn.
RESOLUTION = 1e-4
#: Goals met closer than this, in knots at full velocity, need no common progress.
_CLOSE = 5e-3
#: A goal counts as denser than knots down to this share of one.
_DENSE = 1e-3
#: Of the way a source needs to stop, by differences of its goals.
_SURE = 0.98
_ROUNDS = 2
#: Differences of control points below this share of a knot's way at full velocity are none.
_STILL = 1e-9
#: Iterations of the solver in one solution.
ITERATIONS = 40
_CYCLES = 2**50


@dataclass(frozen=True, eq=False)
class StreamReport:
    """What has become of the goals, by what was handed out.

    ``goals`` given, ``passed`` so far; ``deviation`` (N,): largest distance from a goal in its
    cycle, the lag added. ``lag``, ``largest_lag`` (s): behind time plus delay, now and at most.
    ``starved``: how often the goals ran out in motion; ``starving``: now; ``beyond`` (N,): how far
    past the last goal then. ``reversals`` (N,): turns that the goals do not have.
    """

    goals: int
    passed: int
    deviation: FloatArray
    lag: float
    largest_lag: float
    starved: int
    starving: bool
    beyond: FloatArray
    reversals: NDArray[np.int64]


class _Goal(NamedTuple):
    """``time`` (s) in the stream's own clock; ``cycle`` in which it is due."""

    position: FloatArray
    time: float
    cycle: int
    velocity: FloatArray | None


class GoalStream:
    """Goals of N joints, 2 Hz to the control rate, followed a delay behind.

    ``limits``: one per joint; ``start`` (N,): where the joints rest. ``period`` (s): time between
    goals, unless they have times of their own. ``delay``: the motion passes a goal so many periods
    after the first one's arrival and its time; ``margin`` (s) is added to it, for goals that come
    late and for handing over.

    A stream is trusted to keep its limits: the plan may rest beyond the last goal known by what the
    source itself still needs to stop. With ``stop_within`` it always ends at rest at the last goal
    known, without another; where the delay is shorter than a stop the velocity dips.

    Goals that lie further on never make the motion go back. Those that limits do not allow in time
    are passed later, all joints together; the lag is made up as fast as the limits allow.
    ``smoothing`` is the weight of jerk against distance from the goals: small (1e-4) for exact
    goals, the default for goals with noise.

    >>> stream = GoalStream([Limits(2.0, 4.0, 500.0)], 1e-3, [0.0], period=0.1)
    >>> blocks = []
    >>> for k in range(1, 20):
    ...     stream.push([0.01 * k])
    ...     blocks += stream.take(100 * k)
    >>> stream.end()
    >>> while not stream.done:
    ...     blocks += stream.take(stream.cycle + 1)
    >>> float(blocks[-1].position[-1, 0]), stream.report.starved
    (0.19, 0)
    """

    def __init__(
        self,
        limits: Sequence[Limits],
        cycle_time: float,
        start: ArrayLike,
        *,
        period: float,
        delay: int = 4,
        margin: float = 0.0,
        stop_within: bool = False,
        smoothing: float = 0.1,
        knots: int = KNOTS,
        iterations: int = ITERATIONS,
        joint_names: Sequence[str] | None = None,
    ) -> None:
        """Raises InputError."""
        self._T = positive("cycle_time", cycle_time)
        self._period = positive("period", period)
        if self._period < self._T * (1 - 1e-9):
            raise InputError("period", period, f"must be at least a cycle of {self._T!r} s")
        for name, value, least, most in (
            ("delay", delay, 1, _LONGEST),
            ("knots", knots, 6, 48),
            ("iterations", iterations, 3, 200),
        ):
            if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
                raise InputError(name, value, f"must be an int in {least} .. {most}")
        if real("margin", margin) < 0.0:
            raise InputError("margin", margin, "must not be negative")
        if isinstance(limits, Limits) or not all(isinstance(limit, Limits) for limit in limits):
            raise InputError("limits", limits, "must be a list of one Limits per joint")
        self._limits = list(limits)
        n = len(self._limits)
        self._names = tuple(joint_names or (f"joint{k}" for k in range(n)))
        if len(self._names) != n:
            raise InputError("joint_names", self._names, f"must be one per joint: {n}")
        self._behind = self._cycles(delay * self._period + margin)
        self._within = bool(stop_within)
        own = [both(limit) for limit in self._limits]
        stop = max(x.velocity / x.acceleration + x.acceleration / x.jerk for x in own)
        self._m = max(2, round(stop / knots / self._T))
        self._tail = math.ceil(stop / self._T / self._m) + 3
        self._most = math.ceil(_AHEAD * stop / self._T / self._m)
        at = self._row("start", start)
        self._horizon = Horizon(
            self._limits,
            self._T,
            self._m,
            at,
            smoothing=positive("smoothing", smoothing),
            iterations=iterations,
        )
        self._ranges = np.array(
            [(-np.inf, np.inf) if x.position is None else x.position for x in self._limits]
        )
        self._known: list[_Goal] = [_Goal(at, 0.0, 0, None)]  # the last ones passed, and those ahead
        self._first = True  # no goal was timed yet since the start or a rest elsewhere
        self._ended = False
        self._arriving = 0  # knots of a plan that ends on the last goal
        self._cycle = self._segments = self._begin = 0
        self._goals = self._passed = self._starved = 0
        self._worst = self._lag = 0.0
        self._starving = False
        self.kept = 0
        self._beyond, self._deviation = np.zeros(n), np.zeros(n)
        self._turns = _Turns(at, RESOLUTION * self._horizon.velocity)

    # ---- what comes in

    def push(
        self, position: ArrayLike, time: float | None = None, *, velocity: ArrayLike | None = None
    ) -> None:
        """Take a goal: ``position`` (N,), ``time`` (s) after the goal before's, else a period.

        The first one is due the delay after the cycle handed out so far, the others by their times
        after it; one without a time that comes at rest, when no goal is ahead, is timed anew.
        ``velocity`` (N,) is what the goal moves with, if that is known. Raises InputError: not
        finite, outside the position limits, times that do not increase, or lie more than
        ``FURTHEST`` periods beyond the newest goal and what was handed out; a stream that was ended.
        """
        if self._ended:
            raise InputError("position", position, "the stream was ended")
        goal = self._row("position", position)
        speed = None if velocity is None else self._row("velocity", velocity)
        for name, limit, x in zip(self._names, self._limits, goal.tolist(), strict=True):
            if limit.position is not None and not limit.position[0] <= x <= limit.position[1]:
                raise InputError(f"position of {name}", x, f"must lie in {limit.position}")
        last = self._known[-1]
        at = last.time + self._period if time is None else real("time", time)
        if self._goals and not at > last.time:
            raise InputError("time", time, f"must be after {last.time}")
        idle = max(self._cycle + self._behind - last.cycle, 0) * self._T
        most = last.time + idle + FURTHEST * self._period
        if not self._first and at > most * (1.0 + 1e-12):
            raise InputError("time", time, f"must be at most {most!r}: {FURTHEST} periods ahead")
        if self._first or (time is None and self._waiting()):
            self._first = False
            due = self._cycle + self._behind
            self._begin = due - self._cycles(self._period)
            self._known = [_Goal(self._horizon.knot.position, at, self._begin, None)]
            self._horizon.progress = np.zeros(1)
        else:
            due = max(last.cycle + self._cycles(at - last.time), last.cycle + 1)
        self._known.append(_Goal(goal, at, due, speed))
        self._goals += 1
        self._arriving = 0
        self._turns.add(goal)

    def end(self) -> None:
        """No goal comes any more: the motion ends at rest on the last one."""
        self._ended = True

    def rested(self, position: ArrayLike, cycle: int) -> None:
        """Go on from rest elsewhere, in ``cycle``: what was handed out was not played to its end.

        Counts as starved; the goals ahead are timed anew. Raises InputError.
        """
        at = self._row("position", position)
        ahead = self._known[self._index() :]
        self._horizon.rest(at)
        self._cycle = max(self._cycle, cycle)
        self._starving, self._arriving, self._first = True, 0, not ahead
        self._starved += 1
        if ahead:
            late = self._cycle + self._behind - ahead[0].cycle
            ahead = [goal._replace(cycle=goal.cycle + late) for goal in ahead]
            self._begin = self._cycle
            self._known = [_Goal(at, ahead[0].time - self._period, self._begin, None), *ahead]
        else:
            self._known = [self._known[-1]]

    def skipped(self, cycles: int) -> None:
        """So many cycles of the clock were left out: goals are due as much earlier."""
        self._known = [goal._replace(cycle=goal.cycle - cycles) for goal in self._known]
        if self._waiting() or self._horizon.resting:
            self._begin -= cycles
        else:
            self._horizon.progress = self._horizon.progress - cycles / self._m

    # ---- what goes out

    @property
    def cycle(self) -> int:
        """Cycles handed out."""
        return self._cycle

    @property
    def done(self) -> bool:
        """Whether the stream was ended and what was handed out rests on its last goal."""
        return self._ended and self._horizon.resting and not self._horizon.knot.moving and self._on_last()

    @property
    def report(self) -> StreamReport:
        """What has become of the goals so far."""
        return StreamReport(
            self._goals,
            self._passed,
            self._deviation.copy(),
            self._lag,
            self._worst,
            self._starved,
            self._starving,
            self._beyond.copy(),
            self._turns.more(),
        )

    def take(self, cycle: int) -> list[Followed]:
        """Hand out the motion up to ``cycle`` of the stream, or to the next knot behind it.

        What was handed out stands; the rest is planned anew with each knot. Call it as late as the
        motion must be known: the later, the more goals are. A rest without goals is one segment,
        however long. Raises InputError.
        """
        if isinstance(cycle, bool) or not isinstance(cycle, int) or cycle > _CYCLES:
            raise InputError("cycle", cycle, f"must be an int, at most {_CYCLES}")
        found = []
        while self._cycle < cycle and not self.done:
            made = self._next(cycle)
            found.append(numbered(made, self._names, self._segments, self._cycle))
            self._cycle += int(made.cycles.sum())
            self._segments += len(made)
        return found

    def remainder(self) -> list[Followed]:
        """What would follow if nothing else came: to rest. Hands out nothing."""
        return self._horizon.remainder(self._names, self._segments, self._cycle, self._last())

    # ---- the next piece

    def _next(self, cycle: int) -> Followed:
        """A rest, or one knot more."""
        horizon = self._horizon
        if horizon.resting:
            if horizon.knot.moving:
                return horizon.settle(1, self._last())
            if self._waiting() and not (self._ended and not self._on_last()):
                return horizon.settle(max(cycle - self._cycle, 1), self._last())
            if self._cycle < self._begin and not self._waiting():
                return horizon.settle(min(self._begin, cycle) - self._cycle, self._last())
        if self._arriving:
            self._arriving -= 1
            plan = None
        else:
            plan = self._plan()
        self._count(plan)
        before = horizon.given[:, 2].copy()
        way = horizon.plan[:, 0] if plan is None else plan.control[:, 0]
        step = np.where(np.abs(way - before) > _STILL * horizon.velocity, way - before, 0.0)
        self._turns.sign, self._turns.count = self._turns.see(step[:, None])
        return horizon.hand_out(plan, self._last())

    def _index(self) -> int:
        """The first goal that is ahead."""
        now = self._horizon.progress[0]
        due = self._due()
        return int(np.searchsorted(due, now + 1e-9, side="right"))

    def _due(self) -> FloatArray:
        """When goals are due, in knots from now; the sample is half a cycle behind the spline."""
        cycles = np.array([goal.cycle for goal in self._known], dtype=np.float64)
        return (cycles - 0.5 - self._cycle) / self._m

    def _waiting(self) -> bool:
        return self._index() == len(self._known)

    def _last(self) -> FloatArray:
        return self._known[-1].position

    def _on_last(self) -> bool:
        return bool((self._horizon.knot.position == self._last()).all())

    def _plan(self) -> Plan:
        """Each joint by itself where goals are met so; else with a common progress."""
        horizon = self._horizon
        first = self._index()
        self._known = self._known[max(0, first - 1 - self._kept(first)) :]
        due = self._due()
        first = self._index()
        self._starve(first == len(due))
        best = None
        if horizon.progress[0] > -1e-2:
            progress = np.arange(float(2 * (self._most + self._tail)))
            best = self._solve(due, progress, first, None, paced=False)
        if best is None or not self._close(best):
            progress, plan = horizon.ahead(2 * (self._most + self._tail)), None
            for _ in range(_ROUNDS):
                best = self._solve(due, progress, first, plan, paced=True)
                if best is None:
                    break
                progress, plan = best.progress, best.control
        if best is None:
            self.kept += 1
            aims, knots = self._aims(due, horizon.ahead(2 * (self._most + self._tail)), first)
            best = horizon.stay(aims, knots)
        return self._arrive(due, first, best) or best

    def _solve(
        self,
        due: FloatArray,
        progress: FloatArray,
        first: int,
        plan: FloatArray | None,
        *,
        paced: bool,
    ) -> Plan | None:
        """The best plan that turns no more often than the goals do."""
        aims, knots = self._aims(due, progress, first, 0 if plan is None else plan.shape[1])
        for strict in (False, True):
            best = self._horizon.solve(
                aims, knots, progress[: knots + 1], paced=paced, plan=plan, strict=strict
            )
            if self._turns_kept(aims, best):
                break
        else:
            return None
        last = min(knots, max(1, math.ceil(aims.moment[-1]) if len(aims.moment) else 1))
        more = np.arange(1.0, 2 * (self._most + self._tail) - last)
        progress = np.concatenate([best.progress[: last + 1], best.progress[last] + more])
        return Plan(best.control, progress, best.share, best.deviation, best.iterations)

    def _turns_kept(self, aims: Aims, plan: Plan) -> bool:
        """Whether it turns no more often than the goals, or than its directions."""
        steps = np.diff(plan.control, axis=1, prepend=self._horizon.given[:, 2:])
        steps = np.where(np.abs(steps) > _STILL * self._horizon.velocity[:, None], steps, 0.0)
        _, count = self._turns.see(steps)
        _, asked = self._turns.see(aims.direction.astype(np.float64))
        asked = asked + (aims.direction == 0).any(axis=1)
        return bool((count <= np.maximum(self._turns.asked, asked)).all())

    def _close(self, plan: Plan) -> bool:
        """Whether goals are met, so that the joints need nothing in common."""
        return bool((np.abs(plan.deviation) <= _CLOSE * self._horizon.velocity).all())

    def _kept(self, first: int) -> int:
        """Passed goals to keep, for differences over a knot."""
        least = self._known[min(first, len(self._known) - 1)].cycle - 3 * self._m
        kept = 0
        while kept < first - 1 and self._known[first - 2 - kept].cycle > least:
            kept += 1
        return kept + 2

    def _starve(self, out: bool) -> None:
        if not out or self._ended or self._within:
            self._starving = False
        elif not self._starving:
            self._starving = True
            self._starved += 1

    def _aims(
        self, due: FloatArray, progress: FloatArray, first: int, least: int = 0
    ) -> tuple[Aims, int]:
        """The goals as a plan with this progress has them, and its length."""
        horizon = self._horizon
        position = np.array([goal.position for goal in self._known])
        rising = np.maximum.accumulate(progress) + 1e-9 * np.arange(len(progress))
        moment = np.interp(due, rising, np.arange(float(len(rising))))
        moment = np.where(due > rising[-1], len(rising) - 1 + due - rising[-1], moment)
        moment = np.where(due < rising[0], due - rising[0], moment)
        ahead = np.arange(first, len(due))
        ahead = ahead[moment[ahead] < self._most]
        at = moment[ahead]
        knots = (math.ceil(at[-1]) if len(at) else 0) + self._tail
        knots = max(knots, horizon.plan.shape[1], least)
        gap = np.diff(at, prepend=moment[ahead[0] - 1] if len(ahead) and ahead[0] else 0.0)
        speed = None
        if any(self._known[i].velocity is not None for i in ahead):
            speed = np.array([self._velocity(i, due) for i in ahead])
        last = position[-1]
        here = horizon.knot.position
        given = horizon.given[:, 2] + horizon.origin
        low = np.minimum(np.minimum(position[first:].min(axis=0, initial=np.inf), here), last)
        high = np.maximum(np.maximum(position[first:].max(axis=0, initial=-np.inf), here), last)
        if not self._within and not self._ended:
            more = self._onward()
            low, high = np.minimum(low, last + more), np.maximum(high, last + more)
        low, high = np.maximum(low, self._ranges[:, 0]), np.minimum(high, self._ranges[:, 1])
        return (
            Aims(
                at,
                np.clip(gap, _DENSE, 1.0),
                position[ahead],
                self._slopes(due, position, ahead),
                speed,
                np.column_stack([low, high]),
                self._directions(moment, position, first, knots, given),
                last,
                self._ended,
            ),
            knots,
        )

    def _velocity(self, i: int, due: FloatArray) -> FloatArray:
        """Of a goal, per knot; by differences where it has none."""
        known = self._known[i].velocity
        if known is not None:
            return known * (self._m * self._T)
        position = np.array([goal.position for goal in self._known])
        return self._slopes(due, position, np.array([i]))[0]

    def _slopes(self, due: FloatArray, position: FloatArray, ahead: NDArray[np.intp]) -> FloatArray:
        """How goals change with progress: differences over at least a knot, where there are goals."""
        after = np.searchsorted(due, due[ahead] + 0.5).clip(max=len(due) - 1)
        before = (np.searchsorted(due, due[ahead] - 0.5, side="right") - 1).clip(min=0)
        time = np.maximum(due[after] - due[before], 1e-9)[:, None]
        return np.asarray((position[after] - position[before]) / time)

    def _directions(
        self,
        moment: FloatArray,
        position: FloatArray,
        first: int,
        knots: int,
        given: FloatArray,
    ) -> NDArray[np.int32]:
        """The sign of each first difference (N, knots): that of the goals where it is felt."""
        joints, centre = len(given), np.arange(knots) + 1.5
        found = np.zeros((joints, knots), dtype=np.int32)
        begin = max(first - 1, 0)
        at, way = moment[begin:], position[begin:]
        still = RESOLUTION * self._horizon.velocity
        for j in range(joints):
            going = int(self._turns.sign[j])
            found[j] = going
            for sign, one, _ in self._pieces(way[:, j], j):
                if sign == going and one == 0:
                    continue
                top = one  # where it turns: the last of equal goals
                while one == 0 and top + 1 < len(way) and abs(way[top + 1, j] - way[0, j]) <= still[j]:
                    top += 1
                since = -np.inf if going == 0 and one == 0 else at[top]
                found[j, centre >= since] = sign
        # where goals rest: on towards them; a motion that is beyond them must turn
        left, step = way[-1] - given, given - self._horizon.given[:, 1] - self._horizon.origin
        on = np.where(left * step >= 0.0, np.sign(left), 0.0).astype(np.int32)
        if not self._within and not self._ended:
            on = np.where(on == 0, self._turns.sign, on).astype(np.int32)
        flat = (np.abs(way - way[-1]) <= still).all(axis=0)
        found[flat] = on[flat, None]
        return found

    def _pieces(self, way: FloatArray, joint: int) -> list[tuple[int, int, int]]:
        return monotone_pieces(way, RESOLUTION * float(self._horizon.velocity[joint]))

    def _onward(self) -> FloatArray:
        """Trust: how far the source goes at least if it keeps the limits: its shortest stop."""
        goals = [self._known[-1]]
        for goal in reversed(self._known[:-1]):
            if len(goals) < 3 and goals[-1].cycle - goal.cycle >= self._m:
                goals.append(goal)
        more = np.zeros(len(self._limits))
        if len(goals) < 3:
            return more
        three, two, one = goals
        b, c = (two.cycle - one.cycle) * self._T, (three.cycle - two.cycle) * self._T
        v0, v1 = (two.position - one.position) / b, (three.position - two.position) / c
        for j, limits in enumerate(map(both, self._limits)):
            if v0[j] * v1[j] <= 0.0:
                continue
            sign, A, J = math.copysign(1.0, v1[j]), limits.acceleration, limits.jerk
            mean = sign * float(v1[j] - v0[j]) / ((b + c) / 2.0)
            a = max(-A, mean - J * (b + c) / 2.0)
            v = sign * float(v1[j]) + (mean + a) / 2.0 * c / 2.0 - J * c * c / 6.0
            if v > 0.0:
                state = State(0.0, min(v, limits.velocity), min(a, A))
                way = plan_velocity(state, 0.0, limits, self._T).end.position
                more[j] = sign * max(_SURE * way - _CLOSE * self._horizon.velocity[j], 0.0)
        return more

    def _arrive(self, due: FloatArray, first: int, best: Plan) -> Plan | None:
        """The first knot in which all joints can rest on the last goal, if there is one soon."""
        if not (self._ended or (self._within and first == len(due))):
            return None
        aims, _ = self._aims(due, best.progress, first)
        last = float(aims.moment[-1]) if len(aims.moment) else 0.0
        if len(aims.moment) < len(due) - first:
            return None
        worst = np.abs(best.deviation).max(axis=0, initial=0.0)
        allowed = np.maximum(1.2 * worst, _CLOSE * self._horizon.velocity)
        n = max(1, math.ceil(last - 1e-9) - 2)
        for knots in range(n, n + self._tail):
            aims, _ = self._aims(due, best.progress, first)
            short = Aims(
                aims.moment,
                aims.weight,
                aims.position,
                aims.slope,
                aims.velocity,
                aims.range,
                np.ascontiguousarray(aims.direction[:, :knots]),
                aims.end,
                True,
            )
            progress = best.progress[: knots + 1]
            if len(progress) < knots + 1:
                return None
            found = self._horizon.solve(
                short, knots, progress, paced=False, ends=True, plan=best.control
            )
            if (found.share == 1.0).all() and (np.abs(found.deviation) <= allowed).all():
                self._arriving = knots + 2
                return Plan(found.control, best.progress, found.share, found.deviation, 0)
        return None

    # ---- bookkeeping

    def _count(self, plan: Plan | None) -> None:
        """The goals that the next knot passes."""
        due, now = self._due(), self._horizon.progress[0]
        first = self._index()
        if plan is None:
            passed = int(np.sum((due > now) & (due <= self._horizon.ahead(1)[1])))
        else:
            passed = int(np.sum((due > now) & (due <= plan.progress[1])))
            if passed:
                worst = np.abs(plan.deviation[:passed]).max(axis=0, initial=0.0)
                self._deviation = np.maximum(self._deviation, worst)
        if passed and first < len(due):
            self._passed += passed
            ahead = self._horizon.ahead(1) if plan is None else plan.progress
            self._lag = max(0.0, 1.0 - float(ahead[1])) * self._m * self._T
            self._worst = max(self._worst, self._lag)
        if self._starving:
            gap = np.abs(self._horizon.knot.position - self._last())
            self._beyond = np.maximum(self._beyond, gap)

    def _cycles(self, seconds: float) -> int:
        return int(seconds / self._T * (1.0 + 1e-12) + 0.5)

    def _row(self, name: str, value: ArrayLike) -> FloatArray:
        try:
            row = np.array(value, dtype=np.float64)
        except (TypeError, ValueError) as fault:
            raise InputError(name, value, f"must be {len(self._limits)} numbers") from fault
        if row.shape != (len(self._limits),):
            raise InputError(name, row.shape, f"must have shape ({len(self._limits)},)")
        if not np.isfinite(row).all():
            raise InputError(name, row.tolist(), "must be finite")
        return row


def monotone_pieces(way: FloatArray, resolution: float) -> list[tuple[int, int, int]]:
    """Sign, first and last index of the pieces of a row that do not turn by more than so much.

    >>> monotone_pieces(np.array([0.0, 1.0, 0.999, 2.0, 0.5]), 0.01)
    [(1, 0, 3), (-1, 3, 4)]
    """
    pieces: list[tuple[int, int, int]] = []
    sign, begin, top = 0, 0, 0
    for i in range(1, len(way)):
        step = way[i] - way[top]
        if sign == 0:
            if abs(step) > resolution:
                sign, top = (1 if step > 0 else -1), i
        elif sign * step >= 0.0:
            top = i
        elif abs(step) > resolution:
            pieces.append((sign, begin, top))
            sign, begin, top = -sign, top, i
    pieces.append((sign, begin, len(way) - 1))
    return pieces


class _Turns:
    """Changes of direction per joint: of the goals, and of what was handed out."""

    def __init__(self, start: FloatArray, resolution: FloatArray) -> None:
        self._resolution, self._top = resolution, start.copy()
        self.asked = np.zeros(len(start), dtype=np.int64)
        self._going = np.zeros(len(start), dtype=np.int64)
        self.sign, self.count = self._going.copy(), self.asked.copy()

    def add(self, goal: FloatArray) -> None:
        """A goal more."""
        step = goal - self._top
        sign = np.where(np.abs(step) > self._resolution, np.sign(step), self._going).astype(np.int64)
        self.asked += (sign != self._going) & (self._going != 0)
        moved = (sign != self._going) | (self._going * step > 0.0)
        self._top, self._going = np.where(moved, goal, self._top), sign

    def more(self) -> NDArray[np.int64]:
        """Turns of the motion that the goals do not have (N,)."""
        return np.maximum(self.count - self.asked, 0)

    def see(self, steps: FloatArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Sign and count after these differences of control points (N, n)."""
        sign, count = self.sign, self.count
        for step in steps.T:
            now = np.where(step != 0.0, np.sign(step), sign).astype(np.int64)
            count = count + ((now != sign) & (sign != 0))
            sign = now
        return sign, count
