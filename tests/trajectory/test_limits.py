"""Limits where a list is expected: one is taken for all joints, all else is refused by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from sjerk import (
    GoalStream,
    InputError,
    Limits,
    State,
    Trajectory,
    follow,
    follow_path,
    follow_stops,
    follow_within,
    plan,
)
from sjerk.trajectory.joining import brake, join
from sjerk.trajectory.segments import Knot

ONE = Limits(2.0, 4.0, 50.0)
POINTS = [[0.0, 0.0], [0.2, 0.1], [0.3, 0.4]]
WAY = Trajectory(["a", "b"], [0.0, 1.0, 2.0], POINTS)
REST = Knot.rest([0.0, 0.0])


def stream(limits: Any) -> Any:
    goals = GoalStream(limits, 1e-3, [0.0, 0.0], period=0.1)
    goals.push([0.01, 0.02])
    goals.end()
    return [block.position for block in goals.take(1000)]


#: Everything that takes limits by joint, and what it gives, comparable.
TAKERS: dict[str, Callable[[Any], Any]] = {
    "follow": lambda limits: [b.jerk for b in follow(WAY, limits, 1e-3)],
    "follow_within": lambda limits: [
        b.jerk for b in follow_within(WAY, limits, 1e-3, tolerance=1e-3).blocks
    ],
    "follow_path": lambda limits: [b.jerk for b in follow_path(POINTS, limits, 1e-3)],
    "follow_path, tolerance": lambda limits: [
        b.jerk for b in follow_path(POINTS, limits, 1e-3, tolerance=0.01)
    ],
    "follow_stops": lambda limits: [
        m.sample().position for m in follow_stops(POINTS, limits, 1e-3)
    ],
    "GoalStream": stream,
    "brake": lambda limits: [brake(REST, limits, 1e-3).position],
    "join": lambda limits: [join(REST, [0.1, 0.2], limits, 1e-3).position],
    "check": lambda limits: [WAY.check(limits) or 0.0],
    "plan": lambda limits: [plan([State(0.0)] * 2, [1.0, 2.0], limits, 1e-3).sample().position],
}


@pytest.mark.parametrize("taker", TAKERS)
def test_one_limits_is_taken_for_all_joints(taker: str) -> None:
    """The same motion as with a list of as many, bit for bit."""
    for one, two in zip(TAKERS[taker](ONE), TAKERS[taker]([ONE, ONE]), strict=True):
        assert np.array_equal(one, two)


@pytest.mark.parametrize("taker", TAKERS)
@pytest.mark.parametrize(
    ("wrong", "field"),
    [
        (None, "limits"),
        ("fast", "limits"),
        (b"fast", "limits"),
        (2.0, "limits"),
        ([ONE, None], "limits[1]"),
        (["ab", ONE], "limits[0]"),
        ([[2.0, 4.0, 50.0], [2.0, 4.0, 50.0]], "limits[0]"),
        ([ONE], "limits"),
        ([ONE] * 3, "limits"),
        ([], "limits"),
        (np.ones((2, 3)), "limits"),
    ],
    ids=str,
)
def test_what_is_no_limits_is_refused_by_name(taker: str, wrong: Any, field: str) -> None:
    """The field, the value and what it must be: before anything is planned."""
    if taker == "check" and wrong is None:
        return  # checks no limits
    with pytest.raises(InputError) as caught:
        TAKERS[taker](wrong)
    assert caught.value.field.startswith(field) or (
        taker == "plan" and "limits" in str(caught.value)
    )


@pytest.mark.parametrize("wrong", [{"a": ONE}, {"a": ONE, "b": None}, {"a": ONE, "b": [2.0, 4.0]}])
def test_limits_by_name_are_checked_too(wrong: Any) -> None:
    """A joint that is missing, and what is no Limits."""
    with pytest.raises(InputError, match="limits"):
        list(follow(WAY, wrong, 1e-3))
