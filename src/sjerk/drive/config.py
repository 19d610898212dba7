"""Everything a drive is set to, in SI units and in objects of CiA 402; motors by name.

Never here: a drive that runs.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, fields, replace
from typing import Any

from sjerk._binding import ffi, lib
from sjerk.errors import InputError, SjerkError


class Jump(enum.IntEnum):
    """What a target further than the jump limit from the one before causes (2100h:1)."""

    FAULT = 0
    """The drive goes into the fault 8612h."""
    CLAMP = 1
    """The target is moved to the jump limit."""
    OFF = 2
    """Targets are not checked for jumps."""


class DriveConfigError(SjerkError, ValueError):
    """A field of `DriveConfig` is out of range: `field`, `value`, and `low` to `high` it may be.

    `reason` says it in words.
    """

    def __init__(self, field: str, value: float, low: float, high: float) -> None:
        """Name the field, the value and the limits."""
        inside = low <= value <= high
        self.reason = (
            "does not fit the other fields" if inside else f"is outside {low:.10g} .. {high:.10g}"
        )
        super().__init__(f"{field} = {value!r} {self.reason}")
        self.field, self.value, self.low, self.high = field, value, low, high


@dataclass(frozen=True, kw_only=True)
class Motor:
    """A motor set, in the units of its field names; `source` is where they come from.

    >>> round(MOTORS["SGM7J-04A"].friction_nm, 4)
    0.0381
    """

    name: str
    rated_torque_nm: float
    peak_torque_nm: float
    rated_current_a: float
    inertia_kg_m2: float
    max_speed_rpm: float = 6000.0
    source: str = ""

    @property
    def friction_nm(self) -> float:
        """Coulomb friction: assumed as 3 % of the rated torque, no data sheet gives it."""
        return 0.03 * self.rated_torque_nm


_SIGMA7J = "Yaskawa Sigma-7 SGM7J ratings table, manualshive sgmmv p55"
_SIGMA7A = "Yaskawa Sigma-7 SGM7A-15 to -70 ratings table, manualshive sgmmv p82"

MOTORS: dict[str, Motor] = {
    motor.name: motor
    for motor in (
        Motor(
            name="SGM7J-02A",
            rated_torque_nm=0.637,
            peak_torque_nm=2.23,
            rated_current_a=1.6,
            inertia_kg_m2=0.263e-4,
            source=_SIGMA7J,
        ),
        Motor(
            name="SGM7J-04A",
            rated_torque_nm=1.27,
            peak_torque_nm=4.46,
            rated_current_a=2.5,
            inertia_kg_m2=0.486e-4,
            source=_SIGMA7J,
        ),
        Motor(
            name="SGM7J-08A",
            rated_torque_nm=2.39,
            peak_torque_nm=8.36,
            rated_current_a=4.4,
            inertia_kg_m2=1.59e-4,
            source=_SIGMA7J,
        ),
        Motor(
            name="SGM7A-15A",
            rated_torque_nm=4.90,
            peak_torque_nm=14.7,
            rated_current_a=9.3,
            inertia_kg_m2=2.00e-4,
            source=_SIGMA7A,
        ),
        Motor(
            name="SGM7A-30A",
            rated_torque_nm=9.80,
            peak_torque_nm=29.4,
            rated_current_a=17.9,
            inertia_kg_m2=7.00e-4,
            source=_SIGMA7A,
        ),
    )
}
"""Motor sets with their sources. Of the currents only the SGM7J-04A's is from its source, the
others are from memory; they are shown (6075h) and drive nothing."""


@dataclass(frozen=True, kw_only=True)
class DriveConfig:
    """Everything a drive is set to; checked when it is made.

    SI units are in the names. The second half are objects of CiA 402 in their own type and unit
    (pu: position unit of 607Ah, one encoder increment unless 6091h and 6092h say otherwise).

    Raises `DriveConfigError` with the field and its range, and `InputError` for what is no number,
    or no integer where one is needed.

    >>> DriveConfig(period_s=0.0)
    Traceback (most recent call last):
    sjerk.drive.config.DriveConfigError: period_s = 0.0 is outside 2.5e-05 .. 0.1
    """

    period_s: float = 1e-3  # 60C2h
    inner_rate_hz: float = 8000.0
    position_gain_per_s: float = 40.0
    velocity_bandwidth_hz: float = 40.0
    velocity_integral_s: float = 0.02
    velocity_feedforward: float = 1.0
    acceleration_feedforward: float = 1.0
    torque_time_s: float = 4e-4
    velocity_filter_s: float = 2e-4
    rated_torque_nm: float = 1.27
    peak_torque_nm: float = 4.46
    rated_current_a: float = 2.5
    max_speed_rpm: float = 6000.0
    inertia_kg_m2: float = 0.486e-4
    load_inertia_ratio: float = 1.0
    friction_nm: float = 0.04
    friction_speed_rad_s: float = 0.5
    viscous_nm_s: float = 2e-5
    load_torque_nm: float = 0.0
    brake_torque_nm: float = 0.0
    stop_timeout_s: float = 0.25
    jump_factor: float = 1.1
    stream_acceleration_rev_s2: float = 0.0  # 2100h:4
    stream_jerk_rev_s3: float = 0.0  # 2100h:5
    profile_jerk_rev_s3: float = 10000.0  # 60A4h:1, 2100h:6
    switch_negative_rev: float = -1e9
    switch_positive_rev: float = 1e9
    switch_home_rev: float = 1e9
    switch_home_end_rev: float = 1e9
    probe_1_rev: float = 1e9
    probe_1_end_rev: float = 1e9
    probe_2_rev: float = 1e9
    probe_2_end_rev: float = 1e9
    hard_stop_negative_rev: float = -1e9
    hard_stop_positive_rev: float = 1e9

    encoder_increments: int = 16777216  # 608Fh:1
    encoder_revolutions: int = 1  # 608Fh:2
    gear_motor: int = 1  # 6091h:1
    gear_shaft: int = 1  # 6091h:2
    feed: int = 16777216  # 6092h:1
    feed_shaft: int = 1  # 6092h:2
    range_min: int = -(2**31)  # 607Bh:1
    range_max: int = 2**31 - 1  # 607Bh:2
    software_min: int = 0  # 607Dh:1
    software_max: int = 0  # 607Dh:2
    polarity: int = 0  # 607Eh
    following_window: int = 16777216  # 6065h
    following_time_ms: int = 0  # 6066h
    position_window: int = 10  # 6067h
    position_time_ms: int = 100  # 6068h
    velocity_window: int = 65535  # 606Dh
    velocity_time_ms: int = 0  # 606Eh
    velocity_threshold: int = 65535  # 606Fh
    threshold_time_ms: int = 0  # 6070h
    max_profile_velocity: int = 1677721600  # 607Fh
    profile_velocity: int = 167772160  # 6081h
    profile_acceleration: int = 1677721600  # 6083h
    profile_deceleration: int = 1677721600  # 6084h
    quick_stop_deceleration: int = 4194304000  # 6085h
    max_acceleration: int = 0xFFFFFFFF  # 60C5h
    max_deceleration: int = 0xFFFFFFFF  # 60C6h
    max_torque: int = 3500  # 6072h
    torque_slope: int = 10000  # 6087h
    torque_limit_positive: int = 3500  # 60E0h
    torque_limit_negative: int = 3500  # 60E1h
    quick_stop_option: int = 2  # 605Ah
    shutdown_option: int = 0  # 605Bh
    disable_option: int = 1  # 605Ch
    halt_option: int = 1  # 605Dh
    fault_option: int = 2  # 605Eh
    abort_option: int = 1  # 6007h
    jump_option: int = Jump.FAULT  # 2100h:1
    positioning_option: int = 0  # 60F2h
    sync_extrapolation: int = 3  # 2100h:3
    sync_error_limit: int = 12  # 10F1h:2
    software_from_home: int = 0  # 2100h:8
    home_offset: int = 0  # 607Ch
    homing_method: int = 37  # 6098h
    homing_speed_switch: int = 16777216  # 6099h:1
    homing_speed_zero: int = 1677721  # 6099h:2
    homing_acceleration: int = 167772160  # 609Ah
    hard_stop_torque: int = 300  # 2100h:9
    hard_stop_time_ms: int = 50  # 2100h:10

    def __post_init__(self) -> None:
        """Check every field against the ranges that C holds."""
        self.to_c()

    @classmethod
    def for_motor(cls, motor: str | Motor = "SGM7J-04A", **changes: Any) -> DriveConfig:
        """A config for a motor, by its name in `MOTORS` or an own one; `changes` are other fields.

        Raises `ValueError` for a name that is not there, and as the constructor does.

        >>> DriveConfig.for_motor("SGM7A-30A", load_inertia_ratio=3.0).rated_torque_nm
        9.8
        """
        if isinstance(motor, str):
            if motor not in MOTORS:
                raise ValueError(f"motor = {motor!r} is unknown, one of {', '.join(MOTORS)}")
            motor = MOTORS[motor]
        return cls(
            **{
                "rated_torque_nm": motor.rated_torque_nm,
                "peak_torque_nm": motor.peak_torque_nm,
                "rated_current_a": motor.rated_current_a,
                "inertia_kg_m2": motor.inertia_kg_m2,
                "max_speed_rpm": motor.max_speed_rpm,
                "friction_nm": motor.friction_nm,
                **changes,
            }
        )

    def changed(self, **changes: Any) -> DriveConfig:
        """A copy with other values, checked again.

        >>> DriveConfig().changed(quick_stop_option=6).quick_stop_option
        6
        """
        return replace(self, **changes)

    def to_c(self) -> Any:
        """For C calls: the config as an ``sj_drive_config *``; raises as the constructor does."""
        config = ffi.new("sj_drive_config *")
        for entry in fields(self):
            value = getattr(self, entry.name)
            wanted = int if isinstance(entry.default, int) else (int, float)
            if isinstance(value, bool) or not isinstance(value, wanted):
                kind = "an integer" if wanted is int else "a number"
                raise InputError(entry.name, value, f"must be {kind}")
            try:
                setattr(config, entry.name, value)
            except OverflowError:
                low, high = _limits(entry.name)
                raise DriveConfigError(entry.name, value, low, high) from None
        raise_for_config(lib.sj_drive_config_check(config), config)
        return config


def _field(number: int) -> tuple[str, float, float]:
    low, high = ffi.new("double *"), ffi.new("double *")
    name = ffi.string(lib.sj_drive_config_field(number, low, high)).decode()
    return name, low[0], high[0]


def _limits(field: str) -> tuple[float, float]:
    number = 1
    while True:
        name, low, high = _field(number)
        if name == field:
            return low, high
        number += 1


def raise_for_config(status: int, config: Any) -> None:
    """Raise the `DriveConfigError` of a status that is not 0, the number of a field of ``config``.

    >>> raise_for_config(0, None)
    """
    if status:
        name, low, high = _field(status)
        raise DriveConfigError(name, getattr(config, name), low, high)
