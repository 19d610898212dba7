"""Unmodified clients of ROS 2 judge the nodes: ``./run test-ros2``.

Each node is a program of its own with a kernel in a process of its own; the clients are rclpy's
action, service, parameter and topic clients in this process, on an isolated domain.
"""

from __future__ import annotations

import json
import math
import os
import secrets
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.ros_robot import (
    LIMITS,
    LONGEST_S,
    NAMES,
    SCALE,
    Program,
    kernel_apart,
    monitor_of,
    running,
)

os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)

import rclpy
from action_msgs.msg import GoalStatus
from cobot_msgs.srv import CobotApiSrv
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTolerance, SpeedScalingFactor
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.action import ActionClient
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import JointState
from sjerk_msgs.msg import MotionState
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from sjerk import Monitor


class Client:
    """One client node, spun here."""

    def __init__(self) -> None:
        self.node = rclpy.create_node("judge", namespace=f"/judge_{secrets.token_hex(4)}")

    def until(self, met: Callable[[], Any], timeout: float = LONGEST_S) -> Any:
        """Spin until something is true; what it is."""
        end = time.monotonic() + timeout
        while not (found := met()):
            if time.monotonic() > end:
                raise TimeoutError(met)
            rclpy.spin_once(self.node, timeout_sec=0.02)
        return found

    def wait(self, future: Any, timeout: float = LONGEST_S) -> Any:
        """The result of a future."""
        self.until(future.done, timeout)
        return future.result()

    def spin(self, seconds: float) -> None:
        """For some time."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            rclpy.spin_once(self.node, timeout_sec=0.01)

    def call(self, kind: type, name: str, request: Any) -> Any:
        """A service's answer."""
        client = self.node.create_client(kind, name)
        self.until(client.service_is_ready)
        answer = self.wait(client.call_async(request))
        self.node.destroy_client(client)
        return answer


@pytest.fixture(scope="module", autouse=True)
def _ros() -> Iterator[None]:
    rclpy.init()
    yield
    rclpy.shutdown()


@pytest.fixture
def client() -> Iterator[Client]:
    """Its own for each test."""
    made = Client()
    yield made
    made.node.destroy_node()


class Arm:
    """The controller, and the clients of its action and topics."""

    def __init__(self, client: Client, name: str) -> None:
        self.client, self.name, self.states = client, name, []
        self.action = ActionClient(
            client.node, FollowJointTrajectory, f"/{name}/follow_joint_trajectory"
        )
        client.until(self.action.server_is_ready)
        client.node.create_subscription(JointState, "/joint_states", self.states.append, 10)
        client.until(lambda: self.states)
        self.server_knows()

    def server_knows(self) -> None:
        """The server finds the client later than the client finds the server."""
        self.client.spin(0.5)  # what the other end has found cannot be asked

    def position(self) -> np.ndarray:
        """The newest joint states."""
        return np.array(self.states[-1].position)

    def send(self, rows: Any, times: Any, names: Any = NAMES, **options: Any) -> Any:
        """The answer to a goal; ``feedback`` of it is called back."""
        feedback = options.pop("feedback", None)
        message = FollowJointTrajectory.Goal(trajectory=way(rows, times, names), **options)
        return self.client.wait(self.action.send_goal_async(message, feedback))

    def arrives(self, at: Any) -> None:
        """Wait until the joint states are there."""
        self.client.until(lambda: np.allclose(self.position(), at, atol=1e-5))

    def moves(self) -> None:
        """Wait until it does."""
        with Monitor.attach(kernel_of(self)) as monitor:
            self.client.until(lambda: monitor.feedback().moving)

    def result(self, goal: Any) -> tuple[int, int, str]:
        """Status, code and text at its end."""
        answer = None
        for _ in range(6):
            # DDS drops an answer whose asker the server has not found yet: then ask again
            try:
                answer = self.client.wait(goal.get_result_async(), LONGEST_S / 6.0)
                break
            except TimeoutError:
                continue
        assert answer is not None, "no result"
        return answer.status, answer.result.error_code, answer.result.error_string


