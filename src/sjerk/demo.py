"""The main job: the paper's experiment (its Figures 6 and 7) on a recorded path.

A kernel with one Sigma-7 drive of 24 bits; the host moves it to the end of the path and records
what was commanded and what the encoder said.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

from sjerk.host import AxisFeedback, Distribution, Host, Timing
from sjerk.kernel import Axis, MotionKernel
from sjerk.profile import Limits
from sjerk.trajectory import Recording, read_recording

COUNTS_PER_DEGREE = 2**24 / 360.0
#: Panda joint 1 under the paper's velocity limit; half of each ramp is spent at jerk.
LIMITS = Limits.from_jerk_factor(
    velocity=90.0, acceleration=float(np.degrees(3.75)), jerk_factor=0.5
)
AFTER_S = 1.0


class Record:
    """Every cycle of one axis that the host saw; what it missed is counted."""

    def __init__(self) -> None:
        self.cycles: list[int] = []
        self.rows: list[AxisFeedback] = []

    def follow(self, host: Host, goal: float, still_s: float) -> None:
        """Record until the motion has been at rest for so many seconds; shows progress."""
        start = host.feedback().axes[0].position
        still_since: float | None = None
        shown = -1
        while still_since is None or time.monotonic() - still_since < still_s:
            feedback = host.feedback()
            if self.cycles and feedback.cycle == self.cycles[-1]:
                time.sleep(100e-6)
                continue
            axis = feedback.axes[0]
            self.cycles.append(feedback.cycle)
            self.rows.append(axis)
            if axis.moving or axis.goal != goal:
                still_since = None
            elif still_since is None:
                still_since = time.monotonic()
            share = int(10.0 * abs(axis.position - start) / (abs(goal - start) or 1.0)) * 10
            if share != shown:
                shown = share
                print(f"\rmoving: {share:3d} % {axis.position:9.3f} deg", end="", file=sys.stderr)
        print(file=sys.stderr)

    @property
    def missed(self) -> int:
        """Cycles between the first and the last that the host did not see."""
        return self.cycles[-1] - self.cycles[0] + 1 - len(self.cycles)

    def column(self, name: str) -> np.ndarray:
        """One field over all recorded cycles."""
        return np.array([getattr(row, name) for row in self.rows])


def run(path: Path, out: Path, cycle_time: float, joint: str | None) -> int:
    """Do the experiment; prints the table, writes the picture. Returns the exit code."""
    recording = read_recording(path, joint=joint)
    goal = float(recording.position[-1])
    axis = Axis(LIMITS, counts_per_unit=COUNTS_PER_DEGREE)
    print(
        f"{path.name}: joint {recording.joint}, {len(recording.time)} points over "
        f"{recording.time[-1]:.2f} s, ends at {goal:.3f} deg"
    )
    record = Record()
    with MotionKernel(axes=[axis], cycle_time=cycle_time) as kernel, kernel.host() as host:
        try:
            host.enable()
            start = float(recording.position[0])
            if start != 0.0:
                host.move(start).wait()
            move = host.move(goal)
            record.follow(host, goal, AFTER_S)
            move.wait(timeout=1.0)
            timing = host.feedback().timing
            host.disable()
        except KeyboardInterrupt:
            print("\nstopping along a jerk-limited ramp", file=sys.stderr)
            host.stop()
            at = host.feedback().axes[0]
            print(f"stopped at {at.position:.6f} deg, velocity {at.velocity:g} deg/s")
            return 130
    print(table(record, timing, goal, cycle_time))
    return draw(out, recording, record, cycle_time)


def table(record: Record, timing: Timing, goal: float, cycle_time: float) -> str:
    """The figures of the run."""
    last = record.rows[-1]
    moving = int(np.count_nonzero(record.column("moving")))
    error = last.actual_counts - round(goal * COUNTS_PER_DEGREE)
    lines = [
        f"cycles of {cycle_time * 1e6:g} us   {moving} in motion, {len(record.rows)} recorded, "
        f"{record.missed} not seen by the host",
        f"final error          {error} increments of 2^24 per revolution, {AFTER_S:g} s after the "
        "last set-point",
        f"commanded position   {last.position!r} deg, goal {goal!r} deg",
    ]
    for name, most, unit in (
        ("velocity", LIMITS.velocity, "deg/s"),
        ("acceleration", LIMITS.acceleration, "deg/s^2"),
        ("jerk", LIMITS.jerk, "deg/s^3"),
    ):
        peak = getattr(last, f"peak_{name}")
        lines.append(f"largest {name:12} {peak:.6f} of {most:.6f} {unit} ({peak / most:.2%})")
    lines.append("                     median      p99    p99.9    worst   (us)")
    for name, row in (
        ("period", timing.period),
        ("computing time", timing.computing),
        ("wake-up latency", timing.latency),
    ):
        lines.append(f"{name:18} {_us(row)}")
    lines.append(f"late                 {timing.late} cycles skipped of {timing.period.count + 1}")
    return "\n".join(lines)


def _us(row: Distribution) -> str:
    return " ".join(f"{1e6 * x:8.1f}" for x in (row.median, row.p99, row.p999, row.worst))


def draw(out: Path, recording: Recording, record: Record, cycle_time: float) -> int:
    """Write the picture, or say what is missing for it."""
    try:
        from sjerk.plot import Curve, panels
    except ImportError:
        print("no picture: matplotlib draws it (pip install 'sjerk[demo]')")
        return 0
    t = (np.array(record.cycles) - record.cycles[0]) * cycle_time
    content = {
        "position / deg": [
            Curve("recorded path", recording.time, recording.position, "."),
            Curve("commanded", t, record.column("position")),
            Curve("actual", t, record.column("actual_position"), "--"),
        ],
        "velocity / (deg/s)": [
            Curve("commanded", t, record.column("velocity")),
            Curve("actual", t, record.column("actual_velocity"), "--"),
        ],
        "acceleration / (deg/s^2)": [Curve("commanded", t, record.column("acceleration"))],
        "jerk / (deg/s^3)": [Curve("commanded", t, record.column("jerk"))],
    }
    limits = {
        "velocity / (deg/s)": LIMITS.velocity,
        "acceleration / (deg/s^2)": LIMITS.acceleration,
        "jerk / (deg/s^3)": LIMITS.jerk,
    }
    title = f"one move to the path's end, cycle {cycle_time * 1e6:g} us"
    panels(out, title, content, limits)
    print(f"picture: {out}")
    return 0
