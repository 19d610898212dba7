"""Streams as users bring them, each with what it must give: late where it must be, never cut."""

from __future__ import annotations

import numpy as np
import pytest

from helpers.following_check import PANDA, T, recording_keeps, toppra_plan
from helpers.stream_check import Array, ended, positions
from sjerk import GoalStream, Limits, State, plan
from sjerk.cli import demo
from sjerk.trajectory import read_recording, shipped_recording
from sjerk.trajectory.segments import Followed

ROBOT = Limits(velocity=2.0, acceleration=10.0, jerk=500.0)


def streamed(stream: GoalStream, goals: Array, times: Array, arrivals: Array) -> Array:
    """Positions in each cycle, of goals (n, N) at times (n,) that come later; 0 is the start."""
    blocks: list[Followed] = []
    for k in range(1, len(goals)):
        blocks += stream.take(round(arrivals[k] / T))
        stream.push(goals[k], float(times[k]))
    return positions([*blocks, *ended(stream)])


@pytest.mark.parametrize("late", [False, True])
@pytest.mark.parametrize(("delay", "margin"), [(4, 0.0), (4, 0.1), (5, 0.0), (10, 0.0)])
@pytest.mark.parametrize("within", [True, False])
def test_the_demo_s_path_never_goes_back(
    within: bool, delay: int, margin: float, late: bool
) -> None:
    """At 10 Hz, every fifth goal late by half a period and one by three; in time from 5 periods on.

    The source rises all the way, and a programme on a fine grid needs 0.94 of the jerk for it.
    """
    goals = read_recording(shipped_recording()).position[:, None]
    stream = GoalStream(
        [demo.LIMITS], T, goals[0], period=0.1, delay=delay, margin=margin, stop_within=within
    )
    times = 0.1 * np.arange(len(goals))
    arrivals = times.copy()
    if late:
        arrivals[::5] += 0.05
        arrivals[len(goals) // 2] += 0.3
        arrivals = np.maximum.accumulate(arrivals)
    rows = streamed(stream, goals, times, arrivals)
    recording_keeps(rows, [demo.LIMITS])
    assert (np.diff(rows[:, 0]) >= 0.0).all()
    assert stream.report.reversals.max() == 0
    assert rows[-1] == goals[-1]
    if late:
        return
    moved = np.flatnonzero(np.diff(rows[:, 0]))
    assert (moved[-1] - moved[0] + 1) * T <= times[-1] + 0.1
    if not within or delay > 4 or margin:
        assert np.abs(np.diff(rows[:, 0], 3)).max() <= 0.95 * demo.LIMITS.jerk * T**3
        assert stream.report.deviation[0] <= 5e-4 * np.ptp(goals)
        assert stream.report.largest_lag <= 0.01


@pytest.mark.parametrize("period", [0.002, 0.01, 0.02, 0.1])
@pytest.mark.parametrize("within", [True, False])
def test_a_source_that_starts_at_half_of_the_velocity_is_caught_up_with(
    period: float, within: bool
) -> None:
    """1 rad/s from the first goal on: the lag stays below 0.2 s and ends, so does the stream.

    It stops as it started, in no time: who trusted it turns back, and is there a move later.
    """
    goals = period * np.arange(round(2.0 / period) + 1)[:, None]
    stream = GoalStream([ROBOT], T, [0.0], period=period, stop_within=within)
    blocks: list[Followed] = []
    for k in range(1, len(goals)):
        stream.push(goals[k])
        blocks += stream.take(round(k * period / T))
    assert within or stream.report.lag <= 0.02
    rows = positions([*blocks, *ended(stream)])
    recording_keeps(rows, [ROBOT])
    assert stream.report.largest_lag <= 0.2
    there = (np.flatnonzero(np.diff(rows[:, 0]))[-1] + 1) * T
    delay = stream.delay
    back = plan(State(2.0, 1.0), 2.0, ROBOT, T).duration
    assert there - 2.0 - delay <= (0.2 if within else back + 0.05)
    assert within or stream.report.reversals.max() <= 1
    assert not within or (np.diff(rows[:, 0]) >= 0.0).all()


def test_a_plan_at_all_of_its_acceleration_is_late_and_not_cut() -> None:
    """TOPP-RA's plan of the Panda at 10 Hz, 4 periods behind: goals within 1 % and a half."""
    way = toppra_plan(0.1, 0)
    stream = GoalStream(PANDA, T, way.position[0], period=0.1)
    rows = streamed(stream, way.position, way.time, way.time)
    recording_keeps(rows, PANDA)
    assert (stream.report.deviation <= 0.015 * np.ptp(way.position, axis=0)).all()
    assert stream.report.largest_lag <= 0.2
    moved = np.flatnonzero(np.diff(rows, axis=0).any(axis=1))
    assert (moved[-1] + 1) * T <= way.duration + stream.delay + 0.3


@pytest.mark.parametrize(
    ("limits", "way", "seconds", "period"),
    [
        (ROBOT, 1.0, 4.0, 0.002),
        (ROBOT, 1.0, 1.2, 0.002),
        (Limits(2.0, 4.0, 40.0), 1.0, 3.0, 0.004),
        (Limits(90.0, 214.0, 1025.0), 100.0, 3.0, 0.01),
    ],
)
def test_goals_denser_than_knots_lose_nothing(
    limits: Limits, way: float, seconds: float, period: float
) -> None:
    """A quintic that uses 4 to 40 % of the acceleration, at the control rate: in time, as soft."""
    x = np.linspace(0.0, 1.0, round(seconds / period) + 1)
    goals = way * (10 * x**3 - 15 * x**4 + 6 * x**5)[:, None]
    stream = GoalStream([limits], T, [0.0], period=period)
    assert stream.delay == pytest.approx(4 * stream.knot, abs=period)
    times = period * np.arange(len(goals))
    rows = streamed(stream, goals, times, times)
    assert stream.report.largest_lag <= 0.2 * stream.knot
    assert stream.report.deviation[0] <= 1e-3 * way
    assert np.abs(np.diff(rows[:, 0], 2)).max() <= 1.1 * 5.7735 * way / seconds**2 * T**2
