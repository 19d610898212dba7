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

from helpers.ros2_clients import Arm, Client, Stalls, servo
from helpers.ros_robot import LIMITS, NAMES, SCALE, Commands, monitor_of, running
from sjerk import Monitor

pytest_plugins = ["helpers.ros2_fixtures"]


# ---- streams by topic


class Wave:
    """A cosine from rest: what publishers tell, and where the joints are to be."""

    amplitude, pace = 0.3, 0.75

    def __init__(self) -> None:
        self.began = time.time()
        self._offset = time.time() - time.monotonic()

    def at(self, now: Any) -> Any:
        """Position at a time of day."""
        return self.amplitude * (1 - np.cos(self.pace * np.maximum(now - self.began, 0.0)))

    def speed(self, now: Any) -> Any:
        """Velocity then."""
        return self.amplitude * self.pace * np.sin(self.pace * np.maximum(now - self.began, 0.0))

    def judged(self, commands: Commands, until: float) -> dict[str, float]:
        """Lag, distance and velocity off at that lag, the largest acceleration, each as a ratio."""
        day = commands.time + self._offset
        steady = (day > self.began + 1.5) & (day < until)
        delays = np.arange(-0.1, 1.5, 1e-3)
        q, v = commands.position[steady, 1], commands.velocity[steady, 1]
        off = [np.square(q - self.at(day[steady] - d)).sum() for d in delays]
        lag = float(delays[int(np.argmin(off))])
        at = day[steady] - lag
        most = self.amplitude * self.pace
        return {
            "lag": lag,
            "off": float(np.abs(q - self.at(at)).max()) / self.amplitude,
            "ripple": float(np.abs(v - self.speed(at)).max()) / most,
            "acceleration": float(np.abs(commands.acceleration[steady, 1]).max())
            / (most * self.pace),
        }


@pytest.mark.parametrize("mode", ["track", "stream"])
def test_windows_and_chunks_are_followed(tmp_path: Path, client: Client, mode: str) -> None:
    """Windows of a servo node at 100 Hz, chunks of a policy at 5 Hz.

    What publisher, node and kernel stood still is allowed for; judged without any of it, in virtual
    time: test_ros_acceptance.py.
    """
    rate, gap, count = (100.0, 0.01, 11) if mode == "track" else (5.0, 0.05, 12)
    more = ["--node-name", "servo", "--ros-args", "-p", f"topic_mode:={mode}"]
    more += ["-p", "stream.period:=0.05", "-p", "stream.delay:=8"]
    with running(tmp_path, "ros2", "controller", *more) as program:
        Arm(client, "servo", program.kernel)
        publisher = client.node.create_publisher(JointTrajectory, "/servo/joint_trajectory", 10)
        client.until(lambda: publisher.get_subscription_count() == 1)
        with (
            Commands(program.kernel) as commands,
            Stalls(client, program.kernel, "/joint_states") as stood,
            monitor_of(program.kernel) as monitor,
        ):
            wave = Wave()

            def publish(now: float) -> None:
                message = JointTrajectory(joint_names=NAMES)
                stamp = message.header.stamp
                stamp.sec, stamp.nanosec = int(now), int(now % 1 * 1e9)
                for k in range(count):
                    q, v = wave.at(now + gap * k), wave.speed(now + gap * k)
                    point = JointTrajectoryPoint(positions=[float(q)] * 3)
                    if mode == "track":
                        point.velocities = [float(v)] * 3
                    point.time_from_start.nanosec = round(k * gap * 1e9)
                    message.points.append(point)
                publisher.publish(message)

            stood.gaps = servo(client, publish, rate, 6.0)
            ended = time.time()
            client.until(lambda: not monitor.feedback().moving)
        found = wave.judged(commands, ended)
        print(json.dumps(found | {"stood_still": stood.longest}))
        assert commands.within()
        slack = 2.0 * stood.longest * wave.pace  # of a wave that goes on meanwhile
        assert found["off"] <= 0.01 + slack
        if mode == "track":
            assert abs(found["lag"]) <= 0.02 + stood.longest
            assert found["ripple"] <= 0.05 + 10.0 * slack
        elif stood.longest < 0.02:  # a stream that makes up for lost time has more
            assert found["acceleration"] <= 1.2


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


def test_it_is_the_far_end_of_a_topic_interface(tmp_path: Path, client: Client) -> None:
    """Commands at 100 Hz as JointStateTopicSystem sends them: near by, and silent at the end.

    Reliable and one deep, only joints with a command, none while commands and states differ by less
    than its threshold; states come best effort.
    """
    threshold, reach, seconds = 1e-5, 0.6, 3.0
    topics = ["-p", "goal_topic:=/robot_joint_commands", "-p", "state_topic:=/robot_joint_states"]
    more = ["--ros-args", "-p", "mode:=track", *topics]
    with running(tmp_path, "ros2", "control", *more) as program:
        states: list[Any] = []
        client.node.create_subscription(
            JointState, "/robot_joint_states", states.append, qos_profile_sensor_data
        )
        publisher = client.node.create_publisher(JointState, "/robot_joint_commands", 1)
        client.until(lambda: states and publisher.get_subscription_count() == 1)
        off, sent, silent = [0.0], [], [0]
        with Stalls(client, program.kernel, "/robot_joint_states") as stood:
            began = time.time()

            def publish(now: float) -> None:
                share = min(1.0, (now - began) / seconds)
                command = reach * share**2 * (3 - 2 * share)
                state = dict(zip(states[-1].name, states[-1].position, strict=True))
                differs = [abs(command - state[name]) for name in NAMES]
                off.append(max(differs))
                if sum(differs) <= threshold:
                    silent[0] += 1
                    return
                silent[0] = 0
                message = JointState(name=NAMES, position=[command] * 3)
                stamp = message.header.stamp
                stamp.sec, stamp.nanosec = int(now), int(now % 1 * 1e9)
                sent.append(now)
                publisher.publish(message)

            stood.gaps = servo(client, publish, 100.0, seconds)
            for _ in range(100):
                if silent[0] >= 20:
                    break
                stood.gaps += servo(client, publish, 100.0, 0.1)
        print(json.dumps({"off": max(off), "at_end": off[-1], "stood_still": stood.longest}))
        assert silent[0] >= 20  # and stays so: the interface has nothing to send any more
        assert len(sent) > 50
        # a state is up to 20 ms old, and what stands still falls behind
        fastest = 1.5 * reach / seconds
        assert max(off) <= fastest * (0.05 + 2.0 * stood.longest)


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
