"""Ways off and onto a path: from any state of a followed motion to rest, or to a way-point.

A path planner's motion begins and ends at rest; what interrupts it does not. ``brake`` and ``join``
plan by the kernel's own planner and return what ``follow`` returns. Never here: shared memory,
drives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from sjerk.errors import InputError
from sjerk.following import Followed, IntArray
from sjerk.planning import Synchronization, plan, plan_velocity
from sjerk.profile import FloatArray, Limits, Profile, State

_PHASES = 4  # of a segment
#: Rounds until the sample stands on a way-point that is passed in motion; each gains 3 digits.
_ROUNDS = 6


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


def brake(
    knot: Knot,
    limits: Sequence[Limits],
    cycle_time: float,
    *,
    joint_names: Sequence[str] | None = None,
) -> Followed:
    """Bring every joint to rest as fast as its limits allow; one cycle more, for the samples.

    ``limits``: one per joint; the smaller ones, where braking has its own. Raises InputError.

    >>> stop = brake(Knot.rest([0.0]), [Limits(1.0, 1.0, 10.0)], 1e-3)
    >>> stop.cycles.tolist(), stop.position[-1].tolist()
    ([1], [0.0])
    """
    profiles = [
        plan_velocity(state, 0.0, both(limit), cycle_time)
        for state, limit in zip(knot.states(cycle_time), limits, strict=True)
    ]
    return _followed(
        knot, profiles, cycle_time, joint_names, rest=[p.end.position for p in profiles]
    )


def join(
    knot: Knot,
    position: ArrayLike,
    limits: Sequence[Limits],
    cycle_time: float,
    *,
    velocity: ArrayLike | None = None,
    least: int = 0,
    synchronization: Synchronization = "time",
    joint_names: Sequence[str] | None = None,
) -> Followed:
    """Go to a way-point by the shortest motion of at least ``least`` cycles, joints together.

    ``position`` (N,) is met by the sample of the last cycle, bit for bit; at rest, unless
    ``velocity`` (N,) is given. In motion the sample may miss it by an eighth of what a cycle of
    jerk covers, where the plan's last jerk changes its sign with that. Raises InputError as
    ``plan`` does.

    >>> ramp = join(Knot.rest([0.0, 0.0]), [0.2, 0.1], [Limits(1.0, 4.0, 100.0)] * 2, 1e-3)
    >>> ramp.position[-1].tolist()
    [0.2, 0.1]
    """
    T = cycle_time
    goal = np.array(position, dtype=np.float64)
    speed = np.zeros_like(goal) if velocity is None else np.array(velocity, dtype=np.float64)
    if goal.shape != knot.position.shape or speed.shape != goal.shape:
        raise InputError("position", goal.shape, f"must have shape {knot.position.shape}")
    starts, own = knot.states(T), [both(limit) for limit in limits]
    shift = np.zeros_like(goal)
    for _ in range(_ROUNDS):
        targets = [State(*row) for row in np.column_stack([goal + shift, speed]).tolist()]
        motion = plan(
            starts,
            targets,
            own,
            T,
            synchronization=synchronization,
            min_duration=max(0, least - (velocity is None)) * T,
        )
        if velocity is None:
            return _followed(knot, motion.profiles, T, joint_names, rest=goal)
        made = _followed(knot, motion.profiles, T, joint_names)
        left = goal - made.position[-1]
        if np.abs(left).max() <= 4.0 * np.spacing(np.abs(goal).max()):
            made.position[-1] = goal
            return made
        shift += left
    return made


def both(limits: Limits) -> Limits:
    """The smaller ones of driving and braking."""
    acceleration = min(limits.acceleration, limits.braking[0])
    jerk = min(limits.jerk, limits.braking[1])
    return Limits(limits.velocity, acceleration, jerk)


def split(motion: Followed, cycles: int) -> tuple[Followed, Followed]:
    """The first ``cycles`` of a motion, and the rest; neither is empty.

    >>> whole = join(Knot.rest([0.0]), [0.2], [Limits(1.0, 4.0, 100.0)], 1e-3)
    >>> head, tail = split(whole, 100)
    >>> int(head.cycles.sum()), bool(tail.position[-1] == 0.2)
    (100, True)
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
    for p in range(_PHASES):
        before[p] = min(before[p], left)
        left -= int(before[p])
    after -= before
    knot = Knot.of(motion, i)
    P, V, A, j = _through(*_begin(knot, T), knot.last_jerk * T**3, before, motion.jerk[i] * T**3)
    between = (_sample(P, V, A, j), V / T, A / T**2, j / T**3)
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


