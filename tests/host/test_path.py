"""Paths played in the kernel: the samples bit for bit, and every change of speed on the path."""

from __future__ import annotations

import itertools
import os
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from unittest import mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.following_check import recording_keeps
from helpers.path_check import (
    ENDED,
    PANDA,
    Bench,
    T,
    along,
    begin_of,
    blocks_of,
    curve,
    keeps,
    recording,
)
from sjerk import (
    Axis,
    InputError,
    Limits,
    MotionKernel,
    MotionStoppedError,
    RefusedError,
    SupersededError,
    Trajectory,
    follow,
)
from sjerk.cycle.states import AxisState
from sjerk.host import EventKind, PathState
from sjerk.host.path_feeder import PathFeeder
from sjerk.trajectory.joining import brake
from sjerk.trajectory.segments import Followed, Knot, rows, split

PLAN = blocks_of()
SAMPLES = recording(PLAN)[0]
CURVE = curve(SAMPLES)
WAY = float(np.sqrt((np.diff(SAMPLES, axis=0) ** 2).sum(axis=1)).sum())


def same_end(positions: np.ndarray, rows: int = 100) -> None:
    """The last rows are those of the recording, bit for bit."""
    end = int(np.flatnonzero((positions != positions[-1]).any(axis=1))[-1]) + 2
    full = int(np.flatnonzero((SAMPLES[-1] != SAMPLES).any(axis=1))[-1]) + 2
    np.testing.assert_array_equal(positions[end - rows : end], SAMPLES[full - rows : full])


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("period", [0.1, 0.002])
def test_the_samples_are_those_of_the_plan_bit_for_bit(seed: int, period: float) -> None:
    """Seven joints of the Panda, way-points at 0.1 s and at 2 ms, through the ring."""
    blocks = blocks_of(seed, period)
    expected, _ = recording(blocks)
    bench = Bench(expected[0].tolist())
    path = bench.play(iter(blocks))
    positions = bench.run(path)
    assert path.done
    rows = positions[begin_of(positions) :]
    np.testing.assert_array_equal(rows, expected[: len(rows)])
    np.testing.assert_array_equal(rows[-1], expected[-1])


def test_what_is_told_on_the_way() -> None:
    """States, way-points and segments of the path; velocity to jerk are those of the plan."""
    bench = Bench(SAMPLES[0].tolist())
    path = bench.play(PLAN)
    assert path.state is PathState.SENT
    expected = PLAN[0].sample()
    seen = []
    while path.state not in ENDED:
        bench.kernel.step()
        bench.rows.append(bench.now())
        seen.append(bench.host.feedback())
    begin = begin_of(bench.positions) - 1  # rows are one ahead of the frames
    ends = np.cumsum(PLAN[0].cycles)
    for i in range(1, len(SAMPLES) - 1, 97):
        frame = seen[begin + i]
        assert {axis.state for axis in frame.axes} == {AxisState.SYNCHRONIZED_MOTION}
        assert all(axis.moving and axis.goal_id == path.goal_id for axis in frame.axes)
        assert frame.path.state is PathState.RUNS
        assert frame.path.speed == 1.0
        assert frame.path.point == int(np.searchsorted(ends, i, side="left")) + 1
        assert frame.path.time == pytest.approx(
            (i - (0, *ends)[frame.path.point - 1]) * T, abs=1e-12
        )
        for name in ("velocity", "acceleration", "jerk"):
            told = [getattr(axis, name) for axis in frame.axes]
            np.testing.assert_allclose(told, getattr(expected, name)[i], rtol=1e-12, atol=1e-12)
    bench.kernel.step(2)
    assert all(axis.state is AxisState.STANDSTILL for axis in bench.host.feedback().axes)
    events = [event for event in bench.host.events()[0] if event.kind is EventKind.PATH]
    assert [PathState(event.code) for event in events] == [PathState.RUNS, PathState.DONE]


