"""A kernel as CANopen master: on a bus in one process, and killed with its drive in another."""

from __future__ import annotations

import json
import shlex
import struct
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest

from helpers.root import program
from sjerk import Axis, Drive, DriveConfig, InputError, Limits, MotionKernel, SjerkError
from sjerk.cycle.states import AxisState
from sjerk.drive.device import Device
from sjerk.host import EventKind, LimitSwitch, MoveState
from sjerk.kernel import FeedForward
from sjerk.ports.canopen import MASTER, Master, Node, SdoClient, sender

T = 5e-3
COUNTS = 2**24 / 360.0
LIMITS = Limits(90.0, 500.0, 5000.0)
NODES = {0: 3, 1: 4}


class Bus:
    """Two drives in a thread each on a virtual bus, and a kernel that leads them."""

    def __init__(self, channel: str) -> None:
        self.channel = channel
        self.devices: dict[int, Device] = {}
        self.ends = {node: threading.Event() for node in NODES.values()}
        self.ready = threading.Barrier(len(NODES) + 1)
        self.threads = [
            threading.Thread(target=self._drive, args=item) for item in self.ends.items()
        ]
        for thread in self.threads:
            thread.start()
        self.ready.wait(10.0)
        self.bus = can.Bus(interface="virtual", channel=channel)
        self.kernel = MotionKernel([Axis(LIMITS, COUNTS, "external")] * 2, T)
        self.host = self.kernel.host()

    def _drive(self, node_id: int, end: threading.Event) -> None:
        device = self.devices[node_id] = Device(Drive(), node_id=node_id)
        with can.Bus(interface="virtual", channel=self.channel) as bus:
            node = Node(device, sender(bus), now=time.monotonic())
            self.ready.wait(10.0)
            node.run(bus, end.is_set)

    def until(self, master: Master, met: Callable[[], bool], what: str) -> None:
        end = time.monotonic() + 30.0
        master.run(lambda: met() or time.monotonic() > end)
        assert met(), what

    def close(self) -> None:
        for end in self.ends.values():
            end.set()
        for thread in self.threads:
            thread.join()
        self.bus.shutdown()


@pytest.fixture
def bus(tmp_path: Path) -> Iterator[Bus]:
    """Closed whatever happens."""
    bus = Bus(f"master-{tmp_path.name}")
    yield bus
    bus.close()


def test_drives_on_the_bus_are_enabled_moved_and_disabled(bus: Bus) -> None:
    """Two axes arrive together; no target was a jump to the drives."""
    master = Master(bus.kernel, bus.bus, NODES)
    host = bus.host
    bus.until(master, lambda: not bus.kernel.image.stale.any(), "answers")
    host.enable()
    bus.until(master, lambda: all(a.follows for a in host.feedback().axes), "enabled drives")
    move = host.move([12.0, -7.0])
    bus.until(master, lambda: move.done, "the goal")
    bus.until(
        master,
        lambda: all(
            abs(a.actual_position - p) < 1e-3
            for a, p in zip(host.feedback().axes, (12.0, -7.0), strict=True)
        ),
        "the motors",
    )
    for node in NODES.values():
        sdo = SdoClient(bus.bus, node)
        assert [int.from_bytes(sdo.read(0x2101, sub), "little") for sub in (7, 8, 10)] == [0] * 3
    host.disable()
    bus.until(master, lambda: not any(a.enabled for a in host.feedback().axes), "disabled drives")


def test_a_drive_that_falls_silent_is_a_lost_axis(bus: Bus) -> None:
    """Its thread ends in mid-motion: lost after a few cycles, the other halts."""
    master = Master(bus.kernel, bus.bus, NODES)
    host = bus.host
    host.enable()
    bus.until(master, lambda: all(a.follows for a in host.feedback().axes), "enabled drives")
    move = host.move([200.0, -150.0])
    bus.until(master, lambda: host.feedback().axes[0].velocity > 20.0, "some speed")
    bus.ends[NODES[1]].set()
    rest = [AxisState.STANDSTILL, AxisState.ERROR_STOP]
    bus.until(master, lambda: [a.state for a in host.feedback().axes] == rest, "the halt")
    assert move.state is MoveState.STOPPED
    assert [e.axis for e in host.events()[0] if e.kind is EventKind.SYNC] == [1]


