"""Virtual time: the cycle of the kernel without a clock, by a script or from a recording.

The same C as in a process, deterministic, as fast as the processor. Never here: motion, files.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from sjerk._binding import ffi, lib
from sjerk.errors import InputError
from sjerk.host import Host
from sjerk.kernel import MotionKernel
from sjerk.kernel.trace import Chunk, Trace, frame_dtype
from sjerk.recording.recording import Recording

Action = Callable[[Host], object]
_BATCH = 512  # cycles in one call of C: their items must fit the trace


# ---- by a script ---------------------------------------------------------------------------------


def simulate(
    kernel: MotionKernel,
    script: Iterable[tuple[int, Action]] | Callable[[int, Host], object],
    cycles: int,
) -> Recording:
    """Run a kernel that has not run yet for so many cycles; what it did, as a recording.

    ``script``: pairs of a cycle (1 is the first) and what a host does before it, in order; or a
    callable that is called before every cycle with its number. Drives are simulated or ``"ideal"``;
    external ones stay where they are. Raises InputError.

    >>> from sjerk import Axis, Limits
    >>> axis = Axis(Limits(90.0, 500.0, 5000.0), 2**24 / 360, "ideal")
    >>> script = [(1, lambda host: host.enable()), (10, lambda host: host.move(1.0))]
    >>> simulate(MotionKernel([axis]), script, 400).position[-1]
    array([1.])
    """
    if isinstance(cycles, bool) or not isinstance(cycles, int) or not 0 < cycles < 2**40:
        raise InputError("cycles", cycles, "must be an int of at least 1")
    trace = Trace.of(kernel.trace_to(None))
    raw = kernel.core
    if raw.feedback.cycle != 0:
        raise InputError("kernel", kernel.name, "has run already: make a new one")
    axes, period = len(kernel.axes), round(kernel.cycle_time * 1e9)
    frames = np.zeros(cycles, frame_dtype(axes))
    memory = ffi.from_buffer("char[]", frames)
    stride = frames.dtype.itemsize
    chunks: list[Chunk] = []
    with kernel.host() as host:
        at = 0
        for begin, action in _ordered(script, cycles):
            at = _run(raw, trace, chunks, memory, stride, at, begin - 1, period)
            action(host)
        _run(raw, trace, chunks, memory, stride, at, cycles, period)
    whole = Chunk.joined(chunks, axes)
    found = replace(whole, frames=frames, missed=np.zeros(cycles, np.uint64))
    return Recording(trace.description, lambda: iter((found,)))


def _ordered(script: Any, cycles: int) -> Iterable[tuple[int, Action]]:
    if callable(script):
        for cycle in range(1, cycles + 1):
            yield cycle, partial(script, cycle)
        return
    last = 0
    for i, (cycle, action) in enumerate(script):
        if not isinstance(cycle, int) or not max(last, 1) <= cycle <= cycles:
            raise InputError(
                f"script[{i}]", cycle, f"must be a cycle {max(last, 1)} .. {cycles}, in order"
            )
        if not callable(action):
            raise InputError(f"script[{i}]", action, "must be callable with a host")
        yield cycle, action
        last = cycle


def _run(
    raw: Any,
    trace: Trace,
    chunks: list[Chunk],
    memory: Any,
    stride: int,
    at: int,
    end: int,
    period: int,
) -> int:
    while at < end:
        n = min(_BATCH, end - at)
        lib.sj_virtual_run(raw, n, at * period, period, memory + at * stride)
        at += n
        chunks += trace.messages()
    return at


# ---- from a recording ----------------------------------------------------------------------------


@dataclass(frozen=True)
class Difference:
    """The first difference of a replay: ``field`` of ``axis`` (None: of the cycle)."""

    cycle: int
    axis: int | None
    field: str
    recorded: object
    replayed: object

    def __str__(self) -> str:
        where = "" if self.axis is None else f"axis {self.axis} "
        return (
            f"cycle {self.cycle}: {where}{self.field} = {self.recorded!r} as recorded, "
            f"{self.replayed!r} now"
        )


@dataclass(frozen=True)
class Replay:
    """What became of a replay: ``cycles`` that came out bit for bit; ``seconds`` it took."""

    cycles: int
    difference: Difference | None
    seconds: float
    cycle_time: float

    @property
    def identical(self) -> bool:
        """Whether every cycle came out as recorded."""
        return self.difference is None

    @property
    def speed(self) -> float:
        """How many times faster than the recorded kernel."""
        return self.cycles * self.cycle_time / self.seconds


def replay(recording: Recording | Path | str) -> Replay:
    """Run a recording again: the same configuration, and in each cycle what it took from outside.

    Every frame is compared with the recorded one, bit for bit: set-points, commanded and actual
    positions, states, statuswords. Raises InputError for a recording that does not begin with the
    kernel's first cycle, or that has gaps.

    >>> from sjerk import Axis, Limits
    >>> kernel = MotionKernel([Axis(Limits(90.0, 500.0, 5000.0), 2**24 / 360)])
    >>> script = [(1, lambda host: host.enable()), (10, lambda host: host.move(1.0))]
    >>> replay(simulate(kernel, script, 400)).identical
    True
    """
    recording = recording if isinstance(recording, Recording) else Recording.open(recording)
    kernel = recording.kernel()
    raw, expected, seconds = kernel.core, 1, 0.0
    for chunk in recording.chunks():
        cycle = chunk.frames["head"]["cycle"].astype(np.int64)
        _check(recording, chunk, cycle, expected)
        rows = [np.ascontiguousarray(r) for r in (chunk.commands, chunk.records, chunk.stops)]
        inputs = [x for r in rows for x in (len(r), ffi.from_buffer(r))]
        frames = np.ascontiguousarray(chunk.frames)
        begun = time.perf_counter()
        same = lib.sj_virtual_replay(raw, len(frames), ffi.from_buffer(frames), *inputs)
        seconds += time.perf_counter() - begun
        if same < len(frames):
            size = frames.dtype.itemsize
            own = np.frombuffer(ffi.buffer(ffi.addressof(raw, "item"), size), frames.dtype)
            difference = _difference(frames[same], own[0])
            return Replay(expected - 1 + same, difference, seconds, recording.cycle_time)
        expected += len(frames)
    if expected == 1:
        raise InputError("recording", recording.source, "has no cycle")
    return Replay(expected - 1, None, seconds, recording.cycle_time)


def _check(recording: Recording, chunk: Chunk, cycle: Any, expected: int) -> None:
    if expected == 1 and len(cycle) and cycle[0] != 1:
        raise InputError(
            "recording",
            recording.source,
            f"begins with cycle {cycle[0]}: only from the kernel's first cycle on is its state "
            "known",
        )
    holes = np.flatnonzero((np.diff(cycle, prepend=expected - 1) != 1) | (chunk.missed > 0))
    if len(holes):
        i = int(holes[0])
        raise InputError(
            "recording",
            recording.source,
            f"has a gap before cycle {cycle[i]} ({chunk.missed[i]} items lost): what the kernel "
            "took there is not known",
        )
    taken = cycle[chunk.frames["collected"] == 1]
    if not np.array_equal(taken, chunk.commands["cycle"].astype(np.int64)):
        raise InputError("recording", recording.source, "has cycles whose command is missing")


def _difference(recorded: Any, replayed: Any) -> Difference:
    """The first field whose bytes differ."""
    cycle = int(recorded["head"]["cycle"])

    def walk(x: Any, y: Any, name: str, axis: int | None) -> Difference | None:
        if x.tobytes() == y.tobytes():
            return None
        for part in x.dtype.names or ():
            if part == "axis":
                for i in range(len(x[part])):
                    found = walk(x[part][i], y[part][i], "", i)
                    if found:
                        return found
                continue
            found = walk(x[part], y[part], f"{name}.{part}" if name else part, axis)
            if found:
                return found
        return Difference(cycle, axis, name, x.item(), y.item())

    found = walk(recorded, replayed, "", None)
    assert found is not None
    return found
