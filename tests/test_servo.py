"""The simulated motor: laws of its loops."""

from __future__ import annotations

import math

import pytest

from sjerk.cia402 import MOTORS, Drive, DriveConfig

REV = 16777216


def run_to(drive: Drive, goal: int, seconds: float) -> int:
    """A smooth stream to the goal; the actual position one second after its last target."""
    feedback = drive.enable()
    start = feedback.position_actual
    n = round(seconds / drive.config.period_s)
    for k in range(1, n + 1):
        u = k / n
        blend = u**4 * (35 - 84 * u + 70 * u * u - 20 * u**3)
        feedback = drive.cycle(0xF, start + round(goal * blend))
    for _ in range(round(1 / drive.config.period_s)):
        feedback = drive.cycle(0xF, start + goal)
    return feedback.position_actual - start


@pytest.mark.parametrize("period", [250e-6, 300e-6, 1e-3, 4e-3])
@pytest.mark.parametrize("motor", MOTORS)
def test_the_motor_settles_within_ten_increments_in_a_second(motor: str, period: float) -> None:
    """160 degrees of one revolution: within 10 increments one second after the last target."""
    drive = Drive(DriveConfig.for_motor(motor, period_s=period))
    goal = round(REV * 160 / 360)
    assert abs(run_to(drive, goal, 2.2) - goal) <= 10


@pytest.mark.parametrize("feedforward", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("motor", MOTORS)
def test_steady_following_error_is_v_over_kp(motor: str, feedforward: float) -> None:
    """(1 - ff) v / Kp within 1e-4 of v / Kp at 1000 rpm."""
    drive = Drive(
        DriveConfig.for_motor(motor, velocity_feedforward=feedforward, following_window=2**32 - 1)
    )
    target = drive.enable().position_demand
    speed = 1000 / 60 * REV
    errors = []
    for k in range(1500):
        target += round(speed * 1e-3 * min(1.0, k / 100))
        feedback = drive.cycle(0xF, target)
        if k >= 1400:
            errors.append(feedback.following_error)
    law = speed / 40
    assert abs(sum(errors) / len(errors) - (1 - feedforward) * law) <= 1e-4 * law
    assert max(errors) - min(errors) <= 10


def test_the_inner_loop_runs_at_8_khz_or_the_next_multiple() -> None:
    """Whole steps in every period, never fewer than 8000 a second."""
    for period, steps in (
        (1e-3, 8),
        (250e-6, 2),
        (125e-6, 1),
        (300e-6, 3),
        (4e-3, 32),
        (62.5e-6, 1),
    ):
        assert Drive(DriveConfig(period_s=period)).inner_steps == steps
        assert steps / period >= 8000 * (1 - 1e-9)


def test_the_motor_obeys_newton() -> None:
    """Free of friction and in torque mode, speed is torque times time over inertia."""
    config = DriveConfig(friction_nm=0.0, viscous_nm_s=0.0)
    drive = Drive(config)
    drive.enable(mode=10)
    before = drive.cycle(0xF, mode=10, target_torque=200).velocity_actual
    start = math.nan
    for k in range(100):
        velocity = drive.cycle(0xF, mode=10, target_torque=200).velocity_actual
        if k == 49:
            start = velocity
    inertia = config.inertia_kg_m2 * 2
    gain = 0.2 * config.rated_torque_nm / inertia * 0.05 / (2 * math.pi) * REV
    assert before >= 0
    assert velocity - start == pytest.approx(gain, rel=1e-4)
