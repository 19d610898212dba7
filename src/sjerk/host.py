"""The host's side of a kernel: commands in, feedback out, through the dual-port RAM.

Never here: the cycle, the layout of the memory, bit masks of drives.
"""

from __future__ import annotations

import hashlib
import threading
import time
from collections.abc import Callable, Sequence
from enum import Enum
from functools import cache
from typing import Any

from sjerk._binding import ffi, lib
from sjerk.errors import (
    InputError,
    KernelGoneError,
    MotionStoppedError,
    RefusedError,
    SjerkError,
    real,
)
from sjerk.feedback import Feedback
from sjerk.handshake import Layout, Segment
from sjerk.planning import Synchronization, check_target, code_of, cycles_of
from sjerk.profile import Limits, State

Target = float | State

#: Why a goal was refused, by ``enum sj_result``.
REASONS = {
    lib.SJ_RESULT_NOT_FOLLOWING: "the drive does not follow (not enabled, or stopped by itself)",
    lib.SJ_RESULT_PLAN: "a number or a limit cannot be planned with",
    lib.SJ_RESULT_RANGE: "the goal is beyond what the drive can count",
    lib.SJ_RESULT_STOPPED: "a stop came with it, or the kernel is ending",
}


@cache
def layout(axes: int) -> Layout:
    """Layout of the segment of a kernel with so many axes."""
    return Layout(
        command_bytes=lib.sj_command_bytes(axes),
        feedback_bytes=lib.sj_feedback_bytes(axes),
        abi=_abi(),
    )


@cache
def _abi() -> int:
    """Hash of the payload structs: names, types and offsets of every field."""

    def describe(ctype: Any) -> str:
        if ctype.kind == "array":
            return f"[{ctype.length}]{describe(ctype.item)}"
        if ctype.kind != "struct":
            return str(ctype.cname)
        return "".join(f"{n}:{f.offset}:{describe(f.type)};" for n, f in ctype.fields)

    text = describe(ffi.typeof("sj_command")) + describe(ffi.typeof("sj_feedback"))
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little")


# ---- commands ------------------------------------------------------------------------------------


class MoveState(Enum):
    """What has become of a move."""

    SENT = "sent"
    MOVING = "moving"
    DONE = "done"
    STOPPED = "stopped"
    REFUSED = "refused"


def _reached(axis: Any, goal: State) -> bool:
    """On the goal; or past it, still with the velocity that was asked for."""
    return bool(axis.settled or (not axis.moving and axis.position == goal.position))


class Move:
    """Handle of one commanded move."""

    def __init__(self, host: Host, goal_id: int, targets: dict[int, State]) -> None:
        """Not for callers: ``Host.move`` makes it."""
        self._host = host
        self._goal_id = goal_id
        self._targets = targets

    @property
    def targets(self) -> dict[int, State]:
        """Goal by axis number."""
        return dict(self._targets)

    @property
    def state(self) -> MoveState:
        """What has become of it, by the newest feedback."""
        return self._state(self._host._frame())

    def _state(self, frame: Any) -> MoveState:
        if frame.result_goal_id < self._goal_id:
            return MoveState.SENT
        if frame.result_goal_id == self._goal_id and frame.result != lib.SJ_RESULT_ACCEPTED:
            return MoveState.REFUSED
        axes = [frame.axis[i] for i in self._targets]
        if any(axis.goal_id != self._goal_id for axis in axes):
            return MoveState.STOPPED
        if all(map(_reached, axes, self._targets.values())):
            return MoveState.DONE
        return MoveState.MOVING if any(a.moving for a in axes) else MoveState.STOPPED

    @property
    def done(self) -> bool:
        """Whether the command has settled on the goal."""
        return self.state is MoveState.DONE

    def wait(self, timeout: float | None = None) -> None:
        """Return when the command has settled on the goal.

        Raises RefusedError (with the reason), MotionStoppedError (stopped or replaced on the way),
        KernelGoneError, TimeoutError.
        """
        settled = (MoveState.DONE, MoveState.STOPPED, MoveState.REFUSED)
        self._host._wait_until(
            lambda frame: self._state(frame) in settled, timeout, f"move to {self._targets}"
        )
        frame = self._host._frame()
        state = self._state(frame)
        if state is MoveState.REFUSED:
            raise RefusedError(frame.result, REASONS[frame.result], frame.result_axis)
        if state is MoveState.STOPPED:
            raise MotionStoppedError({i: float(frame.axis[i].position) for i in self._targets})


