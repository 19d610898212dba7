"""The main device's side of CoE: mails to a device, SDO of any length, both ways (ETG.1000.6, 5.6).

A mail whose answer is lost on its way is asked for again by the repeat bit (080Eh bit 1), so that a
lost frame loses no transfer. Never here: what an object means, the device's side (`coe`).
"""

from __future__ import annotations

import struct

from sjerk.ports.ethercat.access import MS, Access, BusError, Steps, position_of
from sjerk.ports.ethercat.datagrams import Command, Datagram

_COE, _SDO_REQUEST, _SDO_RESPONSE, _EMERGENCY, _ABORT = 3, 2, 3, 1, 0x80
_PATIENCE_NS = 1_000 * MS
_TRIES = 20
_SM0_STATUS, _SM1_STATUS, _SM1_ACTIVATE, _FULL, _REPEAT = 0x0805, 0x080D, 0x080E, 0x08, 0x02
_ANSWERS, _SEGMENTS = {0: 1, 1: 3, 2: 2, 3: 0}, (0, 3)  # commands: download, upload, segments
_ABORTS = {
    0x05030000: "toggle bit", 0x05040000: "time-out", 0x05040001: "unknown command",
    0x06010000: "access is not supported", 0x06010001: "write only", 0x06010002: "read only",
    0x06010003: "sub-index 0 is not zero", 0x06020000: "no such object",
    0x06040041: "cannot be mapped", 0x06040042: "the mapping is too long",
    0x06040043: "parameters do not fit", 0x06070010: "wrong length",
    0x06090011: "no such sub-index",
    0x06090030: "value out of range", 0x06090031: "value too high", 0x06090032: "value too low",
    0x08000000: "general error", 0x08000020: "cannot be stored", 0x08000021: "local control",
    0x08000022: "not in this state",
}  # fmt: skip


class AbortError(BusError):
    """A device refused an SDO: ``code``, ``index``, ``sub``.

    >>> print(AbortError(0, 0x6064, 0, 0x06010002))
    device 0: 6064h:0: 06010002h (read only)
    """

    def __init__(self, device: int, index: int, sub: int, code: int) -> None:
        why = _ABORTS.get(code, "see the drive's manual")
        super().__init__(f"{index:04X}h:{sub}: {code:08X}h ({why})", device)
        self.code, self.index, self.sub = code, index, sub


