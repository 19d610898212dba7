"""Unmodified clients of ROS 2 judge how the nodes begin and end: ``./run test-ros2``."""

from __future__ import annotations

import math
import os
import re
import secrets
import signal
import subprocess
import sys
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from action_msgs.msg import GoalStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.parameter_client import AsyncParameterClient
from std_msgs.msg import String
from std_srvs.srv import Trigger

from helpers.ros2_clients import Arm, Client
from helpers.ros_robot import (
    LIMITS,
    LONGEST_S,
    PANDA,
    SCALE,
    Commands,
    kernel_apart,
    monitor_of,
    panda,
    running,
)
from sjerk.trajectory import shipped_recording
from sjerk.trajectory.files import read_bag

pytest_plugins = ["helpers.ros2_fixtures"]
ROOT = Path(__file__).resolve().parents[3]
PAGE = (ROOT / "docs" / "explanation" / "ros.md").read_text()
[CONTACT] = re.findall(r"```toml\n(# contact.*?)```", PAGE, re.DOTALL)


def test_cleaned_up_and_configured_anew(tmp_path: Path, client: Client) -> None:
    """Under other names of joints; what joint_trajectory_controller alone understands is told."""
    words = ["--joints", "a", "b", "c", "--node-name", "again"]
    words += ["--ros-args", "-p", "command_interfaces:=[position]", "-p", "constraints.b.goal:=0.5"]
    with running(tmp_path, "ros2", "controller", *words) as program:
        arm = Arm(client, "again")
        assert arm.result(arm.send([[0.1, 0.1, 0.0]], [0.5], ["a", "b", "c"]))[1] == 0
        for number in (
            Transition.TRANSITION_DEACTIVATE,
            Transition.TRANSITION_CLEANUP,
            Transition.TRANSITION_CONFIGURE,
            Transition.TRANSITION_ACTIVATE,
        ):
            request = ChangeState.Request(transition=Transition(id=number))
            assert client.call(ChangeState, "/again/change_state", request).success
        client.until(arm.action.server_is_ready)
        arm.server_knows()
        assert arm.result(arm.send([[0.2, 0.0, 0.0]], [0.5], ["a", "b", "c"]))[1] == 0
        told = program.log.read_text()
        assert "without a meaning here: command_interfaces" in told


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_in_motion_stops_tells_and_ends(
    tmp_path: Path, client: Client, number: int
) -> None:
    """SIGINT comes twice, as from a terminal and a launcher."""
    with running(tmp_path, "ros2", "controller", "--node-name", f"hand{number}") as program:
        arm = Arm(client, f"hand{number}")
        goal = arm.send([[1.0, 0.0, 0.0]], [8.0])
        result = goal.get_result_async()
        with monitor_of(program.kernel) as monitor:
            client.until(lambda: monitor.feedback().moving)
        program.process.send_signal(number)
        client.spin(0.05)
        if number == signal.SIGINT:
            program.process.send_signal(number)
        answer = client.wait(result)
        assert answer.result.error_code == -1
        assert "shut down" in answer.result.error_string
        assert program.process.wait(LONGEST_S) == 0


def test_a_killed_node_leaves_the_arm_at_rest(tmp_path: Path, client: Client) -> None:
    """With the kernel in a program of its own; a new node leads on."""
    with kernel_apart(tmp_path) as (kernel, _):
        words = [sys.executable, "-m", "sjerk", "ros2", "controller", "--kernel", kernel]
        with monitor_of(kernel) as monitor, ExitStack() as nodes:
            for kill in (True, False):
                called = "killed" if kill else "next"  # what was killed is known for a while
                node = subprocess.Popen([*words, "--node-name", called])
                nodes.callback(node.kill)
                arm = Arm(client, called)
                goal = arm.send([[1.0 if kill else 0.2, 0.0, 0.0]], [1.5])
                if kill:
                    client.until(lambda: monitor.feedback().moving)
                    node.kill()
                    node.wait()
                    client.until(lambda: not monitor.feedback().moving)
                    peaks = monitor.feedback().axes[0]
                    assert peaks.peak_velocity <= LIMITS["velocity"] * SCALE[0] * (1 + 1e-9)
                    assert peaks.peak_jerk <= LIMITS["jerk"] * SCALE[0] * (1 + 1e-9)
                    arm.action.destroy()
                else:
                    assert arm.result(goal)[1] == 0
                    node.send_signal(signal.SIGTERM)
                    assert node.wait(LONGEST_S) == 0


