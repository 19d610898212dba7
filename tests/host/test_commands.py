"""Commands of a host, one by one, in an own loop: what moves, what is refused, who stops what."""

from __future__ import annotations

import asyncio

import numpy as np
import pytest

from helpers.loops import enabled
from sjerk import (
    Axis,
    Drive,
    DriveConfig,
    Host,
    InputError,
    Limits,
    MotionKernel,
    Reactions,
    RefusedError,
    State,
    SupersededError,
)
from sjerk._binding import ffi, lib
from sjerk.cycle.states import AxisState
from sjerk.host import EventKind, MoveState

T = 1e-3
COUNTS = 2**24 / 360.0
LIMITS = Limits(90.0, 500.0, 5000.0, deceleration=300.0)
STOP = Limits(90.0, 2000.0, 40000.0)


def axis(position: tuple[float, float] | None = None, **more: object) -> Axis:
    limits = Limits(90.0, 500.0, 5000.0, deceleration=300.0, position=position)
    return Axis(limits, COUNTS, stop_limits=STOP, **more)  # type: ignore[arg-type]


def stepped(*axes: Axis, **more: object) -> tuple[MotionKernel, Host]:
    return enabled(axes or [axis()], T, **more)


def run(kernel: MotionKernel, host: Host, most: int = 20_000) -> np.ndarray:
    """Positions (cycles, axes) until nothing moves, the present one first."""
    rows = [[a.position for a in host.feedback().axes]]
    for _ in range(most):
        kernel.step()
        feedback = host.feedback()
        rows.append([a.position for a in feedback.axes])
        if not feedback.moving:
            return np.array(rows)
    raise AssertionError("it never came to rest")


def kept(rows: np.ndarray, limits: Limits = LIMITS, factor: float = 1.0) -> None:
    """No n-th difference exceeds its limit."""
    ulp = np.spacing(np.max(np.abs(rows)))
    most = (limits.velocity * factor, max(limits.acceleration, limits.braking[0]), limits.jerk)
    for n, limit in enumerate(most, start=1):
        assert np.max(np.abs(np.diff(rows, n, axis=0))) <= limit * T**n * (1 + 1e-9) + 2**n * ulp


def states(host: Host) -> list[AxisState]:
    return [a.state for a in host.feedback().axes]


@pytest.mark.parametrize("cycles", range(20, 400, 40))
def test_a_drive_is_disabled_when_its_motor_rests(cycles: int) -> None:
    """The command rests before the motor: without current it would coast away from it."""
    kernel = MotionKernel([axis()], T)
    host = kernel.host()
    host.enable()
    kernel.step(20)
    host.move(100.0)
    kernel.step(cycles)
    host.disable()
    host.halt()
    positions = []
    while host.feedback().axes[0].enabled:
        kernel.step()
        positions.append(kernel.positions.copy())
    assert abs(host.feedback().axes[0].actual_velocity) <= 1e-3 * 90.0
    rest = positions[-1]
    kernel.step(500)
    assert abs(host.feedback().axes[0].position - rest) < 0.02


def test_states_go_with_the_commands() -> None:
    """Disabled, standstill, discrete, continuous, stopping and back, each told as an event."""
    kernel = MotionKernel([axis()], T)
    host = kernel.host()
    kernel.step()
    assert states(host) == [AxisState.DISABLED]
    host.enable()
    kernel.step(10)
    host.move(5.0)
    kernel.step(50)
    host.jog(20.0)
    kernel.step(50)
    host.quick_stop()
    run(kernel, host)
    kernel.step()
    host.disable()
    kernel.step(1000)  # the motor comes to rest first
    told = [AxisState(e.code) for e in host.events()[0] if e.kind is EventKind.STATE]
    S = AxisState
    assert told == [
        S.STANDSTILL,
        S.DISCRETE_MOTION,
        S.CONTINUOUS_MOTION,
        S.STOPPING,
        S.STANDSTILL,
        S.DISABLED,
    ]


def test_a_relative_move_goes_from_the_commanded_position() -> None:
    """Also in motion; twice is twice."""
    kernel, host = stepped()
    start = host.feedback().axes[0].position
    host.move(3.0, relative=True)
    run(kernel, host)
    move = host.move(-1.0, relative=True)
    run(kernel, host)
    assert host.feedback().axes[0].position == pytest.approx(start + 2.0, abs=1e-12)
    assert move.done


def test_a_jog_holds_its_velocity_and_rests_at_the_position_limit() -> None:
    """Continuous motion at the velocity asked for; never beyond the limit."""
    kernel, host = stepped(axis((-20.0, 30.0)))
    host.jog(40.0)
    kernel.step(500)
    assert 39.9 < host.feedback().axes[0].velocity <= 40.0
    assert states(host) == [AxisState.CONTINUOUS_MOTION]
    kept(run(kernel, host))
    assert host.feedback().axes[0].position == 30.0
    refused = host.jog(1.0)
    kernel.step()
    assert refused.state is MoveState.REFUSED
    host.jog(-40.0)
    kernel.step(300)
    host.jog(0.0)
    kept(run(kernel, host))
    kernel.step()
    assert states(host) == [AxisState.STANDSTILL]


