"""A window of a motion: way-points from a state on, planned, cut, and made into segments.

``Window`` holds what is known and not handed out yet; ``Plan`` is what was found for it. Never
here: which way-points belong together, how fast they may be passed.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from sjerk.errors import InputError
from sjerk.profile import FloatArray, Limits
from sjerk.trajectory.fastest import places
from sjerk.trajectory.programme import Answer
from sjerk.trajectory.segments import PHASES, Followed, IntArray, Knot, Passed, begin_of
from sjerk.trajectory.spline import Knots

#: Stops that a window looks ahead of what it hands out, and hands out at a time.
LOOKAHEAD, HAND_OUT = 5.0, 5.0
#: Stops over which it begins with the knots of the one before.
KEPT = 2.0
#: The tolerance of way-points, where none is given: of a joint's way and of its fastest cycle.
WAY_SHARE, CYCLE_SHARE = 1e-4, 0.05


def tolerances(tolerance: float | ArrayLike | None, joints: int) -> FloatArray | None:
    """One per joint (N,); raises InputError."""
    if tolerance is None:
        return None
    try:
        row = np.array(tolerance, dtype=np.float64)
    except (TypeError, ValueError):
        row = np.zeros(0)
    if row.shape not in ((), (joints,)) or not ((row > 0.0) & np.isfinite(row)).all():
        raise InputError("tolerance", tolerance, f"must be above 0, one number or {joints}")
    return np.array(np.broadcast_to(row, (joints,)))


def units(table: FloatArray, way: FloatArray, tolerance: FloatArray | None) -> FloatArray:
    """Tolerances (N,); where none are given by each joint's way and its fastest cycle."""
    if tolerance is not None:
        return tolerance
    most = CYCLE_SHARE * table[:, 0]
    return np.minimum(most, np.maximum(WAY_SHARE * way, 1e-6 * most))


def ranges(limits: Sequence[Limits]) -> FloatArray | None:
    """Position limits (N, 2); None where there are none."""
    box = np.array([limit.position or (-np.inf, np.inf) for limit in limits])
    return box if np.isfinite(box).any() else None


def stop_of(table: FloatArray) -> float:
    """Cycles that the slowest joint needs to stop, from all of its velocity."""
    V, A, J = table.T
    return float((V / A + A / J).max())


@dataclass(frozen=True, eq=False)
class Plan:
    """A motion from the state of a window: splines relative to its position, at pace 1.

    ``asked`` (k,): cycles from the start of the window at which its way-points would be passed in
    the time that is asked; ``moments`` (k,): at which they are; of samples, the last one's too
    where the plan rests there (``rests``).
    """

    knots: Knots
    answer: Answer
    asked: FloatArray
    moments: FloatArray
    rests: bool


