"""Streamed goals: never back, never over a limit, never past what is known, soon in time again."""

from __future__ import annotations

import random
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest
import ruckig
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.following_check import PANDA, T, recording_keeps, toppra_plan
from helpers.stream_check import Array, Draw, drawn, ended, judge, one_way, play, positions, run
from sjerk import GoalStream, InputError, Limits, State, plan
from sjerk.cli.demo import dips
from sjerk.trajectory import read_recording, shipped_recording
from sjerk.trajectory.segments import Followed

ROBOT = Limits(velocity=2.0, acceleration=4.0, jerk=40.0)
STOP = 2.0 / 4.0 + 4.0 / 40.0


def played(stream: GoalStream, goals: Iterable[Array], period: float) -> list[Followed]:
    """Push a goal every period and take what must be known until the next one."""
    blocks: list[Followed] = []
    for k, goal in enumerate(goals, start=1):
        stream.push(goal)
        blocks += stream.take(round(k * period / T))
    return blocks


def faultless(draw: Draw, **options: int) -> tuple[GoalStream, float]:
    """Play and judge; how late it ends, in stops."""
    stream, found = play(draw, **options)
    verdict = judge(draw, found)
    assert found.done
    assert verdict["end"]
    assert verdict["over"] <= 1 + 1e-9
    assert verdict["gap"] <= 1e-11
    assert verdict["turns"] <= 0
    assert not draw.within or verdict["passed"] <= 1e-9
    return stream, found.late / draw.stop


@settings(max_examples=25)
@given(st.integers(0, 2**31))
def test_random_streams(seed: int) -> None:
    """No turn that goals do not have, no limit left, no last goal passed, the end bit for bit."""
    draw = drawn(random.Random(seed))
    if len(draw.times) > 2:
        faultless(draw)


@pytest.mark.parametrize("seed", range(4))
def test_trust_waits_where_its_source_could_still_stop(seed: int) -> None:
    """Goals stay away in full motion, longer than a stop takes: no way back to the last of them."""
    rng = random.Random(seed)
    draw = one_way(0.9, 0.1, 3, within=False, joints=rng.choice([1, 3]))
    arrivals = draw.arrivals.copy()
    arrivals[rng.randrange(6, 10)] += 3.0 * draw.stop
    late = replace(draw, arrivals=np.maximum.accumulate(arrivals))
    stream, _ = faultless(late)
    assert stream.report.starved == 1
    assert stream.report.beyond.max() > 0.0


def test_a_stall_right_after_a_turn_needs_no_way_back() -> None:
    """Seven joints, a goal stays away while some turn: rest no further than the last one known."""
    draw = drawn(random.Random(11_000_338))
    assert draw.within
    assert (draw.arrivals > draw.times).any()
    faultless(draw)


@settings(max_examples=10)
@given(st.integers(0, 2**31))
def test_with_ten_iterations_every_stream_arrives(seed: int) -> None:
    """The bound of the solver costs time, no limit and no end."""
    draw = drawn(random.Random(seed))
    if len(draw.times) > 2:
        faultless(draw, iterations=10)


