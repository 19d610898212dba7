"""Random streams, how they are played, and a judge that looks at the jerks handed out alone.

Recordings from rest to rest and through via points, 1 to 7 joints together or each by itself, as
goals at 2 to 500 Hz, at regular and irregular times, exact or quantised to counts, in time, late or
with a stall; limits of driving and braking that differ, 40 to 100 % of which the recording uses.
"""

from __future__ import annotations

import itertools
import math
import random
from dataclasses import dataclass, field

import numpy as np
import ruckig
from numpy.typing import NDArray

from sjerk import GoalStream, Limits, State, plan
from sjerk.trajectory.segments import Followed

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Draw:
    """One stream: goals (n, N) at `times`, which come at `arrivals`; (0,) is the start."""

    limits: list[Limits]
    times: Array
    goals: Array
    arrivals: Array
    period: float
    delay: int
    within: bool
    count: Array
    share: float
    T: float = 1e-3
    velocities: Array | None = None

    @property
    def in_time(self) -> bool:
        """Whether no goal is late, and each known 0.75 stops before the last period begins."""
        known = self.delay * self.period - float(np.diff(self.times).max(initial=self.period))
        return bool((self.arrivals == self.times).all()) and known >= 0.75 * self.stop

    @property
    def one_way(self) -> bool:
        """Whether no joint's goals turn by more than their noise."""
        steps, noise = np.diff(self.goals, axis=0), 2.0 * self.count
        return bool(((steps >= -noise).all(axis=0) | (steps <= noise).all(axis=0)).all())

    @property
    def stop(self) -> float:
        """The longest time in which a joint comes to rest from full velocity, s."""
        return max(
            x.velocity / min(x.acceleration, x.braking[0])
            + min(x.acceleration, x.braking[0]) / min(x.jerk, x.braking[1])
            for x in self.limits
        )


def drawn(rng: random.Random) -> Draw:
    """A stream; the recording is planned under a share of the limits."""
    T = rng.choice([0.5e-3, 1e-3, 1e-3, 2e-3, 4e-3])
    joints = rng.choice([1, 1, 2, 3, 7])
    share = rng.choice([0.4, 0.5, 0.8, 0.95, 1.0])
    limits, slower = [], []
    for _ in range(joints):
        v = 10.0 ** rng.uniform(-0.5, 2)
        a = v / rng.uniform(0.15, 1.0)
        j = a / rng.uniform(0.03, 0.3)
        brake = [1.0, 1.0] if rng.random() < 0.5 else [rng.uniform(0.5, 2), rng.uniform(0.5, 2)]
        limits.append(Limits(v, a, j, a * brake[0], j * brake[1]))
        a, j = a * min(1.0, brake[0]), j * min(1.0, brake[1])
        slower.append(Limits(v * share, a * share, j * share))
    together, legs = rng.random() < 0.6, rng.choice([1, 1, 1, 2, 3])
    at = np.zeros(joints)
    blocks = [at[None]]
    for _ in range(legs):
        way = np.array([rng.choice([-1, 1]) * x.velocity * rng.uniform(0.3, 3) for x in limits])
        starts, ends = [State(x) for x in at.tolist()], [State(x) for x in (at + way).tolist()]
        made = plan(starts, ends, slower, T, synchronization="time" if together else "none")
        rows = made.sample().position
        blocks.append(rows[1:])
        at = rows[-1]
    path = np.concatenate(blocks)
    period = max(T, rng.choice([0.5, 0.2, 0.1, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002]))
    step, rows = max(1, round(period / T)), [0]
    jittered = rng.random() < 0.3
    while rows[-1] < len(path) - 1:
        more = max(1, round(step * rng.uniform(0.4, 1.6))) if jittered else step
        rows.append(min(rows[-1] + more, len(path) - 1))
    goals = path[rows]
    count = np.zeros(joints)
    if rng.random() < 0.3:
        count = np.array([x.velocity for x in limits]) * 10.0 ** rng.uniform(-5, -3)
        goals = np.round(goals / count) * count
    times = np.array(rows) * T
    late = np.zeros(len(times))
    kind = rng.choice(["none", "none", "jitter", "stall"])
    if kind == "jitter":
        late = np.array([rng.uniform(0, 0.5 * period) for _ in late])
    elif kind == "stall" and len(times) > 2:
        late[rng.randrange(1, len(times))] = rng.uniform(1, 5) * period
    arrivals = np.maximum.accumulate(times + late)
    delay = rng.choice([1, 2, 3, 4, 6, 10, max(1, min(256, round(1.5 * 0.5 / period)))])
    within = rng.random() < 0.5
    velocities = np.gradient(path, T, axis=0)[rows] if rng.random() < 0.2 else None
    return Draw(limits, times, goals, arrivals, period, delay, within, count, share, T, velocities)


