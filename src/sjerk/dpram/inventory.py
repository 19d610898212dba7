"""All segments of this machine: what is there, who lives, and what the dead left behind.

Never here: making or opening a segment.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from sjerk import errors
from sjerk.dpram.files import (
    FOLDER,
    INCOMPLETE,
    PREFIX,
    TRACE,
    Lock,
    locked_by_other,
    no_memory,
    open_file,
    ours,
    path_of,
    still_named,
    take_lock,
)


@dataclass(frozen=True, kw_only=True)
class SegmentInfo:
    """One segment found by :func:`clean`: its ``name``, ``size`` in bytes and user ``uid``.

    ``host`` and ``kernel`` say whether those live, ``in_use`` whether a living process has it open,
    ``removed`` whether it is gone now. ``problem`` says why nothing could be learned or done; None
    if all is well.
    """

    name: str
    size: int
    uid: int
    host: bool
    kernel: bool
    in_use: bool
    removed: bool
    problem: str | None = None

    @property
    def companion(self) -> bool:
        """Whether it is a trace, which goes with the segment of a kernel."""
        return self.name.endswith(TRACE)


def clean(*, dry_run: bool = False, any_owner: bool = False) -> list[SegmentInfo]:
    """List all segments of sjerk on this machine, and remove those without a living owner.

    A segment that a living process has open is never removed. Segments of other users are listed
    only, unless ``any_owner``. Files that are no segments are left alone. ``dry_run`` removes
    nothing.

    >>> all(info.removed is False for info in clean(dry_run=True))
    True
    """
    return list(_inspect_all(dry_run, any_owner))


def _inspect_all(dry_run: bool, any_owner: bool) -> Iterator[SegmentInfo]:
    """Whatever lies there: what is no segment ends the look at nothing but itself."""
    try:
        entries = sorted(os.listdir(FOLDER))
    except OSError as error:
        if error.errno == errno.ENOENT:
            return
        raise no_memory(error, FOLDER, 0) from error
    for entry in entries:
        if entry.startswith(PREFIX):
            with contextlib.suppress(errors.SegmentMissingError, FileNotFoundError):
                yield _inspect(entry.removeprefix(PREFIX), dry_run, any_owner)


def _inspect(name: str, dry_run: bool, any_owner: bool) -> SegmentInfo:
    path = path_of(name)
    found = os.stat(path, follow_symlinks=False)

    def info(**more: Any) -> SegmentInfo:
        nothing = {"host": False, "kernel": False, "in_use": False, "removed": False}
        return SegmentInfo(name=name, size=found.st_size, uid=found.st_uid, **(nothing | more))

    if not stat.S_ISREG(found.st_mode):
        return info(problem="not a segment of sjerk: no file")
    try:
        fd = open_file(name, path, os.O_RDWR)
    except (errors.SegmentOwnerError, errors.SegmentGarbageError) as error:
        return info(in_use=isinstance(error, errors.SegmentOwnerError), problem=str(error))
    except OSError as error:
        return info(problem=str(error))
    try:
        host, kernel = locked_by_other(fd, Lock.HOST), locked_by_other(fd, Lock.KERNEL)
        if locked_by_other(fd, Lock.PRESENT):
            return info(host=host, kernel=kernel, in_use=True)
        if found.st_uid != os.geteuid() and not any_owner:
            return info(problem=f"belongs to user {found.st_uid}")
        if INCOMPLETE not in name and not ours(fd):
            return info(problem="not a segment of sjerk")
        if dry_run:
            return info()
        # With this lock no process can attach; one that attached meanwhile keeps it from us.
        if not take_lock(fd, fcntl.F_WRLCK, Lock.PRESENT) or not still_named(fd, path):
            return info(in_use=True)
        os.unlink(path)
        return info(removed=True)
    except OSError as error:  # a read-only file system, locks that are not to be had
        return info(problem=str(error))
    finally:
        os.close(fd)
