"""Unmodified clients of ROS 2, for the judges: a node of theirs, and those of a controller.

Whoever imports this is on an isolated domain of its own.
"""

from __future__ import annotations

import os
import secrets
import time
from collections.abc import Callable
from typing import Any, Self

import numpy as np

from helpers.ros_goals import Goal, long_way, wrong
from helpers.ros_robot import LONGEST_S, NAMES, Commands

os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)

import rclpy
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTolerance
from rclpy.action import ActionClient
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from sjerk import Monitor


class Client:
    """One client node, spun here."""

    def __init__(self) -> None:
        self.node = rclpy.create_node("judge", namespace=f"/judge_{secrets.token_hex(4)}")

    def until(self, met: Callable[[], Any], timeout: float = LONGEST_S) -> Any:
        """Spin until something is true; what it is."""
        end = time.monotonic() + timeout
        while not (found := met()):
            if time.monotonic() > end:
                raise TimeoutError(met)
            rclpy.spin_once(self.node, timeout_sec=0.02)
        return found

    def wait(self, future: Any, timeout: float = LONGEST_S) -> Any:
        """The result of a future."""
        self.until(future.done, timeout)
        return future.result()

    def spin(self, seconds: float) -> None:
        """For some time."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            rclpy.spin_once(self.node, timeout_sec=0.01)

    def call(self, kind: type, name: str, request: Any) -> Any:
        """A service's answer."""
        client = self.node.create_client(kind, name)
        self.until(client.service_is_ready)
        answer = self.wait(client.call_async(request))
        self.node.destroy_client(client)
        return answer


class Arm:
    """The controller, and the clients of its action and topics."""

    def __init__(self, client: Client, name: str, kernel: str = "") -> None:
        self.client, self.name, self.kernel, self.states = client, name, kernel, []
        self.action = ActionClient(
            client.node, FollowJointTrajectory, f"/{name}/follow_joint_trajectory"
        )
        client.until(self.action.server_is_ready)
        client.node.create_subscription(JointState, "/joint_states", self.states.append, 10)
        client.until(lambda: self.states)
        self.server_knows()

    def server_knows(self) -> None:
        """The server finds the client later than the client finds the server."""
        self.client.spin(0.5)  # what the other end has found cannot be asked

    def position(self) -> np.ndarray:
        """The newest joint states."""
        return np.array(self.states[-1].position)

    def send(self, rows: Any, times: Any, names: Any = NAMES, **options: Any) -> Any:
        """The answer to a goal; ``feedback`` of it is called back."""
        feedback = options.pop("feedback", None)
        message = FollowJointTrajectory.Goal(trajectory=way(rows, times, names), **options)
        return self.client.wait(self.action.send_goal_async(message, feedback))

    def arrives(self, at: Any) -> None:
        """Wait until the joint states are there."""
        self.client.until(lambda: np.allclose(self.position(), at, atol=1e-5))

    def moves(self) -> None:
        """Wait until it does."""
        with Monitor.attach(self.kernel) as monitor:
            self.client.until(lambda: monitor.feedback().moving)

    def result(self, goal: Any) -> tuple[int, int, str]:
        """Status, code and text at its end."""
        answer = None
        for _ in range(6):
            # DDS drops an answer whose asker the server has not found yet: then ask again
            try:
                answer = self.client.wait(goal.get_result_async(), LONGEST_S / 6.0)
                break
            except TimeoutError:
                continue
        assert answer is not None, "no result"
        return answer.status, answer.result.error_code, answer.result.error_string


def message_of(goal: Goal) -> JointTrajectory:
    """A goal drawn at random as a message."""
    message = way(goal.positions, goal.times, goal.names)
    for point, velocities in zip(message.points, goal.velocities, strict=True):
        point.velocities = [float(v) for v in velocities]
    stamp = message.header.stamp
    stamp.sec, stamp.nanosec = int(goal.stamp), int(goal.stamp % 1 * 1e9)
    return message


