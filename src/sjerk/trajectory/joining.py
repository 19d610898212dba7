"""Ways off and onto a path: from any state of a followed motion to rest, or to a way-point.

A path planner's motion begins and ends at rest; what interrupts it does not. ``brake`` and ``join``
plan by the kernel's own planner and return what ``follow`` returns. Never here: shared memory,
drives.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sjerk.errors import InputError
from sjerk.limits import limits_of_each
from sjerk.planner import Motion, Synchronization, plan, plan_velocity
from sjerk.profile import FloatArray, Limits, Profile, State
from sjerk.trajectory.segments import (
    PHASES,
    Followed,
    IntArray,
    Knot,
    Passed,
    begin_of,
    sample_of,
    through,
)

#: Rounds until the sample stands on a way-point that is passed in motion; each gains 3 digits.
_ROUNDS = 6


def brake(
    knot: Knot,
    limits: Limits | Sequence[Limits],
    cycle_time: float,
    *,
    joint_names: Sequence[str] | None = None,
) -> Followed:
    """Bring every joint to rest as fast as its limits allow; one cycle more, for the samples.

    ``limits``: one for all or one each; the smaller ones, where braking has its own. Raises
    InputError.

    >>> stop = brake(Knot.rest([0.0]), [Limits(1.0, 1.0, 10.0)], 1e-3)
    >>> stop.cycles.tolist(), stop.position[-1].tolist()
    ([1], [0.0])
    """
    each = limits_of_each(limits, len(knot.position))
    profiles = [
        plan_velocity(state, 0.0, both(limit), cycle_time)
        for state, limit in zip(knot.states(cycle_time), each, strict=True)
    ]
    return _followed(
        knot, profiles, cycle_time, joint_names, rest=[p.end.position for p in profiles]
    )


def join(
    knot: Knot,
    position: ArrayLike,
    limits: Limits | Sequence[Limits],
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
    starts, own = knot.states(T), [both(limit) for limit in limits_of_each(limits, len(goal))]
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
    segments = -(-len(length) // PHASES)
    lengths: IntArray = np.zeros((segments, PHASES), dtype=np.int64)
    jerks: FloatArray = np.zeros((segments, PHASES, joints))
    lengths.reshape(-1)[: len(length)] = length
    jerks.reshape(-1, joints)[: len(length)] = jerk
    P, V, A = begin_of(knot, T)
    j = knot.last_jerk * T**3
    rows = [np.stack([knot.position, knot.velocity, knot.acceleration, knot.last_jerk])]
    for i in range(segments):
        P, V, A, j = through(P, V, A, j, lengths[i], jerks[i] * T**3)
        rows.append(np.stack([sample_of(P, V, A, j), V / T, A / T**2, j / T**3]))
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
        np.ascontiguousarray(table[:, 0]),
        np.ascontiguousarray(table[:, 1]),
        np.ascontiguousarray(table[:, 2]),
        np.ascontiguousarray(table[:, 3]),
        ahead=np.zeros(segments, dtype=np.int64),
        passed=Passed.none(joints),
    )


def stops_of(
    names: Sequence[str], motions: Sequence[Motion], path: FloatArray, kept: IntArray
) -> Followed:
    """Motions from stop to stop as one; ``kept`` (m + 1,): their way-points among ``path``."""
    knot, parts, T = Knot.rest(path[kept[0]]), [], motions[0].cycle_time
    for motion, point in zip(motions, kept[1:], strict=True):
        parts.append(_followed(knot, motion.profiles, T, names, rest=path[point]))
        knot = Knot.of(parts[-1])
    ends = np.cumsum([int(part.cycles.sum()) for part in parts])
    whole: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in ("cycles", "stretch", "lengths", "jerk")
    }
    states = {
        name: np.concatenate(
            [getattr(parts[0], name)[:1], *(getattr(part, name)[1:] for part in parts)]
        )
        for name in ("position", "velocity", "acceleration", "last_jerk")
    }
    moment = np.concatenate([[0.0], ends * T])
    return Followed(
        tuple(names), T, 0, 0, **whole, **states,
        ahead=np.repeat(kept[1:], [len(part) for part in parts]),
        passed=Passed(kept, moment, np.zeros((len(kept), path.shape[1]))),
    )  # fmt: skip
