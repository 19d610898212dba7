"""The panel for long, and its figures: ``./run stress panel --minutes 30``.

Pages come, look, jog and leave by what kills them, again and again; the memory of the panel must
stay flat. First the figures: frames at a socket and how old they are, processor time, late cycles
with and without a panel in pairs of runs, and how long each death takes until the axes rest.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from helpers.panel_bench import ROBOT
from helpers.panel_client import Client, PanelProcess, panel, until
from sjerk import Monitor, MotionKernel
from sjerk.ports.panel.holding import LIMIT
from sjerk.ports.panel.lead import WATCH

_TICKS = os.sysconf("SC_CLK_TCK")


def processor(pid: int) -> float:
    """Seconds of processor time of a process."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS


def memory(pid: int) -> float:
    """Resident memory of a process, MB."""
    found = re.search(r"VmRSS:\s+(\d+)", Path(f"/proc/{pid}/status").read_text())
    assert found is not None
    return int(found.group(1)) / 1024.0


def frames(process: PanelProcess, seconds: float) -> None:
    """Frames a second at a socket, their age, and the panel's processor time."""
    client = Client(process.lead)
    ages: list[float] = []
    stamps: list[float] = []

    def turned(message: dict[str, object]) -> None:
        if message["type"] == "SetOrientationMessage":
            stamps.append(time.monotonic())

    with Monitor.attach(process.name) as monitor:
        client.order("Take the lead", "this browser leads")
        client.order("Drives", "drives follow", "Enable")
        client.set("Moves", "While held")
        held = time.monotonic() + seconds
        begun, client.frames, client.bytes = time.monotonic(), 0, 0
        before = processor(process.process.pid)
        client.on_message = turned
        sign = 1
        while time.monotonic() < held:
            until_turn = time.monotonic() + 1.0
            label = f"panda_joint1 {'+' if sign > 0 else '−'}"
            while time.monotonic() < until_turn:
                client.hold(label)
                newest = monitor.feedback()
                since = len(stamps)
                sent = time.monotonic()
                while len(stamps) == since and time.monotonic() - sent < 0.2:
                    time.sleep(0.0005)
                if len(stamps) > since:
                    ages.append(stamps[-1] - newest.time_ns * 1e-9)
                time.sleep(0.03)
            client.click(label)
            sign = -sign
        took = time.monotonic() - begun
    ages.sort()
    print(
        f"frames at a socket: {client.frames / took:.1f}/s, {client.bytes / took / 1e6:.2f} MB/s; "
        f"age of a turned joint: median {1e3 * statistics.median(ages):.1f} ms, "
        f"p99 {1e3 * ages[int(0.99 * len(ages))]:.1f} ms; "
        f"panel {(processor(process.process.pid) - before) / took:.3f} core"
    )
    client.close()


def late(seconds: float, folder: Path, *, looked_at: bool) -> int:
    """Late cycles of a kernel alone, or with a panel and one page."""
    name = f"late-{time.time_ns()}"
    with MotionKernel(ROBOT.axes, 1e-3, name=name):
        if not looked_at:
            return counted(name, seconds)
        with panel(name=name, folder=folder) as process:
            client = Client(process.view)
            client.told("cycle")
            found = counted(name, seconds)
            client.close()
            return found


def counted(name: str, seconds: float) -> int:
    """Late cycles of the next seconds."""
    with Monitor.attach(name) as monitor:
        first = monitor.feedback()
        time.sleep(seconds)
        return monitor.feedback().timing_since(first).late


def pairs(count: int, seconds: float, folder: Path) -> None:
    """Late cycles in pairs of runs, one after the other."""
    rows = [
        (late(seconds, folder, looked_at=False), late(seconds, folder, looked_at=True))
        for _ in range(count)
    ]
    without = [a for a, _ in rows]
    difference = statistics.median(b - a for a, b in rows)
    spread = max(without) - min(without)
    print(
        f"late cycles of {seconds / 1e-3:.0f} without and with a panel and a page: {rows}; "
        f"median difference {difference:g}, spread without {spread}"
    )


