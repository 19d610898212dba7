"""Drives outside the kernel: bit 12 that falls at speed, silence, the end of the kernel."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from sjerk import (
    Axis,
    Host,
    Limits,
    MotionKernel,
    MotionStoppedError,
    Recording,
    replay,
    simulate,
)
from sjerk._binding import lib
from sjerk.cia402 import Drive, DriveConfig
from sjerk.host import EventKind, LimitSwitch, MoveState
from sjerk.kernel import FeedForward

T = 1e-3
REV = 2**24
COUNTS = REV / 360.0
LIMITS = Limits(3600.0, 36000.0, 720000.0)
FOLLOWS, SILENT = 0x1000, 0x4


class Line:
    """A kernel and one simulated drive in the caller's loop, as a bus would join them."""

    def __init__(self, limits: Limits = LIMITS, **changes: float) -> None:
        self.drive = Drive(DriveConfig(**changes))  # type: ignore[arg-type]
        self.kernel = MotionKernel([Axis(limits, COUNTS, "external")], T)
        self.host = self.kernel.host()
        self.masked = self.missed = self.silent = self.deaf = False
        self.word = 0
        self.targets: list[int] = []
        self.host.enable()
        self.step(20)

    def step(self, cycles: int = 1) -> None:
        """``deaf``: the drive goes on with the last controlword it took."""
        image = self.kernel.image
        for _ in range(cycles):
            out = image.outputs[0]
            self.targets.append(int(out["target_position"]))
            self.word = self.word if self.deaf else int(out["controlword"])
            feedback = self.drive.cycle(
                self.word,
                int(out["target_position"]),
                mode=int(out["mode"]),
                velocity_offset=int(out["velocity_offset"]),
                torque_offset=int(out["torque_offset"]),
                sync_missed=self.missed,
            )
            image.stale[0] = self.silent
            if not self.silent:
                row = image.inputs[0]
                row["statusword"] = feedback.statusword & ~(FOLLOWS if self.masked else 0)
                row["mode_display"] = feedback.mode_display
                row["position_actual"] = feedback.position_actual
                row["velocity_actual"] = feedback.velocity_actual
                row["error_code"] = feedback.error_code
                row["digital_inputs"] = feedback.digital_inputs
            self.kernel.step()


@pytest.mark.parametrize("cycles", [1, 2, 3])
def test_a_missed_sync_throws_no_move_away(cycles: int) -> None:
    """Bridged by 2100h:3: bit 12 stays, the goal is reached to the bit, nothing is found."""
    line = Line()
    move = line.host.move([3600.0])
    line.step(500)
    line.missed = True
    line.step(cycles)
    line.missed = False
    line.step(2500)
    assert move.state is MoveState.DONE
    assert line.targets[-1] == round(3600.0 * COUNTS)
    assert not line.drive.report().findings


@pytest.mark.parametrize("cycles", [1, 3])
def test_bit_12_that_falls_for_a_few_cycles_at_speed_is_no_stop(cycles: int) -> None:
    """The command goes on, the stream has no step, the move is done."""
    line = Line()
    move = line.host.move([3600.0])
    line.step(500)
    line.masked = True
    line.step(cycles)
    line.masked = False
    line.step(2500)
    assert move.state is MoveState.DONE
    assert line.targets[-1] == round(3600.0 * COUNTS)
    assert line.drive.report().clean


@pytest.mark.parametrize("back", [False, True])
def test_a_stale_axis_is_stopped_by_its_drive_and_its_command_does_not_go_back(back: bool) -> None:
    """Only the way back is lost: quick stop bit out, the last commanded target, no JUMP or STEP."""
    line = Line()
    line.host.move([3600.0])
    line.step(500)
    line.silent = True
    line.step(30)
    assert not line.kernel.image.outputs[0]["controlword"] & SILENT
    line.silent = not back
    line.step(400)
    report = line.drive.report()
    assert not report.findings
    assert line.drive.cycle(0, 0).velocity_demand == 0
    steps = [abs(b - a) for a, b in pairwise(line.targets[500:530])]
    assert max(steps) <= LIMITS.velocity * COUNTS * T + 1


def test_a_limit_switch_of_a_drive_is_a_ramp_and_the_axis_can_leave_it() -> None:
    """605Ah to its own end whatever the kernel sends meanwhile; then a move away is done."""
    line = Line(switch_positive_rev=5.0)
    move = line.host.move([3600.0])
    speeds = []
    for _ in range(2000):
        line.step()
        speeds.append(line.kernel.image.inputs[0]["position_actual"])
    assert move.state is not MoveState.DONE
    velocity = [(b - a) / REV / T for a, b in pairwise(map(int, speeds))]
    assert max(a - b for a, b in pairwise(velocity)) < 1.0  # rev/s in 1 ms, of 10
    line.host.move([0.0])
    line.step(3000)
    assert line.host.feedback().axes[0].actual_position == pytest.approx(0.0, abs=0.01)
    assert not line.drive.report().findings


# ---- the end of the kernel -----------------------------------------------------------------------


def end(line: Line) -> int:
    """The order to end, and cycles until the loop of a kernel's process would leave."""
    line.kernel.core.ending = 1
    for cycle in range(20_000):
        line.step()
        if lib.sj_kernel_at_rest(line.kernel.core):
            return cycle + 1
    raise AssertionError("never at rest")


