"""The running kernel as the panel sees it: feedback, trace, events; again when it was restarted.

Never here: orders, pages.
"""

from __future__ import annotations

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
        self._monitor: Monitor | None = None
        self._trace: Trace | None = None
        self.scope: Scope | None = None
        self._next = 0.0

    @property
    def monitor(self) -> Monitor | None:
        """Of the kernel that runs now."""
        return self._monitor

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
        for one in (self._monitor, self._trace):
            if one is not None:
                with suppress(SjerkError):
                    one.close()
        self._monitor = self._trace = None

    close = lost
