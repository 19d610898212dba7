"""Executors of some axes of a kernel, goals that are told at rest, texts that name joints."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.loops import enabled
from helpers.path_check import Array, keeps
from sjerk import Axis, InputError, Limits, MotionKernel, Trajectory, TrajectoryExecutor
from sjerk.executor import GoalHandle, GoalStatus, ResultCode
from sjerk.executor.goal import OPEN

T = 1e-3
LIMITS = Limits(2.0, 20.0, 500.0, position=(-3.0, 3.0))
NAMES = ["lift", "base", "elbow", "wrist", "grip"]
TIME = np.linspace(0.0, 1.0, 11)
RISE = 0.25 * (1.0 - np.cos(np.pi * TIME))


def way(*names: str, size: float = 1.0, first: float = 0.0) -> Trajectory:
    """From rest at ``first``, half a unit times the size, and rest; each joint less."""
    rows = first + size * np.outer(RISE, np.linspace(1.0, 0.5, len(names)))
    return Trajectory(names, TIME, rows)


class Cell:
    """Five axes with names in an own loop, executors of some of them."""

    def __init__(self) -> None:
        axes = [Axis(LIMITS, 1e6, "ideal", name=name) for name in NAMES]
        self.kernel, self.host = enabled(axes, T)
        self.count, self.rows = 0, [self.kernel.positions.copy()]
        self.results: list[GoalHandle] = []
        self.rested: list[GoalHandle] = []
        self.executors: list[TrajectoryExecutor] = []

    def executor(self, **options: Any) -> TrajectoryExecutor:
        made = TrajectoryExecutor(
            self.host,
            clock=lambda: self.count * T,
            on_result=self.results.append,
            on_rest=self.rested.append,
            **options,
        )
        self.executors.append(made)
        return made

    def run(self, cycles: int = 1) -> None:
        for _ in range(cycles):
            self.kernel.step()
            self.count += 1
            self.rows.append(self.kernel.positions.copy())
            if self.count % 5 == 0:
                for executor in self.executors:
                    executor.update()

    def finish(self, *goals: GoalHandle) -> None:
        for _ in range(20_000):
            if not any(goal.status in OPEN for goal in goals):
                return
            self.run()
        raise AssertionError([goal.status for goal in goals])

    @property
    def positions(self) -> Array:
        return np.array(self.rows)


# ---- some axes -----------------------------------------------------------------------------------


def test_names_are_the_axes_own_where_none_are_given() -> None:
    """Of all axes, or of some; an axis without a name is told."""
    cell = Cell()
    goal = cell.executor().submit(way(*NAMES))
    cell.finish(goal)
    assert goal.status is GoalStatus.SUCCEEDED, goal.text
    goal = cell.executor(axes=[4, 2]).submit(way("elbow", "grip", first=0.0))
    cell.finish(goal)
    assert goal.status is GoalStatus.SUCCEEDED, goal.text
    _, host = enabled([Axis(LIMITS, 1e6, "ideal", name="a"), Axis(LIMITS, 1e6, "ideal")], T)
    with pytest.raises(InputError, match="axis 1 has no name"):
        TrajectoryExecutor(host)


@settings(max_examples=8)
@given(
    chosen=st.permutations(range(5)).flatmap(
        lambda order: st.integers(1, 4).map(lambda n: order[:n])
    ),
    moment=st.integers(0, 900),
    replaced=st.booleans(),
)
def test_other_axes_are_free_for_other_use(chosen: list[int], moment: int, replaced: bool) -> None:
    """Moves of the others go on to their goals while the executor plays, pauses, is replaced."""
    cell = Cell()
    names = [f"joint {i}" for i in chosen]
    executor = cell.executor(joint_names=names, axes=chosen)
    goal = executor.submit(way(*names))
    cell.run(moment)
    others = [i for i in range(5) if i not in chosen]
    cell.host.move(dict.fromkeys(others, 0.3), synchronization="none")
    if replaced:
        goal = executor.submit(way(*names, size=0.6))
    cell.run(50)
    cell.host.halt(axes=others[0])
    cell.finish(goal)
    assert goal.status is GoalStatus.SUCCEEDED, goal.text
    cell.run(1500)
    np.testing.assert_array_equal(cell.positions[-1][others[1:]], 0.3)
    assert cell.positions[-1][others[0]] < 0.3
    keeps(cell.positions, [LIMITS] * 5)
    ends = way(*names, size=0.6 if replaced else 1.0).position[-1]
    np.testing.assert_array_equal(cell.positions[-1][chosen], ends)


def test_what_concerns_other_axes_does_not_touch_a_goal() -> None:
    """They are disabled, and out of reach of the executor's names."""
    cell = Cell()
    executor = cell.executor(axes=[1, 2])
    cell.host.disable(axes=[0, 3, 4])
    cell.run(100)
    wrong = executor.submit(way("base", "elbow", "wrist"))
    assert wrong.code is ResultCode.INVALID_JOINTS
    goal = executor.submit(way("elbow", "base"))
    cell.finish(goal)
    assert goal.status is GoalStatus.SUCCEEDED, goal.text
    idle = cell.executor(axes=[0, 1]).submit(way("lift", "base", first=0.0))
    assert (idle.code, idle.text) == (ResultCode.INVALID_GOAL, "not active: lift")


