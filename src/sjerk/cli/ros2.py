"""``sjerk ros2 controller|control``: a kernel behind a ROS 2 node. Never here: topics, motion."""

from __future__ import annotations

import argparse
from typing import Any

from sjerk.cli.nodes import add_node_arguments, check_files
from sjerk.errors import ExtraMissingError, SjerkError
from sjerk.extras import load

_NODES = {
    "controller": "sjerk.ports.ros.ros2_controller",
    "control": "sjerk.ports.ros.ros2_control_node",
}


def add_arguments(jobs: Any) -> None:
    """Add ros2."""
    job = jobs.add_parser(
        "ros2",
        help="be a ROS 2 node on a kernel: trajectory controller, or control node",
        epilog="For example: --ros-args -r joint_states:=/arm/joint_states -p speed:=0.5",
    )
    add_node_arguments(job)
    job.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Be the node until SIGINT or SIGTERM; the exit code."""
    try:
        node = load(_NODES[options.node], extra="ros2")
    except ExtraMissingError as fault:
        what = (
            f"{fault.module!r} is not installed: source a ROS 2, or make one (tools/ros2_venv.sh)"
        )
        raise SjerkError(what) from fault
    return int(node.main(arguments(options)))


def arguments(options: argparse.Namespace) -> list[str]:
    """The options as arguments of ROS; raises InputError for files that are not there."""
    check_files(options)
    words = ["--ros-args"]
    if options.node_name:
        words += ["-r", f"__node:={options.node_name}"]
    if options.params is not None:
        words += ["--params-file", str(options.params)]
    if options.robot is not None:
        words += ["-p", f"kernel.file:={options.robot}"]
    if options.kernel is not None:
        words += ["-p", f"kernel.name:={options.kernel}"]
    if options.joints:
        words += ["-p", f"joints:=[{', '.join(options.joints)}]"]
    return [*words, *options.ros_args]
