"""Motion through many points: way-points of N joints, and what leads through them."""

from sjerk.trajectory.faults import FaultKind, RecordedPathError, TrajectoryError, TrajectoryFault
from sjerk.trajectory.files import RecordedPath, read_recording, shipped_recording
from sjerk.trajectory.following import follow
from sjerk.trajectory.segments import Followed, Segment
from sjerk.trajectory.stream_report import StreamReport
from sjerk.trajectory.streaming import GoalStream
from sjerk.trajectory.thinning import Thinned, follow_within
from sjerk.trajectory.trajectory import ExecutionMode, Trajectory, resample
from sjerk.trajectory.untimed import follow_path, follow_stops

__all__ = [
    "ExecutionMode",
    "FaultKind",
    "Followed",
    "GoalStream",
    "RecordedPath",
    "RecordedPathError",
    "Segment",
    "StreamReport",
    "Thinned",
    "Trajectory",
    "TrajectoryError",
    "TrajectoryFault",
    "follow",
    "follow_path",
    "follow_stops",
    "follow_within",
    "read_recording",
    "resample",
    "shipped_recording",
]
