"""Targets with an acceleration: met exactly, in few cycles, gone on from; or refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from helpers import planner_check as check
from sjerk import Axis, InputError, Limits, MotionKernel, State, plan, plan_velocity
from sjerk.planner import Updater

T = 1e-3
OWN = Limits(2.0, 8.0, 200.0)


@st.composite
def targets(draw: st.DrawFn) -> tuple[State, State, Limits]:
    """A start at rest or in motion, a legal target, limits; any scale."""
    v = 10.0 ** draw(st.floats(-3, 6))
    a = v * 10.0 ** draw(st.floats(-1, 1.5))
    own = Limits(v, a, a * 10.0 ** draw(st.floats(0, 2.5)))
    half, carried = own.acceleration * T, own.acceleration**2 / own.jerk
    share = min(1.0, v / (carried + half)) * 0.9
    unit = st.floats(-1, 1)
    start = State(
        v * draw(st.floats(-9, 9)),
        v * draw(unit) * 0.3,
        own.acceleration * share * draw(unit) * 0.7,
    )
    goal = State(
        start.position + v * draw(st.floats(-9, 9)),
        v * draw(unit) * 0.3,
        own.acceleration * share * draw(unit) * 0.7,
    )
    return start, goal, own


@given(targets())
def test_the_last_row_is_the_target_and_the_motion_goes_on_from_it(
    drawn: tuple[State, State, Limits],
) -> None:
    """To the bit; the rows behind it are the motion at its acceleration, without jerk."""
    start, goal, own = drawn
    profile = plan(start, goal, own, T)
    assume(profile.cycles < 20_000)
    rows = profile.sample()
    assert rows.position[-1] == goal.position
    assert (rows.velocity[-1], rows.acceleration[-1]) == (goal.velocity, goal.acceleration)
    end = profile.at(profile.duration + T)
    scale = own.velocity * (1 + profile.duration)
    assert end.velocity == pytest.approx(
        goal.velocity + goal.acceleration * T / 2, abs=1e-9 * scale
    )
    after = profile.state(profile.cycles + 4)
    assert after.velocity == pytest.approx(
        goal.velocity + 3 * T * goal.acceleration, abs=1e-9 * scale
    )


def test_a_motion_left_at_its_end_goes_on_without_a_jump() -> None:
    """Way-points passed with velocity and acceleration: the rows of all plans are one motion."""
    rng = np.random.default_rng(1)
    loop = Updater([0.0, 0.0], OWN, T)
    rows = []
    for _ in range(40):
        goal = [
            State(float(rng.normal()), float(rng.uniform(-1, 1)), float(rng.uniform(-4, 4)))
            for _ in range(2)
        ]
        while True:
            step = loop.update(goal)
            rows.append((step.position, step.velocity, step.acceleration, step.jerk))
            if step.done:
                assert step.position.tolist() == [one.position for one in goal]
                assert step.velocity.tolist() == [one.velocity for one in goal]
                assert step.acceleration.tolist() == [one.acceleration for one in goal]
                break
    q, v, a, j = (np.array(column) for column in zip(*rows, strict=True))
    for low, high in ((a, j), (v, a), (q, v)):  # Eqs. (15)-(17)
        np.testing.assert_allclose(np.diff(low, axis=0), T * (high[1:] + high[:-1]) / 2, atol=1e-9)
    assert np.abs(v).max() <= 2.0 * (1 + 1e-9)
    assert np.abs(a).max() <= 8.0 * (1 + 1e-9)
    assert np.abs(j).max() <= 200.0 * (1 + 1e-9)


@pytest.mark.parametrize("kind", ["rest", "start"])
def test_it_takes_hardly_a_cycle_more_than_ruckigs_optimum(kind: str) -> None:
    """Half of them within 0.7 cycles, 95 % within 3.5, 98 % within 5 % and 2 cycles."""
    ruckig = pytest.importorskip("ruckig")
    rng = np.random.default_rng(4)
    r = check.with_accelerations(rng, check.draw(rng, 1500, kind), T)
    r = r.only(check.legal(r, T)[0])
    made, answers = check.arrivals(r, T)
    assert not answers.any()
    h, V, A, v1, limits, _ = check.in_cycles(r, T)
    otg, x, out = ruckig.Ruckig(1), ruckig.InputParameter(1), ruckig.Trajectory(1)
    best = []
    for i in range(len(r)):
        x.current_position, x.target_position = [0.0], [h[i]]
        x.current_velocity, x.current_acceleration = [V[i] / T], [A[i] / T**2]
        x.target_velocity, x.target_acceleration = [v1[i] / T], [check.final(r, T)[i] / T**2]
        x.max_velocity, x.max_acceleration = [limits[i, 0] / T], [limits[i, 1] / T**2]
        x.max_jerk = [limits[i, 2] / T**3]
        best.append(out.duration / T if otg.calculate(x, out) >= 0 else np.nan)
    extra = made["cycles"] - np.array(best)
    known = extra[np.isfinite(extra)]
    assert len(known) > 0.9 * len(r)
    assert known.min() > -1e-3
    assert np.median(known) <= 0.7
    assert np.percentile(known, 95) <= 3.5
    within = made["cycles"] <= 1.05 * np.array(best) + 2
    assert np.mean(within[np.isfinite(extra)]) > 0.98


def test_many_ways_to_ask() -> None:
    """Several axes in time, each for itself, at least so long, cruising exactly."""
    goal = [State(1.0, 0.5, 4.0), State(-2.0, 0.0, -3.0), State(0.5)]
    for how in ("time", "phase", "none"):
        motion = plan([0.0] * 3, goal, OWN, T, synchronization=how)  # type: ignore[arg-type]
        assert [profile.end for profile in motion] == goal
        assert (len({profile.cycles for profile in motion}) == 1) == (how != "none")
        assert motion.synchronization == ("none" if how == "none" else "time")
        last = motion.sample()
        if how != "none":
            assert last.acceleration[-1].tolist() == [4.0, -3.0, 0.0]
            assert last.position[-1].tolist() == [1.0, -2.0, 0.5]
    assert plan(0.0, goal[0], OWN, T, min_duration=3.0).duration >= 3.0
    exact = plan(0.0, State(5.0, 0.5, 4.0), OWN, T, cruise="exact")
    assert exact.extrema().velocity.high == pytest.approx(2.0, rel=1e-12)
    assert exact.sample().acceleration[-1] == 4.0


@pytest.mark.parametrize(
    ("goal", "match"),
    [
        (State(1.0, 0.0, 8.1), r"target.*acceleration = 8.1: must lie within \+-8.0"),
        (State(1.0, -1.99, 8.0), r"target.* = .*v - a \|a\| / 2J within \+-2.0"),
        (State(1.0, 1.99, -8.0), r"target.* = .*v - a \|a\| / 2J within \+-2.0"),
    ],
)
def test_what_nothing_leads_to_is_refused(goal: State, match: str) -> None:
    """An acceleration beyond its limit, or one that comes from beyond the velocity limit."""
    with pytest.raises(InputError, match=match):
        plan(0.0, goal, OWN, T)
    with pytest.raises(InputError, match=match.replace("target.*", r"target\[1\].*")):
        plan([0.0, 0.0], [State(1.0, 0.0, 1.0), goal], OWN, T)


def test_braking_has_its_own_acceleration() -> None:
    """The direction of the move decides which limit an acceleration at the target has."""
    own = Limits(2.0, 8.0, 200.0, deceleration=4.0)
    assert plan(0.0, State(1.0, 0.0, 7.0), own, T).end.acceleration == 7.0
    with pytest.raises(InputError, match="limits of its direction"):
        plan(0.0, State(1.0, 0.0, -7.0), own, T)
    assert plan(0.0, State(-1.0, 0.0, -7.0), own, T).end.acceleration == -7.0


def test_a_kernel_still_refuses_it() -> None:
    """Moves of a kernel end without acceleration; so do changes of velocity."""
    kernel = MotionKernel([Axis(OWN, 1e6, "ideal")], T)
    with pytest.raises(InputError, match=r"acceleration = 1.0: must be 0"):
        kernel.host().move(State(1.0, 0.5, 1.0))
    assert plan_velocity(0.0, 1.0, OWN, T).end.acceleration == 0.0