def action_goal_of(goal: Goal) -> Any:
    """As a goal of the action, with its tolerances."""
    tolerances = [JointTolerance(name=name, position=x) for name, x in goal.path_tolerance]
    return FollowJointTrajectory.Goal(trajectory=message_of(goal), path_tolerance=tolerances)


def way(rows: Any, times: Any, names: Any = NAMES) -> JointTrajectory:
    """Positions over times."""
    message = JointTrajectory(joint_names=list(names))
    for row, t in zip(rows, times, strict=True):
        point = JointTrajectoryPoint(positions=[float(x) for x in row])
        whole, rest = divmod(round(t * 1e9), 10**9)
        point.time_from_start.sec, point.time_from_start.nanosec = whole, rest
        message.points.append(point)
    return message


def servo(
    client: Client, publish: Callable[[float], None], rate: float, seconds: float
) -> list[float]:
    """Call at a rate by the clock; the gaps between the calls, s."""
    began, moments = time.monotonic(), []
    for k in range(int(seconds * rate)):
        while time.monotonic() < began + k / rate:
            rclpy.spin_once(client.node, timeout_sec=0.001)
        moments.append(time.monotonic())
        publish(time.time())
    return np.diff(moments).tolist()


class Stalls:
    """How long publisher, node and kernel have stood still at most; a context manager.

    What comes at a rate cannot be followed better than it comes: judges allow for this.
    """

    def __init__(self, client: Client, kernel: str, states: str) -> None:
        """``states``: joint states of the node, which it publishes at 50 Hz."""
        self._client, self._kernel = client, kernel
        self._stamps: list[float] = []
        self._heard = client.node.create_subscription(JointState, states, self._hear, 100)
        self._late, self.gaps, self.longest = 0, [0.0], 0.0

    def _hear(self, message: JointState) -> None:
        stamp = message.header.stamp
        self._stamps.append(stamp.sec + 1e-9 * stamp.nanosec)

    def _late_cycles(self) -> int:
        with Monitor.attach(self._kernel) as monitor:
            return monitor.feedback().timing.late

    def __enter__(self) -> Self:
        self._late = self._late_cycles()
        return self

    def __exit__(self, *error: object) -> None:
        node = max(np.diff(self._stamps).tolist() or [0.0]) - 0.02
        cycles = (self._late_cycles() - self._late) * 1e-3
        own = max(self.gaps) - float(np.median(self.gaps))
        self.longest = max(0.0, node) + cycles + max(0.0, own)
        self._client.node.destroy_subscription(self._heard)


def attacked(arm: Arm, count: int, seconds: float, seed: int = 12) -> int:
    """Send wrong goals by action and topic while a long motion is under way, until enough are sent.

    Each time the motion must be that without them, bit for bit; returns how many were sent.
    """
    draw = np.random.default_rng(seed)
    topic = arm.client.node.create_publisher(JointTrajectory, f"/{arm.name}/joint_trajectory", 10)
    arm.client.until(topic.get_subscription_count)
    sent, alone = 0, None
    while alone is None or sent < count:
        assert arm.result(arm.send([[0.0] * 3], [0.5]))[1] == 0
        with Commands(arm.kernel) as commands:
            goal = arm.client.wait(arm.action.send_goal_async(action_goal_of(long_way(seconds))))
            assert goal.accepted
            result = goal.get_result_async()
            while not result.done():
                if alone is None:
                    arm.client.spin(0.01)
                    continue
                kind, bad = wrong(draw, arm.position())
                sent += 1
                # on the topic a trajectory without points is an order to stop
                if draw.random() < 0.3 and kind not in ("nothing", "nobody", "tolerance"):
                    topic.publish(message_of(bad))
                    rclpy.spin_once(arm.client.node, timeout_sec=0.0)
                else:
                    answer = arm.client.wait(arm.action.send_goal_async(action_goal_of(bad)))
                    assert not answer.accepted, (kind, bad)
            assert result.result().result.error_code == 0
        if alone is None:
            alone = commands.motion()
        assert np.array_equal(alone, commands.motion())
    arm.client.node.destroy_publisher(topic)
    return sent
