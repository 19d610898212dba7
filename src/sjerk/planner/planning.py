"""Planning from any state to any target in whole cycles: the C planner for Python.

``plan`` and ``plan_velocity`` return the same ``Profile`` as the paper's ``scurve``; ``plan_many``
is the fast path without an object per plan. ``docs/explanation/planner.md`` explains the method.
Never here: clocks, shared memory, drives.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Sequence
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike

from sjerk._binding import ffi, lib
from sjerk.errors import InputError, positive, real
from sjerk.limits import limits_of_each
from sjerk.planner.arguments import (
    CODES,
    NAMES,
    Cruise,
    Synchronization,
    check_target,
    check_targets,
    code_of,
    cycles_of,
    exact_of,
    fail,
    is_sequence,
    moving_of,
    states_of,
)
from sjerk.profile import Limits, Profile, Samples, State

#: Allocation without clearing, and types looked up once: this is the fast path.
_new = ffi.new_allocator(should_clear_after_alloc=False)
_between, _joined = lib.sj_plan_between, b"".join
#: The function behind the method: a call of it is the interpreter's own.
_profile: Callable[..., Profile] = Profile.of_c.__func__  # type: ignore[attr-defined]
#: Bytes of limits and a cycle time behind two states.
_KEPT = ffi.sizeof("sj_between") - 2 * ffi.sizeof("sj_state")
#: The ``min_duration`` of whoever gives none, known by identity.
_NO_LEAST = 0.0
_MOST: int = lib.SJ_AXES
_PHASE: int = lib.SJ_SYNC_PHASE
_INT = ffi.typeof("int32_t *")
_PLANS = [ffi.typeof(f"sj_plan[{n}]") for n in range(_MOST + 1)]
#: Only "phase" is ever changed by the planner: the others can be shared.
_MODES = {code: ffi.new("int32_t *", code) for code in CODES.values()}
#: By cycle time: what one of each limit per second is per cycle, as the memory of an ``sj_limits``.
_UNITS: dict[float, bytes] = {}
_PER_CYCLE = struct.pack("5d", 1.0, 1.0, 1.0, 1.0, 1.0)


class Motion:
    """Planned motions of N axes that start together; a sequence of their profiles. Immutable.

    ``synchronization`` is what was done: ``"phase"`` falls back to ``"time"`` where there is no
    straight line. Made by ``plan``.

    >>> both = plan([0.0, 0.0], [160.0, 20.0], [Limits(90.0, 500.0, 5000.0)] * 2, 1e-3)
    >>> len(both), both.synchronization, [profile.cycles for profile in both]
    (2, 'time', [2058, 2058])
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
        return NAMES[self._code]

    @property
    def profiles(self) -> tuple[Profile, ...]:
        """One profile per axis, of one length unless ``synchronization`` is ``"none"``."""
        if self._profiles is None:
            states = _unpacked(self._states)
            starts, ends = states[: self._axes], states[self._axes :]
            ranges = self._ranges or [None] * self._axes
            self._profiles = tuple(
                Profile.of_c(self._plans + i, self._time, start, end, limit, self._plans)
                for i, (start, end, limit) in enumerate(zip(starts, ends, ranges, strict=True))
            )
        return self._profiles

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Motion) and _identity(self) == _identity(other)

    def __hash__(self) -> int:
        return hash(_identity(self))

    def __reduce__(self) -> tuple[Any, ...]:
        memory = bytes(ffi.buffer(self._plans, self._axes * ffi.sizeof("sj_plan")))
        rest = self._time, self._axes, self._states, self._ranges, self._code
        return _motion_from, (memory, *rest)

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
        """Whether any axis leaves its position range between its start and its end."""
        return any(profile.leaves_range for profile in self.profiles)

    @property
    def retracts(self) -> bool:
        """Whether the velocity of any axis turns on its way; see ``Profile.retracts``."""
        return any(profile.retracts for profile in self.profiles)

    def at(self, t: ArrayLike) -> Samples:
        """Return the planned motions at time ``t`` (s): fields have the shape of ``t`` and (N,).

        In u, u/s, u/s^2 and u/s^3 of each axis; ``time`` has the shape of ``t``. Eqs. (1)-(6).
        """
        axes = [profile.at(t) for profile in self.profiles]
        stacked = (
            np.stack([getattr(axis, name) for axis in axes], axis=-1)
            for name in ("position", "velocity", "acceleration", "jerk")
        )
        return Samples(axes[0].time, *stacked)

    def sample(self) -> Samples:
        """Return what the drives get: ``time`` (rows,), the rest (rows, N); rows = cycles + 2.

        An axis that arrives earlier (``"none"``) goes on with its end velocity. Eqs. (15)-(17).
        """
        rows, axes = self.cycles + 2, len(self)
        columns = [np.empty((axes, rows)) for _ in range(4)]
        time = np.empty(rows)
        for i, profile in enumerate(self.profiles):
            profile.fill(Samples(time, *(column[i] for column in columns)), rows)
        return Samples(time, *(column.T for column in columns))


