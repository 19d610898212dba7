"""Debian's unmodified clients of ROS 1 judge the nodes: ``./run test-ros1``.

Each node is a program of its own with a kernel in a process of its own; the clients are rospy's,
actionlib's, rosparam and roslaunch, on a master of their own.
"""

from __future__ import annotations

import math
import os
import secrets
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rospy
from actionlib_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory

from helpers.ros1_clients import TYPES, Arm, attacked, play, ros, until, way
from helpers.ros_robot import (
    LIMITS,
    LONGEST_S,
    NAMES,
    SCALE,
    kernel_apart,
    monitor_of,
    robot,
    running,
)

HERE = Path(__file__).resolve()


@pytest.fixture(scope="module", autouse=True)
def _ros(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with ros(tmp_path_factory.mktemp("log")):
        yield


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Arm]:
    """One controller for the tests that leave it as it was."""
    folder = tmp_path_factory.mktemp("controller")
    with running(folder, "ros1", "controller", "--node-name", "arm") as program:
        yield Arm("arm", program.kernel)


@pytest.fixture
def arm(shared: Arm) -> Arm:
    """At zero and at rest."""
    assert shared.result(shared.send([[0.0] * 3], [0.5]))[0] == GoalStatus.SUCCEEDED
    return shared


def test_the_interfaces_are_those_of_the_field() -> None:
    """The sums by which ROS 1 compares types, as control_msgs has them."""
    sums = {name: kind._md5sum for name, kind in vars(TYPES).items()}
    assert sums == {
        "Action": "bc4f9b743838566551c0390c65f1a248",
        "Goal": "69636787b6ecbde4d61d711979bc7ecb",
        "Result": "493383b18409bfb604b4e26c676401d2",
        "Feedback": "10817c60c2486ef6b33e97dcd87f4474",
        "Tolerance": "f544fe9c16cf04547e135dd6063ff5be",
    }


def test_a_plan_arrives_whatever_the_order_of_joints(arm: Arm) -> None:
    """A wave through 21 points; feedback of it comes on the way; each unit is its own."""
    t = np.linspace(0.1, 2.1, 21)
    rows = 0.3 * np.column_stack([np.sin(t - 0.1), np.cos(t - 0.1) - 1, np.sin(t - 0.1) ** 2])
    seen: list[Any] = []
    goal = arm.send(rows[:, ::-1], t, NAMES[::-1], seen.append)
    assert arm.result(goal)[:2] == (GoalStatus.SUCCEEDED, 0)
    until(lambda: np.allclose(arm.position(), rows[-1], atol=1e-5))
    assert len(seen) > 20
    assert seen[-1].joint_names == NAMES[::-1]
    assert max(np.abs(m.error.positions).max() for m in seen) < 0.01


def test_a_canceled_goal_is_told_at_rest(arm: Arm) -> None:
    """Never PREEMPTED while it moves."""
    with monitor_of(arm.kernel) as monitor:
        for share in (0.1, 0.4, 0.8):
            target = 1.0 if arm.position()[0] < 0.5 else 0.0
            goal = arm.send([[target, -target, target]], [1.5])
            until(lambda s=share: abs(monitor.feedback().axes[1].velocity) > s * 0.5)
            goal.cancel()
            status, code, _ = arm.result(goal)
            assert not monitor.feedback().moving
            assert (status, code) == (GoalStatus.PREEMPTED, 0)


def test_goals_replace_each_other_and_each_is_told(arm: Arm) -> None:
    """Forty at 20 Hz: all but the last aborted by name, no stop between them, the last arrives."""
    goals, moving = [], []
    with monitor_of(arm.kernel) as monitor:
        for k in range(1, 41):
            goals.append(arm.send([[0.02 * k, 0.0, 0.0]], [2.0]))
            time.sleep(0.05)
            moving.append(abs(monitor.feedback().axes[0].velocity))
    told = [arm.result(goal) for goal in goals]
    assert [code for _, code, _ in told] == [-1] * 39 + [0]
    assert all("replaced" in text for _, _, text in told[:-1])
    assert min(moving[8:]) > 0.0


@pytest.mark.parametrize("service", ["quick_stop", "halt"])
def test_the_goal_after_a_stop_runs(arm: Arm, service: str) -> None:
    """The stop answers at rest, the goal under way is aborted, the next one is taken at once."""
    goal = arm.send([[1.0, 0.0, 0.0]], [60.0])
    arm.moves()
    assert rospy.ServiceProxy(f"/arm/{service}", Trigger)().success
    with monitor_of(arm.kernel) as monitor:
        assert not monitor.feedback().moving
    assert arm.result(goal)[:2] == (GoalStatus.ABORTED, -1)
    assert arm.result(arm.send([[0.1, 0.0, 0.0]], [0.5]))[:2] == (GoalStatus.SUCCEEDED, 0)


