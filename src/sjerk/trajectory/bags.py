"""ROS 2 bags (MCAP or SQLite) by rosbags, which comes with the extra ``demo``: load it by need.

Never here: what a motion is checked for.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.typesys import Stores, get_typestore

from sjerk.trajectory.columns import seconds
from sjerk.trajectory.files import Message, Point

#: What reading a file raises that is no bag.
BagErrors = (AnyReaderError, OSError)


def messages(path: Path) -> Iterator[Message]:
    """Joint names and points of each message; a JointTrajectory is a whole motion and the last.

    Positions in radians, as they are in the bag. Raises ``BagErrors``.
    """
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as bag:
        for connection, stamp, raw in bag.messages():
            kind = connection.msgtype
            if kind == "trajectory_msgs/msg/JointTrajectory":
                message: Any = bag.deserialize(raw, kind)
                points = [
                    Point(
                        seconds(p.time_from_start),
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
                point = Point(stamp * 1e-9, True, message.position, message.velocity, ())
                yield list(message.name), [point]
