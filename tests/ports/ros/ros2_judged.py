"""Unmodified clients of ROS 2 judge the trajectory controller: ``./run test-ros2``.

Each node is a program of its own with a kernel in a process of its own; the clients are rclpy's
action, service, parameter and topic clients in this process, on an isolated domain. What each of
these modules judges: docs/explanation/ros.md.
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from action_msgs.msg import GoalStatus
from cobot_msgs.srv import CobotApiSrv
from control_msgs.msg import JointTolerance, SpeedScalingFactor
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import DurabilityPolicy, QoSProfile
from sjerk_msgs.msg import MotionState
from std_srvs.srv import SetBool, Trigger

from helpers.ros2_clients import Arm, Stalls, action_goal_of, attacked, servo
from helpers.ros_goals import Goal, right, wrong
from helpers.ros_robot import LIMITS, NAMES, SCALE, Commands, monitor_of
from sjerk import Monitor

TESTS = Path(__file__).resolve().parents[2]

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
    """At 20 random moments: never CANCELED while it moves, limits kept, and no slow way to rest.

    How long the stop takes is counted in cycles, from the first whose time runs slower on the path,
    and compared with v / a of the joint that takes longest.
    """
    draw, ratios = np.random.default_rng(2), []
    with monitor_of(arm.kernel) as monitor:
        for _ in range(20):
            target = 1.0 if arm.position()[0] < 0.5 else 0.0
            with Commands(arm.kernel) as commands:
                goal = arm.send([[target, -target, target]], [1.5])
                at = 0.05 + 0.9 * draw.random()
                begun = abs(arm.position()[1])
                arm.moves()
                arm.client.until(
                    lambda share=at, b=begun: (
                        abs(abs(monitor.feedback().axes[1].position) - b) > share
                        or not monitor.feedback().moving
                    )
                )
                answer = arm.client.wait(goal.cancel_goal_async())
                status, code, _ = arm.result(goal)
                assert not monitor.feedback().moving
            if not answer.goals_canceling:  # it had arrived
                continue
            assert (status, code) == (GoalStatus.STATUS_CANCELED, 0)
            assert commands.within()
            ratio = stop_compared(commands)
            if ratio:
                ratios.append(ratio)
    print("stop / (v / a): median", np.median(ratios), "largest", max(ratios), len(ratios))
    assert len(ratios) >= 10
    assert np.median(ratios) <= 1.4


def stop_compared(commands: Commands) -> float | None:
    """Time of the last braking over v / a of the joint that takes longest; None: hardly moved."""
    speed = np.abs(commands.velocity[commands.moving()])
    peak = int(speed[:, 1].argmax())
    falling = np.flatnonzero(np.diff(speed[peak:, 1]) < 0.0)
    begin = peak + int(falling[0])
    if speed[begin].max() < 0.2:
        return None
    least = float(speed[begin].max()) / LIMITS["acceleration"]
    return (len(speed) - begin) * 1e-3 / least


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


def test_deferred_goals_follow_each_other_without_a_stop(arm: Arm) -> None:
    """Sixty at 10 Hz, each to begin 50 ms later: no stop, and near the way that they tell."""
    amplitude, pace, period = 0.3, 1.0, 0.1

    def wanted(t: Any) -> Any:
        return amplitude * (1 - np.cos(pace * np.maximum(t, 0.0)))

    goals: list[Any] = []
    began = time.time() + 0.3

    def send(now: float) -> None:
        at = np.arange(1, 11) * 0.1
        rows = np.repeat(wanted(now + 0.05 + at - began)[:, None], 3, axis=1)
        goal = Goal(NAMES, at.tolist(), rows.tolist(), [[] for _ in at], stamp=now + 0.05)
        goals.append(arm.action.send_goal_async(action_goal_of(goal)))

    offset = time.time() - time.monotonic()
    with Commands(arm.kernel) as commands, Stalls(arm.client, arm.kernel, "/joint_states") as stood:
        stood.gaps = servo(arm.client, send, 1.0 / period, 60 * period)
        handles = [arm.client.wait(goal) for goal in goals]
        results = [arm.result(handle)[1] for handle in handles if handle.accepted]
    print("refused", len(goals) - len(results), "stood still", stood.longest)
    assert set(results[:-1]) <= {-1}
    assert results[-1] == 0
    assert commands.within()
    t = commands.time + offset - began
    under_way = (t > 1.0) & (t < 60 * period - 0.5)
    if stood.longest < 0.05:  # a goal that comes after its begin is refused, and rightly so
        assert len(results) == 60
        turns = np.abs(np.sin(pace * t)) < 0.3  # those of the cosine are no stops
        assert np.abs(commands.velocity[under_way & ~turns]).min() > 0.0
    off = np.abs(commands.position[:, 1] - wanted(t))[under_way].max()
    print("off", off)
    assert off <= 0.01 + 2.0 * amplitude * pace * stood.longest


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

    goal = arm.send([[0.0, 0.4, 0.0], [0.5, 0.0, 0.0]], [1.0, 2.0])
    for bad in (
        {"execution_mode": "bogus"},
        {"speed": -1.0},
        {"speed": "fast"},
        {"joints": ["a"]},
        {"constraints__nowhere__goal": 1.0},
        {"resampling_delta": 0.53},  # the axes have different units
        {"tolerance": 0.01},  # the axes have different units
        {"invalid_goals": "sometimes"},
    ):
        [answer] = put(**bad)
        assert not answer.successful
        assert answer.reason
    # the two that the cobot's users set at run time
    assert all(a.successful for a in put(execution_mode="single_point", resampling_delta=0.0))
    with Commands(arm.kernel) as commands:
        assert arm.result(goal)[1] == 0
        at_end = commands
    # the goal under way keeps the mode that it began with: it goes by 0.4 of the second joint
    assert at_end.position[:, 1].max() > 0.39
    with Commands(arm.kernel) as commands:
        assert arm.result(arm.send([[0.2, 0.4, 0.0], [0.0, 0.0, 0.0]], [1.0, 2.0]))[1] == 0
    assert np.abs(commands.position[:, 1]).max() == 0.0  # the next one goes to its last point alone
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
    bad = [
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
    refused = [arm.send(rows, times, **options).accepted for rows, times, options in bad]
    assert refused == [False] * len(bad)
    assert arm.result(running_goal)[:2] == (GoalStatus.STATUS_SUCCEEDED, 0)


def test_random_wrong_goals_change_no_bit_of_what_moves(arm: Arm) -> None:
    """By action and topic, fields of any size, nan, huge: the motion is that without them."""
    assert attacked(arm, count=200, seconds=4.0) >= 200


def test_random_right_goals_each_have_one_result(arm: Arm) -> None:
    """Replacing each other, with wrong ones between: the limits hold, the last one arrives."""
    draw = np.random.default_rng(12)
    with Commands(arm.kernel) as commands:
        results, last = [], None
        for _ in range(40):
            if draw.random() < 0.3:
                kind, goal = wrong(draw, arm.position())
                refused = arm.client.wait(arm.action.send_goal_async(action_goal_of(goal)))
                assert not refused.accepted, kind
                continue
            goal = right(draw, arm.position())
            handle = arm.client.wait(arm.action.send_goal_async(action_goal_of(goal)))
            if handle.accepted:
                results.append(handle)
                last = goal
            arm.client.spin(0.2 * draw.random())
        told = [arm.result(handle) for handle in results]
    assert [code for _, code, _ in told] == [-1] * (len(told) - 1) + [0]
    assert commands.within()
    assert last is not None
    order = [last.names.index(name) for name in NAMES]
    assert commands.position[-1] == pytest.approx(np.array(last.positions[-1])[order], abs=1e-12)


def test_a_client_that_vanishes_leaves_its_goal_to_its_end(arm: Arm) -> None:
    """Killed in motion: the goal goes on to its end, and the next client is served."""
    code = "import sys; from helpers.ros2_vanish import main; main(*sys.argv[1:])"
    words = [sys.executable, "-c", code, arm.name, os.environ["ROS_DOMAIN_ID"]]
    child = subprocess.Popen(words, env=os.environ | {"PYTHONPATH": str(TESTS)})
    try:
        with monitor_of(arm.kernel) as monitor:
            arm.client.until(lambda: monitor.feedback().axes[0].position > 0.1 * SCALE[0])
            child.kill()
            child.wait()
            arm.client.until(lambda: not monitor.feedback().moving)
            assert monitor.feedback().axes[0].position == 0.8 * SCALE[0]
    finally:
        child.kill()
        child.wait()
    assert arm.result(arm.send([[0.1, 0.0, 0.0]], [0.5]))[:2] == (GoalStatus.STATUS_SUCCEEDED, 0)


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
