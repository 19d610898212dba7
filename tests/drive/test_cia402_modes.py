"""CSV, CST, homing, and modes changed while running."""

from __future__ import annotations

import pytest

from helpers.homing import ATTAINED, ERROR, REACHED, home
from sjerk.cia402 import Drive, DriveConfig, DriveFeedback, DriveState, Mode, StatusWord

REV = 16777216


@pytest.mark.parametrize("method", [0, 17, 18, 33, 34, 35, 37])
def test_homing_ends_attained_and_standing(method: int) -> None:
    """Bits 13 12 10 go 000, then 011; a method's home is where it should be."""
    drive = Drive(
        DriveConfig(
            homing_method=method,
            home_offset=1000,
            switch_negative_rev=-0.7,
            switch_positive_rev=1.6,
        )
    )
    seen = home(drive)
    assert not seen[0].statusword & (ATTAINED | REACHED | ERROR)  # in the period that starts
    assert seen[-1].statusword & (ATTAINED | REACHED | ERROR) == ATTAINED | REACHED
    home_at = seen[-1].position_internal - (seen[-1].position_actual - 1000)
    expected = {0: 1000, 17: -0.7 * REV, 18: 1.6 * REV, 33: 0, 34: REV, 35: 0, 37: 0}[method]
    # a switch is seen once in a period, at a tenth of a revolution per second
    assert home_at == pytest.approx(expected, abs=2000 if method in (17, 18) else 5)
    for _ in range(3):
        assert drive.cycle(0xF, mode=Mode.HOMING).statusword & ATTAINED


def test_homing_onto_a_missing_switch_is_an_error() -> None:
    """Bit 13, and 10 when it stands; the next start clears it."""
    drive = Drive(DriveConfig(homing_method=17))
    assert home(drive)[-1].statusword & (ATTAINED | ERROR) == ERROR
    drive.configure(homing_method=37)
    drive.cycle(0xF, mode=Mode.HOMING)
    assert not drive.cycle(0x1F, mode=Mode.HOMING).statusword & ERROR


def test_homing_for_the_index_stops_at_a_limit_switch() -> None:
    """Methods 33 and 34 know no way back from a limit switch."""
    drive = Drive(DriveConfig(homing_method=34, switch_positive_rev=0.3))
    assert home(drive)[-1].statusword & (ATTAINED | ERROR) == ERROR


def test_taking_bit_4_away_interrupts_homing() -> None:
    """Bits 001: neither attained nor an error."""
    drive = Drive(DriveConfig(homing_method=34))
    drive.enable(mode=Mode.HOMING)
    for _ in range(500):
        word = drive.cycle(0x1F, mode=Mode.HOMING).statusword
        assert not word & (ATTAINED | REACHED | ERROR)
    for _ in range(500):
        feedback = drive.cycle(0xF, mode=Mode.HOMING)
    assert feedback.statusword & (ATTAINED | REACHED | ERROR) == REACHED
    assert feedback.velocity_demand == 0


def test_homed_is_told_whenever_mode_6_is_shown() -> None:
    """Also without bit 4, after other modes, and not enabled."""
    drive = Drive()
    assert not drive.cycle(0, mode=Mode.HOMING).statusword & ATTAINED
    home(drive)
    drive.cycle(0, mode=Mode.CSP)
    assert drive.cycle(0, mode=Mode.HOMING).statusword & ATTAINED
    drive.configure(feed=36000)
    assert not drive.cycle(0, mode=Mode.HOMING).statusword & ATTAINED


def test_csv_follows_a_velocity() -> None:
    """60FFh + 60B1h is the velocity of the axis; beyond the limit it is held, bit 11."""
    drive = Drive()
    drive.enable(mode=Mode.CSV)
    for k in range(400):
        target = round(min(k / 200, 1.0) * 10 * REV)
        feedback = drive.cycle(0xF, mode=Mode.CSV, target_velocity=target, velocity_offset=REV)
    assert feedback.follows
    assert feedback.velocity_actual == pytest.approx(11 * REV, rel=1e-3)
    feedback = drive.cycle(0xF, mode=Mode.CSV, target_velocity=2**31 - 1)
    assert feedback.statusword & StatusWord.INTERNAL_LIMIT
    assert not feedback.follows


def test_cst_follows_a_torque_up_to_the_speed_limit() -> None:
    """6071h + 60B2h is the torque; at the speed limit the motor is not driven further."""
    drive = Drive()
    drive.enable(mode=Mode.CST)
    for _ in range(20):
        feedback = drive.cycle(0xF, mode=Mode.CST, target_torque=300, torque_offset=100)
    assert feedback.torque_actual == pytest.approx(400, abs=2)
    for _ in range(3000):
        feedback = drive.cycle(0xF, mode=Mode.CST, target_torque=400)
    assert feedback.error_code == 0
    assert feedback.velocity_actual == pytest.approx(100 * REV, rel=0.01)
    assert feedback.statusword & StatusWord.INTERNAL_LIMIT


def test_a_limit_switch_stops_csv_and_cst() -> None:
    """No way on past the switch, the way back open."""
    for mode, on, back in (
        (Mode.CSV, {"target_velocity": 5 * REV}, {"target_velocity": -REV}),
        (Mode.CST, {"target_torque": 50}, {"target_torque": -50}),
    ):
        drive = Drive(DriveConfig(switch_positive_rev=2.0))
        drive.enable(mode=mode)
        for _ in range(3000):
            feedback = drive.cycle(0xF, mode=mode, **on)
        assert feedback.digital_inputs == 2
        assert abs(feedback.velocity_actual) < REV // 100
        assert feedback.statusword & StatusWord.INTERNAL_LIMIT
        for _ in range(3000):
            feedback = drive.cycle(0xF, mode=mode, **back)
        assert feedback.digital_inputs == 0


@pytest.mark.parametrize("first", [Mode.CSP, Mode.CSV, Mode.CST])
@pytest.mark.parametrize("second", [Mode.CSP, Mode.CSV, Mode.CST])
def test_modes_change_while_running_without_a_bump(first: Mode, second: Mode) -> None:
    """At 5 revolutions per second: velocity and torque go on, CSP after CST works."""
    drive = Drive()
    drive.enable(mode=Mode.CSP)
    target = 0.0

    def step(mode: Mode, speed: float, position: int | None = None) -> DriveFeedback:
        nonlocal target
        target += speed * REV * 1e-3
        return drive.cycle(
            0xF,
            round(target) if position is None else position,
            mode=mode,
            target_velocity=round(speed * REV),
            target_torque=31,  # about the friction at this speed
        )

    for k in range(500):
        step(Mode.CSP, 5 * min(1.0, k / 300))
    feedback = drive.cycle(0xF, round(target), mode=first)
    for _ in range(100):
        if not feedback.follows:
            target = feedback.position_actual
        feedback = step(first, 5.0)
    before = feedback
    torques, velocities = [], []
    for _ in range(40):
        if not feedback.follows:
            target = feedback.position_actual
        feedback = step(second, 5.0)
        assert feedback.mode_display == second
        torques.append(feedback.torque_actual)
        velocities.append(feedback.velocity_actual)
    assert feedback.state is DriveState.OPERATION_ENABLED
    assert feedback.error_code == 0
    assert max(abs(t - before.torque_actual) for t in torques) < 150
    assert max(abs(v - before.velocity_actual) for v in velocities) < 0.2 * 5 * REV