@pytest.mark.parametrize("velocity", [0.0, 0.5, 60.0])
def test_a_jog_of_zero_is_done_at_rest(velocity: float) -> None:
    """From rest at once, from a jog once that is over; a fault on the way is none of it."""
    kernel, host = stepped(axis((-20.0, 30.0)))
    host.jog(velocity)
    kernel.step(100)
    rest = host.jog(0.0)
    for _ in range(500):
        kernel.step()
        moves = host.feedback().axes[0].moving
        assert rest.state is (MoveState.MOVING if moves else MoveState.DONE)
        rest.check()
    assert rest.done
    turning = host.jog(10.0)
    kernel.step(100)
    host.halt(timeout=0.0)
    kernel.step(500)
    assert turning.state is MoveState.STOPPED


def test_a_goal_that_leaves_the_limits_is_refused_before_it_moves() -> None:
    """Beyond a limit, relative too, and with a velocity that could not be stopped in time."""
    kernel, host = stepped(axis((-20.0, 30.0)))
    with pytest.raises(InputError, match="position"):
        host.move(31.0)
    for ask in (
        lambda: host.move(40.0, relative=True),
        lambda: host.move(State(29.9, velocity=80.0)),
    ):
        move = ask()
        kernel.step()
        assert move.state is MoveState.REFUSED
        assert host.link.frame().result == lib.SJ_RESULT_LIMIT
        assert not host.feedback().moving
    host.move(State(20.0, velocity=30.0))
    kept(run(kernel, host))
    assert host.feedback().axes[0].position == 30.0


def test_a_halt_brings_all_axes_of_a_move_to_rest_in_the_same_cycle() -> None:
    """Halting one axis halts its group, within limits, together; a bystander goes on."""
    kernel, host = stepped(axis(), axis(), axis())
    group = host.move({0: 40.0, 1: -25.0})
    kernel.step()
    single = host.move({2: 85.0})
    kernel.step(400)
    host.halt(axes=0)
    rows = [[a.position for a in host.feedback().axes]]
    last = [0, 0, 0]
    for cycle in range(3000):
        kernel.step()
        feedback = host.feedback()
        rows.append([a.position for a in feedback.axes])
        for i, a in enumerate(feedback.axes):
            last[i] = cycle if a.moving else last[i]
        if not feedback.moving:
            break
    kept(np.array(rows))
    assert abs(last[0] - last[1]) <= 1
    assert last[2] > last[0] + 100
    assert group.state is MoveState.STOPPED
    assert single.done


@pytest.mark.parametrize("at", range(20, 420, 57))
def test_a_straight_line_is_kept_through_halt_hold_and_override(at: int) -> None:
    """Axes in phase stay on their line to the last bits, whenever they are slowed or held."""
    kernel, host = stepped(axis(), axis(), axis())
    start = np.array([a.position for a in host.feedback().axes])
    goal = start + np.array([40.0, -25.0, 10.0])
    move = host.move(goal.tolist(), synchronization="phase")
    rows = []

    def go(cycles: int) -> None:
        for _ in range(cycles):
            kernel.step()
            rows.append([a.position for a in host.feedback().axes])

    go(at)
    host.override(0.3)
    go(150)
    host.hold()
    go(900)
    assert all(a.velocity == 0.0 for a in host.feedback().axes)
    assert move.state is MoveState.MOVING
    host.override(1.5)
    go(20)
    host.resume()
    go(3000)
    assert move.done
    table = np.array(rows)
    kept(table)
    share = (table - start) / (goal - start)
    assert np.max(np.abs(share - share[:, :1])) < 1e-12
    assert table[-1].tolist() == goal.tolist()


def test_an_override_is_smooth_within_the_limits_and_never_beyond_them() -> None:
    """Any factor at any time: limits kept, the goal reached; 2 doubles a slow goal's velocity."""
    kernel, host = stepped()
    slow = Limits(20.0, 500.0, 5000.0, deceleration=300.0)
    move = host.move(60.0, limits=slow)
    rows, fastest = [host.feedback().axes[0].position], 0.0
    for factor in (0.5, 2.0, 0.0, 0.1, 2.0, 1.0):
        host.override(factor)
        for _ in range(400):
            kernel.step()
            rows.append(host.feedback().axes[0].position)
            fastest = max(fastest, host.feedback().axes[0].velocity)
    rows += [float(row[0]) for row in run(kernel, host)[1:]]
    kept(np.array(rows)[:, None])
    assert 39.0 < fastest <= 40.0 * (1 + 1e-9)
    assert move.done
    for wrong in (-0.1, 2.1, float("nan")):
        with pytest.raises(InputError):
            host.override(wrong)