@settings(max_examples=15)
@given(st.integers(0, 2**31))
def test_a_start_in_motion_and_outside_the_limits(seed: int) -> None:
    """Up to twice the limits: the jerk's limit holds, nothing grows, soon inside, the end exact."""
    rng = random.Random(seed)
    limits, states = [], []
    for _ in range(rng.choice([1, 2, 7])):
        v = 10.0 ** rng.uniform(-1, 2)
        a = v / rng.uniform(0.1, 1.0)
        limits.append(Limits(v, a, a / rng.uniform(0.03, 0.3)))
        state = (rng.uniform(low, high) for low, high in ((-5 * v, 5 * v), (-2 * v, 2 * v)))
        states.append(State(*state, acceleration=2.0 * a * rng.uniform(-1, 1)))
    stream = GoalStream(limits, T, states, period=0.05, delay=8, stop_within=rng.random() < 0.5)
    q, v, a = np.array([[x.position, x.velocity, x.acceleration] for x in states]).T
    V, A, J = np.array([[x.velocity, x.acceleration, x.jerk] for x in limits]).T
    goal = q + 0.3 * v
    blocks: list[Followed] = []
    if rng.random() < 0.8:
        step = 0.025 * V * [rng.choice([-1, 1]) for _ in limits]
        goals = goal + step * np.arange(1, 20)[:, None]
        blocks, goal = played(stream, goals, 0.05), goals[-1]
    blocks += ended(stream)
    cycles = np.concatenate([b.lengths.ravel() for b in blocks])
    j = np.repeat(np.concatenate([b.jerk.reshape(-1, len(a)) for b in blocks]), cycles, axis=0)
    none = np.zeros((1, len(limits)))
    As = a + np.vstack([none, np.cumsum(T * j, axis=0)])  # of the continuous motion
    steps = As[:-1] * T + j * (T * T / 2)
    Vs = v + a * (T / 2) + np.vstack([none, np.cumsum(steps, axis=0)])
    steps = Vs[:-1] * T + As[:-1] * (T * T / 2) + j * (T**3 / 6)
    Ps = q + v * (T / 2) - a * (T * T / 12) + np.cumsum(steps, axis=0)
    assert (np.abs(j) <= J * (1 + 1e-9)).all()
    assert (np.abs(As) <= np.maximum(A, np.abs(a)) * (1 + 1e-9)).all()
    most = np.maximum(V, np.abs(v) + np.abs(a) * T + a * a / (2 * J))
    assert (np.abs(Vs) <= most * (1 + 1e-9)).all()
    assert (np.abs(Vs[round(3 * float((V / A + A / J).max()) / T) :]) <= V * (1 + 1e-9)).all()
    samples = Ps - Vs[1:] * (T / 2) + As[1:] * (T * T / 3) - j * (T**3 / 8)
    assert (np.abs(positions(blocks)[-len(samples) :] - samples) <= 1e-9 * V).all()
    if stream.report.goals:
        np.testing.assert_array_equal(blocks[-1].position[-1], goal)


@pytest.mark.parametrize("within", [False, True])
@pytest.mark.parametrize(("share", "most"), [(0.5, 1e-3), (0.8, 1e-3), (0.95, 2e-3), (1.0, 1e-2)])
def test_goals_are_met_at_their_time(share: float, most: float, within: bool) -> None:
    """With a delay of 1.5 stops (within) or 0.75 (trust) beside the period; ends within a knot."""
    draw = one_way(share, 0.02, 1, within=within)
    delay = round((1.5 if within else 0.75) * draw.stop / 0.02) + 1
    draw = replace(draw, delay=delay)
    stream, found = play(draw, smoothing=1e-4)
    assert found.late <= draw.stop / 12 + 1.5 * T
    rows = positions(found.blocks)
    due = np.round((draw.times[1:] - draw.times[1]) / T).astype(int) + round(delay * 0.02 / T) - 1
    seen = due < len(rows)
    off = np.abs(rows[due[seen]] - draw.goals[1:][seen]) / draw.goals[-1]
    assert off.max() <= most
    assert stream.report.lag <= 1e-3


def test_goals_are_met_exactly_where_that_is_asked() -> None:
    """Four stops a second at half of the limits: to rounding, in their cycles."""
    draw = one_way(0.5, 0.2, 6, within=False)
    stream, found = play(draw, exact=True)
    rows = positions(found.blocks)
    due = np.round((draw.times[1:] - draw.times[1]) / T).astype(int) + 1200 - 1
    due = np.minimum(due, len(rows) - 1)  # behind its end it rests where it is
    np.testing.assert_allclose(rows[due], draw.goals[1:], atol=1e-9)
    assert stream.report.deviation.max() <= 1e-9


