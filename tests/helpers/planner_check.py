"""Random planning requests and an independent judge of the plans, vectorised over many.

Written from the notation only (Eqs. 1-6, the half-cycle lemma): the judge shares no code with
the planner. Everything is in seconds and axis units until `judge` turns to cycles.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sjerk._binding import dtype_of, ffi, lib
from sjerk.planner import Plans

Array = NDArray[np.float64]
#: The memory of an `sj_plan`.
PLAN = dtype_of("sj_plan")
WITHIN = 1.0 + 1e-9
COARSE = "coarse"
#: Scale of each unit to radians. In the coarse one a cycle is long: one cycle of jerk is 0.01 to
#: 1000 times all acceleration, one of acceleration up to 30 times the velocity; most states lie at
#: their limits.
UNITS = {"radians": 1.0, "millimetres": 1e3, "increments": 2**24 / (2 * np.pi), COARSE: 1.0}
#: Crossings of zero that are followed, each nearly six times nearer to the verdict.
TURNS = 40
KINDS = ("rest", "start", "target")


@dataclass
class Requests:
    """n requests: rows (position, velocity, acceleration), limits (n, 5); most targets have two."""

    start: Array
    target: Array
    limits: Array

    def __len__(self) -> int:
        return len(self.start)

    def only(self, chosen: Any) -> Requests:
        return Requests(self.start[chosen], self.target[chosen], self.limits[chosen])


def draw(
    rng: np.random.Generator,
    n: int,
    kind: str,
    *,
    scale: float = 1.0,
    asymmetric: bool = False,
    T: float = 1e-3,
) -> Requests:
    """At least n requests drawn as in the planner's prototypes, starts inside their limits."""
    parts: list[Requests] = []
    while sum(map(len, parts)) < n:
        m = n + 100
        v, a, j = (10.0 ** rng.uniform(*low_high, m) for low_high in ((-1, 1), (0, 1.5), (1, 3)))
        limits = np.column_stack([v, a, j, a, j])
        if asymmetric:
            limits[:, 3:] *= 10.0 ** rng.uniform(-0.7, 0.7, (m, 2))
        start = np.zeros((m, 3))
        target = np.zeros((m, 2))
        start[:, 0] = rng.normal(size=m) * 10.0 ** rng.uniform(-3, 1, m)
        target[:, 0] = start[:, 0] + rng.normal(size=m) * 10.0 ** rng.uniform(-3, 1, m)
        if kind != "rest":
            least = np.minimum(limits[:, 1], limits[:, 3])
            start[:, 1] = rng.uniform(-1, 1, m) * v
            start[:, 2] = rng.uniform(-1, 1, m) * least
        if kind == "target":
            target[:, 1] = rng.uniform(-1, 1, m) * v
        V = start[:, 1] + start[:, 2] * T / 2  # of the continuous motion
        least_j = np.minimum(limits[:, 2], limits[:, 4])
        carried = V + start[:, 2] * np.abs(start[:, 2]) / (2 * least_j)
        inside = (np.abs(carried) <= 0.999 * v) & (np.abs(V) <= 0.999 * v)
        parts.append(Requests(start * scale, target * scale, limits * scale).only(inside))
    return Requests(
        *(np.concatenate([getattr(p, f) for p in parts])[:n] for f in ("start", "target", "limits"))
    )


