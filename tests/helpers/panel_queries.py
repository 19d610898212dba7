"""Random queries of a plan for the panel's robot among obstacles, and who judges the motion."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from helpers import panel_judge as judge
from helpers.panel_bench import RANGES, ROBOT, SETTINGS
from sjerk.ports.panel.clearance import Clearance
from sjerk.ports.panel.shapes import Scene, Shape

LIMITS = [axis.limits for axis in ROBOT.axes]
SCENE = Scene(
    {
        "table": Shape("box", (0.6, 1.6, 0.1), (0.55, 0.0, 0.05)),
        "wall": Shape("box", (1.6, 0.05, 1.2), (0.3, -0.55, 0.6)),
        "post": Shape("cylinder", (0.05, 0.9), (0.4, 0.35, 0.45)),
    }
)
CLEAR = Clearance(SETTINGS.arm, *RANGES.T, SCENE)


def query(random: np.random.Generator) -> tuple[Any, Any]:
    """A start and a goal over the whole ranges, both with some clearance."""
    free: list[Any] = []
    while len(free) < 2:
        rows = random.uniform(*RANGES.T, (60, 7))
        free += [q for q in rows if CLEAR.distances(q)[0] > 0.03]
    return free[0], free[1]


def queries(count: int, seed: int = 0) -> Iterator[tuple[Any, Any, np.random.Generator]]:
    """So many of them, each with the random numbers of its judge."""
    for number in range(count):
        random = np.random.default_rng([seed, number])
        yield *query(random), random


def touches(q: Any, random: np.random.Generator) -> bool:
    """Whether a point of the skin is inside an obstacle or under the floor."""
    at, links = judge.skin(q.tolist(), 40, random)
    inside = (at[links > 1, 2] < 0).any()
    for one in SCENE.shapes.values():
        inside |= judge.inside(at[links > 0], one.kind, one.size, one.centre, one.yaw).any()
    return bool(inside)