def one_way(share: float, period: float, delay: int, *, within: bool, joints: int = 2) -> Draw:
    """A synchronised motion from rest to rest that uses a share of the limits, in time."""
    limits = [Limits(2.0 * k, 5.0 * k, 40.0 * k) for k in range(1, joints + 1)]
    slower = [Limits(x.velocity * share, x.acceleration * share, x.jerk * share) for x in limits]
    ends = [State(3.0 * k) for k in range(1, joints + 1)]
    T = 1e-3
    rows = plan([State(0.0)] * joints, ends, slower, T).sample().position.reshape(-1, joints)
    chosen = [*range(0, len(rows) - 1, round(period / T)), len(rows) - 1]
    times = np.array(chosen) * T
    return Draw(limits, times, rows[chosen], times, period, delay, within, np.zeros(joints), share)


@dataclass
class Outcome:
    """What was handed out, and which goals were known in each knot."""

    blocks: list[Followed] = field(default_factory=list)
    known: list[int] = field(default_factory=list)  # goals known when each block was made
    done: bool = False
    behind: float = 0.0  # s, after plan + delay and the arrival of the last goal
    late: float = 0.0  # s, and after what came late with the rest of the recording behind it


def play(draw: Draw, **options: float) -> tuple[GoalStream, Outcome]:
    """Goals as they arrive, and a knot each time the one before is over."""
    T = draw.T
    stream = GoalStream(
        draw.limits,
        T,
        draw.goals[0],
        period=draw.period,
        delay=draw.delay,
        stop_within=draw.within,
        **options,  # type: ignore[arg-type]
    )
    found, k, begin = Outcome(), 1, float(draw.arrivals[min(1, len(draw.arrivals) - 1)])
    longest = round(
        (3 * float(draw.times[-1]) + 60 * draw.stop + draw.delay * draw.period + 10) / T
    )
    while not stream.done and stream.cycle < longest:
        while k < len(draw.times) and draw.arrivals[k] - begin <= stream.cycle * T + 1e-9:
            speed = None if draw.velocities is None else draw.velocities[k]
            stream.push(draw.goals[k], float(draw.times[k]), velocity=speed)
            k += 1
        if k == len(draw.times):
            stream.end()
        until = stream.cycle + 1000
        if k < len(draw.times):  # until it comes nothing is new
            until = math.ceil((float(draw.arrivals[k]) - begin - 1e-9) / T)
        made = stream.take(max(until, stream.cycle + 1))
        found.blocks += made
        found.known += [k] * len(made)
    found.done = stream.done
    due = float(draw.times[-1] - draw.times[1]) + draw.delay * draw.period
    due = max(due, float(draw.arrivals[-1]) - begin)
    moving = [b.first_cycle + int(b.cycles.sum()) for b in found.blocks if b.jerk.any()]
    ended = (moving[-1] if moving else 0) * T
    found.behind = ended - due
    # what comes late is followed by the rest of the recording, as fast as the limits allow
    rest = draw.share * (draw.times[-1] - draw.times)
    found.late = ended - max(due, float((draw.arrivals + rest)[1:].max()) - begin)
    return stream, found


