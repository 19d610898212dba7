"""Trajectories as goals: accepted or refused with the right code, watched, replaced, stopped."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.following_check import Array, toppra_plan
from helpers.path_check import PANDA, Bench, T, along, curve, keeps
from sjerk import (
    Axis,
    InputError,
    Limits,
    MotionKernel,
    State,
    Trajectory,
    TrajectoryExecutor,
    plan,
)
from sjerk.executor import GoalHandle, GoalStatus, ResultCode, Settings, Tolerance
from sjerk.trajectory import ExecutionMode

NAMES = [f"panda_joint{i}" for i in range(1, 8)]
PLAN = toppra_plan(0.1, 0)
#: Seven joints, a short smooth way from rest to rest.
TIME = np.arange(0.0, 1.05, 0.1)
WAY = 0.1 * (1.0 - np.cos(np.pi * TIME))[:, None] * np.linspace(1.0, -0.5, 7)


class Machine(Bench):
    """A kernel in an own loop with an executor whose clock is the kernel's."""

    def __init__(self, at: Any = (0.0,) * 7, limits: Any = PANDA, **settings: Any) -> None:
        super().__init__(list(at), limits)
        self.count = 0
        self.results: list[GoalHandle] = []
        self.told: list[tuple[float, Any]] = []
        self.executor = TrajectoryExecutor(
            self.host,
            NAMES,
            settings=Settings(**settings),
            clock=self.time,
            on_feedback=lambda goal, told: self.told.append((self.time(), told)),
            on_result=self.results.append,
        )

    def time(self) -> float:
        return self.count * T

    def cycles(self, count: int = 1) -> None:
        for _ in range(count):
            self.kernel.step()
            self.count += 1
            if self.count % 5 == 0:
                self.executor.update()
            self.rows.append(self.now())

    def until(self, met: Callable[[], bool], most: int = 30_000) -> None:
        for _ in range(most):
            if met():
                return
            self.cycles()
        raise AssertionError(f"not within {most} cycles")

    def finish(self, goal: GoalHandle) -> Array:
        self.until(lambda: goal.status not in (GoalStatus.WAITING, GoalStatus.EXECUTING))
        return self.positions

    def rest(self) -> None:
        self.until(lambda: not any(axis.moving for axis in self.host.feedback().axes))


def smooth(**changes: Any) -> Trajectory:
    """The short way, with other fields."""
    fields = {"joint_names": NAMES, "time": TIME, "position": WAY} | changes
    return Trajectory(**fields)


def test_a_plan_of_the_panda_is_played_and_succeeds() -> None:
    """TOPP-RA at 0.1 s: every way-point stands in the recording, limits kept, result told once."""
    machine = Machine(PLAN.position[0])
    goal = machine.executor.submit(PLAN)
    assert goal.accepted
    positions = machine.finish(goal)
    assert (goal.status, goal.code) == (GoalStatus.SUCCEEDED, ResultCode.SUCCESSFUL)
    assert goal.text
    for point in PLAN.position:
        assert (positions == point).all(axis=1).any()
    keeps(positions, PANDA)
    assert machine.results == [goal]
    assert 0.0 < goal.stretch < 0.2


def test_feedback_comes_at_its_rate() -> None:
    """20 Hz: desired, actual and error in the goal's own order of joints."""
    machine = Machine()
    order = NAMES[::-1]
    goal = machine.executor.submit(smooth(joint_names=order, position=WAY[:, ::-1]))
    positions = machine.finish(goal)
    assert goal.status is GoalStatus.SUCCEEDED
    np.testing.assert_array_equal(positions[-1], WAY[-1])
    times = np.diff([time for time, _ in machine.told])
    assert (times > 0.0499).all()
    assert len(machine.told) >= 20
    for _, told in machine.told:
        assert told.joint_names == tuple(order)
        np.testing.assert_array_equal(told.error, told.desired - told.actual)
    assert any(np.abs(told.error).max() > 0.0 for _, told in machine.told)


