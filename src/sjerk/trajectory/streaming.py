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
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from sjerk.errors import InputError, positive, real
from sjerk.limits import limits_of_each
from sjerk.profile import FloatArray, Limits
from sjerk.trajectory.horizon import Aims, Horizon, Mode, Plan, numbered
from sjerk.trajectory.joining import both
from sjerk.trajectory.known import Known, Turns, row_of
from sjerk.trajectory.segments import Followed
from sjerk.trajectory.stream_report import Ledger, StreamReport

#: Periods that a goal's time may lie beyond what is known: more is another clock.
FURTHEST = 100
#: Longest delay, in periods.
_LONGEST = 10_000
#: Knots in the time of a stop from full velocity.
KNOTS = 12
#: How far ahead goals are looked at, in stops.
_AHEAD = 3.0
#: Goals closer to a turn than this share of what a knot covers at full velocity are no turn.
RESOLUTION = 1e-4
#: Goals met closer than this, in knots at full velocity, need no common progress.
_CLOSE = 1e-2
#: Up to so many knots ahead; further ones may be further off.
_NEAR = 2.0
#: A goal counts as denser than knots down to this share of one.
_DENSE = 1e-3
#: Of the way a source needs to stop, by differences of its goals.
_SURE = 0.98
#: Differences of control points below this share of a knot's way at full velocity are none.
_STILL = 1e-9
#: Weight of jerk against distance from the goals.
SMOOTHING = 0.1
#: Iterations of the solver in one solution.
ITERATIONS = 40
_CYCLES = 2**50


