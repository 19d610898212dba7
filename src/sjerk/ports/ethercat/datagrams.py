"""EtherCAT frames of requests: datagrams composed, and their answers taken apart.

    14 Ethernet | 2 length, type 1 | datagrams: 10 header, n data, 2 working counter

Indices 40h to 7Fh are those of requests here; those of the cyclic frames lie above, those of other
programs on the same interface usually below. Never here: sockets, what a register means.
"""

from __future__ import annotations

import enum
import struct
from collections.abc import Sequence
from typing import NamedTuple

FIRST_INDEX, INDICES = 0x40, 0x40
LONGEST_DATA = 1486
_HEADER, _FIRST, _MORE = 10, 16, 0x8000
_ETHERNET = b"\xff" * 6 + b"\x10" * 6 + b"\x88\xa4"


class Command(enum.IntEnum):
    """What a datagram does at a device."""

    APRD = 1
    """Read at a position."""
    APWR = 2
    """Write at a position."""
    FPRD = 4
    """Read at a station address."""
    FPWR = 5
    """Write at a station address."""
    BRD = 7
    """Read at all devices, joined by or."""
    BWR = 8
    """Write at all devices."""
    FRMW = 14
    """Read at a station address, write at all behind it."""


class Datagram(NamedTuple):
    """A request: command, device, register, data (of a read: as many bytes)."""

    command: Command
    address: int
    offset: int
    data: bytes


class Answer(NamedTuple):
    """What became of a datagram: its data and its working counter."""

    data: bytes
    counter: int


def compose(datagrams: Sequence[Datagram], index: int) -> bytes:
    """The frame of some datagrams.

    >>> compose([Datagram(Command.BRD, 0, 0x130, bytes(2))], 0x40)[14:30].hex(" ")
    '0e 10 07 40 00 00 30 01 02 00 00 00 00 00 00 00'
    """
    body = b""
    for number, (command, address, offset, data) in enumerate(datagrams):
        size = len(data) | (_MORE if number < len(datagrams) - 1 else 0)
        body += struct.pack("<BBHHHH", command, index, address & 0xFFFF, offset, size, 0)
        body += data + b"\0\0"
    return (_ETHERNET + struct.pack("<H", len(body) | 0x1000) + body).ljust(60, b"\0")


def take_apart(frame: bytes, sent: bytes) -> list[Answer] | None:
    """The answers in a frame; None where it is not what became of the frame that was sent."""
    if len(frame) < len(sent) or frame[12:16] != sent[12:16] or not frame[6] & 2:
        return None
    answers, at, more = [], _FIRST, True
    while more:
        if (
            frame[at : at + 2] != sent[at : at + 2]
            or frame[at + 4 : at + 8] != sent[at + 4 : at + 8]
        ):
            return None
        size = struct.unpack_from("<H", sent, at + 6)[0]
        length, more = size & 0x7FF, bool(size & _MORE)
        end = at + _HEADER + length
        answers.append(Answer(frame[at + _HEADER : end], struct.unpack_from("<H", frame, end)[0]))
        at = end + 2
    return answers
