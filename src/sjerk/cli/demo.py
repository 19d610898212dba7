"""The main job: the paper's experiment (its Figures 6 and 7) on a recorded path.

A kernel with one Sigma-7 drive of 24 bits. First the host moves it to the end of the path in one
move, then it streams every recorded point at its time: each interrupting the motion before, as the
paper's control node does; with look-ahead that can always stop on the last one; and with look-ahead
that trusts the stream. Recorded is what was commanded and what the encoder said.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Generator, Iterator
from contextlib import closing
from pathlib import Path

import numpy as np

from sjerk.errors import InputError
from sjerk.executor.playing import StreamPlayer
from sjerk.host.feedback import AxisFeedback
from sjerk.host.host import Host
from sjerk.host.timing import Distribution, Timing
from sjerk.kernel.kernel import Axis, MotionKernel
from sjerk.profile import FloatArray, Limits
from sjerk.trajectory.trajectory import Recording, read_recording

COUNTS_PER_DEGREE = 2**24 / 360.0
#: Panda joint 1 under the paper's velocity limit; half of each ramp is spent at jerk.
LIMITS = Limits.from_jerk_factor(
    velocity=90.0, acceleration=float(np.degrees(3.75)), jerk_factor=0.5
)
AFTER_S = 1.0
#: Goal periods of the recording that look-ahead is behind it.
DELAY = 4
#: How long before it is due a piece is sent: a busy machine holds a host up.
AHEAD_S = 0.1
#: A dip: the speed falls by more than this share and rises again.
DIP = 0.1


class Record:
    """Every cycle of one axis that the host saw; what it missed is counted."""

    def __init__(self, label: str) -> None:
        self.label = label
        self.cycles: list[int] = []
        self.rows: list[AxisFeedback] = []
        self.peak_velocity = self.peak_acceleration = self.peak_jerk = 0.0

    def follow(self, host: Host, goals: Iterator[float], end: float) -> None:
        """Record until the motion has rested at ``end`` for a while; shows progress.

        ``goals`` is asked in every turn: it commands what is due and gives the newest goal.
        """
        before = host.feedback().axes[0]
        start = before.position
        still_since: float | None = None
        shown = -1
        while still_since is None or time.monotonic() - still_since < AFTER_S:
            goal = next(goals)
            feedback = host.feedback()
            if self.cycles and feedback.cycle == self.cycles[-1]:
                time.sleep(100e-6)
                continue
            axis = feedback.axes[0]
            self._add(feedback.cycle, axis, axis.goal_id > before.goal_id)
            if goal != end or axis.position != end or axis.moving:
                still_since = None
            elif still_since is None:
                still_since = time.monotonic()
            share = int(10.0 * abs(axis.position - start) / (abs(end - start) or 1.0)) * 10
            if share != shown:
                shown = share
                line = f"\r{self.label}: {share:3d} % {axis.position:9.3f} deg"
                print(line, end="", file=sys.stderr)
        print(file=sys.stderr)

    def _add(self, cycle: int, axis: AxisFeedback, ours: bool) -> None:
        self.cycles.append(cycle)
        self.rows.append(axis)
        if not ours:
            return
        # the kernel keeps the peaks of every cycle of a goal, also of those not seen here
        self.peak_velocity = max(self.peak_velocity, axis.peak_velocity)
        self.peak_acceleration = max(self.peak_acceleration, axis.peak_acceleration)
        self.peak_jerk = max(self.peak_jerk, axis.peak_jerk)

    @property
    def missed(self) -> int:
        """Cycles between the first and the last that the host did not see."""
        return self.cycles[-1] - self.cycles[0] + 1 - len(self.cycles)

    def column(self, name: str) -> FloatArray:
        """One field over all recorded cycles."""
        return np.array([getattr(row, name) for row in self.rows], dtype=np.float64)


def dips(velocity: FloatArray) -> int:
    """How often the speed falls by more than a tenth of its last peak and rises again."""
    count, peak, trough, falling = 0, 0.0, 0.0, False
    for speed in np.abs(velocity):
        if falling:
            trough = min(trough, speed)
            if speed > trough + DIP * peak:
                count, peak, falling = count + 1, speed, False
        else:
            peak = max(peak, speed)
            if speed < (1.0 - DIP) * peak:
                trough, falling = speed, True
    return count


def single_move(host: Host, goal: float) -> Iterator[float]:
    """Command the end of the path once."""
    host.move(goal)
    while True:
        yield goal


def streamed(host: Host, recording: Recording) -> Iterator[float]:
    """Command each recorded point at its time."""
    start = time.monotonic()
    for due, goal in zip(recording.time[1:], recording.position[1:], strict=True):
        host.move(float(goal))
        while time.monotonic() - start < due:
            yield float(goal)
    while True:
        yield float(recording.position[-1])


def ahead(host: Host, recording: Recording, *, stop_within: bool) -> Generator[float, None, None]:
    """Hand each recorded point at its time to a stream with look-ahead."""
    period = float(np.median(np.diff(recording.time)))
    with StreamPlayer(
        host, period=period, delay=DELAY, ahead=AHEAD_S, stop_within=stop_within
    ) as player:
        start = time.monotonic()
        for due, goal in zip(recording.time[1:], recording.position[1:], strict=True):
            player.push([float(goal)], float(due))
            while time.monotonic() - start < due:
                yield float(goal)
        player.end()
        while not player.done:
            yield float("nan")
        while True:
            yield float(recording.position[-1])


def run(path: Path, out: Path, cycle_time: float, joint: str | None) -> int:
    """Do the experiment; prints the table, writes the picture. Returns the exit code."""
    _check_picture(out)
    recording = read_recording(path, joint=joint)
    start, end = float(recording.position[0]), float(recording.position[-1])
    axis = Axis(LIMITS, counts_per_unit=COUNTS_PER_DEGREE)
    print(
        f"{path.name}: joint {recording.joint}, {len(recording.time)} points over "
        f"{recording.time[-1]:.2f} s, ends at {end:.3f} deg"
    )
    single, stream = Record("one move"), Record("interrupted")
    within, trusted = Record("stop within"), Record("look-ahead")
    records = (single, stream, within, trusted)
    with MotionKernel(axes=[axis], cycle_time=cycle_time) as kernel, kernel.host() as host:
        try:
            host.enable()
            host.move(start).wait()
            single.follow(host, single_move(host, end), end)
            host.move(start).wait()
            stream.follow(host, streamed(host, recording), end)
            for record in (within, trusted):
                host.move(start).wait()
                goals = ahead(host, recording, stop_within=record is within)
                with closing(goals):
                    record.follow(host, goals, end)
            timing = host.feedback().timing
            host.disable()
        except KeyboardInterrupt:
            print("\nstopping along a jerk-limited ramp", file=sys.stderr)
            host.stop()
            at = host.feedback().axes[0]
            print(f"stopped at {at.position:.6f} deg, velocity {at.velocity:g} deg/s")
            return 130
    print(table(recording, records, timing, cycle_time))
    return draw(out, recording, records, cycle_time)


def _check_picture(out: Path) -> None:
    """Refuse before anything moves what could not be written afterwards."""
    if out.suffix.lower() not in (".png", ".svg", ".pdf", ".jpg"):
        raise InputError("--out", str(out), "must end in .png, .svg, .pdf or .jpg")
    if not out.parent.is_dir():
        raise InputError("--out", str(out), f"must lie in a folder that exists, not {out.parent}")
    if out.is_dir():
        raise InputError("--out", str(out), "must be a file, not a folder")


def table(
    recording: Recording, records: tuple[Record, ...], timing: Timing, cycle_time: float
) -> str:
    """The figures of the run."""
    goal = float(recording.position[-1])
    own = dips(np.diff(recording.position) / np.diff(recording.time))
    rows: list[tuple[str, list[str]]] = [
        ("", [record.label for record in records]),
        (
            f"cycles of {cycle_time * 1e6:g} us",
            [str(round(float(np.sum(r.column("moving"))))) + " in motion" for r in records],
        ),
        ("not seen by the host", [f"{r.missed} cycles" for r in records]),
        (
            f"final error {AFTER_S:g} s later",
            [f"{_error(r, goal)} increments" for r in records],
        ),
    ]
    for name, most, unit in (
        ("velocity", LIMITS.velocity, "deg/s"),
        ("acceleration", LIMITS.acceleration, "deg/s^2"),
        ("jerk", LIMITS.jerk, "deg/s^3"),
    ):
        peaks = [getattr(record, f"peak_{name}") for record in records]
        label = f"largest {name}, limit {most:.3f} {unit}"
        rows.append((label, [f"{peak:.4f} ({peak / most:.2%})" for peak in peaks]))
    rows.append(
        (
            f"dips of the velocity > 10 %, path's own {own}",
            [str(dips(r.column("velocity"))) for r in records],
        )
    )
    plan = float(recording.time[-1])
    rows.append(
        (
            f"in motion beside the path's {plan:.2f} s",
            [f"{_moving(r) * cycle_time - plan:+.3f} s" for r in records],
        )
    )
    lines = [f"{name:46}" + "".join(f"{cell:>24}" for cell in cells) for name, cells in rows]
    lines.append("")
    lines.append(f"{'us':22}{'median':>10}{'p99':>10}{'p99.9':>10}{'worst':>10}")
    for name, row in (
        ("period", timing.period),
        ("computing time", timing.computing),
        ("wake-up latency", timing.latency),
    ):
        lines.append(f"{name:22}{_us(row)}")
    lines.append(f"late: {timing.late} cycles skipped of {timing.period.count + 1 + timing.late}")
    return "\n".join(lines)


def _moving(record: Record) -> int:
    """Cycles from the first commanded change to the last."""
    position = record.column("position")
    changed = np.flatnonzero(np.diff(position) != 0.0)
    return int(record.cycles[changed[-1] + 1] - record.cycles[changed[0]])


def _error(record: Record, goal: float) -> int:
    return record.rows[-1].actual_counts - round(goal * COUNTS_PER_DEGREE)


def _us(row: Distribution) -> str:
    return "".join(f"{1e6 * x:10.1f}" for x in (row.median, row.p99, row.p999, row.worst))


def draw(out: Path, recording: Recording, records: tuple[Record, ...], cycle_time: float) -> int:
    """Write the picture, or say what is missing for it."""
    try:
        from sjerk.cli.plot import Curve, panels
    except ImportError:
        print("no picture: matplotlib draws it (pip install 'sjerk[demo]')")
        return 0
    panel = {
        "position / deg": [Curve("recorded path", recording.time, recording.position, "k.")],
        "velocity / (deg/s)": [],
        "acceleration / (deg/s^2)": [],
        "jerk / (deg/s^3)": [],
    }
    for record, colour in zip(records, ("C0", "C1", "C2", "C3"), strict=True):
        t = (np.array(record.cycles) - record.cycles[0]) * cycle_time
        for name in panel:
            field = name.split()[0]
            label = f"{record.label}, commanded"
            panel[name].append(Curve(label, t, record.column(field), f"{colour}-"))
            if field in ("position", "velocity"):
                actual = record.column(f"actual_{field}")
                label = "actual" if record is records[-1] else ""
                panel[name].append(Curve(label, t, actual, "k:"))
    limits = {
        "velocity / (deg/s)": LIMITS.velocity,
        "acceleration / (deg/s^2)": LIMITS.acceleration,
        "jerk / (deg/s^3)": LIMITS.jerk,
    }
    title = f"one move, and every point streamed in three ways; cycle {cycle_time * 1e6:g} us"
    panels(out, title, panel, limits)
    print(f"picture: {out}")
    return 0
