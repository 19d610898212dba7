"""Axes that turn for ever: the first point of a motion chooses the turn, the others follow it."""

from __future__ import annotations

import math
import time
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.loops import enabled
from sjerk import (
    Axis,
    Limits,
    MotionKernel,
    RefusedError,
    StreamPlayer,
    Trajectory,
    TrajectoryExecutor,
    follow,
    follow_path,
)
from sjerk.executor import GoalHandle, GoalStatus, ResultCode, Settings
from sjerk.executor.goal import OPEN
from sjerk.host.turns import Turns

T = 2e-3
#: Axis units of one turn: degrees, radians, turns, increments, and none that is round.
WRAPS = (360.0, 2.0 * math.pi, 1.0, 65536.0, 0.1, 17.3)


def limits(wrap: float | None) -> Limits:
    """Some turns a second; an axis that does not wrap is in radians."""
    size = wrap or 2.0 * math.pi
    return Limits(8.0 * size, 60.0 * size, 1500.0 * size)


def axis(wrap: float | None, turn: float = 0.0, **more: Any) -> Axis:
    """One that stands so many turns from 0; few increments, so that it may be far."""
    size = wrap or 2.0 * math.pi
    return Axis(limits(wrap), 2.0**12 / size, "ideal", wrap=wrap, start=turn * size, **more)


def exact(position: float, turns: int, wrap: float) -> float:
    """The double nearest to a position so many turns on, by fractions."""
    return float(Fraction(position) + turns * Fraction(wrap))


def nearest(value: float, position: float, turns: int, wrap: float) -> bool:
    """Whether no double is nearer to a position so many turns on; of two any, by fractions."""
    off = abs(Fraction(value) - Fraction(position) - turns * Fraction(wrap))
    return off <= Fraction(math.ulp(value)) / 2 * (1 + Fraction(1, 10**9))


def turns_to(position: float, at: float, wrap: float | None) -> int:
    """By fractions: the nearest, of two the one ahead."""
    if wrap is None:
        return 0
    return math.floor((Fraction(at) - Fraction(position)) / Fraction(wrap) + Fraction(1, 2))


class Bench:
    """A kernel in an own loop, and an executor of all of its axes or of some."""

    def __init__(self, axes: list[Axis], **options: Any) -> None:
        self.kernel, self.host = enabled(axes, T)
        self.count, self.rows = 0, [self.kernel.positions.copy()]
        self.told: list[Any] = []
        self.executor = TrajectoryExecutor(
            self.host,
            clock=lambda: self.count * T,
            feedback_rate=1.0 / T,
            on_feedback=lambda _, told: self.told.append(told),
            **options,
        )

    def run(self, cycles: int) -> None:
        for _ in range(cycles):
            self.kernel.step()
            self.count += 1
            self.rows.append(self.kernel.positions.copy())
            if self.count % 5 == 0:
                self.executor.update()

    def finish(self, goal: GoalHandle) -> np.ndarray:
        while goal.status in OPEN:
            self.run(5)
            assert self.count < 100_000
        return np.array(self.rows)

    @property
    def at(self) -> list[float]:
        return [one.position for one in self.host.feedback().axes]


# ---- whole turns ---------------------------------------------------------------------------------


@given(
    st.one_of(st.sampled_from(WRAPS), st.floats(1e-6, 1e9)),
    st.floats(-30.0, 30.0),
    st.floats(-1e6, 1e6),
)
def test_positions_are_rounded_once(wrap: float, place: float, turn: float) -> None:
    """Onto the axis and back, as fractions have it; never further than half a turn away."""
    position, at = place * wrap, turn * wrap
    turns = Turns.nearest([position], [at], [wrap])
    count = int(turns.count[0])
    [onto], [back] = turns.onto([position]).tolist(), turns.back([at]).tolist()
    assert nearest(onto, position, count, wrap)
    assert nearest(back, at, -count, wrap)
    apart = abs(Fraction(position) + count * Fraction(wrap) - Fraction(at)) / Fraction(wrap)
    assert apart <= Fraction(1, 2) + Fraction(1, 10**9)
    assert abs(count - turns_to(position, at, wrap)) <= (apart > 0.499999)
    # what a motion is given comes back to within the last bit of where it is played
    room = 0.5 * math.ulp(onto) + 0.5 * math.ulp(position)
    assert abs(float(turns.back([onto])[0]) - position) <= room


