"""What happened in a kernel: its events.

Never here: feedback, commands, the layout of the memory.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from sjerk._binding import lib
from sjerk.cycle.states import AxisState
from sjerk.host.feedback import LimitSwitch, PathState


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
    STOP = lib.SJ_EVENT_STOP  #: Another process than the host has asked for a stop.
    SWITCH = lib.SJ_EVENT_SWITCH  #: A limit switch of an axis has closed or opened.


class StopKind(IntEnum):
    """How axes were asked to stop."""

    HALT = lib.SJ_REACT_HALT  #: All axes of a move together, within the limits of the move.
    QUICK_STOP = lib.SJ_REACT_QUICK_STOP  #: Each axis by its own stop limits.


@dataclass(frozen=True)
class Event:
    """Something that happened in a cycle of the kernel.

    ``axis`` is None for all. ``code``: of a goal or of limits the ``enum sj_result``, of a state
    the new ``AxisState``, of a path the new ``PathState``, of a fault the drive's 603Fh (-1: homing
    failed), of a stop the ``StopKind``, of a switch the ``LimitSwitch`` of those that are closed
    now. ``value``: the state or the switches before, the way-point ahead, the
    following error (axis unit), how many cycles were late, or of a stop the process (0: not known,
    more than 32 processes stop this kernel). REACHED: in the frame ``cycle`` all axes of
    ``goal_id`` are on their goals, to the last bit.

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
        elif self.kind is EventKind.SWITCH:
            what = LimitSwitch(self.code).name or "OPEN"
            return f"cycle {self.cycle}{where}: SWITCH {what}"
        elif self.kind is EventKind.STOP:
            who = "unknown" if self.pid is None else self.pid
            return f"cycle {self.cycle}{where}: STOP {StopKind(self.code).name} by process {who}"
        return f"cycle {self.cycle}{where}: {self.kind.name} {what} {self.value:g}"

    @property
    def pid(self) -> int | None:
        """Of a stop: the process that asked for it; None where it is not known, and of others."""
        return int(self.value) if self.kind is EventKind.STOP and self.value else None

    @classmethod
    def of(cls, cycle: int, kind: int, axis: int, code: int, value: float, goal_id: int) -> Event:
        """The event of the fields of a ``sj_kernel_event``, whose ``axis`` is -1 for all."""
        return cls(cycle, EventKind(kind), None if axis < 0 else axis, code, value, goal_id)
