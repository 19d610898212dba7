"""The commands of a person about recordings: record, plot, simulate.

Never here: motion, layouts of files.
"""

from __future__ import annotations

import argparse
import itertools
import signal
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sjerk.cli.arguments import duration_or_inf
from sjerk.cli.commands import add_force, name_of, ready, show
from sjerk.errors import ExtraMissingError, InputError
from sjerk.recording.recording import Recorder, Recording
from sjerk.recording.replay import replay

_POINTS = 2000  # most points of a curve: more is not seen


def add_arguments(jobs: Any) -> None:
    """Add record, plot and simulate."""
    job = jobs.add_parser("record", help="record every cycle of a running kernel until its end")
    job.add_argument("file", type=Path, help="ends in .parquet or .mcap (extra: record)")
    job.add_argument("--name", help="of the kernel; default: the only one that runs")
    job.add_argument("--seconds", type=duration_or_inf, default=float("inf"))
    add_force(job)
    job.add_argument("--json", action="store_true")
    job.set_defaults(run=_record)
    job = jobs.add_parser("plot", help="a picture of a recording: planned, commanded, actual")
    job.add_argument("file", type=Path)
    job.add_argument("--out", type=Path, help="default: the recording's name with .png")
    job.add_argument("--axes", type=int, nargs="+", help="default: all")
    job.set_defaults(run=_plot)
    job = jobs.add_parser("simulate", help="run a recording again and compare every bit")
    job.add_argument("file", type=Path)
    job.add_argument("--json", action="store_true")
    job.set_defaults(run=_simulate)


def _record(options: argparse.Namespace) -> int:
    def end(*_: object) -> None:
        raise KeyboardInterrupt

    name = name_of(options)
    ready(options, options.file)
    before = signal.signal(signal.SIGTERM, end)
    try:
        recorder = Recorder(name, options.file)
        until = time.monotonic() + options.seconds
        with recorder, suppress(KeyboardInterrupt):
            while recorder.alive and time.monotonic() < until:
                time.sleep(0.05)
    finally:
        signal.signal(signal.SIGTERM, before)
    show(
        options,
        {"file": str(options.file), "cycles": recorder.cycles, "missed": recorder.missed},
    )
    return 0


def _simulate(options: argparse.Namespace) -> int:
    """Exit code 1 where the recording does not come out again."""
    done = replay(options.file)
    show(
        options,
        {
            "cycles": done.cycles,
            "identical": done.identical,
            "difference": None if done.difference is None else str(done.difference),
            "times_real_time": round(done.speed, 1),
        },
    )
    return 0 if done.identical else 1


# ---- the picture ---------------------------------------------------------------------------------


def _thin(values: NDArray[Any]) -> NDArray[Any]:
    """Indices of at most so many rows: of each bin its smallest and its largest value."""
    n = len(values)
    if n <= _POINTS:
        return np.arange(n)
    edges = np.linspace(0, n, _POINTS // 2 + 1).astype(int)
    found = [0, n - 1]
    for low, high in itertools.pairwise(edges):
        part = values[low:high]
        found += [low + int(np.argmin(part)), low + int(np.argmax(part))]
    return np.unique(found)


def _plot(options: argparse.Namespace) -> int:
    try:
        from sjerk.cli import plot
    except ImportError as fault:
        raise ExtraMissingError("matplotlib", "demo") from fault
    out = options.out or options.file.with_suffix(".png")
    plot.check(out)
    recording = Recording.open(options.file)
    if not len(recording):
        raise InputError("file", str(options.file), "has no cycle")
    axes = options.axes or range(len(recording.axes))
    for i in axes:
        if not 0 <= i < len(recording.axes):
            raise InputError("axes", i, f"axis numbers are 0 .. {len(recording.axes) - 1}")
    plot.grid(
        out,
        f"{recording.name}: {len(recording)} cycles of {recording.cycle_time * 1e6:g} us",
        [(f"axis {i}", _panels(plot.Curve, recording, i)) for i in axes],
    )
    print(f"plot: {out}")
    return 0


def _panels(curve: Any, recording: Recording, i: int) -> dict[str, list[Any]]:
    T, time_s, unit = recording.cycle_time, recording.time, recording.axes[i].unit or "unit"

    def one(label: str, values: NDArray[Any], style: str = "-") -> Any:
        rows = _thin(values)
        return curve(label, time_s[rows], values[rows], style)

    limits = recording.column("limits")[:, i]
    position, actual = recording.position[:, i], recording.actual_position[:, i]
    own = recording.axes[i].limits.position
    cycles, planned = recording.way_points(i)
    points = [curve("way-points", cycles * T, planned, "k.")] if len(cycles) else []
    bounds = [one("", np.full(len(position), x), "k--") for x in own or ()]
    found = {
        f"position / {unit}": [
            one("planned", recording.goal[:, i], ":"),
            one("commanded", position),
            one("actual", actual, "--"),
            *points,
            *bounds,
        ],
        f"error / {unit}": [one("commanded - actual", position - actual)],
    }
    for n, (name, values) in enumerate(
        (
            ("velocity", recording.velocity),
            ("acceleration", recording.acceleration),
            ("jerk", recording.jerk),
        ),
        start=1,
    ):
        down = {"acceleration": "deceleration", "jerk": "deceleration_jerk"}.get(name, name)
        most = np.maximum(limits[name], limits[down]) / T**n
        found[f"{name} / {unit}/s{n if n > 1 else ''}"] = [
            one("commanded", values[:, i]),
            one("limits", most, "k--"),
            one("", -most, "k--"),
        ]
    return found
