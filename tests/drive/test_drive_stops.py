"""A stop that has begun ends at its own end; at a closed switch the axis stands, away is free."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sjerk.cia402 import Drive, DriveConfig, DriveFeedback, DriveState, Mode, StatusWord
from sjerk.drive import Device

REV = 16777216
FOLLOWS, LIMIT = StatusWord.FOLLOWS, StatusWord.INTERNAL_LIMIT
REACHED = StatusWord.TARGET_REACHED
SPEED = 10.0  # revolutions per second


def running(config: DriveConfig, mode: Mode = Mode.CSP) -> tuple[Drive, DriveFeedback, float]:
    """A drive that follows a stream at SPEED in CSP or CSV, its feedback, its last target."""
    drive = Drive(config)
    feedback = drive.enable(mode=mode)
    target = float(feedback.position_demand)
    for k in range(200):
        speed = SPEED * (k + 1) / 200
        target += speed * REV * 1e-3
        feedback = drive.cycle(0xF, round(target), mode=mode, target_velocity=round(speed * REV))
    assert feedback.follows
    return drive, feedback, target


#: What a master sends while a stop runs, by the last feedback and the targets before.
TARGETS: dict[str, Callable[[DriveFeedback, float, int], int]] = {
    "goes on": lambda f, last, k: round(last + SPEED * REV * 1e-3 * (k + 1)),
    "stands": lambda f, last, k: round(last),
    "6064h": lambda f, last, k: f.position_actual,
    "6062h": lambda f, last, k: f.position_demand,
    "turns back": lambda f, last, k: round(last - SPEED * REV * 1e-3 * (k + 1)),
}


def check_ramp(speeds: list[float], rate: float) -> None:
    """The demand slows down by `rate` (rev/s^2) per second, all the way to zero."""
    end = next(k for k, v in enumerate(speeds) if v == 0)
    for a, b in pairwise(speeds[: end + 1]):
        assert a - b <= rate * 1e-3 * 1.001 + 1e-4
    assert end == pytest.approx(speeds[0] / rate * 1e3, abs=2)


@pytest.mark.parametrize("then", TARGETS)
@pytest.mark.parametrize(("option", "rate"), [(1, 100.0), (2, 250.0), (5, 100.0), (6, 250.0)])
def test_the_ramp_at_a_limit_switch_ends_at_its_own_end(
    then: str, option: int, rate: float
) -> None:
    """605Ah at a switch in CSP: whatever targets come meanwhile, bit 12 = 0 and bit 11 = 1."""
    drive, feedback, last = running(DriveConfig(switch_positive_rev=1.05, quick_stop_option=option))
    while feedback.digital_inputs == 0:
        last += SPEED * REV * 1e-3
        feedback = drive.cycle(0xF, round(last))
    speeds = [feedback.velocity_demand / REV]
    for k in range(300):
        feedback = drive.cycle(0xF, TARGETS[then](feedback, last, k))
        speeds.append(feedback.velocity_demand / REV)
        assert feedback.statusword & LIMIT
        assert not feedback.follows or speeds[-1] == 0 or then == "turns back"
        if feedback.velocity_demand == 0:
            break
    check_ramp(speeds, rate)


def test_a_master_that_anchors_at_the_actual_position_gets_bit_12_back() -> None:
    """As a kernel does at a switch: 6064h as the target until bit 12 is there, then away."""
    drive, feedback, _ = running(DriveConfig(switch_positive_rev=1.05))
    for _ in range(2000):
        step = round(SPEED * REV * 1e-3) if feedback.digital_inputs == 0 else 0
        feedback = drive.cycle(0xF, feedback.position_demand + step)
    for _ in range(300):
        feedback = drive.cycle(0xF, feedback.position_actual)
        if feedback.follows:
            break
    assert feedback.follows
    assert feedback.statusword & LIMIT
    target = feedback.position_demand
    for k in range(1000):
        target -= round(REV * 1e-3 * min(1.0, k / 100))
        feedback = drive.cycle(0xF, target)
        assert feedback.follows
    assert feedback.digital_inputs == 0
    assert not feedback.statusword & LIMIT
    assert feedback.error_code == 0


ORDERS = {
    "halt": (0x10F, {"halt_option": 1}),
    "halt by 6085h": (0x10F, {"halt_option": 2}),
    "disable operation": (0x07, {"disable_option": 1}),
    "shutdown": (0x06, {"shutdown_option": 1}),
    "quick stop": (0x02, {"quick_stop_option": 5}),
    "quick stop by 6085h": (0x02, {"quick_stop_option": 6}),
}


@pytest.mark.parametrize("mode", [Mode.CSP, Mode.CSV])
@pytest.mark.parametrize("then", ["goes on", "stands", "6064h", "6062h"])
@pytest.mark.parametrize("order", ORDERS)
def test_an_order_to_stop_taken_back_in_mid_ramp_does_not_drop_the_ramp(
    order: str, then: str, mode: Mode
) -> None:
    """Halt, 605Ah 5 and 6, 605Bh, 605Ch: enabled again after 10 ms, the ramp goes to its end."""
    word, changes = ORDERS[order]
    drive, feedback, last = running(DriveConfig(**changes), mode)  # type: ignore[arg-type]
    rate = 250.0 if order.endswith("6085h") else 100.0
    speeds = [feedback.velocity_demand / REV]
    for k in range(300):
        velocity = {"goes on": round(SPEED * REV)}.get(then, 0)
        feedback = drive.cycle(
            word if k < 10 else 0xF,
            TARGETS[then](feedback, last, k),
            mode=mode,
            target_velocity=velocity,
        )
        speeds.append(feedback.velocity_demand / REV)
        if feedback.velocity_demand == 0:
            break
        assert not feedback.follows
    check_ramp(speeds, rate)
    assert feedback.error_code == 0


@pytest.mark.parametrize("then", ["stands", "6064h", "6062h"])
def test_the_ramp_after_too_many_missed_syncs_ends_though_they_come_back(then: str) -> None:
    """2100h:3 bridged, then 6085h; SYNC returns in mid-ramp with a target that stands."""
    drive, feedback, last = running(DriveConfig(sync_error_limit=0xFFFF))
    for _ in range(3):
        feedback = drive.cycle(0xF, 0, sync_missed=True)
        assert feedback.follows  # bridged
    speeds = [feedback.velocity_demand / REV]
    for k in range(200):
        feedback = drive.cycle(0xF, TARGETS[then](feedback, last, k), sync_missed=k < 10)
        speeds.append(feedback.velocity_demand / REV)
        if feedback.velocity_demand == 0:
            break
        assert not feedback.follows
    check_ramp(speeds, 250.0)


def test_disable_operation_taken_back_in_a_profile_does_not_jump() -> None:
    """605Ch in the middle of a move of mode 1: planned anew, on to the same set-point."""
    config = DriveConfig(
        profile_velocity=10 * REV,
        profile_acceleration=100 * REV,
        profile_deceleration=100 * REV,
    )
    drive = Drive(config)
    drive.enable(mode=Mode.PROFILE_POSITION)
    drive.cycle(0x1F, 8 * REV, mode=Mode.PROFILE_POSITION)
    demands = []
    for k in range(3000):
        word = 0x07 if 300 <= k < 330 else 0xF
        feedback = drive.cycle(word, mode=Mode.PROFILE_POSITION)
        demands.append(feedback.demand_internal)
    assert demands[-1] == 8 * REV
    steps = [b - a for a, b in pairwise(demands)]
    assert max(abs(b - a) for a, b in pairwise(steps)) <= 100 * REV * 1e-6 + 2


@pytest.mark.parametrize("ends", ["switch", "607Dh"])
@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("mode", [Mode.PROFILE_VELOCITY, Mode.CSV, Mode.CST])
def test_against_an_end_the_axis_stands_and_away_is_free(mode: Mode, side: int, ends: str) -> None:
    """Stops along the ramp of 605Ah, holds to the increment, bit 11 = 1; the other way goes."""
    at = round(1.5 * REV)
    limits = (
        {"switch_positive_rev": 1.5, "switch_negative_rev": -1.5}
        if ends == "switch"
        else {"software_min": -at, "software_max": at}
    )
    drive = Drive(DriveConfig(load_torque_nm=0.1, **limits))  # type: ignore[arg-type]
    drive.enable(mode=mode)

    def step(direction: int) -> DriveFeedback:
        return drive.cycle(
            0xF,
            mode=mode,
            target_velocity=side * direction * 3 * REV,
            target_torque=side * direction * 300,
        )

    speeds = []
    for _ in range(4000):
        feedback = step(1)
        speeds.append(feedback.velocity_demand / REV * side)
    assert feedback.state is DriveState.OPERATION_ENABLED
    assert feedback.statusword & LIMIT
    furthest = at + (max(speeds) ** 2 / (2 * 250) + 0.2) * REV
    assert at <= side * feedback.position_actual <= furthest
    after = speeds[speeds.index(max(speeds)) :]
    assert all(a - b <= 0.2501 for a, b in pairwise(after))
    stood = feedback.position_demand
    for _ in range(5000):
        feedback = step(1)
        assert feedback.position_demand == stood
        assert feedback.statusword & LIMIT
        assert not feedback.statusword & FOLLOWS or mode is Mode.PROFILE_VELOCITY
    assert abs(feedback.position_actual - stood) <= 3
    for _ in range(3000):
        feedback = step(-1)
        if side * feedback.position_actual < at:
            break
    assert side * feedback.position_actual < at
    assert not feedback.statusword & LIMIT


@pytest.mark.parametrize("mode", [m for m in Mode if m is not Mode.HOMING])
def test_bit_11_is_set_on_a_closed_switch_in_every_mode(mode: Mode) -> None:
    """Whatever is commanded there, rest too."""
    drive = Drive(DriveConfig(switch_positive_rev=0.0))
    feedback = drive.enable(mode=mode)
    for _ in range(100):
        feedback = drive.cycle(0xF, feedback.position_actual, mode=mode)
        assert feedback.digital_inputs == 2
        assert feedback.statusword & LIMIT


def test_a_set_point_onto_a_closed_switch_moves_nothing() -> None:
    """Mode 1: taken, given up; one away from it is gone to."""
    drive = Drive(DriveConfig(switch_positive_rev=0.0))
    drive.enable(mode=Mode.PROFILE_POSITION)
    for target in (REV, 5 * REV):
        assert drive.cycle(0x1F, target, mode=Mode.PROFILE_POSITION).statusword & FOLLOWS
        for _ in range(500):
            feedback = drive.cycle(0xF, mode=Mode.PROFILE_POSITION)
            assert feedback.position_demand == 0
            assert not feedback.statusword & REACHED
    drive.cycle(0x1F, -REV, mode=Mode.PROFILE_POSITION)
    for _ in range(2000):
        feedback = drive.cycle(0xF, mode=Mode.PROFILE_POSITION)
    assert feedback.position_demand == -REV
    assert feedback.statusword & REACHED


def test_a_set_point_away_given_in_the_ramp_at_a_switch_begins_at_its_end() -> None:
    """Mode 1: the ramp of 605Ah first, to its end, then the way back."""
    config = DriveConfig(profile_velocity=10 * REV, switch_positive_rev=2.0)
    drive = Drive(config)
    drive.enable(mode=Mode.PROFILE_POSITION)
    feedback = drive.cycle(0x1F, 20 * REV, mode=Mode.PROFILE_POSITION)
    while feedback.digital_inputs == 0:
        feedback = drive.cycle(0xF, mode=Mode.PROFILE_POSITION)
    speeds = [feedback.velocity_demand / REV]
    for k in range(2000):
        feedback = drive.cycle(0x3F if k == 3 else 0xF, 0, mode=Mode.PROFILE_POSITION)
        speeds.append(feedback.velocity_demand / REV)
    check_ramp(speeds, 250.0)
    assert feedback.position_demand == 0
    assert feedback.statusword & REACHED


def test_a_torque_of_zero_lets_no_axis_coast_through_a_switch() -> None:
    """CST: it moves onto the switch by its own inertia, and is stopped."""
    drive = Drive(DriveConfig(switch_positive_rev=2.0))
    drive.enable(mode=Mode.CST)
    torque = 300
    for _ in range(4000):
        feedback = drive.cycle(0xF, mode=Mode.CST, target_torque=torque)
        if feedback.velocity_actual > 20 * REV:
            torque = 0
    assert feedback.digital_inputs == 2
    assert 2 * REV < feedback.position_actual < 3.1 * REV
    assert feedback.velocity_demand == 0


@pytest.mark.parametrize("option", [5, 6, 7, 8])
@pytest.mark.parametrize("mode", [Mode.PROFILE_POSITION, Mode.PROFILE_VELOCITY, Mode.CSP, Mode.CSV])
def test_bit_10_tells_the_end_of_a_quick_stop_that_stays(option: int, mode: Mode) -> None:
    """605Ah 5..8: 0 while the axis slows down, 1 when it stands in Quick stop active."""
    drive, feedback, _ = running(DriveConfig(quick_stop_option=option), Mode.CSV)
    feedback = drive.cycle(0x02, mode=mode)
    moving = 0
    for _ in range(400):
        feedback = drive.cycle(0x02, mode=mode)
        assert feedback.state is DriveState.QUICK_STOP_ACTIVE
        if feedback.velocity_demand != 0:
            moving += 1
            assert not feedback.statusword & REACHED
    assert moving > 10 or option > 6
    assert feedback.statusword & REACHED


@settings(max_examples=60)
@given(
    limits=st.tuples(st.integers(-100, 100), st.integers(-100, 100)),
    order=st.permutations([1, 2]),
)
def test_the_software_limits_are_written_in_any_order(
    limits: tuple[int, int], order: list[int]
) -> None:
    """607Dh: every pair can be written sub by sub; without min < max there is no limit."""
    device = Device(Drive(DriveConfig(software_min=-5, software_max=5)))
    for sub in order:
        device.write(0x607D, sub, limits[sub - 1] * REV)
    assert [device.read(0x607D, sub) for sub in (1, 2)] == [limit * REV for limit in limits]
    low, high = limits
    drive = device.drive
    drive.enable(mode=Mode.PROFILE_POSITION)
    feedback = drive.cycle(0x1F, 120 * REV, mode=Mode.PROFILE_POSITION)
    bound = low < high
    assert bool(feedback.statusword & LIMIT) is bound
