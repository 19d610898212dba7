"""The commands of a person at a running kernel: arguments to calls, results to lines or JSON.

Never here: motion, layouts, bit masks.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from sjerk.cli.arguments import by_axis, duration, duration_or_inf
from sjerk.cli.cyclictest import Cyclictest
from sjerk.errors import (
    ExtraMissingError,
    HostTakenError,
    InputError,
    SegmentMissingError,
    SjerkError,
)
from sjerk.handshake import clean
from sjerk.host.feedback import Feedback
from sjerk.host.host import BUFFERS, Host
from sjerk.host.monitor import Monitor
from sjerk.host.timing import Distribution, Grant
from sjerk.kernel.config import load
from sjerk.recording import files
from sjerk.recording.recording import Recorder

#: Largest wait for a host that is about to leave, seconds.
_PATIENCE = 2.0


def add_arguments(jobs: Any) -> None:
    """Add kernel, enable, disable, reset, move, jog, stop, status, monitor and report."""
    job = jobs.add_parser("kernel", help="run the kernel of a TOML file until Ctrl-C or SIGTERM")
    job.add_argument("file", type=Path)
    job.add_argument("--name", help="of the kernel; default: the file's")
    job.add_argument("--spin-us", type=float, help="busy wait before each deadline")
    job.add_argument("--seconds", type=duration_or_inf, default=float("inf"), help="end by itself")
    job.add_argument(
        "--record", type=Path, help="every cycle, to .parquet or .mcap (extra: record)"
    )
    add_force(job)
    job.add_argument("--json", action="store_true")
    job.set_defaults(run=_kernel)

    def add(name: str, run: Callable[[argparse.Namespace], int], help: str) -> Any:
        job = jobs.add_parser(name, help=help)
        job.add_argument("--name", help="of the kernel; default: the only one that runs")
        job.add_argument("--json", action="store_true", help="one JSON object per line")
        job.set_defaults(run=run)
        return job

    for name, text in (
        ("enable", "enable drives"),
        ("disable", "disable drives, at rest"),
        ("reset", "reset faults"),
    ):
        add(name, _power, text).add_argument("axes", nargs="*", type=int, help="default: all")
    job = add("move", _move, "move to positions; returns at the goal")
    job.add_argument("target", nargs="+", help="a position per axis, or AXIS=POSITION")
    job.add_argument("--relative", action="store_true")
    job.add_argument("--velocity", type=float, help="instead of the axes' own")
    job.add_argument("--synchronization", choices=("time", "phase", "none"), default="time")
    job.add_argument(
        "--buffer",
        choices=tuple(BUFFERS),
        default="aborting",
        help="how it follows what moves already: replace it, wait for it, or blend into it",
    )
    job.add_argument("--no-wait", action="store_true", help="return when it is moving or queued")
    job.add_argument("--timeout", type=duration, help="of the wait, seconds; the move goes on")
    job = add("jog", _jog, "move with a velocity, to a limit, or until stopped; returns at once")
    job.add_argument("velocity", nargs="+", help="a velocity per axis, or AXIS=VELOCITY")
    job = add("stop", _stop, "halt, or quick stop; returns at rest")
    job.add_argument("axes", nargs="*", type=int, help="default: all")
    job.add_argument("--quick", action="store_true", help="each axis by its own stop limits")
    job.add_argument(
        "--interrupt",
        action="store_true",
        help="where another process leads: Ctrl-C for that one first, then the stop",
    )
    add("status", _status, "what the axes do")
    job = add("monitor", _monitor, "a live table (extra: rich)")
    job.add_argument("--seconds", type=duration_or_inf, default=float("inf"))
    job = add("report", _report, "cycle times, beside cyclictest where installed")
    job.add_argument("--seconds", type=duration, default=5.0)


# ---- recordings ----------------------------------------------------------------------------------


def add_force(job: Any) -> None:
    """Add what ``ready`` asks for before it overwrites."""
    job.add_argument("--force", action="store_true", help="overwrite a recording that is there")


def ready(options: argparse.Namespace, file: Path) -> None:
    """Refuse a recording that cannot be written, or would be overwritten, before anything runs.

    Raises InputError, ExtraMissingError.
    """
    files.ready(file)
    if file.exists() and not options.force:
        raise InputError("file", str(file), "exists: --force overwrites it")


# ---- the kernel ----------------------------------------------------------------------------------


def _kernel(options: argparse.Namespace) -> int:
    kernel = load(options.file, name=options.name)
    if options.spin_us is not None:
        kernel.clock = replace(kernel.clock, spin_us=options.spin_us)

    def end(*_: object) -> None:
        raise KeyboardInterrupt

    if options.record is not None:
        ready(options, options.record)
    before, ran = signal.signal(signal.SIGTERM, end), False
    try:
        # the recorder outlives the kernel: the halt at its end is recorded as well
        with ExitStack() as recorded, suppress(KeyboardInterrupt), kernel:
            if options.record is not None:
                recorded.enter_context(Recorder(kernel.name, options.record))
            monitor = Monitor.attach(kernel.name)
            clock = asdict(monitor.feedback().timing.clock)
            show(options, {"kernel": kernel.name, "axes": len(kernel.axes), "clock": clock})
            monitor.close()
            ran = True
            until = time.monotonic() + options.seconds
            while kernel.alive and time.monotonic() < until:
                time.sleep(0.05)
            if not kernel.alive:
                return 6
    finally:
        signal.signal(signal.SIGTERM, before)
    return 0 if ran else 130


def name_of(options: argparse.Namespace) -> str:
    """The kernel that is meant: named, or the only one that runs.

    Raises SegmentMissingError where none runs, InputError where many do.
    """
    if options.name is not None:
        return str(options.name)
    found = [info.name for info in clean(dry_run=True) if info.in_use and not info.companion]
    if not found:
        raise SegmentMissingError("no kernel runs")
    if len(found) > 1:
        raise InputError("--name", None, f"{len(found)} kernels run: {', '.join(found)}")
    return found[0]


# ---- commands ------------------------------------------------------------------------------------


def host_of(options: argparse.Namespace) -> Host:
    """Become the host of the kernel that is meant; whoever is it already is named."""
    try:
        return Host.attach(name_of(options), wait=_PATIENCE)
    except HostTakenError as taken:
        pid = taken.pid
        what = (
            f"{taken}: Ctrl-C there, or `kill -INT {pid}`, halts what a command of sjerk moves; "
            "`sjerk stop --interrupt` does that"
        )
        raise HostTakenError(what, name=taken.name, pid=pid) from None


def _power(options: argparse.Namespace) -> int:
    with host_of(options) as host:
        getattr(host, options.job)(axes=options.axes or None)
        return _positions(options, host)


def _move(options: argparse.Namespace) -> int:
    targets = by_axis("target", options.target)
    with host_of(options) as host:
        limits = None
        if options.velocity is not None:
            own = [axis.limits for axis in host.feedback().axes]
            limits = {
                i: replace(own[i], velocity=options.velocity, position=None)
                for i in (targets if isinstance(targets, dict) else range(len(own)))
                if i in range(len(own))
            }
        move = host.move(
            targets,
            relative=options.relative,
            limits=limits,
            synchronization=options.synchronization,
            buffer=options.buffer,
        )
        try:
            (move.taken if options.no_wait else move.wait)(options.timeout)
        except KeyboardInterrupt:
            move.cancel()
            raise
        return _positions(options, host)


def _jog(options: argparse.Namespace) -> int:
    velocities = by_axis("velocity", options.velocity)
    with host_of(options) as host:
        host.jog(velocities).accepted()
        return _positions(options, host)


def _interrupt(name: str) -> None:
    """Ctrl-C for the process that is host, if there is one; it may take its time to leave."""
    try:
        Host.attach(name).close()
    except HostTakenError as taken:
        if taken.pid:
            os.kill(taken.pid, signal.SIGINT)


def _stop(options: argparse.Namespace) -> int:
    if options.interrupt:
        _interrupt(name_of(options))
    with host_of(options) as host:
        (host.quick_stop if options.quick else host.halt)(axes=options.axes or None)
        return _positions(options, host)


# ---- what is seen --------------------------------------------------------------------------------


def show(options: argparse.Namespace, data: dict[str, Any]) -> None:
    """Print as lines, or as one JSON object where asked."""
    if options.json:
        print(json.dumps(data), flush=True)
        return
    for key, value in data.items():
        if isinstance(value, list):
            for row in value:
                print("  ".join(f"{k} {v}" for k, v in row.items()), flush=True)
        elif isinstance(value, dict):
            for k, v in value.items():
                text = "  ".join(f"{n} {x}" for n, x in v.items()) if isinstance(v, dict) else v
                print(f"{key}.{k}: {text}", flush=True)
        else:
            print(f"{key}: {value}", flush=True)


def _axes(feedback: Feedback) -> list[dict[str, Any]]:
    return [
        {
            "axis": i,
            "state": axis.state.name,
            "drive": axis.drive_state.name,
            "position": round(axis.position, 9),
            "actual": round(axis.actual_position, 6),
            "velocity": round(axis.velocity, 6),
            "unit": axis.unit,
        }
        for i, axis in enumerate(feedback.axes)
    ]


def _positions(options: argparse.Namespace, host: Host) -> int:
    show(options, {"axes": _axes(host.feedback())})
    return 0


def _status(options: argparse.Namespace) -> int:
    with Monitor.attach(name_of(options)) as monitor:
        feedback = monitor.feedback()
        timing = {
            "cycle": feedback.cycle,
            "late": feedback.timing.late,
            "override": feedback.override,
            "hold": feedback.hold,
        }
        show(options, timing | {"axes": _axes(feedback)})
    return 0


def _monitor(options: argparse.Namespace) -> int:
    until = time.monotonic() + options.seconds
    with Monitor.attach(name_of(options)) as monitor:
        if options.json:
            while time.monotonic() < until and monitor.kernel_lives:
                feedback = monitor.feedback()
                show(options, {"cycle": feedback.cycle, "axes": _axes(feedback)})
                time.sleep(0.1)
            return 0
        try:
            from rich.live import Live
            from rich.table import Table
        except ImportError as fault:
            raise ExtraMissingError("rich", "monitor") from fault
        with Live(refresh_per_second=10) as live:
            while time.monotonic() < until and monitor.kernel_lives:
                feedback = monitor.feedback()
                late = feedback.timing.late
                table = Table(title=f"{monitor.name}  cycle {feedback.cycle}  late {late}")
                rows = _axes(feedback)
                for column in rows[0]:
                    table.add_column(column)
                for row in rows:
                    table.add_row(*(str(value) for value in row.values()))
                live.update(table)
                time.sleep(0.1)
    return 0


def _report(options: argparse.Namespace) -> int:
    with Monitor.attach(name_of(options)) as monitor:
        before = monitor.feedback()
        period = before.cycle_time
        judge = Cyclictest.start(
            period, options.seconds, priority=_priority(before.timing.clock.scheduling)
        )
        time.sleep(options.seconds)
        beside: dict[str, Any] | str = "not installed"
        if judge is not None:
            try:
                verdict = judge.result()
                beside = {"version": verdict.version, "priority": verdict.priority}
                beside |= _row("latency", verdict.latency)
            except SjerkError as fault:
                beside = str(fault)
        after = monitor.feedback()
    timing = after.timing_since(before)
    head: dict[str, Any] = {
        "cycle_time_us": round(period * 1e6, 3),
        "cycles": after.cycle - before.cycle,
        "late": timing.late,
        "clock": asdict(timing.clock),
        "times_us": [
            _row(name, getattr(timing, name)) for name in ("latency", "period", "computing")
        ],
        "cyclictest_us": beside,
    }
    show(options, head)
    return 0


def _priority(grant: Grant) -> int:
    """The real-time priority of the kernel, so that its judge gets the same; 0: none."""
    return int(grant.asked.split()[-1]) if grant.granted and grant.asked != "nothing" else 0


def _row(name: str, times: Distribution) -> dict[str, Any]:
    """A distribution in microseconds."""
    values = {k: round(v * 1e6, 1) for k, v in asdict(times).items() if k != "count"}
    return {"of": name, "count": times.count} | values