def draw_coarse(
    rng: np.random.Generator, n: int, kind: str, *, asymmetric: bool = False, T: float = 1e-3
) -> Requests:
    """Requests where a cycle is coarse; in continuous time the starts can keep their limits."""
    parts: list[Requests] = []
    while sum(map(len, parts)) < n:
        m = n + 100

        def ten(low: float, high: float, m: int = m) -> Array:
            return 10.0 ** rng.uniform(low, high, m)

        v = ten(-3, 6)
        a = v * np.where(rng.uniform(size=m) < 0.3, ten(-4, 1.5), ten(-4, 0))
        limits = np.column_stack([v, a, a * ten(-2, 3), a, a])
        limits[:, 4] = limits[:, 2]
        if asymmetric:
            limits[:, 3:] *= 10.0 ** rng.uniform(-1, 1, (m, 2))
        least_a, least_j = (np.minimum(limits[:, i], limits[:, i + 2]) for i in (1, 2))
        side = rng.choice([-1.0, 1.0], m)
        near = v * (1 - rng.choice([0.0, 1.0], m, p=[0.2, 0.8]) * ten(-8, 0))
        A = side * least_a * rng.choice([0.0, 1.0, np.nan], m, p=[0.2, 0.3, 0.5])
        A = np.where(np.isnan(A), side * least_a * rng.uniform(size=m), A)
        V = np.select(
            [rng.uniform(size=m) < p for p in (0.25, 0.35, 0.6)],
            [rng.uniform(-1, 1, m) * v, side * near, side * near - A * rng.uniform(0.1, 0.6, m)],
            side * near - A * np.abs(A) / (2 * least_j),
        )
        target_v = rng.choice([-1.0, 1.0], m) * np.where(
            rng.uniform(size=m) < 0.5, near, v * rng.uniform(size=m)
        )
        if kind == "rest":
            V, A = np.zeros(m), np.zeros(m)
        start = np.column_stack([rng.normal(size=m) * v, (V - A / 2) / T, A / T**2])
        target = np.column_stack(
            [
                start[:, 0] + rng.choice([-1.0, 1.0], m) * v * ten(-9, 5),
                target_v / T if kind == "target" else np.zeros(m),
            ]
        )
        inside = np.maximum(np.abs(V), np.abs(V + A * np.abs(A) / (2 * least_j))) <= v
        limits = limits / np.array([T, T**2, T**3, T**2, T**3])
        inside &= np.abs(target[:, 1]) <= limits[:, 0]
        parts.append(Requests(start, target, limits).only(inside))
    return Requests(
        *(np.concatenate([getattr(p, f) for p in parts])[:n] for f in ("start", "target", "limits"))
    )


class Turning:
    """What whole cycles can do about an acceleration that carries the velocity to its limit.

    Arrays of states (V, A), in cycles, of motions whose limits lie as in `in_cycles`. The rule and
    its proof: "What whole cycles can keep" in docs/explanation/planner.md.
    """

    def __init__(self, V: Array, A: Array, limits: Array, d: Array) -> None:
        _, acc, jacc, dec, jdec = limits.T
        up = d * A >= 0
        jerk = np.where(up, jacc, jdec)
        self.small = np.minimum(jacc, jdec)
        self.ahead, self.beyond = np.where(up, acc, dec), np.where(up, dec, acc)
        a, v = np.abs(A), np.where(A >= 0, V, -V)
        full = np.floor(a / jerk)
        self.left = a - full * jerk
        self.v = v + full * (a - full * jerk / 2)

    def keeps(self, w: Array) -> NDArray[np.bool_]:
        """Whether legal cycles can keep the velocity within w until the acceleration ends.

        Each crossing is the gentlest that keeps w.
        """
        v, a, beyond, ahead = self.v, self.left, self.beyond, self.ahead
        kept = np.zeros(len(v), dtype=bool)
        lost = np.zeros(len(v), dtype=bool)
        for _ in range(TURNS):
            kept |= ~lost & (v + a / 2 <= w)
            room = np.where(kept | (v >= w), np.inf, w - v)
            j = a * a / (2 * room)
            lost |= ~kept & ((v >= w) | (j > self.small) | (j - a > beyond))
            if (kept | lost).all():
                break
            v, a, beyond, ahead = j / 2 - a - v, j - a, ahead, beyond
        return kept

    def least(self) -> Array:
        """The least velocity limit that at most one crossing keeps, by search."""
        a, v = self.left, self.v
        high = np.minimum(self.small, a + self.beyond)
        crosses = (high > a) & (a > 0)
        low, high = np.where(crosses, a, 1.0), np.where(crosses, high, 1.0)

        def peak(j: Array) -> Array:
            return np.maximum(v + a * a / (2 * j), j - v - 1.5 * a)

        for _ in range(200):
            one, two = low + (high - low) / 3, high - (high - low) / 3
            lower = peak(one) < peak(two)
            low, high = np.where(lower, low, one), np.where(lower, two, high)
        landed = np.abs(v + a / 2)
        return np.where(crosses, np.minimum(peak(low), landed), landed)


def velocity_bound(V: Array, A: Array, limits: Array, d: Array) -> Array:
    """The velocity that a plan from (V, A) may reach: its limit, or the excess none avoids."""
    turning, vmax = Turning(V, A, limits, d), limits[:, 0]
    least = np.maximum(np.maximum(vmax, np.abs(V)), turning.least())
    kept = turning.keeps(vmax * (1 - 1e-9)) & (np.abs(V) <= vmax * (1 + 1e-9))
    return np.where(kept, vmax, least)


