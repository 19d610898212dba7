"""A goal stream in a kernel: what the library hands out, with a stop behind it at all times."""

from __future__ import annotations

import os
import signal
import time

import numpy as np
import pytest

from helpers.following_check import Array, T
from helpers.path_check import Bench, keeps
from sjerk import Axis, InputError, Limits, MotionKernel, StreamPlayer
from sjerk.cli.demo import dips

LIMITS = [Limits(2.0, 4.0, 200.0)] * 2
TIME = np.arange(0.0, 3.01, 0.1)
GOALS = 0.3 * (1.0 - np.cos(np.pi * TIME / 3.0))[:, None] * [1.0, -0.4]


def played(
    goals: Array, *, late: int = -1, hold: int = 4, within: bool = False, looks: int = 1
) -> tuple[Bench, StreamPlayer]:
    """A goal every 100 cycles; at goal ``late`` nobody looks for ``hold`` goals.

    ``looks``: so often at a time.
    """
    bench = Bench([0.0, 0.0], LIMITS)
    player = StreamPlayer(bench.host, period=0.1, stop_within=within)
    for k, goal in enumerate(goals[1:]):
        player.push(goal)
        if k == len(goals) - 2:
            player.end()
        for cycle in range(100):
            bench.kernel.step()
            bench.rows.append(bench.now())
            if cycle % 4 == 0 and not late <= k < late + hold:
                for _ in range(looks):
                    player.update()
    for _ in range(20_000):
        if player.done:
            return bench, player
        bench.kernel.step()
        bench.rows.append(bench.now())
        player.update()
    raise AssertionError(player.report)


def test_a_stream_is_played_without_a_dip() -> None:
    """Each goal is passed within 5e-4 of the way, no dip, limits kept, no lag."""
    bench, player = played(GOALS)
    assert player.report.passed == len(GOALS) - 1
    assert player.report.largest_lag <= 2 * T
    for goal in GOALS:
        assert np.abs(bench.positions - goal).max(axis=1).min() <= 5e-4
    assert [dips(v) for v in np.diff(bench.positions, axis=0).T] == [0, 0]
    keeps(bench.positions, LIMITS)
    np.testing.assert_array_equal(bench.positions[-1], GOALS[-1])


def test_stop_within_is_played_too() -> None:
    """Slower, never past a goal, the same end."""
    bench, player = played(GOALS, within=True)
    assert player.report.starved == 0
    keeps(bench.positions, LIMITS)
    assert bench.positions[:, 0].max() == GOALS[-1, 0]
    np.testing.assert_array_equal(bench.positions[-1], GOALS[-1])


def test_a_host_that_is_held_up_goes_on_from_where_its_plan_has_come() -> None:
    """No piece for 400 cycles in full motion: limits kept, a lag, no turn, then to the end."""
    bench, player = played(GOALS, late=12)
    assert player.report.largest_lag > 0.0
    assert player.report.reversals.max() == 0
    assert (np.diff(bench.positions[:, 0]) >= 0.0).all()
    keeps(bench.positions, LIMITS)
    np.testing.assert_array_equal(bench.positions[-1], GOALS[-1])


@pytest.mark.parametrize(("late", "hold"), [(12, 20), (30, 16)])
def test_a_host_that_was_away_is_in_time_again(late: int, hold: int) -> None:
    """No piece for so many goals, at rest meanwhile: every goal passed, the end when it is due."""
    time = np.arange(0.0, 6.01, 0.1)
    goals = 0.3 * (1.0 - np.cos(np.pi * time / 6.0))[:, None] * [1.0, -0.4]
    bench, player = played(goals, late=late, hold=hold)
    assert player.report.passed == player.report.goals
    assert player.report.largest_lag > 0.1
    assert player.report.reversals.max() == 0
    keeps(bench.positions, LIMITS)
    usual, _ = played(goals)
    assert abs(len(bench.rows) - len(usual.rows)) <= 50


def test_a_piece_that_the_kernel_has_not_answered_is_no_lag() -> None:
    """Looks between two cycles of the kernel change nothing: bit for bit the same motion."""
    bench, _ = played(GOALS)
    more, player = played(GOALS, looks=3)
    np.testing.assert_array_equal(more.positions, bench.positions)
    assert player.report.largest_lag <= 2 * T


def test_a_goal_that_is_refused_changes_nothing() -> None:
    """Also while a piece is unanswered: the goals before and behind are played."""
    bench = Bench([0.0, 0.0], LIMITS)
    player = StreamPlayer(bench.host, period=0.1)
    for k, goal in enumerate(GOALS[1:]):
        player.push(goal, 0.1 * k)
        with pytest.raises(InputError, match="time"):
            player.push(goal, 0.1 * k)
        for _ in range(25):
            bench.kernel.step(4)
            player.update()
            with pytest.raises(InputError, match="time"):
                player.push(goal, 0.1 * k)
    player.end()
    while not player.done:
        bench.kernel.step(4)
        player.update()
    assert player.report.passed == player.report.goals == len(GOALS) - 1
    np.testing.assert_array_equal(bench.now(), GOALS[-1])


