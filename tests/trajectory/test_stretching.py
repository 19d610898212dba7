"""Following with the given times: way-points met, limits kept, no cycle lost that could be had."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.following_check import (
    PANDA,
    SHAPES,
    Array,
    T,
    dense,
    excess,
    rationals,
    recording,
    recording_keeps,
    toppra_plan,
    wave,
)
from sjerk import InputError, Limits, Trajectory, TrajectoryError
from sjerk.trajectory import shipped_recording
from sjerk.trajectory.segments import Followed
from sjerk.trajectory.stretching import limits_per_cycle, stretched

ROBOT = Limits(velocity=2.0, acceleration=4.0, jerk=500.0)


def whole(way: Trajectory, limits: list[Limits], **options: bool) -> list[Followed]:
    """Follow, and hold the recording against the way-points and the limits."""
    blocks = list(stretched(way, limits, T, **options))
    position, cycles = recording(blocks)
    np.testing.assert_array_equal(position[cycles], way.position)
    recording_keeps(position, limits)
    asked = np.floor((way.time - way.time[0]) / T + 0.5).astype(int)
    taken = np.concatenate([block.cycles for block in blocks])
    stretch = np.concatenate([block.stretch for block in blocks])
    np.testing.assert_array_equal(taken, np.diff(asked) + stretch)
    assert (stretch >= 0).all()
    return blocks


@pytest.mark.parametrize("velocities", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_sparse_plans_of_the_panda_over_fractions(seed: int, velocities: bool) -> None:
    """TOPP-RA at 0.1 s: every way-point within 1e-9 in its cycle, over fractions."""
    way = toppra_plan(0.1, seed)
    blocks = whole(way, PANDA, use_velocities=velocities)
    for joint in range(seed, 7, 4):
        rationals(blocks, way.position, PANDA[joint], joint)
    taken = sum(int(block.cycles.sum()) for block in blocks)
    assert taken * T <= way.duration * (1.3 if velocities else 1.1)


def test_the_shipped_plan_takes_little_longer() -> None:
    """The recording of the demo under Franka's limits: 3 % over TOPP-RA's bang-bang time."""
    way = Trajectory.from_bag(shipped_recording())
    blocks = whole(way, PANDA, use_velocities=False)
    assert blocks[0].cycles.sum() * T <= 1.03 * way.duration


@pytest.mark.parametrize("seed", range(2))
def test_dense_plans_of_the_panda(seed: int) -> None:
    """TOPP-RA at 2 ms: met and within the limits; what its jumps of acceleration cost is told."""
    whole(toppra_plan(0.002, seed), PANDA, use_velocities=False)


@pytest.mark.parametrize("period", [0.002, 0.003, 0.01, 0.1])
def test_a_smooth_path_is_not_stretched(period: float) -> None:
    """Way-points of a motion within the limits are followed in their own time, dense or sparse."""
    blocks = whole(wave(round(8.0 / period), period), PANDA)
    middle = np.concatenate([block.stretch for block in blocks])[:-1]
    assert middle.max() <= (period == 0.002)  # the first of two cycles may need one more
    assert middle.sum() <= 2


def test_dense_and_sparse_give_the_same_motion() -> None:
    """The same path at 10 ms and at 100 ms: commanded positions differ by less than 1e-3 rad."""
    fine = wave(801, 0.01)
    coarse = fine.take(np.arange(0, 801, 10))
    one, two = (recording(whole(way, PANDA))[0] for way in (fine, coarse))
    rows = min(len(one), len(two))
    assert np.abs(one[:rows] - two[:rows]).max() < 1e-3


def test_given_velocities_are_had() -> None:
    """The sample in the way-point's cycle has the velocity that was asked, in every joint."""
    t = np.arange(0.0, 4.05, 0.1)
    q = np.column_stack([0.2 * (1 - np.cos(np.pi * t)), 0.1 * np.sin(np.pi * t / 2) ** 2])
    v = np.column_stack([0.2 * np.pi * np.sin(np.pi * t), 0.05 * np.pi * np.sin(np.pi * t)])
    v[[0, -1]] = 0.0
    (block,) = whole(Trajectory(["a", "b"], t, q, v), [ROBOT] * 2)
    cycles = np.concatenate([[0], np.cumsum(block.cycles)])
    same = np.concatenate([[True], block.stretch == 0]) & np.concatenate(
        [block.stretch == 0, [True]]
    )
    assert same.sum() > 35
    np.testing.assert_allclose(block.sample().velocity[cycles][same], v[same], rtol=0, atol=1e-12)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("period", [0.0004, 0.002, 0.1, 1.0])
