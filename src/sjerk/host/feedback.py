"""What a kernel publishes every cycle, to be read: axes, states, and the cycle-time report.

Never here: commands, equations, layouts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum, IntEnum, IntFlag
from typing import Any

from sjerk._binding import ffi, lib
from sjerk.cia402 import DriveState
from sjerk.cycle.states import AxisState
from sjerk.host.timing import ClockReport, Distribution, Timing
from sjerk.profile import Limits


class PathState(IntEnum):
    """What a path in the kernel does, or what has become of it."""

    SENT = lib.SJ_PATH_NONE  #: The kernel has not answered yet.
    RUNS = lib.SJ_PATH_RUNS  #: The axes move along the path.
    PAUSED = lib.SJ_PATH_PAUSED  #: The axes rest on the path: a pause, a feed hold, or speed 0.
    STARVES = lib.SJ_PATH_STARVES  #: The axes stop or rest on the path, because segments are late.
    STOPS = lib.SJ_PATH_STOPS  #: The axes come to rest on the path, and the rest of it is dropped.
    DONE = lib.SJ_PATH_DONE  #: The command is on the last way-point.
    STOPPED = lib.SJ_PATH_STOPPED  #: The axes rest on the path, and the rest of it is dropped.
    LEFT = lib.SJ_PATH_LEFT  #: A quick stop, a goal, or late segments took the axes off the path.
    REFUSED = 8  #: The kernel did not accept the path.
    SUPERSEDED = 9  #: Another path or goal took its place.

    @property
    def ended(self) -> bool:
        """Whether this state is the last one of a path.

        >>> [state.name for state in PathState if state.ended]
        ['DONE', 'STOPPED', 'LEFT', 'REFUSED', 'SUPERSEDED']
        """
        return self >= PathState.DONE


@dataclass(frozen=True)
class PathFeedback:
    """The path in play, or the last one, in one cycle.

    ``point``: the way-point ahead; ``time`` (s): passed since the one before, in the path's own
    time; ``speed``: 1 as planned; ``known``: the last way-point that the kernel has.
    """

    goal_id: int
    state: PathState
    axes: tuple[int, ...]
    point: int
    time: float
    speed: float
    known: int


class LimitSwitch(IntFlag):
    """Limit switches of an axis that are closed, as 60FDh has them."""

    NEGATIVE = lib.SJ_DI_NEGATIVE  #: The switch in negative direction of the motor is closed.
    POSITIVE = lib.SJ_DI_POSITIVE  #: The switch in positive direction of the motor is closed.


@dataclass(frozen=True)
class AxisFeedback:
    """One axis in one cycle; positions in axis units, time in seconds.

    ``position`` to ``jerk`` are the commanded sample, ``peak_*`` the largest magnitudes of it since
    the last goal came, ``actual_*`` the encoder's. ``settled``: the goal has been reached.
    ``following_error`` is the drive's own (60F4h, increments), of which ``counts_per_unit`` make
    one axis unit; ``digital_inputs`` its 60FDh. ``velocity_offset`` (60B1h) and ``torque_offset``
    (60B2h) are what the kernel feeds forward, in the drive's own units. ``limits`` are those in
    force, with the position limits; ``wrap`` axis units make one turn, 0 for none. ``name`` is ""
    where the axis has none.
    """

    position: float
    velocity: float
    acceleration: float
    jerk: float
    actual_position: float
    actual_velocity: float
    peak_velocity: float
    peak_acceleration: float
    peak_jerk: float
    goal: float
    goal_id: int
    target_counts: int
    actual_counts: int
    following_error: int
    statusword: int
    error_code: int
    digital_inputs: int
    velocity_offset: int
    torque_offset: int
    moving: bool
    settled: bool
    follows: bool
    enabled: bool
    fault: bool
    state: AxisState
    limits: Limits
    unit: str
    wrap: float
    name: str
    counts_per_unit: float

    @property
    def turned(self) -> float:
        """The commanded position within one turn, 0 .. ``wrap``; ``position`` without a wrap."""
        return self.position % self.wrap if self.wrap else self.position

    @property
    def limit_switches(self) -> LimitSwitch:
        """The limit switches that are closed; none is 0."""
        return switches_of(self)

    @property
    def drive_state(self) -> DriveState:
        """The drive's state by its statusword."""
        return DriveState.of(self.statusword)


@dataclass(frozen=True)
class AxisBus:
    """The drive of an axis, as the port that reaches it sees it.

    ``lost``: cycles without an answer of it, ``wrong``: those with another working counter,
    ``in_row``: the last ones. ``state``, ``code``: 0130h and 0134h on EtherCAT, 0 not known.
    """

    lost: int
    wrong: int
    in_row: int
    counter: int
    state: int
    code: int


@dataclass(frozen=True)
class BusFeedback:
    """The bus of external drives that the kernel's process exchanges.

    ``sent``, ``lost``, ``stray``: frames; ``phase``, ``worst_phase``, ``correction``: seconds, the
    cycle against the drives' clock; ``states``: of all ``present`` devices, joined by or;
    ``foreign``: another main device has taken the drives; ``axes``: by number.
    """

    sent: int
    lost: int
    stray: int
    phase: float
    worst_phase: float
    correction: float
    devices: int
    present: int
    states: int
    aligned: bool
    foreign: bool
    axes: dict[int, AxisBus]

    @classmethod
    def of(cls, frame: Any) -> BusFeedback | None:
        """Read a ``sj_feedback``; None where no port exchanges anything."""
        raw, ns = frame.bus, 1e-9
        if not raw.devices:
            return None
        rows = {i: frame.axis[i].bus for i in range(frame.axes) if frame.axis[i].bus.present}
        axes = {
            i: AxisBus(row.lost, row.wrong, row.in_row, row.counter, row.state, row.code)
            for i, row in rows.items()
        }
        return cls(
            raw.sent,
            raw.lost,
            raw.stray,
            raw.phase_ns * ns,
            raw.worst_ns * ns,
            raw.correction_ns * ns,
            raw.devices,
            raw.present,
            raw.states,
            bool(raw.aligned),
            bool(raw.foreign),
            axes,
        )


