"""One drive set up: from Init to Safe-operational, with its mapping, its start-up objects, SYNC0.

The order is that which drives want: clocks are set before, SYNC0 runs before Safe-operational is
asked for, 1C32h is not written (most drives decide it from SYNC0). A step that a drive refuses is a
`BusError` with device, object and code.

Never here: the cycle, frames, several drives at once.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

from sjerk.errors import InputError
from sjerk.ports.ethercat.access import Access, BusError, Steps
from sjerk.ports.ethercat.clocks import Clocks
from sjerk.ports.ethercat.mailbox import AbortError, Mailbox
from sjerk.ports.ethercat.scanning import Found
from sjerk.ports.ethercat.servo import RX_OFFSETS, TX_OFFSETS
from sjerk.ports.ethercat.settings import DriveSettings, Word
from sjerk.ports.ethercat.states import AlState

#: Objects of the cycle by the words of the kernel's image.
OUT = {
    0x6040: "controlword", 0x6060: "mode", 0x607A: "target_position", 0x60B0: "position_offset",
    0x60B1: "velocity_offset", 0x60B2: "torque_offset",
}  # fmt: skip
IN = {
    0x6041: "statusword", 0x6061: "mode_display", 0x6064: "position_actual",
    0x606C: "velocity_actual", 0x6077: "torque_actual", 0x603F: "error_code",
    0x60F4: "following_error", 0x60FD: "digital_inputs",
}  # fmt: skip
_NEEDED = {True: (0x6040, 0x607A), False: (0x6041, 0x6064)}
_NO_OBJECT, _NO_SUB = 0x06020000, 0x06090011
_CSP = 8
_SM, _FMMU = 0x0800, 0x0600


@dataclass
class Layout:
    """Process data of one direction."""

    length: int = 0
    """Bytes."""
    words: list[tuple[int, int, int]] = field(default_factory=list)
    """Bit, number of bits, offset in the kernel's image."""


@dataclass
class Commissioned:
    """A drive as it was set up, so that it can be set up again."""

    found: Found
    settings: DriveSettings
    axis: int
    logical: int = 0
    mailbox: Mailbox | None = None
    outputs: Layout = field(default_factory=Layout)
    inputs: Layout = field(default_factory=Layout)


def layout_of(words: list[Word], *, receive: bool, device: int) -> Layout:
    """Where the mapped words are; raises `BusError` where one that is needed is missing."""
    names, offsets = (OUT, RX_OFFSETS) if receive else (IN, TX_OFFSETS)
    layout, bit = Layout(), 0
    for word in words:
        if word.sub == 0 and word.index in names:
            layout.words.append((bit, word.bits, offsets[names[word.index]]))
        bit += word.bits
    layout.length = (bit + 7) // 8
    mapped = {word.index for word in words}
    for index in _NEEDED[receive]:
        if index not in mapped:
            way = "receive" if receive else "transmit"
            raise BusError(f"{index:04X}h is not mapped: {way} needs it", device)
    return layout


def to_preop(access: Access, found: Found) -> Steps[Mailbox]:
    """From anywhere to Pre-operational, with mailboxes."""
    station = found.station
    yield from access.request(station, AlState.INIT)
    yield from access.write(station, _FMMU, bytes(16 * 8))
    for number in range(4):  # first off, then anew
        yield from access.write(station, _SM + 8 * number + 6, b"\0")
    boxes = []
    for kind in (1, 2):
        number, area = found.area(kind)
        row = struct.pack("<HHBBBB", area.start, area.length, area.control, 0, 1, 0)
        yield from access.write(station, _SM + 8 * number, row)
        boxes.append((area.start, area.length))
    yield from access.request(station, AlState.PREOP)
    return Mailbox(access, station, *boxes)


def set_up(access: Access, drive: Commissioned, cycle_ns: int) -> Steps[None]:
    """In Pre-operational: start-up objects, mode, cycle, mapping."""
    settings, found = drive.settings, drive.found
    drive.mailbox = mailbox = yield from to_preop(access, found)
    for row in settings.startup:
        yield from mailbox.download(row.index, row.sub, row.data)
    drive.outputs = yield from _map(mailbox, drive, receive=True)
    drive.inputs = yield from _map(mailbox, drive, receive=False)
    yield from _if_there(mailbox, 0x6060, 0, struct.pack("<b", _CSP))
    value, power = interval(cycle_ns)
    yield from _if_there(mailbox, 0x60C2, 1, struct.pack("<B", value))
    yield from _if_there(mailbox, 0x60C2, 2, struct.pack("<b", power))