def test_a_tolerance_bounds_what_is_left_of_goals() -> None:
    """At all of the limits, the last goal known never passed: later rather than further off."""
    draw = one_way(1.0, 0.05, 6, within=True, joints=3)
    free, found = play(draw)
    bound, closer = play(draw, tolerance=0.006)
    assert free.report.deviation.max() > 0.006
    assert bound.report.deviation.max() <= 0.006
    assert closer.late <= found.late + draw.stop / 6
    assert judge(draw, closer)["over"] <= 1 + 1e-9


@settings(max_examples=10)
@given(st.integers(0, 2**31), st.sampled_from([-1.0, 2.0**10, 2.0**-20, 1e6, 1e-7]))
def test_units_and_signs_change_nothing(seed: int, scale: float) -> None:
    """Limits and goals in another unit: the same motion in it."""
    draw = drawn(random.Random(seed))
    if not 2 < len(draw.times) < 400:
        return
    size = abs(scale)
    limits = [
        Limits(
            x.velocity * size,
            x.acceleration * size,
            x.jerk * size,
            x.braking[0] * size,
            x.braking[1] * size,
        )
        for x in draw.limits
    ]
    speeds = None if draw.velocities is None else draw.velocities * scale
    other = replace(
        draw, limits=limits, goals=draw.goals * scale, count=draw.count * size, velocities=speeds
    )
    one, two = play(draw)[1], play(other)[1]
    assert one.done
    assert two.done
    assert abs(one.late - two.late) <= 0.5 * draw.stop
    faultless(other)


def test_far_from_zero_limits_hold_as_near_it() -> None:
    """1e5 times what is covered in a second away: jerks within 1e-9 of their limit, same time."""
    near = one_way(0.95, 0.05, 12, within=True)
    far = replace(near, goals=near.goals + 2e5)
    one, two = play(near)[1], play(far)[1]
    assert judge(far, two)["over"] <= 1 + 1e-9
    assert judge(far, two)["turns"] <= 0
    assert judge(far, two)["end"]
    assert abs(one.late - two.late) <= 2 * T


@pytest.mark.parametrize("late", [0.3, 0.9])
def test_a_lag_is_made_up(late: float) -> None:
    """A goal comes late in full motion: a lag meanwhile, none at the end, and no turn."""
    draw = one_way(0.7, 0.05, 4, within=True)
    arrivals = draw.arrivals.copy()
    arrivals[10] += late
    stream, found = play(replace(draw, arrivals=np.maximum.accumulate(arrivals)))
    assert stream.report.largest_lag > 0.05
    assert stream.report.reversals.max() == 0
    # not later than from rest at the goal before, when the late one comes
    row = [State(x) for x in draw.goals[9]], [State(x) for x in draw.goals[-1]]
    least = float(arrivals[10] + plan(*row, draw.limits, T).duration)
    due = max(float(draw.times[-1]) + 0.2, float(arrivals[-1]))
    assert found.late <= max(least - due, 0.0) + 0.5 * draw.stop


@pytest.mark.parametrize("within", [False, True])
def test_starving_stops_on_what_is_known(within: bool) -> None:
    """Goals that end in full motion: rest at the last one, or the source's stop beyond it."""
    goals = 0.05 * np.arange(30)[:, None] * [1.0, -0.5]
    stream = GoalStream([ROBOT] * 2, T, goals[0], period=0.05, delay=8, stop_within=within)
    blocks = played(stream, goals[1:], 0.05)
    blocks += stream.take(stream.cycle + 20_000)
    rows = positions(blocks)
    recording_keeps(rows, [ROBOT] * 2)
    beyond = (rows[-1] - goals[-1]) * [1.0, -1.0]
    assert stream.report.starved == (not within)
    if within:
        np.testing.assert_array_equal(rows[-1], goals[-1])
        assert (np.abs(rows) <= np.abs(goals[-1])).all()
    else:
        assert (beyond >= -1e-3).all()
        assert (beyond <= [0.5 / 4 + 0.05, 0.5 / 8 + 0.03]).all()
    blocks += ended(stream)
    np.testing.assert_array_equal(positions(blocks)[-1], goals[-1])


