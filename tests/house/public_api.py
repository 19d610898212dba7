"""All public names, used as a program of another package uses them.

mypy and pyright read it in ``./run lint``, with the types that sjerk ships. A test runs it.
"""

from __future__ import annotations

from pathlib import Path as FilePath
from tempfile import TemporaryDirectory
from typing import assert_type

import sjerk
from sjerk import (
    Axis,
    Clock,
    Drive,
    DriveConfig,
    GoalStream,
    Host,
    InfeasibleError,
    InputError,
    KernelGoneError,
    Limits,
    Monitor,
    MotionKernel,
    MotionStoppedError,
    Move,
    Path,
    PlanError,
    Profile,
    QueueFullError,
    Reactions,
    Recorder,
    Recording,
    RefusedError,
    Samples,
    SjerkError,
    State,
    StreamPlayer,
    SupersededError,
    Trajectory,
    TrajectoryError,
    TrajectoryExecutor,
    follow,
    follow_path,
    follow_stops,
    follow_within,
    plan,
    plan_many,
    plan_velocity,
    replay,
    resample,
    scurve,
    simulate,
)

T = 1e-3
LIMITS = Limits(velocity=2.0, acceleration=20.0, jerk=500.0)
WAY = Trajectory(["elbow"], [0.0, 0.5, 1.0], [[0.0], [0.2], [0.3]])


def plans() -> None:
    """Closed form, planner, many at once."""
    profile = assert_type(scurve(1.0, LIMITS, T), Profile)
    samples = assert_type(profile.sample(), Samples)
    assert float(samples.position[-1]) == 1.0
    assert_type(profile.cycles, int)
    assert_type(profile.duration, float)
    single = assert_type(plan(State(0.1, velocity=0.2), 1.0, LIMITS, T), Profile)
    assert single.cycles > 0
    both = plan([0.0, 0.0], [1.0, 2.0], [LIMITS] * 2, T, synchronization="phase")
    for own in both:
        assert_type(own, Profile)
    slowed = assert_type(plan_velocity(State(0.0, velocity=1.0), 0.0, LIMITS, T), Profile)
    assert slowed.end.velocity == 0.0
    assert_type(float(plan_many([0.0, 1.0], [1.0, 0.0], LIMITS, T).duration[0]), float)


def trajectories() -> None:
    """Way-points with times and without, goals told while they come."""
    blocks = list(follow(WAY, [LIMITS], T))
    assert sum(int(block.cycles.sum()) for block in blocks) == 1000
    assert list(follow_path([[0.0], [0.3]], [LIMITS], T))
    assert [motion.cycles for motion in follow_stops([[0.0], [0.3]], [LIMITS], T)]
    assert_type(follow_within(WAY, [LIMITS], T, tolerance=1e-3).largest, float)
    assert len(resample(WAY.position, 0.05)) >= 2
    stream = GoalStream([LIMITS], T, [0.0], period=0.1)
    stream.push([0.01])
    assert_type(stream.done, bool)


def drives() -> None:
    """A drive in a loop of one's own."""
    drive = Drive(DriveConfig(period_s=T))
    assert_type(drive.enable().follows, bool)


def kernels(folder: FilePath) -> None:
    """A kernel in virtual time, one in a process, and who speaks to it."""
    axis = Axis(LIMITS, 1e6, "ideal", name="elbow", unit="rad")
    recording = assert_type(
        simulate(MotionKernel([axis], T), [(1, lambda host: host.enable())], 50), Recording
    )
    assert_type(replay(recording).identical, bool)
    clock, reactions = Clock(priority=0), Reactions()
    with MotionKernel([axis], T, clock=clock, reactions=reactions) as kernel:
        with Recorder(kernel, None) as recorder, kernel.host() as host:
            command(host, kernel.name)
        assert_type(recorder.recording, Recording)


def command(host: Host, name: str) -> None:
    """Moves, paths, streams, goals; what stands in the way is an error of its kind."""
    host.enable()
    move = assert_type(host.move(0.3), Move)
    try:
        move.wait(timeout=30.0)
    except SupersededError as newer:
        assert_type(newer.positions, dict[int, float])
    except (MotionStoppedError, RefusedError, QueueFullError, KernelGoneError) as ended:
        raise SjerkError(str(ended)) from ended
    with Monitor.attach(name) as monitor:
        assert_type(monitor.feedback().axes[0].position, float)
    host.move(0.0).wait(timeout=30.0)
    path = assert_type(host.follow(follow(WAY, [LIMITS], T)), Path)
    path.wait(timeout=30.0)
    executor = TrajectoryExecutor(host, ["elbow"])
    executor.close()
    player = StreamPlayer(host, period=0.05)
    player.close()


def errors() -> None:
    """Each tells what was wrong, with data."""
    try:
        Limits(velocity=-1.0, acceleration=1.0, jerk=1.0)
    except InputError as wrong:
        assert_type(wrong.field, str)
    try:
        Trajectory(["a"], [0.1, 0.1], [[0.0], [1.0]])
    except TrajectoryError as wrong_points:
        assert_type(wrong_points.faults[0].point, int | None)
    assert issubclass(InfeasibleError, SjerkError)
    assert issubclass(PlanError, SjerkError)


def main() -> None:
    """All of it."""
    plans()
    trajectories()
    drives()
    errors()
    with TemporaryDirectory() as folder:
        kernels(FilePath(folder))
    print(f"{len(sjerk.__all__)} names")


if __name__ == "__main__":
    main()
