"""pysoem (SOEM 1.4), unmodified, judges a line of drives: pysoem_judge.py DRIVES."""

from __future__ import annotations

import struct
import sys
import time

import pysoem
from wire import MAIN, Wire, judge

DRIVES = int(sys.argv[1])
OUT, IN = struct.Struct("<Hbxiih"), struct.Struct("<HbxiihHiI")
PERIOD_NS = 10_000_000
PATIENCE_US = 5_000_000

# the machine may be busy: longer than the 2 ms and 700 ms that a bus of its own needs
pysoem.settings.timeouts.ret = 100_000
pysoem.settings.timeouts.rx_mailbox = 5_000_000

wire = Wire(DRIVES, "--drift-ppm", "20")
main = pysoem.Master()
emergencies: list[object] = []


def drives() -> list:
    return main.slaves


def scan() -> None:
    main.open(MAIN)
    assert main.config_init() == DRIVES
    for k, drive in enumerate(drives()):
        drive.add_emergency_callback(emergencies.append)
        assert (drive.man, drive.id, drive.rev) == (0x5E4B, 0x5E4B0402, 1)
        assert drive.name == "sjerk drive"
        assert drive.sdo_read(0x1018, 4) == struct.pack("<I", k + 1)


def transfers() -> None:
    for drive in drives():
        drive.sdo_write(0x6065, 0, struct.pack("<I", 99999))
        assert drive.sdo_read(0x6065, 0) == struct.pack("<I", 99999)
        assert drive.sdo_read(0x1008, 0) == b"sjerk drive"
        assert drive.sdo_read(0x6060, 0) == b"\0"


def segments() -> None:
    """A mapping of 32 words is 130 bytes, more than a mailbox holds: segments down and up."""
    for drive in drives():
        words = struct.pack("<H32I", 32, *[8] * 31, 0x60400010)
        drive.sdo_write(0x1603, 0, words, ca=True)
        assert drive.sdo_read(0x1603, 0, ca=True) == words


def refused_accesses() -> None:
    for index, sub, data, code in (
        (0x5000, 0, None, 0x06020000),
        (0x6040, 1, None, 0x06090011),
        (0x6041, 0, b"\0\0", 0x06010002),
        (0x6065, 0, b"\0\0", 0x06070013),
        (0x6060, 0, b"\x63", 0x06090030),
        (0x1600, 1, struct.pack("<I", 0x60400010), 0x08000022),
    ):
        try:
            if data is None:
                drives()[0].sdo_read(index, sub)
            else:
                drives()[0].sdo_write(index, sub, data)
        except pysoem.SdoError as error:
            told = error.abort_code
        else:
            raise AssertionError(f"{index:04X}h:{sub} was not refused")
        assert told == code, (hex(index), hex(told))


def object_dictionary() -> None:
    objects = drives()[0].od
    names = {thing.index: thing.name for thing in objects}
    assert names[0x6040] in ("Controlword", b"Controlword")
    assert len(names) > 90
    read = 0
    for thing in objects:
        for sub, entry in enumerate(thing.entries):
            if entry.data_type == 0 and entry.bit_length == 0:
                continue
            data = drives()[0].sdo_read(thing.index, sub)
            assert len(data) * 8 == entry.bit_length, (hex(thing.index), sub)
            read += 1
    assert read > 350


def eeprom() -> None:
    drive = drives()[0]
    assert drive.eeprom_read(8)[:4] == struct.pack("<I", 0x5E4B)
    before = drive.eeprom_read(4)[:2]
    drive.eeprom_write(4, struct.pack("<H", 1001))
    assert drive.eeprom_read(4)[:2] == struct.pack("<H", 1001)
    drive.eeprom_write(4, before)


def no_such_transition(state: int, code: int) -> None:
    drive = drives()[0]
    drive.state = state
    drive.write_state()
    drive.state_check(state, 200_000)
    main.read_state()
    assert drive.state & 0x10
    assert drive.al_status == code, hex(drive.al_status)
    drive.state = pysoem.PREOP_STATE | pysoem.STATE_ACK
    drive.write_state()
    assert drive.state_check(pysoem.PREOP_STATE, PATIENCE_US) == pysoem.PREOP_STATE


