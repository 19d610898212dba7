"""The desk between an action server and ``TrajectoryExecutor``: goals in, results out.

It knows messages by their fields, not ROS. Whoever serves calls ``submit``, and ``ended`` when it
was woken; nothing here blocks, and nothing calls back but ``wake``, from any thread.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from sjerk.errors import InputError, SjerkError
from sjerk.executor import (
    GoalHandle,
    GoalStatus,
    ResultCode,
    Settings,
    Tolerance,
    TrajectoryExecutor,
)
from sjerk.executor.goal import OPEN, from_message
from sjerk.host import Host
from sjerk.ports.ros.joints import Joints
from sjerk.trajectory import TrajectoryError
from sjerk.trajectory.columns import seconds


@dataclass(frozen=True)
class Refusal:
    """A goal that was not taken: the code of FollowJointTrajectory, and why."""

    code: ResultCode
    text: str


def tolerances(rows: Sequence[Any], joints: Joints) -> dict[str, Tolerance]:
    """``control_msgs/JointTolerance`` rows, in axis units; -1 stays -1.

    Raises InputError for a joint that is there twice, and for numbers that are no tolerance.
    """
    found: dict[str, Tolerance] = {}
    for row in rows:
        if row.name in found:
            raise InputError("tolerance", row.name, "is there twice")
        scale = joints.scale_of(row.name)
        found[row.name] = Tolerance(
            *(value * scale if value > 0.0 else value for value in (row.position, row.velocity))
        )
    return found


class Desk:
    """Goals of one action server on one host, the newest in play.

    ``clock``: the time of the stamps, s. ``wake`` is called when a goal has ended.
    """

    def __init__(
        self,
        host: Host,
        joints: Joints,
        *,
        settings: Settings,
        feedback_rate: float,
        clock: Callable[[], float],
        wake: Callable[[], None],
    ) -> None:
        """Raises InputError."""
        self._host, self._joints = host, joints
        self._executor = TrajectoryExecutor(
            host,
            joints.names,
            settings=settings,
            feedback_rate=feedback_rate,
            clock=clock,
            on_result=lambda _: wake(),
        )
        self._open: list[GoalHandle] = []

    @property
    def open(self) -> tuple[GoalHandle, ...]:
        """Goals whose results have not been fetched by ``ended``, oldest first."""
        return tuple(self._open)

    def set(self, settings: Settings) -> None:
        """What holds from the next goal on."""
        self._executor.settings = settings

    def update(self) -> None:
        """Look once at what goes on, with a kernel in a caller's own loop."""
        self._executor.update()

    def submit(self, message: Any) -> GoalHandle | Refusal:
        """Take a FollowJointTrajectory goal, or a JointTrajectory; the newest replaces the others.

        Never raises: a message that is wrong in any way is a refusal, and what moves goes on.
        """
        try:
            whole = hasattr(message, "trajectory")
            way, stamp = from_message(message.trajectory if whole else message)
            more: dict[str, Any] = {}
            if whole:
                more_dof = getattr(message, "multi_dof_trajectory", None)  # not in ROS 1
                if more_dof is not None and len(more_dof.points):
                    what = "multi_dof_trajectory: only joints with one degree of freedom"
                    return Refusal(ResultCode.INVALID_GOAL, what)
                more["goal_time"] = seconds(message.goal_time_tolerance)
                for name in ("path_tolerance", "goal_tolerance"):
                    more[name] = tolerances(getattr(message, name), self._joints)
            handle = self._executor.submit(self._joints.trajectory(way), stamp=stamp, **more)
        except TrajectoryError as error:
            return Refusal(ResultCode(error.code), str(error))
        except SjerkError as error:
            return Refusal(ResultCode.INVALID_GOAL, str(error))
        if not handle.accepted:
            return Refusal(handle.code, handle.text)
        self._open.append(handle)
        return handle

    def ended(self, *, at_rest: bool = True) -> list[GoalHandle]:
        """Goals that have ended and can be told now; each is given out once.

        ``at_rest``: a canceled one only once its axes rest.
        """
        gone = not self._host.kernel_lives  # then nothing moves any more

        def told(goal: GoalHandle) -> bool:
            canceled = goal.status is GoalStatus.CANCELED
            return goal.status not in OPEN and (not (at_rest and canceled) or goal.rested or gone)

        over = [goal for goal in self._open if told(goal)]
        self._open = [goal for goal in self._open if goal not in over]
        return over

    def speed(self, factor: float) -> None:
        """Play the goals at another speed, 0 .. 2; raises InputError."""
        for goal in self._open:
            goal.speed(factor)

    def close(self, reason: str) -> None:
        """End the goals, which are told as ABORTED with this reason; refuse all others."""
        self._executor.close(reason)
