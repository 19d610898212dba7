"""What happened in a kernel: its events, and each in words.

Never here: feedback, commands, the layout of the memory.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum

from sjerk._binding import lib
from sjerk.cycle.states import AxisState
from sjerk.host.feedback import LimitSwitch, PathState
from sjerk.host.reasons import HOMING_FAILED, REASONS, fault_words


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

    ``name``: of the axis, "" where it has none. ``str(event)`` tells it in words.

    >>> print(Event.of(7, EventKind.PATH, -1, PathState.DONE, 3.0, 12))
    cycle 7: path 12 is done, on way-point 3
    >>> print(Event.of(9, EventKind.STATE, 1, AxisState.STANDSTILL, 2.0, 0, ["base", "elbow"]))
    cycle 9: axis 1 (elbow): standstill, before discrete motion
    """

    cycle: int
    kind: EventKind
    axis: int | None
    code: int
    value: float
    goal_id: int
    name: str = ""

    def __str__(self) -> str:
        return f"cycle {self.cycle}: {self.words}"

    @property
    def words(self) -> str:
        """What happened, without the cycle, so that equal ones can be counted."""
        return _WORDS[self.kind](self)

    @property
    def where(self) -> str:
        """The axis as texts call it."""
        if self.axis is None:
            return "all axes"
        return f"axis {self.axis} ({self.name})" if self.name else f"axis {self.axis}"

    @property
    def pid(self) -> int | None:
        """Of a stop: the process that asked for it; None where it is not known, and of others."""
        return int(self.value) if self.kind is EventKind.STOP and self.value else None

    @classmethod
    def of(
        cls,
        cycle: int,
        kind: int,
        axis: int,
        code: int,
        value: float,
        goal_id: int,
        names: Sequence[str] = (),
    ) -> Event:
        """The event of the fields of a ``sj_kernel_event``, whose ``axis`` is -1 for all.

        ``names``: of the axes, by number.
        """
        name = names[axis] if 0 <= axis < len(names) else ""
        return cls(cycle, EventKind(kind), None if axis < 0 else axis, code, value, goal_id, name)


# ---- in words ------------------------------------------------------------------------------------


def _state(code: float) -> str:
    return AxisState(round(code)).name.lower().replace("_", " ")


def _result(event: Event, of: str) -> str:
    if event.code == lib.SJ_RESULT_ACCEPTED:
        return f"{of} is accepted"
    if event.code == lib.SJ_RESULT_SUPERSEDED:
        return f"{of} is superseded: cancelled, or a newer one came"
    if event.code == lib.SJ_RESULT_STOPPED:
        return f"{of} is dropped: {REASONS[event.code]}"
    by = "" if event.axis is None else f" by {event.where}"
    return f"{of} is refused{by}: {REASONS.get(event.code, f'code {event.code}')}"


def _host(event: Event) -> str:
    return {
        lib.SJ_HOST_ABSENT: "the host has left, or there was none yet",
        lib.SJ_HOST_ALIVE: "a host is there",
        lib.SJ_HOST_SILENT: "the host, which asked to be watched, is silent",
        lib.SJ_HOST_DEAD: "the host has died",
    }.get(event.code, f"the host's state is {event.code}")


def _fault(event: Event) -> str:
    if event.code == HOMING_FAILED:
        return f"{event.where}: homing has failed"
    return f"{event.where}: drive fault {fault_words(event.code)}"


def _late(event: Event) -> str:
    count = round(event.value)
    return f"{count} cycle{'s' if count != 1 else ''} left out: the clock was late"


def _limits(event: Event) -> str:
    return _result(event, f"{event.where}: a set of limits")


def _path(event: Event) -> str:
    does = {
        PathState.SENT: "has not begun",
        PathState.RUNS: "runs",
        PathState.PAUSED: "is paused",
        PathState.STARVES: "waits for segments",
        PathState.STOPS: "comes to rest",
        PathState.DONE: "is done",
        PathState.STOPPED: "is stopped",
        PathState.LEFT: "is left",
    }.get(PathState(event.code), f"has state {event.code}")
    place = "on" if event.code == PathState.DONE else "ahead is"
    return f"path {event.goal_id} {does}, {place} way-point {event.value:g}"


def _sync(event: Event) -> str:
    why = f"link lost, {fault_words(event.code)}" if event.code else "nothing came from its drive"
    return f"{event.where}: {why}"


def _stop(event: Event) -> str:
    who = "a process that is not known" if event.pid is None else f"process {event.pid}"
    return f"{StopKind(event.code).name.lower().replace('_', ' ')} of {event.where} by {who}"


def _switch(event: Event) -> str:
    closed = LimitSwitch(event.code)
    if not closed:
        return f"{event.where}: limit switches are open"
    sides = " and ".join(side.name.lower() for side in closed if side.name)
    return f"{event.where}: limit switch closed, {sides}"


_WORDS: dict[EventKind, Callable[[Event], str]] = {
    EventKind.GOAL: lambda event: _result(event, f"goal {event.goal_id}"),
    EventKind.STATE: lambda event: (
        f"{event.where}: {_state(event.code)}, before {_state(event.value)}"
    ),
    EventKind.HOST: _host,
    EventKind.CORRUPT: lambda event: "a command or a record in the shared memory is corrupt",
    EventKind.FAULT: _fault,
    EventKind.FOLLOWING: lambda event: f"{event.where}: following error {event.value:g}",
    EventKind.LATE: _late,
    EventKind.ANCHOR: lambda event: (
        f"{event.where}: its drive left in motion, commanded is where it is"
    ),
    EventKind.LIMITS: _limits,
    EventKind.PATH: _path,
    EventKind.REACHED: lambda event: f"goal {event.goal_id} is reached",
    EventKind.SYNC: _sync,
    EventKind.STOP: _stop,
    EventKind.SWITCH: _switch,
}
