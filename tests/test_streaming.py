"""Streamed goals with look-ahead: met in their cycles, limits kept, ends that are told."""

from __future__ import annotations

import itertools
from collections.abc import Iterable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from following_check import PANDA, Array, T, recording_keeps, toppra_plan
from sjerk import GoalStream, InputError, Limits, Trajectory, plan_velocity
from sjerk.cli.demo import dips
from sjerk.trajectory.joining import brake
from sjerk.trajectory.segments import Followed, Knot
from sjerk.trajectory.trajectory import shipped_recording

ROBOT = Limits(velocity=2.0, acceleration=4.0, jerk=500.0)


def played(stream: GoalStream, goals: Iterable[Array], period: float) -> list[Followed]:
    """Push a goal every period and take what must be known until the next one."""
    blocks: list[Followed] = []
    for k, goal in enumerate(goals, start=1):
        stream.push(goal)
        blocks += stream.take(round(k * period / T))
    return blocks


def ended(stream: GoalStream) -> list[Followed]:
    """End the stream and take the rest."""
    stream.end()
    blocks: list[Followed] = []
    while not stream.done:
        blocks += stream.take(stream.cycle + 50)
        assert stream.cycle < 10**6
    return blocks


def positions(blocks: list[Followed]) -> Array:
    """Every cycle; and that blocks go on where the one before ended."""
    for one, two in itertools.pairwise(blocks):
        for name in ("position", "velocity", "acceleration", "last_jerk"):
            np.testing.assert_array_equal(getattr(one, name)[-1], getattr(two, name)[0])
        assert two.first_cycle == one.first_cycle + one.cycles.sum()
    return np.concatenate([block.sample().position for block in blocks])


def falls(position: Array) -> list[int]:
    """Dips of each joint's velocity."""
    return [dips(v) for v in np.diff(position, axis=0).T]


def wave(n: int, period: float, joints: int = 3) -> Array:
    """Goals of a motion from rest to rest, inside the limits."""
    t = np.arange(n) * period
    ease = np.sin(np.pi * np.arange(n) / (n - 1)) ** 4
    return 0.25 * ease[:, None] * np.column_stack([np.sin(1.3 * t + k) for k in range(joints)])


@pytest.mark.parametrize(
    ("period", "delay"), [(0.1, 1), (0.1, 3), (0.02, 5), (0.01, 8), (0.002, 50)]
)
def test_goals_within_the_limits_are_met_in_their_cycles(period: float, delay: int) -> None:
    """10 to 500 Hz: every goal bit for bit, the delay after it came, no cycle of lag."""
    goals = wave(round(4.0 / period), period)
    stream = GoalStream([ROBOT] * 3, T, goals[0], period=period, delay=delay)
    position = positions([*played(stream, goals[1:], period), *ended(stream)])
    due = round(period / T) * (delay + np.arange(len(goals) - 1))
    np.testing.assert_array_equal(position[due[:-3]], goals[1:-3])
    np.testing.assert_array_equal(position[-1], goals[-1])
    recording_keeps(position, [ROBOT] * 3)
    assert stream.report.largest_lag <= 2 * T  # a stop takes a cycle or two more
    assert (stream.report.met, stream.report.missed) == (len(goals) - 1, 0)


@pytest.mark.parametrize(("delay", "margin"), [(4, 0.0), (4, 0.06), (5, 0.03)])
def test_the_panda_at_10_hz_has_no_dip_of_its_own(delay: int, margin: float) -> None:
    """TOPP-RA's plan at full acceleration: all goals met, as many dips as the plan has, no more."""
    way = Trajectory.from_bag(shipped_recording())
    own = falls(np.repeat(way.position, 100, axis=0)[::100])
    stream = GoalStream(PANDA, T, way.position[0], period=0.1, delay=delay, margin=margin)
    position = positions([*played(stream, way.position[1:], 0.1), *ended(stream)])
    recording_keeps(position, PANDA)
    np.testing.assert_array_equal(position[-1], way.position[-1])
    assert falls(position) == own
    assert (stream.report.met, stream.report.missed) == (53, 0)
    assert 0.0 < stream.report.lag < 0.2 * way.duration


