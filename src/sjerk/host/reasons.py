"""Numbers of a kernel in words: why a goal was refused, which fault a drive reports.

Never here: what follows from them.
"""

from __future__ import annotations

from sjerk._binding import lib
from sjerk.cia402 import DriveFault

#: Why a goal was refused, by ``enum sj_result``.
REASONS = {
    lib.SJ_RESULT_NOT_FOLLOWING: "the drive does not follow (not enabled, or stopped by itself)",
    lib.SJ_RESULT_PLAN: "a number or a limit cannot be planned with",
    lib.SJ_RESULT_RANGE: "the goal is beyond what the drive can count",
    lib.SJ_RESULT_STOPPED: "a stop came with it, or the kernel is ending",
    lib.SJ_RESULT_LIMITS: "its limits are not numbers within those of the axis",
    lib.SJ_RESULT_STATE: "the axis is stopping, homing, or has an error",
    lib.SJ_RESULT_LIMIT: "it would leave the position limits of the axis",
    lib.SJ_RESULT_SPEED: "faster than the drive follows",
    lib.SJ_RESULT_KIND: "a record of an unknown kind, or not in its place",
    lib.SJ_RESULT_START: "the path does not begin where the axes are: move there first",
    lib.SJ_RESULT_SEGMENT: "a segment is not valid, or does not continue the one before",
    lib.SJ_RESULT_BEGUN: "what it is to replace has begun, or its path is over",
}
#: ``code`` of a fault of the homing itself, of which the drive has no error code.
HOMING_FAILED = -1

_FAULTS = {fault.code: fault.name.lower().replace("_", " ") for fault in DriveFault}


def fault_words(code: int) -> str:
    """An error code 603Fh as it is written, and its name where sjerk's drive has one.

    >>> fault_words(0x8611), fault_words(0xFF01)
    ('8611h (following error)', 'FF01h')
    """
    name = _FAULTS.get(code)
    return f"{code:04X}h ({name})" if name else f"{code:04X}h"
