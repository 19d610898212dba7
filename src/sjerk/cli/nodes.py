"""What the nodes of ROS 1 and of ROS 2 have in common: arguments, programs.

Never here: ROS.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from types import ModuleType

from sjerk.cli.buses import kernel_of
from sjerk.errors import ExtraMissingError, InputError, SjerkError
from sjerk.extras import load

#: Modules of the port by the node's name.
_MODULES = {"controller": "controller", "control": "control_node"}


def add_node_arguments(job: argparse.ArgumentParser) -> None:
    """Add which node, of which kernel, with which joints and parameters."""
    job.add_argument("node", choices=("control", "controller"))
    job.add_argument("robot", nargs="?", type=Path, help="TOML file of a kernel to run as a child")
    job.add_argument("--kernel", metavar="NAME", help="lead this running kernel instead")
    job.add_argument(
        "--hardware",
        choices=("simulated", "ethercat"),
        help="drives of that file; default: as it says",
    )
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


def check_files(options: argparse.Namespace) -> None:
    """Raise InputError for files that are not there."""
    for name, file in (("params", options.params), ("robot", options.robot)):
        if file is not None and not file.is_file():
            raise InputError(name, str(file), "is no file")


def node_module(node: str, ros: int) -> ModuleType:
    """The module of a node of ROS 1 or 2; raises SjerkError where there is no such ROS."""
    try:
        return load(f"sjerk.ports.ros.ros{ros}_{_MODULES[node]}", extra=f"ros{ros}")
    except ExtraMissingError as fault:
        what = f"{fault.module!r} is not installed: source a ROS {ros}"
        raise SjerkError(f"{what}; `./run ros{ros}` in a clone of sjerk makes one") from fault


def ros2_controller() -> int:
    """Of a ROS 2 package: the trajectory controller, with the arguments of the program."""
    return int(node_module("controller", 2).main(None, kernel_of))


def ros2_control() -> int:
    """Of a ROS 2 package: the control node."""
    return int(node_module("control", 2).main(None, kernel_of))


def ros1_controller() -> int:
    """Of a ROS 1 package: the trajectory controller."""
    return int(node_module("controller", 1).main(None, None, kernel_of))


def ros1_control() -> int:
    """Of a ROS 1 package: the control node."""
    return int(node_module("control", 1).main(None, None, kernel_of))
