"""Random streams, judged: `./run stress streams [--runs N] [--seed S] [--iterations I]`.

What is drawn and how it is judged: tests/helpers/stream_check.py. Exit status 0 if no stream goes
back more often than its goals, leaves a limit, passes the last goal known, ends elsewhere or never.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
from helpers.stream_check import runs


def main() -> int:
    """Print what was found; 1 if any fault was."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--iterations", type=int, default=40, help="bound of the solver")
    parser.add_argument("--verbose", action="store_true", help="a line for each run with a fault")
    options = parser.parse_args()
    began, told, faults = time.monotonic(), time.monotonic(), 0
    table: dict[str, dict[str, float]] = {}
    kept = 0
    late: dict[str, list[float]] = {"within": [], "trust": []}
    cut: dict[str, list[float]] = {"within": [], "trust": []}
    in_time: dict[str, list[float]] = {"within": [], "trust": []}
    for i, draw, found, verdict, stream in runs(
        options.seed, options.runs, iterations=options.iterations
    ):
        mode = "within" if draw.within else "trust"
        row = table.setdefault(
            mode, dict.fromkeys(("runs", "back", "over", "passed", "end", "undone"), 0)
        )
        bad = {
            "back": verdict["turns"] > 0,
            "over": verdict["over"] > 1 + 1e-9 or verdict["gap"] > 1e-12,
            "passed": draw.within and verdict["passed"] > 1e-9,
            "end": not verdict["end"],
            "undone": not found.done,
        }
        row["runs"] += 1
        kept += stream.report.kept
        for name, is_bad in bad.items():
            row[name] += is_bad
        faults += any(bad.values())
        late[mode].append(found.late / draw.stop)
        cut[mode].append(verdict["cut"])
        if draw.in_time:
            in_time[mode].append(found.late / stream.knot)
        if options.verbose and any(bad.values()):
            said = ", ".join(f"{k} {v - (k == 'over'):.3g}" for k, v in verdict.items())
            print(
                f"run {i}: {said}; N {len(draw.limits)} period {draw.period} delay {draw.delay} "
                f"{mode} share {draw.share} late {found.late / draw.stop:.2f}",
                flush=True,
            )
        if time.monotonic() - told > 10.0:
            told = time.monotonic()
            print(
                f"{i + 1} of {options.runs} runs, {told - began:.0f} s, {faults} with a fault",
                flush=True,
            )
    for mode, row in table.items():
        stops = np.percentile(late[mode], [50, 90, 99, 100])
        print(mode, ", ".join(f"{name} {int(n)}" for name, n in row.items()))
        print(
            "  late, in stops: median {:.2f}, p90 {:.2f}, p99 {:.2f}, worst {:.2f}".format(*stops)
        )
        if in_time[mode]:
            print(
                f"  {len(in_time[mode])} in time, known 0.75 stops before they were due: "
                f"late by {max(in_time[mode]):.2f} knots at most"
            )
        off = np.percentile(cut[mode], [50, 90, 99, 100])
        print(
            "  goals off the motion, of the way: "
            "median {:.1e}, p90 {:.1e}, p99 {:.1e}, worst {:.1e}".format(*off)
        )
    print(f"the plan before was kept in {kept} knots")
    return int(faults > 0)


if __name__ == "__main__":
    sys.exit(main())
