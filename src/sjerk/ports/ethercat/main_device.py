"""A kernel as the main device of EtherCAT drives, in the caller's own loop.

>>> from sjerk import Axis, Limits, MotionKernel
>>> from sjerk.ports.ethercat import Line, MainDevice
>>> axis = Axis(Limits(20.0, 400.0, 4e4), 2**24, "external", unit="rev")
>>> kernel = MotionKernel([axis], 1e-3)
>>> host = kernel.host()
>>> with MainDevice(kernel, Line(drives=1), {0: 0}) as bus:  # both in virtual time
...     host.enable()
...     bus.run(lambda: host.feedback().axes[0].follows)
...     move = host.move(1.0)
...     bus.run(lambda: move.done)
...     host.feedback().axes[0].position
1.0

With the name of an interface instead of a `Line` the same loop runs on a cable, as punctual as
Python is. ``sjerk kernel robot.toml`` has the exchange in C, inside the kernel's cycle.

Never here: registers, the layout of frames.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from sjerk._binding import ffi, lib
from sjerk.errors import InputError, SjerkError
from sjerk.kernel import MotionKernel
from sjerk.ports.ethercat.access import Steps, T, finish
from sjerk.ports.ethercat.bus import Bus, Say
from sjerk.ports.ethercat.line import Line
from sjerk.ports.ethercat.mailbox import Mailbox
from sjerk.ports.ethercat.settings import BusSettings, DriveSettings
from sjerk.ports.ethercat.steward import Steward
from sjerk.ports.ethercat.transports import InterfaceTransport, LineTransport

_REST_S = 5.0
_MOMENT_NS = 1_000_000


class MainDevice:
    """The external axes of a kernel on a line of EtherCAT drives; use as a context."""

    def __init__(
        self,
        kernel: MotionKernel,
        target: Line | str,
        drives: Mapping[int, DriveSettings | int],
        settings: BusSettings | None = None,
        *,
        say: Say | None = None,
    ) -> None:
        """Nothing is sent by this.

        `target`: a `Line` without an interface (virtual time), or the name of an interface.
        `drives`: by axis, what drives it; a number is a position on the cable. `say`: is told what
        happens on the bus. Raises `InputError`; `OSError` without the
        right to raw sockets; `BusError` where another main device is there.
        """
        self._kernel = kernel
        given = {
            axis: DriveSettings(drive) if isinstance(drive, int) else drive
            for axis, drive in drives.items()
        }
        self._line = target if isinstance(target, Line) else None
        self._transport = (
            LineTransport(target)
            if isinstance(target, Line)
            else InterfaceTransport(target, alone=True)
        )
        self._cycle_ns = round(kernel.cycle_time * 1e9)
        self.bus = Bus(
            kernel.core, self._cycle_ns, self._transport, given, settings or BusSettings()
        )
        """What is on the cable, and procedures beside the cycle."""
        self._steward = Steward(self.bus, say or (lambda _: None))
        self._watch: Steps[None] | None = None
        self._deadline = 0

    # ---- from power-up to Init again ----

    def __enter__(self) -> MainDevice:
        """Set the drives up and take them to Operational; none is enabled. Raises `BusError`."""
        try:
            finish(self.bus.prepare(), self._moment)
            self._deadline = self._transport.now()
            finish(self.bus.operate(), self._cycle)
        except BaseException:
            self._transport.close()
            raise
        self._watch = self._steward.watch()
        return self

    def __exit__(self, *_: object) -> None:
        """Halt, disable each drive, then Safe-operational and Init."""
        try:
            core = self._kernel.core
            core.ending = 1
            end = self._transport.now() + round(_REST_S * 1e9)
            self._watch = None
            while not lib.sj_kernel_at_rest(core) and self._transport.now() < end:
                self._cycle()
            finish(self.bus.release(), self._cycle)
            finish(self.bus.leave(), self._moment)
        finally:
            self._transport.close()

    # ---- in between ----

    def exchange(self) -> None:
        """One cycle at its time: what came, `MotionKernel.step`, what goes out."""
        if self._watch is None:
            raise SjerkError("the main device is not in use: enter it as a context")
        self._cycle()
        next(self._watch)

    def run(self, stop: Callable[[], bool]) -> None:
        """`exchange` until ``stop()``, which is asked in every cycle."""
        while not stop():
            self.exchange()

    def read(self, axis: int, index: int, sub: int = 0) -> bytes:
        """An object of a drive, while the cycle goes on; raises `BusError`."""
        return self._request(self._mailbox(axis).upload(index, sub))

    def write(self, axis: int, index: int, sub: int, data: bytes) -> None:
        """Write an object of a drive, while the cycle goes on; raises `BusError`."""
        self._request(self._mailbox(axis).download(index, sub, data))

    def _mailbox(self, axis: int) -> Mailbox:
        for drive in self.bus.drives:
            if drive.axis == axis and drive.mailbox is not None:
                return drive.mailbox
        raise InputError("axis", axis, "must be the number of an axis with a drive on this bus")

    def _request(self, steps: Steps[T]) -> T:
        return finish(steps, self._cycle if self._watch is not None else self._moment)

    def _moment(self) -> None:
        self._transport.wait_until(self._transport.now() + _MOMENT_NS)

    def _cycle(self) -> None:
        transport, bus, core = self._transport, self.bus.c, self._kernel.core
        transport.wait_until(self._deadline)
        for frame in transport.receive():
            lib.sj_bus_accept(bus, frame, len(frame))
        moved = lib.sj_bus_settle(bus)
        lib.sj_bus_state(bus, ffi.addressof(core, "feedback"))
        self._kernel.step()
        lib.sj_bus_compose(bus, transport.now(), self._deadline)
        for k in range(bus.frames):
            flight = bus.flight[k]
            transport.send(ffi.buffer(flight.bytes)[: flight.length])
        self._deadline += self._cycle_ns + moved
        if (behind := transport.now() - self._deadline) >= 0:
            skipped = behind // self._cycle_ns + 1
            core.feedback.late += skipped
            self._deadline += skipped * self._cycle_ns
