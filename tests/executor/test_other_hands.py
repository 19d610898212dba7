"""Other hands beside an executor: stops and moves of the host, stops of other processes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_executor import NAMES, TIME, WAY, Machine, smooth

from helpers.path_check import PANDA, keeps
from sjerk import Trajectory
from sjerk._binding import lib
from sjerk.executor import GoalStatus, ResultCode


def by_monitor(machine: Machine, quick: bool) -> None:
    """What a stop of another process leaves in the memory."""
    base = machine.kernel.core.segment
    lib.sj_stop_claim(base, 3, 4711)
    lib.sj_stop_request(base, 3, 0 if quick else 1, 1 if quick else 0)


HANDS: dict[str, Callable[[Machine], object]] = {
    "halt": lambda machine: machine.host.halt(),
    "halt of one": lambda machine: machine.host.halt(axes=3),
    "quick stop": lambda machine: machine.host.quick_stop(),
    "quick stop of one": lambda machine: machine.host.quick_stop(axes=3),
    "halt beside": lambda machine: by_monitor(machine, quick=False),
    "quick stop beside": lambda machine: by_monitor(machine, quick=True),
    "move": lambda machine: machine.host.move([0.02] * 7),
    "move of one": lambda machine: machine.host.move({2: -0.03}),
    "move that is refused": lambda machine: machine.host.move({2: 1e11}, relative=True),
}


@settings(max_examples=15)
@given(
    hand=st.sampled_from(sorted(HANDS)),
    moment=st.integers(0, 1300),
    after=st.one_of(st.just(0), st.integers(1, 600)),
    stamped=st.booleans(),
    size=st.floats(-0.3, 0.3),
)
def test_the_first_goal_after_another_hand_runs(
    hand: str, moment: int, after: int, stamped: bool, size: float
) -> None:
    """Whatever ended the motion before, in play or long over: from rest, within the limits."""
    machine = Machine()
    first = machine.executor.submit(smooth())
    machine.cycles(moment)
    HANDS[hand](machine)
    machine.cycles(after if "beside" not in hand else max(after, 1))
    if "quick" in hand:  # until its end goals are refused
        machine.cycles(1)
        machine.until(lambda: all(a.state.name != "STOPPING" for a in machine.host.feedback().axes))
    ends = size * np.linspace(1.0, -1.0, 7)
    rise = 0.5 * (1.0 - np.cos(np.pi * TIME))[:, None]
    goal = machine.executor.submit(
        Trajectory(NAMES, 0.5 + TIME, rise * ends),
        stamp=machine.time() + 0.05 if stamped else 0.0,
    )
    positions = machine.finish(goal)
    assert goal.status is GoalStatus.SUCCEEDED, goal.text
    np.testing.assert_array_equal(positions[-1], rise[-1] * ends)
    if "quick" not in hand:
        keeps(positions, PANDA)
    assert first.status in (GoalStatus.SUCCEEDED, GoalStatus.ABORTED)


@pytest.mark.parametrize("hand", ["halt", "quick stop beside"])
def test_a_goal_that_waits_when_another_hand_stops_is_aborted(hand: str) -> None:
    """It was given before the stop: nothing begins after it by itself."""
    machine = Machine()
    machine.executor.submit(smooth())
    machine.cycles(300)
    goal = machine.executor.submit(smooth(position=0.5 * WAY), stamp=machine.time() + 0.5)
    machine.cycles(100)
    assert goal.status is GoalStatus.WAITING
    HANDS[hand](machine)
    machine.finish(goal)
    assert (goal.status, goal.code) == (GoalStatus.ABORTED, ResultCode.INVALID_GOAL)
    machine.cycles(800)
    rest = machine.positions[-1]
    machine.cycles(300)
    np.testing.assert_array_equal(machine.positions[-1], rest)
