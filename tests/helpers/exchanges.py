"""The kernel's side of the exchanges of a segment, for its tests."""

from __future__ import annotations

from sjerk._binding import ffi, lib
from sjerk.handshake import Segment


def collect(segment: Segment) -> bytes | int:
    """The fresh command, or the status if there is none."""
    out = ffi.new("char[]", segment.layout.command_bytes)
    status = lib.sj_command_collect(segment.base, out)
    return bytes(ffi.buffer(out)) if status == 1 else status
