"""A table in the terminal that is always up to date, by rich (extra ``monitor``).

Never here: which kernel, how long.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from rich.live import Live
from rich.table import Table

from sjerk.cli.common import axis_rows, word
from sjerk.host import Monitor


def watch(monitor: Monitor, goes_on: Callable[[], bool], period: float) -> None:
    """Show what the axes do every ``period`` seconds while it ``goes_on``."""
    with Live(refresh_per_second=1.0 / period) as live:
        while goes_on():
            feedback = monitor.feedback()
            late = feedback.timing.late
            table = Table(title=f"{monitor.name}  cycle {feedback.cycle}  late {late}")
            rows = axis_rows(feedback)
            for column in rows[0]:
                table.add_column(column)
            for row in rows:
                table.add_row(*(word(value) for value in row.values()))
            live.update(table)
            time.sleep(period)
