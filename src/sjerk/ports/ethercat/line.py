"""A line of emulated drives on EtherCAT: in virtual time, or on a network interface.

>>> line = Line(drives=2)
>>> answer = line.frame(bytes.fromhex("ffffffffffff 101010101010 88a4 0e10"
...                                   "07 00 0000 3001 0200 0000 0000 0000"))
>>> answer[26], answer[28]  # Init, seen by two devices
(1, 2)

Whoever is on the cable commands the drives: EtherCAT has no authentication. This is an emulator for
tests; EtherCAT is a registered trademark and patented technology of Beckhoff Automation, and no
conformance is claimed.

Never here: what a register or a mail means.
"""

from __future__ import annotations

import os
import queue
import struct
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from pathlib import Path
from types import TracebackType
from typing import Any

from sjerk._binding import ffi, lib
from sjerk.drive import DriveConfig, DriveFault, Report
from sjerk.errors import InputError
from sjerk.ports.ethercat.behaviours import BEHAVIOURS, Behaviour
from sjerk.ports.ethercat.capture import Capture
from sjerk.ports.ethercat.esi import esi
from sjerk.ports.ethercat.subdevice import Subdevice, Tell

_POLL_NS = 20_000_000


class Line:
    """Emulated drives one behind the other, as EtherCAT subdevices."""

    def __init__(
        self,
        interface: str | None = None,
        *,
        drives: int = 1,
        behaviour: str | Behaviour | Sequence[str | Behaviour] = "free",
        config: DriveConfig | None = None,
        at: int | Sequence[int] = 0,
        drift_ppm: float = 0.0,
        hop_ns: int = 600,
        alias: int = 0,
        memory: Path | None = None,
        capture: Path | None = None,
        tell: Tell | None = None,
    ) -> None:
        """Power the drives up.

        `interface`: where they answer once the line is entered as a context or `run`; None: virtual
        time, `frame` and `advance`. `at`: increments of the encoders at the start. `drift_ppm`: the
        clocks run so much too fast and too slow in turn. `alias`: of the first drive, the others
        count on; 0 none. `memory`: a file that keeps the SII over power cycles. `capture`: frames
        in virtual time (on an interface: `sjerk.ports.ethercat.capture.InterfaceCapture`). Raises
        `InputError`.
        """
        if not 1 <= drives <= lib.SJ_ESC_LINE:
            raise InputError("drives", drives, f"must be 1 to {lib.SJ_ESC_LINE}")
        if not -1000 <= drift_ppm <= 1000:
            raise InputError("drift_ppm", drift_ppm, "must be -1000 to 1000")
        if not 0 <= hop_ns <= 1_000_000:
            raise InputError("hop_ns", hop_ns, "must be 0 to 1000000 ns")
        if not 0 <= alias <= 0xFFFF - drives:
            raise InputError("alias", alias, f"must be 0 to {0xFFFF - drives}")
        kinds = _each("behaviour", behaviour, drives, (str, Behaviour))
        places = _each("at", at, drives, (int,))
        self.now = 0
        """Virtual time, ns."""
        self._interface = interface
        self._memory = memory
        self._owned = ffi.new("sj_esc[]", drives)
        self._escs = [self._owned + k for k in range(drives)]
        self._line = ffi.new("sj_line *")
        self._line.devices, self._line.count = self._owned, drives
        self._line.hop_ns = hop_ns
        self._frame = ffi.new("uint8_t[]", lib.SJ_ESC_FRAME)
        self._capture = Capture(capture) if capture else None
        kept = memory.read_bytes() if memory and memory.exists() else b""
        size = len(kept) // drives
        self.devices = [
            Subdevice(
                self._escs[k],
                position=k,
                behaviour=_behaviour(kinds[k]),
                config=config or DriveConfig(),
                at=places[k],
                drift_ppm=drift_ppm * (-1) ** k,
                alias=alias + k if alias else 0,
                memory=(kept[k * size : (k + 1) * size] or None) if memory else None,
                keep=memory is not None,
                tell=tell,
            )
            for k in range(drives)
        ]
        """The subdevices, in their order on the cable."""
        self._commands: queue.SimpleQueue[tuple[Future[Any], Callable[[], Any]]]
        self._commands = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        self._stopped = threading.Event()
        self._failure: OSError | None = None
        self._connect(drives)

    # ---- virtual time ----

    def advance(self, ns: int) -> None:
        """Let virtual time pass: SYNC signals, periods, watchdogs, each at its own time.

        What a device's application has to decide is decided at the time that it becomes due.
        """
        if ns < 0:
            raise InputError("ns", ns, "must not be negative")
        end = self.now + ns
        passed = ffi.new("int64_t *", self.now)
        while True:
            busy = any(device.busy for device in self.devices)
            told = lib.sj_line_pass(self._line, passed, end, busy)
            self.now = passed[0]
            if told or busy:
                self._serve(self.now)
            if self.now >= end:
                return

    def frame(self, frame: bytes) -> bytes | None:
        """One Ethernet frame at the present virtual time; None: nothing comes back."""
        if self._capture:
            self._capture.write(self.now, frame)
        if len(frame) > lib.SJ_ESC_FRAME:
            return None
        ffi.memmove(self._frame, frame, len(frame))
        length = lib.sj_line_frame(self._line, self._frame, len(frame), self.now)
        self._serve(self.now)
        if length <= 0:
            return None
        answer = bytes(ffi.buffer(self._frame, length))
        if self._capture:
            self._capture.write(self.now, answer)
        return answer

    @property
    def serving(self) -> bool:
        """Whether the line answers on its interface."""
        return self._thread is not None and self._thread.is_alive()

    # ---- faults on demand ----

    def cut(self, count: int) -> None:
        """Pull the cable behind so many devices; those after it are not reached."""
        self._within("count", count, self._line.count)
        self._do(lambda: self._connect(count))

    def heal(self) -> None:
        """Plug the cable in again."""
        self._do(lambda: self._connect(self._line.count))

    def power_cycle(self, number: int) -> None:
        """Switch a device off and on: state, clock and address are gone, its position is not."""
        self._within("number", number, self._line.count - 1)
        self._do(lambda: self._power_up(number))

    def lose(self, every: int = 0) -> None:
        """Lose every so-many-th frame on its way back; 0: none."""
        self._set("lose_every", every)

    def wkc(self, every: int = 0) -> None:
        """Take 1 off the working counters of the logical datagrams of every so-many-th frame."""
        self._set("damage_every", every)

    def late(self, every: int = 0, *, ns: int = 0) -> None:
        """Answer every so-many-th frame so much later (on an interface)."""
        self._set("late_ns", ns)
        self._set("late_every", every)

    def state(self, number: int, status: int, code: int = 0) -> None:
        """Have a device change its state by itself: 0130h (with 10h its error bit) and 0134h."""
        self._within("number", number, self._line.count - 1)
        if status & 0x0F not in (1, 2, 4, 8) or status & ~0x1F:
            raise InputError("status", f"{status:#x}", "must be 1, 2, 4 or 8, or these + 10h")
        self._do(lambda: self.devices[number].force(status, code))

    def inject(self, number: int, fault: DriveFault, present: bool = True) -> None:
        """Make the cause of a drive's own fault appear or go."""
        self._within("number", number, self._line.count - 1)
        self._do(lambda: self.devices[number].device.drive.inject(fault, present))

    # ---- what there is to see ----

    def report(self, number: int = 0) -> Report:
        """The verdict of a drive on the targets it was given."""
        self._within("number", number, self._line.count - 1)
        report: Report = self._do(lambda: self.devices[number].device.drive.report())
        return report

    def status(self) -> dict[str, Any]:
        """Counters and, per device, states, words and clocks, as plain numbers."""
        status: dict[str, Any] = self._do(self._status)
        return status

    def esi(self) -> str:
        """The ESI file of the first device."""
        first = self.devices[0]
        return esi(first.dictionary, first.behaviour, bytes(first.sii))

    # ---- an interface ----

    def __enter__(self) -> Line:
        """Answer on the interface, in a thread; `OSError` without the right to raw sockets."""
        if self._interface is not None:
            descriptor = self._open()
            self._thread = threading.Thread(target=self._run, args=(descriptor,), daemon=True)
            self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Fall silent; keep the SII; raises what ended the thread."""
        self._stopped.set()
        if self._thread is not None:
            self._line.wake = 1
            self._thread.join()
            self._thread = None
        self.close()
        if self._failure is not None and error is None:
            raise self._failure

    def run(self, stop: Callable[[], bool]) -> None:
        """Answer on the interface in this thread until `stop()`; asked 50 times a second."""
        descriptor = self._open()
        try:
            self._answer(descriptor, stop)
        finally:
            lib.sj_wire_close(descriptor)

    def close(self) -> None:
        """End the capture and keep the SII."""
        if self._capture:
            self._capture.close()
            self._capture = None
        if self._memory:
            self._memory.write_bytes(b"".join(bytes(device.sii) for device in self.devices))

    # ---- inside ----

    def _open(self) -> int:
        if self._interface is None:
            raise InputError("interface", None, "must name an interface")
        descriptor = int(lib.sj_wire_open(self._interface.encode()))
        if descriptor < 0:
            why = os.strerror(-descriptor)
            raise OSError(-descriptor, f"no raw socket on {self._interface}: {why}")
        now = lib.sj_wire_now()
        for device in self.devices:
            device.power_up(now)
        self._connect(self._line.cut)
        return descriptor

    def _run(self, descriptor: int) -> None:
        try:
            self._answer(descriptor, self._stopped.is_set)
        except OSError as error:
            self._failure = error
        finally:
            lib.sj_wire_close(descriptor)

    def _answer(self, descriptor: int, stop: Callable[[], bool]) -> None:
        while not stop():
            now = lib.sj_wire_now()
            told = lib.sj_wire_serve(self._line, descriptor, now + _POLL_NS)
            if told < -1:
                raise OSError(-1 - told, f"the socket on {self._interface} failed")
            self._line.wake = 0
            self._serve(lib.sj_wire_now())
            while not self._commands.empty():
                future, command = self._commands.get()
                try:
                    future.set_result(command())
                except Exception as error:
                    future.set_exception(error)

    def _serve(self, now: int) -> None:
        waiting = 0
        for esc, device in zip(self._escs, self.devices, strict=True):
            while esc.events:
                device.serve(now)
            if device.busy:
                device.poll(now)
            waiting |= device.waiting
        self._line.watch_outputs = waiting

    def _do(self, command: Callable[[], Any]) -> Any:
        """In the thread that serves the line, or here if there is none."""
        if self._thread is None or threading.current_thread() is self._thread:
            return command()
        future: Future[Any] = Future()
        self._commands.put((future, command))
        self._line.wake = 1
        return future.result(timeout=10.0)

    def _set(self, field: str, value: int) -> None:
        if value < 0:
            raise InputError(field, value, "must not be negative")
        self._do(lambda: setattr(self._line, field, value))

    def _within(self, field: str, value: int, high: int) -> None:
        if not 0 <= value <= high:
            raise InputError(field, value, f"must be 0 to {high}")

    def _connect(self, count: int) -> None:
        """DL status 0110h: port 0 is always linked, port 1 where the next device is reached."""
        before, self._line.cut = self._line.cut, count
        for k, esc in enumerate(self._escs):
            follows = k < count - 1
            port1 = 0x0020 | 0x0800 if follows else 0x0400
            registers = ffi.buffer(esc.memory)
            struct.pack_into("<H", registers, 0x0110, 0x5211 | port1)
            if k == count - 1 and before > count and registers[0x0311][0] < 255:
                registers[0x0311] = bytes((registers[0x0311][0] + 1,))  # lost link at port 1

    def _power_up(self, number: int) -> None:
        now = self.now if self._thread is None else lib.sj_wire_now()
        self.devices[number].power_up(now)
        self._connect(self._line.cut)

    def _status(self) -> dict[str, Any]:
        line = self._line
        names = ("frames", "datagrams", "broken", "lost", "damaged", "cut")
        return {name: int(getattr(line, name)) for name in names} | {
            "devices": [
                {
                    "state": int(device.state),
                    "error": device.error,
                    "code": device.code,
                    "statusword": int(esc.tx.statusword),
                    "position": int(esc.tx.position_actual),
                    "periods": int(esc.periods),
                    "syncs": int(esc.syncs),
                    "syncs_missed": int(esc.syncs_missed),
                    "deviation_ns": float(esc.deviation_ns),
                    "samples": int(device.device.drive.report().samples),
                    "findings": {
                        kind.name: count
                        for kind, count in device.device.drive.report().findings.items()
                    },
                }
                for esc, device in zip(self._escs, self.devices, strict=True)
            ]
        }


def _each(name: str, value: Any, count: int, kinds: tuple[type, ...]) -> list[Any]:
    """One value for every device."""
    if isinstance(value, kinds):
        return [value] * count
    values = list(value)
    if len(values) != count:
        raise InputError(name, value, f"must be one value or {count}")
    return values


def _behaviour(which: str | Behaviour) -> Behaviour:
    if isinstance(which, Behaviour):
        return which
    if which not in BEHAVIOURS:
        raise InputError("behaviour", which, f"must be one of {', '.join(BEHAVIOURS)}")
    return BEHAVIOURS[which]
