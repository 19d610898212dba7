"""control_msgs of ROS 1 where it is not installed: the same classes, made of the fields' names.

The fields of its FollowJointTrajectory and JointTolerance are those of control_msgs 1.5
(BSD-3-Clause), so the sums that clients and servers compare are too. Never here: nodes.
"""

from __future__ import annotations

import importlib
from types import SimpleNamespace
from typing import Any

import actionlib_msgs.msg
import genpy.dynamic
import trajectory_msgs.msg

_RULE = "=" * 80 + "\n"
_NAME = "control_msgs/FollowJointTrajectory"
_POINT = "trajectory_msgs/JointTrajectoryPoint"
_PARTS = {
    "Goal": (
        "trajectory_msgs/JointTrajectory trajectory",
        "control_msgs/JointTolerance[] path_tolerance",
        "control_msgs/JointTolerance[] goal_tolerance",
        "duration goal_time_tolerance",
    ),
    "Result": (
        "int32 error_code",
        "int32 SUCCESSFUL = 0",
        "int32 INVALID_GOAL = -1",
        "int32 INVALID_JOINTS = -2",
        "int32 OLD_HEADER_TIMESTAMP = -3",
        "int32 PATH_TOLERANCE_VIOLATED = -4",
        "int32 GOAL_TOLERANCE_VIOLATED = -5",
        "string error_string",
    ),
    "Feedback": (
        "Header header",
        "string[] joint_names",
        f"{_POINT} desired",
        f"{_POINT} actual",
        f"{_POINT} error",
    ),
    "ActionGoal": ("Header header", "actionlib_msgs/GoalID goal_id", f"{_NAME}Goal goal"),
    "ActionResult": (
        "Header header",
        "actionlib_msgs/GoalStatus status",
        f"{_NAME}Result result",
    ),
    "ActionFeedback": (
        "Header header",
        "actionlib_msgs/GoalStatus status",
        f"{_NAME}Feedback feedback",
    ),
}
_TOLERANCE = ("string name", "float64 position", "float64 velocity", "float64 acceleration")
_ACTION = tuple(f"{_NAME}Action{part} action_{part.lower()}" for part in ("Goal", "Result", "Feedback"))


def _made() -> dict[str, Any]:
    """All classes by name, of the definitions as one text."""

    def text(fields: tuple[str, ...]) -> str:
        return "\n".join(fields) + "\n"

    way, *below = trajectory_msgs.msg.JointTrajectory._full_text.split(_RULE)
    status, *further = actionlib_msgs.msg.GoalStatus._full_text.split(_RULE)
    parts = {_NAME + part: text(fields) for part, fields in _PARTS.items()}
    parts["control_msgs/JointTolerance"] = text(_TOLERANCE)
    parts |= {"trajectory_msgs/JointTrajectory": way, "actionlib_msgs/GoalStatus": status}
    rows = [f"MSG: {name}\n{body}" for name, body in parts.items()] + below + further
    whole = text(_ACTION) + "".join(_RULE + row for row in rows)
    return dict(genpy.dynamic.generate_dynamic(f"{_NAME}Action", whole))


def interfaces() -> SimpleNamespace:
    """Action, Goal, Result, Feedback and Tolerance: of the installed package, or made here."""
    names = {part: f"FollowJointTrajectory{part}" for part in ("Action", "Goal", "Result", "Feedback")}
    names["Tolerance"] = "JointTolerance"
    try:
        installed = importlib.import_module("control_msgs.msg")
        return SimpleNamespace(**{part: getattr(installed, name) for part, name in names.items()})
    except ImportError:
        made = _made()
        return SimpleNamespace(
            **{part: made[f"control_msgs/{name}"] for part, name in names.items()}
        )
