"""A simulated servo drive behind the words of CiA 402: one call is one SYNC period.

The C of this room (``_drive.c`` and what it calls) for Python, explained in
``docs/explanation/drive.md``. Never here: planning, time, transport.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Any, NamedTuple

from sjerk._binding import ffi, lib
from sjerk.drive.config import DriveConfig, raise_for_config
from sjerk.drive.words import DriveFault, DriveState, Mode, StatusWord


class Finding(enum.IntEnum):
    """What the verdict on the stream of targets names (2101h); a target gets one name at most."""

    JUMP = 0
    """The target was further than the jump limit from the one before."""
    STALE = 1
    """The target was the one before again, while the axis was moving."""
    SKIPPED = 2
    """The target continued the motion of two periods in one: one target was lost."""
    STEP = 3
    """The velocity changed in one period by more than its limits allow."""
    ACCELERATION = 4
    """The acceleration was beyond its limit."""
    VELOCITY = 5
    """The velocity was beyond its limit."""
    JERK = 6
    """The jerk was beyond its limit."""
    PERIOD = 7
    """SYNC does not come in the period of 60C2h: the targets are interpolated over a wrong time."""


class DriveFeedback(NamedTuple):
    """What one period gives back: the words of ``sj_drive_tx``.

    Positions in pu, velocities in pu/s, torques in 0.1 % of the rated torque, currents in 0.1 % of
    the rated current; ``position_internal`` and ``demand_internal`` in encoder increments. What
    touch probes have latched is 60BAh to 60BDh; ``probe_status`` (60B9h) says which of them counts.

    >>> Drive().enable().state.name
    'OPERATION_ENABLED'
    """

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
    probe_1_positive: int
    probe_1_negative: int
    probe_2_positive: int
    probe_2_negative: int
    probe_status: int

    @property
    def state(self) -> DriveState:
        """The state that the statusword shows."""
        return DriveState.of(self.statusword)

    @property
    def follows(self) -> bool:
        """Whether the drive follows its target (bit 12 in CSP, CSV and CST)."""
        return bool(self.statusword & StatusWord.FOLLOWS)


@dataclass(frozen=True)
class Report:
    """The verdict on the targets that a drive was given (2101h).

    The largest velocity, acceleration and jerk are those of the differences of the targets, less
    the rounding to whole units (2^(n-1) / T^n units in an n-th difference), in revolutions of the
    motor per s, s^2, s^3; `following_error` in pu. `findings` counts by name, `first` is the cycle
    of the first of each.

    >>> print(Drive().report())
    0 targets: velocity 0 rev/s, acceleration 0 rev/s^2, jerk 0 rev/s^3, following error 0
    no findings
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
    """A simulated servo drive behind the words of CiA 402 (IEC 61800-7-201).

    One call of `cycle` is one SYNC period. Raises `DriveConfigError` for settings that do not fit.

    >>> drive = Drive()
    >>> for word in (0x00, 0x06, 0x0F, 0x0F):
    ...     feedback = drive.cycle(word, 0)
    >>> feedback.state.name, feedback.follows
    ('OPERATION_ENABLED', True)
    """

    def __init__(self, config: DriveConfig | None = None) -> None:
        """Power the drive up at position 0."""
        self._config = config or DriveConfig()
        self._c = ffi.new("sj_drive *")
        self._rx = ffi.new("sj_drive_rx *")
        self._tx = ffi.new("sj_drive_tx *")
        raise_for_config(lib.sj_drive_init(self._c, self._config.to_c()), self._c.config)

    @property
    def config(self) -> DriveConfig:
        """The present config."""
        return self._config

    @property
    def state(self) -> DriveState:
        """The present state, also before the first period."""
        return next(state for state in DriveState if state.number == self._c.state)

    @property
    def c_drive(self) -> Any:
        """For C calls: the ``sj_drive *``, which lives as long as this object."""
        return self._c

    @property
    def cycles(self) -> int:
        """Periods since power-up."""
        return int(self._c.cycles)

    @property
    def jump_limit(self) -> int:
        """The longest distance of a target from the one before, in pu."""
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
        """Change fields of the config between two periods; the motion goes on.

        Raises `DriveConfigError`, and nothing is changed then.
        """
        config = self._config.changed(**changes)
        raise_for_config(lib.sj_drive_configure(self._c, config.to_c()), self._c.config)
        self._config = config

    def restart(self, config: DriveConfig | None = None) -> None:
        """Power off and on again: words and states are new, the axis stays where it is."""
        servo = ffi.new("sj_servo *", self._c.servo)
        self._config = config or self._config
        raise_for_config(lib.sj_drive_init(self._c, self._config.to_c()), self._c.config)
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
        interpolated_position: int = 0,
        probe_function: int = 0,
        sync_missed: bool = False,
    ) -> DriveFeedback:
        """One SYNC period: words in, inner loops, words out.

        Positions are in pu and wrap as INT32; velocities in pu/s; torques in 0.1 % of the rated
        torque. `interpolated_position` is 60C1h:1 of mode 7, `probe_function` 60B8h. With
        `sync_missed` nothing came in this period, and the targets do not count.
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
        rx.interpolated_position = (int(interpolated_position) + 2**31) % 2**32 - 2**31
        rx.probe_function = probe_function
        lib.sj_drive_cycle_planned(self._c, rx, self._tx)
        tx = self._tx
        return DriveFeedback(
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
            tx.probe_1_positive,
            tx.probe_1_negative,
            tx.probe_2_positive,
            tx.probe_2_negative,
            tx.probe_status,
        )

    def enable(self, *, mode: int = Mode.CSP) -> DriveFeedback:
        """Go to Operation enabled in five periods, holding the position."""
        feedback = self.cycle(0x0000, mode=mode)
        for word in (0x0006, 0x0007, 0x000F, 0x000F):
            feedback = self.cycle(word, feedback.position_actual, mode=mode)
        return feedback

    def inject(self, fault: DriveFault, present: bool = True) -> None:
        """Make the cause of a fault appear or go; the drive reacts in the next period.

        Raises `ValueError` for a fault that comes from the motion: those after `RPDO_TIMEOUT`.
        """
        if fault > DriveFault.RPDO_TIMEOUT:
            raise ValueError(f"fault = {fault.name} comes from the motion, it cannot be injected")
        lib.sj_drive_inject(self._c, fault, present)

    def see_period(self, seconds: float) -> None:
        """SYNC was seen to come in this period; unlike 60C2h it is a warning and a finding."""
        lib.sj_verdict_period(self._c, seconds)

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
