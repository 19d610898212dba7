"""The main job as a user runs it, and what it reads."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sjerk import Axis, DriveConfig
from sjerk.cli import feed_forward
from sjerk.cli.demo import COUNTS_PER_DEGREE, LIMITS, dips
from sjerk.trajectory import RecordedPath, RecordedPathError, read_recording, shipped_recording

CSV = shipped_recording().with_name("panda_joint1.csv")


def test_the_shipped_recordings_are_one_plan_in_two_forms() -> None:
    """54 points at 0.1 s, 0 to 160 degrees, below 90 degrees/s; CSV and MCAP agree."""
    bag, table = read_recording(shipped_recording()), read_recording(CSV)
    assert bag.joint == "panda_joint1"
    assert len(bag.time) == len(table.time) == 54
    np.testing.assert_allclose(bag.position, table.position, rtol=0, atol=1e-8)
    np.testing.assert_allclose(bag.time, table.time, rtol=0, atol=1e-8)
    np.testing.assert_allclose(np.diff(bag.time)[:-1], 0.1)
    assert bag.position[0] == 0.0
    assert bag.position[-1] == pytest.approx(160.0)
    assert np.max(np.abs(np.diff(bag.position) / np.diff(bag.time))) < 90.0


def test_other_joints_of_a_bag_by_name() -> None:
    """A joint is picked by name; an unknown one is told with those there are."""
    assert read_recording(shipped_recording(), joint="panda_joint4").position[0] < -100.0
    with pytest.raises(ValueError, match="panda_joint7"):
        read_recording(shipped_recording(), joint="elbow")


def test_joint_states_make_a_path(tmp_path: Path) -> None:
    """A bag of JointState messages gives one point per message, in either storage."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    JointState = types.types["sensor_msgs/msg/JointState"]
    Header, Time = types.types["std_msgs/msg/Header"], types.types["builtin_interfaces/msg/Time"]
    for plugin in StoragePlugin:
        bag = tmp_path / plugin.name
        with Writer(bag, version=9, storage_plugin=plugin) as writer:
            topic = writer.add_connection("/joint_states", JointState.__msgtype__, typestore=types)
            for i in range(5):
                q = np.array([0.5, 0.1 * i])
                message = JointState(Header(Time(0, 0), ""), ["a", "b"], q, q, q)
                raw = types.serialize_cdr(message, JointState.__msgtype__)
                writer.write(topic, 10**9 + i * 10**8, raw)
        path = read_recording(bag, joint="b")
        np.testing.assert_allclose(path.time, [0.0, 0.1, 0.2, 0.3, 0.4])
        np.testing.assert_allclose(np.radians(path.position), [0.0, 0.1, 0.2, 0.3, 0.4])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "header"),
        ("t,q\n0,1\n1,2\n", "header"),
        ("time_s,position_deg\n", "0 points"),
        ("time_s,position_deg\n0,1\n", "1 points"),
        ("time_s,position_deg\n0,1\n1,two\n", "point 1.*two numbers"),
        ("time_s,position_deg\n0,1\n1,2,3\n", "point 1.*two numbers"),
        ("time_s,position_deg\n0,1\n1,nan\n", "point 1.*not finite"),
        ("time_s,position_deg\n0,1\n1,2\n1,3\n", "point 2.*does not follow"),
    ],
)
def test_bad_tables_are_refused_with_the_point(text: str, message: str, tmp_path: Path) -> None:
    """Which file, which point, what is wrong."""
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(RecordedPathError, match=message):
        read_recording(path)


def test_bad_bags_are_refused(tmp_path: Path) -> None:
    """No file, no bag: one clear error."""
    with pytest.raises(RecordedPathError, match="no such file"):
        read_recording(tmp_path / "none.mcap")
    garbage = tmp_path / "garbage.mcap"
    garbage.write_bytes(b"no bag at all" * 100)
    with pytest.raises(RecordedPathError, match="no readable bag"):
        read_recording(garbage)


