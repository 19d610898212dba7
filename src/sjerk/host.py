"""The host's side of a kernel: commands in, feedback out, through the dual-port RAM.

Never here: the cycle, the layout of the memory, bit masks of drives.
"""

from __future__ import annotations

import asyncio
import hashlib
import threading
import time
from collections.abc import Callable, Generator, Iterable, Sequence
from dataclasses import replace
from enum import Enum
from functools import cache
from typing import Any, Literal, Self

from sjerk._binding import ffi, lib
from sjerk.errors import (
    HostTakenError,
    InputError,
    KernelGoneError,
    MotionStoppedError,
    QueueFullError,
    RefusedError,
    SegmentLayoutError,
    SjerkError,
    SupersededError,
    positive,
    real,
)
from sjerk.feedback import Event, EventKind, Feedback, limits_of
from sjerk.handshake import Layout, Segment
from sjerk.path import Blocks, Path
from sjerk.planning import Synchronization, check_target, code_of, cycles_of
from sjerk.profile import Limits, State

Target = float | State
Axes = int | Iterable[int] | None
Direction = Literal["direct", "shortest", "positive", "negative"]
Buffer = Literal["aborting", "buffered", "blend low", "blend previous", "blend next", "blend high"]

#: PLCopen's buffer modes by their names here.
BUFFERS: dict[str, int] = {
    "aborting": lib.SJ_BUFFER_ABORTING,
    "buffered": lib.SJ_BUFFER_BUFFERED,
    "blend low": lib.SJ_BUFFER_LOW,
    "blend previous": lib.SJ_BUFFER_PREVIOUS,
    "blend next": lib.SJ_BUFFER_NEXT,
    "blend high": lib.SJ_BUFFER_HIGH,
}

#: Why a goal was refused, by ``enum sj_result``.
REASONS = {
    lib.SJ_RESULT_NOT_FOLLOWING: "the drive does not follow (not enabled, or stopped by itself)",
    lib.SJ_RESULT_PLAN: "a number or a limit cannot be planned with",
    lib.SJ_RESULT_RANGE: "the goal is beyond what the drive can count",
    lib.SJ_RESULT_LIMITS: "its limits are not numbers within those of the axis",
    lib.SJ_RESULT_STOPPED: "a stop came with it, or the kernel is ending",
    lib.SJ_RESULT_STATE: "the axis is stopping, homing, or has an error",
    lib.SJ_RESULT_LIMIT: "it would leave the position limits of the axis",
    lib.SJ_RESULT_SPEED: "faster than the drive follows",
    lib.SJ_RESULT_KIND: "a record that is none, or not in its place",
    lib.SJ_RESULT_START: "the path does not begin where the axes are: move there first",
    lib.SJ_RESULT_SEGMENT: "a segment is none, or does not go on from the one before",
    lib.SJ_RESULT_BEGUN: "what it is to replace has begun, or its path is over",
}
_EVENTS = 1024
_RECORDS = 512
_RESULTS = 4096
_HOST_SHIFT = 40


@cache
def layout(axes: int, *, clocked: bool = True) -> Layout:
    """Layout of the segment of a kernel with so many axes; ``clocked``: in a process of its own."""
    return Layout(
        command_bytes=lib.sj_command_bytes(axes),
        feedback_bytes=lib.sj_feedback_bytes(axes) - (0 if clocked else lib.sj_feedback_times()),
        record_bytes=lib.sj_record_bytes(axes),
        record_capacity=_RECORDS,
        event_bytes=ffi.sizeof("sj_kernel_event"),
        event_capacity=_EVENTS,
        abi=_abi(),
    )


@cache
def _abi() -> int:
    """Hash of the payload structs: names, types and offsets of every field."""

    def describe(ctype: Any) -> str:
        if ctype.kind == "array":
            return f"[{ctype.length}]{describe(ctype.item)}"
        if ctype.kind != "struct":
            return str(ctype.cname)
        return "".join(f"{n}:{f.offset}:{describe(f.type)};" for n, f in ctype.fields)

    payloads = ("sj_command", "sj_feedback", "sj_record", "sj_kernel_event")
    text = "".join(describe(ffi.typeof(name)) for name in payloads)
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little")


def axes_of(segment: Segment) -> int:
    """How many axes the kernel of a segment has; raises SegmentLayoutError for another version."""
    whole, one = lib.sj_command_bytes(1), lib.sj_command_bytes(2) - lib.sj_command_bytes(1)
    axes = (segment.layout.command_bytes - whole) // one + 1
    known = (layout(axes, clocked=clocked) for clocked in (True, False))
    if not 1 <= axes <= lib.SJ_AXES or segment.layout not in known:
        raise SegmentLayoutError(f"{segment.name!r} is of another version", name=segment.name)
    return int(axes)


