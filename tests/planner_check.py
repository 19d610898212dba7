"""Random planning requests and an independent judge of the plans, vectorised over many.

Written from the notation only (Eqs. 1-6, the half-cycle lemma): the judge shares no code with
the planner. Everything is in seconds and axis units until `judge` turns to cycles.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sjerk._binding import ffi, lib
from sjerk.planning import Plans

Array = NDArray[np.float64]
WITHIN = 1.0 + 1e-9
UNITS = {"radians": 1.0, "millimetres": 1e3, "increments": 2**24 / (2 * np.pi)}
KINDS = ("rest", "start", "target")


@dataclass
class Requests:
    """n requests: rows (position, velocity, acceleration), (position, velocity), limits (n, 5)."""

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


def in_cycles(r: Requests, T: float) -> tuple[Array, Array, Array, Array, Array, Array]:
    """h, V0, A0, v1 of the continuous motion, limits per cycle, direction of the move."""
    q, v, a = r.start[:, 0], r.start[:, 1] * T, r.start[:, 2] * T**2
    v1 = r.target[:, 1] * T
    P0, V0, A0 = q + v / 2 - a / 12, v + a / 2, a
    h = (r.target[:, 0] - q) - v1 / 2 - (P0 - q)
    limits = r.limits * np.array([T, T**2, T**3, T**2, T**3])
    way = np.where(h != 0, h, np.where(v1 != 0, v1, np.where(V0 != 0, V0, A0)))
    return h, V0, A0, v1, limits, np.where(way < 0, -1.0, 1.0)


def judge(r: Requests, plans: Plans, T: float) -> dict[str, Array]:
    """Largest use of each limit per plan (1 = at the limit), and how far the ends are off.

    Velocity and acceleration at every node and, for the velocity, at zeros of the acceleration
    inside phases. `position`, `velocity`: what is missing at the end, relative to way and limit.
    """
    h, V, A, v1, limits, d = in_cycles(r, T)
    n = len(h)
    vmax, acc, jacc, dec, jdec = limits.T
    P, V, A = np.zeros(n), V.copy(), A.copy()
    worst = {name: np.zeros(n) for name in ("v", "a", "j")}
    path = np.abs(h).copy()
    total = np.zeros(n, dtype=np.int64)
    phases = plans.raw["phase"]
    for k in range(int(plans.phase_counts.max(initial=0))):
        used = plans.phase_counts > k
        cycles = np.where(used, phases["cycles"][:, k], 0)
        J = np.where(used, phases["jerk"][:, k], 0.0)
        total += cycles
        N = cycles.astype(np.float64)
        A1 = A + N * J
        A1 = np.where(np.abs(A1) <= 1e-13 * np.abs(N * J), 0.0, A1)
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
        worst["v"] = np.maximum(worst["v"], np.maximum(np.abs(peak), np.abs(V1)) / vmax)
        path += N * np.maximum(np.abs(V), np.abs(V1))
        V, A = V1, A1
    assert np.array_equal(total, plans.cycles)
    worst["velocity"] = np.abs(V - v1) / vmax
    worst["acceleration"] = np.abs(A) / np.minimum(acc, dec)
    worst["position"] = np.abs(P - h) / np.maximum(path, 1e-300)
    return worst


def lands(r: Requests, plans: Plans, T: float) -> Array:
    """What the interpolator has to spread per plan, in units in the last place of the way.

    Takes every plan over by the C interpolator (exact sums): refusal would mean a miss. The last
    sample is then the goal bit for bit.
    """
    ip, state = ffi.new("sj_interpolator *"), ffi.new("sj_state *")
    made = ffi.cast("sj_plan *", ffi.from_buffer(plans.raw))
    spread = np.zeros(len(r))
    start, load = lib.sj_interpolator_start, lib.sj_interpolator_load
    for i, ((q, v, a), (q1, v1)) in enumerate(
        zip(r.start.tolist(), r.target.tolist(), strict=True)
    ):
        state.position, state.velocity, state.acceleration = q, v * T, a * T * T
        start(ip, state)
        status = load(ip, made + i, q1, v1 * T, 0)
        assert status == lib.SJ_LOAD_OK, (i, status, r.start[i], r.target[i], r.limits[i])
        spread[i] = ip.spread_q.hi * ip.ahead
    return spread
