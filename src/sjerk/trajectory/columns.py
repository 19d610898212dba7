"""A trajectory as columns: what a file or a JointTrajectory message holds of it.

Messages are those of trajectory_msgs, or anything with their fields; no ROS needed. Never here:
files, limits, what a trajectory is checked for beyond its sizes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sjerk.profile import FloatArray
from sjerk.trajectory.faults import FaultKind, TrajectoryError, TrajectoryFault


class Columns(NamedTuple):
    """Times (n,) in s, and rows (n, N) in the joints' own units; None where there are none."""

    joint_names: Sequence[str]
    time: FloatArray
    position: FloatArray
    velocity: FloatArray | None
    acceleration: FloatArray | None


def seconds(stamp: Any) -> float:
    """Of a Time or a Duration: ``sec``, ``nanosec`` of ROS 2, ``secs``, ``nsecs`` of ROS 1."""
    if hasattr(stamp, "secs"):
        return float(stamp.secs + 1e-9 * stamp.nsecs)
    return float(stamp.sec + 1e-9 * stamp.nanosec)


def columns_of(joint_names: Sequence[str], time: ArrayLike, points: Sequence[Any]) -> Columns:
    """The points of a JointTrajectory: their ``positions``, ``velocities``, ``accelerations``.

    Velocities and accelerations are taken where every point has them. Raises TrajectoryError, which
    names each point whose sizes do not fit the joints.
    """
    width, faults = len(joint_names), []
    for i, point in enumerate(points):
        for kind in ("positions", "velocities", "accelerations"):
            size = len(getattr(point, kind))
            if size != width and (size or kind == "positions"):
                faults.append(
                    TrajectoryFault(FaultKind.SIZE, f"{size} {kind} for {width} joints", i)
                )
    if faults:
        raise TrajectoryError(faults)
    position = np.array([p.positions for p in points], dtype=np.float64)
    further: list[FloatArray | None] = []
    for kind in ("velocities", "accelerations"):
        values = [getattr(p, kind) for p in points]
        everywhere = bool(values) and all(map(len, values))
        further.append(np.array(values, dtype=np.float64) if everywhere else None)
    return Columns(
        joint_names,
        np.asarray(time, dtype=np.float64),
        position.reshape(len(points), width),
        *further,
    )
