"""What a sceptical user tried: wrong input of every kind gets a clear error, or works as said."""

from __future__ import annotations

import copy
import os
import pickle
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.loops import enabled
from sjerk import (
    Axis,
    DriveConfig,
    Host,
    InputError,
    KernelGoneError,
    Limits,
    MotionKernel,
    MotionStoppedError,
    Profile,
    Recorder,
    SjerkError,
    State,
    plan,
    plan_many,
    plan_velocity,
    scurve,
)
from sjerk.errors import SegmentTakenError
from sjerk.host import MoveState
from sjerk.profile import Phase

T = 1e-3
L = Limits(90.0, 500.0, 5000.0)
AXIS = Axis(L, 2**24 / 360)
P = plan(0.0, 1.0, L, T)
READ_ONLY = P.sample()
READ_ONLY.time.flags.writeable = False
SHARED = P.sample()


@pytest.mark.parametrize(
    "call",
    [
        lambda: plan(10**400, 160.0, L, T),
        lambda: plan(0.0, 160.0, L, 10**400),
        lambda: plan(0.0, 160.0, None, T),
        lambda: plan([0.0], [160.0], 5, T),
        lambda: plan([0.0], [160.0], [None], T),
        lambda: plan(0.0, 1.0, L, [T]),
        lambda: plan(State(0.0), State(1.0), L, {}),
        lambda: plan([State(0.0)], [State(1.0)], [L], np.array([T])),
        lambda: plan(0.0, 1.0, L, T, synchronization=[]),
        lambda: plan(State(0.0), State(1.0), L, T, synchronization="x"),
        lambda: plan([State(0.0)], [State(1.0)], [L], T, synchronization="x"),
        lambda: plan(0.0, 1.0, L, T, min_duration=np.array([1.0, 2.0])),
        lambda: plan(0.0, 1.0, L, T, min_duration=None),
        lambda: plan(0.0, 1.0, L, T, min_duration=""),
        lambda: plan(b"01", [160.0, 1.0], L, T),
        lambda: plan_velocity(0.0, 1.0, None, T),
        lambda: plan_velocity(0.0, 1.0, L, 1e-300),
        lambda: scurve(1.0, None, T),
        lambda: plan_many([1.0], [3.0], None, T),
        lambda: plan_many([1.0], [3.0], [None], T),
        lambda: plan_many([1.0], [3.0], [[90.0, 500.0, 5000.0]], T),
        lambda: plan_many([True], [3.0], L, T),
        lambda: plan_many(["a"], [3.0], L, T),
        lambda: plan_many([[1.0], [1.0, 2.0]], [3.0, 3.0], L, T),
        lambda: plan_many([1j], [3.0], L, T),
        lambda: plan_many([0.0], [1.0], np.array([[1e300] * 3]), T),
        lambda: Profile([Phase(1, 1.0)], T, 0.0, 1.0),
        lambda: P.sample(out=READ_ONLY),
        lambda: P.sample(out=[]),
        lambda: P.sample(out=type(SHARED)(*[SHARED.time] * 5)),
        lambda: P.sample(out=type(SHARED)(*[list(SHARED.time)] * 5)),
        lambda: MotionKernel(None),
        lambda: MotionKernel([3]),
        lambda: MotionKernel(AXIS),
        lambda: MotionKernel([AXIS], name=5),
        lambda: MotionKernel([AXIS], name=""),
        lambda: Axis(L, 1e3, None),
        lambda: MotionKernel([AXIS]).step(-1),
        lambda: MotionKernel([AXIS]).step(True),
        lambda: MotionKernel([AXIS]).step(2**70),
        lambda: Host.attach("none", L, T),
        lambda: MotionKernel([AXIS]).host().enable(axes=1.5),
        lambda: MotionKernel([AXIS]).host().halt(axes="0"),
        lambda: MotionKernel([AXIS]).host().follow([], axes=1.5),
        lambda: MotionKernel([AXIS], clock=5),
        lambda: MotionKernel([AXIS], reactions="halt"),
        lambda: Recorder(5, None),
        lambda: Recorder(MotionKernel([AXIS]), 5),
        lambda: Axis(L, 1.0, unit="deg\n"),
        lambda: Axis(L, 1.0, unit="\ud800"),
        lambda: DriveConfig(following_window=1e6),
        lambda: DriveConfig(rated_torque_nm="x"),
    ],
)
def test_unusable_input_is_an_input_error(call: Any) -> None:
    """No raw TypeError, no silent acceptance: an InputError names the field."""
    with pytest.raises(InputError) as refusal:
        call()
    assert refusal.value.field


