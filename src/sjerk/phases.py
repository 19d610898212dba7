"""What a motion is made of and given as: phases, samples and ranges, also as the memory C reads.

A ``Plan`` is a row of phases between two states. Never here: the equations of motion, decisions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from sjerk._binding import ffi, lib
from sjerk.errors import InputError, positive, real
from sjerk.limits import State

FloatArray = NDArray[np.float64]

#: The fields of ``Samples``, in order.
COLUMNS = ("time", "position", "velocity", "acceleration", "jerk")
#: Cycle counts up to this are exact in every later step.
CYCLES_MAX: int = lib.SJ_CYCLES_MAX


@dataclass(frozen=True)
class Phase:
    """Constant ``jerk`` (u/s^3, signed, axis coordinates) over whole ``cycles``: Eq. (1).

    >>> Phase(cycles=100, jerk=-5000.0)
    Phase(cycles=100, jerk=-5000.0)
    """

    cycles: int
    jerk: float


@dataclass(frozen=True, eq=False)
class Samples:
    """A motion in numbers: five float64 arrays, in seconds and the axis' own unit u.

    ``time`` (n,) in s; ``position`` in u, ``velocity`` in u/s, ``acceleration`` in u/s^2 and
    ``jerk`` in u/s^3 are (n,) for one axis and (n, N) for N axes.

    >>> Samples.empty(3).position.shape
    (3,)
    """

    time: FloatArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray

    @classmethod
    def empty(cls, rows: int) -> Samples:
        """Room for ``rows`` samples of one axis, to be filled by ``Profile.sample(out=...)``."""
        return cls(*(np.empty(rows) for _ in range(5)))

    def table(self, rows: int) -> Any:
        """For C calls: the arrays as an ``sj_table *`` to be filled with ``rows`` samples.

        Raises ``InputError`` where an array is not float64 of shape (rows,), contiguous and
        writeable. The arrays must outlive the call.
        """
        table = ffi.new("sj_table *")
        table.rows = rows
        columns = [_c_column(name, getattr(self, name), rows) for name in COLUMNS]
        table.time, table.position, table.velocity, table.acceleration, table.jerk = columns
        return table


class Range(NamedTuple):
    """Least and greatest value.

    >>> Range(-1.0, 2.0).high
    2.0
    """

    low: float
    high: float


@dataclass(frozen=True)
class Extrema:
    """Ranges that a planned motion covers, inside phases as well as at their ends.

    In u, u/s, u/s^2 and u/s^3.
    """

    position: Range
    velocity: Range
    acceleration: Range
    jerk: Range

    @classmethod
    def along(cls, nodes: tuple[FloatArray, ...], at: Callable[[FloatArray], Samples]) -> Extrema:
        """Of the motion ``at``; its ``nodes``: time, P, V, A (n,) and the jerk from each one on."""
        time, _P, V, A, J = nodes
        times = list(time)
        for i in range(len(time) - 1):
            length = time[i + 1] - time[i]
            # zeros of A are peaks of the velocity, zeros of V peaks of the position
            for root in (*_roots(0.0, J[i], A[i]), *_roots(J[i] / 2.0, A[i], V[i])):
                if 0.0 < root < length:
                    times.append(time[i] + root)
        motion = at(np.array(times))
        return cls(
            *(
                Range(float(np.min(x)), float(np.max(x)))
                for x in (
                    motion.position,
                    motion.velocity,
                    motion.acceleration,
                    J[:-1] if len(J) > 1 else J,
                )
            )
        )

    def leaves(self, low: float, high: float) -> bool:
        """Whether the position leaves this range, by more than rounding."""
        slack = 1e-12 * max(abs(low), abs(high))
        return self.position.low < low - slack or self.position.high > high + slack

    @property
    def turns(self) -> bool:
        """Whether the velocity has both signs, by more than 1e-9 of its largest."""
        low, high = self.velocity
        nothing = 1e-9 * max(-low, high)
        return low < -nothing and high > nothing


_make = object.__new__
_POINTER = ffi.typeof("sj_plan *")


class Plan:
    """Phases in whole control cycles, from one state of the samples to another. Immutable.

    ``start`` and ``end`` are the samples before and after the motion; ``position_range`` the range
    of the limits it was planned under, or None. The base of ``Profile``, which adds the equations.

    Raises ``InputError`` for too many phases, for lengths that are no cycles, for jerks that are no
    numbers and for states that are no ``State``.

    >>> Plan([Phase(100, 5000.0)], 1e-3, State(0.0), State(0.8, 25.0, 500.0)).cycles
    100
    """

    # Plans are made from C ones, and everything else of them only when it is asked for: a slot that
    # is not set yet, or has nothing in it.
    __slots__ = ("_c_owner", "_c_plan", "_cycle_time", "_end", "_phases", "_range", "_start")

    _c_owner: Any
    _phases: tuple[Phase, ...]
    _range: tuple[float, float] | None

    def __init__(
        self,
        phases: Sequence[Phase],
        cycle_time: float,
        start: State,
        end: State,
        *,
        position_range: tuple[float, float] | None = None,
    ) -> None:
        """Phases as they follow each other; ``cycle_time`` in seconds."""
        self._cycle_time = positive("cycle_time", cycle_time)
        self._phases = tuple(phases)
        for name, state in (("start", start), ("end", end)):
            if not isinstance(state, State):
                raise InputError(name, state, "must be a State")
        self._start, self._end, self._range = start, end, position_range
        self._c_plan = _c_plan(self._phases, self._cycle_time)

    @classmethod
    def of_c(
        cls,
        plan: Any,
        cycle_time: float,
        start: State,
        end: State,
        position_range: tuple[float, float] | None = None,
        owner: Any = None,
    ) -> Self:
        """From a finished ``sj_plan`` or pointer to one, unchecked; ``owner`` keeps its memory."""
        self = _make(cls)
        self._c_plan = plan
        self._cycle_time = cycle_time
        self._start = start
        self._end = end
        if position_range is not None:
            self._range = position_range
        if owner is not None:
            self._c_owner = owner
        return self

    @property
    def c_plan(self) -> Any:
        """For C calls: the phases as an ``sj_plan *``, which lives as long as this object."""
        if ffi.typeof(self._c_plan) is not _POINTER:
            self._c_plan = ffi.new(_POINTER, self._c_plan)
        return self._c_plan

    @property
    def phases(self) -> tuple[Phase, ...]:
        """The phases of constant jerk, in order."""
        if not hasattr(self, "_phases"):
            plan, per_second = self._c_plan, self._cycle_time**3
            self._phases = tuple(
                Phase(plan.phase[i].cycles, plan.phase[i].jerk / per_second)
                for i in range(plan.count)
            )
        return self._phases

    @property
    def cycle_time(self) -> float:
        """Control cycle in seconds."""
        return self._cycle_time

    @property
    def start(self) -> State:
        """The sample before the motion."""
        return self._start

    @property
    def end(self) -> State:
        """The settled sample after it."""
        return self._end

    @property
    def position_range(self) -> tuple[float, float] | None:
        """The position range (low, high) of the limits it was planned under, or None."""
        return getattr(self, "_range", None)

    @property
    def cycles(self) -> int:
        """Length N of the plan in control cycles."""
        return int(self._c_plan.cycles)

    @property
    def duration(self) -> float:
        """Length of the plan in seconds: N times the cycle time."""
        return self.cycles * self._cycle_time

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Plan) and _identity(self) == _identity(other)

    def __hash__(self) -> int:
        return hash(_identity(self))

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}(phases={self.phases!r}, cycle_time={self._cycle_time!r}, "
            f"start={self._start!r}, end={self._end!r})"
        )

    def __reduce__(self) -> tuple[Any, ...]:
        return _again, _identity(self)


def _identity(plan: Plan) -> tuple[Any, ...]:
    """What plans are compared by, and made again from."""
    return (type(plan), plan.phases, plan.cycle_time, plan.start, plan.end, plan.position_range)


def _again(
    cls: type[Plan],
    phases: tuple[Phase, ...],
    cycle_time: float,
    start: State,
    end: State,
    position_range: tuple[float, float] | None,
) -> Plan:
    return cls(phases, cycle_time, start, end, position_range=position_range)


def _c_plan(phases: Sequence[Phase], cycle_time: float) -> Any:
    """The phases as an ``sj_plan *``, jerks per cycle^3; raises ``InputError``."""
    if len(phases) > lib.SJ_PHASES:
        raise InputError("phases", len(phases), f"at most {lib.SJ_PHASES}")
    plan = ffi.new("sj_plan *")
    plan.count = len(phases)
    per_cycle = cycle_time**3
    for i, phase in enumerate(phases):
        if isinstance(phase.cycles, bool) or not isinstance(phase.cycles, int):
            raise InputError(f"phases[{i}].cycles", phase.cycles, "must be an int")
        if not 1 <= phase.cycles <= CYCLES_MAX:
            raise InputError(f"phases[{i}].cycles", phase.cycles, f"must be 1 .. {CYCLES_MAX}")
        plan.phase[i].cycles = phase.cycles
        plan.phase[i].jerk = real(f"phases[{i}].jerk", phase.jerk) * per_cycle
        plan.cycles += phase.cycles
    return plan


def _c_column(name: str, column: FloatArray, rows: int) -> Any:
    if not isinstance(column, np.ndarray):
        raise InputError(f"out.{name}", type(column).__name__, "must be an array")
    flags = column.flags
    if (
        column.shape != (rows,)
        or column.dtype != np.float64
        or not (flags.c_contiguous and flags.writeable)
    ):
        has = (column.shape, str(column.dtype))
        raise InputError(
            f"out.{name}", has, f"must be float64 of shape ({rows},), contiguous and writeable"
        )
    return ffi.from_buffer("double[]", column, require_writable=True)


def _roots(a: float, b: float, c: float) -> tuple[float, ...]:
    """Real roots of a x^2 + b x + c, without cancellation."""
    if a == 0.0:
        return (-c / b,) if b != 0.0 else ()
    square = b * b - 4.0 * a * c
    if square < 0.0:
        return ()
    q = -0.5 * (b + math.copysign(math.sqrt(square), b))
    return (q / a, c / q) if q != 0.0 else (0.0,)