BAD: dict[str, tuple[Callable[[], Any], ResultCode, str]] = {
    "a joint too few": (
        lambda: Trajectory(NAMES[:6], TIME, WAY[:, :6]),
        ResultCode.INVALID_JOINTS,
        "panda_joint7",
    ),
    "an unknown joint": (
        lambda: smooth(joint_names=[*NAMES[:6], "elbow"]),
        ResultCode.INVALID_JOINTS,
        "elbow",
    ),
    "it ends in motion": (
        lambda: smooth(velocity=np.full_like(WAY, 0.1)),
        ResultCode.INVALID_GOAL,
        "velocity",
    ),
    "faster than the limit": (
        lambda: smooth(velocity=np.vstack([np.full((10, 7), 3.0), np.zeros((1, 7))])),
        ResultCode.INVALID_GOAL,
        "exceeds",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_what_is_refused_and_why(case: str) -> None:
    """Code and text; nothing moves, and a goal that goes on is not disturbed."""
    machine = Machine()
    before = machine.executor.submit(smooth())
    machine.cycles(200)
    make, code, text = BAD[case]
    goal = machine.executor.submit(make())
    assert (goal.status, goal.code) == (GoalStatus.REJECTED, code)
    assert text in goal.text
    assert goal.result(0.0) == (code, goal.text)
    machine.finish(before)
    assert before.status is GoalStatus.SUCCEEDED


def test_messages_are_taken_and_refused_like_trajectories() -> None:
    """Real messages of trajectory_msgs: points, sizes, nan, times, names; then a good one."""
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE).types
    Message = types["trajectory_msgs/msg/JointTrajectory"]
    Point = types["trajectory_msgs/msg/JointTrajectoryPoint"]
    Duration = types["builtin_interfaces/msg/Duration"]
    Header, Time = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]

    def message(
        names: list[str] = NAMES, rows: Any = WAY, moments: Any = TIME, sec: int = 0
    ) -> Any:
        empty = np.empty(0)
        points = [
            Point(np.array(q), empty, empty, empty, Duration(int(t), round(1e9 * (t - int(t)))))
            for q, t in zip(rows, moments, strict=True)
        ]
        return Message(Header(Time(sec, 0), ""), names, points)

    machine = Machine()
    machine.cycles(3000)
    spoilt = WAY.copy()
    spoilt[3, 2] = math.nan
    cases = [
        (message(rows=[], moments=[]), ResultCode.INVALID_GOAL, "no points"),
        (message(names=[], rows=np.empty((11, 0))), ResultCode.INVALID_GOAL, "no joints"),
        (message(rows=WAY[:, :5]), ResultCode.INVALID_GOAL, "point 0: 5 positions for 7"),
        (message(rows=spoilt), ResultCode.INVALID_GOAL, "point 3, joint panda_joint3"),
        (message(moments=[*TIME[:5], TIME[4], *TIME[6:]]), ResultCode.INVALID_GOAL, "point 5"),
        (message(names=[NAMES[0]] * 7), ResultCode.INVALID_JOINTS, "twice"),
        (message(sec=1), ResultCode.OLD_HEADER_TIMESTAMP, "ended"),
    ]
    for wrong, code, text in cases:
        goal = machine.executor.submit(wrong)
        assert (goal.status, goal.code) == (GoalStatus.REJECTED, code), text
        assert text in goal.text
    goal = machine.executor.submit(message())
    machine.finish(goal)
    assert goal.status is GoalStatus.SUCCEEDED


def test_position_limits_are_looked_at() -> None:
    """A way-point outside: refused with its point and joint."""
    machine = Machine(limits=[replace(PANDA[0], position=(-0.05, 0.15)), *PANDA[1:]])
    goal = machine.executor.submit(smooth())
    assert (goal.status, goal.code) == (GoalStatus.REJECTED, ResultCode.INVALID_GOAL)
    assert "panda_joint1: position" in goal.text
    assert "lies outside" in goal.text


def test_a_kernel_that_is_not_enabled_refuses() -> None:
    """Not active: the joints are named."""
    machine = Machine()
    machine.host.disable()
    machine.cycles(100)
    goal = machine.executor.submit(smooth())
    assert (goal.status, goal.code) == (GoalStatus.REJECTED, ResultCode.INVALID_GOAL)
    assert "panda_joint1" in goal.text


def test_some_of_the_joints_if_that_is_allowed() -> None:
    """Two of seven move; the others keep still."""
    machine = Machine(allow_partial_joints=True)
    goal = machine.executor.submit(Trajectory([NAMES[4], NAMES[1]], TIME, WAY[:, :2]))
    positions = machine.finish(goal)
    assert goal.status is GoalStatus.SUCCEEDED
    np.testing.assert_array_equal(positions[-1][[4, 1]], WAY[-1, :2])
    np.testing.assert_array_equal(positions[:, [0, 2, 3, 5, 6]], 0.0)


