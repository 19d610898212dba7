"""Exceptions of sjerk, each with the data that a program needs to react, and the checks of input.

Never here: decisions about motion.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from numbers import Real
from typing import Any

#: Characters of a value that a message shows.
_SHOWN = 120


class SjerkError(Exception):
    """Base of every error that sjerk raises on purpose.

    All of them go through ``pickle``, with their data: a worker's error arrives as it was raised.

    >>> from pickle import dumps, loads
    >>> loads(dumps(InputError("jerk", 0.0, "must be greater than 0"))).field
    'jerk'
    """

    def __reduce__(self) -> tuple[Any, ...]:
        """What makes it again; Exception would call ``__init__`` with the text alone."""
        made = super().__reduce__()
        state = made[2:] if isinstance(made, tuple) else ()
        return _again, (type(self), self.args), *state


def _again(kind: type[SjerkError], args: tuple[object, ...]) -> SjerkError:
    """An error without ``__init__``: its attributes are set behind it."""
    return kind.__new__(kind, *args)


class InputError(SjerkError, ValueError):
    """A value that cannot be used: names the ``field``, the ``value`` and the ``limit``.

    >>> print(InputError("velocity", -1.0, "must be greater than 0"))
    velocity = -1.0: must be greater than 0

    The message has the beginning of a long value, ``value`` the whole of it.
    """

    def __init__(self, field: str, value: object, limit: str) -> None:
        text = repr(value)
        text = text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."
        super().__init__(f"{field} = {text}: {limit}")
        self.field = field
        self.value = value
        self.limit = limit


class ExtraMissingError(SjerkError, ImportError):
    """What was asked for needs ``module``, which comes with the extra ``sjerk[extra]``."""

    def __init__(self, module: str, extra: str) -> None:
        super().__init__(f"module {module!r} is not installed: pip install 'sjerk[{extra}]'")
        self.module = module
        self.extra = extra


class PlatformError(SjerkError, ImportError):
    """What was asked for needs Linux: shared memory with its locks, the clock, EtherCAT's sockets.

    Planning, sampling, trajectories, streams and the simulated drive need none of it.
    """

    def __init__(self, name: str) -> None:
        super().__init__(
            f"{name} needs Linux and this is {sys.platform}; "
            "planning, sampling, trajectories, streams and the simulated drive work here"
        )
        self.name = name


class InfeasibleError(SjerkError, ValueError):
    """No forward profile in whole cycles covers the distance.

    ``distance`` is what was asked, ``works`` one that has a profile under the same limits, both in
    the unit of the axis.

    >>> print(InfeasibleError(0.1, 2.5, "shorter than the change of velocity needs"))
    distance = 0.1: shorter than the change of velocity needs; 2.5 works
    """

    def __init__(self, distance: float, works: float, why: str) -> None:
        super().__init__(f"distance = {distance!r}: {why}; {works!r} works")
        self.distance = distance
        self.works = works


class PlanError(SjerkError):
    """The planner found no motion for a legal request: a fault of sjerk, please report it."""


def axis_label(axis: int, names: Sequence[str] = ()) -> str:
    """How a text calls an axis: by its number, and by its name where it has one.

    >>> axis_label(1, ["", "elbow"]), axis_label(0, ["", "elbow"])
    ('axis 1 (elbow)', 'axis 0')
    """
    name = names[axis] if 0 <= axis < len(names) else ""
    return f"axis {axis} ({name})" if name else f"axis {axis}"


class RefusedError(SjerkError):
    """The kernel refused a goal: ``code`` (``enum sj_result``), ``reason``, ``axis`` or -1.

    ``names``: of all axes, for the text.

    >>> print(RefusedError(3, "the drive does not follow", 1, ["shoulder", "elbow"]))
    refused by axis 1 (elbow): the drive does not follow
    """

    def __init__(self, code: int, reason: str, axis: int, names: Sequence[str] = ()) -> None:
        self.code = code
        self.reason = reason
        self.axis = axis
        super().__init__(self.told(lambda i: axis_label(i, names)))

    def told(self, label: Callable[[int], str]) -> str:
        """Its text, with another way to call an axis."""
        by = f" by {label(self.axis)}" if self.axis >= 0 else ""
        return f"refused{by}: {self.reason}"


class MotionStoppedError(SjerkError):
    """A move ended elsewhere: stopped or replaced, or a drive went into a fault.

    ``positions`` are the commanded ones by axis, ``faults`` the error codes (603Fh) of the drives
    that are in a fault, by axis; ``unhomed`` the axis whose homing failed, or None; ``switches``
    the limit switches that are closed (60FDh: 1 negative, 2 positive, 3 both), by axis;
    ``error_stops`` the axes that are in ErrorStop without a fault of their drive (a following
    error, a lost drive). ``names``: of all axes, for the text.

    >>> print(MotionStoppedError({1: 0.25}, names=["shoulder", "elbow"]))
    stopped or replaced before the goal, commanded positions: axis 1 (elbow) 0.25
    """

    def __init__(
        self,
        positions: dict[int, float],
        faults: dict[int, int] | None = None,
        unhomed: int | None = None,
        switches: dict[int, int] | None = None,
        *,
        names: Sequence[str] = (),
        error_stops: Sequence[int] = (),
    ) -> None:
        self.positions = positions
        self.error_stops = tuple(error_stops)
        self.unhomed = unhomed
        self.faults = faults or {}
        self.switches = switches or {}
        super().__init__(self.told(lambda i: axis_label(i, names)))

    def told(self, label: Callable[[int], str]) -> str:
        """Its text, with another way to call an axis."""
        codes = ", ".join(f"{label(i)}: {code:04X}h" for i, code in self.faults.items())
        why = f"drive fault ({codes})" if codes else "stopped or replaced"
        if self.error_stops:
            why += f", in ErrorStop ({', '.join(map(label, self.error_stops))})"
        if self.unhomed is not None:
            why = f"homing of {label(self.unhomed)} failed" + (f", {why}" if codes else "")
        if self.switches:
            sides = ("negative", "positive", "negative and positive")
            closed = (f"{label(i)}: {sides[side - 1]}" for i, side in self.switches.items())
            why += f", limit switch closed ({', '.join(closed)})"
        at = ", ".join(f"{label(i)} {position!r}" for i, position in self.positions.items())
        return f"{why} before the goal, commanded positions: {at}"


class SupersededError(MotionStoppedError):
    """A newer goal took the place of this one. ``positions`` by axis, in axis units.

    >>> print(SupersededError({0: 0.25}))
    stopped or replaced before the goal, commanded positions: axis 0 0.25
    """


class QueueFullError(SjerkError):
    """The look-ahead takes no more now: ``capacity`` records wait. Nothing has been queued.

    >>> print(QueueFullError(512))
    512 records wait for the kernel: wait for one of the moves
    """

    def __init__(self, capacity: int) -> None:
        super().__init__(f"{capacity} records wait for the kernel: wait for one of the moves")
        self.capacity = capacity


class ConfigError(InputError):
    """A value in a configuration file: ``path`` is the file, ``field`` the place in it.

    >>> print(ConfigError("robot.toml", "axes[0].limits.jerk", None, "is missing"))
    robot.toml: axes[0].limits.jerk: is missing
    """

    def __init__(self, path: str, field: str, value: object, limit: str) -> None:
        super().__init__(f"{path}: {field}", value, limit)
        if value is None:  # no file can say it: there is no value
            self.args = (f"{path}: {field}: {limit}",)
        self.path = path
        self.field = field


class KernelGoneError(SjerkError):
    """The kernel's process has ended: whatever was to be waited for does not come.

    >>> raise KernelGoneError("the kernel ended while waiting for drives to follow")
    Traceback (most recent call last):
    sjerk.errors.KernelGoneError: the kernel ended while waiting for drives to follow
    """


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
    """A segment of this name exists and a living process uses it."""


class SegmentStaleError(HandshakeError):
    """A segment of this name exists, but no living process uses it: its owners died."""


class SegmentOwnerError(HandshakeError):
    """The segment belongs to another user (``uid``), or its permissions refuse this one."""

    def __init__(self, message: str, *, name: str = "", uid: int | None = None) -> None:
        super().__init__(message, name=name)
        self.uid = uid


class SegmentMemoryError(HandshakeError):
    """The system lacks what a segment of ``size`` bytes needs: memory, inodes, open files."""

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
    """A word or a checksum is impossible: a process wrote that must not."""


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


#: Magnitudes up to this, and limits down to its inverse, leave room for squares and cubes.
LARGEST = 1e60


def real(field: str, value: object) -> float:
    """Return ``value`` as a float; refuse what is not a finite real number of sane size.

    Magnitudes below 1 / LARGEST count as zero.
    """
    if value.__class__ is not float and (isinstance(value, bool) or not isinstance(value, Real)):
        raise InputError(field, value, "must be a real number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise InputError(field, value, "must be finite")
    if abs(number) > LARGEST:
        raise InputError(field, value, f"must lie within {LARGEST:g} in magnitude")
    return number if abs(number) >= 1.0 / LARGEST else 0.0


def positive(field: str, value: object) -> float:
    """Return ``value`` as a float greater than zero."""
    number = real(field, value)
    if number <= 0.0:
        raise InputError(field, value, f"must be greater than 0, at least {1.0 / LARGEST:g}")
    return number
