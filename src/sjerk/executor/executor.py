"""Trajectories as goals: what an action server of FollowJointTrajectory wraps in a few lines.

``TrajectoryExecutor`` accepts or refuses a trajectory with the codes of
joint_trajectory_controller, plays it on a ``Host``, watches tolerances and reports how it goes.
``docs/explanation/executor.md`` has a server around it. Never here: planning, shared memory,
ROS.
"""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Self

import numpy as np

from sjerk.errors import InputError, PlanError, SjerkError, positive, real
from sjerk.executor.accepted import AcceptedGoal
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
)
from sjerk.executor.handle import GoalHandle, GoalOrders, GoalProgress
from sjerk.executor.joints import Joints
from sjerk.executor.planned import planned
from sjerk.executor.sequencer import Place, Sequencer, positions
from sjerk.host import Feedback, Host, PathState
from sjerk.trajectory import Trajectory, TrajectoryError
from sjerk.trajectory.segments import Followed, Knot

#: A goal that is to begin later than this, in seconds, has its stamp from another clock.
FURTHEST = 3600.0
#: The motion of a goal is planned so many seconds, and those of planning, before its stamp.
_HORIZON = 0.2
#: How often a motion is planned to take over before the one in play is stopped instead.
_TRIES = 6
_CLOSED = "the executor is closed"


