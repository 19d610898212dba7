"""Recorded and planned motions: N joints in time, checked, resampled, read from files.

A ``Trajectory`` is what a path planner hands over, a ``Recording`` one joint of it in degrees.
Never here: profiles, shared memory, drives.
"""

from __future__ import annotations

import csv
import enum
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sjerk.errors import InputError, SjerkError, positive
from sjerk.profile import FloatArray, Limits

CSV_HEADER = ["time_s", "position_deg"]
#: Two way-points are one where a joint differs by less than this share of its limit or delta.
RELATIVE = 1e-9


class ExecutionMode(enum.Enum):
    """What an executor takes from a trajectory."""

    SINGLE_POINT = "single_point"  #: only the last point, by one planned move
    FULL_TRAJECTORY = "full_trajectory"  #: every (resampled) way-point


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


def limits_of(limits: Limits | Sequence[Limits], joints: int) -> list[Limits]:
    """One ``Limits`` per joint: as they are, or one for all; raises InputError."""
    if isinstance(limits, Limits):
        return [limits] * joints
    if isinstance(limits, (str, bytes)) or not isinstance(limits, Iterable):
        raise InputError("limits", limits, "must be Limits, one per joint or one for all")
    row = list(limits)
    for i, limit in enumerate(row):
        if not isinstance(limit, Limits):
            raise InputError(f"limits[{i}]", limit, "must be Limits")
    if len(row) != joints:
        raise InputError("limits", len(row), f"must be one per joint: {joints}")
    return row


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
    sjerk.trajectory.trajectory.TrajectoryError: point 2: time = 0.1 s does not follow 0.1 s
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
        faults: list[Fault] = []
        moments = _array("time", time, faults)
        rows = {
            "position": _array("position", position, faults),
            "velocity": None if velocity is None else _array("velocity", velocity, faults),
            "acceleration": (
                None if acceleration is None else _array("acceleration", acceleration, faults)
            ),
        }
        if faults:
            raise TrajectoryError(faults)
        assert moments is not None
        faults = [*_name_faults(names), *_time_faults(moments)]
        for name, row in rows.items():
            if row is not None and moments.ndim == 1:
                faults += _row_faults(name, row, len(moments), names)
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
    ) -> tuple[Fault, ...]:
        """Return every reason to refuse this trajectory on a machine; empty if there is none.

        ``limits``: one per joint, in the order of ``joint_names`` or by name: positions, and
        velocities and accelerations where given. ``joints``: those of the machine, any order.
        ``start`` (N,): where the joints are; a first point at time 0 further away than
        ``start_tolerance`` (the joint's unit) is a jump, a later one is a ramp. ``begins`` and
        ``now`` in seconds of one clock: the moment of time 0, and the present.

        >>> reach = Limits(1.0, 1.0, 1.0, position=(-1.0, 1.0))
        >>> far = Trajectory(["a"], [0.0, 3.0], [[0.0], [1.5]])
        >>> [(f.kind.value, f.point, f.joint) for f in far.faults([reach], start=[0.5])]
        [('position_limit', 1, 'a'), ('jump', 0, 'a')]
        """
        found: list[Fault] = []
        if joints is not None:
            found += self._joint_faults(tuple(joints))
        if limits is not None:
            found += self._limit_faults(limits)
        if start is not None:
            found += self._jump_faults(start, start_tolerance)
        if self.velocity is not None and not end_velocity_allowed:
            last = len(self) - 1
            for joint, speed in zip(self.joint_names, self.velocity[-1], strict=True):
                if speed != 0.0:
                    why = f"velocity = {speed} at the end, must be 0"
                    found.append(Fault(FaultKind.END_VELOCITY, why, last, joint))
        if begins is not None and begins + self.duration < now:
            why = f"ended {now - begins - self.duration:g} s ago"
            found.append(Fault(FaultKind.PAST, why, len(self) - 1))
        return tuple(found)

    def check(
        self, limits: Limits | Sequence[Limits] | Mapping[str, Limits] | None = None, **options: Any
    ) -> None:
        """Raise TrajectoryError with everything that ``faults`` (same arguments) finds."""
        found = self.faults(limits, **options)
        if found:
            raise TrajectoryError(found)

    def _joint_faults(self, joints: tuple[str, ...]) -> list[Fault]:
        return [
            Fault(FaultKind.JOINTS, f"is not one of {', '.join(joints)}", joint=joint)
            for joint in self.joint_names
            if joint not in joints
        ] + [
            Fault(FaultKind.JOINTS, "is missing", joint=joint)
            for joint in joints
            if joint not in self.joint_names
        ]

    def limits_in_order(
        self, limits: Limits | Sequence[Limits] | Mapping[str, Limits]
    ) -> list[Limits]:
        """One ``Limits`` per joint in the order of ``joint_names``; raises InputError."""
        if isinstance(limits, Mapping):
            missing = [joint for joint in self.joint_names if joint not in limits]
            if missing:
                raise InputError("limits", sorted(limits), f"must have {', '.join(missing)}")
            limits = [limits[joint] for joint in self.joint_names]
        return limits_of(limits, len(self.joint_names))

    def _limit_faults(self, limits: Limits | Sequence[Limits] | Mapping[str, Limits]) -> list[Fault]:
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
                    found.append(Fault(FaultKind.POSITION_LIMIT, why, int(point), joint))
            steepest = max(limit.acceleration, limit.braking[0])
            for kind, name, column, most in (
                (FaultKind.VELOCITY_LIMIT, "velocity", self.velocity, limit.velocity),
                (FaultKind.ACCELERATION_LIMIT, "acceleration", self.acceleration, steepest),
            ):
                if column is not None:
                    for point in np.flatnonzero(np.abs(column[:, i]) > most * (1.0 + RELATIVE)):
                        why = f"{name} = {column[point, i]} exceeds {most}"
                        found.append(Fault(kind, why, int(point), joint))
        return found

    def _jump_faults(self, start: ArrayLike, tolerance: float) -> list[Fault]:
        here = np.asarray(start, dtype=np.float64)
        if here.shape != (len(self.joint_names),):
            raise InputError("start", here.shape, f"must have shape ({len(self.joint_names)},)")
        if self.time[0] > 0.0:
            return []
        return [
            Fault(FaultKind.JUMP, f"position = {there}, the joint is at {where}", 0, joint)
            for joint, there, where in zip(self.joint_names, self.position[0], here, strict=True)
            if not abs(there - where) <= tolerance
        ]

    # ---- files

    @classmethod
    def from_csv(cls, path: str | Path) -> Trajectory:
        """Read a table: ``time`` (or ``time_s``), then per joint its name, ``name.velocity``, ....

        Velocities and accelerations are for all joints or for none. Raises TrajectoryError, with
        the point where a row is not numbers; RecordingError where there is no file, or no text.
        """
        path = Path(path)
        if not path.exists():
            raise RecordingError(path, "no such file")
        try:
            header, table = _numbers(path)
        except (OSError, UnicodeDecodeError, csv.Error) as error:
            raise RecordingError(path, f"cannot be read ({error})") from error
        if not header or header[0] not in ("time", "time_s"):
            raise TrajectoryError(
                [Fault(FaultKind.SIZE, f"{path}: the header {header} does not begin with 'time'")]
            )
        names = [name for name in header[1:] if not name.endswith((".velocity", ".acceleration"))]
        columns = {name: table[:, i] for i, name in enumerate(header)}
        if len(columns) != len(header):
            twice = next(name for name in header if header.count(name) > 1)
            raise TrajectoryError([Fault(FaultKind.DUPLICATE, "is named twice", joint=twice)])
        further: list[FloatArray | None] = []
        for kind in ("velocity", "acceleration"):
            there = [f"{name}.{kind}" in columns for name in names]
            if any(there) and not all(there):
                without = names[there.index(False)]
                raise TrajectoryError([Fault(FaultKind.SIZE, f"no {kind}", joint=without)])
            further.append(
                np.column_stack([columns[f"{name}.{kind}"] for name in names])
                if any(there)
                else None
            )
        unknown = set(header[1:]) - {
            f"{name}{kind}" for name in names for kind in ("", ".velocity", ".acceleration")
        }
        if unknown:
            raise TrajectoryError(
                [Fault(FaultKind.SIZE, "has no position", joint=n) for n in sorted(unknown)]
            )
        position = (
            np.column_stack([columns[n] for n in names]) if names else np.empty((len(table), 0))
        )
        return cls(names, table[:, 0], position, *further)

    def to_csv(self, path: str | Path) -> None:
        """Write what ``from_csv`` reads, every bit of it."""
        header = ["time", *self.joint_names]
        columns = [self.time[:, None], self.position]
        for kind, rows in (("velocity", self.velocity), ("acceleration", self.acceleration)):
            if rows is not None:
                header += [f"{name}.{kind}" for name in self.joint_names]
                columns.append(rows)
        with Path(path).open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(header)
            writer.writerows([repr(float(x)) for x in row] for row in np.hstack(columns))

    @classmethod
    def from_bag(cls, path: str | Path) -> Trajectory:
        """Read a ROS 2 bag (MCAP or SQLite, file or folder): the first JointTrajectory in it.

        Without one, its JointState messages are a path, by the stamps they were recorded at. Needs
        the extra ``demo`` (rosbags). Raises RecordingError for what is no bag, TrajectoryError with
        point and joint for what is no trajectory.
        """
        path = Path(path)
        if not path.exists():
            raise RecordingError(path, "no such file")
        names, points = _points(path)
        width = len(names)
        faults = []
        for i, point in enumerate(points):
            for kind in ("positions", "velocities", "accelerations"):
                size = len(getattr(point, kind))
                if size != width and (size or kind == "positions"):
                    why = f"{size} {kind} for {width} joints"
                    faults.append(Fault(FaultKind.SIZE, why, i))
        if faults:
            raise TrajectoryError(faults)
        time = np.array([point.time for point in points])
        if points and points[0].stamped:
            time -= time[0]
        rows = [np.array([p.positions for p in points], dtype=np.float64).reshape(-1, width)]
        for kind in ("velocities", "accelerations"):
            values = [getattr(p, kind) for p in points]
            rows.append(np.array(values) if points and all(map(len, values)) else None)  # type: ignore[arg-type]
        return cls(names, time, *rows)


