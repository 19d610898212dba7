"""The paper's experiment whole: ./run paper [--out F.png].

A motion planner publishes a recorded plan of seven joints as joint states at 10 Hz; the control
node reads at 500 Hz and commands; the kernel turns degrees into pulses and drives joint 1 over
EtherCAT (simulated drive, real frames on a pair of virtual cables in a network namespace of its
own), six further joints on simulated drives inside. Planner, node, kernel and drive are programs
of their own. Once each goal interrupts the move under way, as in the paper, once with look-ahead.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import secrets
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sjerk import Host, Monitor, Recorder, Recording, SjerkError
from sjerk.cli import cable, demo, pictures
from sjerk.trajectory import shipped_recording
from sjerk.trajectory.files import read_bag

HERE = Path(__file__).parent
LONGEST_S = 60.0
TOPIC = "/joint_states"
MODES = {"interrupt": "interrupted", "stream": "look-ahead"}
FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Plan:
    """Joints, moments (n,) in s and positions (n, 7) in radians."""

    names: list[str]
    time: FloatArray
    position: FloatArray

    @classmethod
    def shipped(cls) -> Plan:
        """The TOPP-RA plan of a Panda that sjerk ships, begun at zero."""
        names, moments, position, *_ = read_bag(shipped_recording().parent / "panda.mcap")
        rows = np.asarray(position)
        return cls(list(names), np.asarray(moments) - moments[0], rows - rows[0])


@dataclass(frozen=True, eq=False)
class Played:
    """What one mode has done: the goals' moments (n,), and the cycles' as recorded (m, 7), deg."""

    sent: FloatArray
    time: FloatArray
    commanded: FloatArray
    velocity: FloatArray
    actual: FloatArray
    missed: int

    @property
    def actual_velocity(self) -> FloatArray:
        """Of joint 1 by its encoder, over ten cycles, deg/s."""
        step = 10
        found = np.zeros(len(self.time))
        found[step:] = (self.actual[step:, 0] - self.actual[:-step, 0]) / (
            self.time[step:] - self.time[:-step]
        )
        return found


def robot(folder: Path, plan: Plan, name: str, interface: str | None) -> Path:
    """The kernel's file: joint 1 under the paper's velocity limit, on EtherCAT where granted."""
    limits = demo.LIMITS
    rows = [f'name = "{name}"', "cycle_time = 0.001"]
    if interface is not None:
        rows += ["[ethercat]", f'interface = "{interface}"', "lost = 100"]
    for k, joint in enumerate(plan.names):
        rows += [
            "[[axes]]",
            f'name = "{joint}"',
            'unit = "deg"',
            f"counts_per_unit = {demo.COUNTS_PER_DEGREE!r}",
            f"limits = {{ velocity = {limits.velocity}, acceleration = {limits.acceleration!r}, "
            f"jerk = {limits.jerk!r} }}",
        ]
        if k == 0 and interface is not None:
            # no real-time machine: SYNC0 may be missed for as long as the watchdog waits
            rows += ["[axes.ethercat]", "position = 0", 'startup = [["10F1:2", "u16", 65535]]']
    file = folder / "panda.toml"
    file.write_text("\n".join(rows) + "\n")
    return file


@contextmanager
def program(words: list[str], log: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A program of its own until the end; its last lines are told where it failed."""
    with log.open("ab") as file:
        process = subprocess.Popen(words, stdout=file, stderr=subprocess.STDOUT)
    try:
        yield process
    except BaseException:
        print(log.read_text(errors="replace")[-2000:], file=sys.stderr)
        raise
    finally:
        process.terminate()
        process.wait(LONGEST_S)


def attached(name: str) -> Monitor:
    """Of a kernel that is starting."""
    end = time.monotonic() + LONGEST_S
    while True:
        try:
            return Monitor.attach(name)
        except SjerkError:
            if time.monotonic() > end:
                raise
            time.sleep(0.05)


def play(kernel: str, plan: Plan, mode: str, ros: str, folder: Path) -> Played:
    """One mode, from the plan's first row to rest on its last."""
    with Host.attach(kernel, wait=LONGEST_S) as host:
        host.enable(LONGEST_S)
        host.move(np.degrees(plan.position[0]).tolist()).wait(LONGEST_S)
    given = {"mode": mode, "read_rate": "500.0", "goal_topic": TOPIC}
    sign = "" if ros == "ros2" else "_"
    extra = [f"{sign}{key}:={value}" for key, value in given.items()]
    if ros == "ros2":
        extra = [word for one in extra for word in ("-p", one)]
    words = [
        sys.executable,
        "-m",
        "sjerk",
        ros,
        "control",
        "--kernel",
        kernel,
        "--ros-args",
        *extra,
    ]
    publisher = [
        sys.executable,
        str(HERE / f"{ros}_publisher.py"),
        str(folder / "plan.json"),
        TOPIC,
    ]
    last = np.degrees(plan.position[-1])
    with (
        program(words, folder / f"node_{mode}.log") as node,
        attached(kernel) as monitor,
        Recorder(kernel, None) as recorder,
    ):
        first = monitor.feedback()
        sent = [
            json.loads(line)["sent"]
            for line in subprocess.check_output(publisher, timeout=LONGEST_S).splitlines()
        ]
        end = time.monotonic() + LONGEST_S
        while True:
            axes = monitor.feedback().axes
            off = max(abs(axis.position - q) for axis, q in zip(axes, last, strict=True))
            if off < 1e-9 and all(axis.settled for axis in axes):
                break
            if node.poll() is not None or time.monotonic() > end:
                raise SjerkError(f"{mode}: {off:g} deg from the plan's end")
            time.sleep(0.01)
        time.sleep(0.3)
    return _played(recorder.recording, recorder.missed, first.cycle, first.time_ns, sent)


