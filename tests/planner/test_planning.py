"""Planning from any state: legality, landing, re-planning everywhere, and ruckig as the judge."""

from __future__ import annotations

import math
import pickle
import sys
from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from helpers import planner_check as check
from helpers.exact import Sample, bilinear, continuous
from helpers.strategies import cycle_times, limits, magnitudes, units
from sjerk import (
    InfeasibleError,
    InputError,
    Limits,
    Profile,
    State,
    plan,
    plan_many,
    plan_velocity,
    scurve,
)
from sjerk.planner import Motion

T = 1e-3
ROBOT = Limits(velocity=90.0, acceleration=500.0, jerk=5000.0)
UNEVEN = Limits(90.0, 500.0, 5000.0, deceleration=300.0, deceleration_jerk=2000.0)
CRAWL = Limits(0.001, 0.5623413251903491, 0.5623413251903491)
WITHIN = check.WITHIN


def nodes(profile: Profile) -> list[tuple[float, float, float]]:
    """(V peak, A, V) at the end of every phase, in rationals from the plan's own numbers, which are
    per cycle: another rounding of them is what a cruise of 10^9 cycles multiplies.
    """
    T_s, made = profile.cycle_time, profile.c_plan
    P, V, A = Sample(
        Fraction(profile.start.position),
        Fraction(profile.start.velocity * T_s),
        Fraction(profile.start.acceleration * T_s * T_s),
    ).plan()
    phases = [(Fraction(p.cycles), Fraction(p.jerk)) for p in made.phase[0 : made.count]]
    return [
        (n.V_peak / T_s, float(n.A) / T_s**2, float(n.V) / T_s) for n in continuous(P, V, A, phases)
    ]


def inside(state: State, limit: Limits, cycle_time: float) -> bool:
    """Whether the motion behind the sample can reach zero acceleration without breaking a limit."""
    least_j = min(limit.jerk, limit.braking[1])
    least_a = min(limit.acceleration, limit.braking[0])
    a = state.acceleration
    v = state.velocity + a * cycle_time / 2
    carried = v + a * abs(a) / (2 * least_j)
    return max(abs(v), abs(carried)) <= limit.velocity and abs(a) <= least_a


def may_reach(
    V: float, A: float, limit: Limits, cycle_time: float, forward: bool
) -> tuple[float, bool]:
    """The velocity that a motion from (V, A) may reach, and whether that is within its limits.

    `forward`: the direction of the move, for unequal limits.
    """
    per_cycle = np.array(
        [
            limit.velocity * cycle_time,
            limit.acceleration * cycle_time**2,
            limit.jerk * cycle_time**3,
            limit.braking[0] * cycle_time**2,
            limit.braking[1] * cycle_time**3,
        ]
    )
    state = (np.array([V * cycle_time]), np.array([A * cycle_time**2]))
    d = np.array([1.0 if forward else -1.0])
    bound = float(check.velocity_bound(*state, per_cycle[None, :], d)[0]) / cycle_time
    least_a = limit.acceleration if (A > 0) == forward else limit.braking[0]
    return bound, bound <= limit.velocity * (1 + 1e-12) and abs(A) <= least_a


def goes_forward(profile: Profile, *, change: bool = False) -> bool:
    """The direction of the move, by the sign of the first that is not zero."""
    T_s, start, end = profile.cycle_time, profile.start, profile.end
    V = start.velocity + start.acceleration * T_s / 2
    way = (end.position - start.position) - (end.velocity + start.velocity) * T_s / 2
    way += start.acceleration * T_s**2 / 12
    signs = [end.velocity, V, start.acceleration]
    return next((x > 0 for x in ([] if change else [way]) + signs if x), True)


def state_at(sample: Sample, cycle_time: float) -> State:
    """The jerk-free sample with the same continuous motion behind it: what a kernel plans from."""
    P, V, A = (float(x) for x in sample.plan())
    v = V - A / 2
    return State(P - v / 2 + A / 12, v / cycle_time, A / cycle_time**2)


def legal(profile: Profile, limit: Limits, *, change: bool = False) -> None:
    """Every limit, at phase ends and inside phases; whole cycles; exact landing of the samples.

    The velocity may pass its limit by what no plan in whole cycles avoids, and no more.
    """
    assert all(phase.cycles >= 1 for phase in profile.phases)
    most_a, most_j = (
        max(limit.acceleration, limit.braking[0]),
        max(limit.jerk, limit.braking[1]),
    )
    start, forward = profile.start, goes_forward(profile, change=change)
    V = start.velocity + start.acceleration * profile.cycle_time / 2
    bound, _ = may_reach(V, start.acceleration, limit, profile.cycle_time, forward)
    for (peak, a, _), phase in zip(nodes(profile), profile.phases, strict=True):
        assert peak <= bound * WITHIN
        assert abs(a) <= most_a * WITHIN
        assert abs(phase.jerk) <= most_j * WITHIN
    if profile.cycles < 50_000:
        samples = profile.sample()
        assert samples.position[0] == profile.start.position
        assert samples.position[-1] == profile.end.position
        assert samples.velocity[-1] == profile.end.velocity
        third = np.abs(np.diff(samples.position, 3))
        ulp = np.spacing(np.max(np.abs(samples.position)))
        # the jump of the acceleration at the very start is the request's own
        jump = abs(profile.start.acceleration) * profile.cycle_time**2
        rest = third[2:] if jump else third
        if len(rest):
            assert np.max(rest) <= most_j * WITHIN * profile.cycle_time**3 + 8 * ulp


