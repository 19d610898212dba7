"""The running kernel as the panel sees it: feedback, trace, events; again when it was restarted.

Never here: orders, pages.
"""

from __future__ import annotations

import threading
import time
from contextlib import suppress

from sjerk.errors import HandshakeError, KernelGoneError, SjerkError
from sjerk.host import Event, EventKind, Feedback, Monitor
from sjerk.kernel.trace import Trace
from sjerk.ports.panel.scope import Scope

_RETRY = 0.5


class Watching:
    """A kernel by name; ``axes``: how many it must have."""

    def __init__(self, name: str, *, axes: int | None = None, any_owner: bool = False) -> None:
        self.name, self._axes, self._any_owner = name, axes, any_owner
        self._lock = threading.RLock()  # no thread reads what another one closes
        self._monitor: Monitor | None = None
        self._trace: Trace | None = None
        self.scope: Scope | None = None
        self._next = 0.0

    @property
    def runs(self) -> bool:
        """Whether there is a kernel, as far as is known."""
        return self._monitor is not None

    @property
    def host_pid(self) -> int | None:
        """The process that is host now; None: nobody is."""
        with self._lock:
            return None if self._monitor is None else self._monitor.host_pid

    def positions(self) -> list[float]:
        """Where the kernel has its axes now; raises KernelGoneError."""
        with self._lock:
            if self._monitor is None:
                raise KernelGoneError("no kernel runs")
            return [axis.position for axis in self._monitor.feedback().axes]

    def follow(self) -> bool:
        """Whether every drive follows its commands; raises KernelGoneError."""
        with self._lock:
            if self._monitor is None:
                raise KernelGoneError("no kernel runs")
            return all(axis.follows for axis in self._monitor.feedback().axes)

    def stop(self, *, quick: bool) -> None:
        """Ask for a stop of all axes, whoever is host, and wait for nothing.

        Raises KernelGoneError, SegmentOwnerError.
        """
        with self._lock:
            if self._monitor is None:
                raise KernelGoneError("no kernel runs")
            order = self._monitor.quick_stop if quick else self._monitor.halt
            order(timeout=0.0)

    def attach(self) -> Feedback | None:
        """Look for the kernel, some times a second; its feedback once it is there.

        Raises SjerkError where it is another robot.
        """
        now = time.monotonic()
        if now < self._next:
            return None
        self._next = now + _RETRY
        monitor = trace = None
        try:
            monitor = Monitor.attach(self.name, any_owner=self._any_owner)
            trace = Trace.attach(self.name, any_owner=self._any_owner)
            feedback = monitor.feedback()
        except (HandshakeError, KernelGoneError, TimeoutError):
            for one in (monitor, trace):
                if one is not None:
                    one.close()
            return None
        if self._axes is not None and len(feedback.axes) != self._axes:
            monitor.close()
            trace.close()
            raise SjerkError(
                f"the kernel {self.name!r} has {len(feedback.axes)} axes, the robot {self._axes}"
            )
        self._axes = len(feedback.axes)
        counts = [axis.counts_per_unit for axis in feedback.axes]
        with self._lock:
            self._monitor, self._trace = monitor, trace
        self.scope = Scope(counts, feedback.cycle_time)
        return feedback

    def feedback(self) -> Feedback | None:
        """The newest feedback, and the trace up to it in the scope; None where the kernel ended."""
        if self._monitor is None or self._trace is None or self.scope is None:
            return None
        try:
            feedback = self._monitor.feedback()
            while (chunk := self._trace.read()) is not None:
                self.scope.feed(chunk)
            return feedback
        except HandshakeError:
            return None
        except KernelGoneError:
            return None

    def events(self) -> list[Event]:
        """What has happened since, without what has no word for a person."""
        if self._monitor is None:
            return []
        with suppress(SjerkError):
            found, _ = self._monitor.events()
            return [event for event in found if event.kind is not EventKind.REACHED]
        return []

    def lost(self) -> None:
        """Let go of a kernel that has ended."""
        with self._lock:
            for one in (self._monitor, self._trace):
                if one is not None:
                    with suppress(SjerkError):
                        one.close()
            self._monitor = self._trace = None

    close = lost
