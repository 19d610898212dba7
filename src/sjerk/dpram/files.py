"""Files of segments: their names, locks and memory, how one appears and who may open it.

A segment is a ``multiprocessing.shared_memory.SharedMemory``. A lock is a byte of the segment file
itself, held by an open file description (``F_OFD_SETLK``): it ends with its process, however that
dies, can be looked at without being taken, and leaves no file of its own behind. They lie far
beyond the content: host, kernel, one that everybody who has the segment open shares, and one for
each slot for stop requests.

Never here: what the content means.
"""

from __future__ import annotations

import contextlib
import enum
import errno
import fcntl
import grp
import mmap
import os
import re
import stat
import struct
import sys
import threading
from multiprocessing import shared_memory
from typing import Any

from sjerk import errors
from sjerk._binding import ffi, lib
from sjerk.dpram.layout import Layout, raise_for_status
from sjerk.dpram.shortage import shortage

#: Where POSIX shared memory lives, and how the names of our files begin.
FOLDER, PREFIX = "/dev/shm", "sjerk-"
#: The first bytes of every segment, of any version.
MAGIC = b"sjerk-m\n"
#: In the file name of a segment that is still being made.
INCOMPLETE = ".unborn"
#: Ends the name of a segment that goes with the kernel of the name before it.
TRACE = ".trace"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*(\.trace)?")
_LONGEST_NAME = 194  # that of its trace, while it is made, ends at 255 bytes

_FLOCK = "hhqqi4x"  # struct flock: type, whence, start, length, pid


class Lock(enum.IntEnum):
    """Bytes of the file that are locked, never read or written: beyond any content."""

    HOST = 1 << 40
    """Held by the one host."""
    KERNEL = HOST + 1
    """Held by the one kernel."""
    PRESENT = HOST + 2
    """Shared by everybody who has the segment open."""
    FIRST_STOP = HOST + 3
    """Held by the process that has the first slot for stop requests; the other slots follow."""


def check_name(name: str) -> str:
    """Return a kernel name that has a place in a file name; raises ``SegmentNameError``.

    >>> check_name("press-2")
    'press-2'
    """
    if not isinstance(name, str):
        raise TypeError(f"a kernel name must be a str, not {name!r}")
    given = len(name.removesuffix(TRACE))
    if given > _LONGEST_NAME:
        raise errors.SegmentNameError(
            f"kernel name of {given} characters is too long: at most {_LONGEST_NAME}", name=name
        )
    if not _NAME.fullmatch(name):
        raise errors.SegmentNameError(
            f"kernel name {name.removesuffix(TRACE)!r} must be letters, digits, '_' and '-', "
            "a letter or digit first",
            name=name,
        )
    return name


def path_of(name: str) -> str:
    """The file of the segment of a kernel.

    >>> path_of("press-2")
    '/dev/shm/sjerk-press-2'
    """
    return f"{FOLDER}/{PREFIX}{name}"


def take_lock(fd: int, kind: int, byte: int) -> bool:
    """Take a lock (F_RDLCK, F_WRLCK) without waiting; False if another process holds it."""
    try:
        fcntl.fcntl(fd, fcntl.F_OFD_SETLK, struct.pack(_FLOCK, kind, os.SEEK_SET, byte, 1, 0))
    except OSError as error:
        if error.errno in (errno.EAGAIN, errno.EACCES):
            return False
        raise
    return True


def locked_by_other(fd: int, byte: int) -> bool:
    """Whether another process holds the lock; asking does not take it."""
    asked = struct.pack(_FLOCK, fcntl.F_WRLCK, os.SEEK_SET, byte, 1, 0)
    kind: int = struct.unpack(_FLOCK, fcntl.fcntl(fd, fcntl.F_OFD_GETLK, asked))[0]
    return kind != fcntl.F_UNLCK


def still_named(fd: int, path: str) -> bool:
    """Whether the path still names the open file."""
    try:
        named = os.stat(path, follow_symlinks=False)
    except FileNotFoundError:
        return False
    opened = os.fstat(fd)
    return (named.st_ino, named.st_dev) == (opened.st_ino, opened.st_dev)


