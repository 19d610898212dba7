"""The planner, to be read beside the paper: limits, states, profiles, and Eqs. (1)-(14).

``scurve`` is the paper's closed form with whole-cycle intervals, in its symbols; a ``Profile`` is
what it returns: Eqs. (1)-(6) as a function of time, and the samples of Eqs. (15)-(17) from the C
interpolator. Unit-free in position; time is in seconds. Never here: clocks, shared memory, drives.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sjerk._binding import ffi, lib
from sjerk.errors import InfeasibleError, InputError, positive, real

FloatArray = NDArray[np.float64]

COLUMNS = ("time", "position", "velocity", "acceleration", "jerk")
#: Relative slack of the whole-cycle roundings, so that 0.1 / 0.001 is 100 cycles and not 101.
ROUNDING_SLACK = 1e-11
#: Cycle counts up to this are exact in every later step.
CYCLES_MAX: int = lib.SJ_CYCLES_MAX


@dataclass(frozen=True, slots=True)
class Limits:
    """Kinematic limits of one axis, magnitudes in its own unit and seconds.

    Acceleration in the direction of the move is limited by ``acceleration`` and ``jerk``,
    acceleration against it by ``deceleration`` and ``deceleration_jerk`` (default: the same).
    ``position`` is the range (low, high) that targets must lie in. Raises ``InputError`` for
    anything but finite numbers greater than zero.

    >>> Limits(velocity=90.0, acceleration=500.0, jerk=5000.0).deceleration
    500.0
    """

    velocity: float
    acceleration: float
    jerk: float
    deceleration: float | None = None
    deceleration_jerk: float | None = None
    position: tuple[float, float] | None = None
    #: The memory of an ``sj_limits`` per second; empty where each target must be looked at.
    _c: bytes = field(init=False, repr=False, compare=False, default=b"")
    _cycled: dict[float, bytes] = field(init=False, repr=False, compare=False, default_factory=dict)

    def __post_init__(self) -> None:
        if self.position is not None:
            try:
                low, high = self.position
            except (TypeError, ValueError):
                raise InputError("position", self.position, "must be (low, high)") from None
            low, high = real("position[0]", low), real("position[1]", high)
            if not low < high:
                raise InputError("position", self.position, "low must be below high")
            object.__setattr__(self, "position", (low, high))
        for name, fallback in (
            ("velocity", None),
            ("acceleration", None),
            ("jerk", None),
            ("deceleration", "acceleration"),
            ("deceleration_jerk", "jerk"),
        ):
            value = getattr(self, name)
            if value is None and fallback is not None:
                value = getattr(self, fallback)
            object.__setattr__(self, name, positive(name, value))
        if self.position is None:
            numbers = self.velocity, self.acceleration, self.jerk, *self.braking
            object.__setattr__(self, "_c", struct.pack("5d", *numbers))

    @classmethod
    def from_jerk_factor(
        cls,
        velocity: float,
        acceleration: float,
        jerk_factor: float,
        *,
        deceleration: float | None = None,
        deceleration_jerk_factor: float | None = None,
        position: tuple[float, float] | None = None,
    ) -> Limits:
        """Limits from a jerk factor s in (0, 1], the share of a full ramp spent at jerk.

        s = T1 / Ta for a ramp from rest to ``velocity``, so J = Acc^2 / (s V): 1 is a pure S, near
        0 a trapezoid.

        >>> Limits.from_jerk_factor(90.0, 450.0, 0.5).jerk
        4500.0
        """
        braking = acceleration if deceleration is None else deceleration
        factors = (
            jerk_factor,
            jerk_factor if deceleration_jerk_factor is None else deceleration_jerk_factor,
        )
        for name, factor in zip(("jerk_factor", "deceleration_jerk_factor"), factors, strict=True):
            if positive(name, factor) > 1.0:
                raise InputError(name, factor, "must lie in (0, 1]")
        v = positive("velocity", velocity)
        jerks = [
            positive(name, level) ** 2 / (factor * v)
            for name, level, factor in zip(
                ("acceleration", "deceleration"), (acceleration, braking), factors, strict=True
            )
        ]
        return cls(velocity, acceleration, jerks[0], braking, jerks[1], position)

    def _per_cycle(self, cycle_time: float) -> bytes:
        """The limits per cycle as the memory of an ``sj_limits``; made once per cycle time."""
        made = self._cycled.get(cycle_time) if cycle_time.__class__ is float else None
        if made is None:
            T = positive("cycle_time", cycle_time)
            deceleration, deceleration_jerk = self.braking
            made = struct.pack(
                "5d",
                self.velocity * T,
                self.acceleration * T**2,
                self.jerk * T**3,
                deceleration * T**2,
                deceleration_jerk * T**3,
            )
            if self.position is None and len(self._cycled) < 16:  # else every target is looked at
                self._cycled[T] = made
        return made

    @property
    def braking(self) -> tuple[float, float]:
        """Deceleration and its jerk, as plain floats."""
        assert self.deceleration is not None
        assert self.deceleration_jerk is not None
        return self.deceleration, self.deceleration_jerk


@dataclass(frozen=True, slots=True)
class State:
    """Position, velocity and acceleration of one axis at one moment.

    >>> State(160.0)
    State(position=160.0, velocity=0.0, acceleration=0.0)
    """

    position: float
    velocity: float = 0.0
    acceleration: float = 0.0
    #: The memory of an ``sj_state``, made once for every later call.
    _c: bytes = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        numbers = [
            real(name, getattr(self, name)) for name in ("position", "velocity", "acceleration")
        ]
        for name, number in zip(("position", "velocity", "acceleration"), numbers, strict=True):
            object.__setattr__(self, name, number)
        object.__setattr__(self, "_c", struct.pack("3d", *numbers))


@dataclass(frozen=True)
class Phase:
    """Constant ``jerk`` (signed, axis coordinates) over a whole number of ``cycles``; Eq. (1)."""

    cycles: int
    jerk: float


@dataclass(frozen=True, eq=False)
class Samples:
    """A motion in numbers: five arrays of one shape, float64, in seconds and the axis's unit."""

    time: FloatArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray

    @classmethod
    def empty(cls, rows: int) -> Samples:
        """Room for ``rows`` samples, to be filled by ``Profile.sample(out=...)``."""
        return cls(*(np.empty(rows) for _ in range(5)))


