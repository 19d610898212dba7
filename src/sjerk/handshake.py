"""The dual-port RAM as Python sees it: who may map the segment, who may write, who is alive.

A segment is a ``multiprocessing.shared_memory.SharedMemory``; how its bytes are laid out and
exchanged is C (``dpram/``). Here are names, permissions, locks and errors; never what a
command or a feedback frame means.

A lock is a byte of the segment file itself, held by an open file description (``F_OFD_SETLK``): it
ends with its process, however that dies, can be looked at without being taken, and leaves no file
of its own behind. Three bytes are used, far beyond the content: host, kernel, and one that
everybody who has the segment open shares.
"""

from __future__ import annotations

import contextlib
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
import time
import weakref
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from multiprocessing import shared_memory
from types import TracebackType
from typing import Any, Literal, NoReturn, Self

from sjerk import errors
from sjerk._binding import ffi, lib

__all__ = [
    "TRACE",
    "HostWatch",
    "Layout",
    "Role",
    "Segment",
    "SegmentInfo",
    "clean",
    "raise_for_status",
]

Role = Literal["owner", "host", "monitor", "kernel"]

_FOLDER = "/dev/shm"
_PREFIX = "sjerk-"
_MAGIC = b"sjerk-m\n"  # the first bytes of every segment, of whatever version
_UNBORN = ".unborn"  # suffix of a segment that is not yet whole
#: Ends the name of a segment that goes with the kernel of the name before it.
TRACE = ".trace"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*(\.trace)?")
_LONGEST_NAME = 200  # file names end at 255 bytes

