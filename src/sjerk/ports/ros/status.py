"""What the nodes tell of a kernel: diagnostics, warnings, and the check before the start.

Never here: ROS, messages.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum

from sjerk.errors import SjerkError
from sjerk.host import Feedback, Host, Monitor
from sjerk.host.events import EventKind
from sjerk.ports.ros.joints import Joints

#: What people have to know of: a goal that is answered or a state that changes is none of it.
WARNED = frozenset(
    {
        EventKind.FAULT,
        EventKind.FOLLOWING,
        EventKind.SYNC,
        EventKind.STOP,
        EventKind.SWITCH,
        EventKind.CORRUPT,
        EventKind.ANCHOR,
    }
)
#: 0130h of a device that exchanges process data, and what stands there where it is not known.
_OPERATIONAL = (0, 8)
#: So many cycles without an answer in a row are a lost drive, as for ``kernel_state``.
_LOST = 10


class Level(IntEnum):
    """As ``diagnostic_msgs/DiagnosticStatus`` counts them."""

    OK = 0  #: As it should be.
    WARN = 1  #: Worth a look.
    ERROR = 2  #: It does not work.
    STALE = 3  #: Nothing is known.


@dataclass(frozen=True)
class Status:
    """One row: of ``what``, how good, in words, and values by name."""

    what: str
    level: Level
    text: str
    values: Mapping[str, object]


def statuses(
    host: Host | None,
    joints: Joints | None,
    more: Mapping[str, Mapping[str, object]] | None = None,
) -> list[Status]:
    """Of the kernel and of each joint; ``more``: further rows of values by name."""
    if host is None or joints is None:
        return [Status("kernel", Level.STALE, "not configured", {})]
    try:
        frame = host.feedback()
        state = host.kernel_state.value
    except SjerkError as error:
        return [Status("kernel", Level.ERROR, str(error), {})]
    timing = frame.timing
    numbers: dict[str, object] = {
        "cycle": frame.cycle,
        "late_cycles": timing.late,
        "latency_p99_us": round(1e6 * timing.latency.p99, 1),
        "computing_p99_us": round(1e6 * timing.computing.p99, 1),
    }
    late = Level.WARN if timing.late else Level.OK
    rows = [Status("kernel", late, state, numbers), *_joints(frame, joints)]
    rows.extend(Status(what, Level.OK, "", own) for what, own in (more or {}).items())
    return rows


def _joints(frame: Feedback, joints: Joints) -> list[Status]:
    rows = []
    for number, (name, axis) in enumerate(zip(joints.names, frame.axes, strict=True)):
        level = Level.OK if axis.follows else Level.WARN
        values: dict[str, object] = {
            "drive": axis.drive_state.name,
            "error_code": f"{axis.error_code:04X}h",
            "following_error_increments": axis.following_error,
        }
        bus = frame.bus.axes.get(number) if frame.bus is not None else None
        if bus is not None:
            values |= {"bus_state": bus.state, "bus_lost": bus.lost, "bus_in_row": bus.in_row}
        text = axis.state.name.lower()
        rows.append(Status(name, Level.ERROR if axis.fault else level, text, values))
    return rows


def check(host: Host, joints: Joints) -> list[Status]:
    """Before the start: per joint whether bus, drive and cycle are as they have to be.

    A row of level ERROR has to be mended before drives are enabled; a closed limit switch is told
    only, for its axis has to be moved off.
    """
    frame = host.feedback()
    late = frame.timing.late
    cycle = f"cycle {1e3 * frame.cycle_time:g} ms, {late} late"
    rows = []
    for number, (name, axis) in enumerate(zip(joints.names, frame.axes, strict=True)):
        wrong = []
        bus = frame.bus.axes.get(number) if frame.bus is not None else None
        if bus is None:
            line = "no bus"
        else:
            line = f"bus state {bus.state}, {bus.lost} lost"
            if bus.in_row >= _LOST or bus.state not in _OPERATIONAL:
                wrong.append(f"its drive does not answer on the bus: code {bus.code:04X}h")
        drive = f"drive {axis.drive_state.name.lower()}"
        if axis.fault:
            wrong.append(f"its drive has fault {axis.error_code:04X}h: reset it")
        noted = ["a limit switch is closed"] if axis.limit_switches else []
        level = Level.ERROR if wrong else Level.WARN if late or noted else Level.OK
        text = "; ".join([line, drive, cycle, *noted, *wrong])
        rows.append(Status(name, level, text, {}))
    return rows


def check_start(host: Host, joints: Joints, tell: Callable[[str], None]) -> None:
    """``tell`` each row of the check; raises SjerkError with the joints that must not start."""
    rows = check(host, joints)
    for row in rows:
        tell(f"{row.what}: {row.text}")
    wrong = [f"{row.what}: {row.text}" for row in rows if row.level >= Level.ERROR]
    if wrong:
        raise SjerkError(f"check before the start: {'; '.join(wrong)}")


def warnings(host: Host | Monitor) -> list[str]:
    """What has happened since the last call that people have to know of, in words."""
    events, missed = host.events()
    told = [str(event) for event in events if event.kind in WARNED]
    return told + ([f"{missed} events were overwritten unread"] if missed else [])
