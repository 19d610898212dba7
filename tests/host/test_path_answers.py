"""Every path gets its answer, whatever of it has been sent: none is left to wait for ever."""

from __future__ import annotations

import queue
import signal
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from helpers.path_check import Bench, T
from sjerk import (
    Axis,
    Host,
    InputError,
    Limits,
    MotionKernel,
    MotionStoppedError,
    Path,
    SupersededError,
    Trajectory,
    follow,
)
from sjerk._binding import lib
from sjerk.host import EventKind, MoveState, PathState
from sjerk.trajectory.segments import Followed

LIMITS = [Limits(2.0, 20.0, 500.0)] * 2


def plan(points: int = 60, joints: int = 2) -> list[Followed]:
    """From rest at the origin, a wave and back."""
    t = 0.1 * np.arange(points)
    wave = 0.2 * np.sin(t) * np.sin(np.pi * np.arange(points) / (points - 1)) ** 4
    names = [f"joint {k}" for k in range(joints)]
    return list(follow(Trajectory(names, t, np.column_stack([wave] * joints)), LIMITS[:joints], T))


def later() -> Iterator[None]:
    while True:
        yield None


class Gate:
    """A source whose blocks come when they are given; an exception is raised, None is its end."""

    def __init__(self) -> None:
        self.given: queue.SimpleQueue[Followed | Exception | None] = queue.SimpleQueue()

    def __iter__(self) -> Iterator[Followed | None]:
        while True:
            try:
                block = self.given.get_nowait()
            except queue.Empty:
                yield None
                continue
            if isinstance(block, Exception):
                raise block
            if block is None:
                return
            yield block


def goal_events(host: Host, path: Path) -> list[int]:
    return [
        e.code for e in host.events()[0] if e.kind is EventKind.GOAL and e.goal_id == path.goal_id
    ]


STOPS: dict[str, tuple[Callable[[Host, Path], object], PathState]] = {
    "cancel": (lambda host, path: path.cancel(), PathState.SUPERSEDED),
    "halt": (lambda host, path: host.halt(), PathState.STOPPED),
    "halt of one axis": (lambda host, path: host.halt(axes=1), PathState.STOPPED),
    "quick stop": (lambda host, path: host.quick_stop(), PathState.STOPPED),
    "disable": (lambda host, path: host.disable(), PathState.STOPPED),
    "move": (lambda host, path: host.move({0: 0.1}), PathState.SUPERSEDED),
    "jog": (lambda host, path: host.jog({1: 0.1}), PathState.SUPERSEDED),
}


@pytest.mark.parametrize("stop", STOPS)
def test_a_path_that_waits_for_its_first_block_is_answered(stop: str) -> None:
    """By whatever ends a path that has been sent; a block that comes after that moves nothing."""
    act, expected = STOPS[stop]
    bench = Bench([0.0, 0.0], LIMITS)
    source = Gate()
    path = bench.play(source)
    path.pump()
    bench.kernel.step(20)
    assert path.state is PathState.SENT
    act(bench.host, path)
    bench.kernel.step(2)
    assert path.state is expected
    with pytest.raises(SupersededError if expected is PathState.SUPERSEDED else MotionStoppedError):
        path.check()
    bench.host.halt()
    bench.kernel.step(2000)
    source.given.put(plan()[0])
    assert path.pump()
    bench.kernel.step(50)
    assert not bench.host.feedback().moving
    assert path.state is expected
    assert bench.host.feedback().path.goal_id != path.goal_id


@pytest.mark.parametrize("stop", STOPS)
def test_in_a_process_wait_returns(stop: str) -> None:
    """The same with the thread that feeds, and a source that hangs for ever."""
    act, expected = STOPS[stop]
    hangs = threading.Event()

    def source() -> Iterator[Followed | None]:
        yield None
        hangs.wait()
        yield None

    with MotionKernel([Axis(limit, 1e6) for limit in LIMITS], T) as kernel, kernel.host() as host:
        host.enable()
        path = host.follow(source())
        act(host, path)
        with pytest.raises(MotionStoppedError):
            path.wait(30.0)
        assert path.state is expected
        hangs.set()


