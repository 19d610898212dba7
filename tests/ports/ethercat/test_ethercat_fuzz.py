"""Random frames against a line with its states, mails and drives: nothing on the wire does harm.

``SJERK_FUZZ_FRAMES`` sets how many, ``SJERK_FUZZ_SEED`` which. `test_sanitizers` runs this file
again under ASan and UBSan.
"""

from __future__ import annotations

import os
import random
import struct

import pytest

from helpers.ethercat_bench import FPRD, FPWR, LRW, MS, Bench, compose
from sjerk.ports.ethercat import BEHAVIOURS, Line

FRAMES = int(os.environ.get("SJERK_FUZZ_FRAMES", "12000"))
SEED = int(os.environ.get("SJERK_FUZZ_SEED", "1"))
REGISTERS = [
    0x0000, 0x0010, 0x0012, 0x0100, 0x0103, 0x0110, 0x0120, 0x0130, 0x0134, 0x0300, 0x0400, 0x0420,
    0x0440, 0x0500, 0x0502, 0x0504, 0x0508, 0x0600, 0x0610, 0x067F, 0x0800, 0x0806, 0x0808, 0x080D,
    0x080E, 0x0810, 0x0816, 0x0818, 0x081E, 0x0820, 0x0900, 0x0910, 0x0918, 0x0920, 0x0928, 0x092C,
    0x0930, 0x0980, 0x0990, 0x09A0, 0x09A4, 0x0FF8, 0x1000, 0x1080, 0x1100, 0x1800, 0x2000, 0x2400,
    0x2FF8, 0x3000, 0xFFFF,
]  # fmt: skip


