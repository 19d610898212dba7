"""The plan of a stream in each knot: through the goals known, to rest, with no turn of its own.

Each joint by itself where goals can be met at their times, else with one progress for all. Never
here: what was handed out, cycles of a clock, reports.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import numpy as np

from sjerk.profile import FloatArray, Limits
from sjerk.trajectory.horizon import Aims, Horizon, Mode, Plan
from sjerk.trajectory.joining import both
from sjerk.trajectory.known import Known, Turns
from sjerk.trajectory.stream_arrival import Arrival, arrive

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
#: Cycles by which the last goal is passed late, so that being sooner counts.
_LAG = 1.0
#: Noise is seen in a few goals only: what one may be off by at most, and how it fades per knot.
_DOUBT, _FADES = 3.0, 0.95
#: Of the way a source needs to stop, by differences of its goals.
_SURE = 0.98
#: Differences of control points below this share of a knot's way at full velocity are none.
STILL = 1e-9


class StreamPlanner:
    """Plans of N joints, from what ``horizon`` has handed out, through what is ``known``.

    ``within``: to rest at the last goal known; ``exact``: goals are met to rounding where limits
    allow it. ``ended``: no goal comes any more. ``kept``: knots without a better plan than the one
    before.
    """

    def __init__(
        self,
        limits: Sequence[Limits],
        cycle_time: float,
        horizon: Horizon,
        known: Known,
        *,
        within: bool,
        exact: bool,
        tolerance: FloatArray | None,
    ) -> None:
        self.horizon, self.known = horizon, known
        self.ended, self.kept = False, 0
        self.arrival: Arrival | None = None  # how it goes to rest, once that is sure
        step = horizon.given[:, 2] - horizon.given[:, 1]
        self.turns = Turns(
            horizon.knot.position,
            RESOLUTION * horizon.velocity,
            np.where(np.abs(step) > STILL * horizon.velocity, np.sign(step), 0.0),
        )
        own = [both(limit) for limit in limits]
        stop = max(x.velocity / x.acceleration + x.acceleration / x.jerk for x in own)
        per_knot = horizon.cycles * cycle_time
        self.tail = math.ceil(stop / per_knot) + 3
        self._most, self._per_knot = math.ceil(_AHEAD * stop / per_knot), per_knot
        self._within, self._exact = within, exact
        self._own, self._T = own, cycle_time
        self._tolerance = np.full(len(own), np.inf) if tolerance is None else tolerance
        self._per_cycle = np.array(
            [
                [x.velocity * cycle_time, x.acceleration * cycle_time**2, x.jerk * cycle_time**3]
                for x in own
            ]
        )
        self._ranges = np.array(
            [(-np.inf, np.inf) if x.position is None else x.position for x in limits]
        )
        self._noise = np.zeros(len(own))
        self._doubt = np.zeros(len(own))  # of goals in the time of about a stop
        self._onward = (
            -math.inf,
            np.zeros(len(own)),
        )  # of the last goal so far; how far it goes on

    def copy(self, horizon: Horizon) -> StreamPlanner:
        """Another one in the same state, for that horizon."""
        other = copy(self)
        other.horizon = horizon
        other.known, other.turns = self.known.copy(), self.turns.copy()
        return other

    def plan(self, cycle: float) -> tuple[Plan | None, int]:
        """The plan of the knot that begins in ``cycle``; None: the one before stands.

        And how many knots long it is if it ends on the last goal, else 0. Goals that are passed are
        forgotten.
        """
        horizon, known = self.horizon, self.known
        m = horizon.cycles
        known.trim(min(known.last_cycle, cycle + horizon.progress[0] * m) - 3.0 * m)
        # the sample is half a cycle behind the spline
        due = (known.cycle - (cycle + 0.5)) / m
        last = known.first == len(known)
        if last and not (self.ended or self._within):
            return None, 0  # nothing is new: it rests where it was to
        self._noise = known.noise(3 * m, self._per_cycle)
        self._doubt = np.maximum(_DOUBT * self._noise, _FADES * self._doubt)
        best = self._best(due)
        if horizon.resting and -horizon.progress[0] > self.tail and self._still(best):
            # it turned before a goal, and does not go back to it
            progress = best.progress - best.progress[0] + due[min(known.first, len(due) - 1)]
            return replace(best, progress=progress), 0
        found = self._arrive(due, best)
        if self._finish(cycle, best, found):
            return None, 0
        if found is not None:
            return found, found.control.shape[1] + 2
        if last and horizon.resting:
            control = horizon.move(known.last)
            progress = horizon.ahead(control.shape[1])
            return replace(best, control=control, progress=progress), control.shape[1] + 2
        return (None if last and self._still(best) else best), 0

    def _best(self, due: FloatArray) -> Plan:
        """Each joint by itself where goals are met so; else with a common progress."""
        horizon, length = self.horizon, 2 * (self._most + self.tail)
        best = None
        if horizon.progress[0] > -1e-2:
            best = self._solve(due, np.arange(float(length)), paced=False)
        if best is None or not self._close(best):
            best = self._solve(due, horizon.ahead(length), paced=True)
        if best is None:
            self.kept += 1
            progress = horizon.ahead(length)
            aims, knots = self._aims(due, progress)
            best = horizon.solve(aims, knots, progress, paced=False, mode=Mode.AS_BEFORE, most=0)
        return best

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
            until = np.inf if aims.ended else aims.moment[-1] - self.tail
            exact = int(np.searchsorted(aims.moment, until))
        attempts = [(mode, aims, False) for mode in Mode]
        if aims.turning.any():
            free = np.where(aims.turning, 0, aims.direction).astype(np.int32)
            attempts.insert(0, (Mode.HARD, replace(aims, direction=free), False))
        if paced and np.isfinite(self._tolerance).any():
            attempts.insert(0, (Mode.HARD, attempts[0][1], True))
        for mode, asked, near in attempts:
            best = self.horizon.solve(
                asked,
                knots,
                progress[: knots + 1],
                paced=paced,
                mode=mode,
                exact=exact,
                near=near,
            )
            if (mode is not Mode.HARD or best.share.all()) and self._keeps_turns(aims, best):
                break
        else:
            return None
        last = min(knots, max(1, math.ceil(aims.moment[-1]) if len(aims.moment) else 1))
        more = np.arange(1.0, 2 * (self._most + self.tail) - last)
        progress = np.concatenate([best.progress[: last + 1], best.progress[last] + more])
        return replace(best, progress=progress)

    def _keeps_turns(self, aims: Aims, plan: Plan) -> bool:
        steps = np.diff(plan.control, axis=1, prepend=self.horizon.given[:, 2:])
        still = STILL * self.horizon.velocity[:, None]
        return self.turns.kept(aims.direction, np.where(np.abs(steps) > still, steps, 0.0))

    def _still(self, plan: Plan) -> bool:
        way = np.abs(plan.control - self.horizon.given[:, 2:]).max(axis=1)
        return bool((way <= _CLOSE * self.horizon.velocity).all())

    def _close(self, plan: Plan) -> bool:
        """Whether goals are met, so that the joints need nothing in common; far ones may change."""
        allowed = _CLOSE * self.horizon.velocity + 2.0 * self._noise
        far = 1.0 + (plan.moment[:, None] / _NEAR) ** 2
        off = np.abs(plan.deviation)
        return bool((off <= far * allowed).all() and (off <= self._tolerance).all())

    def _aims(self, due: FloatArray, progress: FloatArray) -> tuple[Aims, int]:
        """The goals as a plan with this progress has them, and its length."""
        horizon, known = self.horizon, self.known
        first, position = known.first, known.position
        rising = np.maximum.accumulate(progress) + 1e-9 * np.arange(len(progress))
        moment = np.interp(due, rising, np.arange(float(len(rising))))
        moment = np.where(due > rising[-1], len(rising) - 1 + due - rising[-1], moment)
        moment = np.where(due < rising[0], due - rising[0], moment)
        ahead = np.arange(first, first + int(np.searchsorted(moment[first:], self._most)))
        at = moment[ahead]
        knots = (math.ceil(at[-1]) if len(at) else 0) + self.tail
        knots = max(knots, horizon.plan.shape[1])
        gap = np.diff(at, prepend=moment[first - 1])
        slopes = known.slopes(due, ahead)
        speed = None
        if known.speeds:
            speed = known.velocity[ahead] * self._per_knot
            speed = np.where(np.isnan(speed), slopes, speed)
        last, here = position[-1], horizon.knot.position
        whole = len(ahead) == len(due) - first  # else the plan rests on the last one looked at
        end = last if whole else position[first - 1 + len(ahead)]
        low = np.minimum(np.minimum(position[first:].min(axis=0, initial=np.inf), here), last)
        high = np.maximum(np.maximum(position[first:].max(axis=0, initial=-np.inf), here), last)
        more = np.zeros(len(last))
        if not self._within and not self.ended:
            more = self._further()
            low, high = np.minimum(low, last + more), np.maximum(high, last + more)
        low, high = np.maximum(low, self._ranges[:, 0]), np.minimum(high, self._ranges[:, 1])
        if whole:
            end = np.clip(last + more, low, high)
        given = horizon.given + horizon.origin[:, None]
        direction, turning = known.directions(
            moment,
            knots,
            given,
            self.turns,
            np.maximum(RESOLUTION * horizon.velocity, 2.5 * self._noise),
            final=self._within or self.ended,
        )
        # after the last turn no further than it need not come back from
        sign, there = direction[:, -1] * whole, last + more
        on = (direction == self.turns.sign[:, None]).all(axis=1) & (
            sign * (given[:, 2] - there) > 0
        )
        there = np.where(on, given[:, 2], there)
        top, bottom = np.where(sign > 0, there, np.inf), np.where(sign < 0, there, -np.inf)
        return (
            Aims(
                at,
                np.clip(gap, _DENSE, 1.0),
                position[ahead],
                slopes,
                speed,
                np.column_stack([low, high]),
                np.column_stack([bottom, top]),
                direction,
                turning,
                end,
                self.ended and whole,
            ),
            knots,
        )

    def _further(self) -> FloatArray:
        """How far beyond the last goal a plan may rest (N,): looked at when that was new."""
        if self._onward[0] != self.known.time:
            more, least = (
                self.known.onward(self.horizon.cycles, self._per_cycle, self._doubt),
                self.horizon.velocity,
            )
            more = np.sign(more) * np.maximum(_SURE * np.abs(more) - _CLOSE * least, 0.0)
            self._onward = (self.known.time, more)
        return self._onward[1]

    def _finish(self, cycle: float, best: Plan, found: Plan | None) -> bool:
        """Whether a lag is over sooner by the planner to any target than with ``found``."""
        horizon, known, first = self.horizon, self.known, self.known.first
        if not self.ended or first == len(known) or (self._exact and len(known) - first > 1):
            return False
        if known.last_cycle - cycle > self._most * horizon.cycles:
            return False
        due = known.cycle[first:] - cycle
        seen = len(best.moment)
        lag = best.moment[-1] * horizon.cycles - due[seen - 1] if seen else 0.0
        if max(lag, -horizon.progress[0] * horizon.cycles) <= _LAG:
            return False  # it is in time as it is
        worst = np.abs(best.deviation).max(axis=0, initial=0.0)
        made = arrive(
            horizon.knot,
            due,
            known.position[first:],
            np.minimum(self._allowed(worst), self._tolerance),
            _CLOSE * horizon.velocity,
            self._own,
            self._T,
        )
        if made is None:
            return False
        most = np.inf if found is None else (found.control.shape[1] + 2) * horizon.cycles
        if made.cycles > most or not self._turns_enough(made.way):
            return False
        self.arrival = made
        return True

    def _turns_enough(self, way: FloatArray) -> bool:
        """Whether samples (n, N) turn no more often than the goals do."""
        steps = np.diff(way, axis=0).T
        still = STILL * self.horizon.velocity[:, None] / self.horizon.cycles
        _, count = self.turns.see(np.where(np.abs(steps) > still, steps, 0.0))
        self.turns.look()
        return bool((count <= np.maximum(self.turns.asked, self.turns.count)).all())

    def _allowed(self, worst: FloatArray | float) -> FloatArray:
        """How far from goals a way to the last one may be (N,), where the best plan is so far."""
        allowed = np.minimum(3.0 * _CLOSE * self.horizon.velocity, self._tolerance)
        return np.maximum(1.2 * worst, allowed)

    def _arrive(self, due: FloatArray, best: Plan) -> Plan | None:
        """The first knot in which all joints can rest on the last goal, if there is one soon."""
        first = self.known.first
        if not (self.ended or (self._within and first == len(due))):
            return None
        aims, _ = self._aims(due, best.progress)
        last = float(aims.moment[-1]) if len(aims.moment) else 0.0
        if len(aims.moment) < len(due) - first:
            return None
        worst = np.abs(best.deviation).max(axis=0, initial=0.0)
        allowed = self._allowed(worst)
        met = bool((worst <= RESOLUTION * self.horizon.velocity).all())
        exact = len(aims.moment) if self._exact and met else 0
        n = max(1, math.ceil(min(last, due[-1]) - 1e-9) - 2)
        for knots in range(n, n + self.tail):
            short = replace(
                aims, direction=np.ascontiguousarray(aims.direction[:, :knots]), ended=True
            )
            progress = best.progress[: knots + 1]
            if len(progress) < knots + 1:
                return None
            found = self.horizon.solve(
                short, knots, progress, paced=False, ends=True, exact=exact, plan=best.control
            )
            close = (found.share == 1.0).all() and (np.abs(found.deviation) <= allowed).all()
            if close and self._keeps_turns(short, found):
                return replace(found, progress=best.progress)
        return None
