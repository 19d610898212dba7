"""The object dictionary of a drive as CoE (ETG.1000.6) has it.

Two parts: the drive's objects, shared with every other wire, and those that only EtherCAT knows:
identity, PDO mapping 16xxh and 1Axxh, PDO assignment 1C12h and 1C13h, SyncManagers 1C00h,
synchronisation 1C32h and 1C33h. Mapping and assignment can be changed in Pre-operational:
sub-index 0 to zero, the words, sub-index 0 to their number. `Dictionary.layout` tells what the
process data are.

Never here: mails, SyncManager registers.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from typing import NamedTuple

from sjerk.drive.entries import Abort, Object, ObjectEntry, SdoError, Type
from sjerk.drive.objects import DUMMIES, OBJECTS
from sjerk.ports.ethercat.behaviours import Behaviour, Words
from sjerk.ports.ethercat.servo import WireDevice

VENDOR, REVISION = 0x5E4B, 1
"""Vendor id (of the simulation only: it is not assigned to anybody) and revision."""
RX_ASSIGNMENT, TX_ASSIGNMENT = 0x1C12, 0x1C13
_CANOPEN_ONLY = {
    0x1005, 0x1006, 0x1014, 0x1016, 0x1017,
    *(base + n for base in (0x1400, 0x1600, 0x1800, 0x1A00) for n in range(4)),
}  # fmt: skip
_NAME = "Manufacturer device name"
_ASSIGNED = 8
"""Most PDOs of one direction at once."""

U8, U16, U32, TEXT = Type.UNSIGNED8, Type.UNSIGNED16, Type.UNSIGNED32, Type.VISIBLE_STRING


class Mapped(NamedTuple):
    """An object in the process data."""

    row: ObjectEntry
    bit: int


class Layout(NamedTuple):
    """The process data of one direction."""

    words: tuple[Mapped, ...]
    length: int
    """Bytes."""


class Dictionary:
    """Every object of the subdevice by SDO, with the abort codes of CiA 301.

    Values live in the drive's device or, for the objects of EtherCAT, here. `preop` says whether
    the subdevice is in Pre-operational, where mappings may change.
    """

    def __init__(self, device: WireDevice, behaviour: Behaviour, *, serial: int) -> None:
        """Power-on values."""
        self.preop = False
        self._device = device
        self._behaviour = behaviour
        self._values: dict[tuple[int, int], int | str] = {}
        own = _own(behaviour, serial)
        self._own = {thing.index for thing in own}
        things = [thing for index, thing in OBJECTS.items() if index not in _CANOPEN_ONLY]
        named = {thing.index: thing for thing in (*things, *own)}
        self.objects: dict[int, Object] = dict(sorted(named.items()))
        """Every object by its index."""
        self._rows = {
            (row.index, row.sub): row for thing in self.objects.values() for row in thing.entries
        }
        self.power_up()

    def power_up(self) -> None:
        """Power-on values of the objects of EtherCAT."""
        self._values = {
            (row.index, row.sub): row.default  # type: ignore[misc]
            for index in self._own
            for row in self.objects[index].entries
        }

    # ---- SDO ----

    def row(self, index: int, sub: int) -> ObjectEntry:
        """The row of an object; `SdoError` when there is none."""
        if index not in self.objects:
            raise SdoError(Abort.NO_OBJECT, index, sub)
        if (index, sub) not in self._rows:
            raise SdoError(Abort.NO_SUBINDEX, index, sub)
        return self._rows[index, sub]

    def upload(self, index: int, sub: int) -> bytes:
        """The bytes of an object."""
        row = self.row(index, sub)
        if index in self._own:
            return row.type.pack(self._values[index, sub])
        self._device.pull()
        return self._device.upload(index, sub)

    def download(self, index: int, sub: int, data: bytes) -> None:
        """Write an object."""
        row = self.row(index, sub)
        if index not in self._own:
            self._device.pull()
            try:
                self._device.download(index, sub, data)
            finally:
                self._device.push()
            return
        if row.access == "ro":
            raise SdoError(Abort.READ_ONLY, index, sub)
        if len(data) != row.type.size:
            too_long = len(data) > row.type.size
            raise SdoError(Abort.TOO_LONG if too_long else Abort.TOO_SHORT, index, sub)
        value = int.from_bytes(data, "little")
        if row.access == "preop":
            self._map(row, value)
        elif sub == 1:  # 1C32h, 1C33h: how the periods begin
            if value not in self._behaviour.sync_types:
                raise SdoError(Abort.RANGE, index, sub)
            self.set(0x1C32, 1, value)
            self.set(0x1C33, 1, value)
        else:
            self.set(index, sub, value)

    def upload_all(self, index: int, first: int) -> bytes:
        """Complete access from sub-index `first` (0 or 1) on; sub-index 0 takes 16 bits."""
        parts = [self._padded(row) for row in self._complete(index, first)]
        return b"".join(parts)

    def download_all(self, index: int, first: int, data: bytes) -> None:
        """Complete access: every entry in its order; mapping and assignment all or nothing."""
        rows = self._complete(index, first, count=None)
        parts: list[tuple[ObjectEntry, bytes]] = []
        at = 0
        for row in rows:
            if at == len(data):
                break
            size = max(2, row.type.size) if row.sub == 0 else row.type.size
            if at + size > len(data):
                raise SdoError(Abort.TOO_SHORT, index, row.sub)
            parts.append((row, data[at : at + row.type.size]))
            at += size
        if at < len(data):
            raise SdoError(Abort.TOO_LONG, index, first)
        if rows and rows[0].access == "preop":
            self._map_all(index, parts)
            return
        for row, part in parts:
            if row.sub or row.access != "ro":
                self.download(index, row.sub, part)

    def set(self, index: int, sub: int, value: int) -> None:
        """Give an object of EtherCAT a value, whatever its access."""
        self._values[index, sub] = value

    def value(self, index: int, sub: int) -> int:
        """An object of EtherCAT as a number."""
        return int(self._values[index, sub])

    def _complete(self, index: int, first: int, count: int | None = -1) -> list[ObjectEntry]:
        self.row(index, 0)
        entries = self.objects[index].entries
        if len(entries) == 1 or first > 1 or not self._behaviour.complete_access:
            raise SdoError(Abort.UNSUPPORTED_ACCESS, index, first)
        if count is not None and entries[0].access == "preop":
            count = self.value(index, 0)
            return [row for row in entries if first <= row.sub <= count]
        return [row for row in entries if row.sub >= first]

    def _padded(self, row: ObjectEntry) -> bytes:
        data = self.upload(row.index, row.sub)
        return data.ljust(2, b"\0") if row.sub == 0 else data

    # ---- PDOs ----

    def layout(self, *, receive: bool) -> Layout:
        """What the process data carry by 1C12h or 1C13h; `SdoError` when they cannot."""
        assignment = RX_ASSIGNMENT if receive else TX_ASSIGNMENT
        found: list[Mapped] = []
        bit = 0
        for number in range(1, self.value(assignment, 0) + 1):
            pdo = self.value(assignment, number)
            self._check_pdo(pdo, receive, assignment, number)
            for sub in range(1, self.value(pdo, 0) + 1):
                word = self.value(pdo, sub)
                row = self._mapped(word, receive, (pdo, sub))
                if row is not None:
                    found.append(Mapped(row, bit))
                bit += word & 0xFF
        length = (bit + 7) // 8
        if length > (self._behaviour.rx_bytes if receive else self._behaviour.tx_bytes):
            raise SdoError(Abort.PDO_LENGTH, assignment, 0)
        return Layout(tuple(found), length)

    def _pdos(self, receive: bool) -> Iterable[int]:
        return self._behaviour.rx_pdos if receive else self._behaviour.tx_pdos

    def _check_pdo(self, pdo: int, receive: bool, index: int, sub: int) -> None:
        if pdo not in self._pdos(receive):
            raise SdoError(Abort.RANGE, index, sub)

    def _mapped(self, word: int, receive: bool, where: tuple[int, int]) -> ObjectEntry | None:
        """The row that a mapping word names, None for padding; `SdoError` at `where`."""
        index, sub, bits = word >> 16, word >> 8 & 0xFF, word & 0xFF
        if index == 0 or index in DUMMIES:
            if bits == 0 or sub or (index and bits != DUMMIES[index]):
                raise SdoError(Abort.NOT_MAPPABLE, *where)
            return None
        try:
            row = self.row(index, sub)
        except SdoError as error:
            raise SdoError(Abort.NO_OBJECT, *where) from error
        if ("R" if receive else "T") not in row.pdo or bits != row.bits:
            raise SdoError(Abort.NOT_MAPPABLE, *where)
        return row

    def _map(self, row: ObjectEntry, value: int) -> None:
        """One write to a mapping or an assignment."""
        index, sub = row.index, row.sub
        if not self.preop:
            raise SdoError(Abort.DEVICE_STATE, index, sub)
        if sub == 0:
            self._close(index, value)
            return
        same = self._behaviour.equal_write and value == self.value(index, sub)
        if self.value(index, 0) and not same:
            raise SdoError(Abort.DEVICE_STATE, index, sub)
        self._check_word(index, sub, value)
        self.set(index, sub, value)

    def _check_word(self, index: int, sub: int, value: int) -> None:
        if value == 0:
            return
        if index in (RX_ASSIGNMENT, TX_ASSIGNMENT):
            self._check_pdo(value, index == RX_ASSIGNMENT, index, sub)
        else:
            self._mapped(value, index < 0x1A00, (index, sub))

    def _close(self, index: int, count: int) -> None:
        """Sub-index 0: so many words count from now on."""
        limit = _ASSIGNED if index in (RX_ASSIGNMENT, TX_ASSIGNMENT) else self._behaviour.entries
        if count > limit:
            raise SdoError(Abort.PDO_LENGTH, index, 0)
        words = [self.value(index, sub) for sub in range(1, count + 1)]
        receive = index < 0x1A00 or index == RX_ASSIGNMENT
        for sub, word in enumerate(words, 1):
            if word == 0:
                raise SdoError(Abort.NOT_MAPPABLE, index, 0)
            self._check_word(index, sub, word)
        if index in (RX_ASSIGNMENT, TX_ASSIGNMENT):
            if len(set(words)) < len(words):
                raise SdoError(Abort.NOT_MAPPABLE, index, 0)
        elif sum(word & 0xFF for word in words) > 8 * (
            self._behaviour.rx_bytes if receive else self._behaviour.tx_bytes
        ):
            raise SdoError(Abort.PDO_LENGTH, index, 0)
        self.set(index, 0, count)

    def _map_all(self, index: int, parts: list[tuple[ObjectEntry, bytes]]) -> None:
        before = dict(self._values)
        count = self.value(index, 0)
        try:
            self._map(self.row(index, 0), 0)
            for row, part in parts:
                value = int.from_bytes(part, "little")
                if row.sub == 0:
                    count = value
                else:
                    self._map(row, value)
            self._map(self.row(index, 0), count)
        except SdoError:
            self._values = before
            raise


def _own(behaviour: Behaviour, serial: int) -> list[Object]:
    """The objects that only EtherCAT has, and those whose values it gives."""
    cycle = "rw" if behaviour.cycle_writable else "ro"
    things = [
        Object(0x1008, _NAME, (ObjectEntry(0x1008, 0, _NAME, TEXT, "ro", "", behaviour.name),), 7),
        _record(0x1018, "Identity", {
            1: ("Vendor", U32, "ro", VENDOR), 2: ("Product", U32, "ro", behaviour.product),
            3: ("Revision", U32, "ro", REVISION), 4: ("Serial number", U32, "ro", serial)}),
        _record(0x1C00, "SyncManager types", {
            n: (f"SyncManager {n - 1}", U8, "ro", n) for n in range(1, 5)}, code=8),
    ]  # fmt: skip
    access = "preop" if behaviour.mapping_writable else "ro"
    for side, pdos in (("Receive", behaviour.rx_pdos), ("Transmit", behaviour.tx_pdos)):
        things += [
            _counted(index, f"{side} PDO mapping", words, U32, behaviour.entries, access)
            for index, words in pdos.items()
        ]
    for index, side, assigned in (
        (RX_ASSIGNMENT, "Receive", behaviour.rx_assigned),
        (TX_ASSIGNMENT, "Transmit", behaviour.tx_assigned),
    ):
        things.append(_counted(index, f"{side} PDO assignment", assigned, U16, _ASSIGNED, "preop"))
    modes = sum({0: 1, 1: 2, 2: 4, 3: 8}[kind] for kind in behaviour.sync_types)
    kind = "rw" if len(behaviour.sync_types) > 1 else "ro"
    for index, side in ((0x1C32, "Output"), (0x1C33, "Input")):
        things.append(
            _record(index, f"{side} synchronisation", {
                1: ("Type", U16, kind, behaviour.sync_type),
                2: ("Cycle time", U32, cycle, 1_000_000),
                3: ("Shift time", U32, cycle, 0),
                4: ("Types supported", U16, "ro", modes),
                5: ("Minimum cycle time", U32, "ro", behaviour.cycle_least_ns),
                6: ("Calculation and copy time", U32, "ro", 20_000),
                9: ("Delay time", U32, "ro", 0),
                10: ("SYNC0 cycle time", U32, "ro", behaviour.sync0_ns),
                11: ("Events missed", U16, "ro", 0),
                12: ("Cycle too small", U16, "ro", 0),
                32: ("Synchronisation error", U8, "ro", 0)})
        )  # fmt: skip
    return things


def _record(
    index: int, name: str, rows: dict[int, tuple[str, Type, str, int]], code: int = 9
) -> Object:
    head = ObjectEntry(index, 0, "Highest sub-index", U8, "ro", "", max(rows))
    subs = (ObjectEntry(index, sub, n, t, a, "", value) for sub, (n, t, a, value) in rows.items())
    return Object(index, name, (head, *subs), code)


def _counted(index: int, name: str, words: Words, type_: Type, most: int, access: str) -> Object:
    """An array whose sub-index 0 says how many of its words count."""
    head = ObjectEntry(index, 0, "Number", U8, access, "", len(words))
    values = (*words, *(0 for _ in range(most - len(words))))
    subs = (
        ObjectEntry(index, sub, f"Word {sub}", type_, access, "", value)
        for sub, value in enumerate(values, 1)
    )
    return Object(index, name, (head, *subs), 9)


def pack_word(word: int) -> bytes:
    """A mapping word as the SII's PDO entries begin: index and sub-index.

    >>> pack_word(0x607A0020).hex()
    '7a6000'
    """
    return struct.pack("<HB", word >> 16, word >> 8 & 0xFF)
