"""Queued moves one by one, in an own loop and in a whole process."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter
from dataclasses import replace

import pytest

from helpers.chains import (
    COUNTS,
    MODES,
    OWN,
    RANGE,
    Queued,
    T,
    Watch,
    forward_only,
    give,
    kept,
    landed,
    play,
    slower,
    stay_within,
    stepped,
)
from sjerk import (
    Axis,
    InputError,
    Limits,
    MotionKernel,
    MotionStoppedError,
    Move,
    QueueFullError,
    RefusedError,
    State,
)
from sjerk._binding import ffi, lib
from sjerk.host import Buffer, EventKind, Monitor, MoveState

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
        chain[2].check()


def test_too_late_a_cancellation_comes_to_rest_behind_the_goal() -> None:
    """One cycle before the goal there is no other way; then it halts within limits."""
    kernel, host = stepped()
    watch = Watch(kernel, host)
    moves = [host.move(10.0), host.move(30.0, buffer="blend high")]
    while 10.0 - host.link.frame().axis[0].position > 0.1:
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
    assert watch.host.link.frame().axis[0].velocity == 0.0
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


@pytest.mark.parametrize("mode", ["buffered", "blend low"])
def test_a_refusal_names_its_axis(mode: Buffer) -> None:
    """At once, where the drive is disabled; and in its turn, where only the way to it tells."""
    kernel, host = stepped(2, replace(OWN, position=RANGE))
    host.disable(axes=1)
    kernel.step(2000)
    disabled = host.move([2.0, 2.0], buffer=mode)
    kernel.step(2)
    with pytest.raises(RefusedError, match="refused by axis 1: the drive does not follow") as told:
        disabled.check()
    assert told.value.axis == 1
    host.enable()
    kernel.step(2000)
    first = host.move([20.0, 50.0])
    kernel.step(20)
    beyond = host.move([1.0, 50.0], relative=True, buffer=mode)
    kernel.step(6000)
    assert first.done
    with pytest.raises(RefusedError, match="refused by axis 1: it would leave the position limits"):
        beyond.check()
    assert [e.axis for e in host.events()[0] if e.goal_id == beyond.goal_id] == [1]


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
        record.goal_id = host.link.next_goal()
        host.link.fill(record.axis[0].goal, lib.SJ_GOAL_ABSOLUTE, State(1.0), OWN)
        room, _, field = name.rpartition(".")
        goal = record.axis[0].goal
        setattr({"": record, "goal": goal, "limits": goal.limits}[room], field, value)
        host.link.publish_records(record, 1)
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
        moves[-1].check()


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
        assert host.link.frame().corrupt == 0


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
