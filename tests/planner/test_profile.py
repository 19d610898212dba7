"""The planner's closed form: each equation by name, landing, limits, refusals."""

from __future__ import annotations

import math
import random
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from helpers.exact import Sample, bilinear, continuous
from helpers.strategies import cycle_times, limits, magnitudes, units
from sjerk import InfeasibleError, InputError, Limits, Profile, State, plan, scurve
from sjerk.profile import Phase

T_S = 1e-3
ROBOT = Limits(velocity=90.0, acceleration=500.0, jerk=5000.0)
UNEVEN = Limits(90.0, 500.0, 5000.0, deceleration=300.0, deceleration_jerk=2000.0)
#: What "keeps a limit" means for plans (relative).
WITHIN = 1.0 + 1e-9


def counts(profile: Profile) -> list[int]:
    return [phase.cycles for phase in profile.phases]


def exact_phases(profile: Profile) -> list[tuple[Fraction, Fraction]]:
    """Phases as (time, jerk) in rationals of the given doubles."""
    T = Fraction(profile.cycle_time)
    return [(phase.cycles * T, Fraction(phase.jerk)) for phase in profile.phases]


# ---- the equations, one by one -------------------------------------------------------------------


def test_eq01_jerk_has_the_sign_pattern_of_the_seven_intervals() -> None:
    """Jerk is +J, 0, -J, 0, -J_dec, 0, +J_dec."""
    signs = [np.sign(phase.jerk) for phase in scurve(160.0, UNEVEN, T_S).phases]
    assert signs == [1, 0, -1, 0, -1, 0, 1]


@pytest.mark.parametrize("field", ["acceleration", "velocity", "position"])
def test_eq02_eq03_eq05_are_integrals_of_the_jerk(field: str) -> None:
    """The closed forms (2), (3), (5) are what integrating (1) in rationals gives."""
    profile = scurve(-160.0, UNEVEN, T_S, v_start=10.0, v_end=30.0)
    P = Fraction(0) + Fraction(T_S) / 2 * Fraction(profile.start.velocity)
    V, A, t = Fraction(profile.start.velocity), Fraction(0), Fraction(0)
    for time, jerk in exact_phases(profile):
        for part in (Fraction(1, 3), Fraction(1)):
            node = continuous(P, V, A, [(time * part, jerk)])[0]
            at = profile.at(float(t + time * part))
            expected = {"acceleration": node.A, "velocity": node.V, "position": node.P}[field]
            assert getattr(at, field) == pytest.approx(float(expected), rel=1e-9, abs=1e-9)
        node = continuous(P, V, A, [(time, jerk)])[0]
        P, V, A, t = node.P, node.V, node.A, t + time


def test_eq04_eq06_interval_ends_meet() -> None:
    """V and P are continuous across the interval ends: both sides give V_i and P_i."""
    profile = scurve(160.0, UNEVEN, T_S)
    ends = np.cumsum([phase.cycles for phase in profile.phases]) * T_S
    for name in ("velocity", "position"):
        before = getattr(profile.at(ends - 1e-12), name)
        after = getattr(profile.at(ends + 1e-12), name)
        np.testing.assert_allclose(before, after, rtol=0, atol=1e-9)


def test_eq07_the_jerk_interval_is_acc_over_jerk_in_whole_cycles() -> None:
    """T1 = ROUND(Acc / J / T_s) T_s."""
    assert counts(scurve(160.0, Limits(90.0, 500.0, 5000.0), T_S))[0] == 100
    assert counts(scurve(160.0, Limits(90.0, 500.0, 4990.0), T_S))[0] == 101
    assert counts(scurve(160.0, Limits(90.0, 500.0, 4990.0), T_S, rounding="nearest"))[0] == 100


def test_eq08_the_ramp_is_the_change_of_velocity_over_acc_in_whole_cycles() -> None:
    """Ta = T1 + T2 = ROUND((V_max - V_start) / Acc / T_s) T_s."""
    first = counts(scurve(160.0, ROBOT, T_S))
    assert first[0] + first[1] == 180
    first = counts(scurve(160.0, ROBOT, T_S, v_start=20.2))
    assert first[0] + first[1] == math.ceil((90.0 - 20.2) / 500.0 / T_S)


