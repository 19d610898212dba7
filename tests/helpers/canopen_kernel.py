"""A kernel as CANopen master in a process of its own, and its death: run in a bus of one's own.

`-m helpers.canopen_kernel master GOAL OPTION` enables, moves, tells lines of JSON. `judge OPTION`
starts a drive process and a master process, kills the master in mid-motion, looks on what the
drive does, starts the next master, and prints one JSON object of what was seen. `end` ends a master
in mid-motion in order, with the drive there and with the drive suspended, and prints the same.
"""

from __future__ import annotations

import json
import signal
import struct
import subprocess
import sys
import time

import can

from helpers.root import program
from sjerk import Axis, DriveConfig, Limits, MotionKernel, SjerkError
from sjerk.kernel import FeedForward
from sjerk.ports.canopen import Master, SdoClient

NODE, T = 5, 0.01
SLOW_T = 0.05
COUNTS = 2**24 / 360.0
BUS = {"interface": "udp_multicast", "channel": "239.74.163.2"}
LIMITS = Limits(90.0, 500.0, 5000.0)


def say(**what: object) -> None:
    print(json.dumps(what), flush=True)


def master(goal: float, option: int, bus: can.BusABC) -> None:
    """Enable from whatever state the drive is in, move; the first lines tell where it began."""
    kernel = MotionKernel([Axis(LIMITS, COUNTS, "external")], T)
    master = Master(kernel, bus, {0: NODE}, heartbeat=0.05, lost=6, abort_option=option)
    host = kernel.host()

    def cycles(n: int) -> None:
        left = iter(range(n + 1))
        master.run(lambda: next(left) == n)

    def until(met: object) -> None:
        end = time.monotonic() + 30.0
        master.run(lambda: met() or time.monotonic() > end)  # type: ignore[operator]
        assert met(), "waited too long"  # type: ignore[operator]

    cycles(20)
    axis = host.feedback().axes[0]
    say(state=axis.state.name, enabled=axis.enabled, at=axis.actual_counts)
    host.reset()
    cycles(20)
    SdoClient(bus, NODE).write(0x2101, 1, bytes(4))  # the verdict begins anew
    host.enable()
    until(lambda: host.feedback().axes[0].follows)
    axis = host.feedback().axes[0]
    say(follows=True, commanded=axis.target_counts, actual=axis.actual_counts)
    move = host.move(goal)
    until(lambda: abs(host.feedback().axes[0].velocity) > 20.0 or move.done)
    say(moving=True)
    until(lambda: move.done)
    cycles(30)
    sdo = SdoClient(bus, NODE)
    found = [int.from_bytes(sdo.read(0x2101, sub), "little") for sub in range(7, 14)]
    say(done=True, at=host.feedback().axes[0].actual_counts, findings=found)
    host.disable()
    cycles(20)


def judge(option: int) -> None:
    order = [sys.executable, "-m", "sjerk", "drive", "--node", str(NODE)]
    drive = subprocess.Popen(order, stdout=subprocess.PIPE, text=True)
    assert drive.stdout is not None
    assert "is ready" in drive.stdout.readline()

    def start(goal: float) -> subprocess.Popen[str]:
        order = program("helpers.canopen_kernel", "master", str(goal), str(option))
        return subprocess.Popen(order, stdout=subprocess.PIPE, text=True)

    try:
        first = start(300.0)
        assert first.stdout is not None
        told = [json.loads(first.stdout.readline()) for _ in range(3)]
        first.send_signal(signal.SIGKILL)
        first.wait()
        seen = {"first": told, "drive": []}
        with can.Bus(**BUS) as bus:
            looker = SdoClient(bus, NODE)
            end, before = time.monotonic() + 10.0, None
            while time.monotonic() < end:
                word, error, at = (
                    int.from_bytes(looker.read(index), "little", signed=index == 0x6064)
                    for index in (0x6041, 0x603F, 0x6064)
                )
                seen["drive"] = [word, error, at]
                if word & 0x6F != 0x27 and at == before:
                    break
                before = at
                time.sleep(0.05)
        second = start(10.0)
        out, _ = second.communicate(timeout=90.0)
        seen["second"] = [json.loads(line) for line in out.splitlines()]
        print(json.dumps(seen))
    finally:
        drive.terminate()
        drive.communicate()


