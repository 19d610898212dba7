"""A kernel as CANopen master: on a bus in one process, and killed with its drive in another."""

from __future__ import annotations

import json
import shlex
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import can
import pytest

from helpers.root import program
from sjerk import Axis, Drive, InputError, Limits, MotionKernel, SjerkError
from sjerk.cycle.states import AxisState
from sjerk.drive.device import Device
from sjerk.host import EventKind, MoveState
from sjerk.ports.canopen import MASTER, Master, Node, SdoClient, sender

T = 5e-3
COUNTS = 2**24 / 360.0
LIMITS = Limits(90.0, 500.0, 5000.0)
NODES = {0: 3, 1: 4}


class Bus:
    """Two drives in a thread each on a virtual bus, and a kernel that leads them."""

    def __init__(self, channel: str) -> None:
        self.channel = channel
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
        with can.Bus(interface="virtual", channel=self.channel) as bus:
            node = Node(Device(Drive(), node_id=node_id), sender(bus), now=time.monotonic())
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
    try:
        denied = subprocess.run([*NAMESPACE, LOOPBACK], capture_output=True, text=True)
    except FileNotFoundError as error:
        pytest.skip(f"no unshare: {error}")
    if denied.returncode:
        pytest.skip(f"no network namespace with a multicast route: {denied.stderr.strip()}")
    judge = shlex.join(program("helpers.canopen_kernel", "judge", str(option)))
    command = f"{LOOPBACK} && exec {judge}"
    done = subprocess.run([*NAMESPACE, command], capture_output=True, text=True, timeout=180)
    assert done.returncode == 0, done.stderr
    seen = json.loads(done.stdout.splitlines()[-1])

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
