"""Goals of an action server and goal streams, on a host."""

from sjerk.executor.executor import FURTHEST, TrajectoryExecutor
from sjerk.executor.goal import GoalFeedback, GoalStatus, ResultCode, Settings, Tolerance
from sjerk.executor.handle import GoalHandle
from sjerk.executor.playing import StreamPlayer

__all__ = [
    "FURTHEST",
    "GoalFeedback",
    "GoalHandle",
    "GoalStatus",
    "ResultCode",
    "Settings",
    "StreamPlayer",
    "Tolerance",
    "TrajectoryExecutor",
]
