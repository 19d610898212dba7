"""The CANopen port: an unmodified master is the judge, in one process and across processes."""

from __future__ import annotations

import contextlib
import json
import shlex
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import can
import pytest

from helpers.canopen_judge import DEMANDS, NODE, REV, Bench
from helpers.root import program
from sjerk.cia402 import Drive, DriveConfig
from sjerk.drive.device import Device
from sjerk.ports.canopen import Node, sender


@contextlib.contextmanager
def served(device: Device, tmp_path: Path) -> Iterator[tuple[str, Path]]:
    """A drive in a thread on a bus of its own: (channel, data sheet)."""
    channel = f"sjerk-{tmp_path.name}"
    sheet = tmp_path / "drive.eds"
    sheet.write_text(device.data_sheet())
    stop = threading.Event()
    with can.Bus(interface="virtual", channel=channel) as bus:
        node = Node(device, sender(bus), now=time.monotonic())
        thread = threading.Thread(target=node.run, args=(bus, stop.is_set))
        thread.start()
        yield channel, sheet
        stop.set()
        thread.join()


@pytest.fixture
def drive_on_virtual(tmp_path: Path) -> Iterator[tuple[str, Path]]:
    """The default drive, served."""
    with served(Device(Drive(), node_id=NODE), tmp_path) as place:
        yield place


@pytest.mark.parametrize("path", ["PDO", "SDO"])
@pytest.mark.parametrize("demand", DEMANDS)
def test_base_node_402_is_satisfied_in_one_process(
    demand: str, path: str, drive_on_virtual: tuple[str, Path]
) -> None:
    """canopen.BaseNode402 on a virtual bus."""
    channel, sheet = drive_on_virtual
    bench = Bench("virtual", channel, sheet, by_pdo=path == "PDO")
    try:
        DEMANDS[demand](bench)
    finally:
        bench.close()


@pytest.mark.parametrize(
    ("method", "home"), [(1, 0.0), (11, 1.0), (24, 0.35), (26, 0.65), (-4, -1.5)]
)
def test_base_node_402_homes_by_switches_and_stops(
    method: int, home: float, tmp_path: Path
) -> None:
    """`homing()` of the unmodified master: the method by SDO, the place as the page has it."""
    config = DriveConfig(
        switch_negative_rev=-0.7 if method > 0 else -1e9,
        switch_positive_rev=1.4,
        switch_home_rev=0.35,
        switch_home_end_rev=0.65,
        hard_stop_negative_rev=-1.5,
    )
    with served(Device(Drive(config), node_id=NODE), tmp_path) as (channel, sheet):
        bench = Bench("virtual", channel, sheet, by_pdo=True)
        try:
            bench.start()
            sdo = bench.node.sdo
            sdo[0x6098].raw = method
            sdo[0x6099][1].raw = 4 * REV
            sdo[0x6099][2].raw = 2 * REV
            sdo[0x609A].raw = 60 * REV
            sdo[0x607C].raw = -321
            assert bench.node.homing(timeout=20)
            bench.wait(
                lambda: abs(sdo[0x6063].raw - sdo[0x6064].raw - 321 - round(home * REV)) <= 2
            )
        finally:
            bench.close()


def test_base_node_402_leads_profile_torque_and_interpolated_position(
    drive_on_virtual: tuple[str, Path],
) -> None:
    """Modes 4 and 7 by the unmodified master: a torque along its slope, a target in each SYNC."""
    channel, sheet = drive_on_virtual
    bench = Bench("virtual", channel, sheet, by_pdo=True)
    try:
        bench.start()
        sdo = bench.node.sdo
        sdo[0x6087].raw = 2000
        bench.enable("PROFILED TORQUE")
        sdo[0x6071].raw = 60
        bench.wait(lambda: abs(sdo[0x6077].raw - 60) <= 10)
        bench.wait(lambda: bench.words[-1] & 0x1400 == 0x0400)
        sdo[0x6071].raw = 0
        bench.wait(lambda: abs(sdo[0x606C].raw) < REV // 100)
        start = sdo[0x6064].raw
        sdo[0x60C1][1].raw = start
        bench.node.state = "SWITCHED ON"
        bench.enable("INTERPOLATED POSITION")
        bench.node.controlword = 0x001F
        bench.wait(lambda: bench.words[-1] & 0x1000 != 0)
        start = sdo[0x6062].raw
        for k in range(200):
            sdo[0x60C1][1].raw = start + 1000 * k
        bench.wait(lambda: sdo[0x6062].raw == start + 199_000)
        assert sdo[0x603F].raw == 0
    finally:
        bench.close()


def test_base_node_402_reads_what_a_touch_probe_latched(tmp_path: Path) -> None:
    """60B9h and 60BAh in a TPDO, the function in an RPDO: the place of the edge, to the unit."""
    config = DriveConfig(probe_1_rev=0.25, probe_1_end_rev=0.3)
    with served(Device(Drive(config), node_id=NODE), tmp_path) as (channel, sheet):
        bench = Bench("virtual", channel, sheet, by_pdo=True)
        try:
            bench.start()
            node = bench.node
            node.nmt.state = "PRE-OPERATIONAL"
            node.rpdo.read()
            node.tpdo.read()
            node.tpdo[2].clear()
            node.tpdo[2].add_variable(0x60B9)
            node.tpdo[2].add_variable(0x60BA)
            node.rpdo[2].clear()
            node.rpdo[2].add_variable(0x60B8)
            for pdo in (node.tpdo[2], node.rpdo[2]):
                pdo.enabled, pdo.trans_type = True, 1
                pdo.save()
            node.nmt.state = "OPERATIONAL"
            bench.enable("PROFILED POSITION")
            node.rpdo[2]["Touch probe function"].raw = 0x0011
            node.rpdo[2].transmit()
            bench.wait(lambda: node.tpdo[2]["Touch probe status"].raw == 1)
            node.rpdo[1]["Target position"].raw = REV // 2
            node.controlword = 0x003F
            bench.wait(lambda: node.tpdo[2]["Touch probe status"].raw == 3)
            bench.wait(lambda: node.tpdo[2]["Touch probe 1 positive edge"].raw == REV // 4)
        finally:
            bench.close()


NAMESPACE = ["unshare", "-Urn", "sh", "-c"]
LOOPBACK = "ip link set lo up && ip route add 239.0.0.0/8 dev lo"


@pytest.fixture(scope="session")
def across_processes() -> dict[str, dict[str, str]]:
    """Outcomes of the judge and the drive as two processes, in a network of their own."""
    try:
        denied = subprocess.run([*NAMESPACE, LOOPBACK], capture_output=True, text=True)
    except FileNotFoundError as error:
        pytest.skip(f"no unshare: {error}")
    if denied.returncode:
        pytest.skip(f"no network namespace with a multicast route: {denied.stderr.strip()}")
    outcomes = {}
    for path in ("PDO", "SDO"):
        command = f"{LOOPBACK} && exec {shlex.join(program('helpers.canopen_judge', path))}"
        done = subprocess.run([*NAMESPACE, command], capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, done.stderr
        outcomes[path] = json.loads(done.stdout.splitlines()[-1])
    return outcomes


@pytest.mark.parametrize("path", ["PDO", "SDO"])
@pytest.mark.parametrize("demand", DEMANDS)
def test_base_node_402_is_satisfied_across_processes(
    demand: str, path: str, across_processes: dict[str, dict[str, str]]
) -> None:
    """canopen.BaseNode402 on udp_multicast, the drive started by its command line."""
    assert across_processes[path][demand] == ""
