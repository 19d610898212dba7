"""Following beside interpolation, toppra and ruckig: cost per seven-joint way-point, and jerk."""

from __future__ import annotations

import itertools
import tracemalloc
from collections.abc import Iterator
from time import process_time
from typing import Any

import numpy as np
import pytest
import ruckig

from sjerk import (
    GoalStream,
    Limits,
    State,
    Trajectory,
    follow,
    follow_path,
    follow_stops,
    follow_within,
    plan,
)
from sjerk.cli import demo
from sjerk.planner import Updater
from sjerk.trajectory import shipped_recording
from sjerk.trajectory.joining import join
from sjerk.trajectory.segments import Knot, split

T = 1e-3
VELOCITY = [2.175] * 4 + [2.61] * 3
ACCELERATION = [3.75, 1.875, 2.5, 3.125, 3.75, 5.0, 5.0]
PANDA = [Limits(v, a, 500.0) for v, a in zip(VELOCITY, ACCELERATION, strict=True)]
NAMES = [f"joint{k}" for k in range(7)]
TABLE = "trajectories: Panda, seven joints, limits of Franka"


def smooth(n: int, begin: int = 0) -> Trajectory:
    """Way-points at 0.1 s of a motion within the limits."""
    t = (begin + np.arange(n)) * 0.1
    return Trajectory(
        NAMES, t, np.column_stack([0.4 * np.sin((0.8 + 0.1 * k) * t + k) for k in range(7)])
    )


def test_follow_with_times(benchmark: Any) -> None:
    """A plan whose times can be kept: 20 000 way-points."""
    way = smooth(20_000)
    benchmark.extra_info["per"] = len(way)
    benchmark.extra_info["against"] = {
        "test_ruckig_per_way_point": "lower is faster",
        "test_toppra_per_way_point": "lower is faster",
        "test_numpy_copy": "per way-point, beside copying it",
    }
    benchmark(lambda: list(follow(way, PANDA, T)))


def test_follow_with_times_too_fast(benchmark: Any) -> None:
    """TOPP-RA's plan, bang-bang: nearly every segment is stretched."""
    way = Trajectory.from_bag(shipped_recording())
    benchmark.extra_info["per"] = len(way)
    benchmark(lambda: list(follow(way, PANDA, T, use_velocities=False)))


def dense_plan() -> Trajectory:
    """The recorded plan at 2 ms, by cubics through its way-points and velocities."""
    path = Trajectory.from_bag(shipped_recording())
    assert path.velocity is not None
    t = np.append(np.arange(0.0, path.duration, 0.002), path.duration)
    near = np.clip(np.searchsorted(path.time, t, side="right") - 1, 0, len(path) - 2)
    h = np.diff(path.time)[near][:, None]
    share = (t - path.time[near])[:, None] / h
    p, d = path.position[near], path.position[near + 1] - path.position[near]
    v0, v1 = path.velocity[near] * h, path.velocity[near + 1] * h
    q = p + v0 * share + (3 * d - 2 * v0 - v1) * share**2 + (v0 + v1 - 2 * d) * share**3
    return Trajectory(path.joint_names, t, q)


def test_follow_dense_way_points_too_fast(benchmark: Any) -> None:
    """The same at 2 ms: all of 1720 segments are stretched, most to several times their length."""
    way = dense_plan()
    benchmark.extra_info["per"] = len(way)
    benchmark(lambda: list(follow(way, PANDA, T, use_velocities=False)))


def test_follow_without_times(benchmark: Any) -> None:
    """The same way-points as fast as the limits allow."""
    path = Trajectory.from_bag(shipped_recording()).position
    benchmark.extra_info["per"] = len(path)
    benchmark.extra_info["against"] = {"test_toppra_per_way_point": "lower is faster"}
    benchmark(lambda: list(follow_path(path, PANDA, T)))


def test_numpy_copy(benchmark: Any) -> None:
    """Copying the way-points."""
    way = smooth(20_000)
    benchmark.extra_info["per"] = len(way)
    benchmark(way.position.copy)


