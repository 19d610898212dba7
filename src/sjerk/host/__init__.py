"""Commands to a kernel and what comes back: the host, its motions, feedback, events."""

import sys

from sjerk.errors import PlatformError

if sys.platform != "linux":
    raise PlatformError("sjerk.host")

from sjerk.host.arguments import BUFFERS, Axes, Buffer, Direction, Target
from sjerk.host.events import Event, EventKind, StopKind
from sjerk.host.feedback import (
    AxisFeedback,
    Feedback,
    KernelState,
    LimitSwitch,
    PathFeedback,
    PathState,
)
from sjerk.host.host import Host
from sjerk.host.monitor import Monitor
from sjerk.host.move import Move, MoveState
from sjerk.host.path import Path, Progress
from sjerk.host.path_records import Blocks
from sjerk.host.timing import BUCKET_EDGES, ClockReport, Distribution, Grant, Timing

__all__ = [
    "BUCKET_EDGES",
    "BUFFERS",
    "Axes",
    "AxisFeedback",
    "Blocks",
    "Buffer",
    "ClockReport",
    "Direction",
    "Distribution",
    "Event",
    "EventKind",
    "Feedback",
    "Grant",
    "Host",
    "KernelState",
    "LimitSwitch",
    "Monitor",
    "Move",
    "MoveState",
    "Path",
    "PathFeedback",
    "PathState",
    "Progress",
    "StopKind",
    "Target",
    "Timing",
]
