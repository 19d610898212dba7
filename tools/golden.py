"""The golden programs: what they compute is the same to the bit on every processor.

    python tools/golden.py [--renew]     print each hash; exit code 1 where one is another

Plans, samples, a followed trajectory, a kernel with simulated drives and a kernel with emulated
EtherCAT drives, all in virtual time, from inputs that use sums and products only. ``--renew``
records what is computed now. Needs sjerk alone, so that it runs on any machine.
"""

from __future__ import annotations

import hashlib
import json
import platform
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sjerk import Axis, Limits, MotionKernel, Trajectory, plan, plan_many, simulate
from sjerk.host import Host
from sjerk.ports.ethercat import Line, MainDevice
from sjerk.trajectory.stretching import stretched

RECORDED = Path(__file__).resolve().parent / "golden.json"
T = 1e-3
LIMITS = Limits(90.0, 500.0, 5000.0)
PLANS = 200_000


def uniform(seed: int, low: float, high: float, *shape: int) -> NDArray[np.float64]:
    """Numbers from a generator of whole numbers, by one product and one sum each."""
    state, count = np.uint64(seed), int(np.prod(shape))
    with np.errstate(over="ignore"):
        z = state + np.arange(1, count + 1, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)  # splitmix64
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z ^= z >> np.uint64(31)
    share = (z >> np.uint64(11)).astype(np.float64) * 2.0**-53
    return (low + (high - low) * share).reshape(shape)


def plans() -> Iterator[Any]:
    """Any state to any target, limits of three sizes, also those of braking."""
    start = np.column_stack(
        [uniform(1, -200, 200, PLANS), uniform(2, -90, 90, PLANS), uniform(3, -500, 500, PLANS)]
    )
    target = np.column_stack([uniform(4, -200, 200, PLANS), uniform(5, -40, 40, PLANS)])
    columns = (90.0, 500.0, 5000.0, 300.0, 8000.0)
    limits = np.column_stack(
        [uniform(6 + i, 0.5 * v, 2.0 * v, PLANS) for i, v in enumerate(columns)]
    )
    made = plan_many(start, target, limits, T)
    for name in ("cycles", "count", "kind"):
        yield made.rows[name]
    count, first = made.rows["count"].astype(np.int64), made.rows["first"]
    before = np.cumsum(count) - count
    used = np.arange(count.sum()) + np.repeat(first - before, count)
    yield made.pool["cycles"][used]
    yield made.pool["jerk"][used]


def samples() -> Iterator[Any]:
    """Whole motions, one axis and seven in step."""
    goals = uniform(20, -1e4, 1e4, 40)
    for goal in goals:
        made = plan(0.0, float(goal), LIMITS, T).sample()
        yield from (made.position, made.velocity, made.acceleration)
    for row in uniform(21, -300, 300, 20, 7):
        for rule in ("time", "phase"):
            motion = plan([0.0] * 7, row.tolist(), [LIMITS] * 7, T, synchronization=rule)
            yield motion.sample().position


def followed() -> Iterator[Any]:
    """Way-points of seven joints in their times."""
    time = np.arange(41) / 20.0
    way = np.cumsum(uniform(30, -0.05, 0.05, 41, 7), axis=0)
    limits = [Limits(2.0, 8.0, 400.0)] * 7
    for block in stretched(Trajectory([f"j{i}" for i in range(7)], time, way - way[0]), limits, T):
        yield block.cycles
        yield block.sample().position


def kernel() -> Iterator[Any]:
    """Three simulated drives: moves, changes of target, a jog, stops, feed-forward."""
    axes = [
        Axis(LIMITS, 2**24 / 360.0),
        Axis(LIMITS, 2**24 / 360.0, feed_forward="torque"),
        Axis(LIMITS, 2**24 / 360.0, gear=50.0),
    ]
    targets = uniform(40, -150, 150, 20, 3)

    def go(row: NDArray[np.float64]) -> Callable[[Host], object]:
        return lambda host: host.move(row.tolist())

    script: list[tuple[int, Callable[[Host], object]]] = [(1, lambda host: host.enable())]
    script += [(50 + 300 * k, go(row)) for k, row in enumerate(targets)]
    script += [(6500, lambda host: host.jog({0: 30.0})), (7000, lambda host: host.halt(timeout=0))]
    recording = simulate(MotionKernel(axes, T), script, 8000)
    yield recording.position
    yield recording.velocity
    yield recording.acceleration
    yield recording.actual_position


def ethercat() -> Iterator[Any]:
    """A kernel as main device of two emulated drives, joined in virtual time; clocks that drift."""
    axis = Axis(Limits(20.0, 400.0, 4e4), 2**24, "external", unit="rev")
    line = Line(drives=2, drift_ppm=20)
    made = MotionKernel([axis] * 2, T)
    host = made.host()
    with MainDevice(made, line, {0: 0, 1: 1}) as main:
        host.enable()
        for k, goals in enumerate(([0.0, 0.0], [3.0, -2.0], [-1.5, 0.25])):
            if k:
                host.move(goals)
            for _ in range(1500):
                main.exchange()
                yield [
                    x
                    for own in host.feedback().axes
                    for x in (own.position, own.velocity, own.actual_position)
                ]
        yield [device["position"] for device in line.status()["devices"]]


PROGRAMS: dict[str, Callable[[], Iterator[Any]]] = {
    f"{PLANS} plans": plans,
    "samples": samples,
    "followed": followed,
    "kernel": kernel,
    "ethercat": ethercat,
}


def hashed(program: Callable[[], Iterator[Any]]) -> str:
    """SHA-256 over everything it yields, as little-endian numbers of eight bytes."""
    made = hashlib.sha256()
    for values in program():
        array = np.asarray(values)
        made.update(array.astype("<f8" if array.dtype.kind == "f" else "<i8").tobytes())
    return made.hexdigest()


def main() -> int:
    """1 where a hash is not the recorded one."""
    found = {}
    recorded = json.loads(RECORDED.read_text()) if RECORDED.exists() else {}
    renew = "--renew" in sys.argv[1:]
    for name, program in PROGRAMS.items():
        found[name] = hashed(program)
        verdict = "recorded" if renew else "same" if recorded.get(name) == found[name] else "OTHER"
        print(f"{platform.machine()} {name}: {found[name]} {verdict}", flush=True)
    if renew:
        RECORDED.write_text(json.dumps(found, indent=2) + "\n")
    return 0 if renew or found == recorded else 1


if __name__ == "__main__":
    raise SystemExit(main())
