"""`sjerk follow`: a trajectory file on a kernel, as a person runs it."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sjerk import Trajectory
from sjerk.trajectory import shipped_recording

KERNEL = """
[[axes]]
unit = "deg"
counts_per_unit = 46603.37777777778
limits = { velocity = 100, acceleration = 200, jerk = 20000, position = [-170, 170] }
[[axes]]
unit = "deg"
counts_per_unit = 46603.37777777778
limits = { velocity = 100, acceleration = 200, jerk = 20000, position = [-170, 170] }
"""


@pytest.fixture
def kernel(tmp_path: Path) -> Path:
    """The file of a kernel of two axes in degrees."""
    path = tmp_path / f"follow-{tmp_path.name}.toml"
    path.write_text(KERNEL)
    return path


@pytest.fixture
def way(tmp_path: Path) -> Path:
    """A CSV of two joints in degrees."""
    t = np.arange(0.0, 1.01, 0.05)
    q = 10.0 * (1.0 - np.cos(np.pi * t))
    path = tmp_path / "way.csv"
    Trajectory(["a", "b"], t, np.column_stack([q, -q])).to_csv(path)
    return path


def sjerk(*arguments: str | Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "sjerk", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_a_csv_on_an_own_kernel(kernel: Path, way: Path) -> None:
    """Progress, result and positions as JSON lines; exit code 0."""
    run = sjerk("follow", way, "--kernel", kernel, "--json")
    out, err = run.communicate(timeout=120)
    assert run.returncode == 0, err
    lines = [json.loads(line) for line in out.splitlines()]
    assert lines[-1]["result"] == "SUCCESSFUL"
    assert [row["position"] for row in lines[-1]["positions"]] == [20.0, -20.0]
    assert {"point", "desired", "actual", "error"} <= set(lines[0])


def test_an_axis_many_turns_on_follows_a_file_of_its_own_turn(tmp_path: Path) -> None:
    """A table at turn 10, a file of two turns about 0: on by two turns, told as in the file."""
    kernel, path = tmp_path / f"follow-{tmp_path.name}.toml", tmp_path / "table.csv"
    kernel.write_text(
        "cycle_time = 1e-3\n[[axes]]\nunit = 'deg'\nwrap = 360\nstart = 3605\n"
        "counts_per_unit = 1000.0\ndrive = 'ideal'\n"
        "limits = { velocity = 900, acceleration = 9000, jerk = 200000 }\n"
    )
    Trajectory(["table"], [0.0, 0.6, 1.2], [[5.0], [365.0], [725.0]]).to_csv(path)
    out, err = sjerk("follow", path, "--kernel", kernel, "--json").communicate(timeout=120)
    lines = [json.loads(line) for line in out.splitlines()]
    assert lines[-1]["result"] == "SUCCESSFUL", err
    assert [row["position"] for row in lines[-1]["positions"]] == [4325.0]
    assert all(5.0 <= line["desired"][0] <= 725.0 for line in lines[:-1])


def test_a_bag_in_radians_resampled_and_faster(kernel: Path) -> None:
    """Two joints of the shipped plan, by name, in degrees; progress on standard error."""
    joints = ["panda_joint1", "panda_joint6"]
    run = sjerk(
        *("follow", shipped_recording(), "--kernel", kernel, "--joints", *joints),
        *("--mode", "full_trajectory", "--delta", "10", "--scale", "1.5"),
    )
    out, err = run.communicate(timeout=600)
    assert run.returncode == 0, err
    plan = Trajectory.from_bag(shipped_recording())
    ends = np.degrees(plan.position[-1, [plan.joint_names.index(joint) for joint in joints]])
    assert "way-point" in err
    for axis, end in enumerate(ends.tolist()):
        assert f"axis {axis}  position {round(end, 9)}" in out


def test_what_is_refused_has_exit_code_3(kernel: Path, tmp_path: Path) -> None:
    """A way-point outside the range: code, text with point and joint."""
    path = tmp_path / "far.csv"
    Trajectory(["a", "b"], [0.0, 1.0], [[0.0, 0.0], [0.0, 200.0]]).to_csv(path)
    run = sjerk("follow", path, "--kernel", kernel, "--json")
    out, _ = run.communicate(timeout=600)
    assert run.returncode == 3
    told = json.loads(out.splitlines()[-1])
    assert (told["status"], told["code"]) == ("rejected", -1)
    assert "point 1, joint b" in told["text"]


def test_ctrl_c_stops_on_the_path(kernel: Path, way: Path) -> None:
    """Canceled, at rest on the way, exit code 130."""
    run = sjerk("follow", way, "--kernel", kernel, "--json", "--scale", "0.2")
    assert run.stdout is not None
    seen = 0
    while seen < 5:
        run.stdout.readline()
        seen += 1
    run.send_signal(signal.SIGINT)
    out, _ = run.communicate(timeout=600)
    assert run.returncode == 130
    told = json.loads(out.splitlines()[-1])
    assert told["status"] == "canceled"
    one, two = (row["position"] for row in told["positions"])
    assert 0.0 <= one < 20.0
    assert two == pytest.approx(-one, abs=1e-6)


def test_faults_of_arguments_are_one_line(way: Path) -> None:
    """No such file; no kernel; a joint that is not there."""
    scales = ((way, "--scale", word) for word in ("3", "0", "nan"))
    binary = way.with_name("binary.csv")
    binary.write_bytes(bytes(range(128, 256)))
    for arguments in (
        ("none.csv",),
        (binary, "--name", "nobody"),
        (way, "--name", "nobody"),
        *scales,
    ):
        run = sjerk("follow", *arguments)
        _, err = run.communicate(timeout=600)
        assert run.returncode in (1, 6)
        assert err.count("\n") == 1


def test_a_file_that_is_no_trajectory_is_named_with_its_line(kernel: Path, tmp_path: Path) -> None:
    """The file, the line in it, what stands there, what should."""
    path = tmp_path / "bad.csv"
    path.write_text("time,a,b\n0,1,2\n0.5,x,5\n")
    run = sjerk("follow", path, "--kernel", kernel)
    _, err = run.communicate(timeout=600)
    assert run.returncode == 1
    assert str(path) in err
    assert "line 3: ['0.5', 'x', '5'] is not three numbers" in err


def test_joints_are_those_of_the_file_each_once(kernel: Path, way: Path) -> None:
    """A name that is not in the file, or twice, is refused and named; nothing moves."""
    for joints, told in (
        (("b", "x"), "'x': the file has a, b"),
        (("b", "b"), "'b': is named twice"),
    ):
        run = sjerk("follow", way, "--kernel", kernel, "--joints", *joints)
        _, err = run.communicate(timeout=600)
        assert run.returncode == 1
        assert err == f"sjerk: joints = {told}\n"


NAMED = """
[[axes]]
name = "lift"
unit = "mm"
counts_per_unit = 1000
limits = { velocity = 500, acceleration = 2000, jerk = 200000 }
[[axes]]
unit = "deg"
counts_per_unit = 46603.37777777778
limits = { velocity = 100, acceleration = 200, jerk = 20000 }
[[axes]]
name = "turn"
unit = "rev"
counts_per_unit = 16777216
limits = { velocity = 2, acceleration = 10, jerk = 1000 }
"""


def test_a_joint_is_the_axis_of_its_name_in_any_order(tmp_path: Path) -> None:
    """A file that names turn before lift; a bag of it is in radians and metres."""
    kernel, path = tmp_path / f"follow-{tmp_path.name}.toml", tmp_path / "way.csv"
    kernel.write_text(NAMED)
    Trajectory(["turn", "lift"], [0.0, 1.0], [[0.0, 0.0], [0.25, 40.0]]).to_csv(path)
    out, err = sjerk("follow", path, "--kernel", kernel, "--json").communicate(timeout=600)
    told = json.loads(out.splitlines()[-1])
    assert told["result"] == "SUCCESSFUL", err
    assert {row["axis"]: row["position"] for row in told["positions"]} == {2: 0.25, 0: 40.0}


def test_a_joint_that_no_axis_has_is_refused_where_others_have_theirs(tmp_path: Path) -> None:
    """Nothing moves by order once a name counts."""
    kernel, path = tmp_path / f"follow-{tmp_path.name}.toml", tmp_path / "way.csv"
    kernel.write_text(NAMED)
    Trajectory(["turn", "left"], [0.0, 1.0], [[0.0, 0.0], [0.25, 40.0]]).to_csv(path)
    run = sjerk("follow", path, "--kernel", kernel)
    _, err = run.communicate(timeout=600)
    assert run.returncode == 1
    assert err == (
        "sjerk: joints = 'left': the kernel has lift, axis 1, turn: --joints picks some\n"
    )


def test_progress_never_counts_beyond_the_trajectory(kernel: Path, tmp_path: Path) -> None:
    """With a way onto it, whose points are counted by the kernel too."""
    path = tmp_path / "far.csv"
    Trajectory(["a"], [0.0, 0.5, 1.0], [[20.0], [22.0], [20.0]]).to_csv(path)
    out, err = sjerk("follow", path, "--kernel", kernel, "--json").communicate(timeout=600)
    lines = [json.loads(line) for line in out.splitlines()]
    assert lines[-1]["result"] == "SUCCESSFUL", err
    assert max(line["point"] for line in lines[:-1]) == 3