def stop_at(cycle: int, order: str) -> tuple[np.ndarray, Bench, PathState]:
    """Positions from three cycles before an order until rest, all of them judged."""
    bench = Bench(SAMPLES[0].tolist())
    path = bench.play(PLAN)
    while path.state is PathState.SENT:
        bench.kernel.step()
    bench.skip(path, max(cycle - 4, 1))
    for _ in range(4):
        bench.kernel.step()
        bench.rows.append(bench.now())
    if order == "halt":
        bench.host.halt()
    else:
        getattr(path, order)()
    rest = (*ENDED, PathState.PAUSED)
    positions = bench.run(path, until=lambda: path.state in rest)
    bench.kernel.step(10)
    assert bench.now() == bench.rows[-1]
    return positions, bench, path.state


def judge_stop(positions: np.ndarray, cycle: int) -> None:
    keeps(positions, PANDA)
    places, gaps = along(CURVE, positions, 16 * cycle, 16 * 8)
    assert gaps.max() < 1e-6 * WAY
    assert np.diff(places).min() > -1e-6
    whole = np.concatenate([positions, np.repeat(positions[-1:], 3, axis=0)])
    keeps(whole, PANDA)  # rest, without a step


@pytest.mark.parametrize("part", range(10))
def test_cancel_at_random_moments_stops_on_the_path(part: int) -> None:
    """A hundred moments: within 1e-6 of the way's length, all limits kept, never backward."""
    rng = np.random.default_rng(part)
    for cycle in rng.integers(5, len(SAMPLES) - 5, 10).tolist():
        positions, bench, state = stop_at(cycle, "cancel")
        judge_stop(positions, cycle)
        assert state in (PathState.STOPPED, PathState.DONE)
        bench.kernel.step(2)
        assert all(axis.state is AxisState.STANDSTILL for axis in bench.host.feedback().axes)


@pytest.mark.parametrize("cycle", [300, 1500, 2700])
def test_a_halt_is_a_stop_on_the_path(cycle: int) -> None:
    """Halt forgets the path, as cancel does; a goal may follow at once."""
    positions, bench, state = stop_at(cycle, "halt")
    judge_stop(positions, cycle)
    assert state is PathState.STOPPED
    move = bench.host.move(SAMPLES[0].tolist())
    while not move.done:
        bench.kernel.step(20)
    assert bench.now() == SAMPLES[0].tolist()


@settings(max_examples=15)
@given(st.integers(5, len(SAMPLES) - 400), st.integers(1, 400), st.sampled_from(["pause", "hold"]))
def test_after_a_pause_the_samples_are_those_of_the_plan(cycle: int, wait: int, order: str) -> None:
    """Pause or hold anywhere, also before it rests: limits kept, on the path, then bit for bit."""
    bench = Bench(SAMPLES[0].tolist())
    path = bench.play(PLAN)
    bench.run(path, until=lambda: len(bench.rows) > cycle)
    if order == "pause":
        path.pause()
    else:
        bench.host.hold()
    count = len(bench.rows) + wait
    bench.run(path, until=lambda: len(bench.rows) > count)
    if order == "pause":
        path.resume()
    else:
        bench.host.resume()
    positions = bench.run(path)
    assert path.done
    recording_keeps(positions, PANDA)
    places, gaps = along(CURVE, positions, 0, 16 * 8)
    assert gaps.max() < 1e-6 * WAY
    assert np.diff(places).min() > -1e-6
    if wait + cycle < len(SAMPLES) - 2500:
        same_end(positions)


@settings(max_examples=15)
@given(
    st.lists(st.tuples(st.integers(1, 600), st.floats(0.0, 2.0)), min_size=1, max_size=6),
)
def test_any_speeds_keep_all_limits(changes: list[tuple[int, float]]) -> None:
    """Speeds between 0 and 2 at any moments: limits kept, on the path, and it ends exactly."""
    bench = Bench(SAMPLES[0].tolist())
    path = bench.play(PLAN)
    for wait, speed in changes:
        path.speed(speed)
        count = len(bench.rows) + wait
        bench.run(path, until=lambda count=count: len(bench.rows) > count)  # type: ignore[misc]
    if path.state not in ENDED:
        path.speed(1.0)
        bench.run(path)
    positions = bench.positions
    assert path.done
    recording_keeps(positions, PANDA)
    _, gaps = along(CURVE, positions, 0, 16 * 8)
    assert gaps.max() < 1e-6 * WAY
    np.testing.assert_array_equal(positions[-1], SAMPLES[-1])


