"""``sjerk follow``: a trajectory from a file, played on a kernel. Never here: motion, layouts."""

from __future__ import annotations

import argparse
import sys
import threading
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from sjerk.cli.arguments import duration
from sjerk.cli.common import host_of, show
from sjerk.errors import InputError
from sjerk.executor import (
    GoalFeedback,
    GoalHandle,
    GoalStatus,
    ResultCode,
    Settings,
    TrajectoryExecutor,
)
from sjerk.host import Host
from sjerk.kernel import load
from sjerk.trajectory import ExecutionMode, Trajectory, TrajectoryError

_REFUSED, _STOPPED = 3, 4


def add_arguments(jobs: Any) -> None:
    """Add follow."""
    job = jobs.add_parser("follow", help="play a trajectory on a kernel; returns at its end")
    job.add_argument("path", type=Path, help="CSV (time, joint, ...) or ROS 2 bag (radians)")
    where = job.add_mutually_exclusive_group()
    where.add_argument("--name", help="of the kernel; default: the only one that runs")
    where.add_argument("--kernel", type=Path, help="run the kernel of this TOML file meanwhile")
    job.add_argument("--any-owner", action="store_true", help="also a kernel of another user")
    modes = [mode.value for mode in ExecutionMode]
    job.add_argument("--mode", choices=modes, default="full_trajectory")
    job.add_argument("--delta", type=float, default=0.0, help="resample, axis units")
    job.add_argument("--tolerance", type=float, default=0.0, help="of dense points, axis units")
    job.add_argument("--scale", type=float, default=1.0, help="of the speed, up to 2")
    job.add_argument("--joints", nargs="+", help="names of the axes; default: the file's, in order")
    job.add_argument("--timeout", type=duration, help="seconds; then it stops")
    job.add_argument("--json", action="store_true", help="one JSON object per line")
    job.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Exit code 3 where it is refused, 4 where it is stopped; Ctrl-C stops it."""
    if options.scale == 0.0:  # of a running goal it is a pause, at the start it never ends
        raise InputError("scale", options.scale, "must be greater than 0, up to 2")
    settings = Settings(
        execution_mode=options.mode,
        resampling_delta=options.delta,
        tolerance=options.tolerance,
        speed=options.scale,
        allow_partial_joints=True,
        allow_end_velocity=True,
    )
    trajectory = _read(options.path)
    with ExitStack() as open_:
        if options.kernel is not None:
            host = open_.enter_context(open_.enter_context(load(options.kernel)).host())
            host.enable()
        else:
            host = open_.enter_context(host_of(options))
        names, trajectory = _fit(host, trajectory, options)
        executor = open_.enter_context(
            TrajectoryExecutor(
                host,
                names,
                settings=settings,
                on_feedback=_Progress(options, len(trajectory)).report,
            )
        )
        goal = executor.submit(trajectory)
        try:
            goal.result(options.timeout)
        except TimeoutError:
            _stop(host, goal)
            raise
        except KeyboardInterrupt:
            _stop(host, goal)
            raise
        finally:
            _result(options, host, goal)
    if goal.status is GoalStatus.SUCCEEDED:
        return 0
    return _REFUSED if goal.status is GoalStatus.REJECTED else _STOPPED


def _read(path: Path) -> Trajectory:
    try:
        return (Trajectory.from_csv if path.suffix.lower() == ".csv" else Trajectory.from_bag)(path)
    except TrajectoryError as error:
        raise InputError("path", str(path), str(error)) from error


def _fit(
    host: Host, trajectory: Trajectory, options: argparse.Namespace
) -> tuple[list[str], Trajectory]:
    """Names of the kernel's axes, and the trajectory in their units; bags are in radians."""
    axes = host.feedback().axes
    names = list(options.joints or trajectory.joint_names)
    if len(names) > len(axes):
        raise InputError("joints", names, f"the kernel has {len(axes)} axes: --joints picks some")
    for name in names:
        if name not in trajectory.joint_names:
            raise InputError("joints", name, f"the file has {', '.join(trajectory.joint_names)}")
        if names.count(name) > 1:
            raise InputError("joints", name, "is named twice")
    present = names.copy()
    columns = [trajectory.joint_names.index(name) for name in present]
    bag = options.path.suffix.lower() != ".csv"
    scale = np.array(
        [180.0 / np.pi if bag and axes[names.index(n)].unit == "deg" else 1.0 for n in present]
    )
    rows = [
        None if rows is None else rows[:, columns] * scale
        for rows in (trajectory.position, trajectory.velocity, trajectory.acceleration)
    ]
    assert rows[0] is not None
    names += [f"axis {i}" for i in range(len(names), len(axes))]
    return names, Trajectory(present, trajectory.time, rows[0], rows[1], rows[2])


def _stop(host: Host, goal: GoalHandle) -> None:
    goal.cancel()
    host.halt()


class _Progress:
    """How far it is: JSON lines, or one line that is written over."""

    def __init__(self, options: argparse.Namespace, points: int) -> None:
        self._options, self._points = options, points
        self._lock = threading.Lock()

    def report(self, goal: GoalHandle, feedback: GoalFeedback) -> None:
        """One line of feedback."""
        worst = float(np.abs(feedback.error).max())
        point = feedback.point + 1  # of the trajectory, counted as a person does
        with self._lock:
            if self._options.json:
                show(
                    self._options,
                    {
                        "point": point,
                        "points": self._points,
                        "desired": feedback.desired.tolist(),
                        "actual": feedback.actual.tolist(),
                        "error": worst,
                        "speed": feedback.speed,
                    },
                )
                return
            line = f"\rway-point {point} of {self._points}, speed {feedback.speed:.0%}"
            print(f"{line}, error {worst:.6f} ", end="", file=sys.stderr, flush=True)


def _result(options: argparse.Namespace, host: Host, goal: GoalHandle) -> None:
    if not options.json:
        print(file=sys.stderr)
    joints = goal.trajectory.joint_names
    axes = host.feedback().axes[: len(joints)]
    show(
        options,
        {
            "status": goal.status.value,
            "code": int(goal.code),
            "result": ResultCode(goal.code).name,
            "text": goal.text,
            "stretch_s": goal.stretch,
            "positions": [
                {"axis": i, "position": axis.position, "unit": axis.unit}
                for i, axis in enumerate(axes)
            ],
        },
    )
