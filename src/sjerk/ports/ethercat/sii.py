"""The SII (the EEPROM of a subdevice, ETG.2010) from a behaviour and its dictionary.

    words 0000h configuration | 0008h identity | 0014h mailboxes | 003Eh size
    from 0040h categories: 2 type | 2 length in words | data; the end is FFFFh

Never here: the ESI file (`sjerk.ports.ethercat.esi`), registers.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

from sjerk.ports.ethercat.behaviours import Behaviour
from sjerk.ports.ethercat.dictionary import REVISION, VENDOR, Dictionary, pack_word

SIZE = 2048
"""Bytes of the memory."""
_STRINGS, _GENERAL, _FMMU, _SM, _TXPDO, _RXPDO, _DC = 10, 30, 40, 41, 50, 51, 60
_NOBODY = 0xFF


class Area(NamedTuple):
    """One SyncManager as the SII and the ESI file describe it."""

    start: int
    length: int
    control: int
    kind: int
    """1 mailbox out, 2 mailbox in, 3 outputs, 4 inputs."""


def areas(dictionary: Dictionary, behaviour: Behaviour) -> tuple[Area, Area, Area, Area]:
    """The four SyncManagers: mailboxes, outputs and inputs of the default mapping."""
    box = behaviour.mailbox
    outputs = 0x1000 + 2 * box
    inputs = 0x2000 if outputs < 0x1400 else 0x2400  # three buffers of either fit
    return (
        Area(0x1000, box, 0x26, 1),
        Area(0x1000 + box, box, 0x22, 2),
        Area(outputs, dictionary.layout(receive=True).length, 0x64, 3),
        Area(inputs, dictionary.layout(receive=False).length, 0x20, 4),
    )


def sii(dictionary: Dictionary, behaviour: Behaviour, *, serial: int, alias: int = 0) -> bytes:
    """The whole memory, `SIZE` bytes."""
    mailbox_out, mailbox_in, *_ = fields = areas(dictionary, behaviour)
    head = bytearray(0x80)
    struct.pack_into("<HHHHH", head, 0, 0x0005, 0x4403, 0, 0, alias)
    struct.pack_into("<H", head, 14, checksum(head[:14]))
    struct.pack_into("<IIII", head, 16, VENDOR, behaviour.product, REVISION, serial)
    mailboxes = (mailbox_out.start, mailbox_out.length, mailbox_in.start, mailbox_in.length)
    struct.pack_into("<HHHHH", head, 0x30, *mailboxes, 0x0004)
    struct.pack_into("<HH", head, 0x7C, SIZE * 8 // 1024 - 1, 1)
    strings = _Strings()
    general = _general(behaviour, strings)
    managers = b"".join(
        struct.pack("<HHBBBB", area.start, area.length, area.control, 0, 1, area.kind)
        for area in fields
    )
    clocks = _clocks(behaviour, strings)
    sending = _pdos(dictionary, behaviour, strings, receive=False)
    receiving = _pdos(dictionary, behaviour, strings, receive=True)
    parts = (
        bytes(head),
        _category(_STRINGS, strings.pack()),
        _category(_GENERAL, general),
        _category(_FMMU, bytes((1, 2, 3, 0))),
        _category(_SM, managers),
        _category(_TXPDO, sending),
        _category(_RXPDO, receiving),
        _category(_DC, clocks),
    )
    data = b"".join(parts)
    assert len(data) + 2 <= SIZE, "the end FFFFh fits too"
    return data.ljust(SIZE, b"\xff")


def checksum(head: bytes | bytearray) -> int:
    """Of the first 14 bytes: x^8 + x^2 + x + 1, start FFh.

    >>> hex(checksum(bytes(14)))
    '0x30'
    """
    value = 0xFF
    for byte in head:
        value ^= byte
        for _ in range(8):
            value = (value << 1 ^ (0x07 if value & 0x80 else 0)) & 0xFF
    return value


class _Strings:
    """The names of the memory, numbered from 1 in the order of their use."""

    def __init__(self) -> None:
        self._numbers: dict[str, int] = {}

    def number(self, text: str) -> int:
        return self._numbers.setdefault(text, len(self._numbers) + 1)

    def pack(self) -> bytes:
        names = b"".join(bytes((len(text),)) + text.encode("ascii") for text in self._numbers)
        return bytes((len(self._numbers),)) + names


def _category(kind: int, data: bytes) -> bytes:
    data += b"\0" * (len(data) % 2)
    return struct.pack("<HH", kind, len(data) // 2) + data


def _general(behaviour: Behaviour, strings: _Strings) -> bytes:
    name = strings.number(behaviour.name)
    details = 0x03 | 0x04 | 0x08 * behaviour.mapping_writable | 0x20 * behaviour.complete_access
    group = strings.number("Drives")
    # group, image, order, name, CoE details, current of the E-bus, ports (MII)
    return struct.pack("<4Bx B 6x hxx H14x", group, 0, name, name, details, 0, 0x11)


def _pdos(
    dictionary: Dictionary, behaviour: Behaviour, strings: _Strings, *, receive: bool
) -> bytes:
    pdos = behaviour.rx_pdos if receive else behaviour.tx_pdos
    assigned = behaviour.rx_assigned if receive else behaviour.tx_assigned
    data = b""
    for index, words in pdos.items():
        manager = (2 if receive else 3) if index in assigned else _NOBODY
        name = strings.number(f"PDO {index:04X}")
        data += struct.pack("<HBBBBH", index, len(words), manager, 0, name, 0)
        for word in words:
            text = kind = 0
            if word >> 16:
                row = dictionary.row(word >> 16, word >> 8 & 0xFF)
                text, kind = strings.number(dictionary.objects[row.index].name), row.type.code
            data += pack_word(word) + struct.pack("<BBBH", text, kind, word & 0xFF, 0)
    return data


def _clocks(behaviour: Behaviour, strings: _Strings) -> bytes:
    """Operation modes: by the distributed clock, and by outputs where the drive runs so."""
    modes = [("DC", behaviour.assign_activate)]
    if not behaviour.dc_required:
        modes.append(("SM", 0))
    return b"".join(
        # SYNC0 cycle, shift, SYNC1 shift, its factor, AssignActivate, SYNC0 factor, name
        struct.pack(
            "<IIIhHhB5x",
            behaviour.sync0_ns if activate else 0, 0, 0, int(bool(activate & 0x0400)), activate,
            int(bool(activate) and not behaviour.sync0_ns), strings.number(name),
        )
        for name, activate in modes
    )  # fmt: skip
