"""The trace of a kernel: what each of its cycles took and gave, as arrays.

A segment next to the kernel's own, of the same handshake: items in its event ring, the kernel's
description as its one feedback frame. A reader needs no lock and disturbs nobody. Never
here: files, motion.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import cache
from numbers import Integral, Real
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from sjerk._binding import dtype_of, ffi, lib
from sjerk.errors import SegmentLayoutError, SegmentNotReadyError
from sjerk.handshake import TRACE, Layout, Segment

_KIND = slice(16, 20)  # of an item: bytes of sj_trace_head.kind
_SECONDS = 4.0  # of cycles that are kept for a reader that is late
_LEAST, _MOST, _MOST_BYTES = 256, 2**14, 2**25


def layout(axes: int, cycle_time: float, description: int) -> Layout:
    """Layout of the trace of a kernel; ``description`` in bytes."""
    item = int(lib.sj_trace_item_bytes(axes))
    capacity = _LEAST
    while capacity < min(_SECONDS / cycle_time, _MOST) and 2 * capacity * item <= _MOST_BYTES:
        capacity *= 2
    return Layout(
        command_bytes=8,  # nobody commands a trace
        feedback_bytes=description,
        event_bytes=item,
        event_capacity=capacity,
        abi=_abi(),
    )


@cache
def _abi() -> int:
    text = str([frame_dtype(1).descr, command_dtype(1).descr, event_dtype().descr])
    text += str([record_dtype(1).descr, stop_dtype().descr])
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little")


def touch(segment: Segment) -> None:
    """Map every page now, not in a cycle."""
    memory = np.frombuffer(ffi.buffer(segment.base, segment.size), np.uint8)
    int(memory[::4096].sum())


# ---- layouts -------------------------------------------------------------------------------------


@cache
def frame_dtype(axes: int) -> np.dtype[Any]:
    """One ``sj_trace_frame`` of so many axes."""
    return dtype_of("sj_trace_frame", last=axes)


@cache
def command_dtype(axes: int) -> np.dtype[Any]:
    """One ``sj_command`` of so many axes."""
    return dtype_of("sj_command", last=axes)


@cache
def record_dtype(axes: int) -> np.dtype[Any]:
    """One ``sj_record`` of so many axes."""
    return dtype_of("sj_record", last=axes)


@cache
def stop_dtype() -> np.dtype[Any]:
    """One ``sj_stop``: what a process beside the host asked to be stopped."""
    return dtype_of("sj_stop")


@cache
def row_dtype(axes: int, what: Literal["command", "record", "stop"]) -> np.dtype[Any]:
    """Cycle, number and bytes of one command, of one record of the ring, or of one stop."""
    kinds = {"command": lib.sj_command_bytes, "record": lib.sj_record_bytes}
    size = stop_dtype().itemsize if what == "stop" else int(kinds[what](axes))
    return np.dtype([("cycle", "u8"), ("number", "u8"), ("data", np.dtype((np.void, size)))])


@cache
def event_dtype() -> np.dtype[Any]:
    """One ``sj_kernel_event``."""
    return dtype_of("sj_kernel_event")


# ---- what a kernel is ----------------------------------------------------------------------------


def describe(**what: Any) -> bytes:
    """Text (JSON) of dataclasses and numbers; only fields that are not as by default."""
    text = json.dumps(plain(what), separators=(",", ":")).encode()
    return text + b" " * (-len(text) % 8)


def plain(value: Any) -> Any:
    """Tables, lists, texts and numbers of Python, of dataclasses of sjerk and numbers of any kind.

    Of a subclass the fields that sjerk gave its base. Raises TypeError for anything else.
    """
    if is_dataclass(value) and not isinstance(value, type):
        known = next(c for c in type(value).__mro__ if c.__module__.partition(".")[0] == "sjerk")
        found = {}
        for field in fields(known):
            if not field.init:
                continue
            own = getattr(value, field.name)
            usual = field.default
            if field.default_factory is not MISSING:
                usual = field.default_factory()
            if usual is MISSING or own != usual:
                found[field.name] = plain(own)
        return found
    if isinstance(value, dict):
        return {key: plain(one) for key, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(one) for one in value]
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Real):
        return float(value)
    if isinstance(value, str) or value is None:
        return value
    raise TypeError(f"{value!r} cannot be described")


# ---- reading -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Chunk:
    """Consecutive cycles of a trace.

    ``frames``: structured (cycles,), one ``sj_trace_frame`` each. ``missed`` (cycles,): items that
    were lost before each. ``commands``, ``records`` and ``stops`` (those that processes beside the
    host asked for): structured ``cycle``, ``number``, ``data``; ``events``: structured
    ``sj_kernel_event``; all in order.
    """

    frames: NDArray[Any]
    missed: NDArray[np.uint64]
    commands: NDArray[Any]
    records: NDArray[Any]
    events: NDArray[Any]
    stops: NDArray[Any]

    @property
    def axes(self) -> int:
        """How many axes."""
        return int(self.frames.dtype["axis"].shape[0])

    @classmethod
    def joined(cls, chunks: Sequence[Chunk], axes: int) -> Chunk:
        """One chunk of many, maybe none."""
        if not chunks:
            return cls(
                np.empty(0, frame_dtype(axes)),
                np.empty(0, np.uint64),
                np.empty(0, row_dtype(axes, "command")),
                np.empty(0, row_dtype(axes, "record")),
                np.empty(0, event_dtype()),
                np.empty(0, row_dtype(axes, "stop")),
            )
        if len(chunks) == 1:
            return chunks[0]
        names = [field.name for field in fields(cls)]
        return cls(*(np.concatenate([getattr(one, name) for one in chunks]) for name in names))


class Trace:
    """A reader of the trace of one kernel, from the oldest items that are kept.

    Of a full trace the oldest eighth is left out: the kernel may overwrite it before it is read.
    """

    def __init__(self, segment: Segment, axes: int, text: bytes) -> None:
        """Not for callers: ``attach`` or ``of``."""
        self.segment = segment
        self.description: dict[str, Any] = json.loads(text)
        self.axes = axes
        self._bytes = int(lib.sj_trace_item_bytes(axes))
        self._room = max(64, 2**22 // self._bytes)
        self._buffer = np.empty((self._room, self._bytes), np.uint8)
        self._into = ffi.from_buffer("char[]", self._buffer)
        kept = segment.layout.event_capacity * 7 // 8
        oldest = max(0, int(lib.sj_event_latest(segment.base)) - kept)
        self._cursor = ffi.new("uint64_t *", oldest)
        self._missed = ffi.new("uint64_t *", 0)
        self._rest = np.empty((0, self._bytes), np.uint8)
        self._lost = 0

    @classmethod
    def attach(cls, name: str, *, any_owner: bool = False) -> Self:
        """The trace of the running kernel ``name``; raises HandshakeError."""
        segment = Segment.attach(name + TRACE, role="monitor", any_owner=any_owner)
        try:
            return cls.of(segment)
        except BaseException:
            segment.close()
            raise

    @classmethod
    def of(cls, segment: Segment) -> Self:
        """The trace in a segment."""
        text, number = ffi.new("char[]", segment.layout.feedback_bytes), ffi.new("uint64_t *")
        if segment.check(lib.sj_feedback_read(segment.base, text, number)) == 0:
            raise SegmentNotReadyError(
                f"the kernel of {segment.name!r} has not begun", name=segment.name
            )
        raw = bytes(ffi.buffer(text))
        description = json.loads(raw)
        axes = len(description["axes"])
        if segment.layout != layout(axes, description["cycle_time"], len(raw)):
            raise SegmentLayoutError(f"{segment.name!r} is of another version", name=segment.name)
        return cls(segment, axes, raw)

    @property
    def alive(self) -> bool:
        """Whether the kernel lives."""
        return self.segment.kernel_lives()

    @property
    def position(self) -> int:
        """Number of the newest item that was read."""
        return int(self._cursor[0])

    def read(self) -> Chunk | None:
        """The whole cycles since the last call, some thousand at most; None if there are none."""
        before = self._missed[0]
        found = self.segment.check(
            lib.sj_trace_drain(
                self.segment.base, self._cursor, self._missed, self._room, self._into
            )
        )
        lost = int(self._missed[0] - before)
        if found == 0:
            return None
        # a loss lies before the last item that was drained
        items = np.concatenate([self._rest, self._buffer[:found]])
        kinds = items[:, _KIND].view(np.int32)[:, 0]
        ends = np.flatnonzero(kinds == lib.SJ_TRACE_FRAME)
        whole = int(ends[-1]) + 1 if len(ends) else 0
        self._rest = items[whole:].copy()
        if whole == 0:
            self._lost += lost
            return None
        chunk = self._chunk(items[:whole], kinds[:whole], ends)
        if lost and len(self._rest) == 0:
            chunk.missed[-1] += lost
            lost = 0
        chunk.missed[0] += self._lost
        self._lost = lost
        return chunk

    def messages(self) -> list[Chunk]:
        """Of a trace without frames: what came since the last call."""
        found = []
        while n := self.segment.check(
            lib.sj_trace_drain(
                self.segment.base, self._cursor, self._missed, self._room, self._into
            )
        ):
            items = self._buffer[:n]
            kinds = items[:, _KIND].view(np.int32)[:, 0]
            found.append(self._chunk(items, kinds, np.empty(0, np.int64)))
        return found

    def _chunk(self, items: NDArray[np.uint8], kinds: NDArray[np.int32], ends: Any) -> Chunk:
        frames = np.ascontiguousarray(items[ends, : lib.sj_trace_frame_bytes(self.axes)])
        rows = np.ascontiguousarray(items[kinds == lib.SJ_TRACE_EVENT])
        head = ffi.sizeof("sj_trace_head")
        event = np.ascontiguousarray(rows[:, head : head + event_dtype().itemsize])
        return Chunk(
            frames.view(frame_dtype(self.axes))[:, 0],
            np.zeros(len(frames), np.uint64),
            self._rows(items[kinds == lib.SJ_TRACE_COMMAND], row_dtype(self.axes, "command")),
            self._rows(items[kinds == lib.SJ_TRACE_RECORD], row_dtype(self.axes, "record")),
            event.view(event_dtype())[:, 0],
            self._rows(items[kinds == lib.SJ_TRACE_STOP], row_dtype(self.axes, "stop")),
        )

    def _rows(self, items: NDArray[np.uint8], kind: np.dtype[Any]) -> NDArray[Any]:
        """Cycle, number, and the payload behind the whole head."""
        head, size = ffi.sizeof("sj_trace_head"), kind["data"].itemsize
        part = np.concatenate([items[:, :16], items[:, head : head + size]], axis=1)
        return np.ascontiguousarray(part).view(kind)[:, 0]

    def close(self) -> None:
        """Let go of the segment."""
        if self.segment.role == "monitor":
            self.segment.close()
