"""What tests draw: limits, distances and cycle times from radians to encoder increments."""

from __future__ import annotations

from typing import Any

from hypothesis import strategies as st

from sjerk import Limits


def magnitudes(low: float, high: float) -> st.SearchStrategy[float]:
    """Floats spread evenly over the decades from 10**low to 10**high, round ones among them."""
    return st.floats(low, high).map(lambda e: 10.0**e) | st.integers(int(low), int(high)).map(
        lambda e: 10.0**e
    )


@st.composite
def limits(draw: Any, *, scale: float = 1.0, asymmetric: bool = True) -> Limits:
    """Limits of a real axis (ramps of 1 ms to 10 s), in a unit of `scale` to the natural one."""
    velocity = draw(magnitudes(-2, 2))
    acceleration = velocity * draw(magnitudes(-1, 3))
    jerk = acceleration * draw(magnitudes(-1, 4))
    other = st.none() | magnitudes(-1, 1) if asymmetric else st.none()
    braking, braking_jerk = draw(other), draw(other)
    return Limits(
        velocity * scale,
        acceleration * scale,
        jerk * scale,
        None if braking is None else acceleration * braking * scale,
        None if braking_jerk is None else jerk * braking_jerk * scale,
    )


units = st.sampled_from([1.0, 57.3, 1e3, 2670176.85, 1e-3])
cycle_times = st.sampled_from([50e-6, 100e-6, 250e-6, 1e-3, 2e-3, 10e-3]) | st.floats(50e-6, 10e-3)
