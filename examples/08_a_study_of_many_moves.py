"""A study: how long moves take over the limits of acceleration and jerk, by millions of plans.

    python examples/08_a_study_of_many_moves.py [picture.png] [--moves N] [--scheduler ADDRESS]

Each task plans its own moves from its own seed, so that the result is the same wherever it runs: in
this process, on all processors (``pip install 'sjerk[studies]'``), or on a cluster by the address
of its dask scheduler.
"""

import argparse
from collections.abc import Iterable
from contextlib import ExitStack
from typing import NamedTuple

import matplotlib

matplotlib.use("Agg")
import numpy as np
from matplotlib import pyplot

from sjerk import Limits, plan_many

try:
    from distributed import Client
except ImportError:
    Client = None

T = 1e-3
VELOCITY = 90.0  # deg/s
ACCELERATIONS = np.geomspace(100.0, 2000.0, 16)  # deg/s^2
JERKS = np.geomspace(1e3, 1e5, 16)  # deg/s^3
BATCH = 50_000


class Task(NamedTuple):
    """Moves under one pair of limits."""

    row: int
    column: int
    moves: int
    seed: int


class Result(NamedTuple):
    """Moves and the sum of their durations, s."""

    row: int
    column: int
    moves: int
    seconds: float


def run(task: Task) -> Result:
    """Plan the moves of a task: from rest to rest, distances between 1 and 180 degrees."""
    limits = Limits(VELOCITY, float(ACCELERATIONS[task.row]), float(JERKS[task.column]))
    goals = np.random.default_rng(task.seed).uniform(1.0, 180.0, task.moves)
    plans = plan_many(np.zeros(task.moves), goals, limits, T)
    return Result(task.row, task.column, task.moves, float(plans.duration.sum()))


def tasks(moves: int) -> Iterable[Task]:
    """As many for each pair of limits, in batches."""
    each = -(-moves // (len(ACCELERATIONS) * len(JERKS)))
    seed = 0
    for row in range(len(ACCELERATIONS)):
        for column in range(len(JERKS)):
            for first in range(0, each, BATCH):
                yield Task(row, column, min(BATCH, each - first), seed)
                seed += 1


def results(moves: int, scheduler: str | None) -> Iterable[Result]:
    """On a cluster, on all processors, or here."""
    if Client is None:
        yield from map(run, tasks(moves))
        return
    with ExitStack() as stack:
        client = stack.enter_context(
            Client(scheduler)
            if scheduler
            else Client(processes=False, dashboard_address=None, silence_logs=40)
        )
        yield from client.gather(client.map(run, list(tasks(moves)), pure=True))


def main() -> None:
    """Plan, print, draw."""
    parser = argparse.ArgumentParser()
    parser.add_argument("picture", nargs="?", default="08_a_study_of_many_moves.png")
    parser.add_argument("--moves", type=int, default=256_000)
    parser.add_argument("--scheduler", help="address of a dask scheduler")
    options = parser.parse_args()
    total, count = np.zeros((2, len(ACCELERATIONS), len(JERKS)))
    for result in results(options.moves, options.scheduler):
        total[result.row, result.column] += result.seconds
        count[result.row, result.column] += result.moves
    mean = total / count
    print(f"{int(count.sum())} moves; mean duration {mean.max():.3f} s .. {mean.min():.3f} s")

    figure, axes = pyplot.subplots(figsize=(7, 5), layout="constrained")
    picture = axes.pcolormesh(JERKS, ACCELERATIONS, mean, shading="gouraud")
    axes.contour(JERKS, ACCELERATIONS, mean, 10, colors="white", linewidths=0.6)
    axes.set(xscale="log", yscale="log", xlabel="jerk, deg/s$^3$", ylabel="acceleration, deg/s$^2$")
    axes.set_title(f"mean duration of {int(count.sum()):,} moves of 1 to 180 degrees, s")
    figure.colorbar(picture)
    figure.savefig(options.picture, dpi=110)


if __name__ == "__main__":
    main()
