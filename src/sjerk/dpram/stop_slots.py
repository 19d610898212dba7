"""Which process has which slot for its stop requests: a lock of the file for each but the last.

A process that finds every slot taken uses the last one, which nobody locks, so that a stop is never
refused; the kernel then cannot tell who asked. Never here: what a stop does, waiting.
"""

from __future__ import annotations

import fcntl
import os
from typing import Any

from sjerk._binding import lib
from sjerk.dpram.files import Lock, take_lock

#: The slot that is shared by all who find no other.
SHARED: int = lib.SJ_STOP_SLOTS - 1


def claim(fd: int, base: Any) -> int:
    """The number of a slot for this open file, locked until it is closed, or ``SHARED``.

    A slot in which a request of a dead process still waits for the kernel is left alone.
    """
    for slot in range(SHARED):
        byte = Lock.FIRST_STOP + slot
        if not take_lock(fd, fcntl.F_WRLCK, byte):
            continue
        if lib.sj_stop_claim(base, slot, os.getpid()):
            return slot
        take_lock(fd, fcntl.F_UNLCK, byte)
    return SHARED
