"""``sjerk record``: every cycle of a running kernel to a file. Never here: layouts of files."""

from __future__ import annotations

import argparse
import math
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from sjerk.cli.arguments import ENDLESS, duration_or_inf
from sjerk.cli.common import add_force, add_verb, name_of, ready, show, sigterm_as_ctrl_c
from sjerk.recording import Recorder


def add_arguments(jobs: Any) -> None:
    """Add record."""
    job = add_verb(jobs, "record", run, "record every cycle of a running kernel until its end")
    job.add_argument("file", type=Path, help="ends in .parquet or .mcap (extra: record)")
    job.add_argument("--seconds", type=duration_or_inf, default=math.inf, help=ENDLESS)
    add_force(job)


def run(options: argparse.Namespace) -> int:
    """Until the kernel has ended, the time is over, Ctrl-C or SIGTERM."""
    name = name_of(options)
    ready(options, options.file)
    with sigterm_as_ctrl_c():
        recorder = Recorder(name, options.file, any_owner=options.any_owner)
        until = time.monotonic() + options.seconds
        with recorder, suppress(KeyboardInterrupt):
            while recorder.alive and recorder.fault is None and time.monotonic() < until:
                time.sleep(0.05)
    show(
        options,
        {"file": str(options.file), "cycles": recorder.cycles, "missed": recorder.missed},
    )
    return 0
