"""The simulated motor: laws of its loops."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sjerk._binding import ffi, lib
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


@st.composite
def machines(draw: Any) -> DriveConfig:
    """A drive whose motor may be weak, loaded, or held by a brake."""
    return DriveConfig.for_motor(
        draw(st.sampled_from(sorted(MOTORS))),
        period_s=draw(st.sampled_from([1e-3, 1e-3, 1e-3, 250e-6])),
        velocity_feedforward=draw(st.floats(0.0, 1.0)),
        acceleration_feedforward=draw(st.floats(0.0, 1.0)),
        load_torque_nm=draw(st.floats(-0.5, 0.5)),
        brake_torque_nm=draw(st.sampled_from([0.0, 1.0])),
        torque_limit_positive=draw(st.sampled_from([5000, 50, 0])),
        torque_limit_negative=draw(st.sampled_from([5000, 50, 0])),
        jump_option=draw(st.integers(0, 2)),
        following_window=2**32 - 1,
    )


WORDS = st.tuples(
    st.sampled_from([0xF, 0xF, 0xF, 0xF, 0x10F, 0x7, 0x2, 0x0]),
    st.sampled_from([8, 8, 8, 8, 9, 10, 6]),
    st.integers(-(2**17), 2**17) | st.integers(-(2**31), 2**31 - 1),  # per period; or wild
    st.integers(-1000, 1000),
    st.sampled_from([0, 0, 0, 1]),
)


@given(
    st.lists(machines(), min_size=1, max_size=10),
    st.lists(st.lists(WORDS, min_size=10, max_size=10), min_size=1, max_size=20),
)
def test_motors_side_by_side_are_motors_one_by_one(
    configs: list[DriveConfig], script: list[list[Any]]
) -> None:
    """Drives cycled together have, bit for bit, the states and words of drives cycled alone."""
    n = len(configs)
    raw = [config.to_c() for config in configs]
    alone, together = ffi.new("sj_drive[]", n), ffi.new("sj_drive[]", n)
    rx, told, tx = (ffi.new(f"sj_drive_{w}[]", n) for w in ("rx", "tx", "tx"))
    for i in range(n):
        assert lib.sj_drive_init(alone + i, raw[i]) == 0
        assert lib.sj_drive_init(together + i, raw[i]) == 0
    each = [
        ffi.new(f"{kind} *[]", [array + i for i in range(n)])
        for kind, array in (("sj_drive", together), ("sj_drive_rx", rx), ("sj_drive_tx", tx))
    ]

    def cycle() -> None:
        for i in range(n):
            lib.sj_drive_cycle(alone + i, rx + i, told + i)
        lib.sj_drive_cycles(*each, n)
        assert bytes(ffi.buffer(alone)) == bytes(ffi.buffer(together))
        assert bytes(ffi.buffer(told)) == bytes(ffi.buffer(tx))

    for word in (0x0, 0x6, 0x7, 0xF, 0xF):
        for i in range(n):
            rx[i].controlword, rx[i].mode = word, 8
        cycle()
    for words in script:
        for i in range(n):
            word, mode, step, torque, missed = words[i]
            rx[i].controlword, rx[i].mode, rx[i].sync_missed = word, mode, missed
            goal = told[i].position_demand + step
            rx[i].target_position = (goal + 2**31) % 2**32 - 2**31
            rx[i].target_velocity, rx[i].target_torque = 100 * step // 128 % 2**30, torque
            rx[i].torque_offset = torque
        for _ in range(3):
            cycle()
