"""How fast to pass goals: paces to try for a stream whose own asks too much.

A pace is how many goal periods are passed in the time of one. Never here: planning, state.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from sjerk.profile import FloatArray

#: Share of a goal period by which a segment may be shorter to make up lag.
CATCH_UP = 0.1
#: Paces to try. Faster
#: ones are for a motion that cannot brake as hard as the goals now ask.
PACES = (
    1 / (1 - CATCH_UP),
    1.05,
    1,
    0.97,
    0.94,
    0.9,
    0.85,
    0.8,
    0.7,
    0.6,
    0.5,
    0.35,
    0.2,
    1.2,
    1.3,
)
#: In how many segments the pace changes.
STEPS = (1, 1.5, 2, 4)
#: Shares of the limits to brake with towards the last goal.
BRAKES = (1.0, 0.6, 0.3, 0.1)
#: Cycles between goals that are met where the pace changes: whole cycles are too coarse below.
SPACING = 25
#: Room for rounding.
KEPT = 1.0 + 1e-10


def rates(now: float, goals: int, most: FloatArray | None) -> Iterator[FloatArray]:
    """Paces towards each of so many goals, from the present one to each of ``PACES``.

    ``most`` (goals,): where the motion is to stop at the last goal, the paces to brake from.

    >>> next(rates(1.0, 2, None)).round(3).tolist()
    [1.111, 1.111]
    """
    brakes = [np.full(goals, np.inf)]
    if most is not None:
        brakes += [share * most for share in BRAKES]
    for pace, steps, cap in itertools.product(PACES, STEPS, brakes):
        share = np.minimum(1.0, (np.arange(goals) + 1) / steps)
        yield np.minimum(np.maximum(now + (pace - now) * share, 0.1), cap)


def slowing(way: FloatArray, periods: FloatArray, push: FloatArray) -> FloatArray:
    """Largest mean pace towards each goal from which the joints can slow down to the last.

    ``way`` (n, N) between goals, ``periods`` (n,) in cycles, ``push`` (N,) per cycle^2.

    >>> slowing(np.ones((3, 1)), np.full(3, 100.0), np.array([1e-4])).round(2).tolist()
    [2.22, 1.71, 0.71]
    """
    speed = np.maximum(np.abs(way) / periods[:, None], 1e-300)
    least = np.minimum(1.0, (push / speed).min(axis=1))
    left = np.append(np.cumsum(periods[::-1])[::-1], 0.0)
    time = np.sqrt(2.0 * left[:-1] / least) - np.sqrt(2.0 * left[1:] / least)
    return np.asarray(periods / time)


def thinned(periods: FloatArray) -> Iterator[list[int]]:
    """Which goals to meet, as indices: all, or fewer where they are close; then without the first.

    >>> list(thinned(np.full(3, 100.0)))
    [[0, 1, 2], [1, 2], [2]]
    """
    kept, room = [len(periods) - 1], 0.0
    for i in range(len(periods) - 2, -1, -1):
        room += float(periods[i + 1])
        if room >= SPACING:
            kept.append(i)
            room = 0.0
    if len(kept) > 1 and periods[: kept[-1] + 1].sum() < 0.5 * SPACING:
        kept.pop()
    kept.reverse()
    for first in range(min(3, len(kept))):
        yield kept[first:]


def excess(shares: FloatArray) -> float:
    """Cost in cycles of limits that would be left later; less in the half that is known least."""
    weight = np.minimum(1.0, np.linspace(2.0, 0.0, len(shares), endpoint=False))
    return float((3e3 * np.maximum(shares - KEPT, 0.0) * weight).max())
