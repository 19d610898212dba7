"""Following without times: fast, within the limits, through points, near them, or with stops."""

from __future__ import annotations

import numpy as np
import pytest

from helpers.following_check import (
    PANDA,
    Array,
    T,
    dense,
    excess,
    recording,
    recording_keeps,
    toppra_plan,
)
from sjerk import InputError, Limits
from sjerk.trajectory.following import limits_per_cycle
from sjerk.trajectory.untimed import follow_path, follow_stops

ROBOT = Limits(velocity=2.0, acceleration=4.0, jerk=500.0)


def walk(n: int, joints: int, step: float, seed: int) -> Array:
    rng = np.random.default_rng(seed)
    return np.cumsum(rng.uniform(-step, step, (n, joints)), axis=0)


def gap(position: Array, path: Array) -> Array:
    """Distance of each position from the straight lines of a path, by brute force."""
    start, way = path[:-1], np.diff(path, axis=0)
    best = np.full(len(position), np.inf)
    for a, d in zip(start, way, strict=True):
        along = np.clip(((position - a) @ d) / (d @ d), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(position - a - along[:, None] * d, axis=1))
    return best


@pytest.mark.parametrize("seed", range(4))
def test_through_every_point_nearly_as_fast_as_bang_bang(seed: int) -> None:
    """The points of a TOPP-RA plan, without its times: at most 12 % longer, with limited jerk."""
    plan = toppra_plan(0.1, seed)
    blocks = list(follow_path(plan.position, PANDA, T))
    position, cycles = recording(blocks)
    np.testing.assert_array_equal(position[cycles], plan.position)
    recording_keeps(position, PANDA)
    assert len(position) * T < 1.12 * plan.duration


@pytest.mark.parametrize("step", [1e-3, 0.05, 1.0])
def test_random_points_are_met_within_the_limits(step: float) -> None:
    """Over 1000 segments ahead, from tiny to long: every point bit for bit, every limit."""
    path = walk(1500, 3, step, 1)
    blocks = list(follow_path(path, PANDA[:3], T, block=200))
    position, cycles = recording(blocks)
    np.testing.assert_array_equal(position[cycles], path)
    recording_keeps(position, PANDA[:3])


def test_no_segment_can_lose_a_cycle() -> None:
    """As with times: judged by a full linear system of its own."""
    path = walk(9, 2, 0.5, 3)
    (block,) = follow_path(path, [ROBOT] * 2, T)
    cycles, table = block.cycles.tolist(), limits_per_cycle([ROBOT] * 2, T)
    for i in range(len(cycles)):
        shorter = [*cycles[:i], cycles[i] - 1, *cycles[i + 1 :]]
        worst = max(excess(*dense(shorter, path[:, k]), table[k].tolist()) for k in range(2))
        assert worst > 1.0 - 1e-6


def test_it_slows_down_for_what_lies_far_ahead() -> None:
    """A thousand short segments on one line are one long move: full speed, and braking in time."""
    path = np.linspace(0.0, 20.0, 1001)[:, None]
    blocks = list(follow_path(path, [ROBOT], T, tolerance=1e-3, block=10))
    samples = [block.sample() for block in blocks]
    assert max(sample.velocity.max() for sample in samples) > 0.95 * ROBOT.velocity
    recording_keeps(recording(blocks)[0], [ROBOT])
    assert sum(block.cycles.sum() for block in blocks) * T < 1.08 * (20.0 / 2.0 + 2.0 / 4.0)


@pytest.mark.parametrize("tolerance", [0.003, 0.03, 0.3])
def test_corners_are_cut_within_the_tolerance(tolerance: float) -> None:
    """Commanded positions near the lines, lines' corners near the positions; faster than stops."""
    path = walk(25, 3, 0.6, 2)
    blocks = list(follow_path(path, PANDA[:3], T, tolerance=tolerance))
    position, _ = recording(blocks)
    recording_keeps(position, PANDA[:3])
    assert gap(position, path).max() <= tolerance * (1 + 1e-9)
    for corner in path:
        assert np.linalg.norm(position - corner, axis=1).min() <= tolerance * (1 + 1e-9)
    if tolerance >= 0.03:
        stops = sum(motion.cycles for motion in follow_stops(path, PANDA[:3], T))
        assert len(position) < stops


def test_a_line_there_and_back_within_the_tolerance() -> None:
    """Reversals are met, repeated points are one."""
    path = np.array([[0.0, 0.0], [0.5, 0.1], [0.5, 0.1], [0.0, 0.0], [0.5, 0.1]])
    position, _ = recording(list(follow_path(path, [ROBOT] * 2, T, tolerance=0.01)))
    recording_keeps(position, [ROBOT] * 2)
    assert gap(position, path[[0, 1]]).max() <= 0.01


def test_exact_stops_are_on_the_lines() -> None:
    """Every point is a rest, and the way between is straight."""
    path = walk(12, 3, 0.5, 4)
    motions = list(follow_stops(path, PANDA[:3], T))
    assert len(motions) == 11
    for motion, one, two in zip(motions, path[:-1], path[1:], strict=True):
        position = motion.sample().position
        np.testing.assert_array_equal(position[[0, -1]], [one, two])
        assert gap(position, np.array([one, two])).max() < 1e-12
        recording_keeps(position, PANDA[:3])


def test_nothing_to_do_and_nothing_usable() -> None:
    """One point, or the same again, is no motion; what is no path is refused."""
    assert list(follow_path([[1.0]], [ROBOT], T)) == []
    assert list(follow_path([[1.0], [1.0]], [ROBOT], T)) == []
    assert list(follow_stops([[1.0], [1.0]], [ROBOT], T)) == []
    for path in ([1.0, 2.0], [[1.0], [np.nan]], np.empty((0, 2))):
        with pytest.raises(InputError):
            follow_path(path, [ROBOT], T)
    with pytest.raises(InputError):
        follow_path([[0.0], [1.0]], [ROBOT] * 2, T)
    with pytest.raises(InputError):
        follow_path([[0.0], [1.0]], [ROBOT], T, tolerance=0.0)
