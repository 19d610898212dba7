"""Scripts of goals that come one by one: streams, and those of an executor."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from random import Random
from typing import Any

from adapter import find
from drawn import PERIODS, UNITS, axis, limits, names, some, way
from sjerk import (
    GoalStream,
    Host,
    Limits,
    MotionKernel,
    StreamPlayer,
    Trajectory,
    TrajectoryExecutor,
)
from told import Told, run

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


class Streamer:
    """A player of goals of some axes, begun anew where another hand has ended its motion."""

    def __init__(
        self, draw: Random, told: Told, host: Host, machine: MotionKernel, every: int
    ) -> None:
        self.told, self.host, self.draw = told, host, draw
        self.own = [axis.limits for axis in machine.axes]
        self.period, T = every * machine.cycle_time, machine.cycle_time
        self.chosen = some(draw, len(self.own))
        self.options: dict[str, Any] = {
            "delay": draw.randint(1, 6),
            "ahead": draw.choice([0.02, 0.05, 12 * T]),
            "stop_within": draw.random() < 0.3,
        }
        self.begin()

    def begin(self) -> None:
        """From rest where the axes are."""
        frame = self.host.feedback()
        here = [frame.axes[i].position for i in self.chosen]
        own = [self.own[i] for i in self.chosen]
        self.goals = _wander(self.draw, own, here, self.period)
        self.player = StreamPlayer(self.host, period=self.period, axes=self.chosen, **self.options)

    def update(self) -> Generator[int]:
        """Feed; the cycles that a new beginning takes."""
        self.told.attempt(self.player.update)
        if self.told.refused:
            self.tell()
            self.host.reset(timeout=None)
            yield 300
            self.begin()

    def push(self) -> None:
        """One more goal."""
        self.told.attempt(self.player.push, next(self.goals))

    def tell(self) -> None:
        """What has become of the goals."""
        self.told.event("report", self.player.report)


def _stream_played(draw: Random, told: Told) -> None:
    unit, T = draw.choice(UNITS), draw.choice(PERIODS)
    machine = MotionKernel([axis(draw, unit) for _ in range(draw.randint(1, 4))], T)
    every = draw.choice([4, 10, 33, 100])
    gap = draw.choice([1, 4, 4, 20])

    def play(host: Host) -> Generator[int]:
        host.enable()
        yield 10
        stream = Streamer(draw, told, host, machine, every)
        count, silent, left = 0, 0, draw.randint(10, 60)
        while left > 0:
            yield gap
            count += gap
            if count >= every:
                count -= every
                left -= 1
                silent = max(0, silent - 1) or (draw.random() < 0.03) * draw.randint(1, 20)
                if not silent:
                    stream.push()
            yield from stream.update()
            if draw.random() < 0.002:
                told.event("order", "stop")
                draw.choice([host.halt, host.quick_stop, host.hold, host.resume])(timeout=None)
        stream.tell()
        stream.player.end()
        host.resume()
        for _ in range(200):
            yield gap
            told.attempt(stream.player.update)
        stream.tell()
        told.event("done", told.attempt(lambda: stream.player.done))

    run(told, machine, play, 60 * every + 1500 + 200 * gap)


# ---- goals of an executor ------------------------------------------------------------------------


def executor(draw: Random, told: Told) -> None:
    """Goals with stamps and tolerances, replaced, paused, canceled, stopped by another hand."""
    unit, T = draw.choice(UNITS), draw.choice(PERIODS[:-1])
    machine = MotionKernel([axis(draw, unit) for _ in range(draw.randint(1, 7))], T)
    gap = draw.choice([1, 5, 5, 5, 20])

    def play(host: Host) -> Generator[int]:
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