def test_ruckig_per_way_point(benchmark: Any) -> None:
    """Ruckig from state to state through the same way-points: a plan for each."""
    ruckig = pytest.importorskip("ruckig")
    way = smooth(500)
    velocity = np.gradient(way.position, 0.1, axis=0)
    otg, inp, trajectory = ruckig.Ruckig(7), ruckig.InputParameter(7), ruckig.Trajectory(7)
    inp.max_velocity, inp.max_acceleration, inp.max_jerk = VELOCITY, ACCELERATION, [500.0] * 7
    rows = [(q.tolist(), v.tolist()) for q, v in zip(way.position, velocity, strict=True)]

    def through() -> None:
        for (q0, v0), (q1, v1) in itertools.pairwise(rows):
            inp.current_position, inp.current_velocity = q0, v0
            inp.target_position, inp.target_velocity = q1, v1
            otg.calculate(inp, trajectory)

    benchmark.extra_info["per"] = len(rows)
    benchmark(through)


def test_toppra_per_way_point(benchmark: Any) -> None:
    """TOPP-RA over the same path: velocity and acceleration limits only, no jerk limit."""
    toppra = pytest.importorskip("toppra")
    path = Trajectory.from_bag(shipped_recording()).position
    v, a = np.array(VELOCITY), np.array(ACCELERATION)
    limits = [
        toppra.constraint.JointVelocityConstraint(np.column_stack([-v, v])),
        toppra.constraint.JointAccelerationConstraint(np.column_stack([-a, a])),
    ]

    def plan() -> Any:
        way = toppra.SplineInterpolator(np.linspace(0.0, 1.0, len(path)), path)
        return toppra.algorithm.TOPPRA(limits, way).compute_trajectory(0.0, 0.0)

    benchmark.extra_info["per"] = len(path)
    benchmark(plan)


def largest(position: np.ndarray, order: int) -> float:
    return float(np.abs(np.diff(position, order, axis=0)).max() / T**order)


def hermite(way: Trajectory, quintic: bool) -> np.ndarray:
    """Cubic (position, velocity) or quintic (and acceleration) interpolation, every cycle."""
    t = np.arange(0.0, way.time[-1] + T / 2, T)
    i = np.clip(np.searchsorted(way.time, t, side="right") - 1, 0, len(way) - 2)
    h = np.diff(way.time)[i][:, None]
    x = (t - way.time[i])[:, None] / h
    assert way.velocity is not None
    p, d = way.position[i], way.position[i + 1] - way.position[i]
    v0, v1 = way.velocity[i] * h, way.velocity[i + 1] * h
    if not quintic:
        return p + v0 * x + (3 * d - 2 * v0 - v1) * x**2 + (v0 + v1 - 2 * d) * x**3
    slope = np.gradient(way.velocity, way.time, axis=0)
    a0, a1 = slope[i] * h**2, slope[i + 1] * h**2
    return (
        p
        + v0 * x
        + a0 / 2 * x**2
        + (10 * d - 6 * v0 - 4 * v1 - (3 * a0 - a1) / 2) * x**3
        + (-15 * d + 8 * v0 + 7 * v1 + (3 * a0 - 2 * a1) / 2) * x**4
        + (6 * d - 3 * v0 - 3 * v1 - (a0 - a1) / 2) * x**5
    )


def test_jerk_beside_interpolation(report: Any) -> None:
    """Largest jerk, acceleration of the recorded plan: cubic, quintic, followed; and time lost."""
    way = Trajectory.from_bag(shipped_recording())
    rows = {
        "cubic interpolation": hermite(way, False),
        "quintic interpolation": hermite(way, True),
        "follow, its velocities": _positions(follow(way, PANDA, T)),
        "follow, velocities chosen": _positions(follow(way, PANDA, T, use_velocities=False)),
        "follow_path, no times": _positions(follow_path(way.position, PANDA, T)),
        "follow_path, corridor 0.01": _positions(
            follow_path(way.position, PANDA, T, corridor=0.01)
        ),
    }
    stops = sum(motion.cycles for motion in follow_stops(way.position, PANDA, T))
    for name, position in rows.items():
        used = np.abs(np.diff(position, 2, axis=0)).max(axis=0) / T**2 / ACCELERATION
        report.line(
            TABLE,
            f"{name:28} jerk {largest(position, 3) / 500.0:8.3f} of its limit, acceleration "
            f"{used.max():6.3f}, time {(len(position) - 1) * T / way.duration:6.3f} of the plan's",
        )
    report.line(TABLE, f"{'follow_stops':28} time {stops * T / way.duration:6.3f} of the plan's")
    for name in list(rows)[2:]:
        assert largest(rows[name], 3) <= 500.0 * (1 + 1e-6)