def test_a_path_in_a_process_is_fed_by_a_thread() -> None:
    """Blocks from a generator, a kernel in its own process: done on the last way-point, told."""
    way = Trajectory(["a", "b"], 0.01 * np.arange(1000), _wave(1000, 2, 0.01))
    limits = [Limits(2.0, 20.0, 500.0)] * 2
    with MotionKernel([Axis(limit, 1e6) for limit in limits], T) as kernel, kernel.host() as host:
        host.enable()
        host.move(way.position[0].tolist()).wait(10.0)
        path = host.follow(follow(way, limits, T, block=256, lookahead=64))
        path.speed(2.0)
        path.wait(60.0)
        assert path.done
        assert host.feedback().axes[0].position == way.position[-1, 0]
        assert path.progress.complete
        again = host.follow(
            follow(Trajectory(["a"], [0.0, 5.0], [[0.5], [1.0]]), limits[:1], T), axes=[1]
        )
        with pytest.raises(RefusedError, match="move there first"):
            again.wait(10.0)
        host.move([0.0, 0.0]).wait(10.0)
        last = host.follow(follow(way, limits, T))
        deadline = time.monotonic() + 20.0
        while last.progress.point < 20 and time.monotonic() < deadline:
            time.sleep(1e-3)
        last.cancel()
        with pytest.raises(MotionStoppedError):
            last.wait(20.0)
        assert last.state is PathState.STOPPED


def _wave(n: int, joints: int, period: float, amplitude: float = 0.25) -> np.ndarray:
    t = np.arange(n) * period
    ease = np.sin(np.pi * np.arange(n) / (n - 1)) ** 4
    return (
        np.column_stack(
            [amplitude * np.sin(2.0 * np.pi * (0.2 + 0.02 * k) * t + k) for k in range(joints)]
        )
        * ease[:, None]
    )


def test_a_source_that_fails_stops_the_path_and_is_raised() -> None:
    """What the blocks raise later comes out of wait; the motion has come to rest on the path."""

    def broken() -> Iterator[Followed]:
        yield from itertools.islice(
            follow(
                Trajectory(["a"], 0.1 * np.arange(300), _wave(300, 1, 0.1)),
                limits,
                T,
                block=40,
                lookahead=20,
            ),
            2,
        )
        raise ValueError("no more")

    limits = [Limits(2.0, 20.0, 500.0)]
    with MotionKernel([Axis(limits[0], 1e6)], T) as kernel, kernel.host() as host:
        host.enable()
        path = host.follow(broken())
        with pytest.raises(ValueError, match="no more"):
            path.wait(60.0)
        assert not host.feedback().moving


def test_a_refused_path_names_the_axis() -> None:
    """Disabled, or elsewhere than where the path begins."""
    limits = [Limits(2.0, 20.0, 500.0)] * 2
    ways = Trajectory(["a", "b"], 0.1 * np.arange(60), _wave(60, 2, 0.1))
    bench = Bench(ways.position[0].tolist(), limits)
    bench.host.disable(axes=1)
    bench.kernel.step(2000)
    path = bench.play(follow(ways, limits, T))
    bench.run(path)
    with pytest.raises(RefusedError, match="refused by axis 1: the drive does not follow"):
        path.check()
    bench.host.enable()
    bench.kernel.step(2000)
    bench.host.move({1: 0.5})
    bench.kernel.step(5000)
    path = bench.play(follow(ways, limits, T))
    bench.run(path)
    with pytest.raises(RefusedError, match="refused by axis 1: the path does not begin where"):
        path.check()
    told = [e.axis for e in bench.host.events()[0] if e.kind is EventKind.GOAL]
    assert told[-1] == 1


