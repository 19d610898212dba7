"""Planning from any state to any target in whole cycles: the C planner for Python.

``plan`` and ``plan_velocity`` return the same ``Profile`` as the paper's ``scurve``; ``plan_many``
is the fast path without an object per plan. ``docs/explanation/planner.md`` explains the method.
Never here: clocks, shared memory, drives.
"""

from __future__ import annotations

import math
import os
import struct
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Literal, NoReturn, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sjerk._binding import ffi, lib
from sjerk.errors import LARGEST, InputError, PlanError, positive, real
from sjerk.profile import CYCLES_MAX, FloatArray, Limits, Profile, Samples, State

Synchronization = Literal["time", "phase", "none"]
_CODES = {"none": lib.SJ_SYNC_NONE, "time": lib.SJ_SYNC_TIME, "phase": lib.SJ_SYNC_PHASE}
_NAMES: dict[int, Synchronization] = {
    lib.SJ_SYNC_NONE: "none",
    lib.SJ_SYNC_TIME: "time",
    lib.SJ_SYNC_PHASE: "phase",
}
#: Allocation without clearing, and types looked up once: this is the fast path.
_new = ffi.new_allocator(should_clear_after_alloc=False)
#: Starting a thread costs about as much as planning a thousand axes.
_ROWS_PER_THREAD = 4000
_MOST: int = lib.SJ_AXES
_ROOM: int = lib.SJ_PHASES
_PHASE: int = lib.SJ_SYNC_PHASE
_PLAN, _INT = ffi.typeof("sj_plan *"), ffi.typeof("int32_t *")
_PLANS = [ffi.typeof(f"sj_plan[{n}]") for n in range(_MOST + 1)]
#: Only "phase" is ever changed by the planner: the others can be shared.
_MODES = {code: ffi.new("int32_t *", code) for code in _CODES.values()}
#: By cycle time: what one of each limit per second is per cycle, as the memory of an ``sj_limits``.
_UNITS: dict[float, bytes] = {}
_PER_CYCLE = struct.pack("5d", 1.0, 1.0, 1.0, 1.0, 1.0)
_ROW = np.dtype(
    [("cycles", np.int64), ("first", np.int64), ("count", np.int32), ("kind", np.int32)]
)
_PHASES = np.dtype([("cycles", np.int64), ("jerk", np.float64)])
assert _ROW.itemsize == ffi.sizeof("sj_row")
assert _PHASES.itemsize == ffi.sizeof("sj_phase")