def test_eq09_the_ramp_of_whole_cycles_has_the_adjusted_acceleration() -> None:
    """With whole cycles the plateau is the change of velocity over Ta, below Acc_max."""
    profile = scurve(160.0, Limits(90.0, 501.0, 5000.0), T_S)
    ramp = counts(profile)[0] + counts(profile)[1]
    extrema = profile.extrema()
    assert extrema.acceleration.high == pytest.approx(extrema.velocity.high / (ramp * T_S))
    assert extrema.acceleration.high < 501.0


def test_eq10_the_cruise_covers_what_the_ramps_leave() -> None:
    """T4 = ROUND((L - ramps) / (V_max T_s)) T_s."""
    profile = scurve(160.0, ROBOT, T_S)
    ramps = 2 * (100 + 180) * T_S * 90.0 / 2
    assert counts(profile)[3] == math.ceil((160.0 - ramps) / (90.0 * T_S))


@pytest.mark.parametrize("rounding", ["up", "nearest"])
@pytest.mark.parametrize(("v_start", "v_end"), [(0.0, 0.0), (12.0, 0.0), (0.0, 33.3), (20.0, 70.0)])
def test_eq11_eq12_eq13_levels_meet_distance_and_velocities(
    rounding: str, v_start: float, v_end: float
) -> None:
    """With whole-cycle lengths the three levels meet L, V_start and V_end exactly."""
    profile = scurve(123.456, UNEVEN, T_S, v_start=v_start, v_end=v_end, rounding=rounding)  # type: ignore[arg-type]
    start = Fraction(T_S) / 2 * Fraction(v_start)
    end = continuous(start, Fraction(v_start), Fraction(0), exact_phases(profile))[-1]
    assert float(end.A) == pytest.approx(0.0, abs=1e-12)
    assert float(end.V) == pytest.approx(v_end, abs=1e-11)
    assert float(end.P + Fraction(T_S) / 2 * Fraction(v_end)) == pytest.approx(123.456, rel=1e-13)


def test_eq14_a_short_move_peaks_at_v_adj_without_cruise() -> None:
    """V_adj solves the distance with full ramps; T4 = 0."""
    fine = 1e-6
    profile = scurve(20.0, UNEVEN, fine)
    assert len(profile.phases) == 6
    alpha, beta = 1 / 500.0 + 1 / 300.0, 500.0 / 5000.0 + 300.0 / 2000.0
    v_adj = (-beta + math.sqrt(beta**2 + 8 * alpha * 20.0)) / (2 * alpha)
    assert profile.extrema().velocity.high == pytest.approx(v_adj, rel=1e-4)


def test_a_ramp_that_never_reaches_its_acceleration_is_solved() -> None:
    """Degenerate ramps (T2 < 0 and T6 < 0): V^3 = L^2 J / 4 from rest to rest."""
    fine = 1e-6
    profile = scurve(0.5, ROBOT, fine)
    assert profile.extrema().velocity.high == pytest.approx((0.25 * 5000 / 4) ** (1 / 3), rel=1e-4)
    assert profile.extrema().acceleration.high < 500.0


def test_nearest_is_the_paper_to_the_letter_and_can_exceed_a_limit() -> None:
    """ROUND to nearest breaks limits in some plans; rounding up does not in the same ones."""
    uneven = [Limits(90.0, 500.0, 5000.0 + 7.0 * k) for k in range(60)]
    broken = [
        limit
        for limit in uneven
        if scurve(160.0, limit, T_S, rounding="nearest").extrema().jerk.high > limit.jerk * WITHIN
    ]
    assert broken
    assert all(scurve(160.0, k, T_S).extrema().jerk.high <= k.jerk * WITHIN for k in broken)


# ---- properties ----------------------------------------------------------------------------------


