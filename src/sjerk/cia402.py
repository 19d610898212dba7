"""CiA 402 (IEC 61800-7-201) to be read: words, states, modes, transitions, and a simulated drive.

The first half is data: what each bit, state and transition is. The second half is `Drive`, the
C drive of ``_cia402.c`` and ``_servo.c`` in plain Python: one call of `Drive.cycle` is one SYNC
period. Tests hold the table below and the C against an oracle that knows neither.

Never here: planning, time, transport.
"""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

from sjerk._binding import ffi, lib
from sjerk.errors import InputError, SjerkError


class ControlWord(enum.IntFlag):
    """Controlword 6040h. `QUICK_STOP` = 0 stops. `FAULT_RESET` acts on its rising edge."""

    SWITCH_ON = 0x0001
    ENABLE_VOLTAGE = 0x0002
    QUICK_STOP = 0x0004
    ENABLE_OPERATION = 0x0008
    MODE_4 = 0x0010
    MODE_5 = 0x0020
    MODE_6 = 0x0040
    FAULT_RESET = 0x0080
    HALT = 0x0100


class StatusWord(enum.IntFlag):
    """Statusword 6041h. Bits 10, 12 and 13 belong to the mode; the names here are CSP's."""

    READY_TO_SWITCH_ON = 0x0001
    SWITCHED_ON = 0x0002
    OPERATION_ENABLED = 0x0004
    FAULT = 0x0008
    VOLTAGE_ENABLED = 0x0010
    QUICK_STOP = 0x0020
    SWITCH_ON_DISABLED = 0x0040
    WARNING = 0x0080
    SYNC = 0x0100
    REMOTE = 0x0200
    TARGET_REACHED = 0x0400
    INTERNAL_LIMIT = 0x0800
    FOLLOWS = 0x1000
    FOLLOWING_ERROR = 0x2000


class State(enum.Enum):
    """States of the drive; the value is (number in C, mask, pattern) of the statusword."""

    NOT_READY_TO_SWITCH_ON = (0, 0x4F, 0x00)
    SWITCH_ON_DISABLED = (1, 0x4F, 0x40)
    READY_TO_SWITCH_ON = (2, 0x6F, 0x21)
    SWITCHED_ON = (3, 0x6F, 0x23)
    OPERATION_ENABLED = (4, 0x6F, 0x27)
    QUICK_STOP_ACTIVE = (5, 0x6F, 0x07)
    FAULT_REACTION_ACTIVE = (6, 0x4F, 0x0F)
    FAULT = (7, 0x4F, 0x08)

    @property
    def number(self) -> int:
        """The state's number in C (``SJ_STATE_...``)."""
        return self.value[0]

    @classmethod
    def of(cls, statusword: int) -> State:
        """The state a statusword shows.

        >>> State.of(0x1237)
        <State.OPERATION_ENABLED: (4, 111, 39)>
        """
        for state in cls:
            _, mask, pattern = state.value
            if statusword & mask == pattern:
                return state
        raise ValueError(f"statusword = {statusword:#06x} shows no state of CiA 402")


class Mode(enum.IntEnum):
    """Modes of operation 6060h that the drive has."""

    NONE = 0
    PROFILE_POSITION = 1
    PROFILE_VELOCITY = 3
    HOMING = 6
    CSP = 8
    CSV = 9
    CST = 10


class Command(enum.Enum):
    """Commands of the controlword; the value is (mask, pattern) over bits 3 to 0."""

    DISABLE_VOLTAGE = (0b0010, 0b0000)
    QUICK_STOP = (0b0110, 0b0010)
    SHUTDOWN = (0b0111, 0b0110)
    SWITCH_ON = (0b1111, 0b0111)
    """Disable operation, when operation is enabled."""
    ENABLE_OPERATION = (0b1111, 0b1111)

    @classmethod
    def of(cls, controlword: int) -> Command:
        """The command a controlword gives.

        >>> Command.of(0x000F)
        <Command.ENABLE_OPERATION: (15, 15)>
        """
        return next(c for c in cls if controlword & c.value[0] == c.value[1])


class Transition(NamedTuple):
    """One row of the state machine: `number` from `source` to `target` when all of it holds."""

    number: int
    source: State | None
    target: State
    command: Command | None = None
    """Needed command; None: the transition does not look at the command."""
    when: str = ""
    """A condition of `CONDITIONS` that must hold too; "" none."""


class Situation(NamedTuple):
    """What the state machine decides upon beside its state."""

    controlword: int = 0
    previous: int = 0
    quick_stop_option: int = 2
    shutdown_option: int = 0
    disable_option: int = 1
    power: bool = True
    fault: bool = False
    cause: bool = False
    standing: bool = True


