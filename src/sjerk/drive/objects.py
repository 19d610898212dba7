"""The object dictionary of the drive as data: CiA 301 communication, CiA 402 drive profile.

`OBJECTS` is the table, of what `sjerk.drive.entries` has; `sjerk.drive.eds` writes it as an
electronic data sheet. A row's `source` says where its value lives: ``config.x`` is a field of
`sjerk.drive.config.DriveConfig`, ``rx.x`` and ``tx.x`` are words of the process data,
``report.x`` and ``finding.X`` the verdict on the stream, "" the dictionary itself, ``special`` a
rule of `sjerk.drive.device`.

Never here: a drive, a bus, a value that changes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from sjerk.drive.entries import (
    I8,
    I16,
    I32,
    REAL,
    TEXT,
    U8,
    U16,
    U32,
    Abort,
    Object,
    ObjectEntry,
    Row,
    SdoError,
    many,
    var,
)

PDOS = 4
"""Receive and transmit PDOs, each."""
MAPPED = 8
"""Most objects in one PDO."""
HOMING_METHODS = (0, *range(1, 15), *range(17, 31), 33, 34, 35, 37, -1, -2, -3, -4)
"""What 6098h takes."""

_RPDO_MAPS = (
    (0x60400010, 0x60600008, 0x607A0020),
    (0x60FF0020, 0x60710010),
    (0x60B00020, 0x60B10020),
    (0x60B20010,),
)
_TPDO_MAPS = (
    (0x60410010, 0x60610008, 0x60640020),
    (0x606C0020, 0x60770010, 0x603F0010),
    (0x60F40020, 0x60620020),
    (0x60FD0020,),
)
DISABLED = 0x80000000
NO_RTR = 0x40000000


def _pdo(number: int, receive: bool) -> Iterator[Object]:
    side, communication = ("Receive", 0x1400) if receive else ("Transmit", 0x1800)
    base = (0x200 if receive else 0x180) + 0x100 * number
    cob = base | (0 if number == 0 else DISABLED) | (0 if receive else NO_RTR)
    rows: list[Row] = [
        ("COB-ID", U32, "rw", "", cob, "", "special"),
        ("Transmission type", U8, "rw", "", 255, "", "special"),
    ]
    if not receive:
        rows += [
            ("Inhibit time", U16, "rw", "", 0, "100 us", "special"),
            ("Reserved", U8, "ro", "", 0, "", ""),
            ("Event timer", U16, "rw", "", 0, "ms", ""),
        ]
    name = f"{side} PDO {number + 1} communication"
    record = many(communication + number, name, *rows, code=9)
    if receive:  # sub-indices 3 and 4 are none
        head = replace(record.entries[0], default=5)
        timer = ObjectEntry(communication + number, 5, "Event timer", U16, "rw", "", 0, "ms", "")
        record = replace(record, entries=(head, *record.entries[1:], timer))
    yield record
    maps = (_RPDO_MAPS if receive else _TPDO_MAPS)[number]
    mapping = many(
        communication + 0x200 + number,
        f"{side} PDO {number + 1} mapping",
        *(
            (
                f"Mapped object {n + 1}",
                U32,
                "rw",
                "",
                maps[n] if n < len(maps) else 0,
                "",
                "special",
            )
            for n in range(MAPPED)
        ),
        code=9,
        count="rw",
    )
    head = replace(mapping.entries[0], name="Mapped objects", default=len(maps), source="special")
    yield replace(mapping, entries=(head, *mapping.entries[1:]))


_COMMUNICATION: tuple[Object, ...] = (
    var(0x1000, "Device type", U32, "ro", "", 0x00020192),
    var(0x1001, "Error register", U8, "ro", "T", 0, "", "special"),
    many(
        0x1003,
        "Pre-defined error field",
        *(("Error", U32, "ro", "", 0, "", "special") for _ in range(8)),
        count="rw",
    ),
    var(0x1005, "COB-ID SYNC", U32, "rw", "", 0x80, "", "special"),
    var(0x1006, "Communication cycle period", U32, "rw", "", 0, "us"),
    var(0x1008, "Manufacturer device name", TEXT, "ro", "", "sjerk simulated drive"),
    var(0x1009, "Manufacturer hardware version", TEXT, "ro", "", "none"),
    var(0x100A, "Manufacturer software version", TEXT, "ro", "", "0.1.0"),
    many(0x1010, "Store parameters", ("Save all", U32, "rw", "", 1, "", "special")),
    many(0x1011, "Restore defaults", ("Restore all", U32, "rw", "", 1, "", "special")),
    var(0x1014, "COB-ID EMCY", U32, "rw", "", 0x80, "", "special"),
    many(
        0x1016,
        "Consumer heartbeat time",
        ("Master", U32, "rw", "", 0, "ms", "special"),
    ),
    var(0x1017, "Producer heartbeat time", U16, "rw", "", 0, "ms"),
    many(
        0x1018,
        "Identity",
        ("Vendor", U32, "ro", "", 0, "", ""),
        ("Product", U32, "ro", "", 0x5E4B0402, "", ""),
        ("Revision", U32, "ro", "", 1, "", ""),
        ("Serial number", U32, "ro", "", 0, "", ""),
        code=9,
    ),
    many(
        0x10F1,
        "Error settings",
        ("Local error reaction", U32, "ro", "", 1, "", ""),
        ("Sync error counter limit", U16, "rw", "", 12, "", "config.sync_error_limit"),
        code=9,
    ),
    *(part for number in range(PDOS) for part in _pdo(number, True)),
    *(part for number in range(PDOS) for part in _pdo(number, False)),
)

# fmt: off
_MAKER: tuple[Object, ...] = (
    many(0x2100, "Supervision of the targets",
          ("Reaction to a jump: 0 fault, 1 clamp, 2 off", U8, "rw", "", 0, "",
           "config.jump_option"),
          ("Jump limit", U32, "ro", "T", 0, "pu", "special"),
          ("SYNCs bridged", U16, "rw", "", 3, "", "config.sync_extrapolation"),
          ("Acceleration limit, 0 = the motor's", REAL, "rw", "", 0.0, "rev/s^2",
           "config.stream_acceleration_rev_s2"),
          ("Jerk limit, 0 = none", REAL, "rw", "", 0.0, "rev/s^3", "config.stream_jerk_rev_s3"),
          ("Jerk of profiles", REAL, "rw", "", 10000.0, "rev/s^3", "config.profile_jerk_rev_s3"),
          ("Silence that is a missed SYNC where 1006h = 0; 0: learned", U16, "rw", "", 500, "ms",
           ""),
          ("607Dh counts: 0 as 607Ah, 1 less 607Ch", U8, "rw", "", 0, "",
           "config.software_from_home"),
          ("Torque with which a hard stop is sought", U16, "rw", "", 300, "0.1 %",
           "config.hard_stop_torque"),
          ("Time at that torque that is a hard stop", U16, "rw", "", 50, "ms",
           "config.hard_stop_time_ms"),
          code=9),
    many(0x2101, "Verdict on the targets",
          ("Write 0: begin again; targets judged", U32, "rw", "T", 0, "", "special"),
          ("Largest velocity", REAL, "ro", "", 0.0, "rev/s", "report.velocity_rev_s"),
          ("Largest acceleration", REAL, "ro", "", 0.0, "rev/s^2", "report.acceleration_rev_s2"),
          ("Largest jerk", REAL, "ro", "", 0.0, "rev/s^3", "report.jerk_rev_s3"),
          ("Largest following error", U32, "ro", "T", 0, "pu", "report.following_error"),
          ("Missed SYNCs", U32, "ro", "T", 0, "", "report.missed_syncs"),
          ("Jumps", U32, "ro", "T", 0, "", "finding.JUMP"),
          ("Stale targets", U32, "ro", "T", 0, "", "finding.STALE"),
          ("Skipped targets", U32, "ro", "T", 0, "", "finding.SKIPPED"),
          ("Steps in velocity", U32, "ro", "T", 0, "", "finding.STEP"),
          ("Acceleration beyond limit", U32, "ro", "T", 0, "", "finding.ACCELERATION"),
          ("Velocity beyond limit", U32, "ro", "T", 0, "", "finding.VELOCITY"),
          ("Jerk beyond limit", U32, "ro", "T", 0, "", "finding.JERK"),
          ("SYNC unlike 60C2h", U32, "ro", "T", 0, "", "finding.PERIOD"), code=9),
    many(0x2102, "Feed-forward of the drive itself",
          ("Of the velocity, 0 .. 1", REAL, "rw", "", 1.0, "", "config.velocity_feedforward"),
          ("Of the acceleration, 0 .. 1", REAL, "rw", "", 1.0, "",
           "config.acceleration_feedforward"), code=9),
)

_PROFILE: tuple[Object, ...] = (
    var(0x6007, "Abort connection option code", I16, "rw", "", 1, "", "config.abort_option"),
    var(0x603F, "Error code", U16, "ro", "T", 0, "", "tx.error_code"),
    var(0x6040, "Controlword", U16, "rw", "R", 0, "", "rx.controlword"),
    var(0x6041, "Statusword", U16, "ro", "T", 0, "", "tx.statusword"),
    var(0x605A, "Quick stop option code", I16, "rw", "", 2, "", "config.quick_stop_option"),
    var(0x605B, "Shutdown option code", I16, "rw", "", 0, "", "config.shutdown_option"),
    var(0x605C, "Disable operation option code", I16, "rw", "", 1, "", "config.disable_option"),
    var(0x605D, "Halt option code", I16, "rw", "", 1, "", "config.halt_option"),
    var(0x605E, "Fault reaction option code", I16, "rw", "", 2, "", "config.fault_option"),
    var(0x6060, "Modes of operation", I8, "rw", "R", 0, "", "special"),
    var(0x6061, "Modes of operation display", I8, "ro", "T", 0, "", "tx.mode_display"),
    var(0x6062, "Position demand value", I32, "ro", "T", 0, "pu", "tx.position_demand"),
    var(0x6063, "Position actual internal", I32, "ro", "T", 0, "inc", "tx.position_internal"),
    var(0x6064, "Position actual value", I32, "ro", "T", 0, "pu", "tx.position_actual"),
    var(0x6065, "Following error window", U32, "rw", "", 1 << 24, "pu", "config.following_window"),
    var(0x6066, "Following error time out", U16, "rw", "", 0, "ms", "config.following_time_ms"),
    var(0x6067, "Position window", U32, "rw", "", 10, "pu", "config.position_window"),
    var(0x6068, "Position window time", U16, "rw", "", 100, "ms", "config.position_time_ms"),
    var(0x606B, "Velocity demand value", I32, "ro", "T", 0, "pu/s", "tx.velocity_demand"),
    var(0x606C, "Velocity actual value", I32, "ro", "T", 0, "pu/s", "tx.velocity_actual"),
    var(0x606D, "Velocity window", U16, "rw", "", 65535, "pu/s", "config.velocity_window"),
    var(0x606E, "Velocity window time", U16, "rw", "", 0, "ms", "config.velocity_time_ms"),
    var(0x606F, "Velocity threshold", U16, "rw", "", 65535, "pu/s", "config.velocity_threshold"),
    var(0x6070, "Velocity threshold time", U16, "rw", "", 0, "ms", "config.threshold_time_ms"),
    var(0x6071, "Target torque", I16, "rw", "R", 0, "0.1 %", "rx.target_torque"),
    var(0x6072, "Max torque", U16, "rw", "R", 3500, "0.1 %", "config.max_torque"),
    var(0x6073, "Max current", U16, "ro", "", 3512, "0.1 %", "special"),
    var(0x6074, "Torque demand value", I16, "ro", "T", 0, "0.1 %", "tx.torque_demand"),
    var(0x6075, "Motor rated current", U32, "ro", "", 2500, "mA", "special"),
    var(0x6076, "Motor rated torque", U32, "ro", "", 1270, "mNm", "special"),
    var(0x6077, "Torque actual value", I16, "ro", "T", 0, "0.1 %", "tx.torque_actual"),
    var(0x6078, "Current actual value", I16, "ro", "T", 0, "0.1 %", "tx.current_actual"),
    var(0x6079, "DC link circuit voltage", U32, "ro", "T", 325000, "mV", "tx.dc_link_mv"),
    var(0x607A, "Target position", I32, "rw", "R", 0, "pu", "special"),
    many(0x607B, "Position range limit",
          ("Min", I32, "idle", "", -(1 << 31), "pu", "config.range_min"),
          ("Max", I32, "idle", "", (1 << 31) - 1, "pu", "config.range_max")),
    var(0x607C, "Home offset", I32, "rw", "", 0, "pu", "config.home_offset"),
    many(0x607D, "Software position limit",
          ("Min", I32, "rw", "", 0, "pu", "config.software_min"),
          ("Max", I32, "rw", "", 0, "pu", "config.software_max")),
    var(0x607E, "Polarity", U8, "idle", "", 0, "", "config.polarity"),
    var(0x607F, "Max profile velocity", U32, "rw", "R", 1677721600, "pu/s",
         "config.max_profile_velocity"),
    var(0x6080, "Max motor speed", U32, "idle", "", 6000, "rpm", "special"),
    var(0x6081, "Profile velocity", U32, "rw", "R", 167772160, "pu/s", "config.profile_velocity"),
    var(0x6083, "Profile acceleration", U32, "rw", "R", 1677721600, "pu/s^2",
         "config.profile_acceleration"),
    var(0x6084, "Profile deceleration", U32, "rw", "R", 1677721600, "pu/s^2",
         "config.profile_deceleration"),
    var(0x6085, "Quick stop deceleration", U32, "rw", "R", 4194304000, "pu/s^2",
         "config.quick_stop_deceleration"),
    var(0x6086, "Motion profile type", I16, "ro", "", 3, "3: jerk-limited"),
    var(0x6087, "Torque slope", U32, "rw", "R", 10000, "0.1 %/s", "config.torque_slope"),
    many(0x608F, "Position encoder resolution",
          ("Increments", U32, "ro", "", 1 << 24, "inc", "config.encoder_increments"),
          ("Motor revolutions", U32, "ro", "", 1, "rev", "config.encoder_revolutions")),
    many(0x6090, "Velocity encoder resolution",
          ("Increments per second", U32, "ro", "", 1 << 24, "inc/s", "config.encoder_increments"),
          ("Motor revolutions per second", U32, "ro", "", 1, "rev/s",
           "config.encoder_revolutions")),
    many(0x6091, "Gear ratio",
          ("Motor revolutions", U32, "idle", "", 1, "rev", "config.gear_motor"),
          ("Shaft revolutions", U32, "idle", "", 1, "rev", "config.gear_shaft")),
    many(0x6092, "Feed constant",
          ("Feed", U32, "idle", "", 1 << 24, "pu", "config.feed"),
          ("Shaft revolutions", U32, "idle", "", 1, "rev", "config.feed_shaft")),
    var(0x6098, "Homing method", I8, "rw", "R", 37, "", "config.homing_method"),
    many(0x6099, "Homing speeds",
          ("Search for switch", U32, "rw", "", 1 << 24, "pu/s", "config.homing_speed_switch"),
          ("Search for zero", U32, "rw", "", 1677721, "pu/s", "config.homing_speed_zero")),
    var(0x609A, "Homing acceleration", U32, "rw", "", 167772160, "pu/s^2",
         "config.homing_acceleration"),
    var(0x60A3, "Profile jerk use", U8, "ro", "", 1),
    many(0x60A4, "Profile jerk",
          ("Jerk", U32, "rw", "", 0xFFFFFFFF, "pu/s^3", "special")),
    var(0x60B0, "Position offset", I32, "rw", "R", 0, "pu", "rx.position_offset"),
    var(0x60B1, "Velocity offset", I32, "rw", "R", 0, "pu/s", "rx.velocity_offset"),
    var(0x60B2, "Torque offset", I16, "rw", "R", 0, "0.1 %", "rx.torque_offset"),
    var(0x60B8, "Touch probe function", U16, "rw", "R", 0, "", "rx.probe_function"),
    var(0x60B9, "Touch probe status", U16, "ro", "T", 0, "", "tx.probe_status"),
    var(0x60BA, "Touch probe 1 positive edge", I32, "ro", "T", 0, "pu", "tx.probe_1_positive"),
    var(0x60BB, "Touch probe 1 negative edge", I32, "ro", "T", 0, "pu", "tx.probe_1_negative"),
    var(0x60BC, "Touch probe 2 positive edge", I32, "ro", "T", 0, "pu", "tx.probe_2_positive"),
    var(0x60BD, "Touch probe 2 negative edge", I32, "ro", "T", 0, "pu", "tx.probe_2_negative"),
    var(0x60C0, "Interpolation sub mode select", I16, "rw", "", 0, "0: linear", "special"),
    many(0x60C1, "Interpolation data record",
          ("Position set-point", I32, "rw", "R", 0, "pu", "rx.interpolated_position")),
    many(0x60C2, "Interpolation time period",
          ("Value", U8, "idle", "", 1, "s x 10^index", "special"),
          ("Index", I8, "idle", "", -3, "", "special"), code=9),
    var(0x60C5, "Max acceleration", U32, "rw", "R", 0xFFFFFFFF, "pu/s^2",
         "config.max_acceleration"),
    var(0x60C6, "Max deceleration", U32, "rw", "R", 0xFFFFFFFF, "pu/s^2",
         "config.max_deceleration"),
    var(0x60E0, "Positive torque limit", U16, "rw", "R", 3500, "0.1 %",
         "config.torque_limit_positive"),
    var(0x60E1, "Negative torque limit", U16, "rw", "R", 3500, "0.1 %",
         "config.torque_limit_negative"),
    many(0x60E3, "Supported homing methods",
          *((f"Method {n}", I8, "ro", "", n, "", "") for n in HOMING_METHODS)),
    var(0x60F2, "Positioning option code", U16, "rw", "", 0, "", "config.positioning_option"),
    var(0x60F4, "Following error actual value", I32, "ro", "T", 0, "pu", "tx.following_error"),
    var(0x60FC, "Position demand internal", I32, "ro", "T", 0, "inc", "tx.demand_internal"),
    var(0x60FD, "Digital inputs", U32, "ro", "T", 0, "", "tx.digital_inputs"),
    many(0x60FE, "Digital outputs",
          ("Physical outputs", U32, "rw", "R", 0, "", "rx.digital_outputs"),
          ("Bit mask", U32, "rw", "R", 0, "", "rx.output_mask")),
    var(0x60FF, "Target velocity", I32, "rw", "R", 0, "pu/s", "rx.target_velocity"),
    var(0x6502, "Supported drive modes", U32, "ro", "T", 0x000003ED),
)
# fmt: on

OBJECTS: dict[int, Object] = {thing.index: thing for thing in (*_COMMUNICATION, *_MAKER, *_PROFILE)}
"""Every object by its index."""
_ENTRIES = {(row.index, row.sub): row for thing in OBJECTS.values() for row in thing.entries}

DUMMIES: dict[int, int] = {0x01: 1, 0x02: 8, 0x03: 16, 0x04: 32, 0x05: 8, 0x06: 16, 0x07: 32}
"""Bits of the data types that may fill a receive PDO: they are skipped."""


def entry(index: int, sub: int) -> ObjectEntry:
    """The row of an object; `SdoError` when there is none.

    >>> entry(0x6040, 0).name
    'Controlword'
    """
    if index not in OBJECTS:
        raise SdoError(Abort.NO_OBJECT, index, sub)
    if (index, sub) not in _ENTRIES:
        raise SdoError(Abort.NO_SUBINDEX, index, sub)
    return _ENTRIES[index, sub]


def default(row: ObjectEntry, node_id: int) -> int | float | str:
    """The power-on value of a row in a node: COB-IDs carry the number of the node.

    >>> hex(default(entry(0x1014, 0), 5))
    '0x85'
    """
    if isinstance(row.default, int) and (
        row.index == 0x1014
        or (0x1400 <= row.index < 0x1C00 and row.sub == 1 and not row.index & 0x200)
    ):
        return row.default + node_id
    return row.default