def test_a_path_tolerance_aborts_and_stops_on_the_path() -> None:
    """-4 with the joint; the motion comes to rest on its path within the limits, and holds."""
    machine = Machine()
    goal = machine.executor.submit(smooth(), path_tolerance={NAMES[2]: Tolerance(1e-4)})
    machine.finish(goal)
    assert goal.code is ResultCode.PATH_TOLERANCE_VIOLATED
    assert NAMES[2] in goal.text
    machine.rest()
    keeps(machine.positions, PANDA)
    full = Machine()
    full.finish(full.executor.submit(smooth()))
    _, gaps = along(curve(full.positions), machine.positions[-1:], 0, 16 * len(full.rows))
    assert gaps.max() < 1e-6
    assert 0.0 < machine.positions[-1, 0] < WAY[-1, 0]


def test_tolerances_of_the_settings_and_of_the_goal() -> None:
    """0: as the settings have it; -1: unchecked."""
    machine = Machine(path_tolerance={NAMES[2]: Tolerance(1e-4)})
    assert machine.executor.submit(smooth()).accepted
    machine.until(lambda: bool(machine.results))
    assert machine.results[0].code is ResultCode.PATH_TOLERANCE_VIOLATED
    machine.rest()
    goal = machine.executor.submit(smooth(), path_tolerance={NAMES[2]: Tolerance(-1.0)})
    machine.finish(goal)
    assert goal.status is GoalStatus.SUCCEEDED
    wrong = machine.executor.submit(smooth(), goal_tolerance={"elbow": Tolerance(1.0)})
    assert wrong.code is ResultCode.INVALID_JOINTS


def test_goal_tolerance_and_goal_time() -> None:
    """A tolerance that is never met: -5 after the goal's time, and with 0 it waits for ever."""
    machine = Machine()
    exact = {name: Tolerance(1e-13) for name in NAMES}
    goal = machine.executor.submit(
        smooth(position=0.7123456 * WAY), goal_tolerance=exact, goal_time=0.25
    )
    machine.finish(goal)
    assert goal.code is ResultCode.GOAL_TOLERANCE_VIOLATED
    assert "0.25 s" in goal.text
    goal = machine.executor.submit(smooth(position=0.6123456 * WAY), goal_tolerance=exact)
    machine.cycles(3000)
    assert goal.status is GoalStatus.EXECUTING
    machine.executor.close()
    assert goal.status is GoalStatus.CANCELED


def test_a_goal_tolerance_waits_for_the_motor() -> None:
    """The command arrives first; the goal succeeds when the joints are there and at rest."""
    machine = Machine()
    near = {name: Tolerance(1e-4) for name in NAMES}
    goal = machine.executor.submit(smooth(), goal_tolerance=near, goal_time=2.0)
    machine.finish(goal)
    assert goal.status is GoalStatus.SUCCEEDED
    assert goal.feedback is not None
    assert np.abs(goal.feedback.error).max() <= 1e-4
    assert np.abs(goal.feedback.actual_velocity).max() <= 0.01


def test_a_new_goal_replaces_the_one_before() -> None:
    """The old one is aborted with -1 at once, the motion stays smooth, the newest goal wins."""
    machine = Machine()
    first = machine.executor.submit(smooth())
    machine.cycles(400)
    second = machine.executor.submit(smooth(position=WAY * 0.3))
    third = machine.executor.submit(smooth(position=WAY[::-1] * 0.5))
    assert (first.status, first.code) == (GoalStatus.ABORTED, ResultCode.INVALID_GOAL)
    assert "replaced" in first.text
    assert second.status is GoalStatus.ABORTED
    machine.finish(third)
    assert third.status is GoalStatus.SUCCEEDED
    keeps(machine.positions, PANDA)
    np.testing.assert_array_equal(machine.positions[-1], WAY[0] * 0.5)


@pytest.mark.parametrize("cycle", [1, 150, 500, 900])
def test_cancel_stops_jerk_limited(cycle: int) -> None:
    """CANCELED at once; from there to rest within the limits, and no further."""
    machine = Machine()
    goal = machine.executor.submit(smooth())
    machine.cycles(cycle)
    goal.cancel()
    assert (goal.status, goal.code) == (GoalStatus.CANCELED, ResultCode.SUCCESSFUL)
    machine.cycles(5)
    machine.rest()
    keeps(machine.positions, PANDA)
    assert machine.positions[-1, 0] < WAY[-1, 0]
    goal.cancel()
    assert machine.results == [goal]


