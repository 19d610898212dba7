"""What a kernel publishes every cycle, to be read: axes, states, and the cycle-time report.

Never here: commands, equations, layouts.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from sjerk.cia402 import State as DriveState
from sjerk.clock import ClockReport


@dataclass(frozen=True)
class AxisFeedback:
    """One axis in one cycle; positions in axis units, time in seconds.

    ``position`` to ``jerk`` are the commanded sample, ``peak_*`` the largest magnitudes of it since
    the last goal came, ``actual_*`` the encoder's. ``settled``: the goal has been reached.
    ``following_error`` is the drive's own (60F4h,
    increments).
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
    moving: bool
    settled: bool
    follows: bool
    enabled: bool
    fault: bool

    @property
    def drive_state(self) -> DriveState:
        """The drive's state by its statusword."""
        return DriveState.of(self.statusword)


@dataclass(frozen=True)
class Distribution:
    """A duration over all cycles, seconds. Interpolated in buckets of 6 %; ``worst`` is exact."""

    count: int
    median: float
    p99: float
    p999: float
    worst: float

    @classmethod
    def of(cls, histogram: Any) -> Distribution:
        """Read a ``sj_histogram``."""
        count, worst = int(histogram.count), histogram.worst_ns * 1e-9
        cuts: list[float] = []
        buckets = list(histogram.bucket)
        for share in (0.5, 0.99, 0.999):
            below, value = 0, worst
            for i, n in enumerate(buckets):
                if n and below + n >= share * count:
                    octave, step = divmod(i, 16)
                    inside = (share * count - below) / n  # evenly within the bucket
                    value = 64e-9 * 2.0**octave * (1.0 + (step + inside) / 16.0)
                    break
                below += n
            cuts.append(min(value, worst))
        return cls(count, cuts[0], cuts[1], cuts[2], worst)


@dataclass(frozen=True)
class Timing:
    """The cycle-time report: wake-up latency, period, computing time, and skipped cycles."""

    latency: Distribution
    period: Distribution
    computing: Distribution
    late: int
    clock: ClockReport


class Feedback:
    """One frame of the kernel's feedback: all axes in the same cycle."""

    def __init__(self, frame: Any, cycle_time: float) -> None:
        """Not for callers: ``Host.feedback`` makes it from a private copy of the frame."""
        self._frame = frame
        self._cycle_time = cycle_time
        self.cycle = int(frame.cycle)
        self.time_ns = int(frame.time_ns)
        self.axes = tuple(_axis_feedback(frame.axis[i], cycle_time) for i in range(frame.axes))

    def __repr__(self) -> str:
        return f"Feedback(cycle={self.cycle}, axes={self.axes!r})"

    @property
    def moving(self) -> bool:
        """Whether any axis moves."""
        return any(axis.moving for axis in self.axes)

    @property
    def timing(self) -> Timing:
        """The cycle-time report up to this cycle."""
        frame = self._frame
        return Timing(
            Distribution.of(frame.latency),
            Distribution.of(frame.period),
            Distribution.of(frame.computing),
            int(frame.late),
            ClockReport.of(frame.clock),
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
        moving=bool(raw.moving),
        settled=bool(raw.settled),
        follows=bool(raw.follows),
        enabled=bool(raw.enabled),
        fault=bool(raw.fault),
    )
