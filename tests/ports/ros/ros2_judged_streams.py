"""Unmodified publishers of ROS 2 judge what comes by topic: ``./run test-ros2``."""

from __future__ import annotations

import json
import math
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from helpers.ros2_clients import Arm, Client, servo
from helpers.ros_robot import LIMITS, NAMES, SCALE, monitor_of, running
from sjerk import Monitor

pytest_plugins = ["helpers.ros2_fixtures"]


# ---- streams by topic


def test_windows_of_a_servo_node_are_tracked(tmp_path: Path, client: Client) -> None:
    """Windows of 0.1 s at 100 Hz with velocities: off by at most 1 % of the amplitude."""
    more = ["--node-name", "servo", "--ros-args", "-p", "topic_mode:=track"]
    with running(tmp_path, "ros2", "controller", *more) as program:
        arm = Arm(client, "servo")
        publisher = client.node.create_publisher(JointTrajectory, "/servo/joint_trajectory", 10)
        client.until(lambda: publisher.get_subscription_count() == 1)
        began, off = time.time(), []
        amplitude, pace = 0.3, 0.75

        def wanted(t: float) -> tuple[float, float]:
            x = max(0.0, t - began)
            return (
                amplitude * (1 - math.cos(pace * x)),
                amplitude * pace * math.sin(pace * x),
            )

        with Monitor.attach(program.kernel) as monitor:

            def publish(now: float) -> None:
                message = JointTrajectory(joint_names=NAMES)
                stamp = message.header.stamp
                stamp.sec, stamp.nanosec = int(now), int(now % 1 * 1e9)
                for k in range(11):
                    q, v = wanted(now + 0.01 * k)
                    point = JointTrajectoryPoint(positions=[q] * 3, velocities=[v] * 3)
                    point.time_from_start.nanosec = k * 10_000_000
                    message.points.append(point)
                publisher.publish(message)
                if now - began > 1.0:
                    frame = monitor.feedback()
                    age = frame.age or 0.0
                    q, _ = wanted(time.time() - age)
                    off.append(abs(frame.axes[1].position - q))

            servo(client, publish, 100.0, 4.0)
            client.until(lambda: not monitor.feedback().moving)
        print(json.dumps({"off_median": float(np.median(off)), "off_most": max(off)}))
        assert np.median(off) <= 0.01 * amplitude
        assert arm.states


# ---- the control node

#: Apart from what controllers beside it publish.
GOALS = ["-p", "goal_topic:=/goals"]


@pytest.mark.parametrize("mode", ["interrupt", "stream", "track"])
def test_joint_states_are_goals(tmp_path: Path, client: Client, mode: str) -> None:
    """At 10 Hz in degrees turned to radians: none lost, the end is the last one, bit for bit."""
    count = 30
    way_ = 0.6 * (1 - np.cos(np.linspace(0, math.pi, count))) / 2
    more = ["--ros-args", "-p", f"mode:={mode}", "-p", "read_rate:=500.0", *GOALS]
    with running(tmp_path, "ros2", "control", *more) as program:
        states: list[Any] = []
        topic = "/sjerk_control_node/joint_states"
        client.node.create_subscription(JointState, topic, states.append, 10)
        publisher = client.node.create_publisher(JointState, "/goals", 10)
        client.until(lambda: states and publisher.get_subscription_count() == 1)
        rows = iter(way_)

        def publish(now: float) -> None:
            q = float(next(rows))
            message = JointState(name=["gripper", *NAMES[::-1]], position=[9.9, q, q, q])
            stamp = message.header.stamp
            stamp.sec, stamp.nanosec = int(now), int(now % 1 * 1e9)
            publisher.publish(message)

        with Monitor.attach(program.kernel) as monitor:
            servo(client, publish, 10.0, count / 10.0)
            # before the last goal is taken nothing may have come to rest for good
            client.until(
                lambda: (
                    not monitor.feedback().moving
                    and abs(monitor.feedback().axes[1].position - way_[-1]) < 1e-12
                )
            )
            for axis, scale in zip(monitor.feedback().axes, SCALE, strict=True):
                assert axis.position == way_[-1] * scale
                assert axis.peak_velocity <= LIMITS["velocity"] * scale * (1 + 1e-9)
                assert axis.peak_jerk <= LIMITS["jerk"] * scale * (1 + 1e-9)


def test_wrong_joint_states_are_refused_and_counted(tmp_path: Path, client: Client) -> None:
    """The node lives; the motion under way goes on to its goal; best effort is taken too."""
    with (
        running(tmp_path, "ros2", "control", "--ros-args", *GOALS) as program,
        monitor_of(program.kernel) as monitor,
    ):
        publisher = client.node.create_publisher(JointState, "/goals", qos_profile_sensor_data)
        client.until(lambda: publisher.get_subscription_count() == 1)
        goal = JointState(name=NAMES, position=[0.5, 0.0, 0.0])

        def moves() -> bool:
            publisher.publish(goal)  # best effort: one of them comes
            return monitor.feedback().moving

        client.until(moves)
        for names, position in (
            (NAMES, [math.nan, 0.0, 0.0]),
            (NAMES[:2], [0.0, 0.0]),
            (NAMES, [0.0]),
            (NAMES, [9.0, 0.0, 0.0]),
            ([], []),
            ([NAMES[0], *NAMES], [0.0] * 4),
        ):
            publisher.publish(JointState(name=names, position=position))
            client.spin(0.02)
        client.until(lambda: not monitor.feedback().moving)
        assert monitor.feedback().axes[0].position == 0.5 * SCALE[0]
        assert program.process.poll() is None
