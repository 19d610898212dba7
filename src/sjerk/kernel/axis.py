"""What an axis is: limits, unit, drive. Checked where it is made.

Never here: motion, the cycle.
"""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass, field
from typing import Any, Literal

from sjerk._binding import ffi
from sjerk.cia402 import DriveConfig
from sjerk.errors import InputError, positive
from sjerk.profile import Limits


@dataclass(frozen=True)
class Axis:
    """One axis: its limits, its unit in drive increments, its drive.

    ``counts_per_unit``: drive increments per axis unit, e.g. 2**24 / 360 for degrees at a 24-bit
    encoder; ``gear``: motor turns per turn of the axis. ``limits.position``: the position
    limits. ``stop_limits``: of the quick stop, else ``limits``. ``wrap``: axis units of one turn of
    an axis that turns for ever. ``following_error`` (axis unit): beyond it the kernel reacts.
    ``drive``: the simulated one; ``"ideal"``: without mechanics, always on its target;
    ``"external"``: the caller exchanges ``MotionKernel.image`` around ``step``.

    >>> Axis(Limits(90.0, 500.0, 5000.0), 2**24 / 360, unit="deg", gear=100.0).unit
    'deg'
    """

    limits: Limits
    counts_per_unit: float
    drive: DriveConfig | Literal["external", "ideal"] = field(default_factory=DriveConfig)
    _: KW_ONLY
    unit: str = ""
    gear: float = 1.0
    wrap: float | None = None
    stop_limits: Limits | None = None
    following_error: float | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.limits, Limits):
            raise InputError("limits", self.limits, "must be a Limits")
        if self.stop_limits is not None and not isinstance(self.stop_limits, Limits):
            raise InputError("stop_limits", self.stop_limits, "must be a Limits")
        if not isinstance(self.drive, DriveConfig) and self.drive not in ("external", "ideal"):
            raise InputError("drive", self.drive, "must be a DriveConfig, 'ideal' or 'external'")
        if not isinstance(self.unit, str) or len(self.unit.encode("utf-8", "replace")) > 15:
            raise InputError("unit", self.unit, "must be a text of at most 15 bytes")
        if not self.unit.isprintable():
            raise InputError("unit", self.unit, "must be printable, in one line")
        for name in ("counts_per_unit", "gear"):
            object.__setattr__(self, name, positive(name, getattr(self, name)))
        for name in ("wrap", "following_error"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, positive(name, getattr(self, name)))
        if self.wrap is not None and self.limits.position is not None:
            raise InputError(
                "wrap", self.wrap, "an axis that turns for ever has no position limits"
            )

    def to_c(self, T: float) -> Any:
        """The ``sj_axis_config *`` at this cycle time."""
        config = ffi.new("sj_axis_config *")
        for name, limits in (("limits", self.limits), ("stop_limits", self.stop_limits)):
            rows = (limits or self.limits).per_cycle(T)
            ffi.memmove(ffi.addressof(config, name), rows, len(rows))
        low, high = self.limits.position or (-math.inf, math.inf)
        config.position_min, config.position_max = low, high
        config.counts_per_unit = self.counts_per_unit * self.gear
        config.following_limit = self.following_error or math.inf
        config.velocity_max = math.inf
        config.wrap = self.wrap or 0.0
        config.external = self.drive == "external"
        config.ideal = self.drive == "ideal"
        config.unit = self.unit.encode()
        return config
