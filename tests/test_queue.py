"""Queued moves: buffered and blended, by random chains in an own loop and in a whole process."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sjerk import (
    Axis,
    Event,
    EventKind,
    Host,
    InputError,
    Limits,
    MotionKernel,
    MotionStoppedError,
    Move,
    MoveState,
    QueueFullError,
    State,
    plan_velocity,
)
from sjerk._binding import ffi, lib

T = 1e-3
COUNTS = 2**24 / 360.0
OWN = Limits(90.0, 500.0, 5000.0, deceleration=300.0, deceleration_jerk=4000.0)
#: Whole runs are long: fewer of them than of plans.
SOME = max(settings().max_examples // 4, 25)
MODES = ("buffered", "blend low", "blend previous", "blend next", "blend high")


def stepped(axes: int = 1, limits: Limits = OWN) -> tuple[MotionKernel, Host]:
    stop = replace(limits, deceleration=2000.0, deceleration_jerk=40000.0)
    kernel = MotionKernel([Axis(limits, COUNTS, stop_limits=stop)] * axes, T)
    host = kernel.host()
    host.enable()
    kernel.step(10)
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
    moves: list[Move]
    events: list[Event]

    def reached(self) -> dict[int, int]:
        return {e.goal_id: e.cycle for e in self.events if e.kind is EventKind.REACHED}

    def answers(self) -> Counter[int]:
        return Counter(e.goal_id for e in self.events if e.kind is EventKind.GOAL)


_AXIS = ffi.typeof("sj_axis_feedback")
_FIELDS = {"goal_id": "u8", "moving": "i4", "follows": "i4"} | dict.fromkeys(
    ("position", "velocity", "acceleration", "jerk"), "f8"
)
_DTYPE = np.dtype(
    {
        "names": list(_FIELDS),
        "formats": list(_FIELDS.values()),
        "offsets": [dict(_AXIS.fields)[name].offset for name in _FIELDS],
        "itemsize": ffi.sizeof(_AXIS),
    }
)


class Watch:
    """Steps a kernel and keeps every frame."""

    def __init__(self, kernel: MotionKernel, host: Host) -> None:
        self.kernel, self.host = kernel, host
        frame = ffi.buffer(host._buffer)
        offset = ffi.offsetof("sj_feedback", "axis")
        self.axes = np.frombuffer(frame, _DTYPE, count=host._axes, offset=offset)
        self.cycles: list[int] = []
        self.rows: list[np.ndarray] = []
        self.events: list[Event] = []
        self.look()

    def look(self) -> bool:
        self.cycles.append(self.host._frame().cycle)
        self.rows.append(self.axes.copy())
        self.events += self.host.events()[0]
        return bool(self.axes["moving"].any())

    def step(self, cycles: int = 1) -> bool:
        """Whether any axis moves."""
        moving = True
        for _ in range(cycles):
            self.kernel.step()
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
        rows = np.array(self.rows)
        columns = (rows[name] for name in [*Run.__dataclass_fields__][1:-2])
        return Run(np.array(self.cycles), *columns, moves, self.events)


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
    by_id = {move._goal_id: own for move, own in zip(run.moves, limits, strict=True)}
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
            of = np.flatnonzero(run.goal_id[:, i] == move._goal_id)
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
        row = int(np.flatnonzero(run.cycle == reached[move._goal_id])[0])
        for i in one.ways:
            at = row if one.synchronization == "time" else slice(0, row + 1)
            assert goals[i] in np.atleast_1d(run.position[at, i])
    assert np.array_equal(run.position[-1], goals)
    assert set(run.answers().values()) <= {1}
    assert len(run.answers()) == len(chain)


ways = st.one_of(st.floats(0.01, 12.0), st.floats(-12.0, -0.01), st.sampled_from([1.0, -0.5, 5.0]))


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


@settings(max_examples=SOME)
@given(chains())
def test_any_chain_keeps_its_limits_and_meets_every_goal(case: tuple[int, list[Queued]]) -> None:
    """Continuous, within the limits in force, forward only, on each goal, answered once; no slower
    than the same moves buffered."""
    axes, chain = case
    run = play(axes, chain)
    kept(run, [one.limits for one in chain], axes)
    forward_only(run, axes)
    landed(run, chain, axes)
    assert max(run.reached().values()) <= last_cycle_when_buffered(axes, chain)


# ---- the velocity to pass with -------------------------------------------------------------------


def ramp(start: float, end: float, limits: Limits) -> float:
    """What a change of velocity covers, by the planner's Python side; without its last cycle."""
    wide = replace(limits, velocity=max(start, end, limits.velocity))
    return plan_velocity(State(0.0, start), end, wide, T).end.position - end * T


def expected(mode: str, ways: tuple[float, float], limits: tuple[Limits, Limits]) -> float:
    """The velocity at the goal between two moves in one direction, the first from rest.

    The largest that the mode allows, that the second can stop from within its way, and that the
    first can reach within its own: under its velocity limit, and a run-up beyond it at the end.
    """
    one, two = limits[0].velocity, limits[1].velocity
    asked = {
        "blend low": min(one, two),
        "blend previous": one,
        "blend next": two,
        "blend high": max(one, two),
    }[mode]

    def works(v: float) -> bool:
        before, behind = min(v, one), min(v, two)
        first = ramp(0.0, before, limits[0]) + ramp(before, v, limits[0]) + v * T
        second = ramp(v, behind, limits[1]) + ramp(behind, 0.0, limits[1])
        return first <= ways[0] and second <= ways[1]

    low, high = 0.0, asked
    if works(asked):
        return asked
    for _ in range(40):
        v = 0.5 * (low + high)
        low, high = (v, high) if works(v) else (low, v)
    return low