@st.composite
def moves(draw: st.DrawFn) -> tuple[float, Limits, float, float, float]:
    scale = draw(units)
    limit = draw(limits(scale=scale))
    distance = draw(magnitudes(-9, 9)) * draw(st.sampled_from([-1.0, 1.0]))
    v_start = limit.velocity * draw(st.just(0.0) | st.floats(0.0, 1.0))
    v_end = limit.velocity * draw(st.just(0.0) | st.floats(0.0, 1.0))
    return distance, limit, draw(cycle_times), v_start, v_end


def check_plan(profile: Profile, limit: Limits, sign: float) -> None:
    """Every limit of the plan, at phase ends and inside phases, in rationals."""
    assert all(phase.cycles >= 1 for phase in profile.phases)
    T = Fraction(profile.cycle_time)
    V = Fraction(profile.start.velocity)
    nodes = continuous(T / 2 * V, V, Fraction(0), exact_phases(profile))
    before = Fraction(0)
    for phase, node in zip(profile.phases, nodes, strict=True):
        assert node.V_peak <= limit.velocity * WITHIN
        assert sign * float(node.V) >= -1e-9 * limit.velocity
        level = sign * float(node.A)
        assert -limit.braking[0] * WITHIN <= level <= limit.acceleration * WITHIN
        along = sign * float(before + node.A) > 0
        assert abs(phase.jerk) <= (limit.jerk if along else limit.braking[1]) * WITHIN
        before = node.A


def check_samples(profile: Profile, limit: Limits) -> None:
    """Landing bit for bit, and n-th differences of what the drive gets."""
    samples, T = profile.sample(), profile.cycle_time
    assert samples.position.shape == (profile.cycles + 2,)
    assert samples.position[0] == profile.start.position
    assert samples.position[-1] == profile.end.position
    assert samples.velocity[-1] == profile.end.velocity
    assert samples.acceleration[-1] == samples.jerk[-1] == 0.0
    ulp = np.spacing(np.max(np.abs(samples.position)))
    most_a = max(limit.acceleration, limit.braking[0])
    most_j = max(limit.jerk, limit.braking[1])
    for n, most in ((1, limit.velocity), (2, most_a), (3, most_j)):
        difference = (
            np.max(np.abs(np.diff(samples.position, n))) if len(samples.position) > n else 0
        )
        assert difference <= most * WITHIN * T**n + 2**n * ulp


@given(moves())
@example((-3.0, ROBOT, T_S, 90.0, 90.0))
@example((1e-9, ROBOT, T_S, 0.0, 0.0))
@example((1e9, Limits(1e-2, 1e-3, 1e-4), 50e-6, 0.0, 0.0))
def test_any_move_lands_in_whole_cycles_within_the_limits(
    move: tuple[float, Limits, float, float, float],
) -> None:
    """Whole cycles, exact landing and limits for any numbers, or a refusal with a way out."""
    distance, limit, cycle_time, v_start, v_end = move
    try:
        profile = scurve(distance, limit, cycle_time, v_start=v_start, v_end=v_end)
    except InfeasibleError as refusal:
        works = refusal.works
        profile = scurve(works, limit, cycle_time, v_start=v_start, v_end=v_end)
        possible = v_start == v_end == 0.0 or abs(works) <= abs(distance)
        if possible:
            raise
    except InputError:
        assert abs(distance) > 1e14 * limit.velocity * cycle_time  # more than 2^50 cycles
        return
    check_plan(profile, limit, math.copysign(1.0, distance))
    if profile.cycles < 200_000:
        check_samples(profile, limit)


@given(moves())
def test_nearest_lands_exactly_too(move: tuple[float, Limits, float, float, float]) -> None:
    """The paper's rounding may break limits, never the landing."""
    distance, limit, cycle_time, _, _ = move
    try:
        profile = scurve(distance, limit, cycle_time, rounding="nearest")
    except InputError:
        return
    assume(profile.cycles < 100_000)
    samples = profile.sample()
    assert samples.position[-1] == distance


