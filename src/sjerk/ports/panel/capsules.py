"""Capsules: the least of some that hold a cloud of points, and one as a mesh.

Never here: files, arms.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sjerk.ports.panel.arm import Capsule

FloatArray = NDArray[np.float64]

#: What rounding may leave outside, and the thinnest capsule, m.
_ROUNDING, _THINNEST = 1e-9, 1e-4
#: Of a mesh: rings of each half sphere, and sides.
_RINGS, _SIDES = 6, 18


def least_capsule(link: int, points: FloatArray, larger: float = 0.0) -> Capsule:
    """Along one of the principal axes or the edges of the frame: the one with the least volume.

    ``points`` (n, 3), m; a capsule is convex, so it holds all that is between them. ``larger``: by
    this much more.
    """
    middle = points.mean(axis=0)
    away = points - middle
    principal = np.linalg.eigh(away.T @ away)[1].T
    best: tuple[float, Capsule] | None = None
    for along in (*principal, *np.eye(3)):
        found = _around(link, points, along / np.linalg.norm(along), larger)
        length = float(np.linalg.norm(np.subtract(found.end, found.start)))
        volume = np.pi * found.radius**2 * (length + 4.0 / 3.0 * found.radius)
        if best is None or volume < best[0]:
            best = volume, found
    assert best is not None
    return best[1]


def _around(link: int, points: FloatArray, along: FloatArray, larger: float) -> Capsule:
    """The capsule with its line along a direction, through the middle of what is across."""
    side = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    side /= np.linalg.norm(side)
    base = np.stack([side, np.cross(along, side), along])
    local = points @ base.T
    centre = (local[:, :2].max(axis=0) + local[:, :2].min(axis=0)) / 2.0
    across = np.linalg.norm(local[:, :2] - centre, axis=1)
    radius = max(float(across.max()), _THINNEST)
    # a point at `across` from the line is held by an end that is no nearer than its cap reaches
    cap = np.sqrt(np.maximum(radius**2 - across**2, 0.0))
    low, high = float((local[:, 2] + cap).min()), float((local[:, 2] - cap).max())
    if low > high:  # one sphere is enough
        low = high = (low + high) / 2.0
    line = np.clip(local[:, 2], low, high)
    radius = float(np.hypot(across, local[:, 2] - line).max()) + larger
    (x, y, z), (u, v, w) = ((np.array([*centre, at]) @ base).tolist() for at in (low, high))
    size = float(np.abs(points).max(initial=0.0)) + radius
    return Capsule(link, (x, y, z), (u, v, w), max(radius, _THINNEST) + _ROUNDING * size)


def capsule_mesh(capsule: Capsule) -> tuple[NDArray[Any], NDArray[Any]]:
    """Vertices (n, 3) and triangles (m, 3) of a capsule, in its link's frame.

    Rings around its line: those of a half sphere at either end.
    """
    start, end = np.array(capsule.start), np.array(capsule.end)
    length = float(np.linalg.norm(end - start))
    along = (end - start) / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
    side = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    side /= np.linalg.norm(side)
    up = np.cross(along, side)
    latitude = np.linspace(-np.pi / 2.0, np.pi / 2.0, 2 * _RINGS)
    turn = np.linspace(0.0, 2.0 * np.pi, _SIDES, endpoint=False)
    around = np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * up
    rows = [
        (start if angle < 0.0 else end)
        + capsule.radius * (np.sin(angle) * along + np.cos(angle) * around)
        for angle in latitude
    ]
    ring, k = np.meshgrid(np.arange(2 * _RINGS - 1), np.arange(_SIDES), indexing="ij")
    one, two = ring * _SIDES + k, ring * _SIDES + (k + 1) % _SIDES
    faces = [[one, two, one + _SIDES], [two, two + _SIDES, one + _SIDES]]
    triangles = np.concatenate([np.stack(f, axis=-1).reshape(-1, 3) for f in faces])
    return np.concatenate(rows), triangles
