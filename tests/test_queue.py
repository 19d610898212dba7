"""Queued moves: buffered and blended, by random chains in an own loop and in a whole process."""

from __future__ import annotations

import subprocess
import sys
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
from sjerk.monitor import Monitor

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
    than the same moves buffered.
    """
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


def in_flight(run: Run, row: int, sign: float) -> State:
    """The sample without jerk that goes on as the one of this row does (half-cycle lemma)."""
    q, v, a, j = (
        sign * float(c[row, 0]) for c in (run.position, run.velocity, run.acceleration, run.jerk)
    )
    return State(q + j / 8, (v - j / 4) / T, (a + j / 2) / T**2)


def expected(
    mode: str, start: State, ways: tuple[float, float], limits: tuple[Limits, Limits]
) -> float:
    """The velocity at the goal between two moves in one direction, the first under way.

    The largest that the mode allows, that the second can stop from within its way, and that the
    first can reach within what is left of its own: under its velocity limit, and a run-up beyond
    it at the end.
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
        begun = plan_velocity(start, before, limits[0], T).end.position - before * T
        first = begun + ramp(before, v, limits[0]) + v * T
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
    decided = int(np.flatnonzero(run.goal_id[:, 0] == run.moves[0]._goal_id)[0])
    most = expected(mode, in_flight(run, decided, sign), ways, limits)
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
                chosen = range(axes) if some is None else [some]
                moves.append(host.move(dict.fromkeys(chosen, place)))
            case "cancel":
                moves[which % len(moves)].cancel()
            case "queue":
                again = chain[which % len(chain)]
                back = {i: -way for i, way in again.ways.items()}
                moves.append(give(host, replace(again, ways=back)))
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


# ---- one by one ----------------------------------------------------------------------------------


def test_a_blend_follows_the_buffer_modes_of_plcopen() -> None:
    """60, then 30, then 80 deg/s: the velocity at each goal is the mode's."""
    passed = {}
    for mode in MODES:
        chain = [
            Queued({0: 20.0}, slower(60.0), mode),
            Queued({0: 20.0}, slower(30.0), mode),
            Queued({0: 20.0}, slower(80.0), mode),
        ]
        run = play(1, chain)
        landed(run, chain, 1)
        rows = [run.cycle.tolist().index(c) for c in run.reached().values()]
        passed[mode] = [round(float(run.velocity[row, 0] / T), 6) for row in rows]
    assert passed["buffered"] == [0.0, 0.0, 0.0]
    assert passed["blend low"] == [30.0, 30.0, 0.0]
    assert passed["blend previous"] == [60.0, 30.0, 0.0]
    assert passed["blend next"][0] == 30.0
    assert passed["blend high"][0] == 60.0
    assert passed["blend next"][1] > 65.0 > 40.0 < passed["blend high"][1]


def test_a_buffered_move_begins_in_the_cycle_after_the_one_before() -> None:
    """No cycle of rest is added, none is lost."""
    run = play(1, [Queued({0: 1.0}, OWN, "buffered"), Queued({0: 1.0}, OWN, "buffered")])
    row = run.cycle.tolist().index(min(run.reached().values()))
    assert run.velocity[row, 0] == 0.0
    assert run.velocity[row + 1, 0] > 0.0


def test_handles_tell_where_their_moves_are() -> None:
    """Sent, queued, moving, done although passed."""
    kernel, host = stepped()
    moves = [host.move(5.0 * n, buffer="blend low") for n in (1, 2, 3)]
    seen = []
    assert [move.state for move in moves] == [MoveState.SENT] * 3
    for _ in range(3000):
        kernel.step()
        states = [move.state for move in moves]
        if not seen or seen[-1] != states:
            seen.append(states)
    queued, moving, done = MoveState.QUEUED, MoveState.MOVING, MoveState.DONE
    assert seen == [
        [moving, queued, queued],
        [done, queued, queued],  # on the goal in this cycle; the next one begins another move
        [done, moving, queued],
        [done, done, queued],
        [done, done, moving],
        [done, done, done],
    ]