def test_hold_and_resume(arm: Arm) -> None:
    """On the path: it rests there and goes on."""
    goal = arm.send([[1.0, 0.0, 0.0]], [1.5])
    with monitor_of(arm.kernel) as monitor:
        until(lambda: monitor.feedback().axes[0].position > 0.05 * SCALE[0])
        hold = rospy.ServiceProxy("/arm/hold", SetBool)
        assert hold(True).success
        until(lambda: monitor.feedback().axes[0].velocity == 0.0)
        assert 0.0 < monitor.feedback().axes[0].position < SCALE[0]
        assert hold(False).success
    assert arm.result(goal)[:2] == (GoalStatus.SUCCEEDED, 0)


def test_the_check_before_the_start_tells_each_joint(arm: Arm) -> None:
    """Bus, drive and cycle."""
    answer = rospy.ServiceProxy("/arm/check", Trigger)()
    assert answer.success
    for name in NAMES:
        assert f"{name}: no bus; drive operation_enabled; cycle 1 ms" in answer.message


def test_parameters_hold_from_the_next_goal_on(arm: Arm) -> None:
    """By rosparam: a wrong one refuses the goal with its name; a right one changes no motion."""
    goal = arm.send([[0.5, 0.0, 0.0], [0.0, 0.0, 0.0]], [1.0, 2.0])
    arm.moves()
    arm.parameter("execution_mode", "bogus")
    status, code, text = arm.result(arm.send([[0.1, 0.0, 0.0]], [0.5]))
    assert (status, code) == (GoalStatus.REJECTED, -1)
    assert "execution_mode" in text
    arm.parameter("execution_mode", "full_trajectory")
    arm.parameter("invalid_goals", "abort")
    status, code, _ = arm.result(arm.send([[0.1]], [0.5], ["a"]))
    assert (status, code) == (GoalStatus.ABORTED, -2)
    arm.parameter("invalid_goals", "reject")
    assert arm.result(goal)[:2] == (GoalStatus.SUCCEEDED, 0)


def test_wrong_goals_are_refused_with_reasons_and_what_moves_goes_on(arm: Arm) -> None:
    """Each with a code and a text."""
    going = arm.send([[1.0, 0.0, 0.0]], [2.0])
    arm.moves()
    nan, row = math.nan, [0.1, 0.0, 0.0]
    tolerance = [TYPES.Tolerance(name="nobody", position=1.0)]
    wrong = [
        ([], [], NAMES, {}, -1),
        ([row], [1.0], ["a", "b", "c"], {}, -2),
        ([row], [1.0], [NAMES[0]] * 3, {}, -2),
        ([[0.1]], [1.0], NAMES[:1], {}, -2),
        ([[nan, 0.0, 0.0]], [1.0], NAMES, {}, -1),
        ([[0.1, 0.0]], [1.0], NAMES, {}, -1),
        ([row, row], [1.0, 0.5], NAMES, {}, -1),
        ([[9.0, 0.0, 0.0]], [1.0], NAMES, {}, -1),
        ([row], [1.0], NAMES, {"path_tolerance": tolerance}, -2),
    ]
    for rows, times, names, more, expected in wrong:
        status, code, text = arm.result(arm.send(rows, times, names, **more))
        assert (status, code) == (GoalStatus.REJECTED, expected), text
        assert text
    assert arm.result(going)[:2] == (GoalStatus.SUCCEEDED, 0)


def test_random_wrong_goals_change_no_bit_of_what_moves(arm: Arm) -> None:
    """By action and topic, fields of any size, nan, huge: the motion is that without them."""
    assert attacked(arm, count=200, seconds=4.0) >= 200


def test_a_trajectory_by_topic_moves_and_one_without_points_stops(arm: Arm) -> None:
    """On ``~command``, as controllers of ROS 1 have it."""
    publisher = rospy.Publisher("/arm/command", JointTrajectory, queue_size=1)
    until(publisher.get_num_connections)
    with monitor_of(arm.kernel) as monitor:
        publisher.publish(way([[0.2, 0.0, 0.0]], [0.5]))
        until(lambda: monitor.feedback().axes[0].position == 0.2 * SCALE[0])
        publisher.publish(way([[1.0, 0.0, 0.0]], [8.0]))
        until(lambda: monitor.feedback().axes[0].position > 0.21 * SCALE[0])
        publisher.publish(JointTrajectory(joint_names=NAMES))
        until(lambda: not monitor.feedback().moving)
        assert 0.2 * SCALE[0] < monitor.feedback().axes[0].position < SCALE[0]


