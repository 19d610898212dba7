"""``sjerk monitor``: what the axes do, ten times a second. Never here: commands, pictures."""

from __future__ import annotations

import argparse
import math
import time
from typing import Any

from sjerk.cli.arguments import ENDLESS, duration_or_inf
from sjerk.cli.common import add_verb, axis_rows, name_of, show
from sjerk.extras import load
from sjerk.host import Monitor

_PERIOD_S = 0.1


def add_arguments(jobs: Any) -> None:
    """Add monitor."""
    job = add_verb(jobs, "monitor", run, "a live table (extra: rich)")
    job.add_argument("--seconds", type=duration_or_inf, default=math.inf, help=ENDLESS)


def run(options: argparse.Namespace) -> int:
    """Until the time is over or the kernel has ended."""
    live = None if options.json else load("sjerk.cli.live", extra="monitor")
    with Monitor.attach(name_of(options), any_owner=options.any_owner) as monitor:
        until = time.monotonic() + options.seconds

        def goes_on() -> bool:
            return time.monotonic() < until and monitor.kernel_lives

        if live is not None:
            live.watch(monitor, goes_on, _PERIOD_S)
            return 0
        while goes_on():
            feedback = monitor.feedback()
            show(options, {"cycle": feedback.cycle, "axes": axis_rows(feedback)})
            time.sleep(_PERIOD_S)
    return 0
