"""Following with the given times: own time where the limits allow, as little more else."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.following_check import (
    PANDA,
    SHAPES,
    Array,
    T,
    commanded_at,
    rationals,
    recording,
    recording_keeps,
    toppra_plan,
    wave,
)
from sjerk import (
    InputError,
    Limits,
    Trajectory,
    TrajectoryError,
    follow,
    follow_stops,
    plan,
)
from sjerk.trajectory import shipped_recording
from sjerk.trajectory.segments import Followed, Knot

ROBOT = Limits(velocity=2.0, acceleration=4.0, jerk=500.0)


def whole(
    way: Trajectory, limits: list[Limits], cycle_time: float = T, **how: Any
) -> list[Followed]:
    """Follow, and hold the recording against the way-points, their times and the limits."""
    blocks = list(follow(way, limits, cycle_time, **how))
    position, _ = recording(blocks)
    recording_keeps(position, limits, cycle_time)
    np.testing.assert_array_equal(position[-1], way.position[-1])
    point = np.concatenate([block.passed.point for block in blocks])
    moment = np.concatenate([block.passed.moment for block in blocks]) / cycle_time
    deviation = np.concatenate([block.passed.deviation for block in blocks])
    np.testing.assert_array_equal(point, np.arange(len(way)))
    # never faster than asked, from way-point to way-point; what is told is what is commanded
    assert (np.diff(moment) >= np.diff(way.time) / cycle_time * (1 - 1e-6) - 1e-6).all()
    scale = np.abs(position).max() + np.ptp(position)
    told = commanded_at(blocks, moment) - way.position
    np.testing.assert_allclose(told, deviation, rtol=0, atol=1e-12 * scale + 1e-15)
    stretch = sum(int(block.stretch.sum()) for block in blocks)
    asked = (way.time[-1] - way.time[0]) / cycle_time
    assert abs(len(position) - 1 - asked - stretch) <= 1.0 + 1e-6
    return blocks


def cycles(blocks: list[Followed]) -> int:
    return sum(int(block.cycles.sum()) for block in blocks)


def ends(blocks: list[Followed]) -> Array:
    return np.concatenate([blocks[0].position[:1], *(block.position[1:] for block in blocks)])


def largest(blocks: list[Followed]) -> float:
    return max(block.passed.largest for block in blocks)


def quintic(duration: float, period: float, way: float = 1.0) -> Trajectory:
    x = np.append(np.arange(0.0, 1.0 - period / duration / 2, period / duration), 1.0)
    return Trajectory(["a"], x * duration, way * (10 * x**3 - 15 * x**4 + 6 * x**5)[:, None])


@pytest.mark.parametrize("period", [0.001, 0.002, 0.003, 0.0033, 0.01, 0.1, 0.5])
@pytest.mark.parametrize("velocities", [True, False])
def test_a_motion_within_the_limits_is_played_in_its_own_time(
    period: float, velocities: bool
) -> None:
    """For any sampling, whole cycles or not, with or without velocities: within the tolerance."""
    way = wave(round(8.0 / period) + 1, period, 2)
    if velocities:
        speed = np.gradient(way.position, way.time, axis=0)
        speed[[0, -1]] = 0.0
        way = Trajectory(way.joint_names, way.time, way.position, speed)
    blocks = whole(way, PANDA[:2])
    assert cycles(blocks) == int(np.ceil(way.duration / T - 1e-6))
    assert largest(blocks) <= 1.1e-4
    if period >= 0.1:
        assert largest(blocks) <= 1e-8


@pytest.mark.parametrize("dt", [0.001, 0.002, 0.005, 0.01, 0.0137, 0.02, 0.05, 0.1])
@pytest.mark.parametrize("pace", [1.0, 1.1])
@pytest.mark.parametrize("velocities", [False, True])
def test_a_time_optimal_motion_takes_its_own_time(dt: float, pace: float, velocities: bool) -> None:
    """Ruckig's motion at all of its limits, sampled: its own time, two cycles for the samples."""
    ruckig = pytest.importorskip("ruckig")
    otg, inp, made = ruckig.Ruckig(1), ruckig.InputParameter(1), ruckig.Trajectory(1)
    inp.current_position, inp.target_position = [0.0], [1.0]
    inp.max_velocity, inp.max_acceleration, inp.max_jerk = [2.0], [5.0], [50.0]
    otg.calculate(inp, made)
    t = np.append(np.arange(0.0, made.duration - dt / 2, dt), made.duration)
    q, v = (np.array([made.at_time(float(x))[k] for x in t]) for k in (0, 1))
    v[[0, -1]] = 0.0
    way = Trajectory(["a"], t * pace, q, v / pace if velocities else None)
    blocks = whole(way, [Limits(2.0, 5.0, 50.0)])
    assert cycles(blocks) <= np.ceil(made.duration * pace / T - 1e-6) + (2 if pace == 1.0 else 0)
    assert largest(blocks) <= 1e-4


