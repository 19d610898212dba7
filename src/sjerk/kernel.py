"""The motion kernel: axes and their drives in one cycle, in a process of its own or step by step.

``with MotionKernel(...) as kernel`` starts a process whose cycle runs wholly in C by absolute time;
``MotionKernel(...).step()`` is one cycle in the caller's own loop. Never here: equations, layouts.
"""

from __future__ import annotations

import itertools
import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from sjerk._binding import ffi, lib
from sjerk.cia402 import DriveConfig
from sjerk.clock import Clock
from sjerk.errors import InputError, KernelGoneError, SjerkError, positive
from sjerk.handshake import HostWatch, Segment
from sjerk.host import Host, layout
from sjerk.profile import Limits

_numbers = itertools.count(1)


@dataclass(frozen=True)
class Axis:
    """One axis: its limits, its unit in drive increments, its drive.

    ``counts_per_unit``: drive increments per axis unit, e.g. 2**24 / 360 for degrees at a 24-bit
    encoder without gear.
    """

    limits: Limits
    counts_per_unit: float
    drive: DriveConfig = field(default_factory=DriveConfig)

    def __post_init__(self) -> None:
        if not isinstance(self.limits, Limits):
            raise InputError("limits", self.limits, "must be a Limits")
        object.__setattr__(
            self, "counts_per_unit", positive("counts_per_unit", self.counts_per_unit)
        )


class MotionKernel:
    """A kernel of 1 to 64 axes with simulated drives.

    >>> axis = Axis(Limits(90.0, 500.0, 5000.0), counts_per_unit=2**24 / 360)
    >>> kernel = MotionKernel(axes=[axis], cycle_time=1e-3)
    >>> host = kernel.host()
    >>> host.enable()
    >>> for _ in range(10):
    ...     kernel.step()
    >>> move = host.move(1.0)
    >>> while not move.done:
    ...     kernel.step()
    >>> host.feedback().axes[0].position
    1.0
    """

    def __init__(
        self,
        axes: Sequence[Axis],
        cycle_time: float = 1e-3,
        *,
        name: str | None = None,
        clock: Clock | None = None,
    ) -> None:
        """``cycle_time`` in seconds (25 us to 100 ms). ``name``: of the segment, else made up.

        ``clock``: what the process asks of the system, else nothing.

        Raises InputError for axes that cannot run: each names the axis.
        """
        self._axes = tuple(axes)
        if not 1 <= len(self._axes) <= lib.SJ_AXES:
            raise InputError("axes", len(self._axes), f"must be 1 .. {lib.SJ_AXES} axes")
        self._T = positive("cycle_time", cycle_time)
        if not 25e-6 <= self._T <= 0.1:
            raise InputError("cycle_time", cycle_time, "must lie in 25e-6 .. 0.1 s")
        self._name = name or f"kernel-{os.getpid()}-{next(_numbers)}"
        self._clock = clock or Clock()
        self._process: subprocess.Popen[bytes] | None = None
        self._segment: Segment | None = None
        self._kernel: Any = _build(self._axes, self._T, ffi.NULL)  # checks everything now
        self._host: Host | None = None

    @property
    def name(self) -> str:
        """Name under which hosts and monitors find the kernel."""
        return self._name

    @property
    def cycle_time(self) -> float:
        """Control cycle in seconds."""
        return self._T

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The axes, by number."""
        return self._axes

    # ---- a process of its own

    def __enter__(self) -> MotionKernel:
        """Start the process; returns when its cycle runs."""
        if self._segment is not None:
            raise SjerkError(f"kernel {self._name!r} is already in use")
        self._segment = Segment.create(self._name, layout(len(self._axes)))
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-c", "from sjerk.kernel import serve; serve()"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                start_new_session=True,  # Ctrl-C is the host's to turn into a stop
            )
            assert self._process.stdin is not None
            assert self._process.stdout is not None
            pickle.dump((self._name, self._axes, self._T, self._clock), self._process.stdin)
            self._process.stdin.flush()
            if self._process.stdout.readline() != b"running\n":
                raise KernelGoneError(f"kernel {self._name!r} did not start")
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        """Stop the motion along its ramp, disable the drives, end the process."""
        if self._host is not None:
            self._host.close()
        if self._process is not None:
            assert self._process.stdin is not None
            assert self._process.stdout is not None
            with self._process.stdin, self._process.stdout:
                pass  # end of its input tells it to stop and end
            self._process.wait()
            self._process = None
        if self._segment is not None:
            self._segment.unlink()
            self._segment.close()
            self._segment = None

    def host(self) -> Host:
        """Become the kernel's host; one at a time."""
        limits = [axis.limits for axis in self._axes]
        if self._process is not None:
            segment = Segment.attach(self._name, layout(len(self._axes)), role="host")
            self._host = Host(segment, limits, self._T, cyclic=True)
            return self._host
        if self._segment is None:
            self._segment = Segment.private(layout(len(self._axes)))
            self._kernel.segment = self._segment.base
        self._host = Host(self._segment, limits, self._T, cyclic=False)
        return self._host

    # ---- the caller's own loop

    def step(self, cycles: int = 1) -> None:
        """One cycle in the caller's own loop, or many: collect, interpolate, drive, publish."""
        if self._process is not None:
            raise SjerkError("the kernel runs in its process: step() is for a kernel without one")
        if self._segment is None:
            self.host()
        lib.sj_kernel_cycles(self._kernel, cycles)


def _build(axes: Sequence[Axis], cycle_time: float, base: Any) -> Any:
    """The ``sj_kernel *`` of these axes; raises InputError naming the axis."""
    kernel = ffi.new("sj_kernel *")
    lib.sj_kernel_init(kernel, base, len(axes))
    T = cycle_time
    for i, axis in enumerate(axes):
        limits = axis.limits
        per_cycle = ffi.from_buffer("sj_limits[]", limits._per_cycle(T))
        drive = axis.drive.changed(period_s=T)
        if lib.sj_kernel_axis(kernel, i, drive.to_c(), per_cycle, axis.counts_per_unit) != 0:
            raise InputError(f"axes[{i}].drive", drive, "does not fit the cycle time")
        most = kernel.axis[i].drive.jump_limit / (axis.counts_per_unit * T)
        if limits.velocity > most:
            raise InputError(
                f"axes[{i}].limits.velocity", limits.velocity, f"the drive follows up to {most:.6g}"
            )
    return kernel


# ---- in the kernel's process ---------------------------------------------------------------------


class _EndError(Exception):
    """SIGTERM came."""


def serve() -> None:
    """Run as the kernel process: axes by standard input, whose end is the order to end."""

    def terminate(*_: object) -> None:
        raise _EndError

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, terminate)
    name, axes, cycle_time, clock = pickle.load(sys.stdin.buffer)
    with Segment.attach(name, layout(len(axes)), role="kernel") as segment:
        kernel = _build(axes, cycle_time, segment.base)
        end = ffi.new("int32_t *")
        options = clock.to_c(cycle_time)

        def run() -> None:
            report = ffi.addressof(kernel.feedback, "clock")
            lib.sj_clock_prepare(kernel, layout(len(axes)).size, options, report)
            lib.sj_clock_run(kernel, options, end)

        cycle = threading.Thread(target=run)
        with HostWatch(segment, period_s=0.01):
            cycle.start()
            try:
                sys.stdout.write("running\n")
                sys.stdout.flush()
                sys.stdin.buffer.read()
            except (_EndError, BrokenPipeError):
                pass
            lib.sj_clock_end(end)
            cycle.join()
        lib.sj_shm_leave_kernel(segment.base)
        segment.unlink()  # for a parent that died
