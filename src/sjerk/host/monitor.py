"""What can be seen of a running kernel, by a monitor or by a host.

``Monitor`` reads, and can stop: it is never in the way of the host, so there may be as many as are
wanted. Never here: commands that move, how the memory is read.
"""

from __future__ import annotations

from typing import Self

from sjerk.handshake import Segment
from sjerk.host.arguments import Axes
from sjerk.host.events import Event, StopKind
from sjerk.host.feedback import Feedback, KernelState, names_of
from sjerk.host.reader import EventCursor, FrameReader
from sjerk.host.stop_requests import StopRequests


class Observer:
    """What a monitor and a host have in common for their callers; a context manager."""

    def __init__(self, reader: FrameReader) -> None:
        """Not for callers: ``Monitor.attach``, ``Host.attach`` or ``MotionKernel.host``."""
        self._reader = reader
        self._events = EventCursor(reader.segment)
        self._axis_names: tuple[str, ...] = ()

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

    @property
    def kernel_state(self) -> KernelState:
        """Whether its cycles go on: a process that is there may be suspended, or have no processor.

        It counts as suspended where its newest frame is older than 0.1 s and ten cycles.
        """
        if not self._reader.kernel_lives:
            return KernelState.GONE
        frame = self._reader.frame()
        age = self._reader.age(frame)
        if age is not None and age > 0.1 + 10.0 * frame.cycle_time_s:
            return KernelState.SUSPENDED
        return KernelState.RUNNING

    def feedback(self) -> Feedback:
        """Return the newest feedback: every axis in the same cycle.

        Raises KernelGoneError where the kernel has ended: its last frame is no feedback.
        """
        self._reader.check_kernel("reading feedback")
        copy = self._reader.copy()
        return Feedback(copy, copy.cycle_time_s, self._reader.age(copy))

    def _names(self) -> tuple[str, ...]:
        """Of the axes; they are in the first frame, and stay."""
        if not self._axis_names:
            self._axis_names = names_of(self._reader.frame())
        return self._axis_names

    def events(self) -> tuple[list[Event], int]:
        """Events since the last call, oldest first, and how many were overwritten unread."""
        found = []
        self._events.missed[0] = 0
        while (raw := self._events.next()) is not None:
            found.append(
                Event.of(
                    raw.cycle, raw.kind, raw.axis, raw.code, raw.value, raw.goal_id, self._names()
                )
            )
        return found, int(self._events.missed[0])


class Monitor(Observer):
    """Reads a running kernel of another process, and can stop it; as many as there are.

    Its pages are mapped for reading only until the first stop.

    >>> from sjerk import Axis, Limits, MotionKernel
    >>> axis = Axis(Limits(90.0, 500.0, 5000.0), 2**24 / 360)
    >>> with MotionKernel([axis]) as kernel, Monitor.attach(kernel.name) as monitor:
    ...     monitor.feedback().axes[0].moving
    False
    """

    @classmethod
    def attach(cls, name: str, *, any_owner: bool = False) -> Self:
        """Read the running kernel ``name``; ``any_owner``: also one of another user.

        Raises HandshakeError: no such kernel, another version, another user's.
        """
        reader = FrameReader(Segment.attach(name, role="monitor", any_owner=any_owner))
        reader.wait_until(lambda frame: True, 5.0, "the first cycle")
        return cls(reader, any_owner=any_owner)

    def __init__(self, reader: FrameReader, *, any_owner: bool = False) -> None:
        """Not for callers: ``attach``."""
        super().__init__(reader)
        self._stops = StopRequests(reader.segment, any_owner=any_owner)

    def close(self) -> None:
        """Let go of the kernel; what moves goes on."""
        self._stops.close()
        super().close()

    @property
    def host_pid(self) -> int | None:
        """The process that is host now; None: nobody is."""
        return self._reader.segment.host_pid()

    def halt(self, timeout: float | None = 30.0, *, axes: Axes = None) -> None:
        """Bring axes to rest within the limits of their moves, whoever is host; returns at rest.

        The kernel takes it in its next cycle, refuses a goal of that cycle, drops what waits for
        these axes, and tells it as an event (``EventKind.STOP``) with this process. The host stays
        host: it may move them again. ``timeout`` in s; 0: it is asked for, and returns at once.

        Raises InputError for axes that the kernel has not, KernelGoneError, TimeoutError,
        SegmentOwnerError where this user may only read.

        >>> from sjerk import Axis, Limits, MotionKernel
        >>> axis = Axis(Limits(90.0, 500.0, 5000.0), 2**24 / 360)
        >>> with MotionKernel([axis]) as kernel, Monitor.attach(kernel.name) as monitor:
        ...     host = kernel.host()
        ...     host.enable()
        ...     move = host.move(1000.0)
        ...     move.accepted()
        ...     monitor.halt()
        ...     print(move.state.name)
        STOPPED
        """
        self._stops.stop(StopKind.HALT, axes, timeout)

    def quick_stop(self, timeout: float | None = 30.0, *, axes: Axes = None) -> None:
        """As ``halt``, but each axis as soon as its own stop limits allow."""
        self._stops.stop(StopKind.QUICK_STOP, axes, timeout)
