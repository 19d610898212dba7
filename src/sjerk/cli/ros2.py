"""``sjerk ros2 controller|control``: a kernel behind a ROS 2 node. Never here: topics, motion."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from sjerk.errors import ExtraMissingError, InputError, SjerkError
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
    job.add_argument("node", choices=sorted(_NODES))
    job.add_argument("robot", nargs="?", type=Path, help="TOML file of a kernel to run as a child")
    job.add_argument("--kernel", metavar="NAME", help="lead this running kernel instead")
    job.add_argument("--params", type=Path, metavar="F.yaml", help="parameters of the node")
    job.add_argument("--node-name", metavar="NAME", help="of the node: the controller's name")
    job.add_argument(
        "--joints",
        nargs="+",
        metavar="JOINT",
        help="one name per axis, in order; default: those of the axes",
    )
    job.add_argument(
        "--ros-args", nargs=argparse.REMAINDER, default=[], help="all further words are ROS's"
    )
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
    words = ["--ros-args"]
    if options.node_name:
        words += ["-r", f"__node:={options.node_name}"]
    for name, file in (("params", options.params), ("robot", options.robot)):
        if file is not None and not file.is_file():
            raise InputError(name, str(file), "is no file")
    if options.params is not None:
        words += ["--params-file", str(options.params)]
    if options.robot is not None:
        words += ["-p", f"kernel.file:={options.robot}"]
    if options.kernel is not None:
        words += ["-p", f"kernel.name:={options.kernel}"]
    if options.joints:
        words += ["-p", f"joints:=[{', '.join(options.joints)}]"]
    return [*words, *options.ros_args]
