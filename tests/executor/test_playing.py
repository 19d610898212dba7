"""A goal stream in a kernel: what the library hands out, with a stop behind it at all times."""

from __future__ import annotations

import numpy as np
import pytest

from helpers.following_check import Array, T
from helpers.path_check import Bench, keeps
from sjerk import InputError, Limits, StreamPlayer
from sjerk.cli.demo import dips

LIMITS = [Limits(2.0, 4.0, 200.0)] * 2
TIME = np.arange(0.0, 3.01, 0.1)
GOALS = 0.3 * (1.0 - np.cos(np.pi * TIME / 3.0))[:, None] * [1.0, -0.4]


def played(goals: Array, *, late: int = -1, within: bool = False) -> tuple[Bench, StreamPlayer]:
    """A goal every 100 cycles; at goal ``late`` nobody looks for 400 cycles."""
    bench = Bench([0.0, 0.0], LIMITS)
    player = StreamPlayer(bench.host, period=0.1, stop_within=within)
    for k, goal in enumerate(goals[1:]):
        player.push(goal)
        if k == len(goals) - 2:
            player.end()
        for cycle in range(100):
            bench.kernel.step()
            bench.rows.append(bench.now())
            if cycle % 4 == 0 and not late <= k < late + 4:
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