@given(moves())
def test_mirrored_distance_gives_the_mirrored_profile(
    move: tuple[float, Limits, float, float, float],
) -> None:
    """Planning commutes with turning the axis round."""
    distance, limit, cycle_time, v_start, v_end = move
    results = []
    for sign in (1.0, -1.0):
        try:
            found = scurve(sign * distance, limit, cycle_time, v_start=v_start, v_end=v_end)
            results.append([(p.cycles, sign * p.jerk) for p in found.phases])
        except InfeasibleError as refusal:
            results.append([(0, sign * refusal.works)])
        except InputError:
            results.append([])
    assert results[0] == results[1]


def test_a_refused_distance_is_refused_because_no_profile_of_few_cycles_exists() -> None:
    """Where scurve raises, an exhaustive search over all interval lengths finds nothing either."""
    draw = random.Random(3)
    refused = 0
    for _ in range(200):
        V = draw.uniform(1.0, 4.0)
        limit = Limits(V, draw.uniform(0.3, 1.5), draw.uniform(0.2, 1.0))
        v_start, v_end = draw.uniform(0.0, V), draw.uniform(0.0, V)
        distance = draw.uniform(0.5, 25.0)
        try:
            scurve(distance, limit, 1.0, v_start=v_start, v_end=v_end)
        except InfeasibleError:
            refused += 1
            L = distance - (v_start + v_end) / 2
            assert not exhaustive(L, v_start, v_end, limit, 11)
    assert refused > 20


