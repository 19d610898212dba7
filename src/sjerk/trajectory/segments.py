"""Followed motions as data: segments of constant jerk, and the places where they are cut.

Sampled by the extension; cut exactly, so that the parts are the whole. Never here: planning, shared
memory, drives.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sjerk._binding import ffi, lib
from sjerk.errors import InputError
from sjerk.profile import FloatArray, Samples, State

IntArray = NDArray[np.int64]

#: Phases of a segment.
PHASES = 4


class Segment(NamedTuple):
    """The way from way-point ``point - 1`` to ``point``.

    ``cycles`` it takes, of which ``stretch`` more than its times asked; ``lengths`` (4,) of its
    phases in cycles (some 0) and ``jerk`` (4, N) in them.
    """

    point: int
    cycles: int
    stretch: int
    lengths: IntArray
    jerk: FloatArray


@dataclass(frozen=True, eq=False)
class Followed:
    """Consecutive segments of a followed trajectory, m of them, for N joints.

    ``first``: index of the way-point where they begin; ``first_cycle``: its cycle from the start of
    the motion. ``cycles``, ``stretch`` (m,): length of each segment, and how many cycles of it the
    times did not ask for. ``lengths`` (m, 4): phases in cycles; ``jerk`` (m, 4, N) per second^3.
    ``position`` (m + 1, N): the way-points; ``velocity``, ``acceleration`` (m + 1, N): of the
    continuous motion in their cycles; ``last_jerk`` (m + 1, N): of the cycle before.
    """

    joint_names: tuple[str, ...]
    cycle_time: float
    first: int
    first_cycle: int
    cycles: IntArray
    stretch: IntArray
    lengths: IntArray
    jerk: FloatArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    last_jerk: FloatArray

    def __len__(self) -> int:
        return len(self.cycles)

    def __iter__(self) -> Iterator[Segment]:
        for i in range(len(self)):
            yield Segment(
                self.first + i + 1,
                int(self.cycles[i]),
                int(self.stretch[i]),
                self.lengths[i],
                self.jerk[i],
            )

    def sample(self) -> Samples:
        """Return what the drives get: ``time`` (rows,), the rest (rows, N).

        One row per cycle, the first way-point's included only at the start of the motion. In its
        cycle a way-point is met bit for bit.
        """
        start, rows, joints = int(self.first == 0), int(self.cycles.sum()), self.position.shape[1]
        T = self.cycle_time
        columns: list[FloatArray] = [np.zeros((start + rows, joints)) for _ in range(4)]
        table = ffi.new("sj_follow_samples *")
        table.position, table.velocity, table.acceleration, table.jerk = (
            doubles(column[start:]) for column in columns
        )
        per_cycle = (self.velocity * T, self.acceleration * T**2, self.last_jerk * T**3)
        jerk = self.jerk * T**3
        lib.sj_follow_sample(
            len(self),
            joints,
            *map(doubles, (self.position, *per_cycle)),
            ffi.from_buffer("int64_t[]", self.lengths),
            doubles(jerk),
            table,
        )
        position, velocity, acceleration, jerks = columns
        if start:
            position[0] = self.position[0]
        for column, unit in ((velocity, T), (acceleration, T**2), (jerks, T**3)):
            np.divide(column, unit, out=column)
        time: FloatArray = T * np.arange(
            self.first_cycle + 1 - start, self.first_cycle + 1 + rows, dtype=np.float64
        )
        return Samples(time, position, velocity, acceleration, jerks)


@dataclass(frozen=True, eq=False)
class Knot:
    """Where a followed motion can be cut: the end of a segment, N joints.

    ``position`` (N,): what the drives get in this cycle; ``velocity``, ``acceleration`` (N,): of
    the continuous motion; ``last_jerk`` (N,): of the cycle before. Per second.

    >>> Knot.rest([0.5]).velocity.tolist()
    [0.0]
    """

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    last_jerk: FloatArray

    @classmethod
    def rest(cls, position: ArrayLike) -> Knot:
        """At rest, and settled."""
        at = np.array(position, dtype=np.float64)
        return cls(at, np.zeros_like(at), np.zeros_like(at), np.zeros_like(at))

    @classmethod
    def of(cls, motion: Followed, i: int = -1) -> Knot:
        """The state at way-point ``i`` of a block; default: its end."""
        return cls(
            motion.position[i], motion.velocity[i], motion.acceleration[i], motion.last_jerk[i]
        )

    @property
    def moving(self) -> bool:
        """Whether anything moves or is about to."""
        return bool(self.velocity.any() or self.acceleration.any() or self.last_jerk.any())

    def states(self, T: float) -> list[State]:
        """Samples without jerk before them that belong to the same continuous motion."""
        v = self.velocity - self.acceleration * (T / 2)
        # the half-cycle lemma: once with the jerk of the cycle before, once without
        a = self.acceleration * T**2
        begin = self.position + self.velocity * (T / 2) - a / 3 + self.last_jerk * (T**3 / 8)
        q = begin - v * (T / 2) + a / 12
        return [State(*row) for row in np.column_stack([q, v, self.acceleration]).tolist()]


def dwell(position: ArrayLike, cycles: int, cycle_time: float) -> Followed:
    """Rest at a position (N,) for so many cycles, at least 1.

    >>> dwell([0.5], 3, 1e-3).sample().position.tolist()
    [[0.5], [0.5], [0.5], [0.5]]
    """
    at = np.array(position, dtype=np.float64)
    return Followed(
        tuple(f"joint{k}" for k in range(len(at))),
        cycle_time,
        0,
        0,
        np.array([cycles]),
        np.zeros(1, dtype=np.int64),
        np.array([[cycles, 0, 0, 0]]),
        np.zeros((1, PHASES, len(at))),
        np.repeat(at[None], 2, axis=0),
        *(np.zeros((2, len(at))) for _ in range(3)),
    )


def split(motion: Followed, cycles: int) -> tuple[Followed, Followed]:
    """The first ``cycles`` of a motion, and the rest; neither is empty.

    >>> head, tail = split(dwell([0.5], 7, 1e-3), 3)
    >>> head.cycles.tolist(), tail.cycles.tolist(), tail.first_cycle
    ([3], [4], 3)
    """
    total, T = int(motion.cycles.sum()), motion.cycle_time
    if isinstance(cycles, bool) or not isinstance(cycles, int) or not 0 < cycles < total:
        raise InputError("cycles", cycles, f"must be an int in 1 .. {total - 1}")
    ends = np.cumsum(motion.cycles)
    i = int(np.searchsorted(ends, cycles))
    if ends[i] == cycles:
        return rows(motion, 0, i + 1), rows(motion, i + 1, len(motion))
    before, after = motion.lengths[i].copy(), motion.lengths[i].copy()
    left = cycles - (int(ends[i - 1]) if i else 0)
    for p in range(PHASES):
        before[p] = min(before[p], left)
        left -= int(before[p])
    after -= before
    knot = Knot.of(motion, i)
    P, V, A, j = through(*begin_of(knot, T), knot.last_jerk * T**3, before, motion.jerk[i] * T**3)
    between = (sample_of(P, V, A, j), V / T, A / T**2, j / T**3)
    head, tail = rows(motion, 0, i + 1), rows(motion, i, len(motion))
    for name, row in zip(_STATES, between, strict=True):
        getattr(head, name)[-1] = getattr(tail, name)[0] = row
    head.lengths[-1], tail.lengths[0] = before, after
    head.cycles[-1], tail.cycles[0] = before.sum(), after.sum()
    head.stretch[-1] = 0
    return head, replace(tail, first_cycle=motion.first_cycle + cycles)


def rows(motion: Followed, first: int, last: int) -> Followed:
    """Segments ``first .. last - 1`` of a motion, copied."""
    return replace(
        motion,
        first=motion.first + first,
        first_cycle=motion.first_cycle + int(motion.cycles[:first].sum()),
        **{n: getattr(motion, n)[first:last].copy() for n in _SEGMENTS},
        **{n: getattr(motion, n)[first : last + 1].copy() for n in _STATES},
    )


_SEGMENTS = ("cycles", "stretch", "lengths", "jerk")
_STATES = ("position", "velocity", "acceleration", "last_jerk")


def begin_of(knot: Knot, T: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """P, V, A of the continuous motion, per cycle."""
    V, A = knot.velocity * T, knot.acceleration * T**2
    return knot.position + V / 2 - A / 3 + knot.last_jerk * (T**3 / 8), V, A


def through(
    P: FloatArray, V: FloatArray, A: FloatArray, j: FloatArray, lengths: IntArray, jerk: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """P, V, A after phases of constant jerk, and the last one's jerk."""
    for n, J in zip(lengths.tolist(), jerk, strict=True):
        if n:
            P = P + n * (V + n * (A / 2 + n * J / 6))
            V, A, j = V + n * (A + n * J / 2), A + n * J, J
    return P, V, A, j


def sample_of(P: FloatArray, V: FloatArray, A: FloatArray, j: FloatArray) -> FloatArray:
    return P - V / 2 + A / 3 - j / 8


def doubles(array: FloatArray) -> Any:
    return ffi.from_buffer("double[]", np.ascontiguousarray(array), require_writable=False)