def test_two_executors_take_turns_and_a_kernel_plays_one_path() -> None:
    """A goal beside the path of other joints is refused with the reason; when that is over it runs,
    and the host's own paths count too.
    """
    cell = Cell()
    left, right = cell.executor(axes=[0, 1]), cell.executor(axes=[2, 3])
    first = left.submit(way("lift", "base"))
    cell.run(300)
    refused = right.submit(way("elbow", "wrist"))
    assert (refused.status, refused.code) == (GoalStatus.REJECTED, ResultCode.INVALID_GOAL)
    assert "one path at a time" in refused.text
    cell.run(100)
    assert first.status is GoalStatus.EXECUTING
    cell.finish(first)
    second = right.submit(way("elbow", "wrist"))
    cell.finish(second)
    assert [goal.status for goal in (first, second)] == [GoalStatus.SUCCEEDED] * 2
    one, other = left.submit(way("lift", "base", size=0.0, first=0.5)), None
    other = right.submit(way("elbow", "wrist", size=-0.5, first=0.5))
    cell.finish(one, other)
    assert one.status is GoalStatus.SUCCEEDED
    assert other.status in (GoalStatus.SUCCEEDED, GoalStatus.ABORTED)
    if other.status is GoalStatus.ABORTED:
        assert "one path at a time" in other.text
    keeps(cell.positions, [LIMITS] * 5)


def test_wrong_axes_are_refused() -> None:
    """Numbers the kernel has not, twice the same, as many names as axes."""
    cell = Cell()
    for axes in ([5], [-1], [1, 1], [], "01"):
        with pytest.raises(InputError, match="axes"):
            cell.executor(axes=axes)
    for names in (["a"], ["a", "a"], ["a", 3], "ab"):
        with pytest.raises(InputError, match="joint_names"):
            cell.executor(joint_names=names, axes=[1, 2])


# ---- at rest -------------------------------------------------------------------------------------


@settings(max_examples=10)
@given(moment=st.integers(0, 1100), how=st.sampled_from(["cancel", "reason", "replaced", "end"]))
def test_rest_is_told_once_and_only_at_rest(moment: int, how: str) -> None:
    """Canceled, aborted, replaced or reached: CANCELED at once, rest when nothing of it moves."""
    cell = Cell()
    executor = cell.executor()
    goal = executor.submit(way(*NAMES))
    cell.run(moment)
    newer = None
    if how == "cancel":
        goal.cancel()
    elif how == "reason":
        executor.close("the robot is put away")
    elif how == "replaced":
        newer = executor.submit(way(*NAMES, size=0.5))
    for _ in range(4000):
        cell.run()
        told = list(cell.rested)
        if goal in told:
            break
        assert not goal.rested
    assert goal.rested
    assert goal.status not in OPEN
    if newer is None:
        assert not cell.host.feedback().moving
    elif newer.status in OPEN:
        assert newer.status is GoalStatus.EXECUTING
    for other in filter(None, [newer]):
        cell.finish(other)
    cell.run(100)
    assert cell.rested.count(goal) == 1
    assert set(cell.rested) == set(cell.results)
    if how == "reason" and goal.status is GoalStatus.ABORTED:
        assert (goal.code, goal.text) == (ResultCode.INVALID_GOAL, "the robot is put away")
        refused = executor.submit(way(*NAMES))
        assert refused.rested
        assert "the robot is put away" in refused.text


def test_in_a_process_a_cancel_is_told_at_rest() -> None:
    """By the thread that watches: they still move when CANCELED is told, and rest at on_rest."""
    slow = Limits(2.0, 1.0, 10.0)
    moving: list[tuple[str, bool]] = []
    with MotionKernel([Axis(slow, 1e6, "ideal", name="lift")], T) as kernel, kernel.host() as host:
        host.enable()

        def told(what: str) -> Any:
            return lambda goal: moving.append((what, host.feedback().moving))

        with TrajectoryExecutor(host, on_result=told("result"), on_rest=told("rest")) as executor:
            goal = executor.submit(Trajectory(["lift"], [4.0], [[2.0]]))
            while host.feedback().axes[0].velocity < 0.4:
                time.sleep(1e-3)
            goal.cancel()
            while not goal.rested:
                time.sleep(1e-3)
    assert moving == [("result", True), ("rest", False)]


# ---- texts ---------------------------------------------------------------------------------------


def test_results_name_joints() -> None:
    """By the executor's names, whatever the axes are called."""
    cell = Cell()
    executor = cell.executor(joint_names=["left hip", "left knee"], axes=[3, 1])
    goal = executor.submit(way("left hip", "left knee"))
    cell.run(400)
    cell.host.halt()
    cell.finish(goal)
    assert goal.status is GoalStatus.ABORTED
    for text in ("joint left hip 0.", "joint left knee 0."):
        assert text in goal.text
    assert "axis" not in goal.text
    executor.close()
    assert executor.submit(way("left hip", "left knee")).text == "the executor is closed"
