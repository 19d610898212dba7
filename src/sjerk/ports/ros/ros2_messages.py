"""Messages of control_msgs from what the kernel and the executor tell. Never here: nodes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTrajectoryControllerState
from trajectory_msgs.msg import JointTrajectoryPoint

from sjerk.executor import GoalFeedback
from sjerk.ports.ros.joints import Joints
from sjerk.ports.ros.messages import Rows, stamp_of


def controller_state(
    names: Sequence[str], rows: Rows, speed: float, stamp: Any
) -> JointTrajectoryControllerState:
    """Commanded, actual, their difference."""
    told = JointTrajectoryControllerState(joint_names=list(names), speed_scaling_factor=speed)
    told.header.stamp = stamp
    told.reference = JointTrajectoryPoint(
        positions=rows.command_position,
        velocities=rows.command_velocity,
        accelerations=rows.command_acceleration,
    )
    told.feedback = JointTrajectoryPoint(
        positions=rows.feedback_position, velocities=rows.feedback_velocity
    )
    told.error = JointTrajectoryPoint(
        positions=rows.command_position - rows.feedback_position,
        velocities=rows.command_velocity - rows.feedback_velocity,
    )
    told.output = JointTrajectoryPoint(positions=rows.command_position)
    return told


def goal_feedback(told: GoalFeedback, joints: Joints, stamp: Any) -> Any:
    """Of one goal under way, its joints in its order."""
    scale = [joints.scale_of(name) for name in told.joint_names]
    message = FollowJointTrajectory.Feedback(joint_names=list(told.joint_names))
    message.header.stamp = stamp
    for name, position, velocity in (
        ("desired", told.desired, told.desired_velocity),
        ("actual", told.actual, told.actual_velocity),
        ("error", told.error, told.desired_velocity - told.actual_velocity),
    ):
        point = JointTrajectoryPoint(positions=position / scale, velocities=velocity / scale)
        at = point.time_from_start
        at.sec, at.nanosec = stamp_of(max(0.0, told.time))
        setattr(message, name, point)
    if hasattr(message, "index"):  # control_msgs of Kilted and later
        message.index = told.point
    return message
