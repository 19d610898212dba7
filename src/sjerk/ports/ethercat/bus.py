"""The bus of a main device: scanned, set up, aligned, taken to Operational and down again.

The cyclic frame is C (`_frame.c`); this is what happens beside it, as procedures (`access.Steps`)
that run in a thread beside a clocked kernel, or between the cycles of virtual time.

Never here: sockets, the cycle, what happens when a device falls out (`steward`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from sjerk._binding import ffi, lib
from sjerk.errors import InputError
from sjerk.ports.ethercat.access import MS, Access, BusError, Steps, Transport
from sjerk.ports.ethercat.clocks import Clocks
from sjerk.ports.ethercat.commissioning import (
    Commissioned,
    Layout,
    interval,
    set_up,
    to_safeop,
)
from sjerk.ports.ethercat.scanning import Found, scan
from sjerk.ports.ethercat.settings import BusSettings, DriveSettings
from sjerk.ports.ethercat.states import AlState

_LOGICAL = 0x10000
_EXPECTED = 3  # read 1, written 2
_ALIGN_NS, _LEAST_STEP_NS, _DEVIATION_NS = 10_000 * MS, 125_000, 1_000


class Bus:
    """Some drives of a kernel behind one transport."""

    def __init__(
        self,
        core: Any,
        cycle_ns: int,
        transport: Transport,
        drives: Mapping[int, DriveSettings],
        settings: BusSettings,
    ) -> None:
        """`core`: the kernel (``sj_kernel *``); `drives`: by axis. Raises `InputError`."""
        if not drives or len(drives) > lib.SJ_BUS_DRIVES:
            raise InputError("drives", len(drives), f"must be 1 .. {lib.SJ_BUS_DRIVES}")
        if cycle_ns % _LEAST_STEP_NS:
            raise InputError("cycle_time", cycle_ns * 1e-9, "must be a multiple of 125e-6 s")
        interval(cycle_ns)
        for axis in drives:
            if not 0 <= axis < core.axes or not core.axis[axis].config.external:
                raise InputError("drives", axis, "must be numbers of external axes")
        self.access = Access(transport)
        self.settings, self.cycle_ns = settings, cycle_ns
        self.wanted = dict(drives)
        self.devices: list[Found] = []
        """Everything on the cable, in its order."""
        self.drives: list[Commissioned] = []
        """The drives of the kernel, by their order on the cable."""
        self.clocks = Clocks(self.access, [])
        self.c = ffi.new("sj_bus *")
        """``sj_bus *``"""
        self.c.kernel, self.c.period_ns, self.c.lost = core, cycle_ns, settings.lost
        self.c.phase_ns = round(cycle_ns * (1.0 - settings.shift))

    # ---- up ----

    def prepare(self) -> Steps[None]:
        """Scan, compare, set the clocks, set every drive up: all are Safe-operational then.

        Raises `BusError` with device, object and code.
        """
        self.devices = yield from scan(self.access)
        self.drives = self._matched()
        for device in self.devices:
            yield from self.access.request(device.station, AlState.INIT)
        by_clock = any(drive.settings.activate for drive in self.drives)
        self.clocks = Clocks(self.access, self.devices if by_clock else [])
        yield from self.clocks.start()
        logical = _LOGICAL
        for drive in self.drives:
            yield from set_up(self.access, drive, self.cycle_ns)
            drive.logical = logical
            logical += max(drive.outputs.length, drive.inputs.length)
        for drive in self.drives:
            yield from to_safeop(self.access, drive, self.clocks, self.cycle_ns)
        yield from self._describe()

    def _matched(self) -> list[Commissioned]:
        """Which device is which axis's; raises `BusError`."""
        taken: dict[int, Commissioned] = {}
        for axis, settings in self.wanted.items():
            found = self._find(axis, settings)
            if found.position in taken:
                raise BusError(f"is wanted by two axes: {taken[found.position].axis} and {axis}",
                               found.position)  # fmt: skip
            check_identity(found, settings)
            taken[found.position] = Commissioned(found, settings, axis)
        if self.settings.others == "refuse":
            for device in self.devices:
                if device.position not in taken:
                    raise BusError(
                        f'{device.name!r} is on the cable and of no axis; others = "ignore"',
                        device.position,
                    )
        return [taken[position] for position in sorted(taken)]

    def _find(self, axis: int, settings: DriveSettings) -> Found:
        if settings.position is not None:
            if settings.position < len(self.devices):
                return self.devices[settings.position]
            raise BusError(f"axis {axis} wants position {settings.position}, "
                           f"{len(self.devices)} devices are on the cable")  # fmt: skip
        found = [device for device in self.devices if device.alias == settings.alias]
        if len(found) != 1:
            raise BusError(
                f"axis {axis} wants alias {settings.alias}, {len(found)} devices have it"
            )
        return found[0]

    def _describe(self) -> Steps[None]:
        """Tell the cyclic frame what it carries."""
        c, reference = self.c, self.clocks.reference
        for drive, row in zip(self.drives, c.drive, strict=False):
            row.axis, row.station, row.logical = drive.axis, drive.found.station, drive.logical
            row.out_bytes, row.in_bytes = drive.outputs.length, drive.inputs.length
            row.expected = _EXPECTED
            row.out_words = _words(row.outputs, drive.outputs, drive.found.position)
            row.in_words = _words(row.inputs, drive.inputs, drive.found.position)
        c.count = len(self.drives)
        if lib.sj_bus_lay_out(c) == 0:
            raise BusError(f"the process data need more than {lib.SJ_BUS_FRAMES} frames a cycle")
        if reference is not None:
            c.reference, c.wide = reference.station, reference.wide
            c.clock_ns = yield from self.clocks.now()
            c.clock_sent_ns = self.access.now()

    def operate(self) -> Steps[None]:
        """While the cycle runs: wait until the clocks are together, then all to Operational.

        Raises `BusError`.
        """
        end = self.access.now() + _ALIGN_NS
        while self.clocks.reference is not None and not self.c.told.aligned:
            if self.access.now() > end:
                raise BusError(f"the cycle stays {self.c.told.phase_ns * 1e-3:.1f} us away from "
                               "the drives' clock")  # fmt: skip
            yield
        for drive in self.drives:
            while drive.settings.activate:
                off = yield from self.clocks.deviation(drive.found)
                if off < _DEVIATION_NS:
                    break
                if self.access.now() > end:
                    raise BusError(f"its clock stays {off} ns off", drive.found.position)
                yield
        for drive in self.drives:
            yield from self.access.request(drive.found.station, AlState.OP)
        while not self.operational:
            if self.access.now() > end:
                raise BusError("a drive fell out of Operational at once")
            yield

    @property
    def operational(self) -> bool:
        """Whether every drive has been seen in Operational by the cycle, and answers."""
        rows = [self.c.drive[k] for k in range(self.c.count)]
        return all(row.been_up and not self.c.kernel.stale[row.axis] for row in rows)

    # ---- down ----

    def release(self) -> Steps[None]:
        """While the cycle runs and the drives are disabled: to Safe-operational."""
        yield from self._all_to(AlState.SAFEOP)

    def leave(self) -> Steps[None]:
        """After the cycle: to Init."""
        yield from self._all_to(AlState.INIT)

    def _all_to(self, state: AlState) -> Steps[None]:
        """Those that answer and are above it."""
        if self.c.told.foreign:
            return  # they are another main device's now
        for drive in self.drives:
            try:
                now, _ = yield from self.access.state(drive.found.station)
                if now & 0x0F > state:
                    yield from self.access.request(drive.found.station, state)
            except BusError:
                continue  # it is gone: nothing to take down


def check_identity(found: Found, settings: DriveSettings) -> None:
    """Raise `BusError` where a device is not the one that is wanted."""
    if settings.identity is not None and settings.identity != (found.vendor, found.product):
        vendor, product = settings.identity
        raise BusError(
            f"identity is [{found.vendor:#x}, {found.product:#x}] ({found.name}), "
            f"[{vendor:#x}, {product:#x}] is wanted",
            found.position,
        )


def _words(rows: Any, layout: Layout, device: int) -> int:
    if len(layout.words) > lib.SJ_BUS_WORDS:
        raise BusError(f"more than {lib.SJ_BUS_WORDS} objects are mapped", device)
    for row, (bit, bits, offset) in zip(rows, layout.words, strict=False):
        row.bit, row.bits, row.offset = bit, bits, offset
    return len(layout.words)


Say = Callable[[str], None]
"""Told what happens on the bus."""
