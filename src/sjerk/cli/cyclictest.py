"""cyclictest (rt-tests) next to a kernel: the system's own wake-up latency in the same seconds.

Started as an external program where it is installed; its JSON is read. Never here: the kernel.
"""

from __future__ import annotations

import json
import math
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from sjerk.errors import InputError, SjerkError, positive
from sjerk.host import Distribution

#: Longest latency that gets a bucket of its own, microseconds; longer ones are counted.
LONGEST_US = 10_000


@dataclass(frozen=True)
class Judgement:
    """What one thread of cyclictest saw: ``latency`` in seconds, ``priority`` 0 is no real time."""

    version: str
    priority: int
    latency: Distribution


class Cyclictest:
    """A run of cyclictest: ``start`` it, do something else, then ask for the ``result``."""

    def __init__(self, process: subprocess.Popen[str], file: Path, priority: int) -> None:
        """Not for callers: ``start`` makes it."""
        self._process, self._file, self._priority = process, file, priority

    @classmethod
    def start(cls, period: float, seconds: float, *, priority: int = 0) -> Self | None:
        """One thread of this period (s) for whole seconds; None where it is not installed.

        ``priority``: of SCHED_FIFO, 0 for the usual scheduling. Raises InputError.
        """
        tool = shutil.which("cyclictest")
        if tool is None:
            return None
        interval = round(positive("period", period) * 1e6)
        if not 0 <= priority <= 99:
            raise InputError("priority", priority, "must lie in 0 .. 99")
        with tempfile.NamedTemporaryFile(suffix=".json", delete=False) as file:
            where = Path(file.name)
        order = [tool, "--quiet", "--threads=1", "--mlockall", f"--interval={interval}"]
        order += [f"--duration={max(1, math.ceil(seconds))}", f"--histogram={LONGEST_US}"]
        order += [f"--json={where}", *([f"--priority={priority}"] if priority else [])]
        process = subprocess.Popen(
            order, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        return cls(process, where, priority)

    def result(self) -> Judgement:
        """Wait for its end; raises SjerkError with its own words when it could not measure."""
        said = self._process.communicate()[1].strip()
        text = self._file.read_text(encoding="utf-8")
        self._file.unlink()
        try:
            return read(text, self._priority)
        except (ValueError, KeyError, SjerkError) as fault:
            raise SjerkError(f"cyclictest: {said or fault}") from fault


def read(text: str, priority: int) -> Judgement:
    """Read the JSON of ``cyclictest --histogram --json`` with one thread.

    Latencies are cut to whole microseconds: bucket n holds n .. n + 1 us. Raises ValueError,
    KeyError: not such a file; SjerkError: it measured nothing.

    >>> text = '{"rt_test_version:": "2.40", "thread": {"0": {"histogram": {"17": 3, "20": 1},'
    >>> round(read(text + ' "cycles": 4, "max": 20}}}', 80).latency.worst, 9)
    2e-05
    """
    found = json.loads(text)
    thread = found["thread"]["0"]
    if not thread["cycles"]:
        raise SjerkError("it measured nothing")
    return Judgement(str(found["rt_test_version:"]), priority, _distribution(thread))


def _distribution(thread: dict[str, Any]) -> Distribution:
    buckets = sorted((int(us), int(n)) for us, n in thread["histogram"].items())
    count, worst = int(thread["cycles"]), int(thread["max"]) * 1e-6
    cuts = []
    for share in (0.5, 0.99, 0.999):
        below, value = 0, worst  # beyond the buckets only the worst is known
        for us, n in buckets:
            if below + n >= share * count:
                value = (us + (share * count - below) / n) * 1e-6
                break
            below += n
        cuts.append(min(value, worst))
    return Distribution(count, cuts[0], cuts[1], cuts[2], worst)
