"""The paper's experiment whole: ./run paper [--out F.png] [--ros ros1|ros2] [--inside].

A motion planner publishes a recorded plan of seven joints as joint states at 10 Hz; the control
node reads at 500 Hz and commands; the kernel turns degrees into pulses and drives joint 1 over
EtherCAT (a simulated drive, real frames on a pair of virtual cables in a network namespace of its
own), six further joints on simulated drives inside. Planner, node, kernel and drive are programs
of their own. Once each goal interrupts the move under way, as in the paper, once with look-ahead.
"""

from __future__ import annotations

import argparse
import csv
import os
import secrets
import subprocess
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from paper.experiment import MODES, READ_HZ, AwayError, Plan, Played, attached, play, program, robot

from sjerk import InputError, SjerkError
from sjerk.cli import cable, demo, pictures
from sjerk.host import Timing


def write(out: Path, plan: Plan, played: dict[str, Played]) -> list[Path]:
    """Figures 6 and 7 as one picture, and what is drawn as tables beside it; these files."""
    columns, tables = [], []
    goals = np.degrees(plan.position[:, 0])
    for mode, one in played.items():
        run, t = one.run, one.time
        per_s = 1.0 / 0.001
        content = {
            "position / deg": [
                pictures.Curve("goals, as published", one.sent, goals, "k."),
                pictures.Curve("commanded", t, run.position, "C0-"),
                pictures.Curve("encoder", t, run.actual_position, "C1:"),
            ],
            "velocity / (deg/s)": [
                pictures.Curve("commanded", t, run.velocity, "C0-"),
                pictures.Curve("encoder", t, run.actual_velocity * per_s, "C1:"),
                pictures.Curve("limit", t[[0, -1]], np.full(2, demo.LIMITS.velocity), "k--"),
            ],
            "acceleration / (deg/s^2)": [pictures.Curve("commanded", t, run.acceleration, "C0-")],
        }
        columns.append((MODES[mode], content))
        tables.append(out.with_name(f"{out.stem}_{mode}.csv"))
        with tables[-1].open("w", newline="") as file:
            table = csv.writer(file)
            names = [f"{kind}_{n}_deg" for kind in ("command", "encoder") for n in plan.names]
            table.writerow(["time_s", *names])
            for moment, q, at in zip(t, one.command, one.encoder, strict=True):
                table.writerow([f"{moment:.3f}", *(f"{x:.5f}" for x in (*q, *at))])
    tables.append(out.with_name(f"{out.stem}_goals.csv"))
    with tables[-1].open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["time_s", *(f"{name}_deg" for name in plan.names)])
        for moment, row in zip(plan.time, np.degrees(plan.position), strict=True):
            table.writerow([f"{moment:.4f}", *(f"{x:.6f}" for x in row)])
    pictures.grid(out, "joint 1 of 7: goals at 10 Hz over ROS, cycle 1 ms", columns)
    return tables


def table(plan: Plan, played: dict[str, Played], timing: Timing) -> str:
    """The figures of the experiment."""
    last = np.degrees(plan.position[-1])
    own = demo.dips(np.diff(plan.position[:, 0]) / np.diff(plan.time))
    rows: dict[str, list[str]] = {"": [MODES[mode] for mode in played]}
    counts = len(plan.time)
    for one in played.values():
        run = one.run
        off = np.rint((one.encoder[-1] - last) * demo.COUNTS_PER_DEGREE)
        cells = {
            f"goals read, of {counts}": f"{one.goals}",
            "oldest goal when read": f"{one.age_ms:.2f} ms",
            "cycles not recorded, left out": f"{run.missed}, {run.skipped}",
            f"encoder of joint 1 at the end, goal {last[0]:.4f}": f"{one.encoder[-1, 0]:.4f} deg",
            "off at the end, the farthest of 7 encoders": f"{int(np.abs(off).max())} increments",
            f"largest velocity commanded, limit {demo.LIMITS.velocity:g}": (
                f"{run.peak('velocity'):.4f} deg/s"
            ),
            f"dips of the velocity > 10 %, plan's own {own}": f"{demo.dips(run.velocity)}",
            "at rest after the last goal": f"{_rest(one) - one.sent[-1]:.3f} s",
        }
        for name, cell in cells.items():
            rows.setdefault(name, []).append(cell)
    lines = [f"{name:48}" + "".join(f"{c:>20}" for c in cells) for name, cells in rows.items()]
    lines.append(f"{'us':48}{'median':>10}{'p99':>10}{'worst':>10}")
    for name in ("period", "computing", "latency"):
        one_ = getattr(timing, name)
        cells_ = "".join(f"{1e6 * x:10.1f}" for x in (one_.median, one_.p99, one_.worst))
        lines.append(f"{name:48}{cells_}")
    return "\n".join(lines)