def test_a_stream_that_comes_back_is_timed_anew() -> None:
    """A goal without a time that comes at rest is due the delay after it came."""
    stream = GoalStream([ROBOT], T, [0.0], period=0.1, delay=6, smoothing=1e-4)
    played(stream, 0.02 * np.arange(1, 11)[:, None], 0.1)
    blocks = stream.take(8000)
    at = float(blocks[-1].position[-1, 0])
    now = stream.cycle
    stream.push([at + 0.05])
    rows = positions(ended(stream))
    assert abs(rows[600 - 1, 0] - at - 0.05) <= 2e-3
    assert rows[150, 0] == at
    assert now == 8000


def test_joints_keep_their_path_when_limits_bind() -> None:
    """Goals twice too fast: no joint leaves the common path by more than 2 % of its way."""
    draw = one_way(1.0, 0.05, 6, within=True, joints=3)
    limits = [
        Limits(x.velocity / f, x.acceleration / f**2, x.jerk / f**3)
        for x, f in zip(draw.limits, (2.0, 1.2, 1.5), strict=True)
    ]
    bound = replace(draw, limits=limits)
    stream, found = play(bound)
    rows = positions(found.blocks) / draw.goals[-1]
    assert np.ptp(rows, axis=1).max() <= 0.02
    assert stream.report.reversals.max() == 0
    assert judge(bound, found)["over"] <= 1 + 1e-9


@pytest.mark.parametrize(("noise", "most"), [("quantised", 2.0), ("jittered", 2.0)])
def test_noise_does_not_become_jerk(noise: str, most: float) -> None:
    """500 Hz goals to 1/500 of the way, or at times 20 % off: jerk rms below twice the true one."""
    limits, rng = Limits(2.0, 10.0, 100.0), np.random.default_rng(4)
    t = np.arange(0.0, 6.0, 0.002)
    stamps = t + (0.0004 * rng.uniform(-1, 1, len(t)) if noise == "jittered" else 0.0)
    goals = 0.25 * (1.0 - np.cos(np.pi * t))
    if noise == "quantised":
        goals = np.round(goals / 1e-3) * 1e-3
    stream = GoalStream([limits], T, [goals[0]], period=0.002, delay=200)
    blocks: list[Followed] = []
    for k in range(1, len(t)):
        stream.push([goals[k]], float(stamps[k]))
        blocks += stream.take(2 * k)
    jerk = np.repeat(
        np.concatenate([b.jerk[:, 0, 0] for b in blocks]),
        np.concatenate([b.cycles for b in blocks]),
    )
    true = 0.25 * np.pi**3 / np.sqrt(2.0)
    assert np.sqrt(np.mean(jerk[2000:5000] ** 2)) <= most * true
    rows = positions(blocks)[:, 0]
    asked = 0.25 * (1.0 - np.cos(np.pi * (np.arange(len(rows)) * T + T - 0.4 + 0.002)))
    assert np.sqrt(np.mean((rows - asked)[2000:5000] ** 2)) <= 4e-4
    assert stream.report.lag == 0.0


def replanned(every: int, ahead: float, limits: Limits, seconds: float) -> Array:
    """A sine tracked by ruckig: to position and velocity `ahead`, planned anew every few cycles."""
    otg, out = ruckig.Ruckig(1, T), ruckig.OutputParameter(1)
    inp = ruckig.InputParameter(1)
    inp.max_velocity, inp.max_acceleration, inp.max_jerk = (
        [limits.velocity], [limits.acceleration], [limits.jerk],
    )  # fmt: skip
    rows = []
    for k in range(round(seconds / T)):
        if k % every == 0:
            t = k * T + ahead
            inp.target_position = [0.25 * (1.0 - np.cos(np.pi * t))]
            inp.target_velocity = [0.25 * np.pi * np.sin(np.pi * t)]
        otg.update(inp, out)
        out.pass_to_input(inp)
        rows.append(out.new_position[0])
    return np.array(rows)


