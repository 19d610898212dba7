"""SDO transfers of CiA 301: the server of a node, and a client for masters.

Never here: what an object means.
"""

from __future__ import annotations

import time
from typing import Any

from sjerk.drive import Abort, Device, SdoError, entry
from sjerk.errors import SjerkError
from sjerk.ports.canopen.frames import sender

_ANSWER_S = 2.0


class SdoServer:
    """The server of one node: expedited and segmented transfers, one at a time.

    >>> SdoServer(Device()).answer(bytes([0x40, 0x5A, 0x60, 0, 0, 0, 0, 0])).hex()
    '4b5a600002000000'
    """

    def __init__(self, device: Device) -> None:
        """Serve the dictionary of a device."""
        self._device = device
        self._place = (0, 0)
        self._up: bytes | None = None
        self._down: bytearray | None = None
        self._size = 0
        self._toggle = 0

    def answer(self, request: bytes) -> bytes | None:
        """The response (8 bytes) to a request; None to an abort, which needs none."""
        if len(request) != 8:
            return self._abort(Abort.COMMAND)
        command = request[0] >> 5
        if command in (1, 2):
            self._up = self._down = None
            self._place = (request[1] | request[2] << 8, request[3])
        try:
            match command:
                case 0:
                    return self._take_segment(request)
                case 1:
                    return self._begin_download(request)
                case 2:
                    return self._begin_upload()
                case 3:
                    return self._give_segment(request)
                case 4:
                    self._up = self._down = None
                    return None
                case _:
                    return self._abort(Abort.COMMAND)
        except SdoError as error:
            return self._abort(error.abort)

    def _abort(self, abort: Abort) -> bytes:
        self._up = self._down = None
        return self._head(0x80) + int(abort).to_bytes(4, "little")

    def _head(self, first: int) -> bytes:
        index, sub = self._place
        return bytes((first, index & 0xFF, index >> 8, sub))

    def _begin_download(self, request: bytes) -> bytes:
        row = entry(*self._place)
        expedited, sized = request[0] & 2, request[0] & 1
        if expedited:
            size = 4 - (request[0] >> 2 & 3) if sized else min(row.type.size, 4)
            self._device.download(*self._place, bytes(request[4 : 4 + size]))
        else:
            if row.access == "ro":
                raise SdoError(Abort.READ_ONLY, *self._place)
            self._size = int.from_bytes(request[4:8], "little") if sized else row.type.size
            if self._size != row.type.size:
                too_long = self._size > row.type.size
                raise SdoError(Abort.TOO_LONG if too_long else Abort.TOO_SHORT, *self._place)
            self._down, self._toggle = bytearray(), 0
        return self._head(0x60) + bytes(4)

    def _take_segment(self, request: bytes) -> bytes:
        if self._down is None:
            return self._abort(Abort.COMMAND)
        if request[0] >> 4 & 1 != self._toggle:
            return self._abort(Abort.TOGGLE)
        self._down += request[1 : 8 - (request[0] >> 1 & 7)]
        if len(self._down) > self._size:
            return self._abort(Abort.TOO_LONG)
        response = bytes((0x20 | self._toggle << 4,)) + bytes(7)
        self._toggle ^= 1
        if request[0] & 1:
            data, self._down = bytes(self._down), None
            self._device.download(*self._place, data)
        return response

    def _begin_upload(self) -> bytes:
        data = self._device.upload(*self._place)
        if len(data) <= 4:
            return self._head(0x43 | (4 - len(data)) << 2) + data.ljust(4, b"\0")
        self._up, self._toggle = data, 0
        return self._head(0x41) + len(data).to_bytes(4, "little")

    def _give_segment(self, request: bytes) -> bytes:
        if self._up is None:
            return self._abort(Abort.COMMAND)
        if request[0] >> 4 & 1 != self._toggle:
            return self._abort(Abort.TOGGLE)
        part, rest = self._up[:7], self._up[7:]
        first = self._toggle << 4 | (7 - len(part)) << 1 | (not rest)
        self._toggle ^= 1
        self._up = rest or None
        return bytes((first,)) + part.ljust(7, b"\0")


class SdoClient:
    """Expedited SDO transfers with one node on a bus of python-can.

    Frames of others that come in between are dropped.
    """

    def __init__(self, bus: Any, node: int) -> None:
        """Ask the node of this number; raises `ExtraMissingError` without sjerk[canopen]."""
        self._bus, self._node, self._send = bus, node, sender(bus)

    def write(self, index: int, sub: int, data: bytes) -> None:
        """Write one to four bytes; raises `SjerkError` with the abort code, or for no answer."""
        head = bytes((0x23 | (4 - len(data)) << 2, index & 0xFF, index >> 8, sub))
        self._ask(head + data.ljust(4, b"\0"))

    def read(self, index: int, sub: int = 0) -> bytes:
        """Read an object of one to four bytes; raises as `write`."""
        answer = self._ask(bytes((0x40, index & 0xFF, index >> 8, sub)) + bytes(4))
        return answer[4 : 8 - (answer[0] >> 2 & 3)]

    def _ask(self, request: bytes) -> bytes:
        place = request[1:4]
        name = f"node {self._node}, {place[1]:02X}{place[0]:02X}h:{place[2]}"
        self._send(0x600 + self._node, request)
        end = time.monotonic() + _ANSWER_S
        while (left := end - time.monotonic()) > 0.0:
            frame = self._bus.recv(left)
            if frame is None or frame.arbitration_id != 0x580 + self._node:
                continue
            answer = bytes(frame.data)
            if len(answer) != 8 or answer[1:4] != place:
                continue
            if answer[0] >> 5 == 4:
                raise SjerkError(f"{name}: abort {int.from_bytes(answer[4:], 'little'):08X}h")
            return answer
        raise SjerkError(f"{name}: no answer")
