"""How the cycle is clocked: what is asked of the system and what it granted.

The loop itself is ``_clock.c``. Never here: time, scheduling, motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from sjerk._binding import ffi
from sjerk.errors import InputError, real


@dataclass(frozen=True, kw_only=True)
class Clock:
    """What a kernel process asks of the system; everything is optional.

    ``spin_us``: microseconds before each deadline that are spent watching the clock instead of
    sleeping, and rehearsing the cycle on a copy; capped so that the system never suspends a
    real-time thread. ``priority``: 1..99 of SCHED_FIFO, 0 for none. ``cpu``: the processor to stay
    on. ``lock_memory``: touch and lock what the cycle needs. Raises InputError. What was refused is
    reported by ``Feedback.timing.clock``; the cycle runs all the same.

    >>> Clock(spin_us=60.0, priority=80, cpu=1, lock_memory=True).priority
    80
    """

    spin_us: float = 0.0
    priority: int = 0
    cpu: int | None = None
    lock_memory: bool = False

    def __post_init__(self) -> None:
        if not 0.0 <= real("spin_us", self.spin_us) <= 1e5:
            raise InputError("spin_us", self.spin_us, "must lie in 0 .. 1e5 us")
        for name, value, most in (("priority", self.priority, 99), ("cpu", self.cpu, 1023)):
            if name == "cpu" and value is None:
                continue
            if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= most:
                raise InputError(name, value, f"must be a whole number 0 .. {most}")
        if not isinstance(self.lock_memory, bool):
            raise InputError("lock_memory", self.lock_memory, "must be True or False")

    def to_c(self, cycle_time: float) -> Any:
        """The ``sj_clock_options *`` at this cycle time (s)."""
        options = ffi.new("sj_clock_options *")
        options.period_ns = round(cycle_time * 1e9)
        options.spin_ns = round(self.spin_us * 1e3)
        options.priority = self.priority
        options.cpu = -1 if self.cpu is None else self.cpu
        options.lock_memory = self.lock_memory
        return options
