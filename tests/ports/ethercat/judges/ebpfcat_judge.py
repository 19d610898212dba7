"""ebpfcat, unmodified, reads SII and dictionary: ebpfcat_judge.py DRIVES.

A program of its own: ebpfcat is under the GPL, no test imports it.
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Coroutine
from typing import Any

from ebpfcat.ethercat import EtherCat, MachineState, ObjectEntry, Terminal
from wire import MAIN, Wire, judge

DRIVES = int(sys.argv[1])
wire = Wire(DRIVES)
loop = asyncio.new_event_loop()
bus = EtherCat(MAIN)
terminals: list[Terminal] = []


def run(work: Coroutine[Any, Any, Any]) -> Any:
    return loop.run_until_complete(asyncio.wait_for(work, 60))


def scan() -> None:
    async def work() -> None:
        await bus.connect()
        assert await bus.count() == DRIVES
        for k in range(DRIVES):
            terminal = Terminal(bus)
            await terminal.initialize(-k, 100 + k)
            terminals.append(terminal)

    run(work())


def categories() -> None:
    """Every category of the SII was parsed; identity and CoE."""
    for terminal in terminals:
        assert terminal.vendorId == 0x5E4B
        assert terminal.productCode == 0x5E4B0402
        assert {10, 30, 40, 41, 50, 51, 60} <= set(terminal.eeprom), sorted(terminal.eeprom)


def dictionary() -> None:
    """Every object and entry of the dictionary is described, and what is described reads."""

    async def work(terminal: Terminal) -> tuple[int, int]:
        await terminal.to_operational(MachineState.PRE_OPERATIONAL)
        objects = await terminal.read_ODlist()
        values = 0
        for thing in objects.values():
            for sub, entry in thing.entries.items():
                if isinstance(entry, ObjectEntry) and entry.dataType.value:
                    await terminal.sdo_read(thing.index, sub)
                    values += 1
        return len(objects), values

    for terminal in terminals:
        objects, values = run(work(terminal))
        assert objects > 90, objects
        assert values > 350, values


with wire:
    judge({"scan": scan, "SII": categories, "dictionary": dictionary})
