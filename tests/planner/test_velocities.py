"""Changes of velocity of several axes: in time, in phase, each for itself."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sjerk import InputError, Limits, State, plan_velocity
from sjerk.planner import Motion

T = 1e-3
Drawn = tuple[list[State], list[float], list[Limits]]


@st.composite
def axes(draw: st.DrawFn, *, steady: bool = False) -> Drawn:
    """2 to 6 axes of any scale, starts inside their limits, any velocities."""
    starts, velocities, limits = [], [], []
    for _ in range(draw(st.integers(2, 6))):
        v = 10.0 ** draw(st.floats(-3, 6))
        a = v * 10.0 ** draw(st.floats(-1, 2))
        j = a * 10.0 ** draw(st.floats(0, 3))
        more = [10.0 ** draw(st.floats(-1, 1)) for _ in range(2)] if draw(st.booleans()) else [1, 1]
        limits.append(Limits(v, a, j, a * more[0], j * more[1]))
        share = draw(st.floats(-1, 1))
        starts.append(
            State(v * draw(st.floats(-1e3, 1e3)), 0.4 * v * share if not steady else v * share)
        )
        if not steady:
            small = min(a, a * more[0], np.sqrt(v * min(j, j * more[1]) * 0.5), 0.2 * v / T)
            last = starts[-1]
            push = float(small * draw(st.floats(-1, 1)))
            starts[-1] = State(last.position, last.velocity, push)
        velocities.append(v * draw(st.floats(-1, 1) | st.sampled_from([0.0, 1.0, -1.0])))
    return starts, velocities, limits


def held(motion: Motion, limits: list[Limits]) -> None:
    """Every limit, inside phases as well, each in its direction."""
    for profile, own in zip(motion, limits, strict=True):
        d = -1.0 if (profile.end.velocity or profile.start.velocity) < 0.0 else 1.0
        found, room = profile.extrema(), 1 + 1e-9
        assert max(map(abs, found.velocity)) <= own.velocity * room
        low, high = sorted(d * x for x in found.acceleration)
        assert high <= own.acceleration * room
        assert low >= -own.braking[0] * room


@settings(max_examples=40)
@given(axes())
def test_in_time_all_are_done_in_the_cycle_of_the_slowest(drawn: Drawn) -> None:
    """One length, that of the slowest alone; the velocities to the bit; every limit."""
    starts, velocities, limits = drawn
    motion = plan_velocity(starts, velocities, limits, T)
    alone = plan_velocity(starts, velocities, limits, T, synchronization="none")
    assert (motion.synchronization, alone.synchronization) == ("time", "none")
    assert {profile.cycles for profile in motion} == {alone.cycles}
    for i, profile in enumerate(alone):
        assert profile == plan_velocity(starts[i], velocities[i], limits[i], T)
    asked = [State(0.0, velocity).velocity for velocity in velocities]  # 1e-308 is no velocity
    assert motion.sample().velocity[-1].tolist() == asked
    held(motion, limits)


@settings(max_examples=40)
@given(axes(steady=True))
def test_in_phase_the_velocities_change_in_proportion(drawn: Drawn) -> None:
    """Of states without acceleration: each the same share of its change, in every row."""
    starts, velocities, limits = drawn
    motion = plan_velocity(starts, velocities, limits, T, synchronization="phase")
    asked = [State(0.0, velocity).velocity for velocity in velocities]  # 1e-127 is no velocity
    change = np.array(asked) - [start.velocity for start in starts]
    held(motion, limits)
    if not change.any():
        return
    assert motion.synchronization == "phase"
    assert motion.cycles >= plan_velocity(starts, velocities, limits, T).cycles - 3
    rows = motion.sample().velocity - [start.velocity for start in starts]
    scale = np.maximum([own.velocity for own in limits], 1e-300)
    largest = int(np.argmax(np.abs(change) / scale))
    share = rows[:, largest] / change[largest]
    assert np.abs(rows - share[:, None] * change).max(axis=0) == pytest.approx(
        0.0, abs=1e-9 * scale.max()
    )


def test_a_stop_in_phase_stays_on_its_line() -> None:
    """Three axes on a straight line stop on it, with the slowest; in time they leave it."""
    rng = np.random.default_rng(2)
    left = []
    for _ in range(200):
        way = rng.uniform(-1, 1, 3)
        limits = [Limits(1.0, *(10.0 ** rng.uniform([0, 1], [1, 3])).tolist()) for _ in way]
        starts = [State(float(x), float(0.9 * x)) for x in way]
        for how in ("phase", "time"):
            motion = plan_velocity(starts, [0.0] * 3, limits, T, synchronization=how)  # type: ignore[arg-type]
            rows = motion.sample().position
            off = rows - np.outer(rows @ way, way) / (way @ way)
            if how == "phase":
                assert np.abs(off).max() <= 1e-12
            else:
                left.append(np.abs(off).max())
    assert max(left) > 1e-3


def test_those_that_wait_go_gently() -> None:
    """The axis that could be faster uses a lower acceleration all the time, and does not wait."""
    own = Limits(90.0, 500.0, 5000.0)
    fast, slow = plan_velocity([State(0.0, 9.0), State(0.0, 90.0)], [0.0, 0.0], own, T)
    assert fast.cycles == slow.cycles == 280
    assert max(map(abs, fast.extrema().acceleration)) < 9.0 / 0.2
    assert fast.phases[-1].jerk != 0.0


@settings(max_examples=20)
@given(st.sampled_from(["velocity", "limits", "start", "beyond"]))
def test_what_cannot_be_is_refused_by_its_field(what: str) -> None:
    """One velocity and one limit per axis, each within its own."""
    start, velocity, own = [0.0, 0.0], [1.0, 2.0], [Limits(2.0, 4.0, 50.0)] * 2
    if what == "velocity":
        with pytest.raises(InputError, match=r"velocity.*must be one per axis: 2"):
            plan_velocity(start, [1.0], own, T)
        with pytest.raises(InputError, match=r"velocity.*must be one per axis"):
            plan_velocity(start, 1.0, own, T)  # type: ignore[call-overload]
    elif what == "limits":
        with pytest.raises(InputError, match=r"limits.*must be one per joint: 2"):
            plan_velocity(start, velocity, own[:1], T)
    elif what == "start":
        with pytest.raises(InputError, match=r"start\[1\]"):
            plan_velocity([0.0, "x"], velocity, own, T)  # type: ignore[list-item]
        with pytest.raises(InputError, match=r"velocity"):
            plan_velocity([], [], own[0], T)
    else:
        with pytest.raises(InputError, match=r"velocity\[1\] = 3.0: must lie within \+-2.0"):
            plan_velocity(start, [1.0, 3.0], own, T)
