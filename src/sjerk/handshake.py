"""The dual-port RAM as Python sees it: who may map the segment, who may write, who is alive.

``Segment`` is one opened segment, ``HostWatch`` looks whether its host lives. This module is the
front of the room: ``Layout`` and ``raise_for_status`` come from ``sjerk.dpram.layout``, ``clean``
and ``SegmentInfo`` from ``sjerk.dpram.inventory``. How bytes are laid out and exchanged is C
(``dpram/``). Never here: what a command or a feedback frame means.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import threading
import time
import weakref
from types import TracebackType
from typing import Any, Literal, NoReturn, Self

from sjerk import errors
from sjerk._binding import ffi, lib
from sjerk.dpram.files import (
    INCOMPLETE,
    TRACE,
    Lock,
    Pages,
    PrivateMemory,
    check_file,
    check_name,
    create_file,
    give_name,
    group_number,
    locked_by_other,
    no_memory,
    open_file,
    path_of,
    still_named,
    take_lock,
)
from sjerk.dpram.inventory import SegmentInfo, clean
from sjerk.dpram.layout import Layout, check_content, raise_for_status
from sjerk.dpram.stop_slots import SHARED, claim

__all__ = [
    "TRACE",
    "HostWatch",
    "Layout",
    "Role",
    "Segment",
    "SegmentInfo",
    "clean",
    "group_number",
    "raise_for_status",
]

#: What a process is to a segment: it keeps it, commands through it, looks on, is the kernel, or
#: looks on and may stop the axes.
Role = Literal["owner", "host", "monitor", "kernel", "stopper"]


def _finish(export: Any, memory: Any, fd: int, role: Role) -> None:
    """Leave in order. The exports go first: a SharedMemory with exports refuses to close."""
    if role == "host":
        lib.sj_shm_leave_host(export)
    elif role == "kernel":
        lib.sj_shm_leave_kernel(export)
    _release(export, memory, fd)


def _release(export: Any, memory: Any, fd: int) -> None:
    ffi.release(export)
    memory.close()
    if fd >= 0:
        os.close(fd)  # and with it every lock


_living: weakref.WeakSet[Segment] = weakref.WeakSet()


class Segment:
    """One opened segment. Made by :meth:`create`, :meth:`attach` or :meth:`private`.

    It is a context manager: leaving it closes the segment, and removes it if it was created here.
    One thread at a time may write through it: the C calls run without the interpreter lock.
    The exchanges and their proof: ``docs/explanation/handshake.md``.

    >>> with Segment.private(Layout(command_bytes=8, feedback_bytes=8)) as segment:
    ...     segment.role, segment.size, segment.host_lives()
    ('owner', 28672, True)
    """

    def __init__(
        self, name: str, layout: Layout, role: Role, memory: Any, fd: int, created: bool = False
    ) -> None:
        """Not for callers: the classmethods make the arguments."""
        self._name = name
        self._layout = layout
        self._role: Role = role
        self._memory = memory
        self._fd = fd
        self._created = created
        self._stop_slot: int = SHARED
        self._state: Literal["open", "closed", "forked"] = "open"
        export = ffi.from_buffer("char[]", memory.buf)
        self._export = export
        self._base = ffi.cast("void *", export)  # a pointer crosses into C faster than an array
        self._finalizer = weakref.finalize(self, _finish, export, memory, fd, role)
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

        Raises ``SegmentTakenError`` if a living process uses the name, ``SegmentStaleError`` if
        only dead ones did (unless ``replace_stale``), ``SegmentMemoryError``,
        ``SegmentNameError``, ``InputError`` for a group that is not there or not this user's.
        """
        check_name(name)
        gid = group_number(group)
        while True:
            temporary = f"{name}{INCOMPLETE}-{os.getpid()}-{time.monotonic_ns()}"
            fd = create_file(name, temporary, layout, gid)
            if fd < 0:
                continue
            memory: Any = None
            try:
                # clean() may have come between creation and lock
                if not still_named(fd, path_of(temporary)):
                    os.close(fd)
                    continue
                give_name(name, path_of(temporary), replace_stale)
                if role == "kernel":
                    take_lock(fd, fcntl.F_WRLCK, Lock.KERNEL)
                memory = Pages(fd, writable=True)
                return cls._opened(name, layout, role, memory, fd, created=True)
            except BaseException as error:
                if memory is not None:
                    memory.close()
                os.close(fd)
                if isinstance(error, OSError):
                    raise no_memory(error, name, layout.size) from error
                raise
            finally:
                with contextlib.suppress(FileNotFoundError):
                    os.unlink(path_of(temporary))

    @classmethod
    def attach(
        cls,
        name: str,
        layout: Layout | None = None,
        *,
        role: Literal["host", "monitor", "kernel", "stopper"] = "monitor",
        any_owner: bool = False,
    ) -> Self:
        """Open the segment of kernel ``name``.

        A monitor maps the pages read-only, a stopper asks for stops, and of both there may be any
        number. There is one host and one kernel at a time, each held by a lock that ends with its
        process. ``layout`` is what the content must be; None takes the one found. ``any_owner``
        accepts a segment that another user created.

        Raises ``SegmentMissingError``, ``SegmentOwnerError``, ``HostTakenError`` (with the pid of
        the other), ``KernelTakenError``, ``SegmentMemoryError`` where the system lacks something,
        or the ``SegmentFormatError`` that says what is wrong with the content.
        """
        check_name(name)
        if role not in ("host", "monitor", "kernel", "stopper"):
            raise ValueError(f"role = {role!r} is not 'host', 'monitor', 'kernel' or 'stopper'")
        path = path_of(name)
        fd = open_file(name, path, os.O_RDONLY if role == "monitor" else os.O_RDWR)
        memory: Any = None
        try:
            check_file(fd, name, any_owner)
            if not take_lock(fd, fcntl.F_RDLCK, Lock.PRESENT):
                raise errors.SegmentMissingError(
                    f"segment {name!r} is being removed: its owners died", name=name
                )
            memory = Pages(fd, writable=role != "monitor")
            if not still_named(fd, path):
                raise errors.SegmentMissingError(f"segment {name!r} was just removed", name=name)
            with ffi.from_buffer("char[]", memory.buf) as base:
                found = check_content(base, name, layout)
                if role == "host" and not take_lock(fd, fcntl.F_WRLCK, Lock.HOST):
                    pid = int(lib.sj_shm_host_pid(base))
                    raise errors.HostTakenError(
                        f"kernel {name!r} already has a host, process {pid}", name=name, pid=pid
                    )
            if role == "kernel" and not take_lock(fd, fcntl.F_WRLCK, Lock.KERNEL):
                raise errors.KernelTakenError(f"kernel {name!r} is already running", name=name)
            return cls._opened(name, found, role, memory, fd)
        except BaseException as error:
            if memory is not None:
                memory.close()
            os.close(fd)
            if isinstance(error, OSError):
                raise no_memory(error, name, 0) from error
            raise

    @classmethod
    def private(cls, layout: Layout) -> Self:
        """A segment in the memory of this process: host and kernel in one, no locks, no files."""
        memory = PrivateMemory(layout.size)
        with ffi.from_buffer("char[]", memory.buf) as base:
            raise_for_status(lib.sj_shm_format(base, len(base), layout.config()))
            lib.sj_shm_begin_kernel(base, time.monotonic_ns())
            lib.sj_shm_begin_host(base, os.getpid(), time.monotonic_ns())
        return cls("", layout, "owner", memory, -1)

    @classmethod
    def _opened(
        cls, name: str, layout: Layout, role: Role, memory: Any, fd: int, created: bool = False
    ) -> Self:
        """The Segment of a file whose locks are taken; begins the epoch of its role."""
        segment = cls(name, layout, role, memory, fd, created)
        if role == "stopper":
            segment._stop_slot = claim(fd, segment.base)
        elif role == "host":
            lib.sj_shm_begin_host(segment.base, os.getpid(), time.monotonic_ns())
        elif role == "kernel":
            lib.sj_shm_begin_kernel(segment.base, time.monotonic_ns())
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
    def stop_slot(self) -> int:
        """The slot for stop requests of this process, for the C calls."""
        return self._stop_slot

    def is_same(self, other: Segment) -> bool:
        """Whether both are one memory, not two that had the same name one after the other."""
        _ = self.base, other.base
        if self is other or min(self._fd, other._fd) < 0:
            return self is other
        return os.path.samestat(os.fstat(self._fd), os.fstat(other._fd))

    @property
    def closed(self) -> bool:
        """Whether it can no longer be used here."""
        return self._state != "open"

    @property
    def base(self) -> Any:
        """The memory as ``void *``, for the C calls. Do not keep it beyond :meth:`close`.

        Raises ``SegmentClosedError``, and ``ForkedError`` in a process that inherited the segment
        by fork.
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
        """Whether a living process is host. Asks for the lock only: a silent host lives."""
        _ = self.base
        return self._fd < 0 or self._role == "host" or locked_by_other(self._fd, Lock.HOST)

    def host_pid(self) -> int | None:
        """The process that is host, or None; for messages: it may end at any moment."""
        return int(lib.sj_shm_host_pid(self.base)) if self.host_lives() else None

    def kernel_lives(self) -> bool:
        """Whether a living process is the kernel."""
        _ = self.base
        return self._fd < 0 or self._role == "kernel" or locked_by_other(self._fd, Lock.KERNEL)

    # ---- ending -----------------------------------------------------------------------------

    def close(self) -> None:
        """Give back locks and memory. The segment stays for others. Closing twice does no harm."""
        if self._state == "open":
            self._state = "closed"
            self._finalizer()

    def unlink(self) -> None:
        """Remove the name. Processes that have the segment open keep it. Twice does no harm."""
        if self._fd >= 0 and self._state == "open" and still_named(self._fd, path_of(self._name)):
            os.unlink(path_of(self._name))

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

    def abandon(self) -> None:
        """In the child of a fork: let go of locks and memory, which are the parent's.

        Called for every open segment when a process forks.
        """
        if self._state == "open":
            self._state = "forked"
            self._finalizer.detach()
            _release(self._export, self._memory, self._fd)


def _after_fork() -> None:
    for segment in list(_living):
        segment.abandon()


os.register_at_fork(after_in_child=_after_fork)


# ---- watching, cleaning -------------------------------------------------------------------------


class HostWatch:
    """Looks, outside the cycle, whether the host lives, and notes it where the cycle sees it.

    The kernel process keeps one while it runs; ``sj_shm_host_state`` then tells the cycle. It is a
    context manager with a thread that looks every ``period_s`` seconds, so the cycle must run
    without the interpreter lock. Without the thread, call :meth:`look` regularly. Leave it before
    the segment is closed. Raises ``ValueError`` for a monitor's segment and for a period that is
    not positive.

    >>> with Segment.private(Layout(command_bytes=8, feedback_bytes=8)) as segment:
    ...     HostWatch(segment).look()
    True
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
