"""Targets that move on: met within a cycle on their line, and as soon as continuous time allows."""

from __future__ import annotations

import re

import numpy as np
import pytest
import ruckig

from helpers import planner_check as check
from sjerk import Axis, Host, InputError, Limits, MotionKernel, State, plan, simulate
from sjerk.planner import Updater

T = 1e-3
REQUESTS = 1500
LIMITS = Limits(2.175, 7.5, 500.0)


def drawn(unit: str, asymmetric: bool) -> check.Requests:
    """Half of them with the target as near as a moving start can just meet it."""
    rng = np.random.default_rng(31 + 7 * asymmetric + len(unit))
    if unit == check.COARSE:
        r = check.draw_coarse(rng, REQUESTS, "target", asymmetric=asymmetric, T=T)
    else:
        scale = check.UNITS[unit]
        r = check.draw(rng, REQUESTS, "target", scale=scale, asymmetric=asymmetric, T=T)
    k = len(r) // 2
    most = r.limits[:k, 0]
    r.target[:k, 0] = r.start[:k, 0] + r.start[:k, 1] * T * rng.uniform(1.0, 60.0, k)
    r.target[:k, 1] = np.clip(r.start[:k, 1] * (1.0 + 0.1 * rng.normal(size=k)), -most, most)
    return r


def optimum(r: check.Requests) -> np.ndarray:
    """Cycles that continuous time needs, by ruckig."""
    otg, out = ruckig.Ruckig(1), ruckig.Trajectory(1)
    h, V, A, v1, _, _ = check.in_cycles(r, T)
    found = []
    for i in range(len(r)):
        x = ruckig.InputParameter(1)
        x.current_position, x.target_position = [0.0], [h[i]]
        x.current_velocity, x.current_acceleration = [V[i] / T], [A[i] / T**2]
        x.target_velocity = [v1[i] / T]
        x.max_velocity, x.max_acceleration = [r.limits[i, 0]], [r.limits[i, 1]]
        x.max_jerk = [r.limits[i, 2]]
        otg.calculate(x, out)
        found.append(out.duration / T)
    return np.array(found)


@pytest.mark.parametrize("asymmetric", [False, True])
@pytest.mark.parametrize("unit", list(check.UNITS))
def test_met_on_its_line_within_a_cycle_and_never_later_than_exactly(
    unit: str, asymmetric: bool
) -> None:
    """Any scale and limits: g + v x with 0 <= x <= T, no longer than to g, limits kept as there."""
    r = drawn(unit, asymmetric)
    met = sooner = 0
    for start, target, limits in zip(r.start, r.target, r.limits, strict=True):
        s, t, own = State(*start.tolist()), State(*target.tolist()), Limits(*limits.tolist())
        exact, moving = plan(s, t, own, T), plan(s, t, own, T, moving=True)
        ahead = moving.end.position - t.position
        size = 1e-9 * (abs(t.position - s.position) + abs(t.velocity) * T)
        assert -size <= ahead * np.sign(t.velocity) <= abs(t.velocity) * T + size
        assert moving.end.velocity == t.velocity
        assert moving.cycles <= exact.cycles
        rows = moving.sample()
        assert rows.position[-1] == moving.end.position
        high = moving.extrema()
        before = exact.extrema()
        top = max(own.velocity, *map(abs, before.velocity))
        assert max(map(abs, high.velocity)) <= top * check.WITHIN
        steep = max(own.acceleration, own.braking[0], *map(abs, before.acceleration))
        assert max(map(abs, high.acceleration)) <= steep * check.WITHIN
        assert max(map(abs, high.jerk)) <= max(own.jerk, own.braking[1]) * check.WITHIN
        met += ahead != 0.0
        sooner += moving.cycles < exact.cycles
    assert sooner > 5
    assert met >= sooner


