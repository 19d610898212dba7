"""The paper's experiment (its Figures 6 and 7) on one axis of the panel's kernel, in a thread.

The recorded path is commanded as one move, or every point at its time: each interrupting the motion
before, as the paper's control node does, or handed to a stream with look-ahead. A stop ends it,
whoever asked for it. Never here: pages, planning.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from enum import Enum

import numpy as np

from sjerk.errors import InputError, SjerkError
from sjerk.executor import StreamPlayer
from sjerk.host import Host, Move
from sjerk.host.move import MoveState
from sjerk.limits import Limits
from sjerk.trajectory import RecordedPath

#: Radians of a unit.
_UNITS = {"rad": 1.0, "deg": float(np.pi / 180.0)}
#: Joint 1 of the Panda under the paper's velocity limit, half of each ramp at jerk; rad.
_PAPER = Limits.from_jerk_factor(velocity=float(np.pi / 2), acceleration=3.75, jerk_factor=0.5)
#: Goal periods that look-ahead is behind, and how long before it is due a piece is sent (s).
_DELAY, _AHEAD = 4, 0.1
_LOOK = 0.002
_ENDED = (MoveState.STOPPED, MoveState.REFUSED)


class Method(Enum):
    """How the points of the path are commanded."""

    ONE_MOVE = "one move to its end"
    INTERRUPTED = "every point interrupts (paper)"
    STOP_WITHIN = "look-ahead that can always stop"
    LOOK_AHEAD = "look-ahead"


def in_unit(recorded: RecordedPath, unit: str) -> RecordedPath:
    """The path, which counts in degrees, for an axis in this unit; raises InputError."""
    if unit not in _UNITS:
        raise InputError("unit", unit, f"must be {' or '.join(_UNITS)}: the path is an angle")
    scale = _UNITS["deg"] / _UNITS[unit]
    return replace(recorded, position=recorded.position * scale)


def paper_limits(unit: str, own: Limits) -> Limits:
    """The paper's limits for an axis in this unit, as far as its own allow."""
    scale = _UNITS["rad"] / _UNITS[unit]
    most = (getattr(_PAPER, name) * scale for name in ("velocity", "acceleration", "jerk"))
    v, a, j = most
    return Limits(min(v, own.velocity), min(a, own.acceleration), min(j, own.jerk))


class Experiment:
    """One run, begun at once. ``recorded`` in axis units; the axis rests at its first point.

    ``stops`` counts the stops that were asked for, ``first`` is how many there were when it was
    ordered: the run ends with the next one. ``over`` gets "" at its end, or the reason.
    """

    def __init__(
        self,
        host: Host,
        axis: int,
        recorded: RecordedPath,
        method: Method,
        *,
        stops: Callable[[], int],
        first: int,
        over: Callable[[str], None],
    ) -> None:
        self._host, self._axis, self._recorded, self._method = host, axis, recorded, method
        self._stops, self._first, self._over = stops, first, over
        own = host.feedback().axes[axis]
        self._limits = paper_limits(own.unit, own.limits)
        #: The cycle before the first one of the run.
        self.begin = host.feedback().cycle
        #: Where its time begins, ns of the monotonic clock.
        self.begun_ns = time.monotonic_ns()
        self._sent: list[Move] = []
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name="experiment", daemon=True)
        self._thread.start()

    @property
    def running(self) -> bool:
        """Whether it is not over."""
        return self._thread.is_alive()

    def close(self) -> None:
        """Command nothing more, and halt the axis."""
        self._end.set()
        self._thread.join()

    def _run(self) -> None:
        try:
            if self._method is Method.ONE_MOVE:
                self._move(len(self._recorded.time) - 1)
                self._settled()
            elif self._method is Method.INTERRUPTED:
                self._each(self._move)
                self._settled()
            else:
                self._looking_ahead()
        except (SjerkError, TimeoutError, OSError) as fault:
            why = str(fault)
        else:
            why = "cancelled" if self._end.is_set() else ""
        if why:  # nothing that was commanded beside a stop goes on
            with suppress(SjerkError, OSError):
                self._host.halt(timeout=0.0, axes=[self._axis])
        self._over(why)

    def _each(self, command: Callable[[int], object]) -> None:
        """Command every point at its time."""
        begun = time.monotonic()
        for k, due in enumerate(self._recorded.time.tolist()):
            while (left := begun + due - time.monotonic()) > 0.0:
                self._check()
                if self._end.wait(min(left, 10.0 * _LOOK)):
                    return
            if k:
                command(k)

    def _move(self, k: int) -> None:
        """Command a point; a stop that came meanwhile wins."""
        self._check()
        goal = float(self._recorded.position[k])
        move = self._host.move({self._axis: goal}, limits={self._axis: self._limits})
        self._sent = [*self._sent[-1:], move]
        self._check()

    def _check(self) -> None:
        """Raise SjerkError after a stop: of this panel, or of another process."""
        ended = [move.state for move in self._sent if move.state in _ENDED]
        if ended:
            self._sent[-1].check()
        if ended or self._stops() != self._first:
            raise SjerkError("a stop has ended it")

    def _settled(self) -> None:
        while self._sent and not self._sent[-1].done and not self._end.wait(_LOOK):
            self._check()

    def _looking_ahead(self) -> None:
        times, positions = self._recorded.time, self._recorded.position
        with StreamPlayer(
            self._host,
            period=float(np.median(np.diff(times))),
            delay=_DELAY,
            ahead=_AHEAD,
            stop_within=self._method is Method.STOP_WITHIN,
            axes=[self._axis],
        ) as player:
            self._each(lambda k: player.push([float(positions[k])], float(times[k])))
            player.end()
            while not player.done and not self._end.wait(_LOOK):
                self._check()
