"""What the kernel has answered to goals, kept for the handles of their motions.

Never here: commands, waiting, the layout of the memory.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Sequence
from typing import Any

from sjerk.cycle.states import AxisState
from sjerk.errors import MotionStoppedError, RefusedError
from sjerk.handshake import Segment
from sjerk.host.events import EventKind
from sjerk.host.feedback import PathState, switches_of
from sjerk.host.reader import EventCursor
from sjerk.host.reasons import HOMING_FAILED, REASONS

_KEPT = 4096  # answers of each kind


def refusal(code: int, axis: int, detail: str = "", *, names: Sequence[str] = ()) -> RefusedError:
    """The error of an ``enum sj_result``; ``axis`` -1: of none in particular; ``names``: of all."""
    return RefusedError(code, "; ".join(filter(None, (REASONS[code], detail))), axis, names)


def stopped(
    frame: Any, axes: Iterable[int], unhomed: int | None = None, *, names: Sequence[str] = ()
) -> MotionStoppedError:
    """The error of a motion that ended elsewhere, and why, as far as the frame says."""
    rows = {i: frame.axis[i] for i in axes}
    return MotionStoppedError(
        {i: float(axis.position) for i, axis in rows.items()},
        {i: int(axis.error_code) for i, axis in rows.items() if axis.fault},
        unhomed,
        {i: int(closed) for i, axis in rows.items() if (closed := switches_of(axis))},
        names=names,
        error_stops=[
            i for i, axis in rows.items() if axis.state == AxisState.ERROR_STOP and not axis.fault
        ],
    )


class Answers:
    """The newest answers to goals by their ids, by the events."""

    def __init__(self, segment: Segment) -> None:
        """From now on."""
        self._events = EventCursor(segment)
        self._lock = threading.Lock()  # the threads of paths ask too
        self._results: dict[int, tuple[int, int]] = {}
        self._reached: dict[int, int] = {}  # the cycle in which a goal was reached
        self._path_states: dict[int, int] = {}
        self._unhomed: dict[int, int] = {}  # the axis whose homing failed

    def _look(self) -> None:
        with self._lock:
            while (event := self._events.next()) is not None:
                table: dict[int, Any]
                answer: Any
                if event.kind == EventKind.GOAL:
                    table, answer = self._results, (event.code, event.axis)
                elif event.kind == EventKind.PATH:
                    table, answer = self._path_states, event.code
                elif event.kind == EventKind.FAULT and event.code == HOMING_FAILED:
                    table, answer = self._unhomed, event.axis
                elif event.kind == EventKind.REACHED:
                    table, answer = self._reached, event.cycle
                else:
                    continue
                table[event.goal_id] = answer
                table.pop(event.goal_id - _KEPT, None)

    def result(self, goal_id: int, frame: Any) -> tuple[int, int] | None:
        """Result and axis of a goal that the kernel has passed; None: it never saw it."""
        if frame.result_goal_id == goal_id:
            return frame.result, frame.result_axis
        self._look()
        return self._results.get(goal_id)

    def reached(self, goal_id: int) -> bool:
        """Whether all axes of the goal have been on it."""
        self._look()
        return goal_id in self._reached

    def unhomed(self, goal_id: int) -> int | None:
        """The axis whose homing failed, of a goal that homes; None: of none so far."""
        self._look()
        return self._unhomed.get(goal_id)

    def path_state(self, goal_id: int) -> PathState:
        """The last state of a path that an event reported; SENT for none."""
        return PathState(self._path_states.get(goal_id, PathState.SENT))