class Range(NamedTuple):
    """Least and greatest value."""

    low: float
    high: float


@dataclass(frozen=True)
class Extrema:
    """Ranges that a planned motion covers, inside phases as well as at their ends."""

    position: Range
    velocity: Range
    acceleration: Range
    jerk: Range


class _Way(NamedTuple):
    """Nodes of a plan: time, P, V, A at phase starts and at the end, and the jerk from there."""

    time: FloatArray
    P: FloatArray
    V: FloatArray
    A: FloatArray
    J: FloatArray


class Profile:
    """A planned motion of one axis in whole control cycles. Immutable.

    ``start`` and ``end`` are the samples that the drive gets before and after: ``sample()`` begins
    with the one and settles on the other, bit for bit. The plan ``at(t)`` is the continuous motion
    behind the samples; they show it about half a cycle late (``docs/architecture.md``).
    """

    # The fast path makes profiles from C plans and leaves everything else until it is asked for.
    __slots__ = (
        "_c_owner",
        "_c_plan",
        "_cycle_time",
        "_end",
        "_phases",
        "_range",
        "_start",
        "_way",
    )

    _phases: tuple[Phase, ...] | None
    _way: _Way | None

    def __init__(
        self,
        phases: Sequence[Phase],
        cycle_time: float,
        start: State,
        end: State,
        *,
        position_range: tuple[float, float] | None = None,
    ) -> None:
        """Phases as they follow each other; ``cycle_time`` in seconds.

        Raises InputError for lengths that are no cycles and jerks that are no numbers.
        """
        self._cycle_time = positive("cycle_time", cycle_time)
        self._phases = tuple(phases)
        for name, state in (("start", start), ("end", end)):
            if not isinstance(state, State):
                raise InputError(name, state, "must be a State")
        self._start, self._end, self._range = start, end, position_range
        self._way = self._c_owner = None
        if len(self._phases) > lib.SJ_PHASES:
            raise InputError("phases", len(self._phases), f"at most {lib.SJ_PHASES}")
        self._c_plan = ffi.new("sj_plan *")
        self._c_plan.count = len(self._phases)
        per_cycle = self._cycle_time**3
        for i, phase in enumerate(self._phases):
            if isinstance(phase.cycles, bool) or not isinstance(phase.cycles, int):
                raise InputError(f"phases[{i}].cycles", phase.cycles, "must be an int")
            if not 1 <= phase.cycles <= CYCLES_MAX:
                raise InputError(f"phases[{i}].cycles", phase.cycles, f"must be 1 .. {CYCLES_MAX}")
            self._c_plan.phase[i].cycles = phase.cycles
            self._c_plan.phase[i].jerk = real(f"phases[{i}].jerk", phase.jerk) * per_cycle
            self._c_plan.cycles += phase.cycles

    @classmethod
    def _of(
        cls,
        plan: Any,
        cycle_time: float,
        start: State,
        end: State,
        position_range: tuple[float, float] | None,
        owner: Any = None,
    ) -> Profile:
        """A profile of a finished ``sj_plan *``; ``owner`` keeps its memory."""
        self = cls.__new__(cls)
        self._c_plan = plan
        self._c_owner = owner
        self._cycle_time = cycle_time
        self._start = start
        self._end = end
        self._range = position_range
        self._phases = self._way = None
        return self

    @property
    def phases(self) -> tuple[Phase, ...]:
        """The phases of constant jerk, in order."""
        if self._phases is None:
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
    def cycles(self) -> int:
        """Length N of the plan in control cycles."""
        return int(self._c_plan.cycles)

    @property
    def duration(self) -> float:
        """Length of the plan in seconds, N * cycle_time."""
        return self.cycles * self._cycle_time

    @property
    def leaves_range(self) -> bool:
        """Whether the way leaves the position range of the limits it was planned under."""
        if self._range is None:
            return False
        low, high = self._range
        reach = self.extrema().position
        slack = 1e-12 * max(abs(low), abs(high))
        return reach.low < low - slack or reach.high > high + slack

    def _key(self) -> tuple[Any, ...]:
        return self.phases, self._cycle_time, self._start, self._end, self._range

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Profile) and self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())

    def __repr__(self) -> str:
        return (
            f"Profile(phases={self.phases!r}, cycle_time={self._cycle_time!r}, "
            f"start={self._start!r}, end={self._end!r})"
        )

    def __reduce__(self) -> tuple[Any, ...]:
        return _profile_from, self._key()

    @property
    def _nodes(self) -> _Way:
        """Time, P, V, A at the start of every phase and at the end, and the jerk from there on."""
        if self._way is not None:
            return self._way
        T_s = self._cycle_time
        # Half-cycle lemma, no jerk before the start: the continuous state behind the first sample.
        A = self._start.acceleration
        V = self._start.velocity + 0.5 * T_s * A
        P = self._start.position + 0.5 * T_s * self._start.velocity - T_s**2 / 12.0 * A
        done = 0
        nodes = [(0.0, P, V, A)]
        for phase in self.phases:
            t = phase.cycles * T_s
            # Eqs. (6), (4), (2) at the end of the interval
            P += V * t + A * t**2 / 2.0 + phase.jerk * t**3 / 6.0
            V += A * t + phase.jerk * t**2 / 2.0
            A += phase.jerk * t
            done += phase.cycles
            nodes.append((done * T_s, P, V, A))
        jerks = np.array([*(phase.jerk for phase in self.phases), 0.0])
        time, position, velocity, acceleration = np.array(nodes).T.copy()
        self._way = _Way(time, position, velocity, acceleration, jerks)
        return self._way

    def at(self, t: ArrayLike) -> Samples:
        """Return the planned motion at time ``t`` in closed form, Eqs. (1)-(6).

        ``t`` in seconds from the start, scalar or array; before 0 and after ``duration`` the motion
        is the one of that moment held at its velocity. Fields have the shape of ``t``.

        >>> profile = scurve(160.0, Limits(90.0, 500.0, 5000.0), 1e-3)
        >>> round(float(profile.at(profile.duration / 2).velocity), 9) <= 90.0
        True
        """
        time = np.asarray(t, dtype=np.float64)
        starts, P, V, A, J = self._nodes
        clipped = np.clip(time, 0.0, starts[-1])
        i = np.clip(np.searchsorted(starts, clipped, side="right") - 1, 0, len(starts) - 1)
        dt = clipped - starts[i]
        jerk = np.where((time < 0.0) | (time >= starts[-1]), 0.0, J[i])  # Eq. (1)
        acceleration = A[i] + J[i] * dt  # Eq. (2)
        velocity = V[i] + dt * (A[i] + dt * J[i] / 2.0)  # Eq. (3)
        position = P[i] + dt * (V[i] + dt * (A[i] / 2.0 + dt * J[i] / 6.0))  # Eq. (5)
        position = position + velocity * (time - clipped)
        return Samples(time, position, velocity, acceleration, jerk)

    def sample(self, out: Samples | None = None) -> Samples:
        """Return what the drive gets, cycle by cycle, Eqs. (15)-(17): N + 2 rows.

        Row 0 is ``start``, row N + 1 the settled ``end``, equal to the goal bit for bit. ``out``:
        arrays to fill (float64, contiguous, exactly N + 2 long), for use without allocation.

        >>> samples = scurve(160.0, Limits(90.0, 500.0, 5000.0), 1e-3).sample()
        >>> float(samples.position[-1]), float(samples.velocity[-1])
        (160.0, 0.0)
        """
        rows = self.cycles + 2
        if out is None:
            out = Samples.empty(rows)
        elif not isinstance(out, Samples):
            raise InputError("out", type(out).__name__, "must be a Samples")
        elif len({id(getattr(out, name)) for name in COLUMNS}) < len(COLUMNS):
            raise InputError("out", "one array for two columns", "must be five arrays")
        self._sample_rows(out, rows)
        return out

    def _sample_rows(self, out: Samples, rows: int) -> None:
        table = ffi.new("sj_table *")
        table.rows = rows
        columns = [_c_column(name, getattr(out, name), rows) for name in COLUMNS]
        table.time, table.position, table.velocity, table.acceleration, table.jerk = columns
        ends = self._start._c, self._end._c
        if lib.sj_sample(self._c_plan, *ends, self._cycle_time, table) != lib.SJ_LOAD_OK:
            raise InputError("phases", self.phases, "must lead from start to end in whole cycles")

    def extrema(self) -> Extrema:
        """Return the ranges of the plan, with the peaks inside phases (zeros of A and of V)."""
        starts, _P, V, A, J = self._nodes
        times = list(starts)
        for i in range(len(self.phases)):
            length = starts[i + 1] - starts[i]
            # zeros of A are peaks of the velocity, zeros of V peaks of the position
            for root in (*_roots(0.0, J[i], A[i]), *_roots(J[i] / 2.0, A[i], V[i])):
                if 0.0 < root < length:
                    times.append(starts[i] + root)
        plan = self.at(np.array(times))
        jerks = J[:-1] if self.phases else J
        return Extrema(
            *(
                Range(float(np.min(x)), float(np.max(x)))
                for x in (plan.position, plan.velocity, plan.acceleration, jerks)
            )
        )


