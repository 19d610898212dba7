"""The command line of sjerk, thin: arguments in, exit code out.

Exit codes: 0 done, 1 an error that is told in one line, 2 wrong arguments,
3 refused by the kernel, 4 stopped or superseded on the way, 5 not within the time, 6 no such
kernel, or it ended, 130 stopped by Ctrl-C.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from sjerk.cli import commands, demo, follow, record
from sjerk.errors import (
    KernelGoneError,
    MotionStoppedError,
    RefusedError,
    SegmentMissingError,
    SjerkError,
)
from sjerk.handshake import clean
from sjerk.ports.canopen import node
from sjerk.trajectory.trajectory import shipped_recording

_EPILOG = (__doc__ or "").partition("\n\n")[2]


def arguments() -> argparse.ArgumentParser:
    """The parser of ``python -m sjerk``."""
    parser = argparse.ArgumentParser(prog="sjerk", description="A motion kernel.", epilog=_EPILOG)
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
    job.set_defaults(
        run=lambda o: demo.run(o.path, o.out, o.cycle_us / 1e6, o.joint),
    )
    commands.add_arguments(jobs)
    record.add_arguments(jobs)
    follow.add_arguments(jobs)
    job = jobs.add_parser("clean", help="remove the segments of kernels that are dead")
    job.add_argument("--dry-run", action="store_true", help="list, remove nothing")
    job.set_defaults(run=_clean)
    job = jobs.add_parser("drive", help="be a simulated CiA 402 drive on a CANopen bus")
    node.add_arguments(job)
    job.set_defaults(run=node.run)
    return parser


def _clean(options: argparse.Namespace) -> int:
    found = clean(dry_run=options.dry_run)
    for info in found:
        fate = "removed" if info.removed else "in use" if info.in_use else info.problem or "dead"
        print(f"{info.name}: {info.size} bytes, {fate}")
    print(f"{sum(info.removed for info in found)} of {len(found)} segments removed")
    return 0


_CODES: dict[type[Exception], int] = {
    RefusedError: 3,
    MotionStoppedError: 4,
    TimeoutError: 5,
    KernelGoneError: 6,
    SegmentMissingError: 6,
}


def main(argv: list[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    options = arguments().parse_args(argv)
    try:
        return int(options.run(options))
    except (SjerkError, TimeoutError, OSError) as error:
        print(f"sjerk: {error}", file=sys.stderr)
        return next((code for kind, code in _CODES.items() if isinstance(error, kind)), 1)
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    raise SystemExit(main())
