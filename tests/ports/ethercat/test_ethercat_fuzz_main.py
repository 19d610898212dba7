"""Random and forged answers to a main device that moves drives: no crash, and no wrong target.

``SJERK_FUZZ_FRAMES`` sets how many, ``SJERK_FUZZ_SEED`` which. ``./run stress ethercat`` runs this
file and `test_ethercat_fuzz` under ASan and UBSan.

What is not drawn is an answer with the right working counter, index and registers and other
inputs: whoever forges a frame byte by byte is obeyed, as on any wire without authentication.
"""

from __future__ import annotations

import os
import random
import struct
from collections import deque
from collections.abc import Iterator

import numpy as np
import pytest

from helpers.ethercat_bench import APWR, BRD, FPRD, LRW, compose
from helpers.ethercat_joined import COUNTS, Joined
from sjerk._binding import ffi, lib
from sjerk.cycle.states import AxisState
from sjerk.ports.ethercat.subdevice import Subdevice

FRAMES = int(os.environ.get("SJERK_FUZZ_FRAMES", "12000"))
SEED = int(os.environ.get("SJERK_FUZZ_SEED", "1"))
PARTS = 4
DRIVES = 3
T, VELOCITY = 1e-3, 20.0  # of the axes: s, rev/s
EXPECTED = 3  # working counter of an LRW
INDICES = 128


def datagrams(frame: bytes) -> Iterator[tuple[int, int, int]]:
    """Place, command and length of each."""
    at, more = 16, 0x8000
    while more and at + 12 <= len(frame):
        size = struct.unpack_from("<H", frame, at + 6)[0]
        more = size & 0x8000
        yield at, frame[at], size & 0x7FF
        at += 12 + (size & 0x7FF)


class Attack:
    """What comes beside, before and instead of the answers."""

    def __init__(self, seed: int) -> None:
        self.draw = random.Random(seed)
        self.forging = 0.0  # part of the frames that is taken for the answer
        self.past: deque[bytes] = deque(maxlen=INDICES - 8)

    def forged(self, sent: bytes) -> bytes:
        """An answer to `sent` with any data, and with wrong working counters of the drives."""
        draw, frame = self.draw, bytearray(sent)
        frame[6] |= 2
        for at, command, length in datagrams(sent):
            if at + 12 + length > len(frame):
                break
            if command == LRW or draw.random() < 0.3:
                frame[at + 10 : at + 10 + length] = draw.randbytes(length)
                wrong = draw.choice((0, 1, 2, 4, 6, 0xFFFF, draw.randrange(5, 0x10000)))
                struct.pack_into("<H", frame, at + 10 + length, wrong)
        return bytes(frame)

    def spoilt(self, sent: bytes) -> bytes:
        """An answer with one head turned, cut, or followed by anything; no drive has counted."""
        draw, frame = self.draw, bytearray(sent)
        frame[6] |= draw.choice((0, 2))
        kind = draw.randrange(3)
        if kind == 0:
            at, *_ = draw.choice(list(datagrams(sent)))
            frame[at + draw.choice((0, 1, 2, 3, 4, 5, 6, 7))] ^= draw.randrange(1, 256)
        elif kind == 1:
            del frame[draw.randrange(len(frame)) :]
        else:
            frame += draw.randbytes(draw.randrange(1514 - len(frame)))
        return bytes(frame)

    def other_main_device(self) -> bytes:
        """What another one asks, as it comes back: its indices may be ours."""
        draw = self.draw
        asked = draw.choice((
            (BRD, 0, 0x0130, bytes(2)),
            (APWR, -draw.randrange(3), 0x0010, bytes(2)),
            (FPRD, 0x1001, 0x0130, bytes(6)),
            (LRW, 0x10000, 0, draw.randbytes(40)),
        ))  # fmt: skip
        frame = bytearray(compose(asked, index=draw.randrange(256)))
        frame[6] |= 2
        struct.pack_into("<H", frame, 16 + 10 + len(asked[3]), draw.choice((0, 1, 3)))
        return bytes(frame)

    def frame(self, sent: bytes) -> bytes:
        """Any of these, an answer of before, or noise."""
        draw = self.draw
        if draw.random() < self.forging:
            return self.forged(sent)
        kind = draw.random()
        if kind < 0.4:
            return self.spoilt(sent)
        if kind < 0.6:
            return self.other_main_device()
        if kind < 0.8 and self.past:
            return draw.choice(self.past)
        return draw.randbytes(draw.choice((0, 13, 16, 60, draw.randrange(1600))))


