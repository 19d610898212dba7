"""A CANopen node frame by frame, with a clock that the test holds."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

from sjerk.cia402 import Drive
from sjerk.drive.device import Device
from sjerk.ports.canopen import Node

NODE = 5


@dataclass
class Frame:
    arbitration_id: int
    data: bytearray
    is_extended_id: bool = False
    is_remote_frame: bool = False
    is_error_frame: bool = False


@dataclass
class Wire:
    """A node whose PDOs come with each SYNC, the frames it sent, and the time."""

    now: float = 100.0
    sent: list[tuple[int, bytes]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.device = Device(Drive(), node_id=NODE)
        self.node = Node(self.device, lambda i, d: self.sent.append((i, d)), now=self.now)
        for number in range(4):
            self.write(0x1400 + number, 2, 1)
            self.write(0x1800 + number, 2, 1)

    def put(self, identifier: int, data: bytes = b"", *, remote: bool = False) -> None:
        self.node.take(Frame(identifier, bytearray(data), is_remote_frame=remote), self.now)

    def pass_time(self, seconds: float, step: float = 1e-3) -> None:
        for _ in range(round(seconds / step)):
            self.now += step
            self.node.tick(self.now)

    def take(self, identifier: int) -> list[bytes]:
        found = [data for i, data in self.sent if i == identifier]
        self.sent = [(i, data) for i, data in self.sent if i != identifier]
        return found

    def write(self, index: int, sub: int, value: int) -> None:
        self.device.write(index, sub, value)

    def sync(self, word: int | None = None, target: int = 0, mode: int = 8) -> None:
        if word is not None:
            self.put(0x200 + NODE, struct.pack("<Hbi", word, mode, target))
        self.now += 1e-3
        self.put(0x80)

    def enable(self) -> None:
        self.put(0, bytes((1, NODE)))
        for word in (0x06, 0x07, 0x0F, 0x0F):
            self.sync(word)
        assert self.device.feedback.follows
