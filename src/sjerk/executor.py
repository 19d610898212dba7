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
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum, IntEnum
from typing import Any, Self

import numpy as np

from sjerk.errors import InputError, SjerkError, positive, real
from sjerk.feedback import Feedback, PathState
from sjerk.following import Followed, follow
from sjerk.host import Host
from sjerk.joining import Knot, join
from sjerk.path import Path
from sjerk.profile import FloatArray, Limits
from sjerk.states import AxisState
from sjerk.thinning import follow_within
from sjerk.trajectory import (
    ExecutionMode,
    Fault,
    FaultKind,
    Trajectory,
    TrajectoryError,
    resample,
)

#: A goal that is to begin later than this, in seconds, has its stamp from another clock.
FURTHEST = 3600.0
#: Closer to its first way-point a motion needs no ramp; axis units.
_THERE = 1e-9


class ResultCode(IntEnum):
    """FollowJointTrajectory's error codes."""

    SUCCESSFUL = 0
    INVALID_GOAL = -1
    INVALID_JOINTS = -2
    OLD_HEADER_TIMESTAMP = -3
    PATH_TOLERANCE_VIOLATED = -4
    GOAL_TOLERANCE_VIOLATED = -5


class GoalStatus(Enum):
    """What has become of a goal; the last four are final."""

    WAITING = "waiting"  #: for the motion before to come to rest
    EXECUTING = "executing"
    SUCCEEDED = "succeeded"
    CANCELED = "canceled"
    ABORTED = "aborted"
    REJECTED = "rejected"


_OPEN = (GoalStatus.WAITING, GoalStatus.EXECUTING)


@dataclass(frozen=True)
class Tolerance:
    """How far a joint's actual position and velocity may be from the commanded ones.

    Axis units, per second. 0: as the executor has it, and there unchecked; -1: unchecked.
    """

    position: float = 0.0
    velocity: float = 0.0

    def __post_init__(self) -> None:
        for name in ("position", "velocity"):
            value = real(name, getattr(self, name))
            if value < 0.0 and value != -1.0:
                raise InputError(name, value, "must not be negative, but for -1")

    def over(self, default: Tolerance) -> Tolerance:
        """These, with the default's where they are 0."""
        return Tolerance(self.position or default.position, self.velocity or default.velocity)


@dataclass(frozen=True, eq=False)
class GoalFeedback:
    """Where the joints of a goal are, in its trajectory's order of joints.

    ``time`` (s): of the trajectory's own clock, stretches included; ``point``: the way-point ahead.
    ``desired`` is commanded, ``actual`` the encoder's, ``error`` their difference: (N,) each.
    """

    joint_names: tuple[str, ...]
    time: float
    point: int
    speed: float
    desired: FloatArray
    actual: FloatArray
    error: FloatArray
    desired_velocity: FloatArray
    actual_velocity: FloatArray


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
        self._ways: Callable[[FloatArray, float], Iterator[Followed]] | None = None
        self._settings = Settings()
        self._stretch = 0

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


@dataclass(frozen=True)
class Settings:
    """What holds for goals from the next one on: ``TrajectoryExecutor.settings``.

    ``execution_mode``: every way-point, or only the last by one planned motion.
    ``resampling_delta`` (axis units): way-points nearer to the next one kept are left out; 0: none
    are. ``speed``: 0 .. 2, as ``GoalHandle.speed``. ``use_velocities``: those of the trajectory, or
    ones chosen so that the jerk is constant. ``tolerance`` (axis units): way-points, dense ones
    above all, are passed so near (``follow_within``); 0: met. Tolerances by joint; ``goal_time``
    (s) that the joints may take to come within the goal's after the motion, 0: for ever, also where
    they cannot come so near; then only ``cancel`` or another goal ends it. ``stopped_velocity``
    that counts as rest. ``start_tolerance``: a first way-point at time 0 further away is refused;
    None: it is gone to first.
    """

    execution_mode: ExecutionMode = ExecutionMode.FULL_TRAJECTORY
    resampling_delta: float = 0.0
    speed: float = 1.0
    use_velocities: bool = False
    tolerance: float = 0.0
    allow_partial_joints: bool = False
    allow_end_velocity: bool = False
    path_tolerance: Mapping[str, Tolerance] = field(default_factory=dict)
    goal_tolerance: Mapping[str, Tolerance] = field(default_factory=dict)
    goal_time: float = 0.0
    stopped_velocity: float = 0.01
    start_tolerance: float | None = None

    def __post_init__(self) -> None:
        try:
            mode = ExecutionMode(self.execution_mode)
        except ValueError as fault:
            known = ", ".join(mode.value for mode in ExecutionMode)
            raise InputError("execution_mode", self.execution_mode, f"must be {known}") from fault
        object.__setattr__(self, "execution_mode", mode)
        for name in ("resampling_delta", "tolerance", "goal_time", "stopped_velocity"):
            if real(name, getattr(self, name)) < 0.0:
                raise InputError(name, getattr(self, name), "must not be negative")
        if not 0.0 <= real("speed", self.speed) <= 2.0:
            raise InputError("speed", self.speed, "must lie in 0 .. 2")
        for name in ("path_tolerance", "goal_tolerance"):
            _check_tolerances(name, getattr(self, name))
        if self.start_tolerance is not None:
            positive("start_tolerance", self.start_tolerance)