CONDITIONS: dict[str, Callable[[Situation], bool]] = {
    "": lambda s: True,
    "a fault": lambda s: s.fault,
    "power": lambda s: s.power,
    "standing": lambda s: s.standing,
    "605Bh = 0 or standing": lambda s: s.shutdown_option == 0 or s.standing,
    "605Ch = 0 or standing": lambda s: s.disable_option == 0 or s.standing,
    "605Ah = 0, or 1..4 and standing": lambda s: (
        s.quick_stop_option == 0 or (s.quick_stop_option < 5 and s.standing)
    ),
    "605Ah = 5..8": lambda s: s.quick_stop_option >= 5,
    "reset edge, cause gone": lambda s: bool(s.controlword & ~s.previous & 0x80) and not s.cause,
}

_S, _C = State, Command

TRANSITIONS: tuple[Transition, ...] = (
    Transition(0, None, _S.NOT_READY_TO_SWITCH_ON),
    Transition(13, _S.NOT_READY_TO_SWITCH_ON, _S.FAULT_REACTION_ACTIVE, when="a fault"),
    Transition(13, _S.SWITCH_ON_DISABLED, _S.FAULT_REACTION_ACTIVE, when="a fault"),
    Transition(13, _S.READY_TO_SWITCH_ON, _S.FAULT_REACTION_ACTIVE, when="a fault"),
    Transition(13, _S.SWITCHED_ON, _S.FAULT_REACTION_ACTIVE, when="a fault"),
    Transition(13, _S.OPERATION_ENABLED, _S.FAULT_REACTION_ACTIVE, when="a fault"),
    Transition(13, _S.QUICK_STOP_ACTIVE, _S.FAULT_REACTION_ACTIVE, when="a fault"),
    Transition(1, _S.NOT_READY_TO_SWITCH_ON, _S.SWITCH_ON_DISABLED),
    Transition(2, _S.SWITCH_ON_DISABLED, _S.READY_TO_SWITCH_ON, _C.SHUTDOWN, "power"),
    Transition(7, _S.READY_TO_SWITCH_ON, _S.SWITCH_ON_DISABLED, _C.DISABLE_VOLTAGE),
    Transition(7, _S.READY_TO_SWITCH_ON, _S.SWITCH_ON_DISABLED, _C.QUICK_STOP),
    Transition(3, _S.READY_TO_SWITCH_ON, _S.SWITCHED_ON, _C.SWITCH_ON),
    Transition(3, _S.READY_TO_SWITCH_ON, _S.SWITCHED_ON, _C.ENABLE_OPERATION),  # and 4 at once
    Transition(10, _S.SWITCHED_ON, _S.SWITCH_ON_DISABLED, _C.DISABLE_VOLTAGE),
    Transition(10, _S.SWITCHED_ON, _S.SWITCH_ON_DISABLED, _C.QUICK_STOP),
    Transition(6, _S.SWITCHED_ON, _S.READY_TO_SWITCH_ON, _C.SHUTDOWN),
    Transition(4, _S.SWITCHED_ON, _S.OPERATION_ENABLED, _C.ENABLE_OPERATION),
    Transition(9, _S.OPERATION_ENABLED, _S.SWITCH_ON_DISABLED, _C.DISABLE_VOLTAGE),
    Transition(11, _S.OPERATION_ENABLED, _S.QUICK_STOP_ACTIVE, _C.QUICK_STOP),
    Transition(
        8, _S.OPERATION_ENABLED, _S.READY_TO_SWITCH_ON, _C.SHUTDOWN, "605Bh = 0 or standing"
    ),
    Transition(5, _S.OPERATION_ENABLED, _S.SWITCHED_ON, _C.SWITCH_ON, "605Ch = 0 or standing"),
    Transition(12, _S.QUICK_STOP_ACTIVE, _S.SWITCH_ON_DISABLED, _C.DISABLE_VOLTAGE),
    Transition(
        12, _S.QUICK_STOP_ACTIVE, _S.SWITCH_ON_DISABLED, when="605Ah = 0, or 1..4 and standing"
    ),
    Transition(16, _S.QUICK_STOP_ACTIVE, _S.OPERATION_ENABLED, _C.ENABLE_OPERATION, "605Ah = 5..8"),
    Transition(14, _S.FAULT_REACTION_ACTIVE, _S.FAULT, when="standing"),
    Transition(15, _S.FAULT, _S.SWITCH_ON_DISABLED, when="reset edge, cause gone"),
)
"""The state machine, in the order of decision: the first row that fits is taken, one per period.

Only Enable operation in Ready to switch on runs two rows in one period, 3 and then 4.
Bit 7 counts by its rising edge in Fault and nowhere else: held, it blocks no command.
"""


