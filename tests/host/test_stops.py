"""Stops beside the host: any process of the owner, in the next cycle, told and recorded."""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.loops import enabled
from helpers.root import STRESS
from sjerk import (
    Axis,
    InputError,
    KernelGoneError,
    Limits,
    Monitor,
    MotionKernel,
    Recorder,
    Recording,
    replay,
)
from sjerk._binding import ffi, lib
from sjerk.dpram.stop_slots import SHARED
from sjerk.handshake import Segment
from sjerk.host import Event, EventKind, MoveState, StopKind
from sjerk.recording.tables import chunk_of, tables_of

T = 1e-3
COUNTS = 2**24 / 360.0
LIMITS = Limits(90.0, 500.0, 5000.0)
STOP = Limits(90.0, 2000.0, 40000.0)
AXES = 3
AXIS = Axis(LIMITS, COUNTS, "ideal", stop_limits=STOP)


def ask(kernel: MotionKernel, kind: StopKind, axes: int, *, slot: int = 0, pid: int = 4711) -> None:
    """A request of a process in the memory of a kernel in an own loop."""
    base = kernel.core.segment
    assert lib.sj_stop_claim(base, slot, pid) == 1
    halt = kind is StopKind.HALT
    lib.sj_stop_request(base, slot, axes if halt else 0, 0 if halt else axes)


def stops(events: list[Event]) -> list[tuple[int, int | None, StopKind, int | None]]:
    """Cycle, axis, kind and process of the stops among these events."""
    return [(e.cycle, e.axis, StopKind(e.code), e.pid) for e in events if e.kind is EventKind.STOP]


