"""Goals of an action server as data: codes, tolerances, settings, feedback, messages.

Names and numbers are those of FollowJointTrajectory and joint_trajectory_controller. Never here:
what is done with them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum, IntEnum
from typing import Any

from sjerk.errors import InputError, positive, real
from sjerk.profile import FloatArray
from sjerk.trajectory import ExecutionMode, FaultKind, Trajectory, TrajectoryError, TrajectoryFault
from sjerk.trajectory.columns import columns_of, seconds


class ResultCode(IntEnum):
    """The error codes of ``control_msgs/action/FollowJointTrajectory``.

    >>> ResultCode(-4).name
    'PATH_TOLERANCE_VIOLATED'
    """

    SUCCESSFUL = 0  #: The goal is reached, or was canceled, or goes on.
    INVALID_GOAL = -1  #: The goal cannot be accepted, or the kernel has ended its motion.
    INVALID_JOINTS = -2  #: The joints are not those of the executor.
    OLD_HEADER_TIMESTAMP = -3  #: All of the trajectory lies before now.
    PATH_TOLERANCE_VIOLATED = -4  #: A joint left its path tolerance during the motion.
    GOAL_TOLERANCE_VIOLATED = -5  #: A joint did not come within its goal tolerance in time.


class GoalStatus(Enum):
    """What has become of a goal; the last four are final."""

    WAITING = "waiting"  #: Its motion has not begun: the one before still moves.
    EXECUTING = "executing"  #: Its motion is in play, or the joints settle after it.
    SUCCEEDED = "succeeded"  #: The joints are within the goal tolerance.
    CANCELED = "canceled"  #: ``GoalHandle.cancel`` ended it.
    ABORTED = "aborted"  #: A newer goal, a tolerance, or the kernel ended it.
    REJECTED = "rejected"  #: It was not accepted.


OPEN = (GoalStatus.WAITING, GoalStatus.EXECUTING)


@dataclass(frozen=True)
class Tolerance:
    """How far a joint's actual position and velocity may be from the commanded ones.

    ``position`` in axis units, ``velocity`` per second. 0: as the executor has it, and there
    unchecked; -1: unchecked, as in ``control_msgs/msg/JointTolerance``. Raises InputError.

    >>> Tolerance(0.1).over(Tolerance(0.5, 2.0))
    Tolerance(position=0.1, velocity=2.0)
    """

    position: float = 0.0
    velocity: float = 0.0

    def __post_init__(self) -> None:
        for name in ("position", "velocity"):
            value = real(name, getattr(self, name))
            if value < 0.0 and value != -1.0:
                raise InputError(name, value, "must not be negative, but for -1")

    def over(self, default: Tolerance) -> Tolerance:
        """These, with the default's where they are 0."""
        return Tolerance(self.position or default.position, self.velocity or default.velocity)


