"""Whether whole cycles can keep a velocity limit: the planner's rule against the judge's own."""

from __future__ import annotations

import numpy as np
import pytest

from helpers import planner_check as check
from sjerk import Limits, State, plan
from sjerk._binding import ffi, lib

T = 1e-3
STATES = 20_000


def verdicts(V: check.Array, A: check.Array, limits: check.Array) -> np.ndarray:
    """`sj_plan_keeps` of many; the first limits are those on the acceleration's side."""
    own = ffi.new("sj_limits *")
    found = []
    for v, a, row in zip(V.tolist(), A.tolist(), limits.tolist(), strict=True):
        own.velocity, own.acceleration, own.jerk, own.deceleration, own.deceleration_jerk = row
        found.append(lib.sj_plan_keeps(v, a, own))
    return np.array(found, bool)


@pytest.mark.parametrize("asymmetric", [False, True])
@pytest.mark.parametrize("unit", list(check.UNITS))
@pytest.mark.parametrize("lowered", [1.0, 0.5, 0.05])
def test_the_rule_decides_as_the_judge_does(unit: str, asymmetric: bool, lowered: float) -> None:
    """Starts within their limits, also at their edge, and under limits lowered on the way; both
    verdicts of the judge at a limit 1e-9 less and more have the planner's between them.
    """
    rng = np.random.default_rng(int(lowered * 100) + 7 * asymmetric + 13 * len(unit))
    if unit == check.COARSE:
        r = check.draw_coarse(rng, STATES, "start", asymmetric=asymmetric, T=T)
    else:
        r = check.draw(rng, STATES, "start", scale=check.UNITS[unit], asymmetric=asymmetric, T=T)
    _, V, A, _, limits, _ = check.in_cycles(r, T)
    limits = limits * np.array([1.0, 1.0, lowered, 1.0, lowered])
    turning = check.Turning(V, A, limits, np.where(A < 0, -1.0, 1.0))
    found = verdicts(V, A, limits)
    vmax = limits[:, 0]
    sure, possible = turning.keeps(vmax * (1 - 1e-9)), turning.keeps(vmax * (1 + 1e-9))
    wrong = (sure & ~found) | (found & ~possible)
    assert not wrong.any(), (V[wrong][:3], A[wrong][:3], limits[wrong][:3], found[wrong][:3])
    assert (sure != possible).mean() < 0.2
    if lowered < 1.0 or unit == check.COARSE:
        assert 0.001 < found.mean() < 0.9999
    if unit == check.COARSE:
        one = turning.v + turning.left / 2 <= vmax
        assert (found & ~one).sum() > 10  # kept by crossing zero alone
        assert (limits[:, 2] > limits[:, 1]).sum() > 1000  # a cycle of jerk beyond all acceleration


def test_a_start_at_its_velocity_limit_crosses_zero_as_gently_as_the_rule_allows() -> None:
    """Its room is the rounding of the limit; with the most jerk the way back is 11 % too fast."""
    start = State(-77938.99418885127, -407445835.18527544, -225481.6106106558)
    target = State(130086396.04140195, -210692605.1725983)
    V = 407445947.92608094
    A, J, D, L = 984029173544.5106, 1.2826353736931008e17, 332052349034.73126, 8.656341158872474e17
    made = plan(start, target, Limits(V, A, J, D, L), 1e-3)
    request = check.Requests(
        np.array([[start.position, start.velocity, start.acceleration]]),
        np.array([[target.position, target.velocity]]),
        np.array([[V, A, J, D, L]]),
    )
    rows = np.frombuffer(check.ffi.buffer(made.c_plan), dtype=check.PLAN).copy()
    worst = check.judge(request, rows, 1e-3)
    assert all(worst[name][0] <= check.WITHIN for name in "vaj")
