"""How a node comes to its kernel and to its joints, by its parameters. Never here: ROS."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from typing import Any

from sjerk.errors import InputError
from sjerk.host import Host
from sjerk.kernel import MotionKernel
from sjerk.ports.ros.joints import Joints

#: A kernel of a file, with its drives as ``kernel.hardware`` says; whoever knows buses gives it.
KernelOf = Callable[[str, str], MotionKernel]


def lead(value: Callable[[str], Any], open_: ExitStack, kernel_of: KernelOf) -> Host:
    """Become the host of the kernel that the parameters name; ``open_`` ends it.

    Raises InputError and what ``kernel_of`` and ``Host.attach`` raise.
    """
    file, name = value("kernel.file"), value("kernel.name")
    if bool(file) == bool(name):
        what = "exactly one of kernel.file and kernel.name must be given"
        raise InputError("kernel", file or name, what)
    if file:
        kernel = open_.enter_context(kernel_of(file, value("kernel.hardware")))
        return open_.enter_context(kernel.host())
    return open_.enter_context(Host.attach(name, wait=2.0))


def joints_of(given: Sequence[str], host: Host) -> Joints:
    """The joints by these names, else by those of the axes; raises InputError."""
    units = [axis.unit for axis in host.feedback().axes]
    return Joints.of([name for name in given if name] or host.names, units)