def deaths(folder: Path) -> None:
    """From the last sign of a held button to rest, for each way to die."""
    cases: dict[str, Callable[[PanelProcess, Client], None]] = {
        "released": lambda process, client: client.click("panda_joint1 +"),
        "silent": lambda process, client: None,
        "page closed": lambda process, client: client.close(),
        "panel stopped": lambda process, client: os.kill(process.process.pid, signal.SIGSTOP),
        "panel killed": lambda process, client: os.kill(process.process.pid, signal.SIGKILL),
    }
    for case, die in cases.items():
        name = f"death-{time.time_ns()}"
        with MotionKernel(ROBOT.axes, 1e-3, name=name), Monitor.attach(name) as monitor:
            process = PanelProcess(name=name, folder=folder)
            client = Client(process.lead)
            client.order("Take the lead", "this browser leads")
            client.order("Drives", "drives follow", "Enable")

            def moves(client: Client = client, monitor: Monitor = monitor) -> bool:
                client.hold("panda_joint1 +")
                time.sleep(0.03)
                return monitor.feedback().moving

            until(moves, "moves")
            for _ in range(10):
                client.hold("panda_joint1 +")
                time.sleep(0.03)
            last = time.monotonic()
            die(process, client)
            braking = None
            speed = abs(monitor.feedback().axes[0].velocity)
            while (frame := monitor.feedback()).moving:
                if braking is None and abs(frame.axes[0].velocity) < 0.98 * speed:
                    braking = time.monotonic() - last
                time.sleep(0.002)
            rest = time.monotonic() - last
            begun = f"{1e3 * braking:.0f} ms" if braking is not None else "at once"
            most = (WATCH if case.startswith("panel") else LIMIT) + (rest - (braking or 0.0)) + 0.5
            verdict = "in time" if rest <= most else "LATE"
            print(f"jog, {case}: brakes after {begun}, rests after {1e3 * rest:.0f} ms, {verdict}")
            with suppress(ProcessLookupError):
                os.kill(process.process.pid, signal.SIGKILL)
            process.process.wait()
            client.close()


def soak(process: PanelProcess, minutes: float) -> bool:
    """Pages come and go; whether the memory stays flat after the first fifth."""
    end = time.monotonic() + 60.0 * minutes
    rows: list[tuple[float, float]] = []
    pages = 0
    begun = time.monotonic()
    while time.monotonic() < end:
        client = Client(process.lead)
        client.order("Take the lead", "leads")
        client.order("Drives", "drives follow", "Enable")
        for _ in range(20):
            client.hold("panda_joint2 +" if pages % 2 else "panda_joint2 −")
            time.sleep(0.03)
        client.close()
        pages += 1
        rows.append((time.monotonic() - begun, memory(process.process.pid)))
    after = [mb for at, mb in rows if at > 0.2 * 60.0 * minutes]
    half = len(after) // 2
    first, second = statistics.median(after[:half]), statistics.median(after[half:])
    print(
        f"soak: {pages} pages in {minutes:g} minutes; memory {rows[0][1]:.0f} MB at first, "
        f"median {first:.1f} MB, later {second:.1f} MB"
    )
    return second < 1.05 * first


def main() -> int:
    """The figures, then the soak; exit code 1 where its memory grew."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--minutes", type=float, default=30.0)
    arguments.add_argument("--seconds", type=float, default=10.0, help="of each figure")
    arguments.add_argument("--pairs", type=int, default=5)
    options = arguments.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        deaths(folder)
        pairs(options.pairs, options.seconds, folder)
        with panel(name=f"soak-{time.time_ns()}", folder=folder) as process:
            frames(process, options.seconds)
            flat = soak(process, options.minutes)
    return 0 if flat else 1


if __name__ == "__main__":
    raise SystemExit(main())
