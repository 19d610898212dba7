"""``sjerk home``: drives find their references. Never here: how a drive homes."""

from __future__ import annotations

import argparse
from typing import Any

from sjerk.cli.arguments import duration
from sjerk.cli.common import add_axes, add_verb, axes_of, host_of, show_axes


def add_arguments(jobs: Any) -> None:
    """Add home."""
    job = add_verb(jobs, "home", run, "home drives by their own method (6098h); returns at the end")
    add_axes(job)
    job.add_argument("--timeout", type=duration, default=60.0, help="seconds (default: 60)")


def run(options: argparse.Namespace) -> int:
    """Ctrl-C halts, as it does for moves."""
    with host_of(options) as host:
        axes = axes_of(options, host)
        move = host.home(axes=axes)
        try:
            move.wait(timeout=options.timeout)
        except (KeyboardInterrupt, TimeoutError):
            host.halt(axes=axes)
            raise
        return show_axes(options, host)
