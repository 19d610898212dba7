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
    """Why a trajectory is refused; ``code`` is FollowJointTrajectory's error code for it."""

    EMPTY = "empty"  #: no joints or no points
    DUPLICATE = "duplicate"  #: a joint is named twice
    JOINTS = "joints"  #: not the joints that are there
    SIZE = "size"  #: an array of the wrong shape
    NOT_FINITE = "not_finite"
    TIME = "time"  #: before the start, or not after the point before
    END_VELOCITY = "end_velocity"  #: the last point does not rest
    POSITION_LIMIT = "position_limit"
    VELOCITY_LIMIT = "velocity_limit"
    ACCELERATION_LIMIT = "acceleration_limit"
    JUMP = "jump"  #: the first point is not where the joint is
    PAST = "past"  #: all of it lies before now

    @property
    def code(self) -> int:
        """-1 INVALID_GOAL, -2 INVALID_JOINTS or -3 OLD_HEADER_TIMESTAMP."""
        if self is FaultKind.PAST:
            return -3
        return -2 if self in (FaultKind.JOINTS, FaultKind.DUPLICATE) else -1


@dataclass(frozen=True)
class Fault:
    """One reason to refuse: ``point`` from 0 and ``joint`` by name, where they apply."""

    kind: FaultKind
    why: str
    point: int | None = None
    joint: str | None = None

    def __str__(self) -> str:
        where = [] if self.point is None else [f"point {self.point}"]
        where += [] if self.joint is None else [f"joint {self.joint}"]
        return f"{', '.join(where)}: {self.why}" if where else self.why


class TrajectoryError(SjerkError, ValueError):
    """A trajectory cannot be used; ``faults`` says why, at least one."""

    def __init__(self, faults: Sequence[Fault]) -> None:
        more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
        super().__init__(f"{faults[0]}{more}")
        self.faults = tuple(faults)

    @property
    def code(self) -> int:
        """FollowJointTrajectory's error code of the first fault."""
        return self.faults[0].kind.code


class RecordingError(SjerkError, ValueError):
    """A recording cannot be used: ``path``, and the ``point`` (from 0) where it fails, or None."""

    def __init__(self, path: Path, why: str, point: int | None = None) -> None:
        where = f"{path}" if point is None else f"{path}, point {point}"
        super().__init__(f"{where}: {why}")
        self.path = path
        self.point = point


# ---- checks --------------------------------------------------------------------------------------


def array(name: str, value: ArrayLike, faults: list[Fault]) -> FloatArray | None:
    try:
        return np.array(value, dtype=np.float64, order="C")
    except (TypeError, ValueError):
        faults.append(Fault(FaultKind.SIZE, f"{name}: no regular array of numbers"))
        return None


def name_faults(names: tuple[str, ...]) -> list[Fault]:
    if not names:
        return [Fault(FaultKind.EMPTY, "no joints")]
    twice = sorted({name for name in names if names.count(name) > 1})
    return [Fault(FaultKind.DUPLICATE, "is named twice", joint=name) for name in twice]


def time_faults(time: FloatArray) -> list[Fault]:
    if time.ndim != 1:
        return [Fault(FaultKind.SIZE, f"time has shape {time.shape}, must be (n,)")]
    if not len(time):
        return [Fault(FaultKind.EMPTY, "no points")]
    wrong = np.flatnonzero(~np.isfinite(time))
    if len(wrong):
        return [
            Fault(FaultKind.NOT_FINITE, f"time = {time[i]} is not finite", int(i)) for i in wrong
        ]
    faults = []
    if time[0] < 0.0:
        faults.append(Fault(FaultKind.TIME, f"time = {time[0]} s is before the start", 0))
    for i in np.flatnonzero(np.diff(time) <= 0.0) + 1:
        why = f"time = {time[i]} s does not follow {time[i - 1]} s"
        faults.append(Fault(FaultKind.TIME, why, int(i)))
    return faults


def row_faults(name: str, rows: FloatArray, points: int, names: tuple[str, ...]) -> list[Fault]:
    if rows.shape != (points, len(names)):
        why = f"{name} has shape {rows.shape}, must be ({points}, {len(names)})"
        return [Fault(FaultKind.SIZE, why)]
    return [
        Fault(FaultKind.NOT_FINITE, f"{name} = {rows[i, k]} is not finite", int(i), names[int(k)])
        for i, k in np.argwhere(~np.isfinite(rows))
    ]
