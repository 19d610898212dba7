"""Unmodified EtherCAT main devices judge the drives: ``./run test-ethercat``, ``./run judges``.

Each judge is a program of its own beside the emulator's process, both on a pair of virtual cables
in a network namespace of their own, without root. A machine that refuses namespaces skips with its
reason. A judge whose software is missing fails: the environment is to have it.
"""

from __future__ import annotations

import functools
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

LONGEST_S = 100
JUDGES = Path(__file__).with_name("judges")
CABLE = (
    "ip link add ecm type veth peer name ecs && ip link set lo up && "
    "for i in ecm ecs; do "
    "sysctl -qw net.ipv6.conf.$i.disable_ipv6=1 2>/dev/null; ip link set $i up || exit 1; done"
)
NAMESPACE = ["unshare", "-Urn", "sh", "-c"]
#: Which judges this environment has: those of the permissive licences, or the others too.
GROUP = os.environ.get("SJERK_JUDGES", "permissive")

CHECKS = {
    "pysoem": (
        "scan", "transfers", "segments", "refused accesses", "object dictionary", "SII",
        "refusal 11h", "refusal 12h", "refusal 13h", "Safe-operational", "Operational",
        "operation enabled", "targets", "SDO beside", "fault and emergency", "watchdog", "clocks",
        "end",
    ),
    "kickcat": ("scan", "SDO", "mapping", "Operational", "targets", "end"),
    "ebpfcat": ("scan", "SII", "dictionary"),
    "soemx": ("scan", "Operational", "targets", "end"),
}  # fmt: skip
RUNS = {
    "permissive": [("pysoem", 1), ("pysoem", 2), ("pysoem", 7), ("kickcat", 2), ("kickcat", 7)],
    "copyleft": [("ebpfcat", 1), ("ebpfcat", 2), ("soemx", 1), ("soemx", 7)],
}
ROWS = [(*run, check) for run in RUNS[GROUP] for check in CHECKS[run[0]]]


@pytest.fixture(scope="session")
def cable() -> None:
    """A namespace with a cable can be had here."""
    try:
        made = subprocess.run([*NAMESPACE, CABLE], capture_output=True, text=True)
    except FileNotFoundError as error:
        pytest.skip(f"no unshare: {error}")
    if made.returncode:
        pytest.skip(f"no network namespace with a pair of cables: {made.stderr.strip()}")


@functools.cache
def _first() -> list[str]:
    """Before other programs of the machine, where that is allowed: main devices have deadlines."""
    command = ["nice", "-n", "-15"]
    done = subprocess.run([*command, "true"], capture_output=True)
    return command if done.returncode == 0 and not done.stderr else []


@functools.cache
def verdict(name: str, drives: int) -> dict[str, str]:
    """What became of every check of a judge: "" or where it failed."""
    program = f'"{sys.executable}" "{JUDGES / name}_judge.py" {drives}'
    with subprocess.Popen(
        [*_first(), *NAMESPACE, f"{CABLE} && exec {program}"],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    ) as process:
        try:
            said = process.communicate(timeout=LONGEST_S)[0]
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            said = f"it did not end within {LONGEST_S} s"
    lines = [line for line in said.splitlines() if line.startswith("{")]
    if lines:
        return dict(json.loads(lines[-1]))
    return dict.fromkeys(CHECKS[name], f"{name} said: {said[-4000:]}")


@pytest.mark.usefixtures("cable")
@pytest.mark.parametrize(("name", "drives", "check"), ROWS)
def test_an_unmodified_main_device_is_satisfied(name: str, drives: int, check: str) -> None:
    """One check of one judge on a line of so many drives."""
    outcome = verdict(name, drives)[check]
    assert not outcome, outcome