def _rest(one: Played) -> float:
    """Moment of the last commanded change of joint 1."""
    return float(one.time[np.flatnonzero(np.diff(one.run.position))[-1] + 1])


def experiment(options: argparse.Namespace) -> int:
    """Do it, here: prints the table, writes the picture."""
    plan, name = Plan.shipped(), f"paper-{secrets.token_hex(4)}"
    os.environ |= {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    os.environ |= {"ROS_DOMAIN_ID": str(1 + os.getpid() % 100)}
    with tempfile.TemporaryDirectory() as made, ExitStack() as open_:
        folder = Path(made)
        os.environ["ROS_LOG_DIR"] = made
        plan.save(folder / "plan.json")
        if options.ros == "ros1":
            os.environ |= {"ROS_MASTER_URI": "http://localhost:11387", "ROS_HOSTNAME": "localhost"}
            master = ["rosmaster", "--core", "-p", "11387"]
            open_.enter_context(program(master, folder / "master.log"))
        if options.on_cable:
            open_.enter_context(cable.drives(1))
        played: dict[str, Played] = {}
        file = robot(folder, plan, name, cable.MAIN if options.on_cable else None)
        for left in reversed(range(demo.ATTEMPTS)):
            log = folder / "kernel.log"
            words = [sys.executable, "-m", "sjerk", "kernel", str(file)]
            try:
                with program(words, log) as kernel, attached(name, kernel) as monitor:
                    for mode in MODES:
                        if mode not in played:
                            print(f"{options.ros}: {MODES[mode]}", file=sys.stderr)
                            played[mode] = play(name, plan, mode, options.ros, folder)
                    timing = monitor.feedback().timing
                break
            except AwayError as fault:
                said = log.read_text(errors="replace").strip().splitlines()[-1:]
                if not left:
                    raise
                print(fault, *said, "it is tried again", sep="; ", file=sys.stderr)
    where = "EtherCAT, on virtual cables" if options.on_cable else "simulated inside"
    print(f"joint 1: {where}; six more simulated inside; {options.ros}, read at {READ_HZ:g} Hz")
    print(table(plan, played, timing))
    files = [options.out, *write(options.out, plan, played)]
    print(f"picture and data: {', '.join(str(file) for file in files)}")
    return 0


def main() -> int:
    """On the cables where they can be had, else inside; the exit code."""
    parser = argparse.ArgumentParser(
        prog="./run paper", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("paper.png"), help="the picture")
    parser.add_argument("--ros", choices=("ros1", "ros2"), default="ros2")
    parser.add_argument("--inside", action="store_true", help="all drives inside, no EtherCAT")
    parser.add_argument("--on-cable", action="store_true", help=argparse.SUPPRESS)  # it is there
    options = parser.parse_args()
    try:
        pictures.check(options.out)
        if not options.out.absolute().parent.is_dir():
            raise InputError("out", str(options.out), "must lie in a folder that exists")
        if not options.on_cable and not options.inside:
            here = [sys.executable, "-m", "paper", *sys.argv[1:], "--on-cable"]
            try:
                command = cable.first(cable.inside(here))
            except SjerkError as fault:
                print(f"{fault}; joint 1 has a simulated drive inside, too", file=sys.stderr)
            else:
                return subprocess.call(command)
        return experiment(options)
    except SjerkError as fault:
        print(f"./run paper: {fault}", file=sys.stderr)
        return 1


if __name__ == "__main__":
    raise SystemExit(main())
