"""Studies: what is mapped over processes is pure and can be pickled."""

from __future__ import annotations

import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sjerk import Axis, Limits, MotionKernel, Recording, Trajectory, follow, plan_many, simulate
from sjerk.planner.batch import Plans

LIMITS = Limits(90.0, 500.0, 5000.0)
TIME = np.linspace(0.0, 2.0, 21)
WAY = Trajectory(["a", "b"], TIME, np.column_stack([TIME**2, -(TIME**3)]))


def planned(seed: int) -> Plans:
    """Plans of random states."""
    rng = np.random.default_rng(seed)
    start = rng.uniform(-90, 90, (500, 3))
    return plan_many(start, rng.uniform(-90, 90, 500), LIMITS, 1e-3)


def followed(_: int) -> list[NDArray[np.float64]]:
    """A followed trajectory."""
    limits = [Limits(20.0, 80.0, 2000.0)] * 2
    return [block.sample().position for block in follow(WAY, limits, 1e-3)]


def simulated(_: int) -> Recording:
    """A kernel in virtual time."""
    script = [(1, lambda host: host.enable()), (20, lambda host: host.move(5.0))]
    return simulate(MotionKernel([Axis(LIMITS, 2**24 / 360)], name="study"), script, 400)


def bits(made: Any) -> bytes:
    """What a result says, to the bit."""
    if isinstance(made, Plans):
        return made.rows.tobytes() + b"".join(
            part.tobytes() for i in range(len(made)) for part in made.phases(i)
        )
    if isinstance(made, Recording):
        return made.position.tobytes() + made.actual_position.tobytes() + made.jerk.tobytes()
    return b"".join(part.tobytes() for part in made)


def test_a_result_is_the_same_in_another_process_and_through_pickle() -> None:
    """Of each function; a second call in this process gives it again."""
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=spawn) as pool:
        for work in (planned, followed, simulated):
            here = bits(work(7))
            assert here
            assert bits(work(7)) == here
            assert bits(pool.submit(work, 7).result(timeout=300)) == here
            assert bits(pickle.loads(pickle.dumps(work(7)))) == here


def test_a_recording_in_a_file_is_pickled_by_its_path(tmp_path: Path) -> None:
    """It is opened where it arrives, not carried."""
    made = simulated(0)
    made.save(tmp_path / "run.mcap")
    carried = pickle.dumps(Recording.open(tmp_path / "run.mcap"))
    assert len(carried) < 2000
    assert bits(pickle.loads(carried)) == bits(made)


def test_arguments_can_be_pickled() -> None:
    """Limits, axes and trajectories arrive as they were."""
    axis = Axis(LIMITS, 1e6, name="elbow", feed_forward="velocity")
    assert pickle.loads(pickle.dumps(axis)) == axis
    way = pickle.loads(pickle.dumps(WAY))
    assert (way.position == WAY.position).all()
    limits = [Limits(20.0, 80.0, 2000.0)] * 2
    again = [block.sample().position for block in follow(way, limits, 1e-3)]
    assert bits(again) == bits(followed(0))
