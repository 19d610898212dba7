"""The drive's state machine and CSP, period by period."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sjerk._binding import ffi, lib
from sjerk.cia402 import (
    MOTORS,
    Drive,
    DriveConfig,
    DriveConfigError,
    DriveFault,
    DriveState,
    Mode,
    StatusWord,
)


def walk(drive: Drive, *words: int, target: int = 0) -> list[DriveState]:
    return [drive.cycle(word, target).state for word in words]


def test_power_up_ends_in_switch_on_disabled() -> None:
    """Transitions 0 and 1 need no command."""
    drive = Drive()
    assert drive.state is DriveState.NOT_READY_TO_SWITCH_ON
    assert walk(drive, 0) == [DriveState.SWITCH_ON_DISABLED]


def test_a_master_walks_to_operation_enabled_step_by_step() -> None:
    """0006, 0007, 000F run transitions 2, 3, 4, each visible for a period."""
    drive = Drive()
    assert walk(drive, 0, 0x06, 0x07, 0x0F) == [
        DriveState.SWITCH_ON_DISABLED,
        DriveState.READY_TO_SWITCH_ON,
        DriveState.SWITCHED_ON,
        DriveState.OPERATION_ENABLED,
    ]


def test_transitions_3_and_4_run_in_one_word() -> None:
    """000F in Ready to switch on enables at once."""
    drive = Drive()
    walk(drive, 0, 0x06)
    assert walk(drive, 0x0F) == [DriveState.OPERATION_ENABLED]
    assert drive.transitions == (3, 4)


@pytest.mark.parametrize(
    ("words", "expected", "transition"),
    [
        ((0x06, 0x0F, 0x07), DriveState.SWITCHED_ON, 5),
        ((0x06, 0x07, 0x06), DriveState.READY_TO_SWITCH_ON, 6),
        ((0x06, 0x00), DriveState.SWITCH_ON_DISABLED, 7),
        ((0x06, 0x02), DriveState.SWITCH_ON_DISABLED, 7),
        ((0x06, 0x0F, 0x06), DriveState.READY_TO_SWITCH_ON, 8),
        ((0x06, 0x0F, 0x00), DriveState.SWITCH_ON_DISABLED, 9),
        ((0x06, 0x07, 0x00), DriveState.SWITCH_ON_DISABLED, 10),
        ((0x06, 0x07, 0x02), DriveState.SWITCH_ON_DISABLED, 10),
    ],
)
def test_ways_back(words: tuple[int, ...], expected: DriveState, transition: int) -> None:
    """Each way back to less power has its transition."""
    drive = Drive()
    assert walk(drive, 0, *words)[-1] is expected
    assert drive.transitions == (transition,)


@pytest.mark.parametrize(
    ("words", "statusword"),
    [
        ((0,), 0x0250),
        ((0, 6), 0x0231),
        ((0, 6, 7), 0x0233),
        ((0, 6, 0xF), 0x0237),
        ((0, 6, 0xF, 0xF), 0x1237),
    ],
)
def test_statusword_is_the_canonical_word(words: tuple[int, ...], statusword: int) -> None:
    """The canonical statusword of each state; bit 8 (SYNC), 10 (in position) apart."""
    drive = Drive()
    for word in words:
        feedback = drive.cycle(word)
    assert feedback.statusword & ~(StatusWord.SYNC | StatusWord.TARGET_REACHED) == statusword


def test_a_fault_is_reset_by_the_rising_edge_once_its_cause_is_gone() -> None:
    """13, 14, then 15 on an edge of bit 7 only, and not while the cause is there."""
    drive = Drive()
    drive.enable()
    drive.inject(DriveFault.OVER_VOLTAGE)
    assert walk(drive, 0x0F) == [DriveState.FAULT_REACTION_ACTIVE]
    assert drive.cycle(0x0F).error_code == 0x3210
    assert walk(drive, 0x8F, 0x8F) == [DriveState.FAULT, DriveState.FAULT]
    drive.inject(DriveFault.OVER_VOLTAGE, False)
    assert walk(drive, 0x8F, 0x0F) == [DriveState.FAULT, DriveState.FAULT]
    assert walk(drive, 0x8F) == [DriveState.SWITCH_ON_DISABLED]
    assert drive.cycle(0).error_code == 0


def test_enabling_takes_the_actual_position_as_demand() -> None:
    """Target 0 far from the axis is a refused jump, never a run to 0."""
    drive = Drive()
    feedback = drive.enable()
    for target in range(0, 400_000_000, 400_000):
        feedback = drive.cycle(0xF, target)
    for _ in range(300):
        feedback = drive.cycle(0xF, target)
    drive.cycle(0)
    walk(drive, 6, 7, target=0)
    assert drive.cycle(0xF, 0).statusword & StatusWord.FOLLOWS == 0
    feedback = drive.cycle(0xF, 0)
    assert feedback.error_code == DriveFault.REFERENCE_LIMIT.code
    assert abs(feedback.position_actual - target) < 2000


@settings(deadline=None, derandomize=True)
@given(start=st.integers(-(2**31), 2**31 - 1), rate=st.integers(-400_000, 400_000))
def test_targets_wrap_as_int32(start: int, rate: int) -> None:
    """A steady stream across the end of INT32 is followed like any other."""
    drive = Drive(DriveConfig(range_min=-(2**31), range_max=2**31 - 1))
    drive.enable()
    point = ffi.addressof(drive.c_drive, "actual")
    point.units = start  # a drive that has been turning for long
    drive.cycle(0)
    feedback = drive.enable()
    target = feedback.position_actual
    for k in range(60):
        target += round(rate * min(k, 20) / 20)
        feedback = drive.cycle(0xF, target)
    assert feedback.follows
    assert feedback.position_demand == (target + 2**31) % 2**32 - 2**31
    assert abs(feedback.following_error) < 400_000


def test_the_jump_limit_is_sharp() -> None:
    """A target at the limit is followed, one increment more is a fault 8612h."""
    for way, faulted in ((0, False), (1, True)):
        drive = Drive(DriveConfig(following_window=0xFFFFFFFF))
        feedback = drive.enable()
        feedback = drive.cycle(0xF, feedback.position_demand + drive.jump_limit + way)
        assert (feedback.error_code == 0x8612) is faulted
        assert feedback.follows is not faulted


def test_a_bad_field_is_named_with_value_and_limits() -> None:
    """Every field of the config has a range that C and Python agree upon."""
    names = list(DriveConfig.__dataclass_fields__)
    for number, name in enumerate(names, 1):
        low, high = ffi.new("double *"), ffi.new("double *")
        assert ffi.string(lib.sj_drive_config_field(number, low, high)).decode() == name
        kind = type(DriveConfig.__dataclass_fields__[name].default)
        bad = high[0] * 2 + 1
        if kind is not float:
            bad = int(bad)
        with pytest.raises(DriveConfigError) as caught:
            DriveConfig(**{name: bad})
        assert caught.value.field == name
        assert name in str(caught.value)
    assert lib.sj_drive_config_field(len(names) + 1, low, high) == ffi.NULL


@pytest.mark.parametrize("motor", MOTORS)
def test_a_config_reaches_the_c_as_it_is(motor: str) -> None:
    """Each field has the value that it was given, and the C accepts the whole."""
    config = DriveConfig.for_motor(motor, home_offset=-7, polarity=224, following_window=2**32 - 1)
    raw = config.to_c()
    for name, value in vars(config).items():
        assert getattr(raw, name) == value, name
    assert lib.sj_drive_config_check(raw) == 0


def test_a_mode_without_a_loop_is_not_displayed() -> None:
    """6061 stays when 6060 names a mode the drive does not have."""
    drive = Drive()
    drive.enable()
    assert drive.cycle(0xF, 0, mode=5).mode_display == Mode.CSP