def test_an_axis_without_a_wrap_has_no_turns() -> None:
    """Bit for bit, wherever it is."""
    turns = Turns.nearest([0.1, 0.1], [1e9, 0.1], [0.0, 360.0])
    assert turns.onto([0.1, 0.1]).tolist() == [0.1, 0.1]


# ---- goals ---------------------------------------------------------------------------------------


@st.composite
def cases(draw: st.DrawFn) -> dict[str, Any]:
    """Some axes of every kind, where they are, and a way of some of them that turns."""
    axes = draw(st.integers(1, 4))
    wraps = [draw(st.sampled_from([None, *WRAPS])) for _ in range(axes)]
    turns = [draw(st.sampled_from([0, 1, -1, 3, -12, 1000, -10_000, 10_000])) for _ in wraps]
    joints = draw(st.permutations(range(axes)))[: draw(st.integers(1, axes))]
    return {
        "wraps": wraps,
        # an axis in radians stands where the way begins
        "turns": [n if wrap else 0 for n, wrap in zip(turns, wraps, strict=True)],
        "joints": list(joints),
        "first": [draw(st.floats(-1.6, 1.6)) for _ in joints],
        "off": [draw(st.floats(-0.49, 0.49)) for _ in joints],
        "ways": [draw(st.floats(-2.5, 2.5)) for _ in joints],
        "mode": draw(st.sampled_from(["full_trajectory", "full_trajectory", "single_point"])),
        "checked": draw(st.booleans()),
    }


@settings(max_examples=12)
@given(cases())
def test_a_goal_is_played_in_the_nearest_turn(case: dict[str, Any]) -> None:
    """To its end to the last bit, all the way round, told in its own turn; the others stay."""
    wraps, joints = case["wraps"], case["joints"]
    sizes = [wraps[j] or 2.0 * math.pi for j in joints]
    places = [0.0] * len(wraps)
    for j, first, off in zip(joints, case["first"], case["off"], strict=True):
        places[j] = case["turns"][j] + first + (off if wraps[j] else 0.0)
    bench = Bench(
        [axis(w, p, name=f"j{i}") for i, (w, p) in enumerate(zip(wraps, places, strict=True))],
        settings=Settings(
            execution_mode=case["mode"],
            allow_partial_joints=True,
            start_tolerance=0.5 * max(sizes) if case["checked"] else None,
        ),
    )
    begin, s = bench.at, 0.5 - 0.5 * np.cos(np.pi * np.linspace(0.0, 1.0, 7))
    first, ways = np.array(case["first"]) * sizes, np.array(case["ways"]) * sizes
    way = Trajectory([f"j{j}" for j in joints], np.linspace(0.0, 1.2, 7), first + np.outer(s, ways))
    goal = bench.executor.submit(way)
    assert goal.accepted, goal.text
    rows = bench.finish(goal)
    assert goal.status is GoalStatus.SUCCEEDED, goal.text
    ends = way.position[-1].tolist()
    for k, j in enumerate(joints):
        n = turns_to(way.position[0, k], begin[j], wraps[j])
        end = bench.at[j]
        assert nearest(end, ends[k], n, wraps[j] or 0.0)
        if wraps[j]:
            most = abs(way.position[:, k] - way.position[0, k]).max() + 0.5 * wraps[j]
            assert abs(rows[:, j] - begin[j]).max() <= most * (1 + 1e-6)
        told = bench.told[-1]
        room = math.ulp(abs(end) + sizes[k])
        assert abs(told.desired[k] - ends[k]) <= room
        assert told.error[k] == pytest.approx(told.desired[k] - told.actual[k], abs=2 * room)
    for j in set(range(len(wraps))) - set(joints):
        assert bench.at[j] == begin[j]


def test_two_turns_are_two_turns() -> None:
    """0 -> 720 from 1090: on to 1800, and back by the same way."""
    bench = Bench([axis(360.0, 1090.0 / 360.0, name="table")])
    way = Trajectory(["table"], [0.0, 0.5, 1.0], [[0.0], [360.0], [720.0]])
    goal = bench.executor.submit(way)
    bench.finish(goal)
    assert (goal.code, bench.at) == (ResultCode.SUCCESSFUL, [1800.0])
    goal = bench.executor.submit(Trajectory(["table"], [0.0, 1.0], [[720.0], [0.0]]))
    bench.finish(goal)
    assert bench.at == [1080.0]