def test_a_dead_kernel_is_told(tmp_path: Path, client: Client) -> None:
    """Its goal is aborted, the node lives and is inactive."""
    with kernel_apart(tmp_path) as (kernel, apart), monitor_of(kernel) as monitor:
        words = [sys.executable, "-m", "sjerk", "ros2", "controller", "--kernel", kernel]
        node = subprocess.Popen([*words, "--node-name", "lone"])
        try:
            arm = Arm(client, "lone")
            goal = arm.send([[1.0, 0.0, 0.0]], [8.0])
            client.until(lambda: monitor.feedback().moving)
            apart.kill()
            status, code, text = arm.result(goal)
            assert (status, code) == (GoalStatus.STATUS_ABORTED, -1)
            assert text
            assert not arm.send([[0.1, 0.0, 0.0]], [0.5]).accepted
            assert node.poll() is None
        finally:
            node.terminate()
            node.wait(LONGEST_S)


def test_a_recorded_plan_takes_little_more_than_its_time(tmp_path: Path, client: Client) -> None:
    """A TOPP-RA plan of a Panda as recorded, its joints in both orders, then back.

    In cycles of the kernel: at most 1.07 of the plan's time, and within what MoveIt waits for.
    """
    names, times, rows, *_ = read_bag(shipped_recording().parent / "panda.mcap")
    times, rows = np.asarray(times) - times[0], np.asarray(rows)
    lasts = float(times[-1])
    described = partial(panda, start=rows[0].tolist())
    words = ["--node-name", "panda"]
    with running(tmp_path, "ros2", "controller", *words, described=described) as program:
        arm = Arm(client, "panda", program.kernel)
        for order in (1, -1):
            with Commands(program.kernel, scale=[1.0] * 7) as commands:
                goal = arm.send(rows[:, ::order], times, names[::order])
                assert goal.accepted
                assert arm.result(goal)[:2] == (GoalStatus.STATUS_SUCCEEDED, 0)
            took = (commands.moving().stop - commands.moving().start) * 1e-3
            print("plan", lasts, "took", took, "ratio", took / lasts)
            assert commands.position[-1] == pytest.approx(rows[-1], abs=1e-12)
            assert (np.abs(commands.velocity).max(axis=0) <= np.array(PANDA[0]) * 1.000001).all()
            highest = np.abs(commands.acceleration).max(axis=0)
            assert (highest <= np.array(PANDA[1]) * 1.000001).all()
            assert np.abs(commands.jerk).max() <= PANDA[2] * 1.000001
            assert took <= 1.07 * lasts
            assert took <= 1.1 * lasts + 0.5
            back = arm.send([rows[0]], [lasts], names)
            assert arm.result(back)[1] == 0


def contact(folder: Path, name: str) -> Path:
    """A kernel of one axis with a motor, and something hard in its way at 30 degrees."""
    file = folder / "contact.toml"
    file.write_text(CONTACT.replace("NAME", name))
    return file


def test_contact_stops_is_told_and_the_goal_after_a_reset_runs(
    tmp_path: Path, client: Client
) -> None:
    """The axis meets something hard: the file of docs/explanation/ros.md, as it stands there."""
    told: list[Any] = []
    with running(
        tmp_path, "ros2", "controller", "--node-name", "cell", described=contact
    ) as program:
        arm = Arm(client, "cell", program.kernel)
        client.node.create_subscription(String, "/cell/warnings", told.append, 10)
        goal = arm.send([[1.0]], [2.0], ["shoulder"])  # 57 degrees; the way ends at 30
        status, code, text = arm.result(goal)
        print(status, code, text)
        assert (status, code) == (GoalStatus.STATUS_ABORTED, -1)
        assert text
        client.until(lambda: any("shoulder" in m.data for m in told))
        print([m.data for m in told])
        with monitor_of(program.kernel) as monitor:
            client.until(lambda: not monitor.feedback().moving)
            assert monitor.feedback().axes[0].actual_position < 31.0
        assert client.call(Trigger, "/cell/reset", Trigger.Request()).success
        again = arm.send([[0.1]], [1.0], ["shoulder"])
        assert arm.result(again)[:2] == (GoalStatus.STATUS_SUCCEEDED, 0)


#: A file whose drive is on a bus that is not here.
BUS = """
name = "NAME"
cycle_time = 1e-3
[ethercat]
interface = "nowhere0"
[[axes]]
name = "shoulder"
unit = "deg"
counts_per_unit = 46603.37777777778
limits = { velocity = 60, acceleration = 300, jerk = 6000 }
[axes.ethercat]
position = 0
"""


