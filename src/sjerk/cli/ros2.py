"""``sjerk ros2 controller|control``: a kernel behind a ROS 2 node. Never here: topics, motion."""

from __future__ import annotations

import argparse
from typing import Any

from sjerk.cli.buses import kernel_of
from sjerk.cli.nodes import add_node_arguments, check_files, node_module


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
    node = node_module(options.node, 2)
    return int(node.main(arguments(options), kernel_of))


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
    if options.hardware is not None:
        words += ["-p", f"kernel.hardware:={options.hardware}"]
    if options.kernel is not None:
        words += ["-p", f"kernel.name:={options.kernel}"]
    if options.joints:
        words += ["-p", f"joints:=[{', '.join(options.joints)}]"]
    return [*words, *options.ros_args]
