"""sjerk: a motion kernel. Jerk-limited s-curves in whole control cycles, exact to the last bit."""

from sjerk.cia402 import Drive, DriveConfig
from sjerk.errors import (
    InfeasibleError,
    InputError,
    KernelGoneError,
    MotionStoppedError,
    PlanError,
    RefusedError,
    SjerkError,
)
from sjerk.following import Followed, Segment, follow, follow_path, follow_stops
from sjerk.host import Feedback, Host, Move, MoveState
from sjerk.kernel import Axis, MotionKernel
from sjerk.planning import Motion, Plans, plan, plan_many, plan_velocity
from sjerk.profile import Extrema, Limits, Phase, Profile, Range, Samples, State, scurve
from sjerk.trajectory import ExecutionMode, Fault, FaultKind, Trajectory, TrajectoryError, resample

__all__ = [
    "Axis",
    "Drive",
    "DriveConfig",
    "ExecutionMode",
    "Extrema",
    "Fault",
    "FaultKind",
    "Feedback",
    "Followed",
    "Host",
    "InfeasibleError",
    "InputError",
    "KernelGoneError",
    "Limits",
    "Motion",
    "MotionKernel",
    "MotionStoppedError",
    "Move",
    "MoveState",
    "Phase",
    "PlanError",
    "Plans",
    "Profile",
    "Range",
    "RefusedError",
    "Samples",
    "Segment",
    "SjerkError",
    "State",
    "Trajectory",
    "TrajectoryError",
    "follow",
    "follow_path",
    "follow_stops",
    "plan",
    "plan_many",
    "plan_velocity",
    "resample",
    "scurve",
]
