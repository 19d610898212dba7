"""Chains of queued moves: drawn at random, played in an own loop, and what every run must keep."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st

from helpers.loops import enabled
from sjerk import Axis, Host, Limits, MotionKernel, Move
from sjerk.host import Event, EventKind, MoveState
from sjerk.recording import Frames

T = 1e-3
COUNTS = 2**24 / 360.0
OWN = Limits(90.0, 500.0, 5000.0, deceleration=300.0, deceleration_jerk=4000.0)
#: Whole runs are long: fewer of them than of plans.
SOME = max(settings().max_examples // 4, 25)
RANGE = (-60.0, 60.0)
MODES = ("buffered", "blend low", "blend previous", "blend next", "blend high")


def stepped(axes: int = 1, limits: Limits = OWN) -> tuple[MotionKernel, Host]:
    stop = replace(limits, deceleration=2000.0, deceleration_jerk=40000.0)
    kernel, host = enabled([Axis(limits, COUNTS, stop_limits=stop)] * axes, T)
    host.events()
    return kernel, host


def slower(velocity: float, rest: float = 1.0) -> Limits:
    """The axes' limits with another velocity, the rest scaled."""
    return Limits(
        velocity,
        OWN.acceleration * rest,
        OWN.jerk * rest,
        deceleration=OWN.braking[0] * rest,
        deceleration_jerk=OWN.braking[1] * rest,
    )


@dataclass(frozen=True)
class Queued:
    """A move of a chain: distances by axis from the goal before."""

    ways: dict[int, float]
    limits: Limits
    buffer: str
    synchronization: str = "time"
    after: int = 0  # cycles until it is given


@dataclass
class Run:
    """What was seen: columns (cycles, axes), the moves, the events."""

    cycle: np.ndarray
    goal_id: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    jerk: np.ndarray
    follows: np.ndarray
    feed_hold: np.ndarray
    moves: list[Move]
    events: list[Event]

    def reached(self) -> dict[int, int]:
        return {e.goal_id: e.cycle for e in self.events if e.kind is EventKind.REACHED}

    def answers(self) -> Counter[int]:
        return Counter(e.goal_id for e in self.events if e.kind is EventKind.GOAL)


class Watch:
    """Steps a kernel and keeps every frame."""

    def __init__(self, kernel: MotionKernel, host: Host) -> None:
        self.kernel, self.host, self.frames = kernel, host, Frames(kernel)
        self.events: list[Event] = []
        self.look()

    def look(self) -> bool:
        self.events += self.host.events()[0]
        return bool(self.frames.newest["axis"]["moving"].any())

    def step(self, cycles: int = 1) -> bool:
        """Whether any axis moves."""
        moving = True
        for _ in range(cycles):
            self.frames.step()
            moving = self.look()
        return moving

    def run(self, moves: list[Move], most: int = 40_000) -> Run:
        """On to the end of all of them."""
        over = (MoveState.SENT, MoveState.QUEUED, MoveState.MOVING)
        for _ in range(most):
            if not self.step() and not any(move.state in over for move in moves):
                return self.seen(moves)
        raise AssertionError(f"it never ended: {[move.state for move in moves]}")

    def seen(self, moves: list[Move]) -> Run:
        table = self.frames.table
        axes = table["axis"]
        columns = (axes[name] for name in [*Run.__dataclass_fields__][1:-3])
        bits = np.arange(axes.shape[1], dtype=table["feed_hold"].dtype)
        feed_hold = (table["feed_hold"][:, None] >> bits & 1).astype(bool)
        return Run(table["cycle"], *columns, feed_hold, moves, self.events)


def give(host: Host, one: Queued, buffer: str | None = None) -> Move:
    return host.move(
        dict(one.ways),
        relative=True,
        limits=one.limits,
        synchronization=one.synchronization,  # type: ignore[arg-type]
        buffer=buffer or one.buffer,  # type: ignore[arg-type]
    )


def play(axes: int, chain: list[Queued]) -> Run:
    """Give the moves one by one and watch them to their end."""
    watch = Watch(*stepped(axes))
    moves = []
    for one in chain:
        watch.step(one.after)
        moves.append(give(watch.host, one))
    return watch.run(moves)


def last_cycle_when_buffered(axes: int, chain: list[Queued]) -> int:
    """The cycle in which the same moves, each from rest, are on their last goal."""
    kernel, host = stepped(axes)
    events = []
    for one in chain:
        if one.after:
            kernel.step(one.after)
        give(host, one, "buffered")
    for _ in range(4000):
        kernel.step(20)
        events += host.events()[0]
        if len(found := [e.cycle for e in events if e.kind is EventKind.REACHED]) == len(chain):
            return max(found)
    raise AssertionError("it never ended")


