"""What a frame of the kernel's feedback is in ROS units: rows for messages. Never here: ROS."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sjerk.host import Feedback
from sjerk.ports.ros.joints import Joints
from sjerk.profile import FloatArray


@dataclass(frozen=True, eq=False)
class Rows:
    """All joints (N,) in one cycle, radians and metres: command, feedback, goal."""

    command_position: FloatArray
    command_velocity: FloatArray
    command_acceleration: FloatArray
    feedback_position: FloatArray
    feedback_velocity: FloatArray
    goal: FloatArray

    @classmethod
    def of(cls, frame: Feedback, joints: Joints) -> Rows:
        """Of one frame."""

        def row(name: str) -> FloatArray:
            return joints.to_ros(np.array([getattr(axis, name) for axis in frame.axes]))

        return cls(
            row("position"),
            row("velocity"),
            row("acceleration"),
            row("actual_position"),
            row("actual_velocity"),
            row("goal"),
        )


def stamp_of(seconds: float) -> tuple[int, int]:
    """Whole seconds and nanoseconds, as a Time or a Duration has them.

    >>> stamp_of(1.25)
    (1, 250000000)
    """
    nanoseconds = round(seconds * 1e9)
    return nanoseconds // 10**9, nanoseconds % 10**9
