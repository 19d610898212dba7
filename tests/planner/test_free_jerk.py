"""Limits of acceleration only, ``jerk=inf``: trapezoids in whole cycles, wherever limits go."""

from __future__ import annotations

import math
import pickle
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers import planner_check as check
from helpers.exact import continuous
from helpers.loops import enabled
from sjerk import (
    Axis,
    GoalStream,
    InputError,
    Limits,
    Profile,
    State,
    follow_path,
    plan,
    plan_many,
    plan_velocity,
    scurve,
)
from sjerk.kernel import load
from sjerk.planner import Updater
from sjerk.recording import Frames

FREE = math.inf
FILE = """
cycle_time = 1e-3
[[axes]]
counts_per_unit = 1e6
drive = "ideal"
limits = { velocity = 2.0, acceleration = 4.0, jerk = inf }
"""
T = 1e-3


def freed(r: check.Requests) -> check.Requests:
    """The same requests without a limit of jerk."""
    limits = r.limits.copy()
    limits[:, [2, 4]] = FREE
    return check.Requests(r.start, r.target, limits)


def crossing(r: check.Requests, cycle_time: float) -> check.Requests:
    """With the jerk that crosses all the accelerations in a cycle: what nobody can exceed."""
    limits = r.limits.copy()
    limits[:, [2, 4]] = (limits[:, [1]] + limits[:, [3]]) / cycle_time
    return check.Requests(r.start, r.target, limits)


@pytest.mark.parametrize("asymmetric", [False, True], ids=["even", "uneven"])
@pytest.mark.parametrize("kind", check.KINDS)
@pytest.mark.parametrize("unit", list(check.UNITS))
def test_random_states_keep_velocity_and_acceleration_and_land(
    unit: str, kind: str, asymmetric: bool
) -> None:
    """The judge of the planner finds no limit exceeded and each goal met; none is refused."""
    rng = np.random.default_rng([len(unit), len(kind), asymmetric])
    n, cycle_time = 2000, float(10.0 ** rng.uniform(-4, -2))
    if unit == check.COARSE:
        r = check.draw_coarse(rng, n, kind, asymmetric=asymmetric, T=cycle_time)
    else:
        scale = check.UNITS[unit]
        r = check.draw(rng, n, kind, scale=scale, asymmetric=asymmetric, T=cycle_time)
    free = freed(r)
    made = check.whole(free, plan_many(r.start, r.target, free.limits, cycle_time), cycle_time)
    for name, values in check.judge(crossing(r, cycle_time), made, cycle_time).items():
        assert values.max() <= (1.0 + 1e-9 if name in "vaj" else 1e-9), name
    check.lands(r, made, cycle_time)


def test_in_rationals_the_plan_keeps_its_limits() -> None:
    """At every node and peak: velocity and acceleration, in rationals of the plan's numbers."""
    rng = np.random.default_rng(3)
    for _ in range(200):
        own = Limits(
            *(10.0 ** rng.uniform(-1, 1, 2)).tolist(), FREE, float(10 ** rng.uniform(-1, 1))
        )
        goal = State(rng.normal(), float(rng.uniform(-1, 1) * own.velocity))
        profile = plan(State(0.0, float(rng.uniform(-1, 1) * own.velocity)), goal, own, T)
        P, V, A = Fraction(0), Fraction(profile.start.velocity), Fraction(0)
        most = Fraction(max(own.acceleration, own.braking[0])) * Fraction(1 + 1e-9)
        for phase in profile.phases:
            jerk, time = Fraction(phase.jerk), phase.cycles * Fraction(T)
            end = continuous(P, V, A, [(time, jerk)])[0]
            assert abs(end.A) <= most
            peaks = [end.V] + ([V - A * A / (2 * jerk)] if A * end.A < 0 else [])
            assert max(map(abs, peaks)) <= Fraction(own.velocity) * Fraction(1 + 1e-9)
            P, V, A = end.P, end.V, end.A


@pytest.mark.parametrize("kind", ["rest", "start"])
def test_it_takes_few_cycles_more_than_in_continuous_time(kind: str) -> None:
    """Over ruckig's optimum with an infinite jerk: half within 2.5 cycles, 99 % within 4."""
    ruckig = pytest.importorskip("ruckig")
    r = check.draw(np.random.default_rng(8), 2000, kind)
    r.start[:, 2] = 0.0
    free = freed(r)
    made = plan_many(r.start, r.target, free.limits, T)
    otg, x, out = ruckig.Ruckig(1), ruckig.InputParameter(1), ruckig.Trajectory(1)
    h, V, _, v1, _, _ = check.in_cycles(r, T)
    extra = []
    for i, row in enumerate(free.limits.tolist()):
        x.current_position, x.target_position = [0.0], [h[i]]
        x.current_velocity, x.target_velocity = [V[i] / T], [v1[i] / T]
        x.max_velocity, x.max_acceleration, x.max_jerk = [row[0]], [row[1]], [FREE]
        otg.calculate(x, out)
        extra.append(made.cycles[i] - out.duration / T)
    assert min(extra) > -1e-3
    assert np.median(extra) <= 2.5
    assert np.percentile(extra, 99) <= 4.0
    assert max(extra) <= 12.0