@pytest.mark.parametrize(
    ("share", "asked", "period"),
    [(0.98, 1.0, 0.0033), (0.98, 1.0, 0.0137), (0.98, 1.0007, 0.0033), (1.01, 1.2, 0.005)],
)
def test_a_quintic_that_is_slow_enough_takes_the_time_that_is_asked(
    share: float, asked: float, period: float
) -> None:
    """2 % below its limit of acceleration, at no whole cycles; 1 % above it, asked 1.2 slower."""
    blocks = whole(quintic(asked, period), [Limits(3.0, 5.7735 / share, 500.0)])
    assert cycles(blocks) == np.ceil(asked / T - 1e-6)


@pytest.mark.parametrize(
    ("limits", "least"),
    [
        (Limits(3.0, 5.7735 / 1.01, 500.0), 1001),
        (Limits(3.0, 5.7735 / 1.05, 500.0), 1003),
        (Limits(3.0, 5.7735 / 1.30, 500.0), 1046),
        (Limits(1.875 / 1.05, 8.0, 500.0), 1006),
        (Limits(1.875 / 1.30, 8.0, 500.0), 1070),
        (Limits(3.0, 8.0, 60.0 / 1.05), 1001),
    ],
)
def test_a_quintic_that_asks_too_much_is_stretched_where_it_does(
    limits: Limits, least: int
) -> None:
    """The optimum of an independent solver (scaled too: 1.0001, 1.0024, 1.0454, ...) + 0.5 %."""
    blocks = whole(quintic(1.0, 0.005), [limits])
    assert cycles(blocks) <= 1.005 * least


@pytest.mark.parametrize("seed", range(1))
def test_asking_for_less_never_takes_longer(seed: int) -> None:
    """The same way-points at five paces, most of them too fast."""
    rng = np.random.default_rng(seed)
    q = np.cumsum(rng.normal(size=(7, 2)) * 0.3, axis=0)
    t = np.concatenate([[0.0], np.cumsum(rng.uniform(0.1, 0.6, 6))])
    taken = [
        cycles(whole(Trajectory(["a", "b"], t * pace, q), [ROBOT] * 2))
        for pace in (3.0, 1.2, 1.0, 0.9, 0.5)
    ]
    assert (
        taken == sorted(taken, reverse=True)
        or max(b / a for a, b in itertools.pairwise(taken)) <= 1.005
    )


def test_the_shipped_plan_takes_half_a_percent_longer() -> None:
    """TOPP-RA's bang-bang plan under Franka's limits, jerk limited."""
    way = Trajectory.from_bag(shipped_recording())
    blocks = whole(way, PANDA)
    assert cycles(blocks) * T <= 1.005 * way.duration
    for joint in (0, 3):
        rationals(blocks, ends(blocks), PANDA[joint], joint)


def test_noise_is_told_and_not_paid_with_time() -> None:
    """Way-points quantised to 1e-3 rad, tolerance 1e-6: own time, the deviation is told."""
    way = wave(2001, 0.002, 1)
    rough = Trajectory(way.joint_names, way.time, np.round(way.position, 3))
    blocks = whole(rough, PANDA[:1], tolerance=1e-6)
    assert cycles(blocks) <= 1.02 * way.duration / T
    assert largest(blocks) <= 2e-3


def test_more_way_points_than_knots_can_meet_are_told() -> None:
    """A position in every cycle with a corner in it: near all, in time; to turn takes v^2 / 2a."""
    t = np.arange(1001) * T
    q = np.minimum(t, 1.0 - t)[:, None] * 0.2
    blocks = whole(Trajectory(["a"], t, q), [ROBOT], tolerance=1e-9)
    assert largest(blocks) < 1.3 * 0.2**2 / (2 * ROBOT.acceleration)


