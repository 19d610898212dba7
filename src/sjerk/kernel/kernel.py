"""The motion kernel: axes and their drives in one cycle, in a process of its own or step by step.

``with MotionKernel(...) as kernel`` starts a process whose cycle runs wholly in C by absolute time;
``MotionKernel(...).step()`` is one cycle in the caller's own loop. Never here: equations, layouts.
"""

from __future__ import annotations

import itertools
import math
import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, asdict, dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from sjerk._binding import ffi, lib
from sjerk.cia402 import DriveConfig
from sjerk.errors import InputError, KernelGoneError, SjerkError, positive
from sjerk.handshake import TRACE, HostWatch, Segment
from sjerk.host.host import Host
from sjerk.host.monitor import layout
from sjerk.kernel import trace
from sjerk.kernel.clock import Clock
from sjerk.profile import Limits

_numbers = itertools.count(1)
_ONE, _step = 1, lib.sj_kernel_step
_TAPPED = 64  # cycles between two looks at the trace of an own loop


@dataclass(frozen=True)
class Axis:
    """One axis: its limits, its unit in drive increments, its drive.

    ``counts_per_unit``: drive increments per axis unit, e.g. 2**24 / 360 for degrees at a 24-bit
    encoder; ``gear``: motor turns per turn of the axis. ``limits.position``: the position
    limits. ``stop_limits``: of the quick stop, else ``limits``. ``wrap``: axis units of one turn of
    an axis that turns for ever. ``following_error`` (axis unit): beyond it the kernel reacts.
    ``drive``: the simulated one; ``"ideal"``: without mechanics, always on its target;
    ``"external"``: the caller exchanges ``MotionKernel.image`` around ``step``.

    >>> Axis(Limits(90.0, 500.0, 5000.0), 2**24 / 360, unit="deg", gear=100.0).unit
    'deg'
    """

    limits: Limits
    counts_per_unit: float
    drive: DriveConfig | Literal["external", "ideal"] = field(default_factory=DriveConfig)
    _: KW_ONLY
    unit: str = ""
    gear: float = 1.0
    wrap: float | None = None
    stop_limits: Limits | None = None
    following_error: float | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.limits, Limits):
            raise InputError("limits", self.limits, "must be a Limits")
        if self.stop_limits is not None and not isinstance(self.stop_limits, Limits):
            raise InputError("stop_limits", self.stop_limits, "must be a Limits")
        if not isinstance(self.drive, DriveConfig) and self.drive not in ("external", "ideal"):
            raise InputError("drive", self.drive, "must be a DriveConfig, 'ideal' or 'external'")
        if not isinstance(self.unit, str) or len(self.unit.encode()) > 15:
            raise InputError("unit", self.unit, "must be a text of at most 15 bytes")
        for name in ("counts_per_unit", "gear"):
            object.__setattr__(self, name, positive(name, getattr(self, name)))
        for name in ("wrap", "following_error"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, positive(name, getattr(self, name)))
        if self.wrap is not None and self.limits.position is not None:
            raise InputError(
                "wrap", self.wrap, "an axis that turns for ever has no position limits"
            )

    def _to_c(self, T: float) -> Any:
        """The ``sj_axis_config *`` at this cycle time."""
        config = ffi.new("sj_axis_config *")
        for name, limits in (("limits", self.limits), ("stop_limits", self.stop_limits)):
            rows = (limits or self.limits)._per_cycle(T)
            ffi.memmove(ffi.addressof(config, name), rows, len(rows))
        low, high = self.limits.position or (-math.inf, math.inf)
        config.position_min, config.position_max = low, high
        config.counts_per_unit = self.counts_per_unit * self.gear
        config.following_limit = self.following_error or math.inf
        config.velocity_max = math.inf
        config.wrap = self.wrap or 0.0
        config.external = self.drive == "external"
        config.ideal = self.drive == "ideal"
        config.unit = self.unit.encode()
        return config


Reaction = Literal["none", "halt", "quick stop"]
_REACTIONS = {
    "none": lib.SJ_REACT_NONE,
    "halt": lib.SJ_REACT_HALT,
    "quick stop": lib.SJ_REACT_QUICK_STOP,
}