@dataclass(frozen=True, eq=False)
class GoalFeedback:
    """Where the joints of a goal are, in its trajectory's order of joints.

    ``time`` (s): of the trajectory's own clock, stretches included; ``point``: the way-point ahead.
    ``desired`` is commanded, ``actual`` the encoder's, ``error`` their difference: (N,) each; of
    axes that wrap both positions in the trajectory's own turn.
    """

    joint_names: tuple[str, ...]
    time: float
    point: int
    speed: float
    desired: FloatArray
    actual: FloatArray
    error: FloatArray
    desired_velocity: FloatArray
    actual_velocity: FloatArray


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What holds for goals from the next one on: ``TrajectoryExecutor.settings``.

    ``execution_mode``: every way-point, or only the last by one planned motion.
    ``resampling_delta`` (axis units): way-points nearer to the next one kept are left out; 0: none
    are. ``speed``: 0 .. 2, as ``GoalHandle.speed``. ``use_velocities``: those of the trajectory, or
    ones chosen so that the jerk is constant. ``tolerance`` (axis units): way-points, dense ones
    above all, are passed so near (``follow_within``); 0: met. Tolerances by joint; ``goal_time``
    (s) that the joints may take to come within the goal's after the motion, 0: for ever, also where
    they cannot come so near; then only ``cancel`` or another goal ends it. ``stopped_velocity``
    that counts as rest. ``start_tolerance``: a first way-point at time 0 further away is refused;
    None: it is gone to first. Raises InputError.

    >>> Settings(speed=0.5, goal_tolerance={"elbow": Tolerance(0.01)}).goal_time
    0.0
    """

    execution_mode: ExecutionMode = ExecutionMode.FULL_TRAJECTORY
    resampling_delta: float = 0.0
    speed: float = 1.0
    use_velocities: bool = False
    tolerance: float = 0.0
    allow_partial_joints: bool = False
    allow_end_velocity: bool = False
    path_tolerance: Mapping[str, Tolerance] = field(default_factory=dict)
    goal_tolerance: Mapping[str, Tolerance] = field(default_factory=dict)
    goal_time: float = 0.0
    stopped_velocity: float = 0.01
    start_tolerance: float | None = None

    def __post_init__(self) -> None:
        try:
            mode = ExecutionMode(self.execution_mode)
        except ValueError as fault:
            known = ", ".join(mode.value for mode in ExecutionMode)
            raise InputError("execution_mode", self.execution_mode, f"must be {known}") from fault
        object.__setattr__(self, "execution_mode", mode)
        for name in ("resampling_delta", "tolerance", "goal_time", "stopped_velocity"):
            if real(name, getattr(self, name)) < 0.0:
                raise InputError(name, getattr(self, name), "must not be negative")
        if not 0.0 <= real("speed", self.speed) <= 2.0:
            raise InputError("speed", self.speed, "must lie in 0 .. 2")
        for name in ("path_tolerance", "goal_tolerance"):
            check_tolerances(name, getattr(self, name))
        if self.start_tolerance is not None:
            positive("start_tolerance", self.start_tolerance)


def from_message(message: Any) -> tuple[Trajectory, float]:
    """A JointTrajectory message as a trajectory, and its stamp in seconds; no ROS needed.

    Fields as in trajectory_msgs: ``joint_names``, ``points`` with ``positions``, ``velocities``,
    ``accelerations`` and ``time_from_start``, and ``header.stamp``. Raises TrajectoryError, and
    InputError for what is no such message.
    """
    _has("trajectory", message, ("joint_names", "points", "header"))
    names, points = list(message.joint_names), list(message.points)
    if not points:
        raise TrajectoryError([TrajectoryFault(FaultKind.EMPTY, "no points")])
    for i, point in enumerate(points):
        _has(f"trajectory.points[{i}]", point, _POINT)
    moments = [seconds(point.time_from_start) for point in points]
    return Trajectory(*columns_of(names, moments, points)), seconds(message.header.stamp)


_POINT = ("positions", "velocities", "accelerations", "time_from_start")


def _has(field: str, value: object, names: Sequence[str]) -> None:
    for name in names:
        if not hasattr(value, name):
            what = f"has no {name}: must be a Trajectory, or a message with its fields"
            raise InputError(field, value, what)


def check_tolerances(field: str, given: object) -> None:
    """Refuse what does not map joint names to ``Tolerance``; raises InputError."""
    if not isinstance(given, Mapping):
        raise InputError(field, given, "must map joint names to Tolerance")
    for name, value in given.items():
        if not isinstance(value, Tolerance):
            raise InputError(f"{field}[{name!r}]", value, "must be a Tolerance")


def tolerances(
    field: str,
    names: Sequence[str],
    own: Mapping[str, Tolerance] | None,
    default: Mapping[str, Tolerance],
) -> list[Tolerance]:
    """One per joint, in order; a joint that the goal does not have is an invalid goal."""
    unknown = [
        TrajectoryFault(FaultKind.JOINTS, f"{field} of no joint of the goal", joint=name)
        for name in own or {}
        if name not in names
    ]
    if unknown:
        raise TrajectoryError(unknown)
    return [(own or {}).get(n, Tolerance()).over(default.get(n, Tolerance())) for n in names]


def violated(feedback: GoalFeedback, k: int, limit: Tolerance) -> str:
    """What is out of tolerance at joint k, or nothing."""
    velocity = feedback.desired_velocity[k] - feedback.actual_velocity[k]
    for name, error, most in (
        ("position", feedback.error[k], limit.position),
        ("velocity", velocity, limit.velocity),
    ):
        if most > 0.0 and not abs(error) <= most:
            return f"joint {feedback.joint_names[k]}: {name} off by {error:g}, more than {most:g}"
    return ""