def _array(name: str, value: ArrayLike, faults: list[Fault]) -> FloatArray | None:
    try:
        return np.array(value, dtype=np.float64, order="C")
    except (TypeError, ValueError):
        faults.append(Fault(FaultKind.SIZE, f"{name}: no regular array of numbers"))
        return None


def _name_faults(names: tuple[str, ...]) -> list[Fault]:
    if not names:
        return [Fault(FaultKind.EMPTY, "no joints")]
    twice = sorted({name for name in names if names.count(name) > 1})
    return [Fault(FaultKind.DUPLICATE, "is named twice", joint=name) for name in twice]


def _time_faults(time: FloatArray) -> list[Fault]:
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


def _row_faults(name: str, rows: FloatArray, points: int, names: tuple[str, ...]) -> list[Fault]:
    if rows.shape != (points, len(names)):
        why = f"{name} has shape {rows.shape}, must be ({points}, {len(names)})"
        return [Fault(FaultKind.SIZE, why)]
    return [
        Fault(FaultKind.NOT_FINITE, f"{name} = {rows[i, k]} is not finite", int(i), names[int(k)])
        for i, k in np.argwhere(~np.isfinite(rows))
    ]


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


# ---- recordings ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Recording:
    """One joint's recorded path: ``time`` (n,) in seconds from 0, ``position`` (n,) in degrees."""

    joint: str
    time: FloatArray
    position: FloatArray


