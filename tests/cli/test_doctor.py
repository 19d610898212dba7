"""``sjerk doctor`` tells what is so on this machine, and how it is mended."""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sys
from importlib import metadata

import pytest

from sjerk.__main__ import main
from sjerk.cli import machine
from sjerk.cli.machine import Finding, Verdict
from sjerk.errors import SegmentMemoryError


def doctor(capsys: pytest.CaptureFixture[str]) -> dict[str, dict[str, str]]:
    assert main(["doctor", "--json", "--seconds", "0.2"]) == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    return {row["of"]: row for row in rows}


def test_each_thing_is_told_as_the_system_itself_says(capsys: pytest.CaptureFixture[str]) -> None:
    """Scheduling, raw sockets and tools, by a try of this test's own; what is refused is mended."""
    found = doctor(capsys)
    grants = subprocess.run(
        [sys.executable, "-c", "import os; os.sched_setscheduler(0, 1, os.sched_param(80))"],
        capture_output=True,
    )
    assert found["scheduler"]["verdict"] == ("refused" if grants.returncode else "granted")
    try:
        socket.socket(socket.AF_PACKET, socket.SOCK_RAW, 0).close()
        raw = "granted"
    except PermissionError:
        raw = "refused"
    assert found["raw sockets"]["verdict"] == raw
    installed = shutil.which("cyclictest") is not None
    assert found["cyclictest"]["verdict"] == ("granted" if installed else "refused")
    assert found["shared memory"]["verdict"] == found["kernel"]["verdict"] == "granted"
    for row in found.values():
        assert (row["mend"] == "") == (row["verdict"] == "granted"), row
    assert {"memory locking", "clocks", "namespaces", "preemption", "extra demo"} <= set(found)


def test_without_shared_memory_no_kernel_runs(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 1, the reason, and the line that mends it; no kernel is tried."""

    def full(*_: object, **__: object) -> None:
        raise SegmentMemoryError("no space is left", size=8)

    monkeypatch.setattr(machine.Segment, "create", full)
    assert main(["doctor", "--seconds", "0.2"]) == 1
    told = capsys.readouterr().out
    assert "!!  shared memory: no space is left\n      mount -t tmpfs" in told
    assert "cycles of" not in told


def test_a_finding_that_is_granted_needs_no_mending() -> None:
    """And one that is refused keeps its line."""
    assert Finding.tried("x", True, "there", "do this") == Finding("x", Verdict.GRANTED, "there")
    assert Finding.tried("x", False, "none", "do this").mend == "do this"


def test_nothing_is_left_behind(capsys: pytest.CaptureFixture[str]) -> None:
    """No segment of the doctor outlives it."""
    doctor(capsys)
    assert not [name for name in os.listdir("/dev/shm") if "doctor" in name]


def test_every_extra_for_users_is_told() -> None:
    """Those of the installation, but for the ones of this project's own development."""
    own = ("test", "docs", "wheels", "judges", "bench", "lint")
    known = metadata.metadata("sjerk").get_all("Provides-Extra") or []
    wanted = {f"extra {name}" for name in known if not name.startswith(own)}
    assert wanted
    assert wanted == {finding.of for finding in machine.extras()}