def without_power(drive: object) -> bool:
    """Switch on disabled, or fault behind its reaction: a motor on its ramp keeps its period."""
    return struct.unpack("<H", drive.sdo_read(0x6041, 0))[0] & 0x4F in (0x40, 0x08)


def setup(drive: object) -> None:
    """Remap: a PDO without velocity offset comes and goes; the default in the end."""
    rx = (0x60400010, 0x60600008, 0x00000008, 0x607A0020, 0x60B10020, 0x60B20010)
    drive.sdo_write(0x1C12, 0, b"\0")
    drive.sdo_write(0x1600, 0, b"\0")
    for sub, word in enumerate(rx, 1):
        drive.sdo_write(0x1600, sub, struct.pack("<I", word))
    drive.sdo_write(0x1600, 0, bytes((len(rx),)))
    drive.sdo_write(0x1C12, 1, struct.pack("<H", 0x1600))
    drive.sdo_write(0x1C12, 0, b"\1")
    drive.sdo_write(0x1C32, 2, struct.pack("<I", PERIOD_NS))
    end = time.monotonic() + PATIENCE_US * 1e-6
    while not without_power(drive):
        assert time.monotonic() < end
        time.sleep(0.001)
    drive.sdo_write(0x60C2, 1, b"\x0a")


def exchange() -> bool:
    """One cycle; whether it came back in time."""
    main.send_processdata()
    counter = main.receive_processdata(500_000)
    assert counter in (-1, main.expected_wkc), f"working counter {counter}"
    return counter == main.expected_wkc


def to_safeop() -> None:
    for drive in drives():
        drive.set_watchdog("processdata", 2000)
        drive.setup_func = setup
        assert drive.sdo_read(0x1C32, 1) == b"\1\0"
    size = main.config_map()
    assert size == DRIVES * 38, size
    assert main.state_check(pysoem.SAFEOP_STATE, PATIENCE_US) == pysoem.SAFEOP_STATE, codes()


def codes() -> list[tuple[str, str]]:
    main.read_state()
    return [(hex(drive.state), hex(drive.al_status)) for drive in drives()]


def to_op() -> None:
    for drive in drives():
        drive.output = OUT.pack(0, 8, 0, 0, 0)
    main.state = pysoem.OP_STATE
    main.write_state()
    end = time.monotonic() + 30
    while main.state_check(pysoem.OP_STATE, 2000) != pysoem.OP_STATE:
        exchange()
        assert time.monotonic() < end, codes()


def inputs(k: int) -> tuple[int, ...]:
    return IN.unpack(drives()[k].input)


def enable() -> None:
    steps = {0x40: 0x06, 0x21: 0x07, 0x23: 0x0F, 0x27: 0x0F}
    for _ in range(200):
        if not exchange():
            continue
        words = [inputs(k) for k in range(DRIVES)]
        if all(word[0] & 0x106F == 0x1027 for word in words):
            return
        for drive, word in zip(drives(), words, strict=True):
            drive.output = OUT.pack(steps.get(word[0] & 0x6F, 0), 8, word[2], 0, 0)
    raise AssertionError([hex(inputs(k)[0]) for k in range(DRIVES)])


def smooth(k: int, n: int) -> int:
    """A way of 4 million increments in n cycles, its jerk bounded."""
    x = k / n
    return round(4_000_000 * x**4 * (35 - 84 * x + 70 * x**2 - 20 * x**3))


def targets() -> None:
    """1000 targets of a smooth motion: every drive arrives, and has nothing to say against it."""
    start = [inputs(k)[2] for k in range(DRIVES)]
    sent = 0
    while sent < 1000:
        sent += 1
        for k, drive in enumerate(drives()):
            drive.output = OUT.pack(0x0F, 8, start[k] + smooth(sent, 1000), 0, 0)
        exchange()
    for _ in range(100):
        exchange()
    status = wire.fault("status", exchange)["devices"]
    for k in range(DRIVES):
        assert abs(inputs(k)[2] - start[k] - 4_000_000) <= 1, inputs(k)
        assert status[k]["samples"] >= 1000
        # an answer that came late repeats a target; nothing else may be found
        assert set(status[k]["findings"]) <= {"STALE"}, status[k]


