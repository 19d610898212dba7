"""Every cycle of a kernel to a file, and again from there."""

from sjerk.recording.frames import Frames
from sjerk.recording.recorder import Recorder
from sjerk.recording.recording import Gap, Recording
from sjerk.recording.simulation import Difference, Replay, replay, simulate

__all__ = [
    "Difference",
    "Frames",
    "Gap",
    "Recorder",
    "Recording",
    "Replay",
    "replay",
    "simulate",
]
