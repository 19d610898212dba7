"""The cycle-time report: what was asked of the system and granted, and the times of the cycles.

Never here: the loop itself (``_clock.c``), axes.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sjerk._binding import lib


@dataclass(frozen=True)
class Grant:
    """One request to the system: ``asked``, ``granted``, and ``reason`` where not in full."""

    asked: str
    granted: bool
    reason: str

    @classmethod
    def of(cls, asked: str, code: int) -> Grant:
        """Read an ``enum sj_grant``."""
        if code == lib.SJ_GRANT_NOT_ASKED:
            return cls("nothing", True, "")
        if code == lib.SJ_GRANT_PART:
            return cls(asked, True, "the memory of the cycle only, not the whole process")
        return cls(asked, code > 0, os.strerror(-code) if code < 0 else "")


@dataclass(frozen=True)
class ClockReport:
    """What was asked of the system and granted. ``spin`` in seconds, computing not subtracted."""

    scheduling: Grant
    pinning: Grant
    memory: Grant
    spin: float
    spin_asked: float
    realtime_share: float

    @classmethod
    def of(cls, raw: Any) -> ClockReport:
        """Read a ``sj_clock_report``."""
        return cls(
            Grant.of(f"SCHED_FIFO {raw.asked.priority}", raw.priority),
            Grant.of(f"processor {raw.asked.cpu}", raw.cpu),
            Grant.of("locked memory", raw.memory),
            raw.spin_ns * 1e-9,
            raw.asked.spin_ns * 1e-9,
            raw.share,
        )


@dataclass(frozen=True)
class Distribution:
    """A duration over all cycles, seconds. Interpolated in buckets of 6 %.

    ``worst`` is exact over all cycles, and to the bucket over some of them. ``buckets`` (m,): how
    many cycles each bucket has; its edges are ``BUCKET_EDGES`` (m + 1,), seconds.
    """

    count: int
    median: float
    p99: float
    p999: float
    worst: float
    buckets: NDArray[np.int64] = field(
        default_factory=lambda: np.empty(0, np.int64), repr=False, compare=False
    )

    @classmethod
    def of(cls, histogram: Any, since: Any = None) -> Distribution:
        """Read a ``sj_histogram``, or what came to it after an earlier one."""
        buckets = list(histogram.bucket)
        count, worst = int(histogram.count), histogram.worst_ns * 1e-9
        if since is not None:
            buckets = [n - before for n, before in zip(buckets, since.bucket, strict=True)]
            count -= since.count
            if histogram.worst_ns == since.worst_ns:  # the worst was before
                last = max((i for i, n in enumerate(buckets) if n), default=None)
                worst = 0.0 if last is None else min(worst, _edge(last + 1))
        cuts: list[float] = []
        for share in (0.5, 0.99, 0.999):
            below, value = 0, worst
            for i, n in enumerate(buckets):
                if n and below + n >= share * count:
                    inside = (share * count - below) / n  # evenly within the bucket
                    value = _edge(i) + inside * (_edge(i + 1) - _edge(i))
                    break
                below += n
            cuts.append(min(value, worst))
        return cls(count, cuts[0], cuts[1], cuts[2], worst, np.array(buckets, np.int64))


def _edge(bucket: int) -> float:
    """Lower edge of a bucket of a ``sj_histogram``, seconds; the first one begins at 0."""
    octave, step = divmod(bucket, 16)
    return 64e-9 * 2.0**octave * (1.0 + step / 16.0)


#: Edges of the buckets of every ``Distribution``, seconds; the first bucket has all below it, too.
BUCKET_EDGES = np.array([_edge(i) for i in range(lib.SJ_HISTOGRAM_BUCKETS + 1)])


@dataclass(frozen=True)
class Timing:
    """The cycle-time report: wake-up latency, period, computing time, and skipped cycles."""

    latency: Distribution
    period: Distribution
    computing: Distribution
    late: int
    clock: ClockReport
