"""How the motion of a goal is planned: its trajectory checked, its way-points chosen.

Never here: playing, watching, codes of results.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sjerk.executor.goal import Settings
from sjerk.executor.joints import Joints
from sjerk.executor.sequencer import counted
from sjerk.host import Feedback
from sjerk.host.turns import Turns, nearest_turns
from sjerk.profile import FloatArray
from sjerk.trajectory import ExecutionMode, FaultKind, Trajectory, TrajectoryError, resample
from sjerk.trajectory.entering import Entered, Entry
from sjerk.trajectory.segments import IntArray, Knot


@dataclass(eq=False)
class PlannedGoal:
    """How the motion of a goal is planned: of its axes in ascending order, along its way-points.

    ``joint_axes``: axis numbers in the trajectory's order of joints. ``chosen`` (m,): which of its
    way-points; ``wrap`` (N,): of the axes. ``offset`` (s): of its time that was over at the begin;
    ``points``: the way-point ahead in each segment of what was planned last; ``stretch``: cycles
    more than asked for, of it; ``turns``: of the axes, in it.
    """

    trajectory: Trajectory
    joint_axes: list[int]
    axes: list[int]
    way_points: Trajectory
    chosen: NDArray[np.intp]
    entry: Entry
    wrap: FloatArray
    stamp: float
    single: bool
    offset: float = 0.0
    stretch: int = 0
    points: IntArray = field(default_factory=lambda: np.zeros(1, dtype=np.int64))
    turns: Turns = field(init=False)

    def __post_init__(self) -> None:
        self.turns = Turns(np.zeros(len(self.wrap)), self.wrap)

    def enter(self, knot: Knot, begins: float) -> Entered:
        """From a state, at a time of the clock."""
        self.stretch = 0
        self.offset = max(0.0, begins - self.stamp) if self.stamp else 0.0
        elapsed = begins - self.stamp if self.stamp else 0.0
        # the first way-point whose time is not over, also where another is gone to
        time, columns = self.trajectory.time, [self.joint_axes.index(i) for i in self.axes]
        first = min(int(np.searchsorted(time, elapsed)), len(time) - 1)
        begin = self.trajectory.position[first, columns]
        self.turns = Turns.nearest(begin, knot.position, self.wrap)
        way = _with(self.way_points, position=self.turns.onto(self.way_points.position))
        made = self.entry.enter(way, knot, way.time[-1] if self.single else elapsed)
        self.points = self.chosen[made.points]
        made.blocks = counted(made.blocks, self._lose)
        return made

    def told(self, position: FloatArray) -> FloatArray:
        """Where axes are, in the turn of the trajectory: (N,), in its order of joints."""
        return self.turns.of([self.axes.index(i) for i in self.joint_axes]).back(position)

    def _lose(self, cycles: int) -> None:
        self.stretch += cycles


def planned(
    trajectory: Trajectory,
    settings: Settings,
    frame: Feedback,
    joints: Joints,
    *,
    stamp: float,
    now: float,
) -> PlannedGoal:
    """Check a trajectory, and how its motion will be planned; raises TrajectoryError.

    ``stamp`` and ``now`` (s) of one clock.
    """
    names = trajectory.joint_names
    known = joints.names
    if settings.allow_partial_joints:
        known = tuple(name for name in joints.names if name in names) or joints.names
    faults = list(
        trajectory.faults(
            joints=known,
            begins=now if stamp == 0.0 else stamp,
            now=now,
            end_velocity_allowed=True,
        )
    )
    if any(fault.kind is FaultKind.JOINTS for fault in faults):
        raise TrajectoryError(faults)
    joint_axes = [joints.axis(name) for name in names]
    axes = [frame.axes[i] for i in joint_axes]
    tolerance = settings.start_tolerance
    start = nearest_turns(trajectory.position[0], axes).back([axis.position for axis in axes])
    faults += [
        fault
        for fault in trajectory.faults(
            [axis.limits for axis in axes],
            start=None if tolerance is None else start,
            start_tolerance=tolerance or 1.0,
            end_velocity_allowed=settings.allow_end_velocity,
        )
        # accelerations are kept anyway; a stretch is reported
        if fault.kind is not FaultKind.ACCELERATION_LIMIT
    ]
    if faults:
        raise TrajectoryError(faults)
    single = settings.execution_mode is ExecutionMode.SINGLE_POINT
    chosen = np.arange(len(trajectory))
    if single:
        chosen = chosen[-1:]
    elif settings.resampling_delta:
        chosen = resample(trajectory.position, settings.resampling_delta)
    order = sorted(joint_axes)  # two goals of the same joints are then of the same axes
    return PlannedGoal(
        trajectory,
        joint_axes,
        order,
        _to_rest(trajectory.take(chosen).for_joints([joints.name(i) for i in order])),
        chosen,
        Entry(
            [frame.axes[i].limits for i in order],
            frame.cycle_time,
            settings.use_velocities,
            settings.tolerance,
        ),
        np.array([frame.axes[i].wrap for i in order]),
        stamp,
        single,
    )


def _to_rest(way: Trajectory) -> Trajectory:
    """The same, with velocity 0 at its end: a path ends at rest."""
    if way.velocity is None:
        return way
    velocity = way.velocity.copy()
    velocity[-1] = 0.0
    return _with(way, velocity=velocity)


def _with(
    way: Trajectory, *, position: FloatArray | None = None, velocity: FloatArray | None = None
) -> Trajectory:
    """The same, with these rows."""
    return Trajectory(
        way.joint_names,
        way.time,
        way.position if position is None else position,
        way.velocity if velocity is None else velocity,
        way.acceleration,
    )
