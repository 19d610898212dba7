"""sjerk: a motion kernel. Jerk-limited s-curves in whole control cycles, exact to the last bit."""

from sjerk.cia402 import Drive, DriveConfig
from sjerk.errors import (
    InfeasibleError,
    InputError,
    KernelGoneError,
    MotionStoppedError,
    RefusedError,
    SjerkError,
)
from sjerk.host import Feedback, Host, Move, MoveState
from sjerk.kernel import Axis, MotionKernel
from sjerk.profile import Extrema, Limits, Phase, Profile, Range, Samples, State, scurve

__all__ = [
    "Axis",
    "Drive",
    "DriveConfig",
    "Extrema",
    "Feedback",
    "Host",
    "InfeasibleError",
    "InputError",
    "KernelGoneError",
    "Limits",
    "MotionKernel",
    "MotionStoppedError",
    "Move",
    "MoveState",
    "Phase",
    "Profile",
    "Range",
    "RefusedError",
    "Samples",
    "SjerkError",
    "State",
    "scurve",
]
