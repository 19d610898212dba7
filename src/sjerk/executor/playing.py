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
from dataclasses import replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from sjerk.errors import InputError, SjerkError, positive
from sjerk.host import Host, Path, PathState
from sjerk.host.arguments import joint_axes
from sjerk.profile import FloatArray, Limits
from sjerk.trajectory.known import row_of
from sjerk.trajectory.segments import Followed
from sjerk.trajectory.stream_report import StreamReport
from sjerk.trajectory.streaming import SMOOTHING, GoalStream


class StreamPlayer:
    """Goals of some axes at 10 to 500 Hz, played with look-ahead; options are ``GoalStream``'s.

    ``axes``: one per joint, else all, which must be at rest. ``ahead`` (s): how long before it is
    due a piece is planned and sent; it is added to the delay as a margin. With a kernel in a
    process a thread feeds it; in a caller's own loop ``update`` must be called every few cycles.
    Where it is held up the motion follows its plan, which ends at rest, and is planned on from
    where it is then. Time is the clock's: cycles that the kernel leaves out are a lag, and made up.
    Of axes that wrap the first goal chooses the turn: the one that is nearest.
    """

    def __init__(
        self,
        host: Host,
        *,
        period: float,
        delay: int = 4,
        ahead: float = 0.05,
        stop_within: bool = False,
        smoothing: float = SMOOTHING,
        exact: bool = False,
        tolerance: ArrayLike | None = None,
        axes: Sequence[int] | None = None,
    ) -> None:
        """Raises InputError."""
        self._host, self._T = host, host.cycle_time
        self._axes = joint_axes(axes, host.axis_count)
        frame = host.feedback()
        self._limits: list[Limits] = [frame.axes[i].limits for i in self._axes]
        self._start = np.array([frame.axes[i].position for i in self._axes])
        self._turn = np.array([frame.axes[i].wrap for i in self._axes])
        self._shift: FloatArray | None = None  # whole turns, once a goal has come
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
        self._path: Path | None = None
        self._ends: list[int] = []  # stream's cycles at the way-points of the path, from its first
        self._begin = 0  # the stream's cycle at which the path begins
        self._firm = 0  # way-points of the path before the plan to rest
        self._clock_begin = frame.cycle + frame.timing.late
        self._told = 0  # cycles by which the stream knows that it is behind the clock
        self._replaced: Path | None = None
        self._lost = False
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
            shift = self._shift
            if shift is None:
                wraps = self._turn > 0.0
                turns = np.zeros(len(goal))
                np.divide(self._start - goal, self._turn, out=turns, where=wraps)
                shift = np.round(turns) * self._turn
            self._stream.push(goal + shift, time, velocity=velocity)
            self._shift = shift

    def end(self) -> None:
        """No goal comes any more: the motion ends at rest on the last one."""
        with self._lock:
            self._stream.end()

    @property
    def report(self) -> StreamReport:
        """What has become of the goals, by what was sent."""
        return self._stream.report

    @property
    def done(self) -> bool:
        """Whether the stream was ended and the command rests on its last goal."""
        self._check()
        with self._lock:
            over = self._path is None or self._path.state is PathState.DONE
            return self._stream.done and over

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
            if self._path is not None and not self._lost:
                behind = now - self._played()
                if behind > 0:
                    self._stream.skipped(behind)
                    self._told += behind
            refused = self._path is not None and self._path.state is PathState.REFUSED
            if refused and self._replaced is not None and not self._lost:
                self._lose()
            if self._lost:
                if any(frame.axes[i].moving for i in self._axes):
                    return
                self._lost, self._path = False, None
                self._stream.rested([frame.axes[i].position for i in self._axes], now)
                return
            if self._path is not None and not self._host.clocked:
                self._path.pump()
            if self._path is not None and self._path.state.ended:
                if self._path.state is not PathState.DONE:
                    self._path.check()
                self._stream.keep(self._begin + self._ends[-1])
                self._path = None
            if self._path is None:
                self._from_rest(now)
                return
            if self._played() + self._ahead >= self._begin + self._ends[self._firm - 1]:
                self._go_on()

    def _played(self) -> int:
        """The stream's cycle of the present command."""
        # until the kernel has answered, and where it refuses, the path before is played
        paths = (self._path, self._replaced, self._path)
        told = (path.progress for path in paths if path is not None)
        progress = next((one for one in told if one.point > 0), None)
        if progress is None:
            return self._begin
        point = min(progress.point, len(self._ends))
        before = self._ends[point - 2] if point > 1 else 0
        return self._begin + before + round(progress.time / self._T)

    def _from_rest(self, now: int) -> None:
        if now > self._stream.cycle:
            made = self._stream.take(now)
            if not any(self._moves(block) for block in made):
                return
        else:
            return
        first = next(i for i, block in enumerate(made) if self._moves(block))
        blocks = made[first:]
        enough = blocks[0].first_cycle + 2 * self._ahead
        if self._stream.cycle < enough and not self._stream.done:
            blocks += self._stream.take(enough)
        self._begin, self._ends = blocks[0].first_cycle, []
        self._replaced = None
        self._path = self._host.follow(self._with_rest(blocks, 0), axes=self._axes)

    def _go_on(self) -> None:
        """Replace the plan to rest by the next piece and another such plan."""
        assert self._path is not None
        until = self._played() + self._ahead
        self._firm += self._stream.keep(until - self._ahead // 2)
        if self._firm == len(self._ends):  # it comes to rest
            return
        made = self._stream.take(max(self._stream.cycle, until) + 1)
        if not made:
            return
        self._ends = self._ends[: self._firm]
        at = self._firm + 1
        before = self._path
        try:
            self._path = before.splice(self._with_rest(made, self._firm), at)
            self._replaced = before
        except InputError:
            self._replaced = before
            self._lose()

    def _lose(self) -> None:
        """Too late for the next piece: come to rest, then go on from there."""
        assert self._path is not None
        assert self._replaced is not None
        self._path.cancel()
        self._replaced.cancel()
        self._lost = True

    def _moves(self, block: Followed) -> bool:
        return bool(block.jerk.any())

    def _with_rest(self, blocks: list[Followed], first: int) -> list[Followed]:
        """Numbered from way-point ``first`` of the path on; the plan to rest behind."""
        self._firm = first + sum(len(block) for block in blocks)
        found = []
        cycle = self._ends[-1] if self._ends else 0
        for block in [*blocks, *self._stream.remainder()]:
            found.append(replace(block, first=first, first_cycle=cycle))
            for cycles in block.cycles.tolist():
                cycle += int(cycles)
                self._ends.append(cycle)
            first += len(block)
        return found