@pytest.mark.parametrize("velocities", [True, False])
def test_ways_that_reverse_repeat_and_coincide(shape: str, period: float, velocities: bool) -> None:
    """Met, within the limits, in rationals, at any spacing: below a cycle, too fast, ample."""
    q = np.array(SHAPES[shape])[:, None] * [1.0, -0.5]
    way = Trajectory(["a", "b"], period * np.arange(len(q)), q, np.zeros_like(q))
    blocks = whole(way, [ROBOT] * 2, use_velocities=velocities)
    rationals(blocks, q, ROBOT, 1)


@settings(max_examples=60)
@given(
    st.lists(
        st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(1e-4, 0.2)),
        min_size=2,
        max_size=8,
    ),
    st.booleans(),
)
def test_random_ways(rows: list[tuple[float, float, float]], velocities: bool) -> None:
    """Any way-points at any times: met, within the limits, by the recording and in rationals."""
    table = np.array(rows)
    q, time = table[:, :2], np.cumsum(table[:, 2])
    velocity = np.zeros_like(q)
    velocity[1:-1] = np.clip((q[2:] - q[:-2]) / (time[2:] - time[:-2])[:, None], -2.0, 2.0)
    way = Trajectory(["a", "b"], time, q, velocity)
    rationals(whole(way, [ROBOT] * 2, use_velocities=velocities), q, ROBOT, 0)


def uses(cycles: list[int], q: Array, limits: list[Limits]) -> float:
    table = limits_per_cycle(limits, T)
    return max(
        excess(*dense(cycles, q[:, joint]), table[joint].tolist()) for joint in range(q.shape[1])
    )


@pytest.mark.parametrize("seed", range(12))
def test_no_segment_can_lose_a_cycle_with_the_others_fixed(seed: int) -> None:
    """Judged by a full linear system of its own: as planned it is legal, a cycle less is not."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 12))
    q = rng.uniform(-1.0, 1.0, (n, 3))
    time = np.cumsum(rng.uniform(0.01, 0.6, n))
    (block,) = whole(Trajectory(["a", "b", "c"], time, q), [ROBOT] * 3)
    cycles = block.cycles.tolist()
    assert uses(cycles, q, [ROBOT] * 3) <= 1.0 + 1e-8
    assert max(block.stretch) > 0
    for i in np.flatnonzero(block.stretch):
        fewest = 4 if n == 2 else 3 if i == n - 2 else 2
        if cycles[i] > fewest:
            shorter = [*cycles[:i], cycles[i] - 1, *cycles[i + 1 :]]
            assert uses(shorter, q, [ROBOT] * 3) > 1.0 - 1e-6


def test_windows_do_not_show() -> None:
    """Handed out in small blocks with look-ahead, the motion is that of one window."""
    way = wave(400, 0.02)
    at_once = recording(list(stretched(way, PANDA, T)))[0]
    blocks = list(stretched(way, PANDA, T, block=50, lookahead=100))
    assert len(blocks) > 5
    in_parts, cycles = recording(blocks)
    np.testing.assert_array_equal(in_parts[cycles], way.position)
    np.testing.assert_allclose(in_parts, at_once, rtol=0, atol=1e-9)
    recording_keeps(in_parts, PANDA)
    for one, two in itertools.pairwise(blocks):
        np.testing.assert_array_equal(one.velocity[-1], two.velocity[0])
        np.testing.assert_array_equal(one.acceleration[-1], two.acceleration[0])
        assert two.first_cycle == one.first_cycle + one.cycles.sum()


def test_windows_of_a_way_that_is_stretched() -> None:
    """Too fast everywhere, in small blocks: limits kept and way-points met across their borders."""
    way = wave(600, 0.05, amplitude=2.0)
    blocks = list(stretched(way, PANDA, T, block=40, lookahead=120))
    position, cycles = recording(blocks)
    np.testing.assert_array_equal(position[cycles], way.position)
    recording_keeps(position, PANDA)
    assert sum(int(block.stretch.sum()) for block in blocks) > 1000


@pytest.mark.parametrize("seed", range(30))
def test_wild_ways_in_windows_that_see_little(seed: int) -> None:
    """Distances and times over five decades, soft jerk, 8 way-points ahead: nothing is refused."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 120))
    q = np.cumsum(rng.normal(size=(n, 2)) * 10.0 ** rng.uniform(-5.0, 0.5, (n, 1)), axis=0)
    velocity = np.clip(rng.normal(size=(n, 2)), -2.0, 2.0)
    way = Trajectory(["a", "b"], np.cumsum(10.0 ** rng.uniform(-3.5, 0.0, n)), q, velocity)
    limits = [Limits(2.0, 4.0, 20.0 if seed % 2 else 500.0)] * 2
    block, lookahead = [(4096, 1024), (5, 8), (20, 30)][seed % 3]
    given = seed % 4 < 2
    blocks = list(stretched(way, limits, T, use_velocities=given, block=block, lookahead=lookahead))
    position, cycles = recording(blocks)
    np.testing.assert_array_equal(position[cycles], q)
    recording_keeps(position, limits)


