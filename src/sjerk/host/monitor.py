"""What can be seen of a running kernel, by a monitor or by a host.

``Monitor`` reads only: it takes no lock, so there may be as many as are wanted. Never here:
commands, how the memory is read.
"""

from __future__ import annotations

from typing import Self

from sjerk.handshake import Segment
from sjerk.host.events import Event
from sjerk.host.feedback import Feedback
from sjerk.host.reader import EventCursor, FrameReader


class Observer:
    """What a monitor and a host have in common for their callers; a context manager."""

    def __init__(self, reader: FrameReader) -> None:
        """Not for callers: ``Monitor.attach``, ``Host.attach`` or ``MotionKernel.host``."""
        self._reader = reader
        self._events = EventCursor(reader.segment)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the kernel; what moves goes on."""
        self._reader.close()

    @property
    def name(self) -> str:
        """Name of the kernel."""
        return self._reader.segment.name

    @property
    def closed(self) -> bool:
        """Whether this host or monitor has left its kernel."""
        return self._reader.closed

    @property
    def kernel_lives(self) -> bool:
        """Whether the process of the kernel is there; always True in a caller's own loop."""
        return self._reader.kernel_lives

    def feedback(self) -> Feedback:
        """Return the newest feedback: every axis in the same cycle.

        Raises KernelGoneError where the kernel has ended: its last frame is no feedback.
        """
        self._reader.check_kernel("reading feedback")
        copy = self._reader.copy()
        return Feedback(copy, copy.cycle_time_s)

    def events(self) -> tuple[list[Event], int]:
        """Events since the last call, oldest first, and how many were overwritten unread."""
        found = []
        self._events.missed[0] = 0
        while (raw := self._events.next()) is not None:
            event = Event.of(raw.cycle, raw.kind, raw.axis, raw.code, raw.value, raw.goal_id)
            found.append(event)
        return found, int(self._events.missed[0])


class Monitor(Observer):
    """Reads a running kernel of another process: no lock, no command, as many as there are.

    >>> from sjerk import Axis, Limits, MotionKernel
    >>> axis = Axis(Limits(90.0, 500.0, 5000.0), 2**24 / 360)
    >>> with MotionKernel([axis]) as kernel, Monitor.attach(kernel.name) as monitor:
    ...     monitor.feedback().axes[0].moving
    False
    """

    @classmethod
    def attach(cls, name: str) -> Self:
        """Read the running kernel ``name``.

        Raises HandshakeError: no such kernel, another version.
        """
        reader = FrameReader(Segment.attach(name, role="monitor"))
        reader.wait_until(lambda frame: True, 5.0, "the first cycle")
        return cls(reader)
