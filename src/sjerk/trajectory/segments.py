"""Followed motions as data: segments of constant jerk, and the places where they are cut.

Sampled by the extension; cut exactly, so that the parts are the whole. Never here: planning, shared
memory, drives.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
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
    """A segment of a motion, on the way to way-point ``ahead``.

    ``number`` from 1; ``cycles`` it takes, of which ``stretch`` more than its times asked;
    ``lengths`` (4,) of its phases in cycles (some 0) and ``jerk`` (4, N) in them.
    """

    number: int
    ahead: int
    cycles: int
    stretch: int
    lengths: IntArray
    jerk: FloatArray


@dataclass(frozen=True, eq=False)
class Passed:
    """Way-points as they are passed, k of them.

    ``point`` (k,): their numbers; ``moment`` (k,): seconds from the start of the motion, between
    cycles too; ``deviation`` (k, N): of the commanded motion there, axis units.
    """

    point: IntArray
    moment: FloatArray
    deviation: FloatArray

    @classmethod
    def none(cls, joints: int) -> Passed:
        """No way-point."""
        return cls(np.empty(0, dtype=np.int64), np.empty(0), np.empty((0, joints)))

    @property
    def largest(self) -> float:
        """Largest deviation of any joint, axis units."""
        return float(np.abs(self.deviation).max(initial=0.0))


@dataclass(frozen=True, eq=False)
class Followed:
    """Consecutive segments of a followed motion, m of them, for N joints.

    ``first``: how many segments of the motion come before; ``first_cycle``: the cycle they begin
    in,
    from the start of the motion. ``cycles``, ``stretch`` (m,): length of each segment, and how many
    cycles of it the times did not ask for. ``lengths`` (m, 4): phases in cycles; ``jerk`` (m, 4, N)
    per second^3. ``position`` (m + 1, N): the samples at the segments' ends; ``velocity``,
    ``acceleration`` (m + 1, N): of the continuous motion there; ``last_jerk`` (m + 1, N): of the
    cycle before. ``ahead`` (m,): the way-point that is ahead where the segment begins; ``passed``:
    the way-points in these segments.
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
    ahead: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    passed: Passed = field(default_factory=lambda: Passed.none(0))

    def __len__(self) -> int:
        return len(self.cycles)

    def __iter__(self) -> Iterator[Segment]:
        for i in range(len(self)):
            yield Segment(
                self.first + i + 1,
                int(self.ahead[i]) if len(self.ahead) else 0,
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
        np.zeros((2, len(at))),
        np.zeros((2, len(at))),
        np.zeros((2, len(at))),
        ahead=np.zeros(1, dtype=np.int64),
        passed=Passed.none(len(at)),
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
    cut = motion.first_cycle + cycles
    end = motion.first_cycle + total
    return (
        replace(head, passed=_between(motion, motion.first_cycle, cut)),
        replace(tail, first_cycle=cut, passed=_between(motion, cut, end)),
    )


def rows(motion: Followed, first: int, last: int) -> Followed:
    """Segments ``first .. last - 1`` of a motion, copied."""
    begin = motion.first_cycle + int(motion.cycles[:first].sum())
    return replace(
        motion,
        first=motion.first + first,
        first_cycle=begin,
        passed=_between(motion, begin, begin + int(motion.cycles[first:last].sum())),
        **{n: getattr(motion, n)[first:last].copy() for n in _SEGMENTS},
        **{n: getattr(motion, n)[first : last + 1].copy() for n in _STATES},
    )


def in_blocks(blocks: Iterator[Followed], most: int | None) -> Iterator[Followed]:
    """The same motion with so many segments in a block at most; raises InputError."""
    if most is None:
        return blocks
    if isinstance(most, bool) or not isinstance(most, int) or most < 1:
        raise InputError("block", most, "must be an int, at least 1")
    return (
        rows(block, i, min(i + most, len(block)))
        for block in blocks
        for i in range(0, len(block), most)
    )


def _between(motion: Followed, begin: int, end: int) -> Passed:
    """Way-points after cycle ``begin`` up to ``end``; with those at the start of a motion."""
    cycle = motion.passed.moment / motion.cycle_time
    low = -1.0 if begin == 0 else begin
    some = (cycle > low) & (cycle <= end)
    passed = motion.passed
    return Passed(passed.point[some], passed.moment[some], passed.deviation[some])


_SEGMENTS = ("cycles", "stretch", "lengths", "jerk", "ahead")
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
