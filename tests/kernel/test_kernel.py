"""The kernel as a whole: one cycle in an own loop, and real processes that die at bad moments."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from helpers.loops import enabled
from sjerk import (
    Axis,
    Host,
    InputError,
    KernelGoneError,
    Limits,
    MotionKernel,
    MotionStoppedError,
    RefusedError,
    SjerkError,
    plan,
    scurve,
)
from sjerk._binding import ffi, lib
from sjerk.cia402 import ControlWord, DriveState
from sjerk.host import MoveState
from sjerk.kernel.trace import Trace

T = 1e-3
LIMITS = Limits(90.0, 500.0, 5000.0, deceleration=300.0)
COUNTS = 2**24 / 360.0
AXIS = Axis(LIMITS, counts_per_unit=COUNTS)


def segments() -> set[str]:
    return {entry.name for entry in Path("/dev/shm").iterdir() if "kernel-" in entry.name}


@pytest.fixture(autouse=True)
def nothing_left() -> Iterator[None]:
    """No test leaves a segment behind."""
    mine = f"kernel-{os.getpid()}-"
    yield
    assert not [name for name in segments() if mine in name]


def stepped(axes: int = 1) -> tuple[MotionKernel, Host]:
    """A kernel in the test's own loop, its drives enabled."""
    return enabled([AXIS] * axes, T)


def differences(positions: list[float], limits: Limits) -> None:
    """No n-th difference of commanded positions exceeds its limit."""
    q = np.array(positions)
    ulp = np.spacing(np.max(np.abs(q)))
    most = (limits.velocity, max(limits.acceleration, limits.braking[0]), limits.jerk)
    for n, limit in enumerate(most, start=1):
        assert np.max(np.abs(np.diff(q, n))) <= limit * T**n * (1 + 1e-9) + 2**n * ulp


# ---- one cycle, no process -----------------------------------------------------------------------


def test_the_drive_gets_the_samples_of_the_profile() -> None:
    """Commanded positions are Profile.sample() bit for bit, targets their nearest increments."""
    kernel, host = stepped()
    expected = plan(host.feedback().axes[0].position, 12.5, LIMITS, T).sample().position
    host.move(12.5)
    seen = []
    for _ in range(len(expected) - 1):
        kernel.step()
        seen.append(host.feedback().axes[0])
    assert [axis.position for axis in seen] == expected[1:].tolist()
    assert seen[-1].position == 12.5
    assert [a.target_counts for a in seen] == [round(a.position * COUNTS) for a in seen]


def test_positions_is_a_live_view_of_what_is_commanded() -> None:
    """Made once, never written by its reader, and refused where a process has the kernel."""
    kernel, host = stepped(3)
    view = kernel.positions
    host.move([1.0, 2.0, 3.0])
    for _ in range(50):
        kernel.step()
        assert view.tolist() == [axis.position for axis in host.feedback().axes]
    assert kernel.positions is view
    with pytest.raises(ValueError, match="read-only"):
        view[0] = 1.0
    with MotionKernel([AXIS], T) as other, pytest.raises(SjerkError, match="process"):
        _ = other.positions


def test_several_axes_take_a_goal_together_or_not_at_all() -> None:
    """If one axis refuses, none moves; else all arrive in the same cycle."""
    kernel, host = stepped(3)
    refused = host.move([5.0, 5.0, 5.0])
    host.link.command.axis[1].goal.limits.velocity = -1.0  # forged after the host's own checks
    host.link.command.goal_id += 1
    host.link.publish()
    kernel.step()
    assert not host.feedback().moving
    assert host.link.frame().result == lib.SJ_RESULT_PLAN
    assert refused.state is not MoveState.DONE
    accepted = host.move([5.0, 4.0, 3.0])
    kernel.step(2)
    while host.feedback().moving:
        assert all(axis.moving for axis in host.feedback().axes)
        kernel.step()
    assert accepted.done
    assert [axis.position for axis in host.feedback().axes] == [5.0, 4.0, 3.0]


def test_no_drive_no_goal() -> None:
    """While the drive does not follow, the command is the actual position and goals are refused."""
    kernel = MotionKernel([AXIS], T)
    host = kernel.host()
    kernel.step()
    move = host.move(1.0)
    kernel.step()
    assert move.state is MoveState.REFUSED
    axis = host.feedback().axes[0]
    assert axis.position == axis.actual_position