def exhaustive(L: float, v_start: float, v_end: float, limit: Limits, most: int) -> list[object]:
    """Every whole-cycle profile up to `most` cycles that keeps the (symmetric) limits; T_s = 1."""
    found: list[object] = []
    for T1 in range(1, most // 2):
        for T5 in range(1, (most - 2 * T1) // 2 + 1):
            for T2 in range(most - 2 * T1 - 2 * T5 + 1):
                for T6 in range(most - 2 * T1 - 2 * T5 - T2 + 1):
                    for T4 in range(most - 2 * T1 - 2 * T5 - T2 - T6 + 1):
                        Tc = T1 + T2 / 2 + T4 + T5 + T6 / 2
                        V = (L - v_start * (T1 + T2 / 2) - v_end * (T5 + T6 / 2)) / Tc
                        levels = ((V - v_start) / (T1 + T2), T1), ((v_end - V) / (T5 + T6), T5)
                        if 0 <= V <= limit.velocity and all(
                            abs(level) <= limit.acceleration and abs(level) / n <= limit.jerk
                            for level, n in levels
                        ):
                            found.append((T1, T2, T4, T5, T6))
    return found


# ---- what the drive gets -------------------------------------------------------------------------


@given(
    st.lists(
        st.tuples(st.integers(1, 70), st.integers(-(2**20), 2**20).map(lambda n: n / 2**20)),
        min_size=1,
        max_size=4,
    ),
    st.integers(-(10**9), 10**9).map(float),
)
def test_samples_are_the_nearest_doubles_of_the_rational_bilinear_sums(
    steps: list[tuple[int, float]], start: float
) -> None:
    """Every sampled position is the exact sum of Eqs. (15)-(17), to the last bit."""
    # close the motion: acceleration back to zero, then a brake to rest of its own
    phases: list[tuple[int, float]] = []
    for cycles, jerk in steps:
        phases += [(cycles, jerk), (2 * cycles, -jerk), (cycles, jerk)]
    rows = list(
        bilinear(
            Sample(Fraction(start), Fraction(0), Fraction(0)),
            [(cycles, Fraction(jerk)) for cycles, jerk in phases],
        )
    )
    goal = rows[-1].q
    assert float(goal) == goal  # else the rounding of the goal would be spread over the cycles
    profile = Profile(
        tuple(Phase(*phase) for phase in phases), 1.0, State(start), State(float(goal))
    )
    samples = profile.sample()
    assert [float(row.q) for row in rows] == samples.position.tolist()


@pytest.mark.parametrize("cycles", [10, 10_000_000])
def test_nothing_drifts(cycles: int) -> None:
    """The goal is met bit for bit, and by the sums themselves, after 10 and 10 million cycles."""
    limit = Limits(0.3, 0.7, 5.1)
    scale = cycles * T_S * limit.velocity
    profile = scurve(scale / 3.0, Limits(0.3 / 3, 0.7, 5.1), T_S)
    assert cycles // 3 <= profile.cycles <= 40 * cycles
    position = profile.sample().position
    assert position[-1] == profile.end.position
    # unsettled rows before the end approach it smoothly: no step is hidden in the last one
    ulp = np.spacing(profile.end.position)
    assert abs(np.diff(position[-6:], 3)).max() <= 5.1 * T_S**3 * WITHIN + 8 * ulp


def test_the_plan_and_the_samples_differ_by_half_a_cycle() -> None:
    """q[k] = P(t - T/2) + (5/24) T^2 a[k], v[k] = V(t - T/2) + T^2 j[k] / 8 inside phases."""
    profile = scurve(160.0, UNEVEN, T_S)
    samples = profile.sample()
    inside = np.concatenate(
        [
            np.arange(end - phase.cycles + 1, end + 1)
            for phase, end in zip(profile.phases, np.cumsum(counts(profile)), strict=True)
        ]
    )
    late = profile.at(samples.time[inside] - T_S / 2)
    q = late.position + 5 / 24 * T_S**2 * samples.acceleration[inside]
    v = late.velocity + T_S**2 * samples.jerk[inside] / 8
    np.testing.assert_allclose(samples.position[inside], q, rtol=0, atol=1e-10)
    np.testing.assert_allclose(samples.velocity[inside], v, rtol=0, atol=1e-10)


def test_sample_fills_given_arrays_and_refuses_others() -> None:
    """`out` is filled in place; a wrong length or type is refused by name."""
    profile = scurve(1.0, ROBOT, T_S)
    out = profile.sample()
    out.position[:] = -1.0
    assert profile.sample(out) is out
    assert out.position[-1] == 1.0
    longer = scurve(2.0, ROBOT, T_S)
    with pytest.raises(InputError, match=r"out\.time"):
        longer.sample(out)


def test_phases_that_do_not_lead_to_the_end_are_refused() -> None:
    """A profile that was put together wrongly is not sampled."""
    good = scurve(1.0, ROBOT, T_S)
    with pytest.raises(InputError, match="phases"):
        Profile(good.phases, T_S, good.start, State(1.001)).sample()
    with pytest.raises(InputError, match="phases"):
        Profile(good.phases[:-1], T_S, good.start, good.end).sample()


def test_no_distance_is_an_empty_profile() -> None:
    """Zero distance from rest: no phases, two rows, both the start."""
    profile = scurve(0.0, ROBOT, T_S)
    assert (profile.cycles, profile.duration, profile.phases) == (0, 0.0, ())
    assert profile.sample().position.tolist() == [0.0, 0.0]
    assert profile.at([-1.0, 0.0, 1.0]).position.tolist() == [0.0, 0.0, 0.0]


def test_extrema_see_the_peaks_inside_phases() -> None:
    """The ranges contain a fine sampling of the plan and are reached by it."""
    phases = (Phase(10, 1.0), Phase(40, -1.0), Phase(35, 1.0))
    profile = Profile(phases, 1.0, State(0.0), State(0.0))
    fine = profile.at(np.linspace(0.0, profile.duration, 850_001))
    extrema = profile.extrema()
    for name in ("position", "velocity", "acceleration"):
        seen, found = getattr(fine, name), getattr(extrema, name)
        assert found.low == pytest.approx(seen.min(), abs=1e-4)
        assert found.high == pytest.approx(seen.max(), abs=1e-4)


@given(
    st.floats(-10, 10),
    st.floats(-10, 10),
    units,
    cycle_times,
    st.just(0.0) | st.floats(-1.0, 1.0),
)
def test_at_and_after_the_end_the_plan_is_its_target(
    start: float, distance: float, unit: float, T: float, share: float
) -> None:
    """From ``duration`` on, at and away from rest, ``at`` has no rounding of the phases left."""
    own = Limits(2.0 * unit, 5.0 * unit / T, 50.0 * unit / T**2)
    target = State((start + distance) * unit, share * own.velocity)
    profile = plan(State(start * unit, 0.3 * own.velocity), target, own, T)
    late = profile.at([profile.duration, profile.duration + T / 2, profile.duration + 3 * T])
    P = target.position - 0.5 * T * target.velocity
    assert late.position[0] == P
    assert late.velocity.tolist() == [target.velocity] * 3
    assert late.acceleration.tolist() == late.jerk.tolist() == [0.0] * 3
    if share == 0.0:
        assert late.position.tolist() == [target.position] * 3


def test_at_rest_behind_a_move_is_the_goal_bit_for_bit() -> None:
    """At rest behind 1000 moves the position is the goal, the velocity 0."""
    rng = random.Random(5)
    for _ in range(1000):
        goal, scale = rng.uniform(-1, 1), 10.0 ** rng.uniform(-3, 5)
        profile = plan(rng.uniform(-1, 1), goal, Limits(scale, 5.0 * scale, 50.0 * scale), T_S)
        end = profile.at([profile.duration, profile.duration + 0.1])
        assert end.position.tolist() == [goal, goal]
        assert end.velocity.tolist() == [0.0, 0.0]


# ---- refusals ------------------------------------------------------------------------------------


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf, "90", None, True, 1e200, 1 + 2j])
@pytest.mark.parametrize("field", ["velocity", "acceleration", "jerk"])
def test_limits_refuse_what_is_no_limit(field: str, bad: object) -> None:
    """Nan, inf but of the jerk, zero, negative, non-numbers: refused with field and value."""
    if bad == math.inf and field == "jerk":
        assert Limits(1.0, 1.0, math.inf).jerk_is_free
        return
    values: dict[str, object] = {"velocity": 1.0, "acceleration": 1.0, "jerk": 1.0, field: bad}
    with pytest.raises(InputError, match=field) as refusal:
        Limits(**values)  # type: ignore[arg-type]
    assert refusal.value.field == field
    assert refusal.value.value is bad or refusal.value.value == bad


