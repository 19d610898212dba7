"""Streamed goals with look-ahead: goals come one by one, the motion goes through them.

Commanding each goal as it comes makes it interrupt the one before. ``GoalStream`` runs a delay
behind its goals instead and plans through all that are known, anew with each that comes. It hands
out segments as ``follow`` does. ``docs/explanation/trajectories.md`` has the method. A pure
library: cycles are told, not read from a clock. Never here: shared memory, drives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sjerk.errors import InputError, positive, real
from sjerk.profile import FloatArray, Limits
from sjerk.trajectory.trials import Trial, Window, limits_per_cycle
from sjerk.trajectory.joining import brake, join
from sjerk.trajectory.pacing import CATCH_UP, SPACING, excess, rates, slowing, thinned
from sjerk.trajectory.segments import Followed, IntArray, Knot, dwell, rows, split

#: Goals that a plan looks at; those behind are looked at later.
LOOKAHEAD = 256
#: Periods that a goal's time may lie beyond what is known: more is another clock.
FURTHEST = 100
#: Shares of a goal's velocity to be had there on the way back to a path.
_SHARES = (1.0, 0.8, 0.4, 0.0)
_CYCLES = 2**50
_KEPT = 1.0 + 1e-10


@dataclass(frozen=True, eq=False)
class StreamReport:
    """What has become of the goals, by what was handed out.

    ``goals`` given; ``met`` at their exact position; ``missed``: passed at a distance, the largest
    of which is ``deviation`` (N,). ``lag``, ``largest_lag`` (s): behind time plus delay at the last
    goal met, and at most. ``starved``: how often the goals ran out in motion; ``starving``: now;
    ``beyond`` (N,): how far past the last goal that led at most.
    """

    goals: int
    met: int
    missed: int
    deviation: FloatArray
    lag: float
    largest_lag: float
    starved: int
    starving: bool
    beyond: FloatArray


class _Goal(NamedTuple):
    """``time`` (s) in the stream's own clock; ``cycle`` in which it is due."""

    position: FloatArray
    time: float
    cycle: int


class _Unit(NamedTuple):
    """A piece of a plan: the ``goals`` it disposes of, the last of them met if ``meets``.

    ``loose``: it can be left at any cycle when something better is known.
    """

    motion: Followed
    goals: int
    meets: bool
    loose: bool


class _Choice(NamedTuple):
    """A plan that could be: its ``goals`` are met, ``skipped`` before the first of them are not."""

    cost: float
    made: Followed
    goals: list[_Goal]
    skipped: int


