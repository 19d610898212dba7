"""What has happened, in words, newest first; equal ones that follow each other are counted.

Never here: pages.
"""

from __future__ import annotations

import html
import threading
import time
from collections import deque
from collections.abc import Iterable

from sjerk.host import Event, EventKind

_KEPT = 200


class Journal:
    """Lines with the time of day; ``echo`` gets each that is not about a kernel's cycles.

    >>> journal = Journal()
    >>> for _ in range(3):
    ...     journal.tell("halt")
    >>> [line.partition(" ")[2] for line in journal.lines()]
    ['halt (3 times)']
    """

    def __init__(self) -> None:
        self._lines: deque[list[object]] = deque(maxlen=_KEPT)  # time, text, how many, is bad
        self._lock = threading.Lock()
        self.changes = 0

    def tell(self, text: str, *, bad: bool = False, count: int = 1) -> None:
        """One line more."""
        now = time.strftime("%H:%M:%S")
        with self._lock:
            self.changes += 1
            if self._lines and self._lines[-1][1] == text:
                last = self._lines[-1]
                assert isinstance(last[2], int)
                last[0], last[2] = now, last[2] + count
            else:
                self._lines.append([now, text, count, bad])

    def events(self, events: Iterable[Event]) -> None:
        """Events of the kernel; cycles left out are summed up, else they would flood the rest."""
        for event in events:
            if event.kind is EventKind.LATE:
                self.tell("a cycle left out: the clock was late", count=max(1, round(event.value)))
            else:
                bad = event.kind in (EventKind.FAULT, EventKind.FOLLOWING, EventKind.SYNC)
                self.tell(event.words, bad=bad)

    def lines(self) -> list[str]:
        """Newest first."""
        with self._lock:
            rows = [list(row) for row in reversed(self._lines)]
        return [f"{now} {text}{_times(count)}" for now, text, count, _ in rows]

    def html(self, most: int = 60) -> str:
        """As a list; everything of others is escaped."""
        with self._lock:
            rows = [list(row) for row in reversed(self._lines)][:most]
        parts = []
        for now, text, count, bad in rows:
            style = " style='color:#e03131'" if bad else ""
            words = html.escape(f"{text}{_times(count)}")
            parts.append(f"<div{style}><span style='opacity:.6'>{now}</span> {words}</div>")
        return (
            "<div class='sjerk-events' style='font-size:12px;padding:6px;overflow-wrap:anywhere'>"
            + "".join(parts)
            + "</div>"
        )


def _times(count: object) -> str:
    return "" if count == 1 else f" ({count} times)"
