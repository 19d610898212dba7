"""Planned motions: way-points of N joints in time, checked and resampled.

A ``Trajectory`` is what a path planner hands over. Never here: profiles, shared memory, drives.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sjerk.errors import InputError, positive
from sjerk.limits import limits_of_each
from sjerk.profile import FloatArray, Limits
from sjerk.trajectory.columns import Columns
from sjerk.trajectory.faults import (
    FaultKind,
    TrajectoryError,
    TrajectoryFault,
    array,
    name_faults,
    row_faults,
    time_faults,
)
from sjerk.trajectory.files import read_bag, read_table, write_table

#: Two way-points are one where a joint differs by less than this share of its limit or delta.
RELATIVE = 1e-9
#: An end velocity below this share of its limit is rest; without limits, of the joint's largest.
REST = 1e-4


class ExecutionMode(enum.Enum):
    """What an executor takes from a trajectory."""

    SINGLE_POINT = "single_point"
    """Only the last point, by one planned move."""
    FULL_TRAJECTORY = "full_trajectory"
    """Every way-point, or those that resampling keeps."""


# ---- the trajectory ------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Way-points of N joints: n positions, each at its time.

    ``time`` (n,) in seconds from the start of the motion, strictly increasing, >= 0; ``position``
    and, optionally, ``velocity`` and ``acceleration`` (n, N), columns in the order of
    ``joint_names``, in the joints' own units. Arrays are copied and cannot be written to. Raises
    ``TrajectoryError`` with every fault found, each with its kind, point and joint.

    >>> wave = Trajectory(["a", "b"], [0.0, 0.1, 0.2], [[0, 0], [1, 2], [3, 3]])
    >>> len(wave), wave.duration, wave.velocity is None
    (3, 0.2, True)
    >>> Trajectory(["a"], [0.0, 0.1, 0.1], [[0.0], [1.0], [2.0]])
    Traceback (most recent call last):
    ...
    sjerk.trajectory.faults.TrajectoryError: point 2: time = 0.1 s does not follow 0.1 s
    """

    joint_names: tuple[str, ...]
    time: FloatArray
    position: FloatArray
    velocity: FloatArray | None
    acceleration: FloatArray | None

    def __init__(
        self,
        joint_names: Sequence[str],
        time: ArrayLike,
        position: ArrayLike,
        velocity: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> None:
        """Check and copy."""
        if isinstance(joint_names, str):
            raise InputError("joint_names", joint_names, "must be a sequence of names")
        names = tuple(map(str, joint_names))
        faults: list[TrajectoryFault] = []
        moments = array("time", time, faults)
        rows = {
            "position": array("position", position, faults),
            "velocity": None if velocity is None else array("velocity", velocity, faults),
            "acceleration": (
                None if acceleration is None else array("acceleration", acceleration, faults)
            ),
        }
        if faults:
            raise TrajectoryError(faults)
        assert moments is not None
        faults = [*name_faults(names), *time_faults(moments)]
        for name, row in rows.items():
            if row is not None and moments.ndim == 1:
                faults += row_faults(name, row, len(moments), names)
        if faults:
            raise TrajectoryError(faults)
        for name, value in (("joint_names", names), ("time", moments), *rows.items()):
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.time)

    def __repr__(self) -> str:
        joints = ", ".join(self.joint_names)
        return f"<Trajectory of {joints}: {len(self)} points in {self.duration:g} s>"

    @property
    def duration(self) -> float:
        """Time of the last point in seconds."""
        return float(self.time[-1])

    def take(self, points: ArrayLike) -> Trajectory:
        """The trajectory of these points only: whole points, with their times.

        ``points``: indices, strictly increasing, from 0.

        >>> Trajectory(["a"], [0.0, 1.0, 2.0], [[0.0], [1.0], [4.0]]).take([0, 2]).time.tolist()
        [0.0, 2.0]
        """
        i = np.asarray(points)
        if i.ndim != 1 or i.dtype.kind not in "iu":
            raise InputError("points", points, "must be a row of indices")
        if len(i) and not 0 <= int(i.min()) <= int(i.max()) < len(self):
            raise InputError("points", points, f"must lie in 0 .. {len(self) - 1}")
        rows = (x if x is None else x[i] for x in (self.position, self.velocity, self.acceleration))
        return Trajectory(self.joint_names, self.time[i], *rows)  # type: ignore[arg-type]

    def for_joints(self, joints: Sequence[str]) -> Trajectory:
        """The same motion with columns in the order of ``joints``: all of them, each once.

        Raises TrajectoryError (JOINTS) where a joint is missing or unknown.

        >>> Trajectory(["a", "b"], [0.0], [[1.0, 2.0]]).for_joints(["b", "a"]).position.tolist()
        [[2.0, 1.0]]
        """
        faults = self._joint_faults(tuple(joints))
        if faults:
            raise TrajectoryError(faults)
        i = [self.joint_names.index(joint) for joint in joints]
        rows = (
            x if x is None else x[:, i] for x in (self.position, self.velocity, self.acceleration)
        )
        return Trajectory(tuple(joints), self.time, *rows)  # type: ignore[arg-type]

    def faults(
        self,
        limits: Limits | Sequence[Limits] | Mapping[str, Limits] | None = None,
        *,
        joints: Sequence[str] | None = None,
        start: ArrayLike | None = None,
        start_tolerance: float = 1e-3,
        end_velocity_allowed: bool = False,
        begins: float | None = None,
        now: float = 0.0,
    ) -> tuple[TrajectoryFault, ...]:
        """Return every reason to refuse this trajectory on a machine; empty if there is none.

        ``limits``: one per joint, in the order of ``joint_names`` or by name: positions, and
        velocities and accelerations where given. ``joints``: those of the machine, any order.
        ``start`` (N,): where the joints are; a first point at time 0 further away than
        ``start_tolerance`` (the joint's unit) is a jump, a later one is a ramp. An end velocity
        that is no more than 1e-4 of its limit (else of the joint's largest) is 0. ``begins`` and
        ``now`` in seconds of one clock: the moment of time 0, and the present.

        >>> reach = Limits(1.0, 1.0, 1.0, position=(-1.0, 1.0))
        >>> far = Trajectory(["a"], [0.0, 3.0], [[0.0], [1.5]])
        >>> [(f.kind.value, f.point, f.joint) for f in far.faults([reach], start=[0.5])]
        [('position_limit', 1, 'a'), ('jump', 0, 'a')]
        """
        found: list[TrajectoryFault] = []
        if joints is not None:
            found += self._joint_faults(tuple(joints))
        if limits is not None:
            found += self._limit_faults(limits)
        if start is not None:
            found += self._jump_faults(start, start_tolerance)
        if self.velocity is not None and not end_velocity_allowed:
            found += self._end_faults(limits)
        if begins is not None and begins + self.duration < now:
            why = f"ended {now - begins - self.duration:g} s ago"
            found.append(TrajectoryFault(FaultKind.PAST, why, len(self) - 1))
        return tuple(found)

    def check(
        self, limits: Limits | Sequence[Limits] | Mapping[str, Limits] | None = None, **options: Any
    ) -> None:
        """Raise TrajectoryError with everything that ``faults`` (same arguments) finds."""
        found = self.faults(limits, **options)
        if found:
            raise TrajectoryError(found)

    def _joint_faults(self, joints: tuple[str, ...]) -> list[TrajectoryFault]:
        return [
            TrajectoryFault(FaultKind.JOINTS, f"is not one of {', '.join(joints)}", joint=joint)
            for joint in self.joint_names
            if joint not in joints
        ] + [
            TrajectoryFault(FaultKind.JOINTS, "is missing", joint=joint)
            for joint in joints
            if joint not in self.joint_names
        ]

    def limits_in_order(
        self, limits: Limits | Sequence[Limits] | Mapping[str, Limits]
    ) -> list[Limits]:
        """One ``Limits`` per joint in the order of ``joint_names``; raises InputError.

        ``limits``: one for all joints, one each in order, or by name.
        """
        if isinstance(limits, Mapping):
            missing = [joint for joint in self.joint_names if joint not in limits]
            if missing:
                raise InputError("limits", sorted(limits), f"must have {', '.join(missing)}")
            limits = [limits[joint] for joint in self.joint_names]
        return limits_of_each(limits, len(self.joint_names))

    def _limit_faults(
        self, limits: Limits | Sequence[Limits] | Mapping[str, Limits]
    ) -> list[TrajectoryFault]:
        found = []
        for i, (joint, limit) in enumerate(
            zip(self.joint_names, self.limits_in_order(limits), strict=True)
        ):
            if limit.position is not None:
                low, high = limit.position
                for point in np.flatnonzero(
                    (self.position[:, i] < low) | (self.position[:, i] > high)
                ):
                    why = f"position = {self.position[point, i]} lies outside {limit.position}"
                    found.append(TrajectoryFault(FaultKind.POSITION_LIMIT, why, int(point), joint))
            steepest = max(limit.acceleration, limit.braking[0])
            for kind, name, column, most in (
                (FaultKind.VELOCITY_LIMIT, "velocity", self.velocity, limit.velocity),
                (FaultKind.ACCELERATION_LIMIT, "acceleration", self.acceleration, steepest),
            ):
                if column is not None:
                    for point in np.flatnonzero(np.abs(column[:, i]) > most * (1.0 + RELATIVE)):
                        why = f"{name} = {column[point, i]} exceeds {most}"
                        found.append(TrajectoryFault(kind, why, int(point), joint))
        return found

    def _end_faults(
        self, limits: Limits | Sequence[Limits] | Mapping[str, Limits] | None
    ) -> list[TrajectoryFault]:
        """Planners leave what rounding makes of 0; as small as that it is an end at rest."""
        assert self.velocity is not None
        most = np.abs(self.velocity).max(axis=0)
        if limits is not None:
            most = np.array([limit.velocity for limit in self.limits_in_order(limits)])
        return [
            TrajectoryFault(
                FaultKind.END_VELOCITY,
                f"velocity = {speed} at the end, must be 0 (within {REST:g} of {full:g})",
                len(self) - 1,
                joint,
            )
            for joint, speed, full in zip(self.joint_names, self.velocity[-1], most, strict=True)
            if abs(speed) > REST * full
        ]

    def _jump_faults(self, start: ArrayLike, tolerance: float) -> list[TrajectoryFault]:
        here = np.asarray(start, dtype=np.float64)
        if here.shape != (len(self.joint_names),):
            raise InputError("start", here.shape, f"must have shape ({len(self.joint_names)},)")
        if self.time[0] > 0.0:
            return []
        return [
            TrajectoryFault(
                FaultKind.JUMP, f"position = {there}, the joint is at {where}", 0, joint
            )
            for joint, there, where in zip(self.joint_names, self.position[0], here, strict=True)
            if not abs(there - where) <= tolerance
        ]

    # ---- files

    @classmethod
    def from_csv(cls, path: str | Path) -> Trajectory:
        """Read a table: ``time`` (or ``time_s``), then per joint its name, ``name.velocity``, ....

        Velocities and accelerations are for all joints or for none. Raises TrajectoryError, with
        the point where a row is not numbers; RecordedPathError where there is no file, or no text.
        """
        return cls(*read_table(Path(path)))

    def to_csv(self, path: str | Path) -> None:
        """Write what ``from_csv`` reads, every bit of it."""
        columns = Columns(
            self.joint_names, self.time, self.position, self.velocity, self.acceleration
        )
        write_table(Path(path), columns)

    @classmethod
    def from_bag(cls, path: str | Path) -> Trajectory:
        """Read a ROS 2 bag (MCAP or SQLite, file or folder): the first JointTrajectory in it.

        Without one, its JointState messages are a path, by the stamps they were recorded at. Needs
        the extra ``demo`` (rosbags). Raises RecordedPathError for what is no bag, TrajectoryError
        with point and joint for what is no trajectory.
        """
        return cls(*read_bag(Path(path)))