def test_pause_resume_and_speed() -> None:
    """At rest on the path, on again, and at half the speed: the same end."""
    machine = Machine()
    goal = machine.executor.submit(smooth())
    machine.cycles(400)
    goal.pause()
    machine.cycles(1000)
    held = machine.positions[-500:]
    np.testing.assert_array_equal(held, np.repeat(held[:1], 500, axis=0))
    goal.resume()
    goal.speed(0.5)
    rows = len(machine.rows)
    machine.finish(goal)
    assert goal.status is GoalStatus.SUCCEEDED
    assert len(machine.rows) - rows > 1000
    keeps(machine.positions, PANDA)
    np.testing.assert_array_equal(machine.positions[-1], WAY[-1])


def test_a_first_point_that_is_later_is_a_ramp() -> None:
    """First point at 0.5 s, elsewhere: it is met half a second after the start."""
    machine = Machine()
    way = smooth(time=TIME + 0.5, position=WAY + 0.05)
    rows = len(machine.rows)
    goal = machine.executor.submit(way)
    positions = machine.finish(goal)
    assert goal.status is GoalStatus.SUCCEEDED
    met = np.flatnonzero((positions == way.position[0]).all(axis=1))
    assert 498 <= met[0] - rows <= 505


def test_a_start_elsewhere_is_gone_to_first_or_refused() -> None:
    """A first point at time 0 away from the joints: a ramp, unless a tolerance refuses it."""
    machine = Machine()
    way = smooth(position=WAY + 0.2)
    goal = machine.executor.submit(way)
    positions = machine.finish(goal)
    assert goal.status is GoalStatus.SUCCEEDED
    assert (positions == way.position[0]).all(axis=1).any()
    keeps(positions, PANDA)
    machine.executor.change(start_tolerance=0.01)
    goal = machine.executor.submit(smooth())
    assert goal.code is ResultCode.INVALID_GOAL
    assert "the joint is at" in goal.text


def test_stamps() -> None:
    """In the future: it waits; in the past: way-points that are over are left out."""
    machine = Machine()
    machine.cycles(2000)
    rows = len(machine.rows)
    goal = machine.executor.submit(smooth(), stamp=machine.time() + 0.3)
    positions = machine.finish(goal)
    moved = np.flatnonzero((positions[rows:] != positions[rows]).any(axis=1))[0]
    assert 298 <= moved <= 330
    machine.finish(machine.executor.submit(smooth(position=WAY[::-1])))
    rows = len(machine.rows)
    goal = machine.executor.submit(smooth(), stamp=machine.time() - 0.45)
    positions = machine.finish(goal)[rows:]
    assert goal.status is GoalStatus.SUCCEEDED
    assert not (positions == WAY[3]).all(axis=1).any()
    assert np.abs(positions - WAY[-2]).max(axis=1).min() < 2e-3  # between two cycles, perhaps
    old = machine.executor.submit(smooth(), stamp=machine.time() - 1.5)
    assert old.code is ResultCode.OLD_HEADER_TIMESTAMP


def test_modes_change_from_the_next_goal_on() -> None:
    """While a goal goes on in full, single_point is set: it keeps its mode, the next has it."""
    machine = Machine()
    first = machine.executor.submit(smooth())
    machine.cycles(300)
    machine.executor.change(execution_mode="single_point")
    rows = len(machine.rows)
    machine.finish(first)
    assert all((machine.positions == q).all(axis=1).any() for q in WAY[5:])
    machine.finish(machine.executor.submit(smooth(position=WAY[::-1])))
    positions = machine.positions[rows:]
    np.testing.assert_array_equal(positions[-1], WAY[0])
    back = positions[np.flatnonzero((positions == WAY[-1]).all(axis=1))[-1] :]
    assert not (back == WAY[5]).all(axis=1).any()
    machine.executor.change(execution_mode=ExecutionMode.FULL_TRAJECTORY, resampling_delta=0.09)
    rows = len(machine.rows)
    machine.finish(machine.executor.submit(smooth()))
    met = [(machine.positions[rows:] == q).all(axis=1).any() for q in WAY[1:]]
    assert 2 <= sum(met) < 6
    assert met[-1]


