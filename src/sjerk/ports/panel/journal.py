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

#: Among so many lines an equal refusal is counted.
_REFUSALS = 40
_KEPT = 200


class Journal:
    """Lines with the time of day; ``echo`` gets each that is not about a kernel's cycles.

    >>> journal = Journal()
    >>> for _ in range(3):
    ...     journal.tell("halt")
    >>> [line.partition(" ")[2] for line in journal.lines()]
    ['halt (3 times)']
    >>> for _ in range(3):
    ...     journal.refuse("no file")
    ...     journal.refuse("no speed")
    >>> [line.partition(" ")[2] for line in journal.lines()]
    ['no speed (3 times)', 'no file (3 times)', 'halt (3 times)']
    """

    def __init__(self) -> None:
        self._lines: deque[list[object]] = deque(maxlen=_KEPT)  # time, text, how many, is bad
        self._lock = threading.Lock()
        self.changes = 0

    def tell(self, text: str, *, bad: bool = False, count: int = 1) -> None:
        """One line more; an equal one just before is counted."""
        self._tell(text, 1, bad=bad, count=count)

    def refuse(self, text: str) -> None:
        """What was asked for, and is not done; an equal line of the last ones is counted.

        Whoever asks again and again, for this and that, does not push the rest out of sight.
        """
        self._tell(text, _REFUSALS, bad=True, count=1)

    def _tell(self, text: str, near: int, *, bad: bool, count: int) -> None:
        now = time.strftime("%H:%M:%S")
        with self._lock:
            self.changes += 1
            for k in range(1, 1 + min(near, len(self._lines))):
                if self._lines[-k][1] == text:
                    known = self._lines[-k][2]
                    assert isinstance(known, int)
                    count += known
                    del self._lines[-k]
                    break
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
