"""What the verbs of the command line share: which kernel is meant, how results are printed.

Never here: motion, what a verb does.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sjerk.cli.arguments import axis_word, number_of
from sjerk.errors import HostTakenError, InputError, SegmentMissingError, SjerkError
from sjerk.handshake import clean
from sjerk.host import Feedback, Host, Monitor
from sjerk.recording import files

#: Largest wait for a host that is about to leave, seconds.
PATIENCE_S = 2.0


# ---- arguments


def add_verb(
    jobs: Any, verb: str, run: Callable[[argparse.Namespace], int], help: str, *, named: bool = True
) -> Any:
    """Add a verb with ``--json``, and ``--name`` where it is about a running kernel."""
    job = jobs.add_parser(verb, help=help)
    if named:
        job.add_argument("--name", help="of the kernel; default: the only one that runs")
        job.add_argument("--any-owner", action="store_true", help="also a kernel of another user")
    job.add_argument("--json", action="store_true", help="one JSON object per line")
    job.set_defaults(run=run)
    return job


def add_force(job: Any) -> None:
    """Add what ``ready`` asks for before it overwrites."""
    job.add_argument("--force", action="store_true", help="overwrite a recording that exists")


def ready(options: argparse.Namespace, file: Path) -> None:
    """Refuse a recording that cannot be written, or would be overwritten, before anything runs.

    Raises InputError, ExtraMissingError.
    """
    files.ready(file)
    if file.exists() and not options.force:
        raise InputError("file", str(file), "exists: --force overwrites it")


@contextmanager
def sigterm_as_ctrl_c() -> Iterator[None]:
    """Within it SIGTERM does what Ctrl-C does."""

    def end(*_: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


# ---- which kernel


def name_of(options: argparse.Namespace) -> str:
    """The kernel that is meant: named, or the only one that runs.

    Raises SegmentMissingError where none runs, SjerkError where many do.
    """
    if options.name is not None:
        return str(options.name)
    found = [
        info.name
        for info in clean(dry_run=True)
        if info.kernel and not info.companion and (options.any_owner or info.uid == os.geteuid())
    ]
    if not found:
        raise SegmentMissingError("no kernel runs")
    if len(found) > 1:
        running = f"{len(found)} kernels run: {', '.join(found)}"
        raise SjerkError(f"{running}; --name says which one is meant")
    return found[0]


def host_of(options: argparse.Namespace) -> Host:
    """Become the host of the kernel that is meant; the process that is it already is named."""
    try:
        return Host.attach(name_of(options), wait=PATIENCE_S, any_owner=options.any_owner)
    except HostTakenError as taken:
        pid = taken.pid
        what = (
            f"{taken}: `sjerk stop` halts the axes beside it, `sjerk stop --interrupt` ends it "
            f"too, as Ctrl-C there or `kill -INT {pid}` does"
        )
        raise HostTakenError(what, name=taken.name, pid=pid) from None


# ---- which axes


def add_axes(job: Any) -> None:
    """Add the axes that are meant, by number or name."""
    job.add_argument("axes", nargs="*", type=axis_word, help="numbers or names; default: all")


def names_of(kernel: Host | Monitor) -> list[str]:
    """Names of the axes of the kernel, empty where one has none."""
    return [axis.name for axis in kernel.feedback().axes]


def axes_of(options: argparse.Namespace, kernel: Host | Monitor) -> list[int] | None:
    """Numbers of the axes that are meant; None: all. Raises InputError."""
    axes = options.axes or None
    if axes is None or all(isinstance(axis, int) for axis in axes):
        return axes  # a stop looks nothing up
    names = names_of(kernel)
    return [number_of(axis, names) for axis in axes]


# ---- results


def printable(text: str) -> str:
    """A name of a file, which may have any bytes, in one line."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


def show(options: argparse.Namespace, data: dict[str, Any]) -> None:
    """Print as lines, or as one JSON object where asked."""
    if options.json:
        print(json.dumps(data), flush=True)
        return
    for key, value in data.items():
        if isinstance(value, list):
            for row in value:
                print(_fields(row), flush=True)
        elif isinstance(value, dict):
            for k, v in value.items():
                print(f"{key}.{k}: {_fields(v) if isinstance(v, dict) else word(v)}", flush=True)
        else:
            print(f"{key}: {word(value)}", flush=True)


def _fields(row: dict[str, Any]) -> str:
    """Names and values of a row in one line; a text that says nothing is left out."""
    return "  ".join(f"{name} {word(value)}" for name, value in row.items() if value != "")


def word(value: object) -> str:
    """A value to be read: numbers have 12 digits, in whatever unit; JSON has all of them.

    >>> word(0.1 + 0.2), word(-2.5e-8), word(160.0), word(None)
    ('0.3', '-2.5e-08', '160.0', 'None')
    """
    return str(float(f"{value:.12g}")) if isinstance(value, float) else str(value)


def axis_rows(feedback: Feedback) -> list[dict[str, Any]]:
    """One row per axis: what it does, where it is."""
    named = any(axis.name for axis in feedback.axes)
    return [
        {"axis": i}
        | ({"name": axis.name} if named else {})
        | {
            "state": axis.state.name,
            "drive": axis.drive_state.name,
            "switches": axis.limit_switches.name or "",
            "position": axis.position,
            "actual": axis.actual_position,
            "velocity": axis.velocity,
            "unit": axis.unit,
        }
        for i, axis in enumerate(feedback.axes)
    ]


def bus_rows(feedback: Feedback) -> dict[str, Any]:
    """The bus of external drives, and one row per axis on it; nothing without."""
    bus = feedback.bus
    if bus is None:
        return {}
    head = {
        "devices": f"{bus.present} of {bus.devices}",
        "state": f"{bus.states:02X}h",
        "frames": bus.sent,
        "lost": bus.lost,
        "stray": bus.stray,
        "phase_us": round(bus.phase * 1e6, 3),
        "worst_phase_us": round(bus.worst_phase * 1e6, 3),
        "correction_ns": round(bus.correction * 1e9),
    }
    if bus.foreign:
        head["taken"] = "by another main device"
    rows = [
        {
            "axis": i,
            "bus": f"{axis.state:02X}h",
            "code": f"{axis.code:04X}h",
            "counter": axis.counter,
            "lost": axis.lost,
            "wrong": axis.wrong,
            "in_row": axis.in_row,
        }
        for i, axis in bus.axes.items()
    ]
    return {"bus": head, "bus_axes": rows}


def show_axes(options: argparse.Namespace, host: Host | Monitor) -> int:
    """Print what the axes do; the exit code 0."""
    show(options, {"axes": axis_rows(host.feedback())})
    return 0
