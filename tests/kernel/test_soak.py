"""The soak of the kernel, a short one; and that its judge finds what it is there to find."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.root import STRESS
from sjerk import (
    Axis,
    DriveConfig,
    Host,
    InputError,
    Limits,
    MotionKernel,
    Recording,
    Trajectory,
    follow,
    simulate,
)
from sjerk._binding import ffi, lib
from sjerk.kernel.trace import command_dtype
from stress.kernel_check import check

T = 1e-3
COUNTS = 2**24 / 360.0
LIMITS = Limits(90.0, 500.0, 5000.0, deceleration=300.0, position=(-170.0, 170.0))
AXIS = Axis(LIMITS, COUNTS, "ideal", stop_limits=Limits(90.0, 2000.0, 40000.0))


def test_a_short_soak_finds_nothing(tmp_path: Path) -> None:
    """Real processes, three hosts, kills, faults: every cycle judged and replayed."""
    done = subprocess.run(
        [sys.executable, str(STRESS / "kernel.py"), "--minutes", "0.1", "--seed", "7"],
        capture_output=True,
        text=True,
        timeout=240,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "findings                 0" in done.stdout


# ---- the judge -----------------------------------------------------------------------------------


def good() -> Recording:
    """Two axes that move there, are halted, and move back under lower limits."""
    lower = Limits(40.0, 200.0, 2000.0)
    return simulate(
        MotionKernel([AXIS] * 2, T),
        [
            (1, lambda host: host.enable()),
            (20, lambda host: host.move([60.0, -30.0])),
            (600, lambda host: host.halt()),
            (1400, lambda host: host.move([0.0, 0.0], limits=lower)),
        ],
        5000,
    )


def test_a_good_recording_has_no_finding() -> None:
    """And both moves came near their limits, so that something was judged."""
    verdict = check(good())
    assert not verdict.findings, verdict.words
    assert verdict.goals == {"accepted": 2}
    assert min(verdict.largest.values()) > 0.99


def _position(frames: Any) -> None:
    frames["axis"]["position"][300:, 0] += 1e-4


def _velocity(frames: Any) -> None:
    frames["axis"]["velocity"][300, 1] *= 1.001


def _target(frames: Any) -> None:
    frames["axis"]["target_counts"][700, 1] += 1


def _drive(frames: Any) -> None:
    frames["axis"]["flags"][700, 1] &= ~np.uint32(lib.SJ_TRACE_FOLLOWS)


def _beyond(frames: Any) -> None:
    frames["axis"]["position"][:, 0] += 150.0


@pytest.mark.parametrize(
    ("spoil", "kind"),
    [
        (_position, "step of the position"),
        (_velocity, "step of the velocity"),
        (_target, "target off its position"),
        (_drive, "command off the drive"),
        (_beyond, "position limit"),
    ],
)
def test_one_wrong_number_is_found(spoil: Any, kind: str) -> None:
    """Each promise, broken in one place of a good recording."""
    found = good()
    spoil(found.all.frames)
    assert check(found).findings[kind] > 0


def test_limits_of_the_goal_are_judged_not_only_those_of_the_axis() -> None:
    """The same motion under a command that asked for less is beyond its limits."""
    found = good()
    command = found.commands["data"][-1:].copy().view(command_dtype(2))
    limits = command["axis"]["goal"]["limits"]
    for name in limits.dtype.names:
        limits[name] *= 0.9
    found.commands["data"][-1] = command.view(found.commands["data"].dtype)[0]
    findings = check(found).findings
    for name in ("velocity", "jerk"):
        assert findings[f"limit of {name}"] > 0


def test_a_drive_that_follows_again_at_speed_is_slowed_down_within_its_axis_limits() -> None:
    """Not within the lower ones of the goal that its fault ended; beyond its own is found."""
    lagging = DriveConfig(
        velocity_feedforward=0.5, following_window=round(0.8 * COUNTS), following_time_ms=20
    )
    axis = Axis(LIMITS, COUNTS, lagging)
    again = simulate(
        MotionKernel([axis], T),
        [
            (1, lambda host: host.enable(0.0)),
            (20, lambda host: host.move(150.0, limits=Limits(89.0, 100.0, 500.0))),
            (794, lambda host: (host.reset(timeout=0.0), host.enable(0.0))),
        ],
        1200,
    )
    rows = again.all.frames["axis"][:, 0]
    follows = (rows["flags"] & lib.SJ_TRACE_FOLLOWS) != 0
    first = 1 + int(np.flatnonzero(follows[1:] & ~follows[:-1])[-1])
    assert first > 794
    assert rows["velocity"][first] != 0.0
    assert not check(again).findings
    rows["position"][first + 3] += 5e-6
    assert check(again).findings["limit of jerk"] > 0


def test_a_missing_and_a_second_answer_are_found() -> None:
    """Every goal has exactly one, in the cycle that took it."""
    found = good()
    events = found.all.events
    told = np.flatnonzero(events["kind"] == lib.SJ_EVENT_GOAL)
    goal = events["goal_id"][told[1]].copy()
    events["goal_id"][told[1]] = 77
    findings = check(found).findings
    assert findings["goal without its answer"] == 1
    assert findings["answer without a goal"] == 1
    events["goal_id"][told[1]] = goal
    events["cycle"][told[1]] += 1
    assert check(found).findings["goal without its answer"] == 1


def _left(frames: Any) -> None:
    frames["axis"]["flags"][700:, 1] |= np.uint32(lib.SJ_TRACE_DRIVE_STOP)


def test_an_axis_is_left_to_its_drive_only_while_it_homes() -> None:
    """A stop in any cycle of a homing is the drive's, also before the drive shows mode 6; any other
    one is a finding.
    """
    spoilt = good()
    _left(spoilt.all.frames)
    assert check(spoilt).findings["left to its drive"] == 1
    for after in range(1, 9):
        for stop in (Host.halt, Host.quick_stop):
            script = [
                (1, lambda host: host.enable()),
                (60, lambda host: host.home()),
                (60 + after, lambda host, stop=stop: stop(host, 0.0)),
            ]
            found = simulate(MotionKernel([Axis(LIMITS, COUNTS)], T), script, 200)
            if after <= 3:
                flags = found.all.frames["axis"]["flags"]
                assert (flags & lib.SJ_TRACE_DRIVE_STOP).any()
            assert not check(found).findings


# ---- what the soak found -------------------------------------------------------------------------


@given(seed=st.integers(0, 2**32))
@settings(max_examples=60, deadline=None)
def test_limits_lowered_on_the_way_never_carry_an_axis_beyond_its_own(seed: int) -> None:
    """Goals, halts and limits with lower acceleration and jerk, in the midst of any motion."""
    rng = np.random.default_rng(seed)

    def act(host: Host) -> None:
        lower = Limits(*(rng.uniform(0.1, 1.0, 3) * [90.0, 300.0, 5000.0]))
        goal = rng.uniform(-160.0, 160.0, 3).tolist()
        kind = int(rng.integers(11))
        try:
            if kind < 3:
                sync = ("time", "phase", "none")[kind]
                host.move(goal, limits=lower, synchronization=sync)  # type: ignore[arg-type]
            elif kind == 3:
                host.move(goal)
            elif kind == 4:
                host.jog({0: goal[0] / 2.0, 1: goal[1] / 2.0})
            elif kind == 5:
                host.halt(axes=[0, 1])
            elif kind == 6:
                host.quick_stop()
            elif kind == 7:
                host.override(abs(goal[0]) / 80.0)
            elif kind == 8:
                host.hold() if goal[1] > 0.0 else host.resume()
            elif kind == 9:
                host.move(goal, limits=lower, buffer="blend next" if goal[1] > 0.0 else "buffered")
            else:
                host.set_limits(lower if goal[0] > 0.0 else LIMITS, axes=0)
        except InputError:
            return  # beyond the limits of the moment: not sent

    cycles = np.sort(rng.integers(20, 2500, 40)).tolist()
    script = [(1, lambda host: host.enable()), *((cycle, act) for cycle in cycles)]
    found = simulate(MotionKernel([AXIS] * 3, T), script, 4500)
    verdict = check(found)
    assert not verdict.findings, verdict.words


@given(
    at=st.integers(120, 250),
    share=st.floats(0.86, 0.99),
    lower=st.tuples(st.floats(0.3, 1.0), st.floats(0.1, 1.0), st.floats(0.1, 0.4)),
    way=st.sampled_from(["jog", "back", "move"]),
)
@settings(max_examples=150, deadline=None)
def test_a_lower_jerk_is_exceeded_only_as_much_as_the_velocity_needs(
    at: int, share: float, lower: tuple[float, float, float], way: str
) -> None:
    """Of a start (V, A), A^2 / 2J is what any jerk adds, and whole cycles add no more."""
    asked = Limits(*(np.array(lower) * [90.0, 300.0, 5000.0]))

    def act(host: Host) -> None:
        if way == "move":
            host.move(165.0, limits=asked)
        else:
            host.jog(asked.velocity if way == "jog" else -asked.velocity, limits=asked)

    script = [
        (1, lambda host: host.enable()),
        (10, lambda host: host.jog(90.0 * share)),
        (10 + at, act),
    ]
    found = simulate(MotionKernel([AXIS], T), script, 10 + at + 600)
    row = 10 + at - 2  # the last cycle before
    j = found.jerk[row, 0]
    A = found.acceleration[row, 0] + j * T / 2
    V = found.velocity[row, 0] + found.acceleration[row, 0] * T / 2
    room = max(90.0 - np.copysign(V, A * V), 1e-6)
    needed = A**2 / (2.0 * room)
    assert np.abs(found.velocity).max() <= 90.0 * (1 + 1e-9)
    assert np.abs(found.jerk[row + 2 :]).max() <= max(asked.jerk, needed) * (1 + 1e-6)


@given(
    velocity=st.floats(35.0, 45.0),
    lower=st.tuples(st.floats(0.3, 1.0), st.floats(0.3, 1.0), st.floats(0.02, 0.2)),
    rest=st.booleans(),
    act=st.sampled_from(["jog", "move", "halt and jog"]),
    after=st.integers(80, 260),
)
@settings(max_examples=150, deadline=None)
def test_an_axis_that_leaves_a_path_keeps_the_limits_the_path_began_under(
    velocity: float, lower: tuple[float, float, float], rest: bool, act: str, after: int
) -> None:
    """Not those of a motion before it, nor those that are lowered while the path rests or runs."""
    before = Limits(velocity, 300.0, 5000.0)
    during = Limits(*(np.array(lower) * [velocity, 300.0, 5000.0]))
    way = Trajectory(["a"], 0.01 * np.arange(5), [[0.0], [5.0], [20.0], [60.0], [100.0]])
    plan = list(follow(way, [before], T))
    paths: list[Any] = []

    def script(cycle: int, host: Host) -> None:
        if cycle == 1:
            host.enable()
        elif cycle == 10:
            host.jog(1.0)  # under the axis' first limits, lowered on the way
        elif cycle == 20:
            host.set_limits(before)
        elif cycle == 25:
            host.move(0.0)
        elif cycle == 1000:
            paths.append(host.follow(plan))
            if rest:
                paths[0].pause()
        elif cycle == 1010:
            host.set_limits(during)
        elif cycle == 1020 and rest:
            paths[0].resume()
        elif cycle == 1020 + after and act == "move":
            host.move(150.0)
        elif cycle == 1020 + after:
            host.jog(during.velocity)
        elif cycle == 1025 + after and act == "halt and jog":
            host.halt()
        for path in paths:
            path.pump()

    axis = Axis(LIMITS, COUNTS, "ideal", stop_limits=AXIS.stop_limits)
    verdict = check(simulate(MotionKernel([axis], T), script, 2500))
    assert not verdict.findings, verdict.words


def test_a_host_that_dies_is_noticed_though_its_successor_waited() -> None:
    """The next host is there before anybody looked: the motion is halted all the same."""
    kernel = MotionKernel([AXIS], T)
    host = kernel.host()
    host.enable()
    kernel.step(10)
    host.jog(50.0)
    kernel.step(300)
    base = host.link.segment.base
    lib.sj_shm_begin_host(base, 1, 0)
    kernel.step(2)
    told = [(e.code, e.value) for e in host.events()[0] if e.kind.name == "HOST"]
    assert told == [
        (lib.SJ_HOST_ALIVE, lib.SJ_HOST_ABSENT),
        (lib.SJ_HOST_DEAD, lib.SJ_HOST_ALIVE),
        (lib.SJ_HOST_ALIVE, lib.SJ_HOST_DEAD),
    ]
    kernel.step(600)
    assert not host.feedback().moving
    host.jog(50.0)
    kernel.step(300)
    lib.sj_shm_leave_host(base)
    lib.sj_shm_begin_host(base, 2, 0)
    kernel.step(600)
    assert host.feedback().moving
    assert kernel.core.trace == ffi.NULL
