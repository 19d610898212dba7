"""Unmodified clients of ROS 2 judge the trajectory controller: ``./run test-ros2``.

Each node is a program of its own with a kernel in a process of its own; the clients are rclpy's
action, service, parameter and topic clients in this process, on an isolated domain. What each of
these modules judges: docs/explanation/ros.md.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import rclpy
from action_msgs.msg import GoalStatus
from cobot_msgs.srv import CobotApiSrv
from control_msgs.msg import JointTolerance, SpeedScalingFactor
from helpers.ros2_clients import Arm
from helpers.ros_robot import NAMES, SCALE
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import DurabilityPolicy, QoSProfile
from sjerk_msgs.msg import MotionState
from std_srvs.srv import SetBool, Trigger

from sjerk import Monitor

pytest_plugins = ["helpers.ros2_fixtures"]


def test_a_plan_arrives_in_its_time_whatever_the_order_of_joints(arm: Arm) -> None:
    """A wave through 21 points; feedback of it comes on the way; each unit is its own."""
    t = np.linspace(0.1, 2.1, 21)
    rows = 0.3 * np.column_stack([np.sin(t - 0.1), np.cos(t - 0.1) - 1, np.sin(t - 0.1) ** 2])
    seen: list[Any] = []
    goal = arm.send(rows[:, ::-1], t, NAMES[::-1], feedback=lambda m: seen.append(m.feedback))
    assert goal.accepted
    assert arm.result(goal)[:2] == (GoalStatus.STATUS_SUCCEEDED, 0)
    arm.arrives(rows[-1])
    assert len(seen) > 10
    assert seen[-1].joint_names == NAMES[::-1]
    assert max(np.abs(m.error.positions).max() for m in seen) < 0.01


def test_a_canceled_goal_is_told_at_rest(arm: Arm) -> None:
    """At random moments of a motion: never CANCELED while it moves."""
    with Monitor.attach(arm.kernel) as monitor:
        for share in (0.1, 0.4, 0.8):
            target = 1.0 if arm.position()[0] < 0.5 else 0.0
            goal = arm.send([[target, -target, target]], [1.5])
            arm.client.until(lambda s=share: abs(monitor.feedback().axes[1].velocity) > 0.5 * s)
            answer = arm.client.wait(goal.cancel_goal_async())
            assert len(answer.goals_canceling) == 1
            status, code, _ = arm.result(goal)
            assert not monitor.feedback().moving
            assert (status, code) == (GoalStatus.STATUS_CANCELED, 0)


def test_goals_replace_each_other_and_each_is_told(arm: Arm) -> None:
    """Forty at 20 Hz: all but the last aborted by name, no stop between them, the last arrives."""
    goals, moving = [], []
    with Monitor.attach(arm.kernel) as monitor:
        for k in range(1, 41):
            goals.append(arm.send([[0.02 * k, 0.0, 0.0]], [2.0]))
            arm.client.spin(0.05)
            moving.append(abs(monitor.feedback().axes[0].velocity))
    told = [arm.result(goal) for goal in goals]
    assert [code for _, code, _ in told] == [-1] * 39 + [0]
    assert all("replaced" in text for _, _, text in told[:-1])
    assert min(moving[8:]) > 0.0
    arm.arrives([0.8, 0.0, 0.0])


@pytest.mark.parametrize("service", ["quick_stop", "halt"])
def test_the_goal_after_a_stop_runs(arm: Arm, service: str) -> None:
    """The stop answers at rest, the goal under way is aborted, the next one is taken at once."""
    goal = arm.send([[1.0, 0.0, 0.0]], [8.0])
    arm.moves()
    assert arm.client.call(Trigger, f"/arm/{service}", Trigger.Request()).success
    with Monitor.attach(arm.kernel) as monitor:
        assert not monitor.feedback().moving
    assert arm.result(goal)[:2] == (GoalStatus.STATUS_ABORTED, -1)
    again = arm.send([[0.1, 0.0, 0.0]], [0.5])
    assert arm.result(again)[:2] == (GoalStatus.STATUS_SUCCEEDED, 0)


def test_hold_and_speed(arm: Arm) -> None:
    """On the path: 0 rests and goes on at 1; hold and resume likewise."""
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    speed = arm.client.node.create_publisher(
        SpeedScalingFactor, "/arm/speed_scaling_input", latched
    )
    goal = arm.send([[1.0, 0.0, 0.0]], [1.5])
    with Monitor.attach(arm.kernel) as monitor:
        arm.client.until(lambda: monitor.feedback().axes[0].position > 0.05 * SCALE[0])
        speed.publish(SpeedScalingFactor(factor=0.0))
        arm.client.until(lambda: monitor.feedback().axes[0].velocity == 0.0)
        at = monitor.feedback().axes[0].position
        assert 0.0 < at < 1.0 * SCALE[0]
        speed.publish(SpeedScalingFactor(factor=1.0))
        arm.client.until(lambda: monitor.feedback().axes[0].position > at)
        assert arm.client.call(SetBool, "/arm/hold", SetBool.Request(data=True)).success
        arm.client.until(lambda: monitor.feedback().axes[0].velocity == 0.0)
        assert arm.client.call(SetBool, "/arm/hold", SetBool.Request(data=False)).success
    assert arm.result(goal)[:2] == (GoalStatus.STATUS_SUCCEEDED, 0)


def test_parameters_change_while_a_goal_runs(arm: Arm) -> None:
    """What is wrong is refused with a reason; what is right holds from the next goal on."""
    parameters = AsyncParameterClient(arm.client.node, "/arm")
    arm.client.until(parameters.services_are_ready)

    def put(**values: Any) -> list[Any]:
        given = [
            rclpy.Parameter(name.replace("__", "."), value=value) for name, value in values.items()
        ]
        return list(arm.client.wait(parameters.set_parameters(given)).results)

    goal = arm.send([[0.5, 0.0, 0.0]], [1.0])
    for wrong in (
        {"execution_mode": "bogus"},
        {"speed": -1.0},
        {"speed": "fast"},
        {"joints": ["a"]},
        {"constraints__nowhere__goal": 1.0},
        {"tolerance": 0.01},  # the axes have different units
        {"invalid_goals": "sometimes"},
    ):
        [answer] = put(**wrong)
        assert not answer.successful
        assert answer.reason
    assert all(answer.successful for answer in put(execution_mode="single_point"))
    assert arm.result(goal)[1] == 0
    service = CobotApiSrv.Request(request_full_trajectory_mode=True, resampling_delta=-1.0)
    answer = arm.client.call(CobotApiSrv, "/cobot_api_service", service)
    assert not answer.success
    got = arm.client.wait(parameters.get_parameters(["execution_mode"])).values[0]
    assert got.string_value == "single_point"  # both or none
    service.resampling_delta = 0.0
    service.acknowledge_error = True
    assert arm.client.call(CobotApiSrv, "/cobot_api_service", service).success
    got = arm.client.wait(parameters.get_parameters(["execution_mode"])).values[0]
    assert got.string_value == "full_trajectory"


def test_wrong_goals_are_refused_and_what_moves_goes_on(arm: Arm) -> None:
    """Fifteen kinds."""
    running_goal = arm.send([[1.0, 0.0, 0.0]], [2.0])
    assert running_goal.accepted
    nan, row = math.nan, [0.1, 0.0, 0.0]
    bad_tolerance = [JointTolerance(name="nobody", position=1.0)]
    wrong = [
        ([], [], {}),
        ([row], [1.0], {"names": ["a", "b", "c"]}),
        ([row], [1.0], {"names": [NAMES[0]] * 3}),
        ([row], [1.0], {"names": NAMES[:2]}),
        ([[0.1]], [1.0], {"names": NAMES[:1]}),
        ([[nan, 0.0, 0.0]], [1.0], {}),
        ([[math.inf, 0.0, 0.0]], [1.0], {}),
        ([[0.1, 0.0]], [1.0], {}),
        ([row, row], [1.0, 1.0], {}),
        ([row, row], [1.0, 0.5], {}),
        ([[9.0, 0.0, 0.0]], [1.0], {}),
        ([[0.0, -9.0, 0.0]], [1.0], {}),
        ([row], [-1.0], {}),
        ([row], [1.0], {"path_tolerance": bad_tolerance}),
        ([row], [1.0], {"goal_tolerance": [JointTolerance(name=NAMES[0], position=-2.0)]}),
    ]
    refused = [arm.send(rows, times, **options).accepted for rows, times, options in wrong]
    assert refused == [False] * len(wrong)
    assert arm.result(running_goal)[:2] == (GoalStatus.STATUS_SUCCEEDED, 0)


def test_a_refusal_can_be_told_as_a_result(arm: Arm) -> None:
    """``invalid_goals`` abort: the client gets code and text."""
    parameters = AsyncParameterClient(arm.client.node, "/arm")
    arm.client.until(parameters.services_are_ready)
    for value in ("abort", "reject"):
        changed = [rclpy.Parameter("invalid_goals", value=value)]
        assert arm.client.wait(parameters.set_parameters(changed)).results[0].successful
        goal = arm.send([[0.1, 0.0, 0.0]], [1.0], ["a", "b", "c"])
        assert goal.accepted == (value == "abort")
        if goal.accepted:
            status, code, text = arm.result(goal)
            assert (status, code) == (GoalStatus.STATUS_ABORTED, -2)
            assert "'a'" in text or "a" in text


def test_deactivate_and_activate(arm: Arm) -> None:
    """The goal is told why, later ones are refused, and after activate the next one runs."""
    goal = arm.send([[1.0, 0.0, 0.0]], [8.0])
    arm.moves()

    def change(number: int) -> bool:
        request = ChangeState.Request(transition=Transition(id=number))
        return bool(arm.client.call(ChangeState, "/arm/change_state", request).success)

    assert change(Transition.TRANSITION_DEACTIVATE)
    status, code, text = arm.result(goal)
    assert (status, code) == (GoalStatus.STATUS_ABORTED, -1)
    assert "deactivated" in text
    assert not arm.send([[0.1, 0.0, 0.0]], [0.5]).accepted
    assert change(Transition.TRANSITION_ACTIVATE)
    again = arm.send([[0.1, 0.0, 0.0]], [0.5])
    assert arm.result(again)[:2] == (GoalStatus.STATUS_SUCCEEDED, 0)


def test_the_motion_state_is_one_cycle(arm: Arm) -> None:
    """All joints of the same cycle, in radians and metres."""
    seen: list[Any] = []
    arm.client.node.create_subscription(MotionState, "/arm/motion_state", seen.append, 10)
    arm.client.until(lambda: len(seen) > 2)
    assert seen[-1].name == NAMES
    assert seen[-1].cycle > seen[0].cycle
    assert list(seen[-1].settled) == [True] * 3
