"""Moments to begin with: how fast a path of straight lines may be passed, roughly.

Caps of the speed along the lines from velocity and curvature, a forward and a backward pass with
the acceleration (Bobrow 1985), then a mean over the time that the jerk needs. Never here: what
follows from them; they are a start.
"""

from __future__ import annotations

import numpy as np

from sjerk.profile import FloatArray

#: Share of the acceleration that turning may take, and pushing.
_SHARE = 0.7
#: A way (in cycles at full velocity), and a slope, that is none: its square's inverse is a number.
_LEAST = 1e-100
#: Nodes of a path, at least, and per way-point.
_NODES, _PER_POINT = 400, 4


def moments_of(
    points: FloatArray, table: FloatArray, velocity: FloatArray | None = None
) -> FloatArray:
    """Cycles (n,) at which points (n, J), each another than the one before, may be passed.

    ``table`` (J, 3): limits per cycle; ``velocity`` (J,): at the first point. The last is a rest.

    >>> moments_of(np.array([[0.0], [1.0]]), np.array([[0.01, 1e-4, 1e-5]])).round().tolist()
    [0.0, 259.0]
    """
    V, A, J = table.T
    way = np.diff(points, axis=0)
    length = np.maximum(np.sqrt(((way / V) ** 2).sum(axis=1)), _LEAST)  # cycles at full velocity
    s = np.concatenate([[0.0], np.cumsum(length)])
    direction = way / length[:, None]
    grid = np.union1d(np.linspace(0.0, s[-1], max(_NODES, _PER_POINT * len(points))), s)
    line = np.clip(
        np.searchsorted(s, 0.5 * (grid[1:] + grid[:-1]), side="right") - 1, 0, len(way) - 1
    )
    steep = np.abs(direction[line])  # of each piece of the grid
    most = (V / np.maximum(steep, _LEAST)).min(axis=1) ** 2
    push = _SHARE * (A / np.maximum(steep, _LEAST)).min(axis=1)
    square = np.full(len(grid), np.inf)
    square[:-1] = most
    square[1:] = np.minimum(square[1:], most)
    if len(way) > 1:
        bend = np.zeros(points.shape)
        half = 0.5 * (length[1:] + length[:-1])[:, None]
        bend[1:-1] = np.abs(np.diff(direction, axis=0)) / half
        turn = np.stack([np.interp(grid, s, column) for column in bend.T], axis=1)
        square = np.minimum(square, (_SHARE * A / np.maximum(turn, _LEAST)).min(axis=1))
    first = 0.0
    if velocity is not None:  # along the first line
        first = (
            float((velocity * direction[0] / V**2).sum() / (direction[0] ** 2 / V**2).sum()) ** 2
        )
    square[0], square[-1] = first, 0.0
    rise = 2.0 * np.diff(grid) * push
    square = _passes(square, rise)
    speed = np.sqrt(square)
    time = np.concatenate(
        [[0.0], np.cumsum(2.0 * np.diff(grid) / np.maximum(speed[1:] + speed[:-1], 1e-9))]
    )
    return _smoothed(s, grid, time, float((A / J).max()))


def gaps_between(rows: FloatArray, table: FloatArray) -> FloatArray:
    """Cycles from row to row (n - 1,) at these moments; 0 between equal ones.

    >>> gaps_between(np.array([[0.0], [0.0], [1.0]]), np.array([[0.01, 1e-4, 1e-5]])).round()
    array([  0., 259.])
    """
    way = (np.diff(rows, axis=0) != 0.0).any(axis=1)
    gaps = np.zeros(len(rows) - 1)
    if way.any():
        gaps[way] = np.diff(moments_of(rows[np.concatenate([[True], way])], table))
    return gaps


def stops_between(rows: FloatArray, table: FloatArray) -> FloatArray:
    """Cycles from row to row (n - 1,) from rest to rest, all joints together.

    With the speed v reached a ramp takes v / A + A / J, or 2 sqrt(v / J) below A; the way is v
    times that, and more at v = V.

    >>> stops_between(np.array([[0.0], [1.0]]), np.array([[0.01, 1e-4, 1e-5]])).round()
    array([210.])
    """
    V, A, J = table.T
    way = np.abs(np.diff(rows, axis=0))
    ramped = 0.5 * A * (np.sqrt((A / J) ** 2 + 4.0 * way / A) - A / J)
    speed = np.where(ramped >= A * A / J, ramped, (0.5 * way * np.sqrt(J)) ** (2.0 / 3.0))
    speed = np.minimum(speed, V)
    ramp = np.where(speed >= A * A / J, speed / A + A / J, 2.0 * np.sqrt(speed / J))
    taken: FloatArray = np.where(way > 0.0, way / np.maximum(speed, 1e-300) + ramp, 0.0)
    return np.asarray(taken.max(axis=1))


def _passes(square: FloatArray, rise: FloatArray) -> FloatArray:
    """The largest squares below those given that grow and fall by no more than ``rise``.

    min over k <= i of square[k] + sum of the rises between: one running minimum each way.
    """
    total = np.concatenate([[0.0], np.cumsum(rise)])
    up = np.minimum.accumulate(square - total) + total
    down = np.minimum.accumulate((up + total)[::-1])[::-1] - total
    out: FloatArray = np.maximum(down, 0.0)
    return out


def _smoothed(s: FloatArray, grid: FloatArray, time: FloatArray, width: float) -> FloatArray:
    """When the mean of the way over ``width`` cycles is at each of ``s``."""
    t = np.linspace(-width, time[-1] + width, max(1000, 2 * len(grid)))
    way = np.interp(t, time, grid)
    area = np.concatenate([[0.0], np.cumsum(0.5 * (way[1:] + way[:-1]) * np.diff(t))])
    after = (
        np.interp(t + width / 2.0, t, area) + np.maximum(t + width / 2.0 - t[-1], 0.0) * grid[-1]
    )
    mean = (after - np.interp(t - width / 2.0, t, area)) / width
    mean = np.maximum.accumulate(mean) + np.arange(len(t)) * (1e-12 * grid[-1])
    mean = (mean - mean[0]) / (mean[-1] - mean[0]) * grid[-1]
    found: FloatArray = np.interp(s, mean, t)
    inner = found[1:-1]
    ends = found[0], max(found[-1], float(inner[-1]) if len(inner) else found[0])
    return np.concatenate([[0.0], inner - ends[0], [ends[1] - ends[0]]])
