"""Following without times: fast, within the limits, through points, near them, or with stops."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from helpers.following_check import (
    PANDA,
    Array,
    T,
    commanded_at,
    rationals,
    recording,
    recording_keeps,
    toppra_plan,
)
from sjerk import InputError, Limits, PlanError, follow_path, follow_stops, plan
from sjerk.trajectory.programme import Answer, Programme
from sjerk.trajectory.segments import Followed
from sjerk.trajectory.untimed import Untimed

ROBOT = Limits(velocity=2.0, acceleration=4.0, jerk=500.0)
CIRCLE = np.linspace(0.0, 2.0 * np.pi, 106)
RING = 10.0 * np.column_stack([np.cos(CIRCLE), np.sin(CIRCLE)])


def cycles(blocks: list[Followed]) -> int:
    return sum(int(block.cycles.sum()) for block in blocks)


def largest(blocks: list[Followed]) -> float:
    return max(block.passed.largest for block in blocks)


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


def whole(path: Array, limits: list[Limits], **how: Any) -> tuple[list[Followed], Array]:
    """Follow, and judge the recording: limits, both ends, every way-point in order."""
    blocks = list(follow_path(path, limits, T, **how))
    position, _ = recording(blocks)
    recording_keeps(position, limits)
    np.testing.assert_array_equal(position[[0, -1]], path[[0, -1]])
    point = np.concatenate([block.passed.point for block in blocks])
    np.testing.assert_array_equal(point, np.arange(len(path)))
    moment = np.concatenate([block.passed.moment for block in blocks])
    assert (np.diff(moment) > 0.0).all()
    told = np.concatenate([block.passed.deviation for block in blocks])
    near = 1e-9 * float(np.ptp(path, axis=0).max())
    np.testing.assert_allclose(commanded_at(blocks, moment / T) - path, told, rtol=0.0, atol=near)
    return blocks, position


def stops(path: Array, limits: list[Limits]) -> int:
    """Cycles with a stop at every point, one more each for the samples."""
    return sum(motion.cycles + 1 for motion in follow_stops(path, limits, T))


@pytest.mark.parametrize(
    ("how", "most", "near"),
    [
        ({"tolerance": 0.01 / np.sqrt(2)}, 880, 0.0071),
        ({}, 890, 1e-6),
        ({"corridor": 0.01}, 880, 0.01),
    ],
)
def test_a_circle_takes_what_turning_takes(how: dict[str, float], most: int, near: float) -> None:
    """Radius 10, chords of 0.6, (100, 1000, 10000): found by hand 930, by a free solver 860."""
    limits = [Limits(100.0, 1000.0, 10000.0)] * 2
    blocks, _ = whole(RING, limits, **how)
    assert cycles(blocks) <= most
    assert largest(blocks) <= near
    ends = np.concatenate([blocks[0].position[:1], *(block.position[1:] for block in blocks)])
    rationals(blocks, ends, limits[0], 0)


@pytest.mark.parametrize("between", [[], [1.0], [5.0], [9.0], [2.0, 3.0, 7.0]])
def test_points_on_one_line_cost_nothing(between: list[float]) -> None:
    """[0] to [10] under (3, 4, 40): what ``plan`` takes, and a per cent, whatever lies between."""
    limits = Limits(3.0, 4.0, 40.0)
    path = np.array([[0.0], *([x] for x in between), [10.0]])
    assert cycles(whole(path, [limits])[0]) <= 1.01 * plan(0.0, 10.0, limits, T).cycles


@pytest.mark.parametrize("seed", range(3))
def test_never_slower_than_stopping_and_never_slower_with_a_tolerance(seed: int) -> None:
    """Random polylines: exact, within a per cent at the points, within a per cent of the lines."""
    rng = np.random.default_rng(seed)
    joints, n = int(rng.integers(1, 4)), int(rng.integers(3, 8))
    unit = 10.0 ** rng.uniform(-3.0, 3.0)
    limits = [Limits(2.0 * unit, 4.0 * unit, 10.0 ** rng.uniform(1.0, 2.5) * unit)] * joints
    path = rng.normal(size=(n, joints)) * unit
    width = 0.01 * float(np.linalg.norm(np.ptp(path, axis=0)))
    exact, _ = whole(path, limits)
    near, _ = whole(path, limits, tolerance=0.01 * np.ptp(path, axis=0))
    inside, position = whole(path, limits, corridor=width)
    assert largest(exact) <= 1e-6 * np.ptp(path)
    assert cycles(exact) <= stops(path, limits)
    assert cycles(near) <= 1.002 * cycles(exact)
    assert cycles(inside) <= stops(path, limits)
    assert gap(position, path).max() <= width * (1 + 1e-9)


@pytest.mark.parametrize("seed", range(1))
def test_through_every_point_as_fast_as_bang_bang(seed: int) -> None:
    """The points of a TOPP-RA plan, without its times: its time, with limited jerk."""
    plan_ = toppra_plan(0.1, seed)
    blocks, _ = whole(plan_.position, PANDA)
    assert largest(blocks) <= 1e-6
    assert cycles(blocks) * T <= 1.005 * plan_.duration


def test_windows_of_random_points_with_constant_memory() -> None:
    """Many points from one stop to the next and further: every one met, across all borders."""
    path = walk(50, 2, 1.0, 1)
    blocks, _ = whole(path, PANDA[:2])
    assert len(blocks) > 1
    assert largest(blocks) <= 1e-6
    assert cycles(blocks) < 0.95 * stops(path, PANDA[:2])


def test_a_start_far_from_the_fastest_is_no_answer() -> None:
    """A closed curve whose first motion is slow: rounds that gain much do not count.

    TOPP-RA, without a limit of jerk, takes 4923 cycles; what is left after twenty rounds 6917.
    """
    rng = np.random.default_rng([20261129, 24])
    joints, n = int(rng.integers(2, 8)), int(rng.integers(30, 120))
    spans = ((-0.3, 0.7), (0.3, 1.3), (1.3, 2.8))
    limits = [Limits(*(10.0 ** rng.uniform(*span) for span in spans)) for _ in range(joints)]
    angle, path = np.linspace(0.0, 2.0 * np.pi, n), np.zeros((n, joints))
    for order in (1, 2, 3):
        wave = rng.normal(size=(2, joints)) / order**2
        path += np.outer(np.cos(order * angle), wave[0]) + np.outer(np.sin(order * angle), wave[1])
    path[-1] = path[0]
    assert cycles(whole(path, limits)[0]) <= 1.06 * 4923


def test_it_slows_down_for_what_lies_far_ahead() -> None:
    """Hundreds of short segments on one line are one long move: full speed, braking in time."""
    path = np.linspace(0.0, 20.0, 301)[:, None]
    blocks, _ = whole(path, [ROBOT], tolerance=1e-3)
    assert cycles(blocks) <= 1.02 * plan(0.0, 20.0, ROBOT, T).cycles


@pytest.mark.parametrize("width", [0.003, 0.03])
def test_a_corridor_holds_between_the_points_too(width: float) -> None:
    """Random lines in three joints: within the corridor everywhere, faster than stops."""
    path = walk(5, 3, 0.6, 2)
    blocks, position = whole(path, PANDA[:3], corridor=width)
    assert gap(position, path).max() <= width * (1 + 1e-9)
    assert cycles(blocks) < stops(path, PANDA[:3])


@pytest.mark.parametrize("limits", [(1.0, 2.0, 30.0), (2.0, 5.0, 50.0)])
def test_turning_on_a_position_limit_costs_nothing(limits: tuple[float, float, float]) -> None:
    """0, 2, 0 with limits at 0 and 2: inside in every sample, as fast as without them and 1.5 %."""
    free, held = Limits(*limits), Limits(*limits, position=(0.0, 2.0))
    path = np.array([[0.0], [2.0], [0.0]])
    blocks, position = whole(path, [held])
    assert position.max() <= 2.0 + 1e-12
    assert position.min() >= -1e-12
    assert cycles(blocks) <= 1.015 * cycles(whole(path, [free])[0])


@pytest.mark.parametrize("seed", [1, 5, 11])
@pytest.mark.parametrize("how", [{}, {"tolerance": 0.01}, {"corridor": 0.02}])
def test_ways_turn_on_their_position_limits(seed: int, how: dict[str, float]) -> None:
    """Each joint's range is that of its way-points: inside it, and faster than stopping there."""
    rng = np.random.default_rng(seed)
    path = rng.normal(size=(5, 2))
    limits = [
        Limits(*rng.uniform((1.0, 2.0, 10.0), (3.0, 8.0, 60.0)), position=(x.min(), x.max()))
        for x in path.T
    ]
    blocks, position = whole(path, limits, **how)
    assert (position >= path.min(axis=0) - 1e-9).all()
    assert (position <= path.max(axis=0) + 1e-9).all()
    assert cycles(blocks) < 0.99 * stops(path, limits)