def test_everything_of_the_planner_takes_it() -> None:
    """Several axes, in phase, exact cruise, a given duration, changes of velocity, loops."""
    own = Limits(2.0, 4.0, FREE, deceleration=8.0)
    assert own.braking == (8.0, FREE)
    assert pickle.loads(pickle.dumps(own)) == own
    ends: list[Profile] = [
        *plan([0.0, 0.0], [1.0, -3.0], own, T),
        *plan([0.0, 0.0], [1.0, -3.0], [own, Limits(2.0, 4.0, 50.0)], T, synchronization="phase"),
        plan(0.0, 3.0, own, T, cruise="exact"),
        plan(0.0, 1.0, own, T, min_duration=3.0),
        plan(0.0, 1.0, Limits(2.0, 4.0, FREE, deceleration_jerk=30.0), T),
        plan(0.0, 1.0, Limits(2.0, 4.0, 30.0, deceleration_jerk=FREE), T),
        plan_velocity(State(0.0, 2.0), -1.0, own, T),
        scurve(1.0, own, T),
    ]
    for profile in ends:
        samples = profile.sample()
        assert np.isfinite(samples.position).all()
        assert samples.position[-1] == profile.end.position
        assert np.abs(samples.velocity).max() <= 2.0 * (1 + 1e-9)
        assert np.abs(samples.acceleration).max() <= 8.0 * (1 + 1e-9)
    loop = Updater([0.0], own, T)
    while not (step := loop.update([1.0])).done:
        assert abs(step.acceleration[0]) <= 8.0 * (1 + 1e-9)
    rows = [[2.0, 4.0, FREE], [2.0, 4.0, 50.0]]
    many = plan_many([0.0, 0.0], [1.0, 1.0], np.array(rows), T)
    assert many.cycles.tolist() == [plan(0.0, 1.0, Limits(*row), T).cycles for row in rows]
    listed = plan_many([0.0], [1.0], [Limits(2.0, 4.0, FREE)], T)
    assert listed.cycles[0] == many.cycles[0]


@pytest.mark.parametrize("column", [0, 1, 3])
def test_only_a_jerk_may_be_infinite(column: int) -> None:
    """Velocity and accelerations that are infinite are refused with their name; so is minus inf."""
    row: list[Any] = [2.0, 4.0, 50.0, 4.0, 50.0]
    row[column] = FREE
    with pytest.raises(InputError, match="inf"):
        Limits(*row)
    with pytest.raises(InputError, match=r"limits\[0\]"):
        plan_many([0.0], [1.0], np.array([row]), T)
    for bad in (-FREE, math.nan):
        with pytest.raises(InputError, match="jerk"):
            Limits(2.0, 4.0, bad)
        with pytest.raises(InputError, match=r"limits\[0\]"):
            plan_many([0.0], [1.0], np.array([[2.0, 4.0, bad]]), T)


def test_motions_through_many_points_say_that_they_need_a_jerk() -> None:
    """Streams and followed trajectories refuse it by name, never with what is no number."""
    free = Limits(2.0, 4.0, FREE)
    for name, own in (("jerk", free), ("deceleration_jerk", Limits(2.0, 4.0, 50.0, 4.0, FREE))):
        with pytest.raises(InputError, match=rf"limits\[1\]\.{name} = inf: must be finite"):
            GoalStream([Limits(2.0, 4.0, 50.0), own], T, [0.0, 0.0], period=0.1)
        with pytest.raises(InputError, match=rf"limits\[0\]\.{name} = inf: must be finite"):
            list(follow_path([[0.0], [1.0], [2.0]], own, T))


def test_a_kernel_moves_jogs_and_stops_under_it() -> None:
    """Random moves, jogs, overrides and stops: within velocity and acceleration, to the goal."""
    rng = np.random.default_rng(4)
    for _ in range(10):
        v, a = (float(10.0 ** rng.uniform(*range_)) for range_ in ((-1, 1), (0, 1.5)))
        own, stop = Limits(v, a, FREE), Limits(v, 2.0 * a, FREE)
        kernel, host = enabled([Axis(own, 1e6, "ideal", stop_limits=stop)], T)
        assert host.limits[0] == own
        frames = Frames(kernel)
        for _ in range(12):
            what = rng.choice(["move", "jog", "halt", "quick_stop", "override", "lower", "line"])
            if what == "move":
                host.move(float(rng.normal()))
            elif what == "line":
                host.move(State(float(rng.normal()), float(rng.uniform(-0.5, 0.5) * v)))
            elif what == "jog":
                host.jog(float(rng.uniform(-1, 1) * v))
            elif what == "override":
                host.override(float(rng.uniform(0.3, 1.0)))
            elif what == "lower":
                host.set_limits(Limits(v, a * float(rng.uniform(0.5, 1)), FREE))
            else:
                getattr(host, what)()
            frames.step(int(rng.integers(1, 400)))
        host.override(1.0)
        host.move(0.25)
        kernel.step(int(20 / T / min(v, 1)))
        assert host.feedback().axes[0].position == 0.25
        axis = frames.table["axis"]
        assert np.isfinite(axis["position"]).all()
        assert np.abs(axis["velocity"]).max() <= v * T * (1 + 1e-9)
        assert np.abs(axis["acceleration"]).max() <= 2.0 * a * T**2 * (1 + 1e-9)


def test_a_file_has_it(tmp_path: Path) -> None:
    """``jerk = inf`` in the TOML file of a kernel."""
    path = tmp_path / "free.toml"
    path.write_text(FILE)
    assert load(path).axes[0].limits == Limits(2.0, 4.0, FREE)