@pytest.mark.parametrize("ahead", [0.05, 0.1])
@pytest.mark.parametrize("velocities", [False, True])
def test_tracking_is_ten_times_closer_than_planning_anew(velocities: bool, ahead: float) -> None:
    """A sine each 10 cycles, a horizon of 50 or 100 ms: rms a tenth of ruckig's at that horizon."""
    limits, t = Limits(2.0, 10.0, 100.0), np.arange(0.0, 6.0, 0.01)
    stream = GoalStream([limits], T, [0.0], period=0.01, delay=round(ahead / 0.01), knots=24)
    blocks: list[Followed] = []
    for k in range(1, len(t)):
        speed = [0.25 * np.pi * np.sin(np.pi * t[k])] if velocities else None
        stream.push([0.25 * (1.0 - np.cos(np.pi * t[k]))], velocity=speed)
        blocks += stream.take(10 * k)
    rows = positions(blocks)[2000:5000, 0]
    time = (np.arange(2000, 5000) + 1) * T - ahead + 0.01
    own = np.sqrt(np.mean((rows - 0.25 * (1.0 - np.cos(np.pi * time))) ** 2))
    other = replanned(10, ahead, limits, 5.0)[2000:5000]
    due = (np.arange(2000, 5000) + 1) * T
    theirs = np.sqrt(np.mean((other - 0.25 * (1.0 - np.cos(np.pi * due))) ** 2))
    assert own <= 0.1 * theirs


def test_position_limits_hold_between_goals() -> None:
    """Goals that turn on a limit: inside in every cycle, and on it."""
    limits = [Limits(2.0, 8.0, 80.0, position=(-1.0, 1.0))]
    t = np.arange(0.0, 8.0, 0.05)
    goals = np.sin(t)[:, None]
    goals[31] = 1.0
    stream = GoalStream(limits, T, [0.0], period=0.05, delay=12, smoothing=1e-4)
    rows = positions([*played(stream, goals[1:], 0.05), *ended(stream)])
    assert rows.max() <= 1.0
    assert rows.min() >= -1.0
    assert rows.max() >= 1.0 - 2e-3


@pytest.mark.parametrize("within", [False, True])
def test_the_demos_path_has_no_dip_of_its_own(within: bool) -> None:
    """10 Hz, four periods of delay, a soft jerk limit: as many dips as the path, no turn."""
    limit = Limits.from_jerk_factor(velocity=90.0, acceleration=214.0, jerk_factor=0.5)
    way = read_recording(shipped_recording()).position
    stream = GoalStream([limit], T, way[:1], period=0.1, delay=4, stop_within=within)
    rows = positions([*played(stream, way[1:, None], 0.1), *ended(stream)])
    recording_keeps(rows, [limit])
    assert stream.report.reversals.max() == 0
    own = dips(np.diff(np.interp(np.arange(100 * len(way)) / 100, np.arange(len(way)), way)))
    assert within or dips(np.diff(rows[:, 0])) <= own
    assert rows[-1, 0] == way[-1]


def test_cycles_that_the_clock_leaves_out_are_made_up() -> None:
    """5 % of the cycles left out: the goals are passed at their time, not later and later."""
    draw = one_way(0.5, 0.02, 30, within=False)
    stream = GoalStream(draw.limits, T, draw.goals[0], period=0.02, delay=30)
    blocks: list[Followed] = []
    for k in range(1, len(draw.times)):
        stream.push(draw.goals[k], float(draw.times[k]))
        stream.skipped(1)
        blocks += stream.take(19 * k)
    cycles = stream.cycle
    assert stream.report.lag <= 0.01
    rows = positions([*blocks, *ended(stream)])
    skipped = len(draw.times) - 1
    assert (
        len(rows) + skipped <= (draw.times[-1] + 0.6) / T + 2 * draw.stop / 12 / T + cycles * 0.01
    )
    assert judge(draw, replace(play(draw)[1]))["over"] <= 1 + 1e-9