@pytest.mark.parametrize("lost", [0, 1])
def test_where_no_motion_is_found_it_stops_and_goes_on(
    lost: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A planner that gives up from a window on: every way-point is met, with a rest at each."""
    path, plans, found = walk(50, 2, 1.0, 1), 0, Untimed.plan

    def fails(self: Untimed, window: Any) -> Any:
        nonlocal plans
        plans += 1
        if plans > lost:
            raise PlanError("nothing is found")
        return found(self, window)

    monkeypatch.setattr(Untimed, "plan", fails)
    blocks, _ = whole(path, PANDA[:2])
    assert plans > lost
    assert cycles(blocks) <= stops(path, PANDA[:2])
    for one, two in itertools.pairwise(blocks):
        assert two.first == one.first + len(one)
        assert two.first_cycle == one.first_cycle + one.cycles.sum()


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


def test_points_that_repeat_are_one() -> None:
    """Repeated points are passed once, and keep their numbers."""
    path = np.array([[0.0, 0.0], [0.5, 0.1], [0.5, 0.1], [0.0, 0.0]])
    blocks = list(follow_path(path, [ROBOT] * 2, T))
    assert np.concatenate([block.passed.point for block in blocks]).tolist() == [0, 1, 3]


def test_nothing_to_do_and_nothing_usable() -> None:
    """One point, or the same again, is no motion; what is no path is refused."""
    assert list(follow_path([[1.0]], [ROBOT], T)) == []
    assert list(follow_path([[1.0], [1.0]], [ROBOT], T)) == []
    assert list(follow_stops([[1.0], [1.0]], [ROBOT], T)) == []
    paths: list[Any] = [[1.0, 2.0], [[1.0], [np.nan]], np.empty((0, 2)), "x", None, [[1.0], [1, 2]]]
    for path in paths:
        with pytest.raises(InputError, match="points"):
            follow_path(path, [ROBOT], T)
    limits: list[Any] = [[ROBOT] * 2, "x", None, [None], [[1.0, 2.0, 3.0]]]
    for wrong in limits:
        with pytest.raises(InputError, match="limits"):
            follow_path([[0.0], [1.0]], wrong, T)
    with pytest.raises(InputError, match=r"points\[1\]\[0\]"):
        follow_path([[0.0], [2.0]], Limits(1.0, 1.0, 1.0, position=(0.0, 1.0)), T)
    options: list[dict[str, Any]] = [{"tolerance": 0.0}, {"corridor": -1.0}, {"lookahead": 0.0}]
    for how in options:
        with pytest.raises(InputError):
            follow_path([[0.0], [1.0]], [ROBOT], T, **how)


@pytest.mark.parametrize("size", [5e-324, 1e-160, 1e-14])
@pytest.mark.filterwarnings("error")
def test_ways_of_nearly_nothing(size: float) -> None:
    """Ways down to the smallest number there is are ways: no overflow, the end exact."""
    path = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, 11)))[:, None] * [size, -size]
    blocks = list(follow_path(path, [ROBOT] * 2, T))
    np.testing.assert_array_equal(blocks[-1].position[-1], path[-1])


@pytest.mark.parametrize("seed", [0, 1])
def test_a_corridor_takes_few_steps(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Convex steps of a way of three lines: a round more goes on from the motion before."""
    steps, solve = [0], Programme.solve

    def counted(self: Programme, **options: Any) -> Answer | None:
        steps[0] += 1
        return solve(self, **options)

    monkeypatch.setattr(Programme, "solve", counted)
    path = np.random.default_rng([21, seed]).normal(size=(4, 3))
    list(follow_path(path, [Limits(2.0, 10.0, 500.0)] * 3, 2e-3, corridor=0.03))
    assert steps[0] <= 125