class GoalStream:
    """Goals of N joints, 2 Hz to the control rate, followed a delay behind.

    ``limits``: one for all joints or one each; ``start`` (N,): where the joints rest. ``period``
    (s): time between goals, unless they have times of their own. ``delay``: the motion passes a
    goal so many periods after the first one's arrival and its time; ``margin`` (s) is added to it,
    for goals that come late and for handing over.

    A stream is trusted to keep its limits: the plan may rest beyond the last goal known by what the
    source itself still needs to stop. With ``stop_within`` it always ends at rest at the last goal
    known, without another; where the delay is shorter than a stop the velocity dips.

    Goals that lie further on never make the motion go back. Those that limits do not allow in time
    are passed later, all joints together; the lag is made up as fast as the limits allow.
    ``smoothing`` is the weight of jerk against distance from the goals: small (1e-4) for exact
    goals, the default for goals with noise. With ``exact`` goals that are not denser than knots are
    met to rounding where the limits allow it.

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
        limits: Limits | Sequence[Limits],
        cycle_time: float,
        start: ArrayLike,
        *,
        period: float,
        delay: int = 4,
        margin: float = 0.0,
        stop_within: bool = False,
        smoothing: float = SMOOTHING,
        exact: bool = False,
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
        self._limits = limits_of_each(limits, np.size(start))
        n = len(self._limits)
        self._names = tuple(joint_names or (f"joint{k}" for k in range(n)))
        if len(self._names) != n:
            raise InputError("joint_names", self._names, f"must be one per joint: {n}")
        self._behind = self._cycles(delay * self._period + margin)
        self._within, self._exact = bool(stop_within), bool(exact)
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
        self._per_cycle = np.array(
            [[x.velocity * self._T, x.acceleration * self._T**2, x.jerk * self._T**3] for x in own]
        )
        self._ranges = np.array(
            [(-np.inf, np.inf) if x.position is None else x.position for x in self._limits]
        )
        self._known = Known(at, 0, 0.0)
        self._first = True  # no goal was timed yet since the start or a rest elsewhere
        self._ended = False
        self._arriving = 0  # knots of a plan that ends on the last goal
        self._cycle = self._segments = self._begin = 0
        self._noise = np.zeros(n)
        self._told = Ledger(n)
        self._turns = Turns(at, RESOLUTION * self._horizon.velocity)

    # ---- what comes in

    def push(
        self, position: ArrayLike, time: float | None = None, *, velocity: ArrayLike | None = None
    ) -> None:
        """Take a goal: ``position`` (N,), ``time`` (s) after the goal before's, else a period.

        The first one is due the delay after the cycle handed out so far, the others by their times
        after it; one without a time that comes at rest, when no goal is ahead, is timed anew.
        ``velocity`` (N,) is what the goal moves with, if that is known. Raises InputError: not
        finite, outside the position limits, times that do not increase, or lie more than
        ``FURTHEST`` periods beyond the newest goal and what was handed out; an ended stream.
        """
        if self._ended:
            raise InputError("position", position, "the stream was ended")
        goal = self._row("position", position)
        speed = None if velocity is None else self._row("velocity", velocity)
        for name, limit, x in zip(self._names, self._limits, goal.tolist(), strict=True):
            if limit.position is not None and not limit.position[0] <= x <= limit.position[1]:
                raise InputError(f"position of {name}", x, f"must lie in {limit.position}")
        known = self._known
        at = known.time + self._period if time is None else real("time", time)
        if self._told.goals and not at > known.time:
            raise InputError("time", time, f"must be after {known.time}")
        idle = max(self._cycle + self._behind - known.last_cycle, 0) * self._T
        most = known.time + idle + FURTHEST * self._period
        if not self._first and at > most * (1.0 + 1e-12):
            raise InputError("time", time, f"must be at most {most!r}: {FURTHEST} periods ahead")
        if self._first or (time is None and self._waiting()):
            self._first = False
            due = float(self._cycle + self._behind)
            self._begin = round(due) - self._cycles(self._period)
            self._known = Known(self._horizon.knot.position, self._begin, at)
            self._horizon.progress = np.zeros(1)
        else:
            due = known.last_cycle + (at - known.time) / self._T
            due = round(due) if abs(due - round(due)) < 1e-6 else due
        self._known.add(goal, due, at, speed)
        self._told.goals += 1
        self._arriving = 0
        self._turns.add(goal)

    def end(self) -> None:
        """No goal comes any more: the motion ends at rest on the last one."""
        self._ended = True

    def rested(self, position: ArrayLike, cycle: int) -> None:
        """Go on from rest elsewhere, in ``cycle``: what was handed out was not played to its end.

        Counts as starved; the goals ahead are timed anew. Raises InputError.
        """
        at, known = self._row("position", position), self._known
        self._look()
        self._horizon.rest(at)
        self._cycle = max(self._cycle, cycle)
        self._told.starve(True)
        self._arriving, self._begin = 0, self._cycle
        self._first = known.first == len(known)
        known.position[known.first - 1] = at
        if not self._first:
            known.move(self._cycle + self._behind - float(known.cycle[known.first]))

    def skipped(self, cycles: int) -> None:
        """So many cycles of the clock were left out: goals are due as much earlier."""
        self._known.move(-cycles)
        if self._horizon.resting:
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
        return (
            self._ended
            and self._horizon.resting
            and not self._horizon.knot.moving
            and self._on_last()
        )

    @property
    def report(self) -> StreamReport:
        """What has become of the goals so far."""
        return self._told.report(self._turns.more())

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

    def keep(self, cycle: int) -> int:
        """Hand out the plan as it is, up to ``cycle`` or to its rest: what ``remainder`` told.

        For what is played already. Returns how many segments.
        """
        begun, horizon = self._segments, self._horizon
        while self._cycle < cycle and not (horizon.resting and not horizon.knot.moving):
            made = horizon.settle(1) if horizon.resting else self._knot(None)
            self._arriving = max(self._arriving - 1, 0)
            self._cycle += int(made.cycles[0])
            self._segments += 1
        return self._segments - begun

    def remainder(self) -> list[Followed]:
        """What would follow if nothing else came: to rest. Hands out nothing."""
        return self._horizon.remainder(self._names, self._segments, self._cycle)

    # ---- the next piece

    def _next(self, cycle: int) -> Followed:
        """A rest, or one knot more."""
        horizon = self._horizon
        if horizon.resting:
            if horizon.knot.moving:
                return horizon.settle(1)
            if self._waiting() and not (self._ended and not self._on_last()):
                return horizon.settle(max(cycle - self._cycle, 1))
            if self._cycle < self._begin and not self._waiting():
                return horizon.settle(min(self._begin, cycle) - self._cycle)
        if self._arriving:
            self._arriving -= 1
            plan = None
        else:
            plan = self._plan()
            horizon.end = self._known.last.copy()
        return self._knot(plan)

    def _knot(self, plan: Plan | None) -> Followed:
        """One knot of a plan, or of the one before."""
        horizon = self._horizon
        self._count(plan)
        before = horizon.given[:, 2].copy()
        way = horizon.plan[:, 0] if plan is None else plan.control[:, 0]
        step = np.where(np.abs(way - before) > _STILL * horizon.velocity, way - before, 0.0)
        self._turns.sign, self._turns.count = self._turns.see(step[:, None])
        return horizon.hand_out(plan)

    def _look(self) -> None:
        """Which goals are ahead."""
        now = self._cycle + 0.5 + (self._horizon.progress[0] + 1e-9) * self._m
        self._known.forget(now)

    def _waiting(self) -> bool:
        """Whether no goal is ahead."""
        now = self._cycle + 0.5 + (float(self._horizon.progress[0]) + 1e-9) * self._m
        return self._known.last_cycle <= now

    def _on_last(self) -> bool:
        return bool((self._horizon.knot.position == self._known.last).all())

    def _plan(self) -> Plan:
        """Each joint by itself where goals are met so; else with a common progress."""
        horizon, known = self._horizon, self._known
        self._look()
        known.trim(
            min(known.last_cycle, self._cycle + horizon.progress[0] * self._m) - 3.0 * self._m
        )
        # the sample is half a cycle behind the spline
        due = (known.cycle - (self._cycle + 0.5)) / self._m
        self._told.starve(known.first == len(known) and not self._ended and not self._within)
        self._noise = known.noise(3 * self._m, self._per_cycle)
        best = None
        if horizon.progress[0] > -1e-2:
            progress = np.arange(float(2 * (self._most + self._tail)))
            best = self._solve(due, progress, paced=False)
        if best is None or not self._close(best):
            progress = horizon.ahead(2 * (self._most + self._tail))
            best = self._solve(due, progress, paced=True)
        if best is None:
            self._told.kept += 1
            progress = horizon.ahead(2 * (self._most + self._tail))
            aims, knots = self._aims(due, progress)
            best = horizon.solve(aims, knots, progress, paced=False, mode=Mode.AS_BEFORE, most=0)
        if horizon.resting and -horizon.progress[0] > self._tail and self._still(best):
            # it turned before a goal, and does not go back to it
            progress = best.progress - best.progress[0] + due[min(known.first, len(due) - 1)]
            return replace(best, progress=progress)
        return self._arrive(due, best) or best

    def _solve(
        self,
        due: FloatArray,
        progress: FloatArray,
        *,
        paced: bool,
    ) -> Plan | None:
        """The best plan that turns no more often than the goals do."""
        aims, knots = self._aims(due, progress)
        exact = 0
        if self._exact and len(aims.moment):  # not where it must stop
            until = np.inf if aims.ended else aims.moment[-1] - self._tail
            exact = int(np.searchsorted(aims.moment, until))
        attempts = [(mode, aims) for mode in Mode]
        if aims.turning.any():
            free = np.where(aims.turning, 0, aims.direction).astype(np.int32)
            attempts.insert(0, (Mode.HARD, replace(aims, direction=free)))
        for mode, asked in attempts:
            best = self._horizon.solve(
                asked,
                knots,
                progress[: knots + 1],
                paced=paced,
                mode=mode,
                exact=exact,
            )
            if (mode is not Mode.HARD or best.share.all()) and self._keeps_turns(aims, best):
                break
        else:
            return None
        last = min(knots, max(1, math.ceil(aims.moment[-1]) if len(aims.moment) else 1))
        more = np.arange(1.0, 2 * (self._most + self._tail) - last)
        progress = np.concatenate([best.progress[: last + 1], best.progress[last] + more])
        return replace(best, progress=progress)

    def _keeps_turns(self, aims: Aims, plan: Plan) -> bool:
        steps = np.diff(plan.control, axis=1, prepend=self._horizon.given[:, 2:])
        still = _STILL * self._horizon.velocity[:, None]
        return self._turns.kept(aims.direction, np.where(np.abs(steps) > still, steps, 0.0))

    def _still(self, plan: Plan) -> bool:
        way = np.abs(plan.control - self._horizon.given[:, 2:]).max(axis=1)
        return bool((way <= _CLOSE * self._horizon.velocity).all())

    def _close(self, plan: Plan) -> bool:
        """Whether goals are met, so that the joints need nothing in common; far ones may change."""
        allowed = _CLOSE * self._horizon.velocity + 2.0 * self._noise
        far = 1.0 + (plan.moment[:, None] / _NEAR) ** 2
        return bool((np.abs(plan.deviation) <= far * allowed).all())

    def _aims(self, due: FloatArray, progress: FloatArray) -> tuple[Aims, int]:
        """The goals as a plan with this progress has them, and its length."""
        horizon, known = self._horizon, self._known
        first, position = known.first, known.position
        rising = np.maximum.accumulate(progress) + 1e-9 * np.arange(len(progress))
        moment = np.interp(due, rising, np.arange(float(len(rising))))
        moment = np.where(due > rising[-1], len(rising) - 1 + due - rising[-1], moment)
        moment = np.where(due < rising[0], due - rising[0], moment)
        ahead = np.arange(first, first + int(np.searchsorted(moment[first:], self._most)))
        at = moment[ahead]
        knots = (math.ceil(at[-1]) if len(at) else 0) + self._tail
        knots = max(knots, horizon.plan.shape[1])
        gap = np.diff(at, prepend=moment[first - 1])
        slopes = known.slopes(due, ahead)
        speed = None
        if known.speeds:
            speed = known.velocity[ahead] * (self._m * self._T)
            speed = np.where(np.isnan(speed), slopes, speed)
        last, here = position[-1], horizon.knot.position
        whole = len(ahead) == len(due) - first  # else the plan rests on the last one looked at
        end = last if whole else position[first - 1 + len(ahead)]
        low = np.minimum(np.minimum(position[first:].min(axis=0, initial=np.inf), here), last)
        high = np.maximum(np.maximum(position[first:].max(axis=0, initial=-np.inf), here), last)
        if not self._within and not self._ended:
            more = known.onward(self._m, self._per_cycle)
            more = np.sign(more) * np.maximum(_SURE * np.abs(more) - _CLOSE * horizon.velocity, 0.0)
            low, high = np.minimum(low, last + more), np.maximum(high, last + more)
        low, high = np.maximum(low, self._ranges[:, 0]), np.minimum(high, self._ranges[:, 1])
        return (
            Aims(
                at,
                np.clip(gap, _DENSE, 1.0),
                position[ahead],
                slopes,
                speed,
                np.column_stack([low, high]),
                *known.directions(
                    moment,
                    knots,
                    horizon.given + horizon.origin[:, None],
                    self._turns.sign,
                    np.maximum(RESOLUTION * horizon.velocity, 2.5 * self._noise),
                    final=self._within or self._ended,
                ),
                end,
                self._ended and whole,
            ),
            knots,
        )

    def _arrive(self, due: FloatArray, best: Plan) -> Plan | None:
        """The first knot in which all joints can rest on the last goal, if there is one soon."""
        first = self._known.first
        if not (self._ended or (self._within and first == len(due))):
            return None
        aims, _ = self._aims(due, best.progress)
        last = float(aims.moment[-1]) if len(aims.moment) else 0.0
        if len(aims.moment) < len(due) - first:
            return None
        worst = np.abs(best.deviation).max(axis=0, initial=0.0)
        allowed = np.maximum(1.2 * worst, 3.0 * _CLOSE * self._horizon.velocity)
        met = bool((worst <= RESOLUTION * self._horizon.velocity).all())
        exact = len(aims.moment) if self._exact and met else 0
        n = max(1, math.ceil(last - 1e-9) - 2)
        for knots in range(n, n + self._tail):
            short = replace(
                aims, direction=np.ascontiguousarray(aims.direction[:, :knots]), ended=True
            )
            progress = best.progress[: knots + 1]
            if len(progress) < knots + 1:
                return None
            found = self._horizon.solve(
                short, knots, progress, paced=False, ends=True, exact=exact, plan=best.control
            )
            close = (found.share == 1.0).all() and (np.abs(found.deviation) <= allowed).all()
            if close and self._keeps_turns(short, found):
                self._arriving = knots + 2
                return replace(found, progress=best.progress)
        return None

    # ---- bookkeeping

    def _count(self, plan: Plan | None) -> None:
        """The goals that the next knot passes."""
        self._look()
        known, horizon = self._known, self._horizon
        progress = horizon.ahead(1) if plan is None else plan.progress
        until = self._cycle + 0.5 + (float(progress[1]) + 1e-9) * self._m
        passed = int(np.searchsorted(known.cycle, until, side="right")) - known.first
        if passed > 0:
            off = np.zeros((0, len(self._limits))) if plan is None else plan.deviation[:passed]
            self._told.passing(passed, off, (1.0 - float(progress[1])) * self._m * self._T)
        self._told.rests(np.abs(horizon.knot.position - self._known.last))

    def _cycles(self, seconds: float) -> int:
        return int(seconds / self._T * (1.0 + 1e-12) + 0.5)

    def _row(self, name: str, value: ArrayLike) -> FloatArray:
        return row_of(name, value, len(self._limits))
