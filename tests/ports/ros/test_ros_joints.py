"""Joints and parameters of the ROS nodes, without ROS."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sjerk.errors import InputError
from sjerk.ports.ros.joints import UNITS, Joints
from sjerk.ports.ros.parameters import CONTROL, CONTROLLER, Parameter, constraints, settings
from sjerk.trajectory import Trajectory, TrajectoryError

#: One radian or metre in the units that people have, from their definitions.
DEFINED = {"": 1, "rad": 1, "deg": 360 / math.tau, "rev": 1 / math.tau, "m": 1, "mm": 1e3}


def test_units_are_those_of_their_definitions() -> None:
    """No unit is missing, none is another length."""
    assert UNITS.keys() == DEFINED.keys()
    for unit, size in DEFINED.items():
        assert UNITS[unit] == pytest.approx(size, rel=1e-15)


@given(st.data())
def test_rows_are_found_by_name_in_any_order(data: st.DataObject) -> None:
    """Other joints may be there, before, between and behind."""
    count = data.draw(st.integers(1, 8))
    names = [f"j{i}" for i in range(count)]
    units = data.draw(st.lists(st.sampled_from(sorted(DEFINED)), min_size=count, max_size=count))
    numbers = st.floats(-1e6, 1e6).map(lambda x: x if abs(x) > 1e-200 else 0.0)
    values = data.draw(st.lists(numbers, min_size=count, max_size=count).map(np.array))
    others = [f"other{i}" for i in range(data.draw(st.integers(0, 4)))]
    order = data.draw(st.permutations([*names, *others]))
    told = [values[names.index(n)] if n in names else math.nan for n in order]
    row = Joints.of(names, units).row(order, told, "position")
    assert row == pytest.approx([v * DEFINED[u] for v, u in zip(values, units, strict=True)])
    assert Joints.of(names, units).to_ros(row) == pytest.approx(values, rel=1e-15, abs=0.0)


def test_a_trajectory_of_some_joints_is_scaled_by_their_units() -> None:
    """In its own order of joints; velocities and accelerations too."""
    arm = Joints.of(["turn", "lift"], ["deg", "mm"])
    way = Trajectory(["lift"], [0.0, 1.0], [[0.0], [0.5]], [[0.0], [0.1]], [[0.2], [0.0]])
    scaled = arm.trajectory(way)
    assert scaled.position[:, 0].tolist() == [0.0, 500.0]
    assert scaled.velocity is not None
    assert scaled.velocity[:, 0].tolist() == [0.0, 100.0]
    assert scaled.acceleration is not None
    assert scaled.acceleration[:, 0].tolist() == [200.0, 0.0]
    huge = Trajectory(["turn"], [0.0, 1.0], [[0.0], [1e308]])
    with pytest.raises(TrajectoryError, match="point 1, joint turn: position = inf is not finite"):
        arm.trajectory(huge)


@pytest.mark.parametrize(
    ("names", "units", "text"),
    [
        (["a"], ["deg", "deg"], "must be 2: one per axis"),
        (["a", "a"], ["deg", "deg"], "'a' is there twice"),
        (["a"], ["inch"], "unit of joint 'a' = 'inch': must be one of"),
        ([""], ["deg"], "must be a list of one name per axis"),
        ("a", ["deg"], "must be a list of one name per axis"),
    ],
)
def test_wrong_joints_are_refused(names: list[str], units: list[str], text: str) -> None:
    """Before anything runs, with the field."""
    with pytest.raises(InputError, match=text):
        Joints.of(names, units)


@pytest.mark.parametrize(
    ("names", "values", "text"),
    [
        (["a"], [1.0], "joint 'b' is not named"),
        (["a", "b", "a"], [1.0, 2.0, 3.0], "joint 'a' is named 2 times"),
        (["a", "b"], [1.0], "must be one per name: 2"),
        (["a", "b"], [1.0, math.nan], "position of joint 'b' = nan: must be finite"),
        (["a", "b"], [-math.inf, 0.0], "position of joint 'a' = -inf: must be finite"),
    ],
)
def test_wrong_goals_are_refused(names: list[str], values: list[float], text: str) -> None:
    """With the joint and the value."""
    with pytest.raises(InputError, match=text):
        Joints.of(["a", "b"], ["rad", "m"]).row(names, values, "position")


def test_each_parameter_accepts_its_default_and_says_what_it_is_for() -> None:
    """And no name is there twice."""
    for table in (CONTROLLER, CONTROL):
        names = [parameter.name for parameter in table]
        assert len(set(names)) == len(names)
        for parameter in table:
            parameter.check(parameter.default)
            assert parameter.about


@given(st.sampled_from([*CONTROLLER, *CONTROL]), st.data())
def test_values_outside_are_refused(parameter: Parameter, data: st.DataObject) -> None:
    """Of every parameter: another type, a number outside its range, a text it does not know."""
    wrong: list[object] = [None, b"", object()]
    if not isinstance(parameter.default, str):
        wrong.append("text")
    if not isinstance(parameter.default, bool):
        wrong.append(True)
    if parameter.choices:
        wrong.append("bogus")
    if parameter.low is not None:
        kind = type(parameter.default)
        wrong += [kind(parameter.low - 1), kind(parameter.high * 2 + 1)]
        if kind is float:
            wrong += [math.nan, math.inf]
    with pytest.raises(InputError, match=parameter.name):
        parameter.check(data.draw(st.sampled_from(wrong)))


def test_parameters_become_settings_in_axis_units() -> None:
    """By the unit of each joint."""
    arm = Joints.of(["a", "b"], ["deg", "deg"])
    values = {p.name: p.default for p in (*CONTROLLER, *constraints(arm.names))}
    values |= {
        "resampling_delta": math.pi / 180,
        "execution_mode": "single_point",
        "constraints.b.goal": math.pi,
        "constraints.a.trajectory": math.pi / 2,
    }
    made = settings(values, arm)
    assert made.resampling_delta == pytest.approx(1.0)
    assert made.execution_mode.value == "single_point"
    assert made.goal_tolerance.keys() == {"b"}
    assert made.goal_tolerance["b"].position == pytest.approx(180.0)
    assert made.path_tolerance.keys() == {"a"}
    assert made.path_tolerance["a"].position == pytest.approx(90.0)


def test_one_tolerance_of_joints_with_different_units_is_refused() -> None:
    """It would be another one for each of them; 0 is 0 in any unit."""
    arm = Joints.of(["a", "b"], ["deg", "mm"])
    values = {p.name: p.default for p in (*CONTROLLER, *constraints(arm.names))}
    assert settings(values, arm).tolerance == 0.0
    with pytest.raises(InputError, match=r"tolerance = 0\.01: must be 0 where"):
        settings(values | {"tolerance": 0.01}, arm)