@pytest.mark.parametrize("seed", range(1))
def test_steps_over_decades_are_met_from_stop_to_stop_or_faster(seed: int) -> None:
    """Way-points far closer here than there, asked for far too fast: near, never a slow crawl."""
    rng = np.random.default_rng(seed)
    step = rng.normal(size=(16, 2)) * 10.0 ** rng.uniform(-4.0, 0.0, (16, 1))
    q = np.concatenate([np.zeros((1, 2)), np.cumsum(step, axis=0)])
    limits = [Limits(2.0, 4.0, 500.0), Limits(0.5, 20.0, 100.0)]
    t = np.concatenate([[0.0], np.cumsum(10.0 ** rng.uniform(-2.5, -1.0, 16))])
    blocks = whole(Trajectory(["a", "b"], t, q), limits)
    deviation = np.abs(np.concatenate([block.passed.deviation for block in blocks]))
    assert (deviation <= 1.001e-3 * np.ptp(q, axis=0)).all()
    gaps = np.maximum([motion.cycles for motion in follow_stops(q, limits, T)], np.diff(t) / T)
    assert cycles(blocks) <= gaps.sum() + 2


def test_given_velocities_are_near() -> None:
    """Way-points far apart with velocities: these are had within some per cent."""
    t = np.arange(0.0, 4.05, 0.5)
    q = np.column_stack([0.2 * (1 - np.cos(np.pi * t)), 0.1 * np.sin(np.pi * t / 2) ** 2])
    v = np.column_stack([0.2 * np.pi * np.sin(np.pi * t), 0.05 * np.pi * np.sin(np.pi * t)])
    v[[0, -1]] = 0.0
    blocks = whole(Trajectory(["a", "b"], t, q, v), [ROBOT] * 2)
    assert largest(blocks) <= 1e-7
    position, _ = recording(blocks)
    at = np.rint(t[1:-1] / T).astype(int)
    had = (position[at + 1] - position[at - 1]) / (2 * T)
    assert np.abs(had - v[1:-1]).max() <= 0.05 * np.abs(v).max()


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("period", [0.0004, 0.1, 1.0])
def test_ways_that_reverse_repeat_and_coincide(shape: str, period: float) -> None:
    """Met, within the limits, in rationals, at any spacing: below a cycle, too fast, ample."""
    q = np.array(SHAPES[shape])[:, None] * [1.0, -0.5]
    way = Trajectory(["a", "b"], period * np.arange(len(q)), q)
    blocks = whole(way, [ROBOT] * 2)
    # closer than a cycle the same place cannot be passed again and again but at rest
    assert largest(blocks) <= (2e-4 if period > T else ROBOT.velocity * T)
    rationals(blocks, ends(blocks), ROBOT, 1)


@settings(max_examples=6, deadline=None)
@given(
    st.lists(
        st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(1e-3, 0.2)),
        min_size=2,
        max_size=6,
    ),
    st.sampled_from([1e-3, 1.0, 1e3]),
    st.sampled_from([-1.0, 1.0]),
)
def test_random_ways(rows: list[tuple[float, float, float]], unit: float, sign: float) -> None:
    """Any way-points at any times, in any unit and direction: within the limits, the end exact."""
    table = np.array(rows)
    q, time = table[:, :2] * unit * sign, np.cumsum(table[:, 2])
    limits = Limits(2.0 * unit, 4.0 * unit, 500.0 * unit)
    blocks = whole(Trajectory(["a", "b"], time, q), [limits] * 2)
    rationals(blocks, ends(blocks), limits, 0)


def test_one_way_point_takes_what_plan_takes() -> None:
    """From rest to rest with no time given up: the planner's own cycles, and half a per cent."""
    way = Trajectory(["a"], [0.0, 0.001], [[0.0], [1.0]])
    best = plan(0.0, 1.0, ROBOT, T).cycles
    assert cycles(whole(way, [ROBOT])) <= 1.006 * best + 2