def turns(way: Array, least: float) -> int:
    """Changes of direction by more than `least`."""
    sign = count = 0
    top = float(way[0])
    for x in way.tolist():
        if sign * (x - top) > 0 or (sign == 0 and abs(x - top) > least):
            sign, top = (1 if x > top else -1), x
        elif sign and abs(x - top) > least:
            sign, top, count = -sign, x, count + 1
    return count


def _rounding(found: Outcome, T: float) -> Array:
    """By how much samples may be off the sums at the end (N,), where nothing but rounding is wrong.

    Told per second, a state is rounded twice at the begin of each block and a jerk three times in
    each segment; from there on all that comes after it is moved.
    """
    blocks = found.blocks
    after = sum(int(block.cycles.sum()) for block in blocks)
    total = np.zeros(blocks[0].jerk.shape[2])
    for block in blocks:
        left = after * T
        total += 2.0 * (
            np.abs(block.acceleration[0]) * left**2 / 2 + np.abs(block.velocity[0]) * left
        )
        for lengths, jerk in zip(block.lengths.tolist(), block.jerk, strict=True):
            for cycles, row in zip(lengths, np.abs(jerk), strict=True):
                after -= cycles
                begin, end = (after + cycles) * T, after * T
                total += 3.0 * row * (begin**3 - end**3) / 6
    return np.asarray(total * 2.0**-53)


