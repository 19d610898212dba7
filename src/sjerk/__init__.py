"""sjerk: a motion kernel. Jerk-limited s-curves in whole control cycles, exact to the last bit."""

from sjerk.cia402 import Drive, DriveConfig
from sjerk.clock import Clock, ClockReport, Grant
from sjerk.errors import (
    InfeasibleError,
    InputError,
    KernelGoneError,
    MotionStoppedError,
    PlanError,
    QueueFullError,
    RefusedError,
    SjerkError,
    SupersededError,
)
from sjerk.executor import GoalHandle, TrajectoryExecutor
from sjerk.feedback import (
    AxisFeedback,
    Event,
    EventKind,
    Feedback,
    PathFeedback,
    PathState,
    Timing,
)
from sjerk.following import follow
from sjerk.goals import GoalFeedback, GoalStatus, ResultCode, Settings, Tolerance
from sjerk.host import Host
from sjerk.kernel import Axis, Image, MotionKernel, Reactions
from sjerk.move import Move, MoveState
from sjerk.path import Path, Progress
from sjerk.planning import Motion, Plans, plan, plan_many, plan_velocity
from sjerk.playing import StreamPlayer
from sjerk.profile import Extrema, Limits, Phase, Profile, Range, Samples, State, scurve
from sjerk.recording import Gap, Recorder, Recording
from sjerk.segments import Followed, Segment
from sjerk.simulation import Difference, Replay, replay, simulate
from sjerk.states import AxisState
from sjerk.streaming import GoalStream, StreamReport
from sjerk.thinning import Thinned, follow_within
from sjerk.trajectory import ExecutionMode, Fault, FaultKind, Trajectory, TrajectoryError, resample
from sjerk.untimed import follow_path, follow_stops

__all__ = [
    "Axis",
    "AxisFeedback",
    "AxisState",
    "Clock",
    "ClockReport",
    "Difference",
    "Drive",
    "DriveConfig",
    "Event",
    "EventKind",
    "ExecutionMode",
    "Extrema",
    "Fault",
    "FaultKind",
    "Feedback",
    "Followed",
    "Gap",
    "GoalFeedback",
    "GoalHandle",
    "GoalStatus",
    "GoalStream",
    "Grant",
    "Host",
    "Image",
    "InfeasibleError",
    "InputError",
    "KernelGoneError",
    "Limits",
    "Motion",
    "MotionKernel",
    "MotionStoppedError",
    "Move",
    "MoveState",
    "Path",
    "PathFeedback",
    "PathState",
    "Phase",
    "PlanError",
    "Plans",
    "Profile",
    "Progress",
    "QueueFullError",
    "Range",
    "Reactions",
    "Recorder",
    "Recording",
    "RefusedError",
    "Replay",
    "ResultCode",
    "Samples",
    "Segment",
    "Settings",
    "SjerkError",
    "State",
    "StreamPlayer",
    "StreamReport",
    "SupersededError",
    "Thinned",
    "Timing",
    "Tolerance",
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
