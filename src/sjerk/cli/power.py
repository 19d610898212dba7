"""``sjerk enable``, ``disable`` and ``reset``: the power of drives. Never here: motion."""

from __future__ import annotations

import argparse
from typing import Any

from sjerk.cli.common import add_verb, host_of, show_axes


def add_arguments(jobs: Any) -> None:
    """Add enable, disable and reset."""
    for verb, text in (
        ("enable", "enable drives"),
        ("disable", "disable drives, at rest"),
        ("reset", "reset faults"),
    ):
        job = add_verb(jobs, verb, run, text)
        job.add_argument("axes", nargs="*", type=int, help="default: all")


def run(options: argparse.Namespace) -> int:
    """Do what the verb says."""
    with host_of(options) as host:
        order = {"enable": host.enable, "disable": host.disable, "reset": host.reset}[options.job]
        order(axes=options.axes or None)
        return show_axes(options, host)
