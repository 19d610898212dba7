"""Stops and resets that a service of a node asks for, step by step: nobody is kept waiting.

Never here: ROS, clocks.
"""

from __future__ import annotations

from contextlib import suppress

from sjerk.cycle.states import AxisState
from sjerk.errors import SjerkError
from sjerk.host import Host

#: The orders that both nodes offer as services.
ORDERS = ("halt", "quick_stop", "reset")
#: Seconds until an order counts as not done.
LONGEST = 30.0
#: Seconds in which a kernel that lives takes a reset: some cycles of it.
_TAKEN = 1.0


class Order:
    """One order: given when it is made, done when ``look`` says so; ``fault``: why it failed.

    A stop is done at rest. A reset takes the axes that an error has stopped off their drives, so
    that their commands begin where they are, resets, and enables those that were enabled: an arm
    that met something does not jump back to where it was to be.
    """

    def __init__(self, host: Host, name: str) -> None:
        """``name``: one of ``ORDERS``. Never raises."""
        self._host, self.name, self.fault = host, name, ""
        self._steps = [self._rests]
        try:
            if name == "reset":
                axes = host.feedback().axes
                stopped = [i for i, a in enumerate(axes) if a.state is AxisState.ERROR_STOP]
                self._stopped = [i for i in stopped if axes[i].enabled]
                self._steps = [self._off, self._reset, self._on, self._follow]
            elif name == "quick_stop":
                host.quick_stop(timeout=0.0)
            else:
                host.halt(timeout=0.0)
        except SjerkError as error:
            self.fault = str(error)

    def look(self) -> bool:
        """Whether it is done, or has failed; does what is due for it."""
        try:
            while not self.fault and self._steps and self._steps[0]():
                del self._steps[0]
        except (SjerkError, TimeoutError) as error:
            self.fault = str(error)
        return bool(self.fault) or not self._steps

    @property
    def answer(self) -> str:
        """Why it failed; nothing where it is done."""
        if self.fault or not self._steps:
            return self.fault
        what = "a drive still has a fault, or moves," if self.name == "reset" else "not at rest"
        return f"{what} after {LONGEST:g} s"

    def _rests(self) -> bool:
        return not self._host.feedback().moving

    def _off(self) -> bool:
        if not self._stopped:
            return True
        self._host.disable(timeout=0.0, axes=self._stopped)
        frame = self._host.feedback()
        return not any(frame.axes[i].enabled for i in self._stopped)

    def _reset(self) -> bool:
        self._host.reset(timeout=_TAKEN)
        return True

    def _on(self) -> bool:
        axes = self._host.feedback().axes
        if any(axis.fault or axis.state is AxisState.ERROR_STOP for axis in axes):
            return False
        if self._stopped:
            with suppress(TimeoutError):  # it is sent; ``_follow`` waits
                self._host.enable(timeout=0.0, axes=self._stopped)
        return True

    def _follow(self) -> bool:
        frame = self._host.feedback()
        return self._rests() and all(frame.axes[i].follows for i in self._stopped)