def sjerk(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "sjerk", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_the_demo_arrives_and_draws(tmp_path: Path) -> None:
    """`sjerk demo` on a CSV: the table, the picture, the goal met, exit code 0."""
    picture = tmp_path / "out.png"
    run = sjerk("demo", str(CSV), "--out", str(picture))
    out, err = run.communicate(timeout=120)
    assert run.returncode == 0, err
    assert picture.read_bytes().startswith(b"\x89PNG")
    rows = {line[:46].split(",")[0].strip(): line[46:].split() for line in out.splitlines()}
    errors = rows["final error 1 s later"]
    assert [abs(int(n)) <= 10 for n in errors if n != "increments"] == [True] * 4
    for name, limit in (("velocity", 90.0), ("acceleration", LIMITS.acceleration)):
        peaks = [float(x) for x in rows[f"largest {name}"] if not x.startswith("(")]
        assert len(peaks) == 4
        assert max(peaks) <= float(f"{limit:.4f}")  # printed as the peaks are
    assert "left out by the clock" in rows
    # what the streams ask for themselves, whatever this machine does
    jerks = [float(x.rstrip("%")) for x in rows["largest jerk"]]
    assert max(jerks[:2]) <= 95.0
    assert rows["turns that the path does not have"] == ["0", "0", "0"]
    assert rows["dips of the velocity > 10 %"] == ["1", "1", "0"]  # the path's own is 1
    fed = {name: [float(x.rstrip("%")) for x in rows[name]] for name in rows if "deg: " in name}
    none, own, _, both = fed["160 deg: largest 60F4h over v / Kp"]
    assert none == pytest.approx(100.0, abs=0.1)
    assert own > 6.0
    assert both < 1.0
    assert fed["10 deg: overshoot"][3] <= 0.3 < fed["10 deg: overshoot"][1]
    assert "computing time" in out
    assert "100 %" in err


def _without_namespaces(folder: Path) -> dict[str, str]:
    """An environment whose `unshare` refuses, as on a machine that does not let users have any."""
    refusing = folder / "unshare"
    refusing.write_text("#!/bin/sh\necho 'unshare: unshare failed: not permitted' >&2\nexit 1\n")
    refusing.chmod(0o755)
    return {**os.environ, "PATH": f"{folder}:{os.environ['PATH']}"}


def test_the_demo_on_a_cable_says_in_one_line_what_is_missing(tmp_path: Path) -> None:
    """No namespace, or no program that makes one: exit code 1, nothing has moved."""
    nowhere = {**os.environ, "PATH": str(tmp_path / "empty")}
    for environment, said in (
        (_without_namespaces(tmp_path), "no network namespace with a pair of cables: unshare: "),
        (nowhere, "a network namespace needs the program unshare"),
    ):
        done = subprocess.run(
            [sys.executable, "-m", "sjerk", "demo", "--ethercat", "--out", str(tmp_path / "a.png")],
            capture_output=True,
            text=True,
            env=environment,
            timeout=60,
        )
        assert done.returncode == 1
        assert done.stderr.count("\n") == 1
        assert said in done.stderr
        assert not done.stdout
    assert not (tmp_path / "a.png").exists()


def test_ctrl_c_stops_the_motor_along_a_ramp(tmp_path: Path) -> None:
    """SIGINT in full motion: rest, exit code 130, and no segment stays."""
    run = sjerk("demo", str(CSV), "--out", str(tmp_path / "none.png"))
    assert run.stderr is not None
    assert run.stdout is not None
    seen = ""
    while " 10 %" not in seen:
        seen += run.stderr.read(1)
    run.send_signal(signal.SIGINT)
    out, _ = run.communicate(timeout=60)
    assert run.returncode == 130
    stopped = out.splitlines()[-1]
    assert stopped.endswith("velocity 0 deg/s")
    assert 16.0 <= float(stopped.split()[2]) <= 160.0  # a busy machine may see the end
    assert not [e for e in Path("/dev/shm").iterdir() if f"kernel-{run.pid}-" in e.name]


def test_errors_of_the_command_line_are_one_line(tmp_path: Path) -> None:
    """A missing file is no traceback."""
    run = sjerk("demo", str(tmp_path / "none.csv"))
    _, err = run.communicate(timeout=60)
    assert run.returncode == 1
    assert err.count("\n") == 1
    assert "no such file" in err


def test_what_is_fed_forward_is_shown_for_any_way() -> None:
    """Without friction the drive's own does as well; backwards too; of no way a short one."""
    for friction, start, goal in ((0.0, 0.0, 160.0), (0.04, 20.0, -140.0), (0.04, 5.0, 5.0)):
        drive = DriveConfig(friction_nm=friction)
        axis = Axis(LIMITS, COUNTS_PER_DEGREE, drive, unit="deg")
        lines = feed_forward.table(axis, start, goal, 1e-3).splitlines()
        assert len(lines) == (3 if start == goal else 5)
        none, own, velocity, both = (float(x.rstrip("%")) for x in lines[1][46:].split())
        assert none > 98.0
        assert (max(own, velocity) < 1.0) == (friction == 0.0)
        assert both < 1.0


def test_dips_are_counted() -> None:
    """A fall of more than a tenth that rises again is one dip; a stop at the end is none."""
    assert dips(np.array([0.0, 5.0, 10.0, 9.5, 10.0, 0.0])) == 0
    assert dips(np.array([0.0, -10.0, -8.0, -10.0, -2.0, -9.0, 0.0])) == 2


def test_a_recording_is_plain_data() -> None:
    """Frozen."""
    recording = RecordedPath("a", np.zeros(2), np.zeros(2))
    with pytest.raises(AttributeError):
        recording.joint = "b"  # type: ignore[misc]
