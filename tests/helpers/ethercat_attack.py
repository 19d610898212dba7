"""Random and forged answers to a main device, made from what it sent; what must hold meanwhile.

What is not drawn is an answer with the right working counter, index and registers and other
inputs: whoever forges a frame byte by byte is obeyed, as on any wire without authentication.
"""

from __future__ import annotations

import random
import struct
from collections import deque
from collections.abc import Iterator

import numpy as np

from helpers.ethercat_bench import APWR, BRD, FPRD, LRW, compose
from helpers.ethercat_joined import COUNTS, Joined
from sjerk.cycle.states import AxisState
from sjerk.ports.ethercat.subdevice import Subdevice

INDICES = 128
T, VELOCITY = 1e-3, 20.0  # of the axes: s, rev/s


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


class UnderAttack:
    """Axes that move to and fro, and go on after each stop; every target is looked at."""

    def __init__(self, joined: Joined, draw: random.Random) -> None:
        self.joined, self.draw = joined, draw
        self.stops = self.moves = 0
        self._before = self._targets()
        self._followed = np.zeros(len(self._before), bool)
        self._move()

    def _targets(self) -> np.ndarray:
        found: np.ndarray = self.joined.kernel.image.outputs["target_position"].astype(np.int64)
        return found

    def _move(self) -> None:
        goals = [self.draw.uniform(-3.0, 3.0) for _ in self._before]
        self._goal = self.joined.host.move(goals)

    def cycle(self) -> None:
        """One cycle: no drive that follows is told to step further than its axis's velocity."""
        self.joined.main.exchange()
        now = self._targets()
        step = np.abs((now - self._before + 2**31) % 2**32 - 2**31)
        follows = np.array([follower(device) for device in self.joined.line.devices])
        most = VELOCITY * T * COUNTS + 1.0
        assert (step <= most)[follows & self._followed].all(), step / most
        self._before, self._followed = now, follows
        axes, host = self.joined.axes, self.joined.host
        if any(axis.state == AxisState.ERROR_STOP for axis in axes):
            if self.joined.main.bus.operational and not any(axis.moving for axis in axes):
                self.stops += 1
                host.reset(timeout=0.0)
                host.enable(0.0)
        elif self._goal.done and all(axis.follows for axis in axes):
            self._move()
            self.moves += 1

    def recovers(self) -> None:
        """A reset brings everything back, and a move ends on its goal to the increment."""
        joined = self.joined
        joined.until(lambda: joined.main.bus.operational)
        joined.until(lambda: not any(axis.moving for axis in joined.axes), 20_000)
        joined.host.reset(timeout=0.0)
        joined.cycles(10)
        joined.enable()
        goals = np.arange(1, len(self._before) + 1)
        move = joined.host.move([float(goal) for goal in goals])
        joined.until(lambda: move.done, 20_000)
        joined.cycles(300)
        assert self._targets().tolist() == (goals * COUNTS).tolist()
        assert np.allclose([axis.actual_position for axis in joined.axes], goals, atol=2e-4)
        assert joined.findings() == [{}] * len(goals)
