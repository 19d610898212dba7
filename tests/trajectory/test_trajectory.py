"""Way-points of N joints: what is refused, what files hold, what resampling keeps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sjerk import InputError, Limits
from sjerk.trajectory import (
    ExecutionMode,
    FaultKind,
    RecordedPathError,
    Trajectory,
    TrajectoryError,
    resample,
    shipped_recording,
)

NAN = float("nan")
TWO = ["a", "b"]


def points(n: int) -> list[list[float]]:
    return [[0.1 * i, 0.2 * i] for i in range(n)]


@pytest.mark.parametrize(
    ("names", "time", "position", "velocity", "found"),
    [
        ([], [0.0], np.empty((1, 0)), None, [("empty", None, None)]),
        (TWO, [], np.empty((0, 2)), None, [("empty", None, None)]),
        (["a", "a"], [0.0, 1.0], points(2), None, [("duplicate", None, "a")]),
        (TWO, [0.0, 1.0], points(3), None, [("size", None, None)]),
        (TWO, [0.0, 1.0], [[0.0], [1.0, 2.0]], None, [("size", None, None)]),
        (TWO, [0.0, 1.0], points(2), [[0.0], [0.0]], [("size", None, None)]),
        (TWO, [[0.0, 1.0]], points(2), None, [("size", None, None)]),
        (TWO, [0.0, NAN], points(2), None, [("not_finite", 1, None)]),
        (TWO, [0.0, 1.0], [[0.0, 1.0], [NAN, 2.0]], None, [("not_finite", 1, "a")]),
        (TWO, [0.0, 1.0], points(2), [[0, 0], [0, np.inf]], [("not_finite", 1, "b")]),
        (TWO, [-1.0, 1.0], points(2), None, [("time", 0, None)]),
        (TWO, [0.0, 1.0, 1.0, 0.5], points(4), None, [("time", 2, None), ("time", 3, None)]),
    ],
)
def test_each_fault_is_data_with_its_point_and_joint(
    names: list[str], time: Any, position: Any, velocity: Any, found: list[Any]
) -> None:
    """Kind, point and joint of everything that makes a trajectory none."""
    with pytest.raises(TrajectoryError) as refused:
        Trajectory(names, time, position, velocity)
    assert [(f.kind.value, f.point, f.joint) for f in refused.value.faults] == found
    assert refused.value.code == (-2 if found[0][0] == "duplicate" else -1)


def test_faults_on_a_machine() -> None:
    """Limits, a jump at the start, a moving end, wrong joints, a motion in the past."""
    limits = [Limits(1.0, 2.0, 10.0, position=(-1.0, 1.0)), Limits(1.0, 2.0, 10.0)]
    moving = Trajectory(TWO, [0.0, 1.0], [[0, 0], [2, 2]], [[0, 0], [0, 1.5]], [[0, 0], [3, 0]])
    found = moving.faults(limits, joints=["b", "c"], start=[0.5, 0.0], begins=0.0, now=2.0)
    assert [(f.kind, f.point, f.joint) for f in found] == [
        (FaultKind.JOINTS, None, "a"),
        (FaultKind.JOINTS, None, "c"),
        (FaultKind.POSITION_LIMIT, 1, "a"),
        (FaultKind.ACCELERATION_LIMIT, 1, "a"),
        (FaultKind.VELOCITY_LIMIT, 1, "b"),
        (FaultKind.JUMP, 0, "a"),
        (FaultKind.END_VELOCITY, 1, "b"),
        (FaultKind.PAST, 1, None),
    ]
    assert found[-1].kind.code == -3
    with pytest.raises(TrajectoryError, match="joint a"):
        moving.check({"a": limits[0], "b": limits[1]})


def test_a_sound_trajectory_has_no_faults() -> None:
    """A later first point is a ramp, not a jump; order of joints is free; the end may move."""
    way = Trajectory(TWO, [0.5, 1.0], points(2), [[0.0, 0.0], [0.5, 0.0]])
    limits = {"b": Limits(1.0, 2.0, 10.0), "a": Limits(1.0, 2.0, 10.0)}
    found = way.faults(limits, joints=["b", "a"], start=[9.0, 9.0], end_velocity_allowed=True)
    assert found == ()
    turned = way.for_joints(["b", "a"])
    assert turned.joint_names == ("b", "a")
    np.testing.assert_array_equal(turned.position[:, 0], way.position[:, 1])
    with pytest.raises(ValueError, match="read-only"):
        way.position[0, 0] = 1.0
    with pytest.raises(AttributeError):
        way.time = way.time  # type: ignore[misc]


def test_a_csv_gives_back_every_bit(tmp_path: Path) -> None:
    """to_csv and from_csv, with and without velocities."""
    rng = np.random.default_rng(1)
    rows = [rng.normal(size=(9, 2)) for _ in range(3)]
    for count in (1, 2, 3):
        way = Trajectory(TWO, np.linspace(0.0, 1.0, 9), *rows[:count])
        way.to_csv(tmp_path / "way.csv")
        back = Trajectory.from_csv(tmp_path / "way.csv")
        assert back.joint_names == way.joint_names
        for name in ("time", "position", "velocity", "acceleration"):
            np.testing.assert_array_equal(getattr(back, name), getattr(way, name))


@pytest.mark.parametrize(
    ("text", "kind", "point", "joint"),
    [
        ("", "size", None, None),
        ("a,b\n0,1\n", "size", None, None),
        ("time,a\n0,1\n1,two\n", "size", 1, None),
        ("time,a\n0,1\n1,2,3\n", "size", 1, None),
        ("time,a,a\n0,1,2\n", "duplicate", None, "a"),
        ("time,a,b,a.velocity\n0,1,2,3\n", "size", None, "b"),
        ("time,a,b.velocity\n0,1,2\n", "size", None, "b.velocity"),
        ("time\n0\n", "empty", None, None),
        ("time,a\n0,nan\n", "not_finite", 0, "a"),
    ],
)
def test_bad_tables(
    text: str, kind: str, point: int | None, joint: str | None, tmp_path: Path
) -> None:
    """A bad table says where."""
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(TrajectoryError) as refused:
        Trajectory.from_csv(path)
    first = refused.value.faults[0]
    assert (first.kind.value, first.point, first.joint) == (kind, point, joint)
    with pytest.raises(RecordedPathError, match="no such file"):
        Trajectory.from_csv(tmp_path / "none.csv")


def test_the_shipped_bag_has_all_seven_joints() -> None:
    """TOPP-RA's plan: positions, velocities and accelerations of the Panda."""
    way = Trajectory.from_bag(shipped_recording())
    assert way.position.shape == (54, 7)
    assert way.joint_names[0] == "panda_joint1"
    np.testing.assert_allclose(np.diff(way.time)[:-1], 0.1)


