"""Goals drawn at random, as plain rows: right ones, and ones wrong in one way that is known.

Both ROS are judged by them; whoever sends makes messages of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from helpers.ros_robot import NAMES

#: Position limit of each joint of the robot, rad or m.
REACH = 3.0


@dataclass(frozen=True)
class Goal:
    """Names, and per point its moment (s), positions, velocities; tolerances by joint."""

    names: list[str]
    times: list[float]
    positions: list[list[float]]
    velocities: list[list[float]]
    path_tolerance: list[tuple[str, float]] = field(default_factory=list)
    stamp: float = 0.0


def right(draw: np.random.Generator, start: np.ndarray, span: float = 0.3) -> Goal:
    """One of any number of points near ``start`` (3,), names in any order, slow enough."""
    count = int(draw.integers(1, 30))
    times = np.cumsum(draw.uniform(0.02, 0.4, count)) + 0.3
    way = start + np.cumsum(draw.uniform(-1.0, 1.0, (count, 3)) * span / count, axis=0)
    way = np.clip(way, -0.9 * REACH, 0.9 * REACH)
    order = draw.permutation(3)
    return Goal(
        [NAMES[i] for i in order],
        times.tolist(),
        way[:, order].tolist(),
        [[] for _ in range(count)],
    )


def _number(draw: np.random.Generator) -> float:
    """Nothing that a joint could be asked for."""
    huge = float(10.0 ** draw.uniform(1.0, 308.0)) * (1 if draw.random() < 0.5 else -1)
    return float(draw.choice([math.nan, math.inf, -math.inf, huge]))


def _elsewhere(rows: list[Any], at: int, value: Any) -> list[Any]:
    return [value if k == at else row for k, row in enumerate(rows)]


def _text(draw: np.random.Generator) -> str:
    letters = [chr(int(c)) for c in draw.choice([*range(32, 127), 0xE9, 0x4E2D], draw.integers(9))]
    return "".join(letters)


def wrong(draw: np.random.Generator, start: np.ndarray) -> tuple[str, Goal]:
    """What is wrong with it, and a goal that no controller may take."""
    goal = right(draw, start)
    count = len(goal.times)
    at, joint = int(draw.integers(count)), int(draw.integers(3))
    row = goal.positions[at]
    kinds = [
        "position", "velocity", "size", "sizes", "name", "twice", "fewer", "more", "names", "time",
        "order", "empty", "tolerance", "nobody", "past", "nothing",
    ]  # fmt: skip
    kind = str(draw.choice(kinds))
    if kind == "position":
        bad = _elsewhere(row, joint, _number(draw))
        goal = replace(goal, positions=_elsewhere(goal.positions, at, bad))
    elif kind == "velocity":
        bad = _elsewhere([0.0] * 3, joint, float(draw.choice([math.nan, math.inf, -math.inf])))
        goal = replace(goal, velocities=[bad if k == at else [0.0] * 3 for k in range(count)])
    elif kind == "size":
        size = int(draw.choice([0, 1, 2, 4, 5, 100]))
        goal = replace(goal, positions=_elsewhere(goal.positions, at, [0.0] * size))
    elif kind == "sizes":
        size = int(draw.choice([1, 2, 4, 50]))
        goal = replace(goal, velocities=[[0.0] * size for _ in range(count)])
    elif kind == "name":
        goal = replace(goal, names=_elsewhere(goal.names, joint, _text(draw)))
    elif kind == "twice":
        goal = replace(goal, names=_elsewhere(goal.names, joint, goal.names[joint - 1]))
    elif kind == "fewer":
        few = [row[:2] for row in goal.positions]
        goal = replace(goal, names=goal.names[:2], positions=few)
    elif kind == "more":
        wide = [[*row, 0.0] for row in goal.positions]
        goal = replace(goal, names=[*goal.names, _text(draw)], positions=wide)
    elif kind == "names":
        goal = replace(goal, names=[_text(draw) for _ in range(int(draw.integers(200)))])
    elif kind == "time":
        bad_time = float(draw.choice([-1.0, -1e6, -2e9]))
        goal = replace(goal, times=_elsewhere(goal.times, at, bad_time))
    elif kind == "order":
        again = [*goal.times, goal.times[int(draw.integers(count))]]
        goal = replace(
            goal,
            times=again,
            positions=[*goal.positions, row],
            velocities=[*goal.velocities, []],
        )
    elif kind == "empty":
        goal = replace(goal, names=[])
    elif kind == "tolerance":
        bad_tolerance = float(draw.choice([math.nan, -2.0, -math.inf, -0.5]))
        goal = replace(goal, path_tolerance=[(goal.names[joint], bad_tolerance)])
    elif kind == "nobody":
        goal = replace(goal, path_tolerance=[("nobody", 1.0)])
    elif kind == "past":
        goal = replace(goal, stamp=float(draw.uniform(1.0, 1e6)))
    else:
        goal = replace(goal, times=[], positions=[], velocities=[])
    return kind, goal


def long_way(seconds: float) -> Goal:
    """A motion of all joints through a point each 0.1 s; begins at zero, ends near it."""
    times = np.arange(1, round(seconds / 0.1) + 1) * 0.1
    rows = np.column_stack([0.4 * np.sin(rate * times) for rate in (1.0, 1.3, 1.7)])
    rows *= np.minimum(1.0, times / 2.0)[:, None]
    return Goal(list(NAMES), times.tolist(), rows.tolist(), [[] for _ in times])
