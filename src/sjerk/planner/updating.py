"""Planning in a loop of one's own: a target that may change each cycle, a sample per cycle.

For programs that have a cycle already and want no kernel. ``docs/explanation/own_loop.md`` shows it
beside ruckig's loop. Never here: clocks, drives, how a plan is found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sjerk.errors import InputError, positive
from sjerk.limits import limits_of_each
from sjerk.phases import COLUMNS
from sjerk.planner.arguments import Synchronization, is_sequence, states_of
from sjerk.planner.planning import Motion, plan
from sjerk.profile import FloatArray, Limits, Profile, Samples, State

#: Rows that are sampled at first; twice as many each time they are used up.
_ROWS = 16


@dataclass(frozen=True, eq=False)
class Step:
    """What the drives get in one cycle, N axes: arrays (N,) in u, u/s, u/s^2, u/s^3.

    ``done``: all axes are on their targets, and have been for this sample.
    """

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray
    done: bool


class Updater:
    """Axes on the way to targets that may change in any cycle, planned anew only when they do.

    ``start``: a ``State`` or position per axis; ``limits``: one for all or one each; both as in
    ``plan``, like ``synchronization`` and ``moving``. ``cycle_time`` in seconds. A plan is left
    between two samples without a jump of the acceleration, and within all limits that it left room
    to keep.

    Raises ``InputError``.

    >>> loop = Updater([0.0, 0.0], Limits(90.0, 500.0, 5000.0), 1e-3)
    >>> steps = [loop.update([160.0, 20.0]) for _ in range(100)]
    >>> while not (step := loop.update([10.0, 20.0])).done:
    ...     steps.append(step)
    >>> step.position.tolist()
    [10.0, 20.0]
    """

    def __init__(
        self,
        start: Sequence[State | float],
        limits: Limits | Sequence[Limits],
        cycle_time: float,
        *,
        synchronization: Synchronization = "time",
        moving: bool = False,
    ) -> None:
        """At rest or in motion at ``start``; nothing is planned yet."""
        if not is_sequence(start):
            raise InputError("start", start, "must be a list of one State or number per axis")
        self._states = states_of("start", start)
        self._limits = limits_of_each(limits, len(self._states))
        self._T = positive("cycle_time", cycle_time)
        self._synchronization: Synchronization = synchronization
        self._moving = moving
        self._targets: list[State] = []
        self._motion: Motion | None = None
        self._rows: list[Samples] = []
        self._row = 0

    @property
    def motion(self) -> Motion | None:
        """The plan in execution; None before the first ``update``."""
        return self._motion

    def update(
        self,
        target: Sequence[State | float],
        *,
        limits: Limits | Sequence[Limits] | None = None,
    ) -> Step:
        """Go on for one cycle, to these targets; return what the drives get in it.

        ``limits``: others from now on; lower ones are kept as ``plan`` keeps them from a start
        beyond. Raises ``InputError`` as ``plan`` does; then the motion has not gone on.
        """
        if not is_sequence(target):
            raise InputError("target", target, "must be a list of one State or number per axis")
        targets = states_of("target", target)
        own = self._limits if limits is None else limits_of_each(limits, len(self._states))
        if self._motion is None or targets != self._targets or own != self._limits:
            now = self._states
            if self._motion is not None:
                now = [profile.state(self._row) for profile in self._motion]
            self._motion = plan(
                now,
                targets,
                own,
                self._T,
                synchronization=self._synchronization,
                moving=self._moving,
            )
            self._targets, self._limits, self._rows, self._row = targets, own, [], 0
        self._row += 1
        row = min(self._row, self._motion.cycles + 1)
        if not self._rows or row >= len(self._rows[0].time):
            self._rows = [_sampled(one, row) for one in self._motion]
        columns = (np.array([getattr(x, name)[row] for x in self._rows]) for name in COLUMNS[1:])
        position, velocity, acceleration, jerk = columns
        if self._row > row:
            ends = [one.state(self._row) for one in self._motion]
            position = np.array([end.position for end in ends])
            velocity = np.array([end.velocity for end in ends])
        return Step(position, velocity, acceleration, jerk, self._row > self._motion.cycles)


def _sampled(profile: Profile, row: int) -> Samples:
    """The first samples of a profile, with room for as many again behind ``row``."""
    out = Samples.empty(max(_ROWS, 2 * row))
    profile.fill(out, len(out.time))
    return out
