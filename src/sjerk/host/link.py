"""The link of a host with its kernel: commands and records out, frames and answers in.

Counts the edges of commands, gives signs of life, and keeps account of goals that have not been
sent yet. ``Host`` gives it its words, ``Move`` and ``Path`` are handles on it. Never here: checks
of goals, planning, the layout of the memory.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable
from typing import Any, Protocol
from weakref import WeakSet

from sjerk._binding import ffi, lib
from sjerk.errors import SjerkError, positive
from sjerk.handshake import Segment
from sjerk.host.answers import Answers
from sjerk.host.feedback import limits_of, names_of
from sjerk.host.reader import FrameReader
from sjerk.profile import Limits, State

_HOST_SHIFT = 40


class Unsent:
    """A goal of which the kernel has nothing yet, and what came for its axes meanwhile.

    Only the host can answer it: ``result`` is that, or None while it may still be sent.
    """

    def __init__(self, axes: Iterable[int]) -> None:
        """Of these axes."""
        self.axes = frozenset(axes)
        self.result: int | None = None
        self.goals: set[int] = set()  # direct ones, not known yet to be accepted

    @property
    def free(self) -> bool:
        """Whether it may be sent."""
        return self.result is None and not self.goals


class Feeding(Protocol):
    """What uses the memory in a thread of its own: only while it holds its ``lock``."""

    lock: Any


class Link(FrameReader):
    """A kernel that can be commanded: what a host and the handles of its motions have in common.

    ``lock`` guards ``command``, the ``sj_command`` that is published next, and the ring: other
    threads run while C does. ``cycle_time`` in seconds; ``limits``, ``wraps`` and ``names`` by
    axis, as they were when the link began, or as the host has set them since.
    """

    def __init__(self, segment: Segment, *, clocked: bool, after: int = 0) -> None:
        """``after``: the newest goal id of the host before, in a caller's own loop."""
        super().__init__(segment, clocked=clocked)
        self.lock = threading.Lock()
        self.command = ffi.new("sj_command *")
        self.command.override = 1.0
        self.answers = Answers(segment)
        self.cycle_time = 0.0
        self.limits: list[Limits] = []
        self.wraps: list[float] = []
        self.names: tuple[str, ...] = ()
        self.flushed = 0  # number of the last record that was in the ring when it was emptied
        self._ended = [0] * self.axes  # number of the last command that ends what an axis does
        self._cancelled = 0  # number of the command that cancelled last
        self._unsent: WeakSet[Unsent] = WeakSet()
        self._feeding: WeakSet[Feeding] = WeakSet()
        self._goals = after  # the newest goal id given
        self._watched = False
        if clocked:
            self.wait_until(lambda frame: True, 5.0, "the first cycle")
            self.take_over(self.frame())
            epoch = int(lib.sj_shm_host_epoch(segment.base))
            self._goals = (epoch - 1) << _HOST_SHIFT  # above all that hosts before gave

    def take_over(self, frame: Any) -> None:
        """Go on from what the kernel has taken of the host before, by one of its frames."""
        command = self.command
        self.cycle_time = frame.cycle_time_s
        command.sequence, command.goal_id = frame.sequence, frame.result_goal_id
        command.override, command.hold = frame.override, frame.hold
        for i in range(self.axes):
            for name in ("enable", "halts", "quick_stops", "resets", "limit_sets"):
                setattr(command.axis[i], name, getattr(frame.axis[i], name))
        self.limits = [limits_of(frame.axis[i], self.cycle_time) for i in range(self.axes)]
        self.wraps = [float(frame.axis[i].wrap) for i in range(self.axes)]
        self.names = names_of(frame)

    def close(self) -> None:
        """Leave the kernel to itself, once no thread uses its memory."""
        self.closed = True
        for feeding in list(self._feeding):
            with feeding.lock:  # its thread looks again before it uses the memory
                pass
        if self.clocked and not self.segment.closed:
            lib.sj_shm_leave_host(self.segment.base)
            self.segment.close()

    def waits_for(self, feeding: Feeding) -> None:
        """Make ``close`` wait for this user of the memory."""
        self._feeding.add(feeding)

    # ---- signs of life

    def watch(self, timeout: float | None) -> None:
        """As ``Host.watch``."""
        if not self.clocked:
            raise SjerkError("a kernel in a caller's own loop has no time to be silent in")
        ns = 0 if timeout is None else round(positive("timeout", timeout) * 1e9)
        self.check_kernel("being watched")
        lib.sj_shm_watch_host(self.segment.base, ns, lib.sj_clock_now_ns())
        self._watched = ns > 0

    def beat(self) -> None:
        """Give a sign of life, where the host is watched."""
        if self._watched and not self.closed:
            lib.sj_shm_beat_host(self.segment.base, lib.sj_clock_now_ns())

    def read(self) -> Any | None:
        """As of any reader, and a sign of life."""
        self.beat()
        return super().read()

    # ---- commanding

    def _check_open(self) -> None:
        if self.closed:
            raise SjerkError("this host has left its kernel")
        self.check_kernel("commanding")

    def publish(self) -> int:
        """Send the command; its number. Under the lock."""
        self.beat()
        self._check_open()
        self.command.sequence += 1
        self.segment.check(lib.sj_command_publish(self.segment.base, self.command))
        return int(self.command.sequence)

    def next_goal(self) -> int:
        """The id of a new goal, direct or in a record. Under the lock."""
        self._goals = max(self._goals, int(self.command.goal_id)) + 1
        return self._goals

    @property
    def newest_goal(self) -> int:
        """The newest goal id that was given."""
        return self._goals

    @property
    def room(self) -> int:
        """How many records the look-ahead ring takes now."""
        capacity = self.segment.layout.record_capacity
        return int(capacity - lib.sj_ring_waiting(self.segment.base))

    @property
    def taken_records(self) -> int:
        """Number of the last record that the kernel has taken from the ring."""
        return int(lib.sj_ring_taken(self.segment.base))

    def publish_records(self, records: Any, count: int) -> int:
        """Publish ``sj_record``s that lie ``record_bytes`` apart, all or none. Under the lock.

        Returns the ring number of the last one, or 0: no room for all of them now.
        """
        self._check_open()
        base = self.segment.base
        if not self.segment.check(lib.sj_ring_publish(base, records, count)):
            return 0
        return int(lib.sj_ring_published(base))

    def flush(self) -> None:
        """Empty the look-ahead ring."""
        lib.sj_ring_flush(self.segment.base)
        self.flushed = lib.sj_ring_published(self.segment.base)

    def fill(self, entry: Any, kind: int, target: State, limits: Limits) -> None:
        """Write a goal into a ``sj_axis_goal``, in cycle units."""
        entry.kind, entry.goal = kind, target.position
        entry.goal_velocity = target.velocity * self.cycle_time
        self.fill_limits(entry, limits)

    def fill_limits(self, entry: Any, limits: Limits) -> None:
        """Write limits into a struct that has them, in cycle units."""
        rows = limits.per_cycle(self.cycle_time)
        ffi.memmove(ffi.addressof(entry, "limits"), rows, len(rows))

    def count(self, edge: str, axes: Iterable[int]) -> int:
        """One more edge for each of these axes; the number of the command."""
        with self.lock:
            for i in axes:
                entry = self.command.axis[i]
                setattr(entry, edge, (getattr(entry, edge) + 1) % 2**32)
            if edge != "resets":
                self.stopping(axes)
            return self.publish()

    def await_taken(self, sequence: int, timeout: float | None, what: str) -> None:
        """Return when the kernel has the command of this number; at once in an own loop."""
        if self.clocked:
            self.wait_until(lambda frame: frame.sequence >= sequence, timeout, what)

    # ---- cancelling records

    def cancel_from(self, number: int, axes: Iterable[int]) -> None:
        """Records from this number on are not to be begun on these axes."""
        self.cancels_taken()
        with self.lock:
            self.take_back(number, axes)
        self.cancels_taken()

    def cancels_taken(self) -> None:
        """Wait until the next cancellation does not overwrite the last."""
        self.await_taken(self._cancelled, 5.0, "the cancellation")

    def take_back(self, number: int, axes: Iterable[int]) -> None:
        """As ``cancel_from``, at once. Under the lock."""
        chosen = sum(1 << i for i in axes)
        command, frame = self.command, self.read()
        if frame is not None and frame.sequence < self._cancelled:  # the kernel has not seen it
            number = min(number, command.cancel_from)
            chosen |= command.cancel_axes
        command.cancel_from = number
        command.cancel_to = lib.sj_ring_published(self.segment.base)
        command.cancel_axes = chosen
        command.cancels = (command.cancels + 1) % 2**32
        self._cancelled = self.publish()

    # ---- goals that have not been sent

    def announce(self, axes: Iterable[int]) -> tuple[int, Unsent]:
        """The id of a goal whose first record comes later, and what becomes of it until then."""
        with self.lock:
            unsent = Unsent(axes)
            self._unsent.add(unsent)
            return self.next_goal(), unsent

    def sent(self, goal: Unsent) -> None:
        """Its first record is in the ring: from now on the kernel answers. Under the lock."""
        self._unsent.discard(goal)

    def stopping(self, axes: Iterable[int]) -> None:
        """The command is to stop all that was given for these axes. Under the lock."""
        self.command.stop_records = lib.sj_ring_published(self.segment.base)
        self._ends(axes)
        for goal in self._unsent:
            if goal.result is None and not goal.axes.isdisjoint(axes):
                goal.result = lib.SJ_RESULT_STOPPED

    def _ends(self, axes: Iterable[int]) -> None:
        for i in axes:
            self._ended[i] = int(self.command.sequence) + 1

    def ending(self, axes: Iterable[int]) -> bool:
        """Whether the kernel is still to take a stop or a goal for one of these axes."""
        taken = int(self.frame().sequence)
        return any(self._ended[i] > taken for i in axes)

    def replacing(self, goal_id: int, axes: Iterable[int]) -> None:
        """The command has a goal that replaces, if it is accepted. Under the lock."""
        self.command.goal_records = lib.sj_ring_published(self.segment.base)
        self._ends(axes)
        for goal in self._unsent:
            if not goal.axes.isdisjoint(axes):
                goal.goals.add(goal_id)

    def never_sent(self, goal: Unsent, frame: Any) -> int | None:
        """Why a goal that has not been sent will not be; None: it may still be."""
        with self.lock:
            newer = sorted(goal.goals)
        for goal_id in newer:
            result = self.answers.result(goal_id, frame)
            if result is not None and result[0] == lib.SJ_RESULT_ACCEPTED:
                self.answer(goal, lib.SJ_RESULT_SUPERSEDED)
            elif result is not None or frame.result_goal_id > goal_id:  # refused, or never seen
                goal.goals.discard(goal_id)
        return goal.result

    def answer(self, goal: Unsent, result: int) -> bool:
        """Answer a goal that has not been sent; False: it has been."""
        with self.lock:
            if goal not in self._unsent:
                return False
            goal.result = result if goal.result is None else goal.result
            return True
