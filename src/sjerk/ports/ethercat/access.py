"""Requests to EtherCAT devices beside the cycle: registers, SII, states of the application layer.

Procedures are generators: each `yield` waits a moment, whoever runs them decides how. A thread
sleeps, virtual time runs a cycle. `finish` runs one to its end.

Never here: sockets, mails, what a drive is set up with.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Generator
from typing import Protocol, TypeVar

from sjerk.errors import SjerkError
from sjerk.ports.ethercat.datagrams import Answer, Command, Datagram
from sjerk.ports.ethercat.states import ERROR, AlCode, AlState

T = TypeVar("T")
Steps = Generator[None, None, T]
"""A procedure that waits at each of its steps."""

MS = 1_000_000
_TRIES = 20  # of a frame that does not come back
_SII_NS, _STATE_NS = 500 * MS, 5_000 * MS
_AL_CONTROL, _AL_STATUS, _SII_CONFIG, _SII = 0x0120, 0x0130, 0x0500, 0x0502
_SII_BYTES = 14  # of 0502h to 050Fh: status, word address, data
_SII_BUSY, _SII_FAULT, _SII_EIGHT = 0x8000, 0x7800, 0x0040


class BusError(SjerkError):
    """The bus or a device does not do what it is asked for: ``device`` its position, or None.

    >>> print(BusError("no answer", 3))
    device 3: no answer
    """

    def __init__(self, message: str, device: int | None = None) -> None:
        super().__init__(message if device is None else f"device {device}: {message}")
        self.device = device


class RefusedStateError(BusError):
    """A device refused a state, or left it: ``state`` 0130h, ``code`` 0134h."""

    def __init__(self, device: int, wanted: AlState, state: int, code: int) -> None:
        name = AlCode(code).name.lower().replace("_", " ") if code in set(AlCode) else "unknown"
        super().__init__(
            f"does not go to {wanted.name}: 0130h = {state:02X}h, 0134h = {code:04X}h ({name})",
            device,
        )
        self.state, self.code = state, code


class Transport(Protocol):
    """A way to the devices: an interface, or a line in virtual time."""

    def exchange(self, datagrams: tuple[Datagram, ...]) -> list[Answer] | None:
        """One frame there and back; None where it did not come back."""

    def now(self) -> int:
        """Steady time, ns."""


def finish(steps: Steps[T], pause: Callable[[], object]) -> T:
    """Run a procedure to its end; `pause` is called at each of its steps.

    >>> def two() -> Steps[int]:
    ...     yield
    ...     return 2
    >>> finish(two(), lambda: None)
    2
    """
    while True:
        try:
            next(steps)
        except StopIteration as end:
            value: T = end.value
            return value
        pause()


def position_of(station: int) -> int:
    """Position of a device by its station address, which the scan gave it.

    >>> position_of(0x1003)
    2
    """
    return station - FIRST_STATION


FIRST_STATION = 0x1001
"""Station address of the first device; the others count on."""


class Access:
    """Registers, SII and states over a transport."""

    def __init__(self, transport: Transport) -> None:
        self.transport = transport

    def now(self) -> int:
        """Steady time, ns."""
        return self.transport.now()

    def ask(self, *datagrams: Datagram) -> Steps[list[Answer]]:
        """One frame there and back; a lost one is sent again. Raises `BusError`."""
        for _ in range(_TRIES):
            answers = self.transport.exchange(datagrams)
            if answers is not None:
                return answers
            yield
        raise BusError("no frame comes back: the cable, the power, another interface?")

    def one(self, command: Command, address: int, offset: int, data: bytes) -> Steps[Answer]:
        """As `ask`, of one datagram."""
        answers = yield from self.ask(Datagram(command, address, offset, data))
        return answers[0]

    def count(self) -> Steps[int]:
        """How many devices a frame meets."""
        answer = yield from self.one(Command.BRD, 0, 0x0000, bytes(1))
        return answer.counter

    def read(self, station: int, offset: int, count: int) -> Steps[bytes]:
        """Bytes of a device; raises `BusError` where it does not answer."""
        answer = yield from self.one(Command.FPRD, station, offset, bytes(count))
        if answer.counter != 1:
            raise BusError(f"register {offset:04X}h cannot be read", position_of(station))
        return answer.data

    def word(self, station: int, offset: int) -> Steps[int]:
        """16 bits of a device."""
        data = yield from self.read(station, offset, 2)
        return int.from_bytes(data, "little")

    def write(self, station: int, offset: int, data: bytes) -> Steps[None]:
        """Bytes to a device; raises `BusError` where it does not take them."""
        answer = yield from self.one(Command.FPWR, station, offset, data)
        if answer.counter != 1:
            raise BusError(f"register {offset:04X}h cannot be written", position_of(station))

    # ---- SII ----

    def sii(self, station: int, word: int, words: int) -> Steps[bytes]:
        """So many words of the SII; raises `BusError`.

        The order and the look at what it brings go in one frame: a quick device has done it.
        """
        data = b""
        fpwr, fprd = Command.FPWR, Command.FPRD
        taken = (  # from the device, for the main device
            Datagram(fpwr, station, _SII_CONFIG, b"\2"),
            Datagram(fpwr, station, _SII_CONFIG, b"\0"),
        )
        while len(data) < 2 * words:
            order = struct.pack("<HI", 0x0100, word + len(data) // 2)
            answers = yield from self.ask(
                *(() if data else taken),
                Datagram(fpwr, station, _SII, order),
                Datagram(fprd, station, _SII, bytes(_SII_BYTES)),
            )
            if any(answer.counter != 1 for answer in answers):
                raise BusError("its SII does not answer", position_of(station))
            status, came = yield from self._sii_done(station, answers[-1].data)
            data += came[: 8 if status & _SII_EIGHT else 4]
        return data[: 2 * words]

    def _sii_done(self, station: int, registers: bytes) -> Steps[tuple[int, bytes]]:
        """0502h once it is not busy, and the data; `registers`: as they were just read."""
        end = self.now() + _SII_NS
        while (status := int.from_bytes(registers[:2], "little")) & _SII_BUSY:
            if self.now() > end:
                raise BusError("the SII stays busy", position_of(station))
            yield
            registers = yield from self.read(station, _SII, _SII_BYTES)
        if status & _SII_FAULT:
            raise BusError(f"the SII cannot be read, 0502h = {status:04X}h", position_of(station))
        return status, registers[6:]

    # ---- states ----

    def state(self, station: int) -> Steps[tuple[int, int]]:
        """0130h and 0134h."""
        data = yield from self.read(station, _AL_STATUS, 6)
        state, code = struct.unpack("<HxxH", data)
        return state, code

    def request(self, station: int, state: AlState) -> Steps[None]:
        """Ask for a state, errors acknowledged, and wait for it; raises `RefusedStateError`."""
        before, _ = yield from self.state(station)
        if before & ERROR:
            yield from self.write(station, _AL_CONTROL, struct.pack("<H", before & 15 | ERROR))
            yield from self._acknowledged(station)
        yield from self.write(station, _AL_CONTROL, struct.pack("<H", state))
        end = self.now() + _STATE_NS
        while True:
            status, code = yield from self.state(station)
            if status == state:
                return
            if status & ERROR or self.now() > end:
                raise RefusedStateError(position_of(station), state, status, code)
            yield

    def _acknowledged(self, station: int) -> Steps[None]:
        end = self.now() + 100 * MS
        while self.now() < end:
            status, _ = yield from self.state(station)
            if not status & ERROR:
                return
            yield
