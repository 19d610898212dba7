"""A kernel: its axes and what it feeds forward to them, its process, its clock, its settings."""

import sys

from sjerk.errors import PlatformError

if sys.platform != "linux":
    raise PlatformError("sjerk.kernel")

from sjerk.kernel.axis import Axis
from sjerk.kernel.clock import Clock
from sjerk.kernel.config import described, load, read_table
from sjerk.kernel.feed_forward import FeedForward
from sjerk.kernel.kernel import Image, MotionKernel
from sjerk.kernel.process import Port
from sjerk.kernel.reactions import Reaction, Reactions
from sjerk.kernel.tables import port_tables

__all__ = [
    "Axis",
    "Clock",
    "FeedForward",
    "Image",
    "MotionKernel",
    "Port",
    "Reaction",
    "Reactions",
    "described",
    "load",
    "port_tables",
    "read_table",
]
