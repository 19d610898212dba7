"""Timing: latency, period and computing time of the cycles, as quantiles and histograms.

Each browser counts from its own reset; the kernel's report goes on. Never here: how a cycle is
timed.
"""

from __future__ import annotations

import html
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sjerk.host import BUCKET_EDGES, Distribution, Feedback

_TIMES = ("latency", "period", "computing")


class TimingTab:
    """Of one browser, in a tab that all share."""

    def __init__(self, gui: Any, tab: Any) -> None:
        self._since: Feedback | None = None
        self._reset = False
        with tab:
            self._times = gui.add_html("")
            self._begin = gui.add_button("Count from now", hint="the kernel's own report goes on")
            self._histograms = {key: _histogram(gui, key) for key in _TIMES}
        self._begin.on_click(lambda _: self._asked())

    def _asked(self) -> None:
        self._reset = True

    def restart(self) -> None:
        """Another kernel runs."""
        self._reset, self._since = False, None

    def show(self, feedback: Feedback) -> None:
        """The report since the last reset, or of all cycles of this kernel."""
        if self._reset:
            self._reset, self._since = False, feedback
        since = self._since
        timing = feedback.timing if since is None else feedback.timing_since(since)
        rows = []
        for key in _TIMES:
            one: Distribution = getattr(timing, key)
            cells = (one.median, one.p99, one.p999, one.worst)
            rows.append(
                f"<tr><td>{key}</td>"
                + "".join(f"<td style='text-align:right'>{1e6 * v:.1f}</td>" for v in cells)
                + "</tr>"
            )
            self._histograms[key].data = steps(one)
        granted = timing.clock.scheduling
        rights = granted.asked if granted.granted else f"not granted: {granted.reason}"
        self._times.content = (
            "<div class='sjerk-times' style='font-size:12px;padding:6px' "
            f"data-count='{timing.period.count}'><table style='width:100%'>"
            "<tr style='opacity:.6;text-align:right'><th style='text-align:left'>µs</th>"
            "<th>median</th><th>p99</th><th>p99.9</th><th>worst</th></tr>"
            + "".join(rows)
            + f"</table>late cycles {timing.late} of {timing.period.count}; "
            f"real-time priority: {html.escape(rights)}</div>"
        )


def _histogram(gui: Any, key: str) -> Any:
    return gui.add_uplot(
        (np.array([0.1, 1.0]), np.zeros(2)),
        (
            {"label": "µs"},
            {"label": "cycles (log10)", "stroke": "#37b24d", "fill": "#37b24d40"},
        ),
        title=f"{key} [µs], log10 of cycles",
        height=160,
        scales={"x": {"time": False, "distr": 3}},
        legend={"show": False},
    )


def steps(times: Distribution) -> tuple[NDArray[Any], NDArray[Any]]:
    """The histogram as a line, both axes to be read by powers of ten.

    From a power of ten to another one: uPlot can hang where a logarithmic axis is shorter than a
    decade, as that of the period is in the first seconds.
    """
    used = np.flatnonzero(times.buckets)
    if not len(used):
        return np.array([0.1, 1.0]), np.zeros(2)
    first, last = max(0, int(used[0]) - 1), min(len(times.buckets) - 1, int(used[-1]) + 1)
    edges = BUCKET_EDGES[first : last + 2] * 1e6
    x = np.repeat(edges, 2)
    x[::2] *= 1.0 - 1e-9  # abscissas must grow
    counts = np.repeat(np.log10(1.0 + times.buckets[first : last + 1]), 2)
    low = 10.0 ** np.floor(np.log10(x[0]) - 1e-9)
    high = 10.0 ** np.ceil(np.log10(x[-1]) + 1e-9)
    return np.concatenate([[low], x, [high]]), np.concatenate([[0.0, 0.0], counts, [0.0, 0.0]])
