"""A client of ROS 2 that sends a goal and waits, to be killed: ``main(controller, domain)``."""

from __future__ import annotations

import os

import rclpy

from helpers.ros2_clients import Arm, Client


def main(name: str, domain: str) -> None:
    """Send a slow goal, and spin on."""
    os.environ["ROS_DOMAIN_ID"] = domain  # that of whoever began this
    rclpy.init()
    client = Client()
    Arm(client, name).send([[0.8, 0.0, 0.0]], [3.0])
    client.spin(60.0)