def test_paths_without_times(report: Any) -> None:
    """A circle in 106 points, a line with points on it, the points of the Panda's plan: cycles."""
    angle = np.linspace(0.0, 2.0 * np.pi, 106)
    ring = 10.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    fast, slow = [Limits(100.0, 1000.0, 10000.0)] * 2, [Limits(3.0, 4.0, 40.0)]
    way = Trajectory.from_bag(shipped_recording())
    straight = plan(0.0, 10.0, slow[0], T).cycles
    rows: list[tuple[str, Any, list[Limits], dict[str, float], float]] = [
        ("circle, exact", ring, fast, {}, 890.0),
        ("circle, tolerance 0.01", ring, fast, {"tolerance": 0.01}, 880.0),
        ("circle, corridor 0.01", ring, fast, {"corridor": 0.01}, 880.0),
        ("[0], [10]", [[0.0], [10.0]], slow, {}, 1.01 * straight),
        ("[0], [1], [10]", [[0.0], [1.0], [10.0]], slow, {}, 1.01 * straight),
        ("Panda, exact", way.position, PANDA, {}, way.duration / T),
    ]
    for name, path, limits, how, most in rows:
        began = process_time()
        cycles = sum(int(block.cycles.sum()) for block in follow_path(path, limits, T, **how))
        report.line(
            TABLE,
            f"{name:24} {cycles:5} cycles (at most {most:.0f}), computed in "
            f"{(process_time() - began) / (cycles * T):.2f} of its time",
        )
        assert cycles <= most


def _positions(blocks: Iterator[Any]) -> np.ndarray:
    return np.concatenate([block.sample().position for block in blocks])


def test_memory(report: Any) -> None:
    """The peak of memory for ten times as many way-points, streamed: constant."""
    peaks = []
    for pieces in (20, 200):
        tracemalloc.start()
        source = (smooth(1000, 1000 * i) for i in range(pieces))
        done = sum(len(block) for block in follow(source, PANDA, T))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert done == 1000 * pieces - 1
    report.line(
        TABLE,
        f"memory, 200 000 way-points / 20 000: {peaks[1] / peaks[0]:.3f} ({peaks[1] / 1e6:.1f} MB)",
    )
    assert peaks[1] < 1.2 * peaks[0]


STREAM = "streamed goals at 10 Hz: the recorded plan, Franka's limits; its first joint, the demo's"


def test_streaming_beside_interruption(report: Any) -> None:
    """Dips of the velocity above 10 %, jerk, time lost: interrupted, within, with look-ahead."""
    way = Trajectory.from_bag(shipped_recording())
    degrees = np.degrees(way.position[:, :1])
    for name, goals, limits in (("panda", way.position, PANDA), ("demo", degrees, [demo.LIMITS])):
        own = [demo.dips(v) for v in np.diff(goals, axis=0).T]
        report.line(STREAM, f"{name:6} {'the goals themselves':24} dips {own}")
        for kind in ("interruption", "stop_within", "look-ahead"):
            if kind == "interruption":
                position, told = _interrupted(goals, limits), ""
            else:
                stream = GoalStream(
                    limits, T, goals[0], period=0.1, stop_within=kind == "stop_within"
                )
                position = _streamed(stream, goals)
                told = f", lag at most {stream.report.largest_lag:.3f} s"
                most = stream.report.deviation / np.ptp(goals, axis=0)
                told += f", goals within {most.max():.1e} of the way"
            dips = [demo.dips(v) for v in np.diff(position, axis=0).T]
            jerk = np.abs(np.diff(position, 3, axis=0)).max(axis=0) / T**3
            share = (jerk / [limit.jerk for limit in limits]).max()
            moved = np.flatnonzero((np.diff(position, axis=0) != 0.0).any(axis=1))
            late = (moved[-1] - moved[0] + 1) * T - way.duration
            off = np.abs(position[-1] - goals[-1]).max()
            report.line(
                STREAM,
                f"{name:6} {kind:24} dips {dips}, jerk {share:.3f} of its limit, "
                f"{late:+.3f} s, end off by {off:.1e}{told}",
            )
            if kind == "look-ahead":
                assert dips == own


