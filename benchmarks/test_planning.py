"""Planning: cost beside ruckig's in the same run, durations over its optimum, worst case.

ruckig is called with inputs built beforehand; from its figure the cost of the bare call from Python
is taken off where sjerk's own C cost stands beside it.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from conftest import Report
from helpers import planner_check as check
from sjerk import Limits, State, plan, plan_many
from sjerk._binding import ffi, lib
from sjerk.planner.batch import PHASE, PHASES_MAX, ROW

ruckig = pytest.importorskip("ruckig")

T = 1e-3
N = 2000
ROUNDS = 60
TABLE = "planning, ratios of this run (best of rounds, per plan)"


@pytest.fixture(autouse=True)
def pinned() -> Iterator[None]:
    """On one core for the test, so that both sides see the same."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(before)})
    yield
    os.sched_setaffinity(0, before)


def best(work: Callable[[], object], per: int, rounds: int = ROUNDS) -> float:
    """Seconds per item of the fastest round."""
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times) / per


def inputs(r: check.Requests) -> list[Any]:
    """Ruckig's inputs for the continuous motions behind the requests."""
    h, V, A, v1, _, _ = check.in_cycles(r, T)
    made = []
    for i in range(len(r)):
        x = ruckig.InputParameter(1)
        x.current_position, x.target_position = [0.0], [h[i]]
        x.current_velocity, x.current_acceleration = [V[i] / T], [A[i] / T**2]
        x.target_velocity = [v1[i] / T]
        x.max_velocity, x.max_acceleration = [r.limits[i, 0]], [r.limits[i, 1]]
        x.max_jerk = [r.limits[i, 2]]
        made.append(x)
    return made


class Rows:
    """The C planner over an array, no Python between the plans."""

    def __init__(self, r: check.Requests) -> None:
        self.start, self.target = (np.ascontiguousarray(x) for x in (r.start, r.target))
        self.limits = r.limits * np.array([T, T**2, T**3, T**2, T**3])
        self.rows = np.empty(len(r), dtype=ROW)
        self.pool = np.empty(len(r) * PHASES_MAX, dtype=PHASE)
        self.failed = ffi.new("int64_t *")

    def run(self, first: int = 0, n: int | None = None) -> None:
        n = len(self.start) if n is None else n
        status = lib.sj_plan_rows(
            n,
            T,
            ffi.from_buffer("double[]", self.start) + 3 * first,
            3,
            ffi.from_buffer("double[]", self.target) + 2 * first,
            2,
            ffi.cast("sj_limits *", ffi.from_buffer(self.limits)) + first,
            1,
            ffi.cast("sj_row *", ffi.from_buffer(self.rows)) + first,
            ffi.cast("sj_phase *", ffi.from_buffer(self.pool)),
            0,
            self.failed,
        )
        assert status == 0


