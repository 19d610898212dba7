"""control_msgs of ROS 1 where it is not installed: the same classes, made of the fields' names.

The fields are those of FollowJointTrajectory and JointTolerance of control_msgs 1.5 and of what
they are made of (trajectory_msgs, actionlib_msgs, std_msgs; all BSD-3-Clause), so the sums by which
ROS 1 compares types are too. Never here: nodes.
"""

from __future__ import annotations

from types import SimpleNamespace

import genpy.dynamic

try:
    import control_msgs.msg as installed
except ImportError:  # on Debian: always
    installed = None

_RULE = "=" * 80 + "\n"
_NAME = "control_msgs/FollowJointTrajectory"
_POINT = "trajectory_msgs/JointTrajectoryPoint"
_STATES = (
    "PENDING", "ACTIVE", "PREEMPTED", "SUCCEEDED", "ABORTED", "REJECTED", "PREEMPTING",
    "RECALLING", "RECALLED", "LOST",
)  # fmt: skip
_CODES = (
    "SUCCESSFUL", "INVALID_GOAL", "INVALID_JOINTS", "OLD_HEADER_TIMESTAMP",
    "PATH_TOLERANCE_VIOLATED", "GOAL_TOLERANCE_VIOLATED",
)  # fmt: skip
_HEADER, _STATUS = "Header header", "actionlib_msgs/GoalStatus status"
_PARTS = {
    f"{_NAME}Goal": (
        "trajectory_msgs/JointTrajectory trajectory",
        "control_msgs/JointTolerance[] path_tolerance",
        "control_msgs/JointTolerance[] goal_tolerance",
        "duration goal_time_tolerance",
    ),
    f"{_NAME}Result": (
        "int32 error_code",
        *(f"int32 {name} = {-k}" for k, name in enumerate(_CODES)),
        "string error_string",
    ),
    f"{_NAME}Feedback": (
        _HEADER,
        "string[] joint_names",
        *(f"{_POINT} {name}" for name in ("desired", "actual", "error")),
    ),
    f"{_NAME}ActionGoal": (_HEADER, "actionlib_msgs/GoalID goal_id", f"{_NAME}Goal goal"),
    f"{_NAME}ActionResult": (_HEADER, _STATUS, f"{_NAME}Result result"),
    f"{_NAME}ActionFeedback": (_HEADER, _STATUS, f"{_NAME}Feedback feedback"),
    "control_msgs/JointTolerance": (
        "string name",
        *(f"float64 {name}" for name in ("position", "velocity", "acceleration")),
    ),
    "trajectory_msgs/JointTrajectory": (
        _HEADER,
        "string[] joint_names",
        f"{_POINT}[] points",
    ),
    _POINT: (
        *(f"float64[] {name}" for name in ("positions", "velocities", "accelerations", "effort")),
        "duration time_from_start",
    ),
    "actionlib_msgs/GoalID": ("time stamp", "string id"),
    "actionlib_msgs/GoalStatus": (
        "actionlib_msgs/GoalID goal_id",
        "uint8 status",
        *(f"uint8 {name} = {k}" for k, name in enumerate(_STATES)),
        "string text",
    ),
    "std_msgs/Header": ("uint32 seq", "time stamp", "string frame_id"),
}
_ACTION = tuple(
    f"{_NAME}Action{part} action_{part.lower()}" for part in ("Goal", "Result", "Feedback")
)


def interfaces() -> SimpleNamespace:
    """Action, Goal, Result, Feedback and Tolerance: of the installed package, or made here."""
    names = {
        part: f"FollowJointTrajectory{part}" for part in ("Action", "Goal", "Result", "Feedback")
    }
    names["Tolerance"] = "JointTolerance"
    if installed is not None:
        return SimpleNamespace(**{part: getattr(installed, name) for part, name in names.items()})
    texts = {name: "\n".join(fields) + "\n" for name, fields in _PARTS.items()}
    whole = "\n".join(_ACTION) + "\n"
    whole += "".join(f"{_RULE}MSG: {name}\n{text}" for name, text in texts.items())
    made = genpy.dynamic.generate_dynamic(f"{_NAME}Action", whole)
    return SimpleNamespace(**{part: made[f"control_msgs/{name}"] for part, name in names.items()})
