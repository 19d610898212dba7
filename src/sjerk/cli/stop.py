"""``sjerk stop``: axes to rest, whoever is the host. Never here: planning."""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import time
from typing import Any

from sjerk.cli.common import PATIENCE_S, add_axes, add_verb, axes_of, name_of, show_axes
from sjerk.errors import HostTakenError
from sjerk.host import Monitor


def add_arguments(jobs: Any) -> None:
    """Add stop."""
    job = add_verb(jobs, "stop", run, "halt, or quick stop; returns at rest")
    add_axes(job)
    job.add_argument("--quick", action="store_true", help="each axis by its own stop limits")
    job.add_argument(
        "--interrupt",
        action="store_true",
        help="where another process is the host: send it Ctrl-C, then stop what it began",
    )


def _interrupt(monitor: Monitor) -> None:
    """Send Ctrl-C to the process that is the host; returns when it leads no more.

    Raises HostTakenError where it does not leave.
    """
    pid = monitor.host_pid
    if pid is None:
        return
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, signal.SIGINT)
    end = time.monotonic() + PATIENCE_S
    while monitor.host_pid == pid:
        if time.monotonic() > end:
            what = f"the axes are at rest, but process {pid} still leads, after Ctrl-C"
            raise HostTakenError(what, name=monitor.name, pid=pid)
        time.sleep(1e-3)


def run(options: argparse.Namespace) -> int:
    """Return at rest."""
    with Monitor.attach(name_of(options), any_owner=options.any_owner) as monitor:
        stop = monitor.quick_stop if options.quick else monitor.halt
        axes = axes_of(options, monitor)
        stop(axes=axes)
        if options.interrupt:
            try:
                _interrupt(monitor)
            finally:
                stop(axes=axes)
        return show_axes(options, monitor)
