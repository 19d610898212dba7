"""Goals between an action server and the executor, with messages that have the fields of ROS."""

from __future__ import annotations

from types import SimpleNamespace as Message
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as profile
from hypothesis import strategies as st

from sjerk import Axis, Host, Limits, MotionKernel
from sjerk.executor import GoalHandle, GoalStatus, ResultCode, Settings
from sjerk.ports.ros.desk import Desk, Refusal
from sjerk.ports.ros.joints import Joints

NAMES = ("shoulder", "elbow")


def stamped(sec: int = 0, nanosec: int = 0) -> Message:
    """A Time or a Duration."""
    return Message(sec=sec, nanosec=nanosec)


def trajectory(names: Any, rows: Any, times: Any) -> Message:
    """A JointTrajectory."""
    points = [
        Message(
            positions=row,
            velocities=[],
            accelerations=[],
            time_from_start=stamped(int(t), round((t - int(t)) * 1e9)),
        )
        for row, t in zip(rows, times, strict=True)
    ]
    return Message(header=Message(stamp=stamped()), joint_names=list(names), points=points)


def goal(way: Message, **options: Any) -> Message:
    """A goal of FollowJointTrajectory."""
    given_ = {
        "multi_dof_trajectory": Message(points=[]),
        "path_tolerance": [],
        "goal_tolerance": [],
        "goal_time_tolerance": stamped(),
    }
    return Message(trajectory=way, **(given_ | options))


