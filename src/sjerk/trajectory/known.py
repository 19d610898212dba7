"""The goals of a stream that are known: when and where, how they go on, where they turn.

Never here: plans, control points, cycles that were handed out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sjerk.errors import InputError
from sjerk.profile import FloatArray

IntArray = NDArray[np.int64]


def row_of(name: str, value: ArrayLike, joints: int) -> FloatArray:
    """A finite number for each joint; raises InputError."""
    try:
        row = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as fault:
        raise InputError(name, value, f"must be {joints} numbers") from fault
    if row.shape != (joints,):
        raise InputError(name, row.shape, f"must have shape ({joints},)")
    if not np.isfinite(row).all():
        raise InputError(name, row.tolist(), "must be finite")
    return row


class Known:
    """Goals of N joints in the order of time: the last ones passed, and those ahead.

    ``cycle`` (g,): when they are due, in cycles, whole or not; ``position``, ``velocity`` (g, N),
    nan where none was given. ``first``: the first one ahead.
    """

    def __init__(self, position: FloatArray, cycle: int, time: float) -> None:
        joints = len(position)
        self._cycle = np.zeros(64)
        self._position, self._velocity = np.zeros((64, joints)), np.full((64, joints), np.nan)
        self._begin, self._end = 0, 0
        self.speeds = False  # whether any velocity was given
        self.first, self.time = 1, time
        self.add(position, cycle, time, None)

    def copy(self) -> Known:
        """The same, with rows of its own."""
        other = Known.__new__(Known)
        vars(other).update(vars(self))
        other._cycle, other._position = self._cycle.copy(), self._position.copy()
        other._velocity = self._velocity.copy()
        return other

    def add(
        self, position: FloatArray, cycle: float, time: float, velocity: FloatArray | None
    ) -> None:
        """A goal behind the others, at ``time`` of the source."""
        if self._end == len(self._cycle):
            size = self._end - self._begin
            for name in ("_cycle", "_position", "_velocity"):
                old = getattr(self, name)
                new = np.empty((max(64, 2 * size), *old.shape[1:]))
                new[:size] = old[self._begin : self._end]
                setattr(self, name, new)
            self._begin, self._end = 0, size
        self._cycle[self._end], self._position[self._end] = cycle, position
        self._velocity[self._end] = np.nan if velocity is None else velocity
        self.speeds |= velocity is not None
        self._end += 1
        self.time = time

    def __len__(self) -> int:
        return self._end - self._begin

    @property
    def cycle(self) -> FloatArray:
        """(g,): when each is due."""
        return self._cycle[self._begin : self._end]

    @property
    def position(self) -> FloatArray:
        """(g, N)."""
        return self._position[self._begin : self._end]

    @property
    def velocity(self) -> FloatArray:
        """(g, N): as given, else nan."""
        return self._velocity[self._begin : self._end]

    @property
    def last(self) -> FloatArray:
        """Position of the last one (N,)."""
        return np.asarray(self._position[self._end - 1])

    @property
    def last_cycle(self) -> float:
        """When the last one is due."""
        return float(self._cycle[self._end - 1])

    def move(self, cycles: float) -> None:
        """All of them are due so many cycles later."""
        self._cycle[self._begin : self._end] += cycles

    def forget(self, cycle: float) -> None:
        """Those ahead are due after ``cycle``; of those passed keep some, for differences."""
        self.first = int(np.searchsorted(self.cycle, cycle, side="right"))

    def trim(self, cycle: float) -> None:
        """Keep what is due from ``cycle`` on, and three that are passed."""
        less = min(int(np.searchsorted(self.cycle, cycle)), self.first - 3)
        if less > 0:
            self._begin += less
            self.first -= less

    def slopes(self, due: FloatArray, at: NDArray[np.intp]) -> FloatArray:
        """How goals ``at`` change per unit of ``due``: over one at least, where there are goals."""
        after = np.searchsorted(due, due[at] + 0.5).clip(max=len(due) - 1)
        before = (np.searchsorted(due, due[at] - 0.5, side="right") - 1).clip(min=0)
        time = np.maximum(due[after] - due[before], 1e-9)[:, None]
        return np.asarray((self.position[after] - self.position[before]) / time)

    def onward(self, cycles: int, limits: FloatArray, noise: FloatArray) -> FloatArray:
        """How far the source goes at least beyond the last goal if it keeps the limits (N,).

        ``limits`` (N, 3) per cycle: velocity, acceleration, jerk. From goals ``cycles`` or more
        apart: the least velocity and acceleration that these allow at the last one, where each is
        off by as much as ``noise`` (N,), and the shortest stop from there.
        """
        last = len(self) - 1
        cycle, more = self.cycle, np.zeros(len(limits))
        two = int(np.searchsorted(cycle, cycle[last] - cycles, side="right")) - 1
        one = int(np.searchsorted(cycle, cycle[two] - cycles, side="right")) - 1 if two > 0 else -1
        if one < 0:
            return more
        b, c = cycle[two] - cycle[one], cycle[last] - cycle[two]
        v0 = (self.position[two] - self.position[one]) / b
        v1 = (self.position[last] - self.position[two]) / c
        V, A, J = limits.T
        sign = np.sign(v1)
        mean = sign * (v1 - v0) / ((b + c) / 2.0) - 4.0 * noise / (b * c)
        a = np.clip(mean - J * (b + c) / 2.0, -A, A)
        v = sign * v1 - 2.0 * noise / c + (mean + a) / 2.0 * c / 2.0 - J * c * c / 6.0
        v = np.minimum(v, V)
        going = (v0 * v1 > 0.0) & (v > 0.0)
        return np.where(going, sign * shortest_stop(np.maximum(v, 0.0), a, A, J), 0.0)

    def directions(
        self,
        moment: FloatArray,
        knots: int,
        given: FloatArray,
        turns: Turns,
        resolution: FloatArray,
        *,
        final: bool,
    ) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
        """The sign of each first difference of control points (N, knots), and where it may turn.

        ``moment`` (g,) of the goals, in knots; ``given`` (N, 3): the last control points; ``turns``
        of what was handed out. ``resolution`` (N,): turns below it are none. ``final``: a plan must
        end on the last goal.
        """
        going = turns.sign
        centre, begin = np.arange(knots) + 1.5, self.first - 1
        found = np.repeat(going.astype(np.int32)[:, None], knots, axis=1)
        turning = np.zeros((len(given), knots), dtype=np.bool_)
        at, way = moment[begin:], self.position[begin:]
        steps = np.diff(way, axis=0)
        up, down = [np.any(sign * steps > 0.0, axis=0).tolist() for sign in (1.0, -1.0)]
        for j, least in enumerate(resolution.tolist()):
            if up[j] and down[j]:
                pieces = monotone_pieces(way[:, j], least)
            else:  # from the last of equal goals on
                begin = int(np.argmax(steps[:, j] != 0.0)) if up[j] or down[j] else 0
                pieces = [(1 if up[j] else -1, begin)] if up[j] or down[j] else []
            early = len(pieces) > 1 and pieces[1][0] == going[j]
            if early and len(pieces) > turns.left()[j]:  # it has turned before goals do
                del pieces[0]
            for i, (sign, one) in enumerate(pieces):
                found[j, centre >= (at[one] if going[j] or i else -np.inf)] = sign
                if i or (going[j] and going[j] != sign):
                    top = one  # as far back as goals are as far on
                    while top > 0 and abs(way[top - 1, j] - way[one, j]) <= least:
                        top -= 1
                    turning[j] |= (centre > at[top] - 1.0) & (centre < at[one] + 1.0)
        # where goals rest: on towards them; a motion that is beyond them must turn
        left, step = way[-1] - given[:, 2], given[:, 2] - given[:, 1]
        on = np.where(left * step >= 0.0, np.sign(left), 0.0).astype(np.int32)
        if not final:
            on = np.where(on == 0, going, on).astype(np.int32)
        flat = (np.abs(way - way[-1]) <= resolution).all(axis=0)
        found[flat] = on[flat, None]
        return found, turning

    def noise(self, cycles: float, limits: FloatArray) -> FloatArray:
        """What the goals of so many cycles are off by at least (N,), that no motion explains.

        By divided differences, of a motion within V, A / 2 and J / 6: ``limits`` (N, 3) per cycle.
        Their weights alternate in sign, so that those of 1, -1, 1 are the sums of their magnitudes.
        """
        since = int(np.searchsorted(self.cycle, self.last_cycle - cycles))
        cycle, found = self.cycle[since:], np.zeros(len(limits))
        rows = np.empty((len(cycle), len(limits) + 1))
        rows[:, :-1], rows[::2, -1], rows[1::2, -1] = self.position[since:], 1.0, -1.0
        for order, limit in enumerate((limits / [1.0, 2.0, 6.0]).T, start=1):
            if len(cycle) <= order:
                break
            rows = (rows[1:] - rows[:-1]) / (cycle[order:] - cycle[:-order])[:, None]
            off = (np.abs(rows[:, :-1]) - limit) / np.abs(rows[:, -1:])
            found = np.maximum(found, off.max(axis=0))
        return found


def shortest_stop(v: FloatArray, a: FloatArray, A: FloatArray, J: FloatArray) -> FloatArray:
    """Way to rest from v >= 0 and a, under A and J; a lower estimate where a stops too early.

    Jerk -J to a deceleration p, constant, jerk J: p^2 = J v + a^2 / 2 or A.

    >>> one = np.ones(1)
    >>> round(float(shortest_stop(4.0 * one, 0.0 * one, 2.0 * one, 2.0 * one)[0]), 9)
    6.0
    """
    p = np.minimum(np.sqrt(J * v + a * a / 2.0), A)
    t1, t3 = np.maximum((a + p) / J, 0.0), p / J
    v1 = v + a * t1 - J * t1 * t1 / 2.0
    t2 = np.maximum(v1 - p * t3 / 2.0, 0.0) / p.clip(min=1e-300)
    v2 = v1 - p * t2
    way = v * t1 + a * t1**2 / 2.0 - J * t1**3 / 6.0 + v1 * t2 - p * t2**2 / 2.0
    way = way + v2 * t3 - p * t3**2 / 2.0 + J * t3**3 / 6.0
    early = a < -p * (1.0 - 1e-9)
    return np.asarray(
        np.where(early, v * v / (2.0 * np.abs(a).clip(min=1e-300)), np.maximum(way, 0.0))
    )


def monotone_pieces(way: FloatArray, resolution: float) -> list[tuple[int, int]]:
    """Sign and begin of the pieces of a row that do not turn by more than so much.

    A piece begins at the last of equal values.

    >>> monotone_pieces(np.array([0.0, 1.0, 0.999, 2.0, 2.0, 0.5]), 0.01)
    [(1, 0), (-1, 4)]
    """
    beyond = np.abs(way - way[0]) > resolution
    top = int(beyond.argmax())
    if not beyond[top]:
        return []
    high = float(way[top])
    sign = 1 if high > way[0] else -1
    pieces = [(sign, top - 1)]
    step = np.sign(np.diff(way))
    moves = np.flatnonzero(step)
    at = moves[1:][step[moves[1:]] != step[moves[:-1]]]  # where it turns, by however little
    for i in [*at[at > top].tolist(), len(way) - 1]:
        ahead = float(way[i]) - high
        if abs(ahead) > resolution and sign * ahead <= 0.0:
            sign = -sign
            pieces.append((sign, top))
            top, high = i, float(way[i])
        elif sign * ahead >= 0.0:
            top, high = i, float(way[i])
    return pieces


class Turns:
    """Changes of direction per joint: of the goals, and of what was handed out."""

    def __init__(self, start: FloatArray, resolution: FloatArray, going: FloatArray) -> None:
        """From ``start`` (N,), in the directions ``going`` (N,): signs, 0 at rest."""
        self._resolution, self._top = resolution, start.copy()
        self.asked = np.zeros(len(start), dtype=np.int64)
        self._going = going.astype(np.int64)
        self.sign, self.count = self._going.copy(), self.asked.copy()
        self._new: list[FloatArray] = []

    def copy(self) -> Turns:
        """The same, with counts of its own."""
        other = Turns.__new__(Turns)
        vars(other).update(vars(self))
        other.asked, other._new = self.asked.copy(), list(self._new)
        return other

    def add(self, goal: FloatArray) -> None:
        """A goal more; counted when that is needed."""
        self._new.append(goal)

    def look(self) -> None:
        """Count the turns of the goals added."""
        if len(self._new) > 1 and (np.diff(self._new, axis=0) * self._going > 0.0).all():
            del self._new[1:-1]  # on and on
        for goal in self._new:
            self._count(goal)
        self._new.clear()

    def _count(self, goal: FloatArray) -> None:
        step = goal - self._top
        on = self._going * step
        if (on > 0.0).all():
            self._top = goal
            return
        turns = (np.abs(step) > self._resolution) & (on <= 0.0)
        self.asked += turns & (self._going != 0)
        self._going = np.where(turns, np.sign(step), self._going).astype(np.int64)
        self._top = np.where(turns | (on > 0.0), goal, self._top)

    def more(self) -> IntArray:
        """Turns of the motion that the goals do not have (N,)."""
        self.look()
        return np.asarray(np.maximum(self.count - self.asked, 0))

    def left(self) -> IntArray:
        """Turns of the goals that the motion has not made (N,); negative: it made more."""
        self.look()
        return np.asarray(self.asked - self.count)

    def kept(self, direction: NDArray[np.int32], steps: FloatArray) -> bool:
        """Whether these steps (N, n) turn no more often than the goals, or than directions do."""
        if direction.all() and (steps * direction >= 0.0).all():
            return True  # along all of them
        self.look()
        _, count = self.see(steps)
        _, asked = self.see(direction.astype(np.float64))
        asked = asked + (direction == 0).all(axis=1)
        return bool((count <= np.maximum(self.asked, asked)).all())

    def see(self, steps: FloatArray) -> tuple[IntArray, IntArray]:
        """Sign and count after these differences of control points (N, n)."""
        signs = np.sign(np.column_stack([self.sign, steps])).astype(np.int64)
        at = np.where(signs != 0, np.arange(signs.shape[1]), 0)
        held = np.take_along_axis(signs, np.maximum.accumulate(at, axis=1), axis=1)
        turned = (held[:, 1:] != held[:, :-1]) & (held[:, :-1] != 0)
        return held[:, -1], self.count + turned.sum(axis=1)
