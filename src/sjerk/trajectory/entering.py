"""Ways onto a trajectory: from rest or in motion, onto its way-points whose time is not over.

``Entry.enter`` chooses among the spline from the state that is reached and planned motions to the
first way-point ahead; from rest also the motion in the trajectory's own time, where the others lose
much; ``docs/explanation/trajectories.md``. Never here: shared memory, drives.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sjerk.errors import InputError, PlanError, SjerkError
from sjerk.profile import FloatArray, Limits
from sjerk.trajectory.faults import TrajectoryError
from sjerk.trajectory.following import follow
from sjerk.trajectory.joining import join
from sjerk.trajectory.segments import Followed, IntArray, Knot, dwell
from sjerk.trajectory.stretching import BLOCK, limits_per_cycle, stretched
from sjerk.trajectory.thinning import follow_within
from sjerk.trajectory.trajectory import Trajectory
from sjerk.trajectory.window import units

#: Closer to its first way-point a motion needs no ramp; axis units.
_THERE = 1e-9
#: Way-points, and seconds of them, by which ways onto a trajectory are compared.
_HEAD, _SECONDS = 64, 1.0
#: Way-points handed out at a time where the motion before does not wait for them.
_BLOCK = 512
#: Way-points at most, and what the others lose, in seconds and as a share of the time, so that it
#: pays to begin later by the planning of a motion in own time.
_PLANNED, _LOST, _SHARE_LOST = 4096, 0.1, 0.2
#: Shares of a way-point's velocity to pass it with.
_SHARES = (1.0, 0.75, 0.5, 0.25, 0.0)


@dataclass(eq=False)
class Entered:
    """A motion onto a trajectory and along it.

    ``blocks``: segments, numbered from 0 on; ``points`` (m,): for each of them, which way-point of
    the trajectory is ahead.
    """

    blocks: Iterator[Followed]
    points: IntArray


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
        >>> sum(int(block.cycles.sum()) for block in made.blocks), made.points.tolist()
        (750, [1, 2])
        """
        due = elapsed + 1.5 * self.cycle_time if knot.moving else max(elapsed, 0.0)
        first = min(int(np.searchsorted(way.time, due)), len(way) - 1)
        left = way.take(np.arange(first, len(way)))
        ahead = float(left.time[0]) - elapsed
        made = (self._in_motion if knot.moving else self._from_rest)(left, knot, ahead)
        return Entered(_numbered(made.blocks, way.joint_names), made.points + first)

    def _from_rest(self, left: Trajectory, knot: Knot, ahead: float) -> Entered:
        """Wait at the first way-point, or go there first where it is due; then on."""
        T = self.cycle_time
        there = bool((np.abs(left.position[0] - knot.position) <= _THERE).all())
        lead: list[Followed] = []
        if there and (ahead >= T or len(left) == 1):
            lead = [dwell(knot.position, max(int(ahead / T), 1), T)]
        elif not there and ahead < 2.0 * T:
            lead, there = [join(knot, left.position[0], self.limits, T)], True
        start = Knot.of(lead[0]) if lead else knot
        points = np.zeros(len(lead[0]) if lead else 0, dtype=np.int64)
        if there and len(left) == 1:
            return Entered(iter(lead), points)
        made = self._onward(left, start, None if there else ahead)
        return Entered(itertools.chain(lead, made.blocks), np.concatenate([points, made.points]))

    def _onward(self, left: Trajectory, start: Knot, ahead: float | None) -> Entered:
        """The quick motion; the one in own time where that is far sooner, or is the only one.

        ``ahead`` (s): until the first way-point; None: the start is there.
        """
        if len(left) > _PLANNED:
            return self._quick(left, start, ahead)
        wrong: SjerkError | None = None
        try:
            quick = _Known.of(self._quick(left, start, ahead))
            if not self._stays(quick.blocks):
                wrong = PlanError("way-points: the motion between them leaves the position limits")
        except SjerkError as error:
            wrong = error
        asked = float(left.time[-1] - left.time[0]) + (ahead or 0.0)
        if wrong is None:
            lost = quick.cycles * self.cycle_time - asked
            if lost <= _LOST + _SHARE_LOST * asked:
                return quick.entered
        try:
            own = self._own_time(left, start, ahead)
        except SjerkError:
            if wrong is not None:
                raise wrong from None
            return quick.entered
        return own.entered if wrong is not None or own.cycles < quick.cycles else quick.entered

    def _quick(self, left: Trajectory, start: Knot, ahead: float | None) -> Entered:
        """The first way-points as soon as they are passed by trial, the others by stretching."""
        if ahead is not None:
            return self._in_motion(left, start, ahead)
        gap = float(left.time[1] - left.time[0])
        if gap < 2.0 * self.cycle_time:
            return self._led(None, left, start)
        there = replace(start, position=left.position[0])
        made = self._in_motion(left.take(np.arange(1, len(left))), there, gap)
        return Entered(made.blocks, made.points + 1)

    def _own_time(self, left: Trajectory, start: Knot, ahead: float | None) -> _Known:
        """By ``follow``, from rest."""
        before = int(ahead is not None)  # points of the motion before the first way-point
        moments = left.time - left.time[0] + (ahead or 0.0)
        moments = np.append(np.zeros(before), moments)
        position = np.vstack([start.position, left.position[1 - before :]])
        velocity = None
        if left.velocity is not None:  # the start's counts
            velocity = np.vstack([0.0 * start.position, left.velocity[1 - before :]])
        table = limits_per_cycle(self.limits, self.cycle_time)
        blocks = list(
            follow(
                Trajectory(left.joint_names, moments, position, velocity),
                self.limits,
                self.cycle_time,
                tolerance=self.tolerance or units(table, np.ptp(position, axis=0), None),
                use_velocities=self.use_velocities,
            )
        )
        points = np.concatenate([block.ahead for block in blocks]) - before
        last = len(left) - 1
        # those in one cycle are one
        return _Known(blocks, np.append(np.clip(points[:-1], 0, last), last))

    def _in_motion(self, left: Trajectory, knot: Knot, ahead: float) -> Entered:
        """The way on which the next way-points are passed soonest; by trial on those only."""
        near = int(np.searchsorted(left.time, left.time[0] + _SECONDS, side="right"))
        short = left.take(np.arange(min(max(near, _HEAD), len(left))))
        soonest = ahead + short.time[-1] - short.time[0] + 3.0 * self.cycle_time
        best: tuple[float, _Way] | None = None
        for way in self._ways(left, knot, ahead):
            try:
                blocks = list(way(short).blocks)
            except (PlanError, InputError, TrajectoryError):
                continue
            taken = _cycles(blocks) * self.cycle_time
            if (best is None or taken < best[0]) and self._stays(blocks):
                best = taken, way
                if taken <= soonest:
                    break
        if best is None:
            raise PlanError("the state in motion leaves no way onto the trajectory")
        return best[1](left)

    def _ways(self, left: Trajectory, knot: Knot, ahead: float) -> Iterator[_Way]:
        """What to try: the spline through all, or a motion to the first one and on from there."""
        T = self.cycle_time
        if ahead >= 2.0 * T and len(left) > 1:
            yield lambda way: self._splined(way, knot, ahead)
        velocity, least = self._velocity(left), max(0, round(ahead / T))
        for share in _SHARES if velocity.any() else (0.0,):
            ramp = join(
                knot,
                left.position[0],
                self.limits,
                T,
                velocity=share * velocity if share else None,
                least=least,
            )
            ramp.stretch[-1] = int(ramp.cycles.sum()) - least
            yield lambda way, ramp=ramp: self._led(ramp, way, Knot.of(ramp))  # type: ignore[misc]

    def _velocity(self, left: Trajectory) -> FloatArray:
        """With which the first of these way-points is passed, if the limits allow."""
        if len(left) == 1:
            return np.zeros(left.position.shape[1])
        if self.use_velocities and left.velocity is not None:
            wanted = left.velocity[0]
        else:
            wanted = (left.position[1] - left.position[0]) / (left.time[1] - left.time[0])
        most = np.array([limit.velocity for limit in self.limits]) * (1.0 - 1e-9)
        return np.asarray(np.clip(wanted, -most, most))

    def _stays(self, blocks: Sequence[Followed]) -> bool:
        ranges = [limit.position or (-np.inf, np.inf) for limit in self.limits]
        if not np.isfinite(ranges).any():
            return True
        low, high = np.array(ranges).T
        rows = [replace(block, first=1).sample().position for block in blocks]
        return all(bool(((row >= low) & (row <= high)).all()) for row in rows)

    def _splined(self, left: Trajectory, knot: Knot, ahead: float) -> Entered:
        """The first way-point in its time, straight from the state."""
        moments = np.concatenate([[0.0], left.time - left.time[0] + ahead])
        velocity = (
            None if left.velocity is None else np.vstack([0.0 * knot.position, left.velocity])
        )
        position = np.vstack([knot.position, left.position])
        return self._along(Trajectory(left.joint_names, moments, position, velocity), knot, -1)

    def _led(self, leading: Followed | None, left: Trajectory, state: Knot) -> Entered:
        """A motion to the first way-point, then along the others."""
        if leading is None and len(left) == 1:
            leading = dwell(state.position, 1, self.cycle_time)
        points = np.zeros(0 if leading is None else len(leading), dtype=np.int64)
        before = iter(() if leading is None else (leading,))
        if len(left) == 1:
            return Entered(before, points)
        position = np.vstack([state.position, left.position[1:]])
        velocity = None if left.velocity is None else left.velocity.copy()
        if velocity is not None:
            velocity[0] = 0.0  # the state counts
        body = Trajectory(left.joint_names, left.time - left.time[0], position, velocity)
        made = self._along(body, state, 0)
        return Entered(itertools.chain(before, made.blocks), np.concatenate([points, made.points]))

    def _along(self, body: Trajectory, state: Knot, shift: int) -> Entered:
        """From the state at its first point; ``shift`` to the numbers of the trajectory."""
        begin = state if state.moving else None
        if self.tolerance:
            near = follow_within(
                body, self.limits, self.cycle_time, tolerance=self.tolerance, begin=begin
            )
            return Entered(iter(near.blocks), near.kept[1:] + shift)
        blocks = stretched(
            body,
            self.limits,
            self.cycle_time,
            use_velocities=self.use_velocities,
            block=BLOCK if begin is None else _BLOCK,
            begin=begin,
        )
        return Entered(blocks, np.arange(1, len(body)) + shift)


@dataclass(eq=False)
class _Known:
    """A motion all of which is planned: its blocks, and the way-point ahead in each segment."""

    blocks: list[Followed]
    points: IntArray

    @classmethod
    def of(cls, entered: Entered) -> _Known:
        return cls(list(entered.blocks), entered.points)

    @property
    def cycles(self) -> int:
        return _cycles(self.blocks)

    @property
    def entered(self) -> Entered:
        return Entered(iter(self.blocks), self.points)


_Way = Callable[[Trajectory], Entered]


def _cycles(blocks: Sequence[Followed]) -> int:
    return sum(int(block.cycles.sum()) for block in blocks)


def _numbered(blocks: Iterator[Followed], names: tuple[str, ...]) -> Iterator[Followed]:
    """Blocks that follow each other as one motion."""
    first = cycle = 0
    for block in blocks:
        yield replace(block, joint_names=names, first=first, first_cycle=cycle)
        first += len(block)
        cycle += int(block.cycles.sum())
