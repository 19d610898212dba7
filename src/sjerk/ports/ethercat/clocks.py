"""Distributed clocks from the main device's side: delays, offsets, SYNC0 (ETG.1000.4, 6.4).

The first device with a clock is the reference. A frame meets a device twice, on its way out and on
its way back; the difference of the port times of two neighbours is twice the delay between them.
Devices in a line only, one behind the other.

Never here: the clock of the cycle (`_frame.c`), the device's own loop (`_esc_dc.c`).
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

from sjerk.ports.ethercat.access import MS, Access, BusError, Steps
from sjerk.ports.ethercat.datagrams import Command, Datagram
from sjerk.ports.ethercat.scanning import Found

_PORT_TIMES, _TIME, _RECEIVED, _OFFSET, _DELAY = 0x0900, 0x0910, 0x0918, 0x0920, 0x0928
_SPEED, _ACTIVATION, _START, _CYCLES = 0x0930, 0x0980, 0x0990, 0x09A0
_AHEAD_NS = 50 * MS  # of the first SYNC0
_LOW = 0xFFFFFFFF


class Clocks:
    """The clocks of a line; its first one counts for all."""

    def __init__(self, access: Access, devices: Sequence[Found]) -> None:
        self._access = access
        self._devices = [device for device in devices if device.clock]
        self._delays: dict[int, int] = {}
        self._time = self._asked = 0

    @property
    def reference(self) -> Found | None:
        """The device whose clock counts; None: there is none."""
        return self._devices[0] if self._devices else None

    def _time_of(self, device: Found, data: bytes) -> int:
        return int.from_bytes(data[: 8 if device.wide else 4], "little")

    def start(self) -> Steps[None]:
        """Measure the delays and set all clocks; SYNC0 stands still."""
        if not self._devices:
            return
        for device in self._devices:
            yield from self._access.write(device.station, _ACTIVATION, b"\0\0")
        yield from self._access.one(Command.BWR, 0, _PORT_TIMES, bytes(4))
        first, before, delay, start = self._devices[0], 0, 0, 0
        for device in self._devices:
            ports = struct.unpack(
                "<4I", (yield from self._access.read(device.station, _PORT_TIMES, 16))
            )
            received = yield from self._access.read(device.station, _RECEIVED, 8)
            links = device.ports
            if len(links) > 2:
                raise BusError("the line branches here: only a line is known", device.position)
            behind = (ports[links[1]] - ports[links[0]]) & _LOW if len(links) == 2 else 0
            if device is first:
                start = self._time_of(device, received)
            else:
                delay += max(0, (before - behind) // 2)
            before = behind
            self._delays[device.station] = delay
            offset = start + delay - self._time_of(device, received)
            yield from self._set(device, offset if device is not first else 0)
        yield from self.now()

    def _set(self, device: Found, offset: int) -> Steps[None]:
        access, station = self._access, device.station
        yield from access.write(station, _OFFSET, struct.pack("<Q", offset & (1 << 64) - 1))
        yield from access.write(station, _DELAY, struct.pack("<I", self._delays[station]))
        yield from access.write(station, _SPEED, struct.pack("<H", 0x1000))

    def now(self) -> Steps[int]:
        """Time of the reference, extended where its clock has 32 bits."""
        reference = self._devices[0]
        asked = self._access.now()
        data = yield from self._access.read(reference.station, _TIME, 8)
        time = self._time_of(reference, data)
        if not reference.wide:
            expected = self._time + asked - self._asked
            time = expected + ((time - expected + (1 << 31)) & _LOW) - (1 << 31)
        self._time, self._asked = time, asked
        return time

    def restore(self, device: Found) -> Steps[None]:
        """The clock of one device that was off, by the others'; theirs do not move."""
        if not device.clock or device is self._devices[0]:
            return
        access, reference = self._access, self._devices[0]
        yield from access.write(device.station, _ACTIVATION, b"\0\0")
        yield from self._set(device, 0)
        asked = [Datagram(Command.FPRD, d.station, _TIME, bytes(8)) for d in (reference, device)]
        times = yield from access.ask(*asked)  # in one frame: the same moment
        if any(answer.counter != 1 for answer in times):
            raise BusError("its clock cannot be read", device.position)
        there, here = (
            self._time_of(d, answer.data)
            for d, answer in zip((reference, device), times, strict=True)
        )
        offset = there + self._delays[device.station] - here
        if not reference.wide:
            offset &= _LOW
        yield from self._set(device, offset)

    def start_sync(self, device: Found, activate: int, period: int, sync0: int) -> Steps[None]:
        """Let SYNC0 come at the multiples of the period; with SYNC1 where `activate` says so."""
        access, station = self._access, device.station
        yield from access.write(station, _ACTIVATION, b"\0\0")
        if not activate:
            return
        cycles = (sync0, period - sync0) if activate & 0x0400 else (period, 0)
        now = yield from self.now()
        start = (now + _AHEAD_NS) // period * period + period
        yield from access.write(station, _CYCLES, struct.pack("<II", *cycles))
        yield from access.write(station, _START, struct.pack("<Q", start & (1 << 64) - 1))
        yield from access.write(station, _ACTIVATION, struct.pack("<H", activate))

    def deviation(self, device: Found) -> Steps[int]:
        """How far the clock of a device is from the reference, ns (092Ch)."""
        data = yield from self._access.read(device.station, 0x092C, 4)
        return int.from_bytes(data, "little") & 0x7FFFFFFF
