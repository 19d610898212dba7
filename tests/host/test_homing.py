"""Homing by a host: done means usable, a failure is told as such, a stop or a reaction ends it."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.loops import enabled
from sjerk import (
    Axis,
    DriveConfig,
    Host,
    Limits,
    MotionKernel,
    MotionStoppedError,
    Reactions,
    RefusedError,
)
from sjerk._binding import ffi, lib
from sjerk.cycle.states import AxisState
from sjerk.host import EventKind, Move, MoveState

T = 1e-3
COUNTS = 2**24 / 360.0
LIMITS = Limits(90.0, 500.0, 5000.0)
OPEN = (MoveState.SENT, MoveState.QUEUED, MoveState.MOVING)


def axis(method: int = 37, **more: object) -> Axis:
    return Axis(LIMITS, COUNTS, DriveConfig(homing_method=method, **more))  # type: ignore[arg-type]


HERE, INDEX, NO_SWITCH = axis(37), axis(34), axis(17)


def ended(kernel: MotionKernel, moves: Sequence[Move]) -> list[MoveState]:
    """Step until all of them are over."""
    for _ in range(30_000):
        kernel.step()
        if all(move.state not in OPEN for move in moves):
            return [move.state for move in moves]
    raise AssertionError([move.state for move in moves])


def states(host: Host) -> list[AxisState]:
    return [one.state for one in host.feedback().axes]


@settings(max_examples=25, deadline=None)
@given(
    methods=st.lists(st.sampled_from([33, 34, 35, 37]), min_size=1, max_size=3),
    start=st.floats(-40, 40),
)
def test_the_next_goal_after_homing_is_always_taken(methods: list[int], start: float) -> None:
    """In the very cycle in which the handle is done; nothing rests before, nothing steps then."""
    kernel, host = enabled([axis(method) for method in methods], T)
    assert ended(kernel, [host.move([start] * len(methods))]) == [MoveState.DONE]
    home = host.home()
    while not home.done:
        kernel.step()
        assert home.done or host.feedback().moving or home.state is MoveState.SENT
    assert set(states(host)) == {AxisState.STANDSTILL}
    assert [e.goal_id for e in host.events()[0] if e.kind is EventKind.REACHED][-1] == home.goal_id
    move = host.move([1.0] * len(methods))
    assert ended(kernel, [move]) == [MoveState.DONE]


REV = 2**24
MACHINE = {
    "switch_negative_rev": -0.7,
    "switch_positive_rev": 1.4,
    "switch_home_rev": 0.35,
    "switch_home_end_rev": 0.65,
    "homing_speed_switch": 6 * REV,
    "homing_speed_zero": 3 * REV,
    "homing_acceleration": 100 * REV,
}
STOPS = {"hard_stop_negative_rev": -0.25, "hard_stop_positive_rev": 1.25}


@pytest.mark.parametrize(
    ("method", "home"),
    [
        *((1, 0.0), (2, 1.0), (7, 0.0), (8, 1.0), (12, 0.0), (11, 1.0), (17, -0.7), (18, 1.4)),
        *((23, 0.35), (29, 0.35), (25, 0.65), (27, 0.65), (-1, 1.0), (-2, 0.0), (-3, 1.25)),
        (-4, -0.25),
    ],
)
def test_a_host_homes_by_any_method_of_the_drive(method: int, home: float) -> None:
    """Zero is where the method has it; the axis rests there, and the next goal is taken."""
    fields = MACHINE if method > 0 else MACHINE | STOPS
    if method < 0:
        fields = fields | {"switch_negative_rev": -1e9, "switch_positive_rev": 1e9}
    kernel, host = enabled([axis(method, **fields)], T)
    assert ended(kernel, [host.home()]) == [MoveState.DONE]
    kernel.step(500)
    drive = kernel.image.inputs[0]
    assert drive["position_internal"] - drive["position_actual"] == pytest.approx(home * REV, abs=1)
    inside = -5.0 if home > 0.5 else 5.0
    assert ended(kernel, [host.move(inside)]) == [MoveState.DONE]
    kernel.step(500)
    assert host.feedback().axes[0].actual_position == pytest.approx(inside, abs=0.01)


@pytest.mark.parametrize("method", [34, 37])
def test_a_queued_move_waits_for_the_homing_before_it(method: int) -> None:
    """It begins when homing is over, in the new frame; it is not lost with the old one."""
    kernel, host = enabled([axis(method), HERE], T)
    home = host.home(axes=0)
    queued = [host.move({0: 2.0}, buffer="buffered"), host.move({0: 1.0}, buffer="buffered")]
    assert ended(kernel, [home, *queued]) == [MoveState.DONE] * 3
    assert host.feedback().axes[0].position == 1.0


@pytest.mark.parametrize("reaction", ["none", "halt", "quick stop"])
def test_a_homing_that_fails_is_told_and_stops_those_that_home_with_it(reaction: str) -> None:
    """ErrorStop and its reason here, a stop there; other axes do as the reactions say."""
    axes = [NO_SWITCH, axis(17, switch_negative_rev=-40.0), HERE]
    kernel, host = enabled(axes, T, reactions=Reactions(drive_fault=reaction))
    host.jog({2: 20.0})
    kernel.step()
    home = host.home(axes=(0, 1))
    behind = host.move({0: 1.0}, buffer="buffered")
    assert ended(kernel, [home, behind])[0] is MoveState.STOPPED
    assert behind.state in (MoveState.STOPPED, MoveState.REFUSED)
    with pytest.raises(MotionStoppedError, match="homing of axis 0 failed before") as caught:
        home.check()
    assert caught.value.unhomed == 0
    kernel.step(1500)
    frame = host.feedback()
    assert [one.moving for one in frame.axes] == [False, False, reaction == "none"]
    assert frame.axes[0].state is AxisState.ERROR_STOP
    assert frame.axes[1].state is not AxisState.ERROR_STOP
    told = [(e.axis, e.code) for e in host.events()[0] if e.kind is EventKind.FAULT]
    assert told == [(0, -1)]
    refused = host.move({0: 1.0})
    kernel.step()
    with pytest.raises(RefusedError, match="stopping, homing, or has an error"):
        refused.check()
    host.reset()
    kernel.step(50)
    assert ended(kernel, [host.move([1.0, 1.0, 1.0])]) == [MoveState.DONE]


@pytest.mark.parametrize("method", [35, 37])
def test_a_goal_during_homing_is_refused_for_that_reason(method: int) -> None:
    """In every cycle until the handle is done: because the axis homes, not for want of power."""
    kernel, host = enabled([axis(method)], T)
    home = host.home()
    kernel.step()
    reasons = set()
    while not home.done:
        move = host.move(1.0)
        kernel.step()
        if home.done:
            break
        assert move.state is MoveState.REFUSED
        with pytest.raises(RefusedError) as caught:
            move.check()
        reasons.add(caught.value.code)
    assert reasons == {lib.SJ_RESULT_STATE}


@pytest.mark.parametrize("ends", ["halt", "quick_stop", "disable"])
def test_a_homing_that_was_ended_does_not_begin_again(ends: str) -> None:
    """By a stop or without power; with power again the axis stands."""
    kernel, host = enabled([INDEX], T)
    home = host.home()
    kernel.step(200)
    getattr(host, ends)()
    assert ended(kernel, [home]) == [MoveState.STOPPED]
    kernel.step(1500)
    host.enable()
    kernel.step(100)
    at = host.feedback().axes[0].actual_position
    assert states(host) == [AxisState.STANDSTILL]
    kernel.step(300)
    assert host.feedback().axes[0].actual_position == pytest.approx(at, abs=0.01)
    assert ended(kernel, [host.move(1.0)]) == [MoveState.DONE]


@pytest.mark.parametrize("reaction", ["none", "halt"])
def test_a_reaction_stops_axes_that_home(reaction: str) -> None:
    """Corrupt data, with a reaction for it: the drive stops as for a halt."""
    kernel, host = enabled([INDEX], T, reactions=Reactions(corrupt=reaction))
    host.home()
    kernel.step(100)
    corrupt(kernel)
    assert (states(host) == [AxisState.HOMING]) is (reaction == "none")


def corrupt(kernel: MotionKernel) -> None:
    """An impossible command word, for one cycle."""
    at = ffi.cast("uint32_t *", ffi.cast("char *", kernel.core.segment) + lib.SJ_SHM_COMMAND)
    before, at[0] = at[0], 0xFF
    kernel.step()
    at[0] = before


def test_the_command_homes_and_tells() -> None:
    """`sjerk home`: exit code 0 and where the axes are; 4 and the axis where it fails."""
    with MotionKernel([HERE, NO_SWITCH], T, name=f"home-{os.getpid()}") as kernel:
        with kernel.host() as host:
            host.enable()

        def sjerk(*words: str) -> subprocess.CompletedProcess[str]:
            program = [sys.executable, "-m", "sjerk", *words, "--name", kernel.name]
            return subprocess.run(program, capture_output=True, text=True, timeout=300)

        done = sjerk("home", "0")
        assert done.returncode == 0, done.stderr
        failed = sjerk("home", "1")
        assert failed.returncode == 4
        assert "homing of axis 1 failed" in failed.stderr
