"""The drive as a CANopen node (CiA 301) on any bus of python-can (extra ``canopen``).

`SdoServer` speaks the SDO protocol, `Node` the rest: NMT with boot-up, heartbeat producer and
consumer, SYNC, four receive and four transmit PDOs, emergency messages. `Node.take` is one frame
in, `Node.tick` the passing of time; `Node.run` feeds both from a bus. The time of the drive is
counted in SYNC periods; without a master that sends SYNC it runs by the clock.

Never here: what an object means, the drive's states.
"""

from __future__ import annotations

import argparse
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

from sjerk.cia402 import MOTORS, Drive, DriveConfig, Fault, State
from sjerk.drive.device import Device
from sjerk.drive.objects import DISABLED, PDOS, Abort, SdoError, entry
from sjerk.errors import ExtraMissingError

INITIALISING, STOPPED, OPERATIONAL, PRE_OPERATIONAL = 0x00, 0x04, 0x05, 0x7F
"""NMT states, as heartbeats show them."""

SYNC_GRACE_S = 0.5
"""Silence after which SYNC counts as missed when 1006h gives no cycle period."""
CATCH_UP_S = 0.05
"""Most of the past that the clock makes up for when nobody sends SYNC."""

_PDO_LENGTH_SHORT, _PDO_LENGTH_LONG = 0x8210, 0x8220

Send = Callable[[int, bytes], None]


class Frame(Protocol):
    """What a port needs of ``can.Message``."""

    arbitration_id: int
    data: bytearray
    is_extended_id: bool
    is_remote_frame: bool
    is_error_frame: bool


class SdoServer:
    """The SDO protocol of CiA 301: expedited and segmented, one transfer at a time."""

    def __init__(self, device: Device) -> None:
        """Serve the dictionary of a device."""
        self._device = device
        self._place = (0, 0)
        self._up: bytes | None = None
        self._down: bytearray | None = None
        self._size = 0
        self._toggle = 0

    def answer(self, request: bytes) -> bytes | None:
        """The response to a request; None: an abort needs none."""
        if len(request) != 8:
            return self._abort(Abort.COMMAND)
        command = request[0] >> 5
        if command in (1, 2):
            self._up = self._down = None
            self._place = (request[1] | request[2] << 8, request[3])
        try:
            match command:
                case 0:
                    return self._take_segment(request)
                case 1:
                    return self._begin_download(request)
                case 2:
                    return self._begin_upload()
                case 3:
                    return self._give_segment(request)
                case 4:
                    self._up = self._down = None
                    return None
                case _:
                    return self._abort(Abort.COMMAND)
        except SdoError as error:
            return self._abort(error.abort)

    def _abort(self, abort: Abort) -> bytes:
        self._up = self._down = None
        return self._head(0x80) + int(abort).to_bytes(4, "little")

    def _head(self, first: int) -> bytes:
        index, sub = self._place
        return bytes((first, index & 0xFF, index >> 8, sub))

    def _begin_download(self, request: bytes) -> bytes:
        row = entry(*self._place)
        expedited, sized = request[0] & 2, request[0] & 1
        if expedited:
            size = 4 - (request[0] >> 2 & 3) if sized else min(row.type.size, 4)
            self._device.download(*self._place, bytes(request[4 : 4 + size]))
        else:
            if row.access == "ro":
                raise SdoError(Abort.READ_ONLY, *self._place)
            self._size = int.from_bytes(request[4:8], "little") if sized else row.type.size
            if self._size != row.type.size:
                too_long = self._size > row.type.size
                raise SdoError(Abort.TOO_LONG if too_long else Abort.TOO_SHORT, *self._place)
            self._down, self._toggle = bytearray(), 0
        return self._head(0x60) + bytes(4)

    def _take_segment(self, request: bytes) -> bytes:
        if self._down is None:
            return self._abort(Abort.COMMAND)
        if request[0] >> 4 & 1 != self._toggle:
            return self._abort(Abort.TOGGLE)
        self._down += request[1 : 8 - (request[0] >> 1 & 7)]
        if len(self._down) > self._size:
            return self._abort(Abort.TOO_LONG)
        response = bytes((0x20 | self._toggle << 4,)) + bytes(7)
        self._toggle ^= 1
        if request[0] & 1:
            data, self._down = bytes(self._down), None
            self._device.download(*self._place, data)
        return response

    def _begin_upload(self) -> bytes:
        data = self._device.upload(*self._place)
        if len(data) <= 4:
            return self._head(0x43 | (4 - len(data)) << 2) + data.ljust(4, b"\0")
        self._up, self._toggle = data, 0
        return self._head(0x41) + len(data).to_bytes(4, "little")

    def _give_segment(self, request: bytes) -> bytes:
        if self._up is None:
            return self._abort(Abort.COMMAND)
        if request[0] >> 4 & 1 != self._toggle:
            return self._abort(Abort.TOGGLE)
        part, rest = self._up[:7], self._up[7:]
        first = self._toggle << 4 | (7 - len(part)) << 1 | (not rest)
        self._toggle ^= 1
        self._up = rest or None
        return bytes((first,)) + part.ljust(7, b"\0")


