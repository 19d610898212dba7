"""Onto a trajectory from any state in motion: no jump, limits kept, way-points near, end met."""

from __future__ import annotations

import itertools
import os
from dataclasses import dataclass, replace

import numpy as np
import pytest

from helpers.following_check import Array
from sjerk import InputError, Limits, PlanError, Trajectory, follow
from sjerk.trajectory.entering import Entry
from sjerk.trajectory.joining import join
from sjerk.trajectory.segments import PHASES, Followed, Knot, packed, split
from sjerk.trajectory.window import limits_per_cycle, stop_of, units


@dataclass
class Scene:
    """A motion under way, which is left in a cycle, and a trajectory that is to take over there."""

    limits: list[Limits]
    T: float
    knot: Knot
    way: Trajectory
    elapsed: float

    @classmethod
    def draw(cls, seed: int) -> Scene:
        """1 to 7 joints, units over six decades, any state that the limits allow."""
        rng = np.random.default_rng(seed)
        n, T = int(rng.integers(1, 8)), float(rng.choice([0.25e-3, 1e-3, 4e-3]))
        unit = 10.0 ** rng.uniform(-3.0, 3.0, n)
        V = rng.uniform(0.5, 3.0, n) * unit
        A = V * rng.uniform(1.0, 10.0, n)
        J = A * rng.uniform(3.0, 50.0, n)
        table = np.column_stack([V, A, J]).tolist()
        stop = float((V / A + A / J).max())
        begin, end = rng.uniform(-1.0, 1.0, (2, n)) * [[1.0], [4.0]] * V * stop
        before = join(Knot.rest(begin), end, [Limits(*row) for row in table], T)
        knot = Knot.of(split(before, int(rng.integers(1, before.cycles.sum())))[0])
        reach = V * stop
        if rng.random() < 0.5:  # a motion of its own, near or far, dense or not, too fast or not
            place = knot.position + rng.uniform(-1.0, 1.0, n) * reach * 10.0 ** rng.uniform(-3, 0)
            goal = place + rng.uniform(-3.0, 3.0, n) * reach
            motion = join(Knot.rest(place), goal, [Limits(*row) for row in table], T)
            rows = motion.sample().position
            step = max(1, round(float(rng.choice([0.002, 0.02, 0.1])) / T))
            q = np.vstack([rows[:-1:step], rows[-1:]])
            time = np.append(np.arange(0, len(rows) - 1, step), len(rows)) * T
            time = time * float(rng.choice([0.7, 1.0, 1.3, 2.0]))
        else:
            gaps = rng.uniform(-2.0, 2.0, (int(rng.integers(1, 9)), n)) * reach
            q = knot.position + np.cumsum(gaps * float(rng.choice([0.1, 1.0])), axis=0)
            time = np.cumsum(rng.uniform(0.1, 2.0, len(q)) * stop)
        if rng.random() < 0.3:
            every = np.vstack([q, begin, end, knot.position])
            low, high = every.min(axis=0), every.max(axis=0)
            pad = rng.uniform(0.0, 0.2) * (high - low) + 1e-9 * V
            ranges = zip(low - pad, high + pad, strict=True)
            limits = [
                Limits(*row, position=(float(one), float(two)))
                for row, (one, two) in zip(table, ranges, strict=True)
            ]
        else:
            limits = [Limits(*row) for row in table]
        elapsed = float(rng.choice([0.0, 0.0, 0.3])) * float(time[-1])
        return cls(limits, T, knot, Trajectory([f"j{k}" for k in range(n)], time, q), elapsed)

    def judge(self, blocks: list[Followed]) -> Array:
        """Commanded positions from the state on; limits by the samples and the jerks of phases."""
        last, segments, cycles = self.knot, 0, 0
        for block in blocks:
            first = Knot.of(block, 0)
            for name in ("position", "velocity", "acceleration", "last_jerk"):
                assert np.array_equal(getattr(first, name), getattr(last, name)), name
            assert (block.first, block.first_cycle) == (segments, cycles)
            segments, cycles = segments + len(block), cycles + int(block.cycles.sum())
            last = Knot.of(block)
        assert not last.moving
        rows = [replace(block, first=1).sample() for block in blocks]
        position = np.concatenate([row.position for row in rows])
        for k, limit in enumerate(self.limits):
            assert max(np.abs(row.velocity[:, k]).max() for row in rows) <= limit.velocity * (
                1 + 1e-9
            )
            most = max(np.abs(row.acceleration[:, k]).max() for row in rows)
            assert most <= limit.acceleration * (1 + 1e-9)
            jerk = max(np.abs(block.jerk[..., k]).max() for block in blocks)
            assert jerk <= limit.jerk * (1 + 1e-9)
            low, high = limit.position or (-np.inf, np.inf)
            noise = 1e-9 * limit.velocity * self.T
            assert position[:, k].min() >= low - noise
            assert position[:, k].max() <= high + noise
        return position