@pytest.mark.parametrize("cycle", [200, 1500, 3000])
def test_a_quick_stop_leaves_the_path_within_the_limits(cycle: int) -> None:
    """Each axis by its own limits, from the commanded state: no step in jerk beyond them."""
    bench = Bench(SAMPLES[0].tolist())
    path = bench.play(PLAN)
    bench.run(path, until=lambda: len(bench.rows) > cycle)
    bench.host.quick_stop()
    bench.run(path)
    assert path.state is PathState.LEFT
    for _ in range(1200):
        bench.kernel.step()
        bench.rows.append(bench.now())
    recording_keeps(bench.positions, PANDA)
    assert all(axis.state is AxisState.STANDSTILL for axis in bench.host.feedback().axes)


@pytest.mark.parametrize("wait", [1, 3, 40, 200, 700])
def test_a_quick_stop_during_a_pause(wait: int) -> None:
    """Also while the speed on the path changes, the axes go on within their jerk limits."""
    bench = Bench(SAMPLES[0].tolist())
    path = bench.play(PLAN)
    bench.run(path, until=lambda: len(bench.rows) > 1500)
    path.pause()
    count = len(bench.rows) + wait
    bench.run(path, until=lambda: len(bench.rows) > count)
    bench.host.quick_stop()
    bench.run(path)
    for _ in range(1200):
        bench.kernel.step()
        bench.rows.append(bench.now())
    recording_keeps(bench.positions, PANDA)


def test_a_goal_for_one_axis_takes_it_away() -> None:
    """The axis goes to its goal from where it is; the others stop on their way."""
    bench = Bench(SAMPLES[0].tolist())
    path = bench.play(PLAN)
    bench.run(path, until=lambda: len(bench.rows) > 1500)
    move = bench.host.move({2: 0.0})
    bench.run(path)
    while not move.done:
        bench.kernel.step()
        bench.rows.append(bench.now())
    positions = bench.positions
    assert positions[-1, 2] == 0.0
    recording_keeps(positions, PANDA)
    rest = [0, 1, 3, 4, 5, 6]
    _, gaps = along(CURVE[:, rest], positions[:, rest], 0, 16 * 8)
    assert gaps.max() < 1e-6 * WAY
    assert path.state is PathState.STOPPED


def test_where_segments_do_not_come_it_stops_on_the_path_and_goes_on() -> None:
    """Half of the path first: a stop on what is known, told; then the rest: bit for bit again."""
    way = Trajectory(["a", "b"], 0.05 * np.arange(400), _wave(400, 2, 0.05, 0.5))
    limits = [Limits(2.0, 20.0, 500.0)] * 2
    blocks = list(follow(way, limits, T, block=100, lookahead=40))
    expected, _ = recording(blocks)
    more = False

    def source() -> Iterator[Followed | None]:
        yield from blocks[:2]
        while not more:
            yield None
        yield from blocks[2:]

    bench = Bench(expected[0].tolist(), limits)
    path = bench.play(source())
    bench.run(path, until=lambda: path.state is PathState.STARVES and path.progress.speed == 0.0)
    stopped = len(bench.rows)
    assert path.progress.point <= path.progress.fed == 199
    more = True
    positions = bench.run(path)
    assert path.done
    recording_keeps(positions, limits)
    _, gaps = along(curve(expected), positions, 0, 16 * 8)
    assert gaps.max() < 1e-6
    np.testing.assert_array_equal(positions[-5000:], expected[len(expected) - 5000 :])
    assert stopped > 5000
    kinds = [PathState(e.code) for e in bench.host.events()[0] if e.kind is EventKind.PATH]
    assert kinds == [PathState.RUNS, PathState.STARVES, PathState.RUNS, PathState.DONE]


def _from(blocks: list[Followed], point: int) -> Followed:
    """The segments of one block from this way-point on."""
    (block,) = blocks
    i = point - block.first
    parts = {
        name: getattr(block, name)[i:]
        for name in ("cycles", "stretch", "lengths", "jerk", "position", "velocity", "acceleration")
    }
    first = block.first_cycle + int(block.cycles[:i].sum())
    return replace(block, first=point, first_cycle=first, last_jerk=block.last_jerk[i:], **parts)


