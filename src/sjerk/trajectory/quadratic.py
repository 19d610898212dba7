"""A convex quadratic programme in the order of time, solved by ``_qp.c``.

Never here: what its variables mean.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sjerk._binding import ffi, lib
from sjerk.profile import FloatArray

_INT = NDArray[np.int32]


@dataclass(frozen=True)
class Optimum:
    """``x`` (n,); whether it is ``solved``; ``outside``: most by which a row leaves its bounds.

    A row counts with its largest entry scaled to 1.
    """

    x: FloatArray
    solved: bool
    iterations: int
    outside: float


@dataclass(frozen=True, eq=False)
class Rows:
    """Sparse rows of m constraints: row r is ``value[start[r]:start[r+1]]`` at ``column`` of these.

    ``start`` (m + 1,), ``column`` (entries,), ascending within a row, ``value`` (entries,).
    """

    start: _INT
    column: _INT
    value: FloatArray


def minimise(
    hessian: FloatArray,
    gradient: FloatArray,
    rows: Rows,
    lower: FloatArray,
    upper: FloatArray,
    start: FloatArray,
    *,
    most: int = 60,
    warm: float = 0.0,
    tolerance: float = 1e-9,
) -> Optimum:
    """Minimise 1/2 x'Hx + g'x subject to lower <= Ax <= upper; units in which these are about 1.

    ``hessian`` (n, band + 1): H(i, j) at ``[i, band + j - i]`` for i - band <= j <= i; no row of
    ``rows`` spans more than ``band``. ``start`` (n,): a guess, ``warm``: how far from its bounds it
    is taken to be at least. At ``most`` so many iterations.

    >>> one = Rows(np.array([0, 1], np.int32), np.array([0], np.int32), np.ones(1))
    >>> x = minimise(np.ones((1, 1)), np.array([-2.0]), one, np.zeros(1), np.ones(1), np.zeros(1)).x
    >>> round(float(x[0]), 6)
    1.0
    """
    n, band = hessian.shape[0], hessian.shape[1] - 1
    x = np.array(start, dtype=np.float64)
    work = np.empty(lib.sj_qp_doubles(n, len(lower), band))
    free = float(lib.SJ_QP_FREE)
    columns = [
        np.ascontiguousarray(column, dtype=np.float64)
        for column in (
            hessian,
            gradient,
            rows.value,
            np.clip(lower, -free, free),
            np.clip(upper, -free, free),
        )
    ]
    problem, result = ffi.new("sj_qp *"), ffi.new("sj_qp_result *")
    problem.variables, problem.rows, problem.band = n, len(lower), band
    problem.hessian, problem.gradient, problem.value, problem.lower, problem.upper = (
        ffi.from_buffer("double[]", column) for column in columns
    )
    problem.start = ffi.from_buffer("int32_t[]", rows.start)
    problem.column = ffi.from_buffer("int32_t[]", rows.column)
    lib.sj_qp_solve(
        problem,
        ffi.from_buffer("double[]", x),
        ffi.from_buffer("double[]", work),
        most,
        warm,
        tolerance,
        result,
    )
    solved = result.status == lib.SJ_QP_SOLVED
    return Optimum(x, solved, result.iterations, result.outside)
