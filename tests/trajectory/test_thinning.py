"""Dense way-points within a tolerance: near all of them, limits kept, little time lost."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.following_check import PANDA, Array, T, recording, recording_keeps, toppra_plan
from helpers.path_check import along, curve
from sjerk import InputError, Limits, Trajectory, follow_within
from sjerk.trajectory.stretching import stretched
from sjerk.trajectory.thinning import Thinned

ROBOT = Limits(velocity=2.0, acceleration=4.0, jerk=500.0)


def judged(way: Trajectory, limits: list[Limits], tolerance: float) -> tuple[Thinned, Array]:
    """The distances again, by cubics through the recording; and limits, and points that are met."""
    made = follow_within(way, limits, T, tolerance=tolerance)
    position, cycles = recording(made.blocks)
    recording_keeps(position, limits)
    np.testing.assert_array_equal(position[cycles], way.position[made.kept])
    assert made.kept[0] == 0
    assert made.kept[-1] == len(way) - 1
    return made, position


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-4])
@pytest.mark.parametrize("seed", range(2))
def test_dense_plans_of_the_panda_lose_little_time(seed: int, tolerance: float) -> None:
    """TOPP-RA at 2 ms: within the tolerance of every way-point, some per cent longer."""
    way = toppra_plan(0.002, seed)
    made, position = judged(way, PANDA, tolerance)
    assert made.largest <= tolerance
    assert (len(position) - 1) * T <= 1.1 * way.duration
    places = curve(position)
    due = np.interp(way.time, way.time[made.kept], recording(made.blocks)[1])
    for i in range(0, len(way), 97):
        _, gap = along(places, way.position[i : i + 1], max(0, int(16 * due[i]) - 480), 960)
        assert gap.max() <= np.sqrt(7) * tolerance


def test_dense_and_sparse_give_the_same_motion() -> None:
    """The same plan at 2 ms and at 100 ms: motions that differ by less than the tolerance."""
    tolerance = 2e-3
    dense, sparse = toppra_plan(0.002, 0), toppra_plan(0.1, 0)
    one = judged(dense, PANDA, 1e-4)[1]
    two = recording(list(stretched(sparse, PANDA, T, use_velocities=False)))[0]
    _, gaps = along(curve(one), two[::5], 0, 16 * len(one))  # each 5 ms: it turns far more slowly
    assert gaps.max() <= tolerance
    assert abs(len(one) - len(two)) <= 0.02 * len(two)


def test_a_way_that_needs_every_point_keeps_all() -> None:
    """Noise above the tolerance: every way-point is met."""
    rng = np.random.default_rng(2)
    way = Trajectory(["a"], np.arange(30) * 0.05, rng.normal(size=(30, 1)) * 0.1)
    made, _ = judged(way, [ROBOT], 1e-9)
    assert len(made.kept) == 30


@settings(max_examples=25)
@given(
    st.lists(st.floats(-0.5, 0.5), min_size=2, max_size=40),
    st.sampled_from([0.004, 0.05]),
    st.sampled_from([1e-3, 0.05]),
)
def test_any_way(rows: list[float], period: float, tolerance: float) -> None:
    """Reversing, repeating, too fast: within the tolerance, within the limits."""
    way = Trajectory(["a"], period * np.arange(len(rows)), np.array(rows)[:, None])
    made, _ = judged(way, [ROBOT], tolerance)
    assert made.largest <= tolerance


def test_what_is_refused() -> None:
    """A tolerance that is none."""
    way = Trajectory(["a"], [0.0, 1.0], [[0.0], [0.1]])
    with pytest.raises(InputError, match="tolerance"):
        follow_within(way, [ROBOT], T, tolerance=0.0)
    assert judged(way, [ROBOT], 1.0)[0].largest == 0.0
