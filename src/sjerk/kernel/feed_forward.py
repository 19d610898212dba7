"""What the kernel feeds forward to a drive, and in which words: 60B1h and 60B2h of CiA 402.

Never here: motion, the differences of the commanded positions (``cycle/_feed_forward.c``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from sjerk._binding import ffi
from sjerk.cia402 import DriveConfig
from sjerk.errors import InputError, positive, real
from sjerk.profile import Limits

_POSITION, _VELOCITY, _TORQUE = 0x80, 0x40, 0x20  # 607Eh
_VELOCITY_MOST, _TORQUE_MOST = 2**31 - 1, 2**15 - 1  # of 60B1h, of 60B2h


@dataclass(frozen=True, kw_only=True)
class FeedForward:
    """The motor behind an axis, as far as the kernel feeds its motion forward.

    60B1h is the velocity of the command, in position units of the drive per s; ``velocity_unit``
    of them make one of the drive's velocity unit. 60B2h is the torque that the command needs,

        inertia alpha + friction w / (abs(w) + friction_speed) + viscous w + load,

    in 0.1 % of ``rated_torque_nm`` (6076h); None: no 60B2h. What rounding leaves of the torque is
    carried to the next cycle. ``counts_per_revolution``: position units of one turn of the motor.
    ``polarity``: 607Eh of the drive, bit 7 position, 6 velocity, 5 torque. ``inertia_kg_m2`` counts
    motor and load, both seen from the motor. Source: CiA 402 (IEC 61800-7-201), objects 60B1h and
    60B2h.

    Raises InputError.

    >>> FeedForward.of(DriveConfig()).friction_nm
    0.04
    """

    velocity_unit: float = 1.0
    polarity: int = 0
    rated_torque_nm: float | None = None
    counts_per_revolution: float | None = None
    inertia_kg_m2: float = 0.0
    friction_nm: float = 0.0
    friction_speed_rad_s: float = 0.5
    viscous_nm_s: float = 0.0
    load_torque_nm: float = 0.0

    def __post_init__(self) -> None:
        for name in ("velocity_unit", "friction_speed_rad_s"):
            object.__setattr__(self, name, positive(name, getattr(self, name)))
        for name in ("inertia_kg_m2", "friction_nm", "viscous_nm_s", "load_torque_nm"):
            value = real(name, getattr(self, name))
            if value < 0.0 and name != "load_torque_nm":
                raise InputError(name, value, "must be at least 0")
            if value and self.rated_torque_nm is None:
                raise InputError(
                    "rated_torque_nm", None, f"is needed for {name}: 60B2h is a part of it"
                )
            object.__setattr__(self, name, value)
        for name in ("rated_torque_nm", "counts_per_revolution"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, positive(name, getattr(self, name)))
        if self.rated_torque_nm is not None and self.counts_per_revolution is None:
            raise InputError(
                "counts_per_revolution", None, "is needed for 60B2h: torques are of the motor"
            )
        known = _POSITION | _VELOCITY | _TORQUE
        if (
            isinstance(self.polarity, bool)
            or not isinstance(self.polarity, int)
            or self.polarity & ~known
        ):
            raise InputError("polarity", self.polarity, "must be bits 80h, 40h and 20h of 607Eh")

    @classmethod
    def of(cls, drive: DriveConfig, *, torque: bool = True) -> FeedForward:
        """The motor that a drive is set to; ``torque``: 60B2h too.

        >>> FeedForward.of(DriveConfig(gear_motor=10)).counts_per_revolution
        1677721.6
        """
        if not torque:
            return cls(polarity=drive.polarity)
        feed = drive.feed * drive.gear_shaft
        return cls(
            polarity=drive.polarity,
            rated_torque_nm=drive.rated_torque_nm,
            counts_per_revolution=feed / (drive.feed_shaft * drive.gear_motor),
            inertia_kg_m2=drive.inertia_kg_m2 * (1.0 + drive.load_inertia_ratio),
            friction_nm=drive.friction_nm,
            friction_speed_rad_s=drive.friction_speed_rad_s,
            viscous_nm_s=drive.viscous_nm_s,
            load_torque_nm=drive.load_torque_nm,
        )

    def _sign(self, bit: int) -> float:
        """Of a word with this bit of 607Eh, beside the position as a word."""
        return -1.0 if bool(self.polarity & _POSITION) != bool(self.polarity & bit) else 1.0

    def to_c(self, counts_per_unit: float, T: float) -> Any:
        """The ``sj_feed_forward *`` of an axis with so many position units at this cycle time."""
        words = ffi.new("sj_feed_forward *")
        words.velocity = self._sign(_VELOCITY) * counts_per_unit / (T * self.velocity_unit)
        words.friction_step = 1.0
        if self.rated_torque_nm is None or self.counts_per_revolution is None:
            return words
        unit = self._sign(_TORQUE) * 1e3 / self.rated_torque_nm
        rad = 2.0 * math.pi * counts_per_unit / self.counts_per_revolution
        words.inertia = unit * self.inertia_kg_m2 * rad / T**2
        words.friction = unit * self.friction_nm
        words.friction_step = self.friction_speed_rad_s * T / rad
        words.viscous = unit * self.viscous_nm_s * rad / T
        # of the motor, whatever way the positions count
        load = 1e3 * self.load_torque_nm / self.rated_torque_nm
        words.load = round(-load if self.polarity & _TORQUE else load)
        return words

    def check(self, words: Any, limits: Limits, T: float) -> None:
        """Raise InputError where motion within these limits needs more than a word holds."""
        velocity, acceleration = limits.velocity * T, max(limits.acceleration, limits.braking[0])
        word = abs(words.velocity) * velocity
        if word > _VELOCITY_MOST:
            most = limits.velocity * _VELOCITY_MOST / word
            raise InputError("limits.velocity", limits.velocity, f"60B1h holds up to {most:.6g}")
        word = (
            abs(words.inertia) * acceleration * T**2
            + abs(words.friction)
            + abs(words.viscous) * velocity
            + abs(words.load)
        )
        if word > _TORQUE_MOST:
            raise InputError(
                "feed_forward",
                f"{word / 1e3:.6g} of the rated torque",
                f"60B2h holds up to {_TORQUE_MOST / 1e3:g}",
            )
