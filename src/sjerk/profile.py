"""The planner, to be read next to the paper: profiles, and Eqs. (1)-(14).

``scurve`` is the paper's closed form with whole-cycle intervals, in its symbols; a ``Profile`` is
what it returns: Eqs. (1)-(6) as a function of time, and the samples of Eqs. (15)-(17) from the C
interpolator. Unit-free in position: u stands for the unit of the axis; time is in seconds.

This module is the front of what planning is asked with and answered by: ``Limits`` and ``State``
come from ``sjerk.limits``, ``Phase``, ``Samples``, ``Range`` and ``Extrema`` from
``sjerk.phases``. Never here: clocks, shared memory, drives.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import product
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sjerk._binding import lib
from sjerk.errors import InfeasibleError, InputError, positive, real
from sjerk.limits import Limits, State, behind
from sjerk.phases import COLUMNS, CYCLES_MAX, Extrema, FloatArray, Phase, Plan, Range, Samples

__all__ = [
    "CYCLES_MAX",
    "Extrema",
    "FloatArray",
    "Limits",
    "Phase",
    "Profile",
    "Range",
    "Samples",
    "State",
    "scurve",
]

ROUNDING_SLACK = 1e-11  # relative, of whole cycles: 0.1 / 0.001 is 100 of them, not 101


class Profile(Plan):
    """A planned motion of one axis in whole control cycles. Immutable.

    ``start`` and ``end`` are the samples that the drive gets before and after the motion:
    ``sample()`` begins with the one and settles on the other, bit for bit. The plan ``at(t)`` is
    the continuous motion behind the samples; they show it about half a cycle late
    (``docs/architecture.md``). Made by ``scurve``, ``plan`` and ``plan_velocity``, or of phases.

    Raises ``InputError`` for lengths that are no cycles, for jerks that are no numbers and for
    states that are no ``State``.

    >>> rise = Profile([Phase(100, 5000.0)], 1e-3, State(0.0), State(0.8, 25.0, 500.0))
    >>> rise.cycles, rise.duration
    (100, 0.1)
    """

    # The fast path leaves the nodes until they are asked for.
    __slots__ = ("_nodes",)

    _nodes: tuple[FloatArray, ...]

    @property
    def leaves_range(self) -> bool:
        """Whether the plan leaves ``position_range`` between its start and its end."""
        return bool((limits := self.position_range) and self.extrema().leaves(*limits))

    @property
    def retracts(self) -> bool:
        """Whether the velocity turns on the way: the axis swings back, or first goes the other way.

        So it is where the start is too fast to stop before the target, or moves away from it.

        >>> from sjerk import plan
        >>> plan(State(0.0, 90.0), 5.0, Limits(90.0, 500.0, 5000.0), 1e-3).retracts
        True
        """
        return self.extrema().turns

    def _all_nodes(self) -> tuple[FloatArray, ...]:
        """Time, P, V, A at the start of every phase and at the end, and the jerk from there on."""
        if hasattr(self, "_nodes"):
            return self._nodes
        T_s = self._cycle_time
        P, V, A = behind(self._start, T_s)
        done = 0
        nodes = [(0.0, P, V, A)]
        for phase in self.phases:
            t = phase.cycles * T_s
            # Eqs. (6), (4), (2) at the end of the interval
            P += V * t + A * t**2 / 2.0 + phase.jerk * t**3 / 6.0
            V += A * t + phase.jerk * t**2 / 2.0
            A += phase.jerk * t
            done += phase.cycles
            nodes.append((done * T_s, P, V, A))
        end = behind(self._end, -T_s)
        if abs(end[0] - P) <= 1e-6 * max(abs(node[1]) for node in nodes):
            nodes[-1] = (done * T_s, *end)  # it leads there: as asked, without rounding
        jerks = np.array([*(phase.jerk for phase in self.phases), 0.0])
        time, position, velocity, acceleration = np.array(nodes).T.copy()
        self._nodes = (time, position, velocity, acceleration, jerks)
        return self._nodes

    def at(self, t: ArrayLike) -> Samples:
        """Return the planned motion at time ``t`` in closed form, Eqs. (1)-(6).

        ``t`` in seconds from the start, scalar or array; before 0 the motion is that of 0 at its
        velocity, from ``duration`` on exactly that of ``end``, without jerk. Fields have the shape
        of ``t``, in u, u/s, u/s^2 and u/s^3.

        >>> profile = scurve(160.0, Limits(90.0, 500.0, 5000.0), 1e-3)
        >>> round(float(profile.at(profile.duration / 2).velocity), 9) <= 90.0
        True
        """
        time = np.asarray(t, dtype=np.float64)
        starts, P, V, A, J = self._all_nodes()
        clipped = np.maximum(time, 0.0)
        i = np.clip(np.searchsorted(starts, clipped, side="right") - 1, 0, len(starts) - 1)
        dt = clipped - starts[i]
        jerk = np.where((time < 0.0) | (time >= starts[-1]), 0.0, J[i])  # Eq. (1)
        acceleration = A[i] + J[i] * dt  # Eq. (2)
        velocity = V[i] + dt * (A[i] + dt * J[i] / 2.0)  # Eq. (3)
        position = P[i] + dt * (V[i] + dt * (A[i] / 2.0 + dt * J[i] / 6.0))  # Eq. (5)
        position = position + velocity * (time - clipped)
        return Samples(time, position, velocity, acceleration, jerk)

    def sample(self, out: Samples | None = None) -> Samples:
        """Return what the drive gets, cycle by cycle, Eqs. (15)-(17): N + 2 rows.

        Row 0 is ``start``, row N + 1 the settled ``end``, equal to the goal bit for bit. ``out``:
        arrays to fill, for use without allocation. Raises ``InputError`` where they are not
        float64, contiguous and exactly N + 2 long.

        >>> samples = scurve(160.0, Limits(90.0, 500.0, 5000.0), 1e-3).sample()
        >>> float(samples.position[-1]), float(samples.velocity[-1])
        (160.0, 0.0)
        """
        rows = self.cycles + 2
        if out is None:
            out = Samples.empty(rows)
        elif not isinstance(out, Samples):
            raise InputError("out", type(out).__name__, "must be a Samples")
        elif len({id(getattr(out, name)) for name in COLUMNS}) < len(COLUMNS):
            raise InputError("out", "one array for two columns", "must be five arrays")
        self.fill(out, rows)
        return out

    def state(self, cycle: int) -> State:
        """Return the state in which the motion can be left after ``cycle`` cycles, 0 or more.

        Row 1 of a plan from it follows row ``cycle`` of ``sample()`` by Eqs. (15)-(17). A ``State``
        has no jerk: by the half-cycle lemma it is the sample without jerk behind which the same
        motion lies, a + T j / 2, v - T^2 j / 4, q + T^3 j / 8. Raises ``InputError``.

        >>> scurve(160.0, Limits(90.0, 500.0, 5000.0), 1e-3).state(1000).velocity
        89.98875140607424
        """
        if isinstance(cycle, bool) or not isinstance(cycle, int) or cycle < 0:
            raise InputError("cycle", cycle, "must be an int, at least 0")
        T, end, after = self._cycle_time, self._end, (cycle - self.cycles - 1) * self._cycle_time
        v, a = end.velocity, end.acceleration
        if cycle >= self.cycles:
            return State(end.position + after * (v + after * a / 2.0), v + after * a, a)
        rows = Samples.empty(cycle + 1)
        self.fill(rows, cycle + 1)
        q, v, a, j = (float(getattr(rows, name)[-1]) for name in COLUMNS[1:])
        return State(q + j * T**3 / 8.0, v - j * T**2 / 4.0, a + j * T / 2.0)

    def fill(self, out: Samples, rows: int) -> None:
        """Fill the arrays of ``out`` with ``rows`` samples; any number of rows.

        From row N + 1 on the motion goes on as its end, without jerk. Raises ``InputError``
        for arrays that are not float64 of shape (rows,), contiguous and writeable.
        """
        table = out.table(rows)
        ends = self._start.memory, self._end.memory
        if lib.sj_sample(self.c_plan, *ends, self._cycle_time, table) != lib.SJ_LOAD_OK:
            raise InputError("phases", self.phases, "must lead from start to end in whole cycles")

    def extrema(self) -> Extrema:
        """Return the ranges of the plan, with the peaks inside phases (zeros of A and of V).

        >>> scurve(160.0, Limits(90.0, 500.0, 5000.0), 1e-3).extrema().acceleration.high <= 500.0
        True
        """
        return Extrema.along(self._all_nodes(), self.at)


# ---- the paper's closed form, Eqs. (7)-(14) ------------------------------------------------------


class _Intervals(NamedTuple):
    """T1 (= T3), T2, T4, T5 (= T7), T6 in cycles."""

    T1: int
    T2: int
    T4: int
    T5: int
    T6: int

    @property
    def cycles(self) -> int:
        return 2 * self.T1 + self.T2 + self.T4 + 2 * self.T5 + self.T6


class _Levels(NamedTuple):
    """What Eqs. (11)-(13) adjust; Dec_max signed (negative while braking)."""

    Acc_max: float
    V_max: float
    Dec_max: float


class _Task(NamedTuple):
    """One question to the closed form: forward, magnitudes, seconds."""

    L: float
    V_start: float
    V_end: float
    V_max: float
    Acc_max: float
    J_acc: float
    Dec_max: float
    J_dec: float
    T_s: float
    to_cycles: Callable[[float], int]


def _up(cycles: float) -> int:
    return math.ceil(cycles * (1.0 - ROUNDING_SLACK))


def _nearest(cycles: float) -> int:
    return math.floor(cycles + 0.5)


def _ramp(task: _Task, dV: float, Acc_max: float, J: float) -> tuple[int, int]:
    """T1 and T2 in cycles for a change of velocity ``dV`` >= 0."""
    if dV <= 0.0:
        return 0, 0  # no change: that ramp is absent
    if dV * J < Acc_max**2:
        # T2 < 0: the ramp never reaches Acc_max; its time is 2 sqrt(dV / J)
        return max(1, task.to_cycles(math.sqrt(dV / J) / task.T_s)), 0
    T1 = max(1, task.to_cycles(abs(Acc_max / J) / task.T_s))  # Eq. (7)
    Ta = max(T1, task.to_cycles(abs(dV / Acc_max) / task.T_s))  # Eq. (8)
    return T1, Ta - T1


def _ramp_time(dV: float, Acc_max: float, J: float) -> float:
    """Length of the shortest continuous ramp, T1 + T2 + T3."""
    if dV * J < Acc_max**2:
        return 2.0 * math.sqrt(max(dV, 0.0) / J)
    return dV / Acc_max + Acc_max / J


def _distance_at(task: _Task, V: float) -> float:
    """Distance of the two continuous ramps that meet at the peak velocity ``V``."""
    ta = _ramp_time(V - task.V_start, task.Acc_max, task.J_acc)
    td = _ramp_time(V - task.V_end, task.Dec_max, task.J_dec)
    return 0.5 * (task.V_start + V) * ta + 0.5 * (V + task.V_end) * td


def _V_adj(task: _Task) -> float:
    """Return the peak velocity of a move too short for V_max: Eq. (14) for full ramps."""
    lowest = max(task.V_start, task.V_end)
    if _distance_at(task, task.V_max) <= task.L:
        return task.V_max
    Acc, Dec, J_acc, J_dec = task.Acc_max, task.Dec_max, task.J_acc, task.J_dec
    alpha = 1.0 / Acc + 1.0 / Dec
    beta = Acc / J_acc + Dec / J_dec
    gamma = (
        Acc * task.V_start / J_acc
        + Dec * task.V_end / J_dec
        - task.V_start**2 / Acc
        - task.V_end**2 / Dec
        - 2.0 * task.L
    )
    square = beta**2 - 4.0 * alpha * gamma
    if square >= 0.0:
        V_adj = (-beta + math.sqrt(square)) / (2.0 * alpha)  # Eq. (14)
        full = V_adj - task.V_start >= Acc**2 / J_acc and V_adj - task.V_end >= Dec**2 / J_dec
        if full and V_adj >= lowest:
            return V_adj
    # A ramp that never reaches its limit: the distance grows with the peak, so bracket and halve
    # to the last bit.
    low, high = lowest, task.V_max
    while True:
        middle = 0.5 * (low + high)
        if not low < middle < high:
            return high
        if _distance_at(task, middle) < task.L:
            low = middle
        else:
            high = middle


def _intervals(task: _Task) -> _Intervals:
    """Eqs. (7)-(10), and (14) with them again where there is no cruise."""
    T_s = task.T_s
    T1, T2 = _ramp(task, task.V_max - task.V_start, task.Acc_max, task.J_acc)
    T5, T6 = _ramp(task, task.V_max - task.V_end, task.Dec_max, task.J_dec)
    Ta, Td = (T1 + T2) * T_s, (T5 + T6) * T_s
    Acc_adj = (task.V_max - task.V_start) / Ta if Ta else 0.0  # Eq. (9)
    Dec_adj = (task.V_end - task.V_max) / Td if Td else 0.0  # Eq. (9)
    T4 = (
        task.L
        - (2 * T1 + T2) * T_s * (task.V_start + 0.5 * Acc_adj * Ta)
        - (2 * T5 + T6) * T_s * (task.V_max + 0.5 * Dec_adj * Td)
    ) / (task.V_max * T_s)  # Eq. (10)
    if T4 > 0.0:
        return _Intervals(T1, T2, task.to_cycles(T4), T5, T6)
    V_adj = _V_adj(task)  # Eq. (14); V_max := V_adj, T4 := 0, Eqs. (7)-(9) again
    T1, T2 = _ramp(task, V_adj - task.V_start, task.Acc_max, task.J_acc)
    T5, T6 = _ramp(task, V_adj - task.V_end, task.Dec_max, task.J_dec)
    return _Intervals(T1, T2, 0, T5, T6)


def _levels(task: _Task, n: _Intervals) -> _Levels | None:
    """Eqs. (11)-(13): with the lengths fixed, the levels that meet distance and velocities."""
    L, V_start, V_end = task.L, task.V_start, task.V_end
    T1, T2, T4, T5, T6 = (count * task.T_s for count in n)
    Ta, Td = T1 + T2, T5 + T6
    Tc = T1 + 0.5 * T2 + T4 + T5 + 0.5 * T6
    if Tc == 0.0:
        return None
    Acc_max = Dec_max = 0.0
    if Ta:
        Acc_max = (L - V_start * (2 * T1 + T2 + T4 + T5 + 0.5 * T6) - V_end * (T5 + 0.5 * T6)) / (
            Ta * Tc
        )  # Eq. (11)
    V_max = (L - V_start * (T1 + 0.5 * T2) - V_end * (T5 + 0.5 * T6)) / Tc  # Eq. (12)
    if Td:
        Dec_max = (V_start * (T1 + 0.5 * T2) + V_end * (T1 + 0.5 * T2 + T4 + 2 * T5 + T6) - L) / (
            Td * Tc
        )  # Eq. (13)
    # An absent ramp leaves the velocity as it is; then the lengths alone must meet the distance.
    scale = max(V_max, V_start, V_end)
    for length, velocity in ((Ta, V_start), (Td, V_end)):
        if not length and abs(V_max - velocity) > 1e-12 * scale:
            return None
    return _Levels(Acc_max, V_max, Dec_max)


def _within(task: _Task, n: _Intervals, levels: _Levels | None) -> bool:
    """Whether the levels keep every limit: of acceleration forwards, of braking backwards."""
    if levels is None:
        return False
    slack = 1.0 + 10.0 * ROUNDING_SLACK
    if not 0.0 <= levels.V_max <= task.V_max * slack:
        return False
    for level, count in ((levels.Acc_max, n.T1), (levels.Dec_max, n.T5)):
        most, jerk = (task.Acc_max, task.J_acc) if level > 0.0 else (task.Dec_max, task.J_dec)
        if abs(level) > most * slack or abs(level) > jerk * count * task.T_s * slack:
            return False
    return True


def _splits(task: _Task, cycles: int) -> Iterator[_Intervals]:
    """Ways to divide so many cycles: all of them for a few, else ramps fitted to the peak."""
    if cycles <= 12:
        for T1, T5 in product(range(1, cycles // 2), repeat=2):
            rest = cycles - 2 * T1 - 2 * T5
            for T2, T6 in product(range(rest + 1), repeat=2):
                if rest >= T2 + T6:
                    yield _Intervals(T1, T2, rest - T2 - T6, T5, T6)
        return
    V = min(task.L / (cycles * task.T_s), task.V_max)
    for _ in range(4):
        ramps = []
        for velocity, rising in ((task.V_start, task.V_start < V), (task.V_end, task.V_end > V)):
            limits = (task.Acc_max, task.J_acc) if rising else (task.Dec_max, task.J_dec)
            ramps.append(_ramp(task, abs(V - velocity), *limits))
        (T1, T2), (T5, T6) = (ramp if ramp[0] else (1, 0) for ramp in ramps)
        T4 = cycles - 2 * T1 - T2 - 2 * T5 - T6
        if T4 < 0:
            return
        n = _Intervals(T1, T2, T4, T5, T6)
        yield n
        levels = _levels(task, n)
        assert levels is not None
        V = max(0.0, min(levels.V_max, task.V_max))


def _dip(task: _Task, shortest: int) -> _Intervals | None:
    """Return intervals of ``shortest`` cycles or a little more that keep the limits.

    Needed where whole cycles leave a gap: V_start or V_end > 0 and a peak velocity that the extra
    fraction of a cycle pushes below them. The profile then dips: it brakes before it accelerates.
    """
    extra = 0
    while extra <= 64 * shortest + 64:
        for n in _splits(task, shortest + extra):
            if _within(task, n, _levels(task, n)):
                return n
        extra += 1 + extra // 16
    return None


def _solve(task: _Task) -> tuple[_Intervals, _Levels] | None:
    """Lengths and levels of a forward profile, or None where there is none."""
    if task.L <= 0.0:
        return None
    n = _intervals(task)
    levels = _levels(task, n)
    if task.to_cycles is _nearest:
        return (n, levels) if levels is not None and levels.V_max >= 0.0 else None
    if not _within(task, n, levels):
        fewest = max(4, task.to_cycles(task.L / (task.V_max * task.T_s)))
        found = _dip(task, min(fewest, n.cycles)) or _dip(task, n.cycles)
        if found is None:
            return None
        n, levels = found, _levels(task, found)
    assert levels is not None
    return n, levels


def _distance_that_works(task: _Task) -> float:
    """Return a longer L that has a profile: the first of a growing row that is solved."""
    L = max(task.L, _distance_at(task, max(task.V_start, task.V_end)), task.V_max * task.T_s)
    while _solve(task._replace(L=L)) is None:
        L *= 1.05
    return L


def scurve(
    distance: float,
    limits: Limits,
    cycle_time: float,
    *,
    v_start: float = 0.0,
    v_end: float = 0.0,
    rounding: Literal["up", "nearest"] = "up",
) -> Profile:
    """Plan a forward move of ``distance`` in whole control cycles, Eqs. (7)-(14).

    ``distance`` is signed and covered exactly by the samples; ``v_start`` and ``v_end`` >= 0 are
    velocities along the travel; ``cycle_time`` in seconds. ``rounding="up"`` lengthens each
    interval to whole cycles and never exceeds a limit; ``"nearest"`` is the paper to the letter,
    and exceeds limits by some per cent in most plans. Ramps too short to reach their acceleration
    (T2 < 0 or T6 < 0) are solved as such. Where a fraction of a cycle would push the peak velocity
    below ``v_start`` or ``v_end``, the profile is lengthened until it keeps the limits.

    Raises ``InputError`` for unusable numbers and ``InfeasibleError``, with a distance that works,
    where no forward profile exists (a move shorter than the change of velocity needs).

    >>> profile = scurve(160.0, Limits(90.0, 500.0, 5000.0), 1e-3)
    >>> profile.cycles, [phase.cycles for phase in profile.phases]
    (2058, [100, 80, 100, 1498, 100, 80, 100])
    """
    distance = real("distance", distance)
    if not isinstance(limits, Limits):
        raise InputError("limits", limits, "must be a Limits")
    T_s = positive("cycle_time", cycle_time)
    for name, velocity in (("v_start", v_start), ("v_end", v_end)):
        if not 0.0 <= real(name, velocity) <= limits.velocity:
            raise InputError(name, velocity, f"must lie in [0, {limits.velocity!r}]")
    if rounding not in ("up", "nearest"):
        raise InputError("rounding", rounding, "must be 'up' or 'nearest'")
    sign = math.copysign(1.0, distance)
    start = State(0.0, sign * v_start)
    end = State(distance, sign * v_end)
    if distance == 0.0 and v_start == 0.0 and v_end == 0.0:
        return Profile((), T_s, start, end)

    # Half-cycle lemma, point 2: for the samples to cover the distance, the plan covers this.
    half_cycles = 0.5 * T_s * (v_start + v_end)
    Dec_max, J_dec = limits.braking
    task = _Task(
        abs(distance) - half_cycles,
        v_start,
        v_end,
        limits.velocity,
        limits.acceleration,
        limits.jerk,
        Dec_max,
        J_dec,
        T_s,
        _up if rounding == "up" else _nearest,
    )
    solution = _solve(task)
    if solution is None:
        works = sign * (_distance_that_works(task) + half_cycles)
        raise InfeasibleError(distance, works, "no forward profile in whole cycles")
    n, levels = solution
    if n.cycles > CYCLES_MAX:
        raise InputError("distance", distance, f"takes {n.cycles} cycles, at most {CYCLES_MAX}")
    J_acc = sign * levels.Acc_max / (n.T1 * T_s) if n.T1 else 0.0
    J_dec = sign * levels.Dec_max / (n.T5 * T_s) if n.T5 else 0.0
    # Eq. (1)
    phases = (
        Phase(n.T1, J_acc),
        Phase(n.T2, 0.0),
        Phase(n.T1, -J_acc),
        Phase(n.T4, 0.0),
        Phase(n.T5, J_dec),
        Phase(n.T6, 0.0),
        Phase(n.T5, -J_dec),
    )
    return Profile(tuple(phase for phase in phases if phase.cycles), T_s, start, end)
