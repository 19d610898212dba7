"""Whoever commands a kernel: the exchanges of a host with it, without what is commanded.

Publishes commands and records, counts their edges, gives signs of life, and keeps what the kernel
has answered to goals. ``Move`` and ``Path`` are handles on it, ``Host`` gives it its words. Never
here: checks of goals, planning, the layout of the memory.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable, Sequence
from typing import Any, Self
from weakref import WeakSet

from sjerk._binding import ffi, lib
from sjerk.errors import HostTakenError, InputError, RefusedError, SjerkError, positive
from sjerk.handshake import Segment
from sjerk.host.feedback import EventKind, limits_of
from sjerk.host.monitor import Reader, layout
from sjerk.profile import Limits

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
_RESULTS = 4096
_HOST_SHIFT = 40


class Unsent:
    """A goal of which the kernel has nothing yet, and what came for its axes meanwhile.

    Only the host can answer it: ``result`` is that, or None while it may still be sent.
    """

    def __init__(self, axes: Iterable[int]) -> None:
        self.axes = frozenset(axes)
        self.result: int | None = None
        self.goals: set[int] = set()  # direct ones, not known yet to be accepted

    @property
    def free(self) -> bool:
        """Whether it may be sent."""
        return self.result is None and not self.goals


class Commander(Reader):
    """What a host and the handles of its motions have in common: they command."""

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
        self._unsent: WeakSet[Unsent] = WeakSet()
        self._fed: WeakSet[Any] = WeakSet()  # handles with threads that use the memory
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
        for handle in list(self._fed):
            with handle._feeding:  # its thread looks again before it uses the memory
                pass
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

    def _refusal(self, code: int, axis: int, detail: str = "") -> RefusedError:
        return RefusedError(code, "; ".join(filter(None, (REASONS[code], detail))), axis)

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

    def _stopping(self, axes: Iterable[int]) -> None:
        """The command is to stop all that was given for these axes; under the lock."""
        self._command.stop_records = lib.sj_ring_published(self._segment.base)
        for goal in self._unsent:
            if goal.result is None and not goal.axes.isdisjoint(axes):
                goal.result = lib.SJ_RESULT_STOPPED

    def _replacing(self, goal_id: int, axes: Iterable[int]) -> None:
        """The command has a goal that replaces, if it is accepted; under the lock."""
        self._command.goal_records = lib.sj_ring_published(self._segment.base)
        for goal in self._unsent:
            if not goal.axes.isdisjoint(axes):
                goal.goals.add(goal_id)

    def _never_sent(self, goal: Unsent, frame: Any) -> int | None:
        """Why a goal that has not been sent will not be; None: it may still be."""
        with self._lock:
            newer = sorted(goal.goals)
        for goal_id in newer:
            result = self._result(goal_id, frame)
            if result is not None and result[0] == lib.SJ_RESULT_ACCEPTED:
                self._end(goal, lib.SJ_RESULT_SUPERSEDED)
            elif result is not None or frame.result_goal_id > goal_id:  # refused, or never seen
                goal.goals.discard(goal_id)
        return goal.result

    def _end(self, goal: Unsent, result: int) -> bool:
        """Answer a goal that has not been sent; False: it has been."""
        with self._lock:
            if goal not in self._unsent:
                return False
            goal.result = result if goal.result is None else goal.result
            return True

    def _count(self, edge: str, axes: Iterable[int]) -> int:
        """One more edge for each of these axes; the number of the command."""
        with self._lock:
            for i in axes:
                entry = self._command.axis[i]
                setattr(entry, edge, (getattr(entry, edge) + 1) % 2**32)
            if edge != "resets":
                self._stopping(axes)
            self._publish()
            return int(self._command.sequence)

    def _cancel(self, number: int, axes: Iterable[int]) -> None:
        """Records from this number on are not to be begun on these axes."""
        self._cancels_taken()
        with self._lock:
            self._take_back(number, axes)
        self._cancels_taken()

    def _cancels_taken(self) -> None:
        """Wait until the next cancellation does not overwrite the last."""
        self._taken(self._cancelled, 5.0, "the cancellation")

    def _take_back(self, number: int, axes: Iterable[int]) -> None:
        """As ``_cancel``, at once; under the lock."""
        chosen = sum(1 << i for i in axes)
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

    def _taken(self, sequence: int, timeout: float | None, what: str) -> None:
        if self._cyclic:
            self._wait_until(lambda frame: frame.sequence >= sequence, timeout, what)
