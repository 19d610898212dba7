"""``sjerk plot``: a recording, or the points of a trajectory, as a picture.

Never here: how it is drawn.
"""

from __future__ import annotations

import argparse
import itertools
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sjerk.errors import InputError
from sjerk.extras import load
from sjerk.recording import Recording
from sjerk.trajectory import Trajectory, TrajectoryError, resample

_POINTS = 2000  # most points of a curve: more is not seen


def add_arguments(jobs: Any) -> None:
    """Add plot."""
    job = jobs.add_parser("plot", help="a picture of a recording: planned, commanded, actual")
    job.add_argument("file", type=Path, help="a recording, .parquet or .mcap")
    job.add_argument(
        "--resample",
        type=float,
        metavar="DELTA",
        help="instead: FILE is a trajectory (CSV or bag), drawn before and after resampling",
    )
    job.add_argument("--out", type=Path, help="default: the recording's name with .png")
    job.add_argument("--axes", type=int, nargs="+", help="default: all")
    job.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Check the picture's kind before the recording is read."""
    pictures = load("sjerk.cli.pictures", extra="demo")
    out = options.out or options.file.with_suffix(".png")
    pictures.check(out)
    if options.resample is not None:
        return _resampled(options, pictures, out)
    recording = Recording.open(options.file)
    if not len(recording):
        raise InputError("file", str(options.file), "has no cycle")
    axes = options.axes or range(len(recording.axes))
    for i in axes:
        if not 0 <= i < len(recording.axes):
            raise InputError("axes", i, f"axis numbers are 0 .. {len(recording.axes) - 1}")
    pictures.grid(
        out,
        f"{recording.name}: {len(recording)} cycles of {recording.cycle_time * 1e6:g} us",
        [(f"axis {i}", _panels(pictures.Curve, recording, i)) for i in axes],
    )
    print(f"plot: {out}")
    return 0


def _resampled(options: argparse.Namespace, pictures: Any, out: Path) -> int:
    """Every joint's points, and those that ``resample`` keeps."""
    file = options.file
    read = Trajectory.from_csv if file.suffix.lower() == ".csv" else Trajectory.from_bag
    try:
        trajectory = read(file)
    except TrajectoryError as error:
        raise InputError("file", str(file), str(error)) from error
    if trajectory.position is None:
        raise InputError("file", str(file), "has no positions")
    kept = resample(trajectory.position, options.resample)
    joints = options.axes or range(len(trajectory.joint_names))
    panels = {}
    for i in joints:
        if not 0 <= i < len(trajectory.joint_names):
            most = len(trajectory.joint_names) - 1
            raise InputError("axes", i, f"joint numbers are 0 .. {most}")
        at, position = trajectory.time, trajectory.position[:, i]
        panels[trajectory.joint_names[i]] = [
            pictures.Curve("points", at, position, ".-"),
            pictures.Curve("kept", at[kept], position[kept], "o-"),
        ]
    title = f"{file.name}: {len(trajectory)} points, {len(kept)} kept at {options.resample:g}"
    pictures.grid(out, title, [("before and after resampling", panels)])
    print(f"plot: {out}, {len(trajectory)} points, {len(kept)} kept")
    return 0


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


def _panels(curve: Any, recording: Recording, i: int) -> dict[str, list[Any]]:
    T, time_s, unit = recording.cycle_time, recording.time, recording.axes[i].unit or "unit"

    def one(label: str, values: NDArray[Any], style: str = "-") -> Any:
        rows = _thin(values)
        return curve(label, time_s[rows], values[rows], style)

    limits = recording.column("limits")[:, i]
    position, actual = recording.position[:, i], recording.actual_position[:, i]
    own = recording.axes[i].limits.position
    cycles, planned = recording.knots(i)
    points = [curve("knots", cycles * T, planned, "k.")] if len(cycles) else []
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
