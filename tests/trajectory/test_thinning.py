"""Dense way-points within a tolerance, whole: near all of them, limits kept, little time lost."""

from __future__ import annotations

import numpy as np
import pytest

from helpers.following_check import PANDA, T, recording, recording_keeps, toppra_plan
from helpers.path_check import along, curve
from sjerk import InputError, Limits, Trajectory, follow_within

ROBOT = Limits(velocity=2.0, acceleration=4.0, jerk=500.0)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3])
def test_a_dense_plan_of_the_panda_loses_little_time(tolerance: float) -> None:
    """TOPP-RA at 8 ms: within the tolerance of every way-point, judged by cubics of its own."""
    way = toppra_plan(0.008, 0)
    made = follow_within(way, PANDA, T, tolerance=tolerance)
    position, _ = recording(made.blocks)
    recording_keeps(position, PANDA)
    assert made.largest <= tolerance * (1 + 1e-6)
    assert (len(position) - 1) * T <= 1.01 * way.duration
    places = curve(position)
    moments = np.concatenate([block.passed.moment for block in made.blocks]) / T
    for i in range(0, len(way), 29):
        _, gap = along(places, way.position[i : i + 1], max(0, int(16 * moments[i]) - 480), 960)
        assert gap.max() <= np.sqrt(7) * tolerance


def test_the_deviation_is_that_of_every_way_point() -> None:
    """One row per way-point, the ends exact."""
    way = toppra_plan(0.1, 1)
    made = follow_within(way, PANDA, T, tolerance=1e-3)
    assert made.deviation.shape == way.position.shape
    assert not made.deviation[[0, -1]].any()
    assert made.stretch >= 0


def test_what_is_refused() -> None:
    """A tolerance that is none."""
    way = Trajectory(["a"], [0.0, 1.0], [[0.0], [0.1]])
    with pytest.raises(InputError, match="tolerance"):
        follow_within(way, [ROBOT], T, tolerance=0.0)
    assert follow_within(way, [ROBOT], T, tolerance=1.0).largest == 0.0
