"""The interval of the SYNC, learned from those that come: when has it stopped?

    limit = max(LEAST_S, SILENT_INTERVALS x the longest of the last REMEMBERED intervals)

A silence beyond `limit` is a SYNC that stopped. SYNCs that are late, and single ones that are
missing, raise no alarm: n intervals of a SYNC with the period T, each SYNC up to T late, last
(n - 1) T together or longer, so that the longest of four is 3/4 T or longer. A missing SYNC leaves
a gap of 3 T or less, which is four times that.

An interval beyond the limit was a silence and is not learned, unless the one before it was about as
long: then the master has changed its period.

Never here: what a drive does then.
"""

from __future__ import annotations

import statistics
from collections import deque

SILENT_INTERVALS = 4
"""A silence of more than so many of the longest intervals is a SYNC that stopped."""
KNOWN = 4
"""Intervals from which on the SYNC is known."""
REMEMBERED = 64
"""Intervals of which the longest counts."""
LEAST_S = 0.01
"""No silence shorter than this is one: masters and their adapters send in bursts."""
UNKNOWN_S = 0.5
"""The limit before the SYNC is known."""
COMPARED = 16
"""Intervals whose median is compared with 60C2h."""


class SyncWatch:
    """Intervals between SYNCs; times are seconds of any steady clock.

    >>> watch = SyncWatch()
    >>> watch.limit
    0.5
    >>> for k in range(6):
    ...     watch.take(k / 64)
    >>> watch.limit
    0.0625
    """

    def __init__(self) -> None:
        """No SYNC has come."""
        self._at: float | None = None
        self._before = 0.0
        self._known: deque[float] = deque(maxlen=REMEMBERED)
        self._compared: list[float] = []

    def take(self, now: float) -> None:
        """A SYNC came at the time `now`."""
        if self._at is not None:
            interval = now - self._at
            if interval <= max(self.limit, SILENT_INTERVALS * self._before):
                self._known.append(interval)
            self._before = interval
            self._compared.append(interval)
        self._at = now

    @property
    def limit(self) -> float:
        """Seconds of silence beyond which the SYNC has stopped."""
        if len(self._known) < KNOWN:
            return UNKNOWN_S
        return max(LEAST_S, SILENT_INTERVALS * max(self._known))

    def period(self, *, counts: bool) -> float | None:
        """The median of the last intervals; None before enough in a row had `counts` true."""
        if not counts:
            self._compared.clear()
        if len(self._compared) < COMPARED:
            return None
        median = statistics.median(self._compared)
        self._compared.clear()
        return median
