"""soemx (SOEM 2), unmodified, judges a line of drives: soemx_judge.py DRIVES.

A program of its own: SOEM 2 is under the GPL, no test imports it. The SDO calls of this binding
send no mail (seen in a capture): they judge nothing here.
"""

from __future__ import annotations

import struct
import sys
import time

import soemx
from wire import MAIN, Wire, judge

DRIVES = int(sys.argv[1])
OUT, IN = struct.Struct("<Hbxiih"), struct.Struct("<HbxiihHiI")
STEPS = {0x40: 0x06, 0x21: 0x07, 0x23: 0x0F, 0x27: 0x0F}
PATIENCE_US = 5_000_000

wire = Wire(DRIVES)
main = soemx.Master()


def scan() -> None:
    main.open(MAIN)
    assert main.config_init() == DRIVES
    for drive in main.slaves:
        assert (drive.man, drive.id) == (0x5E4B, 0x5E4B0402)
        drive.set_watchdog("processdata", 2000)


def exchange() -> bool:
    main.send_processdata()
    counter = main.receive_processdata(500_000)
    assert counter in (-1, main.expected_wkc), counter
    return counter == main.expected_wkc


def to_op() -> None:
    main.config_map()
    assert main.state_check(soemx.SAFEOP_STATE, 0, PATIENCE_US) == soemx.SAFEOP_STATE
    for drive in main.slaves:
        drive.output = OUT.pack(0, 8, 0, 0, 0)
    main.state = soemx.OP_STATE
    main.write_state()
    end = time.monotonic() + 30
    while main.state_check(soemx.OP_STATE, 0, 2000) != soemx.OP_STATE:
        exchange()
        assert time.monotonic() < end


def targets() -> None:
    """Enabled, then 1000 targets of a smooth motion; every drive arrives."""
    sent, start = 0, [0] * DRIVES
    for _ in range(3500):  # the motion takes 1000, then friction lets go
        exchange()
        words = [IN.unpack(drive.input) for drive in main.slaves]
        if not sent and all(word[0] & 0x106F == 0x1027 for word in words):
            start = [word[2] for word in words]
            sent = 1
        x = min(sent, 1000) / 1000
        way = round(4_000_000 * x**4 * (35 - 84 * x + 70 * x**2 - 20 * x**3))
        for k, (drive, word) in enumerate(zip(main.slaves, words, strict=True)):
            target = start[k] + way if sent else word[2]
            drive.output = OUT.pack(STEPS.get(word[0] & 0x6F, 0), 8, target, 0, 0)
        sent += bool(sent)
    for k, drive in enumerate(main.slaves):
        assert abs(IN.unpack(drive.input)[2] - start[k] - 4_000_000) <= 1, IN.unpack(drive.input)
    for device in wire.fault("status")["devices"]:
        assert device["samples"] >= 1000
        assert set(device["findings"]) <= {"STALE"}, device


def end() -> None:
    main.state = soemx.INIT_STATE
    main.write_state()
    assert main.state_check(soemx.INIT_STATE, 0, PATIENCE_US) == soemx.INIT_STATE
    main.close()


with wire:
    judge({"scan": scan, "Operational": to_op, "targets": targets, "end": end})
