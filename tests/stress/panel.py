"""The panel for long, and its figures: ``./run stress panel --minutes 30``.

Random plans come first, each judged sample by sample by a judge that shares no code with the panel.
Then the figures: how long each death takes until the axes rest, late cycles with and without a
panel in pairs of runs, frames at a socket and how old they are, processor time. Last, pages come,
look, jog and leave by what kills them, again and again; the memory of the panel must stay flat.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import re
import signal
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from helpers.panel_bench import ROBOT
from helpers.panel_client import Client, PanelProcess, panel, until
from helpers.panel_queries import CLEAR, LIMITS, queries, touches
from sjerk import Monitor, MotionKernel
from sjerk.ports.panel.holding import LIMIT
from sjerk.ports.panel.lead import WATCH
from sjerk.ports.panel.planning import NoWayError, plan
from sjerk.ports.panel.server import FRAMES

_PARTS = ("setup", "plans", "deaths", "pairs", "frames", "soak")
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


def setup() -> bool:
    """From a clean clone to the page, by the command that a person types; its size."""
    root = Path(__file__).resolve().parents[2]
    with tempfile.TemporaryDirectory() as name:
        clone = Path(name) / "sjerk"
        subprocess.run(["git", "clone", "--quiet", str(root), str(clone)], check=True)
        begun = time.monotonic()
        order = ["./run", "panel", "--json", "--port", "0", "--name", f"setup-{time.time_ns()}"]
        process = subprocess.Popen(order, cwd=clone, stdout=subprocess.PIPE, text=True)
        try:
            assert process.stdout is not None
            links = json.loads(process.stdout.readline())
            with urllib.request.urlopen(links["view"]) as page:
                size = len(page.read())
            took = time.monotonic() - begun
        finally:
            process.send_signal(signal.SIGINT)
            process.wait()
    print(f"set-up: {took:.1f} s from a clean clone to the page of {size / 1e6:.3f} MB")
    return took <= 120.0 and size <= 1_000_000


def frames(process: PanelProcess, seconds: float) -> bool:
    """Frames a second at a socket, their age, and the panel's processor time; are they enough?"""
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
                if len(stamps) > since and sign * newest.axes[0].velocity > 0.0:  # else it rests
                    ages.append(stamps[-1] - newest.time_ns * 1e-9)
                time.sleep(0.03)
            client.click(label)
            sign = -sign
        took = time.monotonic() - begun
    ages.sort()
    rate, last = client.frames / took, ages[int(0.99 * len(ages))]
    cores = (processor(process.process.pid) - before) / took
    print(
        f"frames at a socket: {rate:.1f}/s, {client.bytes / took / 1e6:.2f} MB/s; "
        f"age of a turned joint: median {1e3 * statistics.median(ages):.1f} ms, "
        f"p99 {1e3 * last:.1f} ms, {last * FRAMES:.2f} of a frame's period; "
        f"panel {cores:.3f} core"
    )
    client.close()
    return rate >= 30.0 and last <= 1.0 / FRAMES and cores <= 0.15


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


def pairs(count: int, seconds: float, folder: Path) -> bool:
    """Late cycles in pairs of runs, one after the other: is the difference within the spread?"""
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
    return difference <= spread


def deaths(folder: Path) -> bool:
    """From the last sign of a held button to rest, for each way to die; whether all in time."""
    well = True
    cases: dict[str, Callable[[PanelProcess, Client], None]] = {
        "released": lambda process, client: client.click("panda_joint1 +"),
        "silent": lambda process, client: None,
        "page closed": lambda process, client: client.close(),
        "panel stopped": lambda process, client: os.kill(process.process.pid, signal.SIGSTOP),
        "panel killed": lambda process, client: os.kill(process.process.pid, signal.SIGKILL),
        "STOP": lambda process, client: client.click("STOP"),
    }
    for what, (case, die) in itertools.product(("jog", "path"), cases.items()):
        if what == "path" and case in ("released", "silent"):
            continue  # nothing is held
        name = f"death-{time.time_ns()}"
        with MotionKernel(ROBOT.axes, 1e-3, name=name), Monitor.attach(name) as monitor:
            process = PanelProcess(name=name, folder=folder)
            client = Client(process.lead)
            client.order("Take the lead", "this browser leads")
            client.order("Drives", "drives follow", "Enable")

            def moves(
                client: Client = client, monitor: Monitor = monitor, what: str = what
            ) -> bool:
                if what == "jog":
                    client.hold("panda_joint1 +")
                time.sleep(0.03)
                return monitor.feedback().moving

            if what == "path":
                client.set("Pose", "left")
                client.set("To goal", "Set goal")
                client.order("Plan & Execute", "in motion")
            until(moves, "moves")
            for _ in range(10):
                moves()
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
            limit = WATCH if case.startswith("panel") else LIMIT
            most = limit + (rest - (braking or 0.0)) + 0.5
            verdict = "in time" if rest <= most else "LATE"
            well &= rest <= most
            print(
                f"{what}, {case}: brakes after {begun}, rests after {1e3 * rest:.0f} ms, {verdict}"
            )
            with suppress(ProcessLookupError):
                os.kill(process.process.pid, signal.SIGKILL)
            process.process.wait()
            client.close()
    return well