def test_cost_of_a_stream(report: Any) -> None:
    """Seven joints, goals at 500 and 10 Hz: share of one core, and the longest step."""
    limits, names = [Limits(2.0, 4.0, 40.0)] * 7, ("within limits", "25 % too fast")
    for period, (name, speed) in itertools.product(
        (0.002, 0.1), zip(names, (0.8, 2.0), strict=True)
    ):
        time = np.arange(0.0, 8.0, period)
        goals = np.outer(1.0 - np.cos(speed * np.pi / 2.0 * time), np.linspace(0.3, 0.8, 7))
        stream = GoalStream(limits, T, goals[0], period=period, delay=max(2, round(0.6 / period)))
        spent, worst = process_time(), 0.0
        for k in range(1, len(time)):
            before = process_time()
            stream.push(goals[k])
            stream.take(round(k * period / T))
            worst = max(worst, process_time() - before)
        share = (process_time() - spent) / time[-1]
        report.line(
            STREAM,
            f"7 joints, {1 / period:.0f} Hz, {name:14}: {share:.2%} of a core, one take at most "
            f"{1e3 * worst:.1f} ms, lag at most {stream.report.largest_lag:.3f} s",
        )


@pytest.mark.parametrize("smoothing", [0.1, 1e-4])
def test_quantised_goals(report: Any, smoothing: float) -> None:
    """500 Hz, counts of 1/500 of the way: jerk beside that of the motion behind them, and lag."""
    limits, t = Limits(2.0, 10.0, 100.0), np.arange(0.0, 6.0, 0.002)
    goals = np.round(0.25 * (1.0 - np.cos(np.pi * t)) / 1e-3) * 1e-3
    stream = GoalStream([limits], T, [0.0], period=0.002, delay=200, smoothing=smoothing)
    blocks = []
    for k in range(1, len(t)):
        stream.push([goals[k]])
        blocks += stream.take(2 * k)
    lengths = np.concatenate([block.lengths.ravel() for block in blocks])
    jerk = np.repeat(np.concatenate([block.jerk.ravel() for block in blocks]), lengths)
    ratio = float(np.sqrt(np.mean(jerk[2000:5000] ** 2)) / (0.25 * np.pi**3 / np.sqrt(2.0)))
    rows = np.arange(2000, 5000)
    due = 0.25 * (1.0 - np.cos(np.pi * ((rows + 1) * T - 0.4 + 0.002)))
    off = float(np.sqrt(np.mean((_positions(iter(blocks))[rows + 1, 0] - due) ** 2)))
    report.line(
        STREAM,
        f"500 Hz in counts of 1/500 of the way, smoothing {smoothing:g}: jerk rms {ratio:.2f} of "
        f"the true one, position rms {off:.1e}, lag {stream.report.largest_lag:.3f} s",
    )
    if smoothing == 0.1:
        assert ratio <= 2.0
        assert stream.report.largest_lag == 0.0


@pytest.mark.parametrize("ahead", [0.05, 0.1])
@pytest.mark.parametrize("every", [1, 2, 5, 10, 20])
def test_tracking_a_sine(report: Any, every: int, ahead: float) -> None:
    """0.5 (1 - cos pi t), told every few cycles with its velocity: beside ruckig."""
    limits, period = Limits(2.175, 7.5, 500.0), every * T
    t = np.arange(0.0, 5.0, period)
    stream = GoalStream([limits], T, [0.0], period=period, delay=round(ahead / period), knots=24)
    blocks = []
    for k in range(1, len(t)):
        position, velocity = _sine(t[k])
        stream.push([position], velocity=[velocity])
        blocks += stream.take(every * k)
    rows = np.arange(1000, 4000)
    own = _positions(iter(blocks))[rows, 0] - _sine(rows * T - ahead + period)[0]
    otg, out, inp = ruckig.Ruckig(1, T), ruckig.OutputParameter(1), ruckig.InputParameter(1)
    inp.max_velocity, inp.max_acceleration = [limits.velocity], [limits.acceleration]
    inp.max_jerk = [limits.jerk]
    other = []
    for k in range(4000):
        if k % every == 0:
            position, velocity = _sine(k * T + ahead)
            inp.target_position, inp.target_velocity = [position], [velocity]
        otg.update(inp, out)
        out.pass_to_input(inp)
        other.append(out.new_position[0])
    theirs = np.array(other)[rows] - _sine((rows + 1) * T)[0]
    ratio = float(np.sqrt(np.mean(own**2) / np.mean(theirs**2)))
    report.line(
        STREAM,
        f"sine told every {every:2} cycles, {ahead} s ahead: error rms / that of planning anew "
        f"with ruckig {ratio:.1e}",
    )
    assert ratio <= (0.1 if every < 20 or ahead == 0.1 else 0.2)  # 20 cycles: 30 ms are known ahead


