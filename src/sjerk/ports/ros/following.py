"""Joint states as goals: each interrupts the move, is one of a stream, or is tracked.

What both control nodes do with what came; they bring messages and time. Never here: ROS, clocks.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from sjerk.errors import KernelGoneError, SjerkError
from sjerk.executor import StreamPlayer
from sjerk.host import Host
from sjerk.host.turns import Turns, nearest_turns
from sjerk.ports.ros.joints import Joints
from sjerk.ports.ros.tracking import SHARE, Rest, Tracker, Window
from sjerk.profile import FloatArray

#: So many ages of goals are looked back on.
_AGES = 1000


class Following:
    """Goals in, motion of one host; ``counts`` of goals, and of those refused and unchanged.

    Of axes that wrap the first goal of a motion chooses the turn, in ``interrupt`` the first one
    since another hand has moved.

    ``value``: a parameter of ``parameters.CONTROL`` by name. ``tell``: called with why a goal was
    refused or a motion has ended. A kernel that is gone is raised: KernelGoneError.
    """

    def __init__(
        self, host: Host, joints: Joints, value: Callable[[str], Any], tell: Callable[[str], None]
    ) -> None:
        """Raises InputError."""
        self._host, self._joints, self._value, self._tell = host, joints, value, tell
        self.mode: str = value("mode")
        self.counts: Counter[str] = Counter()
        self._ages: deque[float] = deque(maxlen=_AGES)
        self._last: FloatArray | None = None
        self._before: tuple[float, FloatArray] | None = None
        self._turns: Turns | None = None
        self._player: StreamPlayer | None = None
        self._first, self._came, self._ended = 0.0, 0.0, False
        self._late: list[tuple[FloatArray, FloatArray | None, float]] = []
        self._tracker = Tracker(
            horizon=value("track.horizon"),
            timeout=value("track.timeout"),
            most=[SHARE * axis.limits.velocity for axis in host.feedback().axes],
            rest_on_last=True,
        )

    def take(
        self,
        names: Sequence[str],
        position: Sequence[float],
        velocity: Sequence[float],
        *,
        sent: float,
        now: float,
    ) -> None:
        """One goal, of joints in any order, sent at ``sent`` (s); ``velocity`` may be empty."""
        self.counts["goals"] += 1
        self._ages.append(now - sent)
        try:
            goal = self._joints.row(names, position, "position")
            own = self._joints.row(names, velocity, "velocity") if len(velocity) else None
            if self.mode == "interrupt":
                self._interrupt(goal)
            elif self.mode == "stream":
                self._stream(goal, own, sent, now)
            else:
                self._track(goal, own, sent, now)
        except KernelGoneError:
            raise
        except SjerkError as error:
            self.counts["refused"] += 1
            self._tell(f"goal refused: {error}")

    def _interrupt(self, goal: FloatArray) -> None:
        """The paper: each new goal replaces the move under way."""
        if self._last is not None and (goal == self._last).all():
            self.counts["unchanged"] += 1
            return
        turns = self._turns
        if self._last is None or turns is None:
            turns = nearest_turns(goal, self._host.feedback().axes)
        self._host.move(turns.onto(goal).tolist())
        self._last, self._turns = goal, turns

    def _stream(
        self, goal: FloatArray, velocity: FloatArray | None, sent: float, now: float
    ) -> None:
        """One of a stream, at its time."""
        self._came = now
        if self._player is not None and self._ended:  # they begin the next stream
            self._late.append((goal, velocity, sent))
            return
        if self._player is None:
            axes = self._host.feedback().axes
            place = nearest_turns(goal, axes).onto(goal)
            if all(q == axis.position for q, axis in zip(place, axes, strict=True)):
                self.counts["unchanged"] += 1
                return
            self._player = StreamPlayer(
                self._host,
                period=self._value("stream.period"),
                delay=self._value("stream.delay"),
                ahead=self._value("stream.ahead"),
            )
            self._first = sent
        by_stamp = sent - self._first if self._value("use_stamps") else None
        self._player.push(goal, by_stamp, velocity=velocity)

    def _track(
        self, goal: FloatArray, velocity: FloatArray | None, sent: float, now: float
    ) -> None:
        """The newest goal, with its velocity or one by its difference to the goal before."""
        before, self._before = self._before, (sent, goal)
        if velocity is None:
            apart = sent - before[0] if before else 0.0
            usable = before is not None and 0.0 < apart <= self._value("track.timeout")
            velocity = (goal - before[1]) / apart if before and usable else np.zeros(len(goal))
        if not self._tracker.active or self._turns is None:
            self._turns = nearest_turns(goal, self._host.feedback().axes)
        self._tracker.take(Window.of([sent], [self._turns.onto(goal)], [velocity]), now)

    def turn(self, now: float) -> None:
        """What is due without a goal: to be called at 100 Hz or so."""
        if self._tracker.active:
            self._aim(now)
        if self._player is not None:
            self._end_stream(self._player, now)

    def _aim(self, now: float) -> None:
        """What is tracked; where it cannot be followed the motion comes to rest."""
        try:
            aim = self._tracker.aim(now)
            if aim is Rest.HALT:
                self._host.halt(0.0)
            elif aim is not None:
                self._host.move(aim, synchronization="none", min_duration=self._tracker.horizon)
        except KernelGoneError:
            raise
        except SjerkError as error:
            self._tell(f"tracking: {error}")
            self._tracker.drop()
            self._host.halt(0.0)

    def _end_stream(self, player: StreamPlayer, now: float) -> None:
        """A stream whose goals have stopped to come ends at rest on the last of them."""
        try:
            if not self._host.clocked:
                player.update()  # with a kernel in a caller's own loop nothing else feeds it
            if now - self._came > 3.0 * self._value("stream.period"):
                player.end()
                self._ended = True
            if player.done:
                player.close()
                self._player, self._ended = None, False
                late, self._late = self._late, []
                for goal, velocity, sent in late:
                    self._stream(goal, velocity, sent, now)
        except KernelGoneError:
            raise
        except SjerkError as error:
            self._tell(f"stream: {error}")
            self.drop()

    def drop(self) -> None:
        """Follow no goal that came before: another hand moves."""
        self._tracker.drop()
        if self._player is not None:
            self._player.close()
        self._player = self._last = self._before = self._turns = None
        self._ended = False
        self._late.clear()

    def report(self) -> dict[str, object]:
        """Counts, and ages of the last thousand goals when they were read, for diagnostics."""
        ages = np.array(self._ages or [0.0])
        told: dict[str, object] = {
            "goals": self.counts["goals"],
            "refused": self.counts["refused"],
            "unchanged": self.counts["unchanged"],
            "age_p50_ms": round(1e3 * float(np.median(ages)), 3),
            "age_p99_ms": round(1e3 * float(np.percentile(ages, 99)), 3),
            "age_max_ms": round(1e3 * float(ages.max()), 3),
        }
        if self._player is not None:
            told["stream_lag"] = round(self._player.report.lag, 4)
            told["stream_starved"] = self._player.report.starved
        return told
