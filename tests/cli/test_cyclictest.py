"""cyclictest beside a kernel: its own output is read, and the tool itself where it is installed."""

from __future__ import annotations

import shutil

import pytest

from sjerk import InputError, SjerkError
from sjerk.cli.cyclictest import LONGEST_US, Cyclictest, read

#: Written by cyclictest 2.40: -q -D 1 -i 1000 -p 80 -t 1 -m -h 30 --json=FILE
WRITTEN = """{
  "file_version": 1,
  "cmdline:": "cyclictest -q -D 1 -i 1000 -p 80 -t 1 -m -h 30 --json=o.json",
  "rt_test_version:": "2.40",
  "start_time": "Sun, 22 Nov 2026 14:30:07 +0000",
  "end_time": "Sun, 22 Nov 2026 14:30:09 +0000",
  "return_code": 0,
  "sysinfo": {
    "sysname": "Linux",
    "realtime": 0
  },
  "num_threads": 1,
  "resolution_in_ns": 0,
  "thread": {
    "0": {
      "histogram": {
        "17": 400,
        "18": 500,
        "21": 91,
        "29": 8
      },
      "cycles": 1000,
      "min": 17,
      "max": 814,
      "avg": 27.12,
      "cpu": 0,
      "node": 0
    }
  }
}
"""


def test_percentiles_are_read_from_its_histogram() -> None:
    """Within their bucket of 1 us; what has no bucket counts, and the worst is its own."""
    verdict = read(WRITTEN, 80)
    assert (verdict.version, verdict.priority) == ("2.40", 80)
    assert verdict.latency.count == 1000
    assert verdict.latency.median == pytest.approx(18.2e-6)
    assert verdict.latency.p99 == pytest.approx(21e-6 + 90 / 91 * 1e-6)
    assert verdict.latency.p999 == pytest.approx(30e-6)
    assert verdict.latency.worst == pytest.approx(814e-6)


def test_a_tail_without_buckets_is_the_worst() -> None:
    """Percentiles beyond the last bucket are not made up."""
    latency = read(WRITTEN.replace('"29": 8', '"29": 7'), 0).latency
    assert latency.p999 == latency.worst


@pytest.mark.parametrize("text", ["", "{}", WRITTEN.replace('"0": {', '"1": {')])
def test_what_is_no_report_is_refused(text: str) -> None:
    """Nothing is read from a file that is none."""
    with pytest.raises((ValueError, KeyError)):
        read(text, 0)
    with pytest.raises(SjerkError, match="measured nothing"):
        read(WRITTEN.replace('"cycles": 1000', '"cycles": 0'), 0)


@pytest.mark.skipif(shutil.which("cyclictest") is None, reason="cyclictest is not installed")
def test_the_tool_itself_is_started_and_read() -> None:
    """A second at 1 ms: about as many wake-ups, ordered percentiles."""
    run = Cyclictest.start(1e-3, 0.5)
    assert run is not None
    verdict = run.result()
    latency = verdict.latency
    assert 1 < latency.count <= 1500
    assert 0.0 < latency.median <= latency.p99 <= latency.p999 <= latency.worst
    assert latency.p99 < LONGEST_US * 1e-6 or latency.p99 == latency.worst
    with pytest.raises(InputError, match="priority"):
        Cyclictest.start(1e-3, 1.0, priority=100)


def test_its_refusal_is_told_in_its_words(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tool that fails makes an error with what it said, not a figure."""
    tool = shutil.which("false")
    assert tool is not None
    monkeypatch.setattr(shutil, "which", lambda name: tool)
    run = Cyclictest.start(1e-3, 1.0, priority=80)
    assert run is not None
    with pytest.raises(SjerkError, match="cyclictest"):
        run.result()
