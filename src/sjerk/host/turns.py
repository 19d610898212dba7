"""Axes that turn for ever (``Axis.wrap``): of which whole turn a motion is.

The first point of a motion chooses the turn, the one that is nearest to where the axis is; all
others are relative to it, so that 0 -> 720 turns twice. What the kernel does with a path that it
opens (``_path.c``), bit for bit. Never here: motions, the memory.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from sjerk.host.feedback import AxisFeedback
from sjerk.profile import FloatArray


@dataclass(frozen=True, eq=False)
class Turns:
    """Whole turns from where a motion is written to where axes play it, N axes.

    ``count`` (N,): of them, 0 for axes that do not wrap; ``wrap`` (N,): axis units of one turn, 0
    for none. The product of both is exact, and a position is rounded once: to half of its last bit.

    >>> turns = Turns.nearest([0.0, 90.0], [710.0, 710.0], [360.0, 0.0])
    >>> turns.onto([[0.0, 90.0], [720.0, 0.0]]).tolist()
    [[720.0, 90.0], [1440.0, 0.0]]
    >>> turns.back([710.0, 90.0]).tolist()
    [-10.0, 90.0]
    """

    count: FloatArray
    wrap: FloatArray

    @classmethod
    def nearest(cls, position: ArrayLike, at: ArrayLike, wrap: ArrayLike) -> Turns:
        """Those that bring a position (N,) nearest to where the axes are; of two, the one ahead."""
        units = np.asarray(wrap, dtype=np.float64)
        count = np.zeros(len(units))
        with np.errstate(over="ignore"):  # what is no place on an axis is refused: not finite
            np.divide(np.subtract(at, position), units, out=count, where=units > 0.0)
        return cls(np.floor(count + 0.5), units)

    def of(self, axes: Sequence[int]) -> Turns:
        """Of these axes, by their places."""
        return Turns(self.count[axes], self.wrap[axes])

    def onto(self, position: ArrayLike) -> FloatArray:
        """Positions (..., N) of the motion as those of the axes."""
        way = np.asarray(position, dtype=np.float64)
        if not self.count.any():
            return way
        with np.errstate(over="ignore", invalid="ignore"):
            high, low = _product(self.count, self.wrap)
            total = way + high
            part = total - way
            rest = (way - (total - part)) + (high - part)  # of the sum, exact (Knuth)
            return np.asarray(total + (rest + low))

    def back(self, position: ArrayLike) -> FloatArray:
        """Positions (..., N) of the axes as those of the motion."""
        return replace(self, count=-self.count).onto(position)


def nearest_turns(position: ArrayLike, axes: Sequence[AxisFeedback]) -> Turns:
    """``Turns.nearest`` to where these axes of a frame are commanded to be."""
    return Turns.nearest(position, [axis.position for axis in axes], [axis.wrap for axis in axes])


def _product(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The product without error, as a sum of two (Dekker 1971)."""
    product = a * b
    (x, x_rest), (y, y_rest) = _halves(a), _halves(b)
    return product, ((x * y - product) + x * y_rest + x_rest * y) + x_rest * y_rest


def _halves(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Upper 26 bits and the rest (Veltkamp)."""
    big = 134217729.0 * x  # 2^27 + 1
    high = big - (big - x)
    return high, x - high
