"""``sjerk enable``, ``disable`` and ``reset``: the power of drives. Never here: motion."""

from __future__ import annotations

import argparse
from typing import Any

from sjerk.cli.common import add_axes, add_verb, axes_of, host_of, show_axes


def add_arguments(jobs: Any) -> None:
    """Add enable, disable and reset."""
    for verb, text in (
        ("enable", "enable drives"),
        ("disable", "disable drives, at rest"),
        ("reset", "reset faults"),
    ):
        job = add_verb(jobs, verb, run, text)
        add_axes(job)


def run(options: argparse.Namespace) -> int:
    """Do what the verb says."""
    with host_of(options) as host:
        axes = axes_of(options, host)
        if options.job == "enable":
            host.enable(axes=axes)
        elif options.job == "disable":
            host.disable(axes=axes)
        else:
            host.reset(axes=axes)
        return show_axes(options, host)
