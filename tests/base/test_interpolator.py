"""The interpolator itself: steps against batches, the lemma both ways, settling, refusals."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from helpers.exact import Sample
from helpers.strategies import cycle_times, limits, magnitudes
from sjerk import InputError, Limits, Profile, Samples, scurve
from sjerk._binding import ffi, lib

numbers = st.floats(-1e6, 1e6).filter(lambda x: x == 0.0 or abs(x) > 1e-30)


def stepped(profile: Profile) -> Any:
    """An interpolator that has just taken over the profile."""
    T = profile.cycle_time
    ip = ffi.new("sj_interpolator *")
    start, end = profile.start, profile.end
    lib.sj_interpolator_start(ip, ffi.new("sj_state *", (start.position, start.velocity * T, 0.0)))
    plan = profile.c_plan
    assert lib.sj_interpolator_load(ip, plan, end.position, end.velocity * T, 0) == lib.SJ_LOAD_OK
    return ip


@given(limits(), cycle_times, magnitudes(-6, 6), st.floats(0.0, 1.0))
@example(Limits(1.0, 1.0, 4.0), 2e-3, 1e-4, 0.0)  # a sample midway between two doubles
@example(Limits(478300648.0, 62.06630597537911, 32.0), 1e-3, 1e-4, 0.0)
@example(Limits(133.11568387331658, 48.0, 256.0), 0.0009765625, 1e-4, 0.0)
def test_single_steps_and_the_batch_give_the_same_bits(
    limit: Limits, cycle_time: float, distance: float, end: float
) -> None:
    """What the kernel sends cycle by cycle is what sample() returns."""
    try:
        profile = scurve(distance, limit, cycle_time, v_end=end * limit.velocity)
    except (InputError, ValueError):
        profile = scurve(distance, limit, cycle_time)
    rows = min(profile.cycles + 2, 30_000)
    ip = stepped(profile)
    positions = [ip.q.hi]
    for _ in range(rows - 1):
        lib.sj_interpolator_step(ip)
        positions.append(ip.q.hi)
    table, out = ffi.new("sj_table *"), Samples.empty(rows)
    table.rows = rows
    for name in ("time", "position", "velocity", "acceleration", "jerk"):
        setattr(table, name, ffi.from_buffer("double[]", getattr(out, name)))
    lib.sj_interpolator_fill(stepped(profile), cycle_time, 1, table)
    assert positions[1:] == out.position[1:].tolist()


@given(numbers, numbers, numbers, numbers)
def test_the_lemma_holds_both_ways(q: float, v: float, a: float, j: float) -> None:
    """Sample to plan equals the rational lemma to the last bits, and back is the identity."""
    sample, plan, back = (ffi.new("sj_state *") for _ in range(3))
    sample.position, sample.velocity, sample.acceleration = q, v, a
    lib.sj_lemma_plan(sample, j, plan)
    expected = Sample(Fraction(q), Fraction(v), Fraction(a), Fraction(j)).plan()
    found = (plan.position, plan.velocity, plan.acceleration)
    size = max(abs(q), abs(v), abs(a), abs(j))
    room = Fraction(size) / 2**100  # a double-double ends there: midway it may round either way
    for exact, near in zip(expected, found, strict=True):
        assert abs(Fraction(near) - exact) <= Fraction(math.ulp(near)) / 2 + room
    lib.sj_lemma_sample(plan, j, back)
    for x, y in ((q, back.position), (v, back.velocity), (a, back.acceleration)):
        assert abs(x - y) <= 4 * np.spacing(size)


def test_the_lemma_stays_true_from_cycle_to_cycle() -> None:
    """Rational: integrating either form, Eqs. (1) and (15), keeps the lemma."""
    sample = Sample(Fraction(3), Fraction(2), Fraction(1, 2), Fraction(7))
    P, V, A = sample.plan()
    for k in range(200):
        J = Fraction((k * 37) % 101 - 50, 3)
        P, V, A = P + V + A / 2 + J / 6, V + A + J / 2, A + J
        sample = sample.step(J)
        assert sample.plan() == (P, V, A)


def test_a_settled_motion_goes_on_with_its_end_velocity() -> None:
    """After cycle N + 1 the position grows by v_end per cycle, exactly."""
    profile = scurve(10.0, Limits(1.0, 2.0, 8.0), 0.125, v_end=0.5)
    ip = stepped(profile)
    for k in range(profile.cycles + 1):
        assert lib.sj_interpolator_step(ip) == (k < profile.cycles)
    assert (ip.q.hi, ip.v.hi, ip.a.hi) == (10.0, 0.0625, 0.0)
    for k in range(1, 9):
        assert lib.sj_interpolator_step(ip) == 0
        assert ip.q.hi == 10.0 + k * 0.0625


def test_a_refused_plan_leaves_the_interpolator_as_it_was() -> None:
    """A running motion is not disturbed by a plan that does not fit."""
    profile = scurve(1.0, Limits(1.0, 2.0, 8.0), 1e-3)
    ip = stepped(profile)
    for _ in range(100):
        lib.sj_interpolator_step(ip)
    before = bytes(ffi.buffer(ip))
    plan = profile.c_plan
    assert lib.sj_interpolator_load(ip, plan, 1.0, 0.0, 0) == lib.SJ_LOAD_MISSES
    wrong = ffi.new("sj_plan *")
    for count, cycles in ((-1, 0), (lib.SJ_PHASES + 1, 1), (1, 0), (1, 2**62)):
        wrong.count, wrong.cycles, wrong.phase[0].cycles = count, cycles, cycles
        assert lib.sj_interpolator_load(ip, wrong, 1.0, 0.0, 0) == lib.SJ_LOAD_PHASES
    assert bytes(ffi.buffer(ip)) == before


@pytest.mark.parametrize("rows", [0, 1, 2, 5, 255, 256, 257, 1000])
def test_any_chunk_of_a_motion_is_the_same(rows: int) -> None:
    """Filling in pieces gives the rows of filling at once."""
    profile = scurve(3.0, Limits(1.0, 2.0, 8.0), 1e-3)
    whole = profile.sample()
    ip = stepped(profile)
    first = Samples.empty(1 + rows)
    rest = Samples.empty(profile.cycles + 2)
    for out, start in ((first, 1), (rest, 1 + rows)):
        table = ffi.new("sj_table *")
        table.rows = len(out.time)
        for name in ("time", "position", "velocity", "acceleration", "jerk"):
            setattr(table, name, ffi.from_buffer("double[]", getattr(out, name)))
        lib.sj_interpolator_fill(ip, 1e-3, start, table)
    assert first.position[1:].tolist() == whole.position[1 : 1 + rows].tolist()
    assert rest.position[1 + rows :].tolist() == whole.position[1 + rows :].tolist()
