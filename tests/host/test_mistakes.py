"""Likely mistakes with paths, executors and goal streams: told with field, value and limit."""

from __future__ import annotations

import types
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from helpers.following_check import PANDA, T
from helpers.path_check import Bench
from sjerk import (
    GoalStream,
    InputError,
    Limits,
    RefusedError,
    StreamPlayer,
    Trajectory,
    TrajectoryExecutor,
    follow,
)
from sjerk.executor import GoalStatus, ResultCode, Settings, Tolerance

LIMITS = [Limits(2.0, 4.0, 200.0)] * 2
NAMES = ["a", "b"]
WAY = Trajectory(NAMES, [0.0, 1.0], [[0.0, 0.0], [0.2, 0.1]])


def executor_of(bench: Bench, **options: Any) -> TrajectoryExecutor:
    """One whose clock stands at 1000 s."""
    return TrajectoryExecutor(bench.host, NAMES, clock=lambda: 1000.0, **options)


def test_a_closed_executor_refuses() -> None:
    """A goal after close would be watched by nobody: REJECTED, and over."""
    bench = Bench([0.0, 0.0], LIMITS)
    with executor_of(bench) as executor:
        pass
    goal = executor.submit(WAY)
    assert goal.status is GoalStatus.REJECTED
    assert goal.result(0.0) == (ResultCode.INVALID_GOAL, "the executor is closed")


def test_axes_of_a_stream_differ() -> None:
    """As those of a path: each one of the kernel's, none twice, at least one."""
    bench = Bench([0.0, 0.0], LIMITS)
    for axes in ([0, 0], [], [2], [True]):
        with pytest.raises(InputError, match="axes"):
            StreamPlayer(bench.host, period=0.1, axes=axes)
        with pytest.raises(InputError, match="axes"):
            bench.host.follow(follow(WAY, LIMITS, T), axes=axes)


@pytest.mark.parametrize(
    ("blocks", "told"),
    [
        (WAY, r"follow\(trajectory, limits, cycle_time\) makes blocks of it"),
        (None, "must be a Followed"),
        ("x", "must be a Followed"),
        ([WAY], r"must hold what follow\(\) gives"),
    ],
)
def test_what_is_no_path(blocks: Any, told: str) -> None:
    """A trajectory that has not been planned, or anything else."""
    with pytest.raises(InputError, match=told) as error:
        Bench([0.0, 0.0], LIMITS).host.follow(blocks)
    assert error.value.field == "blocks"


MESSAGE = types.SimpleNamespace(joint_names=NAMES, points=[None], header=None)
CALLS: dict[str, tuple[str, Callable[[TrajectoryExecutor], object]]] = {
    "nothing": ("trajectory", lambda e: e.submit(None)),
    "text": ("trajectory", lambda e: e.submit("x")),
    "no points": ("trajectory.points[0]", lambda e: e.submit(MESSAGE)),
    "a number": ("path_tolerance['a']", lambda e: e.submit(WAY, path_tolerance={"a": 0.1})),  # type: ignore[dict-item]
    "none": ("goal_tolerance['a']", lambda e: e.submit(WAY, goal_tolerance={"a": None})),  # type: ignore[dict-item]
    "a list": ("path_tolerance", lambda e: e.submit(WAY, path_tolerance=[Tolerance()])),  # type: ignore[arg-type]
    "settings": ("goal_tolerance['a']", lambda e: e.change(goal_tolerance={"a": 0.1})),
    "no map": ("path_tolerance", lambda e: Settings(path_tolerance=None)),  # type: ignore[arg-type]
}


@pytest.mark.parametrize("case", CALLS)
def test_what_is_no_goal(case: str) -> None:
    """The error names the field."""
    field, call = CALLS[case]
    with pytest.raises(InputError) as error:
        call(executor_of(Bench([0.0, 0.0], LIMITS)))
    assert error.value.field == field


@pytest.mark.parametrize("names", ["ab", [1, 2], ["a", None]])
def test_joints_have_names(names: Any) -> None:
    """One str is a sequence of letters, but no list of names."""
    with pytest.raises(InputError, match="joint_names"):
        TrajectoryExecutor(Bench([0.0, 0.0], LIMITS).host, names)


