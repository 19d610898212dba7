"""The handle of one commanded motion, direct or queued: what has become of it.

Never here: what is commanded, planning, the layout of the memory.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from enum import Enum
from typing import Any

from sjerk._binding import lib
from sjerk.errors import SupersededError, axis_label
from sjerk.host.answers import refusal, stopped
from sjerk.host.arguments import exceeded
from sjerk.host.feedback import limits_of
from sjerk.host.link import Link
from sjerk.profile import Limits, State


class MoveState(Enum):
    """What has become of a move."""

    SENT = "sent"  #: The kernel has not answered yet.
    QUEUED = "queued"  #: The kernel has it, and waits for the move before.
    MOVING = "moving"  #: The axes move to the goal.
    DONE = "done"  #: The command has settled on the goal, or passed it for a queued move.
    STOPPED = "stopped"  #: A stop ended it before the goal.
    SUPERSEDED = "superseded"  #: A newer goal took its place.
    REFUSED = "refused"  #: The kernel did not accept it.


def _reached(axis: Any, goal: State, known: bool) -> bool:
    """On the goal; or past it, still with the velocity that was asked for."""
    return bool(axis.settled or (known and not axis.moving and axis.position == goal.position))


#: States of an axis that has come to rest as ordered; its state follows a cycle behind.
_STANDS = (lib.SJ_AXIS_STANDSTILL, lib.SJ_AXIS_CONTINUOUS)
_OPEN = (MoveState.SENT, MoveState.QUEUED, MoveState.MOVING)


class Move:
    """Handle of one commanded motion; ``await move`` does what ``wait`` does.

    Positions in axis units. It knows what the kernel has answered by the goal's number, whatever
    was commanded since.

    >>> from sjerk import Axis, MotionKernel
    >>> kernel = MotionKernel([Axis(Limits(90.0, 500.0, 5000.0), 2**24 / 360, "ideal")])
    >>> host = kernel.host()
    >>> host.enable()
    >>> kernel.step(5)
    >>> move = host.move(1.0)
    >>> move.state.name
    'SENT'
    >>> kernel.step(400)
    >>> move.done, move.position
    (True, {0: 1.0})
    """

    def __init__(
        self,
        link: Link,
        goal_id: int,
        targets: dict[int, State],
        *,
        known: bool = True,
        number: int = 0,
        limits: Mapping[int, Limits] | None = None,
        rest: bool = False,
    ) -> None:
        """Not for callers: ``Host.move`` makes it.

        ``known``: the targets are positions. ``number``: in the look-ahead ring, of a queued move.
        ``limits``: what was asked for, by axis. ``rest``: a jog to velocity 0, done at rest.
        """
        self._rest = rest
        self._limits = limits or {}
        self._number = number
        self._link = link
        self._goal_id = goal_id
        self._targets = targets
        self._known = known

    @property
    def targets(self) -> dict[int, State]:
        """Goal by axis number; of a relative move the distance, of a jog the velocity."""
        return dict(self._targets)

    @property
    def goal_id(self) -> int:
        """Number of this goal in feedback and events."""
        return self._goal_id

    @property
    def state(self) -> MoveState:
        """What has become of it, by the newest feedback."""
        return self._state(self._link.frame())

    @property
    def position(self) -> dict[int, float]:
        """Commanded position by axis number, axis units."""
        frame = self._link.frame()
        return {i: float(frame.axis[i].position) for i in self._targets}

    def _state(self, frame: Any) -> MoveState:
        answers, queued = self._link.answers, self._number > 0
        if not queued and frame.result_goal_id < self._goal_id:
            return MoveState.SENT
        result = answers.result(self._goal_id, frame)
        if result is None:
            if queued:
                return self._unanswered()
            return MoveState.SUPERSEDED  # overwritten before the kernel saw it
        if result[0] != lib.SJ_RESULT_ACCEPTED:
            never = {lib.SJ_RESULT_SUPERSEDED: MoveState.SUPERSEDED}
            if queued:
                never[lib.SJ_RESULT_STOPPED] = MoveState.STOPPED
            return never.get(result[0], MoveState.REFUSED)
        axes = [frame.axis[i] for i in self._targets]
        if answers.reached(self._goal_id):
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
        if any(a.moving for a in axes):
            return MoveState.MOVING
        stands = self._rest and all(axis.state in _STANDS for axis in axes)
        return MoveState.DONE if stands else MoveState.STOPPED

    def _unanswered(self) -> MoveState:
        """Of a queued move that the kernel has not begun, and not refused."""
        if self._number <= self._link.flushed:
            return MoveState.STOPPED
        taken = self._link.taken_records >= self._number
        return MoveState.QUEUED if taken else MoveState.SENT

    @property
    def done(self) -> bool:
        """Whether the command has settled on the goal, or passed it for a queued move."""
        return self.state is MoveState.DONE

    def accepted(self, timeout: float | None = 5.0) -> None:
        """Return when the kernel has taken it; raises as ``wait`` does."""
        self._link.wait_until(
            lambda frame: self._state(frame) not in (MoveState.SENT, MoveState.QUEUED),
            timeout,
            "an answer",
        )
        self.check()

    def taken(self, timeout: float | None = 5.0) -> None:
        """Return when the kernel has it, moving or in its queue; raises as ``wait`` does."""
        self._link.wait_until(
            lambda frame: self._state(frame) is not MoveState.SENT, timeout, "an answer"
        )
        self.check()

    def cancel(self) -> None:
        """Halt the axes of this move, together; nothing if it is over or replaced.

        A queued move and all behind it on its axes are not begun; the one before comes to rest on
        its goal. Where it is already so near that it passes, it comes to rest behind it.
        """
        if self._number and self.state in (MoveState.SENT, MoveState.QUEUED):
            self._link.cancel_from(self._number, self._targets)
        if self.state is MoveState.MOVING or (not self._number and self.state is MoveState.SENT):
            self._link.count("halts", self._targets)

    def wait(self, timeout: float | None = None) -> None:
        """Return when the command has settled on the goal.

        Raises RefusedError (with the reason), SupersededError (a newer goal), MotionStoppedError
        (stopped on the way), KernelGoneError, TimeoutError.
        """
        where = ", ".join(
            f"{axis_label(i, self._link.names)} to {goal.position!r}"
            for i, goal in self._targets.items()
        )
        self._link.wait_until(
            lambda frame: self._state(frame) not in _OPEN, timeout, f"move of {where}"
        )
        self.check()

    def _above(self, code: int, axis: int, frame: Any) -> str:
        """Which limit was asked for beyond the one that the axis has in the kernel."""
        asked = self._limits.get(axis)
        if code != lib.SJ_RESULT_LIMITS or asked is None:
            return ""
        own = limits_of(frame.axis[axis], self._link.cycle_time)
        above = exceeded(asked, own)
        return "" if above is None else "{} {:g}, it has {:g}".format(*above)

    def __await__(self) -> Generator[Any, None, None]:
        return self._settle().__await__()

    async def _settle(self) -> None:
        await self._link.until(lambda: self.state not in _OPEN, "a move")
        self.check()

    def check(self) -> None:
        """Raise what ``wait`` would, where the move has ended otherwise than on its goal."""
        frame = self._link.frame()
        state, names = self._state(frame), self._link.names
        if state is MoveState.REFUSED:
            code, axis = self._link.answers.result(self._goal_id, frame) or (0, -1)
            raise refusal(code, axis, self._above(code, axis, frame), names=names)
        if state is MoveState.SUPERSEDED:
            raise SupersededError(self.position, names=names)
        if state is MoveState.STOPPED:
            unhomed = self._link.answers.unhomed(self._goal_id)
            raise stopped(frame, self._targets, unhomed, names=names)
