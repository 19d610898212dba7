"""Why a trajectory or a recording cannot be used, and the checks of the arrays they are made of.

Never here: files, profiles, shared memory, drives.
"""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from sjerk.errors import SjerkError
from sjerk.profile import FloatArray


class FaultKind(enum.Enum):
    """Why a trajectory is refused."""

    EMPTY = "empty"
    """It has no joints or no points."""
    DUPLICATE = "duplicate"
    """A joint is named twice."""
    JOINTS = "joints"
    """Its joints are not those of the machine."""
    SIZE = "size"
    """An array has the wrong shape."""
    NOT_FINITE = "not_finite"
    """A number is infinite or not a number."""
    TIME = "time"
    """A point is before the start, or not after the point before it."""
    END_VELOCITY = "end_velocity"
    """The last point has a velocity."""
    POSITION_LIMIT = "position_limit"
    """A position is outside its range."""
    VELOCITY_LIMIT = "velocity_limit"
    """A velocity is beyond its limit."""
    ACCELERATION_LIMIT = "acceleration_limit"
    """An acceleration is beyond its limit."""
    JUMP = "jump"
    """The first point is not where the joint is."""
    PAST = "past"
    """The whole trajectory lies before the present."""

    @property
    def code(self) -> int:
        """The error code of control_msgs/FollowJointTrajectory.

        -1 INVALID_GOAL, -2 INVALID_JOINTS or -3 OLD_HEADER_TIMESTAMP.

        >>> FaultKind.JUMP.code, FaultKind.JOINTS.code, FaultKind.PAST.code
        (-1, -2, -3)
        """
        if self is FaultKind.PAST:
            return -3
        return -2 if self in (FaultKind.JOINTS, FaultKind.DUPLICATE) else -1


@dataclass(frozen=True)
class TrajectoryFault:
    """One reason to refuse a trajectory: ``point`` from 0, ``joint`` by name, where they apply.

    >>> print(TrajectoryFault(FaultKind.TIME, "time = 0.1 s does not follow 0.1 s", 2))
    point 2: time = 0.1 s does not follow 0.1 s
    """

    kind: FaultKind
    why: str
    point: int | None = None
    joint: str | None = None

    def __str__(self) -> str:
        where = [] if self.point is None else [f"point {self.point}"]
        where += [] if self.joint is None else [f"joint {self.joint}"]
        return f"{', '.join(where)}: {self.why}" if where else self.why


class TrajectoryError(SjerkError, ValueError):
    """A trajectory cannot be used; ``faults`` says why, at least one.

    >>> TrajectoryError([TrajectoryFault(FaultKind.JOINTS, "is missing", joint="a")]).code
    -2
    """

    def __init__(self, faults: Sequence[TrajectoryFault]) -> None:
        more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
        super().__init__(f"{faults[0]}{more}")
        self.faults = tuple(faults)

    @property
    def code(self) -> int:
        """The error code of control_msgs/FollowJointTrajectory of the first fault."""
        return self.faults[0].kind.code


class RecordedPathError(SjerkError, ValueError):
    """A file of a motion cannot be used: ``path``, and the ``point`` from 0 that fails, or None."""

    def __init__(self, path: Path, why: str, point: int | None = None) -> None:
        where = f"{path}" if point is None else f"{path}, point {point}"
        super().__init__(f"{where}: {why}")
        self.path = path
        self.point = point


# ---- checks --------------------------------------------------------------------------------------


def array(name: str, value: ArrayLike, faults: list[TrajectoryFault]) -> FloatArray | None:
    """A value as a float64 array of its own; None, and a fault in ``faults``, where it is none."""
    try:
        return np.array(value, dtype=np.float64, order="C")
    except (TypeError, ValueError):
        faults.append(TrajectoryFault(FaultKind.SIZE, f"{name}: no regular array of numbers"))
        return None


def name_faults(names: tuple[str, ...]) -> list[TrajectoryFault]:
    """Faults of the names of joints: none, or one twice."""
    if not names:
        return [TrajectoryFault(FaultKind.EMPTY, "no joints")]
    twice = sorted({name for name in names if names.count(name) > 1})
    return [TrajectoryFault(FaultKind.DUPLICATE, "is named twice", joint=name) for name in twice]


def time_faults(time: FloatArray) -> list[TrajectoryFault]:
    """Faults of the times (n,): their shape, their values, their order."""
    if time.ndim != 1:
        return [TrajectoryFault(FaultKind.SIZE, f"time has shape {time.shape}, must be (n,)")]
    if not len(time):
        return [TrajectoryFault(FaultKind.EMPTY, "no points")]
    wrong = np.flatnonzero(~np.isfinite(time))
    if len(wrong):
        return [
            TrajectoryFault(FaultKind.NOT_FINITE, f"time = {time[i]} is not finite", int(i))
            for i in wrong
        ]
    faults = []
    if time[0] < 0.0:
        faults.append(TrajectoryFault(FaultKind.TIME, f"time = {time[0]} s is before the start", 0))
    for i in np.flatnonzero(np.diff(time) <= 0.0) + 1:
        why = f"time = {time[i]} s does not follow {time[i - 1]} s"
        faults.append(TrajectoryFault(FaultKind.TIME, why, int(i)))
    return faults


def row_faults(
    name: str, rows: FloatArray, points: int, names: tuple[str, ...]
) -> list[TrajectoryFault]:
    """Faults of the rows (n, N) of one kind: their shape, their values."""
    if rows.shape != (points, len(names)):
        why = f"{name} has shape {rows.shape}, must be ({points}, {len(names)})"
        return [TrajectoryFault(FaultKind.SIZE, why)]
    return [
        TrajectoryFault(
            FaultKind.NOT_FINITE, f"{name} = {rows[i, k]} is not finite", int(i), names[int(k)]
        )
        for i, k in np.argwhere(~np.isfinite(rows))
    ]