def test_offsets_and_switches_travel_by_pdo(bus: Bus) -> None:
    """60B1h, 60B2h to the drives, and their own feed-forward is off; 60FDh and 60F4h from them.

    The following error of a move is a part of that without feed-forward; a switch is an event.
    """
    drive = DriveConfig(following_window=2**32 - 1)
    axes = [
        Axis(LIMITS, COUNTS, "external", feed_forward=FeedForward.of(drive)),
        Axis(LIMITS, COUNTS, "external", feed_forward="velocity"),
    ]
    kernel = MotionKernel(axes, T)
    master = Master(kernel, bus.bus, NODES)
    nodes = [SdoClient(bus.bus, node) for node in NODES.values()]
    own = [[struct.unpack("<f", sdo.read(0x2102, sub))[0] for sub in (1, 2)] for sdo in nodes]
    assert own == [[0.0, 0.0], [0.0, 1.0]]
    host = kernel.host()
    host.enable()
    bus.until(master, lambda: all(a.follows for a in host.feedback().axes), "enabled drives")
    move = host.move([60.0, 60.0])
    sent: list[tuple[int, int, int, int]] = []

    def watch() -> bool:
        a, b = host.feedback().axes
        sent.append((a.velocity_offset, a.torque_offset, a.following_error, b.torque_offset))
        return move.done

    bus.until(master, watch, "the goal")
    speed, torque, error, none = np.abs(sent).max(axis=0)
    assert speed == pytest.approx(90.0 * COUNTS, rel=0.02)
    w = np.radians(90.0)
    friction = drive.friction_nm * w / (w + drive.friction_speed_rad_s)
    assert torque == pytest.approx(1e3 * friction / drive.rated_torque_nm, abs=2)
    assert none == 0
    assert 0 < error < 0.05 * speed / drive.position_gain_per_s
    for device in bus.devices.values():
        device.drive.configure(switch_positive_rev=0.2)
    host.events()
    move = host.move([90.0, 20.0])
    closed = [LimitSwitch.POSITIVE, LimitSwitch(0)]
    bus.until(
        master,
        lambda: (
            [a.limit_switches for a in host.feedback().axes] == closed
            and move.state.name != "MOVING"
        ),
        "a switch",
    )
    told = [(e.axis, e.code) for e in host.events()[0] if e.kind is EventKind.SWITCH]
    assert (0, LimitSwitch.POSITIVE) in told
    assert master.end()


def test_what_cannot_be_led_is_refused(bus: Bus) -> None:
    """Axes that are not external, node numbers that are none, nodes that are not there."""
    inside = MotionKernel([Axis(LIMITS, COUNTS)], T)
    with pytest.raises(InputError, match="external"):
        Master(inside, bus.bus, {0: 3})
    for nodes in ({0: 0}, {0: MASTER}, {2: 3}, {0: 3, 1: 3}):
        with pytest.raises(InputError, match="nodes"):
            Master(bus.kernel, bus.bus, nodes)
    with pytest.raises(SjerkError, match="abort 06020000h"):
        SdoClient(bus.bus, 3).read(0x5FFF)
    odd = MotionKernel([Axis(LIMITS, COUNTS, "external")], 333e-6)
    with pytest.raises(InputError, match="cycle_time"):
        Master(odd, bus.bus, {0: 3})


# ---- the death of the kernel ---------------------------------------------------------------------

NAMESPACE = ["unshare", "-Urn", "sh", "-c"]
LOOPBACK = "ip link set lo up && ip route add 239.0.0.0/8 dev lo"
FAULT, DISABLED = (0x4F, 0x08), (0x4F, 0x40)


def judged(*words: str) -> Any:
    """What processes on a bus of their own have seen."""
    try:
        denied = subprocess.run([*NAMESPACE, LOOPBACK], capture_output=True, text=True)
    except FileNotFoundError as error:
        pytest.skip(f"no unshare: {error}")
    if denied.returncode:
        pytest.skip(f"no network namespace with a multicast route: {denied.stderr.strip()}")
    judge = shlex.join(program("helpers.canopen_kernel", *words))
    command = f"{LOOPBACK} && exec {judge}"
    done = subprocess.run([*NAMESPACE, command], capture_output=True, text=True, timeout=180)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize(
    ("option", "state"), [(1, FAULT), (2, DISABLED), (3, DISABLED)], ids=["fault", "off", "stop"]
)
def test_a_killed_kernel_is_noticed_by_its_drive_and_the_next_one_starts_without_a_step(
    option: int, state: tuple[int, int]
) -> None:
    """SIGKILL in mid-motion: no heartbeat (1016h), so the drive acts by 6007h on its own.

    The next kernel finds it disabled and is disabled itself; enabling starts from 6064h, and no
    target it sends is a jump, stale, or a step to the drive.
    """
    seen = judged("judge", str(option))
    first, second = seen["first"], seen["second"]
    assert (first[0]["state"], first[0]["enabled"]) == ("DISABLED", False)
    assert first[-1] == {"moving": True}
    word, error, at = seen["drive"]
    mask, value = state
    assert word & mask == value
    assert error == (0x8130 if option == 1 else 0)
    assert at > 0
    assert not second[0]["enabled"]
    assert second[0]["state"] == ("ERROR_STOP" if option == 1 else "DISABLED")
    begun = second[1]
    assert begun["follows"]
    assert abs(begun["commanded"] - begun["actual"]) <= 0.01 * COUNTS
    assert second[-1]["done"]
    assert abs(second[-1]["at"] - 10.0 * COUNTS) <= 0.01 * COUNTS
    assert second[-1]["findings"] == [0] * 7


# ---- its end -------------------------------------------------------------------------------------


def test_the_end_of_a_kernel_waits_for_its_drives_and_no_longer() -> None:
    """Out of full motion: at rest, then disabled, then the master leaves; not for a dead drive.

    The drive is a process of its own, told by SDO after the master has gone; then it is suspended.
    """
    seen = judged("end")
    heard, silent = seen["heard"], seen["silent"]
    assert heard["whole"]
    assert not heard["stale"]
    assert heard["velocity"] == 0.0
    word, speed, error = seen["drive"]
    assert word & 0x6F != 0x27
    assert heard["word"] & 0x6F == word & 0x6F
    assert abs(speed) <= 1e-3 * 90.0 * COUNTS
    assert error == 0
    assert seen["findings"] == [0] * 3
    assert silent["stale"]
    assert not silent["whole"]
    assert silent["seconds"] < 2.0
