"""Whoever reads a running kernel: its feedback and its events, through the dual-port RAM.

``Monitor`` reads only; a host, which commands too, is a ``Reader`` as well. Never here: commands,
the cycle, how the memory is read and written.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable
from functools import cache
from typing import Any, Self

from sjerk._binding import ffi, lib
from sjerk.errors import KernelGoneError, SegmentLayoutError, SjerkError, real
from sjerk.handshake import Layout, Segment
from sjerk.host.feedback import Event, Feedback

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


class Reader:
    """What a monitor and a host have in common: they read."""

    def __init__(self, segment: Segment, *, cyclic: bool = True) -> None:
        """Not for callers: ``Monitor.attach``, or ``MotionKernel.host`` for a host."""
        self._segment = segment
        self._axes = axes_of(segment)
        self._cyclic = cyclic
        self._closed = False
        self._buffer = ffi.new("sj_feedback *")
        times = 0 if cyclic else lib.sj_feedback_times()
        self._into = ffi.cast("char *", self._buffer) + times
        self._sequence = ffi.new("uint64_t *")
        self._event = ffi.new("sj_kernel_event *")
        self._missed = ffi.new("uint64_t *")
        self._shown = ffi.new("uint64_t *", lib.sj_event_latest(segment.base))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the kernel; it does not notice."""
        self._closed = True
        if self._cyclic and not self._segment.closed:
            self._segment.close()

    @property
    def name(self) -> str:
        """Name of the kernel."""
        return self._segment.name

    @property
    def closed(self) -> bool:
        """Whether this host or monitor has left its kernel."""
        return self._closed

    @property
    def kernel_lives(self) -> bool:
        """Whether the process of the kernel is there."""
        return not self._cyclic or self._segment.kernel_lives()

    def _read(self) -> Any | None:
        """The newest frame in the own buffer, or None before the first cycle."""
        if self._closed:
            raise SjerkError("this host has left its kernel")
        while True:
            status = lib.sj_feedback_read(self._segment.base, self._into, self._sequence)
            if status != lib.SJ_SHM_LAPPED:
                break
        return self._buffer if self._segment.check(status) else None

    def _frame(self) -> Any:
        frame = self._read()
        if frame is None:
            raise SjerkError("no cycle has run yet: call MotionKernel.step() first")
        return frame

    def feedback(self) -> Feedback:
        """Return the newest feedback: every axis in the same cycle.

        Raises KernelGoneError where the kernel has ended: its last frame is no feedback.
        """
        self._check_kernel("reading feedback")
        size = lib.sj_feedback_bytes(self._axes)
        copy = ffi.new("sj_feedback *")
        ffi.memmove(copy, self._frame(), size)
        return Feedback(copy, copy.cycle_time_s)

    def events(self) -> tuple[list[Event], int]:
        """Events since the last call, oldest first, and how many were overwritten unread."""
        found, event = [], self._event
        self._missed[0] = 0
        while self._next_event(self._shown):
            found.append(Event.of(event))
        return found, int(self._missed[0])

    def _next_event(self, cursor: Any) -> bool:
        base = self._segment.base
        return bool(lib.sj_event_read(base, cursor, self._event, self._missed) == 1)

    def _check_kernel(self, doing: str) -> None:
        if self._cyclic and not self._closed and not self._segment.kernel_lives():
            raise KernelGoneError(f"the kernel has ended: {doing} makes no sense")

    def _alive(self, what: str) -> None:
        if self._cyclic and not self._segment.kernel_lives():
            raise KernelGoneError(f"the kernel ended while waiting for {what}")

    def _wait_until(self, met: Callable[[Any], bool], timeout: float | None, what: str) -> None:
        if not self._cyclic:
            raise SjerkError(f"cannot wait for {what}: no process runs this kernel, call step()")
        end = None if timeout is None else time.monotonic() + real("timeout", timeout)
        look = 0
        while True:
            frame = self._read()
            if frame is not None and met(frame):
                return
            look += 1
            if look % 50 == 0:
                self._alive(what)
            if end is not None and time.monotonic() > end:
                raise TimeoutError(f"{what}: not within {timeout} s")
            time.sleep(200e-6)


class Monitor(Reader):
    """Whoever reads a running kernel: no lock, no command, as many as there are."""

    @classmethod
    def attach(cls, name: str) -> Self:
        """Read the running kernel ``name``.

        Raises HandshakeError: no such kernel, another version.
        """
        monitor = cls(Segment.attach(name, role="monitor"))
        monitor._wait_until(lambda frame: True, 5.0, "the first cycle")
        return monitor