def _profile_from(
    phases: tuple[Phase, ...], cycle_time: float, start: State, end: State, range_: Any
) -> Profile:
    return Profile(phases, cycle_time, start, end, position_range=range_)


def _roots(a: float, b: float, c: float) -> tuple[float, ...]:
    """Real roots of a x^2 + b x + c, without cancellation."""
    if a == 0.0:
        return (-c / b,) if b != 0.0 else ()
    square = b * b - 4.0 * a * c
    if square < 0.0:
        return ()
    q = -0.5 * (b + math.copysign(math.sqrt(square), b))
    return (q / a, c / q) if q != 0.0 else (0.0,)


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


# ---- the paper's closed form, Eqs. (7)-(14) ------------------------------------------------------


class _Intervals(NamedTuple):
    """T1 (= T3), T2, T4, T5 (= T7), T6 in cycles."""

    T1: int
    T2: int
    T4: int
    T5: int
    T6: int

    @property
    def cycles(self) -> int:
        return 2 * self.T1 + self.T2 + self.T4 + 2 * self.T5 + self.T6


class _Levels(NamedTuple):
    """What Eqs. (11)-(13) adjust; Dec_max signed (negative while braking)."""

    Acc_max: float
    V_max: float
    Dec_max: float


class _Task(NamedTuple):
    """One question to the closed form: forward, magnitudes, seconds."""

    L: float
    V_start: float
    V_end: float
    V_max: float
    Acc_max: float
    J_acc: float
    Dec_max: float
    J_dec: float
    T_s: float
    to_cycles: Callable[[float], int]


