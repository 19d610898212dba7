"""``sjerk stop``: axes to rest, also where another process is the host. Never here: planning."""

from __future__ import annotations

import argparse
import os
import signal
from typing import Any

from sjerk.cli.common import add_verb, host_of, name_of, show_axes
from sjerk.errors import HostTakenError
from sjerk.host import Host


def add_arguments(jobs: Any) -> None:
    """Add stop."""
    job = add_verb(jobs, "stop", run, "halt, or quick stop; returns at rest")
    job.add_argument("axes", nargs="*", type=int, help="default: all")
    job.add_argument("--quick", action="store_true", help="each axis by its own stop limits")
    job.add_argument(
        "--interrupt",
        action="store_true",
        help="where another process is the host: send it Ctrl-C first, then stop",
    )


def _interrupt(name: str) -> None:
    """Send Ctrl-C to the process that is the host, if there is one; it leaves when it can."""
    try:
        Host.attach(name).close()
    except HostTakenError as taken:
        if taken.pid:
            os.kill(taken.pid, signal.SIGINT)


def run(options: argparse.Namespace) -> int:
    """Return at rest."""
    if options.interrupt:
        _interrupt(name_of(options))
    with host_of(options) as host:
        (host.quick_stop if options.quick else host.halt)(axes=options.axes or None)
        return show_axes(options, host)