def test_a_quick_stop_is_each_axis_at_its_own_stop_limits() -> None:
    """Faster than a halt, not slowed to synchronise; goals are refused until rest."""
    lengths = []
    for stop in ("halt", "quick_stop"):
        kernel, host = stepped(axis(), axis())
        host.move([80.0, -20.0])
        kernel.step(500)
        getattr(host, stop)()
        kernel.step()
        refused = host.move([0.0, 0.0])
        if stop == "quick_stop":
            kernel.step()
            assert refused.state is MoveState.REFUSED
            assert host.link.frame().result == lib.SJ_RESULT_STATE
            rows = run(kernel, host)
            kept(rows, STOP)
            lengths.append(len(rows))
        else:
            kernel.step()
            assert refused.state is MoveState.MOVING  # a halt may be replaced
            kernel, host = stepped(axis(), axis())
            host.move([80.0, -20.0])
            kernel.step(500)
            host.halt()
            lengths.append(len(run(kernel, host)))
    assert lengths[1] < 0.7 * lengths[0]


def test_a_quick_stop_is_synchronised_only_if_asked() -> None:
    """Together: at rest in the same cycle, the slowest as soon as before, within the limits."""
    last: dict[bool, list[int]] = {}
    for together in (False, True):
        kernel, host = stepped(axis(), axis())
        host.move([80.0, -20.0])
        kernel.step(500)
        host.quick_stop(together=together)
        last[together] = [0, 0]
        rows = [[a.position for a in host.feedback().axes]]
        for cycle in range(1, 2000):
            kernel.step()
            axes = host.feedback().axes
            rows.append([a.position for a in axes])
            for i, a in enumerate(axes):
                last[together][i] = cycle if a.moving else last[together][i]
        kept(np.array(rows), STOP)
    alone, both = last[False], last[True]
    assert alone[0] > alone[1] + 5
    assert both[0] == alone[0]
    assert abs(both[1] - both[0]) <= 1


def test_a_faulted_axis_is_left_to_its_drive_and_the_others_stop() -> None:
    """ErrorStop there, a planned halt here; reset brings it back, with no step of the command."""
    kernel, host = stepped(axis(), axis(), axis())
    move = host.move([60.0, 50.0, -40.0])
    kernel.step(300)
    drive = lib.sj_drive_inject
    drive(ffi.addressof(kernel.core.axis[1], "drive"), lib.SJ_FAULT_ENCODER, 1)
    rows = run(kernel, host)
    kept(rows[:, [0, 2]])
    assert states(host)[1] is AxisState.ERROR_STOP
    assert move.state is MoveState.STOPPED
    faults = [e for e in host.events()[0] if e.kind is EventKind.FAULT]
    assert [e.axis for e in faults] == [1]
    assert faults[0].code != 0
    refused = host.move({1: 0.0})
    kernel.step()
    assert refused.state is MoveState.REFUSED
    drive(ffi.addressof(kernel.core.axis[1], "drive"), lib.SJ_FAULT_ENCODER, 0)
    kernel.step(300)
    host.reset()
    kernel.step(20)
    assert states(host) == [AxisState.STANDSTILL] * 3
    at = host.feedback().axes[1]
    assert abs(at.position - at.actual_position) < 1e-3
    again = host.move([0.0, 0.0, 0.0])
    run(kernel, host)
    assert again.done


def test_a_following_error_stops_all_axes_and_waits_for_a_reset() -> None:
    """Beyond the axis' own window: quick stop, ErrorStop, event; goals only after a reset."""
    kernel, host = stepped(axis(following_error=0.02), axis())
    host.move([60.0, 60.0])
    run(kernel, host)
    assert EventKind.FOLLOWING in {e.kind for e in host.events()[0]}
    assert states(host)[0] is AxisState.ERROR_STOP
    refused = host.move({0: 1.0})
    kernel.step()
    assert refused.state is MoveState.REFUSED
    kernel.step(500)
    host.reset()
    kernel.step(3)
    assert states(host)[0] is AxisState.STANDSTILL


def test_homing_is_the_drives_and_shifts_the_frame_without_a_step() -> None:
    """Method 37 takes the place as zero: the command follows the frame, targets make no jump."""
    drive = DriveConfig(homing_method=37)
    kernel, host = stepped(Axis(LIMITS, COUNTS, drive))
    host.move(12.0)
    run(kernel, host)
    home = host.home()
    kernel.step()
    assert states(host) == [AxisState.HOMING]
    run(kernel, host)
    kernel.step(5)
    assert home.done
    assert states(host) == [AxisState.STANDSTILL]
    at = host.feedback().axes[0]
    assert abs(at.position) < 0.1
    assert abs(at.target_counts - at.actual_counts) < 0.1 * COUNTS
    move = host.move(3.0)
    kept(run(kernel, host))
    assert move.done