def way(rows: Any, times: Any, names: Any = NAMES) -> JointTrajectory:
    """Positions over times."""
    message = JointTrajectory(joint_names=list(names))
    for row, t in zip(rows, times, strict=True):
        point = JointTrajectoryPoint(positions=[float(x) for x in row])
        point.time_from_start.sec = int(t)
        point.time_from_start.nanosec = round((t - int(t)) * 1e9)
        message.points.append(point)
    return message


@pytest.fixture(scope="module")
def controller(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Program]:
    """One controller for the tests that leave it as it was."""
    folder = tmp_path_factory.mktemp("controller")
    with running(folder, "ros2", "controller", "--node-name", "arm") as program:
        yield program


@pytest.fixture
def arm(controller: Program, client: Client) -> Arm:
    """At zero and at rest."""
    made = Arm(client, "arm")
    goal = made.send([[0.0] * 3], [0.5])
    assert made.result(goal)[0] == GoalStatus.STATUS_SUCCEEDED
    return made


def test_a_plan_arrives_in_its_time_whatever_the_order_of_joints(arm: Arm) -> None:
    """A wave through 21 points; feedback of it comes on the way; each unit is its own."""
    t = np.linspace(0.1, 2.1, 21)
    rows = 0.3 * np.column_stack([np.sin(t - 0.1), np.cos(t - 0.1) - 1, np.sin(t - 0.1) ** 2])
    seen: list[Any] = []
    goal = arm.send(rows[:, ::-1], t, NAMES[::-1], feedback=lambda m: seen.append(m.feedback))
    assert goal.accepted
    assert arm.result(goal)[:2] == (GoalStatus.STATUS_SUCCEEDED, 0)
    arm.arrives(rows[-1])
    assert len(seen) > 10
    assert seen[-1].joint_names == NAMES[::-1]
    assert max(np.abs(m.error.positions).max() for m in seen) < 0.01


def test_a_canceled_goal_is_told_at_rest(arm: Arm) -> None:
    """At random moments of a motion: never CANCELED while it moves."""
    with Monitor.attach(kernel_of(arm)) as monitor:
        for share in (0.1, 0.4, 0.8):
            target = 1.0 if arm.position()[0] < 0.5 else 0.0
            goal = arm.send([[target, -target, target]], [1.5])
            arm.client.until(lambda s=share: abs(monitor.feedback().axes[1].velocity) > 0.5 * s)
            answer = arm.client.wait(goal.cancel_goal_async())
            assert len(answer.goals_canceling) == 1
            status, code, _ = arm.result(goal)
            assert not monitor.feedback().moving
            assert (status, code) == (GoalStatus.STATUS_CANCELED, 0)


KERNELS: dict[str, str] = {}


def kernel_of(arm: Arm) -> str:
    """The name of the kernel behind a controller."""
    return KERNELS[arm.name]


@pytest.fixture(autouse=True)
def _kernels(request: pytest.FixtureRequest) -> None:
    if "controller" in request.fixturenames:
        KERNELS["arm"] = request.getfixturevalue("controller").kernel


def test_goals_replace_each_other_and_each_is_told(arm: Arm) -> None:
    """Forty at 20 Hz: all but the last aborted by name, no stop between them, the last arrives."""
    goals, moving = [], []
    with Monitor.attach(kernel_of(arm)) as monitor:
        for k in range(1, 41):
            goals.append(arm.send([[0.02 * k, 0.0, 0.0]], [2.0]))
            arm.client.spin(0.05)
            moving.append(abs(monitor.feedback().axes[0].velocity))
    told = [arm.result(goal) for goal in goals]
    assert [code for _, code, _ in told] == [-1] * 39 + [0]
    assert all("replaced" in text for _, _, text in told[:-1])
    assert min(moving[8:]) > 0.0
    arm.arrives([0.8, 0.0, 0.0])


@pytest.mark.parametrize("service", ["quick_stop", "halt"])
def test_the_goal_after_a_stop_runs(arm: Arm, service: str) -> None:
    """The stop answers at rest, the goal under way is aborted, the next one is taken at once."""
    goal = arm.send([[1.0, 0.0, 0.0]], [8.0])
    arm.moves()
    assert arm.client.call(Trigger, f"/arm/{service}", Trigger.Request()).success
    with Monitor.attach(kernel_of(arm)) as monitor:
        assert not monitor.feedback().moving
    assert arm.result(goal)[:2] == (GoalStatus.STATUS_ABORTED, -1)
    again = arm.send([[0.1, 0.0, 0.0]], [0.5])
    assert arm.result(again)[:2] == (GoalStatus.STATUS_SUCCEEDED, 0)


