"""Files of motions: tables (CSV) and ROS 2 bags (MCAP, SQLite), read into arrays, and written.

A ``RecordedPath`` is one joint of a recorded motion in degrees. Never here: what a trajectory is
checked for beyond its arrays; profiles, shared memory, drives.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sjerk.errors import ExtraMissingError, InputError
from sjerk.extras import load
from sjerk.profile import FloatArray
from sjerk.trajectory.columns import Columns, columns_of
from sjerk.trajectory.faults import (
    FaultKind,
    RecordedPathError,
    TrajectoryError,
    TrajectoryFault,
    row_faults,
    time_faults,
)

CSV_HEADER = ["time_s", "position_deg"]


class Point(NamedTuple):
    """One way-point of a message; ``stamped``: its time is when it was recorded."""

    time: float
    stamped: bool
    positions: Sequence[float]
    velocities: Sequence[float]
    accelerations: Sequence[float]


#: Joint names and points of one message.
Message = tuple[list[str], list[Point]]


# ---- trajectories --------------------------------------------------------------------------------


def read_table(path: Path) -> Columns:
    """The columns of a CSV file, as ``Trajectory.from_csv`` describes it; raises as that does."""
    if not path.exists():
        raise RecordedPathError(path, "no such file")
    try:
        header, table = _numbers(path)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise RecordedPathError(path, f"cannot be read ({error})") from error
    if not header or header[0] not in ("time", "time_s"):
        raise TrajectoryError(
            [
                TrajectoryFault(
                    FaultKind.SIZE, f"{path}: the header {header} does not begin with 'time'"
                )
            ]
        )
    names = [name for name in header[1:] if not name.endswith((".velocity", ".acceleration"))]
    columns = {name: table[:, i] for i, name in enumerate(header)}
    if len(columns) != len(header):
        twice = next(name for name in header if header.count(name) > 1)
        raise TrajectoryError([TrajectoryFault(FaultKind.DUPLICATE, "is named twice", joint=twice)])
    further: list[FloatArray | None] = []
    for kind in ("velocity", "acceleration"):
        there = [f"{name}.{kind}" in columns for name in names]
        if any(there) and not all(there):
            without = names[there.index(False)]
            raise TrajectoryError([TrajectoryFault(FaultKind.SIZE, f"no {kind}", joint=without)])
        further.append(
            np.column_stack([columns[f"{name}.{kind}"] for name in names]) if any(there) else None
        )
    unknown = set(header[1:]) - {
        f"{name}{kind}" for name in names for kind in ("", ".velocity", ".acceleration")
    }
    if unknown:
        raise TrajectoryError(
            [TrajectoryFault(FaultKind.SIZE, "has no position", joint=n) for n in sorted(unknown)]
        )
    position = np.column_stack([columns[n] for n in names]) if names else np.empty((len(table), 0))
    return Columns(names, table[:, 0], position, *further)


def write_table(path: Path, columns: Columns) -> None:
    """Write what ``read_table`` reads, every bit of it."""
    header = ["time", *columns.joint_names]
    table = [columns.time[:, None], columns.position]
    for kind, rows in (("velocity", columns.velocity), ("acceleration", columns.acceleration)):
        if rows is not None:
            header += [f"{name}.{kind}" for name in columns.joint_names]
            table.append(rows)
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        writer.writerows([repr(float(x)) for x in row] for row in np.hstack(table))


def read_bag(path: Path) -> Columns:
    """The columns of the first trajectory in a ROS 2 bag; raises as ``Trajectory.from_bag``."""
    if not path.exists():
        raise RecordedPathError(path, "no such file")
    names, points = _points(path)
    time = np.array([point.time for point in points])
    if points and points[0].stamped:
        time -= time[0]
    return columns_of(names, time, points)


# ---- recordings ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class RecordedPath:
    """The recorded path of one joint: ``time`` (n,) in s from 0, ``position`` (n,) in degrees.

    >>> path = read_recording(shipped_recording().with_name("panda_joint1.csv"))
    >>> path.joint, len(path.time), float(path.position[-1])
    ('panda_joint1', 54, 160.0)
    """

    joint: str
    time: FloatArray
    position: FloatArray


def shipped_recording() -> Path:
    """Return the recording that comes with sjerk: a TOPP-RA plan of a Panda arm.

    An MCAP bag of all joints; where rosbags is not installed, the CSV of its first joint.
    """
    name = "panda.mcap" if find_spec("rosbags") else "panda_joint1.csv"
    return Path(str(files("sjerk") / "data" / name))


def read_recording(path: str | Path, *, joint: str | None = None) -> RecordedPath:
    """Read a time-parameterised path of one joint.

    ``path``: a CSV file with the header ``time_s,position_deg``, or a ROS 2 bag (MCAP or SQLite,
    file or folder) with JointTrajectory or JointState messages in radians; ``joint`` is then the
    joint's name (default: the first). Bags need the extra ``demo`` (rosbags).

    Raises RecordedPathError: no such file, no points, not numbers, time not increasing.
    """
    path = Path(path)
    if not path.exists():
        raise RecordedPathError(path, "no such file")
    try:
        found = _read_csv(path) if path.suffix.lower() == ".csv" else _read_bag(path, joint)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise RecordedPathError(path, f"cannot be read ({error})") from error
    return _checked(path, found)


def _checked(path: Path, recording: RecordedPath) -> RecordedPath:
    time, position = recording.time, recording.position
    if len(time) < 2:
        raise RecordedPathError(path, f"{len(time)} points, at least 2 are needed")
    time, names = time - time[0], (recording.joint,)
    faults = time_faults(time) or row_faults("position", position[:, None], len(time), names)
    if faults:
        raise RecordedPathError(path, faults[0].why, faults[0].point)
    return RecordedPath(recording.joint, time, position)


def _read_csv(path: Path) -> RecordedPath:
    with path.open(newline="") as file:
        header = [cell.strip() for cell in next(csv.reader(file), [])]
    if header != CSV_HEADER:
        raise RecordedPathError(path, f"the header is {header}, not {CSV_HEADER}")
    try:
        _, table = _numbers(path)
    except TrajectoryError as error:
        first = error.faults[0]
        raise RecordedPathError(path, first.why, first.point) from None
    return RecordedPath(path.stem, table[:, 0].copy(), table[:, 1].copy())


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
                why = f"line {reader.line_num}: {row} is not {count} numbers"
                raise TrajectoryError([TrajectoryFault(FaultKind.SIZE, why, i)])
            rows.append(numbers)
    return header, np.array(rows, dtype=np.float64).reshape(len(rows), len(header))


def _messages(path: Path) -> Iterator[Message]:
    """Joint names and points of each message; a JointTrajectory is a whole motion and the last."""
    try:
        bags = load("sjerk.trajectory.bags", extra="demo")
    except ExtraMissingError as missing:
        raise RecordedPathError(
            path, "reading a bag needs rosbags (pip install 'sjerk[demo]'); a CSV does not"
        ) from missing
    try:
        yield from bags.messages(path)
    except bags.BagErrors as error:
        raise RecordedPathError(path, f"is no readable bag ({error})") from error


def _points(path: Path) -> tuple[list[str], list[Point]]:
    """All points of the motion in a bag, in the joint order of its first message."""
    names: list[str] | None = None
    points: list[Point] = []
    for joints, more in _messages(path):
        if names is None:
            names = joints
        elif joints != names:
            why = f"names {', '.join(joints)}, the first {', '.join(names)}"
            raise TrajectoryError([TrajectoryFault(FaultKind.JOINTS, why, len(points))])
        points += more
    if names is None:
        raise RecordedPathError(path, "holds no JointTrajectory and no JointState")
    return names, points


def _read_bag(path: Path, joint: str | None) -> RecordedPath:
    rows: list[tuple[float, float]] = []
    name = joint
    for joints, points in _messages(path):
        name, column = _column(path, joints, name)
        rows += [
            (point.time, _pick(path, point.positions, column, len(rows) + i))
            for i, point in enumerate(points)
        ]
    if name is None or not rows:
        raise RecordedPathError(path, "holds no JointTrajectory and no JointState")
    columns = np.array(rows).T.copy()
    return RecordedPath(name, columns[0], np.degrees(columns[1]))


def _column(path: Path, names: list[str], joint: str | None) -> tuple[str, int]:
    if not names:
        raise RecordedPathError(path, "a message names no joints")
    if joint is None:
        return names[0], 0
    if joint not in names:
        raise InputError("joint", joint, f"{path} has {', '.join(names)}")
    return joint, names.index(joint)


def _pick(path: Path, positions: Any, column: int, point: int) -> float:
    if column >= len(positions):
        raise RecordedPathError(
            path, f"has {len(positions)} positions, joint {column} is missing", point
        )
    value = float(positions[column])
    if not math.isfinite(value):
        raise RecordedPathError(path, f"position = {value} is not finite", point)
    return value
