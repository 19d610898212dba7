"""What an axis is: limits, unit, drive. Checked where it is made.

Never here: motion, the cycle.
"""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass, field
from typing import Any, Literal

from sjerk._binding import ffi
from sjerk.cia402 import DriveConfig
from sjerk.errors import InputError, positive, real
from sjerk.kernel.feed_forward import FeedForward
from sjerk.profile import Limits

#: A longer name does not fit into a frame of the feedback.
NAME_BYTES = 63


@dataclass(frozen=True)
class Axis:
    """One axis: its limits, its unit in drive increments, its drive.

    ``name``: of the joint, in status, events and errors; different ones within a kernel.
    ``counts_per_unit``: drive increments per axis unit, e.g. 2**24 / 360 for degrees at a 24-bit
    encoder; ``gear``: motor turns per turn of the axis. ``limits.position``: the position
    limits. ``stop_limits``: of the quick stop, else ``limits``. ``wrap``: axis units of one turn of
    an axis that turns for ever, which has no position limits; of a motion through points the first
    one chooses the turn. ``following_error`` (axis unit): beyond it the kernel reacts.
    ``drive``: the simulated one; ``"ideal"``: without mechanics, always on its target;
    ``"external"``: the caller exchanges ``MotionKernel.image`` around ``step``.
    ``feed_forward``: what the kernel sends with each target. ``"velocity"``: 60B1h; ``"torque"``:
    60B1h and 60B2h, for the motor of ``drive``; a ``FeedForward``: for the one it says; None:
    nothing. A simulated drive's own feed-forward of the same is then off, lest it count twice; that
    of an external drive is to be turned off there. ``start``: where a simulated drive stands when
    the kernel begins, to the nearest increment; None: at 0. Raises InputError.

    >>> Axis(Limits(90.0, 500.0, 5000.0), 2**24 / 360, unit="deg", gear=100.0).unit
    'deg'
    >>> elbow = Axis(Limits(2.6, 10.0, 500.0, position=(-3.1, -0.1)), 1e6, name="elbow", start=-1.5)
    >>> from sjerk import MotionKernel
    >>> MotionKernel([elbow]).positions.tolist()
    [-1.5]
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
    feed_forward: FeedForward | Literal["velocity", "torque"] | None = None
    name: str = ""
    start: float | None = None

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
        if not isinstance(self.name, str) or not self.name.isprintable():
            raise InputError("name", self.name, "must be a printable text")
        if len(self.name.encode()) > NAME_BYTES:
            raise InputError("name", self.name, f"must be a text of at most {NAME_BYTES} bytes")
        for name in ("counts_per_unit", "gear"):
            object.__setattr__(self, name, positive(name, getattr(self, name)))
        for name in ("wrap", "following_error"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, positive(name, getattr(self, name)))
        if self.wrap is not None and self.limits.position is not None:
            raise InputError(
                "wrap", self.wrap, "an axis that turns for ever has no position limits"
            )
        if self.start is not None:
            self._check_start()
        self._check_feed_forward()

    def _check_start(self) -> None:
        start = real("start", self.start)
        if self.drive == "external":
            raise InputError("start", start, "an external drive is where it is")
        low, high = self.limits.position or (-math.inf, math.inf)
        if not low <= start <= high:
            raise InputError("start", start, f"must lie within the position limits {low} .. {high}")
        most = 2**31 - 1
        if abs(start * self.counts_per_unit * self.gear) > most:
            reach = most / (self.counts_per_unit * self.gear)
            raise InputError("start", start, f"the drive counts up to {reach:.9g} either way")
        object.__setattr__(self, "start", start)

    def _check_feed_forward(self) -> None:
        wanted = self.feed_forward
        if wanted is None:
            return
        if not isinstance(wanted, FeedForward) and wanted not in ("velocity", "torque"):
            raise InputError(
                "feed_forward", wanted, "must be 'velocity', 'torque', a FeedForward or None"
            )
        if self.drive == "ideal":
            raise InputError("feed_forward", wanted, "an ideal drive has no loop to feed")
        if self.drive == "external" and wanted == "torque":
            raise InputError(
                "feed_forward", wanted, "the motor of an external drive must be given: FeedForward"
            )

    @property
    def fed_forward(self) -> FeedForward | None:
        """What is fed forward, with the motor that it is for; None: nothing.

        >>> axis = Axis(Limits(90.0, 500.0, 5000.0), 2**24 / 360, feed_forward="torque")
        >>> axis.fed_forward.friction_nm
        0.04
        """
        if self.feed_forward is None or isinstance(self.feed_forward, FeedForward):
            return self.feed_forward
        if isinstance(self.drive, DriveConfig):
            return FeedForward.of(self.drive, torque=self.feed_forward == "torque")
        return FeedForward()

    def simulated(self, T: float) -> DriveConfig | None:
        """The simulated drive at this cycle time, without what the kernel feeds forward; or None.

        >>> axis = Axis(Limits(90.0, 500.0, 5000.0), 2**24 / 360, feed_forward="velocity")
        >>> axis.simulated(1e-3).velocity_feedforward
        0.0
        """
        if isinstance(self.drive, str):
            return None
        fed, off = self.fed_forward, {}
        if fed is not None:
            off["velocity_feedforward"] = 0.0
        if fed is not None and fed.rated_torque_nm is not None:
            off["acceleration_feedforward"] = 0.0
        return self.drive.changed(period_s=T, **off)

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
        config.feed_forward.friction_step = 1.0
        if self.fed_forward is not None:
            words = self.fed_forward.to_c(config.counts_per_unit, T)
            for limits in (self.limits, self.stop_limits or self.limits):
                self.fed_forward.check(words, limits, T)
            config.feed_forward = words[0]
        config.external = self.drive == "external"
        config.ideal = self.drive == "ideal"
        config.unit = self.unit.encode()
        config.name = self.name.encode()
        config.start = self.start or 0.0
        return config