@pytest.mark.parametrize("stop", STOPS)
def test_a_path_that_is_open_without_a_segment_is_answered(stop: str) -> None:
    """Its one segment is held back, since it may be the last: it has not begun, and ends."""
    bench = Bench([0.0, 0.0], LIMITS)
    source = Gate()
    source.given.put(next(follow(_trajectory(), LIMITS, T, block=1, lookahead=20)))
    path = bench.play(source)
    path.pump()
    bench.kernel.step(20)
    assert bench.host.feedback().path.goal_id == path.goal_id
    STOPS[stop][0](bench.host, path)
    bench.kernel.step(200)
    assert path.state in (PathState.STOPPED, PathState.LEFT)
    with pytest.raises(MotionStoppedError):
        path.check()


def test_what_does_not_touch_it_leaves_it_waiting() -> None:
    """Goals that are refused or never seen, what is of another axis; then it plays to its end."""
    ranged = replace(LIMITS[0], position=(-1.0, 1.0))
    bench = Bench([0.0, 0.0, 0.0], [ranged, *LIMITS])
    source = Gate()
    path = bench.host.follow(source, axes=[0, 1])
    bench.host.move({0: 5.0}, relative=True)  # overwritten before the kernel sees it
    refused = bench.host.move({0: 5.0}, relative=True)
    (block,) = plan()
    source.given.put(block)
    source.given.put(None)
    assert not path.pump()  # it waits for what becomes of them
    bench.kernel.step()
    assert refused.state is MoveState.REFUSED
    bench.host.move({2: 0.1})
    bench.host.quick_stop(axes=2)
    bench.host.reset()
    bench.run(path)
    assert path.done
    assert goal_events(bench.host, path) == [lib.SJ_RESULT_ACCEPTED]


def test_a_source_that_fails_before_its_first_block_is_raised() -> None:
    """In a process by wait; in an own loop by pump, once, and then the path is over."""
    source = Gate()
    with MotionKernel([Axis(limit, 1e6) for limit in LIMITS], T) as kernel, kernel.host() as host:
        host.enable()
        path = host.follow(source)
        source.given.put(ValueError("no block"))
        with pytest.raises(ValueError, match="no block"):
            path.wait(30.0)
    bench = Bench([0.0, 0.0], LIMITS)
    path = bench.play(source)
    source.given.put(ValueError("no block"))
    with pytest.raises(ValueError, match="no block"):
        path.pump()
    assert path.pump()
    assert path.state is PathState.SUPERSEDED


def test_a_source_that_fails_on_the_way_in_an_own_loop_stops_the_path() -> None:
    """At rest on the path, and told by pump once."""
    bench = Bench([0.0, 0.0], LIMITS)
    source = Gate()
    source.given.put(next(iter(follow(_trajectory(), LIMITS, T, block=20, lookahead=20))))
    path = bench.play(source)
    bench.run(path, until=lambda: path.progress.point > 3)
    source.given.put(ValueError("no more"))
    with pytest.raises(ValueError, match="no more"):
        path.pump()
    bench.run(path)
    assert path.state is PathState.STOPPED
    with pytest.raises(ValueError, match="no more"):
        path.check()


def _trajectory() -> Trajectory:
    (block,) = plan(200)
    return Trajectory(block.joint_names, 0.1 * np.arange(200), block.position)


