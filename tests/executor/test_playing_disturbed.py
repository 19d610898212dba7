"""A stream in a kernel that nobody waits for: late looks, late pieces, cycles left out."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from unittest import mock

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.following_check import Array, T
from helpers.path_check import Bench, keeps
from sjerk import GoalStream, Host, Limits, Path, StreamPlayer
from sjerk.host.link import Link
from sjerk.host.path_feeder import PathFeeder

LIMITS = [Limits(2.0, 4.0, 200.0)] * 2


class Machine:
    """A kernel that goes on while its host plans, and leaves out cycles; drawn from ``seed``.

    ``often``: the share of the host's steps in which it is held up; ``hold``: for so many cycles at
    most; ``left_out``: the share of cycles that the clock leaves out.
    """

    def __init__(self, seed: int, *, often: float, hold: int, left_out: float) -> None:
        self.bench = Bench([0.0, 0.0], LIMITS)
        self.draw = np.random.default_rng(seed)
        self.often, self.hold, self.left_out = often, hold, left_out
        self.left = 0
        self.ended = self.due = 0  # by the clock

    def step(self, cycles: int) -> None:
        """So many cycles, some of which are left out."""
        while cycles > 0:
            if self.draw.random() < self.left_out / 20.0:
                out = min(int(self.draw.integers(1, 40)), cycles)
                self.bench.kernel._kernel.feedback.late += out  # as a clock that comes too late
                self.left += out
                cycles -= out
                continue
            self.bench.kernel.step()
            self.bench.rows.append(self.bench.now())
            if self.bench.rows[-1] != self.bench.rows[-2]:
                self.ended = self.clock
            cycles -= 1

    @property
    def clock(self) -> int:
        """Cycles so far, also those left out."""
        return len(self.bench.rows) + self.left

    def held_up(self) -> None:
        """What happens while the host computes, or does not."""
        if self.draw.random() < self.often:
            self.step(int(self.draw.integers(1, self.hold + 1)))

    @contextmanager
    def slow(self) -> Iterator[None]:
        """Whatever the player does takes time, in which the kernel goes on."""
        with (
            mock.patch.object(Host, "feedback", self._then(Host.feedback)),
            mock.patch.object(GoalStream, "take", self._then(GoalStream.take)),
            mock.patch.object(Path, "splice", self._then(Path.splice)),
            mock.patch.object(PathFeeder, "pump", self._then(PathFeeder.pump)),
            mock.patch.object(Link, "take_back", self._then(Link.take_back)),
            mock.patch.object(Link, "publish_records", self._then(Link.publish_records)),
        ):
            yield

    def _then(self, real: Any) -> Any:
        def call(*args: Any, **options: Any) -> Any:
            self.held_up()
            found = real(*args, **options)
            self.held_up()
            return found

        return call


def played(machine: Machine, goals: Array, **options: Any) -> StreamPlayer:
    """A goal every 100 cycles, a look every 4, on this machine."""
    bench = machine.bench
    player = StreamPlayer(bench.host, period=0.1, **options)
    with machine.slow():
        for k, goal in enumerate(goals[1:]):
            due = machine.clock + 100
            if k == 0:
                machine.due = machine.clock + 100 * (len(goals) - 2) + 400 + 2 * 50
            player.push(goal, 0.1 * k)
            if k == len(goals) - 2:
                player.end()
            while machine.clock < due:
                machine.step(4)
                player.update()
            if options.get("stop_within"):
                assert (np.abs(bench.rows[-1]) <= np.abs(goals[: k + 2]).max(axis=0)).all()
        for _ in range(5_000):
            if player.done:
                return player
            machine.step(4)
            player.update()
    raise AssertionError(player.report)


def turns(way: Array) -> int:
    """Changes of direction; a step of less than 1e-9 of the velocity's limit is none."""
    step = np.diff(way)
    step = np.sign(step[np.abs(step) > 1e-9 * LIMITS[0].velocity * T])
    return int((step[1:] != step[:-1]).sum())


@settings(max_examples=15)
@given(
    st.integers(0, 2**32),
    st.booleans(),
    st.sampled_from([0.05, 0.3, 1.0]),
    st.sampled_from([5, 40, 150]),
    st.sampled_from([0.0, 0.1, 0.3]),
    st.integers(0, 2),
)
def test_a_stream_turns_no_more_often_than_its_goals_whatever_is_late(
    seed: int, within: bool, often: float, hold: int, left_out: float, bends: int
) -> None:
    """Pieces that come too late, at any place: no turn, limits kept, all passed, the exact end.

    By the clock, which goes on in cycles that are left out, it ends when that is due, and the lag
    that is told and a start from rest, of a host that is held up in each of its steps, later.
    """
    machine = Machine(seed, often=often, hold=hold, left_out=left_out)
    share = np.linspace(0.0, 1.0, 25)
    way = (1.0 - np.cos(np.pi * (bends + 1) * share)) * 0.3 / (bends + 1)
    goals = way[:, None] * [1.0, -0.4]
    player = played(machine, goals, stop_within=within)
    rows = machine.bench.positions
    assert [turns(row) for row in rows.T] == [bends, bends]
    assert player.report.reversals.max() == 0
    assert player.report.passed == player.report.goals == 24
    keeps(rows, LIMITS)
    np.testing.assert_array_equal(rows[-1], goals[-1])
    due = machine.ended - machine.due
    assert due * T <= player.report.lag + 1.0 + 12 * hold * T, (due, player.report.lag)