# Bytes that are locked, never read or written: beyond any content.
_LOCKS_AT = 1 << 40
_HOST, _KERNEL, _PRESENT = _LOCKS_AT, _LOCKS_AT + 1, _LOCKS_AT + 2
_FLOCK = "hhqqi4x"  # struct flock: type, whence, start, length, pid


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Sizes of what is exchanged; both sides must name the same.

    ``command_bytes`` and ``feedback_bytes`` (1 .. 2**20) are one command and one feedback frame
    for all axes. ``record_capacity`` look-ahead records of ``record_bytes`` wait in the ring,
    ``event_capacity`` events of ``event_bytes`` are kept; capacities are powers of two, 0 for
    none. ``abi`` is a hash of the payload layouts, so that two programs that mean different things
    by the same sizes do not meet.

    >>> Layout(command_bytes=512, feedback_bytes=512).size
    28672
    """

    command_bytes: int
    feedback_bytes: int
    record_bytes: int = 0
    record_capacity: int = 0
    event_bytes: int = 0
    event_capacity: int = 0
    abi: int = 0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            most = 2**64 - 1 if field.name == "abi" else 2**20
            if not isinstance(value, int) or isinstance(value, bool):
                raise TypeError(f"Layout.{field.name} must be an int, not {value!r}")
            if not 0 <= value <= most:
                raise ValueError(f"Layout.{field.name} = {value} is outside 0 .. {most}")
        for what, least in (("record_capacity", 1), ("event_capacity", 4)):
            value = getattr(self, what)
            if value and (value & (value - 1) or value < least):
                raise ValueError(f"Layout.{what} = {value} is not 0 or a power of two >= {least}")
        if not self.size:
            zero = [
                name
                for name, needed in (
                    ("command_bytes", True),
                    ("feedback_bytes", True),
                    ("record_bytes", self.record_capacity > 0),
                    ("event_bytes", self.event_capacity > 0),
                )
                if needed and getattr(self, name) == 0
            ]
            raise ValueError(f"Layout.{zero[0]} = 0 must be > 0")

    @property
    def size(self) -> int:
        """Bytes of a segment of this layout."""
        return int(lib.sj_shm_size(self.config()))

    def config(self) -> Any:
        """The ``sj_shm_config *`` of this layout."""
        return ffi.new("sj_shm_config *", asdict(self))


# ---- errors -------------------------------------------------------------------------------------


def raise_for_status(status: int, name: str = "") -> int:
    """Return a status >= 0 as it is; raise the error of a negative ``enum sj_shm_status``."""
    if status >= 0:
        return status
    who = f"segment {name!r}: " if name else "segment: "
    kinds: dict[int, tuple[type[errors.SegmentFormatError], str]] = {
        lib.SJ_SHM_NOT_READY: (
            errors.SegmentNotReadyError,
            "not ready: it is being created, or its creator died",
        ),
        lib.SJ_SHM_TRUNCATED: (errors.SegmentTruncatedError, "shorter than its layout needs"),
        lib.SJ_SHM_MAGIC: (errors.SegmentGarbageError, "not a segment of sjerk"),
        lib.SJ_SHM_VERSION: (
            errors.SegmentVersionError,
            f"made by another version of sjerk; this one reads layout {lib.SJ_SHM_MAJOR}.x",
        ),
        lib.SJ_SHM_ABI: (
            errors.SegmentLayoutError,
            "its payloads have another layout (ABI hash differs)",
        ),
        lib.SJ_SHM_CONFIG: (
            errors.SegmentLayoutError,
            "its sizes differ from the layout asked for",
        ),
        lib.SJ_SHM_CORRUPT_HEADER: (errors.SegmentGarbageError, "its header has been overwritten"),
        lib.SJ_SHM_CORRUPT_WORD: (
            errors.SegmentCorruptError,
            "the command word is none of its twelve values",
        ),
        lib.SJ_SHM_CORRUPT_DATA: (
            errors.SegmentCorruptError,
            "a checksum fails: somebody writes without the lock",
        ),
        lib.SJ_SHM_CORRUPT_COUNTER: (errors.SegmentCorruptError, "a counter is impossible"),
        lib.SJ_SHM_LAPPED: (
            errors.SegmentFormatError,
            "the reader was overtaken again and again; read once more",
        ),
    }
    if status == lib.SJ_SHM_KERNEL_RESTARTED:
        raise errors.KernelRestartedError(who + "the kernel has been restarted", name=name)
    kind, text = kinds.get(status, (errors.SegmentFormatError, f"unknown status {status}"))
    raise kind(who + text, name=name, status=status)


# ---- names, files, locks ------------------------------------------------------------------------


def _check_name(name: str) -> str:
    if not isinstance(name, str):
        raise TypeError(f"a kernel name must be a str, not {name!r}")
    if len(name) > _LONGEST_NAME:
        raise errors.SegmentNameError(
            f"kernel name of {len(name)} characters is too long: at most {_LONGEST_NAME}", name=name
        )
    if not _NAME.fullmatch(name):
        given = name.removesuffix(TRACE)
        raise errors.SegmentNameError(
            f"kernel name {given!r} must be letters, digits, '_' and '-', a letter or digit first",
            name=name,
        )
    return name


def _path(name: str) -> str:
    return f"{_FOLDER}/{_PREFIX}{name}"


def _lock(fd: int, kind: int, byte: int) -> bool:
    """Take (or with F_UNLCK give back) a lock without waiting; False if another holds it."""
    try:
        fcntl.fcntl(fd, fcntl.F_OFD_SETLK, struct.pack(_FLOCK, kind, os.SEEK_SET, byte, 1, 0))
    except OSError as error:
        if error.errno in (errno.EAGAIN, errno.EACCES):
            return False
        raise
    return True


def _locked_by_other(fd: int, byte: int) -> bool:
    """Whether anybody else holds the lock; looking does not take it."""
    asked = struct.pack(_FLOCK, fcntl.F_WRLCK, os.SEEK_SET, byte, 1, 0)
    kind: int = struct.unpack(_FLOCK, fcntl.fcntl(fd, fcntl.F_OFD_GETLK, asked))[0]
    return kind != fcntl.F_UNLCK


def _same_file(fd: int, path: str) -> bool:
    """Whether the path still names the open file."""
    try:
        named = os.stat(path, follow_symlinks=False)
    except FileNotFoundError:
        return False
    opened = os.fstat(fd)
    return (named.st_ino, named.st_dev) == (opened.st_ino, opened.st_dev)


def _open(name: str, path: str, flags: int) -> int:
    try:  # not blocking: somebody may have put a pipe there
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
        if error.errno in (errno.ELOOP, errno.EISDIR, errno.ENXIO):
            raise errors.SegmentGarbageError(
                f"{path} is not a segment but a link, folder or device", name=name
            ) from None
        raise


# ---- the carrier --------------------------------------------------------------------------------


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

    def __getattr__(self, attribute: str) -> Any:
        return getattr(self._real, attribute)


_bypass_lock = threading.Lock()


def _shared_memory(name: str, *, create: bool = False, size: int = 0) -> shared_memory.SharedMemory:
    """A SharedMemory that no resource tracker knows of."""
    if sys.version_info >= (3, 13):
        return shared_memory.SharedMemory(name, create=create, size=size, track=False)
    module: Any = shared_memory
    with _bypass_lock:
        real = module.resource_tracker
        module.resource_tracker = _Bypass(real, name)
        try:
            return shared_memory.SharedMemory(name, create=create, size=size)
        finally:
            module.resource_tracker = real


class _ReadOnly:
    """What a monitor maps: the pages of the same file, for reading only."""

    def __init__(self, fd: int) -> None:
        self.buf = mmap.mmap(fd, 0, access=mmap.ACCESS_READ)

    def close(self) -> None:
        self.buf.close()


class _Private:
    """Zeroed memory of this process alone."""

    def __init__(self, size: int) -> None:
        self.buf = bytearray(size)

    def close(self) -> None:
        pass


def _birth(name: str, unborn: str, layout: Layout, gid: int | None) -> int:
    """Make a whole segment under a name that nobody asks for; its locked descriptor, or -1."""
    size = layout.size
    try:
        carrier = _shared_memory(_PREFIX + unborn, create=True, size=size)
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.ENOMEM):
            raise _no_memory(name, size) from None
        raise
    fd = -1
    try:
        fd = _open(name, _path(unborn), os.O_RDWR)
        if not _lock(fd, fcntl.F_RDLCK, _PRESENT):  # clean() has it already: begin again
            os.close(fd)
            return -1
        # Now, so that a full file system is an error here and not a bus error in the cycle.
        os.posix_fallocate(fd, 0, size)
        if gid is not None:
            os.fchown(fd, -1, gid)
        os.fchmod(fd, 0o600 if gid is None else 0o660)
        with ffi.from_buffer("char[]", carrier.buf) as base:
            raise_for_status(lib.sj_shm_format(base, len(base), layout.config()), name)
    except BaseException as error:
        if fd >= 0:
            os.close(fd)
        with contextlib.suppress(FileNotFoundError):
            os.unlink(_path(unborn))
        if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.ENOMEM):
            raise _no_memory(name, size) from None
        raise
    finally:
        carrier.close()
    return fd


def _no_memory(name: str, size: int) -> errors.SegmentMemoryError:
    return errors.SegmentMemoryError(
        f"segment {name!r}: {_FOLDER} has no {size} bytes left", name=name, size=size
    )


def _check_file(fd: int, name: str, any_owner: bool) -> None:
    """Refuse what is no segment, or not this user's, before a byte of it is read."""
    found = os.fstat(fd)
    if not stat.S_ISREG(found.st_mode):
        raise errors.SegmentGarbageError(f"segment {name!r} is not a regular file", name=name)
    if found.st_uid != os.geteuid() and not any_owner:
        raise errors.SegmentOwnerError(
            f"segment {name!r} belongs to user {found.st_uid}, not {os.geteuid()}; "
            "any_owner=True accepts it",
            name=name,
            uid=found.st_uid,
        )
    if found.st_size < lib.SJ_SHM_SLOTS:
        raise_for_status(lib.SJ_SHM_TRUNCATED, name)


