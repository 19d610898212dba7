"""Ways of frames to the devices: an interface, or a line in virtual time.

Requests and the frames of the cycle go their own ways, told apart by the index: on an interface by
two sockets with filters in the system. Never here: what a frame means.
"""

from __future__ import annotations

import errno
import os
import select
import socket
import time
from collections.abc import Iterator
from typing import Any

from sjerk._binding import lib
from sjerk.ports.ethercat.access import BusError
from sjerk.ports.ethercat.datagrams import (
    FIRST_INDEX,
    INDICES,
    Answer,
    Datagram,
    compose,
    take_apart,
)
from sjerk.ports.ethercat.line import Line

_FIRST_CYCLIC, _LAST = 0x80, 0xFF
_LISTEN_S = 0.1
_PATIENCE_S = 0.02  # for one answer
_LONGEST = 2048


def open_socket(interface: str, first: int, last: int) -> socket.socket:
    """A raw socket for frames of some indices; `OSError` with the interface in it."""
    descriptor = int(lib.sj_wire_open_for(interface.encode(), first, last))
    if descriptor < 0:
        why = os.strerror(-descriptor)
        raise OSError(-descriptor, f"no raw socket on {interface}: {why}")
    return socket.socket(fileno=descriptor)


def cyclic_socket(interface: str) -> socket.socket:
    """For the frames of the cycle; it never waits."""
    cyclic = open_socket(interface, _FIRST_CYCLIC, _LAST)
    cyclic.setblocking(False)
    return cyclic


def claimed(interface: str) -> bool:
    """Whether a program of sjerk is the main device at an interface."""
    try:
        _named(interface).close()
    except BusError:
        return True
    return False


def claim(interface: str) -> socket.socket:
    """Be the only main device at an interface, as long as the socket is open; raises `BusError`.

    Other programs of sjerk are kept out by a name; others are heard for a while.
    """
    name = _named(interface)
    try:
        with open_socket(interface, 0, _LAST) as listening:
            if select.select([listening], [], [], _LISTEN_S)[0]:
                raise BusError(f"another main device sends on {interface}: only one may")
    except BaseException:
        name.close()
        raise
    return name


def _named(interface: str) -> socket.socket:
    """Hold the interface's name; raises `BusError` where another program does."""
    name = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        name.bind(f"\0sjerk-ethercat-{interface}")
    except OSError as error:
        name.close()
        if error.errno != errno.EADDRINUSE:
            raise
        raise BusError(f"another program of sjerk is the main device on {interface}") from error
    return name


class LineTransport:
    """An emulated line in virtual time."""

    def __init__(self, line: Line) -> None:
        self._line = line
        self._index = 0
        self._came: list[bytes] = []

    def now(self) -> int:
        """Virtual time, ns."""
        return self._line.now

    def wait_until(self, when: int) -> None:
        """Let virtual time pass."""
        self._line.advance(max(0, when - self._line.now))

    def exchange(self, datagrams: tuple[Datagram, ...]) -> list[Answer] | None:
        """One frame there and back; None where it was lost."""
        self._index = (self._index + 1) % INDICES
        sent = compose(datagrams, FIRST_INDEX + self._index)
        answer = self._line.frame(sent)
        return None if answer is None else take_apart(answer, sent)

    def send(self, frame: bytes) -> None:
        """A frame of the cycle."""
        if (answer := self._line.frame(frame)) is not None:
            self._came.append(answer)

    def receive(self) -> Iterator[bytes]:
        """What came of the cycle's frames."""
        while self._came:
            yield self._came.pop(0)

    def close(self) -> None:
        """The line stays as it is."""


class InterfaceTransport:
    """A network interface."""

    def __init__(self, interface: str, *, alone: bool = False) -> None:
        """Raises `OSError`; `alone`: `BusError` where another main device is at the interface."""
        self._claim = claim(interface) if alone else None
        self._requests = open_socket(interface, FIRST_INDEX, FIRST_INDEX + INDICES - 1)
        self._cycle: socket.socket | None = None
        self._interface = interface
        self._index = int(lib.sj_wire_now()) // 1000  # another program may be at another one

    def now(self) -> int:
        """CLOCK_MONOTONIC, ns."""
        return int(lib.sj_wire_now())

    def wait_until(self, when: int) -> None:
        """Sleep."""
        time.sleep(max(0, when - self.now()) * 1e-9)

    def exchange(self, datagrams: tuple[Datagram, ...]) -> list[Answer] | None:
        """One frame there and back; None where it does not come back in time."""
        self._index = (self._index + 1) % INDICES
        sent = compose(datagrams, FIRST_INDEX + self._index)
        self._requests.send(sent)
        end = time.monotonic() + _PATIENCE_S
        while (left := end - time.monotonic()) > 0.0:
            if not select.select([self._requests], [], [], left)[0]:
                return None
            answers = take_apart(self._requests.recv(_LONGEST), sent)
            if answers is not None:
                return answers
        return None

    def _cyclic(self) -> Any:
        if self._cycle is None:
            self._cycle = cyclic_socket(self._interface)
        return self._cycle

    def send(self, frame: bytes) -> None:
        """A frame of the cycle."""
        self._cyclic().send(frame)

    def receive(self) -> Iterator[bytes]:
        """What came of the cycle's frames."""
        while True:
            try:
                yield self._cyclic().recv(_LONGEST)
            except BlockingIOError:
                return

    def close(self) -> None:
        """Give the interface back."""
        self._requests.close()
        for other in (self._cycle, self._claim):
            if other is not None:
                other.close()
