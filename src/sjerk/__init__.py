"""sjerk: a motion kernel. Jerk-limited s-curves in whole control cycles, exact to the last bit."""

from sjerk.cia402 import Drive, DriveConfig
from sjerk.clock import Clock, ClockReport, Grant
from sjerk.errors import (
    InfeasibleError,
    InputError,
    KernelGoneError,
    MotionStoppedError,
    PlanError,
    RefusedError,
    SjerkError,
)
from sjerk.feedback import AxisFeedback, Feedback, Timing
from sjerk.host import Host, Move, MoveState
from sjerk.kernel import Axis, MotionKernel
from sjerk.planning import Motion, Plans, plan, plan_many, plan_velocity
from sjerk.profile import Extrema, Limits, Phase, Profile, Range, Samples, State, scurve

__all__ = [
    "Axis",
    "AxisFeedback",
    "Clock",
    "ClockReport",
    "Drive",
    "DriveConfig",
    "Extrema",
    "Feedback",
    "Grant",
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
    "SjerkError",
    "State",
    "Timing",
    "plan",
    "plan_many",
    "plan_velocity",
    "scurve",
]