def _up(cycles: float) -> int:
    return math.ceil(cycles * (1.0 - ROUNDING_SLACK))


def _nearest(cycles: float) -> int:
    return math.floor(cycles + 0.5)


def _ramp(task: _Task, dV: float, Acc_max: float, J: float) -> tuple[int, int]:
    """T1 and T2 in cycles for a change of velocity ``dV`` >= 0."""
    if dV <= 0.0:
        return 0, 0  # no change: that ramp is absent
    if dV * J < Acc_max**2:
        # T2 < 0: the ramp never reaches Acc_max; its time is 2 sqrt(dV / J)
        return max(1, task.to_cycles(math.sqrt(dV / J) / task.T_s)), 0
    T1 = max(1, task.to_cycles(abs(Acc_max / J) / task.T_s))  # Eq. (7)
    Ta = max(T1, task.to_cycles(abs(dV / Acc_max) / task.T_s))  # Eq. (8)
    return T1, Ta - T1


def _ramp_time(dV: float, Acc_max: float, J: float) -> float:
    """Length of the shortest continuous ramp, T1 + T2 + T3."""
    if dV * J < Acc_max**2:
        return 2.0 * math.sqrt(max(dV, 0.0) / J)
    return dV / Acc_max + Acc_max / J


def _distance_at(task: _Task, V: float) -> float:
    """Distance of the two continuous ramps that meet at the peak velocity ``V``."""
    ta = _ramp_time(V - task.V_start, task.Acc_max, task.J_acc)
    td = _ramp_time(V - task.V_end, task.Dec_max, task.J_dec)
    return 0.5 * (task.V_start + V) * ta + 0.5 * (V + task.V_end) * td


