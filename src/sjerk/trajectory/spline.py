"""Cubic B-splines on knots of whole cycles: what is linear in their control points.

Between two knots the jerk is constant, so a spline is what the interpolator, ``Followed`` and the
kernel take. Time is in cycles. With the polar form f of the cubic (de Boor, A Practical Guide to
Splines; Ramshaw 1989), the knots t[i] and l = t[i] - t[i-1], r = t[i+1] - t[i]:

    control point        c[i] = f(t[i-2], t[i-1], t[i])                i = 0 .. N + 2
    of the velocity      d[i] = 3 (c[i+1] - c[i]) / (t[i+1] - t[i-2])  velocities lie in their hull
    acceleration, knot   a[i] = 2 (d[i+1] - d[i]) / (t[i+1] - t[i-1])
    jerk, segment        j[i] = (a[i+1] - a[i]) / r
    velocity, knot       v[i] = (r d[i] + l d[i+1]) / (l + r)
    position, knot       p[i] = c[i+1] - v[i] (r - l) / 3 + a[i] l r / 6

Each is a stencil: coefficients of consecutive control points. Never here: limits, programmes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sjerk.profile import FloatArray

IntArray = NDArray[np.int64]

#: Sample and plan: q(s) = P(s - 1/2) + 5/24 A(s - 1/2), the half-cycle lemma.
HALF_CYCLE = 5.0 / 24.0
#: By how much knots may lie further apart per cycle, away from where they are dense.
_GROWTH = 0.5
#: Segments from way-point to way-point, to stop at each: so many at least, and at most.
_PARTS = (4.0, 32.0)
#: Segments of a motion past few way-points, where the limits want so many.
_MANY = 200.0
#: Fewest segments of a motion.
_FEWEST = 16


class Knots:
    """N segments of so many cycles each, and the stencils of their spline.

    ``time`` (N + 1,) of the knots from 0. Stencils, row i over ``c[i] ..``: ``hull`` (N + 2, 2),
    ``position``, ``velocity``, ``acceleration`` (N + 1, 3) at the knots, ``jerk`` (N, 4).

    >>> knots = Knots([10, 10, 11, 10])
    >>> line = np.array([-10.0, 0, 10, 21, 31, 41, 51])[:, None] # Greville: c = mean of 3 knots
    >>> knots.time.tolist(), knots.hull.shape
    ([0.0, 10.0, 20.0, 31.0, 41.0], (6, 2))
    """

    def __init__(self, lengths: ArrayLike) -> None:
        """``lengths`` (N,): of the segments, above 0."""
        r = np.asarray(lengths, dtype=np.float64)
        self.lengths = r
        every = np.concatenate([r[:1], r[:1], r, r[-1:], r[-1:]])
        t = np.concatenate([[0.0], np.cumsum(every)]) - 2.0 * r[0]  # t[i + 2] is knot i
        self.time: FloatArray = np.concatenate([[0.0], np.cumsum(r)])
        n = len(r)
        d = 3.0 / (t[3 : n + 5] - t[: n + 2])
        a = 2.0 / (t[3 : n + 4] - t[1 : n + 2])
        left, right = every[1 : n + 2], every[2 : n + 3]
        self.hull: FloatArray = np.column_stack([-d, d])
        d0, d1 = d[:-1], d[1:]
        self.acceleration: FloatArray = np.column_stack([a * d0, -a * (d0 + d1), a * d1])
        both = left + right
        self.velocity: FloatArray = np.column_stack(
            [-right * d0 / both, (right * d0 - left * d1) / both, left * d1 / both]
        )
        self.position: FloatArray = (
            self.acceleration * (left * right / 6.0)[:, None]
            - self.velocity * ((right - left) / 3.0)[:, None]
        )
        self.position[:, 1] += 1.0
        self.jerk: FloatArray = np.zeros((n, 4))
        self.jerk[:, 1:] += self.acceleration[1:]
        self.jerk[:, :3] -= self.acceleration[:-1]
        self.jerk /= r[:, None]

    def __len__(self) -> int:
        return len(self.lengths)

    @property
    def duration(self) -> float:
        """Cycles from the first knot to the last."""
        return float(self.time[-1])

    def at(self, moments: FloatArray) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
        """Segment (m,), and stencils (m, 4) of position, velocity and acceleration at moments."""
        i = np.clip(np.searchsorted(self.time, moments, side="right") - 1, 0, len(self) - 1)
        x = (np.clip(moments, 0.0, self.duration) - self.time[i])[:, None]
        j = self.jerk[i]
        a, v, p = j * x, j * (x * x / 2.0), j * (x**3 / 6.0)
        a[:, :3] += self.acceleration[i]
        v[:, :3] += self.velocity[i] + self.acceleration[i] * x
        p[:, :3] += self.position[i] + x * (self.velocity[i] + self.acceleration[i] * (x / 2.0))
        return i, p, v, a

    def around(self, moments: FloatArray) -> FloatArray:
        """Lengths of the segments (m,) in which these moments lie."""
        i = np.clip(np.searchsorted(self.time, moments, side="right") - 1, 0, len(self) - 1)
        found: FloatArray = self.lengths[i]
        return found

    def begin(
        self, position: FloatArray, velocity: FloatArray, acceleration: FloatArray
    ) -> FloatArray:
        """The three control points (3, J) of a state at the first knot."""
        r, both = self.lengths[0], self.lengths[:2].sum()
        return np.stack(
            [
                position - r * velocity + r * r / 3.0 * acceleration,
                position - r * r / 6.0 * acceleration,
                position + (r + both) / 3.0 * velocity + r * both / 6.0 * acceleration,
            ]
        )

    def motion(self, control: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Position, velocity, acceleration (N + 1, J) at the knots and jerk (N, J).

        By differences of differences: each is as exact as its own size, not as the positions'.
        """
        every = np.concatenate([self.lengths[:1], self.lengths, self.lengths[-1:]])[:, None]
        left, right = every[:-1], every[1:]
        d = np.diff(control, axis=0) * self.hull[:, 1:]
        a = np.diff(d, axis=0) * (2.0 / (left + right))
        v = (right * d[:-1] + left * d[1:]) / (left + right)
        p = control[1:-1] - v * ((right - left) / 3.0) + a * (left * right / 6.0)
        return p, v, a, np.diff(a, axis=0) / self.lengths[:, None]


