"""The last seconds of every axis: each cycle, and its least and largest per bucket to be drawn.

Fed with the kernel's trace as it comes; each cycle is looked at once, so no peak is lost. Never
here: pages, files.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
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
        self._all: list[tuple[NDArray[Any], NDArray[Any], FloatArray]] = []
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
        frames = chunk.frames
        self._keep(frames["head"]["cycle"].copy(), frames["time_ns"].astype(np.int64), rows)
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

    def _keep(self, cycles: NDArray[Any], stamps: NDArray[Any], rows: FloatArray) -> None:
        self._all.append((cycles, stamps, rows))
        kept = sum(len(c) for c, _, _ in self._all)
        while kept - len(self._all[0][0]) >= self.seconds / self.cycle_time:
            kept -= len(self._all.pop(0)[0])

    def drawn(self, axis: int, signal: str) -> FloatArray:
        """Of one axis: least, largest, least, ... (2 buckets,), as ``time``."""
        k = SIGNALS.index(signal)
        found: FloatArray = np.stack([self._low[:, axis, k], self._high[:, axis, k]], 1).ravel()
        return found

    def snapshot(self, axes: list[int], *, after: int = -1) -> Snapshot:
        """Every cycle of the last seconds of some axes, of those after the cycle ``after``."""
        parts = [part for part in list(self._all) if len(part[0]) and int(part[0][-1]) > after]
        empty = (
            np.empty(0, np.uint64),
            np.empty(0, np.int64),
            np.empty((0, len(axes), len(SIGNALS))),
        )
        cycles, stamps, rows = empty
        if parts:
            cycles, stamps, _ = (np.concatenate(one) for one in zip(*parts, strict=True))
            rows = np.concatenate([part[2][:, axes] for part in parts])
        later = cycles.astype(np.int64) > after
        return Snapshot(cycles[later], stamps[later], rows[later], self.cycle_time)


@dataclass(frozen=True)
class Snapshot:
    """Cycles (n,) and their signals (n, axes, ``SIGNALS``), in axis units and seconds.

    ``stamps`` (n,): when each began, ns of the clock: a late clock leaves cycles out, which are
    time all the same.
    """

    cycles: NDArray[Any]
    stamps: NDArray[Any]
    rows: FloatArray
    cycle_time: float

    def of(self, axes: list[int]) -> Snapshot:
        """Some of its axes only."""
        return replace(self, rows=self.rows[:, axes])

    def between(self, begin: float, end: float) -> Snapshot:
        """Those from ``begin`` to ``end``, seconds before the last one (-8, 0)."""
        if not len(self.cycles):
            return self
        before = (self.stamps - self.stamps[-1]) * 1e-9
        half = self.cycle_time / 2.0  # a clock is never exactly in time
        inside = (begin - half <= before) & (before <= end + half)
        return Snapshot(
            self.cycles[inside], self.stamps[inside], self.rows[inside], self.cycle_time
        )

    def drawn(
        self, axis: int, signal: str, *, origin: int, most: int = 480
    ) -> tuple[FloatArray, FloatArray]:
        """Seconds since ``origin`` (ns), and values: least and largest of each bucket.

        At most so many; where there are no more cycles than that, each of them.
        """
        values = self.rows[:, axis, SIGNALS.index(signal)]
        time: FloatArray = (self.stamps - origin) * 1e-9
        if len(values) <= most:
            return time, values
        edges = np.linspace(0, len(values), most // 2 + 1).astype(int)
        low = np.minimum.reduceat(values, edges[:-1])
        high = np.maximum.reduceat(values, edges[:-1])
        middle = (edges[:-1] + edges[1:]) // 2
        return (
            np.stack([time[edges[:-1]], time[middle]], axis=1).ravel(),
            np.stack([low, high], axis=1).ravel(),
        )

    def columns(self, names: list[str]) -> dict[str, NDArray[Any]]:
        """As columns of a file; ``names``: of the axes."""
        found: dict[str, NDArray[Any]] = {
            "cycle": self.cycles,
            "time_s": (self.stamps - self.stamps[:1]) * 1e-9,
        }
        for i, name in enumerate(names):
            for k, signal in enumerate(SIGNALS):
                found[f"{name} {signal}"] = self.rows[:, i, k]
        return found

    def csv(self, names: list[str]) -> bytes:
        """Every cycle, with a line of names first; numbers keep every bit."""
        columns = self.columns(names)
        lines = [",".join(name.replace(",", " ") for name in columns)]
        lines += [
            ",".join(map(repr, row))
            for row in zip(*(column.tolist() for column in columns.values()), strict=True)
        ]
        return ("\n".join(lines) + "\n").encode()
