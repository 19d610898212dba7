"""Judge of a soak: from a recording alone, by numpy, whether every cycle kept every promise.

It knows the meaning of limits and commands, and shares no code with the cycle.

What is judged per cycle and axis: the first three differences of the commanded position against the
limits of the goals in execution; position, velocity and acceleration each continuing from the one
before by the jerk of the cycle; targets the nearest increments; the command on the actual position
while the drive does not follow; position limits; no axis that the kernel leads is left to the quick
stop of its drive. Per goal: one answer, in the cycle that took it.
An episode is an axis' way from rest to rest: its limits are those of the goals of the episode, of
the axis where a halt or a path came, of the quick stop where one came. Where a recording has a gap,
answers are not judged, nor limits until the axis has come to rest.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sjerk import DriveConfig, Recording
from sjerk._binding import lib
from sjerk.host import EventKind
from sjerk.kernel.trace import command_dtype, record_dtype

SLACK = 1e-9  # relative, of a limit: what rounding may add
SHOWN = 5  # findings of a kind that are told in full
NAMES = ("velocity", "acceleration", "jerk")


@dataclass
class Verdict:
    """What was seen, and what was found: counts by kind, and the first of each in words."""

    cycles: int = 0
    gaps: int = 0
    missed: int = 0
    commands: int = 0
    goals: Counter[str] = field(default_factory=Counter)
    faults: int = 0
    anchors: int = 0
    late: int = 0
    deaths: int = 0
    homings: int = 0
    switches: int = 0
    stops: int = 0
    fed: int = 0
    largest: dict[str, float] = field(default_factory=dict)
    findings: Counter[str] = field(default_factory=Counter)
    words: list[str] = field(default_factory=list)

    def find(self, kind: str, text: str) -> None:
        """One more finding."""
        self.findings[kind] += 1
        if self.findings[kind] <= SHOWN:
            self.words.append(f"{kind}: {text}")


def limits_matrix(raw: Any) -> NDArray[np.float64]:
    """Velocity, acceleration, jerk (3,) of a ``sj_limits`` row, the larger of both directions."""
    return np.array(
        [
            raw["velocity"],
            max(raw["acceleration"], raw["deceleration"]),
            max(raw["jerk"], raw["deceleration_jerk"]),
        ]
    )


def check(recording: Recording, first: int = 0) -> Verdict:
    """Judge the whole recording. ``first``: cycles at the begin that are not judged."""
    verdict = Verdict()
    chunk = recording.all
    frames, axes = chunk.frames[first:], len(recording.axes)
    verdict.cycles = len(frames)
    verdict.gaps = len(recording.gaps)
    verdict.missed = int(chunk.missed.sum())
    verdict.commands = len(chunk.commands)
    kinds = Counter(chunk.events["kind"].tolist())
    verdict.faults = kinds[EventKind.FAULT]
    verdict.anchors = kinds[EventKind.ANCHOR]
    verdict.switches = kinds[EventKind.SWITCH]
    verdict.stops = kinds[EventKind.STOP]
    homing = (chunk.events["kind"] == EventKind.STATE) & (
        chunk.events["code"] == lib.SJ_AXIS_HOMING
    )
    verdict.homings = int(homing.sum())
    dead = (chunk.events["kind"] == EventKind.HOST) & (chunk.events["code"] == lib.SJ_HOST_DEAD)
    verdict.deaths = int(dead.sum())
    verdict.late = int(frames["late"][-1]) if len(frames) else 0
    goals = _answers(recording, verdict)
    for axis in range(axes):
        _axis(recording, frames, axis, goals, verdict)
    return verdict


# ---- goals and their answers ---------------------------------------------------------------------


@dataclass(frozen=True)
class Goal:
    """Limits (axes, 3) and which axes, of a goal that was taken."""

    cycle: int
    limits: NDArray[np.float64]
    chosen: NDArray[np.bool_]


def _goal(cycle: int, entries: Any) -> Goal:
    limits = np.array([limits_matrix(entry["limits"]) for entry in entries])
    return Goal(cycle, limits, entries["kind"] != lib.SJ_GOAL_NONE)


def _answers(recording: Recording, verdict: Verdict) -> dict[int, Goal]:
    """Every goal that was taken has exactly one answer; the goals by id."""
    chunk, axes = recording.all, len(recording.axes)
    told = chunk.events[chunk.events["kind"] == EventKind.GOAL]
    answers: dict[int, list[tuple[int, int]]] = {}
    for row in told:
        answers.setdefault(int(row["goal_id"]), []).append((int(row["cycle"]), int(row["code"])))
    goals: dict[int, Goal] = {}
    commands = np.ascontiguousarray(chunk.commands["data"]).view(command_dtype(axes))
    before = 0
    for cycle, command in zip(chunk.commands["cycle"].tolist(), commands, strict=True):
        number = int(command["goal_id"])
        if number == before:
            continue
        before = number
        goals[number] = _goal(cycle, command["axis"]["goal"])
        found = answers.pop(number, [])
        if [c for c, _ in found] != [cycle] and not recording.gaps:
            verdict.find("goal without its answer", f"goal {number} of cycle {cycle}: {found}")
        for _, code in found[:1]:
            verdict.goals["accepted" if code == lib.SJ_RESULT_ACCEPTED else "refused"] += 1
    _records(recording, verdict, goals, answers)
    for number, found in answers.items() if not recording.gaps else ():
        verdict.find("answer without a goal", f"goal {number}: {found}")
    return goals


def _records(
    recording: Recording, verdict: Verdict, goals: dict[int, Goal], answers: dict[int, Any]
) -> None:
    """Queued moves: one answer each, when they begin or are dropped; those that wait have none."""
    kind = record_dtype(len(recording.axes))
    records = np.ascontiguousarray(recording.records["data"]).view(kind)
    taken: dict[int, int] = {}
    paths = set()
    for cycle, record in zip(recording.records["cycle"].tolist(), records, strict=True):
        number = int(record["goal_id"])
        if record["kind"] == lib.SJ_RECORD_SEGMENT:
            continue
        taken[number] = cycle
        if record["kind"] == lib.SJ_RECORD_PATH:
            paths.add(number)  # a segment of it may be refused later
        elif record["kind"] == lib.SJ_RECORD_MOVE:
            goals[number] = _goal(cycle, record["axis"]["goal"])
    for number, cycle in taken.items():
        found = answers.pop(number, [])
        later = [] if number in paths else found[1:]
        if later or any(c < cycle for c, _ in found):
            verdict.find("record with odd answers", f"goal {number} of cycle {cycle}: {found}")
        name = "queued" if found else "waiting at the end"
        verdict.goals[name] += 1


# ---- one axis ------------------------------------------------------------------------------------


def _axis(
    recording: Recording, frames: Any, i: int, goals: dict[int, Goal], verdict: Verdict
) -> None:
    rows, cycle = frames["axis"][:, i], frames["head"]["cycle"].astype(np.int64)
    axis, T = recording.axes[i], recording.cycle_time
    follows = (rows["flags"] & lib.SJ_TRACE_FOLLOWS) != 0
    q, v, a, j = (rows[name] for name in ("position", "velocity", "acceleration", "jerk"))
    # a stretch: consecutive cycles in which the drive follows
    joined = np.zeros(len(rows), bool)
    joined[1:] = follows[1:] & follows[:-1] & (np.diff(cycle) == 1)
    counts = axis.counts_per_unit * axis.gear
    own, stop = _per_cycle(axis.limits, T), _per_cycle(axis.stop_limits or axis.limits, T)
    ulp = np.spacing(np.abs(q)) + 1e-300
    # a path or a held move at another speed is judged by its positions: it has no jerk of its own
    led = (rows["flags"] & (lib.SJ_TRACE_PATH | lib.SJ_TRACE_FEED_HOLD)) != 0
    free = joined & ~led
    free[1:] &= ~led[:-1]

    for x, rate, name in ((q, v, "position"), (v, a, "velocity"), (a, j, "acceleration")):
        expected = x[:-1] + (rate[1:] + rate[:-1]) / 2
        scale = own[NAMES.index(name)] if name in NAMES else own[0]
        most = SLACK * scale + (8 * ulp[1:] if name == "position" else 0.0)
        for k in np.flatnonzero(free[1:] & (np.abs(x[1:] - expected) > most)):
            verdict.find(
                f"step of the {name}", f"axis {i}, cycle {cycle[k + 1]}: {x[k]!r} to {x[k + 1]!r}"
            )
    off = follows & (np.abs(rows["target_counts"] - q * counts) > 0.5 + 1e-6)
    away = ~follows & (np.abs(q - rows["actual_counts"] / counts) > 4 * ulp)
    for wrong, name in ((off, "target off its position"), (away, "command off the drive")):
        for k in np.flatnonzero(wrong):
            verdict.find(name, f"axis {i}, cycle {cycle[k]}: {q[k]!r}")
    left = (rows["flags"] & lib.SJ_TRACE_DRIVE_STOP) != 0
    led_here = follows & (
        rows["state"] != lib.SJ_AXIS_HOMING
    )  # a homing axis is its drive's to stop
    for k in np.flatnonzero(left[1:] & ~left[:-1] & led_here[:-1] & (np.diff(cycle) == 1)):
        verdict.find("left to its drive", f"axis {i}, cycle {cycle[k + 1]}: {q[k + 1]!r}")
    if axis.limits.position is not None:
        low, high = axis.limits.position
        out = joined[1:] & (
            ((q[1:] > high + 1e-9) & (q[1:] > q[:-1])) | ((q[1:] < low - 1e-9) & (q[1:] < q[:-1]))
        )
        for k in np.flatnonzero(out):
            verdict.find("position limit", f"axis {i}, cycle {cycle[k + 1]}: {q[k + 1]!r}")
    _fed(recording, rows, i, follows, joined, verdict)
    allowed = _allowed(recording, frames, i, goals, stop, joined)
    for n, name in enumerate(NAMES, start=1):
        change = np.diff(q, n)
        inside = np.ones(len(change), bool)
        for back in range(n):  # all n + 1 samples in one stretch
            inside &= joined[n - back : len(rows) - back]
        most = allowed[n:, n - 1] * (1.0 + SLACK) + 2**n * 2 * ulp[n:]
        wrong = inside & (np.abs(change) > most)
        with np.errstate(invalid="ignore", divide="ignore"):
            share = np.abs(change[inside]) / allowed[n:, n - 1][inside]
        if len(share):
            verdict.largest[name] = max(verdict.largest.get(name, 0.0), float(np.nanmax(share)))
        for k in np.flatnonzero(wrong):
            verdict.find(
                f"limit of {name}",
                f"axis {i}, cycle {cycle[k + n]}: {abs(change[k]) / most[k]:.9f} of it, "
                f"goal {rows['goal_id'][k + n]}",
            )


def _fed(
    recording: Recording, rows: Any, i: int, follows: Any, joined: Any, verdict: Verdict
) -> None:
    """60B1h is the difference of the positions, 60B2h what the motor needs for it, to one unit."""
    axis, T = recording.axes[i], recording.cycle_time
    v, t = rows["velocity_offset"], rows["torque_offset"]
    if axis.feed_forward is None or not isinstance(axis.drive, DriveConfig):
        for k in np.flatnonzero((v != 0) | (t != 0)):
            verdict.find("fed where nothing is to be", f"axis {i}: {v[k]}, {t[k]}")
        return
    for k in np.flatnonzero(~follows & ((v != 0) | (t != 0))):
        verdict.find("fed to a drive that does not follow", f"axis {i}: {v[k]}, {t[k]}")
    counts, drive, q = axis.counts_per_unit * axis.gear, axis.drive, rows["position"]
    noise = 4 * np.spacing(np.abs(q)) * counts / T
    step = np.diff(q, prepend=q[:1])
    off = joined & (np.abs(v - step * counts / T) > 0.5 + noise + np.abs(v) * 1e-12)
    for k in np.flatnonzero(off):
        verdict.find("60B1h", f"axis {i}, row {k}: {v[k]} of {step[k] * counts / T!r}")
    verdict.fed += int(joined.sum())
    if axis.feed_forward != "torque":
        return
    rad = 2.0 * np.pi * counts / drive.encoder_increments
    w, change = step * rad / T, np.diff(step, prepend=0.0)
    inertia = drive.inertia_kg_m2 * (1.0 + drive.load_inertia_ratio)
    torque = inertia * change * rad / T**2 + drive.viscous_nm_s * w
    torque += drive.friction_nm * w / (np.abs(w) + drive.friction_speed_rad_s)
    needed = 1e3 * torque / drive.rated_torque_nm
    whole = joined & np.roll(joined, 1)
    for k in np.flatnonzero(whole & (np.abs(t - needed) > 1.0 + 1e-3)):
        verdict.find("60B2h", f"axis {i}, row {k}: {t[k]} of {needed[k]!r}")


def _per_cycle(limits: Any, T: float) -> NDArray[np.float64]:
    acceleration = max(limits.acceleration, limits.deceleration or 0.0)
    jerk = max(limits.jerk, limits.deceleration_jerk or 0.0)
    return np.array([limits.velocity * T, acceleration * T**2, jerk * T**3])


def _allowed(
    recording: Recording, frames: Any, i: int, goals: dict[int, Goal], stop: Any, joined: Any
) -> NDArray[np.float64]:
    """Limits (cycles, 3) per cycle units that hold in each cycle."""
    rows = frames["axis"][:, i]
    n = len(rows)
    own = np.stack(
        [
            rows["limits"]["velocity"],
            np.maximum(rows["limits"]["acceleration"], rows["limits"]["deceleration"]),
            np.maximum(rows["limits"]["jerk"], rows["limits"]["deceleration_jerk"]),
        ],
        axis=1,
    )
    allowed = np.zeros((n, 3))
    rest = (rows["velocity"] == 0.0) & (rows["acceleration"] == 0.0) & (rows["jerk"] == 0.0)
    # an episode begins with the first cycle after a rest, or with a new stretch
    begins = np.flatnonzero((rest & ~np.roll(rest, -1)) | (~joined & np.roll(joined, -1)))
    begins = np.unique(np.concatenate([[0], begins]))
    ends = np.concatenate([begins[1:], [n]])
    halts = _halts(recording, i)
    led = (rows["flags"] & lib.SJ_TRACE_PATH) != 0
    path_begins = np.maximum.accumulate(np.where(led & ~np.roll(led, 1), np.arange(n), 0))
    cycle = frames["head"]["cycle"].astype(np.int64)
    torn = np.diff(cycle, prepend=cycle[:1] - 1) != 1
    for low, high in zip(begins.tolist(), ends.tolist(), strict=True):
        part = slice(low, high + 3 if high < n else n)  # the differences reach back
        most = np.zeros(3)
        override = float(frames["override"][max(low - 1, 0) : high].max())
        # its first cycle is still of the one before
        for number in np.unique(rows["goal_id"][min(low + 1, high - 1) : high]).tolist():
            goal = goals.get(number)
            if goal is None or not goal.chosen[i]:
                continue
            limits = goal.limits[i].copy()
            fastest = max(limits[0], own[low:high, 0].max())
            limits[0] = min(limits[0] * max(override, 1.0), fastest)
            most = np.maximum(most, limits)
        if led[low:high].any():  # by a path, which keeps the limits it began under
            first = path_begins[low + int(np.argmax(led[low:high]))]
            most = np.maximum(most, own[max(first - 1, 0) : high].max(axis=0))
        state = rows["state"][low:high]
        if (state == lib.SJ_AXIS_STOPPING).any() or (state == lib.SJ_AXIS_ERROR_STOP).any():
            most = np.maximum(most, stop)
        if torn[low] or torn[min(low + 1, n - 1)]:  # what came in a gap is not known
            most = np.full(3, np.inf)
        first, last = int(cycle[low]), int(cycle[high - 1])
        halted = np.searchsorted(halts, [first, last + 1])
        if most.max() == 0.0 or halted[1] > halted[0]:
            most = np.maximum(most, own[max(low - 1, 0) : high].max(axis=0))
        allowed[part] = np.maximum(allowed[part], most)
    return allowed


def _halts(recording: Recording, i: int) -> NDArray[np.int64]:
    """Cycles in which a halt may have come for this axis: commands, deaths, faults, the end."""
    chunk, axes = recording.all, len(recording.axes)
    commands = np.ascontiguousarray(chunk.commands["data"]).view(command_dtype(axes))
    halts = commands["axis"]["halts"][:, i].astype(np.int64) if len(commands) else np.zeros(0)
    found = [chunk.commands["cycle"][1:][np.diff(halts) != 0]] if len(commands) else []
    enable = commands["axis"]["enable"][:, i] if len(commands) else np.zeros(0)
    found += [chunk.commands["cycle"][1:][np.diff(enable) < 0]] if len(commands) else []
    found.append(chunk.commands["cycle"][:1][halts[:1] != 0])
    kinds = (
        *(EventKind.HOST, EventKind.FAULT, EventKind.FOLLOWING, EventKind.CORRUPT),
        *(EventKind.STOP, EventKind.SYNC),
    )
    found.append(chunk.events["cycle"][np.isin(chunk.events["kind"], kinds)])
    ending = np.flatnonzero(np.diff(chunk.frames["ending"], prepend=0) > 0)
    found.append(chunk.frames["head"]["cycle"][ending])
    return np.unique(np.concatenate(found).astype(np.int64))
