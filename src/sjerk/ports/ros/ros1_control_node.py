"""The control node of ROS 1: joint states are goals, command and feedback are joint states.

The paper's node, on the robot operating system that the paper has. ``parameters.CONTROL`` has its
parameters. Never here: motion.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

import rospy
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from sjerk.errors import SjerkError
from sjerk.ports.ros.following import Following
from sjerk.ports.ros.leading import KernelOf
from sjerk.ports.ros.messages import Rows
from sjerk.ports.ros.parameters import CONTROL
from sjerk.ports.ros.ros1_life import Life, joint_state, run
from sjerk.ports.ros.status import warnings
from sjerk.ports.ros.turns import Drained
from sjerk.trajectory.columns import seconds


class ControlNode(Life):
    """Joint states in, motion of the kernel, joint states out."""

    def __init__(self, kernel_of: KernelOf) -> None:
        """Leads the kernel and enables its drives; raises SjerkError and its like."""
        super().__init__(CONTROL, kernel_of)
        self._following = Following(
            self.host, self.joints, self.value, lambda text: rospy.logerr_throttle(1.0, text)
        )
        self._finishing = False
        self._goals = Drained(depth=100)
        self._commands = rospy.Publisher("~command", JointState, queue_size=1)
        own = self.value("state_topic").replace("~/", "~")  # "~/" would not be private
        self._states = rospy.Publisher(own, JointState, queue_size=10)
        self._warnings = rospy.Publisher("~warnings", String, queue_size=10)
        self.offer_stops(self._following.drop)
        rate = self.value("read_rate")
        self._every, self._due = (1.0 / rate if rate else 0.0), time.monotonic()
        rospy.Subscriber(
            self.value("goal_topic"), JointState, self._came, queue_size=100, tcp_nodelay=True
        )
        self.turns.every(1.0 / self.value("state_publish_rate"), self._publish)
        self.turns.every(0.01, lambda: self._following.turn(rospy.get_time()))
        self.turns.every(1.0, self._diagnose)

    def _came(self, message: JointState) -> None:
        """In rospy's thread: to be polled, or to be done as soon as the loop comes to it."""
        self._goals.put(message)
        if not self._every:
            self.turns.post(self._poll)

    def _poll(self) -> None:
        """Take all goals since the poll before."""
        for message in self._goals.take():
            if self._finishing:
                return
            now, sent = rospy.get_time(), seconds(message.header.stamp)
            self._following.take(
                message.name, message.position, message.velocity, sent=sent or now, now=now
            )

    # ---- what is told

    def _publish(self) -> None:
        frame = self.host.feedback()
        rows, now = Rows.of(frame, self.joints), rospy.Time.now()
        for publisher, position, velocity in (
            (self._commands, rows.command_position, rows.command_velocity),
            (self._states, rows.feedback_position, rows.feedback_velocity),
        ):
            publisher.publish(joint_state(self.joints.names, position, velocity, now))
        for text in warnings(self.host):
            self._warnings.publish(String(data=text))

    def _diagnose(self) -> None:
        report = self._following.report() | {"lost": self._goals.lost}
        self.diagnose({f"goals, {self._following.mode}": report})

    # ---- life

    def spin(self) -> None:
        """One turn: goals as they come, or polled at a rate as in the paper."""
        if not self._every:
            self.turns.turn(0.1)
            return
        self._poll()
        self.turns.turn(0.0)
        self._due = max(self._due + self._every, time.monotonic())
        time.sleep(max(0.0, self._due - time.monotonic()))

    def finish(self) -> bool:
        """Stop what moves; whether it rests."""
        if not self._finishing:
            self._finishing = True
            self._following.drop()
            try:
                self.host.halt(0.0)
            except SjerkError as error:
                rospy.logerr("shut down: %s", error)
        return self.rests()

    def leave(self) -> None:
        """Leave the kernel; end it where it is a child."""
        self.open.close()


def main(arguments: Sequence[str] | None, params: Path | None, kernel_of: KernelOf) -> int:
    """Run the node; ``arguments`` as of ROS, ``params`` a YAML file; returns the exit code."""
    return run("sjerk_control_node", lambda: ControlNode(kernel_of), arguments, params)
