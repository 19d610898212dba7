"""A main device for tests, in virtual time: written from the rules, knows nothing of the emulator.

`Bench` composes datagrams, takes the answers apart, and walks a line of devices through its states.
"""

from __future__ import annotations

import struct
from typing import Any, NamedTuple

from sjerk.ports.ethercat import Line

NOP, APRD, APWR, APRW, FPRD, FPWR, FPRW, BRD, BWR, BRW, LRD, LWR, LRW, ARMW, FRMW = range(15)
MS = 1_000_000


class SdoAbortError(Exception):
    """The device refused an access."""

    def __init__(self, code: int) -> None:
        super().__init__(f"{code:08X}h")
        self.code = code


class MailFaultError(Exception):
    """The device did not understand a mail."""

    def __init__(self, code: int) -> None:
        super().__init__(f"{code:04X}h")
        self.code = code


class Answer(NamedTuple):
    """Data and working counter of a datagram."""

    data: bytes
    wkc: int


def compose(*datagrams: tuple[int, int, int, bytes], index: int = 7) -> bytes:
    """A frame of datagrams: command, address (16 or, logical, 32 bits), offset, data."""
    body = b""
    for number, (command, address, offset, data) in enumerate(datagrams):
        where = struct.pack("<I", address) if command in (LRD, LWR, LRW) else struct.pack(
            "<HH", address & 0xFFFF, offset
        )  # fmt: skip
        more = 0x8000 if number < len(datagrams) - 1 else 0
        body += struct.pack("<BB", command, index) + where
        body += struct.pack("<HH", len(data) | more, 0) + data + b"\0\0"
    frame = b"\xff" * 6 + b"\x10" * 6 + b"\x88\xa4" + struct.pack("<H", len(body) | 0x1000) + body
    return frame.ljust(60, b"\0")


def take_apart(frame: bytes) -> list[Answer]:
    """Data and working counters of a frame."""
    answers, at, more = [], 16, True
    while more:
        size = struct.unpack_from("<H", frame, at + 6)[0]
        length, more = size & 0x7FF, bool(size & 0x8000)
        data = frame[at + 10 : at + 10 + length]
        answers.append(Answer(data, struct.unpack_from("<H", frame, at + 10 + length)[0]))
        at += 12 + length
    return answers