def test_what_remains_is_what_is_kept() -> None:
    """The plan behind what was handed out ends at rest, and is handed out bit for bit if kept."""
    draw = one_way(0.9, 0.05, 6, within=True)
    stream = GoalStream(draw.limits, T, draw.goals[0], period=0.05, delay=6, stop_within=True)
    for k in range(1, 20):
        stream.push(draw.goals[k])
        stream.take(50 * k)
    rest = stream.remainder()
    assert not rest[-1].velocity[-1].any()
    assert [b.first for b in rest] == list(range(rest[0].first, rest[0].first + len(rest)))
    assert stream.keep(10**6) == len(rest)
    assert stream.cycle == rest[-1].first_cycle + int(rest[-1].cycles.sum())
    again = stream.take(stream.cycle + 1)
    np.testing.assert_array_equal(again[0].position[0], rest[-1].position[-1])


def test_seven_joints_of_a_robot() -> None:
    """TOPP-RA's plan of the Panda, at its limits: kept in each cycle, no turn, to its end."""
    way = toppra_plan(0.1, 0)
    stream = GoalStream(PANDA, T, way.position[0], period=0.1, delay=6)
    rows = positions([*played(stream, way.position[1:], 0.1), *ended(stream)])
    recording_keeps(rows, PANDA)
    np.testing.assert_array_equal(rows[-1], way.position[-1])
    assert stream.report.reversals.max() == 0


def test_what_is_refused() -> None:
    """Each names the field, the value and the limit."""
    reach = Limits(1.0, 4.0, 500.0, position=(-1.0, 1.0))
    for options in (
        {"period": 0.0},
        {"period": 0.0005},
        {"period": 0.1, "delay": 0},
        {"period": 0.1, "delay": True},
        {"period": 0.1, "margin": -1.0},
        {"period": 0.1, "smoothing": 0.0},
        {"period": 0.1, "tolerance": 0.0},
        {"period": 0.1, "tolerance": [0.1, 0.1]},
        {"period": 0.1, "iterations": 2},
        {"period": 0.1, "joint_names": ["a", "b"]},
    ):
        with pytest.raises(InputError):
            GoalStream([reach], T, [0.0], **options)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="limits"):
        GoalStream([reach, reach], T, [0.0], period=0.1)
    with pytest.raises(InputError, match="start"):
        GoalStream([reach] * 2, T, [State(0.0), 0.0], period=0.1)  # type: ignore[list-item]
    stream = GoalStream([reach], T, [0.0], period=0.1)
    for goal in ([2.0], [np.nan], [0.0, 0.0]):
        with pytest.raises(InputError):
            stream.push(goal)
    stream.push([0.5], 1.0)
    with pytest.raises(InputError, match="after"):
        stream.push([0.5], 1.0)
    with pytest.raises(InputError, match="velocity"):
        stream.push([0.5], 1.1, velocity=[0.0, 0.0])
    stream.end()
    with pytest.raises(InputError, match="ended"):
        stream.push([0.5])


@pytest.mark.parametrize("number", [2580, 6339])
def test_a_motion_that_has_turned_before_its_goals_does_not_turn_back(number: int) -> None:
    """Goals rest at a turn, and the motion turns before they do: there is no second turn."""
    made = run(21, number)
    assert made is not None
    _, found, verdict, stream = made
    assert found.done
    assert verdict["turns"] <= 0
    assert stream.report.reversals.max() == 0
