"""The player of a path alone, in C: any plan, feeding and speeds; and why waiting is allowed."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.following_check import Array, T, recording
from sjerk import Limits, Trajectory
from sjerk._binding import ffi, lib
from sjerk.trajectory.segments import Followed
from sjerk.trajectory.stretching import stretched

RUNS, RESTS, STARVES, DONE, LOST = range(5)


class Player:
    """``sj_player`` with the segments of a plan at hand."""

    def __init__(self, blocks: Sequence[Followed], limits: Sequence[Limits]) -> None:
        self.raw = ffi.new("sj_player *")
        self.track = ffi.addressof(self.raw, "track")
        self.axes, self.taken = len(limits), 0
        most = ffi.new("sj_track_limits[]", self.axes)
        for k, one in enumerate(limits):
            a, j = min(one.acceleration, one.braking[0]), min(one.jerk, one.braking[1])
            low, high = one.position or (-np.inf, np.inf)
            most[k] = (one.velocity * T, a * T**2, j * T**3, low, high, a * T**2, j * T**3)
        lib.sj_track_begin(self.track, self.axes, blocks[0].position[0].tolist(), most)
        lib.sj_player_begin(self.raw)
        self.segments = [
            (block.first + i + 1, *(self.segment(block, i)))
            for block in blocks
            for i in range(len(block))
        ]

    def segment(self, block: Followed, i: int) -> tuple[Any, Any]:
        axis = ffi.new("sj_track_axis[]", self.axes)
        jerk = block.jerk[i] * T**3
        for k in range(self.axes):
            axis[k] = (
                block.position[i + 1, k],
                block.velocity[i, k] * T,
                block.acceleration[i, k] * T**2,
                block.last_jerk[i, k] * T**3,
                jerk[:, k].tolist(),
            )
        return ffi.new("int64_t[]", block.lengths[i].tolist()), axis

    def add(self) -> int:
        """The next segment; its status."""
        number, cycles, axis = self.segments[self.taken]
        last = self.taken == len(self.segments) - 1
        status = int(lib.sj_track_add(self.track, number, cycles, last, axis))
        self.taken += status == lib.SJ_TRACK_OK
        return status

    def add_all(self) -> None:
        while self.taken < len(self.segments):
            if self.add() == lib.SJ_TRACK_FULL:
                return

    @property
    def position(self) -> list[float]:
        return list(self.raw.run.past[0][0 : self.axes])

    @property
    def place(self) -> float:
        rest = ffi.new("double *")
        return float(lib.sj_player_place(self.raw, rest) + rest[0])


def judge(position: Array, limits: Sequence[Limits]) -> None:
    """Rest, the recorded positions, rest: all differences within the limits."""
    whole = np.concatenate([position[:1].repeat(3, 0), position, position[-1:].repeat(3, 0)])
    noise = 16 * np.finfo(float).eps * np.abs(whole).max()
    for order, name in enumerate(("velocity", "acceleration", "jerk"), start=1):
        most = np.abs(np.diff(whole, order, axis=0)).max(axis=0)
        for k, one in enumerate(limits):
            braking = (np.inf, *one.braking)[order - 1]
            allowed = min(getattr(one, name), braking) * T**order
            assert most[k] <= allowed * (1 + 1e-9) + noise * 2**order, (name, k)


def by_cubics(samples: Array, places: Array) -> Array:
    """Positions at fractions of a cycle, by cubics through four samples of the plan."""
    whole = np.concatenate([samples[:1], samples, samples[-1:].repeat(4, 0)])
    s = np.clip(places, 0.0, len(samples) - 1)
    i = np.floor(s).astype(int)
    t = (s - i)[:, None]
    p0, p1, p2, p3 = whole[i], whole[i + 1], whole[i + 2], whole[i + 3]
    found: Array = (
        -t * (t - 1) * (t - 2) / 6 * p0
        + (t + 1) * (t - 1) * (t - 2) / 2 * p1
        - (t + 1) * t * (t - 2) / 2 * p2
        + (t + 1) * t * (t - 1) / 6 * p3
    )
    return found


def random_plan(rng: np.random.Generator) -> tuple[list[Followed], list[Limits]]:
    """Way-points over decades of distance and time, under limits over decades."""
    joints, n = int(rng.integers(1, 4)), int(rng.integers(2, 60))
    limits = [
        Limits(*(10.0 ** rng.uniform(low, high) for low, high in ((-1, 1), (0, 2), (1, 4))))
        for _ in range(joints)
    ]
    scale = 10.0 ** rng.uniform(-4.0, 0.0, (n, 1)) * 10.0 ** rng.uniform(-1.0, 0.3)
    q = np.cumsum(rng.normal(size=(n, joints)) * scale, axis=0)
    time = np.cumsum(10.0 ** rng.uniform(-3.0, -0.5, n))
    way = Trajectory([f"j{k}" for k in range(joints)], time, q)
    return list(stretched(way, limits, T)), limits


@pytest.mark.parametrize("seed", range(int(os.environ.get("SJERK_PATHS", "40"))))
@pytest.mark.parametrize("feeding", ["at once", "slowly", "in bursts"])
def test_any_plan_any_feeding_any_speeds(seed: int, feeding: str) -> None:
    """Limits kept in every cycle, never backward, on the path to 1e-6 of it, exact at the end."""
    rng = np.random.default_rng(seed)
    blocks, limits = random_plan(rng)
    samples, _ = recording(blocks)
    if len(samples) > 20_000:
        return  # some are very slow, which shows nothing new
    player = Player(blocks, limits)
    rows, places, status, cycle = [player.position], [0.0], RUNS, 0
    while status != DONE:
        while player.taken < len(player.segments) and (
            feeding == "at once"
            or (feeding == "slowly" and rng.random() < 0.02)
            or (feeding == "in bursts" and cycle % 1500 == 0)
        ):
            if player.add() != lib.SJ_TRACK_OK:
                break
        if cycle > 40_000:
            player.raw.wish = 1.0
        elif rng.random() < 0.003:
            player.raw.wish = float(rng.choice([0.0, 0.3, 0.7, 1.0, 1.0, 1.5, 2.0, 0.999999]))
        status = lib.sj_player_step(player.raw)
        rows.append(player.position)
        places.append(player.place)
        cycle += 1
        assert status != LOST
        assert cycle < 120_000
    position = np.array(rows)
    judge(position, limits)
    assert (np.diff(places) >= 0.0).all()
    way = float(np.abs(np.diff(samples, axis=0)).sum())
    gap = np.abs(position - by_cubics(samples, np.array(places)))
    assert gap.max() <= 1e-6 * way
    np.testing.assert_array_equal(position[-1], samples[-1])


def test_what_is_no_path_is_refused_before_it_moves() -> None:
    """Each check of a segment, by its status and axis; nothing of it is taken."""
    q = np.column_stack([np.linspace(0.0, 0.4, 9), np.linspace(0.0, -0.4, 9)])
    limits = [Limits(2.0, 20.0, 500.0, position=(-0.5, 0.5))] * 2
    blocks = list(stretched(Trajectory(["a", "b"], 0.2 * np.arange(9), q), limits, T))

    def status(change: Any, own: Sequence[Limits] = limits) -> tuple[int, int]:
        player = Player(blocks, own)
        assert player.add() == player.add() == lib.SJ_TRACK_OK
        change(*player.segments[2][1:])
        result = player.add()
        return result, player.track.axis

    def set_cycles(p: int, n: int) -> Any:
        return lambda cycles, axis: cycles.__setitem__(p, n)

    def set_axis(k: int, name: str, by: float) -> Any:
        return lambda cycles, axis: setattr(axis[k], name, getattr(axis[k], name) + by)

    assert status(lambda cycles, axis: None) == (lib.SJ_TRACK_OK, -1)
    assert status(set_cycles(0, -1)) == (lib.SJ_TRACK_LENGTH, -1)
    assert status(set_cycles(0, 2**60)) == (lib.SJ_TRACK_LENGTH, -1)
    for name in ("position", "velocity", "acceleration", "last_jerk"):
        assert status(set_axis(1, name, 1e-9)) == (lib.SJ_TRACK_BROKEN, 1)
        assert status(set_axis(1, name, float("nan"))) == (lib.SJ_TRACK_NUMBER, 1)
    slow = [Limits(2.0, 20.0, 500.0), Limits(0.1, 20.0, 500.0)]
    player = Player(blocks, slow)
    results = [player.add() for _ in range(4)]
    assert lib.SJ_TRACK_LIMIT in results
    near = [Limits(2.0, 20.0, 500.0), Limits(2.0, 20.0, 500.0, position=(-0.12, 0.5))]
    player = Player(blocks, near)
    results = [player.add() for _ in range(3)]
    assert results[-1] == lib.SJ_TRACK_POSITION


def differences(h: float, begin: float) -> tuple[Array, Array]:
    """Second and third difference of q(s) = P(s) + 5/24 A(s) at steps of h: weights of the
    accelerations at the knots, and of the jerks of the cycles.
    """
    n = int(np.ceil(begin + 3 * h)) + 1

    def row(s: float) -> Array:
        P, V, A = np.zeros(n + 2), np.eye(n + 2)[0], np.eye(n + 2)[1]
        for i in range(min(int(s), n - 1) + 1):
            m, J = min(1.0, s - i), np.eye(n + 2)[2 + i]
            P = P + m * V + m * m / 2 * A + m**3 / 6 * J
            V, A = V + m * A + m * m / 2 * J, A + m * J
        return np.asarray(P + 5.0 / 24.0 * A)

    q = np.array([row(begin + i * h) for i in range(4)])
    second, third = np.diff(q, 2, axis=0)[0], np.diff(q, 3, axis=0)[0]
    knots = np.zeros(n + 1)
    knots[0] = second[1]
    knots[1:] += second[2:]
    knots[:-1] -= second[2:]
    return knots, third[2:]


@settings(max_examples=300)
@given(st.floats(0.001, 1.0), st.floats(0.0, 0.999999))
def test_a_constant_speed_up_to_one_keeps_all_limits(h: float, begin: float) -> None:
    """Whatever the path: magnitudes of the weights add up to at most 1, so it needs no check."""
    knots, jerks = differences(h, begin)
    assert np.abs(knots).sum() <= 1.0 + 1e-12
    assert np.abs(jerks).sum() <= 1.0 + 1e-12
