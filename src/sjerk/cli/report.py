"""``sjerk report``: cycle times, next to what cyclictest sees in the same seconds.

Never here: the cycle.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import asdict
from typing import Any

from sjerk.cli.arguments import duration
from sjerk.cli.common import add_verb, bus_rows, name_of, show
from sjerk.cli.cyclictest import Cyclictest
from sjerk.errors import SjerkError
from sjerk.host import Distribution, Grant, Monitor


def add_arguments(jobs: Any) -> None:
    """Add report."""
    text = "cycle times, compared with cyclictest where it is installed"
    job = add_verb(jobs, "report", run, text)
    job.add_argument("--seconds", type=duration, default=5.0, help="how long (default: 5)")


def run(options: argparse.Namespace) -> int:
    """Of so many seconds from now on."""
    with Monitor.attach(name_of(options), any_owner=options.any_owner) as monitor:
        before = monitor.feedback()
        period = before.cycle_time
        judge = Cyclictest.start(
            period, options.seconds, priority=_priority(before.timing.clock.scheduling)
        )
        time.sleep(options.seconds)
        compared: dict[str, Any] | str = "not installed"
        if judge is not None:
            try:
                verdict = judge.result()
                compared = {"version": verdict.version, "priority": verdict.priority}
                compared |= _row("latency", verdict.latency)
            except SjerkError as fault:
                compared = str(fault)
        after = monitor.feedback()
    timing = after.timing_since(before)
    head: dict[str, Any] = {
        "cycle_time_us": round(period * 1e6, 3),
        "cycles": after.cycle - before.cycle,
        "late": timing.late,
        "clock": asdict(timing.clock),
        "times_us": [
            _row(name, getattr(timing, name)) for name in ("latency", "period", "computing")
        ],
        "cyclictest_us": compared,
    }
    show(options, head | bus_rows(after))
    return 0


def _priority(grant: Grant) -> int:
    """The real-time priority of the kernel, so that its judge gets the same; 0: none."""
    return int(grant.asked.split()[-1]) if grant.granted and grant.asked != "nothing" else 0


def _row(name: str, times: Distribution) -> dict[str, Any]:
    """A distribution in microseconds."""
    cuts = ("median", "p99", "p999", "worst")
    values = {name: round(getattr(times, name) * 1e6, 1) for name in cuts}
    return {"of": name, "count": times.count} | values
