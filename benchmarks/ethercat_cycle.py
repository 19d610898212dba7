"""Cycles of a kernel with drives on a cable: ethercat_cycle.py WAY DRIVES CYCLE_US SECONDS.

WAY: ``ours`` (the exchange in C), ``arrivals`` (the same, its clock held by arrival times),
``pysoem`` (exchange and clock in Python, as its users write them). Prints one line of JSON.
"""

from __future__ import annotations

import json
import struct
import sys
import threading
import time

import pysoem

from sjerk import Axis, Clock, Limits, MotionKernel
from sjerk._binding import ffi, lib
from sjerk.cli.cable import MAIN
from sjerk.host import Distribution
from sjerk.ports.ethercat.inside import connect

WAY, DRIVES, CYCLE_US, SECONDS = sys.argv[1], *map(int, sys.argv[2:5])
T = CYCLE_US * 1000
OUT, IN = struct.Struct("<Hbxiih"), struct.Struct("<HbxiihHiI")
OUTPUTS = ("controlword", "mode", "target_position", "velocity_offset", "torque_offset")
INPUTS = (
    "statusword", "mode_display", "position_actual", "velocity_actual", "torque_actual",
    "error_code", "following_error", "digital_inputs",
)  # fmt: skip

axis = Axis(Limits(20.0, 400.0, 4e4), 2**24, "external", unit="rev")
kernel = MotionKernel([axis] * DRIVES, CYCLE_US * 1e-6)


def histogram(values: list[int]) -> object:
    """As the kernel's."""
    made = ffi.new("sj_histogram *")
    for value in values:
        lib.sj_histogram_add(made, value)
    return made


def row(made: object) -> dict[str, float]:
    """Microseconds."""
    of = Distribution.of(made)
    return {"median": of.median * 1e6, "p99": of.p99 * 1e6, "worst": of.worst * 1e6}


def in_c() -> dict[str, object]:
    drives = {str(k): {"position": k, "startup": [["10F1:2", "u16", 65535]]} for k in range(DRIVES)}
    bus = {"interface": MAIN, "lost": 1000}
    core = kernel.core
    connection = connect(core, T, {"path": "bench", "bus": bus, "axes": drives})
    c = connection.bus.c
    c.raw = WAY == "arrivals"
    end, options = ffi.new("sj_clock_end *"), Clock().to_c(CYCLE_US * 1e-6)
    cycle = threading.Thread(
        target=lambda: lib.sj_clock_run(core, ffi.NULL, options, connection.exchange, end)
    )
    cycle.start()
    try:
        connection.start()
        for field in (core.feedback.computing, core.feedback.latency, c.phase):
            ffi.memmove(ffi.addressof(field), bytes(ffi.sizeof("sj_histogram")),
                        ffi.sizeof("sj_histogram"))  # fmt: skip
        before = c.told.sent, c.told.lost, core.feedback.late
        time.sleep(SECONDS)
        result = {
            "work": row(core.feedback.computing),
            "wake": row(core.feedback.latency),
            "phase": row(c.phase),
            "cycles": c.told.sent - before[0],
            "answers late": c.told.lost - before[1],
            "late": core.feedback.late - before[2],
            "wrong": sum(c.drive[k].told.wrong for k in range(DRIVES)),
        }
        lib.sj_clock_order(end, lib.SJ_END_REST)
        connection.release()
    finally:
        lib.sj_clock_order(end, lib.SJ_END_LEAVE)
        cycle.join()
        connection.close()
    return result


def in_python() -> dict[str, object]:
    master = pysoem.Master()
    master.open(MAIN)
    assert master.config_init() == DRIVES

    def configure(drive: object) -> None:
        for assign, pdo in ((0x1C12, 0x1600), (0x1C13, 0x1A00)):
            drive.sdo_write(assign, 0, b"\0")
            drive.sdo_write(assign, 1, struct.pack("<H", pdo))
            drive.sdo_write(assign, 0, b"\1")
        drive.sdo_write(0x10F1, 2, struct.pack("<H", 65535))
        drive.dc_sync(1, T)

    for drive in master.slaves:
        drive.setup_func = lambda _, drive=drive: configure(drive)
    master.config_dc()
    master.config_map()
    master.state_check(pysoem.SAFEOP_STATE, 500_000)
    image, slaves = kernel.image, master.slaves
    outputs, inputs = image.outputs, image.inputs
    kernel.step()
    work: list[int] = []
    phase: list[int] = []
    due, integral, correction, wrong = time.monotonic_ns() + T, 0, 0, 0
    settle = 1_000_000_000 // T
    for k in range(settle + SECONDS * 1_000_000_000 // T):
        time.sleep(max(0, due - time.monotonic_ns()) * 1e-9)
        began = time.thread_time_ns()
        master.send_processdata()
        counter = master.receive_processdata(2000)
        if counter == master.expected_wkc:
            for i, drive in enumerate(slaves):
                words = inputs[i]
                for name, value in zip(INPUTS, IN.unpack(drive.input), strict=True):
                    words[name] = value
        else:
            wrong += counter >= 0
        kernel.step()
        for i, drive in enumerate(slaves):
            drive.output = OUT.pack(*(outputs[i][name] for name in OUTPUTS))
        took = time.thread_time_ns() - began
        error = (master.dc_time - T // 2) % T
        error -= T if error > T // 2 else 0
        step = max(-T // 16, min(T // 16, error))
        integral += step
        correction = -step // 10 - integral // 2000
        if k >= settle:
            work.append(took)
            phase.append(abs(error))
        due += T + correction
        while due <= time.monotonic_ns():
            due += T
    master.state = pysoem.INIT_STATE
    master.write_state()
    master.close()
    return {
        "work": row(histogram(work)),
        "phase": row(histogram(phase)),
        "cycles": len(work),
        "wrong": wrong,
    }


print(json.dumps(in_python() if WAY == "pysoem" else in_c()), flush=True)
