"""Kernels in the test's own loop: one cycle at each ``step``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sjerk import Axis, Host, MotionKernel


def enabled(
    axes: Sequence[Axis], cycle_time: float = 1e-3, **more: Any
) -> tuple[MotionKernel, Host]:
    """A kernel and its host after some cycles, every drive enabled and following."""
    kernel = MotionKernel(axes, cycle_time, **more)
    host = kernel.host()
    host.enable()
    kernel.step(10)
    assert all(axis.follows for axis in host.feedback().axes)
    return kernel, host
