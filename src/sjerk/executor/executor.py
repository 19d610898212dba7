"""Trajectories as goals: what an action server of FollowJointTrajectory wraps in a few lines.

``TrajectoryExecutor`` accepts or refuses a trajectory with the codes of
joint_trajectory_controller, plays it on a ``Host``, watches tolerances and reports how it goes.
``docs/explanation/trajectories.md`` has a server around it. Never here: planning, shared memory,
ROS.
"""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Self

import numpy as np

from sjerk.cycle.states import AxisState
from sjerk.errors import InputError, PlanError, SjerkError, positive, real
from sjerk.executor.goal import (
    OPEN,
    GoalFeedback,
    GoalStatus,
    ResultCode,
    Settings,
    Tolerance,
    check_tolerances,
    from_message,
    tolerances,
    violated,
)
from sjerk.executor.handle import GoalHandle, GoalOrders, GoalProgress
from sjerk.executor.planned import PlannedGoal, planned
from sjerk.executor.sequencer import Joined, Sequencer, positions
from sjerk.host import Feedback, Host, PathState
from sjerk.trajectory import Trajectory, TrajectoryError
from sjerk.trajectory.entering import Entered
from sjerk.trajectory.segments import Knot

#: A goal that is to begin later than this, in seconds, has its stamp from another clock.
FURTHEST = 3600.0
#: The motion of a goal is planned so many seconds, and those of planning, before its stamp.
_HORIZON = 0.2
#: How often a motion is planned to take over before the one in play is stopped instead.
_TRIES = 6
_CLOSED = "the executor is closed"
_UNABLE = (AxisState.DISABLED, AxisState.ERROR_STOP, AxisState.STOPPING, AxisState.HOMING)


@dataclass(eq=False)
class _Goal:
    """A goal that was accepted, as long as it is the newest."""

    progress: GoalProgress
    handle: GoalHandle
    plan: PlannedGoal
    settings: Settings
    path_tolerance: list[Tolerance]
    goal_tolerance: list[Tolerance]
    goal_time: float
    settled_at: float | None = None
    joins: bool = False  # takes over from a motion in play
    tries: int = 0

    @property
    def status(self) -> GoalStatus:
        return self.progress.status


