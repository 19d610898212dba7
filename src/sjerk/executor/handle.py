"""One goal of an executor: what has become of it, and the handle that its sender gets.

Never here: planning, watching, what the orders do.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from sjerk.executor.goal import GoalFeedback, GoalStatus, ResultCode
from sjerk.executor.planned import PlannedGoal


@dataclass(eq=False)
class GoalProgress:
    """What has become of a goal so far; its executor writes it, its handle reads it."""

    number: int
    trajectory: Any
    status: GoalStatus = GoalStatus.WAITING
    code: ResultCode = ResultCode.SUCCESSFUL
    text: str = ""
    feedback: GoalFeedback | None = None
    plan: PlannedGoal | None = None
    over: threading.Event = field(default_factory=threading.Event)
    rested: threading.Event = field(default_factory=threading.Event)

    def end(self, status: GoalStatus, code: ResultCode, text: str) -> None:
        """This is its result."""
        self.status, self.code, self.text = status, code, text
        self.over.set()


@dataclass(frozen=True)
class GoalOrders:
    """What the executor of a goal does for its handle."""

    cancel: Callable[[], None]
    pause: Callable[[], None]
    resume: Callable[[], None]
    speed: Callable[[float], None]


class GoalHandle:
    """One goal: how it goes, and the orders for it."""

    def __init__(self, progress: GoalProgress, orders: GoalOrders, cycle_time: float) -> None:
        """Not for callers: ``TrajectoryExecutor.submit`` makes it."""
        self._progress, self._orders, self._T = progress, orders, cycle_time

    @property
    def number(self) -> int:
        """Of this goal, from 1 in the order of ``submit``."""
        return self._progress.number

    @property
    def trajectory(self) -> Any:
        """The trajectory; what was submitted, where that is none."""
        return self._progress.trajectory

    @property
    def status(self) -> GoalStatus:
        """What has become of it."""
        return self._progress.status

    @property
    def accepted(self) -> bool:
        """Whether it was not refused."""
        return self.status is not GoalStatus.REJECTED

    @property
    def code(self) -> ResultCode:
        """The result's code; SUCCESSFUL while it goes on."""
        return self._progress.code

    @property
    def text(self) -> str:
        """The result's text, never empty once there is a result."""
        return self._progress.text

    @property
    def feedback(self) -> GoalFeedback | None:
        """The newest feedback, at the executor's rate; None before the first."""
        return self._progress.feedback

    @property
    def stretch(self) -> float:
        """Seconds more than its times ask for, of what was planned so far."""
        plan = self._progress.plan
        return 0.0 if plan is None else plan.stretch * self._T

    def result(self, timeout: float | None = None) -> tuple[ResultCode, str]:
        """Wait for the end (with a kernel in a process); raises TimeoutError."""
        if not self._progress.over.wait(timeout):
            raise TimeoutError(f"goal {self.number}: not within {timeout} s")
        return self.code, self.text

    @property
    def rested(self) -> bool:
        """Whether it is over and its axes rest, or another goal's motion has taken over from it.

        ``status`` tells CANCELED or ABORTED at once, while the axes still brake.
        """
        return self._progress.rested.is_set()

    def cancel(self) -> None:
        """Stop on the path, jerk-limited, from the commanded state; CANCELED at once.

        Who is to be told at rest looks at ``rested``, or gives the executor ``on_rest``.
        """
        self._orders.cancel()

    def pause(self) -> None:
        """Come to rest on the path and wait for ``resume``."""
        self._orders.pause()

    def resume(self) -> None:
        """Go on along the path."""
        self._orders.resume()

    def speed(self, factor: float) -> None:
        """Pass the path at another speed, 0 .. 2; raises InputError."""
        self._orders.speed(factor)
