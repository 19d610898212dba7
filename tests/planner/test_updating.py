"""Planning in a loop of one's own: plans are left at any cycle, and nothing jumps.

The judge integrates the jerks that were sent by Eqs. (15)-(17) and looks at limits and at the
samples: it does not know where one plan ends and the next begins.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from sjerk import InputError, Limits, Profile, State, plan
from sjerk.planner import Step, Updater

T = 1e-3
ROBOT = Limits(2.175, 7.5, 500.0)
Array = NDArray[np.float64]


def judge(steps: list[Step], start: list[float], limits: list[Limits]) -> None:
    """Each sample follows from the one before by its jerk; all limits are kept."""
    q, v, a, j = (
        np.array([getattr(step, name) for step in steps])
        for name in ("position", "velocity", "acceleration", "jerk")
    )
    zero = np.zeros((1, q.shape[1]))
    q, v, a, j = np.vstack([[start], q]), *(np.vstack([zero, x]) for x in (v, a, j))
    most_v, most_a, most_j = (
        np.array([getattr(one, name) for one in limits])
        for name in ("velocity", "acceleration", "jerk")
    )
    assert np.all(np.abs(v) <= most_v * (1 + 1e-9))
    assert np.all(np.abs(a) <= most_a * (1 + 1e-9))
    assert np.all(np.abs(j) <= most_j * (1 + 1e-9))
    for low, high, scale in ((j, a, most_j * T), (a, v, most_a * T), (v, q, most_v * T)):
        off = np.diff(high, axis=0) - T * (low[1:] + low[:-1]) / 2
        assert np.max(np.abs(off) / scale) <= 1e-6


@given(st.integers(1, 2000), st.integers(-50_000, 50_000), st.floats(-80.0, 80.0))
def test_a_plan_can_be_left_at_any_cycle(cycle: int, thousandths: int, v0: float) -> None:
    """From ``state(k)`` the rest is as long as it was, but for few cycles, and rows follow rows."""
    limit, goal = Limits(90.0, 500.0, 5000.0), thousandths / 1000
    profile = plan(State(0.0, v0), goal, limit, T)
    rows = profile.sample()
    now = profile.state(cycle)
    again = plan(now, goal, limit, T)
    assert again.cycles <= max(0, profile.cycles - cycle) + 4
    new = again.sample()
    if cycle <= profile.cycles:
        a = rows.acceleration[cycle] + T * (rows.jerk[cycle] + new.jerk[1]) / 2
        v = rows.velocity[cycle] + T * (rows.acceleration[cycle] + new.acceleration[1]) / 2
        q = rows.position[cycle] + T * (rows.velocity[cycle] + new.velocity[1]) / 2
        assert new.acceleration[1] == pytest.approx(a, abs=1e-7)
        assert new.velocity[1] == pytest.approx(v, abs=1e-9)
        assert new.position[1] == pytest.approx(q, abs=1e-9)
    assert new.position[-1] == goal


def test_the_state_is_the_motion_s_by_the_lemma() -> None:
    """In rationals: P, V, A behind the state are those of the plan at that time."""
    profile = plan(State(1.0, 10.0, 50.0), 160.0, Limits(90.0, 500.0, 5000.0), T)
    for k in range(0, profile.cycles, 37):
        state, at = profile.state(k), profile.at(k * T)
        A, h = Fraction(state.acceleration), Fraction(T)
        V = Fraction(state.velocity) + h * A / 2
        P = Fraction(state.position) + h * Fraction(state.velocity) / 2 - h * h * A / 12
        assert float(A) == pytest.approx(float(at.acceleration), abs=1e-9)
        assert float(V) == pytest.approx(float(at.velocity), abs=1e-10)
        assert float(P) == pytest.approx(float(at.position), abs=1e-10)
        back = State.continuous(float(P), float(V), float(A), cycle_time=T)
        assert back.position == pytest.approx(state.position, abs=1e-12)
        assert back.velocity == pytest.approx(state.velocity, abs=1e-12)


@given(st.floats(0.1, 1.0), st.floats(-1.0, 1.0), st.floats(1.0, 1000.0))
def test_a_continuous_state_that_just_keeps_the_limit_keeps_it(
    share: float, goal: float, jerk: float
) -> None:
    """V + A^2 / 2J = V_max exactly, from the continuous state, on the grid of the cycles."""
    limit = Limits(2.0, 5.0, jerk)
    n = int(share * min(5.0, np.sqrt(2.0 * 2.0 * jerk)) / (jerk * T))
    A = n * jerk * T
    start = State.continuous(0.0, 2.0 - A * A / (2.0 * jerk), A, cycle_time=T)
    velocity = plan(start, 100.0 * goal, limit, T).extrema().velocity
    assert velocity.high <= 2.0 * (1 + 1e-9)


@st.composite
def runs(draw: st.DrawFn) -> tuple[list[Limits], list[tuple[int, list[float]]], str]:
    """Limits of 1-3 axes; targets and for how many cycles each is asked for."""
    n = draw(st.integers(1, 3))
    limits = [
        Limits(draw(st.floats(0.5, 3.0)), draw(st.floats(2.0, 20.0)), draw(st.floats(50.0, 2e3)))
        for _ in range(n)
    ]
    some = st.tuples(
        st.sampled_from([1, 2, 3, 17]) | st.integers(1, 400),
        st.lists(st.integers(-1000, 1000).map(lambda x: x / 1e3), min_size=n, max_size=n),
    )
    mode = draw(st.sampled_from(["time", "none", "phase"]))
    return limits, draw(st.lists(some, min_size=1, max_size=12)), mode


@given(runs())
def test_targets_that_change_in_any_cycle_never_make_a_jump(
    run: tuple[list[Limits], list[tuple[int, list[float]]], str],
) -> None:
    """One axis or several, whatever the targets and when: all limits kept, the last target met."""
    limits, targets, mode = run
    loop = Updater([0.0] * len(limits), limits, T, synchronization=mode)  # type: ignore[arg-type]
    steps = [loop.update(goal) for count, goal in targets for _ in range(count)]
    for _ in range(100_000):
        if steps[-1].done:
            break
        steps.append(loop.update(targets[-1][1]))
    judge(steps, [0.0] * len(limits), limits)
    assert steps[-1].position.tolist() == targets[-1][1]


def test_a_target_that_moves_each_cycle_is_followed() -> None:
    """0.5 (1 - cos pi t) with its velocity, a new target in each cycle: no jump, no limit lost."""
    loop, steps = Updater([0.0], ROBOT, T), []
    for k in range(4000):
        t = k * T
        goal = State(0.5 * (1 - np.cos(np.pi * t)), 0.5 * np.pi * np.sin(np.pi * t))
        steps.append(loop.update([goal]))
    for _ in range(5000):
        steps.append(loop.update([0.25]))
    judge(steps, [0.0], [ROBOT])
    assert steps[-1].done
    assert steps[-1].position[0] == 0.25


def test_an_end_velocity_goes_on_and_can_be_left() -> None:
    """Behind a target in motion the samples go on at its velocity, for any time, and from there."""
    loop = Updater([0.0], ROBOT, T)
    steps = [loop.update([State(0.5, 1.0)]) for _ in range(3000)]
    assert steps[-1].done
    steps += [loop.update([0.0]) for _ in range(8000)]
    judge(steps, [0.0], [ROBOT])
    assert steps[-1].position[0] == 0.0


def test_lower_limits_in_the_loop_are_kept_as_by_plan() -> None:
    """The velocity falls to the new limit and does not pass below it before the goal's braking."""
    loop = Updater([0.0], Limits(250.0, 2000.0, 15000.0), T)
    low = Limits(75.0, 2000.0, 15000.0)
    steps = [loop.update([300.0]) for _ in range(500)]
    while not steps[-1].done:
        steps.append(loop.update([300.0], limits=low))
    velocity = np.array([step.velocity[0] for step in steps])
    left = 300.0 - np.array([step.position[0] for step in steps])
    assert np.min(velocity[500:][left[500:] > 15.0]) >= 74.9
    assert steps[-1].position[0] == 300.0


@pytest.mark.parametrize("cycle", [-1, 1.0, True, None, "1"])
def test_a_cycle_that_is_none_is_refused(cycle: Any) -> None:
    """By name and value."""
    profile: Profile = plan(0.0, 1.0, ROBOT, T)
    with pytest.raises(InputError, match="cycle"):
        profile.state(cycle)


def test_what_a_loop_refuses_leaves_it_where_it_is() -> None:
    """Targets of other axes, outside the limits, no numbers: the next sample is as if not asked."""
    one, two = (Updater([0.0, 0.0], ROBOT, T) for _ in range(2))
    for loop in (one, two):
        for _ in range(50):
            loop.update([1.0, 0.5])
    for wrong in (1.0, [1.0], [1.0, State(0.0, 5.0)], [1.0, "a"], None, [1.0, float("nan")]):
        with pytest.raises(InputError):
            one.update(wrong)  # type: ignore[arg-type]
    assert np.array_equal(one.update([1.0, 0.5]).position, two.update([1.0, 0.5]).position)
    for start in (0.0, "00", [None]):
        with pytest.raises(InputError):
            Updater(start, ROBOT, T)  # type: ignore[arg-type]
