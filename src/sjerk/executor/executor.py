"""Trajectories as goals: what an action server of FollowJointTrajectory wraps in a few lines.

``TrajectoryExecutor`` accepts or refuses a trajectory with the codes of
joint_trajectory_controller, plays it on a ``Host``, watches tolerances and tells how it goes.
``docs/explanation/trajectories.md`` has a server around it. Never here: planning, shared memory,
ROS.
"""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from sjerk.cycle.states import AxisState
from sjerk.errors import InputError, PlanError, SjerkError, positive, real
from sjerk.executor.course import Course, Joined, counted, positions
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
from sjerk.host.feedback import Feedback, PathState
from sjerk.host.host import Host
from sjerk.trajectory.entering import Entered, Entry
from sjerk.trajectory.segments import Knot
from sjerk.trajectory.trajectory import (
    ExecutionMode,
    FaultKind,
    Trajectory,
    TrajectoryError,
    resample,
)

#: A goal that is to begin later than this, in seconds, has its stamp from another clock.
FURTHEST = 3600.0
#: Seconds, beside those of planning, before the stamp of a goal in which its motion is planned.
_HORIZON = 0.2
#: How often a motion is planned to take over before the one in play is stopped instead.
_TRIES = 6


@dataclass(eq=False)
class Motion:
    """How the motion of a goal is planned: of its axes in their order, along its way-points.

    ``chosen`` (m,): which of the goal's; ``offset`` (s): of its time that was over at the begin.
    """

    axes: list[int]
    way: Trajectory
    chosen: NDArray[np.intp]
    entry: Entry
    stamp: float
    single: bool
    offset: float = 0.0

    def enter(self, knot: Knot, begins: float) -> Entered:
        """From a state, at a time of the clock."""
        self.offset = max(0.0, begins - self.stamp) if self.stamp else 0.0
        elapsed = begins - self.stamp if self.stamp else 0.0
        return self.entry.enter(self.way, knot, self.way.time[-1] if self.single else elapsed)


class GoalHandle:
    """One goal: how it goes, and the orders for it."""

    def __init__(self, executor: TrajectoryExecutor, number: int, trajectory: Any) -> None:
        """Not for callers: ``TrajectoryExecutor.submit`` makes it."""
        self._executor = executor
        self.number = number
        self.trajectory = trajectory
        self._status = GoalStatus.WAITING
        self._code, self._text = ResultCode.SUCCESSFUL, ""
        self._feedback: GoalFeedback | None = None
        self._ended = threading.Event()
        self._path_tolerance: list[Tolerance] = []
        self._goal_tolerance: list[Tolerance] = []
        self._goal_time = 0.0
        self._axes: list[int] = []
        self._settled_at: float | None = None
        self._motion: Motion | None = None
        self._settings = Settings()
        self._stretch = 0
        self._joins, self._tries = False, 0  # takes over from a motion in play

    @property
    def status(self) -> GoalStatus:
        """What has become of it."""
        return self._status

    @property
    def accepted(self) -> bool:
        """Whether it was not refused."""
        return self._status is not GoalStatus.REJECTED

    @property
    def code(self) -> ResultCode:
        """The result's code; SUCCESSFUL while it goes on."""
        return self._code

    @property
    def text(self) -> str:
        """The result's text, never empty once there is a result."""
        return self._text

    @property
    def feedback(self) -> GoalFeedback | None:
        """The newest feedback, at the executor's rate; None before the first."""
        return self._feedback

    @property
    def stretch(self) -> float:
        """Seconds more than its times ask for, of what was planned so far."""
        return self._stretch * self._executor._T

    def _lose(self, cycles: int) -> None:
        self._stretch += cycles

    def result(self, timeout: float | None = None) -> tuple[ResultCode, str]:
        """Wait for the end (with a kernel in a process); raises TimeoutError."""
        if not self._ended.wait(timeout):
            raise TimeoutError(f"goal {self.number}: not within {timeout} s")
        return self._code, self._text

    def cancel(self) -> None:
        """Stop on the path, jerk-limited, from the commanded state; CANCELED at once."""
        self._executor._finish(self, GoalStatus.CANCELED, ResultCode.SUCCESSFUL, "canceled")

    def pause(self) -> None:
        """Come to rest on the path and wait for ``resume``."""
        self._executor._order(self, "pause")

    def resume(self) -> None:
        """Go on along the path."""
        self._executor._order(self, "resume")

    def speed(self, factor: float) -> None:
        """Pass the path at another speed, 0 .. 2."""
        self._executor._order(self, "speed", factor)


