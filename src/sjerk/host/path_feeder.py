"""Feeding a path: its records into the look-ahead ring, as the kernel takes them.

In a thread where a process runs the cycle, by ``pump`` in a caller's own loop. A path that takes
over from another one takes back what of that has not been played, and gives it back where the
kernel refuses. Never here: what a record holds, what has become of the path.
"""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sjerk._binding import ffi, lib
from sjerk.host.feedback import PathState
from sjerk.host.link import Link
from sjerk.host.path_goal import PathGoal
from sjerk.host.path_records import Blocks, PathRecords


class PathFeeder:
    """Sends the segments of one path.

    ``fed``: the last way-point that was sent; ``complete``: whether that is the path's end.
    ``error``: what the source of the blocks raised. ``lock`` guards all of it; the memory of the
    kernel is used only under it.
    """

    def __init__(
        self,
        link: Link,
        goal: PathGoal,
        blocks: Blocks,
        *,
        before: PathFeeder | None = None,
        at: int = 0,
        after: int = 0,
    ) -> None:
        """Begin; ``before``: of the path to take over from, ``at``, ``after`` as in ``splice``.

        Raises InputError, and what the source of the blocks raises.
        """
        self._link, self._goal = link, goal
        self._before = before  # until the kernel has answered
        self.fed, self.complete = 0, False
        self.error: BaseException | None = None
        self.lock = threading.RLock()
        self._sent: list[tuple[int, NDArray[Any]]] = []  # ring number of the last record, batch
        self._yields = False  # another path is to take over, and the kernel has not said yet
        self._frame = ffi.new("sj_feedback *")
        self._number = ffi.new("uint64_t *")
        self._thread: threading.Thread | None = None
        self._capacity = link.segment.layout.record_capacity
        self.records = PathRecords(
            blocks,
            goal.axes,
            goal_id=goal.goal_id,
            of=link.axes,
            cycle_time=link.cycle_time,
            at=at,
            after=after,
        )
        self._waiting = self._next()  # at once, so that what is wrong is raised here
        if before is not None and goal.before is not None:
            before.give_way(at + (after > 0))
            goal.speed, goal.paused = goal.before.speed, goal.before.paused
            self._send()
        if link.clocked:
            self._begin()
        else:
            self.pump()

    def _next(self) -> NDArray[Any]:
        """What is to be sent next; nothing where it is not there yet."""
        parts = [next(self.records)]
        if self._before is not None and not self._goal.first_record and len(parts[0]):
            # nothing may be missing once the kernel has taken over: all that is there goes at once
            parts.append(next(self.records))
            count = 1 + len(parts[-1])
            while self.records.at_hand and count < self._capacity and len(parts[-1]):
                if parts[-1]["last"][-1]:
                    break
                parts.append(next(self.records))
                count += len(parts[-1])
        return self.records.joined(parts) if len(parts) > 1 else parts[0]

    # ---- sending

    def pump(self) -> bool:
        """As ``Path.pump``."""
        while True:
            with self.lock:
                sent = self._push()
            if sent is not None:
                return sent
            try:
                rows = self._next()
            except BaseException as error:
                self._fail(error)
                raise
            with self.lock:
                waiting = self._waiting
                self._waiting = self.records.joined([waiting, rows]) if len(waiting) else rows
            if not len(rows):
                return False

    def _push(self) -> bool | None:
        """Send what waits; whether all has been sent, None: the next of it is needed."""
        if self.error is not None or (self._link.clocked and self._link.closed):
            return True
        if self._is_refused() or (not self._goal.first_record and self._goal.ended):
            return True
        while len(self._waiting) and not self.complete:
            if not self._send():
                return False
        return self._before is None if self.complete else None

    def _is_refused(self) -> bool:
        """Whether the kernel has refused to take over; then the path before goes on."""
        before = self._before
        if before is None:
            return False
        state = self._goal.state(self._link.frame())
        if state is PathState.SENT:
            return False
        self._before = self._goal.before = None
        if state is not PathState.REFUSED:
            return False
        self.complete = True
        before.go_on()
        return True

    def _send(self) -> bool:
        """Some of what waits; False: there is no room, or another path is to take over."""
        goal, link = self._goal, self._link
        with self.lock:
            count = min(link.room, len(self._waiting))
            begins = self._before is not None and not goal.first_record
            if begins and count < min(self._capacity, len(self._waiting)):
                return False  # or the kernel takes over with less
            if count <= 0 or self._yields or (not goal.first_record and goal.ended):
                return False
            part = np.ascontiguousarray(self._waiting[:count])
            with link.lock:
                if not goal.may_begin:
                    return False
                number = link.publish_records(ffi.from_buffer(part), count)
                if not number:
                    return False
                goal.begun(number - count + 1)
            self._waiting = self._waiting[count:]
            if part["kind"][-1] == lib.SJ_RECORD_SEGMENT:
                self.fed = int(part["number"][-1])
                done = link.taken_records - lib.SJ_LOOKAHEAD
                self._sent = [sent for sent in self._sent if sent[0] > done] + [(number, part)]
            self.complete = bool(part["last"][-1])
        return True

    # ---- in a thread

    def _begin(self) -> None:
        self._thread = threading.Thread(target=self._feed, daemon=True)
        self._link.waits_for(self)
        self._thread.start()

    def _feed(self) -> None:
        """The thread: until all is sent, or the path has ended."""
        try:
            while not self._goal.closed.is_set() and not self.pump() and not self._is_over():
                self._goal.closed.wait(1e-3)
            with self.lock:  # another one may have seen the refusal first, and closed the goal
                if not self._link.closed:
                    self._is_refused()
        except BaseException as error:
            if self.error is None:
                self._fail(error)

    def _fail(self, error: BaseException) -> None:
        """No more will come: the handle is to raise this."""
        with self.lock:
            self.error = error
            if not self._link.closed:
                self._goal.cancel()

    def _is_over(self) -> bool:
        """Whether the thread is not needed any more; the kernel may have ended."""
        with self.lock:
            if self._link.closed:
                return True
            base = self._link.segment.base
            if lib.sj_feedback_read(base, self._frame, self._number) != 1:
                return False
            reported = self._frame.path
            ended = reported.goal_id == self._goal.goal_id and PathState(reported.state).ended
            return bool(reported.goal_id > self._goal.goal_id or ended)

    # ---- another path takes over

    @property
    def yields(self) -> bool:
        """Whether another path is to take over, and the kernel has not answered yet."""
        return self._yields

    def give_way(self, first: int) -> None:
        """Take back what the kernel has not taken of way-points from ``first``; wait with more."""
        with self.lock:
            self._yields = True
            for number, part in self._sent:
                points = part["number"]
                if points[-1] >= first:
                    left = int((points >= first).sum())
                    with self._link.lock:
                        self._link.take_back(number - left + 1, self._goal.axes)
                    return

    def go_on(self) -> None:
        """No other path has taken over: send again what was taken back, and go on."""
        reported = self._link.frame().path
        known = int(reported.known) if reported.goal_id == self._goal.goal_id else 0
        with self.lock:
            again = [
                part[(part["kind"] == lib.SJ_RECORD_SEGMENT) & (part["number"] > known)]
                for _, part in self._sent
            ]
            self._waiting = self.records.joined([*again, self._waiting])
            self._sent, self._yields = [], False
            was, self.complete = self.complete, self.complete and not len(self._waiting)
        if self._thread is not None and was and not self.complete:
            self._thread.join()  # its work was done
            self._begin()