class Motion:
    """Planned motions of N axes that start together.

    ``synchronization`` is what was done: ``"phase"`` falls back to ``"time"``.
    """

    __slots__ = ("_axes", "_code", "_plans", "_profiles", "_ranges", "_states", "_time")

    _profiles: tuple[Profile, ...] | None

    def __init__(
        self,
        plans: Any,
        cycle_time: float,
        axes: int,
        states: bytes,
        ranges: list[tuple[float, float] | None] | None,
        code: int,
    ) -> None:
        """Not for callers: ``plan`` makes it. ``states``: memory of starts, then of targets."""
        self._plans = plans
        self._time = cycle_time
        self._axes = axes
        self._states = states
        self._ranges = ranges
        self._code = code
        self._profiles = None

    @property
    def synchronization(self) -> Synchronization:
        """How the axes share the motion."""
        return _NAMES[self._code]

    @property
    def profiles(self) -> tuple[Profile, ...]:
        """One profile per axis, of one length unless ``synchronization`` is ``"none"``."""
        if self._profiles is None:
            states = _unpacked(self._states)
            starts, ends = states[: self._axes], states[self._axes :]
            ranges = self._ranges or [None] * self._axes
            self._profiles = tuple(
                Profile._of(self._plans + i, self._time, start, end, limit, self._plans)
                for i, (start, end, limit) in enumerate(zip(starts, ends, ranges, strict=True))
            )
        return self._profiles

    def _key(self) -> tuple[Any, ...]:
        memory = bytes(ffi.buffer(self._plans, self._axes * ffi.sizeof("sj_plan")))
        return memory, self._time, self._axes, self._states, self._ranges, self._code

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Motion) and (self._time, self._code, self.profiles) == (
            other._time,
            other._code,
            other.profiles,
        )

    def __hash__(self) -> int:
        return hash((self._time, self._code, self.profiles))

    def __reduce__(self) -> tuple[Any, ...]:
        return _motion_from, self._key()

    def __repr__(self) -> str:
        return (
            f"<Motion of {self._axes} axes, {self.cycles} cycles of {self._time!r} s, "
            f"synchronization {self.synchronization!r}>"
        )

    def __len__(self) -> int:
        return self._axes

    def __getitem__(self, axis: int) -> Profile:
        return self.profiles[axis]

    def __iter__(self) -> Iterator[Profile]:
        return iter(self.profiles)

    @property
    def cycle_time(self) -> float:
        """Control cycle in seconds."""
        return self._time

    @property
    def cycles(self) -> int:
        """Length of the longest profile in control cycles."""
        return int(max(self._plans[i].cycles for i in range(self._axes)))

    @property
    def duration(self) -> float:
        """Length in seconds."""
        return self.cycles * self._time

    @property
    def leaves_range(self) -> bool:
        """Whether any axis leaves its position range on the way."""
        return any(profile.leaves_range for profile in self.profiles)

    def at(self, t: ArrayLike) -> Samples:
        """Return the planned motions at time ``t``: fields have the shape of ``t`` and (N,)."""
        axes = [profile.at(t) for profile in self.profiles]
        stacked = (
            np.stack([getattr(axis, name) for axis in axes], axis=-1)
            for name in ("position", "velocity", "acceleration", "jerk")
        )
        return Samples(axes[0].time, *stacked)

    def sample(self) -> Samples:
        """Return what the drives get: ``time`` (rows,), the rest (rows, N); rows = cycles + 2.

        An axis that arrives earlier (``"none"``) goes on with its end velocity.
        """
        rows, axes = self.cycles + 2, len(self)
        columns = [np.empty((axes, rows)) for _ in range(4)]
        time = np.empty(rows)
        for i, profile in enumerate(self.profiles):
            profile._sample_rows(Samples(time, *(column[i] for column in columns)), rows)
        return Samples(time, *(column.T for column in columns))


def _motion_from(memory: bytes, cycle_time: float, axes: int, *rest: Any) -> Motion:
    plans = ffi.new("sj_plan[]", axes)
    ffi.memmove(plans, memory, len(memory))
    return Motion(plans, cycle_time, axes, *rest)


@dataclass(frozen=True, eq=False)
class Plans:
    """Many independent plans as arrays; row i is request i.

    ``rows``: cycles, the index of the first phase, how many phases, and their kind; ``pool``: the
    phases of all plans, cycles and jerks per cycle^3.
    """

    cycle_time: float
    rows: NDArray[Any]
    pool: NDArray[Any]

    @property
    def cycles(self) -> NDArray[np.int64]:
        """Lengths in control cycles."""
        cycles: NDArray[np.int64] = self.rows["cycles"]
        return cycles

    @property
    def duration(self) -> FloatArray:
        """Lengths in seconds."""
        return np.multiply(self.cycles, self.cycle_time, dtype=np.float64)

    @property
    def phase_counts(self) -> NDArray[np.int32]:
        """Phases used by each plan."""
        counts: NDArray[np.int32] = self.rows["count"]
        return counts

    def phases(self, i: int) -> tuple[NDArray[np.int64], FloatArray]:
        """Cycles and jerks (axis unit / s^3) of the phases of plan ``i``."""
        first = int(self.rows["first"][i])
        used = self.pool[first : first + int(self.phase_counts[i])]
        return used["cycles"].copy(), used["jerk"] / self.cycle_time**3

    def __reduce__(self) -> tuple[Any, ...]:
        counts = self.phase_counts.astype(np.int64)
        packed = self.rows.copy()
        packed["first"] = np.cumsum(counts) - counts
        used = np.repeat(self.rows["first"] - packed["first"], counts) + np.arange(counts.sum())
        return Plans, (self.cycle_time, packed, self.pool[used])

    def __len__(self) -> int:
        return len(self.rows)