@dataclass(frozen=True, kw_only=True)
class Reactions:
    """What a kernel does by itself, for all axes; each is also an event.

    ``host_silence`` is that of a host which asked to be watched. After a ``drive_fault`` the axis
    is left to its drive and the others react; so after ``sync_lost``: the drive tells that link or
    SYNC is lost (603Fh = 81xxh, 87xxh), or the caller that its image is stale (``Image.stale``).
    ``overrun``: a cycle of the clock was skipped.
    ``spoilt``: a wild writer in the command. Raises InputError.

    >>> Reactions(drive_fault="quick stop").host_death
    'halt'
    """

    host_death: Reaction = "halt"
    host_silence: Reaction = "halt"
    drive_fault: Reaction = "halt"
    following_error: Reaction = "quick stop"
    overrun: Reaction = "none"
    spoilt: Reaction = "halt"
    sync_lost: Reaction = "halt"

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not isinstance(value, str) or value not in _REACTIONS:
                raise InputError(name, value, f"must be one of {', '.join(_REACTIONS)}")

    def _into(self, kernel: Any) -> None:
        for name, value in asdict(self).items():
            kernel.reaction[getattr(lib, f"SJ_CAUSE_{name.upper()}")] = _REACTIONS[value]


@dataclass(frozen=True)
class Image:
    """Process data of the drives, to be exchanged by the caller around ``MotionKernel.step``.

    Structured arrays (axes,) on the kernel's own memory: ``outputs`` what the kernel wants of the
    drives (``controlword``, ``mode``, ``target_position``, ...), ``inputs`` what they say
    (``statusword``, ``mode_display``, ``position_actual``, ...), in the words of CiA 402.
    ``stale``, (axes,) int32: set 1 where nothing came from a drive in time, 0 when it does again;
    the axis is then in ErrorStop until a reset, the others react as ``Reactions.sync_lost`` says.
    """

    outputs: NDArray[Any]
    inputs: NDArray[Any]
    stale: NDArray[np.int32]


def _rows(kernel: Any, field: str, axes: int) -> NDArray[Any]:
    """A structured array on an array of C structs; it keeps the kernel's memory alive."""
    kind = ffi.typeof(getattr(kernel, field)).item
    names = [(n, f) for n, f in kind.fields if f.type.kind == "primitive"]
    dtype = np.dtype(
        {
            "names": [n for n, _ in names],
            "formats": [_format(f.type.cname, ffi.sizeof(f.type)) for _, f in names],
            "offsets": [f.offset for _, f in names],
            "itemsize": ffi.sizeof(kind),
        }
    )
    offset = ffi.offsetof("sj_kernel", field)
    return np.frombuffer(ffi.buffer(kernel), dtype=dtype, count=axes, offset=offset)


def _commanded(kernel: Any, axes: int) -> NDArray[np.float64]:
    """The commanded positions on the kernel's own memory, which the view keeps alive."""
    size = ffi.sizeof("sj_axis")
    offset = ffi.offsetof("sj_kernel", "axis") + ffi.offsetof("sj_axis", "interpolator", "q", "hi")
    view = np.ndarray((axes,), np.float64, ffi.buffer(kernel), offset, (size,))
    view.flags.writeable = False
    return view


def _format(name: str, size: int) -> str:
    return f"{'u' if name.startswith('u') else 'i'}{size}"


