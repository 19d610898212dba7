"""Random paths without times, judged: `./run stress paths [--runs N] [--seed S]`.

Exams of N inputs each: polylines (never slower than stopping; exact, near and in a corridor),
dense points of smooth curves beside TOPP-RA's time, which knows no jerk, and polylines with
position limits on their turns. Limits are judged on the recorded positions. Exit status 0 if no
motion failed, left a limit, a way-point or a corridor, or was slower than stopping; the share
answered by stops is told.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
from helpers.following_check import recording, recording_keeps
from sjerk import Limits, PlanError, follow_path, follow_stops
from sjerk.trajectory.segments import Followed

T = 1e-3
#: What an exam tells of one input: figures by name, of which 1 is a fault for those in FAULTS.
Told = dict[str, float]
FAULTS = ("failed", "limits", "far", "outside", "slower than stops", "slower with a tolerance")


def judged(blocks: list[Followed], limits: list[Limits]) -> float:
    """1 where a limit is left, by the differences of the recorded positions."""
    position = recording(blocks)[0]
    try:
        recording_keeps(position, limits, T)
    except AssertionError:
        return 1.0
    low, high = np.array([limit.position or (-np.inf, np.inf) for limit in limits]).T
    room = 1e-9 * np.ptp(position, axis=0)
    return float(((position < low - room) | (position > high + room)).any())


def cycles(blocks: list[Followed]) -> int:
    return sum(int(block.cycles.sum()) for block in blocks)


def largest(blocks: list[Followed]) -> float:
    return max(block.passed.largest for block in blocks)


def drawn(rng: np.random.Generator, joints: int, unit: float) -> list[Limits]:
    """Limits over a decade each; the time to full velocity from 0.05 to 10 s."""
    spans = ((-0.3, 0.7), (0.3, 1.3), (1.3, 2.8))
    return [Limits(*(unit * 10.0 ** rng.uniform(*span) for span in spans)) for _ in range(joints)]


def from_lines(position: np.ndarray, path: np.ndarray) -> float:
    """The largest distance of any position from the nearest of the lines between way-points."""
    nearest = np.full(len(position), np.inf)
    for one, two in itertools.pairwise(path):
        way = two - one
        along = np.clip((position - one) @ way / (way @ way), 0.0, 1.0)
        off = np.linalg.norm(position - one - along[:, None] * way, axis=1)
        nearest = np.minimum(nearest, off)
    return float(nearest.max())


def polyline(rng: np.random.Generator) -> Told:
    """Exact, within a per cent at the way-points, within a per cent of the lines; beside stops."""
    joints, n, unit = int(rng.integers(1, 8)), int(rng.integers(3, 9)), 10.0 ** rng.uniform(-3, 3)
    limits = drawn(rng, joints, unit)
    path = rng.normal(size=(n, joints)) * unit
    width = 0.01 * float(np.linalg.norm(np.ptp(path, axis=0)))
    stops = sum(motion.cycles + 1 for motion in follow_stops(path, limits, T))
    exact = list(follow_path(path, limits, T))
    near = list(follow_path(path, limits, T, tolerance=0.01 * np.ptp(path, axis=0)))
    inside = list(follow_path(path, limits, T, corridor=width))
    every = (exact, near, inside)
    return {
        "limits": max(judged(blocks, limits) for blocks in every),
        "slower than stops": float(max(map(cycles, every)) > stops),
        "slower with a tolerance": float(cycles(near) > 1.002 * cycles(exact)),
        "far": float(largest(exact) > 1e-6 * np.ptp(path)),
        "outside": float(from_lines(recording(inside)[0], path) > width * (1.0 + 1e-9)),
        "exact / stops": cycles(exact) / stops,
        "near / exact": cycles(near) / cycles(exact),
        "corridor / stops": cycles(inside) / stops,
        "answered by stops": float(_by_stops(exact)),
        "corridor answered by stops": float(_by_stops(inside)),
    }


def turning(rng: np.random.Generator) -> Told:
    """The ranges of the joints are those of the way-points: each turns on a limit."""
    joints, n, unit = int(rng.integers(1, 4)), int(rng.integers(3, 7)), 10.0 ** rng.uniform(-3, 3)
    free = drawn(rng, joints, unit)
    path = rng.normal(size=(n, joints)) * unit
    limits = [
        Limits(one.velocity, one.acceleration, one.jerk, position=(x.min(), x.max()))
        for one, x in zip(free, path.T, strict=True)
    ]
    stops = sum(motion.cycles + 1 for motion in follow_stops(path, limits, T))
    width = 0.01 * float(np.linalg.norm(np.ptp(path, axis=0)))
    held, other = list(follow_path(path, limits, T)), list(follow_path(path, free, T))
    near = list(follow_path(path, limits, T, tolerance=0.01 * np.ptp(path, axis=0)))
    inside = list(follow_path(path, limits, T, corridor=width))
    every = (held, near, inside)
    return {
        "limits": max(judged(blocks, limits) for blocks in every),
        "slower than stops": float(max(map(cycles, every)) > stops),
        "slower with a tolerance": float(cycles(near) > 1.002 * cycles(held)),
        "outside": float(from_lines(recording(inside)[0], path) > width * (1.0 + 1e-9)),
        "far": float(largest(held) > 1e-6 * np.ptp(path)),
        "with limits / without": cycles(held) / cycles(other),
        "near / exact": cycles(near) / cycles(held),
        "corridor / stops": cycles(inside) / stops,
        "answered by stops": float(_by_stops(held)),
        "corridor answered by stops": float(_by_stops(inside)),
    }


def curve(rng: np.random.Generator) -> Told:
    """Points of a smooth closed curve, two to seven joints: beside TOPP-RA on a spline of them."""
    import toppra

    joints, n = int(rng.integers(2, 8)), int(rng.integers(30, 120))
    limits = drawn(rng, joints, 1.0)
    angle = np.linspace(0.0, 2.0 * np.pi, n)
    path = np.zeros((n, joints))
    for order in (1, 2, 3):
        wave = rng.normal(size=(2, joints)) / order**2
        path += np.outer(np.cos(order * angle), wave[0]) + np.outer(np.sin(order * angle), wave[1])
    most = [np.array([getattr(k, name) for k in limits]) for name in ("velocity", "acceleration")]
    bounds = (
        toppra.constraint.JointVelocityConstraint,
        toppra.constraint.JointAccelerationConstraint,
    )
    rows: list[Any] = [of(np.column_stack([-x, x])) for of, x in zip(bounds, most, strict=True)]
    spline = toppra.SplineInterpolator(np.linspace(0.0, 1.0, n), path)
    timed = toppra.algorithm.TOPPRA(rows, spline).compute_trajectory(0.0, 0.0)
    blocks = list(follow_path(path, limits, T))
    near = list(follow_path(path, limits, T, tolerance=1e-3 * np.ptp(path, axis=0)))
    return {
        "limits": max(judged(made, limits) for made in (blocks, near)),
        "far": float(largest(blocks) > 1e-4 * np.ptp(path)),
        "slower with a tolerance": float(cycles(near) > 1.002 * cycles(blocks)),
        "exact / TOPP-RA": cycles(blocks) * T / timed.duration,
        "within 1e-3 / TOPP-RA": cycles(near) * T / timed.duration,
        "answered by stops": float(_by_stops(blocks)),
    }


def _by_stops(blocks: list[Followed]) -> bool:
    """Whether the motion rests in each of its way-points, as the fallback does."""
    ends = np.concatenate([block.first_cycle + np.cumsum(block.cycles) for block in blocks])
    speed = np.concatenate([np.abs(block.velocity[1:]).max(axis=1) for block in blocks])
    moment = np.concatenate([block.passed.moment for block in blocks]) / blocks[0].cycle_time
    rests = ends[speed == 0.0]
    return bool(np.isin(np.rint(moment[1:]).astype(int), rests).all()) and len(moment) > 2


EXAMS: dict[str, Callable[[np.random.Generator], Told]] = {
    "polyline": polyline,
    "turning": turning,
    "curve": curve,
}


def main() -> int:
    """Print what was found; 1 if any fault was."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--exam", choices=EXAMS, action="append", help="only this one")
    parser.add_argument("--verbose", action="store_true", help="a line for each input with a fault")
    options = parser.parse_args()
    faults = 0
    for name in options.exam or EXAMS:
        rows: list[Told] = []
        began = time.process_time()
        for run in range(options.runs):
            try:
                told = EXAMS[name](np.random.default_rng([options.seed, run]))
            except PlanError as error:
                told = {"failed": 1.0}
                if options.verbose:
                    print(f"{name} {run}: {error}", flush=True)
            rows.append(told)
            wrong = [fault for fault in FAULTS if told.get(fault)]
            faults += bool(wrong)
            if wrong and options.verbose:
                print(f"{name} {run}: {told}", flush=True)
        print(f"{name}: {options.runs} inputs, {time.process_time() - began:.0f} s of computing")
        for key in dict.fromkeys(key for row in rows for key in row):
            column = np.array([row[key] for row in rows if key in row])
            if key in FAULTS or set(np.unique(column)) <= {0.0, 1.0}:
                print(f"  {key}: {int(column.sum())} of {options.runs}")
            else:
                low, high = np.percentile(column, [50, 99])
                print(f"  {key}: median {low:.4g}, p99 {high:.4g}, largest {column.max():.4g}")
    return int(faults > 0)


if __name__ == "__main__":
    sys.exit(main())
