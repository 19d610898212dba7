"""EtherCAT drives inside a kernel's process: what its clock calls, and the thread beside it.

`port_of` makes the order for the process from the tables of a TOML file; `connect` is called there.
The cycle is C alone (`_wire.c`, `_frame.c`); a thread beside it brings back what falls out.

Never here: registers, the layout of frames.
"""

from __future__ import annotations

import sys
import threading
import time
from typing import Any

from sjerk._binding import ffi, lib
from sjerk.kernel import Port
from sjerk.ports.ethercat.access import finish
from sjerk.ports.ethercat.bus import Bus
from sjerk.ports.ethercat.settings import from_tables
from sjerk.ports.ethercat.steward import Steward
from sjerk.ports.ethercat.transports import InterfaceTransport, cyclic_socket

_MOMENT_S = 0.001


def port_of(path: str, bus: object, axes: dict[int, object]) -> Port:
    """The port of the tables [ethercat] and [axes.ethercat]; raises `ConfigError`."""
    from_tables(path, bus, axes)  # refused here, with the place in the file
    rows: dict[str, object] = {str(axis): table for axis, table in axes.items()}
    return Port(__name__, {"path": path, "bus": bus, "axes": rows})


def connect(core: Any, cycle_ns: int, table: dict[str, Any]) -> Connection:
    """Called in the kernel's process; raises `SjerkError`, `OSError`."""
    return Connection(core, cycle_ns, table)


class Connection:
    """The drives of a kernel's process on an interface."""

    def __init__(self, core: Any, cycle_ns: int, table: dict[str, Any]) -> None:
        """Set the drives up; they are Safe-operational then."""
        axes = {int(axis): given for axis, given in table["axes"].items()}
        interface, settings, drives = from_tables(table["path"], table["bus"], axes)
        self._transport = InterfaceTransport(interface, alone=True)
        try:
            self.bus = Bus(core, cycle_ns, self._transport, drives, settings)
            """What is on the cable."""
            finish(self.bus.prepare(), _moment)
            self._socket = cyclic_socket(interface)
        except BaseException:
            self._transport.close()
            raise
        self._wire = ffi.new("sj_wire_bus *")
        self._wire.bus, self._wire.socket = self.bus.c, self._socket.fileno()
        lib.sj_wire_map(self._wire)  # where that is refused, each cycle asks for what came
        self.exchange = ffi.new("sj_exchange *")
        """What the clock calls."""
        lib.sj_wire_exchange(self._wire, self.exchange)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def start(self) -> None:
        """While the cycle runs: Operational."""
        finish(self.bus.operate(), _moment)
        self._thread.start()

    def release(self) -> None:
        """While the cycle runs, all at rest and disabled: Safe-operational."""
        self._end_watch()
        finish(self.bus.release(), _moment)

    def close(self) -> None:
        """After the cycle: Init."""
        self._end_watch()
        try:
            finish(self.bus.leave(), _moment)
        finally:
            lib.sj_wire_unmap(self._wire)
            self._socket.close()
            self._transport.close()

    def _end_watch(self) -> None:
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join()

    def _watch(self) -> None:
        steps = Steward(self.bus, _tell).watch()
        while not self._ended.is_set():
            next(steps)
            time.sleep(_MOMENT_S)


def _moment() -> None:
    time.sleep(_MOMENT_S)


def _tell(what: str) -> None:
    print(f"sjerk: ethercat: {what}", file=sys.stderr, flush=True)
