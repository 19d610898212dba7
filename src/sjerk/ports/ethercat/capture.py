"""Frames to a file that Wireshark reads (pcapng, times in ns).

    section header | interface description | enhanced packet, enhanced packet, ...
    block: 4 type | 4 length | body, filled up to 4 bytes | 4 length

Never here: what a frame means.
"""

from __future__ import annotations

import socket
import struct
import threading
import time
from pathlib import Path

_SECTION, _INTERFACE, _PACKET = 0x0A0D0D0A, 1, 6
_ETHERNET, _LONGEST = 1, 65535
_RESOLUTION_NS = struct.pack("<HHBxxxHH", 9, 1, 9, 0, 0)
_ALL, _SO_TIMESTAMPNS = 3, 35


class Capture:
    """A capture file; `write` is one frame."""

    def __init__(self, path: Path) -> None:
        """Begin the file; it is overwritten."""
        self._file = path.open("wb")
        self._block(_SECTION, struct.pack("<IHHq", 0x1A2B3C4D, 1, 0, -1))
        self._block(_INTERFACE, struct.pack("<HHI", _ETHERNET, 0, _LONGEST) + _RESOLUTION_NS)

    def write(self, time_ns: int, frame: bytes) -> None:
        """One frame at a time in ns."""
        stamp = struct.pack("<IIIII", 0, time_ns >> 32 & 0xFFFFFFFF, time_ns & 0xFFFFFFFF,
                            len(frame), len(frame))  # fmt: skip
        self._block(_PACKET, stamp + frame)

    def close(self) -> None:
        """End the file."""
        self._file.close()

    def _block(self, kind: int, body: bytes) -> None:
        body += b"\0" * (-len(body) % 4)
        size = struct.pack("<I", 12 + len(body))
        self._file.write(struct.pack("<I", kind) + size + body + size)


class InterfaceCapture:
    """A thread that captures everything on an interface, both ways, until it is closed."""

    def __init__(self, interface: str, path: Path) -> None:
        """Begin to capture; `OSError` without the right to raw sockets."""
        self._socket = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(_ALL))
        self._socket.bind((interface, _ALL))
        self._socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        self._socket.settimeout(0.2)
        self._capture = Capture(path)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Take what is left and end the file."""
        self._ended.set()
        self._thread.join()
        self._socket.close()
        self._capture.close()

    def __enter__(self) -> InterfaceCapture:
        """Itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close."""
        self.close()

    def _run(self) -> None:
        while True:
            try:
                frame, control, _, _ = self._socket.recvmsg(_LONGEST, 128)
            except TimeoutError:
                if self._ended.is_set():
                    return
                continue
            except OSError:  # the interface went down
                return
            stamp = time.time_ns()
            for level, kind, data in control:
                if (level, kind) == (socket.SOL_SOCKET, _SO_TIMESTAMPNS):
                    seconds, ns = struct.unpack("@ll", data[: struct.calcsize("@ll")])
                    stamp = seconds * 1_000_000_000 + ns
            self._capture.write(stamp, frame)