class TrajectoryExecutor:
    """Plays trajectories on a host, one goal at a time; the newest replaces the one before.

    ``joint_names``: one str per axis, in order; None: the axes' own (``Axis.name``). ``axes``:
    those of these joints, else all; the others are free for other use, but for paths: a kernel
    plays one path at a time. ``clock``: the time of ``stamp``, in seconds. ``on_feedback`` is
    called at ``feedback_rate`` (Hz), ``on_result`` once per goal that was accepted, ``on_rest``
    once when the axes of a goal that is over rest (``GoalHandle.rested``). With a kernel in a
    process a thread watches; in a caller's own loop ``update`` must be called now and then between
    ``MotionKernel.step``.

    Of axes that wrap (``Axis.wrap``) the first way-point that is due chooses the turn, the nearest
    one to where the axis is when the motion begins; the others are relative to it.

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
        joint_names: Sequence[str] | None = None,
        *,
        axes: Sequence[int] | None = None,
        settings: Settings | None = None,
        feedback_rate: float = 20.0,
        clock: Callable[[], float] = time.time,
        on_feedback: Callable[[GoalHandle, GoalFeedback], None] | None = None,
        on_result: Callable[[GoalHandle], None] | None = None,
        on_rest: Callable[[GoalHandle], None] | None = None,
    ) -> None:
        """Raises InputError."""
        self._host, self._joints = host, Joints.of(host, joint_names, axes)
        self._settings = settings or Settings()
        self._every = 1.0 / positive("feedback_rate", feedback_rate)
        self._clock = clock
        self._on_feedback, self._on_result, self._on_rest = on_feedback, on_result, on_rest
        self._lock = threading.RLock()
        self._numbers = itertools.count(1)
        self._goal: AcceptedGoal | None = None
        self._braking: list[AcceptedGoal] = []  # over, and not known to rest
        self._sequencer = Sequencer(host)
        self._told = -np.inf
        self._closed = _CLOSED
        self._end, self._wake = threading.Event(), threading.Event()
        self._updating = threading.Lock()
        self._thread: threading.Thread | None = None
        if host.clocked:
            self._thread = threading.Thread(target=self._watch, daemon=True)
            self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self, reason: str = "") -> None:
        """End the goal that goes on, and watch no more; goals are refused from now on.

        It is CANCELED, or with a ``reason`` ABORTED (-1, with that text), and comes to rest on its
        path. ``on_rest`` is told by ``update`` only from then on.
        """
        self._closed = f"{_CLOSED}: {reason}" if reason else _CLOSED
        self._end.set()
        with self._lock:
            goal = self._goal
            if goal is not None and reason:
                self._finish(goal, GoalStatus.ABORTED, ResultCode.INVALID_GOAL, reason)
            elif goal is not None:
                self._finish(goal, GoalStatus.CANCELED, ResultCode.SUCCESSFUL, _CLOSED)
        self._wake.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()

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
            return self._refuse(handle, progress, ResultCode.INVALID_GOAL, self._closed)
        settings = self._settings
        for name, own in (("path_tolerance", path_tolerance), ("goal_tolerance", goal_tolerance)):
            check_tolerances(name, {} if own is None else own)
        try:
            if not isinstance(trajectory, Trajectory):
                trajectory, stamp = from_message(trajectory)
                progress.trajectory = trajectory
            stamp = real("stamp", stamp)
            frame = self._host.feedback()
            plan = planned(
                trajectory, settings, frame, self._joints, stamp=stamp, now=self._clock()
            )
            progress.plan, names = plan, trajectory.joint_names
            goal = AcceptedGoal(
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
        idle = self._joints.idle(self._host, frame, names)
        text = f"not active: {', '.join(idle)}" if idle else self._busy(frame, plan.axes)
        if text:
            return self._refuse(handle, progress, ResultCode.INVALID_GOAL, text)
        with self._lock:
            if self._end.is_set():  # closed meanwhile, and the goal would be watched no more
                return self._refuse(handle, progress, ResultCode.INVALID_GOAL, self._closed)
            before = self._goal
            if before is not None and before.status in OPEN:
                text = f"replaced by goal {progress.number}"
                goal.joins = True
                self._ended(before, GoalStatus.ABORTED, ResultCode.INVALID_GOAL, text)
            self._goal = goal
            self._sequencer.settle()
        self._wake.set()
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
        progress.rested.set()
        return handle

    def _busy(self, frame: Feedback, axes: Sequence[int]) -> str:
        """What is in the way of a path of these axes: one of others, else nothing."""
        path = self._sequencer.other(frame)
        return "" if path is None else self._joints.busy(path, axes)

    # ---- what goes on

    def update(self) -> None:
        """Look once: start what waits, watch tolerances, report feedback and results.

        A motion that is due is planned here; orders to goals, and new ones, need not wait for it.
        """
        if not self._updating.acquire(blocking=False):
            return  # another thread does, or this is its callback
        try:
            with self._lock:
                self._sequencer.update()
                goal, due = self._goal, None
                if goal is not None and goal.status in OPEN:
                    due = self._look(self._host.feedback())
                if self._braking:
                    self._tell_rest(self._host.feedback())
            if goal is not None and due is not None:
                self._begin(goal, due)
        finally:
            self._updating.release()

    def _watch(self) -> None:
        pause = min(self._every, 5e-3)
        while not self._end.is_set():
            self._wake.wait(pause)
            self._wake.clear()
            if self._host.closed:
                return
            try:
                self.update()
            except SjerkError as error:
                goal = self._goal
                if goal is not None and goal.status in OPEN:
                    text = self._joints.told(error)
                    self._ended(goal, GoalStatus.ABORTED, ResultCode.INVALID_GOAL, text)
                if self._host.closed or not self._host.kernel_lives:
                    return

    def _look(self, frame: Feedback) -> Place | Knot | None:
        """Where the motion of a goal that waits is to begin now; None: nowhere, or it has."""
        goal = self._goal
        assert goal is not None
        took_over = self._sequencer.verdict()
        if took_over is False and goal.status is GoalStatus.EXECUTING:
            goal.progress.status = GoalStatus.WAITING
        if goal.status is GoalStatus.WAITING:
            try:
                return None if took_over is None else self._due(goal, frame)
            except SjerkError as error:
                self._fail(goal, error)
                return None
        self._follow(goal, frame)
        return None

    def _follow(self, goal: AcceptedGoal, frame: Feedback) -> None:
        """Look at a goal whose motion is in play: report, watch tolerances, see its end."""
        feedback = self._feedback_of(goal, frame)
        goal.progress.feedback = feedback
        now = self._clock()
        if self._on_feedback is not None and now - self._told >= self._every * (1.0 - 1e-6):
            self._told = now
            self._on_feedback(goal.handle, feedback)
        path = self._sequencer.path
        assert path is not None
        state = path.state
        wrong = goal.off_path(feedback)
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
                text = f"{text}; {self._joints.told(error)}"
            self._ended(goal, GoalStatus.ABORTED, ResultCode.INVALID_GOAL, text)

    def _due(self, goal: AcceptedGoal, frame: Feedback) -> Place | Knot | None:
        """Its motion takes over from the one in play, or begins when that is at rest."""
        axes, sequencer = goal.plan.axes, self._sequencer
        sequencer.check()
        if sequencer.disturbed(axes):
            return None
        if sequencer.over or not goal.joins:
            busy = self._busy(frame, axes)
            if busy:
                self._ended(goal, GoalStatus.ABORTED, ResultCode.INVALID_GOAL, busy)
                return None
            return positions(frame, axes) if sequencer.rests(frame, axes) else None
        if goal.tries >= _TRIES or not sequencer.leads(axes):
            self._rest_first(goal)
            return None
        stamp = goal.plan.stamp
        ahead = max(0.0, stamp - self._clock()) if stamp else 0.0
        return None if ahead > sequencer.lead + _HORIZON else sequencer.place(ahead)

    def _begin(self, goal: AcceptedGoal, due: Place | Knot) -> None:
        """Plan its motion without the lock, and let it begin if that is still wanted."""
        joins = isinstance(due, Place)
        knot = due.cut.knot if isinstance(due, Place) else due
        later = due.lead * self._host.cycle_time if isinstance(due, Place) else 0.0
        error: SjerkError | None = None
        try:
            blocks = goal.plan.enter(knot, self._clock() + later).blocks
            blocks = itertools.chain([next(blocks)], blocks)
        except SjerkError as fault:
            error = fault
        with self._lock:
            if self._goal is not goal or goal.status is not GoalStatus.WAITING:
                return
            try:
                if error is not None:
                    raise error
                if self._sends(goal, due, blocks):
                    self._executes(goal)
            except SjerkError as fault:
                if joins and isinstance(fault, PlanError | InputError):
                    self._rest_first(goal)  # no motion from that state within the limits
                else:
                    self._fail(goal, fault)

    def _sends(self, goal: AcceptedGoal, due: Place | Knot, blocks: Iterator[Followed]) -> bool:
        """Whether the motion was sent; else the place is another one by now."""
        axes, sequencer = goal.plan.axes, self._sequencer
        if isinstance(due, Place):
            goal.tries += 1
            return due.path is sequencer.path and sequencer.join(blocks, due)
        frame = self._host.feedback()
        there = np.array_equal(positions(frame, axes).position, due.position)
        if not there or sequencer.disturbed(axes) or not sequencer.rests(frame, axes):
            return False
        sequencer.start(blocks, axes)
        return True

    def _rest_first(self, goal: AcceptedGoal) -> None:
        """Its motion begins once the one in play has come to rest."""
        goal.joins = False
        self._sequencer.cancel()

    def _fail(self, goal: AcceptedGoal, error: SjerkError) -> None:
        self._sequencer.cancel()
        text = self._joints.told(error)
        self._ended(goal, GoalStatus.ABORTED, ResultCode.INVALID_GOAL, text)

    def _executes(self, goal: AcceptedGoal) -> None:
        path = self._sequencer.path
        assert path is not None
        goal.progress.status = GoalStatus.EXECUTING
        if goal.settings.speed != path.factor:
            path.speed(goal.settings.speed)

    def _settle(self, goal: AcceptedGoal, feedback: GoalFeedback) -> None:
        """The command has arrived: the joints are within tolerance, or have time left."""
        wrong = goal.off_goal(feedback)
        if not wrong:
            self._ended(goal, GoalStatus.SUCCEEDED, ResultCode.SUCCESSFUL, "goal reached")
            return
        now = self._clock()
        if goal.settled_at is None:
            goal.settled_at = now
        elif goal.goal_time and now - goal.settled_at > goal.goal_time:
            text = f"goal tolerance, {goal.goal_time:g} s after the motion: {wrong}"
            code = ResultCode.GOAL_TOLERANCE_VIOLATED
            self._ended(goal, GoalStatus.ABORTED, code, text)

    def _feedback_of(self, goal: AcceptedGoal, frame: Feedback) -> GoalFeedback:
        plan, progress = goal.plan, self._sequencer.progress
        axes = [frame.axes[i] for i in plan.joint_axes]
        rows = [
            np.array([getattr(axis, name) for axis in axes])
            for name in ("position", "actual_position", "velocity", "actual_velocity")
        ]
        i = min(max(progress.point - self._sequencer.first, 0), len(plan.points) - 1)
        return GoalFeedback(
            goal.progress.trajectory.joint_names,
            plan.offset + self._sequencer.time(progress),
            int(plan.points[i]),
            progress.speed,
            plan.told(rows[0]),
            plan.told(rows[1]),
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

    def _finish(self, goal: AcceptedGoal, status: GoalStatus, code: ResultCode, text: str) -> None:
        """End a goal that goes on: its motion stops on the path."""
        with self._lock:
            if goal.status not in OPEN:
                return
            self._sequencer.cancel()
            self._ended(goal, status, code, text)

    def _ended(self, goal: AcceptedGoal, status: GoalStatus, code: ResultCode, text: str) -> None:
        goal.progress.end(status, code, text)
        self._braking.append(goal)
        if self._on_result is not None:
            self._on_result(goal.handle)

    def _tell_rest(self, frame: Feedback) -> None:
        """Goals that are over, once their axes rest or are another motion's."""
        newest, sequencer = self._goal, self._sequencer
        left = newest is not None and newest.status is GoalStatus.EXECUTING and sequencer.plays
        over = [
            goal
            for goal in self._braking
            if (left and goal is not newest) or sequencer.rests(frame, goal.plan.axes)
        ]
        for goal in over:
            self._braking.remove(goal)
            goal.progress.rested.set()
            if self._on_rest is not None:
                self._on_rest(goal.handle)