def test_a_stream_begins_at_rest() -> None:
    """Of an axis in motion it is refused, by name; another one may have one, and later all."""
    bench = Bench([0.0, 0.0], LIMITS)
    move = bench.host.move({1: 0.5})
    bench.kernel.step(50)
    for axes in (None, [1], [0, 1]):
        with pytest.raises(InputError, match="axes = 1: must be at rest"):
            StreamPlayer(bench.host, period=0.1, axes=axes)
    StreamPlayer(bench.host, period=0.1, axes=[0])
    while not move.done:
        bench.kernel.step(10)
    StreamPlayer(bench.host, period=0.1)


def test_what_is_refused() -> None:
    """As by the stream."""
    bench = Bench([0.0, 0.0], LIMITS)
    with pytest.raises(InputError, match="ahead"):
        StreamPlayer(bench.host, period=0.1, ahead=0.0)
    player = StreamPlayer(bench.host, period=0.1)
    with pytest.raises(InputError):
        player.push([0.0])


def test_cycles_that_the_kernel_leaves_out_are_made_up() -> None:
    """A kernel that leaves out 10 % of its cycles: the stream passes its last goal in time."""
    bench = Bench([0.0, 0.0], LIMITS)
    player = StreamPlayer(bench.host, period=0.1)
    begun, skipped = bench.host.feedback().cycle, 0
    for k, goal in enumerate(GOALS[1:]):
        player.push(goal, 0.1 * k)
        if k == len(GOALS) - 2:
            player.end()
        for cycle in range(90):
            bench.kernel.step()
            if cycle % 4 == 0:
                player.update()
        bench.kernel._kernel.feedback.late += 10  # as a clock that comes too late does
        skipped += 10
    while not player.done:
        bench.kernel.step()
        player.update()
    took = bench.host.feedback().cycle - begun + skipped
    assert took * T <= 0.1 * (len(GOALS) - 1) + 4 * 0.1 + 2 * 0.05 + 0.15


def test_a_stream_by_the_clock_on_a_kernel_that_is_held_up() -> None:
    """A kernel's process stopped for 30 ms every 0.2 s: all goals passed, no turn, the end.

    What this costs in time is judged in virtual time.
    """
    axes = [Axis(limit, 1e6) for limit in LIMITS]
    with MotionKernel(axes, T) as kernel, kernel.host() as host:
        host.enable()
        with StreamPlayer(host, period=0.05, delay=6, ahead=0.1) as player:
            goals = 0.3 * (1.0 - np.cos(np.linspace(0.0, np.pi, 61)))[:, None] * [1.0, -0.4]
            before, start = host.feedback().timing.late, time.monotonic()
            for k, goal in enumerate(goals[1:]):
                while time.monotonic() - start < 0.05 * k:
                    time.sleep(1e-3)
                player.push(goal, 0.05 * (k + 1))
                if k % 4 == 3:
                    os.kill(kernel.pid or 0, signal.SIGSTOP)
                    time.sleep(0.03)
                    os.kill(kernel.pid or 0, signal.SIGCONT)
            player.end()
            player.wait(60.0)
            frame = host.feedback()
    assert [axis.position for axis in frame.axes] == goals[-1].tolist()
    assert frame.timing.late - before >= 15 * 20
    assert player.report.reversals.max() == 0
    assert player.report.passed == player.report.goals == 60


def test_the_first_goal_chooses_the_turn_of_an_axis_that_wraps() -> None:
    """One and a half turns on, goals from half a turn on: the nearest; the other axis as it is."""
    kernel = MotionKernel([Axis(LIMITS[0], 1e6, wrap=1.0), Axis(LIMITS[0], 1e6)], T)
    host = kernel.host()
    host.enable()
    kernel.step(10)
    move = host.move([1.5, 0.0])
    while not move.done:
        kernel.step(50)
    player = StreamPlayer(host, period=0.1)
    goals = np.column_stack([0.5 + np.linspace(0.0, 0.4, 12), np.linspace(0.0, 0.4, 12)])
    for k, goal in enumerate(goals[1:]):
        player.push(goal)
        if k == len(goals) - 2:
            player.end()
        for _ in range(25):
            kernel.step(4)
            player.update()
    while not player.done:
        kernel.step(4)
        player.update()
    assert [a.position for a in host.feedback().axes] == [pytest.approx(1.9, abs=1e-12), 0.4]
