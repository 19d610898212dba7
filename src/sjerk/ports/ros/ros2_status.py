"""What both nodes tell of the kernel: joint states, motion states, diagnostics."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from sensor_msgs.msg import JointState

from sjerk.host import Feedback
from sjerk.ports.ros.joints import Joints
from sjerk.ports.ros.messages import Rows
from sjerk.ports.ros.status import Status
from sjerk.profile import FloatArray

try:
    from sjerk_msgs.msg import MotionState
except ImportError:  # usable without the package of interfaces
    MotionState = None


class MotionStates:
    """Publishes a frame of the kernel on ``~/motion_state``, where ``sjerk_msgs`` is installed."""

    def __init__(self, node: Node, joints: Joints) -> None:
        """Of this node."""
        self._node, self._joints = node, joints
        self._publisher: Any = None
        if MotionState is None:
            node.get_logger().info("sjerk_msgs is not installed: no ~/motion_state")
        else:
            self._publisher = node.create_publisher(MotionState, "~/motion_state", 10)

    def destroy(self) -> None:
        """Publish no more."""
        if self._publisher is not None:
            self._node.destroy_publisher(self._publisher)
            self._publisher = None

    def publish(self, frame: Feedback, rows: Rows, stamp: Any) -> None:
        """One frame, all joints in the same cycle."""
        if self._publisher is None:
            return
        message = MotionState(
            cycle=frame.cycle,
            name=list(self._joints.names),
            command_position=rows.command_position,
            command_velocity=rows.command_velocity,
            command_acceleration=rows.command_acceleration,
            feedback_position=rows.feedback_position,
            feedback_velocity=rows.feedback_velocity,
            goal=rows.goal,
            state=[int(axis.state) for axis in frame.axes],
            moving=[axis.moving for axis in frame.axes],
            settled=[axis.settled for axis in frame.axes],
            speed=frame.path.speed,
            override=frame.override,
            hold=frame.hold,
            late_cycles=frame.timing.late,
        )
        message.header.stamp = stamp
        self._publisher.publish(message)


def joint_state(
    names: Sequence[str], position: FloatArray, velocity: FloatArray, stamp: Any
) -> JointState:
    """All joints in one cycle."""
    message = JointState(name=list(names), position=position, velocity=velocity)
    message.header.stamp = stamp
    return message


def diagnostics(node: Node, rows: Sequence[Status]) -> DiagnosticArray:
    """Rows as a message of this node."""
    told = DiagnosticArray()
    told.header.stamp = node.get_clock().now().to_msg()
    told.status = [
        DiagnosticStatus(
            level=bytes([row.level]),
            name=f"{node.get_name()}: {row.what}",
            message=row.text,
            hardware_id="sjerk",
            values=[KeyValue(key=key, value=str(value)) for key, value in row.values.items()],
        )
        for row in rows
    ]
    return told
