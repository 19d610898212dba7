"""The motion kernel: axes and their drives in one cycle, in a process of its own or step by step.

``with MotionKernel(...) as kernel`` starts a process whose cycle runs wholly in C by absolute time;
``MotionKernel(...).step()`` is one cycle in the caller's own loop. Never here: equations, layouts.
"""

from __future__ import annotations

import itertools
import json
import os
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sjerk._binding import ffi, lib
from sjerk.errors import InputError, SjerkError, positive
from sjerk.handshake import TRACE, Segment, group_number
from sjerk.host import Host
from sjerk.host.link import Link
from sjerk.host.reader import layout
from sjerk.kernel import trace
from sjerk.kernel.axis import Axis
from sjerk.kernel.clock import Clock
from sjerk.kernel.memory import build, commanded, first_frame, flags, rows
from sjerk.kernel.process import KernelProcess, Order, Port
from sjerk.kernel.reactions import Reactions
from sjerk.kernel.tables import kernel_fields

_numbers = itertools.count(1)
_step = lib.sj_kernel_step
#: How often a loop steps, known by identity: True equals it, too.
_ONCE = 1
_TAPPED = 64  # cycles between two looks at the trace of an own loop


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


class MotionKernel:
    """A kernel of 1 to 64 axes, with simulated drives or external ones.

    >>> from sjerk import Limits
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

    One that has not begun can be pickled, to be run in another process.
    """

    def __init__(
        self,
        axes: Sequence[Axis],
        cycle_time: float = 1e-3,
        *,
        name: str | None = None,
        clock: Clock | None = None,
        reactions: Reactions | None = None,
        group: int | str | None = None,
    ) -> None:
        """``cycle_time`` in seconds (25 us to 100 ms). ``name``: of the segment, else made up.

        ``clock``: what the process asks of the system, else nothing. ``reactions``: what the kernel
        does by itself. ``group``: whose members may command, watch and stop its process, with
        ``any_owner=True``; None: this user alone.

        Raises InputError for axes that cannot run: each names the axis.
        """
        if not isinstance(axes, Sequence) or not all(isinstance(axis, Axis) for axis in axes):
            raise InputError("axes", axes, "must be a list of Axis")
        self._axes = tuple(axes)
        if not 1 <= len(self._axes) <= lib.SJ_AXES:
            raise InputError("axes", len(self._axes), f"must be 1 .. {lib.SJ_AXES} axes")
        _check_names(self._axes)
        self._T = round(positive("cycle_time", cycle_time) * 1e9) / 1e9  # whole nanoseconds
        if not 25e-6 <= self._T <= 0.1:
            raise InputError("cycle_time", cycle_time, "must lie in 25e-6 .. 0.1 s")
        if name is not None and (not isinstance(name, str) or not name):
            raise InputError("name", name, "must be a text that is not empty")
        for field, given, kind in (("clock", clock, Clock), ("reactions", reactions, Reactions)):
            if given is not None and not isinstance(given, kind):
                raise InputError(field, given, f"must be a {kind.__name__}")
        self._named = name
        self._name = name or f"kernel-{os.getpid()}-{next(_numbers)}"
        self._group = group_number(group)
        self.clock = clock or Clock()
        self.port: Port | None = None
        """What exchanges external drives in the kernel's own process."""
        self._reactions = reactions or Reactions()
        self._process: KernelProcess | None = None
        self._segment: Segment | None = None
        self._trace: Segment | None = None
        self._drain: Callable[[], None] | None = None
        # checks everything now
        self._kernel: Any = build(self._axes, self._T, self._reactions, ffi.NULL)
        self._host: Host | None = None
        self._link: Link | None = None  # of that host, in an own loop
        self._image: Image | None = None
        self._positions: NDArray[np.float64] | None = None
        self._ended = False
        self._steps = False  # in the caller's own loop, and nobody looks on

    def __reduce__(self) -> tuple[Any, ...]:
        """For ``pickle`` and ``copy``: another one that has not begun; raises SjerkError else."""
        if self._segment is not None or self._image is not None or self._ended:
            raise SjerkError(
                f"kernel {self._name!r} has begun, and its state is not copied: pickle a new one, "
                "or a recording of it"
            )
        make = partial(
            type(self),
            self._axes,
            self._T,
            name=self._named,
            clock=self.clock,
            reactions=self._reactions,
            group=self._group,
        )
        return make, (), {"port": self.port}

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
        return self._process is not None and self._process.alive

    @property
    def pid(self) -> int | None:
        """Number of the kernel's process; None where there is none."""
        return None if self._process is None else self._process.pid

    # ---- a process of its own

    def __enter__(self) -> MotionKernel:
        """Start the process; returns when its cycle runs."""
        if self._segment is not None or self._ended:
            raise SjerkError(f"kernel {self._name!r} is in use or has ended: make a new one")
        if self.port is None and any(axis.drive == "external" for axis in self._axes):
            raise SjerkError(
                "external drives are for step(), or for a bus ([ethercat] of a TOML file, which "
                "`sjerk kernel` runs): in a process nobody would exchange their image"
            )
        text = self._description()
        self._check_description(text)
        own = layout(len(self._axes))
        trace_layout = trace.layout(len(self._axes), self._T, len(text))
        try:
            # first the trace: a client that finds the kernel finds it
            self._trace = Segment.create(
                self._name + TRACE, trace_layout, group=self._group, replace_stale=True
            )
            self._segment = Segment.create(self._name, own, group=self._group, replace_stale=True)
            self._process = KernelProcess()
            port = None if self.port is None else asdict(self.port)
            order = Order(self._name, text.decode(), trace.plain(self.clock), os.getpid(), port)
            self._process.run(order)
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
            self._process.end()
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

    def _check_description(self, text: bytes) -> None:
        """Refuse axes whose fields do not say all: a process of its own knows these alone."""
        _, values = kernel_fields(self._name, json.loads(text))
        own = build(values["axes"], self._T, values["reactions"], ffi.NULL)
        for i, axis in enumerate(self._axes):
            said, wanted = (ffi.addressof(k, "axis", i) for k in (own, self._kernel))
            if bytes(ffi.buffer(said)) != bytes(ffi.buffer(wanted)):
                raise InputError(
                    f"axes[{i}]",
                    axis,
                    f"a {type(axis).__name__} does what its fields do not say: the kernel's own "
                    "process has the fields of Axis, DriveConfig and Limits only; step() works",
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
        newest = 0 if self._link is None else self._link.newest_goal
        self._link = Link(self._own_memory(), clocked=False, after=newest)
        self._link.take_over(first_frame(self._kernel))
        self._host = Host(self._link)
        return self._host

    # ---- the caller's own loop

    @property
    def image(self) -> Image:
        """The process data of the drives, for a caller's own loop: live views, made once."""
        if self._process is not None:
            raise SjerkError("the kernel runs in its process: its drives are there")
        if self._image is None:
            n = len(self._axes)
            outputs, inputs = rows(self._kernel, "rx", n), rows(self._kernel, "tx", n)
            self._image = Image(outputs, inputs, flags(self._kernel, "stale", n))
        return self._image

    @property
    def positions(self) -> NDArray[np.float64]:
        """Commanded positions (axes,) in axis units, for a caller's own loop: a live view.

        Made once and read-only: ``step`` changes what it shows; ``positions.copy()`` keeps a cycle.
        """
        if self._process is not None:
            raise SjerkError("the kernel runs in its process: Host.feedback reports its positions")
        if self._positions is None:
            self._positions = commanded(self._kernel, len(self._axes))
        return self._positions

    def step(self, cycles: int = _ONCE) -> None:
        """One cycle in the caller's own loop, or many: collect, interpolate, drive, publish."""
        if cycles is _ONCE and self._steps:  # nothing else to check
            _step(self._kernel)
            return
        if self._process is not None:
            raise SjerkError("the kernel runs in its process: step() is for a kernel without one")
        if self._ended:
            raise SjerkError(f"kernel {self._name!r} has ended: make a new one")
        if isinstance(cycles, bool) or not isinstance(cycles, int) or not 0 < cycles < 2**62:
            raise InputError("cycles", cycles, "must be an int of at least 1")
        self._own_memory()
        if self._drain is None:
            lib.sj_kernel_cycles(self._kernel, cycles)
            return
        for begin in range(0, cycles, _TAPPED):
            lib.sj_kernel_cycles(self._kernel, min(_TAPPED, cycles - begin))
            self._drain()

    @property
    def core(self) -> Any:
        """The ``sj_kernel *`` of a caller's own loop, for programs that run C on it."""
        if self._process is not None:
            raise SjerkError("the kernel runs in its process: its memory is there")
        self._own_memory()
        return self._kernel

    def trace_to(self, drain: Callable[[], None] | None) -> Segment:
        """Write the trace of a caller's own loop from now on; ``drain`` before it can overflow.

        ``drain`` None: nobody is called, and the oldest cycles are overwritten.
        """
        if self._process is not None:
            raise SjerkError("the kernel runs in its process: its trace is found by its name")
        self._own_memory()
        if self._trace is None:
            text = self._description()
            self._trace = Segment.private(trace.layout(len(self._axes), self._T, len(text)))
            lib.sj_feedback_publish(self._trace.base, text)
            self._kernel.trace = self._trace.base
        self._drain, self._steps = drain, drain is None
        return self._trace

    def release_trace(self) -> None:
        """Call nobody any more."""
        self._drain = None

    def _own_memory(self) -> Segment:
        if self._segment is None:
            self._segment = Segment.private(layout(len(self._axes), clocked=False))
            self._kernel.segment = self._segment.base
            self._kernel.own_loop = 1
            self._steps = True
        return self._segment


def _check_names(axes: Sequence[Axis]) -> None:
    """Axes that have names have different ones."""
    names = [axis.name for axis in axes]
    for i, name in enumerate(names):
        if name and name in names[:i]:
            first = names.index(name)
            raise InputError(f"axes[{i}].name", name, f"is that of axis {first} already")
