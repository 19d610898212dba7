"""The demo's path played with `stop_within` on a busy machine: `./run stress demo [--runs N]`.

The load is its own: so many processes that never sleep, and several kernels at once. Judged is what
the kernels' recordings say was commanded: no turn that the path does not have, limits kept, the end
met bit for bit. How many cycles the clock left out is told. Exit status 0 if all of it holds.
"""

from __future__ import annotations

import argparse
import multiprocessing
import multiprocessing.synchronize
import os
import sys
import time
from contextlib import closing
from functools import partial

import numpy as np

from sjerk import Axis, MotionKernel
from sjerk.cli import demo, virtual
from sjerk.trajectory import read_recording, shipped_recording

T = 1e-3


def busy(over: multiprocessing.synchronize.Event) -> None:
    """Use a core until it is over."""
    while not over.is_set():
        sum(range(100_000))


def one(number: int, *, stop_within: bool) -> dict[str, float]:
    """A kernel and a stream; what was found."""
    recording = read_recording(shipped_recording())
    start, end = float(recording.position[0]), float(recording.position[-1])
    axis = Axis(demo.LIMITS, demo.COUNTS_PER_DEGREE, unit="deg")
    with MotionKernel([axis], T) as kernel, kernel.host() as host:
        host.enable()
        host.move(start).wait()
        with closing(demo.lookahead(host, recording, stop_within=stop_within)) as goals:
            run = demo.play(host, f"run {number}", goals, end)
    motion = virtual.Motion("", run.position, run.velocity, run.acceleration, run.jerk)
    limits = demo.LIMITS
    return {
        "turns": motion.back(recording.position),
        "over": max(
            run.peak("velocity") / limits.velocity,
            run.peak("acceleration") / limits.acceleration,
            run.peak("jerk") / limits.jerk,
        ),
        "end": run.position[-1] != end,
        "left out": run.skipped / max(len(run.cycle) + run.skipped, 1),
        "not recorded": run.missed,
        "time": (motion.cycles + run.skipped) * T - float(recording.time[-1]),
    }


def main() -> int:
    """Print what was found; 1 if any fault was."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--jobs", type=int, default=4, help="kernels at once")
    parser.add_argument("--busy", type=int, default=os.cpu_count() or 1, help="processes of load")
    parser.add_argument("--trust", action="store_true", help="the other mode")
    options = parser.parse_args()
    spawn = multiprocessing.get_context("spawn")
    over = spawn.Event()
    load = [spawn.Process(target=busy, args=(over,), daemon=True) for _ in range(options.busy)]
    for process in load:
        process.start()
    found: list[dict[str, float]] = []
    told = time.monotonic()
    try:
        with spawn.Pool(options.jobs) as pool:
            job = partial(one, stop_within=not options.trust)
            for row in pool.imap_unordered(job, range(options.runs)):
                found.append(row)
                if time.monotonic() - told > 10.0:
                    told = time.monotonic()
                    print(f"{len(found)} of {options.runs} runs", flush=True)
    finally:
        over.set()
        for process in load:
            process.join()
    back = sum(row["turns"] > 0 for row in found)
    outside = sum(row["over"] > 1 + 1e-9 for row in found)
    elsewhere = sum(bool(row["end"]) for row in found)
    print(
        f"{len(found)} runs: went back {back}, left a limit {outside}, ended elsewhere {elsewhere}"
    )
    for name, form in (
        ("left out", "cycles left out by the clock: median {:.1%}, p90 {:.1%}, worst {:.1%}"),
        ("time", "longer than the path: median {:.2f} s, p90 {:.2f} s, worst {:.2f} s"),
        ("not recorded", "cycles not recorded: median {:.0f}, p90 {:.0f}, worst {:.0f}"),
    ):
        print(form.format(*np.percentile([row[name] for row in found], [50, 90, 100])))
    return int(back + outside + elsewhere > 0)


if __name__ == "__main__":
    sys.exit(main())
