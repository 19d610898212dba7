"""ethercrab, unmodified, in the wheel of an application: ethercrab_judge.py DRIVES.

The application looks for devices of its own kind, by name and lengths. It takes them to Operational
with SYNC0, finds that nobody answers to its commands, and goes back to Init. How far the devices
came is the judgement: ethercrab waits until the clocks are within its tolerance before it goes on.
"""

from __future__ import annotations

import asyncio
import subprocess
import sys
from pathlib import Path

import autd3
from autd3.geometry import Autd3, Geometry
from autd3_link_ethercrab import EtherCrabLinkOption
from wire import MAIN, end_with_parent, judge

DRIVES = int(sys.argv[1])
PATIENCE_S = 20
ATTEMPTS = 4

told: list[str] = []


def once() -> str:
    """A line and a session with it: the application's complaint at the end."""
    line = subprocess.Popen(
        [sys.executable, str(Path(__file__).with_name("lengths_line.py")), str(DRIVES), "626", "2",
         "AUTD", "60"],
        stdout=subprocess.PIPE, text=True, preexec_fn=end_with_parent,
    )  # fmt: skip
    assert line.stdout is not None
    assert line.stdout.readline() == "ready\n"
    places = [Autd3([0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]) for _ in range(DRIVES)]

    async def work() -> None:
        await autd3.Client.open(
            Geometry(places), EtherCrabLinkOption(iface=MAIN), autd3.ClientConfig()
        )

    try:
        asyncio.run(asyncio.wait_for(work(), PATIENCE_S))
    except autd3.Autd3Error as error:
        return str(error)
    finally:
        line.terminate()
        told[:] = line.communicate(timeout=10)[0].splitlines()
    raise AssertionError("the application found its own devices")


def session() -> None:
    """Up to Operational and back; the end is the application's complaint.

    Its time-outs of 10 ms cannot be set: on a busy machine a session that ends by one begins anew.
    """
    for _ in range(ATTEMPTS):
        complaint = once()
        if "ethercrab: timeout" not in complaint:
            break
    assert "ack timeout" in complaint, (complaint, told)


def states() -> None:
    """Every device: all states up, then all down, no refusal between."""
    for k in range(DRIVES):
        way = [
            row.split()[1] for row in told if row.startswith(f"{k} ") and row.split()[1].isupper()
        ]
        assert way == ["PREOP", "SAFEOP", "OP", "SAFEOP", "PREOP", "INIT"], (k, told)


def clocks() -> None:
    """Clocks that run 120 ppm apart were held to one: 092Ch at the end."""
    deviations = [abs(float(row.split()[-1])) for row in told if "deviation" in row]
    assert len(deviations) == DRIVES
    assert max(deviations) < 1000, deviations


judge({"session": session, "states": states, "clocks": clocks})
