"""What a main device is told by a file: refused with its place, before anything is sent."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from sjerk.errors import ConfigError, KernelGoneError
from sjerk.kernel import MotionKernel, described, port_tables, read_table
from sjerk.ports.ethercat.inside import port_of
from sjerk.ports.ethercat.settings import from_tables

BUS = {"interface": "none0"}


@pytest.mark.parametrize(
    ("bus", "axis", "place", "why"),
    [
        ({}, {"position": 0}, "ethercat.interface", "network interface"),
        ({**BUS, "shift": 1.5}, {"position": 0}, "ethercat.shift", "between 0 and 1"),
        ({**BUS, "lost": 0}, {"position": 0}, "ethercat.lost", "1 .. 1000"),
        ({**BUS, "others": "hide"}, {"position": 0}, "ethercat.others", "refuse or ignore"),
        ({**BUS, "shfit": 0.5}, {"position": 0}, "ethercat.shfit", "unknown; known are"),
        (BUS, {}, "axes[0].ethercat.position", "is needed"),
        (BUS, {"position": 0, "alias": 5}, "axes[0].ethercat.position", "not both"),
        (BUS, {"position": -1}, "axes[0].ethercat.position", "0 .."),
        (BUS, {"position": 0, "identity": [1]}, "axes[0].ethercat.identity", "2 whole numbers"),
        (BUS, {"position": 0, "receive": ["60"]}, "axes[0].ethercat.receive", "6099:1"),
        (BUS, {"position": 0, "receive": ["2010:1"]}, "axes[0].ethercat.receive", "2010:1/16"),
        (BUS, {"position": 0, "receive": ["6040"], "rx_pdos": [0x1701]},
         "axes[0].ethercat.receive", "free PDO"),
        (BUS, {"position": 0, "activate": 0x700}, "axes[0].ethercat.sync0_us", "SYNC1"),
        (BUS, {"position": 0, "startup": [["6098:0", "i8", 300]]}, "axes[0].ethercat.value",
         "-128 .. 127"),
        (BUS, {"position": 0, "startup": [["6098:0", "i9", 3]]}, "axes[0].ethercat.type", "i8"),
        (BUS, 7, "axes[0].ethercat", "must be a table"),
    ],
)  # fmt: skip
def test_a_mistake_is_told_with_its_place(
    bus: dict[str, Any], axis: Any, place: str, why: str
) -> None:
    """File, table, field, value and limit, in one line."""
    with pytest.raises(ConfigError) as refused:
        from_tables("robot.toml", bus, {0: axis})
    text = str(refused.value)
    given = " = " if refused.value.value is not None else ": "  # one that is missing has no value
    assert text.startswith(f"robot.toml: {place}{given}")
    assert why in text
    assert "\n" not in text


FILE = """
cycle_time = 0.001
[ethercat]
interface = "none0"
[[axes]]
drive = "ethercat"
counts_per_unit = 1000.0
limits = { velocity = 1.0, acceleration = 1.0, jerk = 1.0 }
[axes.ethercat]
position = 0
"""


def kernel_of(folder: Path, text: str) -> MotionKernel:
    file = folder / "robot.toml"
    file.write_text(text)
    table = read_table(file)
    kernel = described(file, table)
    wire = port_tables(table, "ethercat")
    if wire is not None:
        kernel.port = port_of(str(file), *wire)
    return kernel


def test_an_axis_with_a_table_of_a_port_is_external(tmp_path: Path) -> None:
    """The kernel does not read the port's tables; it knows that the drive is outside."""
    for text in (FILE, FILE.replace('drive = "ethercat"\n', "")):
        kernel = kernel_of(tmp_path, text)
        assert kernel.axes[0].drive == "external"
        assert kernel.port is not None
        assert kernel.port.table["axes"] == {"0": {"position": 0}}


def test_a_kernel_whose_bus_is_not_there_says_so_in_one_line(tmp_path: Path) -> None:
    """No such interface, or no right to it: the kernel does not start, and nothing is left."""
    with pytest.raises(KernelGoneError) as refused, kernel_of(tmp_path, FILE):
        raise AssertionError("it started")
    assert "no raw socket on none0" in str(refused.value)
    assert "\n" not in str(refused.value)
