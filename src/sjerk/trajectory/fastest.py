"""The fastest spline past way-points: a sequence of convex steps.

Each round takes one step in all unknowns, puts every moment where its way-point is nearest, and
finds control points and pace anew for these moments, which is convex: so every round ends in a
motion, and is kept only if it is faster. Never here: windows, rows of programmes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sjerk.profile import FloatArray
from sjerk.trajectory.programme import Answer, Programme, Task
from sjerk.trajectory.spline import HALF_CYCLE, Knots, scaled, take

#: An excess (in tolerances) that is none.
NONE = 1e-5
#: A round that gains less is one of the last ones.
_GAIN = 3e-4
#: A step that promises less is none.
_NOTHING = 5e-5
#: Way-points that may be missed by so much (in tolerances) leave room to go straight on.
_LOOSE = 0.5
ROUNDS = 20
#: A round that gains more than this does not count as one of them; how many there may be in all.
_MUCH, _MOST = 5e-3, 100
#: Steps of the solver for a motion at its moments; one that is not found in so many is none.
_STEPS = 25


def places(knots: Knots, answer: Answer) -> FloatArray:
    """Where the commanded motion is at the moments (n, J): q = P + 5/24 A."""
    segment, p, _, a = knots.at(answer.moments)
    return take(p + HALF_CYCLE / answer.pace**2 * a, segment, answer.control)


def nearest(task: Task, knots: Knots, answer: Answer, keep: float | FloatArray) -> FloatArray:
    """Each moment to where its way-point is nearest, by Gauss-Newton, while the order is kept.

    But for those at which it is within what is to be kept: there nothing is to be mended.
    """
    moments = answer.moments
    for _ in range(3):
        reach = 0.2 * knots.around(moments)
        segment, p, v, _ = knots.at(moments)
        gap = (task.points - take(p, segment, answer.control)) / task.unit
        rate = take(v, segment, answer.control) / task.unit
        square = (rate**2).sum(axis=1)
        new = moments + np.clip(
            (gap * rate).sum(axis=1) / np.maximum(square, 1e-300), -reach, reach
        )
        new = np.where(square > 1e-12 * square.max(initial=0.0), new, moments)
        new = np.where((np.abs(gap) > keep).any(axis=1), new, moments)
        if task.turns is not None:  # as they turn
            new = np.where(task.turns.any(axis=1), moments, new)
        if (
            len(new) == 0
            or new[0] <= 0.0
            or new[-1] >= knots.duration
            or (np.diff(new) <= 0.0).any()
        ):
            break
        moments = new
    return moments


def slowest(task: Task, knots: Knots, moments: FloatArray) -> float:
    """The pace at which every way-point is reached no sooner than asked."""
    if task.least is None or not len(task.least):
        return 0.0
    gaps = np.diff(np.concatenate([[0.0], moments, [knots.duration]]))
    least = task.least.copy()
    least[0] -= 0.5
    if task.end is None:
        gaps = gaps[:-1]
    else:
        least[-1] -= 0.5
    return float((least / np.maximum(gaps, 1e-12)).max(initial=0.0)) * (1.0 + 1e-12)


def settle(
    task: Task,
    knots: Knots,
    answer: Answer,
    keep: float | FloatArray,
    most: int,
    than: float | None = None,
) -> Answer | None:
    """Control points and pace for the moments as they are: the fastest, or None.

    ``than``: the pace that it is to be faster than; what clearly is, or is not, is taken as it is.
    """
    enough, hopeless = (0.0, np.inf) if than is None else (than * (1 - _GAIN), than * (1 + _GAIN))
    least = slowest(task, knots, answer.moments)
    answer = replace(answer, pace=max(answer.pace, least))
    for _ in range(most):
        made = Programme(task, knots, answer, move=False, paced=True).solve(keep=keep, near=1e-7)
        if made is None:
            return None
        if made.pace < least:
            made = replace(made, pace=least)
        same = abs(made.pace - answer.pace) < 2e-4 * answer.pace
        clear = same or not enough < made.pace < hopeless
        done = clear and made.excess < NONE
        answer = made
        if done:
            break
    return answer if answer.excess <= NONE else None


def first_answer(task: Task, knots: Knots, moments: FloatArray, pace: float) -> Answer:
    """Control points on the lines between the way-points."""
    rows = [task.start[:1], task.points]
    ends = [np.zeros(1), moments]
    if task.end is not None:
        rows.append(task.end[None])
        ends.append(np.array([knots.duration]))
    points, at = np.concatenate(rows), np.concatenate(ends)
    r = knots.lengths
    where = np.concatenate([[-r[0]], knots.time, [knots.duration + r[-1]]])
    control = np.stack([np.interp(where, at, column) for column in points.T], axis=1)
    return Answer(control, moments, pace, 0.0)


def feasible(
    task: Task,
    knots: Knots,
    moments: FloatArray,
    pace: float,
    keep: float | FloatArray,
) -> Answer | None:
    """A motion with these moments, or with others near by where there is none; None: none found."""
    answer = first_answer(task, knots, moments, pace)
    n, reach = len(moments), 0.3
    made = settle(task, knots, answer, keep, 25)
    for _ in range(12):  # not with these moments: move them first
        if made is not None or n == 0:
            break
        step = Programme(task, knots, answer, move=True, paced=True).solve(
            keep=keep, reach=reach * knots.around(answer.moments)
        )
        if step is None:
            return None
        if not _ordered(step.moments, knots):
            reach *= 0.5
            continue
        answer = step
        slow = replace(answer, pace=answer.pace * 1.02)
        made = settle(task, knots, replace(slow, moments=nearest(task, knots, slow, keep)), keep, 8)
        if made is None:
            made = settle(task, knots, slow, keep, 8)
    return made


def fastest(
    task: Task, knots: Knots, best: Answer, keep: float | FloatArray, rounds: int = ROUNDS
) -> Answer:
    """From a motion to begin with, the fastest found in so many rounds that gain little each.

    Where way-points have room a step is settled as it is, and reaches further where it held what it
    promised. Exact ones hang on their moments: those are mended first, and rounds go on while any
    gains; going straight on ended 0.4 % later.
    """
    n, reach, still, few = len(best.moments), 0.3, 0, 0
    loose = bool(np.min(keep) > _LOOSE)
    for _ in range(_MOST if n else 0):
        step = Programme(task, knots, best, move=True, paced=True).solve(
            keep=keep, reach=reach * knots.around(best.moments), slower=0.2, near=1e-7
        )
        if loose and step is not None and step.pace > best.pace * (1.0 - _NOTHING):
            break  # no direction leads on: what the pace's tangents miss is of second order
        found, share = None, 1.0
        for share in (1.0, 0.5, 0.25) if step else ():  # along the step, less if that does not help
            found = _settled_along(task, knots, best, step, share, keep, loose)
            if found is not None:
                break
        few += found is None or found.pace > best.pace * (1.0 - _MUCH)
        if found is not None:
            still = still + 1 if found.pace > best.pace * (1.0 - _GAIN) else 0
            assert step is not None
            held = best.pace - found.pace > 0.75 * (best.pace - step.pace)
            more = 3.0 if loose and held else 1.5
            reach = min(reach * more, 4.0) if share == 1.0 else reach * 0.7
            best = found
        else:
            reach, still = reach * 0.2, still + 1
        if still > 2 or reach < 1e-4 or few >= rounds:
            break
    return best


def _settled_along(
    task: Task,
    knots: Knots,
    best: Answer,
    step: Answer | None,
    share: float,
    keep: float | FloatArray,
    loose: bool,
) -> Answer | None:
    """A faster motion with the moments of a part of a step; None: there is none."""
    assert step is not None
    way = Answer(
        best.control + share * (step.control - best.control),
        best.moments + share * (step.moments - best.moments),
        best.pace + share * (step.pace - best.pace),
        0.0,
    )
    if not _ordered(way.moments, knots):
        return None
    mended = nearest(task, knots, way, keep if loose else 0.0)
    both = (way.moments, mended) if loose else (mended, way.moments)
    for moments in both:
        than = best.pace if loose else None
        found = settle(task, knots, replace(way, moments=moments), keep, 3, than)
        if found is not None and found.pace < best.pace:
            return found
        if loose and np.array_equal(*both):
            break
    return None


def whole(
    task: Task, knots: Knots, best: Answer, keep: float | FloatArray
) -> tuple[Knots, Answer] | None:
    """The same in whole cycles, at pace 1: the fewest cycles that do."""
    length = best.pace * knots.duration
    for more in (0, 1, 2, 3, 4, 6, 8, 12, 16, 24):
        cycles = max(int(np.ceil(length - 1e-6)) + more, len(knots))
        own = Knots(scaled(knots, cycles))
        answer = Answer(best.control, best.moments * (cycles / knots.duration), 1.0, 0.0)
        for _ in range(3):
            made = settle(task, own, answer, keep, 6)
            if made is None:
                near = replace(answer, moments=nearest(task, own, answer, keep))
                made = settle(task, own, near, keep, 6)
            if made is None:
                break
            if made.pace <= 1.0 + 1e-9:
                done = _slowed(task, own, made, keep)
                if done is not None:
                    return own, done
                break
            if not len(made.moments):
                break
            step = Programme(task, own, made, move=True, paced=True).solve(
                keep=keep, reach=0.3 * own.around(made.moments)
            )
            if step is None or not _ordered(step.moments, own):
                break
            answer = replace(step, moments=nearest(task, own, step, keep))
    return None


def _slowed(task: Task, knots: Knots, made: Answer, keep: float | FloatArray) -> Answer | None:
    """At pace 1 what is possible faster; from motion the moments are others then."""
    n = len(made.moments)
    answer = replace(made, pace=1.0)
    done = at_pace(task, knots, answer, keep, most=NONE)
    if done is not None or not n:
        return done
    answer = replace(answer, moments=made.moments * made.pace)  # at the same time
    for _ in range(4):
        step = Programme(task, knots, answer, move=True, paced=False).solve(
            keep=keep, reach=0.3 * knots.around(answer.moments)
        )
        if step is None or not _ordered(step.moments, knots):
            return None
        for moments in (nearest(task, knots, step, keep), step.moments):
            answer = replace(step, moments=moments)
            if slowest(task, knots, moments) <= 1.0 + 1e-9:
                done = at_pace(task, knots, answer, keep, most=NONE)
                if done is not None:
                    return done
    return None


def at_pace(
    task: Task, knots: Knots, answer: Answer, keep: float | FloatArray, most: float = np.inf
) -> Answer | None:
    """Control points for moments and pace as they are; joint by joint, smooth where there is room.

    None: there are none, or they need more than ``most`` of excess.
    """
    control, excess = answer.control.copy(), 0.0
    for j in range(len(task.unit)):
        one = _column(answer, j)
        near = keep[:, j : j + 1] if isinstance(keep, np.ndarray) and keep.ndim == 2 else keep
        made = Programme(task.joint(j), knots, one, move=False, paced=False).solve(keep=near)
        if made is None or made.excess > most:
            return None
        control[:, j : j + 1] = made.control
        excess = max(excess, made.excess)
    return replace(answer, control=control, excess=excess)


def in_time(task: Task, knots: Knots, moments: FloatArray, order: list[int]) -> Answer | None:
    """Control points at pace 1 within the tolerance, and exact where that is quickly found.

    Joint by joint, which are separate where the moments stay, in this ``order``; None: one has
    none, and is the first in the order from now on.
    """
    answer = first_answer(task, knots, moments, 1.0)
    found: dict[int, Answer] = {}
    for j in order:
        made = _joint_in_time(task.joint(j), knots, _column(answer, j), 1.0)
        if made is None or made.excess > NONE:
            order.remove(j)
            order.insert(0, j)
            return None
        found[j] = made
    control, excess = answer.control.copy(), 0.0
    for j, made in found.items():
        exact = _joint_in_time(task.joint(j), knots, made, NONE)
        best = made if exact is None or exact.excess > 1.0 else exact
        control[:, j : j + 1] = best.control
        excess = max(excess, best.excess)
    return replace(answer, control=control, excess=excess)


def evenly(
    task: Task, knots: Knots, moments: FloatArray, most: float, order: list[int]
) -> float | None:
    """The least pace at which these moments are kept, all slowed alike; None: above ``most``."""
    answer = first_answer(task, knots, moments, max(1.0, slowest(task, knots, moments)))
    for j in list(order):
        one = _column(answer, j)
        made = _joint_in_time(task.joint(j), knots, one, 1.0)
        if made is not None and made.excess <= NONE:
            continue
        made = settle(task.joint(j), knots, one, 1.0, 6)
        if made is None or made.pace > most:
            order.remove(j)
            order.insert(0, j)
            return None
        answer = replace(answer, pace=max(answer.pace, made.pace))
    return answer.pace


def _column(answer: Answer, j: int) -> Answer:
    return replace(answer, control=np.ascontiguousarray(answer.control[:, j : j + 1]))


def _joint_in_time(task: Task, knots: Knots, answer: Answer, keep: float) -> Answer | None:
    programme = Programme(task, knots, answer, move=False, paced=False)
    return programme.solve(keep=keep, steps=_STEPS)


def resolution(
    task: Task, knots: Knots, moments: FloatArray, keep: float | FloatArray
) -> float | FloatArray:
    """What tolerance (in tolerances) these knots can meet at all, whatever the limits."""
    loose = replace(task, limits=task.limits * 1e3 ** np.arange(1, 4))
    made = at_pace(loose, knots, first_answer(task, knots, moments, 1.0), keep)
    return keep if made is None or made.excess < NONE else keep + 1.1 * made.excess


def in_cycles(
    task: Task, knots: Knots, best: Answer, keep: float | FloatArray
) -> tuple[Knots, Answer] | None:
    """``whole``, more slowly if need be."""
    for slower in (1.0, 1.02, 1.1, 1.5, 2.0):
        made = whole(task, knots, replace(best, pace=best.pace * slower), keep)
        if made is not None:
            return made
    return None


def _ordered(moments: FloatArray, knots: Knots) -> bool:
    whole_way = np.concatenate([[0.0], moments, [knots.duration]])
    return bool((np.diff(whole_way) > 0.0).all())
