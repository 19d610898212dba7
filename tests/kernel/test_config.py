"""Kernels from TOML files: what is read, and that each fault is told with its place."""

from __future__ import annotations

import json
import math
import tomllib
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sjerk import Axis, Clock, DriveConfig, Limits, MotionKernel, Reactions
from sjerk.__main__ import main
from sjerk.errors import ConfigError
from sjerk.kernel import load

GOOD = """
name = "robot"
cycle_time = 500e-6
[clock]
spin_us = 20
[reactions]
drive_fault = "quick stop"
[[axes]]
unit = "deg"
counts_per_unit = 46603.37777777778
gear = 2
following_error = 1.5
limits = { velocity = 90, acceleration = 500, jerk = 5000, position = [-170, 170] }
stop_limits = { velocity = 90, acceleration = 2000, jerk = 40000 }
drive = { velocity_feedforward = 0.5 }
[[axes]]
counts_per_unit = 1000.0
wrap = 360
limits = { velocity = 90.0, acceleration = 500.0, jerk = 5000.0 }
drive = "external"
"""


def test_a_file_makes_the_same_kernel_as_python(tmp_path: Path) -> None:
    """Every table and field arrives."""
    file = tmp_path / "file.toml"
    file.write_text(GOOD)
    kernel = load(file)
    assert (kernel.name, kernel.cycle_time) == ("robot", 500e-6)
    assert kernel.clock == Clock(spin_us=20)
    assert kernel.reactions == Reactions(drive_fault="quick stop")
    limits = Limits(90, 500, 5000, position=(-170, 170))
    assert kernel.axes[0] == Axis(
        limits,
        46603.37777777778,
        DriveConfig(velocity_feedforward=0.5),
        unit="deg",
        gear=2,
        following_error=1.5,
        stop_limits=Limits(90, 2000, 40000),
    )
    assert kernel.axes[1].drive == "external"
    assert load(file, name="other").name == "other"


@pytest.mark.parametrize(
    ("was", "becomes", "place"),
    [
        ("jerk = 5000,", "jerk = -5,", r"axes\[0\].limits.jerk"),
        (", jerk = 5000.0 }", " }", r"axes\[1\].limits.jerk.*missing"),
        ("wrap = 360", "wrap = 0", r"axes\[1\].wrap"),
        ("gear = 2", "geer = 2", r"axes\[0\].geer .*unknown"),
        ("velocity_feedforward", "velocity_feed", r"axes\[0\].drive.velocity_feed .*unknown"),
        ("forward = 0.5", "forward = 5.0", r"axes\[0\].drive.velocity_feedforward"),
        (
            "velocity_feedforward = 0.5",
            "following_window = 1e6",
            r"axes\[0\].drive.following_window",
        ),
        ("forward = 0.5", 'forward = "x"', r"axes\[0\].drive.velocity_feedforward"),
        ("500e-6", "1" * 5000, r"syntax"),
        ('"external"', '"internal"', r"axes\[1\].drive"),
        ("spin_us = 20", "spin_us = -20", r"clock.spin_us"),
        ('"quick stop"', '"explode"', r"reactions.drive_fault"),
        ("500e-6", '"fast"', r"cycle_time"),
        ("velocity = 90,", "velocity = 9e9,", r"axes\[0\].limits.velocity"),
        ("[clock]", "[clock", r"syntax.*line 4"),
        ("limits = { velocity = 90.0", "limit = { velocity = 90.0", r"axes\[1\].limit "),
    ],
)
def test_each_fault_is_told_with_its_place(
    tmp_path: Path, was: str, becomes: str, place: str
) -> None:
    """The file, the table and the field, the value and the limit."""
    assert was in GOOD
    file = tmp_path / "robot.toml"
    file.write_text(GOOD.replace(was, becomes))
    with pytest.raises(ConfigError, match=f"robot.toml: {place}"):
        load(file)


VALUES = st.recursive(
    st.one_of(
        st.booleans(),
        st.integers(),
        st.just(10**400),
        st.floats(),
        st.sampled_from(["", "x", "external", "ideal", "halt"]),
    ),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.just("a"), inner),
    max_leaves=4,
)
FIELDS = [
    *(("axes", 0, "drive", field.name) for field in fields(DriveConfig)),
    *(("axes", 0, "limits", field.name) for field in fields(Limits)),
    *(("axes", 0, field.name) for field in fields(Axis)),
    *(
        (name, field.name)
        for name, kind in (("clock", Clock), ("reactions", Reactions))
        for field in fields(kind)
    ),
    *((name,) for name in ("name", "cycle_time", "clock", "reactions", "axes")),
    ("axes", 1),
]


def toml(value: Any) -> str:
    """One value in TOML."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {toml(one)}" for key, one in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    if isinstance(value, float) and not math.isfinite(value):
        return repr(value)
    return json.dumps(value)


@given(place=st.sampled_from(FIELDS), value=VALUES)
@settings(max_examples=400, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_value_anywhere_is_taken_or_told_with_its_place(
    tmp_path: Path, place: tuple[Any, ...], value: Any
) -> None:
    """Of whatever type: a kernel, or one line with the file and the place."""
    table = tomllib.loads(GOOD)
    inner: Any = table
    for part in place[:-1]:
        inner = inner[part]
    inner[place[-1]] = value
    file = tmp_path / "robot.toml"
    file.write_text("".join(f"{key} = {toml(one)}\n" for key, one in table.items()))
    try:
        assert isinstance(load(file), MotionKernel)
    except ConfigError as fault:
        refused = fault
    else:
        return
    assert refused.path == str(file)
    assert refused.field.startswith(str(place[0]))
    between = "" if refused.value is None else " = "  # None is no value of a file
    assert str(refused).startswith(f"{file}: {refused.field}{between}")
    assert "\n" not in str(refused)


@pytest.mark.parametrize("job", [("kernel",), ("follow", "way.csv", "--kernel")])
def test_a_fault_of_a_file_is_one_line_of_the_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], job: tuple[str, ...]
) -> None:
    """File, place, value and what it must be; exit code 1."""
    file, way = tmp_path / "robot.toml", tmp_path / "way.csv"
    file.write_text(GOOD.replace("velocity_feedforward = 0.5", "following_window = 1e6"))
    way.write_text("time,a\n0,0\n1,1\n")
    assert main([str(way) if word == "way.csv" else word for word in job] + [str(file)]) == 1
    place = "axes[0].drive.following_window = 1000000.0"
    assert capsys.readouterr().err == f"sjerk: {file}: {place}: must be an integer\n"


def test_an_empty_name_is_not_no_name(tmp_path: Path) -> None:
    """It is refused, not replaced by that of the file."""
    file = tmp_path / "robot.toml"
    file.write_text(GOOD)
    with pytest.raises(ConfigError, match="name = ''"):
        load(file, name="")


def test_a_table_for_the_panel_is_left_to_it(tmp_path: Path) -> None:
    """It says nothing of the kernel; any other table is still unknown, and one of an axis too."""
    file = tmp_path / "robot.toml"
    file.write_text(GOOD + "\n[panel]\nanything = 1\n")
    assert len(load(file).axes) == 2
    file.write_text(GOOD + "\n[pannel]\n")
    with pytest.raises(ConfigError, match="pannel"):
        load(file)
    file.write_text(GOOD + "\n[axes.panel]\n")
    with pytest.raises(ConfigError):
        load(file)
