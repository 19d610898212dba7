"""A line of emulated drives in a process of its own, for the judges, in a network namespace.

Environment: ``SJERK_PYTHON_UNDER_TEST`` the interpreter that has sjerk (default: this one).
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

MAIN, LINE = "ecm", "ecs"
_PYTHON = os.environ.get("SJERK_PYTHON_UNDER_TEST", sys.executable)


class Wire:
    """The emulator's process; use as a context."""

    def __init__(self, drives: int, *options: str) -> None:
        if capture := os.environ.get("SJERK_JUDGE_CAPTURE"):
            options = (*options, "--capture", capture)
        self._folder = tempfile.TemporaryDirectory()
        self._control = Path(self._folder.name) / "control"
        self._process = subprocess.Popen(
            [_PYTHON, "-m", "sjerk", "drive", "--ethercat", LINE, "--drives", str(drives),
             "--control", str(self._control), *options],
            stdout=subprocess.PIPE, text=True, preexec_fn=end_with_parent,
        )  # fmt: skip
        self.told: list[str] = []
        assert self._process.stdout is not None
        first = self._process.stdout.readline()
        assert "ready" in first, first
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self.told.append(line.rstrip("\n"))

    def fault(self, words: str, meanwhile: Callable[[], object] | None = None) -> Any:
        """Tell the line a fault; its status. `meanwhile` goes on until the program has ended."""
        with subprocess.Popen(
            [_PYTHON, "-m", "sjerk", "drive", "--control", str(self._control), "--fault", words],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=behind,
        ) as told:  # fmt: skip
            while meanwhile is not None and told.poll() is None:
                meanwhile()
                time.sleep(0.001)
            said, wrong = told.communicate()
        if told.returncode:
            raise AssertionError(f"{words}: {wrong}")
        return json.loads(said)

    def status(self, k: int = 0) -> Any:
        """What a device says of itself."""
        return self.fault("status")["devices"][k]

    def __enter__(self) -> Wire:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.wait(timeout=10)
        self._reader.join(timeout=10)
        self._folder.cleanup()


def end_with_parent() -> None:
    """The emulator does not outlive its judge (PR_SET_PDEATHSIG)."""
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)


def behind() -> None:
    """A program that may wait, where its judge has a real-time priority."""
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def judge(checks: dict[str, Callable[[], object]]) -> None:
    """Run the checks in their order; print what became of each as a line of JSON."""
    outcomes = {}
    for name, check in checks.items():
        try:
            check()
            outcomes[name] = ""
        except Exception:
            outcomes[name] = traceback.format_exc(limit=4)
    print(json.dumps(outcomes), flush=True)
