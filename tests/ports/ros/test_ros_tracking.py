"""Windows over time and what is aimed at, without ROS."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sjerk.errors import InputError
from sjerk.limits import State
from sjerk.ports.ros.tracking import Rest, Tracker, Window

rows = st.integers(1, 6).flatmap(
    lambda n: st.tuples(
        st.lists(st.integers(1, 1000), min_size=n, max_size=n),
        st.lists(st.integers(-9, 9), min_size=n, max_size=n),
        st.lists(st.integers(-9, 9), min_size=n, max_size=n),
    )
)


def aimed(tracker: Tracker, now: float) -> list[float]:
    """Position and velocity that one joint is to have."""
    aim = tracker.aim(now)
    assert isinstance(aim, list)
    return [aim[0].position, aim[0].velocity]


def cubic(t: Fraction, at: list[Fraction], p: list[int], v: list[int]) -> tuple[Fraction, Fraction]:
    """Hermite's basis as in textbooks, in rationals."""
    i = max(k for k in range(len(at)) if at[k] <= t)
    h = at[i + 1] - at[i]
    s = (t - at[i]) / h
    basis = (
        2 * s**3 - 3 * s**2 + 1, (s**3 - 2 * s**2 + s) * h, 3 * s**2 - 2 * s**3, (s**3 - s**2) * h
    )  # fmt: skip
    slope = ((6 * s**2 - 6 * s) / h, 3 * s**2 - 4 * s + 1, (6 * s - 6 * s**2) / h, 3 * s**2 - 2 * s)
    given_ = (p[i], v[i], p[i + 1], v[i + 1])
    return (
        sum((b * g for b, g in zip(basis, given_, strict=True)), Fraction(0)),
        sum((b * g for b, g in zip(slope, given_, strict=True)), Fraction(0)),
    )


@given(rows, st.fractions(0, 1, max_denominator=64))
def test_between_rows_it_is_the_cubic_of_their_positions_and_velocities(
    drawn: tuple[list[int], list[int], list[int]], share: Fraction
) -> None:
    """Against the textbook's basis in rationals; straight on behind the last row."""
    gaps, p, v = drawn
    at = [Fraction(sum(gaps[: k + 1]), 64) for k in range(len(gaps))]
    window = Window.of([float(t) for t in at], [[x] for x in p], [[x] for x in v])
    beyond = at[-1] + share
    q, speed = window.at(float(beyond))
    assert q[0] == pytest.approx(float(p[-1] + v[-1] * share))
    assert speed[0] == v[-1]
    if len(at) > 1:
        t = at[0] + (at[-1] - at[0]) * share * Fraction(99, 100)
        wanted = cubic(t, at, p, v)
        q, speed = window.at(float(t))
        assert q[0] == pytest.approx(float(wanted[0]), abs=1e-9)
        assert speed[0] == pytest.approx(float(wanted[1]), abs=1e-6)


@given(rows, st.floats(0, 1))
def test_without_velocities_it_is_straight_between_rows_and_rests_at_the_last(
    drawn: tuple[list[int], list[int], list[int]], share: float
) -> None:
    """The interpolation of numpy is the judge."""
    gaps, p, _ = drawn
    at = np.cumsum(gaps) / 64
    window = Window.of(at, [[x] for x in p])
    t = at[0] + share * (at[-1] - at[0])
    assert window.at(t)[0][0] == pytest.approx(np.interp(t, at, p), abs=1e-9)
    assert [x[0] for x in window.at(at[-1] + share)] == [p[-1], 0.0]


def test_a_silent_source_is_rested_behind_once() -> None:
    """At its last position; ahead where it ended with a velocity; then there is nothing to do."""
    tracker = Tracker(horizon=0.1, timeout=0.2, most=[5.0])
    tracker.take(Window.of([0.0, 1.0], [[0.0], [1.0]]), now=0.0)
    assert tracker.aim(1.3) == [State(1.0)]
    assert tracker.aim(1.4) is None
    tracker.take(Window.of([2.0], [[1.0]], [[0.5]]), now=2.0)
    assert aimed(tracker, 2.1) == pytest.approx([1.1, 0.5])
    assert tracker.aim(2.3) is Rest.HALT
    assert not tracker.active
    goals = Tracker(horizon=0.1, timeout=0.2, most=[5.0], rest_on_last=True)
    goals.take(Window.of([2.0], [[1.0]], [[0.5]]), now=2.0)
    assert goals.aim(2.3) == [State(1.0)]
    assert goals.aim(2.4) is None


def test_a_long_window_is_followed_to_its_end_without_further_messages() -> None:
    """A source that has told two seconds is not silent after 0.2."""
    tracker = Tracker(horizon=0.1, timeout=0.2, most=[5.0])
    tracker.take(Window.of([0.0, 2.0], [[0.0], [2.0]]), now=0.0)
    assert aimed(tracker, 1.5) == pytest.approx([1.6, 1.0])


def test_velocities_are_cut_to_what_the_axes_can() -> None:
    """The position is aimed at all the same."""
    tracker = Tracker(horizon=0.5, timeout=0.2, most=[1.0])
    tracker.take(Window.of([0.0, 1.0], [[0.0], [4.0]]), now=0.0)
    assert tracker.aim(0.0) == [State(2.0, 1.0)]


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (([], []), "must be one row per time"),
        (([0.0, 0.0], [[1.0], [2.0]]), "time"),
        (([0.0], [[1.0], [2.0]]), "must be one row per time"),
        (([0.0], [[np.nan]]), "must be finite"),
        (([0.0], [[1.0]], [[1.0, 2.0]]), "velocity"),
    ],
)
def test_wrong_windows_are_refused(arguments: tuple[object, ...], text: str) -> None:
    """With the field."""
    with pytest.raises(InputError, match=text):
        Window.of(*arguments)  # type: ignore[arg-type]


def test_a_window_of_other_joints_is_refused_and_the_one_before_goes_on() -> None:
    """Nothing is lost."""
    tracker = Tracker(horizon=0.1, timeout=0.2, most=[1.0])
    tracker.take(Window.of([0.0, 1.0], [[0.0], [0.5]]), now=0.0)
    with pytest.raises(InputError, match="must have 1 columns"):
        tracker.take(Window.of([0.0], [[1.0, 2.0]]), now=0.1)
    assert aimed(tracker, 0.1) == pytest.approx([0.1, 0.5])