# ---- resampling ----------------------------------------------------------------------------------


def resample(points: ArrayLike, delta: float) -> NDArray[np.intp]:
    """Thin a path from its end: return the indices of the points that are kept, increasing.

    ``points`` (n, N) or (n,), ``delta`` > 0 in the joints' unit. The last point is always kept;
    walking towards the start, a point is kept when any joint differs from the last kept one by at
    least ``delta``, compared with a relative tolerance of 1e-9. There is no special case for the
    first point. Whole path points are kept: use ``Trajectory.take``. Raises InputError.

    >>> joint_1 = [0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.2, 1.4, 1.6]
    >>> joint_2 = [0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.0, 1.0, 1.0]
    >>> resample(np.column_stack([joint_1, joint_2]), 0.5).tolist()
    [2, 5, 8]
    >>> resample([0.0, 0.5, 1.0, 1.5], 0.5).tolist()
    [0, 1, 2, 3]
    """
    delta = positive("delta", delta)
    path = np.asarray(points, dtype=np.float64)
    if path.ndim == 1:
        path = path[:, None]
    if path.ndim != 2 or path.shape[1] == 0:
        raise InputError("points", path.shape, "must have shape (n, N) or (n,)")
    wrong = np.flatnonzero(~np.isfinite(path).all(axis=1))
    if len(wrong):
        i = int(wrong[0])
        raise InputError(f"points[{i}]", path[i].tolist(), "must be finite")
    least = delta * (1.0 - RELATIVE)
    kept: list[int] = []
    i = len(path) - 1
    while i >= 0:
        kept.append(i)
        # the next one back that is far enough, looked for in growing blocks
        reference, block, found = path[i], 16, -1
        high = i
        while high > 0 and found < 0:
            low = max(0, high - block)
            far = np.flatnonzero((np.abs(path[low:high] - reference) >= least).any(axis=1))
            found = low + int(far[-1]) if len(far) else -1
            high, block = low, 4 * block
        i = found
    return np.array(kept[::-1], dtype=np.intp)
