"""Velocities lowered in motion, in every way a host has: no axis passes below them, none turns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from helpers.chains import SOME
from helpers.loops import enabled
from sjerk import Axis, Host, Limits, MotionKernel
from sjerk.recording import Frames

T = 1e-3
PAPER = Limits(250.0, 2000.0, 15000.0)
Array = NDArray[np.float64]


class Bench:
    """Axes on the way to goals, recorded from now on."""

    def __init__(self, limits: list[Limits], ways: list[float], mode: str, cycles: int) -> None:
        self.kernel: MotionKernel
        self.host: Host
        self.kernel, self.host = enabled([Axis(one, 10_000) for one in limits], T)
        self.move = self.host.move(ways, synchronization=mode)  # type: ignore[arg-type]
        self.kernel.step(cycles)
        self.frames = Frames(self.kernel)

    def room(self, limits: list[Limits], ways: list[float]) -> list[bool]:
        """Whether each axis can brake before its goal, with five cycles to spare."""
        now = self.host.feedback().axes
        return [
            abs(way) - abs(axis.position)
            > stopping_way(
                np.sign(way) * axis.velocity, np.sign(way) * axis.acceleration, one
            ) + 5 * T * one.velocity
            for way, axis, one in zip(ways, now, limits, strict=True)
        ]  # fmt: skip

    def run(self, cycles: int) -> Array:
        """Velocities (rows, axes) from the first frame on."""
        self.frames.step(cycles)
        table: Array = self.frames.table["axis"]["velocity"] / T
        return table


@pytest.mark.parametrize("mode", ["time", "phase", "none"])
@pytest.mark.parametrize("axes", [1, 2, 3])
@pytest.mark.parametrize("at", [200, 400])
def test_override_0_3_at_250_falls_to_75_and_stays(mode: str, axes: int, at: int) -> None:
    """Until the braking for the goal, but for the part of a cycle; the others in proportion."""
    bench = Bench([PAPER] * axes, [300.0, 240.0, 150.0][:axes], mode, at)
    bench.host.override(0.3)
    velocity = bench.run(6000)[:, 0]
    left = 300.0 - bench.frames.table["axis"]["position"][:, 0]
    before = left > 75.0 * (75.0 / 2000.0 + 2000.0 / 15000.0)  # more than braking takes
    assert np.min(velocity[before]) >= 74.9
    assert np.min(velocity) >= -1e-9
    assert left[-1] == 0.0


def stopping_way(v: float, a: float, limits: Limits) -> float:
    """Shortest way to rest from v > 0, in continuous time, by Eqs. (2), (3), (5)."""
    way = 0.0
    D, J = limits.braking
    if a > 0.0:
        t = a / limits.jerk
        way, v, a = t * (v + a * t / 3), v + a * t / 2, 0.0
    a, peak = -a, min(D, np.sqrt(max(0.0, J * v + a * a / 2)))
    hold = (v - (peak**2 - a * a / 2) / J) / peak if peak > 0.0 else 0.0
    for t, j in ((max(0.0, (peak - a) / J), -J), (max(0.0, hold), 0.0), (peak / J, J)):
        way += t * (v - a * t / 2 + j * t * t / 6)
        v, a = v - a * t + j * t * t / 2, a - j * t
    return float(way)


@settings(max_examples=3 * SOME)
@example(
    drawn=[
        (40.0, 300.0, 3000.0, 1.0, 1.0, 10.0, False),
        (63.0, 300.0, 3000.0, 1.0, 1.0, 20.0, False),
    ],
    mode="time",
    at=265,
    factor=0.5,
    how="hold",
)
@given(
    st.lists(
        st.tuples(
            st.floats(40.0, 250.0), st.floats(300.0, 3000.0), st.floats(3e3, 3e4),
            st.floats(0.5, 2.0), st.floats(0.5, 2.0), st.floats(10.0, 60.0), st.booleans(),
        ),
        min_size=1, max_size=3,
    ),
    st.sampled_from(["time", "none"]),
    st.integers(20, 500),
    st.floats(0.2, 0.95),
    st.sampled_from(["override", "limits", "set_limits", "hold", "twice", "raised"]),
)  # fmt: skip
def test_no_axis_turns_that_has_room_to_stop(
    drawn: list[tuple[float, float, float, float, float, float, bool]],
    mode: str,
    at: int,
    factor: float,
    how: str,
) -> None:
    """An override, lower limits of a goal or of the axes, with a hold between, twice, and back: an
    axis whose braking is shorter than its way goes on forward, and every one ends on its goal.
    """
    limits = [
        Limits(v, a, j, deceleration=a * d, deceleration_jerk=j * dj)
        for v, a, j, d, dj, _, _ in drawn
    ]
    ways = [way if forward else -way for *_, way, forward in drawn]
    bench = Bench(limits, ways, mode, at)
    low = [replace(one, velocity=one.velocity * factor) for one in limits]
    room = bench.room(limits, ways)
    match how:
        case "override":
            bench.host.override(factor)
        case "limits":
            bench.host.move(ways, limits=dict(enumerate(low)), synchronization=mode)  # type: ignore[arg-type]
        case "set_limits":
            for i, one in enumerate(low):
                bench.host.set_limits(one, axes=i)
            bench.host.move(ways, synchronization=mode)  # type: ignore[arg-type]
        case "hold":
            bench.host.hold()
            bench.run(at % 60)
            bench.host.override(factor)
            bench.run(30)
            # what no feed can slow in time is held at its goal, and planned anew from here
            room = [a and b for a, b in zip(room, bench.room(limits, ways), strict=True)]
            bench.host.resume()
        case "twice":
            bench.host.override(factor)
            bench.run(at % 60)
            bench.host.override(factor * 0.6)
        case "raised":
            bench.host.override(factor)
            bench.run(at % 90)
            bench.host.override(1.0)
    for _ in range(60):
        velocity = bench.run(1000)
        if not any(axis.moving for axis in bench.host.feedback().axes):
            break
    for i, way in enumerate(ways):
        if room[i]:
            assert np.min(np.sign(way) * velocity[:, i]) >= -1e-7 * limits[i].velocity, i
        assert bench.host.feedback().axes[i].position == way
        assert np.max(np.abs(velocity[:, i])) <= limits[i].velocity * (1 + 1e-9)
