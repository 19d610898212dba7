"""What a path in play is made of, as far as it may still be left.

``History.keep`` remembers the blocks that pass through it on their way to a ``Path``;
``History.find`` tells where in its numbers the path is so many cycles on, and in which state. Never
here: planning, shared memory.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sjerk.trajectory.segments import Followed, IntArray, Knot, split


@dataclass(frozen=True, eq=False)
class Cut:
    """A place of a path where another may take over: as for ``Path.splice``.

    ``after`` cycles (0: none) of the way to way-point ``at``; ``knot``: the state there.
    """

    at: int
    after: int
    knot: Knot
    before: History

    @property
    def first(self) -> int:
        """Number of the first way-point of what takes over."""
        return self.at + (self.after > 0)


class History:
    """The blocks of a path, numbered as its way-points are; those that were passed may go."""

    def __init__(self, pieces: Sequence[tuple[int, Followed]] = (), *, first: int = 1) -> None:
        """``first``: number of the first way-point of what is kept next."""
        self._pieces = list(pieces)  # number of the first segment's end, and the block
        self._next = first

    def keep(self, blocks: Iterable[Followed]) -> Iterator[Followed]:
        """Blocks as they are taken, remembered."""
        for block in blocks:
            self._pieces.append((self._next, block))
            self._next += len(block)
            yield block

    def forget(self, point: int) -> None:
        """Blocks that end before this way-point are needed no more."""
        while self._pieces and self._pieces[0][0] + len(self._pieces[0][1]) <= point:
            del self._pieces[0]

    def passed(self, point: int) -> int:
        """Cycles of the present motion up to the way-point before this one."""
        for first, block in list(self._pieces):
            if first <= point < first + len(block):
                return block.first_cycle + int(block.cycles[: point - first].sum())
        return 0

    def find(self, point: int, cycle: float, ahead: float) -> Cut | None:
        """The place so many cycles ``ahead`` of ``cycle`` cycles on the way to a way-point.

        None: nothing of it is known, or it is the end.
        """
        left = round(cycle + ahead)
        pieces = list(self._pieces)
        for n, (first, block) in enumerate(pieces):
            if first + len(block) <= point:
                continue
            begin = int(block.cycles[: max(point - first, 0)].sum())
            total = int(block.cycles.sum())
            if begin + left >= total:
                left -= total - begin
                continue
            return _cut(pieces[:n], first, block, begin + left)
        return None


def _cut(before: list[tuple[int, Followed]], first: int, block: Followed, cycles: int) -> Cut:
    """So many cycles into a block."""
    if cycles == 0:
        return Cut(first, 0, Knot.of(block, 0), History(before, first=first))
    head, _ = split(block, cycles)
    ends: IntArray = np.cumsum(block.cycles)
    whole = int(ends[len(head) - 1]) == cycles
    at = first + len(head) - (not whole)
    after = 0 if whole else int(head.cycles[-1])
    return Cut(at, after, Knot.of(head), History([*before, (first, head)], first=first + len(head)))