@pytest.mark.parametrize("within", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_other_plans_of_the_panda(seed: int, within: bool) -> None:
    """At full acceleration: limits kept in every cycle, the end reached."""
    way = toppra_plan(0.1, seed)
    stream = GoalStream(PANDA, T, way.position[0], period=0.1, delay=3, stop_within=within)
    position = positions([*played(stream, way.position[1:], 0.1), *ended(stream)])
    recording_keeps(position, PANDA)
    np.testing.assert_array_equal(position[-1], way.position[-1])


@pytest.mark.parametrize("delay", [1, 2, 4])
def test_starving_stops_within_the_stopping_distance(delay: int) -> None:
    """Goals that end in full motion: passed by at most a stopping distance, told, gone back."""
    goals = 0.12 * np.arange(20)[:, None] * [1.0, -0.5]
    limits = [Limits(2.0, 4.0, 200.0)] * 2
    stream = GoalStream(limits, T, goals[0], period=0.1, delay=delay)
    blocks = played(stream, goals[1:], 0.1)
    while not stream.report.starving:
        blocks += stream.take(stream.cycle + 1)
    at = Knot.of(blocks[-2] if len(blocks[-1].cycles) == 1 else blocks[-1])
    np.testing.assert_array_equal(at.position, goals[-1])
    distance = [
        abs(plan_velocity(state, 0.0, limit, T).end.position - state.position)
        for state, limit in zip(at.states(T), limits, strict=True)
    ]
    while blocks[-1].velocity[-1].any():
        blocks += stream.take(stream.cycle + 7)
    assert stream.report.starved == 1
    assert (stream.report.beyond > 0.0).all()
    assert (stream.report.beyond <= np.array(distance) + 1e-3).all()
    blocks += ended(stream)
    position = positions(blocks)
    recording_keeps(position, limits)
    np.testing.assert_array_equal(position[-1], goals[-1])


def test_a_stream_that_comes_back_is_timed_anew() -> None:
    """After starving to rest the next goal is due the delay after it came."""
    stream = GoalStream([ROBOT], T, [0.0], period=0.1, delay=2)
    blocks = played(stream, 0.05 * np.arange(1, 11)[:, None], 0.1)
    blocks += stream.take(5000)
    assert stream.report.starving
    goal = float(blocks[-1].position[-1, 0]) + 0.005
    now = stream.cycle
    stream.push([goal])
    blocks += stream.take(now + 100)
    stream.push([goal + 0.005])
    blocks += ended(stream)
    assert positions(blocks)[now + 200, 0] == goal
    assert stream.report.lag <= 2 * T


@pytest.mark.parametrize("delay", [1, 2, 3, 6])
def test_stop_within_never_passes_the_last_goal(delay: int) -> None:
    """At every cycle what was handed out ends on the last goal known, not past it."""
    goals = 0.1 * np.arange(1, 25)
    for given_up in (3, 8, 24):
        stream = GoalStream([ROBOT], T, [0.0], period=0.1, delay=delay, stop_within=True)
        blocks: list[Followed] = []
        for k, goal in enumerate(goals[:given_up], start=1):
            stream.push([goal])
            got = stream.take(100 * k)
            assert not got or positions(got).max() <= goal
            blocks += got
        blocks += stream.take(stream.cycle + 20_000)
        position = positions(blocks)
        recording_keeps(position, [ROBOT])
        assert position.max() == position[-1, 0] == goals[given_up - 1]
        assert stream.report.starved == 0


def test_a_late_goal_costs_little() -> None:
    """A goal 20 ms late: the brake has begun, is told, and the lag is made up."""
    goals = 0.1 * np.arange(1, 40)
    stream = GoalStream([ROBOT], T, [0.0], period=0.1, delay=1)
    blocks: list[Followed] = []
    for k, goal in enumerate(goals, start=1):
        if k == 15:
            blocks += stream.take(100 * (k - 1) + 20)
        stream.push([goal])
        blocks += stream.take(100 * k)
    blocks += ended(stream)
    recording_keeps(positions(blocks), [ROBOT])
    report = stream.report
    assert report.starved >= 1
    assert report.met + report.missed == len(goals)
    assert positions(blocks)[-1, 0] == goals[-1]


def test_a_margin_is_for_goals_that_are_late() -> None:
    """Goals up to 30 ms late, 30 ms of margin: all in their cycles."""
    rng = np.random.default_rng(5)
    goals = wave(40, 0.1)
    stream = GoalStream([ROBOT] * 3, T, goals[0], period=0.1, delay=1, margin=0.03)
    blocks: list[Followed] = []
    for k, goal in enumerate(goals[1:]):
        blocks += stream.take(100 * k + int(rng.integers(0, 31)) * (k > 0))
        stream.push(goal)
    blocks += ended(stream)
    assert stream.report.largest_lag == 0.0
    assert stream.report.starved == 0


@settings(max_examples=40)
@given(
    st.lists(st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)), min_size=1, max_size=12),
    st.sampled_from([0.002, 0.01, 0.03, 0.1]),
    st.integers(1, 6),
    st.booleans(),
    st.sampled_from([20.0, 500.0]),
    st.lists(st.integers(0, 400), min_size=12, max_size=12),
)
def test_any_goals_at_any_time(
    rows: list[tuple[float, float]],
    period: float,
    delay: int,
    within: bool,
    jerk: float,
    late: list[int],
) -> None:
    """Wild goals, late goals: limits kept in every cycle, position limits too, the end reached."""
    limits = [Limits(2.0, 4.0, jerk, position=(-1.5, 1.5))] * 2
    stream = GoalStream(limits, T, [0.0, 0.0], period=period, delay=delay, stop_within=within)
    blocks: list[Followed] = []
    for goal, wait in zip(rows, late, strict=False):
        stream.push(goal)
        blocks += stream.take(stream.cycle + wait)
    blocks += ended(stream)
    position = positions(blocks)
    recording_keeps(position, limits)
    np.testing.assert_array_equal(position[-1], rows[-1])
    assert stream.report.met + stream.report.missed <= len(rows)


