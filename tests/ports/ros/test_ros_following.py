"""Joint states as goals, without ROS: a kernel in steps, whose clock is the time."""

from __future__ import annotations

import math
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sjerk import Axis, Host, Limits, MotionKernel
from sjerk.cia402 import DriveConfig
from sjerk.cli.buses import kernel_of
from sjerk.errors import InputError
from sjerk.ports.ros.following import Following
from sjerk.ports.ros.joints import Joints
from sjerk.ports.ros.leading import lead
from sjerk.ports.ros.parameters import CONTROL
from sjerk.ports.ros.status import Level, check, check_start, statuses, warnings

NAMES = ("shoulder", "elbow")
LIMITS = (Limits(90.0, 500.0, 5000.0, position=(-170.0, 170.0)), Limits(2.0, 20.0, 500.0))


class Bench:
    """A kernel in steps, and what follows joint states in one mode."""

    def __init__(self, mode: str) -> None:
        axes = [
            Axis(LIMITS[0], 1e5, "ideal", unit="deg"),
            Axis(LIMITS[1], 1e6, "ideal", unit="rad"),
        ]
        self.kernel = MotionKernel(axes)
        self.host: Host = self.kernel.host()
        self.host.enable()
        self.kernel.step(5)
        values = {parameter.name: parameter.default for parameter in CONTROL} | {"mode": mode}
        self.told: list[str] = []
        self.joints = Joints.of(NAMES, ["deg", "rad"])
        self.following = Following(self.host, self.joints, values.__getitem__, self.told.append)
        self.now = 0.0

    def step(self, seconds: float) -> None:
        """So long, with a turn each 10 ms."""
        for _ in range(round(seconds / 0.01)):
            self.kernel.step(10)
            self.now += 0.01
            self.following.turn(self.now)

    def goal(self, position: Any, names: Any = NAMES, velocity: Any = ()) -> None:
        """One that has just been sent."""
        self.following.take(names, position, velocity, sent=self.now, now=self.now)

    @property
    def position(self) -> np.ndarray:
        """Commanded, in radians."""
        return self.joints.to_ros([axis.position for axis in self.host.feedback().axes])


@pytest.mark.parametrize("mode", ["interrupt", "stream", "track"])
@given(st.integers(0, 2**32 - 1))
@settings(max_examples=6)
def test_a_stream_of_goals_ends_on_the_last_within_the_limits(mode: str, seed: int) -> None:
    """Whatever the goals are within the range, in any order of names, with others besides."""
    draw = np.random.default_rng(seed)
    bench = Bench(mode)
    ends = draw.uniform(-1.0, 1.0, 2)
    for share in np.linspace(0.0, 1.0, 20) ** 2 * (3.0 - 2.0 * np.linspace(0.0, 1.0, 20)):
        order = list(draw.permutation(3))
        names, values = [*NAMES, "gripper"], [*(share * ends), math.nan]
        bench.goal([values[i] for i in order], [names[i] for i in order])
        bench.step(0.1)
    bench.step(6.0)
    assert bench.told == []
    assert bench.following.counts["refused"] == 0
    frame = bench.host.feedback()
    assert not frame.moving
    assert bench.position == pytest.approx(ends, abs=1e-12)
    for axis, limits in zip(frame.axes, LIMITS, strict=True):
        assert axis.peak_velocity <= limits.velocity * (1 + 1e-9)
        assert axis.peak_acceleration <= limits.acceleration * (1 + 1e-9)
        assert axis.peak_jerk <= limits.jerk * (1 + 1e-9)


@pytest.mark.parametrize("mode", ["interrupt", "stream", "track"])
@given(st.integers(0, 2**32 - 1))
@settings(max_examples=6)
def test_wrong_goals_are_refused_and_change_no_bit_of_the_motion(mode: str, seed: int) -> None:
    """Beside a bench that never got them: the same commands, cycle by cycle."""
    draw = np.random.default_rng(seed)
    benches = Bench(mode), Bench(mode)
    wrong = [
        ([0.1], NAMES, ()),
        ([0.1, math.nan], NAMES, ()),
        ([math.inf, 0.0], NAMES, ()),
        ([0.1, 0.1], ("shoulder", "wrist"), ()),
        ([0.1] * 3, ("shoulder", *NAMES), ()),
        ([0.1, 0.1], NAMES, (math.nan, 0.0)),
        ([], (), ()),
    ]
    refused = 0
    for k in range(12):
        for bench in benches:
            bench.goal([0.02 * k, -0.03 * k])
        for _ in range(draw.integers(0, 3)):
            benches[1].goal(*wrong[draw.integers(len(wrong))])
            refused += 1
        for _ in range(10):
            for bench in benches:
                bench.step(0.01)
            assert benches[0].position.tolist() == benches[1].position.tolist()
    assert benches[1].following.counts["refused"] == refused
    assert len(benches[1].told) == refused