# ---- commands ------------------------------------------------------------------------------------


class MoveState(Enum):
    """What has become of a move."""

    SENT = "sent"
    QUEUED = "queued"
    MOVING = "moving"
    DONE = "done"
    STOPPED = "stopped"
    SUPERSEDED = "superseded"
    REFUSED = "refused"


def _reached(axis: Any, goal: State, known: bool) -> bool:
    """On the goal; or past it, still with the velocity that was asked for."""
    return bool(axis.settled or (known and not axis.moving and axis.position == goal.position))


_OPEN = (MoveState.SENT, MoveState.QUEUED, MoveState.MOVING)


class Move:
    """Handle of one commanded motion; ``await move`` does what ``wait`` does."""

    def __init__(
        self,
        host: Host,
        goal_id: int,
        targets: dict[int, State],
        *,
        known: bool = True,
        number: int = 0,
    ) -> None:
        """Not for callers: ``Host.move`` makes it.

        ``known``: the targets are positions. ``number``: in the look-ahead ring, of a queued move.
        """
        self._number = number
        self._host = host
        self._goal_id = goal_id
        self._targets = targets
        self._known = known

    @property
    def targets(self) -> dict[int, State]:
        """Goal by axis number; of a relative move the distance, of a jog the velocity."""
        return dict(self._targets)

    @property
    def state(self) -> MoveState:
        """What has become of it, by the newest feedback."""
        return self._state(self._host._frame())

    @property
    def position(self) -> dict[int, float]:
        """Commanded position by axis number, axis units."""
        frame = self._host._frame()
        return {i: float(frame.axis[i].position) for i in self._targets}

    def _state(self, frame: Any) -> MoveState:
        host, queued = self._host, self._number > 0
        if not queued and frame.result_goal_id < self._goal_id:
            return MoveState.SENT
        result = host._result(self._goal_id, frame)
        if result is None:
            if queued:
                return host._waiting(self._number)
            return MoveState.SUPERSEDED  # overwritten before the kernel saw it
        if result[0] != lib.SJ_RESULT_ACCEPTED:
            never = {lib.SJ_RESULT_SUPERSEDED: MoveState.SUPERSEDED}
            if queued:
                never[lib.SJ_RESULT_STOPPED] = MoveState.STOPPED
            return never.get(result[0], MoveState.REFUSED)
        axes = [frame.axis[i] for i in self._targets]
        if host._was_reached(self._goal_id):
            return MoveState.DONE
        if any(axis.goal_id > self._goal_id for axis in axes):
            return MoveState.SUPERSEDED
        if any(axis.goal_id < self._goal_id for axis in axes):
            return MoveState.MOVING  # its answer is newer than the frame
        if all(
            _reached(a, goal, self._known)
            for a, goal in zip(axes, self._targets.values(), strict=True)
        ):
            return MoveState.DONE
        return MoveState.MOVING if any(a.moving for a in axes) else MoveState.STOPPED

    @property
    def done(self) -> bool:
        """Whether the command has settled on the goal, or passed it for a queued move."""
        return self.state is MoveState.DONE

    def accepted(self, timeout: float | None = 5.0) -> None:
        """Return when the kernel has taken it; raises as ``wait`` does."""
        self._host._wait_until(
            lambda frame: self._state(frame) not in (MoveState.SENT, MoveState.QUEUED),
            timeout,
            "an answer",
        )
        self._raise()

    def taken(self, timeout: float | None = 5.0) -> None:
        """Return when the kernel has it, moving or in its queue; raises as ``wait`` does."""
        self._host._wait_until(
            lambda frame: self._state(frame) is not MoveState.SENT, timeout, "an answer"
        )
        self._raise()

    def cancel(self) -> None:
        """Halt the axes of this move, together; nothing if it is over or replaced.

        A queued move and all behind it on its axes are not begun; the one before comes to rest on
        its goal. Where it is already so near that it passes, it comes to rest behind it.
        """
        if self._number and self.state in (MoveState.SENT, MoveState.QUEUED):
            self._host._cancel(self._number, self._targets)
        if self.state is MoveState.MOVING or (not self._number and self.state is MoveState.SENT):
            self._host._count("halts", self._targets)

    def wait(self, timeout: float | None = None) -> None:
        """Return when the command has settled on the goal.

        Raises RefusedError (with the reason), SupersededError (a newer goal), MotionStoppedError
        (stopped on the way), KernelGoneError, TimeoutError.
        """
        self._host._wait_until(
            lambda frame: self._state(frame) not in _OPEN, timeout, f"move to {self._targets}"
        )
        self._raise()

    def __await__(self) -> Generator[Any, None, None]:
        return self._settle().__await__()

    async def _settle(self) -> None:
        while self.state in _OPEN:
            self._host._alive("a move")
            await asyncio.sleep(1e-3)
        self._raise()

    def _raise(self) -> None:
        frame = self._host._frame()
        state = self._state(frame)
        if state is MoveState.REFUSED:
            code, axis = self._host._result(self._goal_id, frame) or (0, -1)
            raise RefusedError(code, REASONS[code], axis)
        if state is MoveState.SUPERSEDED:
            raise SupersededError(self.position)
        if state is MoveState.STOPPED:
            axes = {i: frame.axis[i] for i in self._targets}
            raise MotionStoppedError(
                self.position, {i: int(axis.error_code) for i, axis in axes.items() if axis.fault}
            )


