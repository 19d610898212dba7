"""ROS 1 over the wire: `./run stress ros1 [--goals N] [--wrong N]`.

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
import rospy
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import JointState

from helpers.ros1_clients import Arm, attacked, play, ros, until
from helpers.ros_robot import NAMES, running
from helpers.ros_soak import RATE_HZ, Soak, options


def ages(folder: Path, count: int) -> dict[str, str]:
    """What the control node tells of so many goals."""
    more = ["--ros-args", "_read_rate:=500", "_goal_topic:=/goals"]
    with running(folder, "ros1", "control", *more):
        reports: list[dict[str, str]] = []

        def look(message: Any) -> None:
            for status in message.status:
                if ": goals, " in status.name:
                    reports.append({row.key: row.value for row in status.values})

        rospy.Subscriber("/diagnostics", DiagnosticArray, look)
        publisher = rospy.Publisher("/goals", JointState, queue_size=10, tcp_nodelay=True)
        until(lambda: reports and publisher.get_num_connections())
        rows = iter(0.6 * (1 - np.cos(np.linspace(0.0, 20.0, count))))

        def publish(now: float) -> None:
            message = JointState(name=NAMES, position=[float(next(rows))] * 3)
            message.header.stamp = rospy.Time.from_sec(now)
            publisher.publish(message)

        play(publish, RATE_HZ, count)
        before = len(reports)
        until(lambda: len(reports) > before + 1)
        return reports[-1]


def main() -> int:
    """Print what was found; 1 if any fault was."""
    chosen, soak = options(__doc__), Soak()
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        (folder / "control").mkdir()
        with ros(folder):
            soak.ages(ages(folder / "control", chosen.goals), chosen.goals)
            with running(folder, "ros1", "controller", "--node-name", "arm") as program:
                arm = Arm("arm", program.kernel)
                soak.wrong(attacked(arm, count=chosen.wrong, seconds=20.0), program)
    return soak.code


if __name__ == "__main__":
    raise SystemExit(main())