def test_a_stop_by_another_hand_aborts() -> None:
    """The kernel halts: the goal is aborted with a text."""
    machine = Machine()
    goal = machine.executor.submit(smooth())
    machine.cycles(300)
    machine.host.halt()
    machine.finish(goal)
    assert (goal.status, goal.code) == (GoalStatus.ABORTED, ResultCode.INVALID_GOAL)
    assert "kernel" in goal.text


def test_wrong_settings_are_refused() -> None:
    """Each names the field, the value and the limit."""
    machine = Machine()
    wrong: list[dict[str, Any]] = [
        {"execution_mode": "twice"},
        {"resampling_delta": -1.0},
        {"speed": 3.0},
        {"goal_time": -1.0},
        {"start_tolerance": 0.0},
        {"colour": 1},
    ]
    for values in wrong:
        with pytest.raises(InputError, match=next(iter(values))):
            machine.executor.change(**values)
    with pytest.raises(InputError):
        Tolerance(-2.0)
    with pytest.raises(InputError, match="joint_names"):
        TrajectoryExecutor(machine.host, NAMES[:3])


def test_a_kernel_in_its_process() -> None:
    """A whole run with a thread that watches: told, succeeded; then replaced and canceled."""
    seen: list[Any] = []
    with (
        MotionKernel([Axis(limit, 1e6) for limit in PANDA], T) as kernel,
        kernel.host() as host,
    ):
        host.enable()
        with TrajectoryExecutor(
            host, NAMES, on_feedback=lambda goal, told: seen.append(told)
        ) as executor:
            goal = executor.submit(smooth(), goal_tolerance={n: Tolerance(1e-3) for n in NAMES})
            code, text = goal.result(timeout=60.0)
            assert code is ResultCode.SUCCESSFUL, text
            assert seen
            first = executor.submit(smooth(position=WAY[::-1]))
            second = executor.submit(smooth())
            assert first.result(60.0)[0] is ResultCode.INVALID_GOAL
            second.cancel()
            assert second.status is GoalStatus.CANCELED
        host.disable()


@settings(max_examples=12)
@given(
    ends=st.lists(st.floats(-0.8, 0.8), min_size=7, max_size=7),
    factor=st.sampled_from([1.0, 1.01, 1.1, 1.3, 2.0]),
    here=st.booleans(),
)
def test_a_goal_that_a_plan_can_reach_in_its_time_is_reached_in_its_time(
    ends: list[float], factor: float, here: bool
) -> None:
    """One way-point, or the present place and one: as soon as ``plan`` says that it can be."""
    least = plan([State(0.0)] * 7, [State(end) for end in ends], PANDA, T).cycles
    due = int(np.ceil(least * factor)) + 2
    machine = Machine()
    rows, moments = np.array([np.zeros(7), ends]), np.array([0.0, due * T])
    goal = machine.executor.submit(
        Trajectory(NAMES, moments, rows) if here else Trajectory(NAMES, moments[1:], rows[1:])
    )
    positions = machine.finish(goal)
    assert goal.status is GoalStatus.SUCCEEDED, goal.text
    assert goal.stretch <= 3 * T
    moving = np.flatnonzero((np.diff(positions, axis=0) != 0.0).any(axis=1))
    if len(moving):
        assert moving[-1] - moving[0] <= due + 3
        np.testing.assert_array_equal(positions[-1], ends)
    keeps(positions, PANDA)


@pytest.mark.parametrize("seed", range(2))
def test_a_goal_that_turns_on_its_position_limits_stays_inside(seed: int) -> None:
    """Way-points on both limits, between others: met, and never passed between them."""
    rng = np.random.default_rng(seed)
    low, high = -1.0, 1.0
    limits = [Limits(2.0, 8.0, 200.0, position=(low, high))] * 7
    count = int(rng.integers(4, 8))
    q = rng.uniform(-0.9, 0.9, (count, 7))
    q[1:-1][rng.random((count - 2, 7)) < 0.4] = high
    q[1:-1][rng.random((count - 2, 7)) < 0.2] = low
    q[0] = 0.5
    machine = Machine(q[0], limits)
    time = np.cumsum(rng.uniform(0.3, 1.0, count))
    goal = machine.executor.submit(Trajectory(NAMES, time - time[0], q))
    positions = machine.finish(goal)
    assert goal.status is GoalStatus.SUCCEEDED, goal.text
    assert positions.min() >= low
    assert positions.max() <= high
    np.testing.assert_array_equal(positions[-1], q[-1])
    for row in q[1:-1]:
        assert np.abs(positions - row).max(axis=1).min() < 0.02