class KernelState(Enum):
    """Whether a kernel works, as seen from outside."""

    RUNNING = "running"  #: Its cycles go on.
    SUSPENDED = "suspended"  #: Its process is there, but its cycles have stopped to come.
    GONE = "gone"  #: Its process has ended.


class Feedback:
    """One frame of the kernel's feedback: all axes in the same cycle.

    ``age``: seconds from the begin of its cycle to its reading; None in a caller's own loop, which
    has no time. ``time_ns``: that begin, CLOCK_MONOTONIC. ``bus``: of external drives, or None.
    """

    def __init__(self, frame: Any, cycle_time: float, age: float | None = None) -> None:
        """Not for callers: ``Host.feedback`` makes it from a private copy of the frame."""
        self.age = age
        self._frame = frame
        self.cycle_time = cycle_time
        self.cycle = int(frame.cycle)
        self.time_ns = int(frame.time_ns)
        self.override = float(frame.override)
        self.hold = bool(frame.hold)
        self.axes = tuple(_axis_feedback(frame.axis[i], cycle_time) for i in range(frame.axes))
        self.path = _path_feedback(frame.path, cycle_time)
        self.bus = BusFeedback.of(frame)

    def __repr__(self) -> str:
        return f"Feedback(cycle={self.cycle}, axes={self.axes!r})"

    @property
    def moving(self) -> bool:
        """Whether any axis moves."""
        return any(axis.moving for axis in self.axes)

    @property
    def timing(self) -> Timing:
        """The cycle-time report from the kernel's start up to this cycle."""
        return self._timing(None)

    def timing_since(self, earlier: Feedback) -> Timing:
        """The cycle-time report of the cycles after ``earlier``, a frame of the same kernel."""
        return self._timing(earlier._frame)

    def _timing(self, since: Any) -> Timing:
        frame = self._frame
        latency, period, computing = (
            Distribution.of(getattr(frame, name), None if since is None else getattr(since, name))
            for name in ("latency", "period", "computing")
        )
        late = int(frame.late) - (0 if since is None else int(since.late))
        return Timing(latency, period, computing, late, ClockReport.of(frame.clock))


def switches_of(axis: Any) -> LimitSwitch:
    """The limit switches that are closed, of anything with ``digital_inputs`` (60FDh)."""
    return LimitSwitch(axis.digital_inputs & (LimitSwitch.NEGATIVE | LimitSwitch.POSITIVE))


def names_of(frame: Any) -> tuple[str, ...]:
    """The names of the axes of a ``sj_feedback``, by number; "" where there is none."""
    return tuple(ffi.string(frame.axis[i].name).decode() for i in range(frame.axes))


def limits_of(raw: Any, T: float) -> Limits:
    """The limits in force of a ``sj_axis_feedback``, per second."""
    own = raw.limits
    free = raw.position_min == -math.inf and raw.position_max == math.inf
    # what Limits.per_cycle makes of a jerk without a limit
    most = own.acceleration + own.deceleration
    jerk, braking = (math.inf if j == most else j / T**3 for j in (own.jerk, own.deceleration_jerk))
    return Limits(
        own.velocity / T,
        own.acceleration / T**2,
        jerk,
        deceleration=own.deceleration / T**2,
        deceleration_jerk=braking,
        position=None if free else (raw.position_min, raw.position_max),
    )


def _path_feedback(raw: Any, T: float) -> PathFeedback:
    return PathFeedback(
        goal_id=int(raw.goal_id),
        state=PathState(raw.state),
        axes=tuple(i for i in range(lib.SJ_AXES) if raw.axes >> i & 1),
        point=int(raw.number),
        time=raw.cycle * T,
        speed=raw.speed,
        known=int(raw.known),
    )


def _axis_feedback(raw: Any, T: float) -> AxisFeedback:
    return AxisFeedback(
        position=raw.position,
        velocity=raw.velocity / T,
        acceleration=raw.acceleration / T**2,
        jerk=raw.jerk / T**3,
        actual_position=raw.actual_position,
        actual_velocity=raw.actual_velocity / T,
        peak_velocity=raw.peak_velocity / T,
        peak_acceleration=raw.peak_acceleration / T**2,
        peak_jerk=raw.peak_jerk / T**3,
        goal=raw.goal,
        goal_id=raw.goal_id,
        target_counts=raw.target_counts,
        actual_counts=raw.actual_counts,
        following_error=raw.following_error,
        statusword=raw.statusword,
        error_code=raw.error_code,
        digital_inputs=raw.digital_inputs,
        velocity_offset=raw.velocity_offset,
        torque_offset=raw.torque_offset,
        moving=bool(raw.moving),
        settled=bool(raw.settled),
        follows=bool(raw.follows),
        enabled=bool(raw.enabled),
        fault=bool(raw.fault),
        state=AxisState(raw.state),
        limits=limits_of(raw, T),
        unit=ffi.string(raw.unit).decode(),
        wrap=raw.wrap,
        name=ffi.string(raw.name).decode(),
        counts_per_unit=raw.counts_per_unit,
    )
