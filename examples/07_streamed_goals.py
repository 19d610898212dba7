"""Streamed goals: each interrupting the last, and with look-ahead.

    python examples/07_streamed_goals.py [picture.png]

A recorded path of a robot's joint comes in at 10 Hz. Interrupted, the joint slows down before every
goal; a stream with look-ahead runs four goal periods behind and goes through them.
"""

import sys
from pathlib import Path

import numpy as np

from sjerk import GoalStream, Limits
from sjerk.cli.pictures import Curve, panels
from sjerk.trajectory import read_recording, shipped_recording
from sjerk.trajectory.joining import join
from sjerk.trajectory.segments import Knot, split

T, PERIOD = 1e-3, 0.1
limits = Limits.from_jerk_factor(velocity=90.0, acceleration=214.0, jerk_factor=0.5)
goals = read_recording(shipped_recording()).position


def interrupted() -> np.ndarray:
    """Each goal a move of its own, planned from wherever the one before has come to."""
    rows, knot = [], Knot.rest(goals[:1])
    for goal in goals[1:]:
        move = join(knot, [goal], [limits], T)
        if move.cycles.sum() > round(PERIOD / T) and goal != goals[-1]:
            move, _ = split(move, round(PERIOD / T))
        rows.append(move.sample().position[:, 0])
        knot = Knot.of(move)
    return np.concatenate(rows)


def looking_ahead(stop_within: bool) -> np.ndarray:
    """Goals pushed as they come, segments taken when they are due."""
    stream = GoalStream([limits], T, goals[:1], period=PERIOD, stop_within=stop_within)
    blocks = []
    for k, goal in enumerate(goals[1:], start=1):
        stream.push([goal])
        blocks += stream.take(round(k * PERIOD / T))
    stream.end()
    while not stream.done:
        blocks += stream.take(stream.cycle + 100)
    print(f"stop_within={stop_within!s:5}: largest lag {stream.report.largest_lag:.3f} s")
    return np.concatenate([block.sample().position[:, 0] for block in blocks])


runs = {
    "each interrupts the last": interrupted(),
    "look-ahead, can always stop": looking_ahead(stop_within=True),
    "look-ahead": looking_ahead(stop_within=False),
}
panel: dict[str, list[Curve]] = {"position / deg": [], "velocity / (deg/s)": []}
panel["position / deg"].append(Curve("goals", PERIOD * np.arange(len(goals)), goals, "k."))
for name, position in runs.items():
    t = T * np.arange(len(position))
    velocity = np.gradient(position, T)
    print(f"{name:28}: {t[-1]:.3f} s, ends at {position[-1]:.6f} deg")
    panel["position / deg"].append(Curve(name, t, position))
    panel["velocity / (deg/s)"].append(Curve(name, t, velocity))
panels(
    Path(sys.argv[1]) if len(sys.argv) > 1 else Path("07_streamed_goals.png"),
    "goals at 10 Hz",
    panel,
    {"velocity / (deg/s)": limits.velocity},
)
