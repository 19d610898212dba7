"""Seven drives on a cable, one LRW each: the cycle's work and the phase, beside other ways.

Work is processor time of the thread: take, kernel, send; in Python with pysoem, its waiting not
counted. Whole is the same with the wait for the answer, which the exchange in C does not have. Both
have one frame a cycle; most of what the one in C takes is the system's, which wakes the emulator.
Phase: of the cycle against the drives' clock. Each drive that left Operational is told with how
late the cycle was. Set up: from the scan to Safe-operational, on open sockets. Send: how late the
frame went out, beside the wake-ups of a thread that only sleeps to the same period in the same
seconds. Skips where no network namespace can be had.

In virtual time: how much faster than real time it is, and a frame through the emulated controllers
beside the same rules written in Python.
"""

from __future__ import annotations

import json
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import Report
from sjerk import Axis, Limits, MotionKernel
from sjerk._binding import ffi
from sjerk.cli.cable import first, inside
from sjerk.errors import SjerkError
from sjerk.ports.ethercat import Line, MainDevice

PROGRAM = Path(__file__).with_name("ethercat_cycle.py")
DRIVES, SECONDS = 7, 4
WAYS = ("ours", "together", "arrivals", "beside", "pysoem")


INSIDE = """
import subprocess, sys
from sjerk.cli.cable import drives
for way in {ways!r}:
    with drives({drives}):
        command = [sys.executable, {program!r}, way, "{drives}", "{cycle}", "{seconds}"]
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True)
    print(done.stdout.strip() or "null", flush=True)
"""


@pytest.mark.parametrize("cycle", [1000, 250])
def test_the_cycle_of_seven_drives(report: Report, cycle: int) -> None:
    """Work and phase of the ways, one after the other; one LRW for all drives is one of them."""
    words = {
        "ways": WAYS,
        "drives": DRIVES,
        "program": str(PROGRAM),
        "cycle": cycle,
        "seconds": SECONDS,
    }
    try:
        command = inside([sys.executable, "-c", INSIDE.format(**words)])
    except SjerkError as error:
        pytest.skip(str(error))
    done = subprocess.run(first(command), stdout=subprocess.PIPE, text=True)
    ways = dict(zip(WAYS, map(json.loads, done.stdout.split("\n")[: len(WAYS)]), strict=True))
    table = f"{DRIVES} EtherCAT drives at {cycle} us: us, median / p99 / worst"
    for way, result in ways.items():
        if result is None:
            report.line(table, f"{way:10} did not run: a stall of the machine")
            continue
        cells = [f"{way:10}"]
        for name in ("work", "whole", "phase", "wake", "send", "sleeper"):
            if name in result:
                row = result[name]
                numbers = " / ".join(f"{row[k]:.1f}" for k in ("median", "p99", "worst"))
                cells.append(f"{name} {numbers}")
        cells.append(f"set up {result['set up'] * 1e3:.0f} ms")
        cells.append(f"of {result['cycles']} cycles, wrong counters {result['wrong']}")
        if "late" in result:
            cells.append(f"late {result['late']}, answers late {result['answers late']}")
        report.line(table, "  ".join(cells))
        for text in result.get("thrown out", []):
            report.line(table, f"{way:10} thrown out: {text}")
    ours, arrivals, python = ways["ours"], ways["arrivals"], ways["pysoem"]
    if ours and python:
        for which in ("median", "p99"):
            ratio = ours["work"][which] / python["work"][which]
            report.line(table, f"work, {which}: ours / pysoem = {ratio:.3f}")
            ratio = ours["work"][which] / python["whole"][which]
            report.line(table, f"{which}: ours / pysoem with its wait = {ratio:.3f}  (<= 0.2)")
        ratio = ours["set up"] / python["set up"]
        report.line(table, f"set up to Safe-operational: ours / pysoem = {ratio:.2f}  (<= 1.1)")
        more = (ours["connect"] - ours["set up"]) * 1e3
        report.line(table, f"listening for another main device (100 ms), opening: {more:.0f} ms")
    if beside := ways["beside"]:
        ratio = beside["send"]["p99"] / beside["sleeper"]["p99"]
        report.line(table, f"p99: late sends / late wake-ups of a sleeper = {ratio:.2f}  (<= 1.3)")
    if ours and arrivals:
        for which in ("median", "p99"):
            ratio = ours["phase"][which] / arrivals["phase"][which]
            report.line(table, f"phase, {which}: ours / arrivals = {ratio:.3f}  (p99 <= 0.1)")
    if ours:
        assert ours["wrong"] == 0


