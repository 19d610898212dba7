"""The command line of sjerk, thin."""

from __future__ import annotations

import argparse

from sjerk.ports import canopen


def main() -> int:
    """Run the command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="sjerk", description=__doc__)
    jobs = parser.add_subparsers(dest="job", required=True)
    drive = jobs.add_parser("drive", help="be a simulated CiA 402 drive on a CANopen bus")
    canopen.add_arguments(drive)
    arguments = parser.parse_args()
    return canopen.run(arguments)


if __name__ == "__main__":
    raise SystemExit(main())
