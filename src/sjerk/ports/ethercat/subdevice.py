"""One emulated EtherCAT subdevice: its states, its mailbox, its drive.

The controller in C tells what the wire did (`Subdevice.serve`), time is told by `Subdevice.poll`.
On the way to Safe-operational the configuration is checked and it is decided what begins the
periods: SYNC0, a buffer of outputs, or the local clock.

Never here: frames, what a mail means.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

from sjerk._binding import ffi, lib
from sjerk.drive import DriveConfig, DriveConfigError, DriveFault, DriveState
from sjerk.drive.entries import SdoError
from sjerk.ports.ethercat.behaviours import Behaviour
from sjerk.ports.ethercat.coe import HEADER, CoeServer, Mail
from sjerk.ports.ethercat.dictionary import Dictionary, Layout, Mapped
from sjerk.ports.ethercat.servo import WireDevice, targets_in, word_of
from sjerk.ports.ethercat.sii import Area, areas, sii
from sjerk.ports.ethercat.states import ERROR, AlCode, AlState, refusal

OP_TIMEOUT_NS = 5_000_000_000
"""Longest wait for outputs and SYNC0 on the way to Operational."""
_QUEUE = 8
"""Mails that wait; above, the mailbox of the main device stays full."""
_STATION, _ALIAS, _AL_CONTROL, _AL_STATUS, _AL_CODE, _SII, _SM, _SYNC = (
    0x0010, 0x0012, 0x0120, 0x0130, 0x0134, 0x0502, 0x0800, 0x0980,
)  # fmt: skip
_FULL, _WRITTEN = 0x08, 0x01
_SYNC_ERROR = 0x8700

Tell = Callable[[int, str], None]
"""Told the number of the device and what happened."""


class Waiting(NamedTuple):
    """A transition to Operational that waits for its conditions."""

    until_ns: int
    output_ns: int
    syncs: int


class Subdevice:
    """One subdevice of a line. Its memory and its clock are the controller's (``sj_esc *``)."""

    def __init__(
        self,
        esc: Any,
        *,
        position: int,
        behaviour: Behaviour,
        config: DriveConfig,
        at: int = 0,
        drift_ppm: float = 0.0,
        alias: int = 0,
        memory: bytes | None = None,
        keep: bool = False,
        tell: Tell | None = None,
    ) -> None:
        """Power the device up. `memory`: contents of the SII,
        `keep`: what is written to it survives a power cycle.
        """
        self.position = position
        self.behaviour = behaviour
        self._esc = esc
        self._config = config
        self._tell = tell
        self._drift_ppb = round(drift_ppm * 1000)
        self.device = WireDevice(esc, config, at=at)
        self.dictionary = Dictionary(self.device, behaviour, serial=position + 1)
        self._areas = areas(self.dictionary, behaviour)
        self._keep = keep
        self._factory = sii(self.dictionary, behaviour, serial=position + 1, alias=alias)
        self.sii = bytearray(memory or self._factory)
        """The SII as it is now."""
        self.power_up(0)

    def power_up(self, now: int) -> None:
        """Power on: everything is new but the encoder, stored parameters and a kept SII."""
        esc = self._esc
        lib.sj_esc_init(esc)
        self.dictionary.power_up()
        self.device.reset()
        self.device.attach()
        self.device.drive.inject(DriveFault.LOST_LINK, False)
        if not self._keep:
            self.sii[:] = self._factory
        self._sii_c = ffi.from_buffer("uint8_t[]", self.sii)
        esc.sii, esc.sii_bytes = self._sii_c, len(self.sii)
        self._registers = ffi.buffer(esc.memory)
        features = 0x0004 | 0x0008 * self.behaviour.clock_64
        self._put("<BBHBBBBH", 0x0000, 0x11, 2, 0, 8, 8, 8, 0x0F, 0x0100 | features)
        self._put("<H", _ALIAS, struct.unpack_from("<H", self.sii, 8)[0])
        self._put("<B", 0x0140, 0x05)
        self._put("<H", _SII, 0x0040)
        self._put("<H", 0x0400, 2498)
        self._put("<H", 0x0410, 1000)
        self._put("<H", 0x0420, 1000)
        self._put("<B", 0x0440, 0x01)
        self._put("<HBB", 0x0930, 0x1000, 0, 0)
        self._put("<BB", 0x0934, 4, 12)
        # the clock of every device shows another time
        esc.boot_ns, esc.drift_ppb = now - 1_000_000_000 * (self.position + 1), self._drift_ppb
        esc.trim_ns = esc.sync_next_ns = esc.sync_period_ns = 0
        esc.trimmed_ns, esc.rate, esc.deviation_ns = now, 0.0, 0.0
        esc.sync1_counts = self.behaviour.by_sync1
        esc.syncs = esc.syncs_missed = esc.periods = 0
        esc.output_ns = esc.period_next_ns = now
        esc.events = esc.silent = esc.fresh = 0
        self._queue: deque[bytes] = deque()
        self._posted: bytes | None = None  # in SM1
        self._read: bytes | None = None  # before it
        self._counter = 0
        self._mail_waits = False
        self._waiting: Waiting | None = None
        self._slow: tuple[list[tuple[Mapped, int]], list[tuple[Mapped, int]]] = ([], [])
        self._coe = CoeServer(self.dictionary, mailbox=self.behaviour.mailbox)
        self.changes: list[tuple[int, int]] = []
        """Every change of the state: 0130h and 0134h."""
        self._put("<H", _AL_STATUS, AlState.INIT)
        self._enter(AlState.INIT, AlCode.NONE)

    # ---- what there is to see ----

    @property
    def state(self) -> AlState:
        """DriveState of the application layer."""
        return AlState(self._get("<H", _AL_STATUS) & 0x0F)

    @property
    def error(self) -> bool:
        """Whether the error bit of 0130h is set."""
        return bool(self._get("<H", _AL_STATUS) & ERROR)

    @property
    def code(self) -> int:
        """AL status code 0134h."""
        return self._get("<H", _AL_CODE)

    @property
    def controller(self) -> Any:
        """Its controller (``sj_esc *``): memory, buffers, the drive's words."""
        return self._esc

    @property
    def waiting(self) -> bool:
        """Whether a transition waits for outputs or SYNC0."""
        return self._waiting is not None

    @property
    def busy(self) -> bool:
        """Whether `poll` has something to do now and then."""
        return self._waiting is not None or bool(self._slow[1])

    def process_areas(self) -> tuple[Area, Area]:
        """SM2 and SM3 as the present mapping wants them; `SdoError` when it is none."""
        _, _, outputs, inputs = areas(self.dictionary, self.behaviour)
        return outputs, inputs

    # ---- the wire did something ----

    def serve(self, now: int) -> None:
        """Act on the controller's events; `now` in its time."""
        events, self._esc.events = self._esc.events, 0
        if events & lib.SJ_ESC_AL_CONTROL:
            self._request(self._get("<H", _AL_CONTROL), now)
        if events & lib.SJ_ESC_MAIL_READ:
            self._read, self._posted = self._posted or self._read, None
            self._pump()
        if events & lib.SJ_ESC_REPEAT:
            self._repeat()
        if events & lib.SJ_ESC_MAIL:
            self._mail_waits = True
        if self._mail_waits:
            self._take_mail()
        if events & lib.SJ_ESC_WATCHDOG and self.state is AlState.OP:
            self._leave_op(AlCode.WATCHDOG)
        if events & lib.SJ_ESC_ERROR:
            self._drive_error()
        if events & lib.SJ_ESC_STATE:
            self._say(DriveState.of(self._esc.tx.statusword).name.replace("_", " ").lower())
        if events & lib.SJ_ESC_SLOW_OUTPUTS:
            self._apply_slow()
        self.poll(now)

    def poll(self, now: int) -> None:
        """Let time pass: a transition that waits, inputs that the drive's words do not have."""
        self._refresh_slow()
        waiting, esc = self._waiting, self._esc
        if waiting is None:
            return
        fresh = not esc.outputs.bytes or esc.output_ns != waiting.output_ns
        synced = esc.sync_source < lib.SJ_SYNC_DC0 or esc.syncs >= waiting.syncs + 2
        if fresh and synced:
            self._enter(AlState.OP, AlCode.NONE)
        elif now - waiting.until_ns >= 0:
            self._enter(AlState.SAFEOP, AlCode.NO_SYNC if fresh else AlCode.WATCHDOG, error=True)

    # ---- states ----

    def _request(self, control: int, now: int) -> None:
        """A write to 0120h."""
        wanted, acknowledged, current = control & 0x0F, bool(control & ERROR), self.state
        if self.error and not acknowledged and wanted >= current:
            return
        self._waiting = None
        code: int = refusal(current, wanted)
        target = current if code else AlState(wanted)
        if not code and (current, target) == (AlState.INIT, AlState.PREOP):
            code = self._check_mailboxes()
        elif not code and (current, target) == (AlState.PREOP, AlState.SAFEOP):
            code = self._configure()
        elif (current, target) == (AlState.SAFEOP, AlState.OP):
            self._put("<HxxH", _AL_STATUS, AlState.SAFEOP, AlCode.NONE)
            self._waiting = Waiting(now + OP_TIMEOUT_NS, self._esc.output_ns, self._esc.syncs)
            return
        self._enter(current if code else target, code, error=bool(code))

    def force(self, status: int, code: int) -> None:
        """Go to a state by itself, as a device with an inner fault does: 0130h and 0134h."""
        self._waiting = None
        self._enter(AlState(status & 0x0F), code, error=bool(status & ERROR))

    def _enter(self, state: AlState, code: int, *, error: bool = False) -> None:
        esc, before = self._esc, self.state
        self._waiting = None
        self._put("<HxxH", _AL_STATUS, state | ERROR * error, code)
        esc.applied = state is AlState.OP
        self.dictionary.preop = state is AlState.PREOP
        if state < AlState.SAFEOP:
            esc.sync_source = lib.SJ_SYNC_FREE
            esc.period_ns = round(self._config.period_s * 1e9)
            esc.outputs.bytes = esc.inputs.bytes = esc.outputs.words = esc.inputs.words = 0
            esc.targets_mapped = esc.deaf = 0
            self._slow = ([], [])
            lib.sj_esc_open(esc, 0)
        if state is AlState.INIT:
            self._queue.clear()
            self._posted = self._read = None
            self._mail_waits = False
            self._registers[_SM + 5] = self._registers[_SM + 13] = b"\0"
            self._coe = CoeServer(self.dictionary, mailbox=self.behaviour.mailbox)
        if before is AlState.OP and state is not AlState.OP:
            if DriveState.of(esc.tx.statusword) in (
                DriveState.OPERATION_ENABLED,
                DriveState.QUICK_STOP_ACTIVE,
            ):
                self.device.drive.inject(DriveFault.LOST_LINK)
            self.device.release()
        if state is AlState.OP:
            self.device.drive.inject(DriveFault.LOST_LINK, False)
            self._put("<B", 0x0440, 0x01)
        self.changes.append((state | ERROR * error, code))
        del self.changes[:-100]
        if before is not state or code:
            self._say(f"{state.name}{' with error' * error}" + (f" {code:04X}h" if code else ""))

    def _leave_op(self, code: AlCode) -> None:
        self._enter(AlState.SAFEOP, code, error=True)

    def _manager(self, number: int) -> tuple[int, int, int, bool]:
        """Start, length, control and whether it is active."""
        start, length, control, _, active = struct.unpack_from(
            "<HHBBB", self._registers, _SM + 8 * number
        )
        return start, length, control, bool(active & 1)

    def _check_mailboxes(self) -> AlCode:
        for number, direction in ((0, 0x06), (1, 0x02)):
            area = self._areas[number]
            start, length, control, active = self._manager(number)
            if (start, length) != area[:2] or control & 0x0F != direction or not active:
                return AlCode.MAILBOX
        return AlCode.NONE

    def _mailboxes_as_configured(self) -> bool:
        return self.state is not AlState.INIT and self._check_mailboxes() is AlCode.NONE

    def _configure(self) -> int:
        """Pre-operational to Safe-operational: mapping, SyncManagers, clocks."""
        layouts = []
        for receive, code in ((True, AlCode.OUTPUT_MAPPING), (False, AlCode.INPUT_MAPPING)):
            try:
                layouts.append(self.dictionary.layout(receive=receive))
            except SdoError:
                return code
        outputs, inputs = layouts
        code = self._check_lengths(outputs, inputs) or self._check_places(outputs, inputs)
        return code or self._choose_clock() or self._open(outputs, inputs)

    def _check_lengths(self, outputs: Layout, inputs: Layout) -> AlCode:
        for number, layout, code in (
            (2, outputs, AlCode.OUTPUT_LENGTH),
            (3, inputs, AlCode.INPUT_LENGTH),
        ):
            _, length, _, active = self._manager(number)
            if layout.length and not active:
                return code
            if active and length != layout.length:
                return code
        return AlCode.NONE

    def _check_places(self, outputs: Layout, inputs: Layout) -> AlCode:
        taken = [range(start, start + length) for start, length, _, _ in map(self._manager, (0, 1))]
        for number, layout, control in ((2, outputs, 0x04), (3, inputs, 0x00)):
            if not layout.length:
                continue
            start, _, flags, _ = self._manager(number)
            buffers = range(start, start + 3 * layout.length)
            inside = start >= lib.SJ_ESC_RAM and buffers.stop <= lib.SJ_ESC_MEMORY
            free = all(buffers.stop <= area.start or area.stop <= start for area in taken)
            if not (inside and free and start % 2 == 0 and flags & 0x0F == control):
                return AlCode.SYNC_MANAGER
            taken.append(buffers)
        return AlCode.NONE

    def _choose_clock(self) -> int:
        """What begins the periods from now on, and how long they are."""
        behaviour, dictionary = self.behaviour, self.dictionary
        active = self._registers[_SYNC + 1][0]
        cycle0, cycle1 = struct.unpack_from("<II", self._registers, 0x09A0)
        kind, deaf = dictionary.value(0x1C32, 1), False
        if active & 1:
            if not active & 2 or (behaviour.by_sync1 and not active & 4):
                return AlCode.DC_CONFIGURATION
            if behaviour.sync0_ns and cycle0 != behaviour.sync0_ns:
                return AlCode.SYNC0_CYCLE
            period, bad = cycle0, AlCode.SYNC0_CYCLE
            if behaviour.by_sync1:
                period, bad = (cycle1 // max(1, cycle0) + 1) * cycle0, AlCode.SYNC1_CYCLE
            if period < behaviour.cycle_least_ns or period % behaviour.cycle_step_ns:
                return bad
            kind = 3 if behaviour.by_sync1 else 2
        else:
            if behaviour.dc_required:
                return behaviour.dc_required
            if kind >= 2:
                return AlCode.DC_CONFIGURATION
            deaf, bad = behaviour.deaf_without_dc, AlCode.SYNC_CYCLE
            period = dictionary.value(0x1C32, 2)
            if kind == 0:
                period = round(self._config.period_s * 1e9)
        try:
            self.device.drive.configure(period_s=period * 1e-9)
        except DriveConfigError:
            return bad
        for index in (0x1C32, 0x1C33):
            dictionary.set(index, 1, kind)
            dictionary.set(index, 2, period)
            dictionary.set(index, 10, cycle0 if active & 1 else behaviour.sync0_ns)
        self._esc.period_ns, self._esc.sync_source, self._esc.deaf = period, kind, deaf
        return AlCode.NONE

    # ---- process data ----

    def _open(self, outputs: Layout, inputs: Layout) -> AlCode:
        esc = self._esc
        self._slow = ([], [])
        for number, layout, process in ((2, outputs, esc.outputs), (3, inputs, esc.inputs)):
            receive = number == 2
            start = self._manager(number)[0]
            free = 0
            for word, mapped in zip(process.word, layout.words, strict=False):
                row = mapped.row
                offset = word_of(row, receive=receive)
                if (slow := offset is None) and free + row.type.size > lib.SJ_ESC_SLOW:
                    return AlCode.OUTPUT_MAPPING if receive else AlCode.INPUT_MAPPING
                if slow:
                    offset = free
                    self._slow[0 if receive else 1].append((mapped, offset))
                    process.slow[offset : offset + row.type.size] = list(
                        self.dictionary.upload(row.index, row.sub)
                    )
                    free += row.type.size
                word.bit, word.bits, word.offset, word.slow = mapped.bit, row.bits, offset, slow
            if len(layout.words) > lib.SJ_ESC_WORDS:
                return AlCode.OUTPUT_MAPPING if receive else AlCode.INPUT_MAPPING
            process.start, process.bytes = start, layout.length
            process.words = len(layout.words)
        esc.targets_mapped = targets_in(mapped.row for mapped in outputs.words)
        lib.sj_esc_open(esc, 1)
        return AlCode.NONE

    def _apply_slow(self) -> None:
        for mapped, offset in self._slow[0]:
            row = mapped.row
            data = bytes(self._esc.outputs.slow[offset : offset + row.type.size])
            if data != self.dictionary.upload(row.index, row.sub):
                try:
                    self.dictionary.download(row.index, row.sub, data)
                except SdoError:  # what the drive refuses keeps its value
                    continue

    def _refresh_slow(self) -> None:
        for mapped, offset in self._slow[1]:
            row = mapped.row
            data = self.dictionary.upload(row.index, row.sub)
            self._esc.inputs.slow[offset : offset + row.type.size] = list(data)

    def _drive_error(self) -> None:
        code = self.device.note_error()
        self._say(f"603Fh = {code:04X}h")
        self._send(CoeServer.emergency(code, self._esc.tx.error_register))
        if code == _SYNC_ERROR and self.state is AlState.OP:
            self._leave_op(AlCode.SYNC_LOST)

    # ---- mailbox ----

    def _take_mail(self) -> None:
        """The mail in SM0, once there is room for its answers."""
        if not self._mailboxes_as_configured():
            self._mail_waits = False
            return
        if len(self._queue) >= _QUEUE:
            return
        self._mail_waits = False
        start, length = self._areas[0][:2]
        mail = bytes(self._registers[start : start + length])
        self._registers[_SM + 5] = bytes((self._registers[_SM + 5][0] & ~_FULL,))
        self.dictionary.set(0x1C32, 11, min(int(self._esc.syncs_missed), 0xFFFF))
        for answer in self._coe.answer(mail):
            self._send(answer)

    def _send(self, mail: Mail) -> None:
        if not self._mailboxes_as_configured():
            return
        self._counter = self._counter % 7 + 1
        head = struct.pack("<HHBB", len(mail.data), 0, 0, mail.protocol | self._counter << 4)
        if len(self._queue) < 64 * _QUEUE:  # nobody reads: the newest are lost
            self._queue.append(head + mail.data)
        self._pump()

    def _pump(self) -> None:
        if self._queue and not self._registers[_SM + 13][0] & _FULL:
            self._post(self._queue.popleft())

    def _post(self, mail: bytes) -> None:
        if not self._mailboxes_as_configured():
            self._queue.clear()
            return
        start, length = self._areas[1][:2]
        assert len(mail) - HEADER <= length - HEADER, "every answer fits the mailbox"
        self._registers[start : start + length] = mail.ljust(length, b"\0")
        self._registers[_SM + 13] = bytes((self._registers[_SM + 13][0] | _FULL | _WRITTEN,))
        self._posted = mail

    def _repeat(self) -> None:
        """080Eh bit 1 toggled: the mail that was read last once more; 080Fh bit 1 follows.

        Its reader never got it. A mail that already waits in SM1 goes out after it.
        """
        asked, done = self._registers[_SM + 14][0] & 2, self._registers[_SM + 15][0] & 2
        if asked == done:
            return
        if self._read is not None:
            if self._posted is not None:
                self._queue.appendleft(self._posted)
            self._post(self._read)
        self._registers[_SM + 15] = bytes((self._registers[_SM + 15][0] & ~2 | asked,))

    # ---- inside ----

    def _get(self, layout: str, address: int) -> int:
        return int(struct.unpack_from(layout, self._registers, address)[0])

    def _put(self, layout: str, address: int, *values: int) -> None:
        struct.pack_into(layout, self._registers, address, *values)

    def _say(self, what: str) -> None:
        if self._tell is not None:
            self._tell(self.position, what)
