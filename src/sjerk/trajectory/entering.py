"""Ways onto a trajectory: from rest or in motion, onto its way-points whose time is not over.

``Entry.enter`` is ``follow`` from the state that is reached; ``docs/explanation/trajectories.md``.
Never here: shared memory, drives.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sjerk.profile import Limits
from sjerk.trajectory.following import follow
from sjerk.trajectory.joining import join
from sjerk.trajectory.segments import Followed, Knot, dwell, packed
from sjerk.trajectory.trajectory import Trajectory
from sjerk.trajectory.window import ranges

#: Closer to its first way-point a motion needs no ramp; axis units.
_THERE = 1e-9
#: Cycles that way-points are apart at least.
_APART = 2.0


@dataclass(frozen=True)
class Entry:
    """How the way-points of a trajectory are to be passed; as in ``Settings``."""

    limits: Sequence[Limits]
    cycle_time: float
    use_velocities: bool = False
    tolerance: float = 0.0

    def enter(self, way: Trajectory, knot: Knot, elapsed: float) -> Iterator[Followed]:
        """Go onto the trajectory when so many seconds of its time are over, and along it.

        From rest a way-point that is due is gone to first; a later one is reached in its time, if
        the limits allow. In motion way-points that are due are over, but for the last one. Blocks
        are numbered from 0 on; ``ahead`` of each segment is a way-point of the trajectory. Limits
        are kept, and times stretched, as by ``follow``. Raises what ``follow`` does; PlanError
        where a state in motion leaves no way onto the trajectory inside the limits.

        >>> way = Trajectory(["a"], [0.0, 0.5, 1.0], [[0.0], [0.02], [0.03]])
        >>> entry = Entry([Limits(2.0, 4.0, 50.0)], 1e-3)
        >>> blocks = list(entry.enter(way, Knot.rest([0.0]), 0.25))
        >>> sum(int(block.cycles.sum()) for block in blocks), [b.ahead.tolist() for b in blocks]
        (750, [[1, 2]])
        """
        T = self.cycle_time
        due = elapsed + 1.5 * T if knot.moving else max(elapsed, 0.0)
        first = min(int(np.searchsorted(way.time, due)), len(way) - 1)
        left = way.take(np.arange(first, len(way)))
        ahead = float(left.time[0]) - elapsed
        there = not knot.moving and (np.abs(left.position[0] - knot.position) <= _THERE).all()
        start, before = knot, []
        if there and (ahead >= T or len(left) == 1):
            before = [dwell(knot.position, max(int(ahead / T), 1), T)]
        elif not there and (len(left) == 1 or not (knot.moving or ahead >= _APART * T)):
            least = max(0, round(ahead / T))
            ramp = join(knot, left.position[0], self.limits, T, least=least)
            if self._inside(ramp):
                ramp.stretch[-1] = int(ramp.cycles.sum()) - least
                start, before, there = Knot.of(ramp), [ramp], True
        blocks = iter(before)
        if len(left) > 1 or not there:
            blocks = itertools.chain(before, self._along(left, start, ahead, there))
        return _numbered(blocks, way.joint_names, first, len(way) - 1)

    def _along(
        self, left: Trajectory, start: Knot, ahead: float, there: bool
    ) -> Iterator[Followed]:
        """From a state, which is ``there``, at the first of these way-points, or before it."""
        moments, some = left.time - left.time[0], 1
        if not there:
            moments = np.append(0.0, moments + max(ahead, _APART * self.cycle_time))
            some = 0
        position = np.vstack([start.position, left.position[some:]])
        velocity = None
        if left.velocity is not None:  # the state's counts
            velocity = np.vstack([0.0 * start.velocity, left.velocity[some:]])
        made = follow(
            Trajectory(left.joint_names, moments, position, velocity),
            self.limits,
            self.cycle_time,
            tolerance=self.tolerance or None,
            use_velocities=self.use_velocities,
            begin=start if start.moving else None,
            quick=True,
        )
        before = 1 - some  # the state is no way-point of theirs
        return (replace(block, ahead=block.ahead - before) for block in made)

    def _inside(self, motion: Followed) -> bool:
        """Whether it keeps the position limits."""
        box = ranges(self.limits)
        rows = replace(motion, first=1).sample().position
        return box is None or bool(((rows >= box[:, 0]) & (rows <= box[:, 1])).all())


def _numbered(
    blocks: Iterator[Followed], names: tuple[str, ...], point: int, last: int
) -> Iterator[Followed]:
    """Blocks that follow each other as one motion, from a way-point of the trajectory on."""
    first = cycle = 0
    for block in blocks:
        ahead = np.minimum(block.ahead + point, last)
        one = packed(replace(block, joint_names=names, first_cycle=cycle, ahead=ahead))
        yield replace(one, first=first)
        first += len(one)
        cycle += int(one.cycles.sum())