# ---- properties ----------------------------------------------------------------------------------


@st.composite
def requests(draw: st.DrawFn, *, moving_target: bool = True) -> tuple[State, State, Limits, float]:
    limit = draw(limits(scale=draw(units)))
    cycle_time = draw(cycle_times)
    share = st.just(0.0) | st.floats(-0.99, 0.99)
    least_a = min(limit.acceleration, limit.braking[0])
    start = State(
        draw(st.just(0.0) | st.floats(-1e9, 1e9)),
        draw(share) * limit.velocity,
        draw(share) * least_a,
    )
    distance = draw(magnitudes(-9, 9)) * draw(st.sampled_from([-1.0, 0.0, 1.0]))
    v1 = draw(share) * limit.velocity if moving_target else 0.0
    return start, State(start.position + distance, v1), limit, cycle_time


@given(requests())
@example((State(0.0), State(1e-12), ROBOT, T))
@example((State(0.0, 1e-14, -1e-14), State(1.0), ROBOT, T))
@example((State(1e9), State(1e9 + 1.0), Limits(1e3, 1e4, 1e6), T))
@example((State(1e8, 3e7), State(-1e8, -3e7), Limits(3e7, 3e9, 3e11), T))
@example((State(0.0, 89.0), State(0.0), UNEVEN, T))
def test_any_request_succeeds_within_the_limits(
    request_: tuple[State, State, Limits, float],
) -> None:
    """No failure and no broken limit, whatever the numbers."""
    start, target, limit, cycle_time = request_
    assume(inside(start, limit, cycle_time))
    try:
        profile = plan(start, target, limit, cycle_time)
    except InputError:
        assert abs(target.position - start.position) / (limit.velocity * cycle_time) > 1e12
        return
    legal(profile, limit)


@given(requests())
def test_mirrored_requests_give_mirrored_plans(
    request_: tuple[State, State, Limits, float],
) -> None:
    """Turning the axis round turns the plan round, bit for bit."""
    start, target, limit, cycle_time = request_
    assume(abs(target.position - start.position) / (limit.velocity * cycle_time) < 1e12)
    flip = [State(-s.position, -s.velocity, -s.acceleration) for s in (start, target)]
    one, two = plan(start, target, limit, cycle_time), plan(flip[0], flip[1], limit, cycle_time)
    assert [(p.cycles, p.jerk) for p in one.phases] == [(p.cycles, -p.jerk) for p in two.phases]


@given(requests(), st.integers(-40, 40))
def test_scaled_requests_give_scaled_plans(
    request_: tuple[State, State, Limits, float], power: int
) -> None:
    """Units do not matter: a power of two scales every jerk exactly and no length."""
    start, target, limit, cycle_time = request_
    assume(abs(target.position - start.position) / (limit.velocity * cycle_time) < 1e12)
    numbers = (start.velocity, start.acceleration, target.position, target.velocity)
    assume(all(x == 0.0 or abs(x) > 1e-40 for x in numbers))  # below 1e-60 is zero, in any unit
    k = 2.0**power

    def scaled(s: State) -> State:
        return State(s.position * k, s.velocity * k, s.acceleration * k)

    wide = Limits(
        limit.velocity * k,
        limit.acceleration * k,
        limit.jerk * k,
        limit.braking[0] * k,
        limit.braking[1] * k,
    )
    one = plan(start, target, limit, cycle_time)
    two = plan(scaled(start), scaled(target), wide, cycle_time)
    assert [(p.cycles, p.jerk * k) for p in one.phases] == [(p.cycles, p.jerk) for p in two.phases]


@given(requests(), st.floats(1.0, 20.0), st.floats(1.0, 20.0))
@example((State(0.0, 0.0, -0.2108779969463809), State(100.0), CRAWL, 1e-4), 1.0, 1.0)
def test_starts_outside_the_limits_come_back_inside(
    request_: tuple[State, State, Limits, float], v_factor: float, a_factor: float
) -> None:
    """Jerk keeps its limit, the velocity exceeds its own by no more than it must, and once inside
    the limits the motion stays there.
    """
    start, target, limit, cycle_time = request_
    start = State(start.position, start.velocity * v_factor, start.acceleration * a_factor)
    assume(abs(target.position - start.position) / (limit.velocity * cycle_time) < 1e9)
    profile = plan(start, target, limit, cycle_time)
    most_j = max(limit.jerk, limit.braking[1])
    most_a = max(limit.acceleration, limit.braking[0])
    forward = goes_forward(profile)
    V, A = start.velocity + start.acceleration * cycle_time / 2, start.acceleration
    bound, came_in = may_reach(V, A, limit, cycle_time, forward)
    for (peak, a, v), phase in zip(nodes(profile), profile.phases, strict=True):
        assert abs(phase.jerk) <= most_j * WITHIN
        assert peak <= max(abs(V), bound) * WITHIN
        if came_in:
            assert peak <= limit.velocity * WITHIN
            assert abs(a) <= most_a * WITHIN
        came_in = came_in or may_reach(v, a, limit, cycle_time, forward)[1]
    samples = profile.sample() if profile.cycles < 20_000 else None
    assert samples is None or samples.position[-1] == target.position


