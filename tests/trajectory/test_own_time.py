"""Motions that keep their limits are followed in their own time, whatever their sampling.

The motions are ruckig's time-optimal ones: their phases begin and end between cycles, and they are
at a limit all the time, so that whatever a planner loses shows. Judged from recorded positions.
"""

from __future__ import annotations

import itertools
import os

import numpy as np
import pytest
import ruckig

from helpers.following_check import Array, T, recording, recording_keeps
from sjerk import Limits, Trajectory, follow
from sjerk.trajectory.entering import Entry
from sjerk.trajectory.segments import Followed, Knot

RUNS = int(os.environ.get("SJERK_PATHS", "30"))


class Motion:
    """A time-optimal motion of one to seven joints, and the limits that it keeps."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        joints = int(rng.integers(1, 8))
        V = rng.uniform(0.5, 3.0, joints)
        A = V * rng.uniform(1.0, 10.0, joints)
        J = A * rng.uniform(3.0, 50.0, joints)
        request, self.found = ruckig.InputParameter(joints), ruckig.Trajectory(joints)
        request.current_position = [0.0] * joints
        request.target_position = rng.uniform(-2.0, 2.0, joints).tolist()
        request.max_velocity, request.max_acceleration = V.tolist(), A.tolist()
        request.max_jerk = J.tolist()
        ruckig.Ruckig(joints).calculate(request, self.found)
        self.limits = [Limits(*row) for row in np.column_stack([V, A, J]).tolist()]
        self.soft = float((A / J).max())
        self.every = float(rng.integers(1, 101)) * 1e-3
        self.velocities = bool(rng.integers(0, 2))

    def sampled(self, pace: float = 1.0) -> Trajectory:
        """Each ``every`` seconds, and at its end; ``pace``: so many times as slow."""
        whole = float(self.found.duration)
        time = np.arange(0.0, whole, self.every)
        if len(time) > 1 and whole - time[-1] < 0.3 * self.every:
            time = time[:-1]
        time = np.append(time, whole)
        rows = [self.found.at_time(t) for t in time.tolist()]
        position, velocity = (np.array([row[k] for row in rows]) for k in (0, 1))
        velocity[0] = velocity[-1] = 0.0
        names = [f"joint{k}" for k in range(len(self.limits))]
        given = velocity / pace if self.velocities and pace >= 1.0 else None
        return Trajectory(names, time * pace, position, given)


def followed(motion: Motion, pace: float = 1.0) -> tuple[list[Followed], Array, Trajectory]:
    """Blocks and positions of a motion; its limits are kept in every cycle."""
    way = motion.sampled(pace)
    blocks = list(follow(way, motion.limits, T))
    position, _ = recording(blocks)
    recording_keeps(position, motion.limits)
    assert np.array_equal(position[-1], way.position[-1])
    return blocks, position, way


# 700: 57 way-points on 66 knots, which cannot meet them; finer ones can
@pytest.mark.parametrize("seed", sorted({*range(RUNS), 700}))
def test_a_motion_within_its_limits_takes_its_own_time(seed: int) -> None:
    """Two cycles more, ten where A/J is; each way-point within 1e-4 of the way, as it is told."""
    motion = Motion(seed)
    blocks, position, way = followed(motion)
    own = np.ceil(way.duration / T - 1e-9)
    assert len(position) - 1 <= own + (10 if motion.soft >= 10.0 * T else 2)
    part = np.abs(np.concatenate([block.passed.deviation for block in blocks]))
    assert (part <= 1.001e-4 * np.maximum(np.ptp(way.position, axis=0), 1e-2)).all()
    # and not only as it is told: between the samples next to its moment
    moment = np.concatenate([block.passed.moment for block in blocks])
    cycle = np.clip(np.floor(moment / T + 1e-6).astype(int), 0, len(position) - 2)
    low = np.minimum(position[cycle], position[cycle + 1])
    high = np.maximum(position[cycle], position[cycle + 1])
    bend = np.array([limit.acceleration for limit in motion.limits]) * T**2
    reach = part.max(axis=0) + bend + 1e-9
    assert ((way.position >= low - reach) & (way.position <= high + reach)).all()


@pytest.mark.parametrize("seed", range(RUNS // 3))
def test_asking_for_less_never_takes_longer(seed: int) -> None:
    """At five paces; the one above the limits is a local optimum, within 4 % of the own time."""
    motion = Motion(1000 + seed)
    fast, *taken = [len(followed(motion, pace)[1]) - 1 for pace in (0.8, 1.0, 1.01, 1.1, 2.0)]
    assert all(a <= b for a, b in itertools.pairwise(taken)), taken
    assert fast <= 1.04 * taken[0]
    for pace, cycles in ((1.1, taken[2]), (2.0, taken[3])):
        assert cycles <= np.ceil(pace * float(motion.found.duration) / T) + 1


@pytest.mark.parametrize("seed", range(RUNS // 3))
@pytest.mark.parametrize("away", [False, True])
def test_a_goal_from_rest_loses_little(seed: int, away: bool) -> None:
    """As an executor plays it, there already or with half a second to the first way-point."""
    motion = Motion(2000 + seed)
    way = motion.sampled()
    way = Trajectory(way.joint_names, way.time + 0.5, way.position, way.velocity)
    begin = way.position[0] + (0.01 if away else 0.0)
    entry = Entry(motion.limits, T, use_velocities=motion.velocities)
    made = entry.enter(way, Knot.rest(begin), 0.0)
    blocks = list(made.blocks)
    position, _ = recording(blocks)
    recording_keeps(position, motion.limits)
    assert np.array_equal(position[-1], way.position[-1])
    late = (len(position) - 1) * T - way.time[-1]
    assert late <= 0.1 + 0.2 * (way.time[-1] - way.time[0]) + 0.01
    assert len(made.points) == sum(len(block) for block in blocks)
    assert made.points[-1] == len(way) - 1
    assert (np.diff(made.points) >= 0).all()
