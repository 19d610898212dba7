"""Recordings: every cycle of a kernel, to a file and back, with what is needed to run it again.

``Recorder`` reads the trace of a kernel; ``Recording`` gives arrays. Never here: how a file is laid
out, motion.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from sjerk._binding import lib
from sjerk.errors import InputError, positive
from sjerk.host.feedback import Event, EventKind, PathState
from sjerk.kernel.config import described
from sjerk.kernel.kernel import MotionKernel
from sjerk.kernel.trace import Chunk, Trace, event_dtype, frame_dtype, record_dtype, row_dtype
from sjerk.recording import files

FloatArray = NDArray[np.float64]
_ROWS = 4096  # cycles of one piece of a file


# ---- between arrays of structs and columns -------------------------------------------------------


def _flat(kind: np.dtype[Any], prefix: str = "") -> Iterator[tuple[str, tuple[str, ...]]]:
    """Column name and path of every number of a struct."""
    for name in kind.names or ():
        inner = kind[name].base
        path = (name,)
        if name == "reserved" or (prefix == "head_" and name != "cycle"):
            continue
        if inner.names:
            below = "" if name in ("head", "axis") else f"{name.rstrip('s')}_"
            for column, rest in _flat(inner, "head_" if name == "head" else below):
                yield column, path + rest
        else:
            yield (name if prefix == "head_" else prefix + name), path


def _to_columns(rows: NDArray[Any]) -> dict[str, NDArray[Any]]:
    found = {}
    for column, path in _flat(rows.dtype):
        values = rows
        for name in path:
            values = values[name]
        found[column] = values
    return found


def _from_columns(columns: dict[str, NDArray[Any]], kind: np.dtype[Any], n: int) -> NDArray[Any]:
    rows = np.zeros(n, kind)
    for column, path in _flat(kind):
        into = rows
        for name in path:
            into = into[name]
        into[...] = _column(columns, column, into)
    return rows


def _column(columns: dict[str, NDArray[Any]], name: str, like: NDArray[Any]) -> NDArray[Any]:
    """A column that fits; raises InputError."""
    found = columns.get(name)
    if found is None:
        raise InputError("column", name, "is missing, or the file is of another version")
    if (found.dtype, found.shape) != (like.dtype, like.shape):
        have, want = (f"{array.dtype}{list(array.shape)}" for array in (found, like))
        raise InputError("column", name, f"must be {want}, is {have}")
    return found


def _tables(chunk: Chunk) -> files.Tables:
    frames = _to_columns(chunk.frames) | {"missed": chunk.missed}
    found = {files.FRAMES: frames, "events": _to_columns(chunk.events)}
    for name in ("commands", "records"):
        rows = getattr(chunk, name)
        found[name] = {part: rows[part] for part in rows.dtype.names}
    return found


def _chunk(tables: files.Tables, axes: int) -> Chunk:
    """Raises InputError for what was not written by ``_tables`` for so many axes."""
    for name in (files.FRAMES, "events", "commands", "records"):
        if "cycle" not in tables.get(name, {}):
            raise InputError("column", f"{name}.cycle", "is missing")
    frames, told = tables[files.FRAMES], tables["events"]
    n, k = len(frames["cycle"]), len(told["cycle"])
    events = _from_columns(told, event_dtype(), k) if k else np.empty(0, event_dtype())
    strange = set(events["kind"].tolist()) - set(EventKind)
    if strange:
        raise InputError("events.kind", min(strange), "is no kind of event")
    return Chunk(
        _from_columns(frames, frame_dtype(axes), n),
        _column(frames, "missed", np.empty(n, np.uint64)),
        _rows(tables["commands"], row_dtype(axes, "command")),
        _rows(tables["records"], row_dtype(axes, "record")),
        events,
    )


def _rows(table: dict[str, NDArray[Any]], kind: np.dtype[Any]) -> NDArray[Any]:
    rows = np.empty(len(table["cycle"]), kind)
    for name in kind.names or () if len(rows) else ():
        if name not in table:
            raise InputError("column", name, "is missing")
        rows[name] = np.ascontiguousarray(table[name]).view(kind[name]).reshape(len(rows))
    return rows


# ---- writing -------------------------------------------------------------------------------------


class Recorder:
    """Records every cycle of a kernel to a file: a running one by name, or one in an own loop.

    The trace keeps some seconds of cycles, so a recorder that begins right after the kernel has its
    first cycle too, and one that is kept waiting loses none; what is lost is counted. The memory it
    takes does not grow. A context manager; the file is whole once it is left.

    >>> from tempfile import TemporaryDirectory
    >>> from sjerk import Axis, Limits
    >>> kernel = MotionKernel([Axis(Limits(90.0, 500.0, 5000.0), 2**24 / 360)])
    >>> with TemporaryDirectory() as folder:
    ...     with Recorder(kernel, f"{folder}/a.parquet") as recorder:
    ...         kernel.step(100)
    ...     recorder.cycles, recorder.missed, len(Recording.open(f"{folder}/a.parquet"))
    (100, 0, 100)
    """

    def __init__(
        self, kernel: MotionKernel | str, path: Path | str, *, period: float = 0.02
    ) -> None:
        """``path`` ends in ``.parquet`` or ``.mcap``; ``period`` in s: how often the trace is read.

        Raises InputError, HandshakeError where no such kernel runs.
        """
        self._period = positive("period", period)
        self._kernel = kernel if isinstance(kernel, MotionKernel) and not kernel.alive else None
        self.cycles = 0
        self.missed = 0
        self._chunks: list[Chunk] = []
        self._waiting = 0
        if self._kernel is not None:
            self._trace = Trace.of(self._kernel._tapped(self._drain))
        else:
            self._trace = Trace.attach(kernel if isinstance(kernel, str) else kernel.name)
        try:
            text = json.dumps(self._trace.description)
            self._file = files.writer(Path(path), text)
        except BaseException:
            self._release()
            raise
        self._end = threading.Event()
        self._fault: BaseException | None = None
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Self:
        """Begin; of a running kernel in a thread."""
        if self._kernel is None:
            self._thread = threading.Thread(target=self._follow, name="sjerk-recorder", daemon=True)
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Take what there is, and end the file. Raises what went wrong meanwhile."""
        self._end.set()
        if self._thread is not None:
            self._thread.join()
        else:
            self._drain()
        try:
            if self._fault is not None:
                raise self._fault
            self._write()
        finally:
            self._file.close()
            self._release()

    @property
    def alive(self) -> bool:
        """Whether there is more to come: the kernel lives."""
        return self._trace.alive

    def _release(self) -> None:
        if self._kernel is not None:
            self._kernel._tap = None
        self._trace.close()

    def _follow(self) -> None:
        try:
            while not self._end.is_set() and self._trace.alive:
                self._drain()
                self._end.wait(self._period)
            self._drain()
        except Exception as fault:
            self._fault = fault

    def _drain(self) -> None:
        before = -1
        while before != self._trace.position:
            before = self._trace.position
            chunk = self._trace.read()
            if chunk is None:
                continue
            self._chunks.append(chunk)
            self.cycles += len(chunk.frames)
            self.missed += int(chunk.missed.sum())
            self._waiting += len(chunk.frames)
            if self._waiting >= _ROWS:
                self._write()

    def _write(self) -> None:
        if self._chunks:
            self._file.write(_tables(Chunk.joined(self._chunks, self._trace.axes)))
        self._chunks, self._waiting = [], 0