def next_state(state: State, situation: Situation) -> tuple[State, tuple[int, ...]]:
    """The state one period later and the numbers of the transitions that ran, by the table.

    >>> next_state(State.SWITCH_ON_DISABLED, Situation(controlword=0x0006))[1]
    (2,)
    """
    command = Command.of(situation.controlword)
    for row in TRANSITIONS:
        if (
            row.source is state
            and row.command in (None, command)
            and CONDITIONS[row.when](situation)
        ):
            if row.number == 3 and command is Command.ENABLE_OPERATION:
                return State.OPERATION_ENABLED, (3, 4)
            return row.target, (row.number,)
    return state, ()


class Fault(enum.IntEnum):
    """Faults by name. Those up to `LOST_LINK` can be injected (`Drive.inject`)."""

    OVER_CURRENT = 1
    EARTH = 2
    OVER_VOLTAGE = 3
    UNDER_VOLTAGE = 4
    OVER_TEMPERATURE = 5
    ENCODER = 6
    SAFE_TORQUE_OFF = 7
    BRAKE = 8
    LOST_LINK = 9
    OVER_SPEED = 10
    FOLLOWING_ERROR = 11
    REFERENCE_LIMIT = 12
    SYNC = 13

    @property
    def code(self) -> int:
        """Error code 603Fh.

        >>> hex(Fault.FOLLOWING_ERROR.code)
        '0x8611'
        """
        return int(lib.sj_drive_fault_code(self.value))


class Jump(enum.IntEnum):
    """What a target further than the jump limit from the one before causes."""

    FAULT = 0
    CLAMP = 1
    OFF = 2


class Finding(enum.IntEnum):
    """What the verdict on the stream of targets names; a target gets one name at most."""

    JUMP = 0
    STALE = 1
    SKIPPED = 2
    STEP = 3
    ACCELERATION = 4
    VELOCITY = 5
    JERK = 6


class DriveConfigError(SjerkError, ValueError):
    """A field of `DriveConfig` is out of range: `field`, `value`, `low`, `high`."""

    def __init__(self, field: str, value: float, low: float, high: float) -> None:
        """Name the field, the value and the limits."""
        inside = low <= value <= high
        reason = (
            "does not fit the other fields" if inside else f"is outside {low:.10g} .. {high:.10g}"
        )
        super().__init__(f"{field} = {value!r} {reason}")
        self.field, self.value, self.low, self.high = field, value, low, high


@dataclass(frozen=True, kw_only=True)
class Motor:
    """A motor set, in the units of its field names.

    `friction_nm` is assumed as 3 % of the rated torque.
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
        """Coulomb friction: an assumption, no data sheet gives it."""
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
    """Everything a drive is set to; checked at construction, `DriveConfigError` names the field.

    What is no number, or no integer where one is needed, is an `InputError`.

    SI units are in the names. The second half are objects of CiA 402 in their own type and unit
    (pu: position unit of 607Ah, one encoder increment unless 6091h and 6092h say otherwise).

    >>> DriveConfig(period_s=0.0)
    Traceback (most recent call last):
    sjerk.cia402.DriveConfigError: period_s = 0.0 is outside 2.5e-05 .. 0.1
    """

    period_s: float = 1e-3
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
    stream_acceleration_rev_s2: float = 0.0
    stream_jerk_rev_s3: float = 0.0
    profile_jerk_rev_s3: float = 10000.0
    switch_negative_rev: float = -1e9
    switch_positive_rev: float = 1e9
    switch_home_rev: float = 1e9

    encoder_increments: int = 16777216
    encoder_revolutions: int = 1
    gear_motor: int = 1
    gear_shaft: int = 1
    feed: int = 16777216
    feed_shaft: int = 1
    range_min: int = -(2**31)
    range_max: int = 2**31 - 1
    software_min: int = 0
    software_max: int = 0
    polarity: int = 0
    following_window: int = 16777216
    following_time_ms: int = 0
    position_window: int = 10
    position_time_ms: int = 0
    velocity_window: int = 65535
    velocity_time_ms: int = 0
    velocity_threshold: int = 65535
    threshold_time_ms: int = 0
    max_profile_velocity: int = 1677721600
    profile_velocity: int = 167772160
    profile_acceleration: int = 1677721600
    profile_deceleration: int = 1677721600
    quick_stop_deceleration: int = 4194304000
    max_acceleration: int = 0xFFFFFFFF
    max_deceleration: int = 0xFFFFFFFF
    max_torque: int = 3500
    torque_limit_positive: int = 3500
    torque_limit_negative: int = 3500
    quick_stop_option: int = 2
    shutdown_option: int = 0
    disable_option: int = 1
    halt_option: int = 1
    fault_option: int = 2
    abort_option: int = 1
    jump_option: int = Jump.FAULT
    positioning_option: int = 0
    sync_extrapolation: int = 3
    sync_error_limit: int = 12
    home_offset: int = 0
    homing_method: int = 37
    homing_speed_switch: int = 16777216
    homing_speed_zero: int = 1677721
    homing_acceleration: int = 167772160

    def __post_init__(self) -> None:
        """Check every field against the ranges that C holds."""
        self.to_c()

    @classmethod
    def for_motor(cls, motor: str | Motor = "SGM7J-04A", **changes: Any) -> DriveConfig:
        """A config for a motor of `MOTORS` or an own one; `changes` are fields.

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
        """A copy with other values, checked again."""
        return replace(self, **changes)

    def to_c(self) -> Any:
        """The config as ``sj_drive_config *``; raises `DriveConfigError`, `InputError`."""
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
        _raise_for(lib.sj_drive_config_check(config), config)
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