def test_diagnostics_tell_kernel_and_joints(arm: Arm) -> None:
    """Of each."""
    seen: dict[str, Any] = {}
    rospy.Subscriber(
        "/diagnostics", DiagnosticArray, lambda m: seen.update({s.name: s for s in m.status})
    )
    until(lambda: all(f"/arm: {what}" in seen for what in ("kernel", "goals", *NAMES)))
    assert {v.key for v in seen["/arm: kernel"].values} >= {"cycle", "late_cycles"}
    assert seen[f"/arm: {NAMES[0]}"].level == 0


def test_the_panda_s_own_yaml_of_ros_2_does(tmp_path: Path) -> None:
    """One file of parameters for both; unknown ones are told."""
    file = tmp_path / "arm.yaml"
    file.write_text(
        "/**:\n  ros__parameters:\n    joints: [a, b, c]\n    command_interfaces: [position]\n"
        "    action_monitor_rate: 10\n    constraints: {goal_time: 1.0, a: {goal: 0.5}}\n"
        "    spede: 1.0\n"
    )
    words = ["--node-name", "named", "--params", str(file)]
    with running(tmp_path, "ros1", "controller", *words) as program:
        arm = Arm("named", program.kernel)
        assert arm.result(arm.send([[0.1, 0.1, 0.0]], [0.5], ["a", "b", "c"]))[1] == 0
        told = program.log.read_text()
        assert "without a meaning here: command_interfaces" in told
        assert "not known: spede" in told


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_in_motion_stops_tells_and_ends(tmp_path: Path, number: int) -> None:
    """SIGINT comes twice, as from a terminal and a launcher."""
    name = f"hand{int(number)}"
    with running(tmp_path, "ros1", "controller", "--node-name", name) as program:
        arm = Arm(name, program.kernel)
        goal = arm.send([[1.0, 0.0, 0.0]], [60.0])
        arm.moves()
        program.process.send_signal(number)
        if number == signal.SIGINT:
            time.sleep(0.05)
            program.process.send_signal(number)
        status, code, text = arm.result(goal)
        assert (status, code) == (GoalStatus.ABORTED, -1)
        assert "shut down" in text
        assert program.process.wait(LONGEST_S) == 0


def test_a_dead_kernel_is_told(tmp_path: Path) -> None:
    """Its goal is aborted with the reason, then the node ends with an error."""
    with kernel_apart(tmp_path) as (kernel, process):
        words = [sys.executable, "-m", "sjerk", "ros1", "controller", "--kernel", kernel]
        node = subprocess.Popen([*words, "--node-name", "lone"])
        try:
            arm = Arm("lone", kernel)
            goal = arm.send([[1.0, 0.0, 0.0]], [60.0])
            arm.moves()
            process.kill()
            status, code, text = arm.result(goal)
            assert (status, code) == (GoalStatus.ABORTED, -1)
            assert text
            assert node.wait(LONGEST_S) == 1
        finally:
            node.kill()
            node.wait()


def test_a_killed_node_leaves_the_arm_at_rest(tmp_path: Path) -> None:
    """With the kernel in a program of its own; a new node leads on."""
    with kernel_apart(tmp_path) as (kernel, _), monitor_of(kernel) as monitor:
        words = [sys.executable, "-m", "sjerk", "ros1", "controller", "--kernel", kernel]
        node = subprocess.Popen([*words, "--node-name", "killed"])
        try:
            arm = Arm("killed", kernel)
            arm.send([[1.0, 0.0, 0.0]], [1.5])
            arm.moves()
        finally:
            node.kill()
            node.wait()
        until(lambda: not monitor.feedback().moving)
        axis = monitor.feedback().axes[0]
        assert axis.peak_velocity <= LIMITS["velocity"] * SCALE[0] * (1 + 1e-9)
        assert axis.peak_jerk <= LIMITS["jerk"] * SCALE[0] * (1 + 1e-9)
        node = subprocess.Popen([*words, "--node-name", "next"])
        try:
            arm = Arm("next", kernel)
            assert arm.result(arm.send([[0.2, 0.0, 0.0]], [0.5]))[1] == 0
            node.terminate()
            assert node.wait(LONGEST_S) == 0
        finally:
            node.kill()
            node.wait()