def sdo_beside() -> None:
    for drive in drives():
        for _ in range(20):
            assert len(drive.sdo_read(0x6064, 0)) == 4
            exchange()


def fault_and_emergency() -> None:
    emergencies.clear()
    wire.fault(f"inject {DRIVES - 1} OVER_CURRENT", exchange)
    last = drives()[-1]
    for _ in range(20):
        exchange()
    assert inputs(DRIVES - 1)[0] & 8
    end = time.monotonic() + 10
    while not any(mail.error_code == 0x2310 for mail in emergencies):
        assert time.monotonic() < end, emergencies
        last.sdo_read(0x603F, 0)  # emergencies come on the way to an answer
        exchange()
    wire.fault(f"clear {DRIVES - 1} OVER_CURRENT", exchange)
    for word in (0, 0x80, 0):
        last.output = OUT.pack(word, 8, inputs(DRIVES - 1)[2], 0, 0)
        for _ in range(5):
            exchange()
    assert not inputs(DRIVES - 1)[0] & 8


def watchdog() -> None:
    end = time.monotonic() + 10
    drives()[0].set_watchdog("processdata", 50)
    exchange()
    while wire.status()["state"] == 8:
        assert time.monotonic() < end
        time.sleep(0.05)
    main.read_state()
    assert (drives()[0].state, drives()[0].al_status) == (0x14, 0x1B), codes()


def clocks() -> None:
    """From the start once more, by SYNC0: clocks follow the first, the period is SYNC0's."""
    main.state = pysoem.INIT_STATE
    main.write_state()
    main.state_check(pysoem.INIT_STATE, PATIENCE_US)
    assert main.config_init() == DRIVES
    assert main.config_dc()

    def by_sync0(drive: object) -> None:
        setup(drive)
        drive.sdo_write(0x10F1, 2, b"\xff\xff")
        drive.dc_sync(1, PERIOD_NS)

    for drive in drives():
        drive.add_emergency_callback(emergencies.append)
        drive.set_watchdog("processdata", 2000)
        drive.setup_func = by_sync0
    main.config_map()
    assert main.state_check(pysoem.SAFEOP_STATE, PATIENCE_US) == pysoem.SAFEOP_STATE, codes()
    to_op()
    before = [device["syncs"] for device in wire.fault("status", exchange)["devices"]]
    for _ in range(300):
        exchange()
        time.sleep(0.001)
    status = wire.fault("status", exchange)["devices"]
    for k, device in enumerate(status):
        assert device["state"] == 8
        assert device["syncs"] > before[k]
        assert drives()[k].sdo_read(0x1C32, 1) == b"\2\0"
        if k:
            assert abs(device["deviation_ns"]) < 1000, device


def end() -> None:
    main.state = pysoem.INIT_STATE
    main.write_state()
    assert main.state_check(pysoem.INIT_STATE, PATIENCE_US) == pysoem.INIT_STATE
    main.close()


with wire:
    judge(
        {
            "scan": scan,
            "transfers": transfers,
            "segments": segments,
            "refused accesses": refused_accesses,
            "object dictionary": object_dictionary,
            "SII": eeprom,
            "refusal 11h": lambda: no_such_transition(pysoem.OP_STATE, 0x11),
            "refusal 12h": lambda: no_such_transition(15, 0x12),
            "refusal 13h": lambda: no_such_transition(pysoem.BOOT_STATE, 0x13),
            "Safe-operational": to_safeop,
            "Operational": to_op,
            "operation enabled": enable,
            "targets": targets,
            "SDO beside": sdo_beside,
            "fault and emergency": fault_and_emergency,
            "watchdog": watchdog,
            "clocks": clocks,
            "end": end,
        }
    )
