"""The command line of sjerk, thin: arguments in, exit code out.

Exit codes: 0 done, 1 an error that is told in one line, 2 wrong arguments, 130 stopped by Ctrl-C.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from sjerk import demo
from sjerk.errors import SjerkError
from sjerk.ports import canopen
from sjerk.trajectory import shipped_recording


def arguments() -> argparse.ArgumentParser:
    """The parser of ``python -m sjerk``."""
    parser = argparse.ArgumentParser(prog="sjerk", description="A motion kernel.")
    jobs = parser.add_subparsers(dest="job", required=True)
    job = jobs.add_parser("demo", help="follow a recorded path with a simulated servo drive")
    job.add_argument(
        "path",
        nargs="?",
        type=Path,
        default=shipped_recording(),
        help="CSV (time_s,position_deg) or ROS 2 bag; default: the shipped TOPP-RA plan",
    )
    job.add_argument("--out", type=Path, default=Path("demo.png"), help="the picture (%(default)s)")
    job.add_argument("--joint", help="joint of a bag (default: its first)")
    job.add_argument("--cycle-us", type=float, default=1000.0, help="control cycle (%(default)s)")
    drive = jobs.add_parser("drive", help="be a simulated CiA 402 drive on a CANopen bus")
    canopen.add_arguments(drive)
    return parser


def main(argv: list[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    options = arguments().parse_args(argv)
    try:
        if options.job == "drive":
            return canopen.run(options)
        return demo.run(options.path, options.out, options.cycle_us * 1e-6, options.joint)
    except SjerkError as error:
        print(f"sjerk: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    raise SystemExit(main())