class TrajectoryExecutor:
    """Plays trajectories on a host, one goal at a time; the newest replaces the one before.

    ``joint_names``: one str per axis of the kernel, in order. ``clock``: the time of ``stamp``, in
    seconds. ``on_feedback`` is called at ``feedback_rate`` (Hz), ``on_result`` once per goal. With
    a kernel in a process a thread watches; in a caller's own loop ``update`` must be called now and
    then between ``MotionKernel.step``.

    A new goal takes over from the motion of the one before, at its stamp or as soon as it can be,
    without a stop where limits allow; a goal that is canceled comes to rest on its path.

    >>> from sjerk import Axis, Limits, MotionKernel
    >>> kernel = MotionKernel([Axis(Limits(2.0, 20.0, 500.0), 1e6, "ideal")])
    >>> host = kernel.host()
    >>> host.enable()
    >>> kernel.step(5)
    >>> executor = TrajectoryExecutor(host, ["elbow"])
    >>> goal = executor.submit(Trajectory(["elbow"], [0.5, 1.0], [[0.3], [0.5]]))
    >>> while goal.status in OPEN:
    ...     executor.update()
    ...     kernel.step(10)
    >>> goal.status.name, goal.code.name, host.feedback().axes[0].position
    ('SUCCEEDED', 'SUCCESSFUL', 0.5)
    """

    def __init__(
        self,
        host: Host,
        joint_names: Sequence[str],
        *,
        settings: Settings | None = None,
        feedback_rate: float = 20.0,
        clock: Callable[[], float] = time.time,
        on_feedback: Callable[[GoalHandle, GoalFeedback], None] | None = None,
        on_result: Callable[[GoalHandle], None] | None = None,
    ) -> None:
        """Raises InputError."""
        self._host, self._names = host, tuple(joint_names)
        if isinstance(joint_names, str) or not all(isinstance(n, str) for n in self._names):
            raise InputError("joint_names", joint_names, "must be a list of one str per axis")
        count = host.axis_count
        if len(self._names) != count or len(set(self._names)) != count:
            raise InputError("joint_names", list(self._names), f"must be {count} different names")
        self._settings = settings or Settings()
        self._every = 1.0 / positive("feedback_rate", feedback_rate)
        self._clock = clock
        self._on_feedback, self._on_result = on_feedback, on_result
        self._lock = threading.RLock()
        self._numbers = itertools.count(1)
        self._goal: _Goal | None = None
        self._sequencer = Sequencer(host)
        self._told = -np.inf
        self._end = threading.Event()
        self._thread: threading.Thread | None = None
        if host.clocked:
            self._thread = threading.Thread(target=self._watch, daemon=True)
            self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Cancel the goal that goes on, and watch no more; goals are refused from now on."""
        self._end.set()
        if self._thread is not None:
            self._thread.join()
        with self._lock:
            goal = self._goal
        if goal is not None and goal.status in OPEN:
            goal.handle.cancel()

    # ---- settings

    @property
    def settings(self) -> Settings:
        """What holds for goals from the next one on; assign another, also while one goes on."""
        return self._settings

    @settings.setter
    def settings(self, settings: Settings) -> None:
        if not isinstance(settings, Settings):
            raise InputError("settings", settings, "must be Settings")
        self._settings = settings

    def change(self, **values: Any) -> Settings:
        """Change some settings, valid from the next goal on; raises InputError.

        Names are those of ``Settings``.
        """
        known = Settings.__dataclass_fields__
        unknown = sorted(set(values) - set(known))
        if unknown:
            raise InputError(
                unknown[0], values[unknown[0]], f"unknown; known are {', '.join(known)}"
            )
        with self._lock:
            self._settings = replace(self._settings, **values)
            return self._settings

    # ---- goals

    def submit(
        self,
        trajectory: Trajectory | Any,
        *,
        path_tolerance: Mapping[str, Tolerance] | None = None,
        goal_tolerance: Mapping[str, Tolerance] | None = None,
        goal_time: float = 0.0,
        stamp: float = 0.0,
    ) -> GoalHandle:
        """Take a goal, or refuse it: the handle's status is then REJECTED, code and text say why.

        ``trajectory``: a ``Trajectory``, or a message with the fields of JointTrajectory (its own
        header's stamp counts then). ``stamp`` (s of the executor's clock): the moment of time 0; 0
        starts now; way-points whose time is over are left out. A first way-point that is later than
        now is gone to in that time, one that is elsewhere at time 0 is gone to first. Tolerances by
        joint, over those of the settings; ``goal_time`` 0: as the settings have it; where they have
        0 too, a goal whose joints never come within its tolerance goes on for ever. Refused too: a
        stamp more than ``FURTHEST`` seconds ahead, any goal after ``close``. An accepted goal
        aborts the one before, whose motion goes on until this one's takes over: at the stamp, or at
        once. Raises InputError for options that are none.
        """
        progress = GoalProgress(next(self._numbers), trajectory)
        handle = self._handle(progress)
        if self._end.is_set():
            return self._refuse(handle, progress, ResultCode.INVALID_GOAL, _CLOSED)
        settings = self._settings
        for name, own in (("path_tolerance", path_tolerance), ("goal_tolerance", goal_tolerance)):
            check_tolerances(name, {} if own is None else own)
        try:
            if not isinstance(trajectory, Trajectory):
                trajectory, stamp = from_message(trajectory)
                progress.trajectory = trajectory
            stamp = real("stamp", stamp)
            frame = self._host.feedback()
            plan = planned(trajectory, settings, frame, self._names, stamp=stamp, now=self._clock())
            progress.plan, names = plan, trajectory.joint_names
            goal = _Goal(
                progress,
                handle,
                plan,
                settings,
                tolerances("path_tolerance", names, path_tolerance, settings.path_tolerance),
                tolerances("goal_tolerance", names, goal_tolerance, settings.goal_tolerance),
                goal_time or settings.goal_time,
            )
        except TrajectoryError as error:
            return self._refuse(handle, progress, ResultCode(error.code), str(error))
        if real("goal_time", goal_time) < 0.0:
            raise InputError("goal_time", goal_time, "must not be negative")
        ahead = stamp - self._clock()
        if ahead > FURTHEST:
            text = f"stamp {stamp!r}: {ahead:g} s ahead of the clock, more than {FURTHEST:g}"
            return self._refuse(handle, progress, ResultCode.INVALID_GOAL, text)
        frame = self._host.feedback()
        idle = self._idle(frame, names)
        if idle:
            text = f"not active: {', '.join(idle)}"
            return self._refuse(handle, progress, ResultCode.INVALID_GOAL, text)
        with self._lock:
            if self._end.is_set():  # closed meanwhile, and the goal would be watched no more
                return self._refuse(handle, progress, ResultCode.INVALID_GOAL, _CLOSED)
            before = self._goal
            if before is not None and before.status in OPEN:
                text = f"replaced by goal {progress.number}"
                goal.joins = True
                self._ended(before, GoalStatus.ABORTED, ResultCode.INVALID_GOAL, text)
            self._goal = goal
            self._look(frame)
        return handle

    def _handle(self, progress: GoalProgress) -> GoalHandle:
        order = partial(self._order, progress)
        orders = GoalOrders(
            cancel=partial(self._cancel, progress),
            pause=partial(order, "pause"),
            resume=partial(order, "resume"),
            speed=partial(order, "speed"),
        )
        return GoalHandle(progress, orders, self._host.cycle_time)

    def _refuse(
        self, handle: GoalHandle, progress: GoalProgress, code: ResultCode, text: str
    ) -> GoalHandle:
        progress.end(GoalStatus.REJECTED, code, text)
        return handle

    def _idle(self, frame: Feedback, names: Sequence[str]) -> list[str]:
        """Joints of a goal whose axes cannot move now, or are to be disabled."""
        orders = self._host.link.command.axis
        return [
            name
            for i, (name, axis) in enumerate(zip(self._names, frame.axes, strict=True))
            if name in names and (not axis.follows or axis.state in _UNABLE or not orders[i].enable)
        ]

    # ---- what goes on

    def update(self) -> None:
        """Look once: start what waits, watch tolerances, report feedback and results."""
        with self._lock:
            self._sequencer.update()
            if self._goal is not None and self._goal.status in OPEN:
                self._look(self._host.feedback())

    def _watch(self) -> None:
        pause = min(self._every, 5e-3)
        while not self._end.wait(pause):
            if self._host.closed:
                return
            try:
                self.update()
            except SjerkError as error:
                goal = self._goal
                if goal is not None and goal.status in OPEN:
                    self._ended(goal, GoalStatus.ABORTED, ResultCode.INVALID_GOAL, str(error))
                if self._host.closed or not self._host.kernel_lives:
                    return

    def _look(self, frame: Feedback) -> None:
        goal = self._goal
        assert goal is not None
        took_over = self._sequencer.verdict()
        if took_over is False and goal.status is GoalStatus.EXECUTING:
            goal.progress.status = GoalStatus.WAITING
        if goal.status is GoalStatus.WAITING:
            if took_over is not None:
                self._begin(goal, frame)
            return
        feedback = self._feedback_of(goal, frame)
        goal.progress.feedback = feedback
        now = self._clock()
        if self._on_feedback is not None and now - self._told >= self._every * (1.0 - 1e-6):
            self._told = now
            self._on_feedback(goal.handle, feedback)
        path = self._sequencer.path
        assert path is not None
        state = path.state
        for k, limit in enumerate(goal.path_tolerance):
            wrong = violated(feedback, k, limit)
            if wrong:
                code = ResultCode.PATH_TOLERANCE_VIOLATED
                self._finish(goal, GoalStatus.ABORTED, code, f"path tolerance: {wrong}")
                return
        if state is PathState.DONE:
            self._settle(goal, feedback)
        elif state.ended:
            text = f"the kernel ended the motion: {state.name.lower()}"
            try:
                path.check()
            except SjerkError as error:
                text = f"{text}; {error}"
            self._ended(goal, GoalStatus.ABORTED, ResultCode.INVALID_GOAL, text)

    def _begin(self, goal: _Goal, frame: Feedback) -> None:
        """Its motion takes over from the one in play, or begins when that is at rest."""
        axes = goal.plan.axes
        try:
            self._sequencer.check()
            if goal.joins and not self._sequencer.over:
                goal.joins = self._join(goal)
                if not goal.joins:
                    self._sequencer.cancel()
            elif self._sequencer.rests(frame, axes):
                self._sequencer.start(goal.plan.enter(positions(frame, axes), self._clock()), axes)
                self._executes(goal)
        except SjerkError as error:
            self._sequencer.cancel()
            self._ended(goal, GoalStatus.ABORTED, ResultCode.INVALID_GOAL, str(error))

    def _join(self, goal: _Goal) -> bool:
        """Whether its motion takes over, or will; else the one in play is to come to rest."""
        plan = goal.plan
        if goal.tries >= _TRIES or not self._sequencer.leads(plan.axes):
            return False
        now = self._clock()
        ahead = max(0.0, plan.stamp - now) if plan.stamp else 0.0
        if ahead > self._sequencer.lead + _HORIZON:
            return True

        def make(knot: Knot, ahead: float) -> Entered:
            return plan.enter(knot, now + ahead)

        try:
            joined = self._sequencer.join(make, ahead)
        except (PlanError, InputError):
            return False  # no motion from that state within the limits; from rest there may be one
        goal.tries += joined is not Joined.END
        if joined is Joined.SENT:
            self._executes(goal)
        return True

    def _executes(self, goal: _Goal) -> None:
        path = self._sequencer.path
        assert path is not None
        goal.progress.status = GoalStatus.EXECUTING
        if goal.settings.speed != path.factor:
            path.speed(goal.settings.speed)

    def _settle(self, goal: _Goal, feedback: GoalFeedback) -> None:
        """The command has arrived: the joints are within tolerance, or have time left."""
        wrong = [w for k, t in enumerate(goal.goal_tolerance) if (w := violated(feedback, k, t))]
        checked = any(tolerance != Tolerance() for tolerance in goal.goal_tolerance)
        fast = np.flatnonzero(np.abs(feedback.actual_velocity) > goal.settings.stopped_velocity)
        if checked and len(fast):
            k = int(fast[0])
            speed = feedback.actual_velocity[k]
            wrong.append(f"joint {feedback.joint_names[k]}: velocity {speed:g} is not rest")
        if not wrong:
            self._ended(goal, GoalStatus.SUCCEEDED, ResultCode.SUCCESSFUL, "goal reached")
            return
        now = self._clock()
        if goal.settled_at is None:
            goal.settled_at = now
        elif goal.goal_time and now - goal.settled_at > goal.goal_time:
            text = f"goal tolerance, {goal.goal_time:g} s after the motion: {wrong[0]}"
            code = ResultCode.GOAL_TOLERANCE_VIOLATED
            self._ended(goal, GoalStatus.ABORTED, code, text)

    def _feedback_of(self, goal: _Goal, frame: Feedback) -> GoalFeedback:
        plan, progress = goal.plan, self._sequencer.progress
        axes = [frame.axes[i] for i in plan.joint_axes]
        rows = [
            np.array([getattr(axis, name) for axis in axes])
            for name in ("position", "actual_position", "velocity", "actual_velocity")
        ]
        ahead = min(max(self._sequencer.ahead(progress), 0), len(plan.chosen) - 1)
        return GoalFeedback(
            goal.progress.trajectory.joint_names,
            plan.offset + self._sequencer.time(progress),
            int(plan.chosen[ahead]),
            progress.speed,
            rows[0],
            rows[1],
            rows[0] - rows[1],
            rows[2],
            rows[3],
        )

    # ---- orders

    def _order(self, progress: GoalProgress, name: str, *values: float) -> None:
        with self._lock:
            goal, path = self._goal, self._sequencer.path
            if goal is None or goal.progress is not progress or path is None:
                return
            if goal.status is GoalStatus.EXECUTING:
                getattr(path, name)(*values)

    def _cancel(self, progress: GoalProgress) -> None:
        with self._lock:
            goal = self._goal
            if goal is not None and goal.progress is progress:
                self._finish(goal, GoalStatus.CANCELED, ResultCode.SUCCESSFUL, "canceled")

    def _finish(self, goal: _Goal, status: GoalStatus, code: ResultCode, text: str) -> None:
        """End a goal that goes on: its motion stops on the path."""
        with self._lock:
            if goal.status not in OPEN:
                return
            self._sequencer.cancel()
            self._ended(goal, status, code, text)

    def _ended(self, goal: _Goal, status: GoalStatus, code: ResultCode, text: str) -> None:
        goal.progress.end(status, code, text)
        if self._on_result is not None:
            self._on_result(goal.handle)
