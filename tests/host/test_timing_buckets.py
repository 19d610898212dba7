"""Histograms of the cycle-time report: every cycle is in one bucket."""

from __future__ import annotations

import time

import numpy as np

from sjerk import Axis, Limits, Monitor, MotionKernel
from sjerk.host import BUCKET_EDGES


def test_every_cycle_is_in_one_bucket_and_the_cuts_are_in_theirs(name: str) -> None:
    """Of all cycles, and of those since an earlier frame."""
    axis = Axis(Limits(90.0, 500.0, 5000.0), 2**24 / 360)
    with MotionKernel([axis], name=name) as kernel, Monitor.attach(kernel.name) as monitor:
        first = monitor.feedback()
        while (last := monitor.feedback()).cycle < first.cycle + 200:
            time.sleep(0.005)
    assert (np.diff(BUCKET_EDGES) > 0).all()
    for timing in (last.timing, last.timing_since(first)):
        for one in (timing.latency, timing.period, timing.computing):
            assert len(one.buckets) == len(BUCKET_EDGES) - 1
            assert one.buckets.min() >= 0
            assert one.buckets.sum() == one.count
            above = np.cumsum(one.buckets) >= 0.5 * one.count
            k = int(above.argmax())
            assert BUCKET_EDGES[k] <= one.median * (1 + 1e-12) or one.median == one.worst
            assert one.median <= BUCKET_EDGES[k + 1] * (1 + 1e-12)