class TrajectoryExecutor:
    """Plays trajectories on a host, one goal at a time; the newest replaces the one before.

    ``joint_names``: one str per axis of the kernel, in order. ``clock``: the time of ``stamp``, in
    seconds. ``on_feedback`` is called at ``feedback_rate`` (Hz), ``on_result`` once per goal. With
    a kernel in a process a thread watches; in a caller's own loop ``update`` must be called now and
    then between ``MotionKernel.step``.

    A goal that is replaced or canceled comes to rest on its path; the next one begins from there.
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
        self._path: Path | None = None
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
        if goal is not None and goal.status in _OPEN:
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
        aborts the one before. Raises InputError for options that are none.
        """
        handle = GoalHandle(self, next(self._numbers), trajectory)
        if self._end.is_set():
            return self._refuse(handle, ResultCode.INVALID_GOAL, _CLOSED)
        settings = self._settings
        for name, own in (("path_tolerance", path_tolerance), ("goal_tolerance", goal_tolerance)):
            _check_tolerances(name, {} if own is None else own)
        try:
            if not isinstance(trajectory, Trajectory):
                trajectory, stamp = from_message(trajectory)
                handle.trajectory = trajectory
            self._prepare(handle, trajectory, settings, real("stamp", stamp))
            names = trajectory.joint_names
            handle._path_tolerance = _tolerances(
                "path_tolerance", names, path_tolerance, settings.path_tolerance
            )
            handle._goal_tolerance = _tolerances(
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
            if before is not None and before.status in _OPEN:
                text = f"replaced by goal {handle.number}"
                self._finish(before, GoalStatus.ABORTED, ResultCode.INVALID_GOAL, text)
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
        if settings.execution_mode is ExecutionMode.SINGLE_POINT:
            chosen = trajectory.take([len(trajectory) - 1])
        elif settings.resampling_delta:
            chosen = trajectory.take(resample(trajectory.position, settings.resampling_delta))
        else:
            chosen = trajectory
        single = settings.execution_mode is ExecutionMode.SINGLE_POINT

        def ways(at: FloatArray, now: float) -> Iterator[Followed]:
            if single:
                return iter([replace(self._ramp(at, chosen.position[-1], limits), first=0)])
            elapsed = now - stamp if stamp else 0.0
            return self._ways(chosen, at, elapsed, limits, settings)

        handle._ways = ways

    def _ramp(self, start: FloatArray, end: FloatArray, limits: Sequence[Limits]) -> Followed:
        return join(Knot.rest(start), end, limits, self._T)

    def _ways(
        self,
        way: Trajectory,
        at: FloatArray,
        elapsed: float,
        limits: Sequence[Limits],
        settings: Settings,
    ) -> Iterator[Followed]:
        """From rest at ``at`` onto the way-points whose time is not over, and along them."""
        left = way.take(np.arange(int(np.searchsorted(way.time, max(elapsed, 0.0))), len(way)))
        ahead = float(left.time[0]) - elapsed
        blocks: list[Iterator[Followed]] = []
        velocity = None if left.velocity is None else left.velocity.copy()
        moments, position = left.time - left.time[0], left.position.copy()
        there = bool((np.abs(position[0] - at) <= _THERE).all())
        if ahead >= 2.0 * self._T and not there:
            moments = np.concatenate([[0.0], moments + ahead])
            position = np.vstack([at, position])
            velocity = None if velocity is None else np.vstack([np.zeros_like(at), velocity])
        else:
            if not there:
                blocks.append(iter([self._ramp(at, position[0], limits)]))
            elif ahead >= self._T:
                blocks.append(iter([_dwell(at, int(ahead / self._T), self._T)]))
                position[0] = at
            else:
                position[0] = at
            if velocity is not None:
                velocity[0] = 0.0
        if len(position) > 1:
            body = Trajectory(way.joint_names, moments, position, velocity)
            if settings.tolerance:
                near = follow_within(body, limits, self._T, tolerance=settings.tolerance)
                blocks.append(iter(near.blocks))
            else:
                given = settings.use_velocities
                blocks.append(follow(body, limits, self._T, use_velocities=given))
        elif not blocks:
            blocks.append(iter([_dwell(at, 1, self._T)]))
        return _numbered(itertools.chain(*blocks), way.joint_names)

    # ---- what goes on

    def update(self) -> None:
        """Look once: start what waits, watch tolerances, tell feedback and results."""
        if self._path is not None and not self._host._cyclic:
            self._path.pump()
        with self._lock:
            if self._goal is not None and self._goal.status in _OPEN:
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
                if goal is not None and goal.status in _OPEN:
                    self._ended(goal, GoalStatus.ABORTED, ResultCode.INVALID_GOAL, str(error))
                if self._host.closed or not self._host.kernel_lives:
                    return

    def _look(self, frame: Feedback) -> None:
        goal = self._goal
        assert goal is not None
        if goal.status is GoalStatus.WAITING:
            if not any(frame.axes[i].moving for i in goal._axes) and self._over():
                self._start(goal, frame)
            return
        told = self._feedback_of(goal, frame)
        goal._feedback = told
        if self._on_feedback is not None and self._clock() - self._told >= self._every * (
            1.0 - 1e-6
        ):
            self._told = self._clock()
            self._on_feedback(goal, told)
        assert self._path is not None
        state = self._path.state
        for k, limit in enumerate(goal._path_tolerance):
            wrong = _violated(told, k, limit)
            if wrong:
                code = ResultCode.PATH_TOLERANCE_VIOLATED
                self._finish(goal, GoalStatus.ABORTED, code, f"path tolerance: {wrong}")
                return
        if state is PathState.DONE:
            self._settle(goal, told)
        elif state in (PathState.STOPPED, PathState.LEFT, PathState.REFUSED, PathState.SUPERSEDED):
            text = f"the kernel ended the motion: {state.name.lower()}"
            try:
                self._path._raise()
            except SjerkError as error:
                text = f"{text}; {error}"
            self._ended(goal, GoalStatus.ABORTED, ResultCode.INVALID_GOAL, text)

    def _over(self) -> bool:
        """Whether the path of the goal before is at its end."""
        ended = (
            PathState.DONE,
            PathState.STOPPED,
            PathState.LEFT,
            PathState.REFUSED,
            PathState.SUPERSEDED,
        )
        return self._path is None or self._path.state in ended

    def _start(self, goal: GoalHandle, frame: Feedback) -> None:
        at = np.array([frame.axes[i].position for i in goal._axes])
        assert goal._ways is not None
        try:
            blocks = self._counted(goal, goal._ways(at, self._clock()))
            self._path = self._host.follow(blocks, axes=goal._axes)
            if goal._settings.speed != 1.0:
                self._path.speed(goal._settings.speed)
        except SjerkError as error:
            self._ended(goal, GoalStatus.ABORTED, ResultCode.INVALID_GOAL, str(error))
            return
        goal._status = GoalStatus.EXECUTING

    def _counted(self, goal: GoalHandle, blocks: Iterator[Followed]) -> Iterator[Followed]:
        for block in blocks:
            goal._stretch += int(block.stretch.sum())
            yield block

    def _settle(self, goal: GoalHandle, told: GoalFeedback) -> None:
        """The command has arrived: the joints are within tolerance, or have time left."""
        wrong = [w for k, t in enumerate(goal._goal_tolerance) if (w := _violated(told, k, t))]
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
        assert self._path is not None
        progress = self._path.progress
        return GoalFeedback(
            goal.trajectory.joint_names,
            progress.time,
            progress.point,
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
                assert self._path is not None
                getattr(self._path, name)(*values)

    def _finish(self, goal: GoalHandle, status: GoalStatus, code: ResultCode, text: str) -> None:
        """End a goal that goes on: its motion stops on the path."""
        with self._lock:
            if goal.status not in _OPEN:
                return
            if goal.status is GoalStatus.EXECUTING and self._path is not None:
                self._path.cancel()
            self._ended(goal, status, code, text)

    def _ended(self, goal: GoalHandle, status: GoalStatus, code: ResultCode, text: str) -> None:
        goal._status, goal._code, goal._text = status, code, text
        goal._ended.set()
        if self._on_result is not None:
            self._on_result(goal)


_CLOSED = "the executor is closed"
_UNABLE = (AxisState.DISABLED, AxisState.ERROR_STOP, AxisState.STOPPING, AxisState.HOMING)


def from_message(message: Any) -> tuple[Trajectory, float]:
    """A JointTrajectory message as a trajectory, and its stamp in seconds; no ROS needed.

    Fields as in trajectory_msgs: ``joint_names``, ``points`` with ``positions``, ``velocities``,
    ``accelerations`` and ``time_from_start``, and ``header.stamp``. Raises TrajectoryError, and
    InputError for what is no such message.
    """
    _has("trajectory", message, ("joint_names", "points", "header"))
    names, points = list(message.joint_names), list(message.points)
    faults = [] if points else [Fault(FaultKind.EMPTY, "no points")]
    for i, point in enumerate(points):
        _has(f"trajectory.points[{i}]", point, _POINT)
        for kind in ("positions", "velocities", "accelerations"):
            size = len(getattr(point, kind))
            if size != len(names) and (size or kind == "positions"):
                faults.append(Fault(FaultKind.SIZE, f"{size} {kind} for {len(names)} joints", i))
    if faults:
        raise TrajectoryError(faults)
    moments = [p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in points]
    rows = [np.array([p.positions for p in points], dtype=np.float64)]
    for kind in ("velocities", "accelerations"):
        values = [getattr(p, kind) for p in points]
        rows.append(np.array(values) if all(map(len, values)) else None)  # type: ignore[arg-type]
    stamp = message.header.stamp
    return Trajectory(names, moments, *rows), stamp.sec + 1e-9 * stamp.nanosec


_POINT = ("positions", "velocities", "accelerations", "time_from_start")


def _has(field: str, value: object, names: Sequence[str]) -> None:
    for name in names:
        if not hasattr(value, name):
            what = f"has no {name}: must be a Trajectory, or a message with its fields"
            raise InputError(field, value, what)


def _check_tolerances(field: str, given: object) -> None:
    if not isinstance(given, Mapping):
        raise InputError(field, given, "must map joint names to Tolerance")
    for name, value in given.items():
        if not isinstance(value, Tolerance):
            raise InputError(f"{field}[{name!r}]", value, "must be a Tolerance")


def _tolerances(
    field: str,
    names: Sequence[str],
    own: Mapping[str, Tolerance] | None,
    default: Mapping[str, Tolerance],
) -> list[Tolerance]:
    """One per joint, in order; a joint that the goal does not have is an invalid goal."""
    unknown = [
        Fault(FaultKind.JOINTS, f"{field} of no joint of the goal", joint=name)
        for name in own or {}
        if name not in names
    ]
    if unknown:
        raise TrajectoryError(unknown)
    return [(own or {}).get(n, Tolerance()).over(default.get(n, Tolerance())) for n in names]


def _violated(told: GoalFeedback, k: int, limit: Tolerance) -> str:
    """What is out of tolerance at joint k, or nothing."""
    velocity = told.desired_velocity[k] - told.actual_velocity[k]
    for name, error, most in (
        ("position", told.error[k], limit.position),
        ("velocity", velocity, limit.velocity),
    ):
        if most > 0.0 and not abs(error) <= most:
            return f"joint {told.joint_names[k]}: {name} off by {error:g}, more than {most:g}"
    return ""


def _dwell(at: FloatArray, cycles: int, T: float) -> Followed:
    """Rest for so many cycles."""
    return Followed(
        tuple(map(str, range(len(at)))),
        T,
        0,
        0,
        np.array([cycles]),
        np.zeros(1, dtype=np.int64),
        np.array([[cycles, 0, 0, 0]]),
        np.zeros((1, 4, len(at))),
        np.repeat(at[None], 2, axis=0),
        *(np.zeros((2, len(at))) for _ in range(3)),
    )


def _numbered(blocks: Iterator[Followed], names: tuple[str, ...]) -> Iterator[Followed]:
    """Blocks that follow each other as one motion."""
    first = cycle = 0
    for block in blocks:
        yield replace(block, joint_names=names, first=first, first_cycle=cycle)
        first += len(block)
        cycle += int(block.cycles.sum())
