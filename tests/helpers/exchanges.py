"""The exchanges of a segment for its tests: the kernel's side, and the text of their C."""

from __future__ import annotations

from helpers.root import SOURCES
from sjerk._binding import ffi, lib
from sjerk.handshake import Segment


def room_text() -> str:
    """All C of the dual-port RAM as one text, to be built as it is or as a mutant."""
    return "\n".join(file.read_text() for file in sorted((SOURCES / "dpram").glob("_*.c")))


def collect(segment: Segment) -> bytes | int:
    """The fresh command, or the status if there is none."""
    out = ffi.new("char[]", segment.layout.command_bytes)
    status = lib.sj_command_collect(segment.base, out)
    return bytes(ffi.buffer(out)) if status == 1 else status
