"""The last seconds of every axis: each cycle, and its least and largest per bucket to be drawn.

Fed with the kernel's trace as it comes; each cycle is looked at once, so no peak is lost. Never
here: pages, files.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sjerk.kernel.trace import Chunk

FloatArray = NDArray[np.float64]

SIGNALS = (
    "position",
    "actual position",
    "velocity",
    "actual velocity",
    "acceleration",
    "jerk",
    "following error",
)


class Scope:
    """Signals of N axes; ``counts`` (N,): increments of the drive per axis unit."""

    def __init__(
        self, counts: ArrayLike, cycle_time: float, *, seconds: float = 8.0, buckets: int = 240
    ) -> None:
        self.cycle_time, self.seconds = cycle_time, seconds
        self._counts = np.asarray(counts, float)
        self.axes = len(self._counts)
        self._size = max(1, round(seconds / cycle_time / buckets))  # cycles of a bucket
        shape = (buckets, self.axes, len(SIGNALS))
        self._low, self._high = np.full(shape, np.nan), np.full(shape, np.nan)
        self._rest = np.empty((0, *shape[1:]))
        self._all: list[tuple[NDArray[Any], FloatArray]] = []
        self._before: FloatArray | None = None
        #: Of the drawn points, two a bucket, seconds before now.
        self.time = (np.arange(-2 * buckets, 0) + 1) * (self._size * cycle_time / 2.0)
        self.missed = 0

    def feed(self, chunk: Chunk) -> None:
        """Take what the trace has had since."""
        self.missed += int(chunk.missed.sum())
        axis, T = chunk.frames["axis"], self.cycle_time
        actual = axis["actual_counts"] / self._counts
        before = actual[:1] if self._before is None else self._before
        columns = (
            axis["position"],
            actual,
            axis["velocity"] / T,
            np.diff(actual, axis=0, prepend=before) / T,
            axis["acceleration"] / T**2,
            axis["jerk"] / T**3,
            axis["following_error"] / self._counts,
        )
        rows = np.stack(columns, axis=-1)
        self._before = actual[-1:]
        self._keep(chunk.frames["head"]["cycle"].copy(), rows)
        rows = np.concatenate([self._rest, rows])
        n = len(rows) // self._size
        self._rest = rows[n * self._size :]
        if n:
            whole = rows[: n * self._size].reshape(n, self._size, *rows.shape[1:])
            whole = whole[-len(self._low) :]
            k = len(whole)
            for kept, new in ((self._low, whole.min(axis=1)), (self._high, whole.max(axis=1))):
                kept[:-k] = kept[k:].copy()
                kept[-k:] = new

    def _keep(self, cycles: NDArray[Any], rows: FloatArray) -> None:
        self._all.append((cycles, rows))
        kept = sum(len(c) for c, _ in self._all)
        while kept - len(self._all[0][0]) >= self.seconds / self.cycle_time:
            kept -= len(self._all.pop(0)[0])

    def drawn(self, axis: int, signal: str) -> FloatArray:
        """Of one axis: least, largest, least, ... (2 buckets,), as ``time``."""
        k = SIGNALS.index(signal)
        found: FloatArray = np.stack([self._low[:, axis, k], self._high[:, axis, k]], 1).ravel()
        return found

    def every_cycle(self) -> tuple[NDArray[Any], FloatArray]:
        """The cycles of the last seconds (n,), and their signals (n, N, ``SIGNALS``)."""
        if not self._all:
            return np.empty(0, np.uint64), np.empty((0, self.axes, len(SIGNALS)))
        cycles, rows = zip(*self._all, strict=True)
        return np.concatenate(cycles), np.concatenate(rows)

    def csv(self, axes: list[int], names: list[str]) -> bytes:
        """Every cycle of the last seconds of some axes, with a line of names first."""
        cycles, rows = self.every_cycle()
        head = ["cycle", "time_s"]
        columns = [cycles.astype(float), cycles * self.cycle_time]
        for i in axes:
            for k, signal in enumerate(SIGNALS):
                head.append(f"{names[i]} {signal}".replace(",", " "))
                columns.append(rows[:, i, k])
        lines = [",".join(head)]
        lines += [",".join(repr(v) for v in row) for row in np.stack(columns, 1).tolist()]
        return ("\n".join(lines) + "\n").encode()
