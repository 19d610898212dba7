"""A followed trajectory as records of the look-ahead ring.

The first record opens the path, or says where in another one it takes over; then comes one per
segment, the last of them marked. Made as they are asked for, so a path of any length needs constant
memory. Never here: the ring, the kernel, what has become of the path.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sjerk._binding import dtype_of, lib
from sjerk.errors import InputError
from sjerk.trajectory.segments import Followed
from sjerk.trajectory.trajectory import Trajectory

#: Records made at a time: memory, and how long the kernel's ring is left alone meanwhile.
_SLICE = 256

#: What is played: consecutive segments; None where the next ones are not there yet.
Blocks = Followed | Iterable[Followed | None]


class PathRecords(Iterator[NDArray[Any]]):
    """Batches of ``sj_record`` for one goal; an empty batch where the source has nothing yet.

    ``start``: where a path of its own begins, by axis, else empty. ``peaks``: largest velocity,
    acceleration and jerk (3, axes) of what has been made. ``at_hand``: whether the blocks were made
    before, all of them.
    """

    def __init__(
        self,
        blocks: Blocks,
        axes: Sequence[int],
        *,
        goal_id: int,
        of: int,
        cycle_time: float,
        at: int,
        after: int,
    ) -> None:
        """``of``: the kernel's number of axes. ``at``, ``after``: as for ``Path.splice``; ``at`` 0
        for a path of its own. Raises InputError, as does each step, for what is no such path.
        """
        self._axes, self._goal_id, self._T = axes, goal_id, cycle_time
        self._rows = dtype_of("sj_record", last=of)
        self.start: list[float] = []
        self.peaks = np.zeros((3, len(axes)))
        source = (blocks,) if isinstance(blocks, Followed) else _blocks(blocks)
        self.at_hand = isinstance(source, list | tuple)
        self._batches = self._made(iter(source), at, after)

    def __next__(self) -> NDArray[Any]:
        return next(self._batches)

    def none(self) -> NDArray[Any]:
        """An empty batch."""
        return np.empty(0, dtype=self._rows)

    def joined(self, parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
        """One after the other, in the layout of the ring (``np.concatenate`` would close gaps)."""
        rows = np.zeros(sum(map(len, parts)), dtype=self._rows)
        first = 0
        for part in parts:
            rows[first : first + len(part)] = part
            first += len(part)
        return rows

    def _made(
        self, blocks: Iterator[Followed | None], at: int, after: int
    ) -> Iterator[NDArray[Any]]:
        """Records of the blocks, at most ``_SLICE`` at a time, the first one opening the path.

        One is held back until it is known whether it is the last.
        """
        held = self.none()
        begin = at + (after > 0)
        expected = shift = -1
        for block in blocks:
            if block is None:
                yield self.none()
                continue
            if not isinstance(block, Followed):
                raise InputError("blocks", block, "must hold what follow() gives, or None")
            if expected < 0:
                expected = block.first if at else 0
                shift = begin - 1 - block.first if at else 0
                self._check(block, expected)
                yield self._opening(block, at, after)
            self._check(block, expected)
            expected = block.first + len(block)
            for i in range(0, len(block), _SLICE):
                some = self._segments(block, i, min(i + _SLICE, len(block)), shift)
                if len(held):
                    yield held
                if len(some) > 1:
                    yield some[:-1]
                held = some[-1:]
        if not len(held):
            raise InputError("blocks", "no segments", "must hold at least one segment")
        held["last"] = 1
        yield held

    def _check(self, block: Followed, expected: int) -> None:
        joints = block.position.shape[1]
        if joints != len(self._axes):
            raise InputError("axes", self._axes, f"must be one per joint: {joints}")
        if abs(block.cycle_time - self._T) > 1e-9 * self._T:
            raise InputError("cycle_time", block.cycle_time, f"the kernel's is {self._T!r}")
        if block.first != expected:
            raise InputError("first", block.first, f"blocks must follow each other: {expected}")

    def _empty(self, count: int) -> NDArray[Any]:
        rows = np.zeros(count, dtype=self._rows)
        rows["goal_id"] = self._goal_id
        rows["axis"]["goal"]["kind"][:, self._axes] = lib.SJ_GOAL_ABSOLUTE
        return rows

    def _opening(self, block: Followed, at: int, after: int) -> NDArray[Any]:
        row = self._empty(1)
        row["kind"], row["number"] = lib.SJ_RECORD_PATH, at
        row["cycles"][:, 0] = after
        self.start = [] if at else block.position[0].tolist()
        row["axis"]["position"][0, self._axes] = block.position[0]
        return row

    def _segments(self, block: Followed, low: int, high: int, shift: int) -> NDArray[Any]:
        T, rows = block.cycle_time, self._empty(high - low)
        self.peaks = np.maximum(self.peaks, _peaks(block, low, high))
        rows["kind"] = lib.SJ_RECORD_SEGMENT
        begin = block.first + shift + 1
        rows["number"] = np.arange(begin + low, begin + high)
        rows["cycles"] = block.lengths[low:high]
        axis = rows["axis"]
        axis["position"][:, self._axes] = block.position[low + 1 : high + 1]
        axis["velocity"][:, self._axes] = block.velocity[low:high] * T
        axis["acceleration"][:, self._axes] = block.acceleration[low:high] * T**2
        axis["last_jerk"][:, self._axes] = block.last_jerk[low:high] * T**3
        axis["jerk"][:, self._axes] = (block.jerk[low:high] * T**3).transpose(0, 2, 1)
        return rows


def _blocks(blocks: Any) -> Iterable[Followed | None]:
    """Refuse what is no source of blocks."""
    if isinstance(blocks, Trajectory):
        made = "follow(trajectory, limits, cycle_time) makes blocks of it"
        raise InputError("blocks", blocks, made)
    if isinstance(blocks, str) or not isinstance(blocks, Iterable):
        raise InputError("blocks", blocks, "must be a Followed, or an iterable of them")
    return blocks


def _peaks(block: Followed, low: int, high: int) -> NDArray[np.float64]:
    """Largest velocity, acceleration and jerk of some segments, at the ends of their phases."""
    at, push = block.velocity[low:high], block.acceleration[low:high]
    most = [np.abs(at), np.abs(push), np.abs(block.jerk[low:high]).max(axis=1)]
    for p in range(block.lengths.shape[1]):
        t, jerk = block.cycle_time * block.lengths[low:high, p, None], block.jerk[low:high, p]
        at, push = at + t * (push + t * jerk / 2.0), push + t * jerk
        most[0], most[1] = np.maximum(most[0], np.abs(at)), np.maximum(most[1], np.abs(push))
    return np.array([each.max(axis=0) for each in most])