@pytest.mark.parametrize("stop", [*STOPS, "source fails"])
def test_a_splice_that_waits_for_its_first_block_is_answered(stop: str) -> None:
    """With the path that it was to replace, which comes to rest within the limits."""
    bench = Bench([0.0, 0.0], LIMITS)
    (block,) = plan()
    path = bench.play(block)
    bench.run(path, until=lambda: path.progress.point > 20)
    source = Gate()
    new = path.splice(source, path.progress.point + 20)
    bench.kernel.step(20)
    assert (path.state, new.state) == (PathState.RUNS, PathState.SENT)
    if stop == "source fails":
        source.given.put(ValueError("no block"))
        with pytest.raises(ValueError, match="no block"):
            new.pump()
        expected = PathState.SUPERSEDED
    else:
        act, expected = STOPS[stop]
        act(bench.host, new)
    bench.kernel.step(8000)
    assert new.state is expected
    assert path.state in (PathState.STOPPED, PathState.LEFT)
    source.given.put(block)
    assert new.pump()
    assert new.state is expected


def test_a_splice_whose_path_ends_first_is_over_too() -> None:
    """The kernel stops the path by itself: nothing is left to take over from."""
    bench = Bench([0.0, 0.0], LIMITS)
    (block,) = plan()
    path = bench.play(block)
    bench.run(path, until=lambda: path.progress.point > 20)
    new = path.splice(later(), path.progress.point + 20)
    path.cancel()
    bench.kernel.step(3000)
    assert path.state is PathState.STOPPED
    assert new.state is PathState.STOPPED
    with pytest.raises(InputError, match="sent are way-points"):
        new.splice(block, 30)


@pytest.mark.parametrize("stop", ["cancel", "halt", "move"])
def test_a_path_that_waits_for_its_turn_is_answered_once(stop: str) -> None:
    """Its opening is taken back; segments that come after that are of a path that is over."""
    act, expected = STOPS[stop]
    bench = Bench([0.0, 0.0], LIMITS)
    bench.host.move([1.0, 1.0])
    bench.kernel.step(20)
    bench.host.events()
    source = Gate()
    source.given.put(next(iter(follow(_trajectory(), LIMITS, T, block=20, lookahead=20))))
    path = bench.play(source)
    bench.kernel.step(20)
    act(bench.host, path)
    blocks = follow(_trajectory(), LIMITS, T, block=20, lookahead=20)
    next(blocks)
    source.given.put(next(blocks))
    path.pump()
    bench.kernel.step(3000)
    assert path.state is expected
    assert len(goal_events(bench.host, path)) == 1


def test_a_cancelled_path_that_waits_does_not_disturb_the_one_in_play() -> None:
    """Its pause stays, and so do both cancellations, sent in the same cycle."""
    bench = Bench([0.0, 0.0], LIMITS)
    (one,) = plan(joints=1)
    first = bench.host.follow(one, axes=[0])
    bench.kernel.step(500)
    first.pause()
    bench.kernel.step(2000)
    assert first.state is PathState.PAUSED
    second = bench.host.follow(one, axes=[1])
    bench.kernel.step(5)
    second.cancel()
    bench.kernel.step(500)
    assert second.state is PathState.SUPERSEDED
    assert first.state is PathState.PAUSED
    third = bench.host.follow(one, axes=[1])
    bench.kernel.step(5)
    third.cancel()
    first.cancel()
    bench.kernel.step(500)
    assert third.state is PathState.SUPERSEDED
    assert first.state is PathState.STOPPED


def _wait(path: Path, waits: threading.Event) -> None:
    waits.set()
    path.wait(30.0)


def test_after_ctrl_c_in_wait_the_path_can_be_cancelled() -> None:
    """The handle is as it was."""
    waits = threading.Event()

    def source() -> Iterator[None]:
        yield None
        waits.wait()
        signal.raise_signal(signal.SIGINT)  # to the main thread
        yield from later()

    with MotionKernel([Axis(limit, 1e6) for limit in LIMITS], T) as kernel, kernel.host() as host:
        host.enable()
        path = host.follow(source())
        with pytest.raises(KeyboardInterrupt):
            _wait(path, waits)
        assert path.state is PathState.SENT
        path.cancel()
        with pytest.raises(SupersededError):
            path.wait(30.0)