def test_hold_and_speed(arm: Arm) -> None:
    """On the path: 0 rests and goes on at 1; hold and resume likewise."""
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    speed = arm.client.node.create_publisher(
        SpeedScalingFactor, "/arm/speed_scaling_input", latched
    )
    goal = arm.send([[1.0, 0.0, 0.0]], [1.5])
    with Monitor.attach(kernel_of(arm)) as monitor:
        arm.client.until(lambda: monitor.feedback().axes[0].position > 0.05 * SCALE[0])
        speed.publish(SpeedScalingFactor(factor=0.0))
        arm.client.until(lambda: monitor.feedback().axes[0].velocity == 0.0)
        at = monitor.feedback().axes[0].position
        assert 0.0 < at < 1.0 * SCALE[0]
        speed.publish(SpeedScalingFactor(factor=1.0))
        arm.client.until(lambda: monitor.feedback().axes[0].position > at)
        assert arm.client.call(SetBool, "/arm/hold", SetBool.Request(data=True)).success
        arm.client.until(lambda: monitor.feedback().axes[0].velocity == 0.0)
        assert arm.client.call(SetBool, "/arm/hold", SetBool.Request(data=False)).success
    assert arm.result(goal)[:2] == (GoalStatus.STATUS_SUCCEEDED, 0)


def test_parameters_change_while_a_goal_runs(arm: Arm) -> None:
    """What is wrong is refused with a reason; what is right holds from the next goal on."""
    parameters = AsyncParameterClient(arm.client.node, "/arm")
    arm.client.until(parameters.services_are_ready)

    def put(**values: Any) -> list[Any]:
        given = [
            rclpy.Parameter(name.replace("__", "."), value=value) for name, value in values.items()
        ]
        return list(arm.client.wait(parameters.set_parameters(given)).results)

    goal = arm.send([[0.5, 0.0, 0.0]], [1.0])
    for wrong in (
        {"execution_mode": "bogus"},
        {"speed": -1.0},
        {"speed": "fast"},
        {"joints": ["a"]},
        {"constraints__nowhere__goal": 1.0},
        {"tolerance": 0.01},  # the axes have different units
        {"invalid_goals": "sometimes"},
    ):
        [answer] = put(**wrong)
        assert not answer.successful
        assert answer.reason
    assert all(answer.successful for answer in put(execution_mode="single_point"))
    assert arm.result(goal)[1] == 0
    service = CobotApiSrv.Request(request_full_trajectory_mode=True, resampling_delta=-1.0)
    answer = arm.client.call(CobotApiSrv, "/cobot_api_service", service)
    assert not answer.success
    got = arm.client.wait(parameters.get_parameters(["execution_mode"])).values[0]
    assert got.string_value == "single_point"  # both or none
    service.resampling_delta = 0.0
    service.acknowledge_error = True
    assert arm.client.call(CobotApiSrv, "/cobot_api_service", service).success
    got = arm.client.wait(parameters.get_parameters(["execution_mode"])).values[0]
    assert got.string_value == "full_trajectory"


def test_wrong_goals_are_refused_and_what_moves_goes_on(arm: Arm) -> None:
    """Fifteen kinds."""
    running_goal = arm.send([[1.0, 0.0, 0.0]], [2.0])
    assert running_goal.accepted
    nan, row = math.nan, [0.1, 0.0, 0.0]
    bad_tolerance = [JointTolerance(name="nobody", position=1.0)]
    wrong = [
        ([], [], {}),
        ([row], [1.0], {"names": ["a", "b", "c"]}),
        ([row], [1.0], {"names": [NAMES[0]] * 3}),
        ([row], [1.0], {"names": NAMES[:2]}),
        ([[0.1]], [1.0], {"names": NAMES[:1]}),
        ([[nan, 0.0, 0.0]], [1.0], {}),
        ([[math.inf, 0.0, 0.0]], [1.0], {}),
        ([[0.1, 0.0]], [1.0], {}),
        ([row, row], [1.0, 1.0], {}),
        ([row, row], [1.0, 0.5], {}),
        ([[9.0, 0.0, 0.0]], [1.0], {}),
        ([[0.0, -9.0, 0.0]], [1.0], {}),
        ([row], [-1.0], {}),
        ([row], [1.0], {"path_tolerance": bad_tolerance}),
        ([row], [1.0], {"goal_tolerance": [JointTolerance(name=NAMES[0], position=-2.0)]}),
    ]
    refused = [arm.send(rows, times, **options).accepted for rows, times, options in wrong]
    assert refused == [False] * len(wrong)
    assert arm.result(running_goal)[:2] == (GoalStatus.STATUS_SUCCEEDED, 0)