def follower(device: Subdevice) -> bool:
    """Whether a drive, asked itself, goes where it is told."""
    return bool(device.controller.tx.statusword & 0x106F == 0x1027)


@pytest.mark.parametrize("part", range(PARTS))
def test_no_answer_makes_a_wrong_target(part: int) -> None:
    """Forged answers, wrong counters, floods, another main device: targets stay a motion within the
    limits, the drives find nothing, and a reset brings everything back.
    """
    attack = Attack(SEED * 1000 + part)
    draw = attack.draw
    stops = done = moves = 0
    with Joined(DRIVES, drift_ppm=20) as joined:
        bus, image = joined.c, joined.kernel.image
        joined.enable()
        line, answer = joined.line, joined.line.frame

        def tapped(frame: bytes) -> bytes | None:
            came = answer(frame)
            if came is not None and frame[17] & 0x80:
                attack.past.append(came)
            return came

        line.frame = tapped  # type: ignore[method-assign]
        before = image.outputs["target_position"].astype(np.int64)
        followed = np.zeros(DRIVES, bool)
        most = VELOCITY * T * COUNTS + 1.0
        move = joined.host.move([draw.uniform(-3.0, 3.0) for _ in range(DRIVES)])
        while done < FRAMES // PARTS:
            if draw.random() < 0.003:
                attack.forging = draw.choice((0.0, 0.0002, 0.002, 0.02))
            flood = draw.choice((0, 0, 0, 1, 2, 3)) if draw.random() < 0.99 else 200
            for _ in range(flood):
                sent = bytes(ffi.buffer(bus.flight[0].bytes, bus.flight[0].length))
                frame = attack.frame(sent)
                lib.sj_bus_accept(bus, frame, len(frame))
                done += 1
            joined.main.exchange()
            now = image.outputs["target_position"].astype(np.int64)
            step = np.abs((now - before + 2**31) % 2**32 - 2**31)
            follows = np.array([follower(device) for device in line.devices])
            assert (step <= most)[follows & followed].all(), (done, step / most)
            before, followed = now, follows
            axes = joined.axes
            if any(axis.state == AxisState.ERROR_STOP for axis in axes):
                if joined.main.bus.operational and not any(axis.moving for axis in axes):
                    stops += 1
                    joined.host.reset(timeout=0.0)
                    joined.host.enable(0.0)
            elif move.done and all(axis.follows for axis in axes):
                move = joined.host.move([draw.uniform(-3.0, 3.0) for _ in range(DRIVES)])
                moves += 1
        assert joined.findings() == [{}] * DRIVES
        assert bus.told.stray > done // 2
        joined.until(lambda: joined.main.bus.operational)
        joined.until(lambda: not any(axis.moving for axis in joined.axes), 20_000)
        joined.host.reset(timeout=0.0)
        joined.cycles(10)
        joined.enable()
        move = joined.host.move([1.0, 2.0, 3.0])
        joined.until(lambda: move.done, 20_000)
        joined.cycles(300)
        assert image.outputs["target_position"].tolist() == [COUNTS, 2 * COUNTS, 3 * COUNTS]
        assert [axis.actual_position for axis in joined.axes] == pytest.approx([1, 2, 3], abs=2e-4)
        assert joined.findings() == [{}] * DRIVES
    print(f"{done} forged frames, {moves} moves, {stops} resets")
