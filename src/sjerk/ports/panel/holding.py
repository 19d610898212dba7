"""Dead-man's switches: buttons that act while they are held, and what ends a hold.

A held button sends messages, some in a second. A hold that was cut because they stayed away needs
a fresh press: those of a window in the background go on once in a second. Never here: what moves.
"""

from __future__ import annotations

from collections.abc import Hashable
from enum import Enum

#: Seconds without a message until a hold is cut.
LIMIT = 0.3
#: Seconds without any message after which a hold that was cut may begin again.
SILENCE = 2.0


class Press(Enum):
    """What a message of a held button means."""

    BEGINS = "begins"  #: The first one of a hold.
    GOES_ON = "goes on"  #: One more.
    CUT = "cut"  #: Of a hold that was cut: it needs a fresh press.


class Holds:
    """Buttons by key; times in seconds of one clock.

    >>> holds = Holds()
    >>> holds.message("elbow", 0.0).name, holds.message("elbow", 0.05).name
    ('BEGINS', 'GOES_ON')
    >>> holds.expired(0.36), holds.message("elbow", 1.0).name, holds.message("elbow", 2.0).name
    (['elbow'], 'CUT', 'CUT')
    >>> holds.release("elbow"), holds.message("elbow", 2.1).name
    (False, 'BEGINS')
    """

    def __init__(self, limit: float = LIMIT, silence: float = SILENCE) -> None:
        self._limit, self._silence = limit, silence
        self._held: dict[Hashable, float] = {}
        self._cut: dict[Hashable, float] = {}

    @property
    def any(self) -> bool:
        """Whether any button is held."""
        return bool(self._held)

    def holds(self, key: Hashable) -> bool:
        """Whether this one is."""
        return key in self._held

    def message(self, key: Hashable, now: float) -> Press:
        """One message of a held button."""
        if now - self._cut.get(key, -self._silence) < self._silence:
            self._cut[key] = now
            return Press.CUT
        self._cut.pop(key, None)
        begun = key in self._held
        self._held[key] = now
        return Press.GOES_ON if begun else Press.BEGINS

    def release(self, key: Hashable) -> bool:
        """The button was let go; whether it was held."""
        self._cut.pop(key, None)
        return self._held.pop(key, None) is not None

    def expired(self, now: float) -> list[Hashable]:
        """Holds whose messages stay away: they are cut."""
        found = [key for key, last in self._held.items() if now - last > self._limit]
        for key in found:
            del self._held[key]
            self._cut[key] = now
        return found

    def clear(self, now: float) -> None:
        """A stop: all holds are cut."""
        for key in self._held:
            self._cut[key] = now
        self._held.clear()
