"""Unmodified clients of ROS 2, for the judges: a node of theirs, and those of a controller.

Whoever imports this is on an isolated domain of its own.
"""

from __future__ import annotations

import os
import secrets
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from helpers.ros_robot import LONGEST_S, NAMES

os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)

import rclpy
from control_msgs.action import FollowJointTrajectory
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


def way(rows: Any, times: Any, names: Any = NAMES) -> JointTrajectory:
    """Positions over times."""
    message = JointTrajectory(joint_names=list(names))
    for row, t in zip(rows, times, strict=True):
        point = JointTrajectoryPoint(positions=[float(x) for x in row])
        point.time_from_start.sec = int(t)
        point.time_from_start.nanosec = round((t - int(t)) * 1e9)
        message.points.append(point)
    return message


def servo(client: Client, publish: Callable[[float], None], rate: float, seconds: float) -> None:
    """Call at a rate by the clock."""
    began = time.monotonic()
    for k in range(int(seconds * rate)):
        while time.monotonic() < began + k / rate:
            rclpy.spin_once(client.node, timeout_sec=0.001)
        publish(time.time())