@overload
def plan(
    start: State | float,
    target: State | float,
    limits: Limits,
    cycle_time: float,
    *,
    synchronization: Synchronization = ...,
    min_duration: float = ...,
) -> Profile: ...
@overload
def plan(
    start: Sequence[State | float],
    target: Sequence[State | float],
    limits: Limits | Sequence[Limits],
    cycle_time: float,
    *,
    synchronization: Synchronization = ...,
    min_duration: float = ...,
) -> Motion: ...
def plan(
    start: State | float | Sequence[State | float],
    target: State | float | Sequence[State | float],
    limits: Limits | Sequence[Limits],
    cycle_time: float,
    *,
    synchronization: Synchronization = "time",
    min_duration: float = 0.0,
) -> Profile | Motion:
    """Plan the fastest motion in whole cycles from any state to any target.

    ``start`` and ``target``: a ``State`` or a position (one axis), or sequences of them (N axes,
    1 to 64); states of the samples, with no jerk before the start. The target's velocity is free
    within the limits, its acceleration must be 0. A start outside the limits is brought back inside
    as fast as jerk allows. ``synchronization``: ``"time"`` all axes arrive in the same cycle,
    ``"phase"`` on a straight line (rest to rest; else time), ``"none"`` each for itself.
    ``min_duration`` in seconds stretches.

    The direction of the move, for ``deceleration`` limits, is that of the way the plan covers: from
    start to target, less the half cycle of both velocities (T/2 times their sum). Any request of
    usable numbers succeeds. Raises InputError for unusable ones: not finite, target outside
    ``limits.position`` or faster than ``limits.velocity``, more than 2^50 cycles.

    >>> limits = Limits(velocity=90.0, acceleration=500.0, jerk=5000.0)
    >>> profile = plan(State(10.0, velocity=40.0), 160.0, limits, 1e-3)
    >>> profile.cycles, float(profile.sample().position[-1])
    (1862, 160.0)
    """
    if (
        start.__class__ is State
        and target.__class__ is State
        and limits.__class__ is Limits
        and synchronization == "time"
        and min_duration.__class__ is float
        and not min_duration
    ):
        return _one(start, target, limits, cycle_time)
    fast = min_duration.__class__ is float and not min_duration
    if fast and start.__class__ is list and target.__class__ is list:
        motion = _many_axes(start, target, limits, cycle_time, synchronization)
        if motion is not None:
            return motion
    code, least = code_of(synchronization), cycles_of(min_duration, cycle_time)
    one = not _is_sequence(start) and not _is_sequence(target)
    starts = _states("start", [start] if one else start)
    targets = _states("target", [target] if one else target)
    if not isinstance(limits, Limits) and not _is_sequence(limits):
        raise InputError("limits", limits, "must be a Limits or a list of one per axis")
    several = [limits] * len(starts) if isinstance(limits, Limits) else list(limits)
    return _axes(starts, targets, several, cycle_time, least, code, single=one)


def _one(start: State, target: State, limits: Limits, T: float) -> Profile:
    """The fast path: one axis, states built beforehand, no options."""
    if limits.position is not None:
        check_target("target", target, limits)
    made = _new(_PLAN)
    status = lib.sj_plan_sample(T, start._c, target._c, limits._per_cycle(T), made)
    if status:
        _fail(status, "target", target, limits)
    return Profile._of(made, T, start, target, limits.position)


def _many_axes(
    starts: list[Any], targets: list[Any], limits: Any, T: float, synchronization: str
) -> Motion | None:
    """The fast path of several axes: lists of states and limits of every target. None: not that."""
    n = len(starts)
    try:
        states = b"".join([state._c for state in starts + targets])
        rows = b"".join([limit._c for limit in limits])
        code = _CODES[synchronization]
        unit = _UNITS.get(T) or _unit(T)
    except (AttributeError, KeyError, TypeError):
        return None
    if len(targets) != n or len(limits) != n or len(states) != 48 * n or len(rows) != 40 * n:
        return None
    if not 0 < n <= _MOST:
        return None
    plans = _new(_PLANS[n])
    mode = _MODES[code] if code != _PHASE else _new(_INT, code)
    if lib.sj_plan_samples(n, T, states, rows, unit, 0, mode, plans):
        return None
    return Motion(plans, T, n, states, None, mode[0])