def test_colcon_builds_the_package_and_its_program_runs(tmp_path: Path, client: Client) -> None:
    """``ament_python``; the program as ``ros2 launch`` starts it, with hardware:=simulated."""
    here = os.environ | {"AMENT_PREFIX_PATH": sys.prefix, "PYTHONWARNINGS": "ignore"}
    here["PATH"] = f"{sys.prefix}/bin:{here['PATH']}"
    words = ["colcon", "build", "--base-paths", str(ROOT / "ros2" / "sjerk_ros2")]
    built = subprocess.run(words, cwd=tmp_path, env=here, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    share = tmp_path / "install/sjerk_ros2/share/sjerk_ros2"
    for name in ("controller", "control"):
        text = (share / "launch" / f"{name}.launch.py").read_text()
        compile(text, name, "exec")
        assert f'executable="{name}"' in text
    assert (share.parent / "ament_index/resource_index/packages/sjerk_ros2").exists()
    # what the workspace's setup.sh adds
    [packages] = tmp_path.glob("install/sjerk_ros2/lib/python*/site-packages")
    here["PYTHONPATH"] = str(packages)
    kernel = f"built-{secrets.token_hex(4)}"
    file, params = tmp_path / "bus.toml", tmp_path / "params.yaml"
    file.write_text(BUS.replace("NAME", kernel))
    params.write_text(
        f"/**:\n  ros__parameters:\n    kernel.file: {file}\n    kernel.hardware: simulated\n"
    )
    program = tmp_path / "install/sjerk_ros2/lib/sjerk_ros2/controller"
    options = ["--ros-args", "-r", "__node:=built", "--params-file", str(params)]
    node = subprocess.Popen([str(program), *options], env=here)
    try:
        arm = Arm(client, "built", kernel)
        goal = arm.send([[0.2]], [1.0], ["shoulder"])
        assert arm.result(goal)[:2] == (GoalStatus.STATUS_SUCCEEDED, 0)
        node.send_signal(signal.SIGINT)
        assert node.wait(LONGEST_S) == 0
    finally:
        node.kill()
        node.wait()
    options += ["-p", "kernel.hardware:=ethercat"]
    refused = subprocess.run(
        [str(program), *options], env=here, capture_output=True, text=True, timeout=LONGEST_S
    )
    assert refused.returncode == 1
    assert "nowhere0" in refused.stderr


OWN = os.environ.get("ROS2", "kilted")
OTHER = {"kilted": "jazzy", "jazzy": "kilted"}[OWN]
OTHER_PYTHON = ROOT / f".venv-ros2-{OTHER}" / "bin" / "python"


def installed(distribution: str) -> str:
    """Of which sources the package in an environment was made; nothing where there is none."""
    stamp = ROOT / f".venv-ros2-{distribution}" / ".installed-test-ros2"
    return stamp.read_text() if stamp.exists() else ""


@pytest.mark.skipif(
    installed(OTHER) != installed(OWN),
    reason=f"the other distribution is not here, or old: ROS2={OTHER} ./run test-ros2 makes it",
)
def test_a_controller_of_the_other_distribution_is_served_alike(
    tmp_path: Path, client: Client
) -> None:
    """Goals, results, cancel and parameters; feedback has other fields there (see the page)."""
    own = {"LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE", "PYTHONPATH", "AMENT_PREFIX_PATH"}
    environment = {key: value for key, value in os.environ.items() if key not in own}
    words = ["--node-name", "other"]
    with running(
        tmp_path, "ros2", "controller", *words, python=str(OTHER_PYTHON), environment=environment
    ) as program:
        arm = Arm(client, "other", program.kernel)
        heard: list[Any] = []
        goal = arm.send([[0.3, 0.2, 0.1]], [1.0], feedback=heard.append)
        assert arm.result(goal)[:2] == (GoalStatus.STATUS_SUCCEEDED, 0)
        arm.arrives([0.3, 0.2, 0.1])
        print("feedback heard of the other distribution:", len(heard))
        goal = arm.send([[2.0, 0.2, 0.1]], [8.0])
        arm.moves()
        assert client.wait(goal.cancel_goal_async()).goals_canceling
        assert arm.result(goal)[:2] == (GoalStatus.STATUS_CANCELED, 0)
        goal = arm.send([[2.0, 0.2, 0.1]], [8.0])
        arm.moves()
        after = arm.send([arm.position().tolist()], [2.0])
        assert arm.result(goal)[:2] == (GoalStatus.STATUS_ABORTED, -1)
        assert arm.result(after)[1] == 0
        assert not arm.send([[math.nan, 0.0, 0.0]], [1.0]).accepted
        parameters = AsyncParameterClient(client.node, "/other")
        client.until(parameters.services_are_ready)
        for value, good in ((0.5, True), (-1.0, False)):
            changed = [rclpy.Parameter("speed", value=value)]
            [answer] = client.wait(parameters.set_parameters(changed)).results
            assert answer.successful == good
            assert good or answer.reason