class GoalStream:
    """Goals of N joints at 10 to 500 Hz, followed a delay behind.

    ``limits``: one per joint; ``start`` (N,): where the joints rest. ``period`` (s): time between
    goals, unless they have times of their own. ``delay``: the motion passes a goal so many periods
    after the first one's arrival and its time; ``margin`` (s) is added to it, for goals that come
    late and for handing over.

    A stream is trusted to go on: the last goal known is passed with the stream's velocity. Where
    goals run out the joints brake at once, each at most its stopping distance beyond the last goal,
    and ``report`` says so. With ``stop_within`` what is handed out can always end at rest on the
    last goal known, without another; where the delay is shorter than a stop the velocity dips.

    Goals are met at their exact position and, where the limits allow, in their cycle; else later:
    the ``lag`` is made up by at most a tenth of each period. Goals that cannot be met from a motion
    that trusted others are passed at a distance (``missed``).

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
        joint_names: Sequence[str] | None = None,
    ) -> None:
        """Raises InputError."""
        self._T = positive("cycle_time", cycle_time)
        self._period = positive("period", period)
        if self._period < 2.0 * self._T * (1 - 1e-9):
            raise InputError("period", period, f"must be at least two cycles of {self._T!r} s")
        if isinstance(delay, bool) or not isinstance(delay, int) or not 1 <= delay <= LOOKAHEAD:
            raise InputError("delay", delay, f"must be an int in 1 .. {LOOKAHEAD}")
        if real("margin", margin) < 0.0:
            raise InputError("margin", margin, "must not be negative")
        if isinstance(limits, Limits) or not all(isinstance(limit, Limits) for limit in limits):
            raise InputError("limits", limits, "must be a list of one Limits per joint")
        self._limits = list(limits)
        n = len(self._limits)
        self._names = tuple(joint_names or (f"joint{k}" for k in range(n)))
        if len(self._names) != n:
            raise InputError("joint_names", self._names, f"must be one per joint: {n}")
        self._table = limits_per_cycle(self._limits, self._T)
        self._behind = self._cycles(delay * self._period + margin)
        self._within = bool(stop_within)
        self._knot = Knot.rest(self._row("start", start))
        self._last = _Goal(self._knot.position, 0.0, 0)
        self._trail = [self._last] * 3  # the last goals given
        self._known: list[_Goal] = []
        self._units: list[_Unit] = []
        self._pace = 1.0  # goal periods passed in the time of one
        self._held: IntArray = np.empty(0, dtype=np.int64)  # cycles of the plan before, to a stop
        self._stale = self._ended = self._timed = False
        self._cycle = self._knots = self._begin = 0
        self._goals = self._met = self._missed = self._starved = 0
        self._lag = self._worst = 0
        self._starving = False
        self._beyond, self._deviation = np.zeros(n), np.zeros(n)

    # ---- what comes in

    def push(self, position: ArrayLike, time: float | None = None) -> None:
        """Take a goal: ``position`` (N,), ``time`` (s) after the goal before's, else a period.

        The first one that comes at rest is due the delay after the cycle handed out so far, the
        others by their times after it. Raises InputError: not finite, outside the position limits,
        times that do not increase, or lie more than ``FURTHEST`` periods beyond the newest goal
        and what was handed out; a stream that was ended.
        """
        if self._ended:
            raise InputError("position", position, "the stream was ended")
        goal = self._row("position", position)
        for name, limit, x in zip(self._names, self._limits, goal.tolist(), strict=True):
            if limit.position is not None and not limit.position[0] <= x <= limit.position[1]:
                raise InputError(f"position of {name}", x, f"must lie in {limit.position}")
        at = self._last.time + self._period if time is None else real("time", time)
        if self._goals and not at > self._last.time:
            raise InputError("time", time, f"must be after {self._last.time}")
        idle = max(self._cycle + self._behind - self._last.cycle, 0) * self._T
        most = self._last.time + idle + FURTHEST * self._period
        if self._timed and at > most * (1.0 + 1e-12):
            raise InputError("time", time, f"must be at most {most!r}: {FURTHEST} periods ahead")
        if not self._timed:
            self._timed = True
            due = self._cycle + self._behind
            self._begin = due - self._cycles(self._period)
        else:
            due = max(self._last.cycle + self._cycles(at - self._last.time), self._last.cycle + 2)
        self._last = _Goal(goal, at, due)
        self._trail = [*self._trail[1:], self._last]
        self._known.append(self._last)
        self._goals += 1
        self._stale = True

    def end(self) -> None:
        """No goal comes any more: the motion ends at rest on the last one."""
        self._ended = self._stale = True

    def rested(self, position: ArrayLike, cycle: int) -> None:
        """Go on from rest elsewhere, in ``cycle``: what was handed out was not played to its end.

        Counts as starved; the next goal is timed anew. Raises InputError.
        """
        self._knot = Knot.rest(self._row("position", position))
        self._cycle = max(self._cycle, cycle)
        self._units, self._held = [], np.empty(0, dtype=np.int64)
        self._stale, self._starving, self._lag, self._pace = True, True, 0, 1.0
        self._starved += 1
        late = self._cycle + self._behind - (self._known[0].cycle if self._known else 0)
        self._timed = bool(self._known)
        self._known = [goal._replace(cycle=goal.cycle + late) for goal in self._known]
        if self._known:
            self._last = self._known[-1]
            self._trail[-1] = self._last
        self._begin = self._cycle

    # ---- what goes out

    @property
    def cycle(self) -> int:
        """Cycles handed out."""
        return self._cycle

    @property
    def done(self) -> bool:
        """Whether the stream was ended and what was handed out rests on its last goal."""
        return self._ended and not self._known and not self._knot.moving and self._on_last()

    @property
    def report(self) -> StreamReport:
        """What has become of the goals so far."""
        return StreamReport(
            self._goals,
            self._met,
            self._missed,
            self._deviation.copy(),
            self._lag * self._T,
            self._worst * self._T,
            self._starved,
            self._starving,
            self._beyond.copy(),
        )

    def take(self, cycle: int) -> list[Followed]:
        """Hand out the motion up to ``cycle`` of the stream, or to the next goal behind it.

        What was handed out stands; the rest is planned anew when a goal comes. Call it as late as
        the motion must be known: the later, the more goals are. A rest without goals is one
        segment, however long. Raises InputError.
        """
        if isinstance(cycle, bool) or not isinstance(cycle, int) or cycle > _CYCLES:
            raise InputError("cycle", cycle, f"must be an int, at most {_CYCLES}")
        found = []
        while self._cycle < cycle and not self.done:
            if self._stale or not self._units:
                self._units, self._stale = self._plan(cycle), False
            unit = self._units.pop(0)
            length, room = int(unit.motion.cycles.sum()), cycle - self._cycle
            if unit.loose and length > room:
                head, tail = split(unit.motion, room)
                self._units.insert(0, unit._replace(motion=tail))
                unit = _Unit(head, 0, False, True)
            found.append(self._hand_out(unit))
        return found

    # ---- the plan

    def _plan(self, cycle: int) -> list[_Unit]:
        """From the present knot on: through the known goals, or else up to ``cycle``."""
        if not self._known:
            return [_Unit(self._without_goals(cycle), 0, False, True)]
        left = self._begin - self._cycle
        if left > 0:
            return [_Unit(dwell(self._knot.position, left, self._T), 0, False, True)]
        goals = self._known[:LOOKAHEAD]
        if self._within or (self._ended and len(goals) == len(self._known)):
            return self._stopping(goals)
        return self._going_on(goals) or self._rejoining(goals) or self._slowly(goals)

    def _without_goals(self, cycle: int) -> Followed:
        """Brake, go back to the last goal of a stream that was ended, or rest."""
        if self._knot.moving:
            if not self._starving:
                self._starving = True
                self._starved += 1
            return brake(self._knot, self._limits, self._T)
        if self._ended and not self._on_last():
            return join(self._knot, self._last.position, self._limits, self._T)
        if self._starving:
            self._timed, self._lag, self._pace = False, 0, 1.0
        cycles = max(2, self._cycles(self._period), cycle - self._cycle)
        return dwell(self._knot.position, cycles, self._T)

    def _asked(self, goals: Sequence[_Goal]) -> IntArray:
        """Cycles to each goal: in its cycle, or later where lag is to be made up."""
        at, before, asked = self._cycle, self._from(), []
        for goal in goals:
            period = goal.cycle - before
            least = max(2, round(period * (1.0 - CATCH_UP)))
            asked.append(max(goal.cycle - at, min(least, period)))
            at, before = at + asked[-1], goal.cycle
        return np.array(asked)

    def _from(self) -> int:
        """The cycle in which the motion should have been where it is."""
        return self._cycle - self._lag

    def _periods(self, goals: Sequence[_Goal]) -> FloatArray:
        """Cycles to each goal at the stream's own pace."""
        due = [self._from(), *(goal.cycle for goal in goals)]
        return np.maximum(np.diff(due), 2.0)

    def _trial(self, goals: Sequence[_Goal], asked: IntArray, beyond: list[FloatArray]) -> Trial:
        T, knot = self._T, self._knot
        window = Window(len(self._names), False)
        every = [max(2, self._cycles(self._period))] * len(beyond)
        window.cycle = np.cumsum([0, *asked.tolist(), *every])
        window.position = np.array([knot.position, *(g.position for g in goals), *beyond])
        window.state = (knot.velocity * T, knot.acceleration * T**2, knot.last_jerk * T**3)
        return Trial(window, self._names, self._table, T)

    def _going_on(self, goals: list[_Goal]) -> list[_Unit] | None:
        """Constant jerk from goal to goal and on behind the last; at another pace if need be."""
        asked = self._asked(goals)
        beyond, every = self._extrapolated(goals)
        trial = self._trial(goals, asked, beyond)
        n = len(goals)
        shares = trial.shares([*asked, *([every] * len(beyond))])
        late = self._cycle + int(asked.sum()) - goals[-1].cycle
        best: _Choice | None = None
        if shares[0] <= _KEPT:
            made = trial.read()
            if self._legal(made, 0):
                best = _Choice(late + excess(shares[:n]), made, goals, 0)
        if best is not None and best.cost == 0.0:
            return self._units_of(best)
        for met in thinned(self._periods(goals)):
            found = self._paced(goals, met, beyond, every)
            if found is not None and (best is None or found.cost < best.cost):
                best = found
            if best is not None and best.cost < 1e4:
                break
        return None if best is None else self._units_of(best)

    def _paced(
        self,
        goals: list[_Goal],
        met: list[int],
        beyond: list[FloatArray],
        every: int,
        *,
        stop: bool = False,
    ) -> _Choice | None:
        """The least late plan: limits kept up to the first goal met, later ones if possible."""
        chosen = [goals[i] for i in met]
        periods = self._periods(chosen)
        due = chosen[-1].cycle - self._cycle
        early = max(0, self._behind - self._cycles(self._period))
        trial = self._trial(chosen, np.maximum(periods.astype(np.int64), 2), beyond)
        n = len(chosen)
        best: tuple[float, IntArray] | None = None
        way = np.diff([self._knot.position, *(goal.position for goal in chosen)], axis=0)
        most = slowing(way, periods, self._table[:, 1]) if stop else None
        for rate in rates(self._pace, n, most):
            cycles = np.maximum(2, np.rint(periods / rate)).astype(np.int64)
            tail = [max(2, round(every / float(rate[-1])))] * len(beyond)
            all_of_it = np.concatenate([cycles, tail]).astype(np.int64)
            shares = trial.shares(all_of_it)
            if not shares[: n if stop else 1].max() <= _KEPT:
                continue
            late = int(cycles.sum()) - due
            cost = max(late, 0) + 2.0 * max(-late, 0) + excess(shares[:n])
            if -late > early:
                cost += 1e5
            if best is None or cost < best[0]:
                best = cost, all_of_it
        if best is None:
            return None
        trial.shares(best[1])
        made = trial.read()
        if not self._legal(made, 0):
            return None
        return _Choice(best[0] + 20.0 * met[0], made, chosen, met[0])

    def _legal(self, made: Followed, i: int) -> bool:
        """Whether the joints can brake from the end of segment i without leaving any limit."""
        knot, T = Knot.of(made, i + 1), self._T
        V, A = knot.velocity * T, knot.acceleration * T**2
        peak = np.abs(V + A * np.abs(A) / (2.0 * self._table[:, 2]))
        return bool((peak <= self._table[:, 0]).all()) and self._stops(knot)

    def _units_of(self, choice: _Choice) -> list[_Unit]:
        """The plan up to the first goal met: the rest is planned again from there."""
        made = choice.made
        period = self._periods(choice.goals[:1])[0]
        self._pace = float(period / made.cycles[0])
        return [_Unit(rows(made, 0, 1), choice.skipped + 1, True, False)]

    def _rejoining(self, goals: list[_Goal]) -> list[_Unit] | None:
        """The motion that is least late at one of the next goals, with its velocity or less."""
        best: tuple[float, int, Followed] | None = None
        asked = np.cumsum(self._asked(goals))
        for m in sorted({0, min(1, len(goals) - 1), len(goals) - 1}):
            velocity = self._velocity(goals, m)
            for share in _SHARES:
                made = join(
                    self._knot,
                    goals[m].position,
                    self._limits,
                    self._T,
                    velocity=share * velocity / self._T,
                    least=int(asked[m]),
                )
                # what is missing of the velocity costs time behind the goal
                slow = (1.0 - share) * np.abs(velocity / self._table[:, 1]).max()
                cost = float(made.cycles.sum() - asked[m]) + 0.5 * slow * (1.0 - share) + 20.0 * m
                if (best is None or cost < best[0]) and self._stays(made):
                    best = (cost, m + 1, made)
        if best is None or not self._stops(Knot.of(best[2])):
            return None
        self._pace = 1.0
        return [_Unit(best[2], best[1], True, False)]

    def _stopping(self, goals: list[_Goal]) -> list[_Unit]:
        """Through the goals to rest on the last one; if there is no way, the plan before stands."""
        asked, periods = self._asked(goals), self._periods(goals)
        left = len(goals) - np.arange(len(goals))
        found = self._paced(goals, list(range(len(goals))), [], 0, stop=True)
        made = None if found is None else found.made
        trial = self._trial(goals, asked, [])
        known = np.concatenate([self._held[: len(goals)], asked[len(self._held) :]])
        slower = periods * np.sqrt(np.maximum(1.0, 4.0 / left))
        best: tuple[bool, int, Followed] | None = None
        for begin in (None, asked, known, slower, 2.0 * slower):
            if begin is not None:
                made = trial.stretched(np.maximum(np.rint(begin), asked).astype(np.int64))
            if made is not None:
                outside = not self._inside(made)
                key = outside, int(made.cycles.sum())
                if not (outside and self._within) and (best is None or key < best[:2]):
                    best = (*key, made)
            if best is not None and best[:2] <= (False, goals[-1].cycle - self._cycle):
                break
        if best is None:
            return self._units or self._slowly(goals)
        chosen = best[2]
        self._held = chosen.cycles[1:]
        self._pace = float(periods[0] / chosen.cycles[0])
        last = len(goals) - 1
        return [_Unit(rows(chosen, i, i + 1), 1, True, i == last) for i in range(len(goals))]

    def _inside(self, made: Followed) -> bool:
        """Whether the motion stays between the way-points of each segment, and in reach."""
        position = replace(made, first=1).sample().position
        segment = np.repeat(np.arange(len(made)), made.cycles)
        one, two = made.position[:-1], made.position[1:]
        way = np.abs(two - one)
        # where it turns a smooth path goes a little further than its points; not at the end
        beside = np.vstack([way[:1], way, way[-1:]])
        room = 0.5 * np.maximum(np.maximum(beside[:-2], beside[2:]), way)
        room[-1] = 0.0
        low, high = np.minimum(one, two) - room, np.maximum(one, two) + room
        inside = (position >= low[segment]) & (position <= high[segment])
        return bool(inside.all()) and self._stays(made)

    def _slowly(self, goals: Sequence[_Goal]) -> list[_Unit]:
        """To rest, on the last goal if the way there stays inside; then it can only be better."""
        self._pace, self._held = 1.0, np.empty(0, dtype=np.int64)
        end = join(self._knot, goals[-1].position, self._limits, self._T, joint_names=self._names)
        if self._stays(end):
            return [_Unit(end, len(goals), True, True)]
        return [_Unit(brake(self._knot, self._limits, self._T), 0, False, False)]

    def _velocity(self, goals: Sequence[_Goal], m: int) -> FloatArray:
        """The stream's velocity at goal m per cycle, within the limits."""
        if m + 1 < len(goals):
            before = goals[m - 1] if m else _Goal(self._knot.position, 0.0, self._from())
            after = goals[m + 1]
            speed = (after.position - before.position) / max(after.cycle - before.cycle, 1)
        else:
            speed, push = self._onward()
            speed = speed + 0.5 * self._cycles(self._period) * push
        return self._slow(speed)

    def _slow(self, speed: FloatArray) -> FloatArray:
        most = self._table[:, 0] * (1.0 - 1e-9)
        return np.clip(speed, -most, most)

    def _onward(self) -> tuple[FloatArray, FloatArray]:
        """Mean velocity up to the last goal and acceleration there by differences, per cycle."""
        one, two, three = self._trail
        ahead, behind = max(three.cycle - two.cycle, 1), max(two.cycle - one.cycle, 1)
        speed = (three.position - two.position) / ahead
        change = speed - (two.position - one.position) / behind
        return speed, change * (2.0 / (ahead + behind))

    def _extrapolated(self, goals: Sequence[_Goal]) -> tuple[list[FloatArray], int]:
        """Points behind the last goal, a while on with its velocity, then to rest; cycles between.

        Half of the acceleration goes on: with none or all of it a plan of few goals overshoots.
        """
        every = max(SPACING, self._cycles(self._period))
        speed, push = self._onward()
        at = speed + 0.5 * self._cycles(self._period) * push
        ways = [self._slow(at + 0.25 * every * push) * every]
        way = self._slow(at + 0.5 * every * push) * every
        n = max(1, int(np.ceil((np.abs(way) / (0.6 * self._table[:, 1] * every**2)).max())))
        ways += [way * (1.0 - (i + 0.5) / n) for i in range(n)]
        return list(goals[-1].position + np.cumsum(ways, axis=0)), every

    def _stops(self, knot: Knot) -> bool:
        """Whether the joints can brake from there without leaving their ranges."""
        if all(limit.position is None for limit in self._limits):
            return True
        return self._stays(brake(knot, self._limits, self._T))

    def _stays(self, motion: Followed) -> bool:
        if all(limit.position is None for limit in self._limits):
            return True
        position = replace(motion, first=1).sample().position
        return all(
            limit.position is None
            or bool(((x >= limit.position[0]) & (x <= limit.position[1])).all())
            for limit, x in zip(self._limits, position.T, strict=True)
        )

    # ---- bookkeeping

    def _hand_out(self, unit: _Unit) -> Followed:
        motion = replace(
            unit.motion,
            joint_names=self._names,
            first=self._knots,
            first_cycle=self._cycle,
        )
        done, self._known = self._known[: unit.goals], self._known[unit.goals :]
        self._cycle += int(motion.cycles.sum())
        self._knots += len(motion)
        self._knot = Knot.of(motion)
        if done:
            met = bool((motion.position[-1] == done[-1].position).all())
            for goal in done[: len(done) - met]:
                self._missed += 1
                gap = np.abs(motion.sample().position - goal.position)
                near = gap[int(gap.max(axis=1).argmin())]
                self._deviation = np.maximum(self._deviation, near)
            self._met += met
            self._lag = self._cycle - done[-1].cycle
            self._worst = max(self._worst, self._lag)
            self._starving = False
        elif self._starving:
            gap = np.abs(motion.position[-1] - self._last.position)
            self._beyond = np.maximum(self._beyond, gap)
        return motion

    def _on_last(self) -> bool:
        return bool((self._knot.position == self._last.position).all())

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
