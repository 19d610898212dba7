"""The histograms of the panel."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from sjerk.host import BUCKET_EDGES, Distribution
from sjerk.ports.panel.timing_tab import steps

BUCKETS = len(BUCKET_EDGES) - 1


@given(st.integers(0, BUCKETS - 1), st.integers(1, BUCKETS), st.integers(0, 2**32 - 1))
def test_a_histogram_is_drawn_over_whole_decades(first: int, width: int, seed: int) -> None:
    """Every bucket at its place; the page hangs on a logarithmic axis shorter than a decade."""
    buckets = np.zeros(BUCKETS, dtype=np.int64)
    own = buckets[first : first + width]
    own[:] = np.random.default_rng(seed).integers(1, 10**6, len(own))
    x, y = steps(Distribution(int(own.sum()), 0.0, 0.0, 0.0, 0.0, buckets))
    assert len(x) == len(y)
    assert (np.diff(x) > 0.0).all()
    for end in (x[0], x[-1]):
        assert abs(np.log10(end) - round(np.log10(end))) < 1e-9
    assert x[-1] >= 9.99 * x[0]
    assert y[0] == y[-1] == 0.0
    middles = 1e6 * (BUCKET_EDGES[:-1] + BUCKET_EDGES[1:]) / 2
    at = np.searchsorted(x, middles, side="right") - 1  # of a step function
    shown = np.where((at >= 0) & (at < len(y)), y[at.clip(0, len(y) - 1)], 0.0)
    assert np.allclose(shown, np.log10(1.0 + buckets))


def test_no_cycle_yet_is_drawn_too() -> None:
    """Right after a reset."""
    x, y = steps(Distribution(0, 0.0, 0.0, 0.0, 0.0, np.zeros(BUCKETS, dtype=np.int64)))
    assert x.tolist() == [0.1, 1.0]
    assert not y.any()
