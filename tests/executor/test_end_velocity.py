"""Velocities at the end of a trajectory: what planners leave of 0 is 0, what is more is refused."""

from __future__ import annotations

from importlib.resources import files

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_executor import NAMES, PANDA, TIME, WAY, Machine, smooth

from helpers.path_check import keeps
from sjerk import Trajectory
from sjerk.executor import GoalStatus, ResultCode
from sjerk.trajectory import FaultKind

SHIPPED = Trajectory.from_bag(str(files("sjerk") / "data" / "panda.mcap"))
RATE = 0.1 * np.pi * np.sin(np.pi * TIME)[:, None] * np.linspace(1.0, -0.5, 7)


def test_the_plan_that_sjerk_ships_is_played() -> None:
    """Its last velocities are 6.9e-18 and the like: what rounding has left of 0."""
    assert SHIPPED.velocity is not None
    assert SHIPPED.velocity[-1].any()
    assert not SHIPPED.faults()
    machine = Machine(SHIPPED.position[0], use_velocities=True)
    machine.executor.change(speed=1.0)
    goal = machine.executor.submit(SHIPPED)
    assert goal.accepted, goal.text
    positions = machine.finish(goal)
    assert goal.status is GoalStatus.SUCCEEDED
    np.testing.assert_array_equal(positions[-1], SHIPPED.position[-1])


@settings(max_examples=10)
@given(
    share=st.floats(-2e-4, 2e-4),
    joint=st.integers(0, 6),
    allowed=st.booleans(),
    given_velocities=st.booleans(),
)
def test_an_end_velocity_up_to_a_ten_thousandth_of_the_limit_is_an_end(
    share: float, joint: int, allowed: bool, given_velocities: bool
) -> None:
    """Played to rest within all limits; more than that is refused with joint, value and limit."""
    velocity = RATE.copy()
    velocity[-1] = 0.0
    velocity[-1, joint] = share * PANDA[joint].velocity
    machine = Machine(use_velocities=given_velocities, allow_end_velocity=allowed)
    goal = machine.executor.submit(smooth(velocity=velocity))
    if abs(share) > 1e-4 and not allowed:
        assert (goal.status, goal.code) == (GoalStatus.REJECTED, ResultCode.INVALID_GOAL)
        assert NAMES[joint] in goal.text
        assert "velocity" in goal.text
        return
    assert goal.accepted, goal.text
    positions = machine.finish(goal)
    machine.cycles(3)
    keeps(machine.positions, PANDA)
    np.testing.assert_array_equal(positions[-1], WAY[-1])


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_without_limits_it_is_a_share_of_the_largest(scale: float) -> None:
    """In any unit."""
    for share, ends in ((0.9e-4, True), (1.1e-4, False)):
        rate = scale * np.array([[0.0], [2.0], [2.0 * share]])
        way = Trajectory(["a"], [0.0, 1.0, 2.0], [[0.0], [1.0], [2.0]], rate)
        kinds = [fault.kind for fault in way.faults()]
        assert kinds == ([] if ends else [FaultKind.END_VELOCITY])
