"""The host's side of a kernel: what a caller can ask of it, checked before it is sent.

Never here: how it is sent (``commander.py``), the cycle, the layout of the memory, bit masks of
drives.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

from sjerk._binding import ffi, lib
from sjerk.errors import InputError, QueueFullError, real
from sjerk.host.commander import Commander
from sjerk.host.monitor import RECORDS
from sjerk.host.move import Move
from sjerk.host.path import Blocks, Path
from sjerk.planner.planning import Synchronization, check_target, code_of, cycles_of
from sjerk.profile import Limits, State

Target = float | State
Axes = int | Iterable[int] | None
Direction = Literal["direct", "shortest", "positive", "negative"]
Buffer = Literal["aborting", "buffered", "blend low", "blend previous", "blend next", "blend high"]

#: PLCopen's buffer modes by their names here.
BUFFERS: dict[str, int] = {
    "aborting": lib.SJ_BUFFER_ABORTING,
    "buffered": lib.SJ_BUFFER_BUFFERED,
    "blend low": lib.SJ_BUFFER_LOW,
    "blend previous": lib.SJ_BUFFER_PREVIOUS,
    "blend next": lib.SJ_BUFFER_NEXT,
    "blend high": lib.SJ_BUFFER_HIGH,
}


def _patience(timeout: float | None) -> None:
    """What cannot be waited for is refused before anything is sent; but a stop is always sent."""
    if timeout is not None:
        real("timeout", timeout)


class Host(Commander):
    """The one host of a kernel: context manager, made by ``MotionKernel.host``.

    Leaving it is in order and stops nothing; a host that dies stops the motion.
    """

    def _chosen(self, axes: Axes) -> list[int]:
        if axes is None:
            return list(range(self._axes))
        if not isinstance(axes, int | Iterable):
            raise InputError("axes", axes, f"axis numbers are 0 .. {self._axes - 1}")
        chosen = [axes] if isinstance(axes, int) else list(axes)
        for i in chosen:
            if not isinstance(i, int) or isinstance(i, bool) or not 0 <= i < self._axes:
                raise InputError("axes", i, f"axis numbers are 0 .. {self._axes - 1}")
        return chosen

    def _joints(self, axes: Axes) -> list[int]:
        """One axis per joint."""
        chosen = self._chosen(axes)
        if not chosen or len(set(chosen)) != len(chosen):
            raise InputError("axes", chosen, "must be at least one, and differ")
        return chosen

    def enable(self, timeout: float | None = 5.0, *, axes: Axes = None) -> None:
        """Enable drives; returns when every one follows (at once in a caller's own loop)."""
        _patience(timeout)
        chosen = self._enable(axes, 1)
        if self._cyclic:
            self._wait_until(
                lambda frame: all(frame.axis[i].follows for i in chosen),
                timeout,
                "drives to follow",
            )

    def disable(self, timeout: float | None = 5.0, *, axes: Axes = None) -> None:
        """Disable drives, each once it is at rest."""
        chosen = self._enable(axes, 0)
        if self._cyclic:
            self._wait_until(
                lambda frame: not any(frame.axis[i].enabled for i in chosen),
                timeout,
                "drives to rest",
            )

    def _enable(self, axes: Axes, level: int) -> list[int]:
        chosen = self._chosen(axes)
        with self._lock:
            for i in chosen:
                self._command.axis[i].enable = level
            if not level:
                self._stopping(chosen)
            self._publish()
        return chosen

    def reset(self, *, axes: Axes = None, timeout: float | None = 5.0) -> None:
        """Reset the faults of drives, and the kernel's own errors, once.

        A look-ahead ring that a wild writer has spoilt is emptied.
        """
        _patience(timeout)
        frame = self._read()
        if frame is not None and frame.ring_spoilt:
            lib.sj_ring_flush(self._segment.base)
            self._flushed = lib.sj_ring_published(self._segment.base)
        self._taken(self._count("resets", self._chosen(axes)), timeout, "the reset")

    def halt(self, timeout: float | None = 30.0, *, axes: Axes = None) -> None:
        """Bring axes to rest within the limits of their moves; returns at rest.

        All axes of a move slow down together. A new goal may replace a halt. In a caller's own loop
        it returns at once.
        """
        self._stopped("halts", axes, timeout)

    def stop(self, timeout: float | None = 30.0) -> None:
        """Halt all axes."""
        self.halt(timeout)

    def quick_stop(
        self, timeout: float | None = 30.0, *, axes: Axes = None, together: bool = False
    ) -> None:
        """Bring each axis to rest as soon as its own stop limits allow.

        Goals are refused until then. ``together``: all of them as late as the slowest, where the
        way to a goal and the limits allow.
        """
        with self._lock:
            for i in self._chosen(axes):
                self._command.axis[i].together = bool(together)
        self._stopped("quick_stops", axes, timeout)

    def _stopped(self, edge: str, axes: Axes, timeout: float | None) -> None:
        chosen = self._chosen(axes)
        sequence = self._count(edge, chosen)
        if self._cyclic:
            self._wait_until(
                lambda frame: (
                    frame.sequence >= sequence and not any(frame.axis[i].moving for i in chosen)
                ),
                timeout,
                "the stop",
            )

    def override(self, factor: float, timeout: float | None = 5.0) -> None:
        """Scale the velocities of all motions, 0 .. 2; in motion too, within the axes' limits.

        Goals are planned anew from the commanded state, so acceleration and jerk keep their limits;
        no motion becomes faster than the axis or its goal allows. 0 waits as ``hold`` does.
        """
        if not 0.0 <= real("factor", factor) <= 2.0:
            raise InputError("factor", factor, "must lie in 0 .. 2")
        _patience(timeout)
        self._level("override", factor, timeout)

    def hold(self, timeout: float | None = 5.0) -> None:
        """Come to rest on the way to the goals and keep them; ``resume`` goes on.

        Axes that are synchronised stay on the way that was planned, together; where one brakes at
        its limit already, that may be at the goal. A stop is ``halt`` or ``quick_stop``, not this.
        """
        self._level("hold", 1, timeout)

    def resume(self, timeout: float | None = 5.0) -> None:
        """Go on to the goals after ``hold``."""
        _patience(timeout)
        self._level("hold", 0, timeout)

    def _level(self, name: str, value: float, timeout: float | None) -> None:
        with self._lock:
            setattr(self._command, name, value)
            self._publish()
            sequence = int(self._command.sequence)
        self._taken(sequence, timeout, name)

    def set_limits(self, limits: Limits, *, axes: Axes = None, timeout: float | None = 5.0) -> None:
        """Give axes other limits from their next goal, jog or halt on; a motion keeps its own.

        Position limits stay those of the kernel. Raises RefusedError where the drive is slower.
        """
        _patience(timeout)
        chosen = self._chosen(axes)
        with self._lock:
            for i in chosen:
                entry = self._command.axis[i]
                rows = limits._per_cycle(self._T)
                ffi.memmove(ffi.addressof(entry, "limits"), rows, len(rows))
                entry.limit_sets = (entry.limit_sets + 1) % 2**32
            self._publish()
            sequence = int(self._command.sequence)
        self._taken(sequence, timeout, "the limits")
        frame = self._frame() if self._cyclic else None
        for i in chosen:
            asked = self._command.axis[i].limits.velocity
            if frame is not None and frame.axis[i].limits.velocity != asked:
                code = lib.SJ_RESULT_SPEED
                raise self._refusal(code, i)
            self._limits[i] = replace(limits, position=self._limits[i].position)

    def move(
        self,
        target: Target | Sequence[Target] | Mapping[int, Target],
        *,
        limits: Limits | Mapping[int, Limits] | None = None,
        synchronization: Synchronization = "time",
        min_duration: float = 0.0,
        relative: bool = False,
        direction: Direction = "direct",
        buffer: Buffer = "aborting",
    ) -> Move:
        """Move to a target: of the one axis, of all axes, or by axis number.

        A target is a position, or a ``State`` with a velocity to arrive with; ``relative``: a
        distance from the commanded position. The kernel plans in its next cycle from the commanded
        state, also during a motion, which the new goal replaces; the same goal under the same
        limits changes nothing. ``limits``: lower ones than the axes' own for this move, one for
        all its axes or by axis number, the rest at their own; position limits stay in force.
        ``direction``: of axes that wrap, which way to a position within the turn.

        ``buffer``, as in PLCopen: ``"aborting"`` replaces at once, and clears the queue of its
        axes; ``"buffered"`` begins in the cycle after the one before is done; a blend lets the one
        before pass its goal at the lower of both velocities, at its own (previous), at the new
        one's (next), or at the higher, as far as both ways and limits allow. Relative: from the
        goal before.

        Returns at once; the handle tells the rest. Raises InputError for what is no target, and
        QueueFullError; a refusal by the kernel is raised by ``Move.wait``.
        """
        if buffer not in BUFFERS:
            raise InputError("buffer", buffer, f"must be one of {', '.join(BUFFERS)}")
        if buffer != "aborting" and direction != "direct":
            raise InputError("direction", direction, "a queued move has no place yet to turn from")
        if buffer.startswith("blend") and synchronization == "phase":
            raise InputError("synchronization", "phase", "begins and ends at rest, without a blend")
        targets = self._targets(target)
        code, least = code_of(synchronization), cycles_of(min_duration, self._T)
        own = self._lower(limits, targets)
        if direction != "direct":
            targets = self._turned(targets, direction)
        for i, goal in targets.items():
            for within in (self._limits[i], own[i]):
                free = replace(within, position=None) if relative else within
                check_target(f"target[{i}]", goal, free)
        kind = lib.SJ_GOAL_RELATIVE if relative else lib.SJ_GOAL_ABSOLUTE
        if buffer != "aborting":
            return self._queue(kind, targets, own, code, least, BUFFERS[buffer])
        return self._goal(kind, targets, own, code, least)

    def follow(
        self,
        blocks: Blocks,
        *,
        axes: Sequence[int] | None = None,
    ) -> Path:
        """Play a followed trajectory in the kernel's cycle: what ``follow``, ``follow_path`` give.

        ``blocks`` are consumed as the kernel takes them, by a thread, or by ``Path.pump`` in a
        caller's own loop; a source may yield None where its next block is not there yet. ``axes``:
        one per joint, else all in order. The path begins from rest at its first way-point (``move``
        there before) when the axes are at rest and no other path plays; what comes later for these
        axes waits for its end. Returns at once; the handle tells the rest. Raises InputError, and
        what the source of the blocks raises at first; a refusal by the kernel is raised by
        ``Path.wait``.
        """
        return Path(self, blocks, self._joints(axes))

    def jog(
        self,
        velocity: float | Sequence[float] | Mapping[int, float],
        *,
        limits: Limits | Mapping[int, Limits] | None = None,
    ) -> Move:
        """Move with a velocity (axis unit / s) until told otherwise.

        At a position limit it comes to rest; then the velocity is what whole cycles leave of it.

        One velocity for the one axis, one per axis, or by axis number; 0 brings to rest. The handle
        is never ``done``: ``cancel`` it, or give another goal. Raises InputError.
        """
        wanted = self._by_axis("velocity", velocity)
        own = self._lower(limits, wanted)
        targets = {i: State(0.0, real(f"velocity[{i}]", v)) for i, v in wanted.items()}
        for i, goal in targets.items():
            check_target(f"velocity[{i}]", goal, replace(own[i], position=None))
        return self._goal(lib.SJ_GOAL_JOG, targets, own, lib.SJ_SYNC_NONE, 0)

    def home(self, *, axes: Axes = None) -> Move:
        """Let drives home by their own method (6098h); the frame shifts without a step.

        The handle is done when the drive has attained its home and follows again.
        """
        chosen = self._chosen(axes)
        targets = {i: State(0.0) for i in chosen}
        own = {i: self._limits[i] for i in chosen}
        return self._goal(lib.SJ_GOAL_HOME, targets, own, lib.SJ_SYNC_NONE, 0)

    def _lower(
        self, limits: Limits | Mapping[int, Limits] | None, axes: Iterable[int]
    ) -> dict[int, Limits]:
        """The limits of a goal by axis: the axes' own, or lower ones."""
        own = {i: self._limits[i] for i in axes}
        if limits is None:
            return own
        lower = limits if isinstance(limits, Mapping) else dict.fromkeys(own, limits)
        for i, asked in lower.items():
            if i not in own:
                raise InputError("limits", i, f"the goal is of axes {', '.join(map(str, own))}")
            if not isinstance(asked, Limits):
                raise InputError("limits", asked, "must be a Limits")
            for name in ("velocity", "acceleration", "jerk", "deceleration", "deceleration_jerk"):
                value, most = getattr(asked, name), getattr(self._limits[i], name)
                if value > most * (1 + 1e-12):
                    raise InputError(f"limits.{name}", value, f"axis {i} has {most!r}")
            own[i] = asked
        return own

    def _goal(
        self, kind: int, targets: dict[int, State], own: dict[int, Limits], code: int, least: int
    ) -> Move:
        with self._lock:
            command = self._command
            command.synchronization, command.least_cycles = code, least
            for i in range(self._axes):
                entry = command.axis[i].goal
                if i in targets:
                    self._fill(entry, kind, targets[i], own[i])
                else:
                    entry.kind = lib.SJ_GOAL_NONE
            command.goal_id = self._next_goal()
            self._replacing(int(command.goal_id), targets)
            self._publish()
            known = kind == lib.SJ_GOAL_ABSOLUTE
            return Move(self, int(command.goal_id), targets, known=known, limits=own)

    def _queue(
        self,
        kind: int,
        targets: dict[int, State],
        own: dict[int, Limits],
        code: int,
        least: int,
        mode: int,
    ) -> Move:
        record = ffi.new("sj_record *")
        record.kind, record.mode = lib.SJ_RECORD_MOVE, mode
        record.synchronization, record.least_cycles = code, least
        for i, target in targets.items():
            self._fill(record.axis[i].goal, kind, target, own[i])
        with self._lock:
            record.goal_id = self._next_goal()
            number = self._publish_records(record, 1)
        if not number:
            raise QueueFullError(RECORDS)
        known = kind == lib.SJ_GOAL_ABSOLUTE
        return Move(self, int(record.goal_id), targets, known=known, number=number, limits=own)

    def _fill(self, entry: Any, kind: int, target: State, limits: Limits) -> None:
        entry.kind, entry.goal = kind, target.position
        entry.goal_velocity = target.velocity * self._T
        rows = limits._per_cycle(self._T)
        ffi.memmove(ffi.addressof(entry, "limits"), rows, len(rows))

    def _turned(self, targets: dict[int, State], direction: str) -> dict[int, State]:
        """Goals of axes that wrap, by the way that is asked for."""
        if direction not in ("shortest", "positive", "negative"):
            raise InputError(
                "direction", direction, "must be direct, shortest, positive or negative"
            )
        frame, found = self._frame(), {}
        for i, goal in targets.items():
            wrap, at = self._wraps[i], float(frame.axis[i].position)
            if not wrap:
                raise InputError("direction", direction, f"axis {i} does not wrap")
            way = (goal.position - at) % wrap
            if direction == "negative" or (direction == "shortest" and way > wrap / 2):
                way -= wrap if way else 0.0
            found[i] = replace(goal, position=at + way)
        return found

    def _by_axis(self, field: str, given: Any) -> dict[int, Any]:
        """What is given by axis number, one per axis, or for the one axis."""
        axes = self._axes
        if isinstance(given, Mapping):
            wanted: dict[int, Any] = dict(given)
        elif isinstance(given, Sequence) and not isinstance(given, str):
            if len(given) != axes:
                raise InputError(field, given, f"must have one {field} per axis ({axes})")
            wanted = dict(enumerate(given))
        elif axes == 1:
            wanted = {0: given}
        else:
            raise InputError(field, given, f"must be by axis number: {axes} axes")
        for i in wanted:
            if not isinstance(i, int) or not 0 <= i < axes:
                raise InputError(field, i, f"axis numbers are 0 .. {axes - 1}")
        if not wanted:
            raise InputError(field, given, "must name at least one axis")
        return wanted

    def _targets(
        self, target: Target | Sequence[Target] | Mapping[int, Target]
    ) -> dict[int, State]:
        return {
            i: value if isinstance(value, State) else State(real(f"target[{i}]", value))
            for i, value in self._by_axis("target", target).items()
        }