@pytest.mark.parametrize("seed", range(int(os.environ.get("SJERK_ENTRIES", "24"))))
def test_from_any_state_in_motion(seed: int) -> None:
    """Way-points whose time is over are over, the others told in order and passed near."""
    scene = Scene.draw(seed)
    way, T = scene.way, scene.T
    blocks = list(Entry(scene.limits, T).enter(way, scene.knot, scene.elapsed))
    position = scene.judge(blocks)
    np.testing.assert_array_equal(position[-1], way.position[-1])
    ahead = np.concatenate([block.ahead for block in blocks])
    first = min(int(np.searchsorted(way.time, scene.elapsed + 1.5 * T)), len(way) - 1)
    assert ahead[0] == first
    assert (np.diff(ahead) >= 0).all()
    assert ahead[-1] <= len(way) - 1
    # between two samples a joint goes further than any tolerance: by straight lines
    table = limits_per_cycle(scene.limits, T)
    size = np.ptp(np.vstack([scene.knot.position, way.position[first:]]), axis=0)
    near = 10.0 * units(table, size, None)  # what it may be raised to
    gaps = np.diff(way.time, prepend=0.0)
    if np.median(gaps) <= 0.1 * stop_of(table) * T:  # denser than knots
        near = np.maximum(near, 0.5 * np.median(gaps) / T * table[:, 0])
    near += (table[:, 1] + table[:, 2]) / 8.0 + 1e-12 * np.abs(way.position).max(axis=0)
    rows = np.vstack([scene.knot.position, position])
    start, step = rows[:-1], np.diff(rows, axis=0)
    for point in way.position[first :: 1 + len(way) // 40]:
        gap, square = (point - start) / near, ((step / near) ** 2).sum(axis=1)
        share = np.clip((gap * (step / near)).sum(axis=1) / np.maximum(square, 1e-300), 0.0, 1.0)
        assert np.abs(gap - share[:, None] * step / near).max(axis=1).min() <= 1.5


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("cut", [50, 200, 310, 420])
def test_a_trajectory_that_fits_the_state_is_played_in_its_time(sign: float, cut: int) -> None:
    """The rest of the motion under way, told at 20 ms: a knot later at most."""
    limits = [Limits(2.0, 8.0, 100.0)] * 2
    goal = sign * np.array([1.0, -0.4])
    whole = join(Knot.rest([0.0, 0.0]), goal, limits, 1e-3)
    head, tail = split(whole, cut)
    rows = replace(tail, first=1).sample().position
    time = np.append(np.arange(20, len(rows) - 20, 20), len(rows)) * 1e-3
    way = Trajectory(["a", "b"], time, rows[np.rint(time * 1e3).astype(int) - 1])
    scene = Scene(limits, 1e-3, Knot.of(head), way, 0.0)
    position = scene.judge(list(Entry(limits, 1e-3).enter(way, scene.knot, 0.0)))
    assert len(position) <= len(rows) + 12
    np.testing.assert_allclose(position[: len(rows)], rows, rtol=0, atol=2e-3)


def rest_of_a_move(seed: int, corner: str) -> Scene | None:
    """A planned move that is cut, and its rest as a trajectory.

    In ``any`` cycle, or where the acceleration ends at the velocity limit (``up``), or where it
    brakes at its limit (``down``).
    """
    rng = np.random.default_rng(seed)
    n, T = int(rng.integers(1, 8)), float(rng.choice([0.25e-3, 1e-3, 4e-3]))
    V = rng.uniform(0.5, 3.0, n) * 10.0 ** rng.uniform(-3.0, 3.0, n)
    A = V * rng.uniform(1.0, 10.0, n)
    J = A * rng.uniform(3.0, 50.0, n)
    limits = [Limits(*row) for row in np.column_stack([V, A, J]).tolist()]
    far = V * float((V / A + A / J).max()) * 10.0 ** rng.uniform(-1.0, 0.6)
    whole = join(Knot.rest(np.zeros(n)), rng.uniform(-1.0, 1.0, n) * far, limits, T)
    row = replace(whole, first=1).sample()
    v, a = row.velocity, row.acceleration
    leads = np.abs(v) + np.maximum(a * np.sign(v), 0.0) ** 2 / (2.0 * J)
    at = {
        "any": np.full(len(v), True),
        "up": ((leads > 0.999 * V) & (a * v > 0.01 * V * A)).any(axis=1),
        "down": ((a * v < 0.0) & (np.abs(a) > 0.999 * A)).any(axis=1),
    }[corner]
    cuts = 1 + np.flatnonzero(at[:-3])
    if not len(cuts):
        return None
    head, tail = split(whole, int(rng.choice(cuts)))
    rows = replace(tail, first=1).sample().position
    step = max(2, round(float(rng.choice([0.01, 0.02, 0.05, 0.1])) / T))
    cycle = np.append(np.arange(step, len(rows) - step, step), len(rows))
    way = Trajectory([f"j{k}" for k in range(n)], cycle * T, rows[cycle - 1])
    return Scene(limits, T, Knot.of(head), way, 0.0)


@pytest.mark.parametrize("corner", ["any", "up", "down"])
def test_the_rest_of_a_planned_move_is_in_time(corner: str) -> None:
    """From every state a planner has: states at a corner of the limits leave knots no room."""
    late: list[float] = []
    for seed in itertools.count():
        scene = rest_of_a_move(seed, corner)
        if len(late) == int(os.environ.get("SJERK_ENTRIES", "24")):
            break
        if scene is not None:
            blocks = list(Entry(scene.limits, scene.T).enter(scene.way, scene.knot, 0.0))
            position = scene.judge(blocks)
            np.testing.assert_array_equal(position[-1], scene.way.position[-1])
            left = round(scene.way.duration / scene.T)
            late.append(max(0, len(position) - left - 4) / left)
    assert np.quantile(late, 0.9) <= 0.01


def test_a_state_that_leaves_no_way_is_refused() -> None:
    """Towards a limit of position, too fast to stop before it."""
    limits = [Limits(2.0, 4.0, 50.0, position=(-1.0, 1.0))]
    knot = Knot(*(np.array([x]) for x in (0.9, 1.9, 0.0, 0.0)))
    way = Trajectory(["a"], [0.5, 1.0], [[0.9], [0.0]])
    with pytest.raises((PlanError, InputError)):
        list(Entry(limits, 1e-3).enter(way, knot, 0.0))


def test_a_single_goal_takes_what_a_plan_takes() -> None:
    """One way-point left, in motion: the planner's motion, in the time asked if that is longer."""
    limits = [Limits(2.0, 4.0, 50.0)]
    knot = Knot(*(np.array([x]) for x in (0.0, 1.0, 0.0, 0.0)))
    soonest = int(join(knot, [1.0], limits, 1e-3).cycles.sum())
    for asked in (0.1, 3.0):
        way = Trajectory(["a"], [asked], [[1.0]])
        (block,) = Entry(limits, 1e-3).enter(way, knot, 0.0)
        assert int(block.cycles.sum()) == max(soonest, round(asked * 1e3))
        assert int(block.stretch.sum()) == max(0, soonest - round(asked * 1e3))


@pytest.mark.parametrize("seed", range(20))
def test_packed_segments_are_the_same_motion(seed: int) -> None:
    """Sample by sample, with the same way-point ahead in each cycle, in as few as have room."""
    rng = np.random.default_rng(seed)
    n, joints = int(rng.integers(1, 60)), int(rng.integers(1, 8))
    limits = [Limits(*10.0 ** rng.uniform(0.0, 1.0, 3).cumsum()) for _ in range(joints)]
    time = np.cumsum(rng.uniform(0.02, 0.4, n + 1))
    q = np.cumsum(rng.uniform(-0.2, 0.2, (n + 1, joints)) * 10.0 ** rng.uniform(-3.0, 0.0), axis=0)
    way = Trajectory([f"j{i}" for i in range(joints)], time - time[0], q)
    for block in follow(way, limits, 1e-3, quick=True):
        made = packed(block)
        one, two = block.sample(), made.sample()
        size = 1.0 + np.abs(one.position).max()
        np.testing.assert_allclose(two.position, one.position, rtol=0.0, atol=4e-15 * size)
        np.testing.assert_array_equal(two.jerk, one.jerk)
        for name in ("ahead", "stretch"):
            assert len(getattr(made, name)) == len(made)
        np.testing.assert_array_equal(
            np.repeat(made.ahead, made.cycles), np.repeat(block.ahead, block.cycles)
        )
        assert made.stretch.sum() == block.stretch.sum()
        full = (made.lengths > 0).sum(axis=1)
        apart = np.diff(made.ahead) != 0
        assert (apart | (full[:-1] + full[1:] > PHASES)).all()
        assert (made.lengths.sum(axis=1) == made.cycles).all()
