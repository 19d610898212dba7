"""Random streams, judged: `./run stress streams [--runs N] [--seed S] [--first F] [--jobs J]`.

What is drawn and how it is judged: tests/helpers/stream_check.py. A run depends on the seed and its
number alone, so slices of one exam add up: `--save FILE` keeps a line for each run, `--of FILE...`
prints the table of such files. `--beside` also plans anew to the last goal known in each cycle,
with ruckig: what a motion that can always stop there needs at least, where goals go one way. Exit
status 0 if no stream goes back more often than its goals, leaves a limit, passes the last goal
known, ends elsewhere or never.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
from helpers.stream_check import lateness_of_planning_anew, run

Row = dict[str, Any]
FAULTS = ("back", "over", "passed", "end", "undone")


def row_of(number: int, *, seed: int, iterations: int, beside: bool) -> Row:
    """One run; empty where nothing was drawn."""
    made = run(seed, number, iterations=iterations)
    if made is None:
        return {}
    draw, found, verdict, stream = made
    late = float((draw.arrivals - draw.times).max())
    row = {
        "run": number,
        "mode": "within" if draw.within else "trust",
        "back": verdict["turns"] > 0,
        "over": verdict["over"] > 1 + 1e-9 or verdict["gap"] > 1e-12,
        "passed": draw.within and verdict["passed"] > 1e-9,
        "end": not verdict["end"],
        "undone": not found.done,
        "behind": found.behind / draw.stop,
        "late": found.late / draw.stop,
        "knots": found.late / stream.knot if draw.in_time else None,
        "goals": "in time" if not late else "stalled" if late >= draw.period else "jittered",
        "cut": float(verdict["cut"]),
        "kept": stream.report.kept,
        "iterations": stream.report.iterations,
        "of": f"N {len(draw.limits)} period {draw.period} delay {draw.delay} share {draw.share}",
    }
    if beside and draw.within and draw.one_way:
        row["beside"] = max(lateness_of_planning_anew(draw), 0.0) / draw.stop
    return row


def main() -> int:
    """Print what was found; 1 if any fault was."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=300)
    parser.add_argument("--first", type=int, default=0, help="number of the first run")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--iterations", type=int, default=40, help="bound of the solver")
    parser.add_argument("--beside", action="store_true", help="plan anew each cycle as well")
    parser.add_argument("--save", type=Path, help="add a line for each run to this file")
    parser.add_argument("--of", type=Path, nargs="+", help="only print the table of these files")
    options = parser.parse_args()
    if options.of:
        lines = [line for path in options.of for line in path.read_text().splitlines()]
        return table([json.loads(line) for line in lines])
    one = partial(row_of, seed=options.seed, iterations=options.iterations, beside=options.beside)
    numbers = range(options.first, options.first + options.runs)
    if options.jobs == 1:
        return table(list(followed(map(one, numbers), options.runs, options.save)))
    with multiprocessing.Pool(options.jobs) as pool:
        rows = pool.imap_unordered(one, numbers, chunksize=4)
        return table(list(followed(rows, options.runs, options.save)))


def followed(rows: Iterable[Row], count: int, save: Path | None) -> Iterator[Row]:
    """The same; what has a fault is told at once, and how far it is now and then."""
    began = told = time.monotonic()
    for i, row in enumerate(rows, start=1):
        if row:
            if save is not None:
                with save.open("a") as file:
                    file.write(json.dumps(row) + "\n")
            if any(row[name] for name in FAULTS):
                print(f"fault: {row}", flush=True)
            yield row
        if time.monotonic() - told > 10.0:
            told = time.monotonic()
            print(f"{i} of {count} runs, {told - began:.0f} s", flush=True)


def table(rows: Sequence[Row]) -> int:
    """Print the figures; 1 if any fault is among them."""
    found = [row for row in rows if row]
    for mode in ("within", "trust"):
        own = [row for row in found if row["mode"] == mode]
        if not own:
            continue
        counts = ", ".join(f"{name} {sum(row[name] for row in own)}" for name in FAULTS)
        print(f"{mode}: runs {len(own)}, {counts}")
        print("  end later than max(plan + delay, arrival of the last goal), in stops")
        line("all", [row["behind"] for row in own])
        both = [row for row in own if "beside" in row]
        line("goals one way", [row["behind"] for row in both])
        line("planned anew each cycle", [row["beside"] for row in both])
        line("the one less the other", [row["behind"] - row["beside"] for row in both])
        print("  the same, or than what came late and the rest of the recording behind it")
        line("all", [row["late"] for row in own])
        for kind in ("in time", "jittered", "stalled"):
            line(f"goals {kind}", [row["late"] for row in own if row["goals"] == kind])
        print("  in time, and known 0.75 stops before they were due; late, in knots")
        line("all", [row["knots"] for row in own if row["knots"] is not None])
        print("  other")
        line("goals off the motion, of the way", [row["cut"] for row in own], "{:.1e}")
        line("most iterations in one solution", [row["iterations"] for row in own], "{:.0f}")
        print(f"  the plan before was kept in {sum(row['kept'] for row in own)} knots")
    return int(any(row[name] for row in found for name in FAULTS))


def line(name: str, values: Sequence[float], form: str = "{:.2f}") -> None:
    """Number, median, 90th and 99th percentile and worst of some values."""
    if values:
        cells = [form.format(x) for x in np.percentile(values, [50, 90, 99, 100])]
        print(
            f"    {name:34} {len(values):6} median {cells[0]}, p90 {cells[1]}, p99 {cells[2]}, "
            f"worst {cells[3]}"
        )


if __name__ == "__main__":
    sys.exit(main())
