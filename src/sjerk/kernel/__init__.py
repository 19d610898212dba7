"""A kernel: its axes, its process, its clock, its file of settings."""

from sjerk.kernel.axis import Axis
from sjerk.kernel.clock import Clock
from sjerk.kernel.config import described, load
from sjerk.kernel.kernel import Image, MotionKernel
from sjerk.kernel.reactions import Reaction, Reactions

__all__ = ["Axis", "Clock", "Image", "MotionKernel", "Reaction", "Reactions", "described", "load"]