def _raise_for(status: int, config: Any) -> None:
    if status:
        name, low, high = _field(status)
        raise DriveConfigError(name, getattr(config, name), low, high)


class Feedback(NamedTuple):
    """What one period gives back: the words of ``sj_drive_tx``, positions in pu."""

    statusword: StatusWord
    mode_display: int
    error_register: int
    position_actual: int
    velocity_actual: int
    torque_actual: int
    error_code: int
    following_error: int
    position_demand: int
    velocity_demand: int
    torque_demand: int
    current_actual: int
    position_internal: int
    demand_internal: int
    digital_inputs: int
    dc_link_mv: int

    @property
    def state(self) -> State:
        """The state the statusword shows."""
        return State.of(self.statusword)

    @property
    def follows(self) -> bool:
        """Whether the drive follows its target (bit 12 in CSP, CSV and CST)."""
        return bool(self.statusword & StatusWord.FOLLOWS)


@dataclass(frozen=True)
class Report:
    """The verdict on the targets a drive was given.

    Largest values are of the differences of the targets, the rounding to whole units subtracted
    (2^(n-1) / T^n units in an n-th difference), in revolutions of the motor per s, s^2, s^3.
    `findings` counts by name, `first` holds the cycle of the first of each.
    """

    samples: int
    missed_syncs: int
    velocity_rev_s: float
    acceleration_rev_s2: float
    jerk_rev_s3: float
    following_error: int
    findings: dict[Finding, int]
    first: dict[Finding, int]

    @property
    def clean(self) -> bool:
        """Whether nothing was found and no SYNC missed."""
        return not self.findings and not self.missed_syncs

    def __str__(self) -> str:
        """The report as lines to read."""
        lines = [
            f"{self.samples} targets: velocity {self.velocity_rev_s:.6g} rev/s, "
            f"acceleration {self.acceleration_rev_s2:.6g} rev/s^2, jerk {self.jerk_rev_s3:.6g} "
            f"rev/s^3, following error {self.following_error}"
        ]
        lines += [
            f"{kind.name.lower()}: {count}, first in cycle {self.first[kind]}"
            for kind, count in self.findings.items()
        ]
        if self.missed_syncs:
            lines.append(f"missed sync: {self.missed_syncs}")
        if self.clean:
            lines.append("no findings")
        return "\n".join(lines)


