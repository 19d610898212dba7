"""The drive as a CANopen node (CiA 301) on any bus of python-can (extra ``canopen``).

`sdo` has the SDO protocol, `Node` the rest: NMT with boot-up, heartbeat producer and consumer,
SYNC, four receive and four transmit PDOs, emergency messages. `Node.take` is one frame in,
`Node.tick` the passing of time; `Node.run` feeds both from a bus. The time of the drive is counted
in SYNC periods; without a master that sends SYNC it runs by the clock.

Never here: what an object means, the drive's states.
"""

from __future__ import annotations

import enum
import time
from collections.abc import Callable
from typing import Any

from sjerk.drive import Device, DriveFault, DriveState
from sjerk.drive.objects import DISABLED, PDOS
from sjerk.ports.canopen.deadlines import Deadlines
from sjerk.ports.canopen.frames import Frame, Send
from sjerk.ports.canopen.sdo import SdoServer
from sjerk.ports.canopen.sync import SyncWatch

CATCH_UP_S = 0.05
"""Most of the past that the clock makes up for in a drive that no SYNC has led."""
BURST = 1000
"""Frames in a row after which time passes, whether more of them wait or not."""
CATCH_UP_SYNCED_S = 2.0
"""The same in a drive that moves when SYNC stays away: its motor has turned on meanwhile."""

_PDO_LENGTH_SHORT, _PDO_LENGTH_LONG, _PDO_TIMEOUT = 0x8210, 0x8220, 0x8250


_FAULTED = (DriveState.FAULT_REACTION_ACTIVE, DriveState.FAULT)


class NmtState(enum.IntEnum):
    """NMT states of CiA 301, as heartbeats show them."""

    INITIALISING = 0x00
    """The node starts; its boot-up message shows this state."""
    STOPPED = 0x04
    """The node takes NMT commands only, and has no master."""
    OPERATIONAL = 0x05
    """The node serves SDO and PDO."""
    PRE_OPERATIONAL = 0x7F
    """The node serves SDO, no PDO."""


