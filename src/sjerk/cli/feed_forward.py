"""What feed-forward is good for: one move by four axes that differ in it alone, in virtual time.

Never here: how the words are made (the kernel), the motor (the drive).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sjerk.cia402 import DriveConfig
from sjerk.host import Host
from sjerk.kernel import Axis, MotionKernel
from sjerk.planner import plan
from sjerk.profile import FloatArray
from sjerk.recording import simulate

SHORT = 10.0  # axis units: a move that is over before a velocity loop has found its torque
_AFTER_S = 1.0
_ENABLED = 20  # cycles


@dataclass(frozen=True)
class Followed:
    """How axes followed one move, by axis: ``error``, the largest 60F4h in parts of v / Kp with the
    largest velocity v of the command, and ``overshoot``, of the encoder, in parts of the way.
    """

    error: FloatArray
    overshoot: FloatArray


def axes(axis: Axis) -> dict[str, Axis]:
    """The axis without feed-forward, with its drive's own, with 60B1h, with 60B2h too."""
    own = axis.drive if isinstance(axis.drive, DriveConfig) else DriveConfig()
    # far from the fault of a following error: what is asked is how large it becomes
    own = own.changed(following_window=2**32 - 1)
    none = own.changed(velocity_feedforward=0.0, acceleration_feedforward=0.0)
    return {
        "none": replace(axis, drive=none, feed_forward=None),
        "the drive's own": replace(axis, drive=own, feed_forward=None),
        "60B1h": replace(axis, drive=none, feed_forward="velocity"),
        "60B1h + 60B2h": replace(axis, drive=none, feed_forward="torque"),
    }


def followed(own: list[Axis], start: float, goal: float, cycle_time: float) -> Followed:
    """Move axes that are alike but for their drives from start to goal, together.

    ``start`` and ``goal`` in axis units, ``cycle_time`` in s.
    """
    there = _cycles(own[0], 0.0, start, cycle_time)
    moved = _cycles(own[0], start, goal, cycle_time)
    begin = _ENABLED + there
    script: list[tuple[int, Callable[[Host], object]]] = [
        (1, lambda host: host.enable()),
        (_ENABLED, lambda host: host.move([start] * len(own))),
        (begin, lambda host: host.move([goal] * len(own))),
    ]
    found = simulate(MotionKernel(own, cycle_time), script, begin + moved)
    rows = slice(begin - 1, None)
    position, actual = found.position[rows], found.actual_position[rows]
    gains = [axis.drive.position_gain_per_s for axis in own if isinstance(axis.drive, DriveConfig)]
    speed = np.abs(np.diff(position, axis=0)).max(axis=0) / cycle_time
    counts = np.array([axis.counts_per_unit * axis.gear for axis in own])
    error = np.abs(found.column("following_error")[rows]).max(axis=0) / counts
    way = goal - start
    return Followed(error / (speed / gains), ((actual - goal) / way).max(axis=0))


def _cycles(axis: Axis, start: float, goal: float, cycle_time: float) -> int:
    """Of a move, and of a while after it."""
    if start == goal:
        return 1
    duration = plan(start, goal, axis.limits, cycle_time).duration
    return round((duration + _AFTER_S) / cycle_time)


def table(axis: Axis, start: float, goal: float, cycle_time: float) -> str:
    """The move, and a short one in the same direction, under each feed-forward."""
    kinds = axes(axis)
    own = list(kinds.values())
    unit = axis.unit or "units"
    rows = [("one move in virtual time, feed-forward by", list(kinds))]
    short = float(start + np.copysign(SHORT, goal - start))
    for end in (goal, short) if goal != start else (short,):
        seen = followed(own, start, end, cycle_time)
        way = f"{abs(end - start):g} {unit}"
        rows += [
            (f"{way}: largest 60F4h over v / Kp", [f"{x:.2%}" for x in seen.error]),
            (f"{way}: overshoot", [f"{x:.2%}" for x in seen.overshoot]),
        ]
    return "\n".join(
        f"{name:46}" + "".join(f"{cell:>18}" for cell in cells) for name, cells in rows
    )