def _unit(cycle_time: float) -> bytes:
    """The entry of _UNITS, which this fills."""
    T = positive("cycle_time", cycle_time)
    made = struct.pack("5d", T, T**2, T**3, T**2, T**3)
    if len(_UNITS) < 16:
        _UNITS[T] = made
    return made


def _axes(
    starts: list[State],
    targets: list[State],
    limits: list[Limits],
    T: float,
    least: int,
    code: int,
    *,
    single: bool,
) -> Profile | Motion:
    n = len(starts)
    if not n == len(targets) == len(limits):
        lengths = (n, len(targets), len(limits))
        raise InputError("start, target, limits", lengths, "must have one entry per axis")
    if not 1 <= n <= lib.SJ_AXES:
        raise InputError("start", n, f"must be 1 .. {lib.SJ_AXES} axes")
    _check_targets(targets, limits)
    plans, mode = _new(_PLANS[n]), _new(_INT, code)
    states = b"".join([state._c for state in (*starts, *targets)])
    rows = b"".join([limit._per_cycle(T) for limit in limits])
    status = lib.sj_plan_samples(n, T, states, rows, _PER_CYCLE, least, mode, plans)
    if status:
        _fail(status, "target", targets, limits)
    ranges = [limit.position for limit in limits]
    if single:
        return Profile._of(plans + 0, T, starts[0], targets[0], ranges[0], plans)
    return Motion(plans, T, n, states, ranges, mode[0])


def plan_velocity(
    start: State | float, velocity: float, limits: Limits, cycle_time: float
) -> Profile:
    """Plan the fastest change to ``velocity`` in whole cycles (jog; stop with 0).

    ``start``: a ``State``, or a position at rest. Where it ends is ``Profile.end``; the direction
    of the move is that of ``velocity``, or of the start's velocity for a stop. Raises InputError.

    >>> profile = plan_velocity(State(0.0, velocity=90.0), 0.0, Limits(90.0, 500.0, 5000.0), 1e-3)
    >>> profile.cycles, profile.end.velocity
    (280, 0.0)
    """
    (state,) = _states("start", [start])
    if not isinstance(limits, Limits):
        raise InputError("limits", limits, "must be a Limits")
    cycle_time = positive("cycle_time", cycle_time)
    velocity = real("velocity", velocity)
    if abs(velocity) > limits.velocity:
        raise InputError("velocity", velocity, f"must lie within +-{limits.velocity!r}")
    made, end = _new(_PLAN), ffi.new("double *")
    status = lib.sj_plan_sample_velocity(
        cycle_time,
        state._c,
        velocity,
        limits._per_cycle(cycle_time),
        made,
        end,
    )
    if status != 0:
        _fail(status, "velocity", velocity, limits)
    return Profile._of(made, cycle_time, state, State(end[0], velocity), limits.position)