def test_a_stamp_of_another_clock_is_refused() -> None:
    """An hour ahead is waited for; more is told with both numbers."""
    executor = executor_of(Bench([0.0, 0.0], LIMITS))
    assert executor.submit(WAY, stamp=1000.0 + 3600.0).accepted
    goal = executor.submit(WAY, stamp=1.7e9)
    assert goal.code is ResultCode.INVALID_GOAL
    assert "stamp 1700000000.0: " in goal.text
    assert "more than 3600" in goal.text


def test_no_goal_for_axes_that_are_to_be_disabled() -> None:
    """At once after disable, though the feedback still says that they follow."""
    bench = Bench([0.0, 0.0], LIMITS)
    bench.host.disable(axes=1)
    goal = executor_of(bench).submit(WAY)
    assert (goal.code, goal.text) == (ResultCode.INVALID_GOAL, "not active: b")


def test_a_start_elsewhere_is_told_with_axis_and_positions() -> None:
    """Of several axes the one that is furthest off."""
    bench = Bench([0.0, 0.0], LIMITS)
    way = Trajectory(["a", "b"], [0.0, 1.0], [[0.1, 0.5], [0.2, 0.6]])
    path = bench.host.follow(follow(way, LIMITS, T), axes=[1, 0])
    bench.run(path)
    with pytest.raises(RefusedError, match=r"it begins at 0\.5, the axis is at 0\.0") as error:
        path.check()
    assert error.value.axis == 0


@pytest.mark.parametrize("name", ["velocity", "acceleration", "jerk"])
def test_a_path_above_the_limits_names_the_worst(name: str) -> None:
    """Planned with other limits than the kernel's: axis, quantity, value and limit."""
    own = [LIMITS[0], replace(LIMITS[1], **{name: 0.05 * getattr(LIMITS[1], name)})]
    bench = Bench([0.0, 0.0], own)
    way = Trajectory(NAMES, [0.0, 0.5], [[0.0, 0.0], [0.1, 0.2]])
    path = bench.host.follow(follow(way, LIMITS, T))
    bench.run(path)
    with pytest.raises(RefusedError, match=f"{name} .* on the path, the axis has ") as error:
        path.check()
    assert error.value.axis == 1


def test_a_move_above_the_limits_names_the_limit() -> None:
    """The host takes limits for granted that the kernel refused: which one, both values."""
    bench = Bench([0.0, 0.0], LIMITS)
    bench.host.link.limits[1] = replace(LIMITS[1], jerk=300.0)
    move = bench.host.move([0.1, 0.1])
    bench.kernel.step(2)
    with pytest.raises(RefusedError, match="jerk 300, it has 200") as error:
        move.check()
    assert error.value.axis == 1


def test_goals_of_a_stream_are_numbers_and_not_of_another_clock() -> None:
    """A time more than 100 periods beyond the newest goal; after an idle while, beyond that."""
    bench = Bench([0.0, 0.0], LIMITS)
    player = StreamPlayer(bench.host, period=0.1)
    for goal in ("x", None, [[1.0], 2.0]):
        with pytest.raises(InputError, match="position"):
            player.push(goal)  # type: ignore[arg-type]
    stream = GoalStream(LIMITS, T, [0.0, 0.0], period=0.1)
    stream.push([0.0, 0.0], 1.7e9)
    with pytest.raises(
        InputError, match=r"time = 3000000000.0: must be at most 1700000010.0: 100 periods"
    ):
        stream.push([0.01, 0.0], 3e9)
    stream.push([0.01, 0.0], 1.7e9 + 9.9)
    stream.take(60_000)
    stream.push([0.0, 0.0], 1.7e9 + 60.0)


def test_rest_without_goals_is_one_piece() -> None:
    """Ten million cycles of it, too; and more than can be counted is refused."""
    stream = GoalStream(PANDA, T, np.zeros(7), period=0.01)
    (rest,) = stream.take(10**7)
    assert (len(rest), stream.cycle) == (1, 10**7)
    with pytest.raises(InputError, match="cycle"):
        stream.take(10**30)