def test_limits_can_be_changed_and_are_refused_beyond_the_drive() -> None:
    """The next move keeps the new ones; what the drive cannot follow changes nothing."""
    kernel, host = stepped()
    gentle = Limits(10.0, 100.0, 1000.0)
    host.set_limits(gentle)
    kernel.step()
    host.move(4.0)
    kept(run(kernel, host), gentle)
    host.set_limits(Limits(1e7, 100.0, 1000.0))
    kernel.step()
    assert host.feedback().axes[0].limits.velocity == pytest.approx(10.0)
    told = [e.code for e in host.events()[0] if e.kind is EventKind.LIMITS]
    assert told == [lib.SJ_RESULT_ACCEPTED, lib.SJ_RESULT_SPEED]


def test_every_goal_has_an_answer() -> None:
    """Accepted, refused with its own reason, superseded before or after the kernel saw it."""
    kernel, host = stepped(axis((-20.0, 30.0)))
    unseen = host.move(1.0)
    refused = host.move(100.0, relative=True)
    kernel.step()
    first = host.move(2.0)
    kernel.step()
    second = host.move(3.0)
    kernel.step()
    assert unseen.state is MoveState.SUPERSEDED
    assert refused.state is MoveState.REFUSED
    assert first.state is MoveState.SUPERSEDED
    assert second.state is MoveState.MOVING
    with pytest.raises(RefusedError, match="position limits"):
        refused.check()
    with pytest.raises(SupersededError):
        first.check()
    second.cancel()
    run(kernel, host)
    assert second.state is MoveState.STOPPED


def test_a_move_can_be_awaited() -> None:
    """In an event loop, beside the task that steps."""
    kernel, host = stepped()

    async def steps() -> None:
        while True:
            kernel.step(20)
            await asyncio.sleep(0)

    async def main() -> None:
        task = asyncio.create_task(steps())
        await host.move(2.0)
        task.cancel()

    asyncio.run(main())
    assert host.feedback().axes[0].position == 2.0


def test_an_axis_that_turns_goes_the_way_it_is_told() -> None:
    """Shortest, positive and negative ways to a place within the turn."""
    kernel, host = stepped(axis(wrap=360.0, unit="deg"))
    host.move(350.0)
    run(kernel, host)
    for direction, place, position in (
        ("shortest", 10.0, 370.0),
        ("shortest", 350.0, 350.0),
        ("positive", 340.0, 700.0),
        ("negative", 350.0, 350.0),
    ):
        host.move(place, direction=direction)  # type: ignore[arg-type]
        run(kernel, host)
        assert host.feedback().axes[0].position == pytest.approx(position)
        assert host.feedback().axes[0].turned == pytest.approx(place)
    assert host.feedback().axes[0].unit == "deg"


def test_external_drives_are_exchanged_by_the_caller() -> None:
    """A drive in the caller's hands, by its process image: enabled, moved and disabled."""
    drive = DriveConfig(period_s=T)
    device = Drive(drive)
    kernel = MotionKernel([Axis(LIMITS, COUNTS, "external")], T)
    host = kernel.host()
    image = kernel.image
    host.enable()

    def step(cycles: int) -> None:
        for _ in range(cycles):
            kernel.step()
            out = image.outputs[0]
            tx = device.cycle(
                controlword=int(out["controlword"]),
                mode=int(out["mode"]),
                target_position=int(out["target_position"]),
            )
            image.inputs[0]["statusword"] = tx.statusword
            image.inputs[0]["mode_display"] = tx.mode_display
            image.inputs[0]["position_actual"] = tx.position_actual

    step(20)
    move = host.move(5.0)
    step(2000)
    assert move.done
    assert host.feedback().axes[0].actual_position == pytest.approx(5.0, abs=1e-3)
    host.disable()
    step(20)
    assert not host.feedback().axes[0].enabled


def test_reactions_are_as_set() -> None:
    """None lets the others go on after a fault; a wrong word is refused."""
    kernel, host = stepped(axis(), axis(), reactions=Reactions(drive_fault="none"))
    move = host.move([60.0, 50.0], synchronization="none")
    kernel.step(300)
    lib.sj_drive_inject(ffi.addressof(kernel.core.axis[1], "drive"), lib.SJ_FAULT_ENCODER, 1)
    run(kernel, host)
    assert host.feedback().axes[0].position == 60.0
    assert move.state is MoveState.STOPPED
    with pytest.raises(InputError, match="overrun"):
        Reactions(overrun="explode")  # type: ignore[arg-type]