class Node:
    """One drive as a CANopen node.

    `send(identifier, data)` puts a frame on the bus. Times are seconds of any steady clock.
    """

    def __init__(
        self,
        device: Device,
        send: Send,
        *,
        now: float = 0.0,
    ) -> None:
        """Boot up: send the boot-up message and enter Pre-operational."""
        self.device = device
        self.nmt = INITIALISING
        self._send = send
        self._on_state: Callable[[State], None] | None = None
        self._sdo = SdoServer(device)
        self._error = 0
        self._state: State | None = None
        self._heartbeat_due = now
        self._master_due: float | None = None
        self._synced = False
        self._cycle_due = now
        self._sync_counts = [0] * PDOS
        self._pending: dict[int, bytes] = {}
        self._sent: list[bytes | None] = [None] * PDOS
        self._sent_at = [now] * PDOS
        self._sampled: list[bytes] = [b""] * PDOS
        self._boot(now)

    def announce(self, on_state: Callable[[State], None]) -> None:
        """Have `on_state` told the present state and each one that follows."""
        self._on_state = on_state
        on_state(self.device.feedback.state)

    # ---- frames ----

    def take(self, frame: Frame, now: float) -> None:
        """Act on one frame from the bus."""
        if frame.is_extended_id or frame.is_error_frame:
            return
        identifier, data = frame.arbitration_id, bytes(frame.data)
        if frame.is_remote_frame:
            self._remote(identifier, now)
        elif identifier == 0x000:
            self._command(data, now)
        elif identifier == int(self.device.read(0x1005)) & 0x7FF:
            self._sync(now)
        elif identifier == 0x600 + self.device.node_id:
            if self.nmt in (PRE_OPERATIONAL, OPERATIONAL):
                self._serve(data, now)
        elif 0x700 < identifier < 0x780:
            self._heard(identifier - 0x700, now)
        elif self.nmt == OPERATIONAL:
            self._process_data(identifier, data)

    def _serve(self, request: bytes, now: float) -> None:
        """One SDO request; without SYNC a new controlword counts before the statusword is read."""
        response = self._sdo.answer(request)
        if response is None:
            return
        if response[0] == 0x60 and response[1:4] == b"\x40\x60\x00" and not self._synced:
            self.device.cycle()
            self._after_cycle()
            self._cycle_due = now + self.device.drive.config.period_s
        self._send(0x580 + self.device.node_id, response)

    def _command(self, data: bytes, now: float) -> None:
        """NMT: start, stop, enter pre-operational, reset node, reset communication."""
        if len(data) != 2 or data[1] not in (0, self.device.node_id):
            return
        match data[0]:
            case 0x01:
                self.nmt = OPERATIONAL
                self._sent = [None] * PDOS
            case 0x02:
                self.nmt = STOPPED
            case 0x80:
                self.nmt = PRE_OPERATIONAL
            case 0x81 | 0x82:
                self.device.reset(communication_only=data[0] == 0x82)
                self._boot(now)
                return
            case _:
                return
        self._pending.clear()
        # a stopped node has no master: 6007h decides
        self.device.drive.inject(Fault.LOST_LINK, self.nmt == STOPPED)

    def _boot(self, now: float) -> None:
        self._sdo = SdoServer(self.device)
        self._synced = False
        self._cycle_due = now
        self._heartbeat_due = now
        self._master_due = None
        self._pending.clear()
        self.device.drive.inject(Fault.LOST_LINK, False)
        self.nmt = PRE_OPERATIONAL
        self._send(0x700 + self.device.node_id, b"\0")
        self._after_cycle()

    def _heard(self, node: int, now: float) -> None:
        watched = int(self.device.read(0x1016, 1))
        if watched >> 16 & 0x7F == node and watched & 0xFFFF:
            if self._master_due is not None and self.nmt != STOPPED:
                self.device.drive.inject(Fault.LOST_LINK, False)
            self._master_due = now + (watched & 0xFFFF) * 1e-3

    def _process_data(self, identifier: int, data: bytes) -> None:
        for number in range(PDOS):
            word, kind = self.device.communication(number, receive=True)
            if word & DISABLED or word & 0x7FF != identifier:
                continue
            length = self.device.length(number, receive=True)
            if len(data) < length:
                self._emergency(_PDO_LENGTH_SHORT)
                return
            if len(data) > length:
                self._emergency(_PDO_LENGTH_LONG)
            if kind <= 240:
                self._pending[number] = data
            else:
                self.device.receive(number, data)

    def _remote(self, identifier: int, now: float) -> None:
        if self.nmt != OPERATIONAL:
            return
        for number in range(PDOS):
            word, kind = self.device.communication(number, receive=False)
            if word & DISABLED or word & 0x40000000 or word & 0x7FF != identifier:
                continue
            if kind == 252:
                self._send(identifier, self._sampled[number])
            else:
                self._transmit(number, now)

    # ---- periods ----

    def _sync(self, now: float) -> None:
        if self.nmt == STOPPED:
            return
        self._synced = True
        period = int(self.device.read(0x1006)) * 1.5e-6
        self._cycle_due = now + (period or SYNC_GRACE_S)
        for number, data in self._pending.items():
            self.device.receive(number, data)
        self._pending.clear()
        self.device.cycle()
        self._after_cycle()
        if self.nmt != OPERATIONAL:
            return
        for number in range(PDOS):
            word, kind = self.device.communication(number, receive=False)
            if word & DISABLED:
                continue
            if kind == 252:
                self._sampled[number] = self.device.transmit(number)
            elif kind == 0:
                self._transmit_if_changed(number, now)
            elif kind <= 240:
                self._sync_counts[number] += 1
                if self._sync_counts[number] >= kind:
                    self._sync_counts[number] = 0
                    self._transmit(number, now)

    def tick(self, now: float) -> float:
        """Do what is due by now; returns when the next is."""
        device = self.device
        if self._cycle_due <= now - CATCH_UP_S:
            self._cycle_due = now
        while self._cycle_due <= now:
            enabled = device.feedback.state is State.OPERATION_ENABLED
            self._synced = self._synced and enabled
            device.cycle(sync_missed=self._synced)
            self._after_cycle()
            self._cycle_due += device.drive.config.period_s
        if self._master_due is not None and self._master_due <= now:
            self._master_due = None
            device.drive.inject(Fault.LOST_LINK)
        interval = int(device.read(0x1017)) * 1e-3
        if interval and self._heartbeat_due <= now:
            self._send(0x700 + device.node_id, bytes((self.nmt,)))
            self._heartbeat_due += interval
            if self._heartbeat_due <= now:
                self._heartbeat_due = now + interval
        if self.nmt == OPERATIONAL:
            self._events(now)
        due = [self._cycle_due]
        if interval:
            self._heartbeat_due = min(self._heartbeat_due, now + interval)
            due.append(self._heartbeat_due)
        if self._master_due is not None:
            due.append(self._master_due)
        return min(due)

    def _events(self, now: float) -> None:
        for number in range(PDOS):
            word, kind = self.device.communication(number, receive=False)
            if word & DISABLED or kind < 254:
                continue
            timer = int(self.device.read(0x1800 + number, 5)) * 1e-3
            if timer and now - self._sent_at[number] >= timer:
                self._transmit(number, now)
            elif now - self._sent_at[number] >= int(self.device.read(0x1800 + number, 3)) * 1e-4:
                self._transmit_if_changed(number, now)

    def _transmit_if_changed(self, number: int, now: float) -> None:
        if self.device.transmit(number) != self._sent[number]:
            self._transmit(number, now)

    def _transmit(self, number: int, now: float) -> None:
        data = self.device.transmit(number)
        self._sent[number], self._sent_at[number] = data, now
        self._send(self.device.communication(number, receive=False)[0] & 0x7FF, data)

    def _after_cycle(self) -> None:
        feedback = self.device.feedback
        if feedback.error_code != self._error:
            self._error = feedback.error_code
            self._emergency(self._error)
        if feedback.state is not self._state:
            self._state = feedback.state
            if self._on_state:
                self._on_state(feedback.state)

    def _emergency(self, code: int) -> None:
        word = int(self.device.read(0x1014))
        if self.nmt in (PRE_OPERATIONAL, OPERATIONAL) and not word & DISABLED:
            register = self.device.feedback.error_register
            self._send(word & 0x7FF, code.to_bytes(2, "little") + bytes((register,)) + bytes(5))

    # ---- a bus ----

    def run(self, bus: Any, stop: Callable[[], bool]) -> None:
        """Serve a python-can bus until `stop()` is true; looks at it ten times a second or more."""
        while not stop():
            due = self.tick(time.monotonic())
            frame = bus.recv(min(0.1, max(0.0, due - time.monotonic())))
            while frame is not None:
                self.take(frame, time.monotonic())
                frame = bus.recv(0)