def final(r: Requests, T: float) -> Array:
    """The acceleration of each target, in cycles."""
    return r.target[:, 2] * T**2 if r.target.shape[1] > 2 else np.zeros(len(r))


def with_accelerations(rng: np.random.Generator, r: Requests, T: float) -> Requests:
    """The same requests to targets of any velocity and acceleration, some of them not legal."""
    v, a = r.limits[:, 0], np.minimum(r.limits[:, 1], r.limits[:, 3])
    a1 = (
        rng.choice([-1.0, 1.0], len(r))
        * a
        * rng.choice([0.0, 1.0, np.nan], len(r), p=[0.1, 0.2, 0.7])
    )
    a1 = np.where(np.isnan(a1), a * rng.uniform(-1, 1, len(r)), a1)
    v1 = v * rng.uniform(-1, 1, len(r))
    j = np.minimum(r.limits[:, 2], r.limits[:, 4])
    edge = np.sign(a1) * np.minimum(0.0, a1 * a1 / (2 * j) - v)  # it comes from the limit
    v1 = np.where(
        rng.uniform(size=len(r)) < 0.2, edge * (1 - 10.0 ** rng.uniform(-9, 0, len(r))), v1
    )
    return Requests(r.start, np.column_stack([r.target[:, 0], v1 + a1 * T / 2, a1]), r.limits)