def plan_many(
    start: ArrayLike,
    target: ArrayLike,
    limits: Limits | Sequence[Limits] | NDArray[Any],
    cycle_time: float,
) -> Plans:
    """Plan n independent axes at once, without a Python object per plan and without the GIL.

    ``start``: positions (n,), or rows (n, 1..3) of position, velocity, acceleration; ``target``:
    positions (n,), or rows (n, 1..2) of position, velocity; ``limits``: one for all, one each, or
    an array (n, 3) of velocity, acceleration, jerk or (n, 5) with those of braking. Row i
    of the result is what ``plan`` would return. Raises InputError with the row.

    >>> plans = plan_many([0.0, 1.0], [160.0, 160.0], Limits(90.0, 500.0, 5000.0), 1e-3)
    >>> plans.cycles.tolist()
    [2058, 2047]
    """
    begin, end = _rows("start", start, 3), _rows("target", target, 2)
    T = positive("cycle_time", cycle_time)
    n, step = len(begin), 1
    if isinstance(limits, Limits):
        _check_range(end, limits, slice(None))
        c_limits, step = ffi.from_buffer("sj_limits[]", limits._per_cycle(T)), 0
        given = n
    elif isinstance(limits, np.ndarray):
        table = _limit_rows(limits) * np.array([T, T**2, T**3, T**2, T**3])
        c_limits = ffi.cast("sj_limits *", ffi.from_buffer(table))
        given = len(table)
    else:
        if not _is_sequence(limits) or not all(isinstance(k, Limits) for k in limits):
            raise InputError("limits", limits, "must be a Limits, a list of them, or an array")
        for i, limit in enumerate(limits):
            _check_range(end, limit, slice(i, i + 1))
        c_limits = ffi.from_buffer("sj_limits[]", b"".join([k._per_cycle(T) for k in limits]))
        given = len(limits)
    if len(end) != n or given != n:
        raise InputError("start, target, limits", (n, len(end), given), "must be of one length")
    # most of the pool is never touched, and so never becomes memory
    rows, pool = np.empty(n, dtype=_ROW), np.empty(n * _ROOM, dtype=_PHASES)
    starts, ends = (ffi.from_buffer("double[]", table) for table in (begin, end))
    made = ffi.cast("sj_row *", ffi.from_buffer(rows))
    phases = ffi.cast("sj_phase *", ffi.from_buffer(pool))

    def run(first: int, last: int) -> tuple[int, int]:
        """Rows first .. last - 1: status, and the row that failed."""
        failed = ffi.new("int64_t *")
        status = lib.sj_plan_rows(
            last - first,
            T,
            starts + first * begin.shape[1],
            begin.shape[1],
            ends + first * end.shape[1],
            end.shape[1],
            c_limits + first * step,
            step,
            made + first,
            phases,
            first * _ROOM,
            failed,
        )
        return status, first + int(failed[0])

    for status, row in _in_parallel(run, n):
        if status == 0:
            continue
        state = (begin[row].tolist(), end[row].tolist())
        shown = limits if isinstance(limits, Limits) else limits[row]
        _fail(status, f"row {row}", state, shown)
    return Plans(T, rows, pool)


