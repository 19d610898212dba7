"""sjerk: a motion kernel. Jerk-limited s-curves in whole control cycles, exact to the last bit.

The names that most programs need; more of each room are in ``sjerk.host``, ``sjerk.kernel``,
``sjerk.executor``, ``sjerk.recording``, ``sjerk.trajectory``, ``sjerk.planner``.
"""

import sys

from sjerk.cia402 import Drive, DriveConfig
from sjerk.errors import (
    InfeasibleError,
    InputError,
    KernelGoneError,
    MotionStoppedError,
    PlanError,
    PlatformError,
    QueueFullError,
    RefusedError,
    SjerkError,
    SupersededError,
)
from sjerk.planner import plan, plan_many, plan_velocity
from sjerk.profile import Limits, Profile, Samples, State, scurve
from sjerk.trajectory.faults import TrajectoryError
from sjerk.trajectory.following import follow
from sjerk.trajectory.streaming import GoalStream
from sjerk.trajectory.thinning import follow_within
from sjerk.trajectory.trajectory import Trajectory, resample
from sjerk.trajectory.untimed import follow_path, follow_stops

if sys.platform == "linux":
    from sjerk.executor import StreamPlayer, TrajectoryExecutor
    from sjerk.host import Host, Monitor, Move, Path
    from sjerk.kernel import Axis, Clock, MotionKernel, Reactions
    from sjerk.recording import Recorder, Recording, replay, simulate
else:

    def __getattr__(name: str) -> object:
        """What needs Linux says so."""
        if name in __all__:
            raise PlatformError(f"sjerk.{name}")
        raise AttributeError(f"module 'sjerk' has no attribute {name!r}")


__all__ = [
    "Axis",
    "Clock",
    "Drive",
    "DriveConfig",
    "GoalStream",
    "Host",
    "InfeasibleError",
    "InputError",
    "KernelGoneError",
    "Limits",
    "Monitor",
    "MotionKernel",
    "MotionStoppedError",
    "Move",
    "Path",
    "PlanError",
    "Profile",
    "QueueFullError",
    "Reactions",
    "Recorder",
    "Recording",
    "RefusedError",
    "Samples",
    "SjerkError",
    "State",
    "StreamPlayer",
    "SupersededError",
    "Trajectory",
    "TrajectoryError",
    "TrajectoryExecutor",
    "follow",
    "follow_path",
    "follow_stops",
    "follow_within",
    "plan",
    "plan_many",
    "plan_velocity",
    "replay",
    "resample",
    "scurve",
    "simulate",
]