def test_roslaunch_starts_and_ends_it(tmp_path: Path) -> None:
    """The package as it is, found by ROS_PACKAGE_PATH; SIGINT ends it, and its kernel."""
    kernel = f"launched-{secrets.token_hex(4)}"
    file = robot(tmp_path, kernel)
    package = HERE.parents[3] / "ros1"
    path = os.pathsep.join([str(package), os.environ.get("ROS_PACKAGE_PATH", "")])
    launch = subprocess.Popen(
        ["roslaunch", "sjerk_ros", "controller.launch", f"kernel:={file}", "name:=launched"],
        env=os.environ | {"ROS_PACKAGE_PATH": path},
    )
    try:
        arm = Arm("launched", kernel)
        goal = arm.send([[1.0, 0.0, 0.0]], [60.0])
        arm.moves()
        launch.send_signal(signal.SIGINT)
        assert arm.result(goal)[:2] == (GoalStatus.ABORTED, -1)
        assert launch.wait(LONGEST_S) == 0
    finally:
        launch.terminate()
        launch.wait(LONGEST_S)
    assert list(Path("/dev/shm").glob(f"sjerk-{kernel}*")) == []


# ---- the control node


@pytest.mark.parametrize("mode", ["interrupt", "stream", "track"])
def test_joint_states_are_goals(tmp_path: Path, mode: str) -> None:
    """At 10 Hz in radians to three units: none lost, the end is the last one, bit for bit."""
    count = 30
    rows = iter(0.6 * (1 - np.cos(np.linspace(0, math.pi, count))) / 2)
    own = f"/control_{mode}"  # its topics by their default names, apart from the controller's
    more = ["--ros-args", f"__ns:={own}", f"_mode:={mode}", "_read_rate:=500"]
    with (
        running(tmp_path, "ros1", "control", *more) as program,
        monitor_of(program.kernel) as monitor,
    ):
        states: list[Any] = []
        rospy.Subscriber(f"{own}/sjerk_control_node/joint_states", JointState, states.append)
        publisher = rospy.Publisher(f"{own}/joint_states", JointState, queue_size=10)
        until(lambda: publisher.get_num_connections() and states)
        q = 0.0

        def publish(now: float) -> None:
            nonlocal q
            q = float(next(rows))
            message = JointState(name=["gripper", *NAMES[::-1]], position=[9.9, q, q, q])
            message.header.stamp = rospy.Time.from_sec(now)
            publisher.publish(message)

        play(publish, 10.0, count)
        until(
            lambda: all(
                a.position == q * s for a, s in zip(monitor.feedback().axes, SCALE, strict=True)
            )
        )
        for axis, scale in zip(monitor.feedback().axes, SCALE, strict=True):
            assert axis.peak_velocity <= LIMITS["velocity"] * scale * (1 + 1e-9)
            assert axis.peak_jerk <= LIMITS["jerk"] * scale * (1 + 1e-9)
        publisher.unregister()


def test_wrong_joint_states_are_refused_and_counted(tmp_path: Path) -> None:
    """The node lives; the motion under way goes on to its goal; diagnostics tell how many."""
    more = ["--node-name", "control", "--ros-args", "_goal_topic:=/wrong_goals"]
    seen: list[dict[str, str]] = []
    done = threading.Event()

    def look(message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == "/control: goals, interrupt":
                seen.append({row.key: row.value for row in status.values})
                if seen[-1]["refused"] == "6":
                    done.set()

    with (
        running(tmp_path, "ros1", "control", *more) as program,
        monitor_of(program.kernel) as monitor,
    ):
        rospy.Subscriber("/diagnostics", DiagnosticArray, look)
        publisher = rospy.Publisher("/wrong_goals", JointState, queue_size=10)
        until(publisher.get_num_connections)
        publisher.publish(JointState(name=NAMES, position=[0.5, 0.0, 0.0]))
        until(lambda: monitor.feedback().moving)
        for names, position in (
            (NAMES, [math.nan, 0.0, 0.0]),
            (NAMES[:2], [0.0, 0.0]),
            (NAMES, [0.0]),
            (NAMES, [9.0, 0.0, 0.0]),
            ([], []),
            ([NAMES[0], *NAMES], [0.0] * 4),
        ):
            publisher.publish(JointState(name=names, position=position))
        until(lambda: monitor.feedback().axes[0].position == 0.5 * SCALE[0])
        assert done.wait(LONGEST_S), seen[-1:]
        assert program.process.poll() is None