class TrajectoryExecutor:
    """Plays trajectories on a host, one goal at a time; the newest replaces the one before.

    ``joint_names``: one str per axis of the kernel, in order. ``clock``: the time of ``stamp``, in
    seconds. ``on_feedback`` is called at ``feedback_rate`` (Hz), ``on_result`` once per goal. With
    a kernel in a process a thread watches; in a caller's own loop ``update`` must be called now and
    then between ``MotionKernel.step``.

    A new goal takes over from the motion of the one before, at its stamp or as soon as it can be,
    without a stop where limits allow; a goal that is canceled comes to rest on its path.
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
        if len(self._names) != host._axes or len(set(self._names)) != len(self._names):
            raise InputError(
                "joint_names", list(self._names), f"must be {host._axes} different names"
            )
        self._T = host._T
        self._settings = settings or Settings()
        self._every = 1.0 / positive("feedback_rate", feedback_rate)
        self._clock = clock
        self._on_feedback, self._on_result = on_feedback, on_result
        self._lock = threading.RLock()
        self._numbers = itertools.count(1)
        self._goal: GoalHandle | None = None
        self._course = Course(host)
        self._told = -np.inf
        self._end = threading.Event()
        self._thread: threading.Thread | None = None
        if host._cyclic:
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
            goal.cancel()

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
        handle = GoalHandle(self, next(self._numbers), trajectory)
        if self._end.is_set():
            return self._refuse(handle, ResultCode.INVALID_GOAL, _CLOSED)
        settings = self._settings
        for name, own in (("path_tolerance", path_tolerance), ("goal_tolerance", goal_tolerance)):
            check_tolerances(name, {} if own is None else own)
        try:
            if not isinstance(trajectory, Trajectory):
                trajectory, stamp = from_message(trajectory)
                handle.trajectory = trajectory
            self._prepare(handle, trajectory, settings, real("stamp", stamp))
            names = trajectory.joint_names
            handle._path_tolerance = tolerances(
                "path_tolerance", names, path_tolerance, settings.path_tolerance
            )
            handle._goal_tolerance = tolerances(
                "goal_tolerance", names, goal_tolerance, settings.goal_tolerance
            )
        except TrajectoryError as error:
            return self._refuse(handle, ResultCode(error.code), str(error))
        names = trajectory.joint_names
        if real("goal_time", goal_time) < 0.0:
            raise InputError("goal_time", goal_time, "must not be negative")
        handle._goal_time = goal_time or settings.goal_time
        ahead = stamp - self._clock()
        if ahead > FURTHEST:
            text = f"stamp {stamp!r}: {ahead:g} s ahead of the clock, more than {FURTHEST:g}"
            return self._refuse(handle, ResultCode.INVALID_GOAL, text)
        frame, orders = self._host.feedback(), self._host._command.axis
        idle = [
            name
            for i, (name, axis) in enumerate(zip(self._names, frame.axes, strict=True))
            if name in names and (not axis.follows or axis.state in _UNABLE or not orders[i].enable)
        ]
        if idle:
            text = f"not active: {', '.join(idle)}"
            return self._refuse(handle, ResultCode.INVALID_GOAL, text)
        with self._lock:
            if self._end.is_set():  # closed meanwhile, and the goal would be watched no more
                return self._refuse(handle, ResultCode.INVALID_GOAL, _CLOSED)
            before = self._goal
            if before is not None and before.status in OPEN:
                text = f"replaced by goal {handle.number}"
                handle._joins = True
                self._ended(before, GoalStatus.ABORTED, ResultCode.INVALID_GOAL, text)
            self._goal = handle
            self._look(frame)
        return handle

    def _refuse(self, handle: GoalHandle, code: ResultCode, text: str) -> GoalHandle:
        handle._status, handle._code, handle._text = GoalStatus.REJECTED, code, text
        handle._ended.set()
        return handle

    def _prepare(
        self, handle: GoalHandle, trajectory: Trajectory, settings: Settings, stamp: float
    ) -> None:
        """Check the trajectory, and how its motion will be planned; raises TrajectoryError."""
        names = trajectory.joint_names
        known: Sequence[str] = self._names
        if settings.allow_partial_joints:
            known = [name for name in self._names if name in names] or self._names
        frame = self._host.feedback()
        now = self._clock()
        begins = now if stamp == 0.0 else stamp
        faults = list(
            trajectory.faults(
                joints=known,
                begins=begins,
                now=now,
                end_velocity_allowed=settings.allow_end_velocity,
            )
        )
        if any(fault.kind is FaultKind.JOINTS for fault in faults):
            raise TrajectoryError(faults)
        handle._axes = [self._names.index(name) for name in names]
        axes = [frame.axes[i] for i in handle._axes]
        limits = [axis.limits for axis in axes]
        start = [axis.position for axis in axes]
        tolerance = settings.start_tolerance
        faults += [
            fault
            for fault in trajectory.faults(
                limits,
                start=None if tolerance is None else start,
                start_tolerance=tolerance or 1.0,
                end_velocity_allowed=True,
            )
            # accelerations are kept anyway; a stretch is told
            if fault.kind is not FaultKind.ACCELERATION_LIMIT
        ]
        if faults:
            raise TrajectoryError(faults)
        handle._settings = settings
        single = settings.execution_mode is ExecutionMode.SINGLE_POINT
        chosen = np.arange(len(trajectory))
        if single:
            chosen = chosen[-1:]
        elif settings.resampling_delta:
            chosen = resample(trajectory.position, settings.resampling_delta)
        order = sorted(handle._axes)  # two goals of the same joints are then of the same axes
        handle._motion = Motion(
            order,
            trajectory.take(chosen).for_joints([self._names[i] for i in order]),
            chosen,
            Entry(
                [frame.axes[i].limits for i in order],
                self._T,
                settings.use_velocities,
                settings.tolerance,
            ),
            stamp,
            single,
        )

    # ---- what goes on

    def update(self) -> None:
        """Look once: start what waits, watch tolerances, tell feedback and results."""
        with self._lock:
            self._course.update()
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
        took_over = self._course.verdict()
        if took_over is False and goal.status is GoalStatus.EXECUTING:
            goal._status = GoalStatus.WAITING
        if goal.status is GoalStatus.WAITING:
            if took_over is not None:
                self._begin(goal, frame)
            return
        told = self._feedback_of(goal, frame)
        goal._feedback = told
        if self._on_feedback is not None and self._clock() - self._told >= self._every * (
            1.0 - 1e-6
        ):
            self._told = self._clock()
            self._on_feedback(goal, told)
        assert self._course.path is not None
        state = self._course.path.state
        for k, limit in enumerate(goal._path_tolerance):
            wrong = violated(told, k, limit)
            if wrong:
                code = ResultCode.PATH_TOLERANCE_VIOLATED
                self._finish(goal, GoalStatus.ABORTED, code, f"path tolerance: {wrong}")
                return
        if state is PathState.DONE:
            self._settle(goal, told)
        elif state in (PathState.STOPPED, PathState.LEFT, PathState.REFUSED, PathState.SUPERSEDED):
            text = f"the kernel ended the motion: {state.name.lower()}"
            try:
                self._course.path._raise()
            except SjerkError as error:
                text = f"{text}; {error}"
            self._ended(goal, GoalStatus.ABORTED, ResultCode.INVALID_GOAL, text)

    def _begin(self, goal: GoalHandle, frame: Feedback) -> None:
        """Its motion takes over from the one in play, or begins when that is at rest."""
        assert goal._motion is not None
        axes = goal._motion.axes
        try:
            self._course.check()
            if goal._joins and not self._course.over:
                goal._joins = self._join(goal)
                if not goal._joins:
                    self._course.cancel()
            elif self._course.rests(frame, axes):
                made = goal._motion.enter(positions(frame, axes), self._clock())
                made.blocks = counted(made.blocks, goal._lose)
                self._course.start(made, axes)
                self._executes(goal)
        except SjerkError as error:
            self._course.cancel()
            self._ended(goal, GoalStatus.ABORTED, ResultCode.INVALID_GOAL, str(error))

    def _join(self, goal: GoalHandle) -> bool:
        """Whether its motion takes over, or will; else the one in play is to come to rest."""
        motion = goal._motion
        assert motion is not None
        if goal._tries >= _TRIES or not self._course.leads(motion.axes):
            return False
        now = self._clock()
        ahead = max(0.0, motion.stamp - now) if motion.stamp else 0.0
        if ahead > self._course.lead + _HORIZON:
            return True

        def make(knot: Knot, ahead: float) -> Entered:
            goal._stretch = 0
            made = motion.enter(knot, now + ahead)
            made.blocks = counted(made.blocks, goal._lose)
            return made

        try:
            joined = self._course.join(make, ahead)
        except (PlanError, InputError):
            return False  # no way from that state within the limits; from rest there may be one
        goal._tries += joined is not Joined.END
        if joined is Joined.SENT:
            self._executes(goal)
        return True

    def _executes(self, goal: GoalHandle) -> None:
        path = self._course.path
        assert path is not None
        goal._status = GoalStatus.EXECUTING
        if goal._settings.speed != path._speed:
            path.speed(goal._settings.speed)

    def _settle(self, goal: GoalHandle, told: GoalFeedback) -> None:
        """The command has arrived: the joints are within tolerance, or have time left."""
        wrong = [w for k, t in enumerate(goal._goal_tolerance) if (w := violated(told, k, t))]
        checked = any(tolerance != Tolerance() for tolerance in goal._goal_tolerance)
        fast = np.flatnonzero(np.abs(told.actual_velocity) > goal._settings.stopped_velocity)
        if checked and len(fast):
            k = int(fast[0])
            speed = told.actual_velocity[k]
            wrong.append(f"joint {told.joint_names[k]}: velocity {speed:g} is not rest")
        if not wrong:
            self._ended(goal, GoalStatus.SUCCEEDED, ResultCode.SUCCESSFUL, "goal reached")
            return
        now = self._clock()
        if goal._settled_at is None:
            goal._settled_at = now
        elif goal._goal_time and now - goal._settled_at > goal._goal_time:
            text = f"goal tolerance, {goal._goal_time:g} s after the motion: {wrong[0]}"
            code = ResultCode.GOAL_TOLERANCE_VIOLATED
            self._ended(goal, GoalStatus.ABORTED, code, text)

    def _feedback_of(self, goal: GoalHandle, frame: Feedback) -> GoalFeedback:
        axes = [frame.axes[i] for i in goal._axes]
        rows = [
            np.array([getattr(axis, name) for axis in axes])
            for name in ("position", "actual_position", "velocity", "actual_velocity")
        ]
        progress, motion = self._course.progress, goal._motion
        assert motion is not None
        ahead = min(max(self._course.ahead(progress), 0), len(motion.chosen) - 1)
        return GoalFeedback(
            goal.trajectory.joint_names,
            motion.offset + self._course.time(progress),
            int(motion.chosen[ahead]),
            progress.speed,
            rows[0],
            rows[1],
            rows[0] - rows[1],
            rows[2],
            rows[3],
        )

    # ---- orders

    def _order(self, goal: GoalHandle, name: str, *values: float) -> None:
        with self._lock:
            if goal is self._goal and goal.status is GoalStatus.EXECUTING:
                getattr(self._course.path, name)(*values)

    def _finish(self, goal: GoalHandle, status: GoalStatus, code: ResultCode, text: str) -> None:
        """End a goal that goes on: its motion stops on the path."""
        with self._lock:
            if goal.status not in OPEN:
                return
            self._course.cancel()
            self._ended(goal, status, code, text)

    def _ended(self, goal: GoalHandle, status: GoalStatus, code: ResultCode, text: str) -> None:
        goal._status, goal._code, goal._text = status, code, text
        goal._ended.set()
        if self._on_result is not None:
            self._on_result(goal)


_CLOSED = "the executor is closed"
_UNABLE = (AxisState.DISABLED, AxisState.ERROR_STOP, AxisState.STOPPING, AxisState.HOMING)