def test_a_start_a_turn_away_is_there() -> None:
    """Within the start tolerance by whole turns; the text of a refusal tells the way's own turn."""
    bench = Bench([axis(360.0, 5.0, name="table")], settings=Settings(start_tolerance=1.0))
    way = Trajectory(["table"], [0.0, 1.0], [[2.0], [20.0]])
    goal = bench.executor.submit(way)
    assert goal.status is GoalStatus.REJECTED
    assert "position = 2.0, the joint is at 0.0" in goal.text
    goal = bench.executor.submit(Trajectory(["table"], [0.0, 1.0], [[-719.5], [-700.0]]))
    bench.finish(goal)
    assert bench.at == [1820.0]


def test_a_goal_in_motion_takes_the_turn_where_it_takes_over() -> None:
    """While three turns are made another goal comes: from the turn in which it takes over."""
    bench = Bench([axis(360.0, name="table")])
    first = bench.executor.submit(Trajectory(["table"], [0.0, 4.0], [[0.0], [1080.0]]))
    while bench.at[0] < 700.0:
        bench.run(5)
    passed = bench.at[0]
    goal = bench.executor.submit(Trajectory(["table"], [0.5, 1.0], [[90.0], [100.0]]))
    rows = bench.finish(goal)
    assert first.status is GoalStatus.ABORTED
    assert bench.at == [820.0]
    assert rows[bench.count - 5 :, 0].max() <= 820.0
    assert passed < 810.0


def test_late_goals_take_the_turn_of_what_is_ahead() -> None:
    """Half of its time is over: the way-point that is due now is nearest to where the axis is."""
    bench = Bench([axis(360.0, 400.0 / 360.0, name="table")])
    bench.run(500)
    way = Trajectory(["table"], [0.0, 1.0, 2.0], [[0.0], [410.0], [800.0]])
    goal = bench.executor.submit(way, stamp=bench.count * T - 0.9)
    bench.finish(goal)
    assert bench.at == [800.0]


# ---- paths ---------------------------------------------------------------------------------------


@settings(max_examples=15)
@given(
    st.lists(
        st.tuples(st.sampled_from([None, *WRAPS]), st.integers(-10_000, 10_000)),
        min_size=1,
        max_size=3,
    ),
    st.floats(-1.0, 1.0),
    st.one_of(st.floats(0.01, 2.5), st.floats(-2.5, -0.01)),
)
def test_a_path_begins_in_the_nearest_turn(
    axes: list[tuple[float | None, int]], first: float, way: float
) -> None:
    """Its samples so many turns on; a second one, written elsewhere, goes on from its end."""
    sizes = [wrap or 2.0 * math.pi for wrap, _ in axes]
    places = [n + first if wrap else first for wrap, n in axes]
    kernel, host = enabled([axis(w, p) for (w, _), p in zip(axes, places, strict=True)], T)
    begin = np.array([first * size for size in sizes])
    own = [limits(wrap) for wrap, _ in axes]
    at = [one.position for one in host.feedback().axes]
    rows = zip(begin.tolist(), at, axes, strict=True)
    host.move([exact(f, turns_to(f, a, w), w or 0.0) for f, a, (w, _) in rows])
    kernel.step(400)
    points = np.array([begin, begin + way * np.array(sizes)])
    for way_points in (points, points[::-1] + [7 * (wrap or 0.0) for wrap, _ in axes]):
        path = host.follow(follow_path(way_points, own, T))
        assert not path.done
        for _ in range(200):
            path.pump()
            kernel.step(20)
        path.check()
        for k, (wrap, _) in enumerate(axes):
            end = host.feedback().axes[k].position
            n = turns_to(way_points[-1, k], end, wrap)
            assert nearest(end, way_points[-1, k], n, wrap or 0.0)


def test_a_path_that_waits_takes_the_turn_where_it_begins() -> None:
    """Behind a move of two turns: nothing goes back, whatever turn the axis was in at the call."""
    kernel, host = enabled([axis(360.0)], T)
    made = list(follow_path([[720.0], [1000.0]], [limits(360.0)], T))
    host.move(720.0)
    kernel.step(5)
    path = host.follow(made)
    low = []
    while not path.done:
        path.pump()
        kernel.step(5)
        low.append(host.feedback().axes[0].position)
    assert low[-1] == 1000.0
    assert (np.diff(low) >= 0.0).all()