def test_a_stop_is_jerk_limited_at_every_moment_of_a_move() -> None:
    """Stopped in each 17th cycle: limits kept, at rest, and not beyond the goal."""
    length = scurve(20.0, LIMITS, T).cycles
    for at in range(1, length - 20, 17):
        kernel, host = stepped()
        positions = [host.feedback().axes[0].position]
        move = host.move(20.0)
        for cycle in range(length + 400):
            if cycle == at:
                host.stop()
            kernel.step()
            positions.append(host.feedback().axes[0].position)
            if cycle > at and not host.feedback().moving:
                break
        differences(positions, Limits(90.0, 500.0, 5000.0))
        assert not host.feedback().moving
        # while it brakes the move's own end is the fastest stop
        assert move.state is (MoveState.DONE if positions[-1] == 20.0 else MoveState.STOPPED)
        assert positions[-1] <= 20.0


def test_the_drive_counter_wraps_and_the_position_goes_on() -> None:
    """Beyond 2^31 increments the INT32 of the drive wraps; commanded and actual do not."""
    fast = Axis(Limits(30_000.0, 60_000.0, 600_000.0), counts_per_unit=COUNTS)
    kernel = MotionKernel([fast], T)
    host = kernel.host()
    host.enable()
    for _ in range(10):
        kernel.step()
    goal = 150.0 * 360.0  # 150 revolutions; the counter holds 128
    move = host.move(goal)
    for _ in range(6000):
        kernel.step()
    axis = host.feedback().axes[0]
    assert move.done
    assert axis.target_counts == round(goal * COUNTS) > 2**31
    assert abs(axis.actual_counts - axis.target_counts) <= 10


def test_a_goal_that_comes_with_a_stop_is_refused() -> None:
    """Stop wins over a goal that the kernel sees in the same cycle."""
    kernel, host = stepped()
    host.stop()
    move = host.move(3.0)
    kernel.step()
    assert move.state is MoveState.REFUSED


def test_without_a_process_waiting_is_refused_and_so_is_reading_too_early() -> None:
    """A wait that could never end is an error."""
    kernel = MotionKernel([AXIS], T)
    host = kernel.host()
    with pytest.raises(SjerkError, match=r"step\(\)"):
        host.feedback()
    kernel.step()
    with pytest.raises(SjerkError, match=r"step\(\)"):
        host.move(1.0).wait()


@pytest.mark.parametrize("state", list(DriveState))
def test_the_controlword_leads_up_and_down_one_transition_at_a_time(state: DriveState) -> None:
    """For every drive state: the word that enables, disables and resets, by CiA 402."""
    word = lib.sj_drive_state_bits(state.number)
    up = {
        DriveState.SWITCH_ON_DISABLED: 0x06,
        DriveState.READY_TO_SWITCH_ON: 0x07,
        DriveState.SWITCHED_ON: 0x0F,
        DriveState.OPERATION_ENABLED: 0x0F,
        DriveState.FAULT: 0x00,
        DriveState.FAULT_REACTION_ACTIVE: 0x00,
    }.get(state, 0x06)
    down = {
        DriveState.OPERATION_ENABLED: 0x07,
        DriveState.FAULT: 0x00,
        DriveState.FAULT_REACTION_ACTIVE: 0x00,
    }.get(state, 0x06)
    assert lib.sj_master_controlword(word, 1, 0) == up
    assert lib.sj_master_controlword(word, 0, 0) == down
    reset = lib.sj_master_controlword(word, 1, 1)
    assert bool(reset & ControlWord.FAULT_RESET) == (up == 0x00)


@pytest.mark.parametrize(
    ("field", "make"),
    [
        ("axes", lambda: MotionKernel([], T)),
        ("axes", lambda: MotionKernel([AXIS] * 65, T)),
        ("cycle_time", lambda: MotionKernel([AXIS], 0.0)),
        ("cycle_time", lambda: MotionKernel([AXIS], 1e-6)),
        ("counts_per_unit", lambda: Axis(LIMITS, counts_per_unit=-1.0)),
        ("limits", lambda: Axis(90.0, counts_per_unit=1.0)),  # type: ignore[arg-type]
        (r"axes\[0\].limits.velocity", lambda: MotionKernel([Axis(Limits(1e6, 1, 1), COUNTS)], T)),
    ],
)
def test_axes_that_cannot_run_are_refused_at_once(field: str, make: object) -> None:
    """Before anything moves: field, value and limit."""
    with pytest.raises(InputError, match=field):
        make()  # type: ignore[operator]