def test_memory_does_not_grow_with_the_points() -> None:
    """Pieces are consumed as needed: never more of them alive than a window needs."""
    consumed = 0

    def pieces() -> Iterator[Trajectory]:
        nonlocal consumed
        for i in range(100):
            consumed += 1
            t = 1.0 + (np.arange(200) + 200 * i) * 0.1
            q = np.column_stack([0.3 * np.sin(0.5 * t) for _ in range(2)])
            yield Trajectory(["a", "b"], t, q)

    done = 0
    for block in stretched(pieces(), [ROBOT] * 2, T, block=500, lookahead=100):
        done += len(block)
        assert consumed * 200 - done <= 500 + 100 + 200 + 1
    assert done == 100 * 200 - 1


def test_other_cycle_times_and_units() -> None:
    """A quarter of a millisecond, and degrees: nothing depends on units."""
    way = wave(80, 0.05)
    turned = Trajectory(way.joint_names, way.time, np.degrees(way.position))
    limits = [
        Limits(*(float(np.degrees(x)) for x in (k.velocity, k.acceleration, k.jerk))) for k in PANDA
    ]
    one = list(stretched(way, PANDA, 250e-6))
    two = list(stretched(turned, limits, 250e-6))
    np.testing.assert_array_equal(one[0].cycles, two[0].cycles)
    recording_keeps(recording(one)[0], PANDA, 250e-6)


def test_what_is_refused() -> None:
    """Way-points and velocities outside the limits, pieces that do not fit, wrong options."""
    reach = Limits(1.0, 4.0, 500.0, position=(-1.0, 1.0))
    first = Trajectory(["a"], [0.0, 1.0], [[0.0], [0.5]])
    cases = [
        (Trajectory(["a"], [0.0, 1.0], [[0.0], [2.0]]), "point 1, joint a"),
        (Trajectory(["a"], [0.0, 1.0], [[0.0], [0.5]], [[0.0], [2.0]]), "point 1, joint a"),
        (iter([first, first]), "point 2.*does not follow"),
        (iter([first, Trajectory(["b"], [2.0], [[0.0]])]), "point 2: not a"),
        (iter([]), "no points"),
    ]
    for source, message in cases:
        with pytest.raises(TrajectoryError, match=message):
            list(stretched(source, [reach], T))
    for options in ({"lookahead": 2}, {"block": 0}, {"block": True}):
        with pytest.raises(InputError):
            stretched(first, [reach], T, **options)
    with pytest.raises(InputError):
        list(stretched(first, [reach, reach], T))
    with pytest.raises(InputError):
        stretched(first, [reach], 0.0)


def test_segments_are_told_one_by_one() -> None:
    """A block is a row of segments: number, way-point ahead, cycles, stretch, lengths, jerks."""
    (block,) = stretched(wave(10, 0.2), PANDA, T)
    segments = list(block)
    assert [segment.number for segment in segments] == list(range(1, 10))
    assert [segment.ahead for segment in segments] == list(range(1, 10))
    for segment in segments:
        assert segment.cycles == segment.lengths.sum()
        assert segment.jerk.shape == (4, 7)
