"""What the judges of ROS 2 begin with: a client, a controller, an arm at rest."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import rclpy
from action_msgs.msg import GoalStatus

from helpers.ros2_clients import Arm, Client
from helpers.ros_robot import Program, running


@pytest.fixture(scope="session", autouse=True)
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


@pytest.fixture(scope="module")
def controller(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Program]:
    """One controller for the tests that leave it as it was."""
    folder = tmp_path_factory.mktemp("controller")
    with running(folder, "ros2", "controller", "--node-name", "arm") as program:
        yield program


@pytest.fixture
def arm(controller: Program, client: Client) -> Arm:
    """At zero and at rest."""
    made = Arm(client, "arm", controller.kernel)
    goal = made.send([[0.0] * 3], [0.5])
    assert made.result(goal)[0] == GoalStatus.STATUS_SUCCEEDED
    return made
