"""A goal that was accepted: what holds for it, and which of its tolerances are violated.

Never here: its motion, what follows from a violation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sjerk.executor.goal import GoalFeedback, GoalStatus, Settings, Tolerance, violated
from sjerk.executor.handle import GoalHandle, GoalProgress
from sjerk.executor.planned import PlannedGoal


@dataclass(eq=False)
class AcceptedGoal:
    """A goal of an executor; ``joins``: it takes over from a motion in play."""

    progress: GoalProgress
    handle: GoalHandle
    plan: PlannedGoal
    settings: Settings
    path_tolerance: list[Tolerance]
    goal_tolerance: list[Tolerance]
    goal_time: float
    settled_at: float | None = None
    joins: bool = False
    tries: int = 0

    @property
    def status(self) -> GoalStatus:
        """What has become of it."""
        return self.progress.status

    def off_path(self, feedback: GoalFeedback) -> str:
        """Which joint has left its path tolerance, or nothing."""
        return _first(feedback, self.path_tolerance)

    def off_goal(self, feedback: GoalFeedback) -> str:
        """Which joint is not within its goal tolerance, or not at rest, or nothing."""
        wrong = _first(feedback, self.goal_tolerance)
        checked = any(tolerance != Tolerance() for tolerance in self.goal_tolerance)
        fast = np.flatnonzero(np.abs(feedback.actual_velocity) > self.settings.stopped_velocity)
        if wrong or not checked or not len(fast):
            return wrong
        speed = feedback.actual_velocity[fast[0]]
        return f"joint {feedback.joint_names[fast[0]]}: velocity {speed:g} is not rest"


def _first(feedback: GoalFeedback, limits: list[Tolerance]) -> str:
    return next((w for k, limit in enumerate(limits) if (w := violated(feedback, k, limit))), "")