class MotionKernel:
    """A kernel of 1 to 64 axes, with simulated drives or external ones.

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
        reactions: Reactions | None = None,
    ) -> None:
        """``cycle_time`` in seconds (25 us to 100 ms). ``name``: of the segment, else made up.

        ``clock``: what the process asks of the system, else nothing. ``reactions``: what the kernel
        does by itself.

        Raises InputError for axes that cannot run: each names the axis.
        """
        if not isinstance(axes, Sequence) or not all(isinstance(axis, Axis) for axis in axes):
            raise InputError("axes", axes, "must be a list of Axis")
        self._axes = tuple(axes)
        if not 1 <= len(self._axes) <= lib.SJ_AXES:
            raise InputError("axes", len(self._axes), f"must be 1 .. {lib.SJ_AXES} axes")
        self._T = round(positive("cycle_time", cycle_time) * 1e9) / 1e9  # whole nanoseconds
        if not 25e-6 <= self._T <= 0.1:
            raise InputError("cycle_time", cycle_time, "must lie in 25e-6 .. 0.1 s")
        if name is not None and (not isinstance(name, str) or not name):
            raise InputError("name", name, "must be a text that is not empty")
        self._name = name or f"kernel-{os.getpid()}-{next(_numbers)}"
        self.clock = clock or Clock()
        self._reactions = reactions or Reactions()
        self._process: subprocess.Popen[bytes] | None = None
        self._segment: Segment | None = None
        self._trace: Segment | None = None
        self._tap: Callable[[], None] | None = None
        self._kernel: Any = _build(
            self._axes, self._T, self._reactions, ffi.NULL
        )  # checks everything now
        self._host: Host | None = None
        self._image: Image | None = None
        self._positions: NDArray[np.float64] | None = None
        self._ended = False
        self._steps = False  # in the caller's own loop, and nobody looks on

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

    @property
    def reactions(self) -> Reactions:
        """What the kernel does by itself."""
        return self._reactions

    @property
    def alive(self) -> bool:
        """Whether the kernel's process runs."""
        return self._process is not None and self._process.poll() is None

    # ---- a process of its own

    def __enter__(self) -> MotionKernel:
        """Start the process; returns when its cycle runs."""
        if self._segment is not None or self._ended:
            raise SjerkError(f"kernel {self._name!r} is in use or has ended: make a new one")
        if any(axis.drive == "external" for axis in self._axes):
            raise SjerkError("external drives are for step(): nobody would exchange their image")
        text = self._description()
        own, beside = layout(len(self._axes)), trace.layout(len(self._axes), self._T, len(text))
        try:
            # first the trace: whoever finds the kernel finds it
            self._trace = Segment.create(self._name + TRACE, beside, replace_stale=True)
            self._segment = Segment.create(self._name, own, replace_stale=True)
            self._process = subprocess.Popen(
                [sys.executable, "-c", "from sjerk.kernel.kernel import serve; serve()"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                start_new_session=True,  # Ctrl-C is the host's to turn into a stop
            )
            assert self._process.stdin is not None
            assert self._process.stdout is not None
            order = (self._name, self._axes, self._T, self.clock, self._reactions, text)
            pickle.dump(order, self._process.stdin)
            self._process.stdin.flush()
            if self._process.stdout.readline() != b"running\n":
                raise KernelGoneError(f"kernel {self._name!r} did not start")
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        """Stop the motion along its ramp, disable the drives, end the process."""
        self._ended, self._steps = True, False
        if self._host is not None:
            self._host.close()
        if self._process is not None:
            assert self._process.stdin is not None
            assert self._process.stdout is not None
            with self._process.stdin, self._process.stdout:
                pass  # end of its input tells it to stop and end
            self._process.wait()
            self._process = None
        for segment in (self._segment, self._trace):
            if segment is not None:
                segment.unlink()
                segment.close()
        self._segment = self._trace = None

    def _description(self) -> bytes:
        """What a recording says of the kernel, so that it can be run again from it alone."""
        return trace.describe(
            name=self._name, cycle_time=self._T, axes=self._axes, reactions=self._reactions
        )

    def host(self) -> Host:
        """Become the kernel's host; one at a time.

        The next one goes on where the last one left. Raises HostTakenError, or SjerkError in an own
        loop, while another host has not been closed.
        """
        if self._ended:
            raise SjerkError(f"kernel {self._name!r} has ended: make a new one")
        if self._process is not None:
            self._host = Host.attach(self._name)
            return self._host
        if self._host is not None and not self._host.closed:
            raise SjerkError(f"kernel {self._name!r} already has a host: close that one first")
        self._private_segment()
        assert self._segment is not None
        before = self._host._goals if self._host is not None else 0
        self._host = Host(self._segment, cyclic=False)
        self._host._go_on(self._described())
        self._host._goals = before
        return self._host

    def _described(self) -> Any:
        """A frame that tells what the axes are, before the first cycle too."""
        frame = ffi.new("sj_feedback *", self._kernel.feedback)
        for i in range(len(self._axes)):
            frame.axis[i].limits = self._kernel.axis[i].config.limits
        for i in range(len(self._axes)):
            for name in ("enable", "halts", "quick_stops", "resets", "limit_sets"):
                setattr(frame.axis[i], name, getattr(self._kernel.axis[i], name))
        frame.override, frame.hold = self._kernel.override, self._kernel.hold
        return frame

    # ---- the caller's own loop

    @property
    def image(self) -> Image:
        """The process data of the drives, for a caller's own loop: live views, made once."""
        if self._process is not None:
            raise SjerkError("the kernel runs in its process: its drives are there")
        if self._image is None:
            n = len(self._axes)
            stale = np.frombuffer(
                ffi.buffer(self._kernel), np.int32, n, ffi.offsetof("sj_kernel", "stale")
            )
            self._image = Image(_rows(self._kernel, "rx", n), _rows(self._kernel, "tx", n), stale)
        return self._image

    @property
    def positions(self) -> NDArray[np.float64]:
        """Commanded positions (axes,) in axis units, for a caller's own loop: a live view.

        Made once and read-only: ``step`` changes what it shows; ``positions.copy()`` keeps a cycle.
        """
        if self._process is not None:
            raise SjerkError("the kernel runs in its process: Host.feedback tells its positions")
        if self._positions is None:
            self._positions = _commanded(self._kernel, len(self._axes))
        return self._positions

    def step(self, cycles: int = 1) -> None:
        """One cycle in the caller's own loop, or many: collect, interpolate, drive, publish."""
        if cycles is _ONE and self._steps:  # the loop of a caller: nothing else to check
            _step(self._kernel)
            return
        if self._process is not None:
            raise SjerkError("the kernel runs in its process: step() is for a kernel without one")
        if self._ended:
            raise SjerkError(f"kernel {self._name!r} has ended: make a new one")
        if isinstance(cycles, bool) or not isinstance(cycles, int) or not 0 < cycles < 2**62:
            raise InputError("cycles", cycles, "must be an int of at least 1")
        self._private_segment()
        if self._tap is None:
            lib.sj_kernel_cycles(self._kernel, cycles)
            return
        for begin in range(0, cycles, _TAPPED):
            lib.sj_kernel_cycles(self._kernel, min(_TAPPED, cycles - begin))
            self._tap()

    def _tapped(self, tap: Callable[[], None] | None) -> Segment:
        """The trace of the own loop; ``tap`` is called before it can overflow."""
        if self._process is not None:
            raise SjerkError("the kernel runs in its process: its trace is found by its name")
        self._private_segment()
        if self._trace is None:
            text = self._description()
            self._trace = Segment.private(trace.layout(len(self._axes), self._T, len(text)))
            lib.sj_feedback_publish(self._trace.base, text)
            self._kernel.trace = self._trace.base
        self._tap, self._steps = tap, tap is None
        return self._trace

    def _private_segment(self) -> None:
        if self._segment is None:
            self._segment = Segment.private(layout(len(self._axes), clocked=False))
            self._kernel.segment = self._segment.base
            self._kernel.own_loop = 1
            self._steps = True


def _build(axes: Sequence[Axis], cycle_time: float, reactions: Reactions, base: Any) -> Any:
    """The ``sj_kernel *`` of these axes; raises InputError naming the axis."""
    kernel = ffi.new("sj_kernel *")
    T = cycle_time
    lib.sj_kernel_init(kernel, base, len(axes), T)
    reactions._into(kernel)
    for i, axis in enumerate(axes):
        config = axis._to_c(T)
        drive = None if isinstance(axis.drive, str) else axis.drive.changed(period_s=T)
        raw = ffi.NULL if drive is None else drive.to_c()
        if lib.sj_kernel_axis(kernel, i, raw, config) != 0:
            raise InputError(f"axes[{i}].drive", drive, "does not fit the cycle time")
        if drive is None:
            continue
        most = kernel.axis[i].drive.jump_limit / config.counts_per_unit
        kernel.axis[i].config.velocity_max = most
        if config.limits.velocity > most:
            raise InputError(
                f"axes[{i}].limits.velocity",
                axis.limits.velocity,
                f"the drive follows up to {most / T:.6g}",
            )
    return kernel


def _copy(axes: int, cycle_time: float, *, clocked: bool = True) -> tuple[Any, Segment]:
    """A ``sj_kernel *`` for ``sj_kernel_rehearse``, and the segment it keeps to."""
    copy, segment = ffi.new("sj_kernel *"), Segment.private(layout(axes, clocked=clocked))
    lib.sj_kernel_init(copy, segment.base, axes, cycle_time)
    return copy, segment


# ---- in the kernel's process ---------------------------------------------------------------------


class _EndError(Exception):
    """SIGTERM came."""


def serve() -> None:
    """Run as the kernel process: axes by standard input, whose end is the order to end."""

    def terminate(*_: object) -> None:
        raise _EndError

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, terminate)
    try:
        order = pickle.load(sys.stdin.buffer)
    except (EOFError, pickle.UnpicklingError, _EndError):
        return  # who wanted the kernel was ended before it could say which
    name, axes, cycle_time, clock, reactions, text = order
    beside = trace.layout(len(axes), cycle_time, len(text))
    with (
        Segment.attach(name + TRACE, beside, role="kernel") as told,
        Segment.attach(name, layout(len(axes)), role="kernel") as segment,
    ):
        kernel = _build(axes, cycle_time, reactions, segment.base)
        lib.sj_feedback_publish(told.base, text)
        trace.touch(told)
        kernel.trace = told.base
        end = ffi.new("int32_t *")
        options = clock.to_c(cycle_time)
        copy, _memory = _copy(len(axes), cycle_time) if options.spin_ns else (ffi.NULL, None)

        def run() -> None:
            report = ffi.addressof(kernel.feedback, "clock")
            lib.sj_clock_prepare(kernel, layout(len(axes)).size, options, report)
            lib.sj_clock_run(kernel, copy, options, end)

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
        for mine in (segment, told):
            lib.sj_shm_leave_kernel(mine.base)
            mine.unlink()  # for a parent that died
