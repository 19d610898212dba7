"""Streams of target positions for the tests: closed form, sampled, rounded to increments."""

from __future__ import annotations

import math
from collections.abc import Iterator

REV = 16777216


def scurve_at(t: float, distance: float, v: float, a: float, j: float) -> float:
    """A jerk-limited move from rest to rest that reaches `v` and `a`; j = inf: a trapezoid."""
    ramp = a / j if math.isfinite(j) else 0.0
    rise = v / a + ramp
    cruise = distance / v - rise
    assert v / a >= ramp
    assert cruise >= 0
    if t > rise + cruise / 2:
        return (
            distance - scurve_at(2 * rise + cruise - t, distance, v, a, j)
            if (t < 2 * rise + cruise)
            else distance
        )
    if t <= 0:
        return 0.0
    if t >= rise:
        return v * rise / 2 + v * (t - rise)
    if t <= ramp:
        return j * t**3 / 6
    if t >= rise - ramp:
        rest = rise - t
        return v * rise / 2 - v * rest + j * rest**3 / 6
    shift = t - ramp / 2  # constant acceleration, begun half a jerk phase late
    return a * shift * shift / 2 + a * ramp * ramp / 24


def back_and_forth(
    seconds: float, period: float, distance: float, v: float, a: float, j: float
) -> Iterator[int]:
    """Targets in increments, moves of `distance` revolutions to and fro with a rest between."""
    ramp = a / j if math.isfinite(j) else 0.0
    one = distance / v + v / a + ramp + 0.05
    for k in range(round(seconds / period)):
        number, t = divmod(k * period, one)
        x = scurve_at(t, distance, v, a, j)
        yield round((x if number % 2 == 0 else distance - x) * REV)