def soak(process: PanelProcess, minutes: float) -> bool:
    """Pages come and go; whether the memory stays flat after the first fifth."""
    end = time.monotonic() + 60.0 * minutes
    rows: list[tuple[float, float]] = []
    pages = 0
    begun = time.monotonic()
    while time.monotonic() < end:
        client = Client(process.lead)
        client.told("leads: <b>nobody</b>")  # the page before has left
        client.order("Take the lead", "this browser leads")
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


def plans(count: int, seed: int) -> bool:
    """Random queries: how many are planned, what touches, how long it takes; is all well?"""
    spent: dict[str, list[float]] = {"find": [], "time": [], "check": []}
    shares, touching, unplanned, samples = [], 0, 0, 0
    for start, goal, random in queries(count, seed):
        try:
            made = plan(CLEAR, start, goal, LIMITS, 1e-3)
        except NoWayError as fault:
            unplanned += 1
            print(f"not planned, {start.tolist()} to {goal.tolist()}: {fault}")
            continue
        exact = (made.position[0] == start).all() and (made.position[-1] == goal).all()
        judged = any(touches(q, random) for q in made.position[::20])
        if made.collides or judged or not exact:
            touching += 1
            print(f"touches or is not exact: {start.tolist()} to {goal.tolist()}")
        samples += len(made.position)
        shares.append(made.shares)
        for key, seconds in made.spent.items():
            spent[key].append(seconds)
    if shares:
        v, a, j = np.max(shares, axis=0).tolist()
        times = ", ".join(
            f"{key} median {1e3 * statistics.median(rows):.0f} ms, worst {1e3 * max(rows):.0f} ms"
            for key, rows in spent.items()
        )
        print(
            f"plans: {len(shares)} of {count} found, {touching} touch, {samples} samples; "
            f"most of the limits: v {v:.6f}, a {a:.6f}, j {j:.6f}; {times}"
        )
        return unplanned == touching == 0 and max(v, a, j) <= 1.0 + 1e-9
    return count == 0


def main() -> int:
    """The plans, the figures, the soak; exit code 1 where one fell short."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--minutes", type=float, default=30.0)
    arguments.add_argument("--seconds", type=float, default=10.0, help="of each figure")
    arguments.add_argument("--pairs", type=int, default=5)
    arguments.add_argument("--queries", type=int, default=60, help="random plans")
    arguments.add_argument("--seed", type=int, default=0, help="of the random plans")
    arguments.add_argument("--only", action="append", choices=_PARTS, help="these parts")
    options = arguments.parse_args()
    wanted = options.only or _PARTS
    well = True
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if "setup" in wanted:
            well &= setup()
        if "plans" in wanted:
            well &= plans(options.queries, options.seed)
        if "deaths" in wanted:
            well &= deaths(folder)
        if "pairs" in wanted:
            well &= pairs(options.pairs, options.seconds, folder)
        if {"frames", "soak"} & set(wanted):
            with panel(name=f"soak-{time.time_ns()}", folder=folder) as process:
                if "frames" in wanted:
                    well &= frames(process, options.seconds)
                if "soak" in wanted:
                    well &= soak(process, options.minutes)
    return 0 if well else 1


if __name__ == "__main__":
    raise SystemExit(main())
