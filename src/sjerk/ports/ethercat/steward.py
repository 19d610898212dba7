"""What falls out of Operational is brought back: a device at a time, beside the cycle.

| seen | done |
|---|---|
| Safe-operational, or an error bit | acknowledged, Operational |
| Init without its station address (power was off) | address, its own clock, everything anew |
| nothing | looked for again and again: a cable, a power supply |
| Init or Pre-operational with its address | another main device was there: nothing, for good |

The axis stays in ErrorStop until somebody resets it. Never here: the cycle, the kernel.
"""

from __future__ import annotations

import struct

from sjerk.ports.ethercat.access import MS, BusError, Steps
from sjerk.ports.ethercat.bus import Bus, Say
from sjerk.ports.ethercat.commissioning import Commissioned, set_up, to_safeop
from sjerk.ports.ethercat.datagrams import Command
from sjerk.ports.ethercat.states import ERROR, AlState

_LOOK_NS, _AGAIN_NS = 10 * MS, 50 * MS


class Steward:
    """Watches the drives of a bus; `watch` runs as long as the cycle does."""

    def __init__(self, bus: Bus, say: Say) -> None:
        """`say` is told what happens."""
        self._bus, self._say = bus, say
        self._down: dict[int, str] = {}  # position: what was said last
        self._begun: set[int] = set()  # positions that are being set up anew

    def watch(self) -> Steps[None]:
        """Look, mend, wait, without an end; only wait once another main device is there."""
        access = self._bus.access
        while True:
            wait = _LOOK_NS
            for number, drive in enumerate(self._bus.drives):
                if self._bus.c.told.foreign:
                    break
                if self._fell(number):
                    try:
                        yield from self._mend(drive)
                    except BusError as error:
                        self._told(drive, str(error))
                        wait = _AGAIN_NS
                elif self._down.pop(drive.found.position, None):
                    self._say(f"device {drive.found.position}: Operational again")
            end = access.now() + wait
            yield
            while access.now() < end:
                yield

    def _fell(self, number: int) -> bool:
        row = self._bus.c.drive[number]
        return bool(row.been_up and self._bus.c.kernel.stale[row.axis])

    def _told(self, drive: Commissioned, what: str) -> None:
        """Say it once, until something else is to be said."""
        if self._down.get(drive.found.position) != what:
            self._down[drive.found.position] = what
            self._say(
                what if what.startswith("device") else f"device {drive.found.position}: {what}"
            )

    def _mend(self, drive: Commissioned) -> Steps[None]:
        bus, station = self._bus, drive.found.station
        answer = yield from bus.access.one(Command.FPRD, station, 0x0130, bytes(6))
        if answer.counter == 0:
            if (yield from self._without_power(drive)) and bus.settings.recover:
                yield from self._anew(drive)
            return
        state, code = answer.data[0], int.from_bytes(answer.data[4:6], "little")
        if state & 0x0F < AlState.SAFEOP and drive.found.position not in self._begun:
            self._give_up(drive)
            return
        if state != AlState.OP:
            error = ", error" if state & ERROR else ""
            self._told(drive, f"0130h = {state:02X}h{error}, 0134h = {code:04X}h")
        if not bus.settings.recover or state == AlState.OP:
            return
        if state & 0x0F >= AlState.SAFEOP:
            yield from bus.access.request(station, AlState.OP)
        else:
            yield from self._anew(drive)

    def _without_power(self, drive: Commissioned) -> Steps[bool]:
        """Whether the device is there without its station address; then it has it again."""
        bus, position = self._bus, drive.found.position
        count = yield from bus.access.count()
        if count != len(bus.devices):
            self._told(drive, f"gone; {count} of {len(bus.devices)} devices answer")
            return False
        answer = yield from bus.access.one(Command.APRD, -position, 0x0010, bytes(2))
        if answer.counter != 1:
            return False
        if any(answer.data):
            self._give_up(drive)
            return False
        self._told(drive, "was without power")
        address = drive.found.station.to_bytes(2, "little")
        yield from bus.access.one(Command.APWR, -position, 0x0010, address)
        return True

    def _give_up(self, drive: Commissioned) -> None:
        self._bus.c.told.foreign = 1
        self._told(drive, "another main device has taken it; all axes stop and stay down")

    def _anew(self, drive: Commissioned) -> Steps[None]:
        bus = self._bus
        self._begun.add(drive.found.position)
        identity = yield from bus.access.sii(drive.found.station, 0x08, 4)
        if identity != struct.pack("<II", drive.found.vendor, drive.found.product):
            raise BusError("another device is in its place", drive.found.position)
        yield from bus.clocks.restore(drive.found)
        yield from set_up(bus.access, drive, bus.cycle_ns)
        yield from to_safeop(bus.access, drive, bus.clocks, bus.cycle_ns)
        yield from bus.access.request(drive.found.station, AlState.OP)
        self._begun.discard(drive.found.position)
