"""One path as a goal of the kernel: the orders to it, and what has become of it.

Its feeder and its handle share it. Never here: segments, threads, waiting.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Any

from sjerk._binding import lib
from sjerk.host.feedback import PathState
from sjerk.host.link import Link


class PathGoal:
    """A path of some axes; ``before``: the one it is to take over from, until the kernel answers.

    ``first_record``: number of its first record in the ring, 0 while none has been sent.
    ``closed`` is set once no more segments of it are wanted.
    """

    def __init__(self, link: Link, axes: Sequence[int], *, before: PathGoal | None = None) -> None:
        """``axes``: one per joint."""
        self._link = link
        self.axes = list(axes)
        self.goal_id, self._unsent = link.announce(self.axes)
        self.before = before
        self.first_record = 0
        self.closed = threading.Event()
        self.speed, self.paused = 1.0, False
        #: Orders go to the first path of those that took over from each other.
        self.root: int = self.goal_id if before is None else before.root
        self._ended: PathState | None = None

    # ---- what has become of it

    def state(self, frame: Any) -> PathState:
        """By a frame; a state that has ended stays."""
        if self._ended is None:
            state = self._state_now(frame)
            if not state.ended:
                return state
            self._ended = state
            self.closed.set()
        return self._ended

    @property
    def ended(self) -> bool:
        """Whether it has, by the newest frame."""
        return self.state(self._link.frame()).ended

    def _state_now(self, frame: Any) -> PathState:
        reported = frame.path
        if not self.first_record:
            return self._unsent_state(frame)
        if reported.goal_id == self.goal_id:
            state = PathState(reported.state)
            refused = reported.result != lib.SJ_RESULT_ACCEPTED
            return PathState.REFUSED if refused and state.ended else state
        result = self._link.answers.result(self.goal_id, frame)
        if result is not None and result[0] == lib.SJ_RESULT_SUPERSEDED:
            return PathState.SUPERSEDED
        if result is not None and result[0] == lib.SJ_RESULT_STOPPED:
            return PathState.STOPPED
        if result is not None and result[0] != lib.SJ_RESULT_ACCEPTED:
            return PathState.REFUSED
        if reported.goal_id > self.goal_id:
            last = self._link.answers.path_state(self.goal_id)
            return last if last.ended else PathState.SUPERSEDED
        return PathState.SENT

    def _unsent_state(self, frame: Any) -> PathState:
        """Answered by what came for its axes, or by what has become of the path before."""
        link, before = self._link, self.before
        result = link.never_sent(self._unsent, frame)
        if result is None and before is not None and before.state(frame).ended:
            link.answer(self._unsent, lib.SJ_RESULT_STOPPED)
            result = self._unsent.result
        if result is None:
            return PathState.SENT
        stopped = result == lib.SJ_RESULT_STOPPED
        return PathState.STOPPED if stopped else PathState.SUPERSEDED

    # ---- what is sent of it

    @property
    def may_begin(self) -> bool:
        """Whether its first record may be sent, or has been. Under the link's lock."""
        return self.first_record > 0 or self._unsent.free

    def begun(self, first_record: int) -> None:
        """Its first record is in the ring: now the kernel answers. Under the link's lock."""
        self.first_record = self.first_record or first_record
        self._link.sent(self._unsent)

    # ---- orders

    def order(self, *, cancel: int = 0) -> None:
        """Send speed and pause, and whether the rest of the path is to be dropped."""
        with self._link.lock:
            order = self._link.command.path
            order.goal_id, order.speed = self.root, self.speed
            order.pause, order.cancel = self.paused, cancel
            self._link.publish()

    def cancel(self) -> None:
        """Come to rest on the path and drop the rest of it; nothing if it has ended."""
        self.closed.set()
        if self.ended:
            return
        alone = self.before is None
        if self._link.answer(self._unsent, lib.SJ_RESULT_SUPERSEDED):
            if not alone:
                self.order(cancel=1)
            return
        self._link.cancels_taken()
        with self._link.lock:
            self._link.take_back(self.first_record, self.axes)
        if alone and not self._is_open():
            self._link.cancels_taken()  # or it has been opened meanwhile
            if not self._is_open():
                return  # and an order to it would end those of the path in play
        self.order(cancel=1)

    def _is_open(self) -> bool:
        """Whether the kernel has opened it, begun or not."""
        return bool(self._link.frame().path.goal_id == self.goal_id)
