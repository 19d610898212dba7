"""Continuous joints of ROS, without ROS: joints of axes that wrap, goals in any turn."""

from __future__ import annotations

import math
from types import SimpleNamespace as Message
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.loops import enabled
from sjerk import Axis, Limits
from sjerk.executor import GoalHandle, GoalStatus, Settings
from sjerk.ports.ros.desk import Desk
from sjerk.ports.ros.following import Following
from sjerk.ports.ros.joints import UNITS, Joints
from sjerk.ports.ros.messages import Rows
from sjerk.ports.ros.parameters import CONTROL, CONTROLLER
from sjerk.ports.ros.topic import TopicMotion

T = 2e-3
NAMES = ("wheel", "arm")
TURN = 2.0 * math.pi


class Bench:
    """A continuous joint so many turns from 0 in some unit, and a joint that has none."""

    def __init__(self, unit: str, turn: float) -> None:
        size = UNITS[unit] * TURN
        axes = [
            Axis(
                Limits(size, 8.0 * size, 200.0 * size),
                2.0**12 / size,
                "ideal",
                unit=unit,
                wrap=size,
                start=turn * size,
            ),
            Axis(Limits(4.0, 40.0, 1000.0), 1e6, "ideal", unit="rad"),
        ]
        self.kernel, self.host = enabled(axes, T)
        self.joints = Joints.of(NAMES, [unit, "rad"])
        self.now = 0.0
        self.turn: Any = lambda now: None

    def step(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.01)):
            self.kernel.step(5)
            self.now += 0.01
            self.turn(self.now)

    @property
    def position(self) -> np.ndarray:
        """Radians, as joint states tell them."""
        return Rows.of(self.host.feedback(), self.joints).command_position


def values(known: Any, **changed: Any) -> Any:
    """Of parameters."""
    return ({parameter.name: parameter.default for parameter in known} | changed).__getitem__


def message(times: Any, rows: Any) -> Message:
    """A JointTrajectory without velocities."""

    def stamp(t: float) -> Message:
        return Message(sec=int(t), nanosec=round((t - int(t)) * 1e9))

    points = [
        Message(positions=list(r), velocities=[], accelerations=[], time_from_start=stamp(t))
        for t, r in zip(times, rows, strict=True)
    ]
    return Message(header=Message(stamp=stamp(0.0)), joint_names=list(NAMES), points=points)


continuous = st.tuples(
    st.sampled_from(["deg", "rad", "rev"]), st.integers(-10_000, 10_000), st.floats(-0.45, 0.45)
)


def ends(bench: Bench, turn: int, goal: float) -> None:
    """The joint has come to the goal by its own turns: one way round and no other."""
    assert bench.position[0] == pytest.approx(turn * TURN + goal, abs=1e-11)
    assert not bench.host.feedback().moving


@settings(max_examples=5)
@given(continuous, st.floats(-12.0, 12.0))
def test_a_goal_of_an_action_turns_as_often_as_it_says(
    joint: tuple[str, int, float], way: float
) -> None:
    """Written about 0 while the joint is many turns on; its feedback is told about 0, too."""
    unit, turn, off = joint
    bench = Bench(unit, turn + off)
    desk = Desk(
        bench.host,
        bench.joints,
        settings=Settings(start_tolerance=0.46 * UNITS[unit] * TURN + 1e-3),
        feedback_rate=1e3,
        clock=lambda: bench.now,
        wake=lambda: None,
    )
    bench.turn = lambda now: desk.update()
    shares = 0.5 - 0.5 * np.cos(np.pi * np.linspace(0.0, 1.0, 9))
    goal = desk.submit(message(np.linspace(0.0, 4.0, 9), np.outer(shares, [way, 0.5])))
    assert isinstance(goal, GoalHandle), goal
    bench.step(5.5)
    assert goal.status is GoalStatus.SUCCEEDED
    ends(bench, turn, way)
    assert goal.feedback is not None
    told = bench.joints.to_ros(goal.feedback.desired)
    assert told == pytest.approx([way, 0.5], abs=1e-11)


@pytest.mark.parametrize("mode", ["interrupt", "stream", "track"])
@settings(max_examples=2)
@given(continuous, st.floats(-9.0, 9.0))
def test_joint_states_as_goals(mode: str, joint: tuple[str, int, float], way: float) -> None:
    """The first one chooses the turn; more than one turn on they are still told apart."""
    unit, turn, off = joint
    bench = Bench(unit, turn + off)
    told: list[str] = []
    following = Following(bench.host, bench.joints, values(CONTROL, mode=mode), told.append)
    bench.turn = following.turn
    for share in 0.5 - 0.5 * np.cos(np.pi * np.linspace(0.0, 1.0, 30)):
        following.take(NAMES, [share * way, share], [], sent=bench.now, now=bench.now)
        bench.step(0.1)
    bench.step(3.0)
    assert told == []
    ends(bench, turn, way)
    # another hand moves, then the joint is told where it was, a turn less
    following.drop()
    bench.host.move({0: bench.host.feedback().axes[0].position + 0.2 * UNITS[unit]})
    bench.step(1.0)
    following.take(NAMES, [way - TURN, 1.0], [], sent=bench.now, now=bench.now)
    bench.step(3.0)
    ends(bench, turn, way)


@pytest.mark.parametrize("mode", ["stream", "track"])
@settings(max_examples=2)
@given(continuous, st.floats(-2.5, 2.5))
def test_trajectories_by_topic(mode: str, joint: tuple[str, int, float], way: float) -> None:
    """Windows of a servo node, chunks of a policy: the first point chooses the turn."""
    unit, turn, off = joint
    bench = Bench(unit, turn + off)
    topic = TopicMotion(bench.host, bench.joints, values(CONTROLLER, topic_mode=mode))
    bench.turn = topic.turn
    at = 0.05 * np.arange(1, 13)
    for k in range(10):
        s = np.clip((0.2 * k + at) / 1.5, 0.0, 1.0)
        rows = np.outer(0.5 - 0.5 * np.cos(np.pi * s), [way, 1.0])
        topic.take(message(at, rows), bench.now, bench.now)
        bench.step(0.2)
    bench.step(4.0)
    ends(bench, turn, way)