class Mailbox:
    """The mailboxes of one device, as its SII has them."""

    def __init__(
        self, access: Access, station: int, out: tuple[int, int], back: tuple[int, int]
    ) -> None:
        """`out`, `back`: start and length of SM0 and SM1."""
        self._access, self._station = access, station
        self._out, self._back = out, back
        self._counter = access.now() // 1000 % 7  # another program's last one may be any
        self.emergencies: list[bytes] = []
        """Emergencies that came between the answers, 8 bytes each, to be taken from here."""

    # ---- SDO ----

    def upload(self, index: int, sub: int) -> Steps[bytes]:
        """The bytes of an object; raises `AbortError`, `BusError`."""
        answer = yield from self._sdo(index, sub, struct.pack("<BHB4x", 0x40, index, sub))
        if answer[0] & 2:
            return answer[4 : 8 - (answer[0] >> 2 & 3 if answer[0] & 1 else 0)]
        size = int(struct.unpack_from("<I", answer, 4)[0])
        data, toggle, more = answer[8 : 8 + size], 0, len(answer) - 8 < size
        while more:
            part = yield from self._sdo(index, sub, bytes((0x60 | toggle << 4,)) + bytes(7))
            if part[0] >> 4 & 1 != toggle:
                raise AbortError(position_of(self._station), index, sub, 0x05030000)
            piece = part[1:]
            data += piece[: 7 - (part[0] >> 1 & 7)] if len(piece) <= 7 else piece
            toggle, more = toggle ^ 1, not part[0] & 1
        if len(data) != size:
            raise BusError(f"{index:04X}h:{sub}: {len(data)} of {size} bytes came",
                           position_of(self._station))  # fmt: skip
        return data

    def download(self, index: int, sub: int, data: bytes) -> Steps[None]:
        """Write an object; raises `AbortError`, `BusError`."""
        if len(data) <= 4:
            head = 0x23 | (4 - len(data)) << 2
            request = struct.pack("<BHB", head, index, sub) + data.ljust(4, b"\0")
            yield from self._sdo(index, sub, request)
            return
        room = self._out[1] - 16
        request = struct.pack("<BHBI", 0x21, index, sub, len(data)) + data[:room]
        yield from self._sdo(index, sub, request)
        rest, toggle, room = data[room:], 0, room + 7
        while rest:
            part, rest = rest[:room], rest[room:]
            first = toggle << 4 | max(0, 7 - len(part)) << 1 | (not rest)
            yield from self._sdo(index, sub, bytes((first,)) + part.ljust(7, b"\0"))
            toggle ^= 1

    def _sdo(self, index: int, sub: int, body: bytes) -> Steps[bytes]:
        """One request and its answer, without the header of CoE.

        A mail whose way back was lost may have been sent twice, and have two answers: what waits
        before a request, and what answers another kind of request, is dropped.
        """
        while (old := (yield from self._fetch())) is not None:
            self._of_sdo(old)
        yield from self._post(struct.pack("<H", _SDO_REQUEST << 12) + body)
        end = self._access.now() + _PATIENCE_NS
        while True:
            mail = yield from self._fetch()
            if mail is None:
                if self._access.now() > end:
                    raise BusError(f"{index:04X}h:{sub}: no answer", position_of(self._station))
                yield
                continue
            answer = self._of_sdo(mail)
            if answer is None:
                continue
            if answer[0] == _ABORT:
                code = int(struct.unpack_from("<I", answer, 4)[0])
                raise AbortError(position_of(self._station), index, sub, code)
            if answer[0] >> 5 != _ANSWERS[body[0] >> 5]:
                continue
            if body[0] >> 5 in _SEGMENTS or struct.unpack_from("<HB", answer, 1) == (index, sub):
                return answer

    def _of_sdo(self, mail: bytes) -> bytes | None:
        """The answer in a mail; an emergency is kept, what is neither is dropped."""
        protocol, data = mail[5] & 15, mail[6:]
        if protocol == 0 and len(data) >= 4:
            code = struct.unpack_from("<H", data, 2)[0]
            raise BusError(f"the mail was not understood: {code:04X}h", position_of(self._station))
        if protocol != _COE or len(data) < 10:
            return None
        service = struct.unpack_from("<H", data)[0] >> 12
        if service == _EMERGENCY:
            self.emergencies.append(data[2:10])
        aborted = service == _SDO_REQUEST and data[2] == _ABORT
        return data[2:] if service == _SDO_RESPONSE or aborted else None

    # ---- mails ----

    def _post(self, data: bytes) -> Steps[None]:
        self._counter = self._counter % 7 + 1
        start, length = self._out
        mail = struct.pack("<HHBB", len(data), 0, 0, _COE | self._counter << 4) + data
        end = self._access.now() + _PATIENCE_NS
        while True:
            asked = Datagram(Command.FPWR, self._station, start, mail.ljust(length, b"\0"))
            answers = self._access.transport.exchange((asked,))
            if answers is not None and answers[0].counter == 1:
                return
            if answers is None and (yield from self._is_full()):
                return  # it went in, and its way back was lost
            if self._access.now() > end:
                raise BusError("its mailbox stays full", position_of(self._station))
            yield

    def _is_full(self) -> Steps[bool]:
        status = yield from self._access.read(self._station, _SM0_STATUS, 1)
        return bool(status[0] & _FULL)

    def _fetch(self) -> Steps[bytes | None]:
        """A mail of the device, None if there is none."""
        if not (yield from self._waits()):
            return None
        start, length = self._back
        asked = (Datagram(Command.FPRD, self._station, start, bytes(length)),)
        answers, tries = self._access.transport.exchange(asked), 0
        while answers is None:
            tries += 1
            if tries > _TRIES:
                raise BusError("no mail comes back", position_of(self._station))
            for _ in range(tries):  # never in step with whatever loses them
                yield
            if not (yield from self._waits()):  # it was read, and lost on its way
                yield from self._repeat()
            answers = self._access.transport.exchange(asked)
        if answers[0].counter != 1:
            return None
        size = int(struct.unpack_from("<H", answers[0].data)[0])
        return answers[0].data[: 6 + size]

    def _waits(self) -> Steps[bool]:
        status = yield from self._access.read(self._station, _SM1_STATUS, 1)
        return bool(status[0] & _FULL)

    def _repeat(self) -> Steps[None]:
        """Ask for the last mail again and wait until it is there (080Fh bit 1 follows)."""
        access, station = self._access, self._station
        before = yield from access.read(station, _SM1_ACTIVATE, 2)
        wanted = before[0] ^ _REPEAT
        yield from access.write(station, _SM1_ACTIVATE, bytes((wanted,)))
        end = access.now() + _PATIENCE_NS
        while access.now() < end:
            now = yield from access.read(station, _SM1_ACTIVATE, 2)
            if now[1] & _REPEAT == wanted & _REPEAT:
                return
            yield
        raise BusError("it does not repeat a mail", position_of(station))
