"""Trajectories by topic as a stream or as windows to be tracked.

Never here: goals of actions, ROS.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from sjerk.executor import StreamPlayer
from sjerk.executor.goal import from_message
from sjerk.host import Host
from sjerk.host.turns import Turns, nearest_turns
from sjerk.ports.ros.joints import Joints
from sjerk.ports.ros.tracking import SHARE, Rest, Tracker, Window


class TopicMotion:
    """What messages of trajectories move, where they are no goals of their own.

    Of axes that wrap the first point of a stream, or of what is tracked, chooses the turn.
    """

    def __init__(self, host: Host, joints: Joints, value: Callable[[str], Any]) -> None:
        """``value``: a parameter of ``parameters.CONTROLLER`` by name."""
        self._host, self._joints, self._value = host, joints, value
        self.mode: str = value("topic_mode")
        self._tracker = Tracker(
            horizon=self._value("track.horizon"),
            timeout=self._value("track.timeout"),
            most=[SHARE * axis.limits.velocity for axis in host.feedback().axes],
        )
        self._turns: Turns | None = None  # of what is tracked
        self._player: StreamPlayer | None = None
        self._first, self._last, self._came = 0.0, 0.0, 0.0

    def drop(self) -> None:
        """Follow nothing that came before: another hand moves."""
        self._tracker.drop()
        if self._player is not None:
            self._player.close()
            self._player = None

    def take(self, message: Any, sent: float, now: float) -> None:
        """A message that was sent at ``sent`` (s); its own stamp counts where it has one.

        Raises SjerkError. No points: come to rest.
        """
        if not message.points:
            self.drop()
            self._host.halt(0.0)
            return
        way, stamp = from_message(message)
        way = self._joints.trajectory(way).for_joints(self._joints.names)
        begin = stamp or sent
        if self.mode == "track":
            if not self._tracker.active or self._turns is None:
                self._turns = nearest_turns(way.position[0], self._host.feedback().axes)
            position = self._turns.onto(way.position)
            self._tracker.take(Window.of(begin + way.time, position, way.velocity), now)
            return
        if self._player is None:
            self._player = StreamPlayer(
                self._host,
                period=self._value("stream.period"),
                delay=self._value("stream.delay"),
                ahead=self._value("stream.ahead"),
            )
            self._first, self._last = begin + float(way.time[0]), -1.0
        self._came = now
        for time, position in zip(way.time, way.position, strict=True):
            at = begin + float(time) - self._first
            if at > self._last + 0.5 * self._host.cycle_time:  # windows overlap: new points only
                self._player.push(position, at)
                self._last = at

    def turn(self, now: float) -> None:
        """What is due without a message; raises what ended the motion."""
        if self._player is not None:
            if not self._host.clocked:
                self._player.update()  # with a kernel in a caller's own loop nothing else feeds it
            if now - max(self._came, self._first + self._last) > self._value("track.timeout"):
                self._player.end()
            if self._player.done:
                self.drop()
        aim = self._tracker.aim(now)
        if aim is Rest.HALT:
            self._host.halt(0.0)
        elif aim is not None:
            self._host.move(aim, synchronization="none", min_duration=self._tracker.horizon)
