"""A recording: the cycles of a kernel as arrays, with what is needed to run it again.

Never here: how a file is laid out, motion.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from sjerk._binding import lib
from sjerk.host import Event, EventKind, PathState
from sjerk.kernel import MotionKernel, described
from sjerk.kernel.trace import Chunk, record_dtype
from sjerk.profile import FloatArray
from sjerk.recording import files
from sjerk.recording.tables import chunk_of, tables_of


def _chunks(path: Path, file: files.TableReader, axes: int) -> Iterator[Chunk]:
    with files.decoding(path):
        for tables in file.tables():
            yield chunk_of(tables, axes)


def _in_present_words(description: Any) -> Any:
    """The description in a file, which may have been written when ``corrupt`` was ``spoilt``."""
    reactions = description.get("reactions") if isinstance(description, dict) else None
    if isinstance(reactions, dict) and "spoilt" in reactions and "corrupt" not in reactions:
        rest = {cause: value for cause, value in reactions.items() if cause != "spoilt"}
        description = description | {"reactions": rest | {"corrupt": reactions["spoilt"]}}
    return description


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
        self._source, self._file = chunks, file
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
            description = _in_present_words(json.loads(file.description))
            found = cls(description, lambda: _chunks(path, file, len(found.axes)), path)
        return found

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickled with its cycles; one in a file by its path, to be opened there."""
        if self._file is not None:
            return type(self).open, (self._file,)
        return type(self), (self.description, partial(iter, tuple(self.chunks())))

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
                file.write(tables_of(chunk))
        finally:
            file.close()

    def kernel(self) -> MotionKernel:
        """A kernel like the recorded one, in its state before its first cycle."""
        return MotionKernel(self.axes, self.cycle_time, reactions=self.reactions)

    @cached_property
    def all(self) -> Chunk:
        """Everything at once, as the kernel traced it (cycle units)."""
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

    def knots(self, axis: int) -> tuple[NDArray[np.int64], FloatArray]:
        """Knots of the paths that were played, as the kernel was given them.

        Returns planned cycle (k,) and position (k,), axis units, at the end of each segment;
        where a path is run at its own speed, it is the commanded position of that cycle.
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
        fields = ("cycle", "kind", "axis", "code", "value", "goal_id")
        names = [axis.name for axis in self.axes]
        rows = ([*(raw[name].item() for name in fields), names] for raw in self.all.events)
        return tuple(Event.of(*row) for row in rows)

    @property
    def commands(self) -> NDArray[Any]:
        """What was taken: ``cycle``, and ``data``, the bytes of the ``sj_command``."""
        return self.all.commands

    @property
    def records(self) -> NDArray[Any]:
        """Records of the ring as they were taken: ``cycle``, ``number``, ``data``."""
        return self.all.records

    @property
    def stops(self) -> NDArray[Any]:
        """Stops that processes beside the host asked for: ``cycle``, ``number``, ``data``."""
        return self.all.stops
