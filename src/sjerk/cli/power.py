"""``sjerk enable``, ``disable`` and ``reset``: the power of drives. Never here: motion."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from typing import Any

from sjerk.cli.common import PATIENCE_S, add_axes, add_verb, axes_of, host_of, show_axes
from sjerk.cycle.states import AxisState
from sjerk.errors import SjerkError, axis_label
from sjerk.host import Host


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
            _enable(host, axes)
        elif options.job == "disable":
            host.disable(axes=axes)
        else:
            _reset(host, axes)
        return show_axes(options, host)


def _failed(host: Host, axes: Sequence[int] | None) -> str:
    """Those of the axes that are in ErrorStop, with the fault of the drive; empty for none."""
    rows = host.feedback().axes
    names = [axis.name for axis in rows]
    return ", ".join(
        axis_label(i, names) + (f": {rows[i].error_code:04X}h" if rows[i].error_code else "")
        for i in (range(len(rows)) if axes is None else axes)
        if rows[i].state is AxisState.ERROR_STOP
    )


def _enable(host: Host, axes: Sequence[int] | None) -> None:
    """Raises SjerkError for an axis in ErrorStop: its drive may follow, and takes no goal."""
    try:
        host.enable(axes=axes)
    except TimeoutError:
        if not _failed(host, axes):
            raise
    if failed := _failed(host, axes):
        raise SjerkError(f"in ErrorStop: {failed}; `sjerk reset` resets faults")


def _reset(host: Host, axes: Sequence[int] | None) -> None:
    """Raises SjerkError for an axis that is in ErrorStop again, or still."""
    host.reset(axes=axes)
    end = time.monotonic() + PATIENCE_S
    while _failed(host, axes) and time.monotonic() < end:
        time.sleep(1e-2)
    if failed := _failed(host, axes):
        raise SjerkError(
            f"still in ErrorStop: {failed}; its cause is still there. A motor that is not where it "
            "should be: `sjerk disable`, `sjerk reset` and `sjerk enable` begin where it is"
        )