def test_a_refusal_can_be_told_as_a_result(arm: Arm) -> None:
    """``invalid_goals`` abort: the client gets code and text."""
    parameters = AsyncParameterClient(arm.client.node, "/arm")
    arm.client.until(parameters.services_are_ready)
    for value in ("abort", "reject"):
        changed = [rclpy.Parameter("invalid_goals", value=value)]
        assert arm.client.wait(parameters.set_parameters(changed)).results[0].successful
        goal = arm.send([[0.1, 0.0, 0.0]], [1.0], ["a", "b", "c"])
        assert goal.accepted == (value == "abort")
        if goal.accepted:
            status, code, text = arm.result(goal)
            assert (status, code) == (GoalStatus.STATUS_ABORTED, -2)
            assert "'a'" in text or "a" in text


def test_deactivate_and_activate(arm: Arm) -> None:
    """The goal is told why, later ones are refused, and after activate the next one runs."""
    goal = arm.send([[1.0, 0.0, 0.0]], [8.0])
    arm.moves()

    def change(number: int) -> bool:
        request = ChangeState.Request(transition=Transition(id=number))
        return bool(arm.client.call(ChangeState, "/arm/change_state", request).success)

    assert change(Transition.TRANSITION_DEACTIVATE)
    status, code, text = arm.result(goal)
    assert (status, code) == (GoalStatus.STATUS_ABORTED, -1)
    assert "deactivated" in text
    assert not arm.send([[0.1, 0.0, 0.0]], [0.5]).accepted
    assert change(Transition.TRANSITION_ACTIVATE)
    again = arm.send([[0.1, 0.0, 0.0]], [0.5])
    assert arm.result(again)[:2] == (GoalStatus.STATUS_SUCCEEDED, 0)


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


def test_the_motion_state_is_one_cycle(arm: Arm) -> None:
    """All joints of the same cycle, in radians and metres."""
    seen: list[Any] = []
    arm.client.node.create_subscription(MotionState, "/arm/motion_state", seen.append, 10)
    arm.client.until(lambda: len(seen) > 2)
    assert seen[-1].name == NAMES
    assert seen[-1].cycle > seen[0].cycle
    assert list(seen[-1].settled) == [True] * 3


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


# ---- streams by topic


def servo(client: Client, publish: Callable[[float], None], rate: float, seconds: float) -> None:
    """Call at a rate by the clock."""
    began = time.monotonic()
    for k in range(int(seconds * rate)):
        while time.monotonic() < began + k / rate:
            rclpy.spin_once(client.node, timeout_sec=0.001)
        publish(time.time())