@settings(max_examples=SOME)
@given(
    st.sampled_from(MODES[1:]),
    st.tuples(st.floats(0.5, 25.0), st.floats(0.5, 25.0)),
    st.tuples(st.floats(5.0, 90.0), st.floats(5.0, 90.0)),
    st.sampled_from([1.0, 0.4]),
    st.sampled_from([1.0, -1.0]),
)
def test_a_goal_is_passed_at_the_velocity_of_the_mode_as_far_as_both_ways_allow(
    mode: str,
    ways: tuple[float, float],
    velocities: tuple[float, float],
    rest: float,
    sign: float,
) -> None:
    """Against a search with plan_velocity alone; lower where whole cycles cost a little."""
    limits = (slower(velocities[0]), slower(velocities[1], rest))
    chain = [
        Queued({0: sign * ways[0]}, limits[0], "buffered"),
        Queued({0: sign * ways[1]}, limits[1], mode),
    ]
    run = play(1, chain)
    kept(run, list(limits), 1)
    landed(run, chain, 1)
    row = run.cycle.tolist().index(run.reached()[run.moves[0]._goal_id])
    passed = abs(run.velocity[row, 0]) / T
    most = expected(mode, ways, limits)
    assert passed <= most * (1 + 1e-6) + 1e-9
    assert passed >= 0.98 * most
    if mode == "blend low":
        assert np.max(np.abs(run.velocity[: row + 1])) <= limits[0].velocity * T * (1 + 1e-9)
        assert np.max(np.abs(run.velocity[row:])) <= limits[1].velocity * T * (1 + 1e-9)


# ---- what may come in the middle of a chain ------------------------------------------------------

RANGE = (-60.0, 60.0)
FINAL = {MoveState.DONE, MoveState.STOPPED, MoveState.SUPERSEDED, MoveState.REFUSED}


def stay_within(run: Run, axes: int, *, quick: bool) -> None:
    """Limits of the axes, their stop limits where one was asked for, and the position limits."""
    most = (2000.0, 40000.0) if quick else (OWN.acceleration, OWN.jerk)
    ulp = 8 * np.spacing(np.max(np.abs(run.position)) + 1.0)
    for i in range(axes):
        q, v, a, j = (c[:, i] for c in (run.position, run.velocity, run.acceleration, run.jerk))
        led = (run.follows[1:, i] & run.follows[:-1, i]).astype(bool)  # else: the drive's own place
        for rate, of in ((v, q), (a, v), (j, a)):
            assert np.max(np.abs(np.diff(of) - (rate[1:] + rate[:-1]) / 2)[led]) <= ulp
        assert np.max(np.abs(v)) <= OWN.velocity * T * (1 + 1e-9)
        assert np.max(np.abs(a)) <= most[0] * T**2 * (1 + 1e-9)
        assert np.max(np.abs(j)) <= most[1] * T**3 * (1 + 1e-9)
        assert RANGE[0] - ulp <= q[run.follows[:, i] == 1].min()
        assert q[run.follows[:, i] == 1].max() <= RANGE[1] + ulp
    assert np.all(run.velocity[-1] == 0.0)


def answered(run: Run) -> None:
    """Each goal once, and the handles say what the events say."""
    answers, reached = run.answers(), run.reached()
    for move in run.moves:
        assert answers[move._goal_id] == 1
        assert move.state in FINAL
        assert (move.state is MoveState.DONE) == (move._goal_id in reached)
    assert sum(answers.values()) == len(run.moves)


actions = st.tuples(
    st.integers(1, 500),
    st.sampled_from(
        ["halt", "halt one", "quick", "quick one", "goal", "goal one", "cancel", "queue", "hold",
         "resume", "slower", "faster", "standstill", "death", "disable one"]
    ),
    st.integers(0, 10),
)  # fmt: skip


@settings(max_examples=4 * SOME)
@given(chains(), st.lists(actions, min_size=1, max_size=4))
def test_whatever_comes_in_a_chain_it_keeps_its_limits_and_answers_every_move(
    case: tuple[int, list[Queued]], events: list[tuple[int, str, int]]
) -> None:
    """Stops, newer goals, cancellations, holds, overrides and a dying host, at any cycle."""
    axes, chain = case
    kernel, host = stepped(axes, replace(OWN, position=RANGE))
    watch = Watch(kernel, host)
    moves = [give(host, one) for one in chain]
    fresh = iter(range(1, 100))
    for after, what, which in events:
        watch.step(after)
        some = None if not what.endswith(" one") else which % axes
        match what.removesuffix(" one"):
            case "halt":
                host.halt(axes=some)
            case "quick":
                host.quick_stop(axes=some)
            case "goal":
                place = 3.0 * which - 20.0 + next(fresh)
                moves.append(host.move({i: place for i in ([some] if some is not None else range(axes))}))
            case "cancel":
                moves[which % len(moves)].cancel()
            case "queue":
                again = chain[which % len(chain)]
                moves.append(give(host, replace(again, ways={i: -w for i, w in again.ways.items()})))
            case "hold":
                host.hold()
            case "resume":
                host.resume()
            case "slower":
                host.override(0.1 * which)
            case "faster":
                host.override(1.0 + 0.1 * which)
            case "standstill":
                watch.step(1500)
            case "disable":
                host.disable(axes=some)
            case "death":
                base = host._segment.base
                lib.sj_shm_note_host(base, lib.sj_shm_host_epoch(base), 0)
                watch.step()
                lib.sj_shm_note_host(base, lib.sj_shm_host_epoch(base), 1)
        watch.step()
    host.resume()
    host.override(1.0)
    run = watch.run(moves)
    quick = any(what.startswith("quick") for _, what, _ in events)
    stay_within(run, axes, quick=quick)
    answered(run)
