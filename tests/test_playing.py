"""A goal stream in a kernel: what the library hands out, with a stop behind it at all times."""

from __future__ import annotations

import numpy as np
import pytest

from following_check import Array, T
from path_check import Bench, keeps
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
    """Every goal stands in the recording, no dip, limits kept, no lag."""
    bench, player = played(GOALS)
    assert player.report.met == len(GOALS) - 1
    assert player.report.largest_lag <= 2 * T
    for goal in GOALS:
        assert (bench.positions == goal).all(axis=1).any()
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


def test_a_host_that_is_held_up_stops_and_goes_on() -> None:
    """No piece for 400 cycles in full motion: at rest within the limits, told, then to the end."""
    bench, player = played(GOALS, late=12)
    assert player.report.starved >= 1
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