@pytest.mark.parametrize("bad", [math.nan, math.inf, "1", None])
@pytest.mark.parametrize("field", ["position", "velocity", "acceleration"])
def test_states_refuse_what_is_no_number(field: str, bad: object) -> None:
    """A state is three finite numbers."""
    with pytest.raises(InputError, match=field):
        State(**{"position": 0.0, field: bad})  # type: ignore[arg-type]


def test_jerk_factor_is_the_share_of_a_full_ramp_at_jerk() -> None:
    """The factor is T1 / Ta for a ramp from rest to V_max; 1 is a pure S."""
    for s in (1.0, 0.5, 0.125):
        profile = scurve(1e3, Limits.from_jerk_factor(90.0, 450.0, s), T_S)
        first = counts(profile)
        T2 = first[1] if s < 1.0 else 0
        assert first[0] / (first[0] + T2) == pytest.approx(s)
    for bad in (0.0, 1.5, math.nan):
        with pytest.raises(InputError, match="jerk_factor"):
            Limits.from_jerk_factor(90.0, 450.0, bad)


@pytest.mark.parametrize(
    ("field", "call"),
    [
        ("distance", lambda: scurve(math.nan, ROBOT, T_S)),
        ("cycle_time", lambda: scurve(1.0, ROBOT, 0.0)),
        ("v_start", lambda: scurve(1.0, ROBOT, T_S, v_start=-1.0)),
        ("v_end", lambda: scurve(1.0, ROBOT, T_S, v_end=90.1)),
        ("rounding", lambda: scurve(1.0, ROBOT, T_S, rounding="down")),  # type: ignore[arg-type]
    ],
)
def test_scurve_names_what_it_refuses(field: str, call: object) -> None:
    """Field, value and limit are in the message."""
    with pytest.raises(InputError, match=field):
        call()  # type: ignore[operator]


def test_too_short_a_distance_is_refused_with_one_that_works() -> None:
    """Braking from 90 to 0 needs its distance."""
    with pytest.raises(InfeasibleError) as refusal:
        scurve(-1.0, ROBOT, T_S, v_start=90.0)
    assert refusal.value.distance == -1.0
    assert refusal.value.works < -8.0
    scurve(refusal.value.works, ROBOT, T_S, v_start=90.0)
