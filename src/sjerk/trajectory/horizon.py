"""Control points of N joints on knots of a whole number of cycles: planned ahead, handed out.

A uniform cubic B-spline with its limits as bounds on differences, ``_horizon.c``. Behind what is
handed out there is always a plan that ends at rest. ``docs/explanation/streams.md`` has the
method. Never here: goals' times, clocks, shared memory.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from sjerk._binding import ffi, lib
from sjerk.profile import FloatArray, Limits, State
from sjerk.trajectory.joining import both
from sjerk.trajectory.segments import PHASES, Followed, Knot, begin_of, sample_of, through

#: Weight of squared differences between a goal's velocity and the plan's, in knots.
_SPEED = 1.0
#: Weight of the rest beyond the last goal, while another may come.
_TAIL = 1e-4
#: Weight of the squared lag of the common progress; its largest change in one solution, in knots.
_LAG, _TRUST = 1e-3, 3.0
#: Control points further from the origin than so many knots at full velocity move it along.
_FAR = 64.0
_BOUNDS = 1e8


class Mode(Enum):
    """What becomes of bounds that the plan before does not keep."""

    #: They hold; where nothing keeps them there is no answer.
    HARD = 0
    #: What the plan before does is allowed.
    AS_BEFORE = 1
    #: The same; but where it goes against a direction, no plan goes along that.
    STRICT = 2


@dataclass(frozen=True, eq=False)
class Aims:
    """What a plan is to pass: g goals of N joints.

    ``moment`` (g,): when, in knots from now; ``position``, ``slope`` (g, N): where, in axis units,
    and its change per knot of progress; ``velocity`` (g, N) per knot, or None. ``range`` (N, 2) of
    positions, ``rest`` (N, 2) of the last one; ``direction`` (N, knots): the sign of a first
    difference, or 0; ``turning`` (N, knots): where that is not sure. ``end`` (N,): where to rest;
    ``ended``: no goal comes behind these.
    """

    moment: FloatArray
    weight: FloatArray
    position: FloatArray
    slope: FloatArray
    velocity: FloatArray | None
    range: FloatArray
    rest: FloatArray
    direction: NDArray[np.int32]
    turning: NDArray[np.bool_]
    end: FloatArray
    ended: bool


@dataclass(frozen=True, eq=False)
class Plan:
    """``control`` (N, knots) from the origin; ``progress`` (knots + 1,) from the present knot.

    ``share`` (N,): of the way from the plan before to the best one; ``moment`` (g,) and
    ``deviation`` (g, N) at the goals.
    """

    control: FloatArray
    progress: FloatArray
    share: FloatArray
    moment: FloatArray
    deviation: FloatArray
    iterations: int


class Horizon:
    """The control points of N joints, ``cycles`` per knot; at rest at ``position`` (N,).

    ``tolerance`` (N,): from goals that are near in time, where a plan asks for it.
    """

    def __init__(
        self,
        limits: Sequence[Limits],
        cycle_time: float,
        cycles: int,
        position: FloatArray,
        *,
        smoothing: float,
        iterations: int,
        tolerance: FloatArray | None = None,
    ) -> None:
        self.cycles, self._T = cycles, cycle_time
        self._smoothing, self._most = smoothing, iterations
        own, h = [both(limit) for limit in limits], cycles * cycle_time
        self.velocity = np.array([limit.velocity * h for limit in own])
        acceleration = np.array([limit.acceleration * h * h for limit in own])
        jerk = np.array([limit.jerk * h**3 for limit in own])
        self._unit = np.minimum(np.minimum(self.velocity, acceleration), jerk)
        self._limits = np.minimum(
            np.column_stack([self.velocity, acceleration, acceleration, jerk])
            / self._unit[:, None],
            _BOUNDS,
        )
        self._tolerance = None if tolerance is None else tolerance / self._unit
        self._size: tuple[int, ...] = (0, 0, 0)
        self.iterations = 0  # most that a solution took
        self.rest(position)

    def rest(self, position: FloatArray) -> None:
        """Begin anew, at rest."""
        self.origin = position.copy()
        self.end = position.copy()  # where a plan rests, bit for bit
        self.given = np.zeros((len(position), 3))  # the last three handed out
        self.plan = np.zeros((len(position), 1))
        self.progress = np.zeros(1)  # in knots, of the present knot and those ahead
        self.knot = Knot.rest(position)
        self.lead: list[Followed] = []  # what comes before the first knot

    def move_on(self, states: Sequence[State], limits: Sequence[Limits]) -> None:
        """Begin anew, in motion: accelerations end first, in `lead`; behind it a plan to rest.

        States may lie outside the limits.
        """
        T = self._T
        q, v, a = (
            np.array([getattr(state, name) for state in states])
            for name in ("position", "velocity", "acceleration")
        )
        knot = Knot(q, v + a * (T / 2.0), a, np.zeros(len(q)))  # by the half-cycle lemma
        jerk = np.array([both(limit).jerk for limit in limits])
        cycles = np.ceil(np.abs(a) / (jerk * T) - 1e-9).astype(np.int64)
        ramp, at = -a / (np.maximum(cycles, 1) * T), begin_of(knot, T)
        lead, before = [], 0
        for until in np.unique(cycles[cycles > 0]).tolist():
            j = np.where(cycles >= until, ramp, 0.0)
            n = until - before
            P, V, A, _ = through(*at, j * T**3, np.array([n]), (j * T**3)[None])
            at = P, V, np.where(cycles > until, A, 0.0)
            one = Knot(sample_of(*at, j * T**3), V / T, at[2] / T**2, j)
            lead.append((knot, n, j, one))
            knot, before = one, until
        P, V = at[0].copy(), at[1] / T
        self.rest(P)
        h = self.cycles * T
        self.given = np.column_stack([-V * h, np.zeros(len(q)), V * h])
        self.plan = self._stop()
        self.knot = knot
        self.lead = [self._followed(*piece) for piece in lead]

    def finish(self, pieces: Sequence[Followed]) -> None:
        """These come next, of one segment each; the last one ends at rest."""
        self.rest(pieces[-1].position[-1])
        self.lead = list(pieces)

    def _stop(self) -> FloatArray:
        """Control points (N, knots) from a motion without acceleration to rest."""
        step = self.given[:, 2] - self.given[:, 1]
        for n in itertools.count(1):
            x = np.arange(1, n + 1) / n
            share = 1.0 - x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
            control = self.given[:, 2:] + np.cumsum(step[:, None] * share, axis=1)
            if self.keeps(control, fast=True):
                return control
        raise AssertionError  # a slow one keeps every limit

    @property
    def resting(self) -> bool:
        """Whether nothing moves and nothing is planned to."""
        return not self.lead and bool(
            (self.given == self.given[:, 2:]).all() and (self.plan == self.given[:, 2:]).all()
        )

    @property
    def at_ease(self) -> bool:
        """Whether something other than a knot comes next: see ``follow_on``."""
        return bool(self.lead) or (self.resting and self.knot.moving)

    @property
    def rests_at(self) -> FloatArray:
        """Where the plan ends (N,)."""
        return self.origin + self.plan[:, -1]

    def ahead(self, knots: int) -> FloatArray:
        """Progress (knots + 1,) of the plan before, going on at its pace."""
        known = self.progress[: knots + 1]
        more = np.arange(1, knots + 2 - len(known), dtype=np.float64)
        return np.concatenate([known, known[-1] + more])

    def solve(
        self,
        aims: Aims,
        knots: int,
        progress: FloatArray,
        *,
        paced: bool,
        ends: bool = False,
        exact: int = 0,
        near: bool = False,
        mode: Mode = Mode.HARD,
        plan: FloatArray | None = None,
        most: int | None = None,
    ) -> Plan:
        """The best plan of so many control points; ``ends``: that ends on ``aims.end``, or share 0.

        ``progress`` (knots + 1,); ``paced``: it is chosen too. ``plan``: one that keeps the limits,
        and is not longer; else the one before. With ``ends`` it is a guess. ``exact``: so many
        goals are met to rounding, in mode HARD. ``near``: within the tolerance. At ``most`` so
        many iterations.
        """
        n, joints, goals = knots, len(self.velocity), len(aims.moment)
        unit = self._unit[:, None]
        plan = resized(self.plan if plan is None else plan, n)
        end = aims.end - self.origin
        tail = np.where(
            np.arange(n) + 2.0 > (aims.moment[-1] if goals else 0.0),
            1.0 if aims.ended else _TAIL,
            0.0,
        )
        columns = [
            np.ascontiguousarray(column, dtype=np.float64)
            for column in (
                self.given / unit,
                plan / unit,
                end / self._unit,
                self._limits,
                np.clip((aims.range - self.origin[:, None]) / unit, -_BOUNDS, _BOUNDS),
                (aims.rest - self.origin[:, None]) / unit,
                aims.moment,
                aims.weight,
                (aims.position - self.origin) / self._unit,
                aims.slope / self._unit,
                tail,
                progress[1:],
                np.arange(1.0, n + 1.0),
            )
        ]
        direction = np.ascontiguousarray(aims.direction)
        c = ffi.new("sj_horizon *")
        (
            c.before, c.plan, c.end, c.limits, c.range, c.rest, c.moment, c.weight, c.goal,
            c.slope, c.tail, c.progress, c.due,
        ) = (ffi.from_buffer("double[]", column) for column in columns)  # fmt: skip
        c.direction = ffi.from_buffer("int32_t[]", direction)
        if aims.velocity is not None:
            speed = np.ascontiguousarray(aims.velocity / self._unit)
            c.speed, c.speed_weight = ffi.from_buffer("double[]", speed), _SPEED
        if self._tolerance is not None and near:
            c.tolerance = ffi.from_buffer("double[]", self._tolerance)
        c.joints, c.knots, c.goals, c.paced, c.ends, c.fresh = (
            joints,
            n,
            goals,
            paced,
            ends,
            mode is Mode.HARD,
        )
        c.strict, c.exact = mode is Mode.STRICT, exact if mode is Mode.HARD else 0
        c.smooth, c.bend = self._smoothing, 5.0 / 24.0 / self.cycles**2
        fastest = float((self.velocity / self._unit).max())
        c.lag, c.trust, c.progress_before = _LAG * fastest * fastest, _TRUST, progress[0]
        self._reserve(joints, n, goals)
        control, moved, share = np.empty((joints, n)), progress[1:].copy(), np.empty(joints)
        result = ffi.new("sj_arrow_result *")
        lib.sj_horizon_plan(
            c,
            ffi.from_buffer("double[]", control),
            ffi.from_buffer("double[]", moved),
            ffi.from_buffer("double[]", share),
            ffi.from_buffer("double[]", self._work),
            ffi.from_buffer("int32_t[]", self._ints),
            self._most if most is None else most,
            result,
        )
        self.iterations = max(self.iterations, result.steps)
        value = np.empty((goals, joints))
        lib.sj_horizon_values(
            c, ffi.from_buffer("double[]", control), ffi.from_buffer("double[]", value)
        )
        control *= unit
        if ends:
            control[:, -1] = end
        stays = aims.range[:, 0] == aims.range[:, 1]
        if stays.any():
            control[stays] = plan[stays]
        # goals are passed where the progress has moved them to
        more = moved[:n] - progress[1 : n + 1]
        ahead = np.interp(aims.moment, np.arange(n + 1.0), np.append(0.0, more))
        off = value * self._unit - (aims.position - self.origin)
        return Plan(
            control,
            np.concatenate([progress[:1], moved]),
            share,
            aims.moment,
            off - aims.slope * ahead[:, None],
            result.steps,
        )

    def move(self, position: FloatArray) -> FloatArray:
        """Control points (N, knots) from rest to rest at ``position`` (N,), all joints together."""
        here, there = self.given[:, 2], position - self.origin
        way = np.abs(there - here) / self._unit
        V, up, down, J = self._limits.T
        least = np.maximum(2.19 * way / V, np.sqrt(7.5 * way / np.minimum(up, down)))
        begin = float(np.maximum(least, np.cbrt(52.5 * way / J)).max())
        for n in itertools.count(max(1, math.floor(0.8 * begin))):
            x = np.arange(1, n + 1) / n
            share = x**4 * (35.0 - 84.0 * x + 70.0 * x**2 - 20.0 * x**3)
            control = here[:, None] + (there - here)[:, None] * share
            control[:, -1] = there
            if self.keeps(control):
                return control
        raise AssertionError  # a slow one keeps every limit

    def keeps(self, control: FloatArray, *, fast: bool = False) -> bool:
        """Whether control points (N, n) behind those handed out, then at rest, keep the limits.

        ``fast``: whatever their velocity.
        """
        rest = np.repeat(control[:, -1:], 3, axis=1)
        row = np.concatenate([self.given, control, rest], axis=1) / self._unit[:, None]
        first, second, third = (np.diff(row, d, axis=1) for d in (1, 2, 3))
        V, up, down, J = self._limits.T[:, :, None] * (1.0 + 1e-12)
        return bool(
            (fast or (np.abs(first) <= V).all())
            and (second <= up).all()
            and (-second <= down).all()
            and (np.abs(third) <= J).all()
        )

    def hand_out(self, plan: Plan | None) -> Followed:
        """One knot more, of this plan, or of the one before."""
        if plan is not None:
            self.plan, self.progress = plan.control, plan.progress
        control = np.concatenate([self.given, self.plan[:, :1]], axis=1)
        self.given = control[:, 1:]
        self.plan = self.plan[:, 1:] if self.plan.shape[1] > 1 else self.plan
        one = self.ahead(1)
        self.progress = np.append(self.progress[1:], one[1])[: max(1, len(self.progress) - 1)] - 1.0
        c0, c1, c2 = self.given.T
        h, e = self.cycles * self._T, 1.0 / self.cycles
        jerk = (control[:, 3] - control[:, 0]) - 3.0 * (control[:, 2] - control[:, 1])
        bend, slope = (c2 - c1) - (c1 - c0), (c2 - c0) / 2.0
        sample = c1 + (bend / 6.0 - e * (slope / 2.0 - e * (bend / 3.0 - e * jerk / 8.0)))
        position = self.origin + sample
        there = (c0 == c1) & (c1 == c2) & (c2 == self.end - self.origin) & (jerk == 0.0)
        position = np.where(there, self.end, position)
        before = self.knot
        self.knot = Knot(position, slope / h, bend / h**2, jerk / h**3)
        self._move_along()
        return self._followed(before, self.cycles, jerk / h**3, self.knot)

    def follow_on(self) -> Followed:
        """What comes next if nothing else is planned; at rest the last sample is settled."""
        if self.lead:
            first, *self.lead = self.lead
            return first
        return self.settle(1) if self.resting else self.hand_out(None)

    def remainder(self, names: tuple[str, ...], first: int, cycle: int) -> list[Followed]:
        """The plan to rest, without handing it out."""
        kept = dict(vars(self))
        found = []
        while not (self.resting and not self.knot.moving):
            made = self.follow_on()
            found.append(numbered(made, names, first, cycle))
            first, cycle = first + 1, cycle + int(made.cycles[0])
        vars(self).update(kept)
        return found

    def settle(self, cycles: int) -> Followed:
        """Stay for so many cycles; the sample is settled after the first one."""
        before = self.knot
        at = self.origin + self.given[:, 2]
        at = np.where(self.given[:, 2] == self.end - self.origin, self.end, at)
        self.knot = Knot.rest(at)
        self.progress = np.zeros(1)
        self.rest(at)
        return self._followed(before, cycles, np.zeros(len(at)), self.knot)

    def _followed(self, before: Knot, cycles: int, jerk: FloatArray, knot: Knot) -> Followed:
        jerks = np.zeros((1, PHASES, len(jerk)))
        jerks[0, 0] = jerk
        return Followed(
            tuple(f"joint{k}" for k in range(len(jerk))),
            self._T,
            0,
            0,
            np.array([cycles]),
            np.zeros(1, dtype=np.int64),
            np.array([[cycles, 0, 0, 0]]),
            jerks,
            np.array([before.position, knot.position]),
            np.array([before.velocity, knot.velocity]),
            np.array([before.acceleration, knot.acceleration]),
            np.array([before.last_jerk, knot.last_jerk]),
        )

    def _move_along(self) -> None:
        """Keep control points near the origin, so that their differences stay as fine far out."""
        far = np.abs(self.given[:, 2]) > _FAR * self.velocity
        if not far.any():
            return
        moved = np.where(far, self.origin + self.given[:, 2], self.origin)
        way = (moved - self.origin)[:, None]
        self.origin, self.given, self.plan = moved, self.given - way, self.plan - way

    def _reserve(self, *size: int) -> None:
        if any(asked > had for asked, had in zip(size, self._size, strict=True)):
            self._size = tuple(max(x, 2 * y) for x, y in zip(size, self._size, strict=True))
            self._work = np.empty(lib.sj_horizon_doubles(*self._size))
            self._ints = np.empty(lib.sj_horizon_ints(*self._size), dtype=np.int32)


def resized(plan: FloatArray, knots: int) -> FloatArray:
    """So many control points (N, knots) of a plan, the last of which are equal."""
    more = max(0, knots - plan.shape[1])
    return np.concatenate([plan[:, :knots], np.repeat(plan[:, -1:], more, axis=1)], axis=1)


def numbered(motion: Followed, names: tuple[str, ...], first: int, cycle: int) -> Followed:
    """A block as it stands in a stream."""
    return replace(motion, joint_names=names, first=first, first_cycle=cycle)
