"""Reading a running kernel through the dual-port RAM: its newest frame, and its events in order.

``FrameReader`` is what a monitor has; the link of a host reads in the same way. Never here:
commands, the cycle, how the memory is read and written.
"""

from __future__ import annotations

import asyncio
import hashlib
import time
from collections.abc import Callable
from functools import cache
from typing import Any

from sjerk._binding import ffi, lib
from sjerk.errors import KernelGoneError, SegmentLayoutError, SjerkError, real
from sjerk.handshake import Layout, Segment

#: How many records the look-ahead ring holds.
RECORDS = 512
_EVENTS = 1024


@cache
def layout(axes: int, *, clocked: bool = True) -> Layout:
    """Layout of the segment of a kernel with so many axes; ``clocked``: in a process of its own."""
    return Layout(
        command_bytes=lib.sj_command_bytes(axes),
        feedback_bytes=lib.sj_feedback_bytes(axes) - (0 if clocked else lib.sj_feedback_times()),
        record_bytes=lib.sj_record_bytes(axes),
        record_capacity=RECORDS,
        event_bytes=ffi.sizeof("sj_kernel_event"),
        event_capacity=_EVENTS,
        abi=_abi(),
    )


@cache
def _abi() -> int:
    """Hash of the payload structs: names, types and offsets of every field."""

    def describe(ctype: Any) -> str:
        if ctype.kind == "array":
            return f"[{ctype.length}]{describe(ctype.item)}"
        if ctype.kind != "struct":
            return str(ctype.cname)
        return "".join(f"{n}:{f.offset}:{describe(f.type)};" for n, f in ctype.fields)

    payloads = ("sj_command", "sj_feedback", "sj_record", "sj_kernel_event")
    text = "".join(describe(ffi.typeof(name)) for name in payloads)
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little")


def axes_of(segment: Segment) -> int:
    """How many axes the kernel of a segment has; raises SegmentLayoutError for another version."""
    whole, one = lib.sj_command_bytes(1), lib.sj_command_bytes(2) - lib.sj_command_bytes(1)
    axes = (segment.layout.command_bytes - whole) // one + 1
    known = (layout(axes, clocked=clocked) for clocked in (True, False))
    if not 1 <= axes <= lib.SJ_AXES or segment.layout not in known:
        raise SegmentLayoutError(f"{segment.name!r} is of another version", name=segment.name)
    return int(axes)


class EventCursor:
    """A place in the events of a kernel; ``missed``: how many were overwritten unread."""

    def __init__(self, segment: Segment) -> None:
        """From the newest event on."""
        self._segment = segment
        self._cursor = ffi.new("uint64_t *", lib.sj_event_latest(segment.base))
        self._event = ffi.new("sj_kernel_event *")
        self.missed = ffi.new("uint64_t *")

    def next(self) -> Any | None:
        """The next ``sj_kernel_event``, valid until the next call; None if there is none yet."""
        status = lib.sj_event_read(self._segment.base, self._cursor, self._event, self.missed)
        return self._event if status == 1 else None


class FrameReader:
    """The newest frame of a kernel, and waiting for one that is wanted.

    ``axes``: how many the kernel has. ``clocked``: a process runs its cycle, so that waiting makes
    sense; else the caller's own loop does. ``buffer``: the ``sj_feedback *`` that ``read`` fills.
    """

    def __init__(self, segment: Segment, *, clocked: bool = True) -> None:
        """Raises SegmentLayoutError for a kernel of another version."""
        self.segment = segment
        self.axes = axes_of(segment)
        self.clocked = clocked
        self.closed = False
        self.buffer = ffi.new("sj_feedback *")
        times = 0 if clocked else lib.sj_feedback_times()
        self._into = ffi.cast("char *", self.buffer) + times
        self._number = ffi.new("uint64_t *")

    def close(self) -> None:
        """Let go of the segment; the kernel does not notice."""
        self.closed = True
        if self.clocked and not self.segment.closed:
            self.segment.close()

    def read(self) -> Any | None:
        """The newest ``sj_feedback`` in the own buffer, or None before the first cycle."""
        if self.closed:
            raise SjerkError("this host has left its kernel")
        while True:
            status = lib.sj_feedback_read(self.segment.base, self._into, self._number)
            if status != lib.SJ_SHM_LAPPED:
                break
        return self.buffer if self.segment.check(status) else None

    @property
    def number(self) -> int:
        """Of the frame that was read last: frames are counted since the segment was made."""
        return int(self._number[0])

    def frame(self) -> Any:
        """As ``read``; raises SjerkError before the first cycle."""
        frame = self.read()
        if frame is None:
            raise SjerkError("no cycle has run yet: call MotionKernel.step() first")
        return frame

    def age(self, frame: Any) -> float | None:
        """Seconds since the begin of the cycle of a frame; None in a caller's own loop."""
        if not self.clocked:
            return None
        return max(0.0, (int(lib.sj_clock_now_ns()) - int(frame.time_ns)) * 1e-9)

    def copy(self) -> Any:
        """A copy of the newest frame."""
        copy = ffi.new("sj_feedback *")
        ffi.memmove(copy, self.frame(), lib.sj_feedback_bytes(self.axes))
        return copy

    @property
    def kernel_lives(self) -> bool:
        """Whether the process of the kernel is there."""
        return not self.clocked or self.segment.kernel_lives()

    def check_kernel(self, doing: str) -> None:
        """Raise KernelGoneError where ``doing`` something with the kernel makes no sense."""
        if not self.closed and not self.kernel_lives:
            raise KernelGoneError(f"the kernel has ended: {doing} makes no sense")

    # ---- waiting

    def check_awaited(self, what: str) -> None:
        """Raise KernelGoneError where nothing can be waited for any more."""
        if not self.kernel_lives:
            raise KernelGoneError(f"the kernel ended while waiting for {what}")

    def wait_until(self, met: Callable[[Any], bool], timeout: float | None, what: str) -> None:
        """Return when a frame is as wanted; raises TimeoutError, KernelGoneError, SjerkError."""
        if not self.clocked:
            raise SjerkError(f"cannot wait for {what}: no process runs this kernel, call step()")
        end = None if timeout is None else time.monotonic() + real("timeout", timeout)
        look = 0
        while True:
            frame = self.read()
            if frame is not None and met(frame):
                return
            look += 1
            if look % 50 == 0:
                self.check_awaited(what)
            if end is not None and time.monotonic() > end:
                raise TimeoutError(f"{what}: not within {timeout} s")
            time.sleep(200e-6)

    async def until(self, met: Callable[[], bool], what: str) -> None:
        """As ``wait_until`` without an end, for a program with an event loop."""
        while not met():
            self.check_awaited(what)
            await asyncio.sleep(1e-3)