def _check_content(base: Any, name: str, layout: Layout | None) -> Layout:
    config = ffi.NULL if layout is None else layout.config()
    status = lib.sj_shm_check(base, len(base), config)
    if status == lib.SJ_SHM_VERSION:
        found = lib.sj_shm_read_version(base, len(base))
        raise errors.SegmentVersionError(
            f"segment {name!r} has layout {found >> 16}.{found & 0xFFFF}, "
            f"this version of sjerk reads {lib.SJ_SHM_MAJOR}.x",
            name=name,
            status=status,
        )
    raise_for_status(status, name)
    if layout is not None:
        return layout
    config = ffi.new("sj_shm_config *")
    lib.sj_shm_read_config(base, len(base), config)
    return Layout(**{field.name: getattr(config, field.name) for field in fields(Layout)})


def _give_name(name: str, unborn: str, replace_stale: bool) -> None:
    """Let the whole segment appear under its name, if that is free, in one step."""
    while True:
        try:
            os.link(unborn, _path(name))
        except FileExistsError:
            with contextlib.suppress(errors.SegmentMissingError):  # gone meanwhile: try again
                _make_room(name, replace_stale)
        else:
            return


def _make_room(name: str, replace_stale: bool) -> None:
    path = _path(name)
    fd = _open(name, path, os.O_RDWR)
    try:
        if not _lock(fd, fcntl.F_WRLCK, _PRESENT):
            raise errors.SegmentTakenError(
                f"segment {name.removesuffix(TRACE)!r} is in use: a kernel of this name is running",
                name=name,
            )
        if not _same_file(fd, path):
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