@pytest.mark.parametrize("every", [1, 3, 5, 10, 20])
def test_following_a_sine_by_moves(report: Any, every: int) -> None:
    """The same told as State(g, v) to plan(moving=True) from where the axis is: beside ruckig."""
    limits = Limits(2.175, 7.5, 500.0)
    ratios = []
    for ahead in (0.0, 0.02, 0.05, 0.1):
        otg, out, inp = ruckig.Ruckig(1, T), ruckig.OutputParameter(1), ruckig.InputParameter(1)
        inp.max_velocity, inp.max_acceleration = [limits.velocity], [limits.acceleration]
        inp.max_jerk = [limits.jerk]
        updater, own, theirs = Updater([0.0], limits, T, moving=True), [], []
        for k in range(4000):
            if k % every == 0:
                position, velocity = map(float, _sine(k * T + ahead))
                inp.target_position, inp.target_velocity = [position], [velocity]
                target = State(position, velocity)
            own.append(float(updater.update([target]).position[0]))
            otg.update(inp, out)
            out.pass_to_input(inp)
            theirs.append(out.new_position[0])
        true = _sine(np.arange(1001, 4001) * T)[0]
        errors = [np.sqrt(np.mean((np.array(x)[1000:] - true) ** 2)) for x in (own, theirs)]
        ratios.append(float(errors[0] / errors[1]))
    report.line(
        STREAM,
        f"sine told every {every:2} cycles to moves that meet it on its line, 0 to 0.1 s ahead: "
        f"error rms / ruckig's {min(ratios):.2f} .. {max(ratios):.2f}  goal <= 1",
    )


def _sine(t: Any) -> tuple[Any, Any]:
    return 0.5 * (1.0 - np.cos(np.pi * t)), 0.5 * np.pi * np.sin(np.pi * t)


def _interrupted(goals: np.ndarray, limits: list[Limits]) -> np.ndarray:
    rows, knot = [goals[:1]], Knot.rest(goals[0])
    for goal in goals[1:]:
        move = join(knot, goal, limits, T)
        if move.cycles.sum() > 100 and (goal != goals[-1]).any():
            move, _ = split(move, 100)
        rows.append(move.sample().position)
        knot = Knot.of(move)
    return np.concatenate(rows)


def _streamed(stream: GoalStream, goals: np.ndarray) -> np.ndarray:
    blocks = []
    for k, goal in enumerate(goals[1:], start=1):
        stream.push(goal)
        blocks += stream.take(100 * k)
    stream.end()
    while not stream.done:
        blocks += stream.take(stream.cycle + 100)
    return _positions(iter(blocks))


def test_dense_way_points(report: Any) -> None:
    """The same plan at 2 ms: met exactly, and within a tolerance."""
    way = dense_plan()
    for tolerance in (1e-2, 1e-3, 1e-4):
        made = follow_within(way, PANDA, T, tolerance=tolerance)
        taken = sum(int(block.cycles.sum()) for block in made.blocks) * T
        report.line(
            TABLE,
            f"2 ms within {tolerance:g} rad: {len(made.kept)} of {len(way)} way-points met, "
            f"largest deviation {made.largest:.2g}, time {taken / way.duration:.3f} of the plan's",
        )
        assert made.largest <= tolerance
