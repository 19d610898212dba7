"""What the soaks of ROS 1 and ROS 2 print and judge in common."""

from __future__ import annotations

import argparse
from collections.abc import Mapping

from helpers.ros_robot import Program

RATE_HZ = 10.0
#: Of the period between goals, within which 99 in a hundred must have been read.
SHARE = 0.1


def options(about: str | None) -> argparse.Namespace:
    """Of the command line."""
    parser = argparse.ArgumentParser(
        description=about, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--goals", type=int, default=600, help="joint states at 10 Hz")
    parser.add_argument("--wrong", type=int, default=10_000, help="wrong goals in motion")
    return parser.parse_args()


class Soak:
    """Prints each finding; ``code`` is 1 once one of them is a fault."""

    def __init__(self) -> None:
        self.code = 0

    def _tell(self, text: str, good: bool) -> None:
        print(("" if good else "FAULT: ") + text, flush=True)
        self.code |= not good

    def ages(self, report: Mapping[str, str], count: int) -> None:
        """Of the control node's goals."""
        read = int(report["goals"])
        self._tell(f"goals read: {read} of {count}", read == count)
        share = 1e-3 * float(report["age_p99_ms"]) * RATE_HZ
        times = ", ".join(f"{key[4:-3]} {report[key]} ms" for key in report if "age_" in key)
        self._tell(f"age when read: {times}; p99 / period {share:.3f}", share <= SHARE)

    def wrong(self, sent: int, program: Program) -> None:
        """Of the controller, whose motion has been compared already."""
        lives = program.process.poll() is None
        self._tell(f"wrong goals in motion: {sent}; the motion bit for bit as without them", lives)
