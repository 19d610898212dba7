"""Control points on knots of their own: the best plan is found on edges of what is allowed too."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from sjerk import Limits
from sjerk.trajectory.horizon import Aims, Horizon, Plan


def arrival(end: float, speed: float, knots: int, high: float) -> Plan:
    """From rest to rest at ``end`` through one goal on the way, inside 0 .. ``high``."""
    limits = [Limits(speed, 2.5 * speed, 20.0 * speed)]
    horizon = Horizon(limits, 1e-3, 44, np.zeros(1), smoothing=0.1, iterations=60)
    aims = Aims(
        moment=np.array([22.0, 44.0]),
        weight=np.ones(2),
        position=np.array([[0.3 * end], [end]]),
        slope=np.zeros((2, 1)),
        velocity=None,
        range=np.array([[0.0, high]]),
        rest=np.array([[-np.inf, np.inf]]),
        direction=np.zeros((1, knots), np.int32),
        turning=np.zeros((1, knots), np.bool_),
        end=np.array([end]),
        ended=True,
    )
    return horizon.solve(aims, knots, np.arange(knots + 1.0), paced=False, ends=True)


@settings(max_examples=25)
@given(st.floats(0.5, 1.5), st.floats(2.0, 3.0), st.integers(50, 60))
def test_an_end_on_the_edge_of_the_range_costs_nothing(end: float, speed: float, n: int) -> None:
    """Rest on the largest position allowed: goals are met as closely as if more were allowed."""
    on_the_edge, free = (arrival(end, speed, n, high) for high in (end, 2.0 * end))
    assert on_the_edge.share.all()
    assert free.share.all()
    assert np.abs(on_the_edge.deviation).max() <= np.abs(free.deviation).max() + 2e-4 * end