class Host:
    """The one host of a kernel: context manager, made by ``MotionKernel.host``.

    Leaving it is in order and stops nothing; a host that dies stops the motion.
    """

    def __init__(
        self,
        segment: Segment,
        limits: Sequence[Limits],
        cycle_time: float,
        *,
        cyclic: bool,
    ) -> None:
        """Not for callers. ``cyclic``: a process runs the cycle, so that waiting makes sense."""
        self._segment = segment
        self._limits = tuple(limits)
        self._T = cycle_time
        self._cyclic = cyclic
        self._command = ffi.new("sj_command *")
        self._buffer = ffi.new("sj_feedback *")
        self._sequence = ffi.new("uint64_t *")
        self._lock = threading.Lock()  # cffi lets other threads run: two would write as one
        if cyclic:
            self._wait_until(lambda frame: True, 5.0, "the first cycle")
            frame = self._frame()
            # go on from what the kernel has taken, whoever was host before
            self._command.sequence = frame.sequence
            self._command.goal_id = frame.result_goal_id
            self._command.stop_count = frame.stop_count
            self._command.reset_count = frame.reset_count
            self._command.enable = int(any(frame.axis[i].enabled for i in range(frame.axes)))

    @classmethod
    def attach(cls, name: str, limits: Sequence[Limits], cycle_time: float) -> Host:
        """Become the host of the running kernel ``name`` from another process.

        ``limits`` of its axes and its ``cycle_time`` as the kernel has them. Raises HandshakeError:
        no such kernel, another number of axes, or a living host.
        """
        segment = Segment.attach(name, layout(len(limits)), role="host")
        return cls(segment, limits, cycle_time, cyclic=True)

    def __enter__(self) -> Host:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Leave the kernel to itself; a motion goes on to its end."""
        if self._cyclic and not self._segment.closed:
            lib.sj_shm_leave_host(self._segment.base)
            self._segment.close()

    # ---- reading

    def _read(self) -> Any | None:
        """The newest frame in the own buffer, or None before the first cycle."""
        while True:
            status = lib.sj_feedback_read(self._segment.base, self._buffer, self._sequence)
            if status != lib.SJ_SHM_LAPPED:
                break
        return self._buffer if self._segment.check(status) else None

    def _frame(self) -> Any:
        frame = self._read()
        if frame is None:
            raise SjerkError("no cycle has run yet: call MotionKernel.step() first")
        return frame

    def feedback(self) -> Feedback:
        """Return the newest feedback: every axis in the same cycle."""
        size = lib.sj_feedback_bytes(len(self._limits))
        copy = ffi.new("sj_feedback *")
        ffi.memmove(copy, self._frame(), size)
        return Feedback(copy, self._T)

    def _wait_until(self, met: Callable[[Any], bool], timeout: float | None, what: str) -> None:
        if not self._cyclic:
            raise SjerkError(f"cannot wait for {what}: no process runs this kernel, call step()")
        end = None if timeout is None else time.monotonic() + timeout
        look = 0
        while True:
            frame = self._read()
            if frame is not None and met(frame):
                return
            look += 1
            if look % 50 == 0 and not self._segment.kernel_lives():
                raise KernelGoneError(f"the kernel ended while waiting for {what}")
            if end is not None and time.monotonic() > end:
                raise TimeoutError(f"{what}: not within {timeout} s")
            time.sleep(200e-6)

    # ---- commanding

    def _publish(self) -> None:
        self._command.sequence += 1
        self._segment.check(lib.sj_command_publish(self._segment.base, self._command))

    def enable(self, timeout: float | None = 5.0) -> None:
        """Enable all drives; returns when every one follows (at once in a caller's own loop)."""
        with self._lock:
            self._command.enable = 1
            self._publish()
        if self._cyclic:
            n = range(len(self._limits))
            self._wait_until(
                lambda frame: all(frame.axis[i].follows for i in n), timeout, "drives to follow"
            )

    def disable(self, timeout: float | None = 5.0) -> None:
        """Disable all drives, each once it is at rest."""
        with self._lock:
            self._command.enable = 0
            self._publish()
        if self._cyclic:
            n = range(len(self._limits))
            self._wait_until(
                lambda frame: not any(frame.axis[i].enabled for i in n), timeout, "drives to rest"
            )

    def reset(self) -> None:
        """Reset the faults of all drives, once."""
        with self._lock:
            self._command.reset_count += 1
            self._publish()

    def stop(self, timeout: float | None = 30.0) -> None:
        """Stop all axes along jerk-limited ramps; returns at rest (at once in an own loop)."""
        with self._lock:
            self._command.stop_count += 1
            count = int(self._command.stop_count)
            self._publish()
        if self._cyclic:
            n = range(len(self._limits))
            self._wait_until(
                lambda frame: (
                    frame.stop_count >= count and not any(frame.axis[i].moving for i in n)
                ),
                timeout,
                "the stop",
            )

    def move(
        self,
        target: Target | Sequence[Target] | dict[int, Target],
        *,
        limits: Limits | None = None,
        synchronization: Synchronization = "time",
        min_duration: float = 0.0,
    ) -> Move:
        """Move to a target: of the one axis, of all axes, or by axis number.

        A target is a position, or a ``State`` with a velocity to arrive with. The kernel plans in
        its next cycle from the commanded state, also during a motion, which the new goal replaces;
        the same goal under the same limits changes nothing. ``limits``: others than the axes' own.
        Returns at once; the handle tells the rest. Raises InputError for what is no target; a
        refusal by the kernel is raised by ``Move.wait``.
        """
        targets = self._targets(target)
        code, least = code_of(synchronization), cycles_of(min_duration, self._T)
        own = {i: limits or self._limits[i] for i in targets}
        for i, goal in targets.items():
            check_target(f"target[{i}]", goal, own[i])
        with self._lock:
            command = self._command
            command.synchronization, command.least_cycles = code, least
            for i in range(len(self._limits)):
                entry = command.axis[i]
                entry.moves = i in targets
                if i in targets:
                    entry.goal = targets[i].position
                    entry.goal_velocity = targets[i].velocity * self._T
                    rows = own[i]._per_cycle(self._T)
                    ffi.memmove(ffi.addressof(entry, "limits"), rows, len(rows))
            command.goal_id += 1
            self._publish()
            return Move(self, int(command.goal_id), targets)

    def _targets(self, target: Target | Sequence[Target] | dict[int, Target]) -> dict[int, State]:
        axes = len(self._limits)
        if isinstance(target, dict):
            wanted: dict[int, Any] = dict(target)
        elif isinstance(target, Sequence) and not isinstance(target, str):
            if len(target) != axes:
                raise InputError("target", target, f"must have one target per axis ({axes})")
            wanted = dict(enumerate(target))
        elif axes == 1:
            wanted = {0: target}
        else:
            raise InputError("target", target, f"must name targets for {axes} axes")
        for i in wanted:
            if not isinstance(i, int) or not 0 <= i < axes:
                raise InputError("target", i, f"axis numbers are 0 .. {axes - 1}")
        if not wanted:
            raise InputError("target", target, "must name at least one axis")
        return {
            i: value if isinstance(value, State) else State(real(f"target[{i}]", value))
            for i, value in wanted.items()
        }