def _identity(motion: Motion) -> tuple[Any, ...]:
    """What motions are compared by."""
    return motion.cycle_time, motion.synchronization, motion.profiles


def _motion_from(memory: bytes, cycle_time: float, axes: int, *rest: Any) -> Motion:
    plans = ffi.new("sj_plan[]", axes)
    ffi.memmove(plans, memory, len(memory))
    return Motion(plans, cycle_time, axes, *rest)


@overload
def plan(
    start: State | float,
    target: State | float,
    limits: Limits,
    cycle_time: float,
    *,
    synchronization: Synchronization = ...,
    min_duration: float = ...,
    cruise: Cruise = ...,
    moving: bool = ...,
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
    cruise: Cruise = ...,
    moving: bool = ...,
) -> Motion: ...
def plan(
    start: Any,
    target: Any,
    limits: Any,
    cycle_time: float,
    *,
    synchronization: Synchronization = "time",
    min_duration: float = _NO_LEAST,
    cruise: Cruise = "fast",
    moving: bool = False,
) -> Profile | Motion:
    """Plan the fastest motion in whole cycles from any state to any target.

    ``start`` and ``target``: a ``State`` or a position (one axis), or sequences of them (N axes,
    1 to 64); states of the samples, with no jerk before the start and behind the end. ``limits``:
    one for all axes or one each. ``cycle_time`` in seconds. The target's velocity and acceleration
    are free within the limits; within them must be the velocity that an acceleration comes from,
    too. A start outside the limits is brought back inside as fast as the jerk allows.
    ``synchronization``: with ``"time"`` all axes arrive in the same cycle, with ``"phase"`` on a
    straight line (from rest to rest; else as ``"time"``), with ``"none"`` each for itself.
    The motion takes ``min_duration`` seconds or more.

    ``cruise``: a ``"fast"`` motion cruises a little below ``limits.velocity``, by less than what a
    cycle at it takes, so that whole cycles cover the distance. With ``"exact"`` it cruises at
    ``limits.velocity`` to rounding (in phase: the axis that limits the line), and what is left is
    taken up by the braking behind it. ``InputError`` where it is not reached for a cycle, and for
    axes that share the motion in time only.

    ``moving``: the target moves on with its velocity, and each axis may meet it up to a cycle later
    on its line. Whole cycles otherwise miss a moving target by a fraction of a cycle where there is
    no time to spare, and then swing back for it. Then ``Profile.end`` is where it is met; the
    axes are by themselves (one axis, or ``"none"``).

    The direction of the move, for ``deceleration`` limits, is that of the distance that the plan
    covers: from start to target, less the half cycle of both velocities (T/2 times their sum).
    Every request of usable numbers succeeds. Raises ``InputError`` for unusable ones: not finite, a
    target outside ``limits.position`` or faster than ``limits.velocity``, more than 2^50 cycles.
    The method: ``docs/explanation/planner.md``.

    >>> limits = Limits(velocity=90.0, acceleration=500.0, jerk=5000.0)
    >>> profile = plan(State(10.0, velocity=40.0), 160.0, limits, 1e-3)
    >>> profile.cycles, float(profile.sample().position[-1])
    (1862, 160.0)
    """
    plain = min_duration is _NO_LEAST and cruise == "fast" and moving is False
    if plain and type(start) is State and type(target) is State and synchronization == "time":
        # the fast path: one axis without a range, states built beforehand, no options
        try:
            per_cycle = limits.cycled[cycle_time] if type(cycle_time) is float else None
        except (AttributeError, KeyError):
            per_cycle = None
        # of limits that another version pickled it may be shorter
        if per_cycle is not None and len(per_cycle) == _KEPT:
            made = _between(_joined((start.memory, target.memory, per_cycle)))
            if made.count >= 0:
                return _profile(Profile, made, cycle_time, start, target)
        if type(limits) is Limits:
            return _one(start, target, limits, cycle_time)  # which tells why where there is none
    if plain and type(start) is list and type(target) is list:
        motion = _many_axes(start, target, limits, cycle_time, synchronization)
        if motion is not None:
            return motion
    code, least = code_of(synchronization), cycles_of(min_duration, cycle_time)
    code += exact_of(cruise, least)
    one = not is_sequence(start) and not is_sequence(target)
    starts = states_of("start", [start] if one else start)
    targets = states_of("target", [target] if one else target)
    code = moving_of(moving, code, targets, least)
    if not isinstance(limits, Limits) and not is_sequence(limits):
        raise InputError("limits", limits, "must be a Limits or a list of one per axis")
    several = [limits] * len(starts) if isinstance(limits, Limits) else list(limits)
    return _axes(starts, targets, several, cycle_time, least, code, single=one)