@pytest.mark.parametrize("kind", check.KINDS)
def test_one_axis_beside_ruckig(report: Report, kind: str) -> None:
    """C planning and plan() beside ruckig's calculate, random states."""
    r = check.draw(np.random.default_rng(11), N, kind)
    otg, out = ruckig.Ruckig(1), ruckig.Trajectory(1)
    made = inputs(r)
    states = [State(*row) for row in r.start.tolist()]
    targets = [State(*row) for row in r.target.tolist()]
    limits = [Limits(*row) for row in r.limits.tolist()]
    requests = list(zip(states, targets, limits, strict=True))
    rows = Rows(r)
    reused = ruckig.InputParameter(1)
    plain = [
        ([q], [v], [a], [q1], [v1], [k[0]], [k[1]], [k[2]])
        for (q, v, a), (q1, v1), k in zip(
            r.start.tolist(), r.target.tolist(), r.limits.tolist(), strict=True
        )
    ]

    def ruckig_calculate() -> None:
        for x in made:
            otg.calculate(x, out)

    def ruckig_call_only() -> None:
        for x in made:
            x.validate  # noqa: B018 - an attribute of the same object: what a bare access costs
            otg.reset()

    def ruckig_set_and_calculate() -> None:
        for q, v, a, q1, v1, most_v, most_a, most_j in plain:
            reused.current_position = q
            reused.current_velocity = v
            reused.current_acceleration = a
            reused.target_position = q1
            reused.target_velocity = v1
            reused.max_velocity = most_v
            reused.max_acceleration = most_a
            reused.max_jerk = most_j
            otg.calculate(reused, out)

    def sjerk_plan() -> None:
        for start, target, limit in requests:
            plan(start, target, limit, T)

    cost = {}
    work = {
        "ruckig calculate": ruckig_calculate,
        "bare call": ruckig_call_only,
        "ruckig set and calculate": ruckig_set_and_calculate,
        "sjerk C": rows.run,
        "sjerk plan": sjerk_plan,
    }
    for name in work:  # warm up, then interleave the rounds
        work[name]()
    for _ in range(ROUNDS):
        for name, run in work.items():
            cost[name] = min(cost.get(name, 1.0), best(run, N, 1))
    core = cost["ruckig calculate"] - cost["bare call"]
    for own, their, seconds, goal in (
        ("sjerk C", "ruckig calculate less the call", core, "goal <= 1.2"),
        ("sjerk plan", "ruckig set and calculate", cost["ruckig set and calculate"], "goal <= 2"),
    ):
        report.line(
            TABLE,
            f"{kind:7} {own:16} {cost[own] * 1e9:7.0f} ns / {their:32} {seconds * 1e9:7.0f} ns"
            f" = {cost[own] / seconds:6.3f}  {goal}",
        )


