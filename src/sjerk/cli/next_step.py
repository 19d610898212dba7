"""What to do about an error: one clause behind its message. Never here: what the error says."""

from __future__ import annotations

import errno
import shlex
from pathlib import Path

from sjerk._binding import lib
from sjerk.errors import (
    KernelGoneError,
    MotionStoppedError,
    RefusedError,
    SegmentMemoryError,
    SegmentMissingError,
    SegmentTakenError,
    SegmentVersionError,
)

_STARTS = "`sjerk kernel robot.toml` starts one, `sjerk new robot.toml` writes such a file"
_SHOWS = "`sjerk status` shows the axes"

#: By the reason of a refusal, ``enum sj_result``.
_REFUSED = {
    lib.SJ_RESULT_NOT_FOLLOWING: f"{_SHOWS}, `sjerk enable` enables them",
    lib.SJ_RESULT_STATE: f"{_SHOWS}, `sjerk reset` resets faults",
    lib.SJ_RESULT_LIMIT: f"{_SHOWS}; the limits are in the TOML file of the kernel",
}


def next_step(error: Exception) -> str:
    """What helps, in one clause; empty where the message says it all.

    >>> next_step(KernelGoneError("ended"))
    '`sjerk clean` removes what a dead kernel left'
    """
    if isinstance(error, RefusedError):
        return _REFUSED.get(error.code, "")
    if isinstance(error, SegmentMissingError):
        return _STARTS
    if isinstance(error, KernelGoneError):
        return "`sjerk clean` removes what a dead kernel left"
    if isinstance(error, MotionStoppedError):
        failed = error.faults or error.error_stops
        return f"`sjerk reset` resets faults, {_SHOWS}" if failed else _SHOWS
    if isinstance(error, SegmentMemoryError | PermissionError):
        return "`sjerk doctor` tells what this machine grants"
    if isinstance(error, SegmentTakenError):
        name = shlex.quote(error.name)
        return f"`sjerk status --name {name}` shows it, another --name starts one beside it"
    if isinstance(error, OSError) and error.errno == errno.ENODEV:
        return "`ip link` lists the interfaces"
    if isinstance(error, SegmentVersionError):
        return "start the kernel again, with the sjerk that commands it: `sjerk --version`"
    if isinstance(error, FileNotFoundError) and Path(str(error.filename)).suffix == ".toml":
        return f"`sjerk new {shlex.quote(str(error.filename))}` writes one"
    return ""
