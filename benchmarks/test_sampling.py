"""Sampling a long move: sjerk beside a plain fill, justblend and ruckig; cost per sample."""

from __future__ import annotations

from typing import Any

import pytest

from sjerk import Limits, Samples, scurve

T = 1e-3
LIMITS = Limits(90.0, 500.0, 5000.0)
DISTANCE = 1600.0
PROFILE = scurve(DISTANCE, LIMITS, T)
ROWS = PROFILE.cycles + 2


def test_plain_fill(benchmark: Any) -> None:
    """Writing one number into each of the same five arrays: numpy's own C loop."""
    out = Samples.empty(ROWS)
    columns = (out.time, out.position, out.velocity, out.acceleration, out.jerk)

    def fill() -> None:
        for column in columns:
            column.fill(1.0)

    benchmark.extra_info["per"] = ROWS
    benchmark(fill)


def test_sample_into_warm_arrays(benchmark: Any) -> None:
    """sample(out=...): no allocation."""
    out = PROFILE.sample()
    benchmark.extra_info["per"] = ROWS
    benchmark.extra_info["against"] = {
        "test_plain_fill": "goal <= 5",
        "test_justblend_samples": "goal <= 0.2",
    }
    benchmark(PROFILE.sample, out)
    assert out.position[-1] == DISTANCE


def test_sample_allocating(benchmark: Any) -> None:
    """sample(): fresh arrays."""
    benchmark.extra_info["per"] = ROWS
    benchmark.extra_info["against"] = {"test_ruckig_at_time_loop": "goal <= 0.04"}
    benchmark(PROFILE.sample)


def test_justblend_samples(benchmark: Any) -> None:
    """Justblend's samples(dt) of its own s-curve over the same distance."""
    justblend = pytest.importorskip("justblend")
    generator = justblend.SCurveTrajectoryGenerator(1)
    generator.set_limits(justblend.Limits([90.0], [500.0], [5000.0]))
    trajectory = generator.generate([[0.0], [DISTANCE]])
    benchmark.extra_info["per"] = len(trajectory.samples(T).t)
    benchmark(trajectory.samples, T)


def test_ruckig_at_time_loop(benchmark: Any) -> None:
    """Ruckig's at_time for every cycle of the same move."""
    ruckig = pytest.importorskip("ruckig")
    otg, inp, trajectory = ruckig.Ruckig(1), ruckig.InputParameter(1), ruckig.Trajectory(1)
    inp.target_position = [DISTANCE]
    inp.max_velocity, inp.max_acceleration, inp.max_jerk = [90.0], [500.0], [5000.0]
    otg.calculate(inp, trajectory)
    times = [k * T for k in range(round(trajectory.duration / T) + 1)]
    benchmark.extra_info["per"] = len(times)
    benchmark(lambda: [trajectory.at_time(t) for t in times])