def test_windows_do_not_show() -> None:
    """Handed out window by window, the motion is in its own time, and each block goes on."""
    way = wave(4001, 0.1, 2)
    blocks = whole(way, PANDA[:2])
    assert len(blocks) >= 2
    assert cycles(blocks) == 400_000
    assert largest(blocks) <= 1e-6
    for one, two in itertools.pairwise(blocks):
        np.testing.assert_array_equal(one.position[-1], two.position[0])
        np.testing.assert_array_equal(one.velocity[-1], two.velocity[0])
        np.testing.assert_array_equal(one.acceleration[-1], two.acceleration[0])
        assert two.first_cycle == one.first_cycle + one.cycles.sum()
        assert two.first == one.first + len(one)


def test_windows_of_a_way_that_is_stretched() -> None:
    """Too fast everywhere, over many windows: limits kept across their borders."""
    way = wave(61, 0.2, 2, amplitude=1.5)
    blocks = whole(way, PANDA[:2], lookahead=2.0)
    assert len(blocks) > 1
    assert sum(int(block.stretch.sum()) for block in blocks) > 100


@pytest.mark.parametrize("limits", [(1.0, 2.0, 30.0), (2.0, 5.0, 50.0)])
@pytest.mark.parametrize("turn", [[1.95, 2.0, 1.95], [2.0]])
def test_position_limits_hold_between_way_points_too(
    turn: list[float], limits: tuple[float, float, float]
) -> None:
    """A turn on a limit, where a smooth curve overshoots its sparse way-points; in its time."""
    time = [0.0, 2.0, 3.0, 4.0, 6.0] if len(turn) > 1 else [0.0, 3.0, 6.0]
    way = Trajectory(["a"], time, np.array([[0.0, *turn, 0.0]]).T)
    reach = Limits(*limits, position=(0.0, 2.0))
    blocks = whole(way, [reach])
    position, _ = recording(blocks)
    assert position.max() <= 2.0 + 1e-12
    assert position.min() >= -1e-12
    if limits == (2.0, 5.0, 50.0) or len(turn) == 1:
        assert cycles(blocks) == 6000
    free, _ = recording(whole(way, [Limits(*limits)]))
    assert (free.max() > 2.05) == (len(turn) > 1)


def test_memory_does_not_grow_with_the_points() -> None:
    """Pieces are consumed as needed: never more of them alive than a window needs."""
    consumed = 0

    def pieces() -> Iterator[Trajectory]:
        nonlocal consumed
        for i in range(120):
            consumed += 1
            t = 1.0 + (np.arange(40) + 40 * i) * 0.1
            ease = np.minimum(1.0, np.minimum(t - 1.0, 481.0 - t) / 4.0) ** 3
            q = np.column_stack([ease * 0.3 * np.sin(0.5 * t) for _ in range(2)])
            yield Trajectory(["a", "b"], t, q)

    done = 0
    for block in follow(pieces(), [ROBOT] * 2, T):
        done += len(block.passed.point)
        assert consumed * 40 - done <= 2 * 1024 + 2 * 40
    assert done == 120 * 40


def test_in_motion_from_any_state_of_another() -> None:
    """Begun in motion, the state goes on: the limits hold across the border."""
    (before,) = follow(quintic(1.0, 0.1), [ROBOT], T)
    i = int(np.searchsorted(np.cumsum(before.cycles), 400))
    knot = Knot.of(before, i)
    end = float(knot.position[0]) + 1.0
    way = Trajectory(["a"], [0.0, 1.5, 3.0], [knot.position, [end], [end + 0.2]])
    blocks = list(follow(way, [ROBOT], T, begin=knot))
    head = before.sample().position[: int(np.cumsum(before.cycles)[i - 1]) + 1]
    rest = np.concatenate([block.sample().position for block in blocks])
    recording_keeps(np.concatenate([head, rest[1:]]), [ROBOT])
    assert largest(blocks) <= 1e-4


def test_other_cycle_times_and_units() -> None:
    """A quarter of a millisecond, and degrees: nothing depends on units."""
    way = wave(80, 0.05, 2)
    turned = Trajectory(way.joint_names, way.time, np.degrees(way.position))
    limits = [
        Limits(*(float(np.degrees(x)) for x in (k.velocity, k.acceleration, k.jerk)))
        for k in PANDA[:2]
    ]
    one = list(follow(way, PANDA[:2], 250e-6))
    two = list(follow(turned, limits, 250e-6))
    np.testing.assert_array_equal(one[0].cycles, two[0].cycles)
    recording_keeps(recording(one)[0], PANDA[:2], 250e-6)