def _one(start: State, target: State, limits: Limits, T: float) -> Profile:
    """One axis, states built beforehand, no options."""
    if limits.position is not None:
        check_target("target", target, limits, accelerated=True)
    made = ffi.new("sj_plan *")
    status = lib.sj_plan_sample(T, start.memory, target.memory, limits.per_cycle(T), made)
    if status:
        fail(status, "target", target, limits)
    return Profile.of_c(made, T, start, target, limits.position)


def _many_axes(
    starts: list[Any], targets: list[Any], limits: Any, T: float, synchronization: str
) -> Motion | None:
    """The fast path of several axes: lists of states and limits of every target. None: not that."""
    n = len(starts)
    try:
        states = b"".join([state.memory for state in starts + targets])
        rows = b"".join([limit.memory for limit in limits])
        code = CODES[synchronization]
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
    check_targets(targets, limits)
    plans, mode = _new(_PLANS[n]), _new(_INT, code)
    states = b"".join([state.memory for state in (*starts, *targets)])
    rows = b"".join([limit.per_cycle(T) for limit in limits])
    status = lib.sj_plan_samples(n, T, states, rows, _PER_CYCLE, least, mode, plans)
    if status:
        for i, (start, target, limit) in enumerate(zip(starts, targets, limits, strict=True)):
            one = lib.sj_plan_sample(T, start.memory, target.memory, limit.per_cycle(T), plans)
            if one:  # an axis that cannot be planned alone
                fail(one, f"target[{i}]", target, limit)
        fail(status, "target", targets, limits)
    if code == lib.SJ_SYNC_MOVING:
        targets = [_met(target, plans[i].slipped) for i, target in enumerate(targets)]
        states = b"".join([state.memory for state in (*starts, *targets)])
    ranges = [limit.position for limit in limits]
    if single:
        return Profile.of_c(plans + 0, T, starts[0], targets[0], ranges[0], plans)
    return Motion(plans, T, n, states, ranges, mode[0])