def test_times_of_their_own() -> None:
    """Goals with stamps, not in step: met in the cycles of their stamps."""
    times = np.cumsum([0.1, 0.13, 0.09, 0.1, 0.2, 0.1, 0.11])
    stream = GoalStream([ROBOT], T, [0.0], period=0.1, delay=2)
    blocks: list[Followed] = []
    for time in times:
        blocks += stream.take(round((time - 0.1) / T))
        stream.push([0.02 * time], time)
    blocks += ended(stream)
    position = positions(blocks)
    for time in times[:-1]:
        assert position[round(time / T) + 100, 0] == 0.02 * time


def test_what_is_refused() -> None:
    """Each names the field, the value and the limit."""
    reach = Limits(1.0, 4.0, 500.0, position=(-1.0, 1.0))
    for options in (
        {"period": 0.0},
        {"period": 0.001},
        {"period": 0.1, "delay": 0},
        {"period": 0.1, "delay": True},
        {"period": 0.1, "margin": -1.0},
        {"period": 0.1, "joint_names": ["a", "b"]},
    ):
        with pytest.raises(InputError):
            GoalStream([reach], T, [0.0], **options)  # type: ignore[arg-type]
    stream = GoalStream([reach], T, [0.0], period=0.1)
    for goal in ([2.0], [np.nan], [0.0, 0.0]):
        with pytest.raises(InputError):
            stream.push(goal)
    stream.push([0.5], 1.0)
    with pytest.raises(InputError, match="after"):
        stream.push([0.5], 1.0)
    stream.end()
    with pytest.raises(InputError, match="ended"):
        stream.push([0.5])
    assert brake(Knot.rest([0.0]), [reach], T).cycles.sum() == 1
