"""Many independent plans at once, without a Python object per plan and without the GIL.

Never here: clocks, shared memory, drives.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sjerk._binding import dtype_of, ffi, lib
from sjerk.errors import InputError, positive
from sjerk.planner.arguments import check_range, fail, is_sequence, limit_rows, rows_of
from sjerk.profile import FloatArray, Limits

#: Starting a thread costs about as much as planning a thousand axes.
_ROWS_PER_THREAD = 4000
#: Most phases of one plan.
PHASES_MAX: int = lib.SJ_PHASES
#: The memory of an ``sj_row``: one plan of many.
ROW = dtype_of("sj_row")
#: The memory of an ``sj_phase``.
PHASE = dtype_of("sj_phase")


@dataclass(frozen=True, eq=False)
class Plans:
    """Many independent plans as arrays; row i is request i. Made by ``plan_many``.

    ``cycle_time`` in seconds. ``rows`` (n,) has the columns ``cycles`` (int64, the length),
    ``first`` (int64, index of the first phase in ``pool``), ``count`` (int32, of phases) and
    ``kind`` (int32, how it was found: ``enum sj_plan_kind`` in ``planner/_planner.h``). ``pool``
    has the phases of all plans, with room between them, by the columns ``cycles`` (int64) and
    ``jerk`` (float64, u per cycle^3: over ``cycle_time**3`` it is u/s^3).

    >>> plans = plan_many([0.0], [160.0], Limits(90.0, 500.0, 5000.0), 1e-3)
    >>> len(plans), plans.duration.tolist(), plans.phases(0)[0].tolist()
    (1, [2.058], [100, 80, 100, 1498, 100, 80, 100])
    """

    cycle_time: float
    rows: NDArray[Any]
    pool: NDArray[Any]

    @property
    def cycles(self) -> NDArray[np.int64]:
        """Lengths (n,) in control cycles."""
        cycles: NDArray[np.int64] = self.rows["cycles"]
        return cycles

    @property
    def duration(self) -> FloatArray:
        """Lengths (n,) in seconds."""
        return np.multiply(self.cycles, self.cycle_time, dtype=np.float64)

    @property
    def phase_counts(self) -> NDArray[np.int32]:
        """Number of phases of each plan, (n,)."""
        counts: NDArray[np.int32] = self.rows["count"]
        return counts

    def phases(self, i: int) -> tuple[NDArray[np.int64], FloatArray]:
        """Cycles (m,) and jerks (m,) in u/s^3 of the m phases of plan ``i``."""
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


def plan_many(
    start: ArrayLike,
    target: ArrayLike,
    limits: Limits | Sequence[Limits] | NDArray[Any],
    cycle_time: float,
) -> Plans:
    """Plan n independent axes at once, without a Python object per plan and without the GIL.

    ``start``: positions (n,), or rows (n, 1..3) of position, velocity, acceleration; ``target``:
    positions (n,), or rows (n, 1..2) of position, velocity; ``limits``: one for all, one each, or
    an array (n, 3) of velocity, acceleration, jerk or (n, 5) with those of braking; ``cycle_time``
    in seconds. In u, u/s, u/s^2, u/s^3; columns that are left out are 0, those of braking as the
    others. Row i of the result is what ``plan`` would return: ``Plans.cycles`` (n,) its length,
    ``Plans.phases(i)`` its phases; as arrays ``Plans.rows`` and ``Plans.pool``. Several processors
    share large batches. Raises ``InputError`` with the row.

    >>> plans = plan_many([0.0, 1.0], [160.0, 160.0], Limits(90.0, 500.0, 5000.0), 1e-3)
    >>> plans.cycles.tolist()
    [2058, 2047]
    """
    begin, end = rows_of("start", start, 3), rows_of("target", target, 2)
    T = positive("cycle_time", cycle_time)
    n, step = len(begin), 1
    if isinstance(limits, Limits):
        check_range(end, limits, slice(None))
        c_limits, step = ffi.from_buffer("sj_limits[]", limits.per_cycle(T)), 0
        given = n
    elif isinstance(limits, np.ndarray):
        table = limit_rows(limits, T)
        c_limits = ffi.cast("sj_limits *", ffi.from_buffer(table))
        given = len(table)
    else:
        if not is_sequence(limits) or not all(isinstance(k, Limits) for k in limits):
            raise InputError("limits", limits, "must be a Limits, a list of them, or an array")
        for i, limit in enumerate(limits):
            check_range(end, limit, slice(i, i + 1))
        c_limits = ffi.from_buffer("sj_limits[]", b"".join([k.per_cycle(T) for k in limits]))
        given = len(limits)
    if len(end) != n or given != n:
        raise InputError("start, target, limits", (n, len(end), given), "must be of one length")
    # most of the pool is never touched, and so never becomes memory
    rows, pool = np.empty(n, dtype=ROW), np.empty(n * PHASES_MAX, dtype=PHASE)
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
            first * PHASES_MAX,
            failed,
        )
        return status, first + int(failed[0])

    for status, row in _in_parallel(run, n):
        if status == 0:
            continue
        state = (begin[row].tolist(), end[row].tolist())
        shown = limits if isinstance(limits, Limits) else limits[row]
        fail(status, f"row {row}", state, shown)
    return Plans(T, rows, pool)


def _processors() -> int:
    """How many this process may use; all where the system does not say."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _in_parallel(run: Callable[[int, int], tuple[int, int]], n: int) -> list[tuple[int, int]]:
    """Rows 0 .. n - 1 in as many parts as there are processors for us, if it is worth a thread."""
    parts = min(_processors(), n // _ROWS_PER_THREAD)
    if parts < 2:
        return [run(0, n)]
    cuts = [n * i // parts for i in range(parts + 1)]
    with ThreadPoolExecutor(parts) as pool:
        return list(pool.map(run, cuts[:-1], cuts[1:]))
