"""A kernel and a line of emulated drives joined in one process, in virtual time."""

from __future__ import annotations

from typing import Any

from sjerk import Axis, Limits, MotionKernel
from sjerk.ports.ethercat import BusSettings, DriveSettings, Line, MainDevice

COUNTS = 2**24
AXIS = Axis(Limits(20.0, 400.0, 4e4), COUNTS, "external", unit="rev")


class Joined:
    """Use as a context; ``said`` is what the bus told."""

    def __init__(
        self,
        drives: int = 2,
        cycle_time: float = 1e-3,
        *,
        settings: BusSettings | None = None,
        setup: dict[int, DriveSettings | int] | None = None,
        axis: Axis = AXIS,
        kernel: MotionKernel | None = None,
        **line: Any,
    ) -> None:
        self.line = Line(drives=drives, **line)
        self.kernel = kernel or MotionKernel([axis] * drives, cycle_time)
        self.host = self.kernel.host()
        self.said: list[str] = []
        self.main = MainDevice(
            self.kernel,
            self.line,
            setup or {k: k for k in range(drives)},
            settings,
            say=self.said.append,
        )
        self.c = self.main.bus.c

    def __enter__(self) -> Joined:
        self.main.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        self.main.__exit__(*error)

    @property
    def axes(self) -> Any:
        """Feedback of the axes."""
        return self.host.feedback().axes

    def cycles(self, count: int) -> None:
        """So many cycles."""
        for _ in range(count):
            self.main.exchange()

    def until(self, met: Any, limit: int = 5000) -> int:
        """Cycles until something is so; how many."""
        for count in range(limit):
            if met():
                return count
            self.main.exchange()
        raise AssertionError("it did not happen")

    def enable(self) -> None:
        """All axes, until they follow."""
        self.host.enable()
        self.until(lambda: all(axis.follows for axis in self.axes))

    def findings(self) -> list[dict[str, int]]:
        """What the drives found wrong with their targets."""
        return [
            {kind: count for kind, count in device["findings"].items() if count}
            for device in self.line.status()["devices"]
        ]
