"""``sjerk move``: axes to positions, now or behind what moves. Never here: planning."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

from sjerk.cli.arguments import by_axis, duration, numbered
from sjerk.cli.common import add_verb, host_of, names_of, show_axes
from sjerk.host import BUFFERS


def add_arguments(jobs: Any) -> None:
    """Add move."""
    job = add_verb(jobs, "move", run, "move to positions; returns at the goal")
    job.add_argument(
        "target", nargs="+", help="a position per axis, or AXIS=POSITION by number or name"
    )
    job.add_argument("--relative", action="store_true", help="targets are distances")
    job.add_argument(
        "--velocity", type=float, help="largest, axis units per s; default: the axes' own"
    )
    job.add_argument("--synchronization", choices=("time", "phase", "none"), default="time")
    job.add_argument(
        "--buffer",
        choices=tuple(BUFFERS),
        default="aborting",
        help="how it follows what moves already: replace it, wait for it, or blend into it",
    )
    job.add_argument("--no-wait", action="store_true", help="return when it is moving or queued")
    job.add_argument("--timeout", type=duration, help="of the wait, seconds; the move goes on")


def run(options: argparse.Namespace) -> int:
    """Ctrl-C cancels the move."""
    words = by_axis("target", options.target)
    with host_of(options) as host:
        targets = numbered("target", words, names_of(host))
        limits = None
        if options.velocity is not None:
            own = [axis.limits for axis in host.feedback().axes]
            limits = {
                i: replace(own[i], velocity=options.velocity, position=None)
                for i in (targets if isinstance(targets, dict) else range(len(own)))
                if i in range(len(own))
            }
        move = host.move(
            targets,
            relative=options.relative,
            limits=limits,
            synchronization=options.synchronization,
            buffer=options.buffer,
        )
        try:
            (move.taken if options.no_wait else move.wait)(options.timeout)
        except KeyboardInterrupt:
            move.cancel()
            raise
        return show_axes(options, host)
