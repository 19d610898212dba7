"""kickcat, unmodified, judges a line of drives: kickcat_judge.py DRIVES. LRD and LWR."""

from __future__ import annotations

import struct
import sys
import time

import kickcat
from wire import MAIN, Wire, judge

DRIVES = int(sys.argv[1])
OUT, IN = struct.Struct("<Hbxiih"), struct.Struct("<HbxiihHiI")
STEPS = {0x40: 0x06, 0x21: 0x07, 0x23: 0x0F, 0x27: 0x0F}

wire = Wire(DRIVES)
link = kickcat.create_link(MAIN, "")
link.set_timeout(0.02)  # without a second interface every read of the SII waits so long
bus = kickcat.Bus(link)


def scan() -> None:
    bus.init(2.0)  # the watchdog of the outputs
    link.set_timeout(0.5)
    assert len(bus.slaves()) == DRIVES


def read_sdo() -> None:
    for drive in bus.slaves():
        data = bus.read_sdo(drive, 0x1018, 2, kickcat.Access.PARTIAL, 4, 1.0)
        assert bytes(data[:4]) == struct.pack("<I", 0x5E4B0402), data


def mapping() -> None:
    bus.create_mapping()
    for drive in bus.slaves():
        assert (drive.output_size, drive.input_size) == (14, 24)


def cycle() -> None:
    bus.process_data_no_check()


def to_op() -> None:
    bus.request_state(kickcat.State.SAFE_OP)
    bus.wait_for_state(kickcat.State.SAFE_OP, 2.0)
    for drive in bus.slaves():
        drive.set_output_bytes(OUT.pack(0, 8, 0, 0, 0))
    bus.request_state(kickcat.State.OPERATIONAL)
    bus.wait_for_state(kickcat.State.OPERATIONAL, 5.0, cycle)


def smooth(k: int, n: int) -> int:
    """A way of 100000 increments in n cycles, its jerk bounded."""
    x = min(k, n) / n
    return round(100_000 * x**4 * (35 - 84 * x + 70 * x**2 - 20 * x**3))


def targets() -> None:
    """Enabled, then 1000 targets; every drive is where it was sent."""
    started: dict[int, int] = {}
    sent = 0
    end = time.monotonic() + 60
    while sent < 2500:  # the motion takes 1000, then friction lets go
        assert time.monotonic() < end, [hex(IN.unpack(d.input_data)[0]) for d in bus.slaves()]
        cycle()
        words = [IN.unpack(drive.input_data) for drive in bus.slaves()]
        if not started and all(word[0] & 0x106F == 0x1027 for word in words):
            started = {k: word[2] for k, word in enumerate(words)}
        sent += bool(started)
        for k, (drive, word) in enumerate(zip(bus.slaves(), words, strict=True)):
            target = started[k] + smooth(sent, 1000) if started else word[2]
            drive.set_output_bytes(OUT.pack(STEPS.get(word[0] & 0x6F, 0), 8, target, 0, 0))
    for k, drive in enumerate(bus.slaves()):
        word = IN.unpack(drive.input_data)
        assert word[0] & 0x106F == 0x1027, hex(word[0])
        assert abs(word[2] - started[k] - 100_000) <= 1, (word, started)
    for device in wire.fault("status")["devices"]:
        assert device["samples"] >= 1000
        assert not set(device["findings"]) & {"JUMP", "SKIPPED"}, device


def end() -> None:
    bus.request_state(kickcat.State.INIT)
    bus.wait_for_state(kickcat.State.INIT, 2.0)


with wire:
    judge({"scan": scan, "SDO": read_sdo, "mapping": mapping, "Operational": to_op,
           "targets": targets, "end": end})  # fmt: skip
