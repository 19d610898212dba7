"""Studies: what is mapped over processes is pure and can be pickled."""

from __future__ import annotations

import math
import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from sjerk import (
    Axis,
    Clock,
    InputError,
    Limits,
    MotionKernel,
    Reactions,
    Recording,
    SjerkError,
    Trajectory,
    TrajectoryError,
    errors,
    follow,
    plan_many,
    simulate,
)
from sjerk.drive.config import DriveConfigError
from sjerk.drive.entries import Abort, SdoError
from sjerk.planner.batch import Plans
from sjerk.ports.ethercat.access import BusError, RefusedStateError
from sjerk.ports.ethercat.mailbox import AbortError
from sjerk.ports.ethercat.states import AlState
from sjerk.trajectory.faults import FaultKind, RecordedPathError, TrajectoryFault

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


def refused(_: int) -> Plans:
    """A batch with a row that is none."""
    return plan_many([0.0, 1.0], [1.0, math.nan], LIMITS, 1e-3)


def test_an_error_of_a_worker_arrives_as_it_was_raised() -> None:
    """With its fields; else the pool breaks, and the study dies without a reason."""
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=spawn) as pool:
        with pytest.raises(InputError) as here:
            refused(0)
        with pytest.raises(InputError) as there:
            pool.submit(refused, 0).result(timeout=300)
        assert str(there.value) == str(here.value)
        assert (there.value.field, there.value.limit) == (here.value.field, here.value.limit)
        assert pool.submit(abs, -1).result(timeout=300) == 1


ERRORS: list[SjerkError] = [
    SjerkError("text"),
    InputError("jerk", -1.0, "must be greater than 0"),
    errors.ConfigError("robot.toml", "axes[0].unit", 3, "must be a text"),
    errors.ExtraMissingError("rich", "monitor"),
    errors.PlatformError("sjerk.Host"),
    errors.InfeasibleError(1.0, 2.0, "too short"),
    errors.RefusedError(3, "not enabled", 1, ["shoulder", "elbow"]),
    errors.MotionStoppedError({1: 0.25}, {1: 0x8611}, 1, {1: 3}, names=["shoulder", "elbow"]),
    errors.SupersededError({0: 1.0}),
    errors.QueueFullError(512),
    errors.SegmentMissingError("no kernel runs", name="robot"),
    errors.SegmentOwnerError("of another", name="robot", uid=7),
    errors.SegmentMemoryError("no memory", name="robot", size=4096),
    errors.SegmentGarbageError("none of ours", name="robot", status=-3),
    errors.HostTakenError("taken", name="robot", pid=12),
    errors.KernelRestartedError("restarted", name="robot", epoch=3),
    DriveConfigError("period_s", 0.0, 2.5e-5, 0.1),
    SdoError(Abort.READ_ONLY, 0x6041, 0),
    TrajectoryError([TrajectoryFault(FaultKind.JOINTS, "is missing", joint="a")] * 2),
    RecordedPathError(Path("path.csv"), "no number", 3),
    BusError("no answer", 3),
    RefusedStateError(1, AlState.OP, 0x14, 0x1A),
    AbortError(0, 0x6064, 0, 0x06010002),
]


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
def test_errors_are_pickled_with_their_data(error: SjerkError) -> None:
    """Type, text and every attribute; notes too."""
    error.add_note("row 7")
    for protocol in range(pickle.HIGHEST_PROTOCOL + 1):
        again = pickle.loads(pickle.dumps(error, protocol))
        assert type(again) is type(error)
        assert str(again) == str(error)
        assert again.args == error.args
        assert vars(again) == vars(error)
        for name in ("name", "path"):  # ImportError keeps them elsewhere
            assert getattr(again, name, None) == getattr(error, name, None)


def test_no_error_with_data_is_forgotten() -> None:
    """Each class of errors that has data of its own is tried above."""

    def below(kind: type[SjerkError]) -> set[type[SjerkError]]:
        return {kind}.union(*(below(one) for one in kind.__subclasses__()))

    own = {kind for kind in below(SjerkError) if "__init__" in vars(kind)}
    assert own - {errors.HandshakeError, errors.SegmentFormatError} <= {type(e) for e in ERRORS}


def test_a_kernel_that_has_not_begun_can_be_pickled() -> None:
    """It runs the same there; one that has begun says why not."""
    axes = [Axis(LIMITS, 2**24 / 360, name="a"), Axis(LIMITS, 1e6, "ideal", start=2.0)]
    reactions, clock = Reactions(host_death="quick stop"), Clock(priority=3)
    kernel = MotionKernel(axes, 2e-3, name="study", reactions=reactions, clock=clock)
    again = pickle.loads(pickle.dumps(kernel))
    assert (again.axes, again.cycle_time, again.name) == (tuple(axes), 2e-3, "study")
    assert (again.reactions, again.clock) == (reactions, clock)
    script = [(1, lambda host: host.enable()), (20, lambda host: host.move([5.0, 3.0]))]
    assert bits(simulate(again, script, 400)) == bits(simulate(kernel, script, 400))
    with pytest.raises(SjerkError, match="'study' has begun"):
        pickle.dumps(kernel)


def test_a_pickled_kernel_without_a_name_gets_its_own() -> None:
    """Both run at once."""
    first = MotionKernel([Axis(LIMITS, 1e6, "ideal")])
    second = pickle.loads(pickle.dumps(first))
    with first as one, second as other:
        assert one.alive
        assert other.alive
        assert one.name != other.name