def _played(found: Recording, missed: int, cycle: int, time_ns: int, sent: list[float]) -> Played:
    moments = time_ns * 1e-9 + (found.cycle.astype(np.float64) - cycle) * found.cycle_time
    rows = moments > sent[0] - 0.1
    return Played(
        np.array(sent) - sent[0],
        moments[rows] - sent[0],
        found.position[rows],
        found.velocity[rows],
        found.actual_position[rows],
        missed,
    )


def write(out: Path, plan: Plan, runs: dict[str, Played]) -> None:
    """Figures 6 and 7 as a picture, and what is drawn as a table beside it."""
    panel = {}
    for mode, run in runs.items():
        goals = np.degrees(plan.position[:, 0])
        label = MODES[mode]
        panel[f"{label}:\nposition / deg"] = [
            pictures.Curve("goals as published", run.sent, goals, "k."),
            pictures.Curve("commanded", run.time, run.commanded[:, 0], "C0-"),
            pictures.Curve("encoder", run.time, run.actual[:, 0], "C1:"),
        ]
        panel[f"{label}:\nvelocity / (deg/s)"] = [
            pictures.Curve("commanded", run.time, run.velocity[:, 0], "C0-"),
            pictures.Curve("encoder, over 10 cycles", run.time, run.actual_velocity, "C1:"),
        ]
        with out.with_name(f"{out.stem}_{mode}.csv").open("w", newline="") as file:
            table = csv.writer(file)
            names = [f"{kind}_{n}_deg" for kind in ("commanded", "encoder") for n in plan.names]
            table.writerow(["time_s", *names])
            for t, q, at in zip(run.time, run.commanded, run.actual, strict=True):
                table.writerow([f"{t:.4f}", *(f"{x:.6f}" for x in (*q, *at))])
    limits = {name: demo.LIMITS.velocity for name in panel if "velocity" in name}
    pictures.panels(out, "joint 1 of 7: goals at 10 Hz over ROS, cycle 1 ms", panel, limits)


def main() -> int:
    """Do the experiment; prints the table, writes the picture; the exit code."""
    parser = argparse.ArgumentParser(prog="./run paper", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("paper.png"), help="the picture")
    parser.add_argument("--ros", choices=("ros1", "ros2"), default="ros2")
    parser.add_argument("--on-cable", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if not options.on_cable:
        try:
            here = [sys.executable, *sys.argv, "--on-cable"]
            return subprocess.call(cable.inside(here))
        except SjerkError as fault:
            print(f"joint 1 on a simulated drive inside, too: {fault}")
    plan = Plan.shipped()
    name = f"paper-{secrets.token_hex(4)}"
    os.environ |= {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_DOMAIN_ID": "87"}
    with tempfile.TemporaryDirectory() as made, ExitStack() as open_:
        folder = Path(made)
        os.environ["ROS_LOG_DIR"] = made
        rows = {"names": plan.names, "time": plan.time.tolist(), "position": plan.position.tolist()}
        (folder / "plan.json").write_text(json.dumps(rows))
        if options.on_cable:
            open_.enter_context(cable.drives(1))
        file = robot(folder, plan, name, cable.MAIN if options.on_cable else None)
        kernel = [sys.executable, "-m", "sjerk", "kernel", str(file)]
        open_.enter_context(program(kernel, folder / "kernel.log"))
        if options.ros == "ros1":
            os.environ |= {"ROS_MASTER_URI": "http://localhost:11387", "ROS_HOSTNAME": "localhost"}
            master = ["rosmaster", "--core", "-p", "11387"]
            open_.enter_context(program(master, folder / "master.log"))
        with attached(name) as monitor:
            runs = {mode: play(name, plan, mode, options.ros, folder) for mode in MODES}
            timing = monitor.feedback().timing
    where = "EtherCAT, virtual cables" if options.on_cable else "simulated inside"
    print(f"joint 1: {where}; six more simulated inside; {options.ros}, goals read at 500 Hz")
    goal = float(np.degrees(plan.position[-1, 0]))
    heads = (
        ("goals", 6),
        ("dips", 6),
        ("largest velocity", 20),
        ("encoder at end", 16),
        ("missed", 8),
    )
    print(f"{'':14}" + "".join(f"{head:>{width}}" for head, width in heads))
    for mode, run in runs.items():
        print(
            f"{MODES[mode]:14}{len(run.sent):6}{demo.dips(run.velocity[:, 0]):6}"
            f"{np.abs(run.velocity[:, 0]).max():14.3f} deg/s"
            f"{run.actual[-1, 0]:12.4f} deg{run.missed:8}"
        )
    print(f"the plan ends at {goal:.4f} deg; limit {demo.LIMITS.velocity:g} deg/s")
    for what in ("period", "computing", "latency"):
        row = getattr(timing, what)
        print(f"{what:10} us: median {1e6 * row.median:8.1f}  p99 {1e6 * row.p99:8.1f}")
    print(f"late cycles: {timing.late}")
    write(options.out, plan, runs)
    tables = ", ".join(f"{options.out.stem}_{mode}.csv" for mode in MODES)
    print(f"picture: {options.out}; data: {tables}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