def legal(r: Requests, T: float) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Targets that must be planned, and those that must be refused; few are neither, by rounding.

    Time runs backwards too: what leads to (v1, a1) from zero acceleration is what brings the start
    (-v1, a1) there (`Turning`). The direction of the move is that of the request.
    """
    _, _, _, v1, limits, d = in_cycles(r, T)
    a1, v = final(r, T), limits[:, 0]
    turning = Turning(-v1, a1, limits, d)
    jerk = np.where(d * a1 >= 0, limits[:, 2], limits[:, 4])
    before, inside = np.abs(v1 - a1 * np.abs(a1) / (2 * jerk)), np.abs(v1) <= v
    return (
        turning.keeps(v * (1 - 1e-8)) & inside & (before <= v * (1 - 1e-8)),
        (np.abs(v1) > v * (1 + 1e-8)) | (before > v * (1 + 1e-8)) | ~turning.keeps(v * (1 + 1e-8)),
    )


def arrivals(r: Requests, T: float) -> tuple[NDArray[Any], NDArray[np.int32]]:
    """Plans to targets with an acceleration, and how each request was answered."""
    made, plans, (limits, _keep), rows = _rows(r, T)
    answers = np.zeros(len(r), dtype=np.int32)
    for i, (row, a1) in enumerate(zip(rows, final(r, T).tolist(), strict=True)):
        answers[i] = lib.sj_plan_arrival(*row, a1, limits + i, plans + i)
    return made, answers


def arrivals_together(r: Requests, T: float, axes: int, more: int) -> NDArray[Any]:
    """Several axes each to such targets in one length, `more` cycles or longer."""
    made, plans, (limits, _keep), rows = _rows(r, T)
    a1, mode = final(r, T).tolist(), ffi.new("int32_t *")
    for i in range(0, len(rows) // axes * axes, axes):
        mode[0] = lib.SJ_SYNC_TIME
        own = slice(i, i + axes)
        status = lib.sj_plan_arrivals(axes, rows[own], a1[own], limits + i, more, mode, plans + i)
        assert status == lib.SJ_PLAN_OK, (i, status, rows[own], a1[own], r.limits[own])
        (cycles,) = set(made["cycles"][own].tolist())
        assert cycles >= more
    return made


def in_cycles(r: Requests, T: float) -> tuple[Array, Array, Array, Array, Array, Array]:
    """h, V0, A0, v1 of the continuous motion, limits per cycle, direction of the move."""
    q, v, a = r.start[:, 0], r.start[:, 1] * T, r.start[:, 2] * T**2
    v1 = r.target[:, 1] * T
    P0, V0, A0 = q + v / 2 - a / 12, v + a / 2, a
    a1 = final(r, T)
    h = (r.target[:, 0] - q) - v1 / 2 - a1 / 12 - (P0 - q)
    v1 = v1 - a1 / 2
    limits = r.limits * np.array([T, T**2, T**3, T**2, T**3])
    way = np.where(h != 0, h, np.where(v1 != 0, v1, np.where(V0 != 0, V0, A0)))
    return h, V0, A0, v1, limits, np.where(way < 0, -1.0, 1.0)


def added(x: Array, y: Array) -> tuple[Array, Array]:
    """The sum and what rounding takes from it (Knuth): long cruises multiply what is left of A."""
    total = x + y
    part = total - x
    return total, (x - (total - part)) + (y - part)


def lost_in_product(x: Array, y: Array) -> Array:
    """What rounding takes from x * y (Dekker)."""

    def split(z: Array) -> tuple[Array, Array]:
        big = 134217729.0 * z
        high = big - (big - z)
        return high, z - high

    (a, b), (c, d) = split(x), split(y)
    lost: Array = ((a * c - x * y) + a * d + b * c) + b * d
    return lost


def whole(r: Requests, plans: Plans, T: float) -> NDArray[Any]:
    """The plans of ``plan_many`` as the C planner makes them, a row of `PLAN` each."""
    made = np.zeros(len(r), dtype=PLAN)
    for name in ("cycles", "count", "kind"):
        made[name] = plans.rows[name]
    limits = in_cycles(r, T)[4]
    made["velocity"], made["acceleration"] = limits[:, 0], np.maximum(limits[:, 1], limits[:, 3])
    for k in range(int(made["count"].max(initial=0))):
        used = made["count"] > k
        made["phase"][used, k] = plans.pool[plans.rows["first"][used] + k]
    return made


def judge(r: Requests, made: NDArray[Any], T: float, *, change: bool = False) -> dict[str, Array]:
    """Largest use of each limit per plan (1 = at the limit), and how far the ends are off.

    The velocity is held against `velocity_bound`: the limit, of a start that can keep it.
    Velocity and acceleration at every node; the velocity also where the acceleration is zero inside
    phases.
    `position`, `velocity`: what is missing at the end, relative to way and limit.
    `change`: plans of a change of velocity, which end where they do.
    """
    h, V, A, v1, limits, d = in_cycles(r, T)
    if change:
        d = np.where(np.where(v1 != 0, v1, np.where(V != 0, V, A)) < 0, -1.0, 1.0)
    n = len(h)
    vmax, acc, jacc, dec, jdec = limits.T
    P, V, A, A_low = np.zeros(n), V.copy(), A.copy(), np.zeros(n)
    worst = {name: np.zeros(n) for name in ("v", "a", "j")}
    path = np.abs(h).copy()
    bound = velocity_bound(V, A, limits, d)
    total = np.zeros(n, dtype=np.int64)
    phases = made["phase"]
    for k in range(int(made["count"].max(initial=0))):
        used = made["count"] > k
        cycles = np.where(used, phases["cycles"][:, k], 0)
        J = np.where(used, phases["jerk"][:, k], 0.0)
        total += cycles
        N = cycles.astype(np.float64)
        A1, lost = added(A, N * J)
        A_low = A_low + lost + lost_in_product(N, J)
        A1, A_low = added(A1, A_low)
        crossing = used & (A * A1 < 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            peak = np.where(crossing, V - A * A / (2 * J), V)
        V1 = V + N * (A + A1) / 2
        P = P + N * V + N * N * (2 * A + A1) / 6
        tiny = 1e-12 * np.maximum(acc, dec)
        up = (d * A > tiny) | (d * A1 > tiny)
        down = (d * A < -tiny) | (d * A1 < -tiny)
        most_j = np.where(up & down, np.minimum(jacc, jdec), np.where(down, jdec, jacc))
        # a phase that crosses zero on a cycle boundary may use each side's own jerk only if it has
        # one jerk, which then must keep both
        worst["j"] = np.maximum(worst["j"], np.where(used, np.abs(J) / most_j, 0.0))
        worst["a"] = np.maximum(
            worst["a"], np.where(d * A1 > 0, np.abs(A1) / acc, np.abs(A1) / dec)
        )
        worst["v"] = np.maximum(worst["v"], np.maximum(np.abs(peak), np.abs(V1)) / bound)
        path += N * np.maximum(np.abs(V), np.abs(V1))
        V, A = V1, A1
    assert np.array_equal(total, made["cycles"])
    worst["velocity"] = np.abs(V - v1) / vmax
    worst["acceleration"] = np.abs(A - final(r, T)) / np.minimum(acc, dec)
    if not change:
        worst["position"] = np.abs(P - h) / np.maximum(path, 1e-300)
    return worst


def _rows(r: Requests, T: float) -> tuple[NDArray[Any], Any, Any, list[list[float]]]:
    """Room for plans, the C view of it and of the limits, and the requests in cycles."""
    h, V, A, v1, limits, _ = in_cycles(r, T)
    made = np.zeros(len(h), dtype=PLAN)
    limits = np.ascontiguousarray(limits)
    rows = np.column_stack([h, V, A, v1]).tolist()
    return (
        made,
        ffi.cast("sj_plan *", ffi.from_buffer(made)),
        (ffi.cast("sj_limits *", ffi.from_buffer(limits)), limits),
        rows,
    )


def changes(r: Requests, T: float) -> NDArray[Any]:
    """Plans of changes of velocity from the states behind the requests."""
    made, plans, (limits, _keep), rows = _rows(r, T)
    for i, (_, v, a, v1) in enumerate(rows):
        status = lib.sj_plan_velocity(v, a, v1, limits + i, plans + i)
        assert status == lib.SJ_PLAN_OK, (i, status, r.start[i], r.target[i], r.limits[i])
    return made


def stretched(r: Requests, T: float, more: Array, times: Array) -> NDArray[Any]:
    """Plans `times` as long as the shortest and `more` cycles, or of the next length that works
    where the target moves.
    """
    made, plans, (limits, _keep), rows = _rows(r, T)
    for i, row in enumerate(rows):
        assert lib.sj_plan_move(*row, limits + i, plans + i) == lib.SJ_PLAN_OK
        length = int(more[i] + times[i] * made["cycles"][i])
        status = lib.sj_plan_duration(*row, limits + i, length, plans + i)
        blocked = status == lib.SJ_PLAN_BLOCKED and row[3] != 0.0
        assert status == lib.SJ_PLAN_OK or blocked, (i, status, row, r.limits[i])
        cycles = int(made["cycles"][i])
        assert cycles > length if blocked else cycles == length
    return made


def together(r: Requests, T: float, axes: int) -> NDArray[Any]:
    """Plans of several axes each, of one length."""
    made, plans, (limits, _keep), rows = _rows(r, T)
    for i in range(0, len(rows), axes):
        status = lib.sj_plan_together(axes, rows[i : i + axes], limits + i, 0, plans + i)
        assert status == lib.SJ_PLAN_OK, (i, status, rows[i : i + axes])
        assert len(set(made["cycles"][i : i + axes].tolist())) == 1
    return made


def velocities(r: Requests, T: float, axes: int) -> NDArray[Any]:
    """Changes of velocity of several axes each, done in the same cycle as the slowest."""
    made, plans, (limits, _keep), rows = _rows(r, T)
    alone, mode = changes(r, T), ffi.new("int32_t *")
    for i in range(0, len(rows), axes):
        mode[0] = lib.SJ_SYNC_TIME
        asked = [[0.0, *row[1:]] for row in rows[i : i + axes]]
        status = lib.sj_plan_velocities(axes, asked, limits + i, mode, plans + i)
        assert status == lib.SJ_PLAN_OK, (i, status, asked)
        assert set(made["cycles"][i : i + axes]) == {alone["cycles"][i : i + axes].max()}
    return made


def lands(r: Requests, made: NDArray[Any], T: float) -> Array:
    """What the interpolator has to spread per plan, in units in the last place of the way.

    Takes every plan over by the C interpolator (exact sums): refusal would mean a miss. The last
    sample is then the goal bit for bit.
    """
    ip, state = ffi.new("sj_interpolator *"), ffi.new("sj_state *")
    plans = ffi.cast("sj_plan *", ffi.from_buffer(made))
    spread = np.zeros(len(r))
    goal = ffi.new("sj_state *")
    start, load = lib.sj_interpolator_start, lib.sj_interpolator_load_to
    for i, ((q, v, a), (q1, v1, *more)) in enumerate(
        zip(r.start.tolist(), r.target.tolist(), strict=True)
    ):
        goal.position, goal.velocity = q1, v1 * T
        goal.acceleration = more[0] * T * T if more else 0.0
        state.position, state.velocity, state.acceleration = q, v * T, a * T * T
        start(ip, state)
        status = load(ip, plans + i, goal, 0)
        assert status == lib.SJ_LOAD_OK, (i, status, r.start[i], r.target[i], r.limits[i])
        spread[i] = ip.spread_q.hi * ip.cycles_left
    return spread