class Bench:
    """A kernel in steps, its host, and a desk whose clock is the kernel's."""

    def __init__(self) -> None:
        axes = [
            Axis(Limits(90.0, 500.0, 5000.0), 1e5, "ideal", unit="deg"),
            Axis(Limits(2.0, 20.0, 500.0), 1e6, "ideal", unit="rad"),
        ]
        self.kernel = MotionKernel(axes)
        self.host: Host = self.kernel.host()
        self.host.enable()
        self.kernel.step(5)
        self.woken = 0
        self.desk = Desk(
            self.host,
            Joints.of(NAMES, ["deg", "rad"]),
            settings=Settings(),
            feedback_rate=20.0,
            clock=lambda: 1000.0 + 1e-3 * self.host.feedback().cycle,
            wake=self._wake,
        )

    def _wake(self) -> None:
        self.woken += 1

    def run(self, cycles: int) -> None:
        """Cycles of the kernel, looks of the executor between them."""
        for _ in range(cycles // 10):
            self.desk.update()
            self.kernel.step(10)
        self.desk.update()


@pytest.fixture
def bench() -> Bench:
    """Its own for each test."""
    return Bench()


def test_a_goal_in_radians_moves_an_axis_in_degrees(bench: Bench) -> None:
    """In any order of joints; its end is told once."""
    handle = bench.desk.submit(goal(trajectory(NAMES[::-1], [[0.3, np.pi / 6]], [1.0])))
    assert isinstance(handle, GoalHandle)
    bench.run(1500)
    assert bench.woken == 1
    assert bench.desk.ended() == [handle]
    assert bench.desk.ended() == []
    assert handle.status is GoalStatus.SUCCEEDED
    axes = bench.host.feedback().axes
    assert axes[0].position == pytest.approx(30.0)
    assert axes[1].position == 0.3


def test_a_canceled_goal_is_told_at_rest_or_at_once(bench: Bench) -> None:
    """Never CANCELED while it moves, unless that is asked for."""
    handle = bench.desk.submit(goal(trajectory(NAMES, [[0.0, 1.0]], [1.0])))
    assert isinstance(handle, GoalHandle)
    bench.run(500)
    handle.cancel()
    assert bench.host.feedback().moving
    assert bench.desk.ended(at_rest=True) == []
    while bench.host.feedback().moving:
        assert bench.desk.ended(at_rest=True) == []
        bench.run(10)
    assert bench.desk.ended(at_rest=True) == [handle]
    again = bench.desk.submit(goal(trajectory(NAMES, [[0.0, -1.0]], [1.0])))
    assert isinstance(again, GoalHandle)
    bench.run(500)
    again.cancel()
    assert bench.desk.ended(at_rest=False) == [again]


def test_the_newest_goal_replaces_and_each_is_told(bench: Bench) -> None:
    """ABORTED with the number of the newer one."""
    first = bench.desk.submit(goal(trajectory(NAMES, [[0.0, 1.0]], [1.0])))
    bench.run(300)
    second = bench.desk.submit(goal(trajectory(NAMES, [[0.0, 0.5]], [1.0])))
    bench.run(4000)
    assert bench.desk.ended() == [first, second]
    assert isinstance(first, GoalHandle)
    assert isinstance(second, GoalHandle)
    assert (first.status, first.code) == (GoalStatus.ABORTED, ResultCode.INVALID_GOAL)
    assert "replaced" in first.text
    assert second.status is GoalStatus.SUCCEEDED


def test_closing_tells_the_reason(bench: Bench) -> None:
    """As ABORTED, and refuses what comes after."""
    handle = bench.desk.submit(goal(trajectory(NAMES, [[0.0, 1.0]], [1.0])))
    assert isinstance(handle, GoalHandle)
    bench.run(300)
    bench.desk.close("deactivated")
    assert (handle.status, handle.code) == (GoalStatus.ABORTED, ResultCode.INVALID_GOAL)
    assert "deactivated" in handle.text
    assert isinstance(bench.desk.submit(goal(trajectory(NAMES, [[0.0, 1.0]], [1.0]))), Refusal)


def test_tolerances_are_taken_in_the_units_of_ros(bench: Bench) -> None:
    """One of pi rad is 180 degrees: a following error of some degrees is within it; -1 stays -1."""
    rows = [Message(name="shoulder", position=np.pi, velocity=-1.0)]
    way = trajectory(NAMES, [[0.5, 0.0]], [1.0])
    handle = bench.desk.submit(goal(way, path_tolerance=rows))
    bench.run(1500)
    assert isinstance(handle, GoalHandle)
    assert handle.status is GoalStatus.SUCCEEDED


WRONG = {
    "no points": (goal(trajectory(NAMES, [], [])), -1),
    "an unknown joint": (goal(trajectory(["wrist", "elbow"], [[0.0, 0.1]], [1.0])), -2),
    "a joint twice": (goal(trajectory(["elbow", "elbow"], [[0.0, 0.1]], [1.0])), -2),
    "a joint missing": (goal(trajectory(["elbow"], [[0.1]], [1.0])), -2),
    "not a number": (goal(trajectory(NAMES, [[0.0, np.nan]], [1.0])), -1),
    "a size": (goal(trajectory(NAMES, [[0.0]], [1.0])), -1),
    "times that fall": (goal(trajectory(NAMES, [[0, 0.1], [0, 0.2]], [1.0, 0.5])), -1),
    "a tolerance of no joint": (
        goal(
            trajectory(NAMES, [[0.0, 0.1]], [1.0]),
            path_tolerance=[Message(name="wrist", position=1.0, velocity=0.0)],
        ),
        None,
    ),
    "a tolerance twice": (
        goal(
            trajectory(NAMES, [[0.0, 0.1]], [1.0]),
            goal_tolerance=[Message(name="elbow", position=1.0, velocity=0.0)] * 2,
        ),
        -1,
    ),
    "a negative tolerance": (
        goal(
            trajectory(NAMES, [[0.0, 0.1]], [1.0]),
            goal_tolerance=[Message(name="elbow", position=-2.0, velocity=0.0)],
        ),
        -1,
    ),
    "joints of several degrees": (
        goal(
            trajectory(NAMES, [[0.0, 0.1]], [1.0]), multi_dof_trajectory=Message(points=[Message()])
        ),
        -1,
    ),
    "no message at all": (object(), -1),
}


@pytest.mark.parametrize("what", WRONG)
def test_a_wrong_goal_is_refused_with_a_text_and_what_moves_goes_on(
    bench: Bench, what: str
) -> None:
    """By the codes of FollowJointTrajectory."""
    running = bench.desk.submit(goal(trajectory(NAMES, [[0.0, 1.0]], [1.0])))
    assert isinstance(running, GoalHandle)
    bench.run(300)
    message, code = WRONG[what]
    answer = bench.desk.submit(message)
    assert isinstance(answer, Refusal)
    assert answer.text
    assert code is None or answer.code == code
    bench.run(1500)
    assert running.status is GoalStatus.SUCCEEDED


@profile(max_examples=60)
@given(
    names=st.lists(st.sampled_from([*NAMES, "wrist", ""]), max_size=3),
    rows=st.lists(st.lists(st.floats(), max_size=3), max_size=3),
    nanoseconds=st.integers(-(2**31), 2**31 - 1),
    width=st.floats(),
)
def test_whatever_comes_is_answered(
    names: list[str], rows: list[list[float]], nanoseconds: int, width: float
) -> None:
    """Fields of any size with any number: a handle or a refusal, never an exception."""
    bench = Bench()
    way = trajectory(names, rows, [0.1 * (k + 1) for k in range(len(rows))])
    for point in way.points:
        point.time_from_start = stamped(0, nanoseconds)
    tolerance = [Message(name="elbow", position=width, velocity=width)]
    answer = bench.desk.submit(goal(way, path_tolerance=tolerance))
    assert isinstance(answer, GoalHandle | Refusal)