def sender(bus: Any) -> Send:
    """`send` of a python-can bus."""
    import can

    def send(identifier: int, data: bytes) -> None:
        bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))

    return send


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of ``python -m sjerk drive``."""
    parser.add_argument("--interface", default="udp_multicast", help="of python-can")
    parser.add_argument("--channel", default="239.74.163.2", help="of python-can")
    parser.add_argument(
        "--option",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="one more option of the interface, such as bitrate=1000000; may be repeated",
    )
    parser.add_argument("--node", type=int, default=5, help="node number, 1 to 127")
    parser.add_argument("--motor", default="SGM7J-04A", choices=sorted(MOTORS))
    parser.add_argument("--load-inertia", type=float, default=1.0, help="load / rotor inertia")
    parser.add_argument("--eds", type=Path, help="write the electronic data sheet here first")


def run(arguments: argparse.Namespace) -> int:
    """Be a CANopen drive until SIGINT or SIGTERM; returns the exit code."""
    try:
        import can
    except ImportError as fault:
        raise ExtraMissingError("can", "canopen") from fault
    if not 1 <= arguments.node <= 127:
        print(f"--node {arguments.node} is outside 1 .. 127", file=sys.stderr)
        return 2
    try:
        config = DriveConfig.for_motor(arguments.motor, load_inertia_ratio=arguments.load_inertia)
    except ValueError as error:
        print(error, file=sys.stderr)
        return 2
    device = Device(Drive(config), node_id=arguments.node)
    if arguments.eds:
        arguments.eds.write_text(device.data_sheet(arguments.eds.name))

    stopping = False

    def stop(*_: object) -> None:
        nonlocal stopping
        stopping = True

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
    options: dict[str, Any] = {}
    for option in arguments.option:
        name, _, value = option.partition("=")
        options[name] = int(value) if value.isdecimal() else value
    try:
        bus = can.Bus(interface=arguments.interface, channel=arguments.channel, **options)
    except (can.CanError, OSError, ValueError, TypeError, ImportError) as error:
        print(f"no bus {arguments.interface} {arguments.channel}: {error}", file=sys.stderr)
        return 1

    def tell(state: State) -> None:
        print(f"node {arguments.node}: {state.name.replace('_', ' ').lower()}", flush=True)

    with bus:
        node = Node(device, sender(bus), now=time.monotonic())
        print(
            f"node {arguments.node} ({arguments.motor}) is ready on "
            f"{arguments.interface} {arguments.channel}",
            flush=True,
        )
        node.announce(tell)
        try:
            node.run(bus, lambda: stopping)
        except (can.CanError, OSError) as error:
            print(f"the bus failed: {error}", file=sys.stderr)
            return 1
    print(device.drive.report(), flush=True)
    return 0
