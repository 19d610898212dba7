"""The main job: the paper's experiment (its Figures 6 and 7) on a recorded path.

A kernel with one Sigma-7 drive of 24 bits. First the host moves it to the end of the path in one
move, then it streams every recorded point at its time: each interrupting the motion before, as the
paper's control node does; with look-ahead that can always stop on the last one; and with look-ahead
that trusts the stream. Recorded is what was commanded and what the encoder said. Beside them: the
streams where no cycle is left out, and the fastest motion through the points.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sjerk._binding import lib
from sjerk.cli import cable, feed_forward, virtual
from sjerk.errors import ExtraMissingError, InputError, SjerkError
from sjerk.executor import StreamPlayer
from sjerk.extras import load
from sjerk.host import Distribution, Host, Timing
from sjerk.kernel import Axis, MotionKernel
from sjerk.ports.ethercat.inside import port_of
from sjerk.profile import FloatArray, Limits
from sjerk.recording import Recorder, Recording
from sjerk.trajectory import RecordedPath, read_recording, shipped_recording

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
#: Errors of a drive whose main device was away: none told, watchdog, SYNC0, a target far ahead.
AWAY = (0, 0x8130, 0x8612, 0x8700)
#: How long a drive may take to come back.
BACK_S = 30.0
#: How long the drive on a cable goes on by itself; three periods at the cycle of the paper.
BRIDGED_S = 0.003
#: Times that a run is made where the machine stands still for longer than a drive waits.
ATTEMPTS = 20
#: A dip: the speed falls by more than this share and rises again.
DIP = 0.1


@dataclass(frozen=True)
class Run:
    """The path played by one method, as its cycles were recorded; arrays (cycles,), deg, s."""

    label: str
    cycle: NDArray[np.uint64]
    moving: NDArray[np.bool_]
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray
    actual_position: FloatArray
    actual_velocity: FloatArray
    actual_counts: NDArray[np.int64]
    missed: int
    skipped: int

    @classmethod
    def of(
        cls,
        label: str,
        recording: Recording,
        after: int,
        *,
        missed: int,
        skipped: int,
        told: bool,
    ) -> Run:
        """The cycles of a recording after one of them.

        ``told``: the actual velocity is the drive's own, 606Ch. Where frames travel, an answer that
        comes late makes a difference of 0 and the next one twice as large.
        """
        rows = recording.cycle > after
        flags = recording.column("flags")[rows, 0]
        numbers = {
            name: getattr(recording, name)[rows, 0]
            for name in ("position", "velocity", "acceleration", "jerk", "actual_position")
        }
        actual = numbers["actual_position"]
        velocity = np.diff(actual, prepend=actual[:1])
        if told:
            per_cycle = recording.cycle_time / COUNTS_PER_DEGREE
            velocity = recording.column("velocity_actual")[rows, 0] * per_cycle
        return cls(
            actual_velocity=velocity,
            label=label,
            cycle=recording.cycle[rows],
            moving=(flags & lib.SJ_TRACE_MOVING) != 0,
            actual_counts=recording.column("actual_counts")[rows, 0],
            missed=missed,
            skipped=skipped,
            **numbers,
        )

    def peak(self, name: str) -> float:
        """The largest magnitude of velocity, acceleration or jerk."""
        return float(np.abs(getattr(self, name)).max())

    def error(self, goal: float) -> int:
        """How far the encoder is from the goal at the end, increments."""
        return int(self.actual_counts[-1]) - round(goal * COUNTS_PER_DEGREE)


def play(host: Host, label: str, goals: Iterator[float], end: float) -> Run:
    """Record until the motion has rested at ``end`` for a while; shows progress.

    ``goals`` is asked in every turn: it commands what is due and gives the newest goal.
    """
    before = host.feedback()
    start = before.axes[0].position
    still_since: float | None = None
    shown = -1
    with Recorder(host.name, None) as recorder:
        while still_since is None or time.monotonic() - still_since < AFTER_S:
            goal = next(goals)
            axis = host.feedback().axes[0]
            if axis.fault:
                raise SjerkError(f"the drive has stopped with an error, {axis.error_code:04X}h")
            if goal != end or axis.moving:
                still_since = None
            elif still_since is None:
                still_since = time.monotonic()
            elif axis.position != end and time.monotonic() - still_since > AFTER_S / 2:
                raise SjerkError(f"the motion ended at {axis.position:.3f} deg, not at {end:g}")
            share = int(10.0 * abs(axis.position - start) / (abs(end - start) or 1.0)) * 10
            if share != shown:
                shown = share
                line = f"\r{label}: {share:3d} % {axis.position:9.3f} deg"
                print(line, end="", file=sys.stderr)
            time.sleep(200e-6)
        print(file=sys.stderr)
    return Run.of(
        label,
        recorder.recording,
        before.cycle,
        missed=recorder.missed,
        skipped=host.feedback().timing.late - before.timing.late,
        told=before.bus is not None,
    )


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


def single_move(host: Host, goal: float) -> Generator[float, None, None]:
    """Command the end of the path once."""
    host.move(goal)
    while True:
        yield goal


def streamed(host: Host, recording: RecordedPath) -> Generator[float, None, None]:
    """Command each recorded point at its time."""
    start = time.monotonic()
    for due, goal in zip(recording.time[1:], recording.position[1:], strict=True):
        host.move(float(goal))
        while time.monotonic() - start < due:
            yield float(goal)
    while True:
        yield float(recording.position[-1])


def lookahead(
    host: Host, recording: RecordedPath, *, stop_within: bool
) -> Generator[float, None, None]:
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


def add_arguments(jobs: Any) -> None:
    """Add demo."""
    job = jobs.add_parser("demo", help="follow a recorded path with a simulated servo drive")
    job.add_argument(
        "path",
        nargs="?",
        type=Path,
        default=shipped_recording(),
        help="CSV (time_s,position_deg) or ROS 2 bag; default: the shipped TOPP-RA plan",
    )
    job.add_argument("--out", type=Path, default=Path("demo.png"), help="the picture (%(default)s)")
    job.add_argument("--joint", help="joint of a bag (default: its first)")
    job.add_argument("--cycle-us", type=float, default=1000.0, help="control cycle (%(default)s)")
    job.add_argument(
        "--ethercat",
        action="store_true",
        help="the drive on EtherCAT, on virtual cables in a network namespace of its own",
    )
    job.add_argument("--on-cable", action="store_true", help=argparse.SUPPRESS)  # it is there
    job.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    if options.ethercat:
        given = [str(options.path), "--out", str(options.out), "--cycle-us", str(options.cycle_us)]
        given += ["--joint", options.joint] if options.joint else []
        here = [sys.executable, "-m", "sjerk", "demo", "--on-cable", *given]
        return subprocess.call(cable.first(cable.inside(here)))
    cycle_time = options.cycle_us / 1e6
    if not options.on_cable:
        return run(options.path, options.out, cycle_time, options.joint)
    with cable.drives(1):
        return run(options.path, options.out, cycle_time, options.joint, interface=cable.MAIN)


def _kernel(cycle_time: float, interface: str | None) -> MotionKernel:
    """One axis: with its simulated drive inside, or with one on EtherCAT."""
    if interface is None:
        return MotionKernel([Axis(LIMITS, COUNTS_PER_DEGREE, unit="deg")], cycle_time)
    axis = Axis(LIMITS, COUNTS_PER_DEGREE, "external", unit="deg")
    kernel = MotionKernel([axis], cycle_time)
    # this machine is hardly a real-time one: missed SYNC0 are bridged for some ms at any cycle, and
    # are no fault for as long as the watchdog waits
    bridged = max(3, round(BRIDGED_S / cycle_time))
    startup = [["10F1:2", "u16", 0xFFFF], ["2100:3", "u16", bridged]]
    patient = {"position": 0, "startup": startup}
    bus = {"interface": interface, "lost": max(4, round(0.1 / cycle_time))}
    kernel.port = port_of("demo", bus, {0: patient})
    return kernel


def run(
    path: Path, out: Path, cycle_time: float, joint: str | None, *, interface: str | None = None
) -> int:
    """Do the experiment; prints the table, writes the picture. Returns the exit code.

    ``interface``: the drive is on EtherCAT there, not in the kernel.
    """
    _check_picture(out)
    recording = read_recording(path, joint=joint)
    start, end = float(recording.position[0]), float(recording.position[-1])
    print(
        f"{path.name}: joint {recording.joint}, {len(recording.time)} points over "
        f"{recording.time[-1]:.2f} s, ends at {end:.3f} deg"
    )
    runs: list[Run] = []
    with _running(cycle_time, interface) as kernel, kernel.host() as host:
        try:
            host.enable()
            for label, begin in (
                ("one move", partial(single_move, host, end)),
                ("interrupted", partial(streamed, host, recording)),
                ("stop within", partial(lookahead, host, recording, stop_within=True)),
                ("look-ahead", partial(lookahead, host, recording, stop_within=False)),
            ):
                runs.append(_attempt(host, label, begin, start, end))
            timing = host.feedback().timing
            host.disable()
        except KeyboardInterrupt:
            print("\nstopping along a jerk-limited ramp", file=sys.stderr)
            host.stop()
            at = host.feedback().axes[0]
            print(f"stopped at {at.position:.6f} deg, velocity {at.velocity:g} deg/s")
            return 130
    beside = virtual.motions(recording, LIMITS, cycle_time, delay=DELAY, margin=2.0 * AHEAD_S)
    print(table(recording, runs, timing, cycle_time))
    print()
    print(virtual.table(recording, beside, LIMITS, cycle_time, dips))
    if interface is None:  # what it compares are drives inside
        print()
        print(feed_forward.table(kernel.axes[0], start, end, cycle_time))
    return draw(out, recording, runs, beside[-1], cycle_time)


def _attempt(
    host: Host,
    label: str,
    begin: Callable[[], Generator[float, None, None]],
    start: float,
    end: float,
) -> Run:
    """One run; again, and told, where the machine kept the cycle from a drive for too long."""
    for left in reversed(range(ATTEMPTS)):
        before = _missed(host)
        try:
            host.move(start).wait()
            with closing(begin()) as goals:
                return play(host, label, goals, end)
        except (SjerkError, TimeoutError):
            missed, code = _missed(host) - before, host.feedback().axes[0].error_code
            if host.feedback().bus is None or code not in AWAY or missed == 0 or not left:
                raise
            print(
                f"\n{label}: the machine stood still, {missed} cycles did not reach the drive; "
                "the run begins anew",
                file=sys.stderr,
            )
            _come_back(host)
    raise AssertionError("the last attempt returns or raises")


def _missed(host: Host) -> int:
    """Cycles so far that were skipped, or whose answers did not come."""
    frame = host.feedback()
    return frame.timing.late + (frame.bus.lost if frame.bus else 0)


def _come_back(host: Host) -> None:
    """The drive is brought back beside the cycle; then its axis is reset and enabled."""
    end = time.monotonic() + BACK_S
    while True:
        host.reset()
        try:
            host.enable()
        except (TimeoutError, SjerkError):
            if time.monotonic() > end:
                raise
        else:
            return


@contextmanager
def _running(cycle_time: float, interface: str | None) -> Iterator[MotionKernel]:
    """The kernel, running; on EtherCAT it is tried again where the machine stalls at its start."""
    for left in reversed(range(ATTEMPTS)):
        kernel = _kernel(cycle_time, interface)
        with ExitStack() as running:
            try:
                running.enter_context(kernel)
            except SjerkError as fault:
                if interface is None or not left:
                    raise
                print(f"{fault}; the start is tried again", file=sys.stderr)
                continue
            yield kernel
            return


def _check_picture(out: Path) -> None:
    """Refuse before anything moves what could not be written afterwards."""
    if out.suffix.lower() not in (".png", ".svg", ".pdf", ".jpg"):
        raise InputError("--out", str(out), "must end in .png, .svg, .pdf or .jpg")
    if not out.parent.is_dir():
        raise InputError("--out", str(out), f"must lie in a folder that exists, not {out.parent}")
    if out.is_dir():
        raise InputError("--out", str(out), "must be a file, not a folder")


def table(recording: RecordedPath, runs: Sequence[Run], timing: Timing, cycle_time: float) -> str:
    """The figures of the run."""
    goal = float(recording.position[-1])
    own = dips(np.diff(recording.position) / np.diff(recording.time))
    rows: list[tuple[str, list[str]]] = [
        ("", [run.label for run in runs]),
        (
            f"cycles of {cycle_time * 1e6:g} us",
            [f"{int(run.moving.sum())} in motion" for run in runs],
        ),
        ("not recorded", [f"{run.missed} cycles" for run in runs]),
        # a stream makes them up as fast as the limits allow: at all of its jerk
        ("left out by the clock", [f"{run.skipped} cycles" for run in runs]),
        (
            f"final error {AFTER_S:g} s later",
            [f"{run.error(goal)} increments" for run in runs],
        ),
    ]
    for name, most, unit in (
        ("velocity", LIMITS.velocity, "deg/s"),
        ("acceleration", LIMITS.acceleration, "deg/s^2"),
        ("jerk", LIMITS.jerk, "deg/s^3"),
    ):
        peaks = [run.peak(name) for run in runs]
        label = f"largest {name}, limit {most:.3f} {unit}"
        rows.append((label, [f"{peak:.4f} ({peak / most:.2%})" for peak in peaks]))
    rows.append(
        (
            f"dips of the velocity > 10 %, path's own {own}",
            [str(dips(run.velocity)) for run in runs],
        )
    )
    plan = float(recording.time[-1])
    rows.append(
        (
            f"in motion, compared with the path's {plan:.2f} s",
            [f"{_moving(run) * cycle_time - plan:+.3f} s" for run in runs],
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


def _moving(run: Run) -> int:
    """Cycles from the first commanded change to the last."""
    changed = np.flatnonzero(np.diff(run.position) != 0.0)
    return int(run.cycle[changed[-1] + 1] - run.cycle[changed[0]])


def _us(row: Distribution) -> str:
    return "".join(f"{1e6 * x:10.1f}" for x in (row.median, row.p99, row.p999, row.worst))


def draw(
    out: Path,
    recording: RecordedPath,
    runs: Sequence[Run],
    bound: virtual.Motion,
    cycle_time: float,
) -> int:
    """Write the picture of the streams and the bound, or say what is missing for it."""
    try:
        pictures = load("sjerk.cli.pictures", extra="demo")
    except ExtraMissingError:
        print("no picture: matplotlib draws it (pip install 'sjerk[demo]')")
        return 0
    panel: dict[str, list[Any]] = {
        "position / deg": [
            pictures.Curve("recorded path", recording.time, recording.position, "k.")
        ],
        "velocity / (deg/s)": [],
        "acceleration / (deg/s^2)": [],
        "jerk / (deg/s^3)": [],
    }
    t = np.arange(len(bound.position)) * cycle_time
    for name, curves in panel.items():
        y = getattr(bound, name.split()[0])
        curves.append(pictures.Curve(f"{bound.label}, computed", t, y, "C7-"))
    for run, colour in zip(runs[1:], ("C1", "C2", "C3"), strict=True):
        t = (run.cycle - run.cycle[0]) * cycle_time
        for name in panel:
            field = name.split()[0]
            label = f"{run.label}, commanded"
            panel[name].append(pictures.Curve(label, t, getattr(run, field), f"{colour}-"))
            if field in ("position", "velocity"):
                actual = getattr(run, f"actual_{field}")
                scale = 1.0 / cycle_time if field == "velocity" else 1.0
                label = "actual" if run is runs[-1] else ""
                panel[name].append(pictures.Curve(label, t, actual * scale, "k:"))
    limits = {
        "velocity / (deg/s)": LIMITS.velocity,
        "acceleration / (deg/s^2)": LIMITS.acceleration,
        "jerk / (deg/s^3)": LIMITS.jerk,
    }
    title = f"every point streamed in three ways, and the bound; cycle {cycle_time * 1e6:g} us"
    pictures.panels(out, title, panel, limits)
    print(f"picture: {out}")
    return 0