class PythonLine:
    """The least that devices do with a cyclic frame, in Python: registers, FMMUs by bytes."""

    def __init__(self, stations: list[tuple[int, int, int, int]]) -> None:
        """Station, logical address, bytes out, bytes in."""
        self.devices = [(*row, bytearray(0x3000)) for row in stations]

    def frame(self, sent: bytes) -> bytes:
        """Through all of them."""
        frame = bytearray(sent)
        for station, logical, outputs, inputs, memory in self.devices:
            at, more = 16, 0x8000
            while more:
                command, _, address, size = struct.unpack_from("<BBIH", frame, at)
                length, more, data = size & 0x7FF, size & 0x8000, at + 10
                end = data + length
                count = 0
                if command == 12:  # LRW
                    if address == logical:
                        memory[0x1100 : 0x1100 + outputs] = frame[data : data + outputs]
                        frame[data : data + inputs] = memory[0x2000 : 0x2000 + inputs]
                        count = 3
                elif command == 7 or address & 0xFFFF == station:  # BRD, FPRD, FRMW
                    where = address >> 16
                    frame[data:end] = memory[where : where + length]
                    count = 1
                elif command == 14:
                    where = address >> 16
                    memory[where : where + length] = frame[data:end]
                    count = 1
                if count:
                    counter = struct.unpack_from("<H", frame, end)[0]
                    struct.pack_into("<H", frame, end, counter + count)
                at = end + 2
        return bytes(frame)


def best(work: Callable[[], object], count: int) -> float:
    """Seconds of one call, of the quickest of some rounds."""
    took = []
    for _ in range(7):
        began = time.perf_counter()
        for _ in range(count):
            work()
        took.append((time.perf_counter() - began) / count)
    return min(took)


def test_virtual_time(report: Report) -> None:
    """Seven drives that move, at 1 ms; a frame through seven beside three in Python."""
    frames, rows = {}, {}
    for drives in (3, DRIVES):
        axis = Axis(Limits(20.0, 400.0, 4e4), 2**24, "external", unit="rev")
        kernel = MotionKernel([axis] * drives, 1e-3)
        host, line = kernel.host(), Line(drives=drives)
        with MainDevice(kernel, line, {k: k for k in range(drives)}) as bus:
            host.enable()
            bus.run(lambda host=host: all(row.follows for row in host.feedback().axes))
            host.move([100.0] * drives)
            cycle = best(bus.exchange, 300)
            c = bus.bus.c
            frames[drives] = frame = bytes(ffi.buffer(c.flight[0].bytes, c.flight[0].length))
            rows[drives] = [
                (d.station, d.logical, d.out_bytes, d.in_bytes)
                for d in (c.drive[k] for k in range(drives))
            ]
            ours = best(lambda line=line, frame=frame: line.frame(frame), 2000)
    python = PythonLine(rows[3])
    assert python.frame(frames[3])[26 + 8] == 3  # one gave the clock, two took it
    theirs = best(lambda: python.frame(frames[3]), 500)
    table = f"{DRIVES} EtherCAT drives in virtual time"
    report.line(table, f"a cycle of 1 ms: {cycle * 1e6:.1f} us; "
                       f"of real time {1e-3 / cycle:.0f} times  (>= 50)")  # fmt: skip
    report.line(table, f"a frame: {ours * 1e6:.2f} us; the least for 3 in Python "
                       f"{theirs * 1e6:.1f} us: {ours / theirs:.3f}")  # fmt: skip
