"""``sjerk status``: what the axes do, once. Never here: commands."""

from __future__ import annotations

import argparse
from typing import Any

from sjerk.cli.common import add_verb, axis_rows, bus_rows, name_of, show
from sjerk.host import Monitor


def add_arguments(jobs: Any) -> None:
    """Add status."""
    add_verb(jobs, "status", run, "what the axes do")


def run(options: argparse.Namespace) -> int:
    """Of the newest cycle."""
    with Monitor.attach(name_of(options), any_owner=options.any_owner) as monitor:
        feedback = monitor.feedback()
        timing: dict[str, Any] = {
            "kernel": monitor.kernel_state.value,
            "age_s": None if feedback.age is None else round(feedback.age, 6),
            "cycle": feedback.cycle,
            "late": feedback.timing.late,
            "override": feedback.override,
            "hold": feedback.hold,
        }
        show(options, timing | bus_rows(feedback) | {"axes": axis_rows(feedback)})
    return 0