def test_one_limits_is_that_of_every_joint() -> None:
    """One ``Limits`` where a list is expected is taken for all joints."""
    way = wave(40, 0.1, 2)
    one, all_ = (list(follow(way, limits, T)) for limits in (ROBOT, [ROBOT, ROBOT]))
    np.testing.assert_array_equal(one[0].jerk, all_[0].jerk)


def test_what_is_refused() -> None:
    """Way-points and velocities outside the limits, pieces that do not fit, wrong options."""
    reach = Limits(1.0, 4.0, 500.0, position=(-1.0, 1.0))
    first = Trajectory(["a"], [0.0, 1.0], [[0.0], [0.5]])
    cases: list[tuple[Any, str]] = [
        (Trajectory(["a"], [0.0, 1.0], [[0.0], [2.0]]), "point 1, joint a"),
        (
            Trajectory(["a"], [0.0, 1.0, 2.0], [[0.0], [0.5], [0.6]], [[0.0], [2.0], [0.0]]),
            "point 1",
        ),
        (
            Trajectory(["a"], [0.0, 1.0], [[0.0], [0.5]], [[0.3], [0.0]]),
            "velocity = 0.3 at the start",
        ),
        (
            Trajectory(["a"], [0.0, 1.0], [[0.0], [0.5]], [[0.0], [0.3]]),
            "velocity = 0.3 at the end",
        ),
        (iter([first, first]), "point 2.*does not follow"),
        (iter([first, Trajectory(["b"], [2.0], [[0.0]])]), "point 2: not a"),
        (iter([]), "no points"),
    ]
    for source, message in cases:
        with pytest.raises(TrajectoryError, match=message):
            list(follow(source, [reach], T))
    for options in (
        {"lookahead": 0.0},
        {"tolerance": 0.0},
        {"tolerance": "x"},
        {"tolerance": [1, 1]},
    ):
        with pytest.raises(InputError):
            list(follow(first, [reach], T, **options))  # type: ignore[arg-type]
    for limits in ([reach, reach], "x", None, [[1.0, 2.0, 3.0]], [None], 3):
        with pytest.raises(InputError, match="limits"):
            list(follow(first, limits, T))  # type: ignore[arg-type]
    with pytest.raises(InputError):
        follow(first, [reach], 0.0)


def test_segments_are_told_one_by_one() -> None:
    """A block is a row of segments with number, way-point ahead, cycles, lengths and jerks."""
    (block,) = follow(wave(10, 0.2), PANDA, T)
    segments = list(block)
    assert [segment.number for segment in segments] == list(range(1, len(block) + 1))
    assert segments[0].ahead == 1
    assert segments[-1].ahead == 9
    for segment in segments:
        assert segment.cycles == segment.lengths.sum()
        assert segment.jerk.shape == (4, 7)


@pytest.mark.parametrize("seed", range(1))
def test_plans_of_the_panda_at_any_sampling(seed: int) -> None:
    """TOPP-RA at 0.1 s and at 8 ms within 1e-3 rad: half a per cent over its bang-bang time."""
    for period in (0.1, 0.008):
        way = toppra_plan(period, seed)
        bare = Trajectory(way.joint_names, way.time, way.position)
        blocks = whole(bare, PANDA, tolerance=1e-3)
        assert cycles(blocks) * T <= 1.01 * way.duration
        assert largest(blocks) <= 1.001e-3


def test_what_is_wrong_later_is_told_at_rest() -> None:
    """A piece that does not fit, found in motion: what is handed out before ends at rest."""
    t = np.arange(2000) * 0.1
    q = 0.3 * (np.minimum(1.0, t / 4.0) ** 3 * np.sin(0.5 * t))[:, None]
    pieces = [Trajectory(["a"], t, q), Trajectory(["b"], [250.0], [[0.0]])]
    blocks: list[Followed] = []
    with pytest.raises(TrajectoryError, match="point 2000: not a"):
        blocks.extend(follow(iter(pieces), [ROBOT], T))
    assert len(blocks) > 1
    assert not blocks[-1].velocity[-1].any()
    assert not blocks[-1].acceleration[-1].any()
    recording_keeps(recording(blocks)[0], [ROBOT])
