"""Queued moves as properties: random chains, the velocity to pass with, what comes in between."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.chains import (
    MODES,
    OWN,
    RANGE,
    SOME,
    Queued,
    Run,
    T,
    Watch,
    chains,
    forward_only,
    give,
    kept,
    landed,
    last_cycle_when_buffered,
    play,
    slower,
    stay_within,
    stepped,
)
from sjerk import Limits, State, plan_velocity
from sjerk._binding import lib
from sjerk.host import MoveState


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

FINAL = {MoveState.DONE, MoveState.STOPPED, MoveState.SUPERSEDED, MoveState.REFUSED}


def answered(run: Run) -> None:
    """Each goal once, and the handles say what the events say."""
    answers, reached = run.answers(), run.reached()
    for move in run.moves:
        assert answers[move.goal_id] == 1
        assert move.state in FINAL
        assert (move.state is MoveState.DONE) == (move.goal_id in reached)
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
                base = host.link.segment.base
                lib.sj_shm_note_host(base, lib.sj_shm_host_epoch(base), 0)
                watch.step()
                lib.sj_shm_note_host(base, lib.sj_shm_host_epoch(base), 1)
        watch.step()
    host.resume()
    host.override(1.0)
    run = watch.run(moves)
    quick = any(what.startswith("quick") for _, what, _ in events)
    disabled = any(what.startswith("disable") for _, what, _ in events)
    stay_within(run, axes, quick=quick, disabled=disabled)
    answered(run)


@settings(max_examples=2 * SOME)
@given(st.integers(1, 700), st.booleans(), st.booleans())
def test_a_quick_stop_while_other_axes_pass_a_goal(at: int, together: bool, jogs: bool) -> None:
    """Axes with chains of their own: each comes to rest at its own stop limits."""
    kernel, host = stepped(2, OWN)
    watch = Watch(kernel, host)
    moves = []
    for axis in range(2):
        if axis == 0 and jogs:
            host.jog({0: 20.0})
            continue
        moves.append(host.move({axis: 30.0 + axis}))
        moves.append(host.move({axis: 60.0}, buffer="blend low"))
    watch.step(at)
    host.quick_stop(together=together)
    run = watch.run(moves)
    stay_within(run, 2, quick=True)


@settings(max_examples=2 * SOME)
@given(
    st.floats(40.0, 90.0),
    st.integers(60, 400),
    st.tuples(st.floats(0.2, 1.0), st.floats(0.05, 1.0), st.floats(0.02, 0.5)),
    st.integers(0, 4),
    st.sampled_from(["hold", "slower", "halt", "goal", "queue"]),
)
def test_limits_lowered_in_a_chain_never_carry_it_beyond_those_it_began_under(
    velocity: float, at: int, lower: tuple[float, float, float], after: int, what: str
) -> None:
    """What is planned next under lower limits, in mid-acceleration, ends within the limits of the
    motion so far: their jerk is at hand as long as the axis moves.
    """
    own = slower(velocity)
    watch = Watch(*stepped(1, replace(own, position=RANGE)))
    host = watch.host
    chain = [Queued({0: 30.0}, own, "buffered"), Queued({0: 20.0}, own, "blend next")]
    moves = [give(host, one) for one in chain]
    watch.step(at)
    low = Limits(*(np.array(lower) * [velocity, own.braking[0], own.braking[1]]), position=RANGE)
    host.set_limits(low)
    watch.step(after)
    match what:
        case "hold":
            host.hold()
        case "slower":
            host.override(0.3)
        case "halt":
            host.halt()
        case "goal":
            moves.append(host.move(-40.0, limits=low))
        case "queue":
            moves.append(host.move(1.0, relative=True, limits=low, buffer="blend low"))
    watch.step(700)
    host.resume()
    host.override(1.0)
    run = watch.run(moves)
    stay_within(run, 1, quick=False)
    assert np.max(np.abs(run.velocity)) <= velocity * T * (1 + 1e-9)
