"""Sentences about streams that hold for any of them, each against a judge of its own."""

from __future__ import annotations

import math
import random
from dataclasses import replace
from fractions import Fraction

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.stream_check import Array, Draw, Outcome, drawn, judge, one_way, play
from sjerk import Limits, State, plan
from sjerk.trajectory.known import Known

T = 1e-3


@settings(max_examples=10)
@given(st.integers(0, 2**31))
def test_a_lag_ends_as_soon_as_a_planner_to_any_target_allows(seed: int) -> None:
    """A stall longer than the motion, then all goals at once: to the last one in a plan's time.

    And a knot: what comes in one is planned in the next. The goals lie on one line.
    """
    rng = random.Random(seed)
    joints = rng.choice([1, 1, 3])
    draw = one_way(rng.uniform(0.4, 1.0), 0.05, rng.randint(1, 6), within=True, joints=joints)
    stalled = rng.randrange(1, len(draw.times))
    arrivals = draw.times.copy()
    arrivals[stalled:] = draw.times[-1] + 3.0
    stream, found = play(replace(draw, arrivals=arrivals))
    judged = judge(draw, found)
    assert judged["end"]
    assert judged["over"] <= 1 + 1e-9
    assert judged["turns"] <= 0
    rest = [State(x) for x in draw.goals[max(stalled - 1, 0)].tolist()]
    last = [State(x) for x in draw.goals[-1].tolist()]
    needed = plan(rest, last, draw.limits, T).cycles
    moving = [b.first_cycle + int(b.cycles.sum()) for b in found.blocks if b.jerk.any()]
    came = float(arrivals[-1] - arrivals[1]) if stalled > 1 else 0.0
    due = round(float(draw.times[-1] - draw.times[1] + draw.delay * draw.period) / T)
    soonest = max(round(came / T) + needed, due)
    assert moving[-1] <= soonest + round(stream.knot / T) + 3


def at_their_times(draw: Draw, found: Outcome, times: Array) -> Array:
    """Where the motion is when goals of these times are due, in shares of the way."""
    rows = np.concatenate([block.sample().position for block in found.blocks])
    rows = rows[-sum(int(block.cycles.sum()) for block in found.blocks) :]
    due = np.round((times - draw.times[1]) / T).astype(int) + round(draw.delay * draw.period / T)
    return np.asarray(rows[np.minimum(due, len(rows)) - 1] / draw.goals[-1])


@settings(max_examples=6)
@given(st.floats(0.4, 0.8), st.integers(2, 20), st.booleans())
def test_how_often_goals_come_changes_nothing(share: float, often: int, within: bool) -> None:
    """A recording sampled more often: the same motion to 2e-3 of the way, the end within a knot."""
    ways, late = [], []
    for period in (0.1, 0.1 / often):
        draw = one_way(share, round(period / T) * T, 1, within=within)
        delay = math.ceil(1.5 * draw.stop / draw.period) + 1
        draw = replace(draw, delay=delay)
        _, found = play(draw, smoothing=1e-4)
        ways.append(at_their_times(draw, found, np.arange(0.1, float(draw.times[-1]), 0.1)))
        late.append(found.late / draw.stop)
    assert np.abs(ways[0] - ways[1]).max() <= 2e-3
    assert abs(late[0] - late[1]) <= 1.1 / 12


@settings(max_examples=8)
@given(st.integers(0, 2**31), st.randoms(use_true_random=False))
def test_the_order_of_joints_changes_nothing(seed: int, rng: random.Random) -> None:
    """Joints in another order: the same motion of each, but for what rounding decides."""
    draw = drawn(random.Random(seed))
    if len(draw.limits) == 1 or not 2 < len(draw.times) < 80:
        return
    order = list(range(len(draw.limits)))
    rng.shuffle(order)
    other = replace(
        draw,
        limits=[draw.limits[k] for k in order],
        goals=draw.goals[:, order],
        count=draw.count[order],
        velocities=None if draw.velocities is None else draw.velocities[:, order],
    )
    one, two = (
        np.concatenate([block.sample().position for block in play(each)[1].blocks])
        for each in (draw, other)
    )
    way, n = np.ptp(draw.goals, axis=0) + 1e-300, min(len(one), len(two))
    assert abs(len(one) - len(two)) <= draw.stop / 12 / draw.T + 1
    assert (np.abs(one[:n, order] - two[:n]) / way[order]).max() <= 1e-3


@settings(max_examples=6)
@given(st.integers(0, 2**31))
def test_limits_hold_in_rationals(seed: int) -> None:
    """Jerks handed out, summed as fractions from rest: no limit passed, between cycles neither."""
    draw = drawn(random.Random(seed))
    if not 2 < len(draw.times) < 200:
        return
    _, found = play(draw)
    T_ = Fraction(draw.T)
    for k, limit in enumerate(draw.limits):
        V_ = A_ = Fraction(0)
        most = [
            Fraction(x) * (1 + Fraction(1, 10**9))
            for x in (
                limit.velocity,
                min(limit.acceleration, limit.braking[0]),
                min(limit.jerk, limit.braking[1]),
            )
        ]
        for block in found.blocks:
            for lengths, jerks in zip(block.lengths.tolist(), block.jerk[:, :, k], strict=True):
                for n, jerk in zip(lengths, jerks.tolist(), strict=True):
                    J, t = Fraction(jerk), n * T_
                    assert abs(J) <= most[2]
                    end = A_ + J * t
                    if A_ * end < 0:  # the velocity's peak
                        assert abs(V_ - A_ * A_ / (2 * J)) <= most[0]
                    V_, A_ = V_ + t * (A_ + end) / 2, end
                    assert abs(V_) <= most[0]
                    assert abs(A_) <= most[1]
        assert abs(V_) <= most[0] / 10**9


@settings(max_examples=60)
@given(st.integers(0, 2**31))
def test_noise_is_what_no_motion_within_the_limits_explains(seed: int) -> None:
    """Nothing where goals are exact; of goals in counts never more than half of one."""
    rng = random.Random(seed)
    unit = 10.0 ** rng.uniform(-3, 3)
    v, a, j = rng.uniform(0.5, 3.0), rng.uniform(1.0, 20.0), rng.uniform(10.0, 400.0)
    limits = Limits(unit * v, unit * a, unit * j)
    way = plan(0.0, unit * rng.choice([-1, 1]) * rng.uniform(0.1, 5.0), limits, T).sample().position
    rows = np.unique([rng.randrange(len(way)) for _ in range(rng.randint(5, 400))])
    table = np.array([[limits.velocity * T, limits.acceleration * T**2, limits.jerk * T**3]])
    count = unit * 10.0 ** rng.uniform(-6, -2)
    for goals, most in ((way, 1e-12 * unit), (np.round(way / count) * count, count / 2)):
        known = Known(goals[rows[:1]], int(rows[0]), 0.0)
        for row in rows[1:].tolist():
            known.add(goals[row : row + 1], float(row), row * T, None)
        assert known.noise(1e9, table)[0] <= most * (1.0 + 1e-6)