def _finish(export: Any, carrier: Any, fd: int, role: Role) -> None:
    """Leave in order. The exports go first: a SharedMemory with exports refuses to close."""
    if role == "host":
        lib.sj_shm_leave_host(export)
    elif role == "kernel":
        lib.sj_shm_leave_kernel(export)
    _release(export, carrier, fd)


def _release(export: Any, carrier: Any, fd: int) -> None:
    ffi.release(export)
    carrier.close()
    if fd >= 0:
        os.close(fd)  # and with it every lock


_living: weakref.WeakSet[Segment] = weakref.WeakSet()


class Segment:
    """One opened segment. Made by :meth:`create`, :meth:`attach` or :meth:`private`.

    It is a context manager: leaving it closes the segment, and removes it if it was created here.
    One thread at a time may write through it: the C calls run without the interpreter lock.

    >>> from sjerk._binding import lib
    >>> with Segment.private(Layout(command_bytes=8, feedback_bytes=8)) as segment:
    ...     lib.sj_command_publish(segment.base, b"12345678")
    0
    """

    def __init__(self, name: str, layout: Layout, role: Role, carrier: Any, fd: int) -> None:
        """Not for callers: the classmethods make the arguments."""
        self._name = name
        self._layout = layout
        self._role: Role = role
        self._carrier = carrier
        self._fd = fd
        self._created = False
        self._state: Literal["open", "closed", "forked"] = "open"
        export = ffi.from_buffer("char[]", carrier.buf)
        self._export = export
        self._base = ffi.cast("void *", export)  # a pointer crosses into C faster than an array
        self._finalizer = weakref.finalize(self, _finish, export, carrier, fd, role)
        _living.add(self)

    # ---- making -----------------------------------------------------------------------------

    @classmethod
    def create(
        cls,
        name: str,
        layout: Layout,
        *,
        role: Literal["owner", "kernel"] = "owner",
        group: int | str | None = None,
        replace_stale: bool = False,
    ) -> Self:
        """Create the segment of kernel ``name`` and keep it open.

        ``role="kernel"`` if this process is itself the kernel, ``"owner"`` if it only keeps the
        segment for one. Only this user may open it (0600); with ``group`` (name or number) its
        members too (0660). The memory is reserved now, and the name appears only once the segment
        is whole.

        Raises SegmentTakenError if somebody living uses the name, SegmentStaleError if only the
        dead do (unless ``replace_stale``), SegmentMemoryError, SegmentNameError.
        """
        _check_name(name)
        gid = grp.getgrnam(group).gr_gid if isinstance(group, str) else group
        while True:
            unborn = f"{name}{_UNBORN}-{os.getpid()}-{time.monotonic_ns()}"
            fd = _birth(name, unborn, layout, gid)
            if fd < 0:
                continue
            carrier: Any = None
            try:
                if not _same_file(fd, _path(unborn)):  # clean() came between creation and lock
                    os.close(fd)
                    continue
                _give_name(name, _path(unborn), replace_stale)
                if role == "kernel":
                    _lock(fd, fcntl.F_WRLCK, _KERNEL)
                carrier = _shared_memory(_PREFIX + name)
                return cls._opened(name, layout, role, carrier, fd, created=True)
            except BaseException:
                if carrier is not None:
                    carrier.close()
                os.close(fd)
                raise
            finally:
                with contextlib.suppress(FileNotFoundError):
                    os.unlink(_path(unborn))

    @classmethod
    def attach(
        cls,
        name: str,
        layout: Layout | None = None,
        *,
        role: Literal["host", "monitor", "kernel"] = "monitor",
        any_owner: bool = False,
    ) -> Self:
        """Open the segment of kernel ``name``.

        A monitor maps the pages read-only, and there may be any number. There is one host and one
        kernel at a time, each held by a lock that ends with its process. ``layout`` is what the
        content must be; None takes the one found. ``any_owner`` accepts a segment that another
        user created.

        Raises SegmentMissingError, SegmentOwnerError, HostTakenError (with the other's pid),
        KernelTakenError, or the SegmentFormatError that says what is wrong with the content.
        """
        _check_name(name)
        if role not in ("host", "monitor", "kernel"):
            raise ValueError(f"role = {role!r} is not 'host', 'monitor' or 'kernel'")
        path = _path(name)
        fd = _open(name, path, os.O_RDONLY if role == "monitor" else os.O_RDWR)
        carrier: Any = None
        try:
            _check_file(fd, name, any_owner)
            if not _lock(fd, fcntl.F_RDLCK, _PRESENT):
                raise errors.SegmentMissingError(
                    f"segment {name!r} is being removed: its owners died", name=name
                )
            carrier = _ReadOnly(fd) if role == "monitor" else _shared_memory(_PREFIX + name)
            if not _same_file(fd, path):
                raise errors.SegmentMissingError(f"segment {name!r} was just removed", name=name)
            with ffi.from_buffer("char[]", carrier.buf) as base:
                found = _check_content(base, name, layout)
                if role == "host" and not _lock(fd, fcntl.F_WRLCK, _HOST):
                    pid = int(lib.sj_shm_host_pid(base))
                    raise errors.HostTakenError(
                        f"kernel {name!r} already has a host, process {pid}", name=name, pid=pid
                    )
            if role == "kernel" and not _lock(fd, fcntl.F_WRLCK, _KERNEL):
                raise errors.KernelTakenError(f"kernel {name!r} is already running", name=name)
            return cls._opened(name, found, role, carrier, fd)
        except BaseException:
            if carrier is not None:
                carrier.close()
            os.close(fd)
            raise

    @classmethod
    def private(cls, layout: Layout) -> Self:
        """A segment in the memory of this process: host and kernel in one, no locks, no files."""
        carrier = _Private(layout.size)
        with ffi.from_buffer("char[]", carrier.buf) as base:
            raise_for_status(lib.sj_shm_format(base, len(base), layout.config()))
            lib.sj_shm_begin_kernel(base, time.monotonic_ns())
            lib.sj_shm_begin_host(base, os.getpid(), time.monotonic_ns())
        return cls("", layout, "owner", carrier, -1)

    @classmethod
    def _opened(
        cls, name: str, layout: Layout, role: Role, carrier: Any, fd: int, created: bool = False
    ) -> Self:
        """The Segment of a file whose locks are taken; begins the epoch of its role."""
        segment = cls(name, layout, role, carrier, fd)
        segment._created = created
        if role == "host":
            lib.sj_shm_begin_host(segment._base, os.getpid(), time.monotonic_ns())
        elif role == "kernel":
            lib.sj_shm_begin_kernel(segment._base, time.monotonic_ns())
        return segment

    # ---- using ------------------------------------------------------------------------------

    @property
    def name(self) -> str:
        """The kernel name; empty for private memory."""
        return self._name

    @property
    def layout(self) -> Layout:
        """The layout of the content."""
        return self._layout

    @property
    def role(self) -> Role:
        """What this process is to the segment."""
        return self._role

    @property
    def size(self) -> int:
        """Bytes of the segment."""
        return self._layout.size

    @property
    def closed(self) -> bool:
        """Whether it can no longer be used."""
        return self._state != "open"

    @property
    def base(self) -> Any:
        """The memory as ``void *``, for the C calls. Do not keep it beyond :meth:`close`.

        Raises SegmentClosedError, and ForkedError in a process that inherited the segment by fork.
        """
        if self._state != "open":
            self._refuse()
        return self._base

    def _refuse(self) -> NoReturn:
        if self._state == "forked":
            raise errors.ForkedError(
                f"segment {self._name!r} was inherited by fork and cannot be used here: attach "
                "to it in the child, or start it by 'spawn' or 'forkserver'",
                name=self._name,
            )
        raise errors.SegmentClosedError(f"segment {self._name!r} is closed", name=self._name)

    def check(self, status: int) -> int:
        """Return a status of a C call that is >= 0; raise the error of one that is not.

        KernelRestartedError carries the epoch of the new kernel. What it knew of positions, goals
        and records is gone: read the feedback, then ``sj_shm_address`` it to speak to it.
        """
        if status == lib.SJ_SHM_KERNEL_RESTARTED:
            epoch = int(lib.sj_shm_kernel_epoch(self.base))
            raise errors.KernelRestartedError(
                f"kernel {self._name!r} has been restarted (epoch {epoch})",
                name=self._name,
                epoch=epoch,
            )
        return raise_for_status(status, self._name)

    def host_lives(self) -> bool:
        """Whether a living process is host. Looks at the lock only: a silent host lives."""
        _ = self.base
        return self._fd < 0 or self._role == "host" or _locked_by_other(self._fd, _HOST)

    def kernel_lives(self) -> bool:
        """Whether a living process is the kernel."""
        _ = self.base
        return self._fd < 0 or self._role == "kernel" or _locked_by_other(self._fd, _KERNEL)

    # ---- ending -----------------------------------------------------------------------------

    def close(self) -> None:
        """Leave: give back locks and memory. The segment stays for others. Twice does no harm."""
        if self._state == "open":
            self._state = "closed"
            self._finalizer()

    def unlink(self) -> None:
        """Remove the name; who has the segment open keeps it. Twice does no harm."""
        if self._fd >= 0 and self._state == "open" and _same_file(self._fd, _path(self._name)):
            os.unlink(_path(self._name))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._created:
            self.unlink()
        self.close()

    def __reduce__(self) -> NoReturn:
        raise TypeError("a Segment cannot be pickled: pass its name and layout, and attach")

    def __repr__(self) -> str:
        return f"<Segment {self._name!r} {self._role} {self._state}>"

    def _inherited(self) -> None:
        """In the child of a fork: let go of locks and memory, which are the parent's."""
        if self._state == "open":
            self._state = "forked"
            self._finalizer.detach()
            _release(self._export, self._carrier, self._fd)


