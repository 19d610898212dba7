"""A goal stream in a kernel: what it hands out is played, the plan to rest behind it.

``StreamPlayer`` takes goals as they come and keeps the kernel's path a little ahead of the motion.
Behind every piece lies the rest of its plan, which ends at rest, replaced by the next piece in
time; so the kernel always knows how to stop, whatever becomes of the host. Never here: planning,
shared memory.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from sjerk.errors import InputError, SjerkError, positive
from sjerk.host import Host, Path, PathState
from sjerk.host.arguments import joint_axes
from sjerk.host.turns import Turns
from sjerk.profile import Limits
from sjerk.trajectory.known import row_of
from sjerk.trajectory.segments import Followed
from sjerk.trajectory.stream_report import StreamReport
from sjerk.trajectory.streaming import SMOOTHING, GoalStream


class StreamPlayer:
    """Goals of some axes at 10 to 500 Hz, played with look-ahead; options are ``GoalStream``'s.

    ``axes``: one per joint, else all, which must be at rest. ``ahead`` (s): how long before it is
    due a piece is planned and sent; it is added to the delay as a margin. With a kernel in a
    process a thread feeds it; in a caller's own loop ``update`` must be called every few cycles.
    Where it is held up the motion follows its plan, which ends at rest; the next piece takes over
    further on along it. Time is the clock's: cycles that the kernel leaves out are a lag, and made
    up. Of axes that wrap the first goal chooses the turn: the one that is nearest.
    """

    def __init__(
        self,
        host: Host,
        *,
        period: float,
        delay: int | None = None,
        ahead: float = 0.05,
        stop_within: bool = False,
        smoothing: float = SMOOTHING,
        exact: bool = False,
        tolerance: ArrayLike | None = None,
        axes: Sequence[int] | None = None,
    ) -> None:
        """Raises InputError, also where an axis is in motion."""
        self._host, self._T = host, host.cycle_time
        self._axes = joint_axes(axes, host.axis_count)
        frame = host.feedback()
        for i in self._axes:
            if frame.axes[i].moving:
                speed = frame.axes[i].velocity
                raise InputError("axes", i, f"must be at rest to begin a stream, not at {speed!r}")
        self._limits: list[Limits] = [frame.axes[i].limits for i in self._axes]
        self._start = np.array([frame.axes[i].position for i in self._axes])
        self._wrap = [frame.axes[i].wrap for i in self._axes]
        self._turns: Turns | None = None  # once a goal has come
        self._stream = GoalStream(
            self._limits,
            self._T,
            self._start,
            period=period,
            delay=delay,
            margin=2.0 * positive("ahead", ahead),
            stop_within=stop_within,
            smoothing=smoothing,
            exact=exact,
            tolerance=tolerance,
        )
        self._ahead = max(2, round(ahead / self._T))
        self._sent: _Sent | None = None  # in play, or about to begin
        self._next: _Sent | None = None  # to take over, until the kernel has answered
        self._trial: GoalStream | None = None  # the stream where it does
        self._begin = 0  # the stream's cycle at which the path begins
        self._clock_begin = frame.cycle + frame.timing.late
        self._told = 0  # cycles by which the stream knows that it is behind the clock
        self._lock = threading.RLock()
        self._over = threading.Event()
        self._error: SjerkError | None = None
        self._thread: threading.Thread | None = None
        if host.clocked:
            self._thread = threading.Thread(target=self._feed, daemon=True)
            self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Feed no more; the motion comes to rest."""
        self._over.set()
        if self._thread is not None:
            self._thread.join()

    # ---- goals

    def push(
        self, position: ArrayLike, time: float | None = None, *, velocity: ArrayLike | None = None
    ) -> None:
        """Take a goal, as ``GoalStream.push`` does; raises that, and what ended the motion."""
        self._check()
        goal = row_of("position", position, len(self._axes))
        with self._lock:
            turns = self._turns or Turns.nearest(goal, self._start, self._wrap)
            goal = turns.onto(goal)
            for stream in self._streams():
                stream.check(goal, time, velocity=velocity)
            for stream in self._streams():
                stream.push(goal, time, velocity=velocity)
            self._turns = turns

    def end(self) -> None:
        """No goal comes any more: the motion ends at rest on the last one."""
        with self._lock:
            for stream in self._streams():
                stream.end()

    def _streams(self) -> list[GoalStream]:
        """As it is, and as it will be if the kernel takes the piece that was sent."""
        return [self._stream] if self._trial is None else [self._stream, self._trial]

    @property
    def report(self) -> StreamReport:
        """What has become of the goals, by what was sent."""
        return self._stream.report

    @property
    def done(self) -> bool:
        """Whether the stream was ended and the command rests on its last goal."""
        self._check()
        with self._lock:
            over = self._sent is None or self._sent.path.state is PathState.DONE
            return self._stream.done and over and self._next is None

    def wait(self, timeout: float | None = None) -> None:
        """Return when ``done``; raises TimeoutError, and what ended the motion."""
        until = None if timeout is None else time.monotonic() + timeout
        while not self.done:
            if until is not None and time.monotonic() > until:
                raise TimeoutError(f"stream: not within {timeout} s")
            time.sleep(1e-3)

    def _check(self) -> None:
        if self._error is not None:
            raise self._error

    # ---- feeding

    def _feed(self) -> None:
        while not self._over.wait(2e-3) and not self._host.closed:
            try:
                self.update()
            except SjerkError as error:
                self._error = error
                return

    def update(self) -> None:
        """Look once: plan and send what is due. Raises what ended the motion."""
        with self._lock:
            frame = self._host.feedback()
            # the kernel's clock: cycles that it left out are time too
            now = frame.cycle + frame.timing.late - self._clock_begin - self._told
            if self._sent is not None:
                behind = now - self._played(self._sent)
                if behind > 0:
                    for stream in self._streams():
                        stream.skipped(behind)
                    self._told += behind
                    now -= behind
                self._sent = self._in_play(self._sent)
            if self._sent is None:
                self._from_rest(now)
            elif self._next is None and (
                self._played(self._sent) + self._ahead >= self._begin + self._sent.firm_end
            ):
                self._go_on(self._sent)

    def _in_play(self, sent: _Sent) -> _Sent | None:
        """What is, by the kernel's answers; None once that has come to its rest.

        Raises what ended the motion.
        """
        if not self._host.clocked:
            sent.path.pump()
            if self._next is not None:
                self._next.path.pump()
        if self._next is not None:
            if self._next.path.state is PathState.SENT:
                return sent
            before = sent.path.state
            if before is PathState.DONE or not before.ended:  # too late: that goes on
                if not self._host.clocked:
                    self._next.path.pump()  # which gives back what it has taken
            else:
                assert self._trial is not None
                sent, self._stream = self._next, self._trial
            self._next = self._trial = None
        if not sent.path.state.ended:
            return sent
        if sent.path.state is not PathState.DONE:
            sent.path.check()
        self._stream.keep(self._begin + sent.ends[-1])
        return None

    def _played(self, sent: _Sent) -> int:
        """The stream's cycle of the present command."""
        for one in (sent, self._next):  # the kernel may have gone over between the two looks
            progress = None if one is None else one.path.progress
            if one is not None and progress is not None and progress.point > 0:
                before = one.ends[progress.point - 2] if progress.point > 1 else 0
                return self._begin + before + round(progress.time / self._T)
        return self._begin

    def _from_rest(self, now: int) -> None:
        stream = self._stream
        stream.rest(now)
        if now <= stream.cycle:
            return
        late = now - stream.cycle  # that a motion, which is to begin, has not begun
        stream.skipped(late)
        self._told += late
        made = stream.take(stream.cycle + 2 * self._ahead)
        first = next((i for i, block in enumerate(made) if block.jerk.any()), None)
        if first is None:
            return
        self._begin = made[first].first_cycle
        pieces, ends, firm = _with_rest(stream, made[first:], [])
        self._sent = _Sent(self._host.follow(pieces, axes=self._axes), ends, firm)

    def _go_on(self, sent: _Sent) -> None:
        """Replace the plan to rest by the next piece and another such plan."""
        if sent.path.progress.known < len(sent.ends):
            return  # the kernel must know how to stop, should it refuse what comes next
        until = self._played(sent) + self._ahead
        sent.firm += self._stream.keep(until - self._ahead // 2)
        if sent.firm == len(sent.ends):  # it comes to rest
            return
        trial = self._stream.copy()
        made = trial.take(max(trial.cycle, until) + 1)
        if not made:
            return
        pieces, ends, firm = _with_rest(trial, made, sent.ends[: sent.firm])
        try:
            path = sent.path.splice(pieces, sent.firm + 1)
        except InputError:  # passed meanwhile: further on then
            return
        self._next, self._trial = _Sent(path, ends, firm), trial


@dataclass
class _Sent:
    """A path; ``ends``: cycles at its way-points, from its first one.

    ``firm``: its way-points before the plan to rest.
    """

    path: Path
    ends: list[int]
    firm: int

    @property
    def firm_end(self) -> int:
        """Cycles before the plan to rest."""
        return self.ends[self.firm - 1]


def _with_rest(
    stream: GoalStream, blocks: list[Followed], before: list[int]
) -> tuple[list[Followed], list[int], int]:
    """Numbered from way-point ``len(before)`` of the path on; the plan to rest behind.

    And the ends of all way-points, and how many come before that plan.
    """
    first, ends, found = len(before), list(before), []
    firm = first + sum(len(block) for block in blocks)
    for block in [*blocks, *stream.remainder()]:
        found.append(replace(block, first=first, first_cycle=ends[-1] if ends else 0))
        for cycles in block.cycles.tolist():
            ends.append((ends[-1] if ends else 0) + int(cycles))
        first += len(block)
    return found, ends, firm
