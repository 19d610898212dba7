"""A kernel in its process as main device of a line of drives: kernel_judge.py DRIVES.

Not a judge of another make: whole runs of `sjerk kernel` over a cable. The drives' own verdict, and
what they tell of their states, judge the kernel.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable

import pysoem
from wire import MAIN, Wire, behind, judge

from sjerk.errors import KernelGoneError
from sjerk.kernel import MotionKernel, described, port_tables
from sjerk.ports.ethercat.inside import port_of

DRIVES = int(sys.argv[1])
COUNTS = 2**24
#: The machine may be busy: the drives wait for half a second, and count no missed SYNC0.
STARTUP = [["10F1:2", "u16", 0xFFFF]]
AXIS = {
    "drive": "ethercat",
    "counts_per_unit": float(COUNTS),
    "unit": "rev",
    "limits": {"velocity": 20.0, "acceleration": 400.0, "jerk": 4e4},
}


def kernel_of(name: str, *, count: int = DRIVES, **more: object) -> MotionKernel:
    axes = [{**AXIS, "ethercat": {"position": k, "startup": STARTUP} | more} for k in range(count)]
    bus = {"interface": MAIN, "lost": 40}
    table = {"cycle_time": 0.002, "ethercat": bus, "axes": axes}
    kernel = described("here.toml", table, name=name)
    kernel.port = port_of("here.toml", *(port_tables(table, "ethercat") or ({}, {})))
    return kernel


def until(met: Callable[[], bool], what: str, seconds: float = 8.0) -> None:
    end = time.monotonic() + seconds
    while not met():
        assert time.monotonic() < end, f"{what}: {wire.told[-12:]}"
        time.sleep(0.01)


wire = Wire(DRIVES)
kernel = kernel_of(f"kernel-judge-{time.monotonic_ns()}")
host = None


def states() -> list[str]:
    return [axis.state.name for axis in host.feedback().axes]


def al_states() -> list[int]:
    """As the drives themselves have them."""
    return [device["state"] for device in wire.fault("status")["devices"]]


def refusals() -> None:
    """What is not as described ends the kernel at once, with one line that says where."""
    for wrong, words in (
        (kernel_of("wrong", identity=[1, 2]), ["device 0", "identity"]),
        (kernel_of("short", count=DRIVES - 1), [f"device {DRIVES - 1}", "others"]),
    ):
        try:
            with wrong:
                raise AssertionError("it started")
        except KernelGoneError as gone:
            text = str(gone)
        assert all(word in text for word in words), text


def start() -> None:
    global host
    kernel.__enter__()
    host = kernel.host()
    bus = host.feedback().bus
    assert bus is not None
    assert bus.aligned
    assert al_states() == [8] * DRIVES


def moves() -> None:
    """Three moves; the goal in increments to the bit, no wrong working counter, no finding."""
    host.enable()
    for goal in (2.0, -1.5, 0.25):
        move = host.move([goal + k for k in range(DRIVES)])
        until(lambda move=move: move.done, f"the move: {states()}")
    axes = host.feedback().axes
    assert [axis.target_counts for axis in axes] == [
        round((0.25 + k) * COUNTS) for k in range(DRIVES)
    ]
    bus = host.feedback().bus
    assert bus.lost >= 0
    assert [row.wrong for row in bus.axes.values()] == [0] * DRIVES
    devices = wire.fault("status")["devices"]
    assert all(device["samples"] > 100 for device in devices)
    missed = [device["syncs_missed"] for device in devices]
    for device in devices:  # a busy machine leaves cycles out: these alone may be found
        found = {kind for kind, count in device["findings"].items() if count}
        assert found == set() or sum(missed), (device, missed)


def requests_beside() -> None:
    """`sjerk ethercat` reads, writes and scans while the cycle goes on."""
    sjerk = [sys.executable, "-m", "sjerk", "ethercat"]

    def ask(*words: str) -> dict[str, object]:
        command = [*sjerk, *words, "--json"]
        done = subprocess.run(command, capture_output=True, text=True, preexec_fn=behind)
        assert done.returncode == 0, done.stderr
        return dict(json.loads(done.stdout))

    before = host.feedback().bus
    ask("write", MAIN, "1", "6065", "77777")
    assert ask("read", MAIN, "1", "6065")["value"] == 77777
    rows = ask("scan", MAIN)["devices"]
    assert [row["state"] for row in rows] == ["08h"] * DRIVES
    after = host.feedback().bus
    assert after.sent > before.sent
    assert states() == ["STANDSTILL"] * DRIVES


SECOND = f"""
[ethercat]
interface = "{MAIN}"
[[axes]]
counts_per_unit = 1.0
limits = {{ velocity = 1.0, acceleration = 1.0, jerk = 1.0 }}
[axes.ethercat]
position = 0
"""


def second() -> None:
    """`sjerk kernel` on the same interface is refused at the start; the first goes on."""
    with tempfile.NamedTemporaryFile("w", suffix=".toml") as file:
        file.write(SECOND)
        file.flush()
        command = [sys.executable, "-m", "sjerk", "kernel", file.name]
        done = subprocess.run(command, capture_output=True, text=True, preexec_fn=behind)
    assert done.returncode == 6, done
    assert f"main device on {MAIN}" in done.stderr, done.stderr
    assert states() == ["STANDSTILL"] * DRIVES


def cable() -> None:
    """Pulled behind the first drive: its axis stays, the others are lost; and back."""
    wire.fault("cut 1")
    try:
        until(lambda: states()[1:] == ["ERROR_STOP"] * (DRIVES - 1), "the loss")
        assert states()[0] == "STANDSTILL"
    finally:
        wire.fault("heal")
    back()


def back() -> None:
    """Operational by itself; moves after a reset."""
    until(lambda: all(row.state == 8 for row in host.feedback().bus.axes.values()), "OP")

    def reset() -> bool:
        host.reset()
        time.sleep(0.05)
        return "ERROR_STOP" not in states()

    until(reset, "the reset")
    host.enable()
    move = host.move([axis.position + 1.0 for axis in host.feedback().axes])
    until(lambda: move.done, "the move afterwards")


def power() -> None:
    """The last drive off and on: address, clock, mapping and state again."""
    wire.fault(f"power {DRIVES - 1}")
    until(lambda: states()[-1] == "ERROR_STOP", "the loss")
    back()


def drop() -> None:
    """A drive falls to Safe-operational by itself, its working counter still right."""
    wire.fault("state 0 0x14 0x1a")
    until(lambda: states()[0] == "ERROR_STOP", "the loss")
    back()


def end() -> None:
    """In mid-motion: a halt, each drive disabled, Safe-operational, Init; no error anywhere."""
    at = len(wire.told)
    host.move([axis.position + 30.0 for axis in host.feedback().axes])
    time.sleep(0.3)
    kernel.__exit__()
    time.sleep(0.2)
    told = wire.told[at:]
    for k in range(DRIVES):
        mine = [line.partition(": ")[2] for line in told if line.startswith(f"{k}: ")]
        assert "error" not in " ".join(mine), mine
        assert mine[0] in ("switched on", "ready to switch on"), mine  # disabled first
        assert mine[-2:] == ["SAFEOP", "INIT"], mine
    assert al_states() == [1] * DRIVES


def taken() -> None:
    """Another main device (pysoem) takes the drives: all axes stop, it is told, nobody fights."""
    with kernel_of(f"taken-{time.monotonic_ns()}") as taken:
        watcher = taken.host()
        watcher.enable()
        other = pysoem.Master()
        other.open(MAIN)
        try:
            assert other.config_init() == DRIVES
            until(lambda: watcher.feedback().bus.foreign, "to be told")
            until(
                lambda: all(a.state.name == "ERROR_STOP" for a in watcher.feedback().axes), "stop"
            )
            time.sleep(0.3)
            assert al_states() == [2] * DRIVES  # left by it
        finally:
            other.close()


try:
    judge(
        {
            "refusals": refusals,
            "start": start,
            "moves": moves,
            "requests beside": requests_beside,
            "a second kernel": second,
            "cable": cable,
            "power": power,
            "drop": drop,
            "end": end,
            "taken": taken,
        }
    )
finally:
    kernel.__exit__()
    wire.__exit__()
