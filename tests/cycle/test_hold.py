"""Synchronised moves that are held: on the line in joint space that was planned, and together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from helpers.chains import COUNTS, OWN, SOME, T
from helpers.loops import enabled
from sjerk import Axis, Host, Limits, MotionKernel, Move
from sjerk.cycle.states import AxisState
from sjerk.host import MoveState
from sjerk.recording import Frames

#: A hold whose axes cannot brake harder than they do lasts to the goal.
LONG = 2500
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Case:
    """Limits by axis; a move, and another that takes over on the way (0: none)."""

    limits: tuple[Limits, ...]
    first: tuple[float, ...]
    goal: tuple[float, ...]
    change: int
    synchronization: str


@st.composite
def cases(draw: st.DrawFn) -> Case:
    axes = draw(st.integers(2, 5))
    limits = [
        Limits(
            draw(st.floats(20.0, 90.0)),
            draw(st.floats(200.0, 600.0)),
            draw(st.floats(3000.0, 9000.0)),
            deceleration=draw(st.floats(200.0, 600.0)),
            deceleration_jerk=draw(st.floats(3000.0, 9000.0)),
        )
        for _ in range(axes)
    ]
    way = st.one_of(st.integers(-40_000, 40_000), st.integers(-1000, 1000)).map(lambda n: n / 1000)
    ways = st.tuples(*[way] * axes).filter(lambda some: np.abs(some).max() > 0.5)
    change = draw(st.sampled_from([0, 0, 40, 130, 300]))
    first = draw(ways)
    goal = draw(ways.filter(lambda some: some != first))
    synchronization = "phase" if change and axes == 3 else "time"
    return Case(tuple(limits), first, goal, change, synchronization)


class Bench:
    """One case, each cycle recorded: positions, and which axes are held."""

    def __init__(self, case: Case) -> None:
        self.kernel, self.host = enabled([Axis(one, COUNTS) for one in case.limits], T)
        if case.change:
            self.host.move(case.first, synchronization=case.synchronization)  # type: ignore[arg-type]
            self.kernel.step(case.change)
        self.frames = Frames(self.kernel)
        self.move = self.host.move(case.goal)

    def step(self, cycles: int) -> None:
        self.frames.step(cycles)

    @property
    def feed_hold(self) -> list[int]:
        """Bits of the axes on a feed hold, by cycle."""
        feed_hold: list[int] = self.frames.table["feed_hold"].tolist()
        return feed_hold

    def finish(self) -> None:
        for _ in range(20_000):
            self.step(1)
            if self.move.done:
                return
        raise AssertionError(f"it never ended: {self.move.state}")

    @property
    def table(self) -> Array:
        """(cycles, axes, 4): position, velocity, acceleration, jerk per cycle."""
        axes = self.frames.table["axis"]
        return np.stack(
            [axes[name] for name in ("position", "velocity", "acceleration", "jerk")], 2
        )


class Line:
    """The curve through the samples of a motion: q(s) = P(s - 1/2) + 5/24 A(s - 1/2).

    The continuous state at the end of a cycle by the half-cycle lemma, one jerk to the next.
    """

    def __init__(self, table: Array) -> None:
        q, v, a, j = (table[:, :, n] for n in range(4))
        A, V = a + j / 2, v + a / 2
        P = q + v / 2 - A / 12
        # and the knot before the first, one cycle of the first sample's jerk back
        back = (P[:1] - V[:1] + A[:1] / 2 - j[:1] / 6, V[:1] - A[:1] + j[:1] / 2, A[:1] - j[:1])
        self.P, self.V, self.A = (np.concatenate(x) for x in zip(back, (P, V, A), strict=True))
        self.J = np.concatenate([j, np.zeros_like(j[:1])])

    def at(self, s: Array) -> tuple[Array, Array]:
        """Positions and their slopes at places in cycles of the samples."""
        t = s + 0.5  # the first knot is a cycle before the first sample's
        i = np.clip(np.floor(t).astype(int), 0, len(self.P) - 1)
        t = (t - i)[:, None]
        P, V, A, J = self.P[i], self.V[i], self.A[i], self.J[i]
        q = P + t * (V + t * (A / 2 + t * J / 6)) + 5 / 24 * (A + t * J)
        return q, V + t * (A + t * J / 2) + 5 / 24 * J

    def places(self, rows: Array, scale: Array) -> tuple[Array, Array]:
        """Nearest places of rows that follow each other, and how far off they are."""
        places, s, last = [], 0.0, rows[0]
        for row in rows:
            if np.array_equal(row, last):
                places.append(s)
                continue
            last = row
            near = np.clip(s + np.linspace(-0.5, 1.5, 41), 0.0, None)
            q, _ = self.at(near)
            s = float(near[np.argmin((((q - row) / scale) ** 2).sum(axis=1))])
            for _ in range(6):
                q, slope = self.at(np.array([s]))
                q, slope = (q[0] - row) / scale, slope[0] / scale
                square = float(slope @ slope)
                s -= float(np.clip(q @ slope / square, -0.1, 0.1)) if square > 1e-24 else 0.0
                s = max(s, 0.0)
            places.append(s)
        at = np.array(places)
        return at, np.abs(self.at(at)[0] - rows).max(axis=1)


def most(position: Array) -> tuple[Array, Array, Array, Array, Array]:
    """By axis the largest velocity, acceleration, deceleration; jerk in driving, in braking."""
    first = np.diff(position, axis=0)
    second, third = np.diff(first, axis=0), np.diff(first, 2, axis=0)
    along = second * (first[1:] + first[:-1])
    noise = 1e-12 * np.abs(first).max() ** 2
    drives, brakes = along > noise, along < -noise
    only = brakes[1:] & brakes[:-1]
    zero = np.zeros(position.shape[1])
    return (
        np.abs(first).max(axis=0, initial=0.0) + zero,
        np.where(drives, np.abs(second), 0.0).max(axis=0),
        np.where(brakes, np.abs(second), 0.0).max(axis=0),
        np.where(~only, np.abs(third), 0.0).max(axis=0),
        np.where(only, np.abs(third), 0.0).max(axis=0),
    )


def keeps(position: Array, alone: Array, limits: tuple[Limits, ...]) -> None:
    """Driving and braking limits of every axis, or what the motion does that is not held."""
    noise = 16 * np.finfo(float).eps * np.abs(position).max() * 8
    allowed = np.array(
        [
            (
                one.velocity * T,
                one.acceleration * T**2,
                one.braking[0] * T**2,
                max(one.jerk, one.braking[1]) * T**3,
                one.braking[1] * T**3,
            )
            for one in limits
        ]
    ).T
    for name, seen, own, limit in zip(
        ("velocity", "acceleration", "deceleration", "jerk", "braking jerk"),
        most(position),
        most(alone),
        allowed,
        strict=True,
    ):
        assert np.all(seen <= np.maximum(limit, own) * (1 + 1e-9) + noise), (name, seen, limit)


def alone(case: Case) -> Array:
    bench = Bench(case)
    bench.finish()
    return bench.table


holds = st.lists(
    st.tuples(st.integers(1, 700), st.integers(1, 1200), st.booleans()), min_size=1, max_size=3
)


@settings(max_examples=SOME)
@given(cases(), holds)
def test_a_held_move_stays_on_its_way_and_ends_on_its_goal(
    case: Case, events: list[tuple[int, int, bool]]
) -> None:
    """Held and resumed anywhere, also before it rests, by a hold or by override 0: on the line of
    the same move undisturbed to 1e-6 of it, never backward, all limits kept; then its own samples
    bit for bit.
    """
    whole = alone(case)
    bench = Bench(case)
    for after, length, override in events:
        bench.step(after)
        if override:
            bench.host.override(0.0)
        else:
            bench.host.hold()
        bench.step(length)
        bench.host.override(1.0)
        bench.host.resume()
    bench.finish()
    table = bench.table
    position, reference = table[:, :, 0], whole[:, :, 0]
    keeps(position, reference, case.limits)
    way = np.abs(np.diff(reference, axis=0)).sum(axis=0)
    scale = np.maximum(way, way.max() * 1e-3)
    line = Line(whole)
    places, gaps = line.places(position, scale)
    assert gaps.max() <= 1e-6 * way.max()
    _, slope = line.at(places[1:])
    steps = np.diff(places) * (np.abs(slope) / scale).max(axis=1)
    assert steps.min() >= -1e-9
    assert position[-1].tolist() == list(case.goal) == reference[-1].tolist()
    # where its own samples begin
    back = int(np.max(np.flatnonzero(bench.feed_hold), initial=-1)) + 2
    end = int(np.flatnonzero((position != position[-1]).any(axis=1))[-1]) + 2
    own = max(end - back, 0)
    # else one axis alone was left to move, or a straight line: by plans anew
    if any(bench.feed_hold):
        assert np.array_equal(table[end - own : end], whole[len(whole) - own :])


@settings(max_examples=2 * SOME)
@example(
    Case(
        limits=(
            Limits(45.0, 274.0, 5927.0, 252.0, 7985.0),
            Limits(65.0, 472.0, 6919.0, 200.0, 7393.0),
        ),
        first=(27.486, -0.606),
        goal=(0.018, 2.387),
        change=40,
        synchronization="time",
    ),
    32,
)
@given(cases(), st.integers(1, 900))
def test_a_hold_rests_until_it_is_resumed(case: Case, at: int) -> None:
    """On its way, or on its goal where it could not brake harder than it does; and stays."""
    bench = Bench(case)
    bench.step(at)
    bench.host.hold()
    bench.step(LONG)
    rest = bench.table[-500:, :, 0]
    assert np.array_equal(rest, rest[:1].repeat(500, 0))
    assert bench.move.state is (
        MoveState.DONE if rest[-1].tolist() == list(case.goal) else MoveState.MOVING
    )
    bench.host.resume()
    if not bench.move.done:
        bench.finish()
    assert bench.table[-1, :, 0].tolist() == list(case.goal)


# ---- what may come while it is held --------------------------------------------------------------


def held(axes: int = 3, at: int = 250, wait: int = 600) -> tuple[MotionKernel, Host, Move]:
    kernel, host = enabled([Axis(OWN, COUNTS)] * axes, T)
    move = host.move([40.0, -25.0, 10.0, 5.0][:axes])
    kernel.step(at)
    host.hold()
    kernel.step(wait)
    return kernel, host, move


def positions(host: Host) -> list[float]:
    return [axis.position for axis in host.feedback().axes]


@pytest.mark.parametrize("wait", [1, 3, 5, 40, 600])
@pytest.mark.parametrize(
    "what", ["halt", "quick_stop", "cancel", "disable", "goal", "one", "slower"]
)
def test_whatever_comes_while_it_is_held_keeps_the_limits(wait: int, what: str) -> None:
    """Also before it rests: a stop ends it, a goal takes axes, another override plans anew."""
    kernel, host, move = held(wait=wait)
    rows = []

    def go(cycles: int) -> None:
        for _ in range(cycles):
            kernel.step()
            axes = host.feedback().axes
            if all(axis.follows for axis in axes):
                rows.append([axis.position for axis in axes])

    rows.append(positions(host))
    more: Any = None
    match what:
        case "halt" | "quick_stop" | "disable":
            getattr(host, what)()
        case "cancel":
            move.cancel()
        case "goal":
            more = host.move([1.0, 2.0, 3.0])
        case "one":
            more = host.move({1: 7.0})
        case "slower":
            host.override(0.5)
    go(900)
    host.resume()
    go(4000)
    stops = (np.inf,) * 2 if what == "quick_stop" else (OWN.acceleration, OWN.jerk)
    noise = 1e-12
    table = np.array(rows)
    for order, limit in enumerate((OWN.velocity, *stops), start=1):
        assert np.abs(np.diff(table, order, axis=0)).max() <= limit * T**order * (1 + 1e-9) + noise
    assert np.array_equal(table[-1], table[-100])
    match what:
        case "goal":
            assert more.done
            assert rows[-1] == [1.0, 2.0, 3.0]
        case "one":
            assert more.done
            assert rows[-1] == [40.0, 7.0, 10.0]
        case "slower":
            assert move.done
            assert rows[-1] == [40.0, -25.0, 10.0]
        case _:
            assert move.state is MoveState.STOPPED
    if what == "disable":
        assert all(a.state is AxisState.DISABLED for a in host.feedback().axes)


def test_two_moves_are_held_together_and_each_ends_in_its_frame() -> None:
    """One nearly at its goal, another of other axes in the middle; both answers are right."""
    kernel, host = enabled([Axis(OWN, COUNTS)] * 4, T)
    near = host.move({0: 5.0, 1: -4.0})
    kernel.step()
    far = host.move({2: 40.0, 3: 33.0})
    kernel.step(180)
    host.hold()
    kernel.step(900)
    assert host.feedback().axes[2].velocity == 0.0
    assert far.state is MoveState.MOVING
    host.resume()
    for _ in range(4000):
        kernel.step()
        at = positions(host)
        assert near.done == (at[:2] == [5.0, -4.0])
        assert far.done == (at[2:] == [40.0, 33.0])
    assert near.done
    assert far.done


def test_a_move_that_waits_behind_a_held_one_begins_after_it() -> None:
    """Buffered behind it while it is held: neither before its turn nor lost."""
    kernel, host, move = held()
    behind = host.move([0.0, 0.0, 0.0], buffer="blend low")
    kernel.step(300)
    assert behind.state is MoveState.QUEUED
    host.resume()
    for _ in range(6000):
        kernel.step()
        if behind.done:
            break
    assert move.done
    assert behind.done
    assert positions(host) == [0.0, 0.0, 0.0]
