"""A drive behind its object dictionary: SDO access with abort codes, PDO mapping, one SYNC period.

What CANopen and CoE have in common and no wire knows: `Device.upload` and `Device.download` are the
two SDO services, `Device.receive` and `Device.transmit` pack process data by the mapping objects
1600h.. and 1A00h.., `Device.cycle` runs the drive with the words the dictionary holds.

Never here: frames, identifiers on a bus, clocks.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable

from sjerk.drive.config import DriveConfig, DriveConfigError
from sjerk.drive.drive import Drive, DriveFeedback, Finding
from sjerk.drive.eds import eds
from sjerk.drive.entries import Abort, ObjectEntry, SdoError
from sjerk.drive.objects import (
    DISABLED,
    DUMMIES,
    MAPPED,
    OBJECTS,
    PDOS,
    default,
    entry,
)
from sjerk.drive.words import DriveState, Mode

Value = int | float | str
POSITIONS = ("target_position", "interpolated_position")
"""Set-points that are the actual position until a master has written them."""
SAVE, LOAD = 0x65766173, 0x64616F6C
"""Signatures of 1010h:1 and 1011h:1."""

_COMMUNICATION = 0x11
"""Bits 0 and 4 of 1001h: generic, communication."""
_RESERVED_BIT = 0x40000000
"""Bit 30 of 1005h would make the drive the producer of SYNC, that of 1014h is reserved."""

_ENABLED = (
    DriveState.OPERATION_ENABLED,
    DriveState.QUICK_STOP_ACTIVE,
    DriveState.FAULT_REACTION_ACTIVE,
)
_OF_THE_MOTOR = (0x6073, 0x6075, 0x6076, 0x6080, 0x60C2)
_RESERVED_IDS = (
    range(0x080),
    range(0x101, 0x181),
    range(0x581, 0x600),
    range(0x601, 0x680),
    range(0x701, 0x800),
)


class Device:
    r"""One drive, its object dictionary (CiA 301, CiA 402) and its PDO mapping.

    >>> device = Device()
    >>> device.download(0x6040, 0, bytes([0x06, 0x00]))
    >>> device.cycle().state.name
    'READY_TO_SWITCH_ON'
    >>> device.upload(0x605A, 0)
    b'\x02\x00'
    """

    def __init__(self, drive: Drive | None = None, *, node_id: int = 1) -> None:
        """Power the drive up; `node_id` (1 .. 127) makes the default identifiers of the PDOs."""
        self.drive = drive or Drive()
        self.node_id = node_id
        self._factory = self.drive.config
        self._stored: tuple[dict[tuple[int, int], Value], DriveConfig] | None = None
        self._getters: dict[tuple[int, int], Callable[[], Value]] = {}
        self._setters: dict[tuple[int, int], Callable[[ObjectEntry, int], None]] = {}
        self._values: dict[tuple[int, int], Value] = {}
        self._plans: dict[tuple[int, bool], tuple[list[ObjectEntry | int], struct.Struct]] = {}
        self._errors: list[int] = []
        self._communication_error = False
        self._rx: dict[str, int] = {}
        self._written: set[str] = set()
        self.feedback: DriveFeedback
        """Of the last period."""
        self._bind()
        self._power_up()

    # ---- SDO ----

    def upload(self, index: int, sub: int) -> bytes:
        """The bytes of an object; raises `SdoError` with the abort code."""
        row = entry(index, sub)
        return row.type.pack(self.read(index, sub))

    def download(self, index: int, sub: int, data: bytes) -> None:
        """Write an object from bytes; raises `SdoError` with the abort code."""
        row = entry(index, sub)
        if row.access == "ro":
            raise SdoError(Abort.READ_ONLY, index, sub)
        if len(data) != row.type.size:
            too_long = len(data) > row.type.size
            raise SdoError(Abort.TOO_LONG if too_long else Abort.TOO_SHORT, index, sub)
        value = row.type.unpack(data)
        assert not isinstance(value, str), "every string is read-only"
        self.write(index, sub, value)

    def read(self, index: int, sub: int = 0) -> Value:
        """The value of an object in its own unit; raises `SdoError` where there is none."""
        row = entry(index, sub)
        place, _, name = row.source.partition(".")
        match place:
            case "tx":
                return int(getattr(self.feedback, name))
            case "rx":
                return self._rx[name]
            case "config":
                value: int | float = getattr(self.drive.config, name)
                return int(value) if row.type.limits else value
            case "report":
                number: int | float = getattr(self.drive.report(), name)
                return min(number, 0xFFFFFFFF) if row.type.limits else number
            case "finding":
                return self.drive.report().findings.get(Finding[name], 0)
        getter = self._getters.get((index, sub))
        return getter() if getter else self._values[index, sub]

    def write(self, index: int, sub: int, value: int | float) -> None:
        """Give an object a value that its type can hold; raises `SdoError` as `download`."""
        row = entry(index, sub)
        if row.access == "ro":
            raise SdoError(Abort.READ_ONLY, index, sub)
        if row.access == "idle" and self.feedback.state in _ENABLED:
            raise SdoError(Abort.DEVICE_STATE, index, sub)
        place, _, name = row.source.partition(".")
        if (index, sub) in self._setters:
            self._setters[index, sub](row, int(value))
        elif place == "rx":
            self._rx[name] = int(value)
        elif place == "config":
            self._configure(row, name, value)
        else:
            self._values[index, sub] = value

    def _configure(self, row: ObjectEntry, field: str, value: int | float) -> None:
        if getattr(self.drive.config, field) == value:
            return
        try:
            self.drive.configure(**{field: value})
        except DriveConfigError as error:
            abort = Abort.RANGE
            if not error.field.endswith(("_option", "_method")) and error.field == field:
                abort = Abort.TOO_HIGH if value > error.high else abort
                abort = Abort.TOO_LOW if value < error.low else abort
            raise SdoError(abort, row.index, row.sub) from error

    def data_sheet(self, file_name: str = "sjerk.eds") -> str:
        """The electronic data sheet with this drive's settings as defaults."""
        values = {
            (row.index, row.sub): self.read(row.index, row.sub)
            for thing in OBJECTS.values()
            for row in thing.entries
            if row.source.startswith("config.") or row.index in _OF_THE_MOTOR
        }
        return eds(node_id=self.node_id, file_name=file_name, values=values)

    # ---- process data ----

    def communication(self, number: int, *, receive: bool) -> tuple[int, int]:
        """Identifier with its flag bits and transmission type of a PDO."""
        index = (0x1400 if receive else 0x1800) + number
        return int(self._values[index, 1]), int(self._values[index, 2])

    def mapping(self, number: int, *, receive: bool) -> list[ObjectEntry | int]:
        """What a PDO carries: entries of the dictionary, and plain numbers of bits to skip."""
        return self._plan(number, receive)[0]

    def receive(self, number: int, data: bytes) -> None:
        """Take a receive PDO: each mapped object gets its value, refused ones keep theirs.

        Raises `SdoError` (`PDO_LENGTH`) where the data are shorter than the mapping.
        """
        rows, layout = self._plan(number, True)
        if len(data) < layout.size:
            raise SdoError(Abort.PDO_LENGTH, 0x1600 + number, 0)
        mapped = [row for row in rows if isinstance(row, ObjectEntry)]
        for row, value in zip(mapped, layout.unpack_from(data), strict=True):
            try:
                self.write(row.index, row.sub, value)
            except SdoError:
                continue

    def transmit(self, number: int) -> bytes:
        """The bytes of a transmit PDO."""
        rows, layout = self._plan(number, False)
        return layout.pack(*(self.read(r.index, r.sub) for r in rows if isinstance(r, ObjectEntry)))

    def length(self, number: int, *, receive: bool) -> int:
        """Bytes of a PDO."""
        return self._plan(number, receive)[1].size

    def cycle(self, *, sync_missed: bool = False) -> DriveFeedback:
        """One SYNC period with the words of the dictionary.

        A target that was not written since the drive was last enabled is the actual position.
        """
        if self.feedback.state is not DriveState.OPERATION_ENABLED:
            for name in POSITIONS:
                if name not in self._written:
                    self._rx[name] = self.feedback.position_actual
        before = self.feedback
        self.feedback = self.drive.cycle(**self._rx, sync_missed=sync_missed)
        if before.state is DriveState.OPERATION_ENABLED is not self.feedback.state:
            self._written.clear()
        if self.feedback.error_code not in (0, before.error_code):
            self._errors = [self.feedback.error_code, *self._errors][:8]
        return self.feedback

    def reset(self, *, communication_only: bool = False) -> None:
        """Power-on values (stored ones, if any): of everything, or of 1000h to 1FFFh."""
        if not communication_only:
            self._power_up()
            return
        self._values.update(
            {place: value for place, value in self._power_on().items() if place[0] < 0x2000}
        )
        self._plans.clear()

    def report_error(self, code: int) -> None:
        """An error event of the communication: into 1003h, and 1001h shows it until it is over."""
        self._errors = [code, *self._errors][:8]
        self._communication_error = True

    def end_errors(self) -> None:
        """No error of the communication is left."""
        self._communication_error = False

    # ---- inside ----

    def _power_on(self) -> dict[tuple[int, int], Value]:
        if self._stored:
            return dict(self._stored[0])
        return {
            (row.index, row.sub): default(row, self.node_id)
            for thing in OBJECTS.values()
            for row in thing.entries
        }

    def _power_up(self) -> None:
        self._values = self._power_on()
        self._plans = {}
        self._errors = []
        self._communication_error = False
        self._written.clear()
        self._rx = dict.fromkeys(
            (
                "controlword",
                "mode",
                "target_position",
                "position_offset",
                "velocity_offset",
                "target_velocity",
                "target_torque",
                "torque_offset",
                "digital_outputs",
                "output_mask",
                "interpolated_position",
                "probe_function",
            ),
            0,
        )
        config = self._stored[1] if self._stored else self._factory
        self.drive.restart(config)
        if not self._stored:
            self._values[0x60C2, 1], self._values[0x60C2, 2] = _interval(self.drive.config.period_s)
        self.feedback = self.drive.cycle(0, mode=Mode.NONE)

    def _bind(self) -> None:
        get, put = self._getters, self._setters
        get[0x1001, 0] = lambda: (
            self.feedback.error_register | (_COMMUNICATION if self._communication_error else 0)
        )
        for sub in range(9):
            get[0x1003, sub] = lambda sub=sub: (  # type: ignore[misc]
                len(self._errors) if sub == 0 else (self._errors + [0] * 8)[sub - 1]
            )
        put[0x1003, 0] = self._clear_errors
        put[0x1005, 0] = put[0x1014, 0] = self._set_identifier
        put[0x1010, 1], put[0x1011, 1] = self._store, self._restore
        for number in range(PDOS):
            put[0x1800 + number, 3] = self._set_inhibit_time
            for base in (0x1400, 0x1800):
                put[base + number, 1] = self._set_pdo_identifier
                put[base + number, 2] = self._set_transmission_type
                for sub in range(MAPPED + 1):
                    put[base + 0x200 + number, sub] = self._set_mapping
        get[0x2100, 2] = lambda: min(self.drive.jump_limit, 0xFFFFFFFF)
        get[0x2101, 1] = lambda: min(self.drive.report().samples, 0xFFFFFFFF)
        put[0x2101, 1] = self._clear_verdict
        get[0x6060, 0] = lambda: self._rx["mode"]
        put[0x6060, 0] = self._set_mode
        get[0x6073, 0] = lambda: self._peak_current()
        get[0x6075, 0] = lambda: round(1000 * self.drive.config.rated_current_a)
        get[0x6076, 0] = lambda: round(1000 * self.drive.config.rated_torque_nm)
        get[0x6080, 0] = lambda: round(self.drive.config.max_speed_rpm)
        put[0x6080, 0] = lambda row, value: self._configure(row, "max_speed_rpm", value)
        get[0x60A4, 1] = self._profile_jerk
        put[0x60A4, 1] = self._set_profile_jerk
        get[0x607A, 0] = lambda: self._rx["target_position"]
        put[0x607A, 0] = lambda row, value: self._set_position("target_position", value)
        put[0x60B8, 0] = self._set_probe_function
        put[0x60C0, 0] = self._set_interpolation
        put[0x60C1, 1] = lambda row, value: self._set_position("interpolated_position", value)
        put[0x60C2, 1] = put[0x60C2, 2] = self._set_interval

    def _peak_current(self) -> int:
        config = self.drive.config
        return min(round(1000 * config.peak_torque_nm / config.rated_torque_nm), 0xFFFF)

    def _clear_errors(self, row: ObjectEntry, value: int) -> None:
        if value != 0:
            raise SdoError(Abort.RANGE, row.index, row.sub)
        self._errors.clear()

    def _clear_verdict(self, row: ObjectEntry, value: int) -> None:
        if value != 0:
            raise SdoError(Abort.RANGE, row.index, row.sub)
        self.drive.clear_report()

    def _store(self, row: ObjectEntry, value: int) -> None:
        if value != SAVE:
            raise SdoError(Abort.CANNOT_STORE, row.index, row.sub)
        self._stored = dict(self._values), self.drive.config

    def _restore(self, row: ObjectEntry, value: int) -> None:
        if value != LOAD:
            raise SdoError(Abort.CANNOT_STORE, row.index, row.sub)
        self._stored = None

    def _set_mode(self, row: ObjectEntry, value: int) -> None:
        if value not in Mode.__members__.values():
            raise SdoError(Abort.RANGE, row.index, row.sub)
        self._rx["mode"] = value

    def _jerk_unit(self) -> float:
        """Units of 60A4h in one revolution of the motor per s^3."""
        config = self.drive.config
        return config.feed / config.feed_shaft * config.gear_shaft / config.gear_motor

    def _profile_jerk(self) -> int:
        return min(round(self.drive.config.profile_jerk_rev_s3 * self._jerk_unit()), 0xFFFFFFFF)

    def _set_profile_jerk(self, row: ObjectEntry, value: int) -> None:
        self._configure(row, "profile_jerk_rev_s3", value / self._jerk_unit())

    def _set_position(self, name: str, value: int) -> None:
        self._rx[name] = value
        self._written.add(name)

    def _set_probe_function(self, row: ObjectEntry, value: int) -> None:
        """Sources 10 (60D0h) and 11 of a probe are not offered."""
        if value & 0x0808:
            raise SdoError(Abort.RANGE, row.index, row.sub)
        self._rx["probe_function"] = value

    def _set_interpolation(self, row: ObjectEntry, value: int) -> None:
        if value != 0:
            raise SdoError(Abort.RANGE, row.index, row.sub)

    def _set_interval(self, row: ObjectEntry, value: int) -> None:
        """60C2h counts once value and index together give a period the drive can run."""
        if (row.sub == 1 and value < 1) or (row.sub == 2 and not -6 <= value <= 0):
            raise SdoError(Abort.RANGE, row.index, row.sub)
        self._values[row.index, row.sub] = value
        period = int(self._values[0x60C2, 1]) / 10 ** -int(self._values[0x60C2, 2])
        try:
            self.drive.configure(period_s=period)
        except DriveConfigError:
            return

    def _set_identifier(self, row: ObjectEntry, value: int) -> None:
        if _reserved(value) or value & (0x3FFFF800 | _RESERVED_BIT):
            raise SdoError(Abort.RANGE, row.index, row.sub)
        self._values[row.index, row.sub] = value

    def _set_pdo_identifier(self, row: ObjectEntry, value: int) -> None:
        """Identifiers change while the PDO is disabled (bit 31), before or after."""
        if _reserved(value) or value & 0x3FFFF800:
            raise SdoError(Abort.RANGE, row.index, row.sub)
        old = int(self._values[row.index, row.sub])
        if not (old | value) & DISABLED and (old ^ value) & 0x7FF:
            raise SdoError(Abort.DEVICE_STATE, row.index, row.sub)
        self._values[row.index, row.sub] = value

    def _set_transmission_type(self, row: ObjectEntry, value: int) -> None:
        by_request = row.index >= 0x1800 and value in (252, 253)
        if 240 < value < 254 and not by_request:
            raise SdoError(Abort.RANGE, row.index, row.sub)
        self._values[row.index, row.sub] = value

    def _set_inhibit_time(self, row: ObjectEntry, value: int) -> None:
        if not int(self._values[row.index, 1]) & DISABLED:
            raise SdoError(Abort.DEVICE_STATE, row.index, row.sub)
        self._values[row.index, row.sub] = value

    def _set_mapping(self, row: ObjectEntry, value: int) -> None:
        """Disable the PDO, sub 0 := 0, write the objects, sub 0 := n, enable."""
        receive = row.index < 0x1800
        number = row.index & 0xF
        base = 0x1400 if receive else 0x1800
        if not int(self._values[base + number, 1]) & DISABLED:
            raise SdoError(Abort.DEVICE_STATE, row.index, row.sub)
        if row.sub > 0:
            if self._values[row.index, 0] != 0:
                raise SdoError(Abort.DEVICE_STATE, row.index, row.sub)
            if value != 0:
                _mapped(value, receive, row)
            self._values[row.index, row.sub] = value
            return
        if value > MAPPED:
            raise SdoError(Abort.PDO_LENGTH, row.index, row.sub)
        words = [int(self._values[row.index, sub]) for sub in range(1, value + 1)]
        for word in words:
            _mapped(word, receive, row)
        if sum(word & 0xFF for word in words) > 64:
            raise SdoError(Abort.PDO_LENGTH, row.index, row.sub)
        self._values[row.index, 0] = value
        self._plans.pop((number, receive), None)

    def _plan(self, number: int, receive: bool) -> tuple[list[ObjectEntry | int], struct.Struct]:
        plan = self._plans.get((number, receive))
        if plan is None:
            index = (0x1600 if receive else 0x1A00) + number
            count = int(self._values[index, 0])
            rows = [
                _mapped(int(self._values[index, sub]), receive, entry(index, sub))
                for sub in range(1, count + 1)
            ]
            layout = "".join(
                row.type.value[1] if isinstance(row, ObjectEntry) else f"{row // 8}x"
                for row in rows
            )
            plan = self._plans[number, receive] = rows, struct.Struct("<" + layout)
        return plan


