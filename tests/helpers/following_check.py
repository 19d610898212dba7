"""Judges of followed trajectories that share no code with what they judge.

`recording_keeps` looks at the recorded positions only; `rationals` integrates the jerks with the
paper's equations over fractions; `dense` is the spline by one full linear system; `commanded_at`
tells positions between the samples from the segments.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from helpers.exact import Sample, continuous
from sjerk import Limits, Trajectory
from sjerk.trajectory.segments import Followed

Array = NDArray[np.float64]
T = 1e-3
#: Franka's limits of the Panda: rad/s, rad/s^2, rad/s^3.
PANDA = [
    Limits(v, a, 500.0)
    for v, a in zip(
        [2.175] * 4 + [2.61] * 3, [3.75, 1.875, 2.5, 3.125, 3.75, 5.0, 5.0], strict=True
    )
]


def recording(blocks: Sequence[Followed]) -> tuple[Array, Array]:
    """Positions of all cycles, and the cycles of the way-points."""
    position = np.concatenate([block.sample().position for block in blocks])
    return position, np.concatenate([[0], np.cumsum(np.concatenate([b.cycles for b in blocks]))])


def recording_keeps(position: Array, limits: Sequence[Limits], cycle_time: float = T) -> None:
    """Differences of the recorded positions: each is a mean of v, a or j over few cycles."""
    rest = np.repeat(position[:1], 3, axis=0), np.repeat(position[-1:], 3, axis=0)
    whole = np.concatenate([rest[0], position, rest[1]])
    noise = 8 * np.finfo(float).eps * np.abs(whole).max()
    for order, name in enumerate(("velocity", "acceleration", "jerk"), start=1):
        most = np.abs(np.diff(whole, order, axis=0)).max(axis=0)
        for joint, limit in enumerate(limits):
            allowed = getattr(limit, name) * cycle_time**order
            assert most[joint] <= allowed * (1 + 1e-9) + noise * 2**order, (name, joint)


def phases(blocks: Sequence[Followed], joint: int) -> list[tuple[int, Fraction]]:
    """Every phase of one joint in cycle units."""
    return [
        (int(n), Fraction(float(block.jerk[i, p, joint])) * Fraction(block.cycle_time) ** 3)
        for block in blocks
        for i in range(len(block))
        for p, n in enumerate(block.lengths[i])
        if n
    ]


def rationals(blocks: Sequence[Followed], way: Array, limit: Limits, joint: int) -> None:
    """The jerks alone, from rest, over fractions: way-points met, limits kept, rest at the end."""
    cycle_time = Fraction(blocks[0].cycle_time)
    at = Sample(Fraction(float(way[0, joint])), Fraction(0), Fraction(0))
    P, V, A = at.plan()
    row = phases(blocks, joint)
    peaks = continuous(P, V, A, [(Fraction(n), jerk) for n, jerk in row])
    within = 1 + 1e-9
    for (_, jerk), node in zip(row, peaks, strict=True):
        assert abs(jerk) <= limit.jerk * float(cycle_time) ** 3 * within
        assert abs(node.A) <= limit.acceleration * float(cycle_time) ** 2 * within
        assert node.V_peak <= limit.velocity * float(cycle_time) * within
    ends = np.cumsum(np.concatenate([block.cycles for block in blocks])).tolist()
    cycle, point = 0, 1
    for n, jerk in row:
        for _ in range(n):
            at = at.step(jerk)
            cycle += 1
            if cycle == ends[point - 1]:
                assert abs(float(at.q - Fraction(float(way[point, joint])))) <= 1e-9
                point += 1
    assert point == len(way)
    end = at.step(Fraction(0))
    assert abs(float(end.q - Fraction(float(way[-1, joint])))) <= 1e-9
    assert abs(float(end.v)) <= 1e-12 * limit.velocity
    assert abs(float(end.a)) <= 1e-12 * limit.acceleration


def dense(cycles: Sequence[int], q: Array) -> tuple[list[int], Array]:
    """The spline from rest to rest through q (n + 1,), by one full system: phases and jerks."""
    n = len(cycles)
    lengths: list[int] = []
    ends = []
    for i, N in enumerate(cycles):
        if n == 1:
            m = max(1, int((N - 1) / 4 + 0.5))
            m = 1 if 2 * m + 1 > N - 1 else m
            lengths += [m, N - 1 - 2 * m, m]
        elif i == 0:
            lengths += [N // 2, N - N // 2]
        elif i == n - 1:
            lengths += [(N - 1) // 2, (N - 1) - (N - 1) // 2]
        else:
            lengths += [N]
        ends.append(len(lengths))
    free = len(lengths)
    rows, right = [], []
    P, V, A = np.zeros(free), np.zeros(free), np.zeros(free)
    done = 0
    for p, m in enumerate(lengths):
        J = np.eye(free)[p]
        P, V, A = P + m * V + m * m / 2 * A + m**3 / 6 * J, V + m * A + m * m / 2 * J, A + m * J
        if p + 1 == ends[done]:
            done += 1
            if done < n:
                rows.append(P - V / 2 + A / 3 - J / 8)
                right.append(q[done] - q[0])
    rows += [P, V, A]
    right += [q[n] - q[0], 0.0, 0.0]
    return lengths, np.linalg.solve(np.array(rows), np.array(right))


def excess(lengths: Sequence[int], jerk: Array, most: Sequence[float]) -> float:
    """Largest use of a limit (velocity, acceleration, jerk per cycle) along phases from rest."""
    V = A = 0.0
    worst = 0.0
    for m, J in zip(lengths, jerk.tolist(), strict=True):
        peak = abs(V - A * A / (2 * J)) if J and 0 < -A / J < m else 0.0
        V, A = V + m * A + m * m / 2 * J, A + m * J
        worst = max(worst, abs(J) / most[2], abs(A) / most[1], max(abs(V), peak) / most[0])
    return worst


def commanded_at(blocks: Sequence[Followed], moments: Array) -> Array:
    """Commanded positions (k, N) at moments in cycles, between the samples too.

    q(s) = P(s - 1/2) + 5/24 A(s - 1/2) of the continuous motion, from the segments' own data.
    """
    T_s = blocks[0].cycle_time
    begins, states = [], []
    for block in blocks:
        cycle = block.first_cycle
        for i in range(len(block)):
            V, A = block.velocity[i] * T_s, block.acceleration[i] * T_s**2
            P = block.position[i] + V / 2 - A / 3 + block.last_jerk[i] * (T_s**3 / 8)
            for n, jerk in zip(block.lengths[i].tolist(), block.jerk[i] * T_s**3, strict=True):
                if n:
                    begins.append(cycle)
                    states.append((P, V, A, jerk))
                    P = P + n * (V + n * (A / 2 + n * jerk / 6))
                    V, A = V + n * (A + n * jerk / 2), A + n * jerk
                    cycle += n
    rows = []
    for moment in moments.tolist():
        if moment < 0.5:
            rows.append(blocks[0].position[0])
            continue
        k = max(0, int(np.searchsorted(begins, moment - 0.5, side="right")) - 1)
        (P, V, A, jerk), x = states[k], moment - 0.5 - begins[k]
        rows.append(P + x * (V + x * (A / 2 + x * jerk / 6)) + 5 / 24 * (A + x * jerk))
    return np.array(rows)


def toppra_plan(period: float, seed: int = 0, points: int = 5) -> Trajectory:
    """A TOPP-RA plan of the seven Panda joints through random postures, sampled at a period."""
    import toppra
    from toppra.algorithm import TOPPRA
    from toppra.constraint import JointAccelerationConstraint, JointVelocityConstraint

    rng = np.random.default_rng(seed)
    postures = np.cumsum(rng.uniform(-0.8, 0.8, (points, 7)), axis=0)
    path: Any = toppra.SplineInterpolator(np.linspace(0.0, 1.0, points), postures)
    v = np.array([limit.velocity for limit in PANDA])
    a = np.array([limit.acceleration for limit in PANDA])
    limits = [
        JointVelocityConstraint(np.column_stack([-v, v])),
        JointAccelerationConstraint(np.column_stack([-a, a])),
    ]
    plan = TOPPRA(limits, path).compute_trajectory(0.0, 0.0)
    time = np.append(np.arange(0.0, plan.duration - period / 2, period), plan.duration)
    velocity = plan(time, 1)
    velocity[0] = velocity[-1] = 0.0
    return Trajectory([f"panda_joint{i}" for i in range(1, 8)], time, plan(time), velocity)


#: Ways of one joint that reverse, repeat and coincide.
SHAPES = {
    "reverse": [0.0, 0.5, 0.0, 0.5, 0.0],
    "repeat": [0.0, 0.3, 0.3, 0.3, 0.6],
    "coincide": [0.0, 0.4, 0.0, 0.4, 0.0, 0.0],
    "nowhere": [0.2, 0.2],
    "one move": [0.0, 1.0],
    "two": [0.0, 1.0, -1.0],
}


def wave(n: int, period: float, joints: int = 7, amplitude: float = 0.25) -> Trajectory:
    """A smooth motion from rest to rest, well inside the limits."""
    t = np.arange(n) * period
    ease = np.sin(np.pi * np.arange(n) / (n - 1)) ** 4
    q = np.column_stack(
        [amplitude * np.sin(2.0 * np.pi * (0.2 + 0.02 * k) * t + k) for k in range(joints)]
    )
    return Trajectory([f"j{k}" for k in range(joints)], t, q * ease[:, None])