def last(bus: can.BusABC) -> None:
    """Enable and jog; end in full motion when a line comes; tell what the drive says just then."""
    fed = FeedForward.of(DriveConfig.for_motor())
    # cycles so long, and heartbeats so patient, that a busy machine loses no axis
    kernel = MotionKernel([Axis(LIMITS, COUNTS, "external", feed_forward=fed)], SLOW_T)
    master = Master(kernel, bus, {0: NODE}, heartbeat=0.5, lost=20)
    SdoClient(bus, NODE).write(0x2100, 7, struct.pack("<H", 10_000))
    host = kernel.host()

    def until(met: object) -> None:
        end = time.monotonic() + 30.0
        master.run(lambda: met() or time.monotonic() > end)  # type: ignore[operator]
        assert met(), "waited too long"  # type: ignore[operator]

    until(lambda: not kernel.image.stale.any())
    host.reset()
    host.enable()
    until(lambda: host.feedback().axes[0].follows)
    host.jog(80.0)
    until(lambda: host.feedback().axes[0].velocity == 80.0)
    say(moving=True)
    sys.stdin.readline()
    begun = host.feedback()
    whole = master.end()
    frame = host.feedback()
    axis = frame.axes[0]
    say(
        whole=whole,
        seconds=(frame.cycle - begun.cycle) * SLOW_T,
        stale=bool(kernel.image.stale[0]),
        velocity=axis.velocity,
        word=axis.statusword,
    )


def read(bus: can.BusABC, index: int, sub: int = 0, *, signed: bool = False) -> int:
    """A number from the drive; a busy machine may be slow to answer."""
    sdo, tries = SdoClient(bus, NODE), 10
    while True:
        try:
            return int.from_bytes(sdo.read(index, sub), "little", signed=signed)
        except SjerkError:
            tries -= 1
            if not tries:
                raise


def end() -> None:
    order = [sys.executable, "-m", "sjerk", "drive", "--node", str(NODE)]
    drive = subprocess.Popen(order, stdout=subprocess.PIPE, text=True)
    assert drive.stdout is not None
    assert "is ready" in drive.stdout.readline()

    def ended(suspend: bool) -> dict[str, object]:
        order = program("helpers.canopen_kernel", "last")
        child = subprocess.Popen(order, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert child.stdout is not None
        assert json.loads(child.stdout.readline()) == {"moving": True}
        if suspend:
            drive.send_signal(signal.SIGSTOP)
        out, _ = child.communicate("end\n", timeout=60.0)
        return dict(json.loads(out))

    try:
        seen: dict[str, object] = {"heard": ended(False)}
        with can.Bus(**BUS) as bus:  # not before: no frames of the motion wait in it
            seen["drive"] = [
                read(bus, index, signed=index == 0x606C) for index in (0x6041, 0x606C, 0x603F)
            ]
            seen["findings"] = [read(bus, 0x2101, sub) for sub in (7, 8, 10)]
        seen["silent"] = ended(True)
        print(json.dumps(seen))
    finally:
        drive.send_signal(signal.SIGCONT)
        drive.terminate()
        drive.communicate()


if __name__ == "__main__":
    if sys.argv[1] == "master":
        with can.Bus(**BUS) as bus:
            master(float(sys.argv[2]), int(sys.argv[3]), bus)
    elif sys.argv[1] == "last":
        with can.Bus(**BUS) as bus:
            last(bus)
    elif sys.argv[1] == "end":
        end()
    else:
        judge(int(sys.argv[2]))
