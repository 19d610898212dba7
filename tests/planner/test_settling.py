"""Limits lowered in motion: the velocity falls to the new limit, not below it, not back.

The judge is the rule in continuous time and closed form: ramp to the limit, cruise, ramp to the
target; where the way is too short for both, ramps by way of a lower velocity. It shares no code
with the planner.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from helpers import planner_check as check
from helpers.strategies import cycle_times, limits, units
from sjerk import Limits, Profile, State, plan, plan_many, plan_velocity

T = 1e-3
#: Cycles that whole cycles may cost over continuous time: each of six roundings less than one.
SPARE = 4
PAPER = Limits(250.0, 2000.0, 15000.0)
LOWERED = Limits(75.0, 2000.0, 15000.0)


def motion(profile: Profile) -> list[tuple[Fraction, Fraction, Fraction]]:
    """Exact (V, A) at the nodes of the plan, per second, and the lowest V up to the next node."""
    T_s = Fraction(profile.cycle_time)
    A = Fraction(profile.start.acceleration)
    V = Fraction(profile.start.velocity) + A * T_s / 2
    nodes = []
    for phase in profile.phases:
        t, J = phase.cycles * T_s, Fraction(phase.jerk)
        low = min(V, V + A * t + J * t * t / 2)
        if J != 0 and 0 < -A / J < t:
            low = min(low, V - A * A / (2 * J))
        nodes.append((V, A, low))
        V, A = V + A * t + J * t * t / 2, A + J * t
    return [*nodes, (V, A, V)]


@dataclass
class Braking:
    """A start that is carried above the limit, and the ramps by which it brakes, forward."""

    V0: float
    A0: float
    limit: Limits

    def shed(self) -> tuple[float, float, float]:
        """Time, way and velocity until the start accelerates no more."""
        if self.A0 <= 0.0:
            return 0.0, 0.0, self.V0
        t = self.A0 / self.limit.jerk
        return t, t * (self.V0 + self.A0 * t / 3), self.V0 + self.A0 * t / 2

    @property
    def least(self) -> float:
        """The velocity that full jerk against the braking leaves."""
        return self.V0 - self.A0**2 / (2 * self.limit.braking[1]) if self.A0 < 0 else self.shed()[2]

    def to(self, v: float) -> tuple[float, float]:
        """Time and way of the fastest ramp to (v, 0), v not above what is left anyway."""
        D, J = self.limit.braking
        time, way, V = self.shed()
        a = max(0.0, -self.A0)
        peak = min(D, math.sqrt(J * (V - v) + a * a / 2))
        hold = (V - v - (peak**2 - a * a / 2) / J) / peak if peak > 0.0 else 0.0
        for t, j in (((peak - a) / J, -J), (max(0.0, hold), 0.0), (peak / J, J)):
            way += t * (V - a * t / 2 + j * t * t / 6)
            V, a = V - a * t + j * t * t / 2, a - j * t
            time += t
        return time, way

    def by(self, v: float, v1: float) -> tuple[float, float]:
        """Time and way of both ramps, by way of v."""
        (t1, s1), (t2, s2) = self.to(v), Braking(v, 0.0, self.limit).to(v1)
        return t1 + t2, s1 + s2

    def rule(self, way: float, v1: float) -> float:
        """Time of the rule over the way: by way of the limit, or of the velocity that fits."""
        V = self.limit.velocity
        time, full = self.by(V, v1)
        if way >= full:
            return time + (way - full) / V
        low, high = v1, V
        for _ in range(100):
            v = (low + high) / 2
            low, high = (v, high) if self.by(v, v1)[1] < way else (low, v)
        return self.by(low, v1)[0]


@pytest.mark.parametrize(
    ("way", "most"),
    [(3000.0, 39817), (300.0, 3817), (60.0, 617), (40.0, 358), (35.0, 330), (32.5, 276)],
)
def test_the_paper_s_axis_at_override_0_3(way: float, most: int) -> None:
    """From 250 the velocity falls to 75 and stays until the braking for the goal, but for what one
    cycle more takes; it never rises, and on the shortest ways it falls through.
    """
    profile = plan(State(0.0, 250.0), way, LOWERED, T)
    assert profile.cycles <= most
    nodes = motion(profile)
    assert all(low >= -1e-9 for *_, low in nodes)
    assert all(A <= 1e-9 for _, A, _ in nodes)
    assert not profile.retracts
    if way >= 60.0:
        cruise = [float(V) for V, A, _ in nodes[1:-1] if abs(A) < 1e-6]
        assert cruise
        assert min(cruise) >= 75.0 * (1 - 1.5 / (way / 75.0 / T - 200.0))


@pytest.mark.parametrize("way", [30.0, 20.0, 0.0, -100.0])
def test_a_plan_that_must_swing_back_says_so(way: float) -> None:
    """No braking is short enough: the plan says before it is used that its velocity turns."""
    assert plan(State(0.0, 250.0), way, LOWERED, T).retracts
    assert plan([State(0.0, 250.0), State(0.0)], [way, 5.0], [LOWERED] * 2, T).retracts
    assert not plan(State(0.0, 250.0), 300.0, LOWERED, T).retracts


@st.composite
def lowered(
    draw: st.DrawFn, *, moving: bool = False
) -> tuple[State, State, Limits, float, float, float]:
    """A start above the limit; a target behind its shortest braking; the cycle, the rule's time,
    the sign. A cycle of jerk is at most all acceleration, one of acceleration at most the limit.
    """
    limit = draw(limits(scale=draw(units)))
    ramps = (limit.acceleration, limit.jerk), limit.braking
    finest = min(min(limit.velocity / a, a / j) for a, j in ramps)
    cycle_time = min(draw(cycle_times), finest)
    V0 = limit.velocity * 10.0 ** draw(st.floats(0.001, 1.3))
    share = draw(st.floats(-1.0, 1.0) | st.sampled_from([0.0, 1.0, -1.0]))
    cycle_of_jerk = limit.braking[1] * cycle_time**2
    falls = math.sqrt(2 * limit.braking[1] * max(0.0, V0 - limit.velocity - cycle_of_jerk))
    a = share * (limit.acceleration if share > 0.0 else min(limit.braking[0], falls))
    start = Braking(V0, a, limit)
    v1 = limit.velocity * (draw(st.floats(0.0, 0.5)) if moving else 0.0)
    shortest, full = start.to(v1)[1], start.by(limit.velocity, v1)[1]
    way = draw(
        st.floats(0.0, 1.0).map(lambda x: shortest + (full - shortest) * x)
        | st.floats(-4.0, 2.0).map(lambda x: full * (1 + 10.0**x))
    )
    way = max(way, shortest + SPARE * max(V0, start.least) * cycle_time)
    assume(way / limit.velocity / cycle_time < 1e9)
    time, v = start.rule(way, v1), V0 - a * cycle_time / 2
    goal = way + cycle_time / 2 * (v + v1) - cycle_time**2 / 12 * a
    sign = draw(st.sampled_from([1.0, -1.0]))
    states = State(0.0, sign * v, sign * a), State(sign * goal, sign * v1)
    return *states, limit, cycle_time, time, sign


@given(lowered())
def test_the_velocity_falls_to_the_limit_and_does_not_turn(
    case: tuple[State, State, Limits, float, float, float],
) -> None:
    """Whatever state, limits, unit, sign and cycle: at rest in the end the motion brakes only, once
    it accelerates no more; it never turns; and it is as soon there as by the rule.
    """
    start, target, limit, cycle_time, time, sign = case
    profile = plan(start, target, limit, cycle_time)
    nodes = motion(profile)
    if sign < 0.0:
        back = plan(
            State(0.0, -start.velocity, -start.acceleration),
            State(-target.position, -target.velocity),
            limit,
            cycle_time,
        )
        assert [(p.cycles, -p.jerk) for p in back.phases] == [
            (p.cycles, p.jerk) for p in profile.phases
        ]
        nodes = motion(back)
    peak = max(V for V, *_ in nodes)
    assert all(low >= -1e-9 * peak for *_, low in nodes)
    assert not profile.retracts
    assert profile.cycles <= time / cycle_time + SPARE
    braking = False
    for _, A, _ in nodes:
        braking = braking or A <= 0
        assert not braking or limit.braking[0] * 1e-9 >= A
    if profile.cycles < 20_000:
        assert profile.sample().position[-1] == target.position


@pytest.mark.parametrize("unit", check.UNITS)
@pytest.mark.parametrize("asymmetric", [False, True])
@pytest.mark.parametrize("kind", ["start", "target"])
def test_above_the_limit_every_other_limit_holds(unit: str, asymmetric: bool, kind: str) -> None:
    """Also where a cycle is coarse: by the judge of all plans, from starts up to 20 times too fast,
    to targets as near as their braking.
    """
    rng = np.random.default_rng(len(unit) + 100 * asymmetric + len(kind))
    drawn = check.draw_coarse if unit == check.COARSE else check.draw
    scale = {} if unit == check.COARSE else {"scale": check.UNITS[unit]}
    r = drawn(rng, 2000, kind, asymmetric=asymmetric, T=T, **scale)
    n = len(r)
    way = np.where(rng.uniform(size=n) < 0.5, -1.0, 1.0)
    r.start[:, 1] = way * r.limits[:, 0] * 10.0 ** rng.uniform(-0.1, 1.3, n)
    stop = way * r.start[:, 1] ** 2 / r.limits[:, 1]
    near = r.start[:, 0] + stop * rng.uniform(0.0, 3.0, n)
    r.target[:, 0] = np.where(rng.uniform(size=n) < 0.7, near, r.target[:, 0])
    made = check.whole(r, plan_many(r.start, r.target, r.limits, T), T)
    worst = check.judge(r, made, T)
    for name in ("v", "a", "j"):
        assert np.max(worst[name]) <= check.WITHIN, (name, r.only(np.argmax(worst[name])))
    for name in ("position", "velocity", "acceleration"):
        assert np.max(worst[name]) <= 1e-9, (name, r.only(np.argmax(worst[name])))


@given(lowered(moving=True))
def test_a_target_in_motion_is_met_from_above_the_limit(
    case: tuple[State, State, Limits, float, float, float],
) -> None:
    """Within the velocity of the start, on the target; and no later than the rule but for the
    cycles that the target's own motion leaves no choice of.
    """
    start, target, limit, cycle_time, time, sign = case
    profile = plan(start, target, limit, cycle_time)
    peak = max(abs(start.velocity + start.acceleration * cycle_time / 2), limit.velocity)
    peak = max(peak, Braking(peak, sign * start.acceleration, limit).least)
    peak += max(limit.jerk, limit.braking[1]) * cycle_time**2
    nodes = motion(profile)
    assert max(abs(V) for V, _, _ in nodes) <= peak * (1 + 1e-9)
    assert abs(float(nodes[-1][0]) - target.velocity) <= 1e-9 * peak
    if not profile.retracts:
        assert profile.cycles <= time / cycle_time + 2 * SPARE


@given(lowered(), st.integers(0, 30))
@example((State(0.0, 250.0), State(60.0), LOWERED, T, 0.616, 1.0), 0)
def test_axes_together_do_not_turn_either(
    case: tuple[State, State, Limits, float, float, float], more: int
) -> None:
    """The same where the motion takes longer than it needs, to wait for another axis."""
    start, target, limit, cycle_time, time, _ = case
    assume(time / cycle_time < 1e7)
    alone = plan(start, target, limit, cycle_time)
    both = plan(start, target, limit, cycle_time, min_duration=alone.duration * (1 + more / 10))
    assert both.cycles >= alone.cycles
    assert not both.retracts


@pytest.mark.parametrize("v0", [80.0, 250.0, 1000.0])
@pytest.mark.parametrize("v1", [75.0, 10.0, 0.0])
def test_a_change_of_velocity_does_not_pass_its_end(v0: float, v1: float) -> None:
    """plan_velocity to a velocity within the limits, from above them: straight down to it."""
    profile = plan_velocity(State(0.0, v0), v1, LOWERED, T)
    assert min(float(low) for *_, low in motion(profile)) >= v1 - 1e-9
    time = Braking(v0, 0.0, LOWERED).to(v1)[0]
    assert profile.cycles <= time / T + 2


@pytest.mark.parametrize("factor", [1.0, 1.5, 10.0])
def test_raised_limits_lead_up_at_once(factor: float) -> None:
    """The inverse: from a cruise at the old limit the plan rises, then falls to the goal only."""
    raised = Limits(75.0 * factor, 2000.0, 15000.0)
    velocity = plan(State(0.0, 75.0), 300.0, raised, T).sample().velocity
    top = int(np.argmax(velocity))
    assert np.all(np.diff(velocity[:top]) >= -1e-9)
    assert np.all(np.diff(velocity[top:]) <= 1e-9)