def judge(draw: Draw, found: Outcome) -> dict[str, float]:
    """Faults, by the jerks handed out: integrated here, from rest at the first goal.

    ``over``: of a limit, as a ratio; ``gap``: between samples and sums; ``turns``: more than the
    goals have; ``passed``: beyond the goals known; ``cut``: largest distance of a goal from all
    samples, as a share of a joint's way.
    """
    T = draw.T
    jerk, cycles = [], []
    for block in found.blocks:
        for i in range(len(block)):
            for n, row in zip(block.lengths[i].tolist(), block.jerk[i], strict=True):
                if n:
                    jerk.append(row)
                    cycles.append(n)
    J = np.repeat(np.array(jerk, dtype=np.longdouble), cycles, axis=0)
    A = np.concatenate([J[:1] * 0, np.cumsum(J, axis=0)]) * T
    V = np.concatenate([J[:1] * 0, np.cumsum(A[:-1] * T + J * (T * T / 2), axis=0)])
    P = np.concatenate(
        [J[:1] * 0, np.cumsum(V[:-1] * T + A[:-1] * (T * T / 2) + J * (T**3 / 6), axis=0)]
    )
    P += draw.goals[0]
    limit = np.array([[x.velocity, x.acceleration, x.jerk] for x in draw.limits])
    braking = np.array([x.braking for x in draw.limits])
    limit[:, 1] = np.maximum(limit[:, 1], braking[:, 0])
    limit[:, 2] = np.maximum(limit[:, 2], braking[:, 1])
    over = max(float((abs(x).max(axis=0) / limit[:, i]).max()) for i, x in enumerate((V, A, J)))
    drives = 1e-12 * limit[:, 0] * limit[:, 1] < A * V
    over = max(
        over, float((np.where(drives, abs(A), 0) / [x.acceleration for x in draw.limits]).max())
    )
    brakes = -1e-12 * limit[:, 0] * limit[:, 1] > A * V
    over = max(over, float((np.where(brakes, abs(A), 0) / braking[:, 0]).max()))
    position = np.concatenate([b.sample().position for b in found.blocks])[-len(J) :]
    sums = P[1:] - V[1:] * (T / 2) + A[1:] * (T * T / 3) - J * (T**3 / 8)
    scale = np.abs(draw.goals).max(axis=0) + 1e-300
    gap = float(((np.abs(position - sums) - _rounding(found, T)) / scale).max())
    more = extra = 0
    for j in range(len(draw.limits)):
        v = V[:, j]
        sign = np.sign(v[np.abs(v) > 1e-9 * limit[j, 0]])
        own = int((np.diff(sign) != 0).sum())
        # goals whose noise is a count have no turns below it
        asked = turns(draw.goals[:, j], 1.5 * float(draw.count[j]) + 1e-12 * float(scale[j]))
        extra = max(extra, own - asked)
    ends = np.cumsum([int(b.cycles.sum()) for b in found.blocks])
    low = np.minimum.accumulate(draw.goals)
    high = np.maximum.accumulate(draw.goals)
    known = np.array(found.known) - 1
    first = np.concatenate([[0], ends[:-1]])
    for one, two, k in zip(first.tolist(), ends.tolist(), known.tolist(), strict=True):
        rows = position[one:two]
        more = max(
            more, float(((rows - high[k]) / scale).max()), float(((low[k] - rows) / scale).max())
        )
    end = bool((position[-1] == draw.goals[-1]).all())
    way, cut = np.ptp(draw.goals, axis=0) + 1e-300, 0.0
    for goal in draw.goals[:: max(1, len(draw.goals) // 30)]:
        cut = max(cut, float((np.abs(position - goal) / way).max(axis=1).min()))
    return {"over": over, "gap": gap, "turns": extra, "passed": more, "end": end, "cut": cut}


def run(
    seed: int, number: int, **options: int
) -> tuple[Draw, Outcome, dict[str, float], GoalStream] | None:
    """One of an exam, by a generator of its own, so that it can be repeated alone."""
    draw = drawn(random.Random(seed * 1_000_003 + number))
    if len(draw.times) < 3:
        return None
    stream, found = play(draw, **options)
    return draw, found, judge(draw, found), stream


def lateness_of_planning_anew(draw: Draw) -> float:
    """When a motion ends that ruckig plans anew in each cycle to the last goal known; as `behind`.

    Each joint by itself, at the limits: it can always stop there, and is as far ahead as it may be.
    """
    joints, T = len(draw.limits), draw.T
    otg, asked = ruckig.Ruckig(joints, T), ruckig.InputParameter(joints)
    out = ruckig.OutputParameter(joints)
    asked.max_velocity = [x.velocity for x in draw.limits]
    asked.max_acceleration = [min(x.acceleration, x.braking[0]) for x in draw.limits]
    asked.max_jerk = [min(x.jerk, x.braking[1]) for x in draw.limits]
    asked.synchronization = ruckig.Synchronization.No
    asked.current_position = asked.target_position = draw.goals[0].tolist()
    known, cycle, begin = 1, 0, float(draw.arrivals[1])
    due = max(
        float(draw.times[-1] - draw.times[1]) + draw.delay * draw.period,
        float(draw.arrivals[-1]) - begin,
    )
    result = ruckig.Result.Working
    while known < len(draw.times) or result != ruckig.Result.Finished:
        while known < len(draw.times) and draw.arrivals[known] - begin <= cycle * T + 1e-9:
            asked.target_position = draw.goals[known].tolist()
            known += 1
        result = otg.update(asked, out)
        out.pass_to_input(asked)
        cycle += 1
    return cycle * T - due


def ended(stream: GoalStream) -> list[Followed]:
    """End the stream and take the rest."""
    stream.end()
    blocks: list[Followed] = []
    while not stream.done:
        blocks += stream.take(stream.cycle + 50)
        assert stream.cycle < 10**6
    return blocks


def positions(blocks: list[Followed]) -> Array:
    """Every cycle; and that blocks go on where the one before ended."""
    for one, two in itertools.pairwise(blocks):
        for name in ("position", "velocity", "acceleration", "last_jerk"):
            np.testing.assert_array_equal(getattr(one, name)[-1], getattr(two, name)[0])
        assert two.first_cycle == one.first_cycle + one.cycles.sum()
    rows = np.concatenate([block.sample().position for block in blocks])
    return rows[-sum(int(block.cycles.sum()) for block in blocks) :]