def _V_adj(task: _Task) -> float:
    """Return the peak velocity of a move too short for V_max: Eq. (14) for full ramps."""
    lowest = max(task.V_start, task.V_end)
    if _distance_at(task, task.V_max) <= task.L:
        return task.V_max
    Acc, Dec, J_acc, J_dec = task.Acc_max, task.Dec_max, task.J_acc, task.J_dec
    alpha = 1.0 / Acc + 1.0 / Dec
    beta = Acc / J_acc + Dec / J_dec
    gamma = (
        Acc * task.V_start / J_acc
        + Dec * task.V_end / J_dec
        - task.V_start**2 / Acc
        - task.V_end**2 / Dec
        - 2.0 * task.L
    )
    square = beta**2 - 4.0 * alpha * gamma
    if square >= 0.0:
        V_adj = (-beta + math.sqrt(square)) / (2.0 * alpha)  # Eq. (14)
        full = V_adj - task.V_start >= Acc**2 / J_acc and V_adj - task.V_end >= Dec**2 / J_dec
        if full and V_adj >= lowest:
            return V_adj
    # A ramp that never reaches its limit: the distance grows with the peak, so bracket and halve
    # to the last bit.
    low, high = lowest, task.V_max
    while True:
        middle = 0.5 * (low + high)
        if not low < middle < high:
            return high
        if _distance_at(task, middle) < task.L:
            low = middle
        else:
            high = middle


def _intervals(task: _Task) -> _Intervals:
    """Eqs. (7)-(10), and (14) with them again where there is no cruise."""
    T_s = task.T_s
    T1, T2 = _ramp(task, task.V_max - task.V_start, task.Acc_max, task.J_acc)
    T5, T6 = _ramp(task, task.V_max - task.V_end, task.Dec_max, task.J_dec)
    Ta, Td = (T1 + T2) * T_s, (T5 + T6) * T_s
    Acc_adj = (task.V_max - task.V_start) / Ta if Ta else 0.0  # Eq. (9)
    Dec_adj = (task.V_end - task.V_max) / Td if Td else 0.0  # Eq. (9)
    T4 = (
        task.L
        - (2 * T1 + T2) * T_s * (task.V_start + 0.5 * Acc_adj * Ta)
        - (2 * T5 + T6) * T_s * (task.V_max + 0.5 * Dec_adj * Td)
    ) / (task.V_max * T_s)  # Eq. (10)
    if T4 > 0.0:
        return _Intervals(T1, T2, task.to_cycles(T4), T5, T6)
    V_adj = _V_adj(task)  # Eq. (14); V_max := V_adj, T4 := 0, Eqs. (7)-(9) again
    T1, T2 = _ramp(task, V_adj - task.V_start, task.Acc_max, task.J_acc)
    T5, T6 = _ramp(task, V_adj - task.V_end, task.Dec_max, task.J_dec)
    return _Intervals(T1, T2, 0, T5, T6)


