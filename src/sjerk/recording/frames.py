"""A kernel in the caller's own loop, step by step, with the feedback of every cycle as an array.

Never here: files, motion.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sjerk._binding import dtype_of, ffi
from sjerk.kernel import MotionKernel


class Frames:
    """Steps a kernel in the caller's own loop and keeps the feedback of every cycle.

    A frame has the fields of ``sj_feedback`` but the histograms; its ``axis`` (axes,) those of
    ``sj_axis_feedback``: ``position`` in u, ``velocity`` in u/cycle, ``acceleration`` in u/cycle^2,
    ``jerk`` in u/cycle^3, ``goal_id``, ``moving``, ``follows``, ``target_counts``,
    ``actual_counts`` and more.
    The first frame is that of the cycle before. Raises ``SjerkError`` for a kernel that runs in a
    process of its own.

    >>> from sjerk import Axis, Limits
    >>> frames = Frames(MotionKernel([Axis(Limits(90.0, 500.0, 5000.0), 2**24 / 360)]))
    >>> frames.step(3)["axis"]["moving"].tolist()
    [0]
    >>> frames.table["axis"]["position"].shape, frames.table["cycle"].tolist()
    ((4, 1), [0, 1, 2, 3])
    """

    def __init__(self, kernel: MotionKernel) -> None:
        """Begin with the present frame."""
        self._kernel = kernel
        self._dtype, begin = _without_histograms(len(kernel.axes))
        feedback = ffi.cast("char *", ffi.addressof(kernel.core, "feedback"))
        self._memory = ffi.buffer(feedback + begin, self._dtype.itemsize)
        self._rows = [bytes(self._memory)]

    def step(self, cycles: int = 1) -> Any:
        """Run so many cycles, 1 or more; the frame after the last one."""
        for _ in range(cycles):
            self._kernel.step()
            self._rows.append(bytes(self._memory))
        return self.newest

    @property
    def newest(self) -> Any:
        """The frame of the newest cycle."""
        return np.frombuffer(self._rows[-1], self._dtype)[0]

    @property
    def table(self) -> NDArray[Any]:
        """All frames (cycles,), the first from before any step."""
        return np.frombuffer(b"".join(self._rows), self._dtype)


@cache
def _without_histograms(axes: int) -> tuple[np.dtype[Any], int]:
    """The fields of ``sj_feedback`` from ``cycle`` on, and where they begin."""
    whole = dtype_of("sj_feedback", last=axes)
    begin: int = ffi.offsetof("sj_feedback", "cycle")
    fields = {name: whole[name] for name in whole.names or ()}
    at = {name: ffi.offsetof("sj_feedback", name) - begin for name in fields}
    kept = [name for name in fields if at[name] >= 0]
    return np.dtype(
        {
            "names": kept,
            "formats": [fields[name] for name in kept],
            "offsets": [at[name] for name in kept],
            "itemsize": whole.itemsize - begin,
        }
    ), begin
