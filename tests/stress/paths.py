"""Random motions through many points, judged: `./run stress paths [--runs N] [--seed S]`.

Four exams of N inputs each: ruckig's time-optimal motions sampled (own time, way-points near), the
same way-points at five paces (never longer where less is asked), polylines without times (never
slower than stopping, exact and near), and the shares of both. Limits are judged on the recorded
positions. Exit status 0 if no motion failed, left a limit or broke a sentence above.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
from helpers.following_check import recording, recording_keeps
from sjerk import Limits, PlanError, Trajectory, follow, follow_path, follow_stops
from sjerk.trajectory.segments import Followed

#: What an exam tells of one input: figures by name, of which 1 is a fault for those in FAULTS.
Told = dict[str, float]
FAULTS = ("failed", "limits", "late", "far", "longer", "slower")


def judged(blocks: list[Followed], limits: list[Limits], T: float) -> Told:
    """Limits kept to 1e-9 by the differences of the recorded positions."""
    try:
        recording_keeps(recording(blocks)[0], limits, T)
    except AssertionError:
        return {"limits": 1.0}
    return {"limits": 0.0}


def cycles(blocks: list[Followed]) -> int:
    return sum(int(block.cycles.sum()) for block in blocks)


def drawn(rng: np.random.Generator, joints: int, unit: float) -> list[Limits]:
    return [
        Limits(
            *(unit * 10.0 ** rng.uniform(*span) for span in ((-0.3, 0.7), (0.3, 1.3), (1.3, 2.8)))
        )
        for _ in range(joints)
    ]


def own_time(rng: np.random.Generator) -> Told:
    """Ruckig's motion at all of its limits: own time and two knots, way-points within 1e-6."""
    import ruckig

    joints, T, unit = int(rng.integers(1, 8)), 1e-3, 10.0 ** rng.uniform(-3.0, 3.0)
    limits = drawn(rng, joints, unit)
    otg, inp, made = ruckig.Ruckig(joints), ruckig.InputParameter(joints), ruckig.Trajectory(joints)
    inp.current_position = rng.normal(size=joints) * unit
    inp.target_position = rng.normal(size=joints) * unit
    inp.max_velocity = [k.velocity for k in limits]
    inp.max_acceleration = [k.acceleration for k in limits]
    inp.max_jerk = [k.jerk for k in limits]
    otg.calculate(inp, made)
    dt = 10.0 ** rng.uniform(-3.0, -1.0)
    t = np.append(np.arange(0.0, made.duration - dt / 2, dt), made.duration)
    q = np.array([np.atleast_1d(made.at_time(float(x))[0]) for x in t])
    way = np.ptp(q, axis=0)
    blocks = list(follow(Trajectory([f"j{k}" for k in range(joints)], t, q), limits, T))
    soft = min(k.acceleration / k.jerk for k in limits) / T
    stop = max(k.velocity / k.acceleration + k.acceleration / k.jerk for k in limits) / T
    knot = max(2.0, soft / 3.0, stop / 60.0)
    late = cycles(blocks) - made.duration / T
    far = max(float((np.abs(b.passed.deviation) / way).max()) for b in blocks)
    exact = late <= 2.0 * knot + 1.0 and far <= 1e-6
    rounded = late <= 1.0 and far <= 1e-4
    return {
        **judged(blocks, limits, T),
        "late": float(late > 2.0 * knot + 1.0),
        "far": float(far > 1.01e-4),
        "as asked": float(exact or rounded),
        "later, cycles": late,
    }


def five_paces(rng: np.random.Generator) -> Told:
    """The same way-points at five paces: none takes longer when less is asked."""
    joints, n, unit = int(rng.integers(1, 4)), int(rng.integers(3, 12)), 10.0 ** rng.uniform(-3, 3)
    limits = drawn(rng, joints, unit)
    q = np.cumsum(rng.normal(size=(n, joints)) * 0.3 * unit, axis=0)
    t = np.concatenate([[0.0], np.cumsum(rng.uniform(0.05, 0.6, n - 1))])
    names = [f"j{k}" for k in range(joints)]
    told: Told = {"limits": 0.0}
    taken = []
    for pace in (3.0, 1.2, 1.0, 0.9, 0.5):
        blocks = list(follow(Trajectory(names, t * pace, q), limits, 1e-3))
        told["limits"] = max(told["limits"], judged(blocks, limits, 1e-3)["limits"])
        taken.append(cycles(blocks))
    rise = max(b / a for a, b in itertools.pairwise(taken)) - 1.0
    return {**told, "longer": float(rise > 0.0), "longer, by share": max(rise, 0.0)}


def polyline(rng: np.random.Generator) -> Told:
    """Exact, and within a per cent: never slower than stopping at every point."""
    joints, n, unit = int(rng.integers(1, 4)), int(rng.integers(3, 9)), 10.0 ** rng.uniform(-3, 3)
    limits = drawn(rng, joints, unit)
    path = rng.normal(size=(n, joints)) * unit
    stops = sum(motion.cycles + 1 for motion in follow_stops(path, limits, 1e-3))
    exact = list(follow_path(path, limits, 1e-3))
    near = list(follow_path(path, limits, 1e-3, tolerance=0.01 * np.ptp(path, axis=0)))
    still = sum(len(block) for block in exact) > 0 and _stops_at_points(exact)
    return {
        "limits": max(judged(b, limits, 1e-3)["limits"] for b in (exact, near)),
        "slower": float(cycles(exact) > stops or cycles(near) > stops),
        "slower with a tolerance": float(cycles(near) > 1.002 * cycles(exact)),
        "far": float(max(b.passed.largest for b in exact) > 1e-6 * np.ptp(path)),
        "exact / stops": cycles(exact) / stops,
        "near / exact": cycles(near) / cycles(exact),
        "answered by stops": float(still),
    }


def _stops_at_points(blocks: list[Followed]) -> bool:
    """Whether the motion rests in each of its way-points, as the fallback does."""
    ends = np.concatenate([block.first_cycle + np.cumsum(block.cycles) for block in blocks])
    speed = np.concatenate([np.abs(block.velocity[1:]).max(axis=1) for block in blocks])
    moment = np.concatenate([block.passed.moment for block in blocks]) / blocks[0].cycle_time
    rests = ends[speed == 0.0]
    return bool(np.isin(np.rint(moment[1:]).astype(int), rests).all()) and len(moment) > 2


EXAMS: dict[str, Callable[[np.random.Generator], Told]] = {
    "own time": own_time,
    "five paces": five_paces,
    "polyline": polyline,
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