def _met(target: State, slipped: float) -> State:
    """Where a target that moves on is met."""
    return State(target.position + slipped, target.velocity) if slipped else target


@overload
def plan_velocity(
    start: State | float,
    velocity: float,
    limits: Limits,
    cycle_time: float,
    *,
    synchronization: Synchronization = ...,
) -> Profile: ...
@overload
def plan_velocity(
    start: Sequence[State | float],
    velocity: Sequence[float],
    limits: Limits | Sequence[Limits],
    cycle_time: float,
    *,
    synchronization: Synchronization = ...,
) -> Motion: ...
def plan_velocity(
    start: State | float | Sequence[State | float],
    velocity: float | Sequence[float],
    limits: Limits | Sequence[Limits],
    cycle_time: float,
    *,
    synchronization: Synchronization = "time",
) -> Profile | Motion:
    """Plan the fastest change to ``velocity`` in whole cycles (jog; stop with 0).

    ``start``: a ``State``, or a position at rest (one axis), or a sequence of them (N axes, 1 to
    64); ``velocity`` in u/s, signed, one each; ``limits``: one for all axes or one each;
    ``cycle_time`` in seconds. ``Profile.end`` is where it ends. The direction of the move is that
    of ``velocity``, or of the start's velocity for a stop.

    ``synchronization``: with ``"time"`` all axes have their velocities in the same cycle, the
    faster ones by a gentler change, with ``"phase"`` all change in proportion, so that a stop stays
    on its straight line (from states without acceleration and within limits; else as ``"time"``),
    with ``"none"`` each is as fast as it can be. Raises ``InputError`` for unusable numbers and for
    a velocity beyond ``limits.velocity``.

    >>> profile = plan_velocity(State(0.0, velocity=90.0), 0.0, Limits(90.0, 500.0, 5000.0), 1e-3)
    >>> profile.cycles, profile.end.velocity
    (280, 0.0)
    >>> both = plan_velocity([0.0, 0.0], [90.0, -20.0], Limits(90.0, 500.0, 5000.0), 1e-3)
    >>> [profile.cycles for profile in both]
    [280, 280]
    """
    one = not is_sequence(start) and not is_sequence(velocity)
    states = states_of("start", [start] if one else start)
    n, code = len(states), code_of(synchronization)
    T = positive("cycle_time", cycle_time)
    if one and not isinstance(limits, Limits):
        raise InputError("limits", limits, "must be a Limits")
    each = limits_of_each(limits, n)
    given: Any = [velocity] if one else velocity
    if not is_sequence(given) or len(given) != n or not 1 <= n <= _MOST:
        raise InputError("velocity", velocity, f"must be one per axis: {n}, at most {_MOST}")
    wanted = []
    for i, (value, limit) in enumerate(zip(given, each, strict=True)):
        name = "velocity" if one else f"velocity[{i}]"
        wanted.append(real(name, value))
        if abs(wanted[-1]) > limit.velocity:
            raise InputError(name, value, f"must lie within +-{limit.velocity!r}")
    plans, mode, ends = _new(_PLANS[n]), _new(_INT, code), ffi.new("double[]", n)
    memory = b"".join([state.memory for state in states])
    rows = b"".join([limit.per_cycle(T) for limit in each])
    status = lib.sj_plan_sample_velocities(n, T, memory, wanted, rows, mode, plans, ends)
    if status != 0:
        fail(status, "velocity", velocity, limits)
    targets = [State(end, value) for end, value in zip(ends, wanted, strict=True)]
    if one:
        return Profile.of_c(plans + 0, T, states[0], targets[0], each[0].position, plans)
    memory += b"".join([state.memory for state in targets])
    return Motion(plans, T, n, memory, [limit.position for limit in each], mode[0])


def _unpacked(rows: bytes) -> list[State]:
    return [State(*row) for row in struct.iter_unpack("3d", rows)]