@pytest.mark.parametrize("order", ["run", "pause", "slow"])
def test_a_splice_goes_on_along_other_segments(order: str) -> None:
    """From a way-point ahead another path takes over, without a step; the samples are then its."""
    q = _wave(200, 2, 0.05, 0.5)
    limits = [Limits(2.0, 20.0, 500.0)] * 2
    other = q.copy()
    other[120:, 0] += 0.1 * np.sin(np.linspace(0.0, np.pi, 80)) ** 2
    one, two = (
        list(follow(Trajectory(["a", "b"], 0.05 * np.arange(200), x), limits, T))
        for x in (q, other)
    )
    expected, _ = recording(two)
    bench = Bench(expected[0].tolist(), limits)
    path = bench.play(one)
    bench.run(path, until=lambda: len(bench.rows) > 1000)
    if order == "pause":
        path.pause()
    elif order == "slow":
        path.speed(0.6)
    with pytest.raises(InputError, match="way-point ahead"):
        path.splice(_from(two, 5), 6)
    new = path.splice(_from(two, 60), 61)
    bench.run(new, until=lambda: len(bench.rows) > 2000)
    assert path.state is PathState.SUPERSEDED
    new.resume()
    new.speed(1.0)
    positions = bench.run(new)
    assert new.done
    recording_keeps(positions, limits)
    _, gaps = along(curve(expected), positions, 0, 16 * 8)
    assert gaps.max() < 1e-6
    np.testing.assert_array_equal(positions[-4000:], expected[len(expected) - 4000 :])
    with pytest.raises(SupersededError):
        path.check()


def test_a_splice_between_way_points_goes_on_where_it_says() -> None:
    """Any cycle of the way ahead, also of the segment that is passed: no step, limits kept."""
    limits = [Limits(2.0, 20.0, 500.0)] * 2
    q = _wave(40, 2, 0.5, 0.5)
    (block,) = follow(Trajectory(["a", "b"], 0.5 * np.arange(40), q), limits, T)
    whole = block.sample().position
    rng = np.random.default_rng(3)
    for cycle, ahead in zip(rng.integers(600, 12_000, 8), rng.integers(8, 900, 8), strict=True):
        bench = Bench(q[0].tolist(), limits)
        path = bench.play(block)
        for _ in range(int(cycle)):
            bench.kernel.step()
            bench.rows.append(bench.now())
        told = path.progress
        passed = int(block.cycles[: told.point - 1].sum()) + round(told.time / T)
        place = passed + int(ahead)
        head, _ = split(block, place)
        stop = brake(Knot.of(head), limits, T)
        at, before = len(head), int(head.cycles[:-1].sum())
        new = path.splice(stop, at, after=place - before)
        bench.run(new)
        assert new.done
        keeps(bench.positions, limits)
        at = begin_of(bench.positions)
        expected = np.concatenate(
            [head.sample().position, replace(stop, first=1).sample().position]
        )
        rows = bench.positions[at:]
        np.testing.assert_allclose(rows, expected[: len(rows)], rtol=0.0, atol=1e-12)
        np.testing.assert_array_equal(rows[:passed], whole[:passed])
        assert (rows[-1] == stop.position[-1]).all()


def test_a_place_that_is_passed_or_not_sent_is_refused_at_once() -> None:
    """Each names the field, the value and where the path is."""
    limits = [Limits(2.0, 20.0, 500.0)]
    blocks = list(follow(Trajectory(["a"], 0.1 * np.arange(60), _wave(60, 1, 0.1)), limits, T))
    bench = Bench(blocks[0].position[0].tolist(), limits)
    path = bench.play(blocks)
    bench.run(path, until=lambda: path.progress.point == 20)
    for at, after in ((19, 5), (20, 0), (60, 1), (61, 0), (-1, 0), (30, -1), (30, 2**63)):
        with pytest.raises(InputError, match=r"at|after"):
            path.splice(blocks[0], at, after=after)
    path.splice(_from(blocks, 30), 31)
    with pytest.raises(InputError, match="already"):
        path.splice(_from(blocks, 31), 32)


