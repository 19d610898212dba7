"""A corridor about straight lines: points along them, as many as it takes to stay within it.

Points on the lines are way-points with moments of their own, passed within the corridor; where the
motion leaves it between two of them there are to be more. Never here: how a motion is found.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from sjerk.errors import PlanError
from sjerk.profile import FloatArray
from sjerk.trajectory.programme import Answer, Task
from sjerk.trajectory.segments import IntArray
from sjerk.trajectory.spline import Knots, take

#: A motion for a task whose way-points may be missed by so much (in tolerances); about the moments
#: (n + 1,) at which another one passes them and ends, or None.
Solve = Callable[[Task, FloatArray, FloatArray | None], tuple[Knots, Answer]]

#: Parts of a line to begin with; rounds in which there are more; share of the corridor to plan for.
_PARTS, _ROUNDS, _SHARE = 6, 7, 0.99
#: Places between two knots at which the distance is measured.
_PLACES = 6
#: Places of a line at which a motion along it is looked at; how far its moments are believed.
_ALONG, _BELIEVED = 200, 0.9


class Corridor:
    """The lines of a task, and how far from them a motion may be."""

    def __init__(self, task: Task, width: float, keep: float | None, times: FloatArray) -> None:
        """``keep``: tolerances within which way-points are passed besides, or None; ``times``.

        ``times`` (n,): of the lines, roughly, in knots.
        """
        assert task.end is not None
        self._task, self._width = task, width
        self._corners = np.concatenate([0.0 * task.end[None], task.points, task.end[None]])
        self._keep = keep
        self._parts: IntArray = np.clip(np.ceil(1.5 * times), 1, _PARTS).astype(np.int64)

    def plan(self, solve: Solve) -> tuple[Knots, Answer]:
        """Return a motion that stays inside, with the moments of the way-points; else PlanError."""
        task, lines = self._task, len(self._corners) - 1
        parts = self._parts
        share, moments = _SHARE, None
        for attempt in range(_ROUNDS):
            line = np.repeat(np.arange(lines), parts)
            within = (
                np.arange(len(line)) - np.repeat(np.cumsum(parts) - parts, parts) + 1
            ) / parts[line]
            rows = self._corners[line] + within[:, None] * np.diff(self._corners, axis=0)[line]
            own = np.cumsum(parts)[:-1] - 1
            most = share * self._width / np.sqrt(len(task.unit)) / task.unit
            keep = np.tile(most, (len(rows) - 1, 1))
            if self._keep is not None:
                keep[own] = np.minimum(keep[own], self._keep)
            knots, answer = solve(replace(task, points=rows[:-1]), keep, moments)
            far = self._outside(knots, answer, line)
            if not far.any():
                return knots, replace(answer, moments=answer.moments[own])
            if attempt % 2:
                share *= 0.9
            parts, before = np.where(far, 2 * parts, parts), parts
            moments = self._passed(knots, answer, before, parts)
        raise PlanError(f"corridor = {self._width}: no motion was found that stays inside")

    def _passed(
        self, knots: Knots, answer: Answer, before: IntArray, parts: IntArray
    ) -> FloatArray:
        """When a motion passes the points of other parts of the lines, and its end."""
        ends = np.concatenate([[0.0], answer.moments, [knots.duration]])
        first = np.concatenate([[0], np.cumsum(before)])
        found = []
        for i, (old, new) in enumerate(zip(before, parts, strict=True)):
            begin, end = ends[first[i]], ends[first[i + 1]]
            if old == new:
                found.append(ends[first[i] + 1 : first[i + 1] + 1])
                continue
            from_, way = self._corners[i], self._corners[i + 1] - self._corners[i]
            at = np.linspace(begin, end, _ALONG)
            segment, p, _, _ = knots.at(at)
            along = (take(p, segment, answer.control) - from_) @ way / (way @ way)
            share = np.arange(1, new + 1) / new
            moments = np.interp(share, np.maximum.accumulate(along), at)
            moments[-1] = end
            evenly = begin + share * (end - begin)  # which keeps them apart
            found.append(_BELIEVED * moments + (1.0 - _BELIEVED) * evenly)
        return np.concatenate(found)

    def _outside(self, knots: Knots, answer: Answer, line: IntArray) -> np.ndarray:
        """Which lines are left by too much, by the commanded motion at many places."""
        ends = np.concatenate([[0.0], answer.moments, [knots.duration]])
        inside = (np.arange(_PLACES) + 0.5) / _PLACES
        at = (knots.time[:-1, None] + inside * knots.lengths[:, None]).reshape(-1)
        segment, p, _, a = knots.at(at)
        position = take(p + 5.0 / 24.0 * a, segment, answer.control)
        part = np.clip(np.searchsorted(ends, at, side="right") - 1, 0, len(line) - 1)
        near = np.full(len(at), np.inf)
        for shift in (-1, 0, 1):
            i = np.clip(line[part] + shift, 0, len(self._corners) - 2)
            from_, way = self._corners[i], self._corners[i + 1] - self._corners[i]
            gap = position - from_
            along = np.clip((gap * way).sum(axis=1) / (way * way).sum(axis=1), 0.0, 1.0)
            near = np.minimum(near, np.sqrt(((gap - along[:, None] * way) ** 2).sum(axis=1)))
        far = np.zeros(len(self._corners) - 1, dtype=bool)
        far[line[part[near > self._width * (1.0 - 1e-9)]]] = True
        return far