def _if_there(mailbox: Mailbox, index: int, sub: int, data: bytes) -> Steps[None]:
    try:
        yield from mailbox.download(index, sub, data)
    except AbortError as error:
        if error.code not in (_NO_OBJECT, _NO_SUB):
            raise


def _map(mailbox: Mailbox, drive: Commissioned, *, receive: bool) -> Steps[Layout]:
    """Assign and fill the PDOs of one direction, or read those that there are."""
    settings, device = drive.settings, drive.found.position
    assignment = 0x1C12 if receive else 0x1C13
    words = settings.receive if receive else settings.transmit
    pdos = settings.rx_pdos if receive else settings.tx_pdos
    if words:
        pdo = settings.rx_pdo if receive else settings.tx_pdo
        yield from mailbox.download(assignment, 0, b"\0")
        yield from mailbox.download(pdo, 0, b"\0")
        for number, word in enumerate(words, 1):
            yield from mailbox.download(pdo, number, struct.pack("<I", word.pack()))
        yield from mailbox.download(pdo, 0, bytes((len(words),)))
        pdos = (pdo,)
    if pdos:
        yield from mailbox.download(assignment, 0, b"\0")
        for number, pdo in enumerate(pdos, 1):
            yield from mailbox.download(assignment, number, struct.pack("<H", pdo))
        yield from mailbox.download(assignment, 0, bytes((len(pdos),)))
    mapped = yield from mapped_words(mailbox, assignment)
    return layout_of(mapped, receive=receive, device=device)


def mapped_words(mailbox: Mailbox, assignment: int) -> Steps[list[Word]]:
    """What the PDOs hold that 1C12h or 1C13h names."""
    words = []
    count = yield from mailbox.upload(assignment, 0)
    for number in range(1, count[0] + 1):
        pdo = int.from_bytes((yield from mailbox.upload(assignment, number)), "little")
        entries = yield from mailbox.upload(pdo, 0)
        for sub in range(1, entries[0] + 1):
            value = yield from mailbox.upload(pdo, sub)
            words.append(Word.unpack(int.from_bytes(value, "little")))
    return words


def to_safeop(access: Access, drive: Commissioned, clocks: Clocks, cycle_ns: int) -> Steps[None]:
    """SyncManagers and FMMUs of the process data, SYNC0, Safe-operational."""
    found, station = drive.found, drive.found.station
    rows = ((3, drive.outputs.length, 2), (4, drive.inputs.length, 1))
    for number, (kind, length, way) in enumerate(rows):
        manager, area = found.area(kind)
        row = struct.pack("<HHBBBB", area.start, length, area.control, 0, 1, 0)
        yield from access.write(station, _SM + 8 * manager + 6, b"\0")
        yield from access.write(station, _SM + 8 * manager, row)
        fmmu = struct.pack("<IHBBHBBB", drive.logical, length, 0, 7, area.start, 0, way, 1)
        yield from access.write(station, _FMMU + 16 * number, fmmu)
    if drive.settings.activate:
        if not found.clock:
            raise BusError("it has no distributed clock: activate = 0", found.position)
        sync0 = round(drive.settings.sync0_us * 1e3)
        yield from clocks.start_sync(found, drive.settings.activate, cycle_ns, sync0)
    yield from access.request(station, AlState.SAFEOP)


def interval(cycle_ns: int) -> tuple[int, int]:
    """60C2h of a cycle; raises `InputError` for one that it cannot hold.

    >>> interval(250_000)
    (25, -5)
    """
    for power in (-3, -4, -5, -6):
        unit = 10 ** (9 + power)
        if cycle_ns % unit == 0 and 1 <= cycle_ns // unit <= 255:
            return cycle_ns // unit, power
    raise InputError("cycle_time", cycle_ns * 1e-9, "60C2h holds 1 .. 255 of 1e-6 .. 1e-3 s")
