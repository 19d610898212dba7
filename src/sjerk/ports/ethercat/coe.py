"""CoE: SDO, SDO information and emergencies in mails (ETG.1000.6, 5.6).

    mail:  2 length | 2 address | 1 channel | 1 protocol, counter << 4 | data
    CoE:   2 service << 12 | data
    SDO:   1 command | 2 index | 1 sub-index | 4 data or size | data

`CoeServer.answer` is one mail in, the mails of the answer out. Transfers of more than a mail holds
go in segments, one at a time. Counter and queue are the subdevice's.

Never here: what an object means, registers.
"""

from __future__ import annotations

import enum
import struct
from typing import NamedTuple

from sjerk.drive.entries import Abort, SdoError, Type
from sjerk.ports.ethercat.dictionary import Dictionary

HEADER = 6
"""Bytes of the header of a mail."""
LONGEST = 4096
"""Most bytes of one download."""
ERROR, COE = 0, 3
"""Protocols: mailbox error, CoE."""
EMERGENCY, REQUEST, RESPONSE, INFORMATION = 1, 2, 3, 8
"""Services of CoE."""
_SDO_HEADER = 10  # CoE header, command, index, sub-index, size
_SEGMENT_HEADER = 3
_INFO_HEADER = 6
_READ, _WRITE = 0x07, 0x38
_WRITE_PREOP = 0x08


class MailError(enum.IntEnum):
    """Why a mail was not understood (ETG.1000.4, mailbox error reply)."""

    PROTOCOL = 0x0002
    """No such protocol here."""
    SERVICE = 0x0004
    """No such service in it."""
    SIZE = 0x0008
    """The length is wrong."""


class Mail(NamedTuple):
    """A mail to send: protocol and data; the subdevice adds address and counter."""

    protocol: int
    data: bytes


class _Upload(NamedTuple):
    rest: bytes
    toggle: int


class _Download(NamedTuple):
    data: bytes
    size: int
    toggle: int
    complete: bool


