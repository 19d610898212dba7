"""One convex step towards the fastest spline past way-points: the quadratic programme.

Unknown are the control points, the moments of the way-points if they may move, the ``pace`` of time
(knots at ``pace * time``, so more is slower) and one excess by which way-points are missed:

    |hull| <= V pace,  |acceleration| <= A pace^2,  |jerk| <= J pace^3

with the powers replaced by their tangents at the present pace; these lie below them, so what is
found keeps the limits. The only other thing linearised is how a way-point's place moves with its
moment. Never here: what to do with an answer.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sjerk.errors import PlanError
from sjerk.profile import FloatArray
from sjerk.trajectory.quadratic import Rows, minimise
from sjerk.trajectory.spline import HALF_CYCLE, IntArray, Knots, take

#: Coefficients of a row: four control points and a moment.
_WIDTH = 5
#: Segments that leave a control point free between the state at the start and rest.
_FEWEST = 4
#: What the excess (in tolerances) costs beside a pace of 1.
_EXCESS = 1e3
#: Least squares of the jerk (in limits) and of the misses (in tolerances).
_SMOOTH, _NEAR = 1e-6, 1e-4
#: Room left in the limits for what the solver leaves undone.
_ROOM = 2e-9
#: The same for positions, of a joint's way.
_INSIDE = 6e-10
#: What a velocity at a turn may be, of a joint's way per segment: its square is below _INSIDE.
_TURN = 1e-6


@dataclass(frozen=True, eq=False)
class Task:
    """A motion of J joints past n way-points, per cycle.

    ``limits`` (J, 3); ``unit`` (J,): tolerances; ``points`` (n, J); ``start`` (3, J): position,
    velocity, acceleration at the first knot; ``end`` (J,): rest at the last, or None: rest
    anywhere; ``box`` (J, 2): positions allowed, or None; ``least`` (n + 1,): cycles asked from
    way-point to way-point, from the start to the end, or None: order only; ``speed`` (n, J):
    velocities wished; ``turns`` (n, J): where a joint is on a position limit, and turns, or None.
    """

    limits: FloatArray
    unit: FloatArray
    points: FloatArray
    start: FloatArray
    end: FloatArray | None
    box: FloatArray | None = None
    least: FloatArray | None = None
    speed: FloatArray | None = None
    turns: NDArray[np.bool_] | None = None
    scale: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        """Unit of the unknowns: the way of each joint."""
        rows = [self.points, self.start[:1]] + ([] if self.end is None else [self.end[None]])
        way = np.ptp(np.concatenate(rows), axis=0)
        object.__setattr__(self, "scale", np.maximum(way, self.unit))

    def joint(self, j: int) -> Task:
        """The same for one joint alone."""
        one = slice(j, j + 1)
        return replace(
            self,
            limits=self.limits[one],
            unit=self.unit[one],
            points=self.points[:, one],
            start=self.start[:, one],
            end=None if self.end is None else self.end[one],
            box=None if self.box is None else self.box[one],
            speed=None if self.speed is None else self.speed[:, one],
            turns=None if self.turns is None else self.turns[:, one],
        )


@dataclass(frozen=True, eq=False)
class Answer:
    """Control points (N + 3, J), moments (n,) on the knots' own time, pace, and excess."""

    control: FloatArray
    moments: FloatArray
    pace: float
    excess: float


