"""A kernel leads a CANopen drive: targets by PDO, SYNC, a heartbeat that the drive watches.

    python examples/06_canopen_master.py [picture.png]

Drive and master talk over a virtual bus here; `--interface socketcan --channel can0` and
`sjerk drive` make the same of two machines. python-can is the extra `sjerk[canopen]`.
"""

import sys
import threading
import time
from pathlib import Path

import can
import numpy as np

from sjerk import Axis, Drive, Limits, MotionKernel
from sjerk.cli.pictures import Curve, panels
from sjerk.drive.device import Device
from sjerk.ports.canopen import Master, Node, sender

T, NODE = 5e-3, 3
counts_per_degree = 2**24 / 360.0
end = threading.Event()


def be_a_drive() -> None:
    with can.Bus(interface="virtual", channel="sjerk") as bus:
        node = Node(Device(Drive(), node_id=NODE), sender(bus), now=time.monotonic())
        node.run(bus, end.is_set)


drive = threading.Thread(target=be_a_drive)
with can.Bus(interface="virtual", channel="sjerk") as bus:
    drive.start()
    bus.recv(5.0)  # the drive has booted
    axis = Axis(Limits(90.0, 500.0, 5000.0), counts_per_degree, "external", unit="deg")
    kernel = MotionKernel([axis], T)
    host = kernel.host()
    master = Master(kernel, bus, {0: NODE})
    host.enable()
    master.run(lambda: host.feedback().axes[0].follows)
    move = host.move(60.0)
    rows = []

    def watch() -> bool:
        a = host.feedback().axes[0]
        rows.append((a.position, a.actual_position, a.velocity))
        return move.done and abs(a.actual_position - a.position) < 1e-3

    master.run(watch)
    at = host.feedback().axes[0]
    print(f"commanded {at.position} deg, the drive says {at.actual_position:.3f} deg")
    assert master.end()  # at rest, and disabled
    end.set()
drive.join()

position, actual, velocity = np.array(rows).T
time_s = np.arange(len(rows)) * T
out = Path(sys.argv[1] if len(sys.argv) > 1 else "06_canopen_master.png")
panels(
    out,
    "60 degrees by PDO and SYNC",
    {
        "position": [
            Curve("commanded", time_s, position),
            Curve("6064h of the drive", time_s, actual, "k:"),
        ],
        "velocity": [Curve("commanded", time_s, velocity)],
    },
    {"velocity": 90.0},
)