@pytest.mark.parametrize("excess", [1.0001, 1.5, 10.0])
@pytest.mark.parametrize("v", [0.0, 0.5, 1.0])
def test_too_much_acceleration_is_shed_at_full_jerk(excess: float, v: float) -> None:
    """From |a| above its limit the plan goes back at full jerk, in the fewest cycles."""
    start = State(0.0, v * 90.0, 500.0 * excess)
    profile = plan(start, 100.0, ROBOT, T)
    least = math.ceil((500.0 * excess - 500.0) / 5000.0 / T)
    t = profile.at(np.arange(profile.cycles + 1) * T)
    first = int(np.argmax(np.abs(t.acceleration) <= 500.0 * WITHIN))
    assert first <= least + 1


@given(requests(moving_target=False))
def test_never_longer_than_the_paper_s_curve(
    request_: tuple[State, State, Limits, float],
) -> None:
    """plan() needs at most the cycles of scurve(rounding="up"), where that exists."""
    _, target, limit, cycle_time = request_
    distance = target.position
    assume(0.0 < abs(distance) / (limit.velocity * cycle_time) < 1e9)
    assert (
        plan(0.0, distance, limit, cycle_time).cycles <= scurve(distance, limit, cycle_time).cycles
    )


@given(limits(), cycle_times, magnitudes(-6, 4), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_never_longer_than_the_paper_s_curve_in_motion(
    limit: Limits, cycle_time: float, distance: float, start: float, end: float
) -> None:
    """The same for start and end velocities along the way."""
    v0, v1 = start * limit.velocity, end * limit.velocity
    try:
        paper = scurve(distance, limit, cycle_time, v_start=v0, v_end=v1)
    except (InfeasibleError, InputError):
        assume(False)
    assert plan(State(0.0, v0), State(distance, v1), limit, cycle_time).cycles <= paper.cycles


# ---- re-planning ---------------------------------------------------------------------------------


def sample_states(profile: Profile) -> list[Sample]:
    """Exact samples of a profile, cycle by cycle."""
    T_s = profile.cycle_time
    start = Sample(
        Fraction(profile.start.position),
        Fraction(profile.start.velocity * T_s),
        Fraction(profile.start.acceleration * T_s * T_s),
    )
    phases = [(p.cycles, Fraction(p.jerk * T_s**3)) for p in profile.phases]
    return list(bilinear(start, phases))


@pytest.mark.parametrize("limit", [ROBOT, UNEVEN], ids=["even", "uneven"])
@pytest.mark.parametrize("seed", range(4))
def test_replanning_from_every_cycle_is_legal_and_never_much_later(
    limit: Limits, seed: int
) -> None:
    """From each cycle of a plan: to the same target it ends no later than two cycles after the
    plan itself, to a new target it is legal; position, velocity and acceleration go on.

    Not where the way left points back: then unequal limits change places.
    """
    rng = np.random.default_rng(seed)
    coarse = 5e-3
    start = State(0.0, rng.uniform(-40, 40), rng.uniform(-200, 200))
    profile = plan(start, rng.uniform(-60, 60), limit, coarse)
    end = profile.end
    states = sample_states(profile)[:-1]
    later = {}
    for k, sample in enumerate(states):
        now, left = state_at(sample, coarse), profile.cycles - k
        again = plan(now, end, limit, coarse)
        if limit is ROBOT or goes_forward(again) == goes_forward(profile):
            later[left] = again.cycles - left
        other = plan(now, end.position + rng.uniform(-50, 50), limit, coarse)
        assert other.sample().position[-1] == other.end.position
        stop = plan_velocity(now, 0.0, limit, coarse)
        if inside(now, limit, coarse):
            for found in (again, other):
                legal(found, limit)
            legal(stop, limit, change=True)
    # The state is rounded to doubles, so the rest of the plan itself is a hair out of reach; in the
    # last cycle, where it has no freedom left, landing exactly takes up to four cycles more.
    assert max(more for left, more in later.items() if left > 1) <= 2
    assert max(later.values()) <= 4


@pytest.mark.parametrize("factor", [0.9, 0.5, 0.1])
def test_limits_lowered_in_mid_motion_are_legal(factor: float) -> None:
    """Lower limits during a move: brought inside at full jerk, no reversal of a forward move."""
    profile = plan(0.0, 160.0, ROBOT, T)
    low = Limits(90.0 * factor, 500.0 * factor, 5000.0)
    states = sample_states(profile)
    for k in range(1, profile.cycles, 11):
        now = state_at(states[k], T)
        V, A = now.velocity + now.acceleration * T / 2, now.acceleration
        if A < 0 and V - A**2 / (2 * 5000.0) < 5000.0 * T**2:
            continue  # full jerk leaves less than a cycle of it: a cycle lost turns back
        slower = plan(now, 400.0, low, T)
        samples = slower.sample()
        assert samples.position[-1] == 400.0
        assert np.min(np.diff(samples.position)) >= -1e-12
        assert np.max(np.abs([phase.jerk for phase in slower.phases])) <= 5000.0 * WITHIN


# ---- many, and against others --------------------------------------------------------------------


def long_runs(config: pytest.Config) -> int:
    return int(config.getoption("--planner-states"))


def drawn(
    rng: np.random.Generator, n: int, unit: str, kind: str, *, asymmetric: bool
) -> tuple[check.Requests, float]:
    """Random requests in a unit, and their cycle time."""
    if unit == check.COARSE:
        cycle_time = float(rng.choice([1e-3, 2e-3, 5e-3, 1e-2]))
        return check.draw_coarse(rng, n, kind, asymmetric=asymmetric, T=cycle_time), cycle_time
    return check.draw(rng, n, kind, scale=check.UNITS[unit], asymmetric=asymmetric), T


def worst_of(worst: dict[str, float], found: dict[str, check.Array], r: check.Requests) -> None:
    """Within every limit and at the goal; keeps the largest figures."""
    for name, values in found.items():
        i = int(values.argmax())
        worst[name] = max(worst.get(name, 0.0), float(values[i]))
        bound = WITHIN if name in "vaj" else 1e-9
        assert values[i] <= bound, (name, values[i], r.start[i], r.target[i], r.limits[i])


def told(capsys: pytest.CaptureFixture[str], text: str) -> None:
    """Progress and figures of a long run."""
    with capsys.disabled():
        sys.stderr.write(text)


SYMMETRY = pytest.mark.parametrize("asymmetric", [False, True], ids=["even", "uneven"])


@SYMMETRY
@pytest.mark.parametrize("kind", check.KINDS)
@pytest.mark.parametrize("unit", list(check.UNITS))
def test_random_states_in_every_unit(
    unit: str,
    kind: str,
    asymmetric: bool,
    pytestconfig: pytest.Config,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """No failure, no limit broken by more than 1e-9, every plan lands: ``--planner-states N``."""
    total, done = long_runs(pytestconfig), 0
    rng = np.random.default_rng(abs(hash_of(unit, kind, asymmetric)))
    worst: dict[str, float] = {}
    longest_ulps = 0.0
    while done < total:
        n = min(20_000, total - done)
        r, cycle_time = drawn(rng, n, unit, kind, asymmetric=asymmetric)
        made = check.whole(r, plan_many(r.start, r.target, r.limits, cycle_time), cycle_time)
        worst_of(worst, check.judge(r, made, cycle_time), r)
        spread = np.abs(check.lands(r, made, cycle_time))
        jerk = np.abs(made["phase"]["jerk"]).max(axis=1)
        way = np.abs(r.start[:, 0]) + np.abs(r.target[:, 0])
        way += made["cycles"] * (r.limits[:, 0] * cycle_time + jerk)
        longest_ulps = max(longest_ulps, float(np.max(spread / np.spacing(way))))
        done += n
        if total > 100_000:
            told(capsys, f"\r{unit} {kind} {(asymmetric and 'uneven') or 'even'}: {done}")
    # the furthest plans of a length are met to 2.5e-13 of the way; coarse cycles have few others
    assert longest_ulps <= (2300.0 if unit == check.COARSE else 64.0)
    if total > 100_000:
        figures = ", ".join(f"{name} {value:.12g}" for name, value in worst.items())
        told(capsys, f" plans, 0 failures; worst {figures}; spread {longest_ulps:.1f} ulp\n")


@SYMMETRY
@pytest.mark.parametrize("unit", list(check.UNITS))
def test_random_states_with_an_acceleration_at_the_target(
    unit: str,
    asymmetric: bool,
    pytestconfig: pytest.Config,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Every legal target is met within all limits, alone and together; the others are refused."""
    total, done = max(2000, long_runs(pytestconfig) // 8), 0
    rng = np.random.default_rng(abs(hash_of(unit, "arrival", asymmetric)))
    worst: dict[str, float] = {}
    while done < total:
        n = min(20_000, total - done)
        kind = str(rng.choice(check.KINDS))
        r, cycle_time = drawn(rng, n, unit, kind, asymmetric=asymmetric)
        r = check.with_accelerations(rng, r, cycle_time)
        made, answers = check.arrivals(r, cycle_time)
        must, never = check.legal(r, cycle_time)
        assert not (must & never).any()
        assert np.mean(must) > 0.5
        assert (answers[must] == 0).all(), r.only(np.flatnonzero(must & (answers != 0))[:1])
        assert (answers[never] == 1).all(), r.only(np.flatnonzero(never & (answers != 1))[:1])
        met = answers == 0
        worst_of(worst, check.judge(r.only(met), made[met], cycle_time), r.only(met))
        check.lands(r.only(met), made[met], cycle_time)
        some = r.only(np.flatnonzero(met)[: min(met.sum(), n // 4) // 4 * 4])
        longer = int(rng.integers(0, 3000))
        both = check.arrivals_together(some, cycle_time, 4, longer)
        worst_of(worst, check.judge(some, both, cycle_time), some)
        done += n
        if total > 10_000:
            told(capsys, f"\r{unit} arrivals {(asymmetric and 'uneven') or 'even'}: {done}")
    if total > 10_000:
        figures = ", ".join(f"{name} {value:.12g}" for name, value in worst.items())
        told(capsys, f" plans, 0 failures; worst {figures}\n")


@SYMMETRY
@pytest.mark.parametrize("what", ["velocity", "velocities", "length", "together"])
@pytest.mark.parametrize("unit", ["radians", check.COARSE])
def test_random_states_in_every_way(
    unit: str,
    what: str,
    asymmetric: bool,
    pytestconfig: pytest.Config,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The same for changes of velocity, plans of a given length, and axes of one length."""
    total, done = long_runs(pytestconfig), 0
    rng = np.random.default_rng(abs(hash_of(unit, what, asymmetric)))
    worst: dict[str, float] = {}
    while done < total:
        n = min(20_000, total - done) // 4 * 4
        kind = str(rng.choice(["start", "target"]))
        r, cycle_time = drawn(rng, n, unit, kind, asymmetric=asymmetric)
        if what == "velocity":
            made = check.changes(r, cycle_time)
        elif what == "velocities":
            made = check.velocities(r, cycle_time, 4)
        elif what == "length":
            more, times = 10.0 ** rng.uniform(0, 2, n), rng.choice([1.0, 2.0], n)
            made = check.stretched(r, cycle_time, more, times)
        else:
            made = check.together(r, cycle_time, 4)
        worst_of(worst, check.judge(r, made, cycle_time, change=what.startswith("velocit")), r)
        done += n
        if total > 100_000:
            told(capsys, f"\r{unit} {what} {(asymmetric and 'uneven') or 'even'}: {done}")
    if total > 100_000:
        figures = ", ".join(f"{name} {value:.12g}" for name, value in worst.items())
        told(capsys, f" plans, 0 failures; worst {figures}\n")


def hash_of(*parts: object) -> int:
    return sum(ord(c) * (i + 1) for i, c in enumerate(repr(parts)))


@pytest.mark.parametrize(
    ("kind", "median", "p99"), [("rest", 1.5, 3.5), ("start", 2.0, 5.0), ("target", 2.0, math.inf)]
)
def test_durations_against_ruckig(kind: str, median: float, p99: float) -> None:
    """Never shorter than ruckig's optimum, and few cycles longer."""
    ruckig = pytest.importorskip("ruckig")
    r = check.draw(np.random.default_rng(7), 4000, kind)
    plans = plan_many(r.start, r.target, r.limits, T)
    otg, inp, out = ruckig.Ruckig(1), ruckig.InputParameter(1), ruckig.Trajectory(1)
    best = []
    h, V, A, v1, _, _ = check.in_cycles(r, T)
    for i in range(len(r)):
        inp.current_position, inp.target_position = [0.0], [h[i]]
        inp.current_velocity, inp.current_acceleration = [V[i] / T], [A[i] / T**2]
        inp.target_velocity = [v1[i] / T]
        inp.max_velocity, inp.max_acceleration = [r.limits[i, 0]], [r.limits[i, 1]]
        inp.max_jerk = [r.limits[i, 2]]
        assert otg.calculate(inp, out) in (ruckig.Result.Working, ruckig.Result.Finished)
        best.append(out.duration / T)
    extra = plans.cycles - np.array(best)
    assert extra.min() > -1e-3
    assert np.median(extra) <= median
    assert np.percentile(extra, 99) <= p99
    assert np.mean(plans.cycles > 1.05 * np.array(best) + 8) < 0.01


def planned_or_refused(call: Callable[[], Profile]) -> Profile | str:
    """What it returns, or the message of its refusal, whose field has no index."""
    try:
        return call()
    except InputError as refused:
        return str(refused).replace("target[0]", "target")


@given(requests(), st.sampled_from([1.0, 1.05, 3.0, 1e18]))
def test_an_axis_is_planned_alone_as_in_a_list(
    request_: tuple[State, State, Limits, float], stretched: float
) -> None:
    """The short way from Python to C and the long one: equal plans, or the same refusal."""
    start, target, limit, T = request_
    target = State(target.position, target.velocity * stretched)
    for _ in range(2):  # the limits know their cycle time the second time
        one = planned_or_refused(lambda: plan(start, target, limit, T))
        assert one == planned_or_refused(lambda: plan([start], [target], [limit], T)[0])


def test_a_plan_keeps_its_memory_for_c() -> None:
    """What C reads outlives the profile, and is the same each time."""
    made = plan(State(0.0, 3.0, 1.0), State(160.0), ROBOT, T)
    memory = made.c_plan
    assert made.c_plan == memory
    phases = [(p.cycles, p.jerk) for p in made.phases]
    del made
    assert [
        (memory.phase[i].cycles, memory.phase[i].jerk / T**3) for i in range(memory.count)
    ] == phases


def test_what_limits_keep_for_c_may_be_of_another_version() -> None:
    """Pickled by one that kept fewer numbers: the same plan, and nothing is read behind them."""
    limits, start, target = Limits(90.0, 500.0, 5000.0), State(0.0), State(160.0)
    made = plan(start, target, limits, T)
    limits.cycled[T] = limits.cycled[T][:40]
    assert plan(start, target, pickle.loads(pickle.dumps(limits)), T) == made


@pytest.mark.parametrize("cycle_time", [True, Decimal(1), "1.0"])
def test_what_only_equals_a_cycle_time_is_none(cycle_time: Any) -> None:
    """Also where limits have been used with the number that it equals."""
    limits = Limits(90.0, 500.0, 5000.0)
    plan(State(0.0), State(1e4), limits, 1.0)
    with pytest.raises(InputError, match="cycle_time"):
        plan(State(0.0), State(1e4), limits, cycle_time)


@given(requests())
def test_plan_many_is_plan(request_: tuple[State, State, Limits, float]) -> None:
    """Row by row the same phases."""
    start, target, limit, cycle_time = request_
    assume(abs(target.position - start.position) / (limit.velocity * cycle_time) < 1e12)
    one = plan(start, target, limit, cycle_time)
    rows = plan_many(
        [[start.position, start.velocity, start.acceleration]] * 2,
        [[target.position, target.velocity]] * 2,
        limit,
        cycle_time,
    )
    cycles, jerks = rows.phases(1)
    assert [(p.cycles, p.jerk) for p in one.phases] == list(
        zip(cycles.tolist(), jerks.tolist(), strict=True)
    )


@given(
    st.integers(0, 2**32 - 1),
    st.lists(st.sampled_from([*check.UNITS]), min_size=1, max_size=3),
    st.lists(st.sampled_from(check.KINDS), min_size=1, max_size=3),
    st.booleans(),
    st.integers(1, 40),
    st.floats(-12.0, 12.0),
    st.sampled_from([0.0, 0.1, 0.5]),
)
def test_rows_planned_at_once_have_the_bits_of_rows_planned_alone(
    seed: int,
    drawn_units: list[str],
    kinds: list[str],
    asymmetric: bool,
    n: int,
    exponent: float,
    shared: float,
) -> None:
    """Rows of all kinds side by side, in any unit: kind, length, and each phase as `plan` has them.

    Some have the distance of nothing, start above their limits or at rest.
    """
    rng = np.random.default_rng(seed)
    cycle_time = float(rng.choice([1e-4, 1e-3, 4e-3, 1e-2]))
    parts = []
    for unit in drawn_units:
        for kind in kinds:
            made, of = drawn(rng, n, unit, kind, asymmetric=asymmetric)
            made.start[:, 1:] *= [of / cycle_time, (of / cycle_time) ** 2]
            made.target[:, 1:] *= of / cycle_time
            made.limits *= (of / cycle_time) ** np.array([1, 2, 3, 2, 3])
            parts.append(made)
    r = check.Requests(
        *(np.concatenate([getattr(p, f) for p in parts]) for f in ("start", "target", "limits"))
    ).only(rng.permutation(n * len(parts)))
    size = 10.0**exponent
    start, target, limit = r.start * size, r.target * size, r.limits * size
    odd = rng.uniform(size=len(start)) < shared
    start[odd] *= rng.choice([[1, 0, 0], [1, 1, 0], [1, 3, 1], [1, 1, 3]], int(odd.sum()))
    still = rng.uniform(size=len(start)) < 0.1 * shared
    target[still, 0] = start[still, 0]
    plans = plan_many(start, target, limit, cycle_time)
    for i in range(len(start)):
        one = plan(State(*start[i]), State(*target[i]), Limits(*limit[i]), cycle_time).c_plan
        first, row = int(plans.rows["first"][i]), plans.rows[i]
        assert (one.cycles, one.count, one.kind) == (row["cycles"], row["count"], row["kind"])
        used = plans.pool[first : first + one.count]
        phases = [(one.phase[k].cycles, one.phase[k].jerk) for k in range(one.count)]
        assert phases == list(zip(used["cycles"].tolist(), used["jerk"].tolist(), strict=True))


def test_many_plans_are_one_by_one_whatever_the_number_and_survive_pickling() -> None:
    """Rows planned in several threads are those of `plan`; pickled, only what is used is kept."""
    r = check.draw(np.random.default_rng(17), 20_000, "target", asymmetric=True)
    plans = plan_many(r.start, r.target, r.limits, T)
    memory = pickle.dumps(plans)
    assert len(memory) < 600 * len(plans)
    again = pickle.loads(memory)
    for i in (0, 1, 9_999, 10_000, 19_999):
        start, end, limit = State(*r.start[i]), State(*r.target[i]), Limits(*r.limits[i])
        one = [(p.cycles, p.jerk) for p in plan(start, end, limit, T).phases]
        for many in (plans, again):
            cycles, jerks = many.phases(i)
            assert list(zip(cycles.tolist(), jerks.tolist(), strict=True)) == one


# ---- several axes --------------------------------------------------------------------------------


@given(st.lists(requests(), min_size=2, max_size=7), st.just(0.0) | st.floats(1e-6, 2.0))
def test_time_synchronised_axes_arrive_in_the_same_cycle(
    axes: list[tuple[State, State, Limits, float]], min_duration: float
) -> None:
    """All profiles have one length, at least the longest and min_duration; all are legal."""
    for start, target, limit, _ in axes:
        assume(inside(start, limit, T))
        assume(abs(target.position - start.position) / limit.velocity < 1e4)
    starts, targets, several = ([axis[i] for axis in axes] for i in range(3))
    motion = plan(starts, targets, several, T, min_duration=min_duration)
    alone = [
        plan(s, t, limit, T).cycles for s, t, limit in zip(starts, targets, several, strict=True)
    ]
    assert isinstance(motion, Motion)
    assert len({profile.cycles for profile in motion}) == 1
    assert motion.cycles >= max(*alone, math.ceil(min_duration / T * (1 - 1e-9)))
    for profile, limit in zip(motion, several, strict=True):
        legal(profile, limit)


def test_targets_at_rest_take_any_common_length() -> None:
    """To rest, the slowest axis decides: nobody waits longer than that."""
    rng = np.random.default_rng(5)
    for _ in range(100):
        r = check.draw(rng, 7, "start")
        several = [Limits(*row) for row in r.limits]
        starts = [State(*row) for row in r.start]
        goals = [float(q) for q in r.target[:, 0]]
        motion = plan(starts, goals, several, T)
        alone = [plan(s, g, k, T).cycles for s, g, k in zip(starts, goals, several, strict=True)]
        assert motion.cycles == max(alone)


@given(
    st.lists(st.tuples(magnitudes(-3, 3), limits()), min_size=2, max_size=7),
    st.floats(0.0, 3.0),
)
def test_phase_synchronised_rest_to_rest_is_a_straight_line(
    axes: list[tuple[float, Limits]], min_duration: float
) -> None:
    """Every sample lies on the line between start and goal, and every axis keeps its limits."""
    goals = [distance * (-1) ** i for i, (distance, _) in enumerate(axes)]
    several = [limit for _, limit in axes]
    assume(all(abs(g) / k.velocity < 1e3 for g, k in zip(goals, several, strict=True)))
    motion = plan(
        [0.0] * len(axes), goals, several, T, synchronization="phase", min_duration=min_duration
    )
    assert isinstance(motion, Motion)
    assert motion.synchronization == "phase"
    assert len({tuple(p.cycles for p in profile.phases) for profile in motion}) == 1
    for profile, limit in zip(motion, several, strict=True):
        legal(profile, limit)
    samples = motion.sample()
    assert samples.position.shape == (motion.cycles + 2, len(axes))
    share = samples.position / np.array(goals)
    assert np.max(np.abs(share - share[:, :1])) <= 1e-12


def test_phase_falls_back_to_time_and_says_so() -> None:
    """From motion there is no straight line: time is used and reported."""
    motion = plan([State(0.0, 5.0), State(0.0)], [10.0, 5.0], ROBOT, T, synchronization="phase")
    assert isinstance(motion, Motion)
    assert motion.synchronization == "time"
    alone = plan([0.0, 0.0], [10.0, 5.0], ROBOT, T, synchronization="none")
    assert alone[0].cycles > alone[1].cycles
    assert alone.sample().position[-1].tolist() == [10.0, 5.0]


# ---- velocity, range, refusals -------------------------------------------------------------------


@given(requests(), st.floats(-1.0, 1.0).filter(lambda x: x == 0.0 or abs(x) > 1e-30))
@example((State(0.0, 0.0, 625.0), State(-1.0), Limits(1.0, 1e3, 1e6), 2e-3), 1.0)
def test_changes_of_velocity_end_as_asked(
    request_: tuple[State, State, Limits, float], share: float
) -> None:
    """plan_velocity: whole cycles, limits kept, settled at the velocity, at its own end."""
    start, _, limit, cycle_time = request_
    assume(inside(start, limit, cycle_time))
    profile = plan_velocity(start, share * limit.velocity, limit, cycle_time)
    legal(profile, limit, change=True)
    assert profile.end.velocity == share * limit.velocity


def test_limits_hold_where_one_cycle_of_jerk_is_more_than_all_acceleration() -> None:
    """A start that can keep its limits in whole cycles does, however long the cycle."""
    limit = Limits(
        7.033655122556424,
        1150.61184175065,
        1799366.3919221708,
        6665.134109367208,
        3140733.9682372203,
    )
    start = State(0.0, 5.958840402279902, 863.020749759082)
    V = start.velocity + start.acceleration * 1e-3
    # forward it can brake hard enough to cross zero within the limit, backward it cannot
    assert may_reach(V, start.acceleration, limit, 2e-3, True) == (limit.velocity, True)
    assert may_reach(V, start.acceleration, limit, 2e-3, False)[0] > 1.005 * limit.velocity
    for target in (0.01, 0.1, 1.0, -0.1, -1.0):
        legal(plan(start, target, limit, 2e-3), limit)
    legal(plan_velocity(start, 0.0, limit, 2e-3), limit, change=True)


@SYMMETRY
def test_no_sequence_of_cycles_keeps_what_the_judge_calls_unavoidable(asymmetric: bool) -> None:
    """Of random legal sequences from starts said to exceed a limit, each one does.

    And none that crosses zero once at most stays below the excess that the judge allows.
    """
    rng = np.random.default_rng(21)
    r = check.draw_coarse(rng, 4000, "start", asymmetric=asymmetric, T=T)
    _, V, A, _, limits, d = check.in_cycles(r, T)
    bound = check.velocity_bound(V, A, limits, d)
    over = bound > limits[:, 0] * (1 + 1e-6)
    assert 100 < np.count_nonzero(over) < 2000
    V, A, limits, d, bound = (x[over] for x in (V, A, limits, d, bound))
    vmax, acc, jacc, dec, jdec = limits.T
    for _ in range(300):
        v, a, peak, crossings = V.copy(), A.copy(), np.abs(V), np.zeros(len(V))
        for k in range(6):
            up = d * a >= 0
            jerk, here, there = (np.where(up, *x) for x in ((jacc, jdec), (acc, dec), (dec, acc)))
            most = np.minimum(np.minimum(jacc, jdec), np.abs(a) + there)
            gentle = a * a / (2 * np.maximum(bound - np.abs(v), 1e-9 * bound))
            share = rng.choice([0.0, 1.0, 2.0, 3.0], len(v))
            some = rng.uniform(-1, 1, len(v)) * np.maximum(jerk, most)
            wanted = np.select([share == 0, share == 1, share == 2], [most, gentle, jerk], some)
            wanted = np.where(np.abs(a) <= jerk, np.abs(a), jerk) if k == 5 else wanted
            b = a - np.sign(a) * np.clip(wanted, -jerk, np.maximum(jerk, most))
            crosses = a * b < 0
            # across zero with the smaller jerk only; never beyond either acceleration limit
            b = np.where(crosses, a - np.sign(a) * np.minimum(np.abs(b - a), most), b)
            b = np.where(a * b < 0, b, np.clip(b, -here, here))
            with np.errstate(divide="ignore", invalid="ignore"):
                turn = np.where(a * b < 0, v + a * a / (2 * (a - b)), v)
            crossings += a * b < 0
            v, a = v + (a + b) / 2, b
            peak = np.maximum(peak, np.maximum(np.abs(turn), np.abs(v)))
        ended = a == 0
        assert not np.any(ended & (peak <= vmax))
        assert not np.any(ended & (crossings <= 1) & (peak < bound * (1 - 1e-9)))


def test_a_stop_is_no_longer_than_the_plan_it_stops() -> None:
    """While a move brakes, a stop takes no longer and ends within a cycle's way of its goal."""
    profile = plan(0.0, 20.0, UNEVEN, T)
    states = sample_states(profile)
    braking = min(range(len(states)), key=lambda k: states[k].a) + 1
    for k in range(braking, profile.cycles - 1):
        stop = plan_velocity(state_at(states[k], T), 0.0, UNEVEN, T)
        assert stop.end.position <= 20.0 + float(states[k].v)
        assert stop.cycles <= profile.cycles - k


def test_position_range_refuses_targets_and_reports_ways() -> None:
    """A target outside is refused; a way that must leave the range says so."""
    ranged = Limits(90.0, 500.0, 5000.0, position=(-1.0, 10.0))
    with pytest.raises(InputError, match=r"target.*position"):
        plan(0.0, 10.5, ranged, T)
    with pytest.raises(InputError, match=r"target\[1\].position"):
        plan_many([0.0, 0.0], [1.0, -2.0], ranged, T)
    assert not plan(0.0, 10.0, ranged, T).leaves_range
    assert plan(State(9.0, 80.0), 10.0, ranged, T).leaves_range
    motion = plan([State(0.0), State(9.0, 80.0)], [1.0, 10.0], ranged, T)
    assert isinstance(motion, Motion)
    assert motion.leaves_range
    for bad in ((1.0, 0.0), (0.0,), (math.nan, 1.0), 3.0):
        with pytest.raises(InputError, match="position"):
            Limits(1.0, 1.0, 1.0, position=bad)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("field", "call"),
    [
        ("acceleration", lambda: plan(0.0, State(1.0, 0.0, 501.0), ROBOT, T)),
        ("velocity", lambda: plan(0.0, State(1.0, 91.0), ROBOT, T)),
        ("target", lambda: plan(0.0, math.nan, ROBOT, T)),
        ("start", lambda: plan("0", 1.0, ROBOT, T)),  # type: ignore[call-overload]
        ("cycle_time", lambda: plan(0.0, 1.0, ROBOT, 0.0)),
        ("cycle_time", lambda: plan(State(0.0), State(1.0), ROBOT, math.nan)),
        ("one entry per axis", lambda: plan([0.0], [1.0, 2.0], ROBOT, T)),
        ("synchronization", lambda: plan([0.0], [1.0], ROBOT, T, synchronization="x")),  # type: ignore[call-overload]
        ("min_duration", lambda: plan(0.0, 1.0, ROBOT, T, min_duration=-1.0)),
        ("axes", lambda: plan([0.0] * 65, [1.0] * 65, ROBOT, T)),
        ("axes", lambda: plan([], [], ROBOT, T)),
        ("cycles", lambda: plan(0.0, 1e30, ROBOT, T)),
        (r"start\[1\]", lambda: plan_many([0.0, math.inf], [0.0, 0.0], ROBOT, T)),
        (r"limits\[0\]", lambda: plan_many([0.0], [1.0], np.array([[1.0, -1.0, 1.0]]), T)),
        ("length", lambda: plan_many([0.0], [1.0, 2.0], ROBOT, T)),
        ("row 1", lambda: plan_many([0.0, 0.0], [[1.0, 0.0], [1.0, 95.0]], ROBOT, T)),
        ("velocity", lambda: plan_velocity(0.0, 91.0, ROBOT, T)),
    ],
)
def test_unusable_requests_name_the_field(field: str, call: object) -> None:
    """Field, value and limit, before anything is planned."""
    with pytest.raises(InputError, match=field):
        call()  # type: ignore[operator]


def test_min_duration_stretches_one_axis() -> None:
    """A longer time is used for a slower motion, not for waiting."""
    fast, slow = plan(0.0, 10.0, ROBOT, T), plan(0.0, 10.0, ROBOT, T, min_duration=2.0)
    assert slow.cycles == 2000
    assert slow.extrema().velocity.high < 0.6 * fast.extrema().velocity.high
    assert all(phase.cycles < 1990 for phase in slow.phases)