class CoeServer:
    """The server of one subdevice."""

    def __init__(self, dictionary: Dictionary, *, mailbox: int) -> None:
        """Serve a dictionary through mailboxes of so many bytes."""
        self._dictionary = dictionary
        self._room = mailbox - HEADER
        self._place = (0, 0)
        self._up: _Upload | None = None
        self._down: _Download | None = None

    def answer(self, mail: bytes) -> list[Mail]:
        """The answer to a mail of the main device."""
        length, _, _, kind = struct.unpack_from("<HHBB", mail)
        if length > self._room or length < 2:
            return [_fault(MailError.SIZE)]
        if kind & 0x0F != COE:
            return [_fault(MailError.PROTOCOL)]
        data = mail[HEADER : HEADER + length]
        service, body = struct.unpack_from("<H", data)[0] >> 12, data[2:]
        if service == REQUEST:
            return self._sdo(body) if len(body) >= 1 else [_fault(MailError.SIZE)]
        if service == INFORMATION:
            return self._information(body)
        return [_fault(MailError.SERVICE)]

    @staticmethod
    def emergency(code: int, register: int) -> Mail:
        """603Fh and 1001h as an emergency message; code 0: the error is gone."""
        return _mail(EMERGENCY, struct.pack("<HB5x", code, register))

    # ---- SDO ----

    def _sdo(self, body: bytes) -> list[Mail]:
        command = body[0] >> 5
        if command in (1, 2):
            if len(body) < 8:
                return [_fault(MailError.SIZE)]
            self._up = self._down = None
            self._place = struct.unpack_from("<HB", body, 1)
        try:
            match command:
                case 0:
                    return self._take_segment(body)
                case 1:
                    return self._begin_download(body)
                case 2:
                    return self._begin_upload(bool(body[0] & 0x10))
                case 3:
                    return self._give_segment(body[0] >> 4 & 1)
                case 4:
                    self._up = self._down = None
                    return []
                case _:
                    return [self._abort(Abort.COMMAND)]
        except SdoError as error:
            return [self._abort(error.abort)]

    def _abort(self, abort: Abort) -> Mail:
        self._up = self._down = None
        return _mail(REQUEST, struct.pack("<BHBI", 0x80, *self._place, int(abort)))

    def _begin_upload(self, complete: bool) -> list[Mail]:
        dictionary, place = self._dictionary, self._place
        data = dictionary.upload_all(*place) if complete else dictionary.upload(*place)
        if 1 <= len(data) <= 4 and not complete:
            head = struct.pack("<BHB", 0x43 | (4 - len(data)) << 2, *place)
            return [_mail(RESPONSE, head + data.ljust(4, b"\0"))]
        head = struct.pack("<BHBI", 0x41 | 0x10 * complete, *place, len(data))
        room = self._room - _SDO_HEADER
        if len(data) > room:
            self._up = _Upload(data[room:], 0)
        return [_mail(RESPONSE, head + data[:room])]

    def _give_segment(self, toggle: int) -> list[Mail]:
        if self._up is None:
            return [self._abort(Abort.COMMAND)]
        if toggle != self._up.toggle:
            return [self._abort(Abort.TOGGLE)]
        room = self._room - _SEGMENT_HEADER
        part, rest = self._up.rest[:room], self._up.rest[room:]
        self._up = _Upload(rest, toggle ^ 1) if rest else None
        unused = max(0, 7 - len(part))
        first = toggle << 4 | unused << 1 | (not rest)
        return [_mail(RESPONSE, bytes((first,)) + part.ljust(7, b"\0"))]

    def _begin_download(self, body: bytes) -> list[Mail]:
        complete, index, sub = bool(body[0] & 0x10), *self._place
        if body[0] & 2:
            row = self._dictionary.row(index, sub)
            sized = 4 - (body[0] >> 2 & 3)
            self._store(body[4 : 4 + (sized if body[0] & 1 else row.type.size)], complete)
            return self._stored(complete)
        size = struct.unpack_from("<I", body, 4)[0]
        if size > LONGEST:
            raise SdoError(Abort.TOO_LONG, index, sub)
        data = body[8 : 8 + size]
        if len(data) < size:
            if self._dictionary.row(index, sub).access == "ro" and not complete:
                raise SdoError(Abort.READ_ONLY, index, sub)
            self._down = _Download(data, size, 0, complete)
        else:
            self._store(data, complete)
        return self._stored(complete)

    def _stored(self, complete: bool) -> list[Mail]:
        return [_mail(RESPONSE, struct.pack("<BHBI", 0x60 | 0x10 * complete, *self._place, 0))]

    def _take_segment(self, body: bytes) -> list[Mail]:
        down = self._down
        if down is None:
            return [self._abort(Abort.COMMAND)]
        toggle = body[0] >> 4 & 1
        if toggle != down.toggle:
            return [self._abort(Abort.TOGGLE)]
        part = body[1:]
        if len(part) <= 7:
            part = part[: 7 - (body[0] >> 1 & 7)]
        data = down.data + part
        if len(data) > down.size:
            return [self._abort(Abort.TOO_LONG)]
        self._down = down._replace(data=data, toggle=toggle ^ 1)
        if body[0] & 1:
            self._down = None
            if len(data) < down.size:
                return [self._abort(Abort.TOO_SHORT)]
            self._store(data, down.complete)
        return [_mail(RESPONSE, bytes((0x20 | toggle << 4,)) + bytes(7))]

    def _store(self, data: bytes, complete: bool) -> None:
        if complete:
            self._dictionary.download_all(*self._place, data)
        else:
            self._dictionary.download(*self._place, data)

    # ---- SDO information ----

    def _information(self, body: bytes) -> list[Mail]:
        wanted = {1: 6, 3: 6, 5: 8}.get(body[0] & 0x7F if body else 0)
        if wanted is None:
            return [_information_abort(Abort.COMMAND)]
        if len(body) < wanted:
            return [_fault(MailError.SIZE)]
        number = struct.unpack_from("<H", body, 4)[0]
        try:
            match body[0] & 0x7F:
                case 1:
                    return self._fragments(2, self._list(number))
                case 3:
                    return self._fragments(4, self._describe(number))
                case _:
                    return self._fragments(6, self._describe_entry(number, body[6], body[7]))
        except SdoError as error:
            return [_information_abort(error.abort)]

    def _fragments(self, opcode: int, data: bytes) -> list[Mail]:
        room = self._room - _INFO_HEADER
        parts = [data[at : at + room] for at in range(0, len(data), room)]
        return [
            _mail(INFORMATION, struct.pack("<BBH", opcode | 0x80 * (left > 0), 0, left) + part)
            for left, part in zip(range(len(parts) - 1, -1, -1), parts, strict=True)
        ]

    def _list(self, kind: int) -> bytes:
        """Object lists: 0 their lengths, 1 all, 2 to receive, 3 to send, 4 to store, 5 to start."""
        objects = self._dictionary.objects
        lists = {
            1: list(objects),
            2: [i for i, thing in objects.items() if any("R" in row.pdo for row in thing.entries)],
            3: [i for i, thing in objects.items() if any("T" in row.pdo for row in thing.entries)],
            4: [i for i, t in objects.items() if any(r.access != "ro" for r in t.entries)],
            5: [],
        }
        if kind == 0:
            return struct.pack("<6H", 0, *(len(lists[number]) for number in range(1, 6)))
        if kind not in lists:
            raise SdoError(Abort.RANGE, kind, 0)
        return struct.pack(f"<{1 + len(lists[kind])}H", kind, *lists[kind])

    def _describe(self, index: int) -> bytes:
        self._dictionary.row(index, 0)
        thing = self._dictionary.objects[index]
        kind = 0 if thing.code == 9 else thing.entries[-1].type.code
        head = struct.pack("<HHBB", index, kind, thing.entries[-1].sub, thing.code)
        return head + thing.name.encode("ascii")

    def _describe_entry(self, index: int, sub: int, wanted: int) -> bytes:
        """A hole below the highest sub-index is an empty entry: who walks the list goes on."""
        try:
            row = self._dictionary.row(index, sub)
        except SdoError as error:
            if error.abort is not Abort.NO_SUBINDEX or sub > self._highest(index):
                raise
            return struct.pack("<HBBHHH", index, sub, 0, 0, 0, 0)
        bits = row.bits
        if row.type is Type.VISIBLE_STRING:
            bits = 8 * len(self._dictionary.upload(index, sub))
        access = _READ | {"ro": 0, "preop": _WRITE_PREOP}.get(row.access, _WRITE)
        access |= 0x40 * ("R" in row.pdo) | 0x80 * ("T" in row.pdo)
        head = struct.pack("<HBBHHH", index, sub, wanted & 7, row.type.code, bits, access)
        return head + row.name.encode("ascii")

    def _highest(self, index: int) -> int:
        return self._dictionary.objects[index].entries[-1].sub


def _mail(service: int, body: bytes) -> Mail:
    return Mail(COE, struct.pack("<H", service << 12) + body)


def _fault(error: MailError) -> Mail:
    return Mail(ERROR, struct.pack("<HH", 1, error))


def _information_abort(abort: Abort) -> Mail:
    return _mail(INFORMATION, struct.pack("<BBHI", 7, 0, 0, int(abort)))
