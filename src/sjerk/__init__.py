"""sjerk: a motion kernel. Jerk-limited s-curves in whole control cycles, exact to the last bit."""

from sjerk.cia402 import Drive, DriveConfig
from sjerk.cycle.states import AxisState
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
from sjerk.executor.executor import GoalHandle, TrajectoryExecutor
from sjerk.executor.goal import GoalFeedback, GoalStatus, ResultCode, Settings, Tolerance
from sjerk.executor.playing import StreamPlayer
from sjerk.host.feedback import (
    AxisFeedback,
    Event,
    EventKind,
    Feedback,
    PathFeedback,
    PathState,
)
from sjerk.host.host import Host
from sjerk.host.move import Move, MoveState
from sjerk.host.path import Path, Progress
from sjerk.host.timing import ClockReport, Grant, Timing
from sjerk.kernel.clock import Clock
from sjerk.kernel.kernel import Axis, Image, MotionKernel, Reactions
from sjerk.planner.planning import Motion, Plans, plan, plan_many, plan_velocity
from sjerk.profile import Extrema, Limits, Phase, Profile, Range, Samples, State, scurve
from sjerk.recording.recording import Gap, Recorder, Recording
from sjerk.recording.replay import Difference, Replay, replay, simulate
from sjerk.trajectory.following import follow
from sjerk.trajectory.segments import Followed, Segment
from sjerk.trajectory.streaming import GoalStream, StreamReport
from sjerk.trajectory.thinning import Thinned, follow_within
from sjerk.trajectory.trajectory import (
    ExecutionMode,
    Fault,
    FaultKind,
    Trajectory,
    TrajectoryError,
    resample,
)
from sjerk.trajectory.untimed import follow_path, follow_stops

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