def test_a_cancelled_move_takes_those_behind_it_along() -> None:
    """The one before comes to rest on its goal; others and later ones are not touched."""
    kernel, host = stepped(2)
    watch = Watch(kernel, host)
    chain = [host.move({0: 20.0 * n}, buffer="blend high") for n in (1, 2, 3)]
    other = host.move({1: 5.0}, buffer="buffered")
    watch.step(100)
    chain[1].cancel()
    later = host.move({0: -3.0}, buffer="buffered")
    run = watch.run([*chain, other, later])
    done, gone = MoveState.DONE, MoveState.SUPERSEDED
    assert [move.state for move in run.moves] == [done, gone, gone, done, done]
    stay_within(run, 2, quick=False)
    assert run.position[:, 0].max() == 20.0
    with pytest.raises(MotionStoppedError):
        chain[2]._raise()


def test_too_late_a_cancellation_comes_to_rest_behind_the_goal() -> None:
    """One cycle before the goal there is no other way; then it halts within limits."""
    kernel, host = stepped()
    watch = Watch(kernel, host)
    moves = [host.move(10.0), host.move(30.0, buffer="blend high")]
    while 10.0 - host._frame().axis[0].position > 0.1:
        watch.step()
    moves[1].cancel()
    run = watch.run(moves)
    assert [move.state for move in moves] == [MoveState.DONE, MoveState.SUPERSEDED]
    stay_within(run, 1, quick=False)
    assert 10.0 < run.position[-1, 0] < 30.0


@pytest.mark.parametrize("at", range(5, 700, 41))
def test_a_hold_keeps_the_chain_and_loses_nothing(at: int) -> None:
    """At any cycle: to rest, on again, forward only, every goal met."""
    watch = Watch(*stepped())
    chain = [Queued({0: 9.0}, slower(v), "blend high") for v in (60.0, 40.0, 80.0)]
    moves = [give(watch.host, one) for one in chain]
    watch.step(at)
    watch.host.hold()
    watch.step(900)
    assert watch.host._frame().axis[0].velocity == 0.0
    watch.host.resume()
    run = watch.run(moves)
    landed(run, chain, 1)
    forward_only(run, 1)
    kept(run, [one.limits for one in chain], 1)


def test_a_refused_move_does_not_stop_the_others() -> None:
    """Beyond a position limit by relative ways; the answer names the reason, the next one runs."""
    kernel, host = stepped(1, replace(OWN, position=RANGE))
    watch = Watch(kernel, host)
    ways = (50.0, 50.0, -20.0)
    moves = [host.move(way, relative=True, buffer="blend low") for way in ways]
    run = watch.run(moves)
    done = MoveState.DONE
    assert [move.state for move in moves] == [done, MoveState.REFUSED, done]
    assert run.position[-1, 0] == pytest.approx(30.0)
    stay_within(run, 1, quick=False)


def test_forged_records_are_refused() -> None:
    """Modes, kinds, limits and numbers that the host would not send."""
    kernel, host = stepped()
    for name, value, code in (
        ("mode", 9, lib.SJ_RESULT_KIND),
        ("synchronization", 7, lib.SJ_RESULT_KIND),
        ("goal.kind", lib.SJ_GOAL_JOG, lib.SJ_RESULT_KIND),
        ("goal.goal", float("nan"), lib.SJ_RESULT_RANGE),
        ("goal.goal_velocity", 1e9, lib.SJ_RESULT_PLAN),
        ("limits.jerk", -1.0, lib.SJ_RESULT_PLAN),
        ("limits.velocity", 1.0, lib.SJ_RESULT_LIMITS),
    ):
        record = ffi.new("sj_record *", {"kind": lib.SJ_RECORD_MOVE, "mode": 1})
        record.goal_id = host._next_goal()
        host._fill(record.axis[0].goal, lib.SJ_GOAL_ABSOLUTE, State(1.0), OWN)
        room, _, field = name.rpartition(".")
        goal = record.axis[0].goal
        setattr({"": record, "goal": goal, "limits": goal.limits}[room], field, value)
        host._publish_records(record, 1)
        kernel.step(3)
        told = [e for e in host.events()[0] if e.kind is EventKind.GOAL]
        assert [(e.goal_id, e.code) for e in told] == [(record.goal_id, code)]
        assert not host.feedback().moving


