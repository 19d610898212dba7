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
_CAUSES = {
    "host_death": lib.SJ_CAUSE_HOST_DEATH,
    "host_silence": lib.SJ_CAUSE_HOST_SILENCE,
    "drive_fault": lib.SJ_CAUSE_DRIVE_FAULT,
    "following_error": lib.SJ_CAUSE_FOLLOWING_ERROR,
    "overrun": lib.SJ_CAUSE_OVERRUN,
    "corrupt": lib.SJ_CAUSE_CORRUPT,
    "sync_lost": lib.SJ_CAUSE_SYNC_LOST,
}


@dataclass(frozen=True, kw_only=True)
class Reactions:
    """What a kernel does by itself, for all axes; each is also an event.

    ``host_death``: the process of the host has died. ``host_silence``: a host that asked to be
    watched has said nothing for too long. ``drive_fault``: the axis is left to its drive, the
    others react. ``following_error``: beyond ``Axis.following_error``. ``overrun``: the clock has
    skipped a cycle. ``corrupt``: a command or a record in the shared memory is corrupt.
    ``sync_lost``: as ``drive_fault``, where a drive reports that its link or SYNC is lost (603Fh =
    81xxh, 87xxh), or the caller that its process data are stale (``Image.stale``). Raises
    InputError.

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
            kernel.reaction[_CAUSES[name]] = _REACTIONS[value]
