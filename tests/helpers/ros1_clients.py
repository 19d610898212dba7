"""Debian's unmodified clients of ROS 1, for the judges, on a master of their own."""

from __future__ import annotations

import os
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from helpers.ros_goals import Goal, long_way, wrong
from helpers.ros_robot import LONGEST_S, NAMES, Commands, monitor_of

with socket.socket() as free:
    free.bind(("127.0.0.1", 0))
    PORT = free.getsockname()[1]
os.environ["ROS_MASTER_URI"] = f"http://localhost:{PORT}"
os.environ["ROS_HOSTNAME"] = "localhost"

import actionlib
import rosgraph
import rospy
from actionlib_msgs.msg import GoalStatus
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from sjerk.ports.ros.ros1_interfaces import interfaces

TYPES = interfaces()


def until(met: Callable[[], Any], timeout: float = LONGEST_S) -> Any:
    """Wait until something is true; what it is."""
    end = time.monotonic() + timeout
    while not (found := met()):
        if time.monotonic() > end:
            raise TimeoutError(met)
        time.sleep(0.005)
    return found


@contextmanager
def ros(folder: Path) -> Iterator[None]:
    """A master of their own, and this process a node of it."""
    os.environ["ROS_LOG_DIR"] = str(folder)
    master = subprocess.Popen(["rosmaster", "--core", "-p", str(PORT)])
    try:
        until(rosgraph.is_master_online)
        rospy.init_node("judge", anonymous=True, disable_signals=True)
        yield
        rospy.signal_shutdown("done")
    finally:
        master.terminate()
        master.wait(LONGEST_S)


def message_of(goal: Goal) -> JointTrajectory:
    """A goal drawn at random as a message."""
    message = way(goal.positions, goal.times, goal.names)
    for point, velocities in zip(message.points, goal.velocities, strict=True):
        point.velocities = [float(v) for v in velocities]
    message.header.stamp = rospy.Time.from_sec(goal.stamp)
    return message


def way(rows: Any, times: Any, names: Any = NAMES) -> JointTrajectory:
    """Positions over times."""
    message = JointTrajectory(joint_names=list(names))
    for row, t in zip(rows, times, strict=True):
        message.points.append(
            JointTrajectoryPoint(
                positions=[float(x) for x in row], time_from_start=rospy.Duration.from_sec(t)
            )
        )
    return message


class Arm:
    """The controller, and the client of its action."""

    def __init__(self, name: str, kernel: str = "") -> None:
        self.name, self.kernel, self.states = name, kernel, []
        self.action = actionlib.ActionClient(f"/{name}/follow_joint_trajectory", TYPES.Action)
        assert self.action.wait_for_server(rospy.Duration(LONGEST_S))
        rospy.Subscriber("/joint_states", JointState, self.states.append)
        until(lambda: self.states)

    def position(self) -> np.ndarray:
        """The newest joint states."""
        return np.array(self.states[-1].position)

    def send(
        self, rows: Any, times: Any, names: Any = NAMES, feedback: Any = None, **more: Any
    ) -> Any:
        """A goal's handle."""
        goal = TYPES.Goal(trajectory=way(rows, times, names), **more)
        return self.action.send_goal(goal, feedback_cb=lambda _, m: feedback and feedback(m))

    def result(self, goal: Any) -> tuple[int, int, str]:
        """Status, code and text at its end."""
        until(lambda: goal.get_comm_state() == actionlib.CommState.DONE)
        result = goal.get_result()
        return goal.get_goal_status(), result.error_code, result.error_string

    def moves(self) -> None:
        """Wait until it does."""
        with monitor_of(self.kernel) as monitor:
            until(lambda: monitor.feedback().moving)

    def parameter(self, name: str, value: str) -> None:
        """By the program that sets parameters."""
        subprocess.run(["rosparam", "set", f"/{self.name}/{name}", value], check=True)


def play(publish: Callable[[float], None], rate: float, count: int) -> None:
    """Call so many times at a rate, by the clock."""
    began = time.monotonic()
    for k in range(count):
        time.sleep(max(0.0, began + k / rate - time.monotonic()))
        publish(rospy.get_time())


def attacked(arm: Arm, count: int, seconds: float, seed: int = 12) -> int:
    """Send wrong goals by action and topic while a long motion is under way, until enough are sent.

    Each time the motion must be that without them, bit for bit; returns how many were sent.
    """
    draw = np.random.default_rng(seed)
    topic = rospy.Publisher(f"/{arm.name}/command", JointTrajectory, queue_size=10)
    until(topic.get_num_connections)
    sent, alone = 0, None
    while alone is None or sent < count:
        assert arm.result(arm.send([[0.0] * 3], [0.5]))[1] == 0
        with Commands(arm.kernel) as commands:
            whole = TYPES.Goal(trajectory=message_of(long_way(seconds)))
            goal = arm.action.send_goal(whole)
            while goal.get_comm_state() != actionlib.CommState.DONE:
                if alone is None:
                    time.sleep(0.01)
                    continue
                kind, bad = wrong(draw, arm.position())
                sent += 1
                # on the topic a trajectory without points is an order to stop
                if draw.random() < 0.3 and kind not in ("nothing", "nobody", "tolerance"):
                    topic.publish(message_of(bad))
                    continue
                tolerances = [TYPES.Tolerance(name=n, position=x) for n, x in bad.path_tolerance]
                ask = TYPES.Goal(trajectory=message_of(bad), path_tolerance=tolerances)
                refused = arm.action.send_goal(ask)
                status, _, text = arm.result(refused)
                assert status == GoalStatus.REJECTED, (kind, bad)
                assert text
            assert goal.get_result().error_code == 0
        if alone is None:
            alone = commands.motion()
        assert np.array_equal(alone, commands.motion())
    topic.unregister()
    return sent
