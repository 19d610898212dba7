"""What the system lacks, in a sentence with the number: memory, inodes, open files.

Never here: segments.
"""

from __future__ import annotations

import contextlib
import errno
import os
import resource


def _no_space(folder: str, size: int) -> str:
    found = os.statvfs(folder)
    if found.f_files and not found.f_favail:
        return f"{folder} has no inode left of its {found.f_files}: remove files there"
    free, whole = (found.f_frsize * blocks for blocks in (found.f_bavail, found.f_blocks))
    return f"{folder} has no {size} bytes left, {free} of {whole} are free"


def _limit(kind: int, option: str, what: str) -> str:
    soft, hard = resource.getrlimit(kind)
    most = "any number" if hard == resource.RLIM_INFINITY else hard
    return f"the limit of {what} is {soft} (`ulimit -{option}`, at most {most})"


def shortage(error: OSError, folder: str, size: int = 0) -> str | None:
    """What was missing for ``size`` bytes in ``folder``; None: the error is of something else.

    >>> import errno
    >>> shortage(OSError(errno.EROFS, ""), "/dev/shm")
    '/dev/shm is mounted read-only'
    """
    match error.errno:
        case errno.ENOSPC | errno.EDQUOT:
            with contextlib.suppress(OSError):
                return _no_space(folder, size)
            return f"{folder} has no {size} bytes left"
        case errno.ENOMEM:
            limit = _limit(resource.RLIMIT_AS, "v", "the memory of this process")
            return f"no memory left for {size} bytes; {limit}"
        case errno.EMFILE:
            limit = _limit(resource.RLIMIT_NOFILE, "n", "open files of this process")
            return f"this process has too many files open: {limit}"
        case errno.ENFILE:
            return "the system has too many files open: see /proc/sys/fs/file-max"
        case errno.EFBIG:
            limit = _limit(resource.RLIMIT_FSIZE, "f", "the size of a file in bytes")
            return f"{size} bytes are too many: {limit}"
        case errno.EROFS:
            return f"{folder} is mounted read-only"
        case errno.EAGAIN:
            return _limit(resource.RLIMIT_NPROC, "u", "processes and threads of this user")
    return None
