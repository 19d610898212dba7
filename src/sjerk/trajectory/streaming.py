"""Streamed goals with look-ahead: goals come one by one, the motion goes through them.

Commanding each goal as it comes makes it interrupt the one before. ``GoalStream`` runs a delay
behind its goals instead and plans through all that are known, anew with each knot, as control
points of a spline that ends at rest. It hands out segments as ``follow`` does.
``docs/explanation/streams.md`` has the method. A pure library: cycles are told, not read from
a clock. Never here: shared memory, drives.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy

import numpy as np
from numpy.typing import ArrayLike

from sjerk.errors import InputError, positive, real
from sjerk.limits import jerk_limited, limits_of_each
from sjerk.profile import FloatArray, Limits, State
from sjerk.trajectory.horizon import Horizon, Plan, numbered
from sjerk.trajectory.joining import both
from sjerk.trajectory.known import Known, row_of
from sjerk.trajectory.segments import Followed
from sjerk.trajectory.stream_arrival import Arrival
from sjerk.trajectory.stream_planner import STILL, StreamPlanner
from sjerk.trajectory.stream_report import Ledger, StreamReport

#: Periods that a goal's time may lie beyond what is known: more is another clock.
FURTHEST = 100
#: Longest delay, in periods.
_LONGEST = 10_000
#: Periods, and knots, that a stream runs behind its goals. With less than so many knots a motion
#: that the limits allow by far hunts: it slows for the last goal known, and catches up.
_DELAY = 4
#: Knots in the time of a stop from full velocity.
KNOTS = 12
#: Weight of jerk against distance from the goals.
SMOOTHING = 0.1
#: Iterations of the solver in one solution.
ITERATIONS = 40
_CYCLES = 2**50


class GoalStream:
    """Goals of N joints, 2 Hz to the control rate, followed a delay behind.

    ``limits``: one for all joints or one each; ``start`` (N,): where the joints rest, or a
    ``State`` of each, as it was sampled: in motion, outside the limits also. ``period`` (s): time
    between goals, unless they have times of their own. ``delay``: the motion passes a goal so many
    periods after the first one's arrival and its time, by default 4, or those of 4 knots where
    goals are denser; ``margin`` (s) is added to it, for goals that come late and for handing over.

    A stream is trusted to keep its limits: the plan may rest beyond the last goal known by what the
    source itself still needs to stop. With ``stop_within`` it always ends at rest at the last goal
    known, without another; where the delay is shorter than a stop the velocity dips.

    Goals that lie further on never make the motion go back. Those that limits do not allow in time
    are passed later, all joints together; the lag is made up as fast as the limits allow.
    ``smoothing`` is the weight of jerk against distance from the goals: small (1e-4) for exact
    goals, the default for goals with noise. With ``exact`` goals that are not denser than knots are
    met to rounding where the limits allow it. With a ``tolerance`` (a number, or (N,)), in
    axis units, goals are passed no further off than that, later where limits ask for it; without
    one deviations are small, and reported.

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
        start: ArrayLike | Sequence[State],
        *,
        period: float,
        delay: int | None = None,
        margin: float = 0.0,
        stop_within: bool = False,
        smoothing: float = SMOOTHING,
        exact: bool = False,
        tolerance: ArrayLike | None = None,
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
            ("delay", _DELAY if delay is None else delay, 1, _LONGEST),
            ("knots", knots, 6, 48),
            ("iterations", iterations, 3, 200),
        ):
            if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
                raise InputError(name, value, f"must be an int in {least} .. {most}")
        if real("margin", margin) < 0.0:
            raise InputError("margin", margin, "must not be negative")
        count = len(start) if isinstance(start, Sequence) else np.size(start)
        self._limits = list(jerk_limited(limits_of_each(limits, count)))
        n = len(self._limits)
        self._names = tuple(joint_names or (f"joint{k}" for k in range(n)))
        if len(self._names) != n:
            raise InputError("joint_names", self._names, f"must be one per joint: {n}")
        own = [both(limit) for limit in self._limits]
        stop = max(x.velocity / x.acceleration + x.acceleration / x.jerk for x in own)
        self._m = max(2, round(stop / knots / self._T))
        if delay is None:
            delay = max(_DELAY, math.ceil(_DELAY * self.knot / self._period - 1e-9))
        self._behind = self._cycles(delay * self._period + margin)
        states = self._states(start)
        at = np.array([state.position for state in states])
        bound = None if tolerance is None else self._tolerances(tolerance)
        self._horizon = Horizon(
            self._limits,
            self._T,
            self._m,
            at,
            smoothing=positive("smoothing", smoothing),
            iterations=iterations,
            tolerance=bound,
        )
        moving = any(state.velocity or state.acceleration for state in states)
        if moving:
            self._horizon.move_on(states, self._limits)
            at = self._horizon.rests_at
        self._within = bool(stop_within)
        self._planner = StreamPlanner(
            self._limits,
            self._T,
            self._horizon,
            Known(at, 0, 0.0),
            within=self._within,
            exact=bool(exact),
            tolerance=bound,
        )
        self._ranges = [(j, x.position) for j, x in enumerate(self._limits) if x.position]
        self._first = True  # no goal was timed yet since the start or a rest elsewhere
        self._arriving = 0  # knots of a plan that ends on the last goal
        self._cycle = self._segments = self._begin = 0
        self._through = 0  # so many goals were known in the last plan
        self._arrival: Arrival | None = None  # what is handed out now, and since which cycle
        self._arrived = 0
        self._told = Ledger(n)

    def copy(self) -> GoalStream:
        """Another one in the same state; what becomes of one of them is nothing to the other."""
        other = GoalStream.__new__(GoalStream)
        vars(other).update(vars(self))
        other._horizon = copy(self._horizon)  # its arrays are replaced, never changed
        other._planner = self._planner.copy(other._horizon)
        other._told = copy(self._told)
        return other

    # ---- what comes in

    def check(
        self, position: ArrayLike, time: float | None = None, *, velocity: ArrayLike | None = None
    ) -> None:
        """Raise what ``push`` would; takes nothing."""
        self._goal(position, time, velocity)

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
        goal, at, speed = self._goal(position, time, velocity)
        known = self._planner.known
        if self._first or (time is None and self._waiting()):
            self._first = False
            due = float(self._cycle + self._behind)
            lead = self._cycles(self._period)
            if self._horizon.resting:  # a goal further off than a period allows is begun earlier
                lead = max(lead, self._horizon.move(goal).shape[1] * self._m)
            self._begin = max(round(due) - lead, self._cycle)
            self._planner.known = Known(self._horizon.knot.position, self._begin, at)
            self._horizon.progress = np.zeros(1)
        else:
            due = known.last_cycle + (at - known.time) / self._T
            due = round(due) if abs(due - round(due)) < 1e-6 else due
            self._lag_to(known.last_cycle, due)
        self._planner.known.add(goal, due, at, speed)
        self._told.goals += 1
        self._arriving = 0
        self._planner.turns.add(goal)

    def _goal(
        self, position: ArrayLike, time: float | None, velocity: ArrayLike | None
    ) -> tuple[FloatArray, float, FloatArray | None]:
        """Position, time and velocity of a goal that may be taken."""
        if self._planner.ended:
            raise InputError("position", position, "the stream was ended")
        goal = self._row("position", position)
        speed = None if velocity is None else self._row("velocity", velocity)
        for j, range_ in self._ranges:
            if not range_[0] <= goal[j] <= range_[1]:
                name = f"position of {self._names[j]}"
                raise InputError(name, float(goal[j]), f"must lie in {range_}")
        known = self._planner.known
        at = known.time + self._period if time is None else real("time", time)
        if self._told.goals and not at > known.time:
            raise InputError("time", time, f"must be after {known.time}")
        idle = max(self._cycle + self._behind - known.last_cycle, 0) * self._T
        most = known.time + idle + FURTHEST * self._period
        if not self._first and at > most * (1.0 + 1e-12):
            raise InputError("time", time, f"must be at most {most!r}: {FURTHEST} periods ahead")
        return goal, at, speed

    def end(self) -> None:
        """No goal comes any more: the motion ends at rest on the last one."""
        self._planner.ended = True

    def skipped(self, cycles: int) -> None:
        """So many cycles of the clock were left out: goals are due as much earlier."""
        known = self._planner.known
        self._look()
        known.move(-cycles)
        if self._horizon.resting:
            self._begin -= cycles
            if known.first < len(known):
                self._lag_to(float(known.cycle[known.first - 1]), float(known.cycle[known.first]))
        else:
            self._horizon.progress = self._horizon.progress - cycles / self._m

    # ---- what goes out

    @property
    def cycle(self) -> int:
        """Cycles handed out."""
        return self._cycle

    @property
    def knot(self) -> float:
        """Time between knots, s."""
        return self._m * self._T

    @property
    def delay(self) -> float:
        """How long after its time a goal is passed, the margin with it, s."""
        return self._behind * self._T

    @property
    def done(self) -> bool:
        """Whether the stream was ended and what was handed out rests on its last goal."""
        return (
            self._planner.ended
            and self._horizon.resting
            and not self._horizon.knot.moving
            and self._on_last()
        )

    @property
    def report(self) -> StreamReport:
        """What has become of the goals so far."""
        return self._told.report(
            self._planner.turns.more(), self._planner.kept, self._horizon.iterations
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

    def rest(self, cycle: int) -> list[Followed]:
        """Hand out rest up to ``cycle`` of the stream, or to where a motion is to begin."""
        found: list[Followed] = []
        while self._cycle < cycle and not self.done:
            settles = self._horizon.at_ease and self._horizon.resting
            rest = 1 if settles else self._at_rest(cycle)
            if not rest:
                break
            found += self.take(self._cycle + rest)
        return found

    def keep(self, cycle: int) -> int:
        """Hand out the plan as it is, up to ``cycle`` or to its rest: what ``remainder`` told.

        For what is played already. Returns how many segments.
        """
        begun, horizon, known = self._segments, self._horizon, self._planner.known
        new = len(known) - (self._told.goals - self._through)  # the first goal it does not know
        while self._cycle < cycle and not (horizon.resting and not horizon.knot.moving):
            if new < len(known):  # that is not passed by it: slower, as those before were passed
                progress = horizon.ahead(max(len(horizon.progress) - 1, 1))
                until = (float(known.cycle[new]) - 1e-6 - self._cycle - 0.5) / self._m
                more = float(np.clip(progress[1] - until, 0.0, progress[1] - progress[0]))
                horizon.progress = np.append(progress[:1], progress[1:] - more)
            made = self._on() if horizon.at_ease else self._knot(None)
            self._arriving = max(self._arriving - 1, 0)
            self._cycle += int(made.cycles[0])
            self._segments += 1
        if horizon.resting and new < len(known):
            self._lag_to(float(known.cycle[new - 1]), float(known.cycle[new]))
        return self._segments - begun

    def remainder(self) -> list[Followed]:
        """What would follow if nothing else came: to rest. Hands out nothing."""
        return self._horizon.remainder(self._names, self._segments, self._cycle)

    # ---- the next piece

    def _next(self, cycle: int) -> Followed:
        """A rest, or one knot more."""
        horizon, known = self._horizon, self._planner.known
        if horizon.at_ease:
            return self._on()
        if (rest := self._at_rest(cycle)) > 0:
            return horizon.settle(rest)
        if self._arriving:
            self._arriving -= 1
            plan = None
        else:
            self._look()
            out = known.first == len(known) and not self._planner.ended and not self._within
            self._told.starve(out)
            plan, self._arriving = self._planner.plan(self._cycle)
            self._through = self._told.goals
            if self._planner.arrival is not None:
                self._arrival = self._planner.arrival
                self._arrived = self._cycle
                horizon.finish(self._arrival.pieces)
                return self._on()
            horizon.end = known.last.copy()
        return self._knot(plan)

    def _at_rest(self, cycle: int) -> int:
        """Cycles of rest until a motion begins, or ``cycle``; 0: it begins now, or is under way."""
        if not self._horizon.resting:
            return 0
        if self._waiting():
            to_last = self._planner.ended and not self._on_last()
            return 0 if to_last else max(cycle - self._cycle, 1)
        return max(min(self._begin, cycle) - self._cycle, 0)

    def _on(self) -> Followed:
        """What was planned in one piece, and the goals that it passes."""
        made, arrival = self._horizon.follow_on(), self._arrival
        if arrival is not None:
            until = self._cycle + int(made.cycles[0]) - self._arrived
            passed = int(np.searchsorted(arrival.passed, until, side="right"))
            if passed:
                late = float(arrival.late[passed - 1]) * self._T
                self._told.passing(arrival.deviation[:passed], late)
                self._told.ahead(int(arrival.ahead[passed - 1]))
        return made

    def _knot(self, plan: Plan | None) -> Followed:
        """One knot of a plan, or of the one before."""
        horizon = self._horizon
        self._count(plan)
        before = horizon.given[:, 2].copy()
        way = horizon.plan[:, 0] if plan is None else plan.control[:, 0]
        step = np.where(np.abs(way - before) > STILL * horizon.velocity, way - before, 0.0)
        self._planner.turns.sign, self._planner.turns.count = self._planner.turns.see(step[:, None])
        return horizon.hand_out(plan)

    def _look(self) -> None:
        """Which goals are ahead."""
        now = self._cycle + 0.5 + (self._horizon.progress[0] + 1e-9) * self._m
        self._planner.known.forget(now)

    def _waiting(self) -> bool:
        """Whether no goal is ahead."""
        now = self._cycle + 0.5 + (float(self._horizon.progress[0]) + 1e-9) * self._m
        return self._planner.known.last_cycle <= now

    def _on_last(self) -> bool:
        return bool((self._horizon.knot.position == self._planner.known.last).all())

    def _lag_to(self, before: float, due: float) -> None:
        """A goal that should be passed already is passed late, as any other is.

        ``before``: when the goal before it was due.
        """
        now = self._cycle + 0.5 + float(self._horizon.progress[0]) * self._m
        if due <= now:
            begin = max(before, due - self._period / self._T)
            self._horizon.progress = self._horizon.progress - (now - begin) / self._m

    # ---- bookkeeping

    def _count(self, plan: Plan | None) -> None:
        """The goals that the next knot passes."""
        self._look()
        known, horizon = self._planner.known, self._horizon
        progress = horizon.ahead(1) if plan is None else plan.progress
        until = self._cycle + 0.5 + (float(progress[1]) + 1e-9) * self._m
        at = int(np.searchsorted(known.cycle, until, side="right"))
        if at > known.first:
            off = np.zeros((0, len(self._limits)))
            off = off if plan is None else plan.deviation[: at - known.first]
            self._told.passing(off, (1.0 - float(progress[1])) * self._m * self._T)
        self._told.ahead(len(known) - at)
        self._told.rests(np.abs(horizon.knot.position - self._planner.known.last))

    def _cycles(self, seconds: float) -> int:
        return int(seconds / self._T * (1.0 + 1e-12) + 0.5)

    def _states(self, start: ArrayLike | Sequence[State]) -> list[State]:
        given = list(start) if isinstance(start, Sequence) else []
        states = [state for state in given if isinstance(state, State)]
        if not states:
            row = self._row("start", start)  # type: ignore[arg-type]
            return [State(x) for x in row.tolist()]
        if len(states) != len(self._limits) or len(states) != len(given):
            raise InputError("start", start, f"must be {len(self._limits)} positions or states")
        return states

    def _tolerances(self, tolerance: ArrayLike) -> FloatArray:
        most = np.array(tolerance, dtype=np.float64)
        most = self._row("tolerance", np.full(len(self._limits), most) if most.ndim == 0 else most)
        if (most <= 0.0).any():
            raise InputError("tolerance", most.tolist(), "must be positive")
        return most

    def _row(self, name: str, value: ArrayLike) -> FloatArray:
        return row_of(name, value, len(self._limits))