def _levels(task: _Task, n: _Intervals) -> _Levels | None:
    """Eqs. (11)-(13): with the lengths fixed, the levels that meet distance and velocities."""
    L, V_start, V_end = task.L, task.V_start, task.V_end
    T1, T2, T4, T5, T6 = (count * task.T_s for count in n)
    Ta, Td = T1 + T2, T5 + T6
    Tc = T1 + 0.5 * T2 + T4 + T5 + 0.5 * T6
    if Tc == 0.0:
        return None
    Acc_max = Dec_max = 0.0
    if Ta:
        Acc_max = (L - V_start * (2 * T1 + T2 + T4 + T5 + 0.5 * T6) - V_end * (T5 + 0.5 * T6)) / (
            Ta * Tc
        )  # Eq. (11)
    V_max = (L - V_start * (T1 + 0.5 * T2) - V_end * (T5 + 0.5 * T6)) / Tc  # Eq. (12)
    if Td:
        Dec_max = (V_start * (T1 + 0.5 * T2) + V_end * (T1 + 0.5 * T2 + T4 + 2 * T5 + T6) - L) / (
            Td * Tc
        )  # Eq. (13)
    # An absent ramp leaves the velocity as it is; then the lengths alone must meet the distance.
    scale = max(V_max, V_start, V_end)
    for length, velocity in ((Ta, V_start), (Td, V_end)):
        if not length and abs(V_max - velocity) > 1e-12 * scale:
            return None
    return _Levels(Acc_max, V_max, Dec_max)


def _within(task: _Task, n: _Intervals, levels: _Levels | None) -> bool:
    """Whether the levels keep every limit: of acceleration forwards, of braking backwards."""
    if levels is None:
        return False
    slack = 1.0 + 10.0 * ROUNDING_SLACK
    if not 0.0 <= levels.V_max <= task.V_max * slack:
        return False
    for level, count in ((levels.Acc_max, n.T1), (levels.Dec_max, n.T5)):
        most, jerk = (task.Acc_max, task.J_acc) if level > 0.0 else (task.Dec_max, task.J_dec)
        if abs(level) > most * slack or abs(level) > jerk * count * task.T_s * slack:
            return False
    return True


