"""ROS 2 over the wire: `./run stress ros2 [--goals N] [--wrong N]`.

Goals at 10 Hz for a minute to the control node, read at 500 Hz: how many it has read, how old they
were. Then wrong goals by action and topic while the controller moves: the node lives, and the
motion is that without them, bit for bit. Exit status 0 if no goal was lost, the oldest of 99 in a
hundred was read within a tenth of the period, and no bit has changed.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import JointState

from helpers.ros2_clients import Arm, Client, attacked, servo
from helpers.ros_robot import NAMES, running
from helpers.ros_soak import RATE_HZ, Soak, options


def ages(client: Client, folder: Path, count: int) -> dict[str, str]:
    """What the control node tells of so many goals."""
    more = ["--ros-args", "-p", "read_rate:=500.0", "-p", "goal_topic:=/goals"]
    with running(folder, "ros2", "control", *more):
        reports: list[dict[str, str]] = []

        def look(message: Any) -> None:
            for status in message.status:
                if ": goals, " in status.name:
                    reports.append({row.key: row.value for row in status.values})

        client.node.create_subscription(DiagnosticArray, "/diagnostics", look, 10)
        publisher = client.node.create_publisher(JointState, "/goals", 10)
        client.until(lambda: reports and publisher.get_subscription_count() == 1)
        rows = iter(0.6 * (1 - np.cos(np.linspace(0.0, 20.0, count))))

        def publish(now: float) -> None:
            message = JointState(name=NAMES, position=[float(next(rows))] * 3)
            stamp = message.header.stamp
            stamp.sec, stamp.nanosec = int(now), int(now % 1 * 1e9)
            publisher.publish(message)

        servo(client, publish, RATE_HZ, count / RATE_HZ)
        before = len(reports)
        client.until(lambda: len(reports) > before + 1)
        return reports[-1]


def main() -> int:
    """Print what was found; 1 if any fault was."""
    chosen = options(__doc__)
    rclpy.init()
    client, soak = Client(), Soak()
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        (folder / "control").mkdir()
        soak.ages(ages(client, folder / "control", chosen.goals), chosen.goals)
        with running(folder, "ros2", "controller", "--node-name", "arm") as program:
            arm = Arm(client, "arm", program.kernel)
            soak.wrong(attacked(arm, count=chosen.wrong, seconds=20.0), program)
    client.node.destroy_node()
    rclpy.shutdown()
    return soak.code


if __name__ == "__main__":
    raise SystemExit(main())
