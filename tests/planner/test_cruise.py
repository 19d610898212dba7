"""``plan(cruise="exact")``: a cruise at the velocity that is given, to rounding."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from helpers import planner_check as check
from helpers.strategies import cycle_times, limits, units
from sjerk import InputError, Limits, Profile, State, plan

T = 1e-3
PAPER = Limits(250.0, 2000.0, 15000.0)


def cruise_of(profile: Profile) -> tuple[int, float]:
    """Cycles without acceleration and jerk at the velocity that lies highest, and that velocity."""
    sign = 1.0 if profile.end.position >= profile.start.position else -1.0
    k = np.arange(profile.cycles + 1) * profile.cycle_time
    at = profile.at(k)
    still = np.abs(at.acceleration[:-1]) + np.abs(np.diff(at.acceleration))
    still = still <= 1e-9 * np.max(np.abs(at.acceleration))
    top = np.max(sign * at.velocity)
    return int(np.sum(still & (sign * at.velocity[:-1] >= top * (1 - 1e-10)))), float(top)


@st.composite
def moves(draw: st.DrawFn) -> tuple[State, State, Limits, float, float]:
    """Any start and target within the limits, with room for a cruise; the cycles of the cruise."""
    limit = draw(limits(scale=draw(units)))
    finest = min(limit.velocity / a for a in (limit.acceleration, limit.braking[0]))
    cycle_time = min(draw(cycle_times), finest / 4)
    share = st.floats(-0.9, 0.9) | st.sampled_from([0.0])
    v0, v1 = draw(share) * limit.velocity, draw(share) * limit.velocity
    least_a, least_j = (
        min(limit.acceleration, limit.braking[0]),
        min(limit.jerk, limit.braking[1]),
    )
    most_a = min(least_a, np.sqrt(2 * least_j * (limit.velocity - abs(v0))) * 0.5)
    a0 = draw(share) * most_a
    ramp = 2 * limit.velocity / least_a + 2 * least_a / least_j
    ramp = max(ramp, 4 * np.sqrt(2 * limit.velocity / least_j), 20 * cycle_time)
    cycles = draw(st.floats(12.0, 400.0))
    way = limit.velocity * (3 * ramp + cycles * cycle_time)
    assume(3 * ramp / cycle_time < 1e5)
    sign = draw(st.sampled_from([1.0, -1.0]))
    return State(0.0, sign * v0, sign * a0), State(sign * way, sign * v1), limit, cycle_time, cycles


@given(moves())
def test_the_cruise_is_at_the_limit_to_rounding(
    case: tuple[State, State, Limits, float, float],
) -> None:
    """Whatever start, target, unit and direction; the other limits hold, the end is exact, and it
    takes at most three cycles more than the fastest, which cruises a little slower.
    """
    start, target, limit, cycle_time, cycles = case
    exact = plan(start, target, limit, cycle_time, cruise="exact")
    steady, top = cruise_of(exact)
    assert steady >= min(cycles - 12.0, 1.0)
    assert abs(top - limit.velocity) <= 1e-12 * limit.velocity
    made = np.frombuffer(check.ffi.buffer(exact.c_plan), dtype=check.PLAN).copy()
    r = check.Requests(
        np.array([[start.position, start.velocity, start.acceleration]]),
        np.array([[target.position, target.velocity]]),
        np.array([[limit.velocity, limit.acceleration, limit.jerk, *limit.braking]]),
    )
    worst = check.judge(r, made, cycle_time)
    assert all(worst[name][0] <= check.WITHIN for name in ("v", "a", "j"))
    assert all(worst[name][0] <= 1e-9 for name in ("position", "velocity", "acceleration"))
    if target.velocity == 0.0:
        assert exact.cycles <= plan(start, target, limit, cycle_time).cycles + 3


def test_on_a_straight_line_the_tightest_axis_cruises_at_its_limit() -> None:
    """Two axes in phase; the other one in proportion, so the line is kept."""
    limits = [PAPER, Limits(100.0, 2000.0, 15000.0)]
    made = plan([0.0, 0.0], [300.0, 200.0], limits, T, synchronization="phase", cruise="exact")
    assert made.synchronization == "phase"
    velocity = made.sample().velocity
    assert np.max(velocity[:, 1]) == pytest.approx(100.0, rel=1e-12)
    assert np.max(velocity[:, 0]) == pytest.approx(150.0, rel=1e-12)
    each = plan([0.0, 0.0], [300.0, 200.0], limits, T, synchronization="none", cruise="exact")
    assert [cruise_of(profile)[1] for profile in each] == pytest.approx([250.0, 100.0], rel=1e-12)


def test_without_the_word_the_cruise_is_a_little_slower() -> None:
    """What is asked for: the fast plan does not reach the velocity."""
    fast = cruise_of(plan(0.0, 300.1, PAPER, T))[1]
    assert fast < 250.0 * (1 - 1e-6)
    assert cruise_of(plan(0.0, 300.1, PAPER, T, cruise="exact"))[1] == pytest.approx(250, rel=1e-13)


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({"cruise": "slow"}, "cruise"),
        ({"cruise": None}, "cruise"),
        ({"cruise": "exact", "min_duration": 3.0}, "min_duration"),
    ],
)
def test_what_is_no_cruise_is_refused(options: dict[str, Any], field: str) -> None:
    """By name; and so is one that is not reached, or is not the velocity of any axis."""
    with pytest.raises(InputError) as caught:
        plan(0.0, 300.0, PAPER, T, **options)
    assert caught.value.field == field
    for short in (1.0, 60.0, 0.0):
        with pytest.raises(InputError, match="cruise"):
            plan(0.0, short, PAPER, T, cruise="exact")
    with pytest.raises(InputError, match="cruise"):
        plan([0.0, 0.0], [300.0, 200.0], PAPER, T, cruise="exact")
