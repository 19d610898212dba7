"""Ways onto a trajectory: from rest or in motion, onto its way-points whose time is not over.

``Entry.enter`` makes one motion of the state that is reached and the way-points that are left;
``docs/explanation/trajectories.md``. Never here: shared memory, drives.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sjerk.profile import FloatArray, Limits
from sjerk.trajectory.following import follow
from sjerk.trajectory.joining import join
from sjerk.trajectory.segments import Followed, Knot, dwell
from sjerk.trajectory.trajectory import Trajectory

#: Closer to its first way-point a motion needs no ramp; axis units.
_THERE = 1e-9


@dataclass(eq=False)
class Entered:
    """A motion onto a trajectory and along it.

    ``blocks``: segments, numbered from 0 on; ``ahead`` and ``passed`` count the trajectory's own
    way-points.
    """

    blocks: Iterator[Followed]


@dataclass(frozen=True)
class Entry:
    """How the way-points of a trajectory are to be passed; as in ``Settings``."""

    limits: Sequence[Limits]
    cycle_time: float
    use_velocities: bool = False
    tolerance: float = 0.0

    def enter(self, way: Trajectory, knot: Knot, elapsed: float) -> Entered:
        """Go onto the trajectory when so many seconds of its time are over, and along it.

        From rest a way-point that is due is gone to first; a later one is reached in its time, if
        the limits allow. In motion way-points that are due are over, but for the last one. Limits
        are kept and segments stretched as by ``follow``. Raises PlanError where a state in motion
        leaves no way onto the trajectory inside the limits, and what ``follow`` raises.

        >>> way = Trajectory(["a"], [0.0, 0.5, 1.0], [[0.0], [0.02], [0.03]])
        >>> entry = Entry([Limits(2.0, 4.0, 50.0)], 1e-3)
        >>> made = entry.enter(way, Knot.rest([0.0]), 0.25)
        >>> blocks = list(made.blocks)
        >>> sum(int(block.cycles.sum()) for block in blocks), blocks[0].passed.point.tolist()
        (750, [1, 2])
        """
        due = elapsed + 1.5 * self.cycle_time if knot.moving else max(elapsed, 0.0)
        first = min(int(np.searchsorted(way.time, due)), len(way) - 1)
        left = way.take(np.arange(first, len(way)))
        ahead = float(left.time[0]) - elapsed
        blocks = (self._in_motion if knot.moving else self._from_rest)(left, knot, ahead)
        return Entered(_numbered(blocks, way.joint_names, first))

    def _from_rest(self, left: Trajectory, knot: Knot, ahead: float) -> Iterator[Followed]:
        T = self.cycle_time
        if (np.abs(left.position[0] - knot.position) <= _THERE).all():
            wait = dwell(knot.position, int(ahead / T), T) if ahead >= T else None
            return self._led(wait, left, knot)
        if ahead >= 2.0 * T:
            return self._in_motion(left, knot, ahead)
        ramp = join(knot, left.position[0], self.limits, T)
        return self._led(ramp, left, Knot.of(ramp))

    def _in_motion(self, left: Trajectory, knot: Knot, ahead: float) -> Iterator[Followed]:
        """Straight from the state; the first way-point in its time, or as soon as it can be."""
        moments = left.time - left.time[0] + max(ahead, self.cycle_time)
        position = np.vstack([knot.position, left.position])
        return self._along(
            left.joint_names, np.concatenate([[0.0], moments]), position, left.velocity, knot, -1
        )

    def _led(self, leading: Followed | None, left: Trajectory, state: Knot) -> Iterator[Followed]:
        """A motion to the first way-point, then along the others."""
        if leading is None and len(left) == 1:
            leading = dwell(state.position, 1, self.cycle_time)
        before = iter(() if leading is None else (leading,))
        if len(left) == 1:
            return before
        position = np.vstack([state.position, left.position[1:]])
        velocity = None if left.velocity is None else left.velocity[1:]
        moments = left.time - left.time[0]
        return itertools.chain(
            before, self._along(left.joint_names, moments, position, velocity, state, 0)
        )

    def _along(
        self,
        names: tuple[str, ...],
        moments: FloatArray,
        position: FloatArray,
        velocity: FloatArray | None,
        state: Knot,
        shift: int,
    ) -> Iterator[Followed]:
        """From the state at its first point to rest; ``shift`` to the numbers of the trajectory."""
        if velocity is not None:  # the state counts, and rest
            velocity = np.vstack([0.0 * position[:1], velocity])
            velocity[-1] = 0.0
        for block in follow(
            Trajectory(names, moments, position, velocity),
            self.limits,
            self.cycle_time,
            tolerance=self.tolerance or None,
            use_velocities=self.use_velocities,
            begin=state if state.moving else None,
        ):
            own = replace(block.passed, point=block.passed.point + shift)
            yield replace(block, ahead=block.ahead + shift, passed=own)


def _numbered(blocks: Iterator[Followed], names: tuple[str, ...], first: int) -> Iterator[Followed]:
    """Blocks that follow each other as one motion, way-points as the whole trajectory has them."""
    segment = cycle = 0
    for block in blocks:
        passed = block.passed
        moment = passed.moment + (cycle - block.first_cycle) * block.cycle_time
        own = passed.point >= 0
        yield replace(
            block,
            joint_names=names,
            first=segment,
            first_cycle=cycle,
            ahead=block.ahead + first,
            passed=replace(
                passed,
                point=passed.point[own] + first,
                moment=moment[own],
                deviation=passed.deviation[own],
            ),
        )
        segment += len(block)
        cycle += int(block.cycles.sum())