@pytest.mark.parametrize("order", ["run", "pause", "slow"])
@pytest.mark.parametrize("points", [60, 3000])
def test_a_refused_splice_leaves_the_path_as_it_was(order: str, points: int) -> None:
    """What was taken back is sent again, its speed and pause stay, every cycle is the plan's."""
    limits = [Limits(2.0, 20.0, 500.0)] * 2
    q = _wave(points, 2, 0.02, 0.02)
    blocks = list(follow(Trajectory(["a", "b"], 0.02 * np.arange(points), q), limits, T))
    expected, _ = recording(blocks)
    bench = Bench(expected[0].tolist(), limits)
    path = bench.play(blocks)
    bench.run(path, until=lambda: len(bench.rows) > 600)
    speed = {"run": 1.0, "pause": 0.0, "slow": 0.5}[order]
    if order == "pause":
        path.pause()
    path.speed(0.5 if order == "slow" else 1.0)
    bench.run(path, until=lambda: path.progress.speed == speed and path.progress.time > 0.0161)
    at = path.progress.point
    # the last cycles of this segment, and others of a path that was never sent behind them
    begin = int(blocks[0].cycles[: at - 1].sum())
    _, tail = split(blocks[0], begin + 18)
    new = path.splice(replace(tail, first=0), at, after=18)
    told = []
    for _ in range(40):
        new.pump()
        bench.kernel.step()
        bench.rows.append(bench.now())
        told.append(path.progress.speed)
    assert new.state is PathState.REFUSED
    assert new.pump()
    assert told == [speed] * 40
    path.resume()
    path.speed(1.0)
    positions = bench.run(path, most=80_000)
    assert path.done
    recording_keeps(positions, limits)
    if order == "run":
        rows = positions[begin_of(positions) :]
        np.testing.assert_array_equal(rows, expected[: len(rows)])
    _, gaps = along(curve(expected), positions, 0, 16 * 8)
    assert gaps.max() < 1e-6
    np.testing.assert_array_equal(positions[-1], expected[-1])


def test_a_splice_that_comes_too_late_is_refused() -> None:
    """What the kernel has set out for stays."""
    q = _wave(60, 1, 0.1, 0.5)
    limits = [Limits(2.0, 20.0, 500.0)]
    blocks = list(follow(Trajectory(["a"], 0.1 * np.arange(60), q), limits, T))
    expected, _ = recording(blocks)
    bench = Bench(expected[0].tolist(), limits)
    path = bench.play(blocks)
    bench.run(path, until=lambda: len(bench.rows) > 1000)
    bench.run(path, until=lambda: path.progress.time > 0.096)  # a few cycles from the next segment
    ahead = path.progress.point + 1
    new = path.splice(_from(blocks, ahead - 1), ahead)
    bench.kernel.step(5)
    assert new.state is PathState.REFUSED
    with pytest.raises(RefusedError, match="has begun"):
        new.check()
    path.cancel()
    bench.kernel.step(3000)
    assert path.state in (PathState.STOPPED, PathState.DONE)


def test_a_path_goes_on_where_the_refusal_is_seen_before_its_feeder() -> None:
    """In a process: splices too late, their state looked at without a pause; the path ends."""
    limits = [Limits(2.0, 20.0, 500.0)]
    q = _wave(700, 1, 0.005, 0.02)
    blocks = list(follow(Trajectory(["a"], 0.005 * np.arange(700), q), limits, T))
    with MotionKernel([Axis(limits[0], 1e6)], T) as kernel, kernel.host() as host:
        host.enable()
        path, refused = host.follow(blocks), 0
        while not path.state.ended and refused < 5:
            at = path.progress.point + 1
            try:
                new = path.splice(_from(blocks, at - 1), at)
            except InputError:  # passed, or the path before has not taken back its segments yet
                continue
            while new.state is PathState.SENT:
                pass
            if new.state is PathState.REFUSED:
                refused += 1
            else:
                path = new
        path.wait(60.0)
        assert refused
        assert host.feedback().axes[0].position == q[-1, 0]


