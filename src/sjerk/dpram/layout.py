"""The layout of a segment, and what a status of its C says in words.

A layout is sizes only: how the bytes lie is C (``_handshake.c``). Never here: files, locks, what a
command or a feedback frame means.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import Any

from sjerk import errors
from sjerk._binding import ffi, lib


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Sizes of what is exchanged; both sides must name the same.

    ``command_bytes`` and ``feedback_bytes`` (1 .. 2**20) are one command and one feedback frame
    for all axes. ``record_capacity`` lookahead records of ``record_bytes`` wait in the ring,
    ``event_capacity`` events of ``event_bytes`` are kept; capacities are powers of two, 0 for
    none. ``abi`` is a hash of the payload layouts, so that two programs that mean different things
    by the same sizes do not meet.

    Raises ``TypeError`` for what is no int, ``ValueError`` with the field and its limit.

    >>> Layout(command_bytes=512, feedback_bytes=512).size
    32768
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
        """For C calls: this layout as an ``sj_shm_config *``."""
        return ffi.new("sj_shm_config *", asdict(self))


def raise_for_status(status: int, name: str = "") -> int:
    """Return a status >= 0 as it is; raise the error of a negative ``enum sj_shm_status``.

    >>> raise_for_status(1)
    1
    """
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
            "a checksum fails: a process writes without the lock",
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


def check_content(base: Any, name: str, layout: Layout | None) -> Layout:
    """The layout of the segment in memory ``base``; that of ``layout`` unless it is None.

    Raises the ``SegmentFormatError`` that says what is wrong with the content.
    """
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