@pytest.mark.parametrize("target", ["1", None, float("nan"), [1.0, 2.0], {1: 1.0}, {}])
def test_targets_that_are_none_are_refused(target: object) -> None:
    """A wrong target never reaches the kernel."""
    kernel, host = stepped()
    with pytest.raises(InputError, match="target"):
        host.move(target)  # type: ignore[arg-type]
    kernel.step()
    assert not host.feedback().moving


def test_a_command_that_was_forged_is_refused_by_the_kernel() -> None:
    """Goals and limits that are no numbers, or out of range, move nothing."""
    kernel, host = stepped()

    def send(goal: float, velocity: float, limit: float) -> int:
        entry = host.link.command.axis[0].goal
        entry.kind, entry.goal, entry.goal_velocity = 1, goal, velocity
        ffi.memmove(ffi.addressof(entry, "limits"), LIMITS.per_cycle(T), 40)
        entry.limits.jerk = limit
        host.link.command.goal_id += 1
        host.link.publish()
        kernel.step()
        return int(host.link.frame().result)

    nan, inf = float("nan"), float("inf")
    assert send(nan, 0.0, 1e-6) == lib.SJ_RESULT_RANGE
    assert send(1e300, 0.0, 1e-6) == lib.SJ_RESULT_RANGE
    for velocity, limit in ((nan, 1e-6), (inf, 1e-6), (1.0, 1e-6), (0.0, 0.0), (0.0, -1.0)):
        assert send(1.0, velocity, limit) == lib.SJ_RESULT_PLAN
    assert send(1.0, 0.0, nan) == lib.SJ_RESULT_LIMITS
    assert not host.feedback().moving
    assert send(1.0, 0.0, 5e-6) == lib.SJ_RESULT_ACCEPTED
    assert host.feedback().moving


# ---- processes -----------------------------------------------------------------------------------


def test_host_and_kernel_in_two_processes() -> None:
    """Enable, move, arrive; change the goal in motion; stop; disable; no goal without a drive."""
    with MotionKernel(axes=[AXIS], cycle_time=T) as kernel, kernel.host() as host:
        host.enable()
        host.move(5.0).wait(timeout=30.0)
        assert host.feedback().axes[0].position == 5.0
        replaced = host.move(90.0)
        host.link.wait_until(lambda frame: frame.axis[0].moving, 10.0, "motion")
        move = host.move(100.0)
        with pytest.raises(MotionStoppedError):
            replaced.wait(timeout=30.0)
        host.stop()
        at = host.feedback().axes[0]
        assert 5.0 < at.position < 90.0
        assert at.velocity == 0.0
        with pytest.raises(MotionStoppedError) as stopped:
            move.wait(timeout=30.0)
        assert stopped.value.positions == {0: at.position}
        host.disable()
        assert host.feedback().axes[0].drive_state is not DriveState.OPERATION_ENABLED
        with pytest.raises(RefusedError, match="does not follow"):
            host.move(1.0).wait(timeout=30.0)
        timing = host.feedback().timing
        assert 0.0 < timing.computing.median <= timing.computing.p99 <= timing.computing.worst
        assert timing.period.count > 100


def test_a_second_host_comes_after_the_first() -> None:
    """One host at a time; the next goes on where the first left."""
    with MotionKernel(axes=[AXIS], cycle_time=T) as kernel:
        with kernel.host() as host:
            host.enable()
            with pytest.raises(SjerkError, match="already has a host"):
                kernel.host()
            move = host.move(2.0)
            move.wait(timeout=30.0)
        with kernel.host() as host:
            host.move(3.0).wait(timeout=30.0)
            assert host.feedback().axes[0].position == 3.0


def test_leaving_the_kernel_during_a_move_stops_it_and_leaves_nothing() -> None:
    """The end of the with block is a stop, not a crash."""
    with MotionKernel(axes=[AXIS], cycle_time=T) as kernel, kernel.host() as host:
        host.enable()
        host.move(170.0)
        host.link.wait_until(lambda frame: frame.axis[0].velocity > 0.01, 10.0, "some speed")


def test_a_killed_kernel_is_told_to_the_waiting_host() -> None:
    """Kill -9 of the kernel: the wait ends with KernelGoneError."""
    with MotionKernel(axes=[AXIS], cycle_time=T) as kernel, kernel.host() as host:
        host.enable()
        move = host.move(170.0)
        assert kernel.pid is not None
        os.kill(kernel.pid, signal.SIGKILL)
        with pytest.raises(KernelGoneError):
            move.wait(timeout=30.0)