@pytest.mark.parametrize("cores", ["one core", "all cores"])
@pytest.mark.parametrize("kind", check.KINDS)
def test_many_beside_ruckig(report: Report, kind: str, cores: str) -> None:
    """Arrays in, lengths in cycles out: plan_many beside ruckig's loop over the rows."""
    if cores == "all cores":
        os.sched_setaffinity(0, range(os.cpu_count() or 1))  # plan_many uses what there is
    n = 20_000
    r = check.draw(np.random.default_rng(15), n, kind)
    otg, x, out = ruckig.Ruckig(1), ruckig.InputParameter(1), ruckig.Trajectory(1)
    cycles = np.empty(n, dtype=np.int64)

    columns = (*r.start.T, *r.target.T, *r.limits.T[:3])

    def ruckig_over_arrays(part: slice) -> None:
        rows = zip(*(column[part].tolist() for column in columns), strict=True)
        for i, (q, v, a, q1, v1, most_v, most_a, most_j) in enumerate(rows, part.start):
            x.current_position = [q]
            x.current_velocity = [v]
            x.current_acceleration = [a]
            x.target_position = [q1]
            x.target_velocity = [v1]
            x.max_velocity = [most_v]
            x.max_acceleration = [most_a]
            x.max_jerk = [most_j]
            otg.calculate(x, out)
            cycles[i] = out.duration / T

    # so much at once is hardly ever left alone: the best of each part of it
    size = 4000 if cores == "one core" else n
    theirs, owns = np.ones(n // 1000), np.ones(n // size)
    for _ in range(12):
        for k in range(len(theirs)):
            part = slice(1000 * k, 1000 * k + 1000)
            theirs[k] = min(theirs[k], best(lambda part=part: ruckig_over_arrays(part), 1000, 1))
        for k in range(3 * len(owns)):
            rows = slice(size * (k % len(owns)), size * (k % len(owns)) + size)
            given = r.start[rows], r.target[rows], r.limits[rows]
            took = best(lambda given=given: plan_many(*given, T), size, 1)
            owns[k % len(owns)] = min(owns[k % len(owns)], took)
    own, their = float(owns.mean()), float(theirs.mean())
    report.line(
        TABLE,
        f"{kind:7} plan_many, {size} rows, {cores} {own * 1e9:7.0f} ns / ruckig's loop over them "
        f"{their * 1e9:7.0f} ns = {own / their:6.3f}  goal <= 0.08 on one core",
    )


@pytest.mark.parametrize("kind", check.KINDS)
def test_seven_axes_beside_ruckig(report: Report, kind: str) -> None:
    """plan() of seven axes with time synchronisation beside ruckig's set and calculate."""
    motions = 50
    r = check.draw(np.random.default_rng(12), 7 * motions, kind)
    otg, x, out = ruckig.Ruckig(7), ruckig.InputParameter(7), ruckig.Trajectory(7)
    requests, plain = [], []
    for m in range(motions):
        rows = slice(7 * m, 7 * m + 7)
        start, target, limits = r.start[rows], r.target[rows], r.limits[rows]
        requests.append(
            (
                [State(*row) for row in start.tolist()],
                [State(*row) for row in target.tolist()],
                [Limits(*row) for row in limits.tolist()],
            )
        )
        columns = (*start.T, *target.T, *limits.T[:3])
        plain.append([column.tolist() for column in columns])

    def ruckig_set_and_calculate() -> None:
        for q, v, a, q1, v1, most_v, most_a, most_j in plain:
            x.current_position = q
            x.current_velocity = v
            x.current_acceleration = a
            x.target_position = q1
            x.target_velocity = v1
            x.max_velocity = most_v
            x.max_acceleration = most_a
            x.max_jerk = most_j
            otg.calculate(x, out)

    def sjerk_plan() -> None:
        for starts, targets, limits in requests:
            plan(starts, targets, limits, T)

    own = their = 1.0
    for _ in range(ROUNDS):
        their = min(their, best(ruckig_set_and_calculate, motions, 1))
        own = min(own, best(sjerk_plan, motions, 1))
    report.line(
        TABLE,
        f"{kind:7} plan, 7 axes, time {own * 1e9:7.0f} ns / ruckig set and calculate, 7 axes "
        f"{their * 1e9:7.0f} ns = {own / their:6.3f}  goal <= 1",
    )


@pytest.mark.parametrize("kind", check.KINDS)
def test_worst_case(report: Report, kind: str) -> None:
    """The slowest of random plans over their median; minimum of repeats per input."""
    r = check.draw(np.random.default_rng(13), N, kind)
    ns = np.full(N, np.inf)
    inner = 10  # the same plan so often in one measurement: the call from Python hardly counts
    tiled = [Rows(r.only([i] * inner)) for i in range(N)]
    clock = time.perf_counter_ns
    for _ in range(20):
        for i, row in enumerate(tiled):
            start = clock()
            row.run()
            ns[i] = min(ns[i], (clock() - start) / inner)
    empty = min(_empty(clock) for _ in range(1000)) / inner
    ns -= empty
    report.line(
        "planning, worst case over the median (minimum of 20 repeats per input, call taken off)",
        f"{kind:7} median {np.median(ns):7.0f} ns  worst {ns.max():7.0f} ns = "
        f"{ns.max() / np.median(ns):6.2f}  goal <= 5",
    )


def _empty(clock: Callable[[], int]) -> int:
    """Cost of the measured call without a plan in it."""
    rows = _EMPTY
    start = clock()
    rows.run(0, 0)
    return clock() - start


_EMPTY = Rows(check.draw(np.random.default_rng(1), 1, "rest"))


@pytest.mark.parametrize("kind", check.KINDS)
def test_durations_over_the_optimum(report: Report, kind: str) -> None:
    """Whole cycles over ruckig's continuous optimum, 20 000 states, 1 ms."""
    r = check.draw(np.random.default_rng(14), 20_000, kind)
    plans = plan_many(r.start, r.target, r.limits, T)
    otg, out = ruckig.Ruckig(1), ruckig.Trajectory(1)
    optimum = []
    for x in inputs(r):
        otg.calculate(x, out)
        optimum.append(out.duration / T)
    extra = plans.cycles - np.array(optimum)
    slow = np.mean(plans.cycles > 1.05 * np.array(optimum) + 8)
    report.line(
        "planning, cycles over ruckig's continuous optimum at 1 ms",
        f"{kind:7} median {np.median(extra):5.2f}  p99 {np.percentile(extra, 99):5.2f}  longer than"
        f" 1.05 x + 8: {slow:.3%}   goals: "
        + {"rest": "1.5, 3.5", "start": "2, 5", "target": "2, -, 1 %"}[kind],
    )
    assert extra.min() > -1e-3
