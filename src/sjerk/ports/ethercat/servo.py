"""The drive and its dictionary, their words where the emulated subdevice controller has them.

The controller runs the drive's periods in C. Between them, `WireDevice.pull` brings its words into
the dictionary and `WireDevice.push` brings what an SDO wrote back.

Never here: frames, CoE, states of the application layer.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from sjerk._binding import ffi, lib
from sjerk.drive import Device, Drive, DriveConfig, DriveFeedback, StatusWord
from sjerk.drive.device import POSITIONS
from sjerk.drive.entries import ObjectEntry

_TX_FIELDS = DriveFeedback._fields[1:]
_SPECIAL = {0x607A: "target_position", 0x6060: "mode"}
RX_OFFSETS = {name: entry.offset for name, entry in ffi.typeof("sj_drive_rx").fields}
TX_OFFSETS = {name: entry.offset for name, entry in ffi.typeof("sj_drive_tx").fields}


class WireDrive(Drive):
    """A drive whose periods a subdevice controller runs."""

    def __init__(self, config: DriveConfig, *, at: int = 0) -> None:
        """Power up with the encoder at so many increments."""
        super().__init__(config)
        self._c.servo.encoder = at
        self._c.actual.increments = at
        lib.sj_drive_rescale(self._c)

    def attach(self, esc: Any) -> None:
        """Give the controller the drive and its present words."""
        esc.drive = self._c
        esc.tx = self._tx[0]


class WireDevice(Device):
    """A device behind an emulated subdevice controller."""

    def __init__(self, esc: Any, config: DriveConfig, *, at: int = 0) -> None:
        """Power up; `esc` is the controller (``sj_esc *``)."""
        self._esc = esc
        self._wire_drive = WireDrive(config, at=at)
        super().__init__(self._wire_drive)
        self.attach()

    def attach(self) -> None:
        """After power-up: the controller's words are the device's."""
        self._wire_drive.attach(self._esc)
        self._esc.state = self._esc.tx.statusword & 0x6F
        self._esc.error = self._esc.tx.error_code
        self.push()

    def pull(self) -> None:
        """The words of the last period into the dictionary."""
        tx, rx = self._esc.tx, self._esc.rx
        self.feedback = DriveFeedback(
            StatusWord(tx.statusword), *(getattr(tx, name) for name in _TX_FIELDS)
        )
        for name in self._rx:
            self._rx[name] = getattr(rx, name)
        written = self._esc.targets_written
        self._written = {name for bit, name in enumerate(POSITIONS) if written >> bit & 1}

    def push(self) -> None:
        """The words of the dictionary to the controller."""
        rx = self._esc.rx
        for name, value in self._rx.items():
            setattr(rx, name, value)
        self._esc.targets_written = sum(
            1 << bit for bit, name in enumerate(POSITIONS) if name in self._written
        )

    def release(self) -> None:
        """The main device that gave the commands is gone: none enables operation, none resets."""
        self._esc.rx.controlword &= 0x0007

    def note_error(self) -> int:
        """Enter the present 603Fh into 1003h and return it."""
        code = int(self._esc.tx.error_code)
        if code:
            self._errors = [code, *self._errors][:8]
        return code


def targets_in(rows: Iterable[ObjectEntry]) -> int:
    """Set-points among mapped objects: bit n for the n-th of `POSITIONS`.

    >>> from sjerk.drive.objects import entry
    >>> targets_in([entry(0x6040, 0), entry(0x60C1, 1)])
    2
    """
    offsets = {word_of(row, receive=True) for row in rows}
    return sum(1 << bit for bit, name in enumerate(POSITIONS) if RX_OFFSETS[name] in offsets)


def word_of(row: ObjectEntry, *, receive: bool) -> int | None:
    """Where a mapped object lies in ``sj_drive_rx`` or ``sj_drive_tx``; None: in neither.

    >>> from sjerk.drive.objects import entry
    >>> word_of(entry(0x6041, 0), receive=False)
    0
    """
    side, _, name = row.source.partition(".")
    if receive and row.sub == 0 and row.index in _SPECIAL:
        side, name = "rx", _SPECIAL[row.index]
    if receive and side == "rx":
        return int(RX_OFFSETS[name])
    if not receive and side == "tx":
        return int(TX_OFFSETS[name])
    return None
