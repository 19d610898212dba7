"""Stops beside the host: what any process of the owner can ask of a running kernel.

The kernel takes a request in its next cycle, whoever is host and whatever that one does, and tells
it as an event with the process that asked. Never here: commands of the host, how axes stop.
"""

from __future__ import annotations

import threading
import time

from sjerk._binding import lib
from sjerk.errors import KernelGoneError, real
from sjerk.handshake import Segment
from sjerk.host.arguments import Axes, axis_numbers
from sjerk.host.events import StopKind
from sjerk.host.reader import FrameReader

_GONE = "the kernel has ended: stopping makes no sense"


class StopRequests:
    """The stop requests of one process; it maps the kernel's memory to write at the first one."""

    def __init__(self, segment: Segment, *, any_owner: bool = False) -> None:
        """``segment``: of the kernel that is meant, as a monitor has it."""
        self._segment = segment
        self._any_owner = any_owner
        self._lock = threading.Lock()
        self._reader: FrameReader | None = None

    def close(self) -> None:
        """Give the slot back; a request that waits for the kernel stays."""
        with self._lock:
            if self._reader is not None:
                self._reader.close()

    def _open(self) -> FrameReader:
        """A reader of its own, so that a thread may stop while others read."""
        with self._lock:
            if not self._segment.kernel_lives():
                raise KernelGoneError(_GONE)
            if self._reader is None:
                mine = Segment.attach(
                    self._segment.name,
                    self._segment.layout,
                    role="stopper",
                    any_owner=self._any_owner,
                )
                if not mine.is_same(self._segment):  # another kernel has the name meanwhile
                    mine.close()
                    raise KernelGoneError(_GONE)
                self._reader = FrameReader(mine)
            return self._reader

    def stop(self, kind: StopKind, axes: Axes, timeout: float | None) -> None:
        """Ask, and return when these axes are at rest, ``timeout`` in s; with 0 at once.

        Raises InputError for axes that the kernel has not, KernelGoneError, TimeoutError.
        """
        reader = self._open()
        chosen = axis_numbers(axes, reader.axes)
        bits = sum(1 << i for i in set(chosen))
        halts, quick_stops = (bits, 0) if kind is StopKind.HALT else (0, bits)
        base, slot = reader.segment.base, reader.segment.stop_slot
        lib.sj_stop_request(base, slot, halts, quick_stops)
        if timeout == 0.0:
            return
        end = None if timeout is None else time.monotonic() + real("timeout", timeout)
        while lib.sj_stop_waits(base, slot):
            reader.check_awaited("the stop")
            if end is not None and time.monotonic() > end:
                raise TimeoutError(f"the stop: not taken by the kernel within {timeout} s")
            time.sleep(200e-6)
        taken = lib.sj_feedback_latest(base)  # the frame of that cycle is one of the next
        left = None if end is None else max(0.0, end - time.monotonic())
        reader.wait_until(
            lambda frame: reader.number > taken and not any(frame.axis[i].moving for i in chosen),
            left,
            "the stop",
        )