def test_what_cannot_be_queued_is_told_before_anything_moves() -> None:
    """A full ring, a mode that is none, a blend on a straight line, a way to turn."""
    kernel, host = stepped()
    with pytest.raises(InputError, match="buffer"):
        host.move(1.0, buffer="blend")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="synchronization"):
        host.move(1.0, buffer="blend low", synchronization="phase")
    with pytest.raises(InputError, match="direction"):
        host.move(1.0, buffer="buffered", direction="positive")
    moves = [host.move(0.01, relative=True, buffer="buffered") for _ in range(512)]
    with pytest.raises(QueueFullError, match="512"):
        host.move(1.0, buffer="buffered")
    kernel.step(40)
    assert host.move(1.0, buffer="buffered").state is MoveState.SENT
    host.halt()
    for _ in range(4):  # the answers of a whole ring are more than events are kept
        kernel.step(50)
        assert moves[-1].state is not MoveState.DONE
    assert moves[-1].state is MoveState.STOPPED
    with pytest.raises(MotionStoppedError):
        moves[-1]._raise()


def test_the_next_host_goes_on_behind_the_queue_of_the_last() -> None:
    """Leaving in order stops nothing; ids keep rising; the new host's move comes last."""
    kernel, host = stepped()
    for way in (1.0, 2.0):
        host.move(way, buffer="buffered")
    kernel.step(20)
    host.close()
    with kernel.host() as second:
        last = second.move(0.5, relative=True, buffer="blend low")
        kernel.step(4000)
        assert last.done
        assert second.feedback().axes[0].position == 2.5


# ---- a whole run ---------------------------------------------------------------------------------


def test_a_thousand_short_moves_run_through_the_ring_of_a_process() -> None:
    """More than the ring holds: the host waits for room; each is answered and reached once."""
    axes = [Axis(Limits(90.0, 5000.0, 500000.0), COUNTS)] * 2
    with MotionKernel(axes, T) as kernel, kernel.host() as host:
        host.enable()
        start = [axis.position for axis in host.feedback().axes]
        moves: list[Move] = []
        for n in range(1000):
            way = {0: 0.05, 1: 0.025 if n % 2 else 0.05}
            while True:
                try:
                    moves.append(host.move(way, relative=True, buffer="blend low"))
                    break
                except QueueFullError:
                    moves[-400].wait(30.0)
        for move in moves[-1::-200]:
            move.wait(60.0)
        assert [move.state for move in moves] == [MoveState.DONE] * 1000
        end = host.feedback()
        assert end.axes[0].position == pytest.approx(start[0] + 50.0, abs=1e-9)
        assert end.axes[1].position == pytest.approx(start[1] + 37.5, abs=1e-9)
        assert host._frame().corrupt == 0


CHAIN = """
import sys
from sjerk import Host
host = Host.attach(sys.argv[1])
host.enable()
for n in range(200):
    host.move([1.0, -2.0], relative=True, buffer="blend high")
print("queued", flush=True)
sys.stdin.read()
"""


@pytest.mark.parametrize("begun", [1, 3, 7])
def test_a_killed_host_leaves_no_move_of_its_chain_without_an_answer(begun: int) -> None:
    """Kill -9 while the chain runs: at rest, the rest of it stopped, and the next host goes on."""
    with MotionKernel([Axis(OWN, COUNTS)] * 2, T) as kernel, Monitor.attach(kernel.name) as monitor:
        child = subprocess.Popen(
            [sys.executable, "-c", CHAIN, kernel.name],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        assert child.stdin is not None
        assert child.stdout is not None
        with child.stdin, child.stdout:
            assert child.stdout.readline() == b"queued\n"
            answers: list[tuple[int, int]] = []
            reached = 0
            while len(answers) < 200:
                events, missed = monitor.events()
                assert missed == 0
                answers += [(e.goal_id, e.code) for e in events if e.kind is EventKind.GOAL]
                reached += sum(e.kind is EventKind.REACHED for e in events)
                if reached >= begun:
                    child.kill()
            child.wait()
        while monitor.feedback().moving:
            pass
        codes = Counter(code for _, code in answers)
        assert set(codes) == {lib.SJ_RESULT_STOPPED, lib.SJ_RESULT_ACCEPTED}
        assert codes[lib.SJ_RESULT_ACCEPTED] >= begun
        assert len({goal_id for goal_id, _ in answers}) == 200
        assert all(axis.velocity == 0.0 for axis in monitor.feedback().axes)
        with kernel.host() as host:
            move = host.move([0.5, 0.5], relative=True, buffer="buffered")
            move.wait(30.0)
            assert move.done
