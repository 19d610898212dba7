"""One jerk per way-point, where no limit binds: met in their cycles; a limit in the way is told."""

from __future__ import annotations

import numpy as np
import pytest

from helpers.following_check import (
    PANDA,
    Array,
    T,
    dense,
    excess,
    rationals,
    recording,
    recording_keeps,
    wave,
)
from sjerk import Limits, Trajectory, follow
from sjerk.trajectory.interpolated import Interpolated
from sjerk.trajectory.segments import Followed, Knot
from sjerk.trajectory.window import limits_per_cycle

ROBOT = Limits(velocity=2.0, acceleration=4.0, jerk=500.0)


def met(way: Trajectory, limits: list[Limits], **how: bool) -> list[Followed]:
    """Followed with every way-point in its cycle, bit for bit."""
    blocks = list(follow(way, limits, T, **how))
    position, cycles = recording(blocks)
    recording_keeps(position, limits)
    np.testing.assert_array_equal(position[cycles], way.position)
    np.testing.assert_array_equal(cycles, np.rint((way.time - way.time[0]) / T))
    return blocks


@pytest.mark.parametrize("period", [0.003, 0.01, 0.1])
def test_a_smooth_path_is_met_in_its_cycles(period: float) -> None:
    """Way-points of a motion within the limits, dense or sparse; one joint over fractions."""
    way = wave(round(4.0 / period), period)
    rationals(met(way, PANDA), way.position, PANDA[3], 3)


def test_dense_and_sparse_give_the_same_motion() -> None:
    """The same path at 10 ms and at 100 ms: commanded positions differ by less than 1e-3 rad."""
    fine = wave(801, 0.01)
    coarse = fine.take(np.arange(0, 801, 10))
    one, two = (recording(met(way, PANDA))[0] for way in (fine, coarse))
    assert np.abs(one - two).max() < 1e-3


def test_given_velocities_are_had() -> None:
    """The sample in the way-point's cycle has the velocity that was asked, in every joint."""
    t = np.arange(0.0, 4.05, 0.1)
    q = np.column_stack([0.2 * (1 - np.cos(np.pi * t)), 0.1 * np.sin(np.pi * t / 2) ** 2])
    v = np.column_stack([0.2 * np.pi * np.sin(np.pi * t), 0.05 * np.pi * np.sin(np.pi * t)])
    v[[0, -1]] = 0.0
    (block,) = met(Trajectory(["a", "b"], t, q, v), [ROBOT] * 2)
    cycles = np.concatenate([[0], np.cumsum(block.cycles)])
    np.testing.assert_allclose(block.sample().velocity[cycles], v, rtol=0, atol=1e-12)


def uses(cycles: list[int], q: Array, limits: list[Limits]) -> float:
    table = limits_per_cycle(limits, T)
    return max(
        excess(*dense(cycles, q[:, joint]), table[joint].tolist()) for joint in range(q.shape[1])
    )


@pytest.mark.parametrize("seed", range(12))
def test_what_passes_a_limit_is_told(seed: int) -> None:
    """Judged by a full linear system: all segments are good if and only if the motion is legal."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3, 12))
    cycles = rng.integers(30, 600, n)
    q = np.concatenate([np.zeros((1, 3)), np.cumsum(rng.uniform(-1.0, 1.0, (n, 3)), axis=0)])
    worst = uses(cycles.tolist(), q, [ROBOT] * 3)
    for share, legal in ((0.999, True), (1.001, False)):
        limits = [Limits(*(np.array([2.0, 4.0, 500.0]) * worst / share).tolist())] * 3
        made = Interpolated(
            ("a", "b", "c"),
            T,
            Knot.rest(q[0]),
            q[1:],
            np.cumsum(cycles),
            None,
            limits_per_cycle(limits, T),
        )
        assert (made.good == n) == legal
        assert made.read(n).sample().position[np.cumsum(cycles)].tolist() == q[1:].tolist()