def open_file(name: str, path: str, flags: int) -> int:
    """A descriptor of the file of a segment.

    Raises ``SegmentMissingError``, ``SegmentOwnerError``, or ``SegmentGarbageError`` for what is
    no file.
    """
    try:  # not blocking: a pipe may lie there
        return os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except FileNotFoundError:
        raise errors.SegmentMissingError(
            f"no segment {name!r}: no kernel of this name is running", name=name
        ) from None
    except PermissionError:
        with contextlib.suppress(OSError):
            uid = os.stat(path, follow_symlinks=False).st_uid
            raise errors.SegmentOwnerError(
                f"segment {name!r} of user {uid} refuses access to user {os.geteuid()}",
                name=name,
                uid=uid,
            ) from None
        raise
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.EISDIR, errno.ENXIO, errno.ENODEV):
            raise errors.SegmentGarbageError(
                f"{path} is not a segment but a link, folder or device", name=name
            ) from None
        if (missing := shortage(error, FOLDER)) is not None:
            raise errors.SegmentMemoryError(f"segment {name!r}: {missing}", name=name) from None
        raise


# ---- memory -----------------------------------------------------------------------------------


class _Bypass:
    """Stands in for the resource tracker while one SharedMemory is made, for that name only.

    Before Python 3.13 every process that attaches registers the segment for deletion at its exit.
    """

    def __init__(self, real: Any, name: str) -> None:
        self._real = real
        self._name = name

    def register(self, name: str, rtype: str) -> None:
        if name.lstrip("/") != self._name:
            self._real.register(name, rtype)

    def unregister(self, name: str, rtype: str) -> None:  # where making it fails half way
        if name.lstrip("/") != self._name:
            self._real.unregister(name, rtype)

    def __getattr__(self, attribute: str) -> Any:
        return getattr(self._real, attribute)


_bypass_lock = threading.Lock()


def new_memory(name: str, size: int) -> shared_memory.SharedMemory:
    """A new SharedMemory that no resource tracker knows of."""
    if sys.version_info >= (3, 13):
        return shared_memory.SharedMemory(name, create=True, size=size, track=False)
    module: Any = shared_memory
    with _bypass_lock:
        real = module.resource_tracker
        module.resource_tracker = _Bypass(real, name)
        try:
            return shared_memory.SharedMemory(name, create=True, size=size)
        finally:
            module.resource_tracker = real


class Pages:
    """The pages of a segment that is open, for reading only or for writing too.

    Not a SharedMemory: where one cannot map the pages it removes the segment, which is another's.
    """

    def __init__(self, fd: int, *, writable: bool) -> None:
        """Map the whole file."""
        self.buf = mmap.mmap(fd, 0, access=mmap.ACCESS_WRITE if writable else mmap.ACCESS_READ)

    def close(self) -> None:
        """Give the pages back."""
        self.buf.close()


class PrivateMemory:
    """Zeroed memory of this process alone."""

    def __init__(self, size: int) -> None:
        """Take ``size`` bytes."""
        self.buf = bytearray(size)

    def close(self) -> None:
        """Nothing to give back."""


def let_in(fd: int, gid: int) -> None:
    """Give a file to a group; raises InputError where this user is not in it."""
    try:
        os.fchown(fd, -1, gid)
    except PermissionError:
        why = f"user {os.geteuid()} is not in it"
        raise errors.InputError("group", gid, why) from None


def group_number(group: int | str | None) -> int | None:
    """The number of a group by its name or number; raises InputError where there is none."""
    if group is None:
        return None
    if isinstance(group, bool) or not isinstance(group, int | str):
        raise errors.InputError("group", group, "must be the name or the number of a group")
    try:
        if isinstance(group, str) and not group.isdecimal():
            return grp.getgrnam(group).gr_gid
        return grp.getgrgid(int(group)).gr_gid
    except (KeyError, OverflowError):
        raise errors.InputError("group", group, "is no group of this system") from None