def test_a_message_is_short_and_says_which_values_are_legal() -> None:
    """Both ends of a range belong to it; a limit is named with its axis; long values are cut."""
    near = Limits(1.0, 2.0, 3.0, position=(-5.0, 5.0))
    with pytest.raises(InputError, match=r"target.position = 10.0: must lie in -5.0 .. 5.0$"):
        plan(State(0.0), State(10.0), near, T)
    with pytest.raises(InputError, match=r"target\[1\].position = 6.0: must lie in -5.0 .. 5.0$"):
        plan_many([0.0, 0.0], [5.0, 6.0], near, T)
    assert plan(State(-5.0), State(5.0), near, T).cycles > 0
    kernel = MotionKernel([AXIS])
    beyond = replace(AXIS.limits, velocity=1e9)
    with pytest.raises(InputError, match=r"limits.velocity = 1000000000.0: must be at most .* 0$"):
        kernel.host().move(1.0, limits=beyond)
    with pytest.raises(InputError) as refusal:
        Limits(velocity=10**400, acceleration=1.0, jerk=1.0)
    assert len(str(refusal.value)) < 200
    assert refusal.value.value == 10**400


def test_arrays_are_sequences_and_tiny_numbers_are_zero_everywhere() -> None:
    """Plan takes arrays of positions; plan_many counts the same numbers as zero as plan."""
    assert plan(np.array([0.0, 1.0]), np.array([2.0, 3.0]), L, T).cycles > 0
    assert plan(0.0, 1e-61, L, T).cycles == plan_many([0.0], [1e-61], L, T).cycles[0] == 0
    kernel, host = enabled([Axis(L, 1.0, "ideal")] * 2)
    move = host.move(np.array([2.0, 3.0]))
    kernel.step(20_000)
    assert move.done
    assert [axis.position for axis in host.feedback().axes] == [2.0, 3.0]


def test_motions_can_be_copied_compared_and_kept() -> None:
    """Pickle, deep copy, equality and hash, of motions, profiles, states and limits."""
    motion = plan([0.0, 1.0], [5.0, 3.0], L, T)
    for thing in (motion, P, State(1.0, 2.0), L):
        for other in (pickle.loads(pickle.dumps(thing)), copy.deepcopy(thing), copy.copy(thing)):
            assert other == thing
            assert hash(other) == hash(thing)
    assert motion != plan([0.0, 1.0], [5.0, 4.0], L, T)
    kept = pickle.loads(pickle.dumps(motion))
    assert np.array_equal(kept.sample().position, motion.sample().position)


def stepped() -> tuple[MotionKernel, Host]:
    return enabled([AXIS], T)


def test_a_host_with_another_cycle_time_is_refused() -> None:
    """Limits per cycle would mean something else: refused with the kernel's own."""
    with MotionKernel([AXIS], T) as kernel:
        with pytest.raises(InputError, match=r"cycle_time = 0.002.*0.001"):
            Host.attach(kernel.name, [L], 2e-3)
        with Host.attach(kernel.name, [L], T) as host:
            host.enable()


def test_limits_of_a_move_stay_within_those_of_the_axis() -> None:
    """Higher limits are refused by the host, and by the kernel where the host is mistaken."""
    kernel, host = stepped()
    with pytest.raises(InputError, match=r"limits.velocity"):
        host.move(3.0, limits=Limits(1e9, 500.0, 5000.0))
    with pytest.raises(InputError, match="limits"):
        host.move(3.0, limits=3)  # type: ignore[arg-type]
    host.link.limits = (Limits(1e3, 1e4, 1e6),)
    move = host.move(3.0)
    kernel.step()
    assert move.state is MoveState.REFUSED
    assert not host.feedback().moving


def test_limits_of_a_move_by_axis() -> None:
    """Each axis by its own lower ones, the rest as they are; of axes of the move only."""
    slow = Limits(9.0, 400.0, 4000.0)
    kernel, host = enabled([AXIS, AXIS], T)
    host.move([20.0, 20.0], limits={1: slow}, synchronization="none")
    kernel.step(400)
    first, second = host.feedback().axes
    assert first.peak_velocity > 50.0
    assert 8.9 < second.peak_velocity <= 9.0 * (1 + 1e-9)
    for wrong in ({1: slow}, {0: None}, {0: Limits(91.0, 500.0, 5000.0)}):
        with pytest.raises(InputError, match="limits"):
            host.move({0: 1.0}, limits=wrong)  # type: ignore[arg-type]


def test_the_position_range_of_an_axis_stays_in_force() -> None:
    """Other limits for one move do not lift it."""
    kernel = MotionKernel([Axis(Limits(90.0, 500.0, 5000.0, position=(-5.0, 5.0)), 1e5)], T)
    host = kernel.host()
    kernel.step()
    with pytest.raises(InputError, match="position"):
        host.move(100.0, limits=L)


def test_one_host_at_a_time_in_an_own_loop_too() -> None:
    """The second is refused until the first is closed, then goes on from its counters."""
    kernel, host = stepped()
    with pytest.raises(SjerkError, match="already has a host"):
        kernel.host()
    first = host.move(1.0)
    kernel.step(400)
    assert first.done
    host.close()
    with pytest.raises(SjerkError, match="left"):
        host.move(2.0)
    following = kernel.host()
    second = following.move(2.0)
    kernel.step(400)
    assert second.done
    assert following.feedback().axes[0].position == 2.0


