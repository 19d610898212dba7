"""The sockets of a main device, on a virtual cable in a network namespace of its own.

A machine that refuses namespaces skips with its reason. ``SJERK_FUZZ_FRAMES`` sets how many frames
come through the ring that the system shares, ``SJERK_FUZZ_SEED`` which; ``./run stress ethercat``
runs this file under ASan and UBSan.
"""

from __future__ import annotations

import os
import select
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from helpers.ethercat_attack import Attack, UnderAttack
from helpers.ethercat_joined import Joined
from helpers.root import ROOT
from sjerk._binding import ffi, lib
from sjerk.cli.cable import DRIVES, MAIN, inside
from sjerk.errors import SjerkError
from sjerk.ports.ethercat.transports import cyclic_socket

FRAMES = int(os.environ.get("SJERK_FUZZ_FRAMES", "6000"))
SEED = int(os.environ.get("SJERK_FUZZ_SEED", "1"))
ETHERCAT = 0x88A4
AXES = 3
SHORTEST, LONGEST = 14, 1514  # what the system sends
SLOTS = 128  # of the ring
OPENED = 200


def elsewhere(request: pytest.FixtureRequest) -> bool:
    """Run this test where the cable is; False: it is here."""
    try:
        socket.if_nametoindex(MAIN)
    except OSError:
        one = [sys.executable, "-m", "pytest", "-q", "-s", "-p", "no:cacheprovider"]
        try:
            command = inside([*one, f"{__file__}::{request.node.name}"])
        except SjerkError as error:
            pytest.skip(str(error))
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
        print(done.stdout)
        return True
    return False


@contextmanager
def peer(interface: str) -> Iterator[socket.socket]:
    """A raw socket at an interface."""
    with socket.socket(socket.AF_PACKET, socket.SOCK_RAW, 0) as raw:
        raw.bind((interface, ETHERCAT))
        yield raw


def test_a_socket_hears_only_its_interface_and_its_indices(request: pytest.FixtureRequest) -> None:
    """Not even what came while it was opened: of another interface, or of another index."""
    if elsewhere(request):
        return
    frame = bytes(12) + ETHERCAT.to_bytes(2, "big") + bytes(46)  # index 0
    ended = threading.Event()

    def flood(interface: str) -> None:
        with peer(interface) as raw:
            while not ended.is_set():
                raw.send(frame)

    floods = [threading.Thread(target=flood, args=(at,)) for at in (DRIVES, MAIN)]
    for thread in floods:
        thread.start()
    try:
        heard = 0
        for _ in range(OPENED):
            with cyclic_socket(MAIN) as opened:
                heard += bool(select.select([opened], [], [], 0.0)[0])
    finally:
        ended.set()
        for thread in floods:
            thread.join()
    assert heard == 0


class Ring:
    """Answers of a line, and an attack's frames, by way of the cable and the ring."""

    def __init__(self, joined: Joined, attack: Attack, wire: socket.socket) -> None:
        self.attack, self.wire, self.answer = attack, wire, joined.line.frame
        self.socket = cyclic_socket(MAIN)
        self.bus = ffi.new("sj_wire_bus *")
        self.bus.bus, self.bus.socket = joined.c, self.socket.fileno()
        assert lib.sj_wire_map(self.bus) == 0
        self.exchange = ffi.new("sj_exchange *")
        lib.sj_wire_exchange(self.bus, self.exchange)
        self.sent = 0
        self.calm = False

    def close(self) -> None:
        """The ring and its socket."""
        lib.sj_wire_unmap(self.bus)
        self.socket.close()

    def frame(self, frame: bytes) -> bytes | None:
        """As the line's; a frame of the cycle comes back by the ring, and is settled there."""
        came = self.answer(frame)
        if came is None or not frame[17] & 0x80:
            return came
        draw = self.attack.draw
        flood = 0 if self.calm else draw.choice((0, 0, 0, 1, 2, 3))
        if not self.calm and draw.random() < 0.02:
            flood = draw.choice((SLOTS - 1, SLOTS, 2 * SLOTS))
        for _ in range(flood):
            self.put(self.attack.frame(frame))
        self.wire.send(came)
        self.attack.past.append(came)
        select.select([self.socket], [], [], 0.02)
        self.exchange.take(self.exchange.self)
        return None

    def put(self, frame: bytes) -> None:
        """One frame of the attack, of any type that a cable carries."""
        made = bytearray(frame)
        if len(made) > SHORTEST + 4 and self.attack.draw.random() < 0.5:
            made[12:14] = ETHERCAT.to_bytes(2, "big")
            made[17] |= 0x80
        if SHORTEST <= len(made) <= LONGEST:
            self.wire.send(made)
            self.sent += 1


def test_no_frame_in_the_ring_makes_a_wrong_target(request: pytest.FixtureRequest) -> None:
    """Forged, spoilt and foreign frames, and more than it holds: targets stay a motion within the
    limits, the drives find nothing, and the kernel goes on afterwards.
    """
    if elsewhere(request):
        return
    attack = Attack(SEED)
    draw = attack.draw
    with Joined(AXES) as joined, peer(DRIVES) as wire:
        bus = joined.c
        joined.enable()
        ring = Ring(joined, attack, wire)
        line = joined.line
        joined.cycles(1)
        line.frame, direct = ring.frame, line.frame  # type: ignore[method-assign]
        axes = UnderAttack(joined, draw)
        while ring.sent < FRAMES:
            if draw.random() < 0.003:
                attack.forging = draw.choice((0.0, 0.0002, 0.002, 0.02))
            axes.cycle()
        assert joined.findings() == [{}] * AXES
        assert bus.told.stray > ring.sent // 4
        stray, ring.calm = bus.told.stray, True
        joined.cycles(10)  # what is left in the ring
        lost = bus.told.lost
        came = bus.told.sent
        joined.until(lambda: bus.told.lost - lost < bus.told.sent - came)  # answers come again
        line.frame = direct  # type: ignore[method-assign]
        axes.recovers()
        ring.close()
    print(f"{ring.sent} frames by the ring, {stray} strays, {lost} answers lost, "
          f"{axes.moves} moves, {axes.stops} resets")  # fmt: skip
