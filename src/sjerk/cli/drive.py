"""``sjerk drive``: simulated drives on CANopen or EtherCAT. Never here: what a frame means."""

from __future__ import annotations

import argparse
import signal
import sys
import time
from pathlib import Path
from typing import Any

from sjerk.cia402 import MOTORS, Drive, DriveConfig, DriveState
from sjerk.drive import Device
from sjerk.extras import load
from sjerk.ports.canopen import Node
from sjerk.ports.ethercat import command as ethercat


def add_arguments(jobs: Any) -> None:
    """Add drive."""
    job = jobs.add_parser("drive", help="be simulated CiA 402 drives on CANopen or EtherCAT")
    job.add_argument("--interface", default="udp_multicast", help="of python-can")
    job.add_argument("--channel", default="239.74.163.2", help="of python-can")
    job.add_argument(
        "--option",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="one more option of the interface, such as bitrate=1000000; may be repeated",
    )
    job.add_argument("--node", type=int, default=5, help="node number, 1 to 127")
    job.add_argument("--motor", default="SGM7J-04A", choices=sorted(MOTORS))
    job.add_argument("--load-inertia", type=float, default=1.0, help="load / rotor inertia")
    job.add_argument("--eds", type=Path, help="write the electronic data sheet here first")
    ethercat.add_arguments(job)
    job.set_defaults(run=lambda o: ethercat.run(o) if ethercat.wanted(o) else run(o))


def run(options: argparse.Namespace) -> int:
    """Be a CANopen drive until SIGINT or SIGTERM; returns the exit code."""
    buses = load("sjerk.ports.canopen.bus", extra="canopen")
    if not 1 <= options.node <= 127:
        print(f"--node {options.node} is outside 1 .. 127", file=sys.stderr)
        return 2
    try:
        config = DriveConfig.for_motor(options.motor, load_inertia_ratio=options.load_inertia)
    except ValueError as error:
        print(error, file=sys.stderr)
        return 2
    device = Device(Drive(config), node_id=options.node)
    if options.eds:
        options.eds.write_text(device.data_sheet(options.eds.name))

    stopping = False

    def stop(*_: object) -> None:
        nonlocal stopping
        stopping = True

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
    try:
        bus = buses.open_bus(options.interface, options.channel, **_bus_options(options.option))
    except buses.OpenErrors as error:
        print(f"no bus {options.interface} {options.channel}: {error}", file=sys.stderr)
        return 1

    def tell(state: DriveState) -> None:
        print(f"node {options.node}: {state.name.replace('_', ' ').lower()}", flush=True)

    with bus:
        node = Node(device, buses.sender(bus), now=time.monotonic())
        print(
            f"node {options.node} ({options.motor}) is ready on "
            f"{options.interface} {options.channel}",
            flush=True,
        )
        node.announce(tell)
        try:
            node.run(bus, lambda: stopping)
        except buses.BusErrors as error:
            print(f"the bus failed: {error}", file=sys.stderr)
            return 1
    print(device.drive.report(), flush=True)
    return 0


def _bus_options(texts: list[str]) -> dict[str, int | str]:
    """NAME=VALUE as options of the interface; whole numbers become numbers."""
    pairs = (text.partition("=") for text in texts)
    return {name: int(value) if value.isdecimal() else value for name, _, value in pairs}
