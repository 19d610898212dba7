"""Cycles of a kernel with drives on a cable: ethercat_cycle.py WAY DRIVES CYCLE_US SECONDS.

WAY: ``ours`` (the exchange in C), ``together`` (the same, one LRW for all drives), ``arrivals``
(as ours, its clock held by arrival times), ``pysoem`` (exchange and clock in Python, as its users
write them). Prints one line of JSON.
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

OUT, IN = struct.Struct("<Hbxiih"), struct.Struct("<HbxiihHiI")
OUTPUTS = ("controlword", "mode", "target_position", "velocity_offset", "torque_offset")
INPUTS = (
    "statusword", "mode_display", "position_actual", "velocity_actual", "torque_actual",
    "error_code", "following_error", "digital_inputs",
)  # fmt: skip

OPERATIONAL = 8
SETTLES_S = 1.0  # the clocks, before anything is counted
LOOKS_S = 0.005  # between two looks at the drives' states
AXIS = Axis(Limits(20.0, 400.0, 4e4), 2**24, "external", unit="rev")


def histogram(values: list[int]) -> object:
    """As the kernel's."""
    made = ffi.new("sj_histogram *")
    for value in values:
        lib.sj_histogram_add(made, value)
    return made


def empty(made: object) -> None:
    """Count from here on."""
    ffi.memmove(ffi.addressof(made), bytes(ffi.sizeof("sj_histogram")), ffi.sizeof("sj_histogram"))


def row(made: object) -> dict[str, float]:
    """Microseconds."""
    of = Distribution.of(made)
    return {"median": of.median * 1e6, "p99": of.p99 * 1e6, "worst": of.worst * 1e6}


def in_c(way: str, count: int, period_us: int, seconds: int) -> dict[str, object]:
    """The exchange in C; ``way`` arrivals holds its clock by arrival times, once it has begun.

    ``thrown out``: each drive that left Operational, with its 0134h and, since the look before, how
    many cycles were skipped and by how much the latest began late.
    """
    T = period_us * 1000
    kernel = MotionKernel([AXIS] * count, period_us * 1e-6)
    drives: dict[str, object] = {str(k): {"position": k} for k in range(count)}
    bus = {"interface": MAIN, "lost": 1000}
    core = kernel.core
    began = time.monotonic()
    connection = connect(core, T, {"path": "bench", "bus": bus, "axes": drives})
    c = connection.bus.c
    c.together = way == "together"
    set_up = time.monotonic() - began
    end, options = ffi.new("sj_clock_end *"), Clock().to_c(period_us * 1e-6)
    cycle = threading.Thread(
        target=lambda: lib.sj_clock_run(core, ffi.NULL, options, connection.exchange, end)
    )
    cycle.start()
    try:
        connection.start()
        c.raw = way == "arrivals"
        time.sleep(SETTLES_S)
        for field in (core.feedback.computing, core.feedback.latency, c.phase):
            empty(field)
        before = c.told.sent, c.told.lost, core.feedback.late
        thrown: list[str] = []
        latest = ffi.new("sj_histogram *")
        until, out, skipped = time.monotonic() + seconds, set(), core.feedback.late
        while time.monotonic() < until:
            time.sleep(LOOKS_S)
            states = [int(c.drive[k].told.state) for k in range(count)]
            for k in [k for k, state in enumerate(states) if state != OPERATIONAL]:
                if k not in out:
                    thrown.append(
                        f"drive {k}, 0134h = {c.drive[k].told.code:04X}h, "
                        f"{core.feedback.late - skipped} cycles skipped, "
                        f"up to {core.feedback.latency.worst_ns / 1000:.0f} us late"
                    )
            out = {k for k, state in enumerate(states) if state != OPERATIONAL}
            skipped = core.feedback.late
            latest.worst_ns = max(latest.worst_ns, core.feedback.latency.worst_ns)
            core.feedback.latency.worst_ns = 0
        core.feedback.latency.worst_ns = latest.worst_ns
        result = {
            "work": row(core.feedback.computing),
            "wake": row(core.feedback.latency),
            "phase": row(c.phase),
            "cycles": c.told.sent - before[0],
            "answers late": c.told.lost - before[1],
            "late": core.feedback.late - before[2],
            "wrong": sum(c.drive[k].told.wrong for k in range(count)),
            "set up": set_up,
            "thrown out": thrown,
        }
        lib.sj_clock_order(end, lib.SJ_END_REST)
        connection.release()
    finally:
        lib.sj_clock_order(end, lib.SJ_END_LEAVE)
        cycle.join()
        connection.close()
    return result


def in_python(count: int, period_us: int, seconds: int) -> dict[str, object]:
    """Exchange and clock by pysoem."""
    T = period_us * 1000
    kernel = MotionKernel([AXIS] * count, period_us * 1e-6)
    master = pysoem.Master()
    master.open(MAIN)
    began_all = time.monotonic()
    assert master.config_init() == count

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
    set_up = time.monotonic() - began_all
    image, slaves = kernel.image, master.slaves
    outputs, inputs = image.outputs, image.inputs
    kernel.step()
    work: list[int] = []
    whole: list[int] = []
    phase: list[int] = []
    due, integral, correction, wrong = time.monotonic_ns() + T, 0, 0, 0
    settle = round(SETTLES_S * 1e9) // T
    for k in range(settle + seconds * 1_000_000_000 // T):
        time.sleep(max(0, due - time.monotonic_ns()) * 1e-9)
        began, began_at = time.thread_time_ns(), time.monotonic_ns()
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
        took, took_all = time.thread_time_ns() - began, time.monotonic_ns() - began_at
        error = (master.dc_time - T // 2) % T
        error -= T if error > T // 2 else 0
        step = max(-T // 16, min(T // 16, error))
        integral += step
        correction = -step // 10 - integral // 2000
        if k >= settle:
            work.append(took)
            whole.append(took_all)
            phase.append(abs(error))
        due += T + correction
        while due <= time.monotonic_ns():
            due += T
    master.state = pysoem.INIT_STATE
    master.write_state()
    master.close()
    return {
        "work": row(histogram(work)),
        "whole": row(histogram(whole)),
        "phase": row(histogram(phase)),
        "cycles": len(work),
        "wrong": wrong,
        "set up": set_up,
    }


if __name__ == "__main__":
    what, numbers = sys.argv[1], [int(word) for word in sys.argv[2:5]]
    print(json.dumps(in_python(*numbers) if what == "pysoem" else in_c(what, *numbers)), flush=True)
