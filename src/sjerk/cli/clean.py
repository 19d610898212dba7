"""``sjerk clean``: segments of kernels that are dead. Never here: what a segment holds."""

from __future__ import annotations

import argparse
from typing import Any

from sjerk.cli.common import printable
from sjerk.handshake import clean


def add_arguments(jobs: Any) -> None:
    """Add clean."""
    job = jobs.add_parser("clean", help="remove the segments of kernels that are dead")
    job.add_argument("--dry-run", action="store_true", help="list, remove nothing")
    job.add_argument("--any-owner", action="store_true", help="also of other users")
    job.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """List what was found, and what became of it."""
    found = clean(dry_run=options.dry_run, any_owner=options.any_owner)
    for info in found:
        fate = "removed" if info.removed else "in use" if info.in_use else info.problem or "dead"
        print(f"{printable(info.name)}: {info.size} bytes, {fate}")
    print(f"{sum(info.removed for info in found)} of {len(found)} segments removed")
    return 0