class Fuzz:
    """A main device gone mad, now and then reasonable."""

    def __init__(self, seed: int) -> None:
        self.draw = random.Random(seed)
        self.line = Line(drives=3, behaviour=self.draw.choices(list(BEHAVIOURS), k=3), drift_ppm=50)
        self.bench = Bench(self.line)
        self.boxes = [self.bench.mailbox(k) for k in range(3)]

    def climb(self) -> None:
        """One step of the right way up, so that the deeper states are reached."""
        draw, bench, k = self.draw, self.bench, self.draw.randrange(3)
        out, out_length, inp, in_length = self.boxes[k]
        station = 0x1001 + k
        up = {1: 0x12, 2: 0x14, 4: 0x18, 8: 0x18}[int(self.line.devices[k].state)]
        wanted = up if draw.random() < 0.8 else draw.choice((0x11, 0x12, 0x14, 0x18))
        steps = [
            (2, -k & 0xFFFF, 0x0010, struct.pack("<H", station)),
            (FPWR, station, 0x0806, b"\0"),
            (FPWR, station, 0x080E, b"\0"),
            (FPWR, station, 0x0800, struct.pack("<HHBBBB", out, out_length, 0x26, 0, 1, 0)),
            (FPWR, station, 0x0808, struct.pack("<HHBBBB", inp, in_length, 0x22, 0, 1, 0)),
            (FPWR, station, 0x0120, struct.pack("<H", wanted)),
            (FPRD, station, inp, bytes(in_length)),
        ]
        device = self.line.devices[k]
        lengths = [area.length for area in device.process_areas()]
        steps += [
            (FPWR, station, 0x0816, b"\0"), (FPWR, station, 0x081E, b"\0"),
            (FPWR, station, 0x0810, struct.pack("<HHBBBB", 0x1800, lengths[0], 0x64, 0, 1, 0)),
            (FPWR, station, 0x0818, struct.pack("<HHBBBB", 0x2400, lengths[1], 0x20, 0, 1, 0)),
            (FPWR, station, 0x0600,
             struct.pack("<IHBBHBBB", 64 * k, lengths[0], 0, 7, 0x1800, 0, 2, 1)),
            (FPWR, station, 0x0610,
             struct.pack("<IHBBHBBB", 64 * k, lengths[1], 0, 7, 0x2400, 0, 1, 1)),
        ]  # fmt: skip
        if draw.random() < 0.5:
            steps[5:5] = [
                (FPWR, station, 0x09A0, struct.pack("<I", draw.choice((MS, 62_500)))),
                (FPWR, station, 0x0990, draw.randbytes(8)),
                (FPWR, station, 0x0980, bytes((0, draw.choice((0, 3, 3, 7))))),
            ]
        for step in steps:
            self.line.frame(compose(step))
        bench.line.frame(compose((LRW, 64 * k, 0, draw.randbytes(max(lengths)))))

    def mail(self) -> tuple[int, int, int, bytes]:
        """A mail, mostly an SDO to an object that exists."""
        draw, k = self.draw, self.draw.randrange(3)
        out, length, *_ = self.boxes[k]
        objects = list(self.line.devices[k].dictionary.objects)
        index = draw.choice(objects) if draw.random() < 0.9 else draw.randrange(0x10000)
        service = draw.choice((2, 2, 2, 8, draw.randrange(16)))
        first = draw.choice((0x40, 0x50, 0x60, 0x70, 0x21, 0x23, 0x2F, 0x31, 0, 1, 0x10, 0x80,
                             draw.randrange(256)))  # fmt: skip
        if service == 8:
            body = struct.pack("<BBHH", draw.choice((1, 3, 5, draw.randrange(256))), 0, 0, index)
            body += draw.randbytes(draw.randrange(5))
        else:
            body = struct.pack("<BHB", first, index, draw.choice((0, 0, 1, 2, draw.randrange(256))))
            body += struct.pack("<I", draw.choice((0, 1, 2, 8, 0x1600, 300, draw.getrandbits(32))))
            body += draw.randbytes(draw.choice((0, 0, draw.randrange(100))))
        size = 2 + len(body) if draw.random() < 0.95 else draw.getrandbits(16)
        kind = 0x13 if draw.random() < 0.95 else draw.randrange(256)
        mail = struct.pack("<HHBBH", size, 0, 0, kind, service << 12) + body
        return FPWR, 0x1001 + k, out, mail[:length].ljust(length, b"\0")

    def datagram(self) -> tuple[int, int, int, bytes]:
        """Anything."""
        draw = self.draw
        choice = draw.random()
        if choice < 0.3:
            return self.mail()
        if choice < 0.45:
            *_, inp, length = self.boxes[k := draw.randrange(3)]
            return FPRD, 0x1001 + k, inp, bytes(length)
        if choice < 0.6:
            return LRW, 64 * draw.randrange(3), 0, draw.randbytes(draw.randrange(1, 64))
        address = draw.choice((0x1001, 0x1002, 0x1003, 0, 0xFFFF, draw.getrandbits(32)))
        offset = draw.choice(REGISTERS) + draw.choice((0, 0, 0, draw.randrange(16)))
        size = draw.choice((1, 2, 4, 6, 8, 16, draw.randrange(1, 400)))
        return draw.randrange(16), address, offset & 0xFFFF, draw.randbytes(size)

    def frame(self) -> bytes:
        """Some datagrams; bits turned or bytes cut off in some."""
        draw = self.draw
        frame = bytearray(compose(*(self.datagram() for _ in range(draw.choice((1, 1, 2, 3))))))
        if draw.random() < 0.1:
            for _ in range(draw.randrange(1, 8)):
                frame[draw.randrange(len(frame))] ^= 1 << draw.randrange(8)
        if draw.random() < 0.03:
            del frame[draw.randrange(len(frame)) :]
        return bytes(frame[:1514])


@pytest.mark.parametrize("part", range(10))
def test_no_frame_does_harm(part: int) -> None:
    """No exception, no endless loop, states that exist, a line that can be brought up again."""
    fuzz = Fuzz(SEED * 1000 + part)
    line, draw = fuzz.line, fuzz.draw
    seen = set()
    for n in range(FRAMES // 10):
        if n % 12 == 0:
            fuzz.climb()
        line.frame(fuzz.frame())
        if draw.random() < 0.3:
            line.advance(draw.choice((1000, 125_000, MS, 20 * MS)))
        if draw.random() < 0.001:
            line.power_cycle(draw.randrange(3))
        seen |= {int(device.state) for device in line.devices}
    assert seen == {1, 2, 4, 8}
    for k in range(3):
        line.power_cycle(k)
    bench = Bench(line)
    for k in range(3):
        bench.to_preop(k)
        assert bench.upload(k, 0x1000, 0) == struct.pack("<I", 0x00020192)