SCRIPT = textwrap.dedent(
    """
    import sys, time
    from sjerk import *
    axis = Axis(Limits(90.0, 500.0, 5000.0), counts_per_unit=2**24 / 360)
    with MotionKernel(axes=[axis], cycle_time=1e-3, name=sys.argv[1]) as kernel:
        host = kernel.host()
        host.enable()
        host.move(170.0)
        host.link.wait_until(lambda frame: frame.axis[0].velocity > 0.05, 10.0, "some speed")
        print("moving", kernel.pid, flush=True)
        time.sleep(60.0)
    """
)


@pytest.mark.parametrize("kill", [signal.SIGKILL, signal.SIGTERM])
def test_a_killed_host_process_stops_the_motion_and_leaves_no_segment(kill: signal.Signals) -> None:
    """The kernel stops along its ramp, disables, ends, and removes the segment of the dead."""
    name = f"orphan-{os.getpid()}-{int(kill)}"
    parent = subprocess.Popen([sys.executable, "-c", SCRIPT, name], stdout=subprocess.PIPE)
    assert parent.stdout is not None
    with parent.stdout:
        pid = int(parent.stdout.readline().split()[1])
        parent.send_signal(kill)
        parent.wait()
    deadline = time.monotonic() + 30.0
    while Path(f"/proc/{pid}").exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not Path(f"/proc/{pid}").exists()
    assert not [entry for entry in Path("/dev/shm").iterdir() if name in entry.name]


HOST = textwrap.dedent(
    """
    import sys, time
    from sjerk import *
    host = Host.attach(sys.argv[1])
    host.enable()
    host.move(float(sys.argv[2]))
    print("moving", flush=True)
    time.sleep(60.0)
    """
)


def test_a_dying_host_disturbs_nothing_but_the_motion_it_wanted_to_be_stopped() -> None:
    """Kill -9 of a host in its own process: every cycle of the path stays within its limits to a
    rest, and the next host goes on. The goals are a minute away, so that none is reached first.
    """
    with MotionKernel([AXIS], T) as kernel:
        monitor = Trace.attach(kernel.name)
        for goal in (6000.0, -6000.0, 6000.0):
            child = subprocess.Popen(
                [sys.executable, "-c", HOST, kernel.name, str(goal)], stdout=subprocess.PIPE
            )
            assert child.stdout is not None
            with child.stdout:
                assert child.stdout.readline() == b"moving\n"
                seen: list[float] = []
                killed = still = 0
                while still < 50:
                    chunk = monitor.read()
                    for frame in chunk.frames if chunk is not None else ():
                        axis = frame["axis"][0]
                        seen.append(axis["position"])
                        if not killed and abs(axis["velocity"]) > 0.04:
                            child.kill()
                            killed = int(frame["head"]["cycle"])
                        moving = axis["flags"] & lib.SJ_TRACE_MOVING
                        still = still + 1 if killed and not moving else 0
                    assert chunk is None or chunk.missed.sum() == 0
                child.wait()
            assert len(seen) > 50
            third = np.abs(np.diff(np.array(seen), 3))
            assert np.max(third) <= 5000.0 * T**3 * (1 + 1e-9) + 8 * np.spacing(np.abs(seen).max())
            assert seen[-1] != goal
        monitor.close()
        with kernel.host() as host:
            host.move(0.0).wait(timeout=300.0)


def test_a_corrupt_command_word_stops_the_motion_and_is_counted() -> None:
    """A wild writer in the command word: every axis stops along its ramp, nothing else moves."""
    kernel, host = stepped()
    move = host.move(60.0)
    kernel.step(200)
    assert host.link.segment is not None
    word = ffi.cast("uint32_t *", ffi.cast("char *", host.link.segment.base) + lib.SJ_SHM_COMMAND)
    before = word[0]
    word[0] = 0xFFFF
    kernel.step()
    word[0] = before
    kernel.step(600)
    assert host.link.frame().corrupt == 1
    assert not host.feedback().moving
    assert move.state is MoveState.STOPPED


def test_two_threads_may_command_one_host() -> None:
    """Commands of two threads are never mixed: every one is counted and the last one executed."""
    with MotionKernel([AXIS], T) as kernel, kernel.host() as host:
        host.enable()
        threads = [
            threading.Thread(target=lambda: [host.move(1.0) for _ in range(300)]) for _ in range(4)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert host.link.command.goal_id == 1200
        host.move(2.0).wait(timeout=30.0)
        assert host.link.frame().corrupt == 0
