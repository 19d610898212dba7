"""Limits and states of one axis: what every motion is planned under, from and to.

Plain values, checked once when they are made. Each keeps its own memory as C reads it, so that the
planner does not convert it again for every plan. Never here: motion.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from sjerk.errors import InputError, positive, real

#: Cycle times for which a ``Limits`` keeps its values per cycle.
_CYCLE_TIMES_KEPT = 16
#: Bytes of an ``sj_limits``.
_LIMITS = struct.calcsize("5d")
#: Limits that may be infinite.
_JERKS = ("jerk", "deceleration_jerk")


@dataclass(frozen=True, slots=True)
class Limits:
    """Kinematic limits of one axis: magnitudes in its own unit u and seconds.

    ``velocity`` in u/s, ``acceleration`` in u/s^2, ``jerk`` in u/s^3. They limit the acceleration
    in the direction of the move; ``deceleration`` and ``deceleration_jerk`` (default: the same)
    limit the acceleration against it. ``position`` is the range (low, high) in u that targets must
    lie in; None is no range. The paper's V_max, Acc_max, J_max, Dec_max.

    ``jerk`` and ``deceleration_jerk`` may be ``math.inf``: the acceleration is limited only, and
    may go from any value to any other within one control cycle (``docs/explanation/planner.md``).

    Raises ``InputError`` for anything but numbers greater than zero, finite but for the jerks, and
    for a range whose low end is not below its high end.

    >>> Limits(velocity=90.0, acceleration=500.0, jerk=5000.0).deceleration
    500.0
    """

    velocity: float
    acceleration: float
    jerk: float
    deceleration: float | None = None
    deceleration_jerk: float | None = None
    position: tuple[float, float] | None = None
    #: For C calls: an ``sj_limits`` per second. Empty with a range, which each target is held to,
    #: and where a jerk is free, which is a number per cycle only.
    memory: bytes = field(init=False, repr=False, compare=False, default=b"")
    #: For C calls: what ``per_cycle`` has made, with the cycle time behind it, by cycle time.
    cycled: dict[float, bytes] = field(init=False, repr=False, compare=False, default_factory=dict)

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
            free = value.__class__ is float and value == math.inf and name in _JERKS
            object.__setattr__(self, name, value if free else positive(name, value))
        if self.position is None and not self.jerk_is_free:
            numbers = self.velocity, self.acceleration, self.jerk, *self.braking
            object.__setattr__(self, "memory", struct.pack("5d", *numbers))

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

        s = T1 / Ta for a ramp from rest to ``velocity``, T1 and Ta as in Eqs. (7) and (8); so
        J = Acc^2 / (s V). 1 is a pure S, near 0 a trapezoid. Raises ``InputError``.

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

    @property
    def braking(self) -> tuple[float, float]:
        """Deceleration (u/s^2) and its jerk (u/s^3), as plain floats."""
        assert self.deceleration is not None
        assert self.deceleration_jerk is not None
        return self.deceleration, self.deceleration_jerk

    @property
    def jerk_is_free(self) -> bool:
        """Whether a jerk is without a limit, ``math.inf``.

        >>> Limits(90.0, 500.0, math.inf).jerk_is_free
        True
        """
        return self.jerk == math.inf or self.deceleration_jerk == math.inf

    def per_cycle(self, cycle_time: float) -> bytes:
        """For C calls: the limits per cycle of ``cycle_time`` seconds, as an ``sj_limits``.

        A free jerk is what takes the acceleration from one limit to the other in one cycle: in
        whole cycles no plan within the limits of acceleration has more.
        Made once per cycle time. Raises ``InputError`` for a cycle time that is not positive.

        >>> len(Limits(90.0, 500.0, 5000.0).per_cycle(1e-3))
        40
        """
        made = self.cycled.get(cycle_time) if cycle_time.__class__ is float else None
        if made is None:
            T = positive("cycle_time", cycle_time)
            deceleration, deceleration_jerk = self.braking
            up, down = self.acceleration * T**2, deceleration * T**2
            jerks = [
                up + down if jerk == math.inf else jerk * T**3
                for jerk in (self.jerk, deceleration_jerk)
            ]
            made = struct.pack("6d", self.velocity * T, up, jerks[0], down, jerks[1], T)
            # with a range every target is looked at anyway
            if self.position is None and len(self.cycled) < _CYCLE_TIMES_KEPT:
                self.cycled[T] = made
        return made[:_LIMITS]


def jerk_limited(limits: Sequence[Limits]) -> Sequence[Limits]:
    """Refuse limits without a jerk, one per joint, for motions that need one; ``InputError``.

    >>> len(jerk_limited([Limits(2.0, 4.0, 500.0)]))
    1
    """
    for i, limit in enumerate(limits):
        if limit.jerk_is_free:
            name, jerk = ("jerk", limit.jerk)
            if jerk != math.inf:
                name, jerk = "deceleration_jerk", limit.braking[1]
            raise InputError(
                f"limits[{i}].{name}", jerk, "must be finite for a motion of this kind"
            )
    return limits


def limits_of_each(limits: Any, joints: int) -> list[Limits]:
    """One ``Limits`` per joint: of one for all, or of a sequence of one each.

    Raises ``InputError`` for anything else, with the entry that is wrong.

    >>> len(limits_of_each(Limits(2.0, 4.0, 500.0), 7))
    7
    """
    if isinstance(limits, Limits):
        return [limits] * joints
    if not isinstance(limits, Sequence) or isinstance(limits, str | bytes | bytearray):
        raise InputError("limits", limits, "must be a Limits, or a list of one per joint")
    for i, limit in enumerate(limits):
        if not isinstance(limit, Limits):
            raise InputError(f"limits[{i}]", limit, "must be a Limits")
    if len(limits) != joints:
        raise InputError("limits", len(limits), f"must be one per joint: {joints}")
    return list(limits)


@dataclass(frozen=True, slots=True)
class State:
    """Position (u), velocity (u/s) and acceleration (u/s^2) of one axis at one moment.

    Raises ``InputError`` for what is no finite number.

    >>> State(160.0)
    State(position=160.0, velocity=0.0, acceleration=0.0)
    """

    position: float
    velocity: float = 0.0
    acceleration: float = 0.0
    #: For C calls: an ``sj_state``, made once for every later call.
    memory: bytes = field(init=False, repr=False, compare=False)

    @classmethod
    def continuous(
        cls,
        position: float,
        velocity: float = 0.0,
        acceleration: float = 0.0,
        *,
        cycle_time: float,
    ) -> State:
        """Return the sample behind which the continuous motion (P, V, A) lies, without jerk so far.

        A state is one of samples, and its motion is half a cycle of acceleration ahead of it. A
        plan from ``continuous`` begins with exactly the V and A given: where V + A^2 / 2J is the
        velocity limit it is not exceeded. The half-cycle lemma (``docs/architecture.md``):
        a = A, v = V - T A / 2, q = P - T V / 2 + T^2 A / 3. Raises ``InputError``.

        >>> State.continuous(0.0, 2.0, 8.0, cycle_time=0.5).velocity
        0.0
        """
        T = positive("cycle_time", cycle_time)
        P, V, A = (
            real(name, value)
            for name, value in (
                ("position", position),
                ("velocity", velocity),
                ("acceleration", acceleration),
            )
        )
        return cls(P - T * V / 2.0 + T**2 * A / 3.0, V - T * A / 2.0, A)

    def __post_init__(self) -> None:
        numbers = [
            real(name, getattr(self, name)) for name in ("position", "velocity", "acceleration")
        ]
        for name, number in zip(("position", "velocity", "acceleration"), numbers, strict=True):
            object.__setattr__(self, name, number)
        object.__setattr__(self, "memory", struct.pack("3d", *numbers))


def behind(sample: State, T: float) -> tuple[float, float, float]:
    """P, V, A of the continuous motion at a sample without jerk; with -T at the end before it.

    The half-cycle lemma (``docs/architecture.md``) with j = 0, from either side of the sample.

    >>> behind(State(0.0, 2.0), 0.5), behind(State(0.0, 2.0), -0.5)
    ((0.5, 2.0, 0.0), (-0.5, 2.0, 0.0))
    """
    q, v, a = sample.position, sample.velocity, sample.acceleration
    return q + 0.5 * T * v - T**2 / 12.0 * a, v + 0.5 * T * a, a