def test_no_goal_is_taken_while_the_drives_are_to_be_disabled() -> None:
    """A disable that waits for the end of a motion is not put off by new goals."""
    kernel, host = stepped()
    host.move(5.0)
    kernel.step(50)
    host.disable()
    kernel.step()
    late = host.move(50.0)
    kernel.step()
    assert late.state is MoveState.REFUSED
    kernel.step(2000)
    assert not host.feedback().axes[0].enabled
    assert host.feedback().axes[0].goal == 5.0


def test_a_drive_fault_is_named_by_the_waiting_move() -> None:
    """The error of a move that a fault ended carries the drive's code."""
    kernel, host = stepped()
    move = host.move(20.0)
    kernel.step(100)
    fault = 3  # SJ_FAULT_OVER_VOLTAGE
    from sjerk._binding import ffi, lib

    lib.sj_drive_inject(ffi.addressof(kernel.core.axis[0], "drive"), fault, 1)
    kernel.step(2000)
    host.link.clocked = True  # let it wait for what has already happened
    with pytest.raises(MotionStoppedError, match="drive fault") as stopped:
        move.wait(timeout=1.0)
    assert stopped.value.faults == {0: lib.sj_drive_fault_code(fault)}


def test_a_kernel_that_has_ended_is_not_silently_simulated() -> None:
    """host(), step() and with: an error that says to make a new one."""
    with MotionKernel([AXIS], T) as kernel, kernel.host() as host:
        assert kernel.pid is not None
        os.kill(kernel.pid, signal.SIGKILL)
        os.waitid(os.P_PID, kernel.pid, os.WEXITED | os.WNOWAIT)
        with pytest.raises(KernelGoneError):
            host.feedback()
        with pytest.raises(KernelGoneError):
            host.reset()
    for call in (kernel.host, kernel.step, kernel.__enter__):
        with pytest.raises(SjerkError, match="ended"):
            call()


def test_the_shortest_documented_cycle_is_allowed_however_it_is_written() -> None:
    """25 us, also as a product that rounds below it."""
    assert MotionKernel([AXIS], 25 * 1e-6).cycle_time == 25e-6


def test_a_stale_segment_of_the_same_name_is_replaced() -> None:
    """A kernel and its owner that were both killed do not block their name."""
    name = f"stale-{time.monotonic_ns()}"
    program = (
        "import os, sys; from sjerk.handshake import *; from sjerk.host.reader import layout; "
        f"s = Segment.create({name!r}, layout(1)); os._exit(0)"
    )
    subprocess.run([sys.executable, "-c", program], check=True)
    with MotionKernel([AXIS], T, name=name) as kernel, kernel.host() as host:
        host.enable()


@pytest.mark.parametrize(
    "arguments",
    [
        ["demo", "--out", "/nowhere/x.png"],
        ["demo", "--out", "p.xyz"],
        ["demo", "--out", ""],
        ["demo", "--out", "/tmp"],
        ["demo", "{tmp}"],
        ["demo", "{tmp}/bytes.csv"],
        ["demo", "{tmp}/dir.csv"],
        ["demo", "{tmp}/long.csv"],
        ["demo", "{tmp}/none.csv"],
        ["drive", "--eds", "/nowhere/x.eds"],
    ],
)
def test_the_command_line_tells_in_one_line(arguments: list[str], tmp_path: Path) -> None:
    """Exit code 1 and one line, before anything moves."""
    (tmp_path / "bytes.csv").write_bytes(bytes(range(256)))
    (tmp_path / "dir.csv").mkdir()
    (tmp_path / "long.csv").write_text("time_s,position_deg\n" + "1" * 200_000 + ",1\n")
    run = subprocess.run(
        [sys.executable, "-m", "sjerk", *(a.format(tmp=tmp_path) for a in arguments)],
        capture_output=True,
        text=True,
        timeout=60,
        cwd=tmp_path,
    )
    assert run.returncode == 1, run.stdout
    assert run.stderr.count("\n") == 1, run.stderr
    assert run.stderr.startswith("sjerk: ")
    assert "moving" not in run.stderr


@pytest.mark.parametrize("call", ["enable", "reset", "resume", "override", "set_limits"])
def test_what_cannot_be_waited_for_is_refused_before_it_is_sent(call: str) -> None:
    """A timeout that is no number; the kernel has seen nothing of it."""
    with MotionKernel([AXIS], T) as kernel, kernel.host() as host:
        before = host.link.frame().sequence
        arguments = {"override": [0.5], "set_limits": [AXIS.limits]}.get(call, [])
        with pytest.raises(InputError, match="timeout"):
            getattr(host, call)(*arguments, timeout=float("nan"))
        host.hold()
        assert host.link.frame().sequence == before + 1


def test_a_name_that_is_taken_is_told_as_it_was_given() -> None:
    """Two kernels of one name: not the segment of a trace beside it."""
    with MotionKernel([AXIS], T) as kernel:
        second = MotionKernel([AXIS], T, name=kernel.name)
        with pytest.raises(SegmentTakenError) as told:
            second.__enter__()
        assert f"{kernel.name!r}" in str(told.value)
        assert ".trace" not in str(told.value)