def test_windows_of_a_servo_node_are_tracked(tmp_path: Path, client: Client) -> None:
    """Windows of 0.1 s at 100 Hz with velocities: off by at most 1 % of the amplitude."""
    more = ["--node-name", "servo", "--ros-args", "-p", "topic_mode:=track"]
    with running(tmp_path, "ros2", "controller", *more) as program:
        arm = Arm(client, "servo")
        publisher = client.node.create_publisher(JointTrajectory, "/servo/joint_trajectory", 10)
        client.until(lambda: publisher.get_subscription_count() == 1)
        began, off = time.time(), []
        amplitude, pace = 0.3, 0.75

        def wanted(t: float) -> tuple[float, float]:
            x = max(0.0, t - began)
            return (
                amplitude * (1 - math.cos(pace * x)),
                amplitude * pace * math.sin(pace * x),
            )

        with Monitor.attach(program.kernel) as monitor:

            def publish(now: float) -> None:
                message = JointTrajectory(joint_names=NAMES)
                stamp = message.header.stamp
                stamp.sec, stamp.nanosec = int(now), int(now % 1 * 1e9)
                for k in range(11):
                    q, v = wanted(now + 0.01 * k)
                    point = JointTrajectoryPoint(positions=[q] * 3, velocities=[v] * 3)
                    point.time_from_start.nanosec = k * 10_000_000
                    message.points.append(point)
                publisher.publish(message)
                if now - began > 1.0:
                    frame = monitor.feedback()
                    age = frame.age or 0.0
                    q, _ = wanted(time.time() - age)
                    off.append(abs(frame.axes[1].position - q))

            servo(client, publish, 100.0, 4.0)
            client.until(lambda: not monitor.feedback().moving)
        print(json.dumps({"off_median": float(np.median(off)), "off_most": max(off)}))
        assert np.median(off) <= 0.01 * amplitude
        assert arm.states


# ---- the control node

#: Apart from what controllers beside it publish.
GOALS = ["-p", "goal_topic:=/goals"]


@pytest.mark.parametrize("mode", ["interrupt", "stream", "track"])
def test_joint_states_are_goals(tmp_path: Path, client: Client, mode: str) -> None:
    """At 10 Hz in degrees turned to radians: none lost, the end is the last one, bit for bit."""
    count = 30
    way_ = 0.6 * (1 - np.cos(np.linspace(0, math.pi, count))) / 2
    more = ["--ros-args", "-p", f"mode:={mode}", "-p", "read_rate:=500.0", *GOALS]
    with running(tmp_path, "ros2", "control", *more) as program:
        states: list[Any] = []
        topic = "/sjerk_control_node/joint_states"
        client.node.create_subscription(JointState, topic, states.append, 10)
        publisher = client.node.create_publisher(JointState, "/goals", 10)
        client.until(lambda: states and publisher.get_subscription_count() == 1)
        rows = iter(way_)

        def publish(now: float) -> None:
            q = float(next(rows))
            message = JointState(name=["gripper", *NAMES[::-1]], position=[9.9, q, q, q])
            stamp = message.header.stamp
            stamp.sec, stamp.nanosec = int(now), int(now % 1 * 1e9)
            publisher.publish(message)

        with Monitor.attach(program.kernel) as monitor:
            servo(client, publish, 10.0, count / 10.0)
            # before the last goal is taken nothing may have come to rest for good
            client.until(
                lambda: (
                    not monitor.feedback().moving
                    and abs(monitor.feedback().axes[1].position - way_[-1]) < 1e-12
                )
            )
            for axis, scale in zip(monitor.feedback().axes, SCALE, strict=True):
                assert axis.position == way_[-1] * scale
                assert axis.peak_velocity <= LIMITS["velocity"] * scale * (1 + 1e-9)
                assert axis.peak_jerk <= LIMITS["jerk"] * scale * (1 + 1e-9)


def test_wrong_joint_states_are_refused_and_counted(tmp_path: Path, client: Client) -> None:
    """The node lives; the motion under way goes on to its goal; best effort is taken too."""
    with (
        running(tmp_path, "ros2", "control", "--ros-args", *GOALS) as program,
        monitor_of(program.kernel) as monitor,
    ):
        publisher = client.node.create_publisher(JointState, "/goals", qos_profile_sensor_data)
        client.until(lambda: publisher.get_subscription_count() == 1)
        goal = JointState(name=NAMES, position=[0.5, 0.0, 0.0])

        def moves() -> bool:
            publisher.publish(goal)  # best effort: one of them comes
            return monitor.feedback().moving

        client.until(moves)
        for names, position in (
            (NAMES, [math.nan, 0.0, 0.0]),
            (NAMES[:2], [0.0, 0.0]),
            (NAMES, [0.0]),
            (NAMES, [9.0, 0.0, 0.0]),
            ([], []),
            ([NAMES[0], *NAMES], [0.0] * 4),
        ):
            publisher.publish(JointState(name=names, position=position))
            client.spin(0.02)
        client.until(lambda: not monitor.feedback().moving)
        assert monitor.feedback().axes[0].position == 0.5 * SCALE[0]
        assert program.process.poll() is None