def _mapped(word: int, receive: bool, where: ObjectEntry) -> ObjectEntry | int:
    """What a mapping word (index, sub, bits) names; raises `SdoError` at `where`."""
    index, sub, bits = word >> 16, word >> 8 & 0xFF, word & 0xFF
    if receive and index in DUMMIES and sub == 0 and bits == DUMMIES[index]:
        if bits % 8:
            raise SdoError(Abort.NOT_MAPPABLE, where.index, where.sub)
        return bits
    try:
        row = entry(index, sub)
    except SdoError as error:
        raise SdoError(Abort.NO_OBJECT, where.index, where.sub) from error
    if ("R" if receive else "T") not in row.pdo or bits != row.bits:
        raise SdoError(Abort.NOT_MAPPABLE, where.index, where.sub)
    return row


def _reserved(word: int) -> bool:
    return any(word & 0x7FF in block for block in _RESERVED_IDS)


def _interval(period_s: float) -> tuple[int, int]:
    """A period as value and power of ten, the coarsest power that is exact or else the finest."""
    for power in range(-3, -7, -1):
        value = period_s * 10**-power
        if 1 <= round(value) <= 255 and math.isclose(value, round(value), rel_tol=1e-9):
            return round(value), power
    return max(1, min(255, round(period_s * 1e6))), -6