class Window:
    """Way-points not handed out yet, the state before them, and what was handed out.

    ``points`` (n, N); ``gaps`` (n,): cycles asked from the way-point before; ``due``: cycles of the
    first of them that are over already.
    """

    def __init__(self, names: Sequence[str], T: float, state: Knot) -> None:
        """At a state, which is at way-point 0."""
        self.names, self.T, self.state = tuple(names), T, state
        joints = len(state.position)
        self.points = np.empty((0, joints))
        self.speeds = np.empty((0, joints))
        self.gaps = np.empty(0)
        self.over = 0.0
        self.left: IntArray = np.empty(0, dtype=np.int64)  # segments planned and not handed out
        self.begun = np.empty(0)  # and moments of the plan, of the first of the way-points
        self.remainder: Plan | None = None
        self.first, self.first_cycle, self.next_point = 0, 0, 1
        self._lost = 0.0  # cycles of stretch that are not whole yet

    def __len__(self) -> int:
        return len(self.points)

    def add(self, points: FloatArray, gaps: FloatArray, speeds: FloatArray | None = None) -> None:
        """Know more way-points."""
        self.points = np.concatenate([self.points, points])
        self.gaps = np.concatenate([self.gaps, gaps])
        if speeds is not None:
            self.speeds = np.concatenate([self.speeds, speeds])

    @property
    def start(self) -> FloatArray:
        """Position relative to the sample, velocity, acceleration (3, N) of the plan, per cycle."""
        P, V, A = begin_of(self.state, self.T)
        return np.stack([P - self.state.position, V, A])

    def going_on(
        self, moments: FloatArray, until: float = np.inf, *, rests: bool = False
    ) -> FloatArray:
        """Moments (k,): those planned before, where there were any; then the same gaps.

        Of the plan before so many cycles; ``rests``: its rest at the last way-point that it knew
        is one of its moments.
        """
        begun = self.begun[self.begun <= until]
        if rests and len(self.begun):
            begun = np.append(self.begun, float(self.left.sum()))
        known = min(len(begun), len(moments))
        if known == 0:
            return moments
        later = moments[known:] - moments[known - 1] + begun[known - 1]
        return np.concatenate([begun[:known], later])

    def hand_out(self, plan: Plan, cycles: float) -> Followed:
        """Segments of so many cycles of a plan, or of all of it; go on from where they end."""
        knots, T = plan.knots, self.T
        count = len(knots)
        if cycles < knots.duration:
            count = max(1, int(np.searchsorted(knots.time, cycles, side="right")) - 1)
        last = count == len(knots)  # at rest, whether at the last way-point or behind it
        p, v, a, j = (x[: count + 1] for x in knots.motion(plan.answer.control))
        j = j[:count]
        joints = p.shape[1]
        before = np.concatenate([self.state.last_jerk[None] * T**3, j])
        v[0], a[0] = self.state.velocity * T, self.state.acceleration * T**2
        taken: IntArray = knots.lengths[:count].astype(np.int64)
        lengths: IntArray = np.zeros((count, PHASES), dtype=np.int64)
        lengths[:, 0] = taken
        jerk = np.zeros((count, PHASES, joints))
        jerk[:, 0] = j
        ways = _ways(knots.lengths[:count, None], v[:-1], a[:-1], before[:-1], j)
        end = self.state.position + (p[-1] - v[-1] / 2.0 + a[-1] / 3.0 - before[-1] / 8.0)
        if last:  # a cycle for the samples to come to rest
            lengths[-1, 1] = 1
            taken[-1] += 1
            before[-1] = v[-1] = a[-1] = 0.0
            end = self.points[len(plan.moments) - 1] if plan.rests else self.state.position + p[-1]
            ways[-1] += j[-1] / 8.0
        position = _summed(self.state.position, ways, end)
        ends = np.cumsum(taken)
        passed = int((plan.moments <= ends[-1] + 1e-9).sum())
        made = Followed(
            self.names, T, self.first, self.first_cycle, taken, self._stretch(plan, passed, ends),
            lengths, jerk / T**3, position, v / T, a / T**2, before / T**3,
            self.next_point + np.searchsorted(plan.moments, ends - taken, side="right"),
            self._passed(plan, passed),
        )  # fmt: skip
        np.minimum(made.ahead, self.next_point + len(self.points) - 1, out=made.ahead)
        origin = self.state.position
        self._forget(plan, passed, int(ends[-1]))
        self.begun = plan.answer.moments[passed:] - int(ends[-1])
        self.left = knots.lengths[count:].astype(np.int64)
        self.first += count
        self.state = Knot.of(made)
        self.remainder = None
        if len(self.left):  # what was planned behind it, to rest: a way on, whatever comes
            onward = Knots(self.left)
            control = plan.answer.control[count:] + (origin - self.state.position)
            control[:3] = onward.begin(*self.start)  # they depend on the knots before the first
            answer = replace(plan.answer, control=control, moments=self.begun)
            later = plan.asked[passed:] - ends[-1], plan.moments[passed:] - ends[-1]
            self.remainder = Plan(onward, answer, *later, plan.rests)
        return made

    def stopped(self, made: Followed) -> Followed:
        """Hand out a motion from rest to rest past all way-points; its own ones start at 0."""
        new = 0 if self.first == 0 else 1  # the start was passed before
        passed = Passed(
            made.passed.point[new:],
            made.passed.moment[new:] + self.first_cycle * self.T,
            made.passed.deviation[new:],
        )
        own = replace(made, first=self.first, first_cycle=self.first_cycle, passed=passed)
        self.next_point += len(self.points)
        self.points, self.gaps, self.speeds = self.points[:0], self.gaps[:0], self.speeds[:0]
        self.left, self.begun, self.over = self.left[:0], self.begun[:0], 0.0
        self.first += len(made)
        self.first_cycle += int(made.cycles.sum())
        self.state = Knot.rest(made.position[-1])
        return own

    def head(self, count: int) -> Window:
        """The same with its first way-points only, to be planned."""
        one = copy.copy(self)
        one.points, one.gaps = self.points[:count], self.gaps[:count]
        one.speeds = self.speeds[:count]
        return one

    def take(self, made: Followed) -> Followed:
        """Hand out a motion whose segments end at way-points; ``made``: numbered from 0 on."""
        count, shift = len(made), self.next_point - 1
        passed = made.passed
        first = 0 if self.first == 0 else 1
        own = replace(
            made,
            first=self.first,
            first_cycle=self.first_cycle,
            ahead=made.ahead + shift,
            passed=Passed(
                passed.point[first:] + shift,
                passed.moment[first:] + self.first_cycle * self.T,
                passed.deviation[first:],
            ),
        )
        self.points, self.gaps = self.points[count:], self.gaps[count:]
        self.speeds = self.speeds[count:]
        self.over, self.left, self.begun = 0.0, self.left[:0], self.begun[:0]
        self.first += count
        self.first_cycle += int(made.cycles.sum())
        self.next_point += count
        self.state, self.remainder = Knot.of(made), None
        return own

    def rest(self, made: Followed) -> Followed:
        """Hand out a motion that passes no way-point, to rest."""
        own = replace(
            made,
            first=self.first,
            first_cycle=self.first_cycle,
            ahead=np.full(len(made), self.next_point),
        )
        self.left, self.begun, self.remainder = self.left[:0], self.begun[:0], None
        self.first += len(made)
        self.over += float(made.cycles.sum())
        self.first_cycle += int(made.cycles.sum())
        self.state = Knot.of(made)
        return own

    def _passed(self, plan: Plan, count: int) -> Passed:
        at = places(plan.knots, plan.answer)[:count]
        deviation = np.zeros((count, self.points.shape[1]))
        deviation[: len(at)] = at - (self.points[: len(at)] - self.state.position)
        point = self.next_point + np.arange(count)
        moment = self.first_cycle + plan.moments[:count]
        if self.first == 0:
            deviation = np.concatenate([np.zeros((1, deviation.shape[1])), deviation])
            point, moment = np.concatenate([[0], point]), np.concatenate([[0.0], moment])
        return Passed(point, moment * self.T, deviation)

    def _stretch(self, plan: Plan, passed: int, ends: IntArray) -> IntArray:
        """Whole cycles of delay, in the segments in which they arise."""
        late = plan.moments[:passed] - plan.asked[:passed]
        fresh = np.diff(late, prepend=0.0)
        segment = np.minimum(np.searchsorted(ends, plan.moments[:passed] - 1e-9), len(ends) - 1)
        lost = self._lost + np.cumsum(np.bincount(segment, fresh, len(ends)))
        whole = np.floor(lost + 1e-6).astype(np.int64)
        self._lost = float(lost[-1] - whole[-1])
        late_by: IntArray = np.diff(whole, prepend=0)
        return late_by

    def _forget(self, plan: Plan, passed: int, cycles: int) -> None:
        at = float(plan.moments[passed - 1]) if passed else -self.over
        self.over = cycles - at
        self.points, self.gaps = self.points[passed:], self.gaps[passed:]
        self.speeds = self.speeds[passed:]
        self.next_point += passed
        self.first_cycle += cycles


def _ways(n: FloatArray, V: FloatArray, A: FloatArray, L: FloatArray, J: FloatArray) -> FloatArray:
    """From sample to sample, n cycles of jerk J after one of jerk L: q = P - V/2 + A/3 - J/8."""
    begin = V / 2.0 - A / 3.0 + L / 8.0
    after = begin + n * (V + n * (A / 2.0 + n * J / 6.0))
    ends: FloatArray = after - (V + n * (A + n * J / 2.0)) / 2.0 + (A + n * J) / 3.0 - J / 8.0
    return ends


def _summed(start: FloatArray, ways: FloatArray, end: FloatArray) -> FloatArray:
    """Samples (m + 1, J), each as exact as its way from the one before, near zero or far.

    What the sum is off at the end, by rounding, is shared out evenly.
    """
    sums = np.concatenate([start[None], ways]).astype(np.longdouble).cumsum(axis=0)
    share = np.arange(len(sums), dtype=np.longdouble)[:, None] / (len(sums) - 1)
    position: FloatArray = (sums + (end - sums[-1]) * share).astype(np.float64)
    position[0], position[-1] = start, end
    return position