class Bench:
    """A line and the main device in front of it."""

    def __init__(self, line: Line | None = None, **options: Any) -> None:
        self.line = line or Line(**options)
        self.count = len(self.line.devices)
        self._counter = [0] * self.count
        self.layout = {}
        for k in range(self.count):
            self.one(APWR, -k, 0x0010, struct.pack("<H", 0x1001 + k))

    # ---- datagrams ----

    def send(self, *datagrams: tuple[int, int, int, bytes]) -> list[Answer]:
        answer = self.line.frame(compose(*datagrams))
        assert answer is not None, "the frame was lost"
        return take_apart(answer)

    def one(self, command: int, address: int, offset: int, data: bytes) -> Answer:
        return self.send((command, address, offset, data))[0]

    def read(self, k: int, offset: int, count: int) -> bytes:
        answer = self.one(FPRD, 0x1001 + k, offset, bytes(count))
        assert answer.wkc == 1
        return answer.data

    def write(self, k: int, offset: int, data: bytes) -> None:
        assert self.one(FPWR, 0x1001 + k, offset, data).wkc == 1

    def word(self, k: int, offset: int) -> int:
        return int(struct.unpack("<H", self.read(k, offset, 2))[0])

    # ---- SII ----

    def sii(self, k: int, word: int) -> bytes:
        """Eight bytes from a word address on."""
        self.write(k, 0x0502, struct.pack("<HI", 0x0100, word))
        assert not self.word(k, 0x0502) & 0x7800
        return self.read(k, 0x0508, 8)

    # ---- states ----

    def request(self, k: int, control: int) -> None:
        self.write(k, 0x0120, struct.pack("<H", control))

    def al(self, k: int) -> tuple[int, int]:
        """0130h and 0134h."""
        status, code = struct.unpack("<HxxH", self.read(k, 0x0130, 6))
        return status, code

    def mailbox(self, k: int) -> tuple[int, int, int, int]:
        """Start and length of both mailboxes by the SII."""
        return struct.unpack("<HHHH", self.sii(k, 0x18))

    def manager(self, k: int, n: int, start: int, length: int, control: int, on: int = 1) -> None:
        self.write(k, 0x0800 + 8 * n + 6, b"\0")
        self.write(k, 0x0800 + 8 * n, struct.pack("<HHBBBB", start, length, control, 0, on, 0))

    def to_preop(self, k: int) -> None:
        out, out_length, inp, in_length = self.mailbox(k)
        self.manager(k, 0, out, out_length, 0x26)
        self.manager(k, 1, inp, in_length, 0x22)
        self.request(k, 2)
        assert self.al(k) == (2, 0)

    def fmmu(self, k: int, n: int, logical: int, length: int, physical: int, kind: int,
             bits: tuple[int, int, int] = (0, 7, 0)) -> None:  # fmt: skip
        self.write(
            k, 0x0600 + 16 * n,
            struct.pack("<IHBBHBBB", logical, length, bits[0], bits[1], physical, bits[2], kind, 1),
        )  # fmt: skip

    def map(self, k: int, outputs: int, inputs: int, *, start: int = 0x1800, end: int = 0x2400,
            logical: int | None = None) -> None:  # fmt: skip
        """SM2, SM3 and their FMMUs; outputs and inputs of a device overlap, 64 bytes apart."""
        logical = 0x10000 + 64 * k if logical is None else logical
        self.manager(k, 2, start, outputs, 0x64, int(outputs > 0))
        self.manager(k, 3, end, inputs, 0x20, int(inputs > 0))
        self.fmmu(k, 0, logical, max(1, outputs), start, 2 if outputs else 0)
        self.fmmu(k, 1, logical, max(1, inputs), end, 1 if inputs else 0)
        self.layout[k] = (logical, max(outputs, inputs))

    def lengths(self, k: int) -> tuple[int, int]:
        """Bytes of outputs and inputs, from the mapping objects by SDO."""
        totals = []
        for assignment in (0x1C12, 0x1C13):
            bits = 0
            for n in range(1, self.upload(k, assignment, 0)[0] + 1):
                pdo = struct.unpack("<H", self.upload(k, assignment, n))[0]
                for s in range(1, self.upload(k, pdo, 0)[0] + 1):
                    bits += self.upload(k, pdo, s)[0]
            totals.append((bits + 7) // 8)
        return totals[0], totals[1]

    def to_safeop(self, k: int, *, sync0: int = 0, sync1: int | None = None) -> None:
        """Configure as a device asks for; by SYNC0 with a cycle in ns, by SYNC1 too if given."""
        self.to_preop(k)
        self.map(k, *self.lengths(k))
        if sync0:
            self.start_sync(k, sync0, sync1)
        self.request(k, 4)
        assert self.al(k) == (4, 0), [hex(x) for x in self.al(k)]

    def start_sync(self, k: int, sync0: int, sync1: int | None = None) -> None:
        now = struct.unpack("<q", self.read(k, 0x0910, 8))[0]
        self.write(k, 0x0980, b"\0\0")
        self.write(k, 0x09A0, struct.pack("<II", sync0, sync1 or 0))
        start = (now // sync0 + 2) * sync0 + sync0 // 2
        self.write(k, 0x0990, struct.pack("<q", start))
        self.write(k, 0x0980, bytes((0, 3 if sync1 is None else 7)))

    def to_op(self, k: int, *, sync0: int = 0, sync1: int | None = None, cycle: int = MS) -> None:
        self.to_safeop(k, sync0=sync0, sync1=sync1)
        self.request(k, 8)
        for _ in range(4):
            self.exchange(k, b"")
            self.line.advance(cycle)
        assert self.al(k) == (8, 0), [hex(x) for x in self.al(k)]

    def exchange(self, k: int, outputs: bytes) -> Answer:
        logical, length = self.layout[k]
        return self.one(LRW, logical, 0, outputs.ljust(length, b"\0"))

    # ---- mails ----

    def post(self, k: int, mail: bytes) -> int:
        start, length, *_ = self.mailbox(k)
        return self.one(FPWR, 0x1001 + k, start, mail.ljust(length, b"\0")).wkc

    def fetch(self, k: int) -> bytes | None:
        """A mail of the device, None if there is none."""
        *_, start, length = self.mailbox(k)
        answer = self.one(FPRD, 0x1001 + k, start, bytes(length))
        if answer.wkc == 0:
            return None
        size = struct.unpack_from("<H", answer.data)[0]
        return answer.data[: 6 + size]

    def ask(self, k: int, data: bytes, protocol: int = 3) -> bytes:
        """A mail and its answer, without the header."""
        self._counter[k] = self._counter[k] % 7 + 1
        head = struct.pack("<HHBB", len(data), 0, 0, protocol | self._counter[k] << 4)
        assert self.post(k, head + data) == 1
        mail = self.fetch(k)
        assert mail is not None, "no answer"
        if mail[5] & 15 == 0:
            raise MailFaultError(struct.unpack_from("<H", mail, 8)[0])
        return mail[6:]

    def sdo(self, k: int, body: bytes) -> bytes:
        answer = self.ask(k, struct.pack("<H", 0x2000) + body)
        if answer[2] == 0x80:
            raise SdoAbortError(struct.unpack_from("<I", answer, 6)[0])
        assert answer[1] >> 4 == 3
        return answer[2:]

    def upload(self, k: int, index: int, sub: int, *, complete: bool = False) -> bytes:
        answer = self.sdo(k, struct.pack("<BHB4x", 0x40 | 0x10 * complete, index, sub))
        assert struct.unpack_from("<HB", answer, 1) == (index, sub)
        if answer[0] & 2:
            return answer[4 : 8 - (answer[0] >> 2 & 3)]
        size = struct.unpack_from("<I", answer, 4)[0]
        data, toggle = answer[8:], 0
        while len(data) < size:
            part = self.sdo(k, bytes((0x60 | toggle << 4,)) + bytes(7))
            assert part[0] >> 4 & 1 == toggle
            piece = part[1:]
            data += piece[: 7 - (part[0] >> 1 & 7)] if len(piece) <= 7 else piece
            toggle ^= 1
            assert bool(part[0] & 1) == (len(data) >= size)
        assert len(data) == size
        return data

    def download(self, k: int, index: int, sub: int, data: bytes, *, complete: bool = False,
                 expedited: bool | None = None) -> None:  # fmt: skip
        if expedited is None:
            expedited = len(data) <= 4 and not complete
        if expedited:
            head = 0x23 | (4 - len(data)) << 2 | 0x10 * complete
            self.sdo(k, struct.pack("<BHB", head, index, sub) + data.ljust(4, b"\0"))
            return
        room = self.mailbox(k)[1] - 16
        head = struct.pack("<BHBI", 0x21 | 0x10 * complete, index, sub, len(data))
        self.sdo(k, head + data[:room])
        rest, toggle, room = data[room:], 0, room + 7
        while rest:
            part, rest = rest[:room], rest[room:]
            unused = max(0, 7 - len(part))
            first = toggle << 4 | unused << 1 | (not rest)
            answer = self.sdo(k, bytes((first,)) + part.ljust(7, b"\0"))
            assert answer[0] == 0x20 | toggle << 4
            toggle ^= 1

    def information(self, k: int, opcode: int, body: bytes) -> bytes:
        """An SDO information service: the joined fragments."""
        answer = self.ask(k, struct.pack("<HBBH", 0x8000, opcode, 0, 0) + body)
        data = b""
        while True:
            code, _, left = struct.unpack_from("<BBH", answer, 2)
            if code & 0x7F == 7:
                raise SdoAbortError(struct.unpack_from("<I", answer, 6)[0])
            assert code & 0x7F == opcode + 1
            data += answer[6:]
            assert bool(code & 0x80) == (left > 0)
            if not left:
                return data
            mail = self.fetch(k)
            assert mail is not None
            answer = mail[6:]