def _splits(task: _Task, cycles: int) -> Iterator[_Intervals]:
    """Ways to divide so many cycles: all of them for a few, else ramps fitted to the peak."""
    if cycles <= 12:
        for T1, T5 in product(range(1, cycles // 2), repeat=2):
            rest = cycles - 2 * T1 - 2 * T5
            for T2, T6 in product(range(rest + 1), repeat=2):
                if rest >= T2 + T6:
                    yield _Intervals(T1, T2, rest - T2 - T6, T5, T6)
        return
    V = min(task.L / (cycles * task.T_s), task.V_max)
    for _ in range(4):
        ramps = []
        for velocity, rising in ((task.V_start, task.V_start < V), (task.V_end, task.V_end > V)):
            limits = (task.Acc_max, task.J_acc) if rising else (task.Dec_max, task.J_dec)
            ramps.append(_ramp(task, abs(V - velocity), *limits))
        (T1, T2), (T5, T6) = (ramp if ramp[0] else (1, 0) for ramp in ramps)
        T4 = cycles - 2 * T1 - T2 - 2 * T5 - T6
        if T4 < 0:
            return
        n = _Intervals(T1, T2, T4, T5, T6)
        yield n
        levels = _levels(task, n)
        assert levels is not None
        V = max(0.0, min(levels.V_max, task.V_max))


def _dip(task: _Task, shortest: int) -> _Intervals | None:
    """Return intervals of ``shortest`` cycles or a little more that keep the limits.

    Needed where whole cycles leave a gap: V_start or V_end > 0 and a peak velocity that the extra
    fraction of a cycle pushes below them. The profile then dips: it brakes before it accelerates.
    """
    extra = 0
    while extra <= 64 * shortest + 64:
        for n in _splits(task, shortest + extra):
            if _within(task, n, _levels(task, n)):
                return n
        extra += 1 + extra // 16
    return None


def _solve(task: _Task) -> tuple[_Intervals, _Levels] | None:
    """Lengths and levels of a forward profile, or None where there is none."""
    if task.L <= 0.0:
        return None
    n = _intervals(task)
    levels = _levels(task, n)
    if task.to_cycles is _nearest:
        return (n, levels) if levels is not None and levels.V_max >= 0.0 else None
    if not _within(task, n, levels):
        fewest = max(4, task.to_cycles(task.L / (task.V_max * task.T_s)))
        found = _dip(task, min(fewest, n.cycles)) or _dip(task, n.cycles)
        if found is None:
            return None
        n, levels = found, _levels(task, found)
    assert levels is not None
    return n, levels


def _distance_that_works(task: _Task) -> float:
    """Return a longer L that has a profile: the first of a growing row that is solved."""
    L = max(task.L, _distance_at(task, max(task.V_start, task.V_end)), task.V_max * task.T_s)
    while _solve(task._replace(L=L)) is None:
        L *= 1.05
    return L


def scurve(
    distance: float,
    limits: Limits,
    cycle_time: float,
    *,
    v_start: float = 0.0,
    v_end: float = 0.0,
    rounding: Literal["up", "nearest"] = "up",
) -> Profile:
    """Plan a forward move of ``distance`` in whole control cycles, Eqs. (7)-(14).

    ``distance`` is signed and covered exactly by the samples; ``v_start`` and ``v_end`` >= 0 are
    velocities along the travel; ``cycle_time`` in seconds. ``rounding="up"`` lengthens each
    interval to whole cycles and never exceeds a limit; ``"nearest"`` is the paper to the letter,
    and exceeds limits by some per cent in most plans. Ramps too short to reach their acceleration
    (T2 < 0 or T6 < 0) are solved as such. Where a fraction of a cycle would push the peak velocity
    below ``v_start`` or ``v_end``, the profile is lengthened until it keeps the limits.

    Raises ``InputError`` for unusable numbers and ``InfeasibleError``, with a distance that works,
    where no forward profile exists (a move shorter than the change of velocity needs).

    >>> profile = scurve(160.0, Limits(90.0, 500.0, 5000.0), 1e-3)
    >>> profile.cycles, [phase.cycles for phase in profile.phases]
    (2058, [100, 80, 100, 1498, 100, 80, 100])
    """
    distance = real("distance", distance)
    if not isinstance(limits, Limits):
        raise InputError("limits", limits, "must be a Limits")
    T_s = positive("cycle_time", cycle_time)
    for name, velocity in (("v_start", v_start), ("v_end", v_end)):
        if not 0.0 <= real(name, velocity) <= limits.velocity:
            raise InputError(name, velocity, f"must lie in [0, {limits.velocity!r}]")
    if rounding not in ("up", "nearest"):
        raise InputError("rounding", rounding, "must be 'up' or 'nearest'")
    sign = math.copysign(1.0, distance)
    start = State(0.0, sign * v_start)
    end = State(distance, sign * v_end)
    if distance == 0.0 and v_start == 0.0 and v_end == 0.0:
        return Profile((), T_s, start, end)

    # Half-cycle lemma, point 2: for the samples to cover the distance, the plan covers this.
    half_cycles = 0.5 * T_s * (v_start + v_end)
    Dec_max, J_dec = limits.braking
    task = _Task(
        abs(distance) - half_cycles,
        v_start,
        v_end,
        limits.velocity,
        limits.acceleration,
        limits.jerk,
        Dec_max,
        J_dec,
        T_s,
        _up if rounding == "up" else _nearest,
    )
    solution = _solve(task)
    if solution is None:
        works = sign * (_distance_that_works(task) + half_cycles)
        raise InfeasibleError(distance, works, "no forward profile in whole cycles")
    n, levels = solution
    if n.cycles > CYCLES_MAX:
        raise InputError("distance", distance, f"takes {n.cycles} cycles, at most {CYCLES_MAX}")
    J_acc = sign * levels.Acc_max / (n.T1 * T_s) if n.T1 else 0.0
    J_dec = sign * levels.Dec_max / (n.T5 * T_s) if n.T5 else 0.0
    # Eq. (1)
    phases = (
        Phase(n.T1, J_acc),
        Phase(n.T2, 0.0),
        Phase(n.T1, -J_acc),
        Phase(n.T4, 0.0),
        Phase(n.T5, J_dec),
        Phase(n.T6, 0.0),
        Phase(n.T5, -J_dec),
    )
    return Profile(tuple(phase for phase in phases if phase.cycles), T_s, start, end)
