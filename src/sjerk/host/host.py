"""The host of a kernel: what a caller can ask of it, checked before it is sent.

Never here: how it is sent (``link.py``), the cycle, the layout of the memory, bit masks of drives.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Self

from sjerk._binding import ffi, lib
from sjerk.errors import HostTakenError, InputError, QueueFullError, real
from sjerk.handshake import Segment
from sjerk.host.answers import refusal
from sjerk.host.arguments import (
    BUFFERS,
    Axes,
    Buffer,
    Direction,
    Target,
    axis_numbers,
    by_axis,
    check_factor,
    check_targets,
    joint_axes,
    lower_limits,
    patience,
    targets_of,
    turned,
)
from sjerk.host.link import Link
from sjerk.host.monitor import Observer
from sjerk.host.move import Move
from sjerk.host.path import Path, play
from sjerk.host.path_records import Blocks
from sjerk.host.reader import RECORDS, layout
from sjerk.planner import Synchronization, check_target, code_of, cycles_of, moving_of
from sjerk.profile import FloatArray, Limits, State

#: States of an axis whose drive is off and that has come to know it.
_DISABLED = (lib.SJ_AXIS_DISABLED, lib.SJ_AXIS_ERROR_STOP)


class Host(Observer):
    """The one host of a kernel: context manager, made by ``MotionKernel.host``.

    Leaving it is in order and stops nothing; a host that dies stops the motion.

    >>> from sjerk import Axis, MotionKernel
    >>> kernel = MotionKernel([Axis(Limits(90.0, 500.0, 5000.0), 2**24 / 360, "ideal")])
    >>> with kernel.host() as host:
    ...     host.enable()
    ...     kernel.step(5)
    ...     move = host.move(1.0)
    ...     kernel.step(400)
    ...     print(move.state.name, host.feedback().axes[0].position)
    DONE 1.0
    """

    def __init__(self, link: Link) -> None:
        """Not for callers: ``MotionKernel.host``, or ``attach`` from another process."""
        super().__init__(link)
        self._link = link

    @classmethod
    def attach(
        cls,
        name: str,
        limits: Sequence[Limits] | None = None,
        cycle_time: float | None = None,
        *,
        wait: float = 0.0,
        any_owner: bool = False,
    ) -> Self:
        """Become the host of the running kernel ``name`` from another process.

        ``limits`` (one per axis) and ``cycle_time`` (s): what the caller takes for granted; the
        kernel reports both. ``wait``: seconds to wait for a host that is about to leave.
        ``any_owner``: also of a kernel of another user, who let a group in.
        Raises HandshakeError: no such kernel, another number of axes, another version, or a living
        host; InputError: another cycle time.
        """
        expected = None
        if limits is not None:
            if isinstance(limits, Limits) or not all(isinstance(one, Limits) for one in limits):
                raise InputError("limits", limits, "must be a list of one Limits per axis")
            expected = layout(len(limits))
        end = time.monotonic() + wait
        while True:
            try:
                segment = Segment.attach(name, expected, role="host", any_owner=any_owner)
                link = Link(segment, clocked=True)
                break
            except HostTakenError:
                if time.monotonic() > end:
                    raise
                time.sleep(1e-3)
        own = link.cycle_time
        if cycle_time is not None and abs(own - cycle_time) > 1e-9 * own:
            link.close()
            raise InputError("cycle_time", cycle_time, f"the kernel's is {own!r}")
        return cls(link)

    @property
    def link(self) -> Link:
        """The exchanges with the kernel as they are, for programs that build on them."""
        return self._link

    @property
    def cycle_time(self) -> float:
        """Control cycle of the kernel, seconds."""
        return self._link.cycle_time

    @property
    def axis_count(self) -> int:
        """How many axes the kernel has."""
        return self._link.axes

    @property
    def names(self) -> tuple[str, ...]:
        """What the axes are called (``Axis.name``), by number; "" where one has no name."""
        return self._link.names

    @property
    def clocked(self) -> bool:
        """Whether a process runs the cycle, so that waiting makes sense; else ``step`` does."""
        return self._link.clocked

    @property
    def limits(self) -> tuple[Limits, ...]:
        """The axes' own limits, by axis number, as the next goal is checked against them."""
        return tuple(self._link.limits)

    # ---- being watched

    def watch(self, timeout: float | None) -> None:
        """Let the kernel react when this host says nothing for so long (s); None: no longer.

        A command, a reading, a wait, or ``beat`` is a sign of life; ``Reactions.host_silence`` is
        what follows. For a kernel in its process. Raises InputError, SjerkError.
        """
        self._link.watch(timeout)

    def beat(self) -> None:
        """Give a sign of life, where a host that is watched has nothing else to say."""
        self._link.beat()

    # ---- power

    def enable(self, timeout: float | None = 5.0, *, axes: Axes = None) -> None:
        """Enable drives; returns when every one follows (at once in a caller's own loop).

        ``axes``: a number or numbers, None: all; ``timeout`` in seconds, None: without an end. An
        axis in ErrorStop stays there until ``reset``. Raises InputError, TimeoutError where a drive
        does not follow, KernelGoneError.
        """
        patience(timeout)
        chosen = self._enable(axes, 1)
        if self._link.clocked:
            self._link.wait_until(
                lambda frame: all(frame.axis[i].follows for i in chosen),
                timeout,
                "drives to follow",
            )

    def disable(self, timeout: float | None = 5.0, *, axes: Axes = None) -> None:
        """Stop as ``halt`` does, then disable these drives, each once it is at rest.

        Whatever moves them: a jog, a move, a path, held or not. What waits for them is dropped. A
        drive that homes stops by its own ramp (605Ch). ``timeout`` as of ``halt``.

        >>> from sjerk import Axis, MotionKernel
        >>> kernel = MotionKernel([Axis(Limits(90.0, 500.0, 5000.0), 2**24 / 360, "ideal")])
        >>> host = kernel.host()
        >>> host.enable()
        >>> kernel.step(5)
        >>> jog = host.jog(30.0)
        >>> kernel.step(300)
        >>> host.disable()
        >>> kernel.step(300)
        >>> host.feedback().axes[0].enabled, jog.state.name
        (False, 'STOPPED')
        """
        chosen = self._enable(axes, 0)
        if self._link.clocked and timeout != 0.0:
            self._link.wait_until(
                lambda frame: (
                    not any(
                        frame.axis[i].enabled or frame.axis[i].state not in _DISABLED
                        for i in chosen
                    )
                ),
                timeout,
                "drives to rest",
            )

    def _enable(self, axes: Axes, level: int) -> list[int]:
        chosen = axis_numbers(axes, self.axis_count)
        with self._link.lock:
            for i in chosen:
                self._link.command.axis[i].enable = level
            if not level:
                self._link.stopping(chosen)
            self._link.publish()
        return chosen

    def reset(self, *, axes: Axes = None, timeout: float | None = 5.0) -> None:
        """Reset the faults of drives, and the kernel's own errors, once.

        A corrupt look-ahead ring is emptied. An axis whose motor is beyond its following error
        fails again at once: ``disable``, ``reset``, ``enable`` begin where it is. ``axes``,
        ``timeout`` as of ``enable``. Raises InputError, TimeoutError, KernelGoneError.
        """
        patience(timeout)
        frame = self._link.read()
        if frame is not None and frame.ring_corrupt:
            self._link.flush()
        number = self._link.count("resets", axis_numbers(axes, self.axis_count))
        self._link.await_taken(number, timeout, "the reset")

    def halt(self, timeout: float | None = 30.0, *, axes: Axes = None) -> None:
        """Bring axes to rest within the limits of their moves; returns at rest.

        All axes of a move slow down together. A new goal may replace a halt. With ``timeout`` 0 the
        order is sent and nothing is waited for, as in a caller's own loop; else it is in seconds,
        None: without an end. Raises InputError, TimeoutError and KernelGoneError, both behind the
        order.
        """
        self._stopped("halts", axes, timeout)

    def stop(self, timeout: float | None = 30.0) -> None:
        """Halt all axes; as ``halt``."""
        self.halt(timeout)

    def quick_stop(
        self, timeout: float | None = 30.0, *, axes: Axes = None, together: bool = False
    ) -> None:
        """Bring each axis to rest as soon as its own stop limits allow.

        Goals are refused until then. ``together``: all of them as late as the slowest, where the
        distance to the goal and the limits allow. ``timeout`` as of ``halt``.
        """
        with self._link.lock:
            for i in axis_numbers(axes, self.axis_count):
                self._link.command.axis[i].together = bool(together)
        self._stopped("quick_stops", axes, timeout)

    def _stopped(self, edge: str, axes: Axes, timeout: float | None) -> None:
        chosen = axis_numbers(axes, self.axis_count)
        sequence = self._link.count(edge, chosen)
        if self._link.clocked and timeout != 0.0:
            self._link.wait_until(
                lambda frame: (
                    frame.sequence >= sequence and not any(frame.axis[i].moving for i in chosen)
                ),
                timeout,
                "the stop",
            )

    def override(self, factor: float, timeout: float | None = 5.0) -> None:
        """Feed override: scale the velocities of all motions, 0 .. 2, in motion too.

        Goals are planned anew from the commanded state, so acceleration and jerk keep their limits;
        no motion becomes faster than the axis or its goal allows. 0 waits as ``hold`` does. Raises
        InputError.
        """
        check_factor(factor)
        patience(timeout)
        self._level("override", factor, timeout)

    def hold(self, timeout: float | None = 5.0) -> None:
        """Feed hold: come to rest before the goals and keep them; ``resume`` goes on.

        Axes that are synchronised stay on the path that was planned, together; where one brakes at
        its limit already, that may be at the goal. A stop is ``halt`` or ``quick_stop``, not this.
        """
        self._level("hold", 1, timeout)

    def resume(self, timeout: float | None = 5.0) -> None:
        """Go on to the goals after ``hold``."""
        patience(timeout)
        self._level("hold", 0, timeout)

    def _level(self, name: str, value: float, timeout: float | None) -> None:
        with self._link.lock:
            setattr(self._link.command, name, value)
            sequence = self._link.publish()
        self._link.await_taken(sequence, timeout, name)

    def set_limits(self, limits: Limits, *, axes: Axes = None, timeout: float | None = 5.0) -> None:
        """Give axes other limits from their next goal, jog or halt on; a motion keeps its own.

        Position limits stay those of the kernel. Raises RefusedError where the drive is slower.
        """
        patience(timeout)
        chosen = axis_numbers(axes, self.axis_count)
        if not isinstance(limits, Limits):
            raise InputError("limits", limits, "must be a Limits")
        with self._link.lock:
            for i in chosen:
                entry = self._link.command.axis[i]
                self._link.fill_limits(entry, limits)
                entry.limit_sets = (entry.limit_sets + 1) % 2**32
            sequence = self._link.publish()
        self._link.await_taken(sequence, timeout, "the limits")
        frame = self._link.frame() if self._link.clocked else None
        for i in chosen:
            asked = self._link.command.axis[i].limits.velocity
            if frame is not None and frame.axis[i].limits.velocity != asked:
                raise refusal(lib.SJ_RESULT_SPEED, i, names=self._link.names)
            self._link.limits[i] = replace(limits, position=self._link.limits[i].position)

    def move(
        self,
        target: Target | Sequence[Target] | Mapping[int, Target] | FloatArray,
        *,
        limits: Limits | Mapping[int, Limits] | None = None,
        synchronization: Synchronization = "time",
        min_duration: float = 0.0,
        relative: bool = False,
        direction: Direction = "direct",
        buffer: Buffer = "aborting",
        moving: bool = False,
    ) -> Move:
        """Move to a target: of the one axis, of all axes, or by axis number.

        A target is a position, or a ``State`` with a velocity to arrive with; ``relative``: a
        distance from the commanded position. The kernel plans in its next cycle from the commanded
        state, also during a motion, which the new goal replaces; the same goal under the same
        limits changes nothing. ``limits``: lower ones than the axes' own for this move, one for
        all its axes or by axis number, the rest at their own; position limits stay in force.
        ``direction``: of axes that wrap, in which direction to a position within the turn.

        ``buffer``, as in PLCopen: ``"aborting"`` replaces at once, and clears the queue of its
        axes; ``"buffered"`` begins in the cycle after the one before is done; a blend lets the one
        before pass its goal at the lower of both velocities, at its own (previous), at the new
        one's (next), or at the higher, as far as both distances and limits allow.
        Relative: from the goal before.

        ``moving``: a target that moves on with its velocity, such as a new ``State`` every few
        cycles; see ``plan``. Each axis may meet it up to a cycle later on its line: one axis, or
        ``synchronization="none"``, and ``"aborting"``.

        Returns at once; the handle shows the rest. Raises InputError for what is no target, and
        QueueFullError; a refusal by the kernel is raised by ``Move.wait``.
        """
        if buffer not in BUFFERS:
            raise InputError("buffer", buffer, f"must be one of {', '.join(BUFFERS)}")
        if buffer != "aborting" and direction != "direct":
            raise InputError("direction", direction, "a queued move has no place yet to turn from")
        if buffer.startswith("blend") and synchronization == "phase":
            raise InputError("synchronization", "phase", "begins and ends at rest, without a blend")
        targets = targets_of(target, self.axis_count)
        code, least = code_of(synchronization), cycles_of(min_duration, self.cycle_time)
        code = moving_of(moving, code, list(targets.values()), least)
        if moving and buffer != "aborting":
            raise InputError("buffer", buffer, "must be 'aborting' for targets that move on")
        own = lower_limits(limits, targets, self._link.limits)
        if direction != "direct":
            frame = self._link.frame()
            at = {i: float(frame.axis[i].position) for i in targets}
            targets = turned(targets, direction, self._link.wraps, at)
        check_targets(targets, self._link.limits, own, relative=relative)
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
        axes waits for its end. Of axes that wrap the first way-point chooses the turn, the nearest
        one to where the axis is then. Returns at once; the handle shows the rest. Raises
        InputError, and what the source of the blocks raises at first; a refusal by the kernel is
        raised by ``Path.wait``.
        """
        return play(self._link, blocks, joint_axes(axes, self.axis_count))

    def jog(
        self,
        velocity: float | Sequence[float] | Mapping[int, float] | FloatArray,
        *,
        limits: Limits | Mapping[int, Limits] | None = None,
    ) -> Move:
        """Move with a velocity (axis unit / s) until another order comes.

        At a position limit it comes to rest; then the velocity is what whole cycles leave of it.

        One velocity for the one axis, one per axis, or by axis number; 0 brings to rest. The handle
        is never ``done`` (of zeros alone it is, at rest): ``cancel`` it, or give another goal.
        Raises InputError.
        """
        wanted = by_axis("velocity", velocity, self.axis_count)
        own = lower_limits(limits, wanted, self._link.limits)
        targets = {i: State(0.0, real(f"velocity[{i}]", v)) for i, v in wanted.items()}
        for i, goal in targets.items():
            check_target(f"velocity[{i}]", goal, replace(own[i], position=None))
        return self._goal(lib.SJ_GOAL_JOG, targets, own, lib.SJ_SYNC_NONE, 0)

    def home(self, *, axes: Axes = None) -> Move:
        """Let drives home by their own method (6098h); the frame shifts without a step.

        The handle is done when the drives have attained their homes and follow again, so that the
        next goal is taken; queued moves begin then. Where one fails, its axis is in ErrorStop until
        ``reset``, the others of this order stop, the rest react as to a drive fault
        (``Reactions.drive_fault``), and ``Move.wait`` raises MotionStoppedError with ``unhomed``.
        """
        chosen = axis_numbers(axes, self.axis_count)
        targets = {i: State(0.0) for i in chosen}
        own = {i: self._link.limits[i] for i in chosen}
        return self._goal(lib.SJ_GOAL_HOME, targets, own, lib.SJ_SYNC_NONE, 0)

    def _goal(
        self, kind: int, targets: dict[int, State], own: dict[int, Limits], code: int, least: int
    ) -> Move:
        with self._link.lock:
            command = self._link.command
            command.synchronization, command.least_cycles = code, least
            for i in range(self.axis_count):
                entry = command.axis[i].goal
                if i in targets:
                    self._link.fill(entry, kind, targets[i], own[i])
                else:
                    entry.kind = lib.SJ_GOAL_NONE
            command.goal_id = self._link.next_goal()
            self._link.replacing(int(command.goal_id), targets)
            self._link.publish()
            known = kind == lib.SJ_GOAL_ABSOLUTE
            rest = kind == lib.SJ_GOAL_JOG and not any(goal.velocity for goal in targets.values())
            goal_id = int(command.goal_id)
            return Move(self._link, goal_id, targets, known=known, limits=own, rest=rest)

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
            self._link.fill(record.axis[i].goal, kind, target, own[i])
        with self._link.lock:
            record.goal_id = self._link.next_goal()
            number = self._link.publish_records(record, 1)
        if not number:
            raise QueueFullError(RECORDS)
        known = kind == lib.SJ_GOAL_ABSOLUTE
        goal_id = int(record.goal_id)
        return Move(self._link, goal_id, targets, known=known, number=number, limits=own)