def _in_parallel(run: Callable[[int, int], tuple[int, int]], n: int) -> list[tuple[int, int]]:
    """Rows 0 .. n - 1 in as many parts as there are processors for us, if it is worth a thread."""
    parts = min(len(os.sched_getaffinity(0)), n // _ROWS_PER_THREAD)
    if parts < 2:
        return [run(0, n)]
    cuts = [n * i // parts for i in range(parts + 1)]
    with ThreadPoolExecutor(parts) as pool:
        return list(pool.map(run, cuts[:-1], cuts[1:]))


def _check_range(end: FloatArray, limits: Limits, rows: slice) -> None:
    if limits.position is None:
        return
    low, high = limits.position
    outside = (end[rows, 0] < low) | (end[rows, 0] > high)
    if outside.any():
        row = (rows.start or 0) + int(np.argmax(outside))
        raise InputError(f"target[{row}].position", end[row, 0], f"must lie in {limits.position}")


def _limit_rows(limits: NDArray[Any]) -> FloatArray:
    rows = _numbers("limits", limits)
    if rows.ndim != 2 or rows.shape[1] not in (3, 5):
        raise InputError("limits", rows.shape, "must have shape (n, 3) or (n, 5)")
    # the row is looked for only where one is bad
    if not (rows.min(initial=1.0) >= 1.0 / LARGEST and rows.max(initial=1.0) <= LARGEST):
        row = int(np.argmin(((rows >= 1.0 / LARGEST) & (rows <= LARGEST)).all(axis=1)))
        raise InputError(
            f"limits[{row}]",
            rows[row].tolist(),
            f"must be greater than 0, within {1.0 / LARGEST:g} .. {LARGEST:g}",
        )
    return rows if rows.shape[1] == 5 else np.hstack([rows, rows[:, 1:3]])


def _rows(name: str, value: ArrayLike, most: int) -> FloatArray:
    rows = _numbers(name, value)
    if rows.ndim == 1:
        rows = rows.reshape(-1, 1)
    if rows.ndim != 2 or not 1 <= rows.shape[1] <= most:
        raise InputError(name, rows.shape, f"must have shape (n,) or (n, 1..{most})")
    size = np.abs(rows)
    if not size.max(initial=0.0) <= LARGEST:  # not a number is not smaller either
        row = int(np.argmin((size <= LARGEST).all(axis=1)))
        raise InputError(
            f"{name}[{row}]", rows[row].tolist(), f"must be finite, within {LARGEST:g} in magnitude"
        )
    tiny = (size < 1.0 / LARGEST) & (size > 0.0)
    return np.where(tiny, 0.0, rows) if tiny.any() else rows


def _numbers(name: str, value: Any) -> FloatArray:
    """An array of real numbers, C-contiguous."""
    try:
        rows = np.asarray(value)
    except ValueError:
        rows = np.asarray(None)
    if rows.dtype.kind not in "fiu":
        raise InputError(name, value, "must be an array of real numbers")
    return np.ascontiguousarray(rows, dtype=np.float64)


def _states(name: str, values: Any) -> list[State]:
    if not _is_sequence(values):
        raise InputError(name, values, "must be a State, a number, or a sequence of them")
    return [
        value if value.__class__ is State else _state(f"{name}[{i}]", value)
        for i, value in enumerate(values)
    ]


def _unpacked(rows: bytes) -> list[State]:
    return [State(*row) for row in struct.iter_unpack("3d", rows)]


def _is_sequence(value: Any) -> bool:
    if value.__class__ is list or value.__class__ is tuple:
        return True
    if isinstance(value, np.ndarray):
        return value.ndim == 1
    return isinstance(value, Sequence) and not isinstance(value, str | bytes | bytearray)


def _state(name: str, value: Any) -> State:
    return value if isinstance(value, State) else State(real(name, value))


def _check_targets(targets: Sequence[State], limits: Sequence[Any]) -> None:
    for i, (target, limit) in enumerate(zip(targets, limits, strict=True)):
        if not isinstance(limit, Limits):
            raise InputError(f"limits[{i}]", limit, "must be a Limits")
        check_target(f"target[{i}]", target, limit)


def code_of(synchronization: str) -> int:
    """The ``enum sj_synchronization`` of a name."""
    if not isinstance(synchronization, str) or synchronization not in _CODES:
        raise InputError("synchronization", synchronization, f"must be one of {', '.join(_CODES)}")
    return int(_CODES[synchronization])


def cycles_of(min_duration: float, cycle_time: float) -> int:
    """Whole cycles that last at least so many seconds."""
    cycles = real("min_duration", min_duration) / positive("cycle_time", cycle_time)
    if not 0.0 <= cycles <= CYCLES_MAX:
        raise InputError("min_duration", min_duration, f"must be 0 .. {CYCLES_MAX} cycles")
    return math.ceil(cycles * (1.0 - 1e-11))


def check_target(name: str, target: State, limits: Limits) -> None:
    """Refuse what no plan may end in."""
    if target.acceleration != 0.0:
        raise InputError(
            f"{name}.acceleration", target.acceleration, "must be 0: not supported yet"
        )
    if abs(target.velocity) > limits.velocity:
        raise InputError(
            f"{name}.velocity", target.velocity, f"must lie within +-{limits.velocity!r}"
        )
    if limits.position is not None and not (
        limits.position[0] <= target.position <= limits.position[1]
    ):
        raise InputError(f"{name}.position", target.position, f"must lie in {limits.position}")


def _fail(status: int, field: str, value: Any, limits: Any) -> NoReturn:
    if status == lib.SJ_PLAN_TOO_LONG:
        raise InputError(field, value, f"takes more than {CYCLES_MAX} cycles under {limits}")
    if status == lib.SJ_PLAN_INVALID:
        if isinstance(value, State):
            check_target(field, value, limits)
        raise InputError(field, value, f"cannot be planned under {limits}")
    raise PlanError(f"no common length was found for {value!r} under {limits}")