def test_goals_that_come_after_a_gap_are_a_stream_again() -> None:
    """A stream that was taken for ended comes to rest; what came meanwhile begins the next one."""
    bench = Bench("stream")
    for k in range(1, 16):
        bench.goal([0.05 * k, -0.04 * k])
        bench.step(0.5 if k in (5, 11) else 0.1)
    bench.step(6.0)
    assert bench.told == []
    assert bench.following.counts["refused"] == 0
    assert bench.position == pytest.approx([0.75, -0.6], abs=1e-12)


def test_an_order_of_another_hand_ends_the_following() -> None:
    """After ``drop`` and a halt the motion rests, and the next goal moves again."""
    bench = Bench("track")
    for k in range(10):
        bench.goal([0.05 * k, 0.0], velocity=[0.5, 0.0])
        bench.step(0.1)
    bench.following.drop()
    bench.host.halt(timeout=0.0)
    bench.step(2.0)
    at = bench.position
    assert not bench.host.feedback().moving
    bench.goal(at + 0.1)
    bench.step(2.0)
    assert bench.position == pytest.approx(at + 0.1, abs=1e-12)


# ---- what is told of a kernel


def test_the_check_before_the_start_names_the_joint_with_a_fault() -> None:
    """And does not let it start."""
    axes = [
        Axis(LIMITS[0], 1e5, "external", unit="deg"),
        Axis(LIMITS[1], 1e6, "external", unit="rad"),
    ]
    kernel = MotionKernel(axes)
    inputs = kernel.image.inputs
    inputs["statusword"][:] = 0x0250  # switch on disabled
    host, joints = kernel.host(), Joints.of(NAMES, ["deg", "rad"])
    kernel.step(5)
    told: list[str] = []
    check_start(host, joints, told.append)
    assert [line.split(":")[0] for line in told] == list(NAMES)
    assert [row.level for row in check(host, joints)] == [Level.OK, Level.OK]
    inputs["statusword"][1], inputs["error_code"][1] = 0x0218, 0x7500
    kernel.step(5)
    rows = check(host, joints)
    assert [row.level for row in rows] == [Level.OK, Level.ERROR]
    with pytest.raises(Exception, match=r"check before the start: elbow: .*7500h"):
        check_start(host, joints, told.append)
    assert any("7500" in text for text in warnings(host))
    assert warnings(host) == []
    assert {row.what: row.level for row in statuses(host, joints)}["elbow"] is Level.ERROR


def test_a_node_has_exactly_one_kernel() -> None:
    """By file or by name."""
    for values in (
        {"kernel.file": "", "kernel.name": ""},
        {"kernel.file": "a", "kernel.name": "b"},
    ):
        with pytest.raises(InputError, match="exactly one"):
            lead(values.__getitem__, ExitStack(), kernel_of)


BUS = """
name = "cell"
[ethercat]
interface = "enp3s0"
[[axes]]
unit = "deg"
counts_per_unit = 1e5
limits = { velocity = 90, acceleration = 500, jerk = 5000 }
DRIVE
[axes.ethercat]
position = 0
"""


@pytest.mark.parametrize("drive", ["", 'drive = "ethercat"', 'drive = "external"'])
def test_the_drives_of_a_file_are_on_its_bus_or_simulated(tmp_path: Path, drive: str) -> None:
    """``hardware``: what it says, whatever the file does; by default as the file says."""
    file = tmp_path / "cell.toml"
    file.write_text(BUS.replace("DRIVE", drive))
    for hardware in ("", "ethercat"):
        kernel = kernel_of(str(file), hardware)
        assert kernel.port is not None
        assert kernel.axes[0].drive == "external"
    simulated = kernel_of(str(file), "simulated")
    assert simulated.port is None
    assert isinstance(simulated.axes[0].drive, DriveConfig)
    host = simulated.host()
    host.enable()
    simulated.step(200)
    move = host.move(1.0)
    simulated.step(1000)
    assert move.done
    file.write_text(BUS.replace("DRIVE", "").split("[axes.eth")[0].replace("[ethercat]", "#"))
    file.write_text(file.read_text().replace("interface", "#"))
    assert kernel_of(str(file), "").port is None
    with pytest.raises(InputError, match="needs a table"):
        kernel_of(str(file), "ethercat")