class Node:
    """One drive as a CANopen node (CiA 301).

    `send(identifier, data)` puts a frame on the bus. Times are seconds of any steady clock. `nmt`
    is the NMT state, `device` the drive behind its dictionary.

    >>> frames = []
    >>> node = Node(Device(node_id=5), lambda identifier, data: frames.append((identifier, data)))
    >>> [(hex(identifier), data.hex()) for identifier, data in frames], node.nmt.name
    ([('0x705', '00')], 'PRE_OPERATIONAL')
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
        self.nmt = NmtState.INITIALISING
        self._send = send
        self._on_state: Callable[[DriveState], None] | None = None
        self._sdo = SdoServer(device)
        self._error = 0
        self._state: DriveState | None = None
        self._heartbeat_due = now
        self._master_due: float | None = None
        self._master_lost = False
        self._synced = False
        self._lived = now
        self._patience = 0.0
        self._cycle_due = now
        self._syncs = SyncWatch()
        self._bad_lengths: dict[int, int] = {}
        self._deadlines = Deadlines(device)
        self._told_deadlines = False
        self._sync_counts = [0] * PDOS
        self._pending: dict[int, bytes] = {}
        self._sent: list[bytes | None] = [None] * PDOS
        self._sent_at = [now] * PDOS
        self._sampled: list[bytes] = [b""] * PDOS
        self._boot(now)

    def announce(self, on_state: Callable[[DriveState], None]) -> None:
        """Call `on_state` with the present state of the drive, and with each one that follows."""
        self._on_state = on_state
        on_state(self.device.feedback.state)

    # ---- frames ----

    def take(self, frame: Frame, now: float) -> None:
        """Act on one frame from the bus that came at the time `now`."""
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
            if self.nmt in (NmtState.PRE_OPERATIONAL, NmtState.OPERATIONAL):
                self._serve(data, now)
        elif 0x700 < identifier < 0x780:
            self._heard(identifier - 0x700, now)
        elif self.nmt == NmtState.OPERATIONAL:
            self._process_data(identifier, data, now)

    def _serve(self, request: bytes, now: float) -> None:
        """One SDO request; without SYNC a new controlword counts before the statusword is read."""
        response = self._sdo.answer(request)
        if response is None:
            return
        if response[0] == 0x60 and response[1:4] == b"\x40\x60\x00" and not self._synced:
            self.device.cycle()
            self._after_cycle()
            self._lived = now
            self._cycle_due = now + self.device.drive.config.period_s
        self._send(0x580 + self.device.node_id, response)

    def _command(self, data: bytes, now: float) -> None:
        """NMT: start, stop, enter pre-operational, reset node, reset communication."""
        if len(data) != 2 or data[1] not in (0, self.device.node_id):
            return
        match data[0]:
            case 0x01:
                self.nmt = NmtState.OPERATIONAL
                self._sent = [None] * PDOS
            case 0x02:
                self.nmt = NmtState.STOPPED
            case 0x80:
                self.nmt = NmtState.PRE_OPERATIONAL
            case 0x81 | 0x82:
                self.device.reset(communication_only=data[0] == 0x82)
                self._boot(now)
                return
            case _:
                return
        self._pending.clear()
        # a stopped node has no master: 6007h decides
        lost = self._master_lost or self.nmt == NmtState.STOPPED
        self.device.drive.inject(DriveFault.LOST_LINK, lost)
        self._deadlines.clear()
        self._end_deadlines()

    def _boot(self, now: float) -> None:
        self._sdo = SdoServer(self.device)
        self._synced = False
        self._lived = self._cycle_due = now
        self._patience = 0.0
        self._syncs = SyncWatch()
        self._bad_lengths.clear()
        self._deadlines.clear()
        self._told_deadlines = False
        self.device.end_errors()
        self._error = self.device.feedback.error_code
        self._heartbeat_due = now
        self._master_due = None
        self._master_lost = False
        self._pending.clear()
        for cause in (DriveFault.LOST_LINK, DriveFault.RPDO_TIMEOUT):
            self.device.drive.inject(cause, False)
        self.nmt = NmtState.PRE_OPERATIONAL
        self._send(0x700 + self.device.node_id, b"\0")
        self._after_cycle()

    def _watched(self) -> tuple[int, float]:
        """Node of the master and seconds after which its silence counts; (0, 0.0): none."""
        word = int(self.device.read(0x1016, 1))
        node, time_s = word >> 16 & 0xFF, (word & 0xFFFF) * 1e-3
        return (node, time_s) if 1 <= node <= 127 and time_s else (0, 0.0)

    def _heard(self, node: int, now: float) -> None:
        watched, time_s = self._watched()
        if node == watched:
            self._master_due = now + time_s
            self._find_master()

    def _find_master(self) -> None:
        """The cause of a lost link is gone, unless the node is stopped."""
        if self._master_lost and self.nmt != NmtState.STOPPED:
            self.device.drive.inject(DriveFault.LOST_LINK, False)
        self._master_lost = False

    def _watch_master(self, now: float) -> None:
        if self._watched() == (0, 0.0):
            self._master_due = None
            self._find_master()
        elif self._master_due is not None and self._master_due <= now:
            self._master_due = None
            self._master_lost = True
            self._cycle_due = now  # no use to wait for its SYNC
            self.device.drive.inject(DriveFault.LOST_LINK)

    def _process_data(self, identifier: int, data: bytes, now: float) -> None:
        for number in range(PDOS):
            word, kind = self.device.communication(number, receive=True)
            if word & DISABLED or word & 0x7FF != identifier:
                continue
            length = self.device.length(number, receive=True)
            self._judge_length(number, len(data) - length)
            if len(data) < length:
                return
            self._deadlines.heard(number, now)
            self._end_deadlines()
            if kind <= 240:
                self._pending[number] = data
            else:
                self.device.receive(number, data)

    def _judge_length(self, number: int, more: int) -> None:
        """An emergency when a receive PDO begins to have a wrong length, and when that is over."""
        code = _PDO_LENGTH_SHORT if more < 0 else _PDO_LENGTH_LONG if more > 0 else 0
        if code == self._bad_lengths.get(number, 0):
            return
        if code:
            self._bad_lengths[number] = code
            self.device.report_error(code)
            self._emergency(code)
            return
        del self._bad_lengths[number]
        self._end_errors()

    def _end_errors(self) -> None:
        """Tell that an error of the communication is over; 1001h shows the others still."""
        if not self._bad_lengths and not self._told_deadlines:
            self.device.end_errors()
        self._emergency(0)

    def _watch_deadlines(self, now: float) -> None:
        """A receive PDO that is late is a lost link, and one emergency of drive or node."""
        for _ in self._deadlines.missed(now):
            device = self.device
            device.drive.inject(DriveFault.RPDO_TIMEOUT)
            self._cycle_due = now
            if device.read(0x6007) == 1 and device.feedback.state not in _FAULTED:
                continue  # its fault tells
            self._told_deadlines = True
            device.report_error(_PDO_TIMEOUT)
            self._emergency(_PDO_TIMEOUT)
        self._end_deadlines()

    def _end_deadlines(self) -> None:
        """Every receive PDO that is watched has come again."""
        if self._deadlines.missing:
            return
        self.device.drive.inject(DriveFault.RPDO_TIMEOUT, False)
        if self._told_deadlines:
            self._told_deadlines = False
            self._end_errors()

    def _remote(self, identifier: int, now: float) -> None:
        if self.nmt != NmtState.OPERATIONAL:
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
        if self.nmt == NmtState.STOPPED:
            return
        self._see_sync(now)
        self._synced = True
        self._lived = now
        self._patience = 0.5e-6 * int(self.device.read(0x1006))
        self._cycle_due = now + self._silence()
        for number, data in self._pending.items():
            self.device.receive(number, data)
        self._pending.clear()
        self.device.cycle()
        self._after_cycle()
        if self.nmt != NmtState.OPERATIONAL:
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

    def _silence(self) -> float:
        """Seconds without SYNC that count: by 1006h, by 2100h:7, or learned."""
        cycle, fixed = int(self.device.read(0x1006)), int(self.device.read(0x2100, 7))
        return 1.5e-6 * cycle or 1e-3 * fixed or self._syncs.limit

    def _see_sync(self, now: float) -> None:
        """Learn the interval, and hold 60C2h against it while the drive is enabled."""
        self._syncs.take(now)
        enabled = self.device.feedback.state is DriveState.OPERATION_ENABLED
        period = self._syncs.period(counts=enabled)
        if period is not None:
            self.device.drive.see_period(period)

    def _live_on(self, now: float) -> None:
        """The periods that have passed without SYNC: missed ones where SYNC led an enabled drive.

        All of them since the last SYNC: the motor does not wait until the silence counts.
        """
        device = self.device
        longest = CATCH_UP_SYNCED_S if self._synced else CATCH_UP_S
        self._lived = max(self._lived, now - longest)
        period = device.drive.config.period_s
        while self._lived + period + self._patience <= now + 1e-9:
            if device.feedback.state is not DriveState.OPERATION_ENABLED:
                self._synced, self._patience = False, 0.0
            device.cycle(sync_missed=self._synced)
            self._after_cycle()
            self._lived += period
        self._cycle_due = self._lived + period + self._patience

    def tick(self, now: float) -> float:
        """Do what is due by the time `now`; returns the time when something is due next."""
        device = self.device
        self._watch_master(now)
        self._watch_deadlines(now)
        if self._cycle_due <= now:
            self._live_on(now)
        interval = int(device.read(0x1017)) * 1e-3
        if interval and self._heartbeat_due <= now:
            self._send(0x700 + device.node_id, bytes((self.nmt,)))
            self._heartbeat_due += interval
            if self._heartbeat_due <= now:
                self._heartbeat_due = now + interval
        if self.nmt == NmtState.OPERATIONAL:
            self._events(now)
        due = [self._cycle_due]
        if interval:
            self._heartbeat_due = min(self._heartbeat_due, now + interval)
            due.append(self._heartbeat_due)
        if self._master_due is not None:
            due.append(self._master_due)
        if self._deadlines.due is not None:
            due.append(self._deadlines.due)
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
        if feedback.error_code != self._error and self.nmt != NmtState.STOPPED:
            self._error = feedback.error_code
            self._emergency(self._error)
        if feedback.state is not self._state:
            self._state = feedback.state
            if self._on_state:
                self._on_state(feedback.state)

    def _emergency(self, code: int) -> None:
        word = int(self.device.read(0x1014))
        if self.nmt in (NmtState.PRE_OPERATIONAL, NmtState.OPERATIONAL) and not word & DISABLED:
            register = int(self.device.read(0x1001))
            self._send(word & 0x7FF, code.to_bytes(2, "little") + bytes((register,)) + bytes(5))

    # ---- a bus ----

    def run(self, bus: Any, stop: Callable[[], bool]) -> None:
        """Serve a bus of python-can until `stop()` is true; it is asked every 0.1 s or sooner."""
        while not stop():
            for _ in range(BURST):
                empty = time.monotonic()
                frame = bus.recv(0)
                if frame is None:
                    break
                self.take(frame, time.monotonic())
            # what waited is no silence, however late this process looks
            due = self.tick(empty)
            frame = bus.recv(min(0.1, max(0.0, due - time.monotonic())))
            if frame is not None:
                self.take(frame, time.monotonic())