class Programme:
    """The rows of one step, from an answer ``before`` on its knots."""

    def __init__(
        self, task: Task, knots: Knots, before: Answer, *, move: bool, paced: bool
    ) -> None:
        """``move``: the moments may; ``paced``: the pace may."""
        self._task, self._knots, self._before = task, knots, before
        self._paced = paced
        self._parts: list[tuple[NDArray[Any], ...]] = []
        J, N, pace = len(task.unit), len(knots), before.pace
        if N < _FEWEST:
            raise PlanError(f"knots = {N + 1}, must be at least {_FEWEST + 1}")
        self._origin = task.start[0]
        # control points that are known: the start's, and rest at the end
        self._known, self._slope = np.zeros((N + 3, J)), np.zeros((N + 3, J))
        p, v, a = task.start
        self._known[:3] = (knots.begin(p, v * pace, a * pace**2) - self._origin) / task.scale
        self._slope[:3] = knots.begin(0.0 * p, v, 2.0 * pace * a) / task.scale
        last = N if task.end is not None else N + 1
        if task.end is not None:
            self._known[N:] = (task.end - self._origin) / task.scale
        # where the unknown ones stand: joint after joint, or in order of time among the moments
        self._segment, self._p, self._v, self._a = knots.at(before.moments)
        self._place = np.full((N + 3, J), -1, dtype=np.int64)
        self._moment: IntArray | None = None
        count = (last - 3) * J
        if not move:
            self._place[3:last] = np.arange(last - 3)[:, None] + (last - 3) * np.arange(J)
        else:
            self._links(N)
            keys = np.concatenate([np.repeat(np.arange(3.0, last), J), self._key])
            rank = np.empty(len(keys), dtype=np.int64)
            rank[np.argsort(keys, kind="stable")] = np.arange(len(keys))
            self._place[3:last] = rank[:count].reshape(-1, J)
            self._moment = rank[count:]
            count = len(keys)
        self._free = self._place >= 0
        if task.end is None:
            self._place[N + 1 :] = self._place[N]
        self._count = count
        self._limits()
        self._way_points()
        self._positions()
        nothing = np.zeros((1, 1), dtype=np.int64)
        self._rows(nothing, np.zeros((1, 1)), 0.0, np.inf, excess=(1.0, 0.0))
        if self._moment is not None and task.least is not None:
            self._order()

    def _links(self, N: int) -> None:
        """Moments in order, and links between far ones, so that rows stay short.

        a[i + 1] - a[i] >= g is the same as a link b that is g / 2 from both at least.
        """
        task, own = self._task, self._segment + 3.5
        n = len(own)
        if task.least is None:
            self._key, self._own = own, np.arange(n)
            return
        ends = np.concatenate([[2.5], own, [N + 0.5]])
        if task.end is None:
            ends = ends[:-1]
        parts = np.maximum(1, np.floor(np.diff(ends) / 2.0)).astype(np.int64)
        total = int(parts.sum())
        gap = np.repeat(np.arange(len(parts)), parts)
        within = (np.arange(total) - np.repeat(np.cumsum(parts) - parts, parts) + 1) / parts[gap]
        pace = self._before.pace
        at = np.concatenate(
            [[-0.5 / pace], self._before.moments, [self._knots.duration + 0.5 / pace]]
        )
        self._key = ends[gap] + within * np.diff(ends)[gap]
        self._at = at[gap] + within * np.diff(at)[gap]
        self._gap, self._part = gap, parts
        keep = slice(None) if task.end is None else slice(0, total - 1)
        self._key, self._at = self._key[keep], self._at[keep]
        self._own = np.cumsum(parts)[:n] - 1

    def _order(self) -> None:
        """Never sooner than asked: pace (b - a) >= share of what is asked, about the present."""
        task, pace = self._task, self._before.pace
        assert task.least is not None
        assert self._moment is not None
        m = len(self._key)
        share = (task.least[: len(self._part)] / self._part)[self._gap]
        unit = 1.0 / (pace * float(self._knots.lengths.mean()))
        own = np.diff(np.concatenate([[0.0], self._at]))
        low = share[:m] - (0.0 if self._paced else 1.0) * pace * own
        low[0] -= 0.5
        at = np.stack([np.concatenate([[0], np.arange(m - 1)]), np.arange(m)], 1)
        value = np.tile([-pace, pace], (m, 1))
        value[0, 0] = 0.0
        at[0, 0] = at[0, 1]
        self._rows(self._moment[at], value * unit, low * unit, np.inf, pace=(own * unit, 0.0))
        if task.end is not None:
            last = self._knots.duration - self._at[-1]
            low_end = share[-1] - 0.5 - (0.0 if self._paced else pace * last)
            self._rows(
                self._moment[-1:, None],
                np.array([[-pace * unit]]),
                low_end * unit,
                np.inf,
                pace=(last * unit, 0.0),
            )

    # ---- rows

    def _rows(
        self,
        at: IntArray,
        value: FloatArray,
        low: FloatArray | float,
        high: FloatArray | float,
        *,
        pace: tuple[FloatArray | float, FloatArray | float] = (0.0, 0.0),
        excess: tuple[float, float] = (0.0, 0.0),
        weight: float = 0.0,
        target: FloatArray | float = 0.0,
    ) -> None:
        """``pace``, ``excess``: coefficients of these two, from below and from above."""
        m, w = at.shape
        places, wide = np.empty((m, _WIDTH), dtype=np.int32), np.zeros((m, _WIDTH))
        places[:, :w], places[:, w:], wide[:, :w] = at, at[:, -1:], value
        beside = np.zeros((2, m, 2))
        for k in range(2):
            if self._paced:
                beside[k, :, 0] = pace[k]
            beside[k, :, 1] = excess[k]
        columns = (np.broadcast_to(np.asarray(x, float), (m,)) for x in (low, high, weight, target))
        self._parts.append((places, wide, beside[0], beside[1], *columns))

    def _stencil(
        self,
        stencil: FloatArray,
        first: IntArray,
        unit: FloatArray,
        low: FloatArray | float,
        high: FloatArray | float,
        *,
        pace: tuple[float, float] = (0.0, 0.0),
        excess: tuple[float, float] = (0.0, 0.0),
        weight: float = 0.0,
        target: FloatArray | float = 0.0,
        rate: FloatArray | None = None,
        of: IntArray | None = None,
        wanted: NDArray[np.bool_] | None = None,
    ) -> None:
        """Stencils (m, w) from control points ``first`` (m,), times ``unit`` (J,), of all joints.

        ``rate`` (m, J): how a row moves with the moment of its way-point, one of each or those
        ``of`` (m,). ``wanted`` (m, J): the rows that are used.
        """
        (m, w), J = stencil.shape, len(unit)
        i = first[:, None] + np.arange(w)
        at = np.ascontiguousarray(self._place[i].swapaxes(1, 2)).reshape(m * J, w)
        value = (stencil[:, None, :] * unit[:, None]).reshape(m * J, w)
        free = at >= 0
        rise: FloatArray | float = 0.0
        constant = np.zeros(m * J)
        keep = np.ones(m * J, dtype=bool) if wanted is None else wanted.reshape(-1).copy()
        wrong = np.flatnonzero(~free.all(axis=1))
        if len(wrong):
            some, off = value[wrong], ~free[wrong]
            known = self._known[i].swapaxes(1, 2).reshape(m * J, w)[wrong]
            slope = self._slope[i].swapaxes(1, 2).reshape(m * J, w)[wrong]
            rise = np.zeros(m * J)
            rise[wrong] = (some * slope * off).sum(axis=1)
            constant[wrong] = (some * known * off).sum(axis=1)
            value[wrong] = np.where(off, 0.0, some)
            places = at[wrong]
            least = np.where(off, np.iinfo(np.int64).max, places).min(axis=1, keepdims=True)
            most = places.max(axis=1, keepdims=True)
            leading = np.cumsum(~off, axis=1) == 0
            at[wrong] = np.where(off, np.where(leading, least, most), places)
            all_off = off.all(axis=1)
            if all_off.any() and rate is None:
                keep[wrong[all_off]] = False
            elif all_off.any():
                at[wrong[all_off]] = 0
        if self._task.end is None:  # the last three are one unknown
            for k in range(w - 1):
                same = at[:, k] == at[:, k + 1]
                value[:, k + 1] += np.where(same, value[:, k], 0.0)
                value[:, k] = np.where(same, 0.0, value[:, k])
        if rate is not None:
            assert self._moment is not None
            moment = np.repeat(self._moment[self._own if of is None else self._own[of]], J)
            none = (value == 0.0).all(axis=1)
            at[none] = moment[none, None]
            at = np.concatenate([at, moment[:, None]], axis=1)
            value = np.concatenate([value, rate.reshape(-1, 1)], axis=1)
            turn = np.argsort(at, axis=1, kind="stable")
            at, value = np.take_along_axis(at, turn, 1), np.take_along_axis(value, turn, 1)
        if self._paced:  # known ones change with the pace: constant + rise (pace - before)
            constant = constant - rise * self._before.pace
            below, above = (np.broadcast_to(one + rise, (m * J,))[keep] for one in pace)
        else:
            below = above = np.zeros(1)
        bounds = [
            (np.broadcast_to(np.asarray(x, float), (m, J)).reshape(-1) - constant)[keep]
            for x in (low, high, target)
        ]
        self._rows(
            at[keep],
            value[keep],
            bounds[0],
            bounds[1],
            pace=(below, above),
            excess=excess,
            weight=weight,
            target=bounds[2],
        )

    def _limits(self) -> None:
        task, knots, pace = self._task, self._knots, self._before.pace
        stencils = (knots.hull, knots.acceleration, knots.jerk)
        for order, stencil in enumerate(stencils, start=1):
            unit = task.scale / (task.limits[:, order - 1] * (1.0 - _ROOM) * pace**order)
            first = np.arange(len(stencil))
            weight = (1e-2 * _SMOOTH if self._paced else _SMOOTH) if order == 3 else 0.0
            if self._paced:  # at the pace before: order pace - (order - 1)
                least, slope = order - 1.0, order / pace
                self._stencil(
                    stencil, first, unit, least, -least, pace=(slope, -slope), weight=weight
                )
            else:
                self._stencil(stencil, first, unit, -1.0, 1.0, weight=weight)

    def _way_points(self) -> None:
        task, before = self._task, self._before
        unit = task.scale / task.unit
        self._target = (task.points - self._origin) / task.unit
        self._reference = self._p + HALF_CYCLE / before.pace**2 * self._a
        self._rate = None
        if self._moment is not None:
            self._rate = take(self._v, self._segment, before.control) / task.unit
        self._unit = unit

    def _positions(self) -> None:
        """Bezier points of the commanded q = P + 5/24 A inside, beside each knot and at it.

        A joint that turns on a limit has a velocity of 0 there. A cubic with its turn on the limit
        is inside the limit between two knots if it is so at both.
        """
        task, knots, before = self._task, self._knots, self._before
        if task.box is None:
            return
        r = knots.lengths[:, None] / 3.0
        low, high = (task.box.T - self._origin) / task.scale + [[_INSIDE], [-_INSIDE]]
        one, first = np.ones(len(task.unit)), np.arange(len(knots))
        half = HALF_CYCLE / before.pace**2
        place, speed = knots.position + half * knots.acceleration, knots.velocity
        right, left = half * r * knots.jerk, -half * r * knots.jerk
        right[:, :3] += place[:-1] + r * speed[:-1]
        left[:, 1:] += place[1:] - r * speed[1:]
        straight = np.ones((len(knots), len(one)), dtype=bool)
        if task.turns is not None:
            turn = np.flatnonzero(task.turns.any(axis=1))
            segment, wanted = self._segment[turn], task.turns[turn]
            np.logical_and.at(straight, segment, ~wanted)
            at, gap = self._p[turn] + half * self._a[turn], knots.lengths[segment, None]
            slope = gap * (self._v[turn] + half * knots.jerk[segment])
            there = rate = None
            if self._moment is not None:
                there, rate = (
                    take(x, segment, before.control) / task.scale
                    for x in (self._v[turn], gap * self._a[turn])
                )
            self._stencil(slope, segment, one, -_TURN, _TURN, rate=rate, of=turn, wanted=wanted)
            self._stencil(at, segment, one, low, high, rate=there, of=turn, wanted=wanted)
        self._stencil(right, first, one, low, high, wanted=straight)
        self._stencil(left, first, one, low, high, wanted=straight)
        self._stencil(place, np.arange(len(place)), one, low, high)

    # ---- the answer

    def solve(
        self,
        *,
        keep: float | FloatArray,
        reach: FloatArray | None = None,
        slower: float = np.inf,
        near: float = 1e-8,
        steps: int = 80,
    ) -> Answer | None:
        """Return the next answer; None: there is none.

        ``keep``: how many tolerances cost no excess; ``reach`` (n,): by how much moments may move;
        ``slower``: by what share the pace may rise; it may fall by 0.3.
        """
        task, before = self._task, self._before
        n, pace = len(task.points), before.pace
        if n:
            target, unit = self._target, self._unit
            # a wish, where nothing else is wished for: never against the pace
            weight = 0.0 if self._paced else _NEAR / max(1.0, float(np.max(keep))) ** 2
            self._stencil(
                self._reference, self._segment, unit, target - keep, target + keep,
                rate=self._rate, excess=(1.0, -1.0), weight=weight, target=target,
            )  # fmt: skip
            if task.speed is not None and self._moment is None:
                gap = np.gradient(before.moments)[:, None] / 4.0 if n > 1 else np.ones((1, 1))
                wish = task.speed * pace / task.unit * gap
                self._stencil(
                    self._v * gap, self._segment, unit, -np.inf, np.inf, weight=_NEAR, target=wish
                )
        if self._moment is not None and n:
            assert reach is not None
            mean = float(self._knots.lengths.mean())
            most = reach / mean
            own = self._moment[self._own][:, None]
            self._rows(own, np.full((n, 1), 1.0 / mean), -most, most)
        if self._paced:
            nothing = np.zeros((1, 1), dtype=np.int64)
            self._rows(nothing, np.zeros((1, 1)), 0.7, 1.0 + slower, pace=(1.0 / pace, 1.0 / pace))
        x = np.zeros(self._count + 2)
        x[self._place[self._free]] = ((before.control - self._origin) / task.scale)[self._free]
        gradient = np.zeros(len(x))
        gradient[-1], x[-1] = _EXCESS, max(before.excess, 0.0)
        if self._paced:
            gradient[-2], x[-2] = 1.0 / pace, pace
        rows = Rows(*(np.concatenate(part) for part in zip(*self._parts, strict=True)))
        found = minimise(rows, gradient, x, near=near, steps=steps)
        if found.lost:
            return None
        missed = 0.8 * (_ROOM if task.box is None else _INSIDE)
        if not (found.solved or found.wrong < missed):
            return None
        x = found.x
        new = float(x[-2]) if self._paced else pace
        control = np.where(self._free, x[np.maximum(self._place, 0)], self._known)
        control = control * task.scale + self._origin
        p, v, a = task.start
        control[:3] = self._knots.begin(p, v * new, a * new**2)
        if task.end is not None:
            control[-3:] = task.end
        else:
            control[-2:] = control[-3]
        moments = before.moments
        if self._moment is not None:
            moments = moments + x[self._moment[self._own]]
        return Answer(control, moments, new, float(x[-1]))
