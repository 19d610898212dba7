"""Exceptions of sjerk. Each carries the data that a program needs to react."""

from __future__ import annotations


class SjerkError(Exception):
    """Base of every error that sjerk raises on purpose."""


class HandshakeError(SjerkError):
    """A segment cannot be used. ``name`` is the kernel name it was asked for by."""

    def __init__(self, message: str, *, name: str = "") -> None:
        super().__init__(message)
        self.name = name


class SegmentNameError(HandshakeError, ValueError):
    """The name has no place in a file name, or is too long."""


class SegmentMissingError(HandshakeError):
    """No segment of this name: no kernel has been started under it, or it has been removed."""


class SegmentTakenError(HandshakeError):
    """A segment of this name exists and somebody living uses it."""


class SegmentStaleError(HandshakeError):
    """A segment of this name exists, but nobody living uses it: its owners died."""


class SegmentOwnerError(HandshakeError):
    """The segment belongs to another user (``uid``), or its permissions refuse this one."""

    def __init__(self, message: str, *, name: str = "", uid: int | None = None) -> None:
        super().__init__(message, name=name)
        self.uid = uid


class SegmentMemoryError(HandshakeError):
    """There is no memory left for ``size`` bytes."""

    def __init__(self, message: str, *, name: str = "", size: int = 0) -> None:
        super().__init__(message, name=name)
        self.size = size


class SegmentFormatError(HandshakeError):
    """The content is not what was expected; ``status`` is the ``enum sj_shm_status``."""

    def __init__(self, message: str, *, name: str = "", status: int = 0) -> None:
        super().__init__(message, name=name)
        self.status = status


class SegmentNotReadyError(SegmentFormatError):
    """Still being created, or its creator died at it."""


class SegmentTruncatedError(SegmentFormatError):
    """Shorter than its header says."""


class SegmentGarbageError(SegmentFormatError):
    """Not a segment of sjerk, or overwritten."""


class SegmentVersionError(SegmentFormatError):
    """Made by a version of sjerk with another layout of the segment."""


class SegmentLayoutError(SegmentFormatError):
    """The payloads differ: another number of axes, or another version of their structs."""


class SegmentCorruptError(SegmentFormatError):
    """A word or a checksum is impossible: somebody wrote who must not."""


class HostTakenError(HandshakeError):
    """Another process is host of this kernel; ``pid`` is that process."""

    def __init__(self, message: str, *, name: str = "", pid: int | None = None) -> None:
        super().__init__(message, name=name)
        self.pid = pid


class KernelTakenError(HandshakeError):
    """Another process is the kernel of this name."""


class KernelRestartedError(HandshakeError):
    """The kernel spoken to is gone; another one, ``epoch``, has taken its place."""

    def __init__(self, message: str, *, name: str = "", epoch: int = 0) -> None:
        super().__init__(message, name=name)
        self.epoch = epoch


class ForkedError(HandshakeError):
    """The segment was inherited by ``fork``: two processes would write as one."""


class SegmentClosedError(HandshakeError, ValueError):
    """The segment has been closed."""