def _after_fork() -> None:
    for segment in list(_living):
        segment._inherited()


os.register_at_fork(after_in_child=_after_fork)


# ---- watching, cleaning -------------------------------------------------------------------------


class HostWatch:
    """Looks, outside the cycle, whether the host lives, and notes it where the cycle sees it.

    The kernel process keeps one while it runs; ``sj_shm_host_state`` then tells the cycle. A
    thread, so the cycle must run without the interpreter lock; without one, call :meth:`look` now
    and then. Leave it before the segment is closed.
    """

    def __init__(self, segment: Segment, *, period_s: float = 0.002) -> None:
        if segment.role == "monitor":
            raise ValueError("HostWatch writes: its segment must not be a monitor's")
        if not period_s > 0:
            raise ValueError(f"HostWatch.period_s = {period_s} must be > 0")
        self._segment = segment
        self._period_s = period_s
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name="sjerk-host-watch", daemon=True)

    def look(self) -> bool:
        """Look once: whether a living process is host."""
        base = self._segment.base
        epoch = lib.sj_shm_host_epoch(base)  # before the lock: see sj_shm_note_host
        lives = self._segment.host_lives()
        lib.sj_shm_note_host(base, epoch, lives)
        return lives

    def _run(self) -> None:
        while not self._end.wait(self._period_s) and not self._segment.closed:
            self.look()

    def __enter__(self) -> Self:
        self.look()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._thread.join()