def shipped_recording() -> Path:
    """Return the recording that comes with sjerk: a TOPP-RA plan of a Panda arm.

    An MCAP bag of all joints; where rosbags is not installed, the CSV of its first joint.
    """
    name = "panda.mcap" if find_spec("rosbags") else "panda_joint1.csv"
    return Path(str(files("sjerk") / "data" / name))


def read_recording(path: str | Path, *, joint: str | None = None) -> Recording:
    """Read a time-parameterised path of one joint.

    ``path``: a CSV file with the header ``time_s,position_deg``, or a ROS 2 bag (MCAP or SQLite,
    file or folder) with JointTrajectory or JointState messages in radians; ``joint`` is then the
    joint's name (default: the first). Bags need the extra ``demo`` (rosbags).

    Raises RecordingError: no such file, no points, not numbers, time not increasing.
    """
    path = Path(path)
    if not path.exists():
        raise RecordingError(path, "no such file")
    try:
        found = _read_csv(path) if path.suffix.lower() == ".csv" else _read_bag(path, joint)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise RecordingError(path, f"cannot be read ({error})") from error
    return _checked(path, found)


def _checked(path: Path, recording: Recording) -> Recording:
    time, position = recording.time, recording.position
    if len(time) < 2:
        raise RecordingError(path, f"{len(time)} points, at least 2 are needed")
    try:
        Trajectory([recording.joint], time - time[0], position[:, None])
    except TrajectoryError as error:
        first = error.faults[0]
        raise RecordingError(path, first.why, first.point) from None
    return Recording(recording.joint, time - time[0], position)