def apply(stencil: FloatArray, control: FloatArray) -> FloatArray:
    """A stencil of every row (m, w) over control points (m + w - 1, J): (m, J)."""
    m, w = stencil.shape
    out: FloatArray = stencil[:, :1] * control[:m]
    for k in range(1, w):
        out += stencil[:, k : k + 1] * control[k : k + m]
    return out


def take(stencil: FloatArray, first: IntArray, control: FloatArray) -> FloatArray:
    """The same where row i begins at control point ``first[i]``."""
    out: FloatArray = stencil[:, :1] * control[first]
    for k in range(1, stencil.shape[1]):
        out += stencil[:, k : k + 1] * control[first + k]
    return out


def even(cycles: int, most: float) -> IntArray:
    """Lengths of segments that differ by a cycle at most, none longer than ``most``.

    >>> even(45, 10).tolist()
    [9, 9, 9, 9, 9]
    >>> even(47, 10).tolist()
    [9, 10, 9, 10, 9]
    """
    count = max(1, int(np.ceil(cycles / max(most, 1.0))))
    bounds = np.floor(np.arange(count + 1) * (cycles / count) + 0.5).astype(np.int64)
    lengths: IntArray = np.diff(bounds)
    return lengths


def spread(moments: FloatArray, cycles: int, sizes: FloatArray) -> IntArray:
    """Lengths for so many cycles: about ``sizes`` (n + 1,) between the moments (n,).

    Lengths grow gently from one to the other; none is below 2 but for rounding.

    >>> spread(np.array([8.0, 16.0]), 100, np.array([4.0, 4.0, 20.0])).tolist()
    [4, 4, 4, 4, 5, 8, 13, 19, 19, 20]
    """
    at = np.concatenate([[0.0], moments, [float(cycles)]])
    size = np.maximum(sizes, 2.0)
    node = np.minimum(np.append(size, np.inf), np.insert(size, 0, np.inf))
    rise = _GROWTH * at  # none larger than a neighbour allows
    node = np.minimum.accumulate(node - rise) + rise
    node = np.minimum.accumulate((node + rise)[::-1])[::-1] - rise
    t = np.arange(cycles) + 0.5
    i = np.clip(np.searchsorted(at, t, side="right") - 1, 0, len(size) - 1)
    own = np.minimum(node[i] + _GROWTH * (t - at[i]), node[i + 1] + _GROWTH * (at[i + 1] - t))
    share = np.concatenate([[0.0], np.cumsum(1.0 / np.clip(own, 2.0, size[i]))])
    count = max(1, int(np.ceil(share[-1] - 1e-9)))
    bounds = np.interp(np.arange(count + 1) * (share[-1] / count), share, np.arange(cycles + 1))
    lengths: IntArray = np.diff(np.floor(bounds + 0.5).astype(np.int64))
    return lengths[lengths > 0]