def test_as_soon_as_continuous_time_allows() -> None:
    """Within four cycles of ruckig's optimum, all of them; to g itself some take thousands more."""
    r = drawn("radians", asymmetric=False)
    best = optimum(r)
    rows = [
        (State(*s), State(*t), Limits(*k))
        for s, t, k in zip(r.start.tolist(), r.target.tolist(), r.limits.tolist(), strict=True)
    ]
    moving = np.array([plan(s, t, k, T, moving=True).cycles for s, t, k in rows])
    exact = np.array([plan(s, t, k, T).cycles for s, t, k in rows])
    assert (moving - best).max() <= 4.0
    assert (exact - best).max() > 100.0


def sine(t: float) -> State:
    """0.5 (1 - cos pi t) with its velocity."""
    return State(0.5 * float(1.0 - np.cos(np.pi * t)), 0.5 * np.pi * float(np.sin(np.pi * t)))


@pytest.mark.parametrize("every", [3, 10])
def test_a_kernel_tracks_as_the_planner_does(every: int) -> None:
    """Host.move in a simulated kernel: the same motion as plans from row to row."""

    def script(cycle: int, host: Host) -> None:
        if cycle == 1:
            host.enable()
        if cycle >= 10 and (cycle - 10) % every == 0:
            host.move(sine((cycle - 10) * T), moving=True)

    kernel = MotionKernel([Axis(LIMITS, 2**24 / 360, "ideal")], T)
    rows = simulate(kernel, script, 2010).position[:, 0]
    state, left, own = State(0.0), None, []
    for k in range(1900):
        if k % every == 0:
            state = state if left is None else left.state(every)
            left = plan(state, sine(k * T), LIMITS, T, moving=True)
            own.extend(left.sample().position[1 : every + 1].tolist())
        assert left is not None
    first = int(np.flatnonzero(rows != 0.0)[0]) - int(np.flatnonzero(own)[0])
    shown = np.array(own[:1800])
    assert len(shown) == 1800
    assert np.abs(rows[first : first + 1800] - shown).max() < 1e-9
    assert np.abs(np.diff(shown)).max() <= LIMITS.velocity * T * check.WITHIN


@pytest.mark.parametrize("every", [3, 5, 10, 20])
def test_a_sine_told_as_it_moves_is_followed_without_swinging_back(every: int) -> None:
    """With its velocity every few cycles: within 4 % of its way in the mean; to g itself 10 %."""
    errors = []
    for moving in (True, False):
        loop, rows = Updater([0.0], LIMITS, T, moving=moving), []
        for k in range(4000):
            if k % every == 0:
                target = sine(k * T)
            rows.append(float(loop.update([target]).position[0]))
        true = [sine(k * T).position for k in range(1, 4001)]
        errors.append(float(np.sqrt(np.mean(np.subtract(rows, true)[1000:] ** 2))))
    assert errors[0] <= 0.04
    assert errors[1] > 0.1


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"moving": 1}, "moving = 1: must be True or False"),
        ({"moving": True, "min_duration": 1.0}, "min_duration = 1000: must be 0 cycles"),
        ({"moving": True, "cruise": "exact"}, "cruise = 'exact': must be 'fast'"),
    ],
)
def test_what_does_not_go_together_is_refused(options: dict[str, object], said: str) -> None:
    """With field, value and limit."""
    with pytest.raises(InputError, match=re.escape(said)):
        plan(0.0, State(1.0, 0.5), LIMITS, T, **options)  # type: ignore[call-overload]


def test_several_axes_meet_their_targets_each_by_itself() -> None:
    """As alone; sharing the time is refused, and so is a target with an acceleration."""
    targets = [State(1.0, 0.5), State(-0.01, -2.0)]
    both = plan([0.0, 0.0], targets, LIMITS, T, synchronization="none", moving=True)
    alone = [plan(0.0, target, LIMITS, T, moving=True) for target in targets]
    assert [axis.phases for axis in both] == [axis.phases for axis in alone]
    assert [axis.end for axis in both] == [axis.end for axis in alone]
    with pytest.raises(InputError, match="synchronization = 'time': must be 'none'"):
        plan([0.0, 0.0], targets, LIMITS, T, moving=True)
    with pytest.raises(InputError, match=re.escape("target[0].acceleration = 1.0: must be 0")):
        plan(0.0, State(1.0, 0.5, 1.0), LIMITS, T, moving=True)
