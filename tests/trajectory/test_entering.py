"""Onto a trajectory from rest: inside its position limits, whatever turns on them; its end met."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
import pytest

from sjerk import Limits, Trajectory
from sjerk.trajectory.entering import Entry
from sjerk.trajectory.segments import Knot


@pytest.mark.parametrize("seed", range(int(os.environ.get("SJERK_ENTRIES", "12"))))
def test_way_points_on_position_limits_are_not_passed(seed: int) -> None:
    """1 to 4 joints over six decades, turning on both limits; at the first one or elsewhere, due or
    not, within a tolerance or not: no sample is outside, the last one is the last way-point.
    """
    rng = np.random.default_rng(seed)
    joints, count = int(rng.integers(1, 5)), int(rng.integers(1, 8))
    unit, T = 10.0 ** rng.uniform(-3.0, 3.0, joints), float(rng.choice([0.25e-3, 1e-3, 4e-3]))
    q = rng.uniform(-0.95, 0.95, (count, joints))
    q[:-1][rng.random((count - 1, joints)) < 0.35] = 1.0
    q[:-1][rng.random((count - 1, joints)) < 0.2] = -1.0
    q *= unit
    time = np.append(0.0, np.cumsum(rng.uniform(0.1, 1.0, count - 1)))
    way = Trajectory([f"j{i}" for i in range(joints)], time + rng.choice([0.0, 0.0005, 0.5]), q)
    at = q[0] if rng.random() < 0.5 else rng.uniform(-0.9, 0.9, joints) * unit
    entry = Entry(
        [Limits(2.0 * x, 8.0 * x, 200.0 * x, position=(-x, x)) for x in unit.tolist()],
        T,
        tolerance=float(rng.choice([0.0, 1e-3])) * float(unit.min()),
    )
    made = entry.enter(way, Knot.rest(at), float(rng.choice([0.0, 0.3])))
    blocks = list(made.blocks)
    position = np.concatenate([replace(block, first=1).sample().position for block in blocks])
    assert (np.abs(position) <= unit).all()
    np.testing.assert_array_equal(position[-1], q[-1])
    assert len(made.points) == sum(len(block) for block in blocks)
    assert (np.diff(made.points) >= 0).all()
    assert made.points[-1] == count - 1