def test_a_path_elsewhere_in_the_turn_is_refused() -> None:
    """The text names the joint that is furthest off by its turn, not by its number."""
    kernel, host = enabled([axis(360.0, 50.0, name="far"), axis(360.0, 0.25, name="near")], T)
    made = follow_path([[0.0, 0.0], [90.0, 90.0]], [limits(360.0)] * 2, T)
    path = host.follow(made)
    for _ in range(5):
        path.pump()
        kernel.step(5)
    with pytest.raises(RefusedError, match=r"\(near\).*begins at 0.0, the axis is at 90.0"):
        path.check()


def test_a_path_is_spliced_in_its_own_turn() -> None:
    """What takes over is written as the path was."""
    kernel, host = enabled([axis(2.0 * math.pi, 33.0)], T)
    own = [limits(2.0 * math.pi)]
    way = Trajectory(["a"], [0.0, 0.5, 1.0, 1.5], [[0.0], [1.0], [2.0], [3.0]])
    [block] = follow(way, own, T)
    path = host.follow(block)
    kernel.step(20)
    path.pump()
    place = path.progress.point + 4
    other = path.splice([block], place) if place <= len(block) else path
    for _ in range(200):
        other.pump()
        kernel.step(10)
    assert other.done
    assert host.feedback().axes[0].position == exact(3.0, 33, 2.0 * math.pi)


# ---- moves, streams, a process -------------------------------------------------------------------


@pytest.mark.parametrize("wrap", WRAPS)
@pytest.mark.parametrize("direction", ["shortest", "positive", "negative"])
def test_a_place_that_the_axis_is_at_is_no_way(wrap: float, direction: Any) -> None:
    """Any number of turns on: what a path or a goal has ended on is there, in every direction."""
    for place in (0.1, 0.35, 0.77):
        kernel, host = enabled([axis(wrap, 10_000.0)], T)
        host.move(place * wrap, direction="shortest")
        kernel.step(600)
        at = host.feedback().axes[0].position
        assert at == exact(place * wrap, turns_to(place * wrap, at, wrap), wrap)
        move = host.move(place * wrap, direction=direction)
        kernel.step(5)
        assert move.done
        assert host.feedback().axes[0].position == at


def test_a_stream_is_played_in_the_nearest_turn() -> None:
    """Of an axis ten thousand turns on; it ends where fractions have it."""
    wrap = 2.0 * math.pi
    kernel, host = enabled([axis(wrap, 10_000.25), axis(None)], T)
    begin = [one.position for one in host.feedback().axes]
    player = StreamPlayer(host, period=0.1)
    goals = np.array([0.25 * wrap, 0.0]) + np.outer(np.linspace(0.0, 1.0, 12), [1.0, -1.0])
    for k, goal in enumerate(goals[1:]):
        player.push(goal)
        if k == len(goals) - 2:
            player.end()
        for _ in range(25):
            kernel.step(2)
            player.update()
    while not player.done:
        kernel.step(5)
        player.update()
    n = turns_to(goals[1, 0], begin[0], wrap)
    assert [one.position for one in host.feedback().axes] == [
        exact(goals[-1, 0], n, wrap),
        goals[-1, 1],
    ]


def test_a_kernel_in_a_process() -> None:
    """A table at turn 100 and an arm without turns: a goal of both, and its result."""
    axes = [axis(360.0, 100.0, name="table"), axis(None, name="arm")]
    with (
        MotionKernel(axes, T, name=f"turns-{time.monotonic_ns()}") as kernel,
        kernel.host() as host,
    ):
        host.enable()
        with TrajectoryExecutor(host, settings=Settings(start_tolerance=0.5)) as executor:
            way = Trajectory(
                ["arm", "table"], [0.0, 0.6, 1.2], [[0.0, 0.0], [0.3, 400.0], [0.6, 725.0]]
            )
            goal = executor.submit(way)
            assert goal.result(60.0) == (ResultCode.SUCCESSFUL, "goal reached")
            assert goal.feedback is not None
            assert goal.feedback.desired.tolist() == [0.6, 725.0]
        assert [one.position for one in host.feedback().axes] == [36_725.0, 0.6]
