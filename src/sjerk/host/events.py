"""What happened in a kernel: its events.

Never here: feedback, commands, the layout of the memory.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from sjerk._binding import lib
from sjerk.cycle.states import AxisState
from sjerk.host.feedback import PathState


class EventKind(IntEnum):
    """What an event is about; ``Event.code`` and ``Event.value`` depend on it."""

    GOAL = lib.SJ_EVENT_GOAL  #: The kernel has answered a goal.
    STATE = lib.SJ_EVENT_STATE  #: The state of an axis has changed.
    HOST = lib.SJ_EVENT_HOST  #: The host has come, left, died, or become silent.
    CORRUPT = lib.SJ_EVENT_CORRUPT  #: A command or a record in the shared memory is corrupt.
    FAULT = lib.SJ_EVENT_FAULT  #: A drive reports a fault.
    FOLLOWING = lib.SJ_EVENT_FOLLOWING  #: The following error of an axis is beyond its limit.
    LATE = lib.SJ_EVENT_LATE  #: The clock has skipped cycles.
    ANCHOR = lib.SJ_EVENT_ANCHOR  #: A drive has left; the command is the actual position.
    LIMITS = lib.SJ_EVENT_LIMITS  #: The kernel has answered new limits of an axis.
    PATH = lib.SJ_EVENT_PATH  #: The state of a path has changed.
    REACHED = lib.SJ_EVENT_REACHED  #: All axes of a goal are on it, to the last bit.
    SYNC = lib.SJ_EVENT_SYNC  #: The link to a drive is lost, or its process data are stale.


@dataclass(frozen=True)
class Event:
    """Something that happened in a cycle of the kernel.

    ``axis`` is None for all. ``code``: of a goal or of limits the ``enum sj_result``, of a state
    the new ``AxisState``, of a path the new ``PathState``, of a fault the drive's 603Fh (-1: homing
    failed). ``value``: the state before, the way-point ahead, the following error (axis unit), or
    how many cycles were late. REACHED: in the frame ``cycle`` all axes of ``goal_id`` are on their
    goals, to the last bit.

    >>> print(Event.of(7, EventKind.PATH, -1, PathState.DONE, 3.0, 12))
    cycle 7: PATH DONE 3
    """

    cycle: int
    kind: EventKind
    axis: int | None
    code: int
    value: float
    goal_id: int

    def __str__(self) -> str:
        where = "" if self.axis is None else f" axis {self.axis}"
        what = str(self.code)
        if self.kind is EventKind.STATE:
            what = AxisState(self.code).name
        elif self.kind is EventKind.PATH:
            what = PathState(self.code).name
        return f"cycle {self.cycle}{where}: {self.kind.name} {what} {self.value:g}"

    @classmethod
    def of(cls, cycle: int, kind: int, axis: int, code: int, value: float, goal_id: int) -> Event:
        """The event of the fields of a ``sj_kernel_event``, whose ``axis`` is -1 for all."""
        return cls(cycle, EventKind(kind), None if axis < 0 else axis, code, value, goal_id)