@pytest.mark.parametrize("storage", ["SQLITE3", "MCAP"])
def test_a_bag_is_written_and_read(storage: str, tmp_path: Path) -> None:
    """A JointTrajectory in either storage; a point of the wrong size is told."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    Whole = types.types["trajectory_msgs/msg/JointTrajectory"]
    Point = types.types["trajectory_msgs/msg/JointTrajectoryPoint"]
    Header, Time = types.types["std_msgs/msg/Header"], types.types["builtin_interfaces/msg/Time"]
    Duration = types.types["builtin_interfaces/msg/Duration"]
    for width in (2, 1):
        bag = tmp_path / f"bag{width}"
        with Writer(bag, version=9, storage_plugin=StoragePlugin[storage]) as writer:
            topic = writer.add_connection("/plan", Whole.__msgtype__, typestore=types)
            none = np.empty(0)
            way = [
                Point(np.full(2 if i < 3 else width, 0.5 * i), np.full(2, 0.1), none, none,
                      Duration(i, 500_000_000))
                for i in range(4)
            ]  # fmt: skip
            raw = types.serialize_cdr(Whole(Header(Time(0, 0), ""), TWO, way), Whole.__msgtype__)
            writer.write(topic, 10**9, raw)
        if width == 2:
            read = Trajectory.from_bag(bag)
            assert read.time.tolist() == [0.5, 1.5, 2.5, 3.5]
            assert read.velocity is not None
            assert read.acceleration is None
            assert read.position[3].tolist() == [1.5, 1.5]
        else:
            with pytest.raises(TrajectoryError, match="point 3: 1 positions for 2 joints"):
                Trajectory.from_bag(bag)


# ---- resampling


def test_the_seeds_table() -> None:
    """The example of the seed: delta 0.5 keeps 2, 5, 8; a grid with delta on it keeps all."""
    one = np.arange(9) * 0.2
    two = np.minimum(one, 1.0)
    assert resample(np.column_stack([one, two]), 0.5).tolist() == [2, 5, 8]
    assert resample(np.arange(10) * 0.1, 0.3).tolist() == [0, 3, 6, 9]
    assert resample([0.0, 0.5, 1.0, 1.5], 0.5).tolist() == [0, 1, 2, 3]
    assert resample(np.empty((0, 2)), 0.5).tolist() == []
    assert resample([[1.0]], 0.5).tolist() == [0]


@given(
    st.lists(st.tuples(*[st.floats(-2, 2)] * 3), min_size=1, max_size=60),
    st.floats(1e-3, 3),
)
def test_resampling_against_the_sentence(rows: list[tuple[float, ...]], delta: float) -> None:
    """The last is kept; backward, the first that differs in any joint by delta; nothing else."""
    kept = [len(rows) - 1]
    for i in range(len(rows) - 2, -1, -1):
        step = [abs(x - y) for x, y in zip(rows[i], rows[kept[-1]], strict=True)]
        if any(s >= delta * (1 - 1e-9) for s in step):
            kept.append(i)
    assert resample(np.array(rows), delta).tolist() == kept[::-1]


def test_resampled_points_are_whole_points() -> None:
    """What is kept is the planner's own point in every joint, at its time."""
    way = Trajectory.from_bag(shipped_recording())
    kept = resample(way.position, 0.3)
    thin = way.take(kept)
    assert len(thin) < len(way)
    np.testing.assert_array_equal(thin.position, way.position[kept])
    np.testing.assert_array_equal(thin.time, way.time[kept])
    assert thin.time[-1] == way.time[-1]


@pytest.mark.parametrize(
    ("path", "delta"),
    [([[0.0]], 0.0), ([[0.0]], NAN), ([[NAN]], 1.0), ([[[0.0]]], 1.0), (np.empty((2, 0)), 1.0)],
)
def test_resampling_refuses(path: Any, delta: float) -> None:
    """No delta, no numbers, no joints."""
    with pytest.raises(InputError):
        resample(path, delta)


def test_modes_have_the_seeds_names() -> None:
    """And a wrong one is refused."""
    assert ExecutionMode("single_point") is ExecutionMode.SINGLE_POINT
    assert ExecutionMode("full_trajectory") is ExecutionMode.FULL_TRAJECTORY
    with pytest.raises(ValueError, match="fast"):
        ExecutionMode("fast")
