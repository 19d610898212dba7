"""Scripts of hosts: moves, paths, streams of goals, goals of an executor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from random import Random
from typing import Any

import numpy as np
from adapter import find, reactions
from drawn import PERIODS, UNITS, WAITS, axis, kernel, limits, lower, names, some, times, way
from told import Told, run

from sjerk import (
    Axis,
    GoalStream,
    Host,
    Limits,
    MotionKernel,
    State,
    StreamPlayer,
    Trajectory,
    TrajectoryExecutor,
    follow,
    follow_path,
    follow_within,
)

BUFFERS = ("buffered", "blend low", "blend previous", "blend next", "blend high")
SYNCHRONIZATIONS = ("time", "time", "none", "phase")


# ---- moves ---------------------------------------------------------------------------------------


class Hand:
    """Gives one random order after the other and tells what becomes of them."""

    def __init__(self, draw: Random, told: Told, host: Host, axes: tuple[Axis, ...]) -> None:
        self.draw, self.told, self.host, self.axes = draw, told, host, axes
        self.handles: list[Any] = []
        self.own = [axis.limits for axis in axes]
        self.unit = max(axis.limits.velocity for axis in axes) / 90.0

    def give(self, *orders: str) -> None:
        """One of these orders."""
        order = self.draw.choice(orders)
        self.told.event("order", order)
        getattr(self, f"_{order}")(some(self.draw, len(self.axes)))
        self.tell()

    def tell(self) -> None:
        """What has become of everything so far."""
        self.told.event("states", [handle.state for handle in self.handles])

    def _attempt(self, call: Any, *given: Any, **options: Any) -> Any:
        return self.told.attempt(call, *given, **options)

    def _handle(self, call: Any, *given: Any, **options: Any) -> None:
        made = self._attempt(call, *given, **options)
        if made is not None:
            self.handles.append(made)

    def _far(self, most: float) -> float:
        return self.draw.choice([self.draw.uniform(-most, most), 1.0, -0.5]) * self.unit

    def _queued(self, chosen: list[int]) -> None:
        self._handle(
            self.host.move,
            {i: self._far(12.0) for i in chosen},
            relative=True,
            limits={i: lower(self.draw, self.own[i]) for i in chosen},
            synchronization=self.draw.choice(SYNCHRONIZATIONS),
            buffer=self.draw.choice(BUFFERS),
        )

    def _move(self, chosen: list[int]) -> None:
        self._handle(
            self.host.move,
            {i: self._far(30.0) for i in chosen},
            synchronization=self.draw.choice(SYNCHRONIZATIONS),
            min_duration=self.draw.choice([0.0, 0.0, self.draw.uniform(0.0, 2.0)]),
            relative=self.draw.random() < 0.2,
        )

    def _onward(self, chosen: list[int]) -> None:
        """Arrive with a velocity."""
        draw, own = self.draw, self.own
        self._handle(
            self.host.move,
            {i: State(self._far(30.0), draw.uniform(-0.5, 0.5) * own[i].velocity) for i in chosen},
            synchronization=draw.choice(["time", "none"]),
        )

    def _turn(self, _: list[int]) -> None:
        endless = {i: axis.wrap for i, axis in enumerate(self.axes) if axis.wrap}
        if endless:
            self._handle(
                self.host.move,
                {i: self.draw.uniform(0.0, wrap) for i, wrap in endless.items()},
                direction=self.draw.choice(["shortest", "positive", "negative"]),
            )

    def _jog(self, chosen: list[int]) -> None:
        self._handle(
            self.host.jog,
            {i: self.draw.uniform(-1.0, 1.0) * self.own[i].velocity for i in chosen},
        )

    def _both(self, chosen: list[int]) -> None:
        """A goal and a stop in one command."""
        self._queued(chosen)
        self._halt(chosen[:1])

    def _halt(self, chosen: list[int]) -> None:
        self.host.halt(axes=chosen, timeout=None)

    def _quick_stop(self, chosen: list[int]) -> None:
        self.host.quick_stop(axes=chosen, timeout=None, together=self.draw.random() < 0.5)

    def _hold(self, _: list[int]) -> None:
        self.host.hold()

    def _resume(self, _: list[int]) -> None:
        self.host.resume()

    def _override(self, _: list[int]) -> None:
        self.host.override(self.draw.choice([0.0, 0.3, 0.7, 1.0, 1.5, self.draw.uniform(0.0, 2.0)]))

    def _cancel(self, _: list[int]) -> None:
        if self.handles:
            self._attempt(self.draw.choice(self.handles).cancel)

    def _disable(self, chosen: list[int]) -> None:
        self.host.disable(axes=chosen, timeout=None)

    def _enable(self, _: list[int]) -> None:
        self.host.enable(timeout=None)

    def _reset(self, chosen: list[int]) -> None:
        self.host.reset(axes=chosen, timeout=None)

    def _home(self, chosen: list[int]) -> None:
        self._handle(self.host.home, axes=chosen)

    def _limits(self, chosen: list[int]) -> None:
        i = self.draw.choice(chosen)
        other = lower(self.draw, self.axes[i].limits)
        if self.draw.random() < 0.1:
            other = times(other, 1e4)  # more than its drive follows
        if self._attempt(self.host.set_limits, other, axes=[i], timeout=None) is None:
            self.own[i] = replace(other, position=self.own[i].position)

    def recover(self) -> Iterator[int]:
        """Everything back to how it was at first."""
        self.host.enable(timeout=None)
        self.host.resume()
        self.host.override(1.0)
        yield 600
        self.tell()


def moves(draw: Random, told: Told) -> None:
    """Queue, blends, halts, quick stops, holds, overrides, jogs, limits, enabling."""
    machine = kernel(draw, draw.choice(UNITS), reactions=_reactions(draw))

    def play(host: Host) -> Iterator[int]:
        hand = Hand(draw, told, host, machine.axes)
        host.enable()
        yield 10
        rare = ["hold", "resume", "override", "cancel", "jog", "onward", "turn", "limits", "both"]
        rare += ["halt", "quick_stop", "disable", "enable", "reset"]
        for _ in range(draw.randint(4, 16)):
            hand.give(*["queued"] * 9, *["move"] * 3, *rare)
            yield draw.choice(WAITS)
            hand.tell()
        yield from hand.recover()

    run(told, machine, play, 5000)


def _reactions(draw: Random) -> Any:
    return reactions(*draw.choices(["none", "halt", "quick stop"], k=7))


# ---- paths ---------------------------------------------------------------------------------------


def _source(draw: Random, blocks: list[Any]) -> Any:
    """All at once, or as they come."""
    if draw.random() < 0.5:
        return blocks
    late = [draw.choice([0, 0, 0, 1, 4]) for _ in blocks]

    def coming() -> Iterator[Any]:
        for block, waits in zip(blocks, late, strict=True):
            for _ in range(waits):
                yield None
            yield block

    return coming()


def _blocks(draw: Random, own: list[Limits], start: list[float], T: float) -> list[Any]:
    """Followed segments from rest at a position, by every way to make them."""
    plan = way(draw, own, start, T)
    how = draw.choice(["times", "times", "within", "path", "corners"])
    block = draw.choice([4, 16, 64, 256])
    if how == "within":
        return list(
            follow_within(plan, own, T, tolerance=draw.uniform(1e-4, 1e-2) * own[0].velocity).blocks
        )
    if how == "times":
        return list(follow(plan, own, T, block=block))
    tolerance = draw.uniform(1e-3, 5e-2) * own[0].velocity if how == "corners" else None
    some_points = plan.position[:: max(1, len(plan) // 25)]
    return list(follow_path(some_points, own, T, tolerance=tolerance, block=block))


class Walker(Hand):
    """A hand that plays paths too."""

    def __init__(self, *given: Any, cycle_time: float) -> None:
        super().__init__(*given)
        self.T = cycle_time
        self.paths: list[tuple[Any, list[Any]]] = []

    def _here(self) -> list[float]:
        return [axis.position for axis in self.host.feedback().axes]

    def _follow(self, chosen: list[int]) -> None:
        here = self._here()
        own = [self.own[i] for i in chosen]
        made = self._attempt(_blocks, self.draw, own, [here[i] for i in chosen], self.T)
        if made:
            self._play(made, self._attempt(self.host.follow, _source(self.draw, made), axes=chosen))

    def _play(self, made: list[Any], path: Any) -> None:
        if path is not None:
            self.paths.append((path, made))
            self.handles.append(path)

    def _pause(self, _: list[int]) -> None:
        if self.paths:
            self._attempt(self.paths[-1][0].pause)

    def _go(self, _: list[int]) -> None:
        if self.paths:
            self._attempt(self.paths[-1][0].resume)

    def _speed(self, _: list[int]) -> None:
        if self.paths:
            factor = self.draw.choice([0.0, 0.3, 1.0, 1.0, 1.3, self.draw.uniform(0.0, 2.0)])
            self._attempt(self.paths[-1][0].speed, factor)

    def _splice(self, _: list[int]) -> None:
        """Another way on from a place ahead, or the brake, or a way-point that is none."""
        if not self.paths:
            return
        path, made = self.paths[-1]
        block, T = self.draw.choice(made), self.T
        total = int(block.cycles.sum())
        told = path.progress
        passed = int(block.cycles[: max(told.point - 1 - block.first, 0)].sum())
        low = min(max(1, passed - 20), total - 1)
        place = self.draw.randint(low, min(total - 1, max(low, passed + 900)))
        head, tail = find("split")(block, place)
        knot = find("Knot").of(head)
        own = [self.own[i] for i in path.axes]
        kind = self.draw.choice(["brake", "same", "way", "way"])
        blocks: Any = None
        if kind == "same":
            blocks = [replace(tail, first=0)]
        elif kind == "brake":
            blocks = self._attempt(find("brake"), knot, own, T)
            blocks = blocks and [blocks]
        else:
            ahead = way(self.draw, own, knot.position.tolist(), T)
            shifted = ahead.position + np.outer(np.minimum(ahead.time, 0.2), knot.velocity)
            shifted[0] = knot.position
            ahead = Trajectory(ahead.joint_names, ahead.time, shifted)
            blocks = self._attempt(lambda: list(follow(ahead, own, T, begin=knot)))
        if blocks:
            at = block.first + len(head)
            after = place - int(head.cycles[:-1].sum())
            self._play(blocks, self._attempt(path.splice, blocks, at, after=after))

    def pump(self) -> None:
        """Feed all paths, in the order of their begin."""
        for path, _ in self.paths:
            self._attempt(path.pump)

    def tell(self) -> None:
        """Paths with their progress."""
        super().tell()
        for path, _ in self.paths[-2:]:
            self.told.event("progress", path.progress)


def paths(draw: Random, told: Told) -> None:
    """Paths by all sources, also late ones: speed, pause, cancel, splices, stops, moves behind."""
    unit, T = draw.choice(UNITS), draw.choice(PERIODS)
    machine = MotionKernel([axis(draw, unit) for _ in range(draw.randint(1, 7))], T)
    orders = ["follow"] * 4 + ["splice"] * 4 + ["speed"] * 4 + ["pause", "go", "go"]
    orders += ["cancel", "halt", "quick_stop", "queued", "move", "override", "hold", "resume"]
    orders += ["jog", "disable", "enable", "limits"]

    def play(host: Host) -> Iterator[int]:
        hand = Walker(draw, told, host, machine.axes, cycle_time=T)
        host.enable()
        yield 10
        hand.give("follow")
        for _ in range(draw.randint(3, 12)):
            wait, gap = draw.choice([1, 7, 40, 200, 700]), draw.choice([1, 5, 16, 64, 256])
            while wait > 0:
                yield min(wait, gap)
                wait -= gap
                hand.pump()
            hand.tell()
            hand.give(*orders)
        yield from hand.recover()
        for _ in range(20):
            hand.pump()
            yield 50
        hand.tell()

    run(told, machine, play, 6000)


# ---- streams of goals ----------------------------------------------------------------------------


def _wander(
    draw: Random, own: list[Limits], at: list[float], period: float
) -> Iterator[list[float]]:
    """Goals of joints that go about as fast as they may, rest, and turn back; without end."""
    velocity = [0.0] * len(own)
    calm = draw.choice([0.2, 0.6, 1.2])
    rests = 0
    while True:
        if rests == 0 and draw.random() < 0.02:
            rests = draw.randint(1, 12)
        rests = max(0, rests - 1)
        for k, limit in enumerate(own):
            step = draw.uniform(-1.0, 1.0) * calm * limit.acceleration * period
            most = calm * limit.velocity
            velocity[k] = 0.0 if rests else max(-most, min(most, velocity[k] + step))
            at[k] += velocity[k] * period
        yield list(at)


def streams(draw: Random, told: Told) -> None:
    """Goals with jitter, gaps and ends: the stream by itself, or played in a kernel."""
    if draw.random() < 0.5:
        _stream_alone(draw, told)
    else:
        _stream_played(draw, told)


def _stream_alone(draw: Random, told: Told) -> None:
    unit, T = draw.choice(UNITS), draw.choice(PERIODS)
    own = [limits(draw, unit) for _ in range(draw.randint(1, 6))]
    period = T * draw.choice([2, 5, 20, 100, draw.uniform(3.0, 80.0)])
    start = [draw.uniform(-10.0, 10.0) * unit for _ in own]
    stream = GoalStream(
        own,
        T,
        start,
        period=period,
        delay=draw.randint(1, 8),
        margin=draw.choice([0.0, draw.uniform(0.0, 0.05)]),
        stop_within=draw.random() < 0.3,
    )
    goals = _wander(draw, own, start, period)
    now, stamp = 0.0, 0.0
    stamped = draw.random() < 0.5
    for k in range(draw.randint(10, 80)):
        now += period * (
            draw.choice([0.0, 1.0, 1.0, draw.uniform(0.5, 1.5)]) + (draw.random() < 0.03) * 8
        )
        stamp += period * draw.uniform(0.7, 1.3)
        told.attempt(stream.push, next(goals), stamp if stamped and k else None)
        for block in told.attempt(stream.take, int(now / T)) or []:
            _tell_block(told, block)
    stream.end()
    told.event("report", stream.report)
    for _ in range(400):
        if stream.done:
            break
        for block in told.attempt(stream.take, stream.cycle + draw.randint(1, 200)) or []:
            _tell_block(told, block)
    told.event("report", stream.report, stream.done)


def _tell_block(told: Told, block: Any) -> None:
    told.samples(block.sample())
    for name in ("cycles", "stretch", "lengths"):
        told.motion(name, getattr(block, name))


def _stream_played(draw: Random, told: Told) -> None:
    unit, T = draw.choice(UNITS), draw.choice(PERIODS)
    machine = MotionKernel([axis(draw, unit) for _ in range(draw.randint(1, 4))], T)
    n = len(machine.axes)
    every = draw.choice([4, 10, 33, 100])
    gap = draw.choice([1, 4, 4, 20])

    def play(host: Host) -> Iterator[int]:
        host.enable()
        yield 10
        chosen = some(draw, n)
        options: dict[str, Any] = {
            "delay": draw.randint(1, 6),
            "ahead": draw.choice([0.02, 0.05, 12 * T]),
            "stop_within": draw.random() < 0.3,
        }

        def begun() -> StreamPlayer:
            return StreamPlayer(host, period=every * T, axes=chosen, **options)

        def look(call: Any, *given: Any) -> Iterator[int]:
            """Where the motion was ended by another hand another player goes on from rest."""
            nonlocal player, goals
            told.attempt(call, *given)
            if told.refused:
                told.event("report", player.report)
                host.reset(timeout=None)
                yield 300
                player, goals = begun(), wander()

        def wander() -> Iterator[list[float]]:
            frame = host.feedback()
            here = [frame.axes[i].position for i in chosen]
            return _wander(draw, [machine.axes[i].limits for i in chosen], here, every * T)

        player, goals = begun(), wander()
        count, silent, left = 0, 0, draw.randint(10, 60)
        while left > 0:
            yield gap
            count += gap
            if count >= every:
                count -= every
                left -= 1
                silent = max(0, silent - 1) or (draw.random() < 0.03) * draw.randint(1, 20)
                if not silent:
                    yield from look(player.push, next(goals))
            yield from look(player.update)
            if draw.random() < 0.002:
                told.event("order", "stop")
                draw.choice([host.halt, host.quick_stop, host.hold, host.resume])(timeout=None)
        told.event("report", player.report)
        player.end()
        host.resume()
        for _ in range(200):
            yield gap
            told.attempt(player.update)
        told.event("report", player.report, told.attempt(lambda: player.done))

    run(told, machine, play, 60 * every + 1500 + 200 * gap)


# ---- goals of an executor ------------------------------------------------------------------------


def executor(draw: Random, told: Told) -> None:
    """Goals with stamps and tolerances, replaced, paused, canceled, stopped by another hand."""
    unit, T = draw.choice(UNITS), draw.choice(PERIODS[:-1])
    machine = MotionKernel([axis(draw, unit) for _ in range(draw.randint(1, 7))], T)
    gap = draw.choice([1, 5, 5, 5, 20])

    def play(host: Host) -> Iterator[int]:
        def clock() -> float:
            return host.feedback().cycle * T

        host.enable()
        yield 10
        n = len(machine.axes)
        commander = TrajectoryExecutor(
            host,
            names(n),
            settings=_settings(draw, n, unit),
            feedback_rate=draw.choice([20.0, 100.0]),
            clock=clock,
            on_feedback=lambda goal, feedback: told.event("feedback", goal.number, feedback),
            on_result=lambda goal: told.event("result", goal.number, goal.status, goal.code),
        )
        goals: list[Any] = []
        for _ in range(draw.randint(3, 14)):
            order = draw.choice(
                ["goal"] * 12 + ["cancel", "pause", "resume", "speed", "settings", "stop"]
            )
            told.event("order", order)
            if order == "goal":
                goals.append(_submit(draw, told, host, machine, commander, clock()))
            elif order == "settings":
                commander.settings = _settings(draw, n, unit)
            elif order == "stop":
                draw.choice([host.halt, host.quick_stop])(axes=some(draw, n), timeout=None)
            elif goals:
                call = getattr(draw.choice(goals[-2:]), order)
                told.attempt(call, *([draw.uniform(0.0, 2.0)] if order == "speed" else []))
            for _ in range(draw.choice([1, 10, 60, 200]) * 5 // gap + 1):
                yield gap
                told.attempt(commander.update)
            told.event("goals", [(goal.status, goal.code, goal.stretch) for goal in goals])
        for _ in range(1500 // gap):
            yield gap
            told.attempt(commander.update)
        commander.close()
        yield 300
        told.event("goals", [(goal.status, goal.code, goal.stretch) for goal in goals])

    run(told, machine, play, 12_000)


def _settings(draw: Random, n: int, unit: float) -> Any:
    Tolerance = find("Tolerance")
    near = {name: Tolerance(draw.uniform(1e-3, 1.0) * unit) for name in names(n)}
    return find("Settings", "ExecutorSettings")(
        execution_mode=draw.choice(list(find("ExecutionMode"))),
        resampling_delta=draw.choice([0.0, 0.0, draw.uniform(0.0, 1.0) * unit]),
        speed=draw.choice([1.0, 1.0, 1.0, draw.uniform(0.1, 2.0)]),
        tolerance=draw.choice([0.0, 0.0, draw.uniform(1e-3, 0.1) * unit]),
        allow_partial_joints=draw.random() < 0.5,
        path_tolerance=draw.choice([{}, {}, near]),
        goal_tolerance=draw.choice([{}, {}, near]),
        goal_time=draw.choice([0.0, 0.3]),
        start_tolerance=draw.choice([None, None, None, 0.01 * unit]),
    )


def _submit(
    draw: Random, told: Told, host: Host, machine: MotionKernel, commander: Any, now: float
) -> Any:
    n = len(machine.axes)
    chosen = list(range(n)) if draw.random() < 0.8 else some(draw, n)
    draw.shuffle(chosen)
    frame = host.feedback()
    own = [machine.axes[i].limits for i in chosen]
    start = [frame.axes[i].position for i in chosen]
    if draw.random() < 0.2:
        start = [x + draw.uniform(-0.1, 0.1) * o.velocity for x, o in zip(start, own, strict=True)]
    made = way(draw, own, start, machine.cycle_time)
    shift = draw.choice([0.0, 0.0, draw.uniform(0.0, 1.0)])
    trajectory = Trajectory([names(n)[i] for i in chosen], made.time + shift, made.position)
    stamp = draw.choice(
        [0.0, 0.0, now, now + draw.uniform(0.0, 0.8), now + 0.3, now - draw.uniform(0.0, 0.5)]
    )
    goal = told.attempt(commander.submit, trajectory, stamp=max(stamp, 0.0))
    told.event("submitted", goal.number, goal.status, goal.code)
    return goal
