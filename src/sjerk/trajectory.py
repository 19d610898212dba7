"""Recorded motions: whole paths in time, read from files.

Never here: shared memory, drives.
"""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sjerk.errors import InputError, SjerkError

FloatArray = NDArray[np.float64]
CSV_HEADER = ["time_s", "position_deg"]


class RecordingError(SjerkError, ValueError):
    """A recording cannot be used: ``path``, and the ``point`` (from 0) where it fails, or None."""

    def __init__(self, path: Path, why: str, point: int | None = None) -> None:
        where = f"{path}" if point is None else f"{path}, point {point}"
        super().__init__(f"{where}: {why}")
        self.path = path
        self.point = point


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
    for name, column in (("time", time), ("position", position)):
        wrong = np.flatnonzero(~np.isfinite(column))
        if len(wrong):
            raise RecordingError(path, f"{name} = {column[wrong[0]]} is not finite", int(wrong[0]))
    back = np.flatnonzero(np.diff(time) <= 0.0)
    if len(back):
        i = int(back[0]) + 1
        raise RecordingError(path, f"time = {time[i]} s does not follow {time[i - 1]} s", i)
    return Recording(recording.joint, time - time[0], position)


def _read_csv(path: Path) -> Recording:
    with path.open(newline="") as file:
        rows = csv.reader(file)
        header = [cell.strip() for cell in next(rows, [])]
        if header != CSV_HEADER:
            raise RecordingError(path, f"the header is {header}, not {CSV_HEADER}")
        points = []
        for i, row in enumerate(rows):
            try:
                time, position = map(float, row)
            except ValueError:
                raise RecordingError(path, f"{row} is not two numbers", i) from None
            points.append((time, position))
    columns = np.array(points, dtype=np.float64).reshape(-1, 2).T.copy()
    return Recording(path.stem, columns[0], columns[1])


def _read_bag(path: Path, joint: str | None) -> Recording:
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    except ImportError as missing:
        raise RecordingError(
            path, "reading a bag needs rosbags (pip install 'sjerk[demo]'); a CSV does not"
        ) from missing
    rows: list[tuple[float, float]] = []
    name = joint
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as bag:
            for connection, stamp, raw in bag.messages():
                kind = connection.msgtype
                if kind == "trajectory_msgs/msg/JointTrajectory":
                    message: Any = bag.deserialize(raw, kind)
                    name, column = _column(path, list(message.joint_names), name)
                    for point in message.points:
                        after = point.time_from_start
                        seconds = after.sec + after.nanosec * 1e-9
                        rows.append((seconds, _pick(path, point.positions, column, len(rows))))
                    break  # one trajectory is a whole motion
                if kind == "sensor_msgs/msg/JointState":
                    message = bag.deserialize(raw, kind)
                    name, column = _column(path, list(message.name), name)
                    rows.append((stamp * 1e-9, _pick(path, message.position, column, len(rows))))
    except (AnyReaderError, OSError) as error:
        raise RecordingError(path, f"is no readable bag ({error})") from error
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