def among(
    moments: FloatArray,
    left: IntArray,
    cycles: int,
    spacing: float,
    kept: float,
    least: float = _PARTS[0],
) -> IntArray:
    """Lengths as dense as way-points at these moments (n,) need; begin with those ``left``.

    ``spacing``: what the limits want; ``kept``: cycles over which the old ones stay; ``least``:
    segments from way-point to way-point.
    """
    gaps = np.diff(moments, prepend=0.0, append=float(cycles))
    most = max(_PARTS[1], _MANY / len(gaps))
    sizes = np.clip(spacing, gaps / most, gaps / least)
    sizes = np.minimum(sizes, cycles / _FEWEST)
    begun = left[: int(np.searchsorted(np.cumsum(left), min(kept, cycles / 2.0)))]
    done = int(begun.sum())
    after = int(np.searchsorted(moments, done + 1.0))
    rest = spread(moments[after:] - done, cycles - done, sizes[after:])
    made: IntArray = np.concatenate([begun, rest])
    return made


def scaled(knots: Knots, cycles: int) -> IntArray:
    """Lengths of the same segments in so many cycles altogether: whole ones, none below 1."""
    count = len(knots)
    bounds = np.floor(knots.time * (cycles / knots.duration) + 0.5).astype(np.int64)
    least = np.arange(count + 1)
    bounds = np.maximum.accumulate(bounds - least) + least  # each after the one before
    bounds = np.minimum(bounds, cycles - least[::-1])
    lengths: IntArray = np.diff(bounds)
    return lengths


def split(lengths: IntArray, most: float) -> IntArray:
    """The same knots and more, so that no segment is longer than ``most``.

    >>> split(np.array([10, 3]), 4.0).tolist()
    [3, 4, 3, 3]
    """
    parts = np.maximum(1, np.ceil(lengths / max(most, 1.0) - 1e-9)).astype(np.int64)
    ends = np.concatenate([[0], np.cumsum(lengths)])
    share = np.arange(int(parts.sum())) - np.repeat(np.cumsum(parts) - parts, parts)
    begin = np.repeat(ends[:-1], parts) + np.floor(
        share * np.repeat(lengths / parts, parts) + 0.5
    ).astype(np.int64)
    made: IntArray = np.diff(np.append(begin, ends[-1]))
    return made


def going_on(left: IntArray, cycles: int, most: float) -> IntArray:
    """Lengths for so many cycles that begin with segments ``left``; the others even.

    >>> going_on(np.array([5, 4]), 20, 4).tolist()
    [5, 4, 4, 3, 4]
    >>> going_on(np.array([5, 4, 9]), 12, 4).tolist()
    [5, 4, 3]
    """
    ends = np.cumsum(left)
    kept = left[: int(np.searchsorted(ends, cycles, side="right"))]
    rest = cycles - int(kept.sum())
    return kept if rest == 0 else np.concatenate([kept, even(rest, most)])
