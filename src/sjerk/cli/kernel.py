"""``sjerk kernel``: run the kernel of a TOML file, with a recording if wanted.

Never here: motion, processes.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from contextlib import ExitStack, suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from sjerk.cli.arguments import ENDLESS, duration_or_inf
from sjerk.cli.buses import kernel_of
from sjerk.cli.common import add_force, add_verb, ready, show, sigterm_as_ctrl_c
from sjerk.host import Monitor
from sjerk.recording import Recorder


def add_arguments(jobs: Any) -> None:
    """Add kernel."""
    text = "run the kernel of a TOML file until Ctrl-C or SIGTERM"
    job = add_verb(jobs, "kernel", run, text, named=False)
    job.add_argument("file", type=Path, help="TOML: axes, limits, drives, reactions")
    job.add_argument("--name", help="of the kernel; default: the file's")
    job.add_argument("--group", help="whose members may use it too, by --any-owner")
    job.add_argument("--spin-us", type=float, help="busy wait before each deadline, us")
    job.add_argument("--seconds", type=duration_or_inf, default=math.inf, help=ENDLESS)
    job.add_argument(
        "--record", type=Path, help="every cycle, to .parquet or .mcap (extra: record)"
    )
    add_force(job)


def run(options: argparse.Namespace) -> int:
    """Exit code 1 without a whole recording, 6 where the kernel ended, 130 where it never ran."""
    kernel = kernel_of(str(options.file), name=options.name, group=options.group)
    if options.spin_us is not None:
        kernel.clock = replace(kernel.clock, spin_us=options.spin_us)
    if options.record is not None:
        ready(options, options.record)
    ran = False
    # the recorder outlives the kernel: the halt at its end is recorded as well
    with sigterm_as_ctrl_c(), ExitStack() as recorded, suppress(KeyboardInterrupt), kernel:
        recorder = None
        if options.record is not None:
            recorder = recorded.enter_context(Recorder(kernel.name, options.record))
        monitor = Monitor.attach(kernel.name)
        clock = asdict(monitor.feedback().timing.clock)
        show(options, {"kernel": kernel.name, "axes": len(kernel.axes), "clock": clock})
        monitor.close()
        ran = True
        until = time.monotonic() + options.seconds
        told = False
        while kernel.alive and time.monotonic() < until:
            time.sleep(0.05)
            if not told and recorder is not None and recorder.fault is not None:
                told = True  # at once; the motion goes on, and the exit code tells at the end
                print(f"sjerk: {recorder.fault}; the kernel goes on", file=sys.stderr, flush=True)
        if not kernel.alive:
            return 6
    return 0 if ran else 130
