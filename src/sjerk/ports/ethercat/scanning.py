"""What is on the cable: every device with its identity, its SII, its ports.

Never here: what a device is set up with.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from sjerk.ports.ethercat.access import FIRST_STATION, Access, BusError, Steps
from sjerk.ports.ethercat.datagrams import Command
from sjerk.ports.ethercat.sii import Area

MOST = 64
"""Devices of a line."""
_STRINGS, _GENERAL, _MANAGERS, _END = 10, 30, 41, 0xFFFF
_LONGEST_SII = 4096  # words that are searched for categories
_LINKED = (0x0200, 0x0800, 0x2000, 0x8000)  # 0110h: communication at ports 0 to 3
_HAS_CLOCK, _WIDE = 0x0004, 0x0008


@dataclass(frozen=True)
class Found:
    """A device on the cable, as itself and its SII say."""

    position: int
    station: int
    alias: int
    vendor: int
    product: int
    revision: int
    serial: int
    name: str
    areas: tuple[Area, ...]
    """SyncManagers 0 to 3 by the SII; empty without."""
    clock: bool
    """Has a distributed clock,"""
    wide: bool
    """of 64 bits."""
    ports: tuple[int, ...]
    """Where cables are."""

    def area(self, kind: int) -> tuple[int, Area]:
        """Number and area of the first SyncManager of a kind; raises `BusError`."""
        for number, area in enumerate(self.areas):
            if area.kind == kind:
                return number, area
        names = {1: "mailbox out", 2: "mailbox in", 3: "outputs", 4: "inputs"}
        raise BusError(f"its SII has no SyncManager for {names[kind]}", self.position)


def scan(access: Access) -> Steps[list[Found]]:
    """All devices in their order; each gets its station address. Raises `BusError`."""
    count = yield from access.count()
    if count > MOST:
        raise BusError(f"{count} devices on the cable, at most {MOST} are known")
    for position in range(count):
        station = struct.pack("<H", FIRST_STATION + position)
        answer = yield from access.one(Command.APWR, -position, 0x0010, station)
        if answer.counter != 1:
            raise BusError("it does not take a station address", position)
    found = []
    for position in range(count):
        found.append((yield from _look(access, position)))
    return found


def _look(access: Access, position: int) -> Steps[Found]:
    station = FIRST_STATION + position
    features = yield from access.word(station, 0x0008)
    links = yield from access.word(station, 0x0110)
    alias = yield from access.word(station, 0x0012)
    vendor, product, revision, serial = struct.unpack(
        "<4I", (yield from access.sii(station, 0x08, 8))
    )
    boxes = struct.unpack("<4H", (yield from access.sii(station, 0x18, 4)))
    categories = yield from _categories(access, station)
    areas = _areas(categories.get(_MANAGERS, b""), boxes)
    return Found(
        position, station, alias, vendor, product, revision, serial,
        name=_name(categories), areas=areas,
        clock=bool(features & _HAS_CLOCK), wide=bool(features & _WIDE),
        ports=tuple(port for port in (0, 3, 1, 2) if links & _LINKED[port]),
    )  # fmt: skip


def _categories(access: Access, station: int) -> Steps[dict[int, bytes]]:
    """The categories that are read here."""
    word, found = 0x40, dict[int, bytes]()
    while word < _LONGEST_SII and len(found) < 3:
        head = yield from access.sii(station, word, 2)
        kind, words = struct.unpack("<HH", head)
        if kind == _END:
            break
        if kind in (_STRINGS, _GENERAL, _MANAGERS):
            found[kind] = yield from access.sii(station, word + 2, words)
        word += 2 + words
    return found


def _areas(category: bytes, boxes: tuple[int, ...]) -> tuple[Area, ...]:
    """SyncManagers; the mailboxes as the SII's head has them, where it has."""
    rows = [struct.unpack_from("<HHBBBB", category, at) for at in range(0, len(category) - 7, 8)]
    areas = [Area(row[0], row[1], row[2], row[5]) for row in rows]
    for number, start, length in ((0, *boxes[:2]), (1, *boxes[2:])):
        if number < len(areas) and length:
            areas[number] = areas[number]._replace(start=start, length=length)
    return tuple(areas)


def _name(categories: dict[int, bytes]) -> str:
    general, strings = categories.get(_GENERAL, b""), categories.get(_STRINGS, b"")
    if len(general) < 4 or not strings:
        return ""
    names, at = [""], 1
    while at < len(strings) and len(names) <= strings[0]:
        size = strings[at]
        names.append(strings[at + 1 : at + 1 + size].decode("ascii", "replace"))
        at += 1 + size
    number = general[3] or general[2]
    return names[number] if number < len(names) else ""
