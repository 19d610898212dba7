"""The cycle: in C, from Python, and as a process on this machine (cycle-time report)."""

from __future__ import annotations

import time
from typing import Any

import pytest

from conftest import Report
from sjerk import Axis, Limits, MotionKernel, scurve

AXIS = Axis(Limits(90.0, 500.0, 5000.0), counts_per_unit=2**24 / 360)


def moving(axes: int) -> MotionKernel:
    """A kernel in this process whose drives follow a move of an hour."""
    slow = Axis(Limits(0.01, 500.0, 5000.0), counts_per_unit=2**24 / 360)
    kernel = MotionKernel([slow] * axes, 1e-3)
    host = kernel.host()
    host.enable()
    kernel.step(10)
    host.move([36.0] * axes if axes > 1 else 36.0)
    kernel.step(100)
    assert host.feedback().moving
    return kernel


@pytest.mark.parametrize("axes", [1, 7])
def test_one_cycle_in_c(benchmark: Any, axes: int) -> None:
    """Collect, interpolate, drive (8 inner steps), publish: per cycle, 100 cycles a call."""
    kernel = moving(axes)
    benchmark.extra_info["per"] = 100
    benchmark(kernel.step, 100)


@pytest.mark.parametrize("axes", [1, 7])
def test_one_cycle_called_from_python(benchmark: Any, axes: int) -> None:
    """kernel.step(): the same with the call."""
    kernel = moving(axes)
    benchmark.extra_info["against"] = {f"test_one_cycle_in_c[{axes}]": ""}
    benchmark(kernel.step)


def test_one_scurve_from_python(benchmark: Any) -> None:
    """Planning by the paper's closed form in Python."""
    benchmark(scurve, 160.0, AXIS.limits, 1e-3)


@pytest.mark.parametrize("period_us", [1000, 250])
def test_cycle_time_report(report: Report, period_us: int) -> None:
    """Three seconds of a kernel process in motion: period, latency, computing time."""
    with MotionKernel([AXIS], period_us * 1e-6) as kernel, kernel.host() as host:
        host.enable()
        host.move(250.0)
        time.sleep(3.0)
        timing = host.feedback().timing
    heading = "cycle-time report, one axis with its drive, us"
    for name, row in (
        ("period", timing.period),
        ("wake-up latency", timing.latency),
        ("computing time", timing.computing),
    ):
        values = " ".join(
            f"{label} {value * 1e6:9.1f}"
            for label, value in (
                ("median", row.median),
                ("p99", row.p99),
                ("p99.9", row.p999),
                ("worst", row.worst),
            )
        )
        report.line(heading, f"{period_us:5} us  {name:16} {values}")
    report.line(
        heading, f"{period_us:5} us  late {timing.late} of {timing.period.count + 1} cycles"
    )
    assert timing.period.count > 100
