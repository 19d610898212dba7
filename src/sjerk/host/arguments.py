"""What a caller may say of axes, targets and limits, as data of every axis; checked.

Every function raises InputError, which names the field, the value and what would be legal. Never
here: how it is sent.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from sjerk._binding import lib
from sjerk.errors import InputError, real
from sjerk.host.turns import Turns
from sjerk.planner import check_target
from sjerk.profile import FloatArray, Limits, State

Target = float | State
Axes = int | Iterable[int] | None
Direction = Literal["direct", "shortest", "positive", "negative"]
Buffer = Literal["aborting", "buffered", "blend low", "blend previous", "blend next", "blend high"]

#: PLCopen's buffer modes by their names here.
BUFFERS: dict[str, int] = {
    "aborting": lib.SJ_BUFFER_ABORTING,
    "buffered": lib.SJ_BUFFER_BUFFERED,
    "blend low": lib.SJ_BUFFER_LOW,
    "blend previous": lib.SJ_BUFFER_PREVIOUS,
    "blend next": lib.SJ_BUFFER_NEXT,
    "blend high": lib.SJ_BUFFER_HIGH,
}
LIMIT_NAMES = ("velocity", "acceleration", "jerk", "deceleration", "deceleration_jerk")


def patience(timeout: float | None) -> None:
    """What cannot be waited for is refused before anything is sent; but a stop is always sent."""
    if timeout is not None:
        real("timeout", timeout)


def check_factor(value: float) -> None:
    """A factor of a speed, 0 .. 2."""
    if not 0.0 <= real("factor", value) <= 2.0:
        raise InputError("factor", value, "must lie in 0 .. 2")


def axis_numbers(axes: Axes, count: int) -> list[int]:
    """One axis, some, or (None) all of ``count``."""
    if axes is None:
        return list(range(count))
    if not isinstance(axes, int | Iterable):
        raise InputError("axes", axes, f"axis numbers are 0 .. {count - 1}")
    chosen = [axes] if isinstance(axes, int) else list(axes)
    for i in chosen:
        if not isinstance(i, int) or isinstance(i, bool) or not 0 <= i < count:
            raise InputError("axes", i, f"axis numbers are 0 .. {count - 1}")
    return chosen


def joint_axes(axes: Axes, count: int) -> list[int]:
    """One axis per joint."""
    chosen = axis_numbers(axes, count)
    if not chosen or len(set(chosen)) != len(chosen):
        raise InputError("axes", chosen, "must be at least one, and differ")
    return chosen


def by_axis(field: str, given: Any, count: int) -> dict[int, Any]:
    """What is given by axis number, one per axis, or for the one axis."""
    if isinstance(given, np.ndarray) and given.ndim == 1:
        given = given.tolist()
    if isinstance(given, Mapping):
        wanted: dict[int, Any] = dict(given)
    elif isinstance(given, Sequence) and not isinstance(given, str):
        if len(given) != count:
            raise InputError(field, given, f"must have one {field} per axis ({count})")
        wanted = dict(enumerate(given))
    elif count == 1:
        wanted = {0: given}
    else:
        raise InputError(field, given, f"must be by axis number: {count} axes")
    for i in wanted:
        if not isinstance(i, int) or not 0 <= i < count:
            raise InputError(field, i, f"axis numbers are 0 .. {count - 1}")
    if not wanted:
        raise InputError(field, given, "must name at least one axis")
    return wanted


def targets_of(
    given: Target | Sequence[Target] | Mapping[int, Target] | FloatArray, count: int
) -> dict[int, State]:
    """Targets by axis number; a bare position is one to rest at."""
    return {
        i: value if isinstance(value, State) else State(real(f"target[{i}]", value))
        for i, value in by_axis("target", given, count).items()
    }


def lower_limits(
    given: Limits | Mapping[int, Limits] | None, axes: Iterable[int], own: Sequence[Limits]
) -> dict[int, Limits]:
    """The limits of a goal by axis: the axes' own, or lower ones."""
    found = {i: own[i] for i in axes}
    if given is None:
        return found
    lower = given if isinstance(given, Mapping) else dict.fromkeys(found, given)
    for i, asked in lower.items():
        if i not in found:
            raise InputError("limits", i, f"the goal is of axes {', '.join(map(str, found))}")
        if not isinstance(asked, Limits):
            raise InputError("limits", asked, "must be a Limits")
        above = exceeded(asked, own[i])
        if above is not None:
            name, value, most = above
            raise InputError(
                f"limits.{name}", value, f"must be at most {most!r}, the limit of axis {i}"
            )
        found[i] = asked
    return found


def exceeded(asked: Limits, own: Limits) -> tuple[str, float, float] | None:
    """The first limit that is asked for beyond one's own: its name, value and own value."""
    for name in LIMIT_NAMES:
        value, most = getattr(asked, name), getattr(own, name)
        if value > most * (1 + 1e-12):
            return name, value, most
    return None


def check_targets(
    goals: Mapping[int, State],
    own: Sequence[Limits],
    lower: Mapping[int, Limits],
    *,
    relative: bool,
) -> None:
    """Refuse targets that their axes' own limits, or lower ones, do not allow."""
    for i, goal in goals.items():
        for within in (own[i], lower[i]):
            free = replace(within, position=None) if relative else within
            check_target(f"target[{i}]", goal, free)


def turned(
    goals: Mapping[int, State],
    direction: str,
    wraps: Sequence[float],
    positions: Mapping[int, float],
) -> dict[int, State]:
    """Goals of axes that wrap, in the direction that is asked for from where they are."""
    if direction not in ("shortest", "positive", "negative"):
        raise InputError("direction", direction, "must be direct, shortest, positive or negative")
    found = {}
    for i, goal in goals.items():
        wrap, at = wraps[i], positions[i]
        if not wrap:
            raise InputError("direction", direction, f"axis {i} does not wrap")
        turns = Turns.nearest([goal.position], [at], [wrap])
        [position] = turns.onto([goal.position]).tolist()
        further = {"positive": int(position < at), "negative": -int(position > at)}
        turns = replace(turns, count=turns.count + further.get(direction, 0))
        found[i] = replace(goal, position=float(turns.onto([goal.position])[0]))
    return found