class _Reader:
    """What a monitor and a host have in common: they read."""

    def __init__(self, segment: Segment, *, cyclic: bool = True) -> None:
        """Not for callers: ``Monitor.attach``, or ``MotionKernel.host`` for a host."""
        self._segment = segment
        self._axes = axes_of(segment)
        self._cyclic = cyclic
        self._closed = False
        self._buffer = ffi.new("sj_feedback *")
        times = 0 if cyclic else lib.sj_feedback_times()
        self._into = ffi.cast("char *", self._buffer) + times
        self._sequence = ffi.new("uint64_t *")
        self._event = ffi.new("sj_kernel_event *")
        self._missed = ffi.new("uint64_t *")
        self._shown = ffi.new("uint64_t *", lib.sj_event_latest(segment.base))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the kernel; it does not notice."""
        self._closed = True
        if self._cyclic and not self._segment.closed:
            self._segment.close()

    @property
    def name(self) -> str:
        """Name of the kernel."""
        return self._segment.name

    @property
    def closed(self) -> bool:
        """Whether this host or monitor has left its kernel."""
        return self._closed

    @property
    def kernel_lives(self) -> bool:
        """Whether the process of the kernel is there."""
        return not self._cyclic or self._segment.kernel_lives()

    def _read(self) -> Any | None:
        """The newest frame in the own buffer, or None before the first cycle."""
        if self._closed:
            raise SjerkError("this host has left its kernel")
        while True:
            status = lib.sj_feedback_read(self._segment.base, self._into, self._sequence)
            if status != lib.SJ_SHM_LAPPED:
                break
        return self._buffer if self._segment.check(status) else None

    def _frame(self) -> Any:
        frame = self._read()
        if frame is None:
            raise SjerkError("no cycle has run yet: call MotionKernel.step() first")
        return frame

    def feedback(self) -> Feedback:
        """Return the newest feedback: every axis in the same cycle.

        Raises KernelGoneError where the kernel has ended: its last frame is no feedback.
        """
        self._check_kernel("reading feedback")
        size = lib.sj_feedback_bytes(self._axes)
        copy = ffi.new("sj_feedback *")
        ffi.memmove(copy, self._frame(), size)
        return Feedback(copy, copy.cycle_time_s)

    def events(self) -> tuple[list[Event], int]:
        """Events since the last call, oldest first, and how many were overwritten unread."""
        found, event = [], self._event
        self._missed[0] = 0
        while self._next_event(self._shown):
            found.append(Event.of(event))
        return found, int(self._missed[0])

    def _next_event(self, cursor: Any) -> bool:
        base = self._segment.base
        return bool(lib.sj_event_read(base, cursor, self._event, self._missed) == 1)

    def _check_kernel(self, doing: str) -> None:
        if self._cyclic and not self._closed and not self._segment.kernel_lives():
            raise KernelGoneError(f"the kernel has ended: {doing} makes no sense")

    def _alive(self, what: str) -> None:
        if self._cyclic and not self._segment.kernel_lives():
            raise KernelGoneError(f"the kernel ended while waiting for {what}")

    def _wait_until(self, met: Callable[[Any], bool], timeout: float | None, what: str) -> None:
        if not self._cyclic:
            raise SjerkError(f"cannot wait for {what}: no process runs this kernel, call step()")
        end = None if timeout is None else time.monotonic() + real("timeout", timeout)
        look = 0
        while True:
            frame = self._read()
            if frame is not None and met(frame):
                return
            look += 1
            if look % 50 == 0:
                self._alive(what)
            if end is not None and time.monotonic() > end:
                raise TimeoutError(f"{what}: not within {timeout} s")
            time.sleep(200e-6)


class Monitor(_Reader):
    """Whoever reads a running kernel: no lock, no command, as many as there are."""

    @classmethod
    def attach(cls, name: str) -> Self:
        """Read the running kernel ``name``.

        Raises HandshakeError: no such kernel, another version.
        """
        monitor = cls(Segment.attach(name, role="monitor"))
        monitor._wait_until(lambda frame: True, 5.0, "the first cycle")
        return monitor


class Host(_Reader):
    """The one host of a kernel: context manager, made by ``MotionKernel.host``.

    Leaving it is in order and stops nothing; a host that dies stops the motion.
    """

    def __init__(self, segment: Segment, *, cyclic: bool) -> None:
        """Not for callers. ``cyclic``: a process runs the cycle, so that waiting makes sense."""
        super().__init__(segment, cyclic=cyclic)
        self._command = ffi.new("sj_command *")
        self._command.override = 1.0
        self._cursor = ffi.new("uint64_t *", lib.sj_event_latest(segment.base))
        self._results: dict[int, tuple[int, int]] = {}
        self._arrived: dict[int, int] = {}  # the cycle in which a goal was reached
        self._flushed = 0
        self._cancelled = 0  # number of the command that cancelled last
        self._path_states: dict[int, int] = {}
        self._lock = threading.Lock()  # cffi lets other threads run: two would write as one
        self._T = 0.0
        self._goals = 0  # the newest goal id given
        self._watched = False
        if cyclic:
            self._wait_until(lambda frame: True, 5.0, "the first cycle")
            self._go_on(self._frame())

    def _go_on(self, frame: Any) -> None:
        """From what the kernel has taken, whoever was host before."""
        command = self._command
        self._T = frame.cycle_time_s
        command.sequence, command.goal_id = frame.sequence, frame.result_goal_id
        command.override, command.hold = frame.override, frame.hold
        epoch = int(lib.sj_shm_host_epoch(self._segment.base))
        self._goals = (epoch - 1) << _HOST_SHIFT  # above all that hosts before gave
        for i in range(self._axes):
            for name in ("enable", "halts", "quick_stops", "resets", "limit_sets"):
                setattr(command.axis[i], name, getattr(frame.axis[i], name))
        self._limits = [limits_of(frame.axis[i], self._T) for i in range(self._axes)]
        self._wraps = [float(frame.axis[i].wrap) for i in range(self._axes)]

    @classmethod
    def attach(
        cls,
        name: str,
        limits: Sequence[Limits] | None = None,
        cycle_time: float | None = None,
        *,
        wait: float = 0.0,
    ) -> Self:
        """Become the host of the running kernel ``name`` from another process.

        ``limits`` (one per axis) and ``cycle_time`` (s): what the caller takes for granted; the
        kernel tells both itself. ``wait``: seconds to wait for a host that is about to leave.
        Raises HandshakeError: no such kernel, another number of axes, another version, or a living
        host; InputError: another cycle time.
        """
        expected = None
        if limits is not None:
            if isinstance(limits, Limits) or not all(isinstance(one, Limits) for one in limits):
                raise InputError("limits", limits, "must be a list of one Limits per axis")
            expected = layout(len(limits))
        end = time.monotonic() + wait
        while True:
            try:
                host = cls(Segment.attach(name, expected, role="host"), cyclic=True)
                break
            except HostTakenError:
                if time.monotonic() > end:
                    raise
                time.sleep(1e-3)
        if cycle_time is not None and abs(host._T - cycle_time) > 1e-9 * host._T:
            host.close()
            raise InputError("cycle_time", cycle_time, f"the kernel's is {host._T!r}")
        return host

    def close(self) -> None:
        """Leave the kernel to itself; a motion goes on to its end."""
        self._closed = True
        if self._cyclic and not self._segment.closed:
            lib.sj_shm_leave_host(self._segment.base)
            self._segment.close()

    def _look(self) -> None:
        """Read what the events say of goals."""
        with self._lock:
            while self._next_event(self._cursor):
                event = self._event
                if event.kind == EventKind.GOAL:
                    self._results[event.goal_id] = (event.code, event.axis)
                    self._results.pop(event.goal_id - _RESULTS, None)
                elif event.kind == EventKind.PATH:
                    self._path_states[event.goal_id] = event.code
                    self._path_states.pop(event.goal_id - _RESULTS, None)
                elif event.kind == EventKind.REACHED:
                    self._arrived[event.goal_id] = event.cycle
                    self._arrived.pop(event.goal_id - _RESULTS, None)

    def _result(self, goal_id: int, frame: Any) -> tuple[int, int] | None:
        """Result and axis of a goal that the kernel has passed; None: it never saw it."""
        if frame.result_goal_id == goal_id:
            return frame.result, frame.result_axis
        self._look()
        return self._results.get(goal_id)

    def _was_reached(self, goal_id: int) -> bool:
        self._look()
        return goal_id in self._arrived

    def _waiting(self, number: int) -> MoveState:
        """Of a record without an answer."""
        if number <= self._flushed:
            return MoveState.STOPPED
        taken = lib.sj_ring_taken(self._segment.base) >= number
        return MoveState.QUEUED if taken else MoveState.SENT

    # ---- being watched

    def watch(self, timeout: float | None) -> None:
        """Let the kernel react when this host says nothing for so long (s); None: no longer.

        A command, a reading, a wait, or ``beat`` is a sign of life; ``Reactions.host_silence`` is
        what follows. For a kernel in its process. Raises InputError, SjerkError.
        """
        if not self._cyclic:
            raise SjerkError("a kernel in a caller's own loop has no time to be silent in")
        ns = 0 if timeout is None else round(positive("timeout", timeout) * 1e9)
        self._check_kernel("being watched")
        lib.sj_shm_watch_host(self._segment.base, ns, lib.sj_clock_now_ns())
        self._watched = ns > 0

    def beat(self) -> None:
        """Give a sign of life, where a host that is watched has nothing else to say."""
        if self._watched and not self._closed:
            lib.sj_shm_beat_host(self._segment.base, lib.sj_clock_now_ns())

    def _read(self) -> Any | None:
        self.beat()
        return super()._read()

    # ---- commanding

    def _publish(self) -> None:
        self.beat()
        if self._closed:
            raise SjerkError("this host has left its kernel")
        self._check_kernel("commanding")
        self._command.sequence += 1
        self._segment.check(lib.sj_command_publish(self._segment.base, self._command))

    def _next_goal(self) -> int:
        """The id of a new goal, direct or in a record; under the lock."""
        self._goals = max(self._goals, int(self._command.goal_id)) + 1
        return self._goals

    def _publish_records(self, records: Any, count: int) -> int:
        """Publish ``sj_record``s that lie ``record_bytes`` apart, all or none; under the lock.

        Returns the ring number of the last one, or 0: no room for all of them now.
        """
        if self._closed:
            raise SjerkError("this host has left its kernel")
        self._check_kernel("commanding")
        base = self._segment.base
        if not self._segment.check(lib.sj_ring_publish(base, records, count)):
            return 0
        return int(lib.sj_ring_published(base))

    def _chosen(self, axes: Axes) -> list[int]:
        if axes is None:
            return list(range(self._axes))
        chosen = [axes] if isinstance(axes, int) else list(axes)
        for i in chosen:
            if not isinstance(i, int) or isinstance(i, bool) or not 0 <= i < self._axes:
                raise InputError("axes", i, f"axis numbers are 0 .. {self._axes - 1}")
        return chosen

    def _count(self, edge: str, axes: Iterable[int]) -> int:
        """One more edge for each of these axes; the number of the command."""
        with self._lock:
            for i in axes:
                entry = self._command.axis[i]
                setattr(entry, edge, (getattr(entry, edge) + 1) % 2**32)
            if edge != "resets":
                self._command.stop_records = lib.sj_ring_published(self._segment.base)
            self._publish()
            return int(self._command.sequence)

    def _cancel(self, number: int, axes: Iterable[int]) -> None:
        """Records from this number on are not to be begun on these axes."""
        chosen = sum(1 << i for i in axes)
        self._taken(self._cancelled, 5.0, "the cancellation before")
        with self._lock:
            command, frame = self._command, self._read()
            if frame is not None and frame.sequence < self._cancelled:  # the kernel has not seen it
                number = min(number, command.cancel_from)
                chosen |= command.cancel_axes
            command.cancel_from = number
            command.cancel_to = lib.sj_ring_published(self._segment.base)
            command.cancel_axes = chosen
            command.cancels = (command.cancels + 1) % 2**32
            self._publish()
            self._cancelled = int(command.sequence)
        self._taken(self._cancelled, 5.0, "the cancellation")

    def _taken(self, sequence: int, timeout: float | None, what: str) -> None:
        if self._cyclic:
            self._wait_until(lambda frame: frame.sequence >= sequence, timeout, what)

    def enable(self, timeout: float | None = 5.0, *, axes: Axes = None) -> None:
        """Enable drives; returns when every one follows (at once in a caller's own loop)."""
        chosen = self._enable(axes, 1)
        if self._cyclic:
            self._wait_until(
                lambda frame: all(frame.axis[i].follows for i in chosen),
                timeout,
                "drives to follow",
            )

    def disable(self, timeout: float | None = 5.0, *, axes: Axes = None) -> None:
        """Disable drives, each once it is at rest."""
        chosen = self._enable(axes, 0)
        if self._cyclic:
            self._wait_until(
                lambda frame: not any(frame.axis[i].enabled for i in chosen),
                timeout,
                "drives to rest",
            )

    def _enable(self, axes: Axes, level: int) -> list[int]:
        chosen = self._chosen(axes)
        with self._lock:
            for i in chosen:
                self._command.axis[i].enable = level
            if not level:
                self._command.stop_records = lib.sj_ring_published(self._segment.base)
            self._publish()
        return chosen

    def reset(self, *, axes: Axes = None, timeout: float | None = 5.0) -> None:
        """Reset the faults of drives, and the kernel's own errors, once.

        A look-ahead ring that a wild writer has spoilt is emptied.
        """
        frame = self._read()
        if frame is not None and frame.ring_spoilt:
            lib.sj_ring_flush(self._segment.base)
            self._flushed = lib.sj_ring_published(self._segment.base)
        self._taken(self._count("resets", self._chosen(axes)), timeout, "the reset")

    def halt(self, timeout: float | None = 30.0, *, axes: Axes = None) -> None:
        """Bring axes to rest within the limits of their moves; returns at rest.

        All axes of a move slow down together. A new goal may replace a halt. In a caller's own loop
        it returns at once.
        """
        self._stopped("halts", axes, timeout)

    def stop(self, timeout: float | None = 30.0) -> None:
        """Halt all axes."""
        self.halt(timeout)

    def quick_stop(
        self, timeout: float | None = 30.0, *, axes: Axes = None, together: bool = False
    ) -> None:
        """Bring each axis to rest as soon as its own stop limits allow.

        Goals are refused until then. ``together``: all of them as late as the slowest, where the
        way to a goal and the limits allow.
        """
        with self._lock:
            for i in self._chosen(axes):
                self._command.axis[i].together = bool(together)
        self._stopped("quick_stops", axes, timeout)

    def _stopped(self, edge: str, axes: Axes, timeout: float | None) -> None:
        chosen = self._chosen(axes)
        sequence = self._count(edge, chosen)
        if self._cyclic:
            self._wait_until(
                lambda frame: (
                    frame.sequence >= sequence and not any(frame.axis[i].moving for i in chosen)
                ),
                timeout,
                "the stop",
            )

    def override(self, factor: float, timeout: float | None = 5.0) -> None:
        """Scale the velocities of all motions, 0 .. 2; in motion too, within the axes' limits.

        Goals are planned anew from the commanded state, so acceleration and jerk keep their limits;
        no motion becomes faster than the axis or its goal allows. 0 waits as ``hold`` does.
        """
        if not 0.0 <= real("factor", factor) <= 2.0:
            raise InputError("factor", factor, "must lie in 0 .. 2")
        self._level("override", factor, timeout)

    def hold(self, timeout: float | None = 5.0) -> None:
        """Come to rest on the way to the goals and keep them; ``resume`` goes on.

        One axis, and axes in phase (``synchronization="phase"``), stay on their path.
        """
        self._level("hold", 1, timeout)

    def resume(self, timeout: float | None = 5.0) -> None:
        """Go on to the goals after ``hold``."""
        self._level("hold", 0, timeout)

    def _level(self, name: str, value: float, timeout: float | None) -> None:
        with self._lock:
            setattr(self._command, name, value)
            self._publish()
            sequence = int(self._command.sequence)
        self._taken(sequence, timeout, name)

    def set_limits(self, limits: Limits, *, axes: Axes = None, timeout: float | None = 5.0) -> None:
        """Give axes other limits from their next goal, jog or halt on; a motion keeps its own.

        Position limits stay those of the kernel. Raises RefusedError where the drive is slower.
        """
        chosen = self._chosen(axes)
        with self._lock:
            for i in chosen:
                entry = self._command.axis[i]
                rows = limits._per_cycle(self._T)
                ffi.memmove(ffi.addressof(entry, "limits"), rows, len(rows))
                entry.limit_sets = (entry.limit_sets + 1) % 2**32
            self._publish()
            sequence = int(self._command.sequence)
        self._taken(sequence, timeout, "the limits")
        frame = self._frame() if self._cyclic else None
        for i in chosen:
            asked = self._command.axis[i].limits.velocity
            if frame is not None and frame.axis[i].limits.velocity != asked:
                code = lib.SJ_RESULT_SPEED
                raise RefusedError(code, REASONS[code], i)
            self._limits[i] = replace(limits, position=self._limits[i].position)

    def move(
        self,
        target: Target | Sequence[Target] | dict[int, Target],
        *,
        limits: Limits | None = None,
        synchronization: Synchronization = "time",
        min_duration: float = 0.0,
        relative: bool = False,
        direction: Direction = "direct",
        buffer: Buffer = "aborting",
    ) -> Move:
        """Move to a target: of the one axis, of all axes, or by axis number.

        A target is a position, or a ``State`` with a velocity to arrive with; ``relative``: a
        distance from the commanded position. The kernel plans in its next cycle from the commanded
        state, also during a motion, which the new goal replaces; the same goal under the same
        limits changes nothing. ``limits``: lower ones than the axes' own
        for this move; position limits stay in force.
        ``direction``: of axes that wrap, which way to a position within the turn.

        ``buffer``, as in PLCopen: ``"aborting"`` replaces at once, and clears the queue of its
        axes; ``"buffered"`` begins in the cycle after the one before is done; a blend lets the one
        before pass its goal at the lower of both velocities, at its own (previous), at the new
        one's (next), or at the higher, as far as both ways and limits allow. Relative: from the
        goal before.

        Returns at once; the handle tells the rest. Raises InputError for what is no target, and
        QueueFullError; a refusal by the kernel is raised by ``Move.wait``.
        """
        if buffer not in BUFFERS:
            raise InputError("buffer", buffer, f"must be one of {', '.join(BUFFERS)}")
        if buffer != "aborting" and direction != "direct":
            raise InputError("direction", direction, "a queued move has no place yet to turn from")
        if buffer.startswith("blend") and synchronization == "phase":
            raise InputError("synchronization", "phase", "begins and ends at rest, without a blend")
        targets = self._targets(target)
        code, least = code_of(synchronization), cycles_of(min_duration, self._T)
        own = self._lower(limits, targets)
        if direction != "direct":
            targets = self._turned(targets, direction)
        for i, goal in targets.items():
            for within in (self._limits[i], own[i]):
                free = replace(within, position=None) if relative else within
                check_target(f"target[{i}]", goal, free)
        kind = lib.SJ_GOAL_RELATIVE if relative else lib.SJ_GOAL_ABSOLUTE
        if buffer != "aborting":
            return self._queue(kind, targets, own, code, least, BUFFERS[buffer])
        return self._goal(kind, targets, own, code, least)

    def follow(
        self,
        blocks: Blocks,
        *,
        axes: Sequence[int] | None = None,
    ) -> Path:
        """Play a followed trajectory in the kernel's cycle: what ``follow``, ``follow_path`` give.

        ``blocks`` are consumed as the kernel takes them, by a thread, or by ``Path.pump`` in a
        caller's own loop; a source may yield None where its next block is not there yet. ``axes``:
        one per joint, else all in order. The path begins from rest at its first way-point (``move``
        there before) when the axes are at rest and no other path plays; what comes later for these
        axes waits for its end. Returns at once; the handle tells the rest. Raises InputError, and
        what the source of the blocks raises at first; a refusal by the kernel is raised by
        ``Path.wait``.
        """
        chosen = self._chosen(None if axes is None else list(axes))
        if len(set(chosen)) != len(chosen):
            raise InputError("axes", chosen, "must differ")
        return Path(self, blocks, chosen)

    def _refusal(self, code: int, axis: int) -> RefusedError:
        return RefusedError(code, REASONS[code], axis)

    def jog(
        self,
        velocity: float | dict[int, float],
        *,
        limits: Limits | None = None,
    ) -> Move:
        """Move with a velocity (axis unit / s) until told otherwise.

        At a position limit it comes to rest; then the velocity is what whole cycles leave of it.

        One velocity for the one axis, or by axis number; 0 brings to rest. The handle is never
        ``done``: ``cancel`` it, or give another goal. Raises InputError.
        """
        wanted = velocity if isinstance(velocity, dict) else {0: velocity}
        if not isinstance(velocity, dict) and self._axes != 1:
            raise InputError("velocity", velocity, f"must be by axis number: {self._axes} axes")
        self._chosen(wanted)
        own = self._lower(limits, wanted)
        targets = {i: State(0.0, real(f"velocity[{i}]", v)) for i, v in wanted.items()}
        for i, goal in targets.items():
            check_target(f"velocity[{i}]", goal, replace(own[i], position=None))
        return self._goal(lib.SJ_GOAL_JOG, targets, own, lib.SJ_SYNC_NONE, 0)

    def home(self, *, axes: Axes = None) -> Move:
        """Let drives home by their own method (6098h); the frame shifts without a step.

        The handle is done when the drive has attained its home and follows again.
        """
        chosen = self._chosen(axes)
        targets = {i: State(0.0) for i in chosen}
        own = {i: self._limits[i] for i in chosen}
        return self._goal(lib.SJ_GOAL_HOME, targets, own, lib.SJ_SYNC_NONE, 0)

    def _lower(self, limits: Limits | None, axes: Iterable[int]) -> dict[int, Limits]:
        """The limits of a goal by axis: the axes' own, or lower ones."""
        if limits is None:
            return {i: self._limits[i] for i in axes}
        if not isinstance(limits, Limits):
            raise InputError("limits", limits, "must be a Limits")
        for i in axes:
            for name in ("velocity", "acceleration", "jerk", "deceleration", "deceleration_jerk"):
                value, most = getattr(limits, name), getattr(self._limits[i], name)
                if value > most * (1 + 1e-12):
                    raise InputError(f"limits.{name}", value, f"axis {i} has {most!r}")
        return dict.fromkeys(axes, limits)

    def _goal(
        self, kind: int, targets: dict[int, State], own: dict[int, Limits], code: int, least: int
    ) -> Move:
        with self._lock:
            command = self._command
            command.synchronization, command.least_cycles = code, least
            for i in range(self._axes):
                entry = command.axis[i].goal
                if i in targets:
                    self._fill(entry, kind, targets[i], own[i])
                else:
                    entry.kind = lib.SJ_GOAL_NONE
            command.goal_id = self._next_goal()
            command.goal_records = lib.sj_ring_published(self._segment.base)
            self._publish()
            known = kind == lib.SJ_GOAL_ABSOLUTE
            return Move(self, int(command.goal_id), targets, known=known)

    def _queue(
        self,
        kind: int,
        targets: dict[int, State],
        own: dict[int, Limits],
        code: int,
        least: int,
        mode: int,
    ) -> Move:
        record = ffi.new("sj_record *")
        record.kind, record.mode = lib.SJ_RECORD_MOVE, mode
        record.synchronization, record.least_cycles = code, least
        for i, target in targets.items():
            self._fill(record.axis[i].goal, kind, target, own[i])
        with self._lock:
            record.goal_id = self._next_goal()
            number = self._publish_records(record, 1)
        if not number:
            raise QueueFullError(_RECORDS)
        known = kind == lib.SJ_GOAL_ABSOLUTE
        return Move(self, int(record.goal_id), targets, known=known, number=number)

    def _fill(self, entry: Any, kind: int, target: State, limits: Limits) -> None:
        entry.kind, entry.goal = kind, target.position
        entry.goal_velocity = target.velocity * self._T
        rows = limits._per_cycle(self._T)
        ffi.memmove(ffi.addressof(entry, "limits"), rows, len(rows))

    def _turned(self, targets: dict[int, State], direction: str) -> dict[int, State]:
        """Goals of axes that wrap, by the way that is asked for."""
        if direction not in ("shortest", "positive", "negative"):
            raise InputError(
                "direction", direction, "must be direct, shortest, positive or negative"
            )
        frame, found = self._frame(), {}
        for i, goal in targets.items():
            wrap, at = self._wraps[i], float(frame.axis[i].position)
            if not wrap:
                raise InputError("direction", direction, f"axis {i} does not wrap")
            way = (goal.position - at) % wrap
            if direction == "negative" or (direction == "shortest" and way > wrap / 2):
                way -= wrap if way else 0.0
            found[i] = replace(goal, position=at + way)
        return found

    def _targets(self, target: Target | Sequence[Target] | dict[int, Target]) -> dict[int, State]:
        axes = self._axes
        if isinstance(target, dict):
            wanted: dict[int, Any] = dict(target)
        elif isinstance(target, Sequence) and not isinstance(target, str):
            if len(target) != axes:
                raise InputError("target", target, f"must have one target per axis ({axes})")
            wanted = dict(enumerate(target))
        elif axes == 1:
            wanted = {0: target}
        else:
            raise InputError("target", target, f"must name targets for {axes} axes")
        for i in wanted:
            if not isinstance(i, int) or not 0 <= i < axes:
                raise InputError("target", i, f"axis numbers are 0 .. {axes - 1}")
        if not wanted:
            raise InputError("target", target, "must name at least one axis")
        return {
            i: value if isinstance(value, State) else State(real(f"target[{i}]", value))
            for i, value in wanted.items()
        }
