"""Scripts of hosts: moves, and paths."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import replace
from random import Random
from typing import Any

import numpy as np

from adapter import find, reactions
from drawn import PERIODS, UNITS, WAITS, axis, kernel, lower, some, times, way
from sjerk import (
    Axis,
    Host,
    Limits,
    MotionKernel,
    State,
    Trajectory,
    follow,
    follow_path,
    follow_within,
)
from told import Told, run

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

    def recover(self) -> Generator[int]:
        """Everything back to how it was at first."""
        self.host.enable(timeout=None)
        self.host.resume()
        self.host.override(1.0)
        yield 600
        self.tell()


def moves(draw: Random, told: Told) -> None:
    """Queue, blends, halts, quick stops, holds, overrides, jogs, limits, enabling."""
    machine = kernel(draw, draw.choice(UNITS), reactions=_reactions(draw))

    def play(host: Host) -> Generator[int]:
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

    def play(host: Host) -> Generator[int]:
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
