"""Requests of a person to devices on an interface, also beside a kernel that runs there.

Never here: the cycle, mappings that are written.
"""

from __future__ import annotations

from typing import Any

from sjerk.ports.ethercat.access import Access, BusError, Steps, T, finish
from sjerk.ports.ethercat.commissioning import mapped_words, to_preop
from sjerk.ports.ethercat.mailbox import Mailbox
from sjerk.ports.ethercat.scanning import Found, scan
from sjerk.ports.ethercat.settings import Word
from sjerk.ports.ethercat.states import AlState
from sjerk.ports.ethercat.transports import InterfaceTransport, claim, claimed

_ERROR_COUNTERS = 0x0300


class Requests:
    """Some requests on an interface; use as a context.

    Where a kernel of sjerk is the main device, its drives keep their states; where none is, another
    main device is refused, and a device may be taken to Pre-operational.
    """

    def __init__(self, interface: str) -> None:
        """Raises `BusError`, `OSError`."""
        self._beside = claimed(interface)
        self._claim = None if self._beside else claim(interface)
        self._transport = InterfaceTransport(interface)
        self._access = Access(self._transport)
        self._interface = interface

    def __enter__(self) -> Requests:
        return self

    def __exit__(self, *_: object) -> None:
        self._transport.close()
        if self._claim is not None:
            self._claim.close()

    def _do(self, steps: Steps[T]) -> T:
        return finish(steps, self._moment)

    def _moment(self) -> None:
        self._transport.wait_until(self._transport.now() + 1_000_000)

    def devices(self) -> list[Found]:
        """Everything on the cable; raises `BusError` where nothing is."""
        found = self._do(scan(self._access))
        if not found:
            raise BusError(f"no device answers on {self._interface}")
        return found

    def scan(self) -> list[dict[str, Any]]:
        """A row per device: identity, clock, state, counters of errors."""
        rows = []
        for device in self.devices():
            state, code = self._do(self._access.state(device.station))
            counters = self._do(self._access.read(device.station, _ERROR_COUNTERS, 8))
            rows.append(
                {
                    "position": device.position,
                    "alias": device.alias,
                    "name": device.name,
                    "identity": [f"{device.vendor:#x}", f"{device.product:#x}"],
                    "revision": f"{device.revision:#x}",
                    "serial": device.serial,
                    "clock": (64 if device.wide else 32) if device.clock else 0,
                    "state": f"{state:02X}h",
                    "code": f"{code:04X}h",
                    "errors": sum(counters),
                }
            )
        return rows

    def read(self, position: int, index: int, sub: int) -> bytes:
        """An object; raises `BusError`."""
        return self._do(self._mailbox(self._device(position)).upload(index, sub))

    def write(self, position: int, index: int, sub: int, data: bytes) -> None:
        """Write an object; raises `BusError`."""
        self._do(self._mailbox(self._device(position)).download(index, sub, data))

    def describe(self) -> str:
        """A kernel's file for what is on the cable, with the PDOs that are assigned."""
        lines = [
            "cycle_time = 0.001",
            "",
            "[ethercat]",
            f'interface = "{self._interface}"',
        ]
        for device in self.devices():
            mailbox = self._mailbox(device)
            out = self._do(mapped_words(mailbox, 0x1C12))
            back = self._do(mapped_words(mailbox, 0x1C13))
            lines += [
                "",
                f"[[axes]] # {device.name}",
                "counts_per_unit = 1.0 # to be filled in: increments of 6064h per unit",
                "limits = { velocity = 1.0, acceleration = 1.0, jerk = 1.0 } # likewise",
                "[axes.ethercat]",
                f"position = {device.position}",
                f"identity = [{device.vendor:#x}, {device.product:#x}]",
                f"activate = {0x0300 if device.clock else 0:#x}",
                f"# mapped: {_names(out)}",
                f"#         {_names(back)}",
            ]
        return "\n".join(lines) + "\n"

    def _device(self, position: int) -> Found:
        devices = self.devices()
        if not 0 <= position < len(devices):
            raise BusError(f"{len(devices)} devices are on the cable, none is number {position}")
        return devices[position]

    def _mailbox(self, device: Found) -> Mailbox:
        """Its mailbox; it is taken to Pre-operational where it is below and no kernel runs."""
        state, _ = self._do(self._access.state(device.station))
        if state & 0x0F == AlState.INIT:
            if self._beside:
                raise BusError("is in Init, and a kernel is its main device", device.position)
            return self._do(to_preop(self._access, device))
        boxes = [(area.start, area.length) for _, area in (device.area(1), device.area(2))]
        return Mailbox(self._access, device.station, boxes[0], boxes[1])


def _names(words: list[Word]) -> str:
    return " ".join(
        f"{word.index:04X}:{word.sub}/{word.bits}" if word.index else f"-{word.bits}"
        for word in words
    )
