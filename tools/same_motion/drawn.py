"""What the scripts draw: limits, axes, way-points, in units from a thousandth to ten thousand."""

from __future__ import annotations

import math
from random import Random
from typing import Any

import numpy as np

from sjerk import Axis, DriveConfig, Limits, MotionKernel, Trajectory

#: Axis units in a degree: radians, degrees, thousandths and ten-thousands.
UNITS = (1.0, 1.0, math.radians(1.0), 1e-3, 1e4)
PERIODS = (1e-3, 1e-3, 1e-3, 250e-6, 2e-3, 4e-3)
WAITS = (0, 1, 3, 17, 60, 180, 400)


def limits(draw: Random, unit: float, position: tuple[float, float] | None = None) -> Limits:
    """Of an axis that makes up to a quarter turn of its motor in a second."""
    velocity = draw.uniform(10.0, 90.0)
    acceleration = velocity * draw.uniform(1.0, 20.0)
    jerk = acceleration * draw.uniform(3.0, 60.0)
    other = draw.random() < 0.5
    return Limits(
        velocity * unit,
        acceleration * unit,
        jerk * unit,
        deceleration=acceleration * unit * draw.uniform(0.3, 2.0) if other else None,
        deceleration_jerk=jerk * unit * draw.uniform(0.3, 2.0) if other else None,
        position=None if position is None else (position[0] * unit, position[1] * unit),
    )


def lower(draw: Random, of: Limits) -> Limits:
    """Limits of a move, within those of its axis."""
    rest = draw.choice([1.0, 1.0, 0.4, draw.uniform(0.05, 1.0)])
    return Limits(
        of.velocity * draw.uniform(0.05, 1.0),
        of.acceleration * rest,
        of.jerk * rest,
        deceleration=of.braking[0] * rest,
        deceleration_jerk=of.braking[1] * rest,
    )


def times(of: Limits, factor: float) -> Limits:
    """The same with every number but the position range multiplied."""
    return Limits(
        of.velocity * factor,
        of.acceleration * factor,
        of.jerk * factor,
        deceleration=of.braking[0] * factor,
        deceleration_jerk=of.braking[1] * factor,
        position=of.position,
    )


def axis(draw: Random, unit: float, drive: Any = None) -> Axis:
    """An axis in this unit, its drive ideal or with mechanics if none is given."""
    bounded, turns = draw.random() < 0.5, draw.random() < 0.2
    own = limits(draw, unit, (-60.0, 60.0) if bounded and not turns else None)
    if drive is None:
        drive = draw.choice(["ideal", DriveConfig(load_inertia_ratio=draw.uniform(0.0, 5.0))])
    return Axis(
        own,
        2**24 / 360.0 / unit,
        drive,
        gear=draw.choice([1.0, 1.0, 10.0]),
        wrap=360.0 * unit if turns else None,
        stop_limits=draw.choice([None, times(own, draw.uniform(1.0, 8.0))]),
        following_error=draw.uniform(0.02, 3.0) * unit if draw.random() < 0.1 else None,
    )


def kernel(draw: Random, unit: float, most: int = 4, **options: Any) -> MotionKernel:
    """One to so many axes."""
    axes = [axis(draw, unit) for _ in range(draw.randint(1, most))]
    return MotionKernel(axes, draw.choice(PERIODS), **options)


def some(draw: Random, n: int) -> list[int]:
    """At least one of the axes, in order."""
    return sorted(draw.sample(range(n), draw.randint(1, n)))


def names(n: int) -> list[str]:
    """Of joints."""
    return [f"joint{i}" for i in range(n)]


def way(draw: Random, own: list[Limits], start: list[float], period: float) -> Trajectory:
    """Way-points from a position on: a smooth wave, a walk with uneven times, or a dense plan."""
    n, kind = len(own), draw.choice(["wave", "walk", "dense"])
    points = {
        "wave": draw.randint(3, 40),
        "walk": draw.randint(2, 25),
        "dense": draw.randint(40, 400),
    }[kind]
    shortest = 3.0 * period
    if kind == "walk":
        steps = [shortest + draw.expovariate(5.0) for _ in range(points - 1)]
    else:
        low, high = (0.02, 0.3) if kind == "wave" else (shortest, 0.02)
        steps = [draw.uniform(low, max(low, high))] * (points - 1)
    time = np.concatenate([[0.0], np.cumsum(steps)])
    if kind == "walk":
        rows = [[0.0] * n]
        for step in steps:  # about as fast as the limits allow, or twice that
            rows.append(
                [
                    x + draw.uniform(-1, 1) * o.velocity * step
                    for x, o in zip(rows[-1], own, strict=True)
                ]
            )
        position = np.array(rows)
    else:
        ease = np.sin(0.5 * np.pi * time / time[-1]) ** 2
        size = [
            draw.uniform(-1.0, 1.0)
            * min(o.velocity * time[-1] / 2, o.acceleration * time[-1] ** 2 / 6)
            for o in own
        ]
        turns = 1.0 + draw.choice([0.0, 0.5]) * np.sin(
            draw.uniform(1.0, 3.0) * np.pi * time / time[-1]
        )
        position = (ease * turns)[:, None] * np.array(size)
    for k, (x, limit) in enumerate(zip(start, own, strict=True)):
        if limit.position is not None and draw.random() < 0.95:  # else: maybe outside
            room = 0.95 * max(0.0, min(limit.position[1] - x, x - limit.position[0]))
            position[:, k] *= min(1.0, room / max(np.abs(position[:, k]).max(), 1e-300))
    if draw.random() < 0.5:  # as a file of such a plan has them
        unit = max(o.velocity for o in own)
        position = np.round(position / unit, 6) * unit
    return Trajectory(names(n), time, position + np.array(start))
