"""``sjerk jog``: axes with a velocity until another order comes. Never here: planning."""

from __future__ import annotations

import argparse
from typing import Any

from sjerk.cli.arguments import by_axis, numbered
from sjerk.cli.common import add_verb, host_of, names_of, show_axes


def add_arguments(jobs: Any) -> None:
    """Add jog."""
    text = "move with a velocity, to a limit, or until stopped; returns at once"
    job = add_verb(jobs, "jog", run, text)
    job.add_argument(
        "velocity", nargs="+", help="a velocity per axis, or AXIS=VELOCITY by number or name"
    )


def run(options: argparse.Namespace) -> int:
    """Return once the kernel has accepted it."""
    words = by_axis("velocity", options.velocity)
    with host_of(options) as host:
        velocities = numbered("velocity", words, names_of(host))
        host.jog(velocities).accepted()
        return show_axes(options, host)
