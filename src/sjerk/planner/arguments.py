"""The arguments of the planner, checked: states, limits, synchronization, least durations.

Errors name the field, the value and the limit. Never here: planning.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Literal, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sjerk._binding import lib
from sjerk.errors import LARGEST, InputError, PlanError, positive, real
from sjerk.profile import CYCLES_MAX, FloatArray, Limits, State

#: How the axes of a motion share it; see ``plan``.
Synchronization = Literal["time", "phase", "none"]
#: How a motion cruises; see ``plan``.
Cruise = Literal["fast", "exact"]
#: The ``enum sj_synchronization`` of each name.
CODES: dict[str, int] = {
    "none": lib.SJ_SYNC_NONE,
    "time": lib.SJ_SYNC_TIME,
    "phase": lib.SJ_SYNC_PHASE,
}
#: The name of each code.
NAMES: dict[int, Synchronization] = {
    lib.SJ_SYNC_NONE: "none",
    lib.SJ_SYNC_TIME: "time",
    lib.SJ_SYNC_PHASE: "phase",
}


def states_of(name: str, values: Any) -> list[State]:
    """A ``State`` per axis of a sequence of states and positions; raises ``InputError``.

    >>> states_of("start", [1.0, State(2.0, 3.0)])[0]
    State(position=1.0, velocity=0.0, acceleration=0.0)
    """
    if not is_sequence(values):
        raise InputError(name, values, "must be a State, a number, or a sequence of them")
    return [
        value if value.__class__ is State else _state(f"{name}[{i}]", value)
        for i, value in enumerate(values)
    ]


def is_sequence(value: Any) -> bool:
    """Whether a value has one entry per axis: a list, a tuple, an array of one dimension.

    >>> is_sequence([0.0]), is_sequence(0.0), is_sequence("0.0")
    (True, False, False)
    """
    if value.__class__ is list or value.__class__ is tuple:
        return True
    if isinstance(value, np.ndarray):
        return value.ndim == 1
    return isinstance(value, Sequence) and not isinstance(value, str | bytes | bytearray)


def _state(name: str, value: Any) -> State:
    return value if isinstance(value, State) else State(real(name, value))


def check_targets(targets: Sequence[State], limits: Sequence[Any]) -> None:
    """Refuse a target that no plan may end in, by axis; raises ``InputError``."""
    for i, (target, limit) in enumerate(zip(targets, limits, strict=True)):
        if not isinstance(limit, Limits):
            raise InputError(f"limits[{i}]", limit, "must be a Limits")
        check_target(f"target[{i}]", target, limit, accelerated=True)


def code_of(synchronization: str) -> int:
    """The ``enum sj_synchronization`` of a name; raises ``InputError``.

    >>> code_of("time") == CODES["time"]
    True
    """
    if not isinstance(synchronization, str) or synchronization not in CODES:
        raise InputError("synchronization", synchronization, f"must be one of {', '.join(CODES)}")
    return int(CODES[synchronization])


def exact_of(cruise: str, least: int) -> int:
    """What an exact cruise adds to the ``enum sj_synchronization``; raises ``InputError``.

    >>> exact_of("fast", 100)
    0
    """
    if not isinstance(cruise, str) or cruise not in ("fast", "exact"):
        raise InputError("cruise", cruise, "must be 'fast' or 'exact'")
    if cruise == "exact" and least:
        raise InputError("min_duration", least, "must be 0 cycles for an exact cruise")
    return int(lib.SJ_SYNC_EXACT) if cruise == "exact" else 0


def moving_of(moving: bool, code: int, targets: Sequence[State], least: int) -> int:
    """The ``enum sj_synchronization`` for targets that move on, or ``code``; raises ``InputError``.

    >>> moving_of(False, code_of("time"), [State(1.0)], 0) == code_of("time")
    True
    """
    if not isinstance(moving, bool):
        raise InputError("moving", moving, "must be True or False")
    if not moving:
        return code
    if len(targets) > 1 and code != lib.SJ_SYNC_NONE:
        what = NAMES.get(code, "exact")
        raise InputError("synchronization", what, "must be 'none' for targets that move on")
    if code > lib.SJ_SYNC_PHASE:
        raise InputError("cruise", "exact", "must be 'fast' for targets that move on")
    if least:
        raise InputError("min_duration", least, "must be 0 cycles for targets that move on")
    for i, target in enumerate(targets):
        if target.acceleration != 0.0:
            name = f"target[{i}].acceleration"
            raise InputError(name, target.acceleration, "must be 0 for a target that moves on")
    return int(lib.SJ_SYNC_MOVING)


def cycles_of(min_duration: float, cycle_time: float) -> int:
    """The least number of whole cycles that last ``min_duration`` seconds; raises ``InputError``.

    >>> cycles_of(0.1, 1e-3)
    100
    """
    cycles = real("min_duration", min_duration) / positive("cycle_time", cycle_time)
    if not 0.0 <= cycles <= CYCLES_MAX:
        raise InputError("min_duration", min_duration, f"must be 0 .. {CYCLES_MAX} cycles")
    return math.ceil(cycles * (1.0 - 1e-11))


def check_target(name: str, target: State, limits: Limits, *, accelerated: bool = False) -> None:
    """Refuse a target that no plan may end in, as ``InputError`` with the field and its limit.

    Its acceleration must be 0, or within the limits where it may be ``accelerated``, its velocity
    lie within the limits, its position within their range.
    """
    most = max(limits.acceleration, limits.braking[0]) if accelerated else 0.0
    if abs(target.acceleration) > most:
        must = f"must lie within +-{most!r}" if accelerated else "must be 0"
        raise InputError(f"{name}.acceleration", target.acceleration, must)
    if abs(target.velocity) > limits.velocity:
        raise InputError(
            f"{name}.velocity", target.velocity, f"must lie within +-{limits.velocity!r}"
        )
    if limits.position is not None and not (
        limits.position[0] <= target.position <= limits.position[1]
    ):
        low, high = limits.position
        raise InputError(f"{name}.position", target.position, f"must lie in {low!r} .. {high!r}")


def check_range(end: FloatArray, limits: Limits, rows: slice) -> None:
    """Refuse the first row of ``end`` (n, 1..2) whose position lies outside the range."""
    if limits.position is None:
        return
    low, high = limits.position
    outside = (end[rows, 0] < low) | (end[rows, 0] > high)
    if outside.any():
        row = (rows.start or 0) + int(np.argmax(outside))
        where = f"target[{row}].position"
        raise InputError(where, float(end[row, 0]), f"must lie in {low!r} .. {high!r}")


def limit_rows(limits: NDArray[Any], T: float) -> FloatArray:
    """Limits (n, 3) or (n, 5) per second as rows (n, 5) per cycle, with those of braking.

    A jerk may be infinite, as in ``Limits``. Raises ``InputError`` with the row.
    """
    rows = _numbers("limits", limits)
    if rows.ndim != 2 or rows.shape[1] not in (3, 5):
        raise InputError("limits", rows.shape, "must have shape (n, 3) or (n, 5)")
    rows = rows if rows.shape[1] == 5 else np.hstack([rows, rows[:, 1:3]])
    per_cycle: FloatArray = rows * np.array([T, T**2, T**3, T**2, T**3])
    # the row is looked for only where one is bad
    if not (rows.min(initial=1.0) >= 1.0 / LARGEST and rows.max(initial=1.0) <= LARGEST):
        free = np.isposinf(rows) & [False, False, True, False, True]
        good = ((rows >= 1.0 / LARGEST) & (rows <= LARGEST)) | free
        if not good.all():
            row = int(np.argmin(good.all(axis=1)))
            raise InputError(
                f"limits[{row}]",
                rows[row].tolist(),
                f"must be greater than 0, within {1.0 / LARGEST:g} .. {LARGEST:g}",
            )
        whole = per_cycle[:, [1]] + per_cycle[:, [3]]  # as Limits.per_cycle has it
        per_cycle = np.ascontiguousarray(np.where(free, whole, per_cycle))
    return per_cycle


def rows_of(name: str, value: ArrayLike, most: int) -> FloatArray:
    """States as rows (n, 1..most); raises ``InputError`` with the row.

    >>> rows_of("start", [1.0, 2.0], 3).shape
    (2, 1)
    """
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
        raise InputError(name, value, "must be an array of real numbers, a row for each move")
    return np.ascontiguousarray(rows, dtype=np.float64)


def fail(status: int, field: str, value: Any, limits: Any) -> NoReturn:
    """Raise the error of an ``enum sj_plan_status``: ``InputError``, or ``PlanError``."""
    if status == lib.SJ_PLAN_TOO_LONG:
        raise InputError(field, value, f"takes more than {CYCLES_MAX} cycles under {limits}")
    if status == lib.SJ_PLAN_INVALID:
        if isinstance(value, State):
            check_target(field, value, limits, accelerated=True)
            if value.acceleration != 0.0:
                why = (
                    "must be within the limits of its direction, and so must the velocity that its "
                    f"acceleration comes from: v - a |a| / 2J within +-{limits.velocity!r}"
                )
                raise InputError(field, value, why)
        raise InputError(field, value, f"cannot be planned under {limits}")
    if status == lib.SJ_PLAN_NO_CRUISE:
        why = f"{limits} leaves no cycle of it to {field} {value}, alone or in phase"
        raise InputError("cruise", "exact", why)
    raise PlanError(f"no common length was found for {value!r} under {limits}")
