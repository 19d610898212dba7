"""Make the recording that the demo follows: a TOPP-RA plan of a Panda arm, as MCAP bag and CSV.

Joint 1 goes from 0 to 160 degrees under 90 degrees/s while the other joints reach around. Needs
``toppra`` and ``rosbags``:

    pip install toppra rosbags && python tools/make_recording.py
"""

from __future__ import annotations

import csv
import shutil
import tempfile
from pathlib import Path

import numpy as np
import toppra
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from toppra.algorithm import TOPPRA
from toppra.constraint import JointAccelerationConstraint, JointVelocityConstraint

DATA = Path(__file__).parent.parent / "src" / "sjerk" / "data"
PERIOD_S = 0.1
#: Panda joint limits, rad/s and rad/s^2; joint 1 held to the paper's 90 degrees/s.
VELOCITY = np.array([np.pi / 2, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61])
ACCELERATION = np.array([3.75, 1.875, 2.5, 3.125, 3.75, 5.0, 5.0])
READY = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
WAYPOINTS = np.array(
    [
        READY,
        [np.radians(30.0), -0.2, 0.5, -1.6, 0.4, 2.0, 0.2],
        [np.radians(75.0), 0.6, -0.5, -2.5, -0.6, 1.2, 1.3],
        [np.radians(125.0), -0.4, 0.4, -1.2, 0.7, 2.3, -0.3],
        [np.radians(160.0), -0.6, 0.0, -2.0, 0.0, 1.571, 0.785],
    ]
)


def plan() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, position and velocity of all joints, every 0.1 s and at the end."""
    path = toppra.SplineInterpolator(np.linspace(0.0, 1.0, len(WAYPOINTS)), WAYPOINTS)
    limits = [
        JointVelocityConstraint(np.column_stack([-VELOCITY, VELOCITY])),
        JointAccelerationConstraint(np.column_stack([-ACCELERATION, ACCELERATION])),
    ]
    trajectory = TOPPRA(limits, path).compute_trajectory(0.0, 0.0)
    time = np.append(np.arange(0.0, trajectory.duration, PERIOD_S), trajectory.duration)
    return time, trajectory(time), trajectory(time, 1)


def write_bag(target: Path, time: np.ndarray, position: np.ndarray, velocity: np.ndarray) -> None:
    """One trajectory_msgs/JointTrajectory with all seven joints."""
    types = get_typestore(Stores.ROS2_HUMBLE)
    Trajectory = types.types["trajectory_msgs/msg/JointTrajectory"]
    Point = types.types["trajectory_msgs/msg/JointTrajectoryPoint"]
    Header, Time = types.types["std_msgs/msg/Header"], types.types["builtin_interfaces/msg/Time"]
    Duration = types.types["builtin_interfaces/msg/Duration"]
    none = np.array([])
    points = []
    for t, q, v in zip(time, position, velocity, strict=True):
        ns = round(float(t) * 1e9)
        points.append(Point(q, v, none, none, Duration(ns // 10**9, ns % 10**9)))
    names = [f"panda_joint{n}" for n in range(1, 8)]
    message = Trajectory(Header(Time(0, 0), "panda_link0"), names, points)
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / "panda"
        with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            topic = writer.add_connection(
                "/joint_trajectory", Trajectory.__msgtype__, typestore=types
            )
            writer.write(topic, 0, types.serialize_cdr(message, Trajectory.__msgtype__))
        shutil.copyfile(bag / "panda.mcap", target)


def main() -> None:
    """Write both forms."""
    time, position, velocity = plan()
    DATA.mkdir(exist_ok=True)
    write_bag(DATA / "panda.mcap", time, position, velocity)
    with (DATA / "panda_joint1.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["time_s", "position_deg"])
        for t, q in zip(time, np.degrees(position[:, 0]), strict=True):
            rows.writerow([f"{t:.9f}", f"{q:.9f}"])
    print(
        f"{len(time)} points, {time[-1]:.3f} s, joint 1 ends at {np.degrees(position[-1, 0])} deg"
    )
    print(f"joint 1: at most {np.degrees(np.abs(velocity[:, 0])).max():.2f} deg/s at the points")


if __name__ == "__main__":
    main()
