"""A path in play beside the plain interpolator, and the cycles that check a change of its speed."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest

from conftest import Report
from sjerk import Axis, Host, Limits, MotionKernel, Path, Trajectory, follow
from sjerk._binding import lib
from sjerk.trajectory import shipped_recording

T = 1e-3
VELOCITY = [2.175] * 4 + [2.61] * 3
ACCELERATION = [3.75, 1.875, 2.5, 3.125, 3.75, 5.0, 5.0]
PANDA = [Limits(v, a, 500.0) for v, a in zip(VELOCITY, ACCELERATION, strict=True)]
TABLE = "a path in play: Panda, seven joints, ideal drives, thread CPU time of a cycle in us"


def kernel_at(position: list[float], limits: list[Limits]) -> tuple[MotionKernel, Host]:
    """Seven ideal drives, enabled, at rest there."""
    kernel = MotionKernel([Axis(limit, 1e6, "ideal") for limit in limits], T)
    host = kernel.host()
    host.enable()
    kernel.step(5)
    move = host.move(position)
    while not move.done:
        kernel.step(100)
    kernel.step(5)
    return kernel, host


def long_way(cycles: int) -> Trajectory:
    """A smooth motion of so many cycles, way-points at 0.1 s."""
    t = 0.1 * np.arange(cycles // 100)
    ease = np.minimum(1.0, t / 2.0)[:, None] ** 3
    q = np.column_stack([0.4 * np.sin((0.8 + 0.1 * k) * t) for k in range(7)])
    return Trajectory([f"joint{k}" for k in range(7)], t, q * ease)


def playing(speed: float) -> tuple[MotionKernel, Path]:
    """A kernel in the midst of a long path."""
    way = long_way(190_000)
    kernel, host = kernel_at(way.position[0].tolist(), PANDA)
    path = host.follow(follow(way, PANDA, T))
    for _ in range(60):
        path.pump()
        kernel.step(100)
    path.speed(speed)
    kernel.step(3000)
    return kernel, path


def test_seven_axes_interpolated(benchmark: Any) -> None:
    """Per cycle of a kernel whose axes follow a move of an hour."""
    slow = [Limits(0.01, limit.acceleration, limit.jerk) for limit in PANDA]
    kernel, host = kernel_at([0.0] * 7, slow)
    host.move([36.0] * 7)
    kernel.step(100)
    benchmark.extra_info["per"] = 100
    benchmark.pedantic(kernel.step, (100,), rounds=500)


@pytest.mark.parametrize("speed", [1.0, 0.7])
def test_seven_axes_on_a_path(benchmark: Any, speed: float) -> None:
    """The same on a path, at its own speed and at another."""
    kernel, path = playing(speed)
    benchmark.extra_info["per"] = 100
    benchmark.extra_info["against"] = {"test_seven_axes_interpolated": "per cycle of seven axes"}
    benchmark.pedantic(kernel.step, (100,), rounds=500)
    assert path.progress.speed == speed


def cpu_of(kernel: Any) -> float:
    """One cycle in C."""
    begin = time.clock_gettime_ns(time.CLOCK_THREAD_CPUTIME_ID)
    lib.sj_kernel_cycles(kernel, 1)
    return (time.clock_gettime_ns(time.CLOCK_THREAD_CPUTIME_ID) - begin) * 1e-3


def test_cycles_that_check_a_stop(report: Report) -> None:
    """Pauses at forty moments of the shipped plan: the cycles before, and those until rest."""
    way = Trajectory.from_bag(shipped_recording())
    blocks = list(follow(way, PANDA, T, use_velocities=False))
    before, checking, rests = [], [], []
    for moment in np.random.default_rng(0).integers(200, int(way.duration / T) - 800, 40).tolist():
        kernel, host = kernel_at(way.position[0].tolist(), PANDA)
        path = host.follow(blocks)
        kernel.step(20)
        raw = kernel.core
        before += [cpu_of(raw) for _ in range(moment)]
        path.pause()
        count = len(checking)
        while path.progress.speed > 0.0:
            checking.append(cpu_of(raw))
        rests.append(len(checking) - count)
    for name, times in (("on the path", before), ("with a pause under way", checking)):
        row = np.percentile(times, [50, 99, 99.9, 100])
        report.line(
            TABLE,
            f"{name:24} p50 {row[0]:7.1f} p99 {row[1]:7.1f} p99.9 {row[2]:7.1f} "
            f"longest {row[3]:7.1f}",
        )
    report.line(TABLE, f"cycles until rest: median {np.median(rests):.0f}, longest {max(rests)}")
