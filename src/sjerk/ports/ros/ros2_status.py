"""What the nodes tell of the kernel beside joint states: motion states and diagnostics."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from sjerk.errors import SjerkError
from sjerk.host import Feedback, Host
from sjerk.ports.ros.joints import Joints
from sjerk.ports.ros.messages import Rows

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


def _status(
    node: Node, what: str, level: bytes, text: str, values: Mapping[str, object]
) -> DiagnosticStatus:
    return DiagnosticStatus(
        level=level,
        name=f"{node.get_name()}: {what}",
        message=text,
        hardware_id="sjerk",
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )


def diagnostics(
    node: Node,
    host: Host | None,
    joints: Joints,
    more: Mapping[str, Mapping[str, object]] | None = None,
) -> DiagnosticArray:
    """Of the kernel and of each joint; ``more``: further rows of values by name."""
    told = DiagnosticArray()
    told.header.stamp = node.get_clock().now().to_msg()
    rows = told.status
    try:
        if host is None:
            rows.append(_status(node, "kernel", DiagnosticStatus.STALE, "not configured", {}))
            return told
        frame = host.feedback()
    except SjerkError as error:
        rows.append(_status(node, "kernel", DiagnosticStatus.ERROR, str(error), {}))
        return told
    timing = frame.timing
    level = DiagnosticStatus.WARN if timing.late else DiagnosticStatus.OK
    numbers = {
        "cycle": frame.cycle,
        "late_cycles": timing.late,
        "latency_p99_us": round(1e6 * timing.latency.p99, 1),
        "computing_p99_us": round(1e6 * timing.computing.p99, 1),
    }
    rows.append(_status(node, "kernel", level, host.kernel_state.value, numbers))
    for name, axis in zip(joints.names, frame.axes, strict=True):
        level = DiagnosticStatus.OK if axis.follows else DiagnosticStatus.WARN
        values: dict[str, object] = {
            "drive": axis.drive_state.name,
            "error_code": f"{axis.error_code:04X}h",
            "following_error_increments": axis.following_error,
        }
        rows.append(
            _status(
                node,
                name,
                DiagnosticStatus.ERROR if axis.fault else level,
                axis.state.name.lower(),
                values,
            )
        )
    rows.extend(
        _status(node, what, DiagnosticStatus.OK, "", own) for what, own in (more or {}).items()
    )
    return told
