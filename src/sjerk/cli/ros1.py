"""``sjerk ros1 controller|control``: a kernel behind a ROS 1 node. Never here: topics, motion."""

from __future__ import annotations

import argparse
from typing import Any

from sjerk.cli.buses import kernel_of
from sjerk.cli.nodes import add_node_arguments, check_files, node_module


def add_arguments(jobs: Any) -> None:
    """Add ros1."""
    job = jobs.add_parser(
        "ros1",
        help="be a ROS 1 node on a kernel: trajectory controller, or control node",
        epilog="For example: --ros-args joint_states:=/arm/joint_states _speed:=0.5",
    )
    add_node_arguments(job)
    job.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Be the node until SIGINT or SIGTERM; the exit code."""
    node = node_module(options.node, 1)
    words = arguments(options)
    return int(node.main(words, options.params, kernel_of))


def arguments(options: argparse.Namespace) -> list[str]:
    """The options as arguments of ROS; raises InputError for files that are not there."""
    check_files(options)
    words = []
    if options.node_name:
        words.append(f"__name:={options.node_name}")
    if options.robot is not None:
        words.append(f"_kernel/file:={options.robot}")
    if options.hardware is not None:
        words.append(f"_kernel/hardware:={options.hardware}")
    if options.kernel is not None:
        words.append(f"_kernel/name:={options.kernel}")
    if options.joints:
        words.append(f"_joints:=[{', '.join(options.joints)}]")
    return [*words, *options.ros_args]
