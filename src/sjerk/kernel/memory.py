"""The C struct of a kernel: made of its axes, copied, and seen as arrays.

Never here: the cycle, processes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sjerk._binding import dtype_of, ffi, lib
from sjerk.errors import InputError
from sjerk.handshake import Segment
from sjerk.host.reader import layout
from sjerk.kernel.axis import Axis
from sjerk.kernel.reactions import Reactions


def build(axes: Sequence[Axis], cycle_time: float, reactions: Reactions, base: Any) -> Any:
    """The ``sj_kernel *`` of these axes; raises InputError naming the axis."""
    kernel = ffi.new("sj_kernel *")
    T = cycle_time
    lib.sj_kernel_init(kernel, base, len(axes), T)
    reactions.to_c(kernel)
    for i, axis in enumerate(axes):
        try:
            config = axis.to_c(T)
        except InputError as fault:
            raise InputError(f"axes[{i}].{fault.field}", fault.value, fault.limit) from fault
        drive = axis.simulated(T)
        raw = ffi.NULL if drive is None else drive.to_c()
        if lib.sj_kernel_axis(kernel, i, raw, config) != 0:
            raise InputError(f"axes[{i}].drive", drive, "does not fit the cycle time")
        if drive is None:
            continue
        most = kernel.axis[i].drive.scale.jump_limit / config.counts_per_unit
        kernel.axis[i].config.velocity_max = most
        if config.limits.velocity > most:
            raise InputError(
                f"axes[{i}].limits.velocity",
                axis.limits.velocity,
                f"the drive follows up to {most / T:.6g}",
            )
    return kernel


def rehearsal(axes: int, cycle_time: float, *, clocked: bool = True) -> tuple[Any, Segment]:
    """A ``sj_kernel *`` for ``sj_kernel_rehearse``, and the segment it keeps to."""
    copy, segment = ffi.new("sj_kernel *"), Segment.private(layout(axes, clocked=clocked))
    lib.sj_kernel_init(copy, segment.base, axes, cycle_time)
    return copy, segment


def first_frame(kernel: Any) -> Any:
    """A ``sj_feedback *`` that shows what the axes are, before the first cycle too."""
    frame = ffi.new("sj_feedback *", kernel.feedback)
    for i in range(kernel.axes):
        axis, shown = kernel.axis[i], frame.axis[i]
        shown.limits = axis.config.limits
        for name in ("enable", "halts", "quick_stops", "resets", "limit_sets"):
            setattr(shown, name, getattr(axis, name))
    frame.override, frame.hold = kernel.override, kernel.hold
    return frame


def rows(kernel: Any, field: str, axes: int) -> NDArray[Any]:
    """A structured array (axes,) on an array of C structs; it keeps the kernel's memory alive."""
    dtype = dtype_of(ffi.typeof(getattr(kernel, field)).item)
    offset = ffi.offsetof("sj_kernel", field)
    return np.frombuffer(ffi.buffer(kernel), dtype=dtype, count=axes, offset=offset)


def flags(kernel: Any, field: str, axes: int) -> NDArray[np.int32]:
    """An array (axes,) on one of int32 in the struct; it keeps the kernel's memory alive."""
    return np.frombuffer(ffi.buffer(kernel), np.int32, axes, ffi.offsetof("sj_kernel", field))


def commanded(kernel: Any, axes: int) -> NDArray[np.float64]:
    """The commanded positions on the kernel's own memory, which the view keeps alive."""
    size = ffi.sizeof("sj_axis")
    offset = ffi.offsetof("sj_kernel", "axis") + ffi.offsetof("sj_axis", "interpolator", "q", "hi")
    view = np.ndarray((axes,), np.float64, ffi.buffer(kernel), offset, (size,))
    view.flags.writeable = False
    return view
