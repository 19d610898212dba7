"""Deadlines of receive PDOs (CiA 301, 140xh:5): which of them did not come in time.

The watch of a PDO begins with its first frame after 140xh:5 was set, and ends with 0 there, with
the PDO itself (bit 31 of 140xh:1), and outside Operational.

Never here: frames, what the drive does.
"""

from __future__ import annotations

from sjerk.drive import Device
from sjerk.drive.objects import DISABLED


class Deadlines:
    """When each receive PDO of a device is due at the latest, and which are missing.

    >>> device = Device()
    >>> device.write(0x1400, 5, 20)
    >>> deadlines = Deadlines(device)
    >>> deadlines.heard(0, 100.0)
    >>> deadlines.missed(100.01), deadlines.missed(100.03), deadlines.missing
    ([], [0], {0})
    """

    def __init__(self, device: Device) -> None:
        """Watch nothing yet."""
        self._device = device
        self._due: dict[int, float] = {}
        self.missing: set[int] = set()
        """Numbers of the PDOs that did not come in time and have not come since."""

    def _time_s(self, number: int) -> float:
        """The deadline of a PDO; 0.0: none."""
        disabled = int(self._device.read(0x1400 + number, 1)) & DISABLED
        return 0.0 if disabled else int(self._device.read(0x1400 + number, 5)) * 1e-3

    def heard(self, number: int, now: float) -> None:
        """A PDO has come."""
        self.missing.discard(number)
        self._due.pop(number, None)
        if time_s := self._time_s(number):
            self._due[number] = now + time_s

    def missed(self, now: float) -> list[int]:
        """The PDOs whose deadline has passed since the last call."""
        for number in [*self._due, *self.missing]:
            if not self._time_s(number):
                self._due.pop(number, None)
                self.missing.discard(number)
        passed = [number for number, due in self._due.items() if due <= now]
        for number in passed:
            del self._due[number]
        self.missing.update(passed)
        return passed

    @property
    def due(self) -> float | None:
        """The next deadline."""
        return min(self._due.values(), default=None)

    def clear(self) -> None:
        """Watch nothing, miss nothing."""
        self._due.clear()
        self.missing.clear()