def kept(run: Run, limits: list[Limits], axes: int) -> None:
    """Every sample within the limits of the move it belongs to, and the samples hang together."""
    by_id = {move.goal_id: own for move, own in zip(run.moves, limits, strict=True)}
    ulp = 8 * np.spacing(np.max(np.abs(run.position)) + 1.0)
    for i in range(axes):
        q, v, a, j = (c[:, i] for c in (run.position, run.velocity, run.acceleration, run.jerk))
        assert np.max(np.abs(np.diff(q) - (v[1:] + v[:-1]) / 2)) <= ulp
        assert np.max(np.abs(np.diff(v) - (a[1:] + a[:-1]) / 2)) <= ulp
        assert np.max(np.abs(np.diff(a) - (j[1:] + j[:-1]) / 2)) <= ulp
        for goal_id, own in by_id.items():
            of = np.flatnonzero(run.goal_id[:, i] == goal_id)
            if len(of) == 0:
                continue
            slack = 1 + 1e-9
            begun, ended = abs(v[max(of[0] - 1, 0)]), abs(v[of[-1]])
            most = max(own.velocity * T, begun, ended)
            assert np.max(np.abs(v[of])) <= most * slack + ulp
            assert np.max(np.abs(a[of])) <= own.acceleration * T**2 * slack + ulp
            assert np.max(np.abs(j[of])) <= own.jerk * T**3 * slack + ulp
            assert max(begun, ended) <= OWN.velocity * T * slack


def forward_only(run: Run, axes: int) -> None:
    """No move goes back: no overshoot of any goal, no way round."""
    for i in range(axes):
        for move in run.moves:
            of = np.flatnonzero(run.goal_id[:, i] == move.goal_id)
            if len(of):
                steps = np.diff(run.position[max(of[0] - 1, 0) : of[-1] + 1, i])
                assert np.all(steps >= -1e-12) or np.all(steps <= 1e-12)


def landed(run: Run, chain: list[Queued], axes: int) -> None:
    """Every goal is met bit for bit in the frame that its event names."""
    goals = run.position[0].copy()
    reached = run.reached()
    for one, move in zip(chain, run.moves, strict=True):
        for i, way in one.ways.items():
            goals[i] += way
        assert move.state is MoveState.DONE
        row = int(np.flatnonzero(run.cycle == reached[move.goal_id])[0])
        for i in one.ways:
            at = row if one.synchronization == "time" else slice(0, row + 1)
            assert goals[i] in np.atleast_1d(run.position[at, i])
    assert np.array_equal(run.position[-1], goals)
    assert set(run.answers().values()) <= {1}
    assert len(run.answers()) == len(chain)


ways = st.one_of(st.floats(0.01, 12.0), st.floats(-12.0, -0.01), st.sampled_from([1.0, -0.5, 5.0]))


def stay_within(run: Run, axes: int, *, quick: bool, disabled: bool = False) -> None:
    """Limits of the axes, their stop limits where one was asked for, and the position limits. The
    kernel leads every axis to the end, unless one was disabled.

    Where a move is held on its way the samples have no jerk of their own: its positions are judged.
    """
    most = (2000.0, 40000.0) if quick else (OWN.acceleration, OWN.jerk)
    ulp = 8 * np.spacing(np.max(np.abs(run.position)) + 1.0)
    assert disabled or np.all(run.follows[:, :axes] == 1)
    for i in range(axes):
        q, v, a, j = (c[:, i] for c in (run.position, run.velocity, run.acceleration, run.jerk))
        led = (run.follows[1:, i] & run.follows[:-1, i]).astype(bool)  # else: the drive's own place
        own = led & ~run.feed_hold[1:, i] & ~run.feed_hold[:-1, i]
        for rate, of in ((v, q), (a, v), (j, a)):
            assert np.max(np.abs(np.diff(of) - (rate[1:] + rate[:-1]) / 2)[own], initial=0.0) <= ulp
        for order, limit in enumerate((OWN.velocity, *most), start=1):
            joined = np.lib.stride_tricks.sliding_window_view(led, order).all(axis=1)
            steps = np.abs(np.diff(q, order))[joined]
            assert np.max(steps, initial=0.0) <= limit * T**order * (1 + 1e-9) + 2**order * ulp
        assert np.max(np.abs(v)) <= OWN.velocity * T * (1 + 1e-9)
        assert np.max(np.abs(a)) <= most[0] * T**2 * (1 + 1e-9)
        assert np.max(np.abs(j)) <= most[1] * T**3 * (1 + 1e-9)
        assert RANGE[0] - ulp <= q[run.follows[:, i] == 1].min()
        assert q[run.follows[:, i] == 1].max() <= RANGE[1] + ulp
    assert np.all(run.velocity[-1] == 0.0)


@st.composite
def chains(draw: st.DrawFn, mixed: bool = True) -> tuple[int, list[Queued]]:
    axes = draw(st.integers(1, 4))
    chain = []
    for _ in range(draw(st.integers(2, 5))):
        chosen = range(axes)
        if mixed and draw(st.booleans()):
            chosen = sorted(draw(st.sets(st.sampled_from(range(axes)), min_size=1)))
        onward = draw(st.booleans())
        chain.append(
            Queued(
                {i: abs(w) if onward else w for i, w in ((i, draw(ways)) for i in chosen)},
                slower(draw(st.floats(5.0, 90.0)), draw(st.sampled_from([1.0, 1.0, 0.4]))),
                draw(st.sampled_from(MODES)),
                draw(st.sampled_from(["time", "time", "time", "none"])),
                draw(st.sampled_from([0, 0, 1, 37, 180, 400])),
            )
        )
    return axes, chain
