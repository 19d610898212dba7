"""Kernels from TOML files: what is read, and that each fault is told with its place."""

from __future__ import annotations

from pathlib import Path

import pytest

from sjerk import Axis, Clock, DriveConfig, Limits, Reactions
from sjerk.config import load
from sjerk.errors import ConfigError

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
    assert kernel._reactions == Reactions(drive_fault="quick stop")
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
        (", jerk = 5000.0 }", " }", r"axes\[1\].limits.jerk .*missing"),
        ("wrap = 360", "wrap = 0", r"axes\[1\].wrap"),
        ("gear = 2", "geer = 2", r"axes\[0\].geer .*unknown"),
        ("velocity_feedforward", "velocity_feed", r"axes\[0\].drive.velocity_feed .*unknown"),
        ("forward = 0.5", "forward = 5.0", r"axes\[0\].drive.velocity_feedforward"),
        ('"external"', '"internal"', r"axes\[1\].drive"),
        ("spin_us = 20", "spin_us = -20", r"clock.spin_us"),
        ('"quick stop"', '"explode"', r"reactions.drive_fault"),
        ("500e-6", '"fast"', r"cycle_time"),
        ("velocity = 90,", "velocity = 9e9,", r"axes\[0\].limits.velocity"),
        ("[clock]", "[clock", r"syntax .*line 4"),
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