@settings(max_examples=60, deadline=None)
@given(
    targets=st.lists(st.floats(-170, 170), min_size=AXES, max_size=AXES),
    synchronization=st.sampled_from(["time", "phase", "none"]),
    queued=st.integers(0, 3),
    cycle=st.integers(0, 900),
    axes=st.sets(st.integers(0, AXES - 1), min_size=1),
    kind=st.sampled_from(StopKind),
    held=st.booleans(),
)
def test_a_stop_beside_the_host_is_the_stop_of_the_host(
    targets: list[float],
    synchronization: str,
    queued: int,
    cycle: int,
    axes: set[int],
    kind: StopKind,
    held: bool,
) -> None:
    """Bit for bit, in whichever state of a motion, with what is queued behind it."""
    rows, ends = [], []
    for beside in (False, True):
        kernel, host = enabled([AXIS] * AXES, T)
        moves = [host.move(targets, synchronization=synchronization)]
        moves += [host.move([10.0 * i] * AXES, buffer="buffered") for i in range(queued)]
        kernel.step(1 + cycle // 2)
        if held:
            host.hold()
        kernel.step(1 + cycle - cycle // 2)
        if beside:
            ask(kernel, kind, sum(1 << i for i in axes))
        else:
            (host.halt if kind is StopKind.HALT else host.quick_stop)(axes=axes)
        seen = []
        for _ in range(900):
            kernel.step()
            seen.append(kernel.positions.copy())
        rows.append(np.array(seen))
        ends.append([move.state for move in moves])
    assert rows[0].tobytes() == rows[1].tobytes()
    assert ends[0] == ends[1]


def test_a_stop_wins_over_a_goal_of_its_cycle_and_over_what_was_queued() -> None:
    """The goal is refused, a record in the ring is never begun; the next goal runs."""
    kernel, host = enabled([AXIS] * 2, T)
    ask(kernel, StopKind.HALT, 0b11)
    direct, queued = host.move([10.0, 10.0]), host.move({0: 3.0}, buffer="buffered")
    kernel.step(400)
    assert [direct.state, queued.state] == [MoveState.REFUSED, MoveState.STOPPED]
    assert kernel.positions.tolist() == [0.0, 0.0]
    after = host.move([1.0, 1.0])
    kernel.step(900)
    assert after.state is MoveState.DONE


def test_each_process_that_asks_is_told_with_its_axes() -> None:
    """Two in one cycle are two events, all axes are one event, and axes that are not there none."""
    kernel, host = enabled([AXIS] * 3, T)
    cycle = host.feedback().cycle
    ask(kernel, StopKind.HALT, 0b101, slot=3, pid=11)
    ask(kernel, StopKind.QUICK_STOP, 2**64 - 1, slot=1, pid=22)
    kernel.step(3)
    assert stops(host.events()[0]) == [
        (cycle + 1, None, StopKind.QUICK_STOP, 22),
        (cycle + 1, 0, StopKind.HALT, 11),
        (cycle + 1, 2, StopKind.HALT, 11),
    ]
    ask(kernel, StopKind.HALT, 0b1000)
    kernel.step(3)
    assert stops(host.events()[0]) == []


def test_a_slot_is_not_claimed_while_its_stop_waits_and_a_new_kernel_begins_without_it() -> None:
    """So nobody is told for another; and what was asked of a kernel that is gone is not obeyed."""
    kernel, host = enabled([AXIS], T)
    base = kernel.core.segment
    ask(kernel, StopKind.HALT, 1, pid=11)
    assert lib.sj_stop_claim(base, 0, 22) == 0
    lib.sj_shm_begin_kernel(base, 0)
    assert lib.sj_stop_claim(base, 0, 22) == 1
    kernel.step(2)
    assert stops(host.events()[0]) == []


@pytest.mark.parametrize("suffix", ["mcap", "parquet"])
def test_a_recording_with_stops_runs_again_bit_for_bit(tmp_path: Path, suffix: str) -> None:
    """From the file alone: who asked for what in which cycle is in it, and what came of it."""
    path = tmp_path / f"a.{suffix}"
    kernel = MotionKernel([AXIS] * AXES, T)
    with Recorder(kernel, path), kernel.host() as host:
        host.enable()
        kernel.step(10)
        for n in range(12):
            host.move([10.0 * n, -7.0 * n, 60.0])
            kernel.step(130)
            ask(kernel, StopKind(1 + n % 2), 1 + n % 7, slot=n % 5, pid=100 + n)
            if n % 3 == 0:
                ask(kernel, StopKind.HALT, 0b111, slot=7, pid=99)
            kernel.step(130)
    found = Recording.open(path)
    assert len(found.stops) == 16
    assert found.stops["number"].tolist()[:2] == [0, 7]
    assert {event.pid for event in found.events if event.kind is EventKind.STOP} >= {99, 100, 111}
    assert replay(found).identical
    whole = found.all
    whole.stops["cycle"][5] += 1  # a stop in another cycle is another motion
    assert not replay(Recording(found.description, lambda: iter((whole,)))).identical


def test_a_recording_from_before_there_were_stops_is_read() -> None:
    """Its tables have none of that name."""
    kernel = MotionKernel([AXIS], T)
    with Recorder(kernel, None) as recorder:
        kernel.step(20)
    tables = tables_of(recorder.recording.all)
    del tables["stops"]
    assert len(chunk_of(tables, 1).stops) == 0


# ---- real processes


def test_a_monitor_stops_what_the_host_moves() -> None:
    """One axis, then all, by both kinds; the host stays host, and its move ends as stopped."""
    with MotionKernel([AXIS] * 2, T) as kernel, Monitor.attach(kernel.name) as monitor:
        host = kernel.host()
        host.enable()
        host.jog([20.0, -20.0]).accepted()  # a goal of the same cycle would be refused
        monitor.quick_stop(axes=0)
        first = monitor.feedback()
        assert (first.axes[0].velocity, first.axes[1].moving) == (0.0, True)
        move = host.move([100.0, 100.0])
        move.accepted()
        monitor.halt()
        assert not monitor.feedback().moving
        assert move.state is MoveState.STOPPED
        assert monitor.host_pid == os.getpid()
        told = stops(host.events()[0])
        assert [entry[1:] for entry in told] == [
            (0, StopKind.QUICK_STOP, os.getpid()),
            (None, StopKind.HALT, os.getpid()),
        ]
        host.move([1.0, 1.0]).wait()
        with pytest.raises(InputError, match=r"axes = 2: axis numbers are 0 \.\. 1"):
            monitor.halt(axes=2)
        host.close()
        monitor.halt()
        assert monitor.host_pid is None


def test_stopping_a_kernel_that_has_ended_is_told() -> None:
    """Also where another one has its name by now, which is not stopped."""
    name = f"stopped-{os.getpid()}"
    with MotionKernel([AXIS], T, name=name):
        monitor, stopper = Monitor.attach(name), Monitor.attach(name)
        stopper.halt()
    for one in (monitor, stopper):
        with pytest.raises(KernelGoneError):
            one.halt()
    with MotionKernel([AXIS], T, name=name) as kernel, kernel.host() as host:
        for one in (monitor, stopper):
            with pytest.raises(KernelGoneError):
                one.halt()
            one.close()
        assert stops(host.events()[0]) == []


def stop_beside(name: str, answers: multiprocessing.Queue[int]) -> None:
    with Monitor.attach(name) as monitor:
        monitor.halt()
        answers.put(os.getpid())


def test_other_processes_stop_a_host_in_this_one() -> None:
    """Each is named by the event of its stop."""
    context = multiprocessing.get_context("spawn")
    with MotionKernel([AXIS], T) as kernel, kernel.host() as host:
        host.enable()
        answers = context.Queue()
        for _ in range(2):
            host.jog(20.0).accepted()
            process = context.Process(target=stop_beside, args=(kernel.name, answers))
            process.start()
            pid = answers.get(timeout=600)
            process.join()
            assert pid == process.pid
            assert not host.feedback().moving
            assert [entry[3] for entry in stops(host.events()[0])] == [pid]


def test_a_stop_is_never_refused_for_want_of_a_slot() -> None:
    """Who finds all slots taken stops all the same, without a name; a slot given back is used."""
    with MotionKernel([AXIS], T) as kernel, kernel.host() as host:
        taken = [Segment.attach(kernel.name, role="stopper") for _ in range(SHARED)]
        assert [segment.stop_slot for segment in taken] == list(range(SHARED))
        with Monitor.attach(kernel.name) as late:
            late.halt()
            assert [entry[3] for entry in stops(host.events()[0])] == [None]
        taken.pop(5).close()
        with Monitor.attach(kernel.name) as late:
            late.halt()
            assert [entry[3] for entry in stops(host.events()[0])] == [os.getpid()]
        for segment in taken:
            segment.close()


def test_a_kernel_of_an_older_layout_is_refused() -> None:
    """With both versions in the message."""
    with MotionKernel([AXIS], T) as kernel, Segment.attach(kernel.name, role="host") as segment:
        major = ffi.cast("uint32_t *", ffi.cast("char *", segment.base) + 8)
        now, major[0] = major[0], 1
        done = subprocess.run(
            [sys.executable, "-m", "sjerk", "stop", "--name", kernel.name],
            capture_output=True,
            text=True,
            timeout=600,
        )
        major[0] = now
    assert done.returncode == 1
    assert f"has layout 1.0, this version of sjerk reads {lib.SJ_SHM_MAJOR}.x" in done.stderr


def test_stops_of_other_processes_arrive_while_hosts_are_killed() -> None:
    """The stress test, small: none lost, none late, and the recording runs again."""
    done = subprocess.run(
        [sys.executable, str(STRESS / "stop.py"), "--stops", "200"],
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "lost 0" in done.stdout
