"""A goal that replaces another in motion: spliced at its stamp or at once, within all limits."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_executor import NAMES, PLAN, TIME, WAY, Machine, smooth

from helpers.following_check import PANDA, Array, T, recording_keeps, toppra_plan
from sjerk import Limits, Trajectory
from sjerk.executor import GoalHandle, GoalStatus, ResultCode

#: Cycles that an order may take, beside what the executor looks for every fifth cycle.
SOON = 60


def plain(way: Trajectory) -> Array:
    """The recording of a goal that is not disturbed, from the cycle before it moves."""
    machine = Machine(way.position[0])
    machine.finish(machine.executor.submit(way))
    return machine.positions


def wave(seconds: float, size: float, start: Any, shift: float = 0.0) -> Trajectory:
    """Way-points at 0.1 s of a smooth motion about ``start`` that ends at rest."""
    time = np.linspace(0.0, seconds, max(3, round(seconds / 0.1) + 1))
    share = np.linspace(1.0, -0.7, 7)
    ease = np.sin(0.5 * np.pi * time / seconds) ** 2
    return Trajectory(NAMES, time + shift, np.asarray(start) + size * ease[:, None] * share)


def met(positions: Array, points: Array) -> list[int]:
    """The rows that stand on each of the points, in order; -1: none."""
    rows, begin = [], 0
    for point in points:
        found = np.flatnonzero((positions[begin:] == point).all(axis=1))
        rows.append(begin + int(found[0]) if len(found) else -1)
        begin = max(begin, rows[-1])
    return rows


def replaced(cycle: int, way: Trajectory, ahead: float) -> tuple[Machine, GoalHandle, int]:
    """The recorded plan, replaced after so many cycles by a goal with a stamp so far ahead (s)."""
    machine = Machine(PLAN.position[0])
    machine.executor.submit(PLAN)
    machine.cycles(cycle)
    row = len(machine.rows)
    goal = machine.executor.submit(way, stamp=machine.time() + ahead if ahead else 0.0)
    assert goal.accepted, goal.text
    machine.finish(goal)
    assert (goal.status, goal.code) == (GoalStatus.SUCCEEDED, ResultCode.SUCCESSFUL), goal.text
    return machine, goal, row


ALONE = plain(PLAN)


@settings(max_examples=15)
@given(
    cycle=st.integers(50, 3200),
    ahead=st.sampled_from([0.0, 0.0, 0.02, 0.3, 0.75]),
    seconds=st.floats(0.3, 3.0),
    size=st.floats(-0.6, 0.6),
    shift=st.sampled_from([0.0, 0.05, 0.4]),
)
def test_any_goal_takes_over_within_the_limits(
    cycle: int, ahead: float, seconds: float, size: float, shift: float
) -> None:
    """Anywhere on a plan at its limits: every cycle legal, the old one kept until the stamp."""
    start = PLAN.position[min(len(PLAN) - 1, int((cycle * T + ahead) / 0.1))]
    machine, _, row = replaced(cycle, wave(seconds, size, start, shift), ahead)
    positions = machine.positions
    recording_keeps(positions, PANDA)
    kept = min(row + int(ahead / T), len(ALONE))  # or until it is over
    # where it is left, between way-points, the sample may be another in its last bit
    np.testing.assert_allclose(positions[:kept], ALONE[:kept], rtol=0.0, atol=1e-14)
    np.testing.assert_array_equal(positions[-1], wave(seconds, size, start, shift).position[-1])


@pytest.mark.parametrize("ahead", [0.0, 0.5])
@pytest.mark.parametrize("cycle", [400, 1150, 2201])
def test_the_same_plan_again_is_gone_on_with(cycle: int, ahead: float) -> None:
    """A plan that goes on as the motion does: met in its cycles, and nothing slows down."""
    way = smooth(time=4.0 * np.linspace(0.0, 1.0, 11))
    alone = plain(way)
    machine = Machine()
    machine.executor.submit(way)
    machine.cycles(cycle)
    now = machine.time()
    begin = int(np.flatnonzero((alone != alone[0]).any(axis=1))[0]) - 1
    here = (len(machine.rows) - 1 - begin) * T  # of the plan's time
    cut = here + (ahead or 0.0)
    time = np.arange(0.0, 4.0 - cut, 0.2)[1:]
    again = Trajectory(
        NAMES,
        np.append(time, 4.0 - cut),
        np.vstack([alone[begin + np.rint((cut + time) / T).astype(int)], alone[-1]]),
    )
    goal = machine.executor.submit(again, stamp=now + ahead if ahead else now)
    positions = machine.finish(goal)
    recording_keeps(positions, PANDA)
    rows = met(positions, again.position[2:])
    due = begin + np.rint((cut + again.time[2:]) / T)
    assert np.abs(np.array(rows) - due).max() <= 5
    assert goal.stretch <= 5 * T
    # no stop: from the goal to the last tenth of the way it is as fast as alone
    speed = np.abs(np.diff(positions[:, 0]))
    own = np.abs(np.diff(alone[:, 0]))
    middle = slice(begin + 200, begin + 3600)
    assert (speed[middle] > 0.8 * own[middle]).all()


def test_a_goal_in_motion_does_not_stop_where_it_need_not() -> None:
    """Another end in the same direction: the velocity never falls to rest before the end."""
    machine = Machine()
    machine.executor.submit(smooth(time=2.0 * np.linspace(0.0, 1.0, 11)))
    machine.cycles(1000)
    row = len(machine.rows)
    way = machine.positions[-1] - machine.positions[0]
    ends = machine.positions[-1] + np.outer([1.4, 2.2], way)
    goal = machine.executor.submit(Trajectory(NAMES, [1.0, 2.5], ends))
    positions = machine.finish(goal)
    recording_keeps(positions, PANDA)
    (at,) = met(positions, ends[:1])
    speed = np.abs(np.diff(positions[row:at], axis=0))
    assert (speed >= 0.5 * speed[0]).all()


def test_way_points_of_a_stamp_ahead_are_met_in_their_cycles() -> None:
    """A stamp half a second ahead, first point 0.3 s later: on the old one, then at its times."""
    machine = Machine()
    first = smooth(time=4.0 * np.linspace(0.0, 1.0, 11))
    alone = plain(first)
    machine.executor.submit(first)
    machine.cycles(1000)
    stamp = machine.time() + 0.5
    row = len(machine.rows) - 1 + 500
    way = wave(3.0, -0.05, alone[row + 300], shift=0.3)
    goal = machine.executor.submit(way, stamp=stamp)
    positions = machine.finish(goal)
    recording_keeps(positions, PANDA)
    np.testing.assert_allclose(positions[:row], alone[:row], rtol=0.0, atol=1e-14)
    rows = np.array(met(positions, way.position))
    assert goal.stretch == 0.0
    assert np.abs(rows - row - np.rint(way.time / T)).max() <= 5
    assert (np.diff(rows) == 100).all()


def test_a_goal_that_waits_is_replaced_and_canceled_too() -> None:
    """The motion in play is that of the first one until another takes over, or it stops."""
    machine = Machine(PLAN.position[0])
    first = machine.executor.submit(PLAN)
    machine.cycles(800)
    later = machine.executor.submit(wave(1.0, 0.1, PLAN.position[20]), stamp=machine.time() + 1.0)
    assert first.status is GoalStatus.ABORTED
    machine.cycles(300)
    assert later.status is GoalStatus.WAITING
    sooner = machine.executor.submit(wave(1.0, 0.1, PLAN.position[12]), stamp=machine.time() + 0.1)
    assert (later.status, later.code) == (GoalStatus.ABORTED, ResultCode.INVALID_GOAL)
    machine.cycles(100)
    third = machine.executor.submit(wave(1.0, 0.1, PLAN.position[12]), stamp=machine.time() + 2.0)
    assert sooner.status is GoalStatus.ABORTED
    third.cancel()
    assert third.status is GoalStatus.CANCELED
    machine.cycles(5)
    machine.rest()
    recording_keeps(machine.positions, PANDA)
    assert machine.results == [first, later, sooner, third]


def test_goals_at_10_hz_follow_each_other_without_rest() -> None:
    """Each replaces the last in motion, as a tracker sends them; every cycle is legal."""
    machine = Machine()
    end = wave(2.0, 0.4, np.zeros(7))
    goals = []
    for k in range(15):
        at = machine.positions[-1]
        goals.append(machine.executor.submit(wave(1.0, 0.05 + 0.005 * k, at)))
        machine.cycles(100)
    goals.append(machine.executor.submit(end))
    positions = machine.finish(goals[-1])
    assert goals[-1].status is GoalStatus.SUCCEEDED
    recording_keeps(positions, PANDA)
    speed = np.abs(np.diff(positions[:, 0]))[400:1400]
    assert speed.min() > 0.0


def test_other_joints_begin_from_rest() -> None:
    """A goal of some of the joints does not take over from one of all: stop, then start."""
    machine = Machine(allow_partial_joints=True)
    first = machine.executor.submit(smooth())
    machine.cycles(400)
    goal = machine.executor.submit(Trajectory([NAMES[4], NAMES[1]], TIME, WAY[:, :2]))
    positions = machine.finish(goal)
    assert first.status is GoalStatus.ABORTED
    assert goal.status is GoalStatus.SUCCEEDED
    recording_keeps(positions, PANDA)


def test_a_paused_goal_is_replaced_from_rest() -> None:
    """What stands, or is slowed to a stop, has no motion to take over from."""
    machine = Machine()
    first = machine.executor.submit(smooth())
    machine.cycles(400)
    first.pause()
    machine.cycles(100)
    goal = machine.executor.submit(smooth(position=WAY[::-1]))
    positions = machine.finish(goal)
    assert goal.status is GoalStatus.SUCCEEDED
    recording_keeps(positions, PANDA)


@pytest.mark.parametrize("speed", [0.4, 0.7])
def test_a_goal_that_is_slowed_down_is_replaced_in_motion(speed: float) -> None:
    """At another speed on the path, its change under way or not."""
    for wait in (3, 60, 700):
        machine = Machine()
        first = machine.executor.submit(smooth(time=3.0 * np.linspace(0.0, 1.0, 11)))
        machine.cycles(600)
        first.speed(speed)
        machine.cycles(wait)
        goal = machine.executor.submit(wave(2.0, 0.4, machine.positions[-1]))
        positions = machine.finish(goal)
        assert goal.status is GoalStatus.SUCCEEDED
        recording_keeps(positions, PANDA)
        moving = np.flatnonzero((np.diff(positions, axis=0) != 0.0).any(axis=1))
        assert (np.diff(moving) == 1).all()


def test_a_range_that_leaves_no_way_in_motion_is_kept() -> None:
    """Towards the end of a range at full speed, a goal behind it: rest first, never outside."""
    limits = [Limits(p.velocity, p.acceleration, p.jerk, position=(-0.3, 0.201)) for p in PANDA]
    machine = Machine(limits=limits)
    machine.executor.submit(smooth())
    for _ in range(3):
        machine.cycles(250)
        goal = machine.executor.submit(wave(0.4, -0.1, np.zeros(7)))
    positions = machine.finish(goal)
    assert goal.status is GoalStatus.SUCCEEDED, goal.text
    recording_keeps(positions, limits)
    assert positions.max() <= 0.201
    assert positions.min() >= -0.3


@pytest.mark.parametrize("period", [0.002, 0.1])
@pytest.mark.parametrize("tolerance", [0.0, 1e-3])
def test_dense_plans_take_over_too(period: float, tolerance: float) -> None:
    """A TOPP-RA plan of the same way, dense and sparse, within a tolerance or through all."""
    plan = toppra_plan(period, 0)
    machine = Machine(PLAN.position[0], tolerance=tolerance)
    machine.executor.submit(PLAN)
    machine.cycles(1000)
    ahead = np.flatnonzero(plan.time > 1.05)
    some = plan.take(ahead if tolerance else np.unique([*ahead[::3], len(plan) - 1]))
    goal = machine.executor.submit(
        Trajectory(NAMES, some.time - some.time[0] + period, some.position)
    )
    positions = machine.finish(goal)
    assert goal.status is GoalStatus.SUCCEEDED, goal.text
    recording_keeps(positions, PANDA)
    np.testing.assert_array_equal(positions[-1], plan.position[-1])


def test_feedback_tells_way_points_and_time_of_its_own_goal() -> None:
    """Points and time rise from those ahead to the last, from the moment it takes over."""
    machine = Machine(PLAN.position[0])
    machine.executor.submit(PLAN)
    machine.cycles(1000)
    machine.told.clear()
    way = wave(2.0, 0.3, machine.positions[-1])
    goal = machine.executor.submit(way, stamp=machine.time() - 0.31)
    machine.finish(goal)
    points = [told.point for _, told in machine.told]
    times = [told.time for _, told in machine.told]
    assert points[0] == 4
    assert points[-1] == len(way) - 1
    assert (np.diff(points) >= 0).all()
    assert (np.diff(times) >= 0.0).all()
    assert 0.31 <= times[0] <= 0.31 + SOON * T
    assert times[-1] == pytest.approx(way.time[-1] + goal.stretch, abs=0.06)


def test_submit_only_checks_and_the_motion_is_planned_beside() -> None:
    """What the caller pays is a part of what planning takes, which ``update`` does: both in its CPU
    time, in one run.
    """
    checked, planned = [], []
    for cycle in (400, 900, 1400, 1900, 2400):
        machine = Machine(PLAN.position[0])
        machine.executor.submit(PLAN)
        machine.cycles(cycle)
        way = wave(2.0, 0.3, machine.positions[-1])
        begin = time.thread_time()
        goal = machine.executor.submit(way)
        middle = time.thread_time()
        machine.executor.update()
        checked.append(middle - begin)
        planned.append(time.thread_time() - middle)
        assert goal.status is GoalStatus.EXECUTING
    assert float(np.median(checked)) < 0.3 * float(np.median(planned))


class Asked(Machine):
    """Its clock, which is read where a motion is planned, does something once."""

    act: Callable[[], object] | None = None

    def time(self) -> float:
        if self.act is not None:
            thread = threading.Thread(target=self.act, daemon=True)
            self.act = None
            thread.start()
            thread.join(20.0)
            assert not thread.is_alive()
        return super().time()


def test_orders_and_goals_do_not_wait_for_planning() -> None:
    """While a motion is planned another thread cancels its goal, or sends the next one."""
    machine = Asked(PLAN.position[0])
    machine.executor.submit(PLAN)
    machine.cycles(800)
    goal = machine.executor.submit(wave(2.0, 0.3, machine.positions[-1]))
    machine.act = goal.cancel
    machine.executor.update()
    assert goal.status is GoalStatus.CANCELED
    machine.rest()
    first = machine.executor.submit(wave(2.0, 0.3, machine.positions[-1]))
    newest: list[GoalHandle] = []
    way = wave(1.0, -0.1, machine.positions[-1])
    machine.act = lambda: newest.append(machine.executor.submit(way))
    machine.executor.update()
    assert first.status is GoalStatus.ABORTED
    positions = machine.finish(newest[0])
    assert newest[0].status is GoalStatus.SUCCEEDED
    np.testing.assert_array_equal(positions[-1], way.position[-1])
    recording_keeps(positions, PANDA)