@dataclass(frozen=True, kw_only=True)
class SegmentInfo:
    """One segment found by :func:`clean`.

    ``host`` and ``kernel`` say whether those live, ``in_use`` whether anybody living has it open.
    ``problem`` says why nothing could be learned or done, None if all is well.
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
        """Whether it only goes with a kernel's own segment: a trace."""
        return self.name.endswith(TRACE)


def clean(*, dry_run: bool = False, any_owner: bool = False) -> list[SegmentInfo]:
    """List all segments of sjerk on this machine, and remove those without a living owner.

    Never one that a living process has open. Segments of other users are listed only, unless
    ``any_owner``; files that are no segments are left alone. ``dry_run`` removes nothing.
    """
    return list(_look_through(dry_run, any_owner))


def _look_through(dry_run: bool, any_owner: bool) -> Iterator[SegmentInfo]:
    for entry in sorted(os.listdir(_FOLDER)):
        if entry.startswith(_PREFIX):
            with contextlib.suppress(errors.SegmentMissingError, FileNotFoundError):
                yield _look_at(entry.removeprefix(_PREFIX), dry_run, any_owner)


def _look_at(name: str, dry_run: bool, any_owner: bool) -> SegmentInfo:
    path = _path(name)
    found = os.stat(path, follow_symlinks=False)

    def info(**more: Any) -> SegmentInfo:
        nothing = {"host": False, "kernel": False, "in_use": False, "removed": False}
        return SegmentInfo(name=name, size=found.st_size, uid=found.st_uid, **(nothing | more))

    try:
        fd = _open(name, path, os.O_RDWR)
    except (errors.SegmentOwnerError, errors.SegmentGarbageError) as error:
        return info(in_use=isinstance(error, errors.SegmentOwnerError), problem=str(error))
    try:
        host, kernel = _locked_by_other(fd, _HOST), _locked_by_other(fd, _KERNEL)
        if _locked_by_other(fd, _PRESENT):
            return info(host=host, kernel=kernel, in_use=True)
        if found.st_uid != os.geteuid() and not any_owner:
            return info(problem=f"belongs to user {found.st_uid}")
        if _UNBORN not in name and not _ours(fd):
            return info(problem="not a segment of sjerk")
        if dry_run:
            return info()
        # From here on nobody can attach; whoever attached since we looked keeps the lock from us.
        if not _lock(fd, fcntl.F_WRLCK, _PRESENT) or not _same_file(fd, path):
            return info(in_use=True)
        os.unlink(path)
        return info(removed=True)
    finally:
        os.close(fd)


def _ours(fd: int) -> bool:
    """Whether the content begins as a segment does, of whatever version or state."""
    return os.pread(fd, len(_MAGIC), 0) == _MAGIC
