"""The control node: joint states are goals, the kernel's command and feedback are joint states.

The paper's node: goals come every 0.1 s, each interrupts the move under way. With other topics it
is the far end of a topic-based hardware interface. ``parameters.CONTROL`` has its parameters. Never
here: motion.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from sjerk.errors import SjerkError
from sjerk.ports.ros.following import Following
from sjerk.ports.ros.joints import Joints
from sjerk.ports.ros.leading import KernelOf, joints_of, lead
from sjerk.ports.ros.messages import Rows
from sjerk.ports.ros.orders import LONGEST, Order
from sjerk.ports.ros.parameters import CONTROL
from sjerk.ports.ros.ros2_life import Waits, checks, declare, run, stops, turned
from sjerk.ports.ros.ros2_status import MotionStates, diagnostics, joint_state
from sjerk.ports.ros.status import check, check_start, statuses, warnings
from sjerk.trajectory.columns import seconds


class ControlNode(Node):  # type: ignore[misc]
    """Joint states in, motion of the kernel, joint states out."""

    def __init__(self, kernel_of: KernelOf) -> None:
        """Leads the kernel and enables its drives; raises SjerkError and its like."""
        super().__init__("sjerk_control_node")
        declare(self, CONTROL)
        self._open = ExitStack()
        self._host = lead(self._value, self._open, kernel_of)
        self._joints: Joints = joints_of(self._value("joints"), self._host)
        check_start(self._host, self._joints, self.get_logger().info)
        self._host.enable()
        self._finishing = False
        self._following = Following(self._host, self._joints, self._value, self._tell)
        self._waits = Waits(self)
        self._commands = self.create_publisher(JointState, "~/command", qos_profile_sensor_data)
        self._states = self.create_publisher(JointState, self._value("state_topic"), 10)
        self._warnings = self.create_publisher(String, "~/warnings", 10)
        self._motion_states = MotionStates(self, self._joints)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        # Best effort takes goals from reliable publishers and from others.
        qos = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.create_subscription(JointState, self._value("goal_topic"), self._on_goal, qos)
        stops(self.create_service, self._on_order)
        checks(self.create_service, lambda: check(self._host, self._joints))
        self.create_timer(1.0 / self._value("state_publish_rate"), self._publish)
        self.create_timer(1.0, self._diagnose)
        self.create_timer(0.01, self._turn)
        rate = self._value("read_rate")
        self._every, self._due = (1.0 / rate if rate else 0.0), time.monotonic()

    def _value(self, name: str) -> Any:
        return self.get_parameter(name).value

    def _now(self) -> float:
        return float(self.get_clock().now().nanoseconds * 1e-9)

    # ---- goals

    def _on_goal(self, message: JointState) -> None:
        now, sent = self._now(), seconds(message.header.stamp)
        self._following.take(
            message.name, message.position, message.velocity, sent=sent or now, now=now
        )

    def _tell(self, text: str) -> None:
        self.get_logger().error(text, throttle_duration_sec=1.0)

    def _turn(self) -> None:
        self._following.turn(self._now())

    # ---- orders

    async def _on_order(self, name: str) -> str:
        self._following.drop()
        order = Order(self._host, name)
        await self._waits.until(order.look, LONGEST)
        return order.answer

    # ---- what is told

    def _publish(self) -> None:
        frame = self._host.feedback()
        rows, now = Rows.of(frame, self._joints), self.get_clock().now().to_msg()
        for publisher, position, velocity in (
            (self._commands, rows.command_position, rows.command_velocity),
            (self._states, rows.feedback_position, rows.feedback_velocity),
        ):
            publisher.publish(joint_state(self._joints.names, position, velocity, now))
        self._motion_states.publish(frame, rows, now)
        for text in warnings(self._host):
            self._warnings.publish(String(data=text))

    def _diagnose(self) -> None:
        goals = {f"goals, {self._following.mode}": self._following.report()}
        rows = statuses(self._host, self._joints, goals)
        self._diagnostics.publish(diagnostics(self, rows))

    # ---- life

    def spin(self, executor: SingleThreadedExecutor) -> None:
        """Take what has come; polled, everything that has come since the poll before."""
        if not self._every:
            executor.spin_once(timeout_sec=0.1)
            return
        for _ in range(100):  # no timer keeps a goal from being read
            if not turned(executor):
                break
        self._due = max(self._due + self._every, time.monotonic())
        time.sleep(max(0.0, self._due - time.monotonic()))

    def finish(self) -> bool:
        """Stop what moves; whether it rests."""
        try:
            if not self._finishing:
                self._finishing = True
                self._following.drop()
                self._host.halt(0.0)
            return not self._host.feedback().moving
        except SjerkError:
            return True

    def leave(self) -> None:
        """Leave the kernel; end it where it is a child."""
        self._open.close()


def main(arguments: Sequence[str] | None, kernel_of: KernelOf) -> int:
    """Run the node; ``arguments`` as of ROS; returns the exit code."""
    return run(lambda: ControlNode(kernel_of), arguments)