def create_file(name: str, temporary: str, layout: Layout, gid: int | None) -> int:
    """Make a whole segment under a name that no other process asks for.

    Returns its locked descriptor, or -1 where ``clean`` came between: begin again. Raises
    ``SegmentMemoryError``.
    """
    size = layout.size
    try:
        memory = new_memory(PREFIX + temporary, size)
    except OSError as error:
        raise no_memory(error, name, size) from error
    fd = -1
    try:
        fd = open_file(name, path_of(temporary), os.O_RDWR)
        if not take_lock(fd, fcntl.F_RDLCK, Lock.PRESENT):  # clean() has it already: begin again
            os.close(fd)
            return -1
        # Now, so that a full file system is an error here and not a bus error in the cycle.
        os.posix_fallocate(fd, 0, size)
        if gid is not None:
            let_in(fd, gid)
        os.fchmod(fd, 0o600 if gid is None else 0o660)
        with ffi.from_buffer("char[]", memory.buf) as base:
            raise_for_status(lib.sj_shm_format(base, len(base), layout.config()), name)
    except BaseException as error:
        if fd >= 0:
            os.close(fd)
        with contextlib.suppress(FileNotFoundError):
            os.unlink(path_of(temporary))
        if isinstance(error, OSError):
            raise no_memory(error, name, size) from error
        raise
    finally:
        memory.close()
    return fd


def no_memory(error: OSError, name: str, size: int) -> Exception:
    """The error of a segment that cannot be made or mapped for want of something; or as it is."""
    missing = shortage(error, FOLDER, size)
    if missing is None:
        return error
    return errors.SegmentMemoryError(f"segment {name!r}: {missing}", name=name, size=size)


def ours(fd: int) -> bool:
    """Whether it is a file that begins as a segment does, of whatever version or state."""
    return stat.S_ISREG(os.fstat(fd).st_mode) and os.pread(fd, len(MAGIC), 0) == MAGIC


def check_file(fd: int, name: str, any_owner: bool) -> None:
    """Refuse what is no segment, or not this user's, before a byte of it is read.

    Raises ``SegmentGarbageError``, ``SegmentOwnerError`` and ``SegmentTruncatedError``.
    """
    found = os.fstat(fd)
    if not stat.S_ISREG(found.st_mode):
        raise errors.SegmentGarbageError(f"segment {name!r} is not a regular file", name=name)
    if found.st_uid != os.geteuid() and not any_owner:
        raise errors.SegmentOwnerError(
            f"segment {name!r} belongs to user {found.st_uid}, not {os.geteuid()}: "
            "any_owner=True (--any-owner) accepts it",
            name=name,
            uid=found.st_uid,
        )
    if found.st_size < lib.SJ_SHM_SLOTS:
        raise_for_status(lib.SJ_SHM_TRUNCATED, name)


def give_name(name: str, temporary: str, replace_stale: bool) -> None:
    """Let the whole segment appear under its name, if that is free, in one step.

    Raises ``SegmentTakenError``, and ``SegmentStaleError`` unless ``replace_stale``.
    """
    while True:
        try:
            os.link(temporary, path_of(name))
        except FileExistsError:
            with contextlib.suppress(errors.SegmentMissingError):  # gone meanwhile: try again
                _make_room(name, replace_stale)
        else:
            return


def _make_room(name: str, replace_stale: bool) -> None:
    path = path_of(name)
    fd = open_file(name, path, os.O_RDWR)
    try:
        if not ours(fd):
            raise errors.SegmentGarbageError(
                f"{path} is there and is no segment of sjerk: it is left alone, take another name",
                name=name,
            )
        if not take_lock(fd, fcntl.F_WRLCK, Lock.PRESENT):
            asked = name.removesuffix(TRACE)
            raise errors.SegmentTakenError(
                f"segment {asked!r} is in use: a kernel of this name is running", name=asked
            )
        if not still_named(fd, path):
            return
        if not replace_stale:
            raise errors.SegmentStaleError(
                f"segment {name!r} was left behind by a process that died; "
                "clean() removes it, replace_stale=True replaces it",
                name=name,
            )
        os.unlink(path)
    finally:
        os.close(fd)