@pytest.mark.parametrize("deceleration", [36000.0, 1000.0])
def test_the_end_waits_until_an_external_drive_is_disabled(deceleration: float) -> None:
    """Out of full motion, also where the stop alone takes longer than the wait at its end."""
    line = Line(Limits(3600.0, 36000.0, 720000.0, deceleration=deceleration))
    line.host.jog([3600.0])
    line.step(500)
    cycles = end(line)
    assert cycles > 3600.0 / deceleration / T
    assert line.drive.state.name != "OPERATION_ENABLED"
    assert abs(line.drive.cycle(0).velocity_actual) < 1e-3 * 10 * REV  # of the limit: at rest
    assert not line.drive.report().findings


def test_the_end_waits_no_longer_for_a_drive_that_stays_enabled() -> None:
    """Two seconds after the order, however long the axis has rested before."""
    line = Line()
    line.step(3000)
    line.deaf = True
    assert 2.0 / T - 2 <= end(line) <= 2.0 / T + 2
    assert line.drive.state.name == "OPERATION_ENABLED"


def test_the_end_does_not_wait_for_a_drive_that_is_silent() -> None:
    """What it said last was that it is enabled."""
    line = Line()
    line.silent = True
    assert end(line) <= 10


# ---- limit switches ------------------------------------------------------------------------------


@pytest.mark.parametrize(("side", "way"), [(LimitSwitch.POSITIVE, 1), (LimitSwitch.NEGATIVE, -1)])
def test_a_limit_switch_is_told_with_its_side(side: LimitSwitch, way: int) -> None:
    """60FDh in the feedback, an event as it closes and opens, the reason of the move's end."""
    line = Line(**{f"switch_{side.name.lower()}_rev": 5.0 * way})  # type: ignore[union-attr]
    line.host.events()
    assert line.host.feedback().axes[0].limit_switches == LimitSwitch(0)
    move = line.host.move([3600.0 * way])
    line.step(2000)
    axis = line.host.feedback().axes[0]
    assert axis.limit_switches is side
    assert axis.digital_inputs & 3 == side
    told = [e for e in line.host.events()[0] if e.kind in (EventKind.SWITCH, EventKind.ANCHOR)]
    assert [(e.kind, e.axis) for e in told] == [(EventKind.SWITCH, 0), (EventKind.ANCHOR, 0)]
    assert (told[0].code, told[0].value) == (side, 0.0)
    assert str(told[0]).endswith(f"axis 0: limit switch closed, {side.name.lower()}")
    with pytest.raises(
        MotionStoppedError, match=f"limit switch closed .axis 0: {side.name.lower()}"
    ):  # type: ignore[union-attr]
        move.check()
    line.host.move([0.0])
    line.step(3000)
    (opened,) = [e for e in line.host.events()[0] if e.kind is EventKind.SWITCH]
    assert (opened.code, opened.value) == (0, float(side))
    assert str(opened).endswith("axis 0: limit switches are open")
    assert line.host.feedback().axes[0].limit_switches == LimitSwitch(0)


def test_switches_of_simulated_drives_are_told_and_replayed(tmp_path: Path) -> None:
    """Two axes, two sides; the recording of it has the inputs and runs again bit for bit."""
    axes = [
        Axis(LIMITS, COUNTS, DriveConfig(switch_positive_rev=1.0)),
        Axis(LIMITS, COUNTS, DriveConfig(switch_negative_rev=-1.0)),
    ]
    script = [
        (1, lambda host: host.enable()),
        (20, lambda host: host.move([3600.0, 0.0])),
        (800, lambda host: host.move({1: -3600.0})),
    ]
    found = simulate(MotionKernel(axes, T), script, 2000)  # type: ignore[arg-type]
    told = [(e.axis, e.code) for e in found.events if e.kind is EventKind.SWITCH]
    assert told == [(0, LimitSwitch.POSITIVE), (1, LimitSwitch.NEGATIVE)]
    found.save(tmp_path / "switches.parquet")
    again = Recording.open(tmp_path / "switches.parquet")
    assert (again.column("digital_inputs")[-1] == [2, 1]).all()
    assert replay(again).identical


def test_an_external_drive_that_is_fed_forward_replays() -> None:
    """Its inputs are in the trace, 60FDh too: the events come out again."""
    fed = FeedForward.of(DriveConfig())
    kernel = MotionKernel([Axis(LIMITS, COUNTS, "external", feed_forward=fed)], T)
    rng = np.random.default_rng(3)

    def act(cycle: int, host: Host) -> None:
        row = kernel.image.inputs[0]
        if cycle == 1:
            host.enable()
            row["statusword"], row["mode_display"] = 0x1237, 8
        if cycle > 1 and rng.random() < 0.01:
            row["digital_inputs"] = int(rng.integers(16))
        if rng.random() < 0.005:
            host.move([float(rng.uniform(-1000.0, 1000.0))])
        row["position_actual"] = kernel.image.outputs[0]["target_position"]

    found = simulate(kernel, act, 3000)
    assert sum(e.kind is EventKind.SWITCH for e in found.events) > 10
    assert np.abs(found.column("velocity_offset")).max() > 1000
    done = replay(found)
    assert done.identical, done.difference
