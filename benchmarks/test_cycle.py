"""The cycle: in C, from Python, and as a process on this machine (cycle-time report)."""

from __future__ import annotations

import time
from typing import Any

import pytest

from conftest import Report
from sjerk import Axis, Limits, MotionKernel, replay, scurve, simulate
from sjerk._binding import lib

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


@pytest.mark.parametrize("axes", [1, 7])
def test_one_cycle_with_its_trace(benchmark: Any, axes: int) -> None:
    """The same with the trace that a recorder reads."""
    kernel = moving(axes)
    kernel.trace_to(None)
    benchmark.extra_info["per"] = 100
    benchmark.extra_info["against"] = {f"test_one_cycle_in_c[{axes}]": ""}
    benchmark(lib.sj_kernel_cycles, kernel.core, 100)


@pytest.mark.parametrize("drive", ["simulated", "ideal"])
def test_virtual_time(report: Report, drive: str) -> None:
    """simulate() of seven axes at 1 ms that move all the time, and the replay of it."""
    goal = {"simulated": 100, "ideal": 1000}[drive]
    axis = AXIS if drive == "simulated" else Axis(AXIS.limits, AXIS.counts_per_unit, "ideal")
    cycles, slow = 60_000, Limits(0.5, 500.0, 5000.0)
    script: list[tuple[int, Any]] = [
        (1, lambda host: host.enable()),
        (20, lambda host: host.move([36.0] * 7, limits=slow)),
    ]
    speeds, shares = [], []
    for _ in range(5):
        kernel = MotionKernel([axis] * 7, 1e-3)
        begun, processor = time.perf_counter(), time.thread_time()
        recording = simulate(kernel, script, cycles)
        speeds.append(cycles * 1e-3 / (time.perf_counter() - begun))
        shares.append(cycles * 1e-3 / (time.thread_time() - processor))
    assert recording.velocity[-1].all()
    done = replay(recording)
    assert done.identical
    report.line(
        "virtual time, seven axes at 1 ms, times real time (best of 5)",
        f"{drive:10} simulate {max(speeds):6.0f} (goal {goal}), by processor time "
        f"{max(shares):6.0f}; replay {done.speed:6.0f}",
    )


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
