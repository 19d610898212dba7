"""Convex quadratic programmes in the order of time, with a border: ``_arrow.c``.

Never here: what unknowns and rows mean.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sjerk._binding import ffi, lib
from sjerk.profile import FloatArray
from sjerk.trajectory.segments import doubles

_INT = NDArray[np.int32]


@dataclass(frozen=True)
class Optimum:
    """``x`` (n + border,); whether it is ``solved``, or ``lost`` to numbers that are none.

    ``wrong``: most by which a slack is not a row's distance to its bound; ``outside``: most by
    which a row is beyond a bound.
    """

    x: FloatArray
    solved: bool
    lost: bool
    steps: int
    wrong: float
    outside: float


@dataclass(frozen=True, eq=False)
class Rows:
    """m rows a of an unknown x (n,): ``low <= a'x + below'w`` and ``a'x + above'w <= high``.

    ``at``, ``value`` (m, up to 6): places that do not fall within a row, and coefficients; those of
    0 are none. ``low``, ``high`` (m,), infinite for none; ``weight``, ``target`` (m,): of half the
    squares (a'x - target)^2 in the objective; ``below``, ``above`` (m, border). A row with low =
    high and nothing of w is met exactly.
    """

    at: _INT
    value: FloatArray
    below: FloatArray
    above: FloatArray
    low: FloatArray
    high: FloatArray
    weight: FloatArray
    target: FloatArray


def minimise(
    rows: Rows,
    gradient: FloatArray,
    start: FloatArray,
    *,
    near: float = 1e-8,
    steps: int = 80,
    begin: float = 1.0,
) -> Optimum:
    """Minimise gradient'x and the squares of the rows, from ``start``, in so many ``steps``.

    ``gradient``, ``start`` (n + border,). In units in which bounds are about 1; the objective is
    missed by at most ``near``. ``begin``: slacks times multipliers to begin with.

    >>> one, no = np.ones(1), np.zeros((1, 0))
    >>> row = Rows(np.zeros((1, 1), np.int32), np.ones((1, 1)), no, no, 0 * one, one, one, 2 * one)
    >>> round(float(minimise(row, np.zeros(1), np.zeros(1)).x[0]), 6)
    1.0
    """
    m, border = rows.below.shape
    there = rows.value != 0.0
    first = np.zeros(m + 1, dtype=np.int32)
    np.cumsum(there.sum(axis=1), out=first[1:])
    at, x = rows.at[there], np.array(start, dtype=np.float64)
    columns = {
        "value": rows.value[there],
        "beside": np.ascontiguousarray(np.stack([rows.below.T, rows.above.T], axis=1)),
        "low": rows.low,
        "high": rows.high,
        "weight": rows.weight,
        "target": rows.target,
        "gradient": gradient,
        "x": x,
    }
    n = len(x) - border
    band = int((rows.at[:, -1] - rows.at[:, 0]).max(initial=0))
    columns["spare"] = np.empty(lib.sj_arrow_spare(n, band, m))
    problem, told = ffi.new("sj_arrow *"), ffi.new("sj_arrow_result *")
    problem.unknowns, problem.rows, problem.bounded = n, m, m
    problem.band, problem.border, problem.most = band, border, steps
    problem.start = ffi.from_buffer("int32_t[]", first)
    problem.at = ffi.from_buffer("int32_t[]", at)
    kept = {name: doubles(column) for name, column in columns.items()}
    for name, column in kept.items():
        setattr(problem, name, column)
    problem.begin, problem.room, problem.near = begin, 1.0, near
    lib.sj_arrow_solve(problem, told)
    return Optimum(
        x,
        told.status == lib.SJ_ARROW_OK,
        told.status == lib.SJ_ARROW_LOST or not bool(np.isfinite(x).all()),
        told.steps,
        told.wrong,
        told.outside,
    )