def _begin(knot: Knot, T: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """P, V, A of the continuous motion, per cycle."""
    V, A = knot.velocity * T, knot.acceleration * T**2
    return knot.position + V / 2 - A / 3 + knot.last_jerk * (T**3 / 8), V, A


def _through(
    P: FloatArray, V: FloatArray, A: FloatArray, j: FloatArray, lengths: IntArray, jerk: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """P, V, A after phases of constant jerk, and the last one's jerk."""
    for n, J in zip(lengths.tolist(), jerk, strict=True):
        if n:
            P = P + n * (V + n * (A / 2 + n * J / 6))
            V, A, j = V + n * (A + n * J / 2), A + n * J, J
    return P, V, A, j


def _sample(P: FloatArray, V: FloatArray, A: FloatArray, j: FloatArray) -> FloatArray:
    return P - V / 2 + A / 3 - j / 8


def _followed(
    knot: Knot,
    profiles: Sequence[Profile],
    T: float,
    names: Sequence[str] | None,
    *,
    rest: ArrayLike | None = None,
) -> Followed:
    """Profiles of N joints cut where any of them changes its jerk; settled at ``rest``."""
    joints, cycles = len(profiles), max(profile.cycles for profile in profiles)
    own = [np.cumsum([phase.cycles for phase in profile.phases]) for profile in profiles]
    bounds = np.unique(np.concatenate([[0, cycles], *own])).astype(np.int64)
    jerk = np.zeros((len(bounds) - 1, joints))
    for k, (profile, ends) in enumerate(zip(profiles, own, strict=True)):
        each = np.array([*(phase.jerk for phase in profile.phases), 0.0])
        jerk[:, k] = each[np.searchsorted(ends, bounds[:-1], side="right")]
    length = np.diff(bounds)
    if rest is not None:  # a cycle for the sample to come to rest
        jerk, length = np.vstack([jerk, np.zeros(joints)]), np.append(length, 1)
    segments = -(-len(length) // _PHASES)
    lengths: IntArray = np.zeros((segments, _PHASES), dtype=np.int64)
    jerks: FloatArray = np.zeros((segments, _PHASES, joints))
    lengths.reshape(-1)[: len(length)] = length
    jerks.reshape(-1, joints)[: len(length)] = jerk
    P, V, A = _begin(knot, T)
    j = knot.last_jerk * T**3
    rows = [np.stack([knot.position, knot.velocity, knot.acceleration, knot.last_jerk])]
    for i in range(segments):
        P, V, A, j = _through(P, V, A, j, lengths[i], jerks[i] * T**3)
        rows.append(np.stack([_sample(P, V, A, j), V / T, A / T**2, j / T**3]))
    if rest is not None:
        rows[-1] = np.stack([np.asarray(rest, dtype=np.float64), *np.zeros((3, joints))])
    table = np.stack(rows)
    taken = lengths.sum(axis=1)
    return Followed(
        tuple(names) if names is not None else tuple(f"joint{k}" for k in range(joints)),
        T,
        1,
        0,
        taken,
        np.zeros_like(taken),
        lengths,
        jerks,
        *(np.ascontiguousarray(table[:, i]) for i in range(4)),
    )
