"""What a kernel does by itself when something goes wrong. Never here: how it stops."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

from sjerk._binding import lib
from sjerk.errors import InputError

Reaction = Literal["none", "halt", "quick stop"]
_REACTIONS = {
    "none": lib.SJ_REACT_NONE,
    "halt": lib.SJ_REACT_HALT,
    "quick stop": lib.SJ_REACT_QUICK_STOP,
}


@dataclass(frozen=True, kw_only=True)
class Reactions:
    """What a kernel does by itself, for all axes; each is also an event.

    ``host_silence`` is that of a host which asked to be watched. After a ``drive_fault`` the axis
    is left to its drive and the others react; so after ``sync_lost``: the drive tells that link or
    SYNC is lost (603Fh = 81xxh, 87xxh), or the caller that its image is stale (``Image.stale``).
    ``overrun``: a cycle of the clock was skipped.
    ``corrupt``: a command or a record that a wild writer overwrote. Raises InputError.

    >>> Reactions(drive_fault="quick stop").host_death
    'halt'
    """

    host_death: Reaction = "halt"
    host_silence: Reaction = "halt"
    drive_fault: Reaction = "halt"
    following_error: Reaction = "quick stop"
    overrun: Reaction = "none"
    corrupt: Reaction = "halt"
    sync_lost: Reaction = "halt"

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not isinstance(value, str) or value not in _REACTIONS:
                raise InputError(name, value, f"must be one of {', '.join(_REACTIONS)}")

    def to_c(self, kernel: Any) -> None:
        """Into the ``sj_kernel *``."""
        for name, value in asdict(self).items():
            kernel.reaction[getattr(lib, f"SJ_CAUSE_{name.upper()}")] = _REACTIONS[value]
