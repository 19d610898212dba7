"""Following way-points without times, as fast as the limits allow.

``follow_path`` finds the fastest spline past the way-points, window by window; ``follow_stops`` is
a planned motion per line. ``docs/explanation/trajectories.md``. Never here: shared memory, drives.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sjerk.errors import InputError, PlanError, positive
from sjerk.limits import limits_of_each
from sjerk.planner import Motion, plan
from sjerk.profile import FloatArray, Limits
from sjerk.trajectory.corridor import Corridor
from sjerk.trajectory.fastest import NONE, fastest, feasible, in_cycles, resolution
from sjerk.trajectory.joining import stops_of
from sjerk.trajectory.parameterization import moments_of, stops_between
from sjerk.trajectory.programme import Answer, Task
from sjerk.trajectory.segments import Followed, IntArray, Knot, in_blocks
from sjerk.trajectory.spline import Knots, among
from sjerk.trajectory.stretching import limits_per_cycle
from sjerk.trajectory.window import (
    HAND_OUT,
    KEPT,
    LOOKAHEAD,
    Plan,
    Window,
    ranges,
    stop_of,
    tolerances,
    units,
)

#: Segments from way-point to way-point, where these are passed and where they are stops.
_PASSING, _STOPPING = 2.0, 4.0
#: By how much a start may become shorter, roughly.
_HOPE = 1.5
#: Way-points of a window, to begin with; and most for which stopping at each is compared.
_SOME, _STOPS = 16, 64


def follow_path(
    points: ArrayLike,
    limits: Limits | Sequence[Limits],
    cycle_time: float,
    *,
    joint_names: Sequence[str] | None = None,
    tolerance: float | ArrayLike | None = None,
    corridor: float | None = None,
    lookahead: float = LOOKAHEAD,
    block: int | None = None,
) -> Iterator[Followed]:
    """Follow way-points without times as fast as the limits allow, from rest to rest.

    ``points`` (n, N). Way-points are met exactly, or within ``tolerance`` (axis units, one for all
    or one per joint); between them the way is free, unless there is a ``corridor``: then the
    commanded motion stays within this distance (Euclidean) of the straight lines between the
    way-points. Two way-points are a straight line. For exact stops at every point, on the lines,
    see ``follow_stops``; a path that fits into one window is never slower than that. ``limits``:
    one per joint, or one for all. ``passed`` of the blocks says when and how near each way-point is
    passed; ``stretch`` is 0. Way-points denser than knots can meet are passed as near as they can.
    Memory is that of a window of twice ``lookahead`` stops (V/A + A/J of the slowest joint);
    ``block``: most segments at a time.
    Raises InputError, PlanError.

    >>> corner = [[0.0, 0.0], [0.5, 0.0], [0.5, 0.5]]
    >>> limits = [Limits(2.0, 4.0, 500.0)] * 2
    >>> exact, near, close = (
    ...     sum(int(b.cycles.sum()) for b in follow_path(corner, limits, 1e-3, **how))
    ...     for how in ({}, {"tolerance": 0.01}, {"corridor": 0.01})
    ... )
    >>> near < exact < close < sum(m.cycles for m in follow_stops(corner, limits, 1e-3))
    True
    """
    T, path = positive("cycle_time", cycle_time), _path(points)
    each = limits_of_each(limits, path.shape[1])
    names = [f"joint{i}" for i in range(path.shape[1])] if joint_names is None else joint_names
    if isinstance(names, str) or len(names) != path.shape[1]:
        raise InputError("joint_names", names, f"must be one per joint: {path.shape[1]}")
    near = tolerances(tolerance, path.shape[1])
    most = None if corridor is None else positive("corridor", corridor)
    ahead = positive("lookahead", lookahead)
    box = ranges(each)
    if box is not None:
        outside = np.argwhere((path < box[:, 0]) | (path > box[:, 1]))
        if len(outside):
            i, k = outside[0]
            raise InputError(
                f"points[{i}][{k}]", path[i, k], f"must lie in {box[k, 0]} .. {box[k, 1]}"
            )
    kept = np.flatnonzero(np.concatenate([[True], (np.diff(path, axis=0) != 0.0).any(axis=1)]))
    if len(kept) < 2:
        return iter(())
    return in_blocks(_windows(path, kept, names, each, T, near, most, ahead), block)


def follow_stops(
    points: ArrayLike, limits: Limits | Sequence[Limits], cycle_time: float
) -> Iterator[Motion]:
    """Follow straight lines between way-points with an exact stop at each; one ``Motion`` per line.

    ``points`` (n, N); ``limits``: one per joint, or one for all. All joints share the phases of
    each motion, so the way is the line itself. Raises InputError.

    >>> [motion.cycles for motion in follow_stops([[0.0], [1.0], [0.5]], [Limits(2, 4, 500)], 1e-3)]
    [1009, 716]
    """
    path = _path(points)
    return _stops(path, limits_of_each(limits, path.shape[1]), positive("cycle_time", cycle_time))


def _stops(path: FloatArray, limits: Sequence[Limits], T: float) -> Iterator[Motion]:
    for one, two in itertools.pairwise(path.tolist()):
        if one != two:
            yield plan(one, two, limits, T, synchronization="phase")


def _path(points: ArrayLike) -> FloatArray:
    try:
        path = np.array(points, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError("points", points, "must be numbers of shape (n, N)") from None
    if path.ndim != 2 or 0 in path.shape:
        raise InputError("points", path.shape, "must have shape (n, N)")
    wrong = np.flatnonzero(~np.isfinite(path).all(axis=1))
    if len(wrong):
        raise InputError(f"points[{wrong[0]}]", path[wrong[0]].tolist(), "must be finite")
    return path


def _windows(
    path: FloatArray,
    kept: IntArray,
    names: Sequence[str],
    limits: Sequence[Limits],
    T: float,
    tolerance: FloatArray | None,
    corridor: float | None,
    lookahead: float,
) -> Iterator[Followed]:
    table = limits_per_cycle(limits, T)
    if len(kept) == 2:  # the straight line, as ``plan`` goes it
        yield stops_of(names, list(_stops(path, limits, T)), path, kept)
        return
    stop = stop_of(table)
    window = Window(names, T, Knot.rest(path[0]))
    planner = Untimed(table, ranges(limits), tolerance, np.ptp(path, axis=0), corridor)
    horizon, done = (HAND_OUT + lookahead) * stop, 1
    while done < len(kept) or len(window):
        done = _fill(window, path, kept, done, table, horizon)
        ends = done == len(kept)
        cut = np.inf
        try:
            found = planner.plan(window)
        except (PlanError, InputError):
            if window.remainder is None:  # at rest: from stop to stop there is always a way
                some = kept[window.next_point - 1 : window.next_point + len(window)]
                rests = list(_stops(path[some], limits, T))
                yield window.stopped(stops_of(names, rests, path, some))
                continue
            found = window.remainder  # to rest, as it was planned before
        else:
            if not ends:
                cut = max(found.knots.duration - lookahead * stop, 1.0)
        if ends and window.first == 0 and len(path) <= _STOPS:
            still = stops_of(names, list(_stops(path, limits, T)), path, kept)
            if int(still.cycles.sum()) < found.knots.duration + 1.0:
                yield still
                return
        made = window.hand_out(found, cut)
        point = made.passed.point
        yield replace(
            made,
            ahead=kept[np.minimum(made.ahead, len(kept) - 1)],
            passed=replace(made.passed, point=kept[point]),
        )


def _fill(
    window: Window,
    path: FloatArray,
    kept: IntArray,
    done: int,
    table: FloatArray,
    horizon: float,
) -> int:
    """Way-points for so many cycles; how many are known then."""
    more = _SOME
    while done < len(kept):
        some = kept[done : done + more]
        window.add(path[some], np.zeros(len(some)))
        done += len(some)
        start = window.state.position
        rows = np.concatenate([start[None], window.points])
        rows = rows[np.concatenate([[True], (np.diff(rows, axis=0) != 0.0).any(axis=1)])]
        if len(rows) > 1 and moments_of(rows, table)[-1] >= horizon:
            break
        more = len(window)
    return done


class Untimed:
    """How way-points are passed that have no times."""

    def __init__(
        self,
        table: FloatArray,
        box: FloatArray | None,
        tolerance: FloatArray | None,
        way: FloatArray,
        corridor: float | None,
    ) -> None:
        """``table`` (N, 3): limits per cycle; ``way`` (N,): of each joint."""
        self._table, self._box, self._stop = table, box, stop_of(table)
        self._unit = units(table, way, tolerance)
        self._exact = tolerance is None
        self._corridor = corridor
        soft = float((table[:, 1] / table[:, 2]).min())
        self._spacing = max(2.0, soft / 3.0, self._stop / 60.0)

    def plan(self, window: Window) -> Plan:
        """The fastest motion past all way-points of a window, to rest at the last."""
        origin = window.state.position
        points = window.points - origin
        box = None if self._box is None else self._box - origin[:, None]
        task = Task(self._table, self._unit, points[:-1], window.start, points[-1], box)
        keep: float | FloatArray = NONE if self._exact else 1.0
        if self._corridor is None:
            knots, answer = self._fastest(task, keep, window)
        else:
            rows = np.concatenate([np.zeros_like(origin)[None], points])
            times = np.diff(moments_of(rows, self._table)) / self._spacing
            lines = Corridor(task, self._corridor, None if self._exact else 1.0, times)
            knots, answer = lines.plan(lambda t, k, m: self._fastest(t, k, window, m))
        moments = np.append(answer.moments + 0.5, knots.duration + 1.0)
        return Plan(knots, answer, moments, moments, True)

    def _fastest(
        self,
        task: Task,
        keep: float | FloatArray,
        window: Window,
        begun: FloatArray | None = None,
    ) -> tuple[Knots, Answer]:
        """``begun`` (n + 1,): moments of the way-points and the end to begin with, or None."""
        assert task.end is not None
        end, task = task.end, replace(task, turns=_on_limits(task))
        if begun is not None:
            made = self._best(task, self._begun(task, keep, begun, window.left, _PASSING))
            if made is not None:
                return made
        rows = np.concatenate([np.zeros_like(end)[None], task.points, end[None]])
        moving = window.state.moving
        passes = moments_of(rows, self._table, task.start[1] if moving else None)[1:]
        gaps = stops_between(rows, self._table)
        if moving:
            _, v, a = task.start
            _, A, J = self._table.T
            gaps[0] += float((np.abs(v) / A + A / J + np.abs(a) / J).max())
        stops = np.cumsum(gaps)
        if self._corridor is None:
            passes = window.going_on(passes, KEPT * self._stop)  # further on it comes to rest
            stops = window.going_on(stops, rests=True)
        found: list[_Start] = []
        for moments, least in ((passes, _PASSING), (stops, _STOPPING)):
            if found and self._corridor is not None:  # points on lines are no stops
                break
            found += self._begun(task, keep, moments, window.left, least)
        best = self._best(task, found)
        if best is None:
            raise PlanError("points: no motion was found that keeps the limits")
        return best

    @staticmethod
    def _best(task: Task, found: list[_Start]) -> tuple[Knots, Answer] | None:
        """The fastest in whole cycles that any of these becomes; None: none does."""
        best: tuple[Knots, Answer] | None = None
        for begun in sorted(found, key=lambda x: x.length):
            if best is not None and best[0].duration <= begun.length / _HOPE:
                continue
            knots, share = begun.knots, begun.keep
            made = in_cycles(task, knots, fastest(task, knots, begun.answer, share), share)
            if made is not None and (best is None or made[0].duration < best[0].duration):
                best = made
        return best

    def _begun(
        self,
        task: Task,
        keep: float | FloatArray,
        moments: FloatArray,
        left: IntArray,
        least: float,
    ) -> list[_Start]:
        """Motions with about these moments, to begin with."""
        length = max(16, int(np.ceil(moments[-1])))
        begun = np.minimum(moments[:-1], length - 1e-3)
        knots = Knots(among(begun, left, length, self._spacing, KEPT * self._stop, least))
        share: FloatArray = np.atleast_1d(
            np.maximum(keep, resolution(task, knots, begun, keep))
        ).astype(np.float64)
        found = [self._at_any_pace(task, knots, begun, share)]
        if task.turns is not None:  # and as they would be passed without position limits
            free = replace(task, box=None, turns=None)
            other = self._at_any_pace(free, knots, begun, share)
            if other is not None:
                other = fastest(free, knots, other, share)
                found.append(feasible(task, knots, other.moments, other.pace, share))
        return [_Start(knots, share, answer) for answer in found if answer is not None]

    @staticmethod
    def _at_any_pace(
        task: Task, knots: Knots, moments: FloatArray, keep: FloatArray
    ) -> Answer | None:
        for pace in (1.0, 1.5, 4.0):
            found = feasible(task, knots, moments, pace, keep)
            if found is not None:
                return found
        return None


@dataclass(frozen=True, eq=False)
class _Start:
    """A motion within so many tolerances."""

    knots: Knots
    keep: FloatArray
    answer: Answer

    @property
    def length(self) -> float:
        return self.answer.pace * self.knots.duration


def _on_limits(task: Task) -> NDArray[np.bool_] | None:
    """Which way-points (n, J) are on a position limit, where the joint turns; None: none is."""
    if task.box is None or not len(task.points):
        return None
    near = 1e-9 * task.scale[:, None]
    on = np.asarray((np.abs(task.points[:, :, None] - task.box) <= near).any(axis=2))
    return on if on.any() else None