# ---- reading -------------------------------------------------------------------------------------


def _chunks(path: Path, file: files.Reader, axes: int) -> Iterator[Chunk]:
    with files.decoding(path):
        for tables in file.tables():
            yield _chunk(tables, axes)


@dataclass(frozen=True)
class Gap:
    """Cycles that are missing between two that are there; ``items`` of the trace lost there."""

    after: int
    before: int
    items: int


class Recording:
    """The cycles of one kernel, as arrays (cycles,) or (cycles, axes); times in seconds.

    >>> recording = Recording.open("nowhere.parquet")
    Traceback (most recent call last):
    sjerk.errors.InputError: file = 'nowhere.parquet': does not exist
    """

    def __init__(
        self,
        description: dict[str, Any],
        chunks: Callable[[], Iterator[Chunk]],
        file: Path | None = None,
    ) -> None:
        """Not for callers: ``open``, ``simulate``. Raises ConfigError, which names the file."""
        self.description = description
        self._source = chunks
        kernel = described(file or "description", description)
        #: What errors call it: its file, or the kernel where there is none.
        self.source = str(file or kernel.name)
        self.name, self.cycle_time = kernel.name, kernel.cycle_time
        self.axes, self.reactions = kernel.axes, kernel.reactions

    @classmethod
    def open(cls, path: Path | str) -> Self:
        """A recording in a file; it is read when asked for.

        Raises InputError, which names the file, here or where damaged bytes are met; OSError.
        """
        path = Path(path)
        with files.decoding(path):
            file = files.reader(path)
            description = json.loads(file.description)
            found = cls(description, lambda: _chunks(path, file, len(found.axes)), path)
        return found

    def __len__(self) -> int:
        return len(self.cycle)

    def chunks(self) -> Iterator[Chunk]:
        """The recording piece by piece, in order, for those that do not fit the memory."""
        return self._source()

    def save(self, path: Path | str) -> None:
        """Write it to a file."""
        file = files.writer(Path(path), json.dumps(self.description))
        try:
            for chunk in self.chunks():
                file.write(_tables(chunk))
        finally:
            file.close()

    def kernel(self) -> MotionKernel:
        """A kernel like the recorded one, in its state before its first cycle."""
        return MotionKernel(self.axes, self.cycle_time, reactions=self.reactions)

    @cached_property
    def all(self) -> Chunk:
        """Everything at once, as the kernel told it (cycle units)."""
        return Chunk.joined(list(self.chunks()), len(self.axes))

    @property
    def cycle(self) -> NDArray[np.uint64]:
        """Number of each cycle, from 1 at the kernel's begin."""
        cycles: NDArray[np.uint64] = self.all.frames["head"]["cycle"]
        return cycles

    @property
    def time(self) -> FloatArray:
        """Time of each cycle in s, 0 at the kernel's begin."""
        return self.cycle.astype(np.float64) * self.cycle_time

    def column(self, name: str) -> NDArray[Any]:
        """A field of ``sj_axis_trace`` (cycles, axes) as it is, in cycle units or increments."""
        values: NDArray[Any] = self.all.frames["axis"][name]
        return values

    @property
    def position(self) -> FloatArray:
        """Commanded position, axis units."""
        return self.column("position")

    @property
    def velocity(self) -> FloatArray:
        """Commanded velocity, per second."""
        return self.column("velocity") / self.cycle_time

    @property
    def acceleration(self) -> FloatArray:
        """Commanded acceleration, per s^2."""
        return self.column("acceleration") / self.cycle_time**2

    @property
    def jerk(self) -> FloatArray:
        """Commanded jerk, per s^3."""
        return self.column("jerk") / self.cycle_time**3

    @property
    def goal(self) -> FloatArray:
        """The planned end of the motion at hand, axis units."""
        return self.column("goal")

    @property
    def actual_position(self) -> FloatArray:
        """Of the encoder, axis units."""
        counts = np.array([axis.counts_per_unit * axis.gear for axis in self.axes])
        position: FloatArray = self.column("actual_counts") / counts
        return position

    def way_points(self, axis: int) -> tuple[NDArray[np.int64], FloatArray]:
        """Way-points of the paths that were played: planned cycle and position, axis units.

        Where a path is run at its own speed, the commanded position of that cycle is the way-point.
        """
        kind = record_dtype(len(self.axes))
        begun = {
            event.goal_id: event.cycle - 1
            for event in reversed(self.events)
            if event.kind is EventKind.PATH and event.code == PathState.RUNS
        }
        cycles: list[int] = []
        positions: list[float] = []
        for record in np.ascontiguousarray(self.records["data"]).view(kind):
            path, entry = int(record["goal_id"]), record["axis"][axis]
            if path not in begun or entry["goal"]["kind"] == lib.SJ_GOAL_NONE:
                continue
            if record["kind"] == lib.SJ_RECORD_SEGMENT:
                begun[path] += int(record["cycles"].sum())
                cycles.append(begun[path])
                positions.append(float(entry["position"]))
        return np.array(cycles, np.int64), np.array(positions)

    @property
    def gaps(self) -> tuple[Gap, ...]:
        """Where cycles, or what they took, were lost."""
        cycle, missed = self.cycle.astype(np.int64), self.all.missed
        found = np.flatnonzero((np.diff(cycle, prepend=cycle[:1] - 1) != 1) | (missed > 0))
        return tuple(
            Gap(int(cycle[i - 1]) if i else 0, int(cycle[i]), int(missed[i])) for i in found
        )

    @property
    def from_the_beginning(self) -> bool:
        """Whether the kernel's first cycle is there."""
        return len(self) > 0 and int(self.cycle[0]) == 1

    @property
    def events(self) -> tuple[Event, ...]:
        """What happened."""
        return tuple(
            Event(
                int(raw["cycle"]),
                EventKind(int(raw["kind"])),
                None if raw["axis"] < 0 else int(raw["axis"]),
                int(raw["code"]),
                float(raw["value"]),
                int(raw["goal_id"]),
            )
            for raw in self.all.events
        )

    @property
    def commands(self) -> NDArray[Any]:
        """What was taken: ``cycle``, and ``data``, the bytes of the ``sj_command``."""
        return self.all.commands

    @property
    def records(self) -> NDArray[Any]:
        """Records of the ring as they were taken: ``cycle``, ``number``, ``data``."""
        return self.all.records
