"""An independent judge of the panel's arm: it shares no code with what it judges.

Kinematics from Craig's matrix (Eq. 3.6) entry by entry, the shape as points on the surface of
capsules, obstacles as inequalities.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

#: a, d, alpha as the maker of the Panda publishes them; then its flange.
PANDA = [
    (0.0, 0.333, 0.0),
    (0.0, 0.0, -math.pi / 2),
    (0.0, 0.316, math.pi / 2),
    (0.0825, 0.0, math.pi / 2),
    (-0.0825, 0.384, -math.pi / 2),
    (0.0, 0.0, math.pi / 2),
    (0.088, 0.0, math.pi / 2),
]
FLANGE = 0.107
RADIUS = (0.075, 0.07, 0.07, 0.065, 0.06, 0.055, 0.05, 0.045)


def product(one: list[list[float]], two: list[list[float]]) -> list[list[float]]:
    """Of two 4 x 4 matrices, with sums that do not round."""
    return [
        [math.fsum(one[i][k] * two[k][j] for k in range(4)) for j in range(4)] for i in range(4)
    ]


def frames(q: Sequence[float]) -> list[Any]:
    """Base and every joint's frame, as 4 x 4 arrays."""
    at = [[float(i == j) for j in range(4)] for i in range(4)]
    found = [np.array(at)]
    for (a, d, alpha), theta in zip(PANDA, q, strict=True):
        ct, st, ca, sa = math.cos(theta), math.sin(theta), math.cos(alpha), math.sin(alpha)
        at = product(
            at,
            [
                [ct, -st, 0.0, a],
                [st * ca, ct * ca, -sa, -sa * d],
                [st * sa, ct * sa, ca, ca * d],
                [0.0, 0.0, 0.0, 1.0],
            ],
        )
        found.append(np.array(at))
    return found


def tip(q: Sequence[float]) -> Any:
    """Position of the flange."""
    last = frames(q)[-1]
    return last[:3, 3] + FLANGE * last[:3, 2]


def bones(q: Sequence[float]) -> list[tuple[int, Any, Any, float]]:
    """Link, ends and radius of what is between two frames, in the base's frame."""
    at = frames(q)
    found = []
    for i in range(8):
        end = at[i + 1][:3, 3] if i < 7 else tip(q)
        if np.linalg.norm(end - at[i][:3, 3]) > 1e-9:
            found.append((i, at[i][:3, 3], end, RADIUS[i]))
    return found


def skin(q: Sequence[float], points: int, random: np.random.Generator) -> tuple[Any, Any]:
    """Random points of the surface of every bone, and its link: (n, 3), (n,)."""
    rows, links = [], []
    for link, start, end, radius in bones(q):
        out = random.normal(size=(points, 3))
        out /= np.linalg.norm(out, axis=1)[:, None]
        along = random.uniform(0.0, 1.0, (points, 1))
        rows.append(start + along * (end - start) + radius * out)
        links.append(np.full(points, link))
    return np.concatenate(rows), np.concatenate(links)


def inside(points: Any, kind: str, size: Sequence[float], centre: Any, yaw: float) -> Any:
    """Which points (n, 3) are inside an obstacle."""
    x, y, z = (points - np.array(centre)).T
    u, v = math.cos(yaw) * x + math.sin(yaw) * y, math.cos(yaw) * y - math.sin(yaw) * x
    if kind == "sphere":
        return x * x + y * y + z * z < size[0] ** 2
    if kind == "cylinder":
        return (x * x + y * y < size[0] ** 2) & (abs(z) < size[1] / 2)
    return (abs(u) < size[0] / 2) & (abs(v) < size[1] / 2) & (abs(z) < size[2] / 2)


def line_distance(a: Any, b: Any, c: Any, d: Any) -> float:
    """Of two line segments, by ternary searches: the distance is convex in both places."""

    def to(point: Any) -> float:
        way = d - c
        length = float(way @ way)
        share = min(1.0, max(0.0, float((point - c) @ way) / length)) if length > 0 else 0.0
        return float(np.linalg.norm(c + share * way - point))

    low, high = 0.0, 1.0
    for _ in range(200):
        one, two = low + (high - low) / 3, high - (high - low) / 3
        if to(a + one * (b - a)) < to(a + two * (b - a)):
            high = two
        else:
            low = one
    return to(a + low * (b - a))
