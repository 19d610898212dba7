"""Seven drives on a cable, one LRW each: the cycle's work and the phase, beside other ways.

Work is processor time of the thread: take, kernel, send; in Python with pysoem, its waiting not
counted. Whole is the same with the wait for the answer, which the exchange in C does not have. Both
have one frame a cycle; most of what the one in C takes is the system's, which wakes the emulator.
Phase: of the cycle against the drives' clock. Each drive that left Operational is told with how
late the cycle was. Skips where no network namespace can be had.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from conftest import Report
from sjerk.cli.cable import first, inside
from sjerk.errors import SjerkError

PROGRAM = Path(__file__).with_name("ethercat_cycle.py")
DRIVES, SECONDS = 7, 4
WAYS = ("ours", "together", "arrivals", "pysoem")


INSIDE = """
import subprocess, sys
from sjerk.cli.cable import drives
for way in {ways!r}:
    with drives({drives}):
        command = [sys.executable, {program!r}, way, "{drives}", "{cycle}", "{seconds}"]
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True)
    print(done.stdout.strip() or "null", flush=True)
"""


@pytest.mark.parametrize("cycle", [1000, 250])
def test_the_cycle_of_seven_drives(report: Report, cycle: int) -> None:
    """Work and phase of the ways, one after the other; one LRW for all drives is one of them."""
    words = {
        "ways": WAYS,
        "drives": DRIVES,
        "program": str(PROGRAM),
        "cycle": cycle,
        "seconds": SECONDS,
    }
    try:
        command = inside([sys.executable, "-c", INSIDE.format(**words)])
    except SjerkError as error:
        pytest.skip(str(error))
    done = subprocess.run(first(command), stdout=subprocess.PIPE, text=True)
    ways = dict(zip(WAYS, map(json.loads, done.stdout.split("\n")[: len(WAYS)]), strict=True))
    table = f"{DRIVES} EtherCAT drives at {cycle} us: us, median / p99 / worst"
    for way, result in ways.items():
        if result is None:
            report.line(table, f"{way:10} did not run: a stall of the machine")
            continue
        cells = [f"{way:10}"]
        for name in ("work", "whole", "phase", "wake"):
            if name in result:
                row = result[name]
                numbers = " / ".join(f"{row[k]:.1f}" for k in ("median", "p99", "worst"))
                cells.append(f"{name} {numbers}")
        cells.append(f"set up {result['set up'] * 1e3:.0f} ms")
        cells.append(f"of {result['cycles']} cycles, wrong counters {result['wrong']}")
        if "late" in result:
            cells.append(f"late {result['late']}, answers late {result['answers late']}")
        report.line(table, "  ".join(cells))
        for text in result.get("thrown out", []):
            report.line(table, f"{way:10} thrown out: {text}")
    ours, arrivals, python = ways["ours"], ways["arrivals"], ways["pysoem"]
    if ours and python:
        for which in ("median", "p99"):
            ratio = ours["work"][which] / python["work"][which]
            report.line(table, f"work, {which}: ours / pysoem = {ratio:.3f}")
            ratio = ours["work"][which] / python["whole"][which]
            report.line(table, f"{which}: ours / pysoem with its wait = {ratio:.3f}  (<= 0.2)")
        ratio = ours["set up"] / python["set up"]
        report.line(table, f"set up to Safe-operational: ours / pysoem = {ratio:.2f}")
    if ours and arrivals:
        for which in ("median", "p99"):
            ratio = ours["phase"][which] / arrivals["phase"][which]
            report.line(table, f"phase, {which}: ours / arrivals = {ratio:.3f}  (p99 <= 0.1)")
    if ours:
        assert ours["wrong"] == 0