def _read_csv(path: Path) -> Recording:
    with path.open(newline="") as file:
        header = [cell.strip() for cell in next(csv.reader(file), [])]
    if header != CSV_HEADER:
        raise RecordingError(path, f"the header is {header}, not {CSV_HEADER}")
    try:
        _, table = _numbers(path)
    except TrajectoryError as error:
        first = error.faults[0]
        raise RecordingError(path, first.why, first.point) from None
    return Recording(path.stem, table[:, 0].copy(), table[:, 1].copy())


_COUNTS = ("no", "one", "two", "three")


def _numbers(path: Path) -> tuple[list[str], FloatArray]:
    """Header and rows of a table."""
    with path.open(newline="") as file:
        reader = csv.reader(file)
        header = [cell.strip() for cell in next(reader, [])]
        count = _COUNTS[len(header)] if len(header) < len(_COUNTS) else str(len(header))
        rows = []
        for i, row in enumerate(reader):
            try:
                numbers = [float(cell) for cell in row]
            except ValueError:
                numbers = []
            if len(numbers) != len(header):
                raise TrajectoryError([Fault(FaultKind.SIZE, f"{row} is not {count} numbers", i)])
            rows.append(numbers)
    return header, np.array(rows, dtype=np.float64).reshape(len(rows), len(header))


class _Point(NamedTuple):
    """One way-point of a message; ``stamped``: its time is when it was recorded."""

    time: float
    stamped: bool
    positions: Sequence[float]
    velocities: Sequence[float]
    accelerations: Sequence[float]


def _messages(path: Path) -> Iterator[tuple[list[str], list[_Point]]]:
    """Joint names and points of each message; a JointTrajectory is a whole motion and the last."""
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    except ImportError as missing:
        raise RecordingError(
            path, "reading a bag needs rosbags (pip install 'sjerk[demo]'); a CSV does not"
        ) from missing
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as bag:
            for connection, stamp, raw in bag.messages():
                kind = connection.msgtype
                if kind == "trajectory_msgs/msg/JointTrajectory":
                    message: Any = bag.deserialize(raw, kind)
                    points = [
                        _Point(
                            p.time_from_start.sec + p.time_from_start.nanosec * 1e-9,
                            False,
                            p.positions,
                            p.velocities,
                            p.accelerations,
                        )
                        for p in message.points
                    ]
                    yield list(message.joint_names), points
                    return
                if kind == "sensor_msgs/msg/JointState":
                    message = bag.deserialize(raw, kind)
                    point = _Point(stamp * 1e-9, True, message.position, message.velocity, ())
                    yield list(message.name), [point]
    except (AnyReaderError, OSError) as error:
        raise RecordingError(path, f"is no readable bag ({error})") from error


def _points(path: Path) -> tuple[list[str], list[_Point]]:
    """All points of the motion in a bag, in the joint order of its first message."""
    names: list[str] | None = None
    points: list[_Point] = []
    for joints, more in _messages(path):
        if names is None:
            names = joints
        elif joints != names:
            why = f"names {', '.join(joints)}, the first {', '.join(names)}"
            raise TrajectoryError([Fault(FaultKind.JOINTS, why, len(points))])
        points += more
    if names is None:
        raise RecordingError(path, "holds no JointTrajectory and no JointState")
    return names, points


def _read_bag(path: Path, joint: str | None) -> Recording:
    rows: list[tuple[float, float]] = []
    name = joint
    for joints, points in _messages(path):
        name, column = _column(path, joints, name)
        rows += [
            (point.time, _pick(path, point.positions, column, len(rows) + i))
            for i, point in enumerate(points)
        ]
    if name is None or not rows:
        raise RecordingError(path, "holds no JointTrajectory and no JointState")
    columns = np.array(rows).T.copy()
    return Recording(name, columns[0], np.degrees(columns[1]))


def _column(path: Path, names: list[str], joint: str | None) -> tuple[str, int]:
    if not names:
        raise RecordingError(path, "a message names no joints")
    if joint is None:
        return names[0], 0
    if joint not in names:
        raise InputError("joint", joint, f"{path} has {', '.join(names)}")
    return joint, names.index(joint)


def _pick(path: Path, positions: Any, column: int, point: int) -> float:
    if column >= len(positions):
        raise RecordingError(
            path, f"has {len(positions)} positions, joint {column} is missing", point
        )
    value = float(positions[column])
    if not math.isfinite(value):
        raise RecordingError(path, f"position = {value} is not finite", point)
    return value