def test_a_splice_of_blocks_at_hand_is_in_the_ring_whole_at_once() -> None:
    """Whenever its feeder gets to run: what the kernel takes over with ends at rest."""
    q = _wave(60, 2, 0.1, 0.5)
    limits = [Limits(2.0, 20.0, 500.0)] * 2
    blocks = list(follow(Trajectory(["a", "b"], 0.1 * np.arange(60), q), limits, T))
    bench = Bench(q[0].tolist(), limits)
    path = bench.play(blocks)
    bench.run(path, until=lambda: len(bench.rows) > 2450)
    at = path.progress.point + 1
    pieces = [rows(block, i, i + 1) for block in blocks for i in range(len(block))]
    with mock.patch.object(PathFeeder, "pump", return_value=False):
        new = path.splice(pieces[at - 1 :], at)
        assert new.progress.fed == 60 - 1
        bench.run(new)
    assert new.done
    recording_keeps(bench.positions, limits)


def test_a_splice_whose_segments_do_not_come_leaves_the_path_within_the_limits() -> None:
    """What is left is shorter than any stop on the path: each axis halts, told, jerk-limited."""
    q = _wave(60, 2, 0.1, 0.5)
    limits = [Limits(2.0, 20.0, 500.0)] * 2
    blocks = list(follow(Trajectory(["a", "b"], 0.1 * np.arange(60), q), limits, T))
    bench = Bench(q[0].tolist(), limits)
    path = bench.play(blocks)
    bench.run(path, until=lambda: len(bench.rows) > 2450 and path.progress.time > 0.088)
    at = path.progress.point + 1

    def source() -> Iterator[Followed | None]:
        rest = _from(blocks, at - 1)
        part = {name: getattr(rest, name)[:2] for name in ("position", "velocity", "acceleration")}
        one = {name: getattr(rest, name)[:1] for name in ("cycles", "stretch", "lengths", "jerk")}
        yield replace(rest, last_jerk=rest.last_jerk[:2], **part, **one)
        while True:
            yield None

    new = path.splice(source(), at)
    bench.run(new)
    assert new.state is PathState.LEFT
    for _ in range(500):
        bench.kernel.step()
        bench.rows.append(bench.now())
    recording_keeps(bench.positions, limits)
    with pytest.raises(MotionStoppedError):
        new.check()


def test_a_long_path_streams_in_constant_memory() -> None:
    """Blocks are planned as they are needed; every cycle bit for bit. SJERK_PATH_POINTS: more."""
    points = int(os.environ.get("SJERK_PATH_POINTS", "6000"))
    limits = [Limits(2.0, 20.0, 500.0)] * 2
    rows: deque[list[float]] = deque()

    def pieces() -> Iterator[Trajectory]:
        for begin in range(0, points, 500):
            t = 0.02 * np.arange(begin, min(begin + 500, points))
            q = np.column_stack([0.2 * np.sin(1.3 * t), 0.3 * np.sin(0.7 * t) * np.cos(t)])
            yield Trajectory(["a", "b"], t + 1.0, q)

    def watched() -> Iterator[Followed]:
        for block in follow(pieces(), limits, T, block=256, lookahead=64):
            rows.extend(block.sample().position.tolist())
            yield block

    kernel = MotionKernel([Axis(limit, 1e6, "ideal") for limit in limits], T)
    host = kernel.host()
    host.enable()
    kernel.step(5)
    path = host.follow(watched())
    longest, moving = 0, False
    begin = rows.popleft()
    for cycle in range(points * 40):
        if cycle % 100 == 0:
            path.pump()
            longest = max(longest, len(rows))
        kernel.step()
        frame = host.link.frame()
        now = [frame.axis[0].position, frame.axis[1].position]
        moving = moving or now != begin
        if moving:
            assert now == rows.popleft()
        if frame.path.state == PathState.DONE:
            break
    assert path.done
    assert not rows
    assert longest < 20 * (2048 + 512 + 32 + 2 * 320)  # window, ring, what waits, what is planned