class Drive:
    """A simulated servo drive behind CiA 402's words, one SYNC period per call.

    >>> drive = Drive()
    >>> for word in (0x00, 0x06, 0x0F, 0x0F):
    ...     feedback = drive.cycle(word, 0)
    >>> feedback.state.name, feedback.follows
    ('OPERATION_ENABLED', True)
    """

    def __init__(self, config: DriveConfig | None = None) -> None:
        """A drive that has just been powered up, at position 0."""
        self._config = config or DriveConfig()
        self._c = ffi.new("sj_drive *")
        self._rx = ffi.new("sj_drive_rx *")
        self._tx = ffi.new("sj_drive_tx *")
        _raise_for(lib.sj_drive_init(self._c, self._config.to_c()), self._c.config)

    @property
    def config(self) -> DriveConfig:
        """The present config."""
        return self._config

    @property
    def state(self) -> State:
        """The present state, also before the first period."""
        return next(state for state in State if state.number == self._c.state)

    @property
    def cycles(self) -> int:
        """Periods since power-up."""
        return int(self._c.cycles)

    @property
    def jump_limit(self) -> int:
        """The longest way of a target in one period, in pu."""
        return int(self._c.scale.jump_limit)

    @property
    def inner_steps(self) -> int:
        """Servo steps in one period."""
        return int(self._c.constants.steps)

    @property
    def transitions(self) -> tuple[int, ...]:
        """Transitions that ran in the last period."""
        return tuple(n for n in range(17) if self._c.transitions >> n & 1)

    def configure(self, **changes: Any) -> None:
        """Change fields of the config between two periods; the motion goes on."""
        config = self._config.changed(**changes)
        _raise_for(lib.sj_drive_configure(self._c, config.to_c()), self._c.config)
        self._config = config

    def restart(self, config: DriveConfig | None = None) -> None:
        """Power off and on again: words and states are new, the axis stays where it is."""
        servo = ffi.new("sj_servo *", self._c.servo)
        self._config = config or self._config
        _raise_for(lib.sj_drive_init(self._c, self._config.to_c()), self._c.config)
        self._c.servo = servo[0]
        self._c.actual.increments = servo.encoder
        lib.sj_drive_rescale(self._c)

    def cycle(
        self,
        controlword: int,
        target_position: int = 0,
        *,
        mode: int = Mode.CSP,
        position_offset: int = 0,
        velocity_offset: int = 0,
        torque_offset: int = 0,
        target_velocity: int = 0,
        target_torque: int = 0,
        digital_outputs: int = 0,
        output_mask: int = 0,
        sync_missed: bool = False,
    ) -> Feedback:
        """One SYNC period: words in, inner loops, words out.

        Positions are pu and wrap as INT32; velocities pu/s; torques 0.1 % of the rated torque.
        `sync_missed`: nothing came in this period, the targets are not looked at.
        """
        rx = self._rx
        rx.controlword = controlword
        rx.mode = mode
        rx.sync_missed = sync_missed
        rx.target_position = (int(target_position) + 2**31) % 2**32 - 2**31
        rx.position_offset = position_offset
        rx.velocity_offset = velocity_offset
        rx.torque_offset = torque_offset
        rx.target_velocity = target_velocity
        rx.target_torque = target_torque
        rx.digital_outputs = digital_outputs
        rx.output_mask = output_mask
        lib.sj_drive_cycle_planned(self._c, rx, self._tx)
        tx = self._tx
        return Feedback(
            StatusWord(tx.statusword),
            tx.mode_display,
            tx.error_register,
            tx.position_actual,
            tx.velocity_actual,
            tx.torque_actual,
            tx.error_code,
            tx.following_error,
            tx.position_demand,
            tx.velocity_demand,
            tx.torque_demand,
            tx.current_actual,
            tx.position_internal,
            tx.demand_internal,
            tx.digital_inputs,
            tx.dc_link_mv,
        )

    def enable(self, *, mode: int = Mode.CSP) -> Feedback:
        """Walk to Operation enabled and two periods on, holding the position."""
        feedback = self.cycle(0x0000, mode=mode)
        for word in (0x0006, 0x0007, 0x000F, 0x000F):
            feedback = self.cycle(word, feedback.position_actual, mode=mode)
        return feedback

    def inject(self, fault: Fault, present: bool = True) -> None:
        """Make the cause of a fault appear or go; the drive reacts in the next period."""
        if fault > Fault.LOST_LINK:
            raise ValueError(f"fault = {fault.name} comes from the motion, it cannot be injected")
        lib.sj_drive_inject(self._c, fault, present)

    def report(self) -> Report:
        """The verdict on the targets since power-up or `clear_report`."""
        verdict = self._c.verdict
        kinds = [kind for kind in Finding if verdict.counts[kind]]
        return Report(
            samples=verdict.samples,
            missed_syncs=verdict.missed_syncs,
            velocity_rev_s=verdict.velocity_max_rev_s,
            acceleration_rev_s2=verdict.acceleration_max_rev_s2,
            jerk_rev_s3=verdict.jerk_max_rev_s3,
            following_error=verdict.following_max,
            findings={kind: verdict.counts[kind] for kind in kinds},
            first={kind: verdict.first[kind] for kind in kinds},
        )

    def clear_report(self) -> None:
        """Begin a new verdict."""
        lib.sj_verdict_clear(ffi.addressof(self._c, "verdict"))
