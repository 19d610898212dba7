"""``sjerk follow``: a trajectory from a file, played on a kernel. Never here: motion, layouts."""

from __future__ import annotations

import argparse
import sys
import threading
from collections.abc import Sequence
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
from sjerk.ports.ros.joints import Joints
from sjerk.trajectory import ExecutionMode, Trajectory, TrajectoryError

_REFUSED, _STOPPED = 3, 4


def add_arguments(jobs: Any) -> None:
    """Add follow."""
    job = jobs.add_parser("follow", help="play a trajectory on a kernel; returns at its end")
    job.add_argument("path", type=Path, help="CSV (time, joint, ...) or ROS 2 bag (rad, m)")
    where = job.add_mutually_exclusive_group()
    where.add_argument("--name", help="of the kernel; default: the only one that runs")
    where.add_argument("--kernel", type=Path, help="run the kernel of this TOML file meanwhile")
    job.add_argument("--any-owner", action="store_true", help="also a kernel of another user")
    modes = [mode.value for mode in ExecutionMode]
    job.add_argument("--mode", choices=modes, default="full_trajectory")
    job.add_argument("--delta", type=float, default=0.0, help="resample, axis units")
    job.add_argument("--tolerance", type=float, default=0.0, help="of dense points, axis units")
    job.add_argument("--scale", type=float, default=1.0, help="of the speed, up to 2")
    job.add_argument("--joints", nargs="+", help="of the file; without named axes: in order")
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
        axes = _axes_of(host, options, trajectory.joint_names)
        units = [axis.unit for axis in host.feedback().axes]
        trajectory = _fit(trajectory, axes, units, options.path)
        executor = open_.enter_context(
            TrajectoryExecutor(
                host,
                list(axes),
                axes=list(axes.values()),
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
            _result(options, host, goal, list(axes.values()))
    if goal.status is GoalStatus.SUCCEEDED:
        return 0
    return _REFUSED if goal.status is GoalStatus.REJECTED else _STOPPED


def _read(path: Path) -> Trajectory:
    try:
        return (Trajectory.from_csv if path.suffix.lower() == ".csv" else Trajectory.from_bag)(path)
    except TrajectoryError as error:
        raise InputError("path", str(path), str(error)) from error


def _axes_of(host: Host, options: argparse.Namespace, known: Sequence[str]) -> dict[str, int]:
    """The axis of each joint that is played: the one of its name; where no axis has one, in order.

    ``known``: the joints of the file.
    """
    names = list(options.joints or known)
    for name in names:
        if name not in known:
            raise InputError("joints", name, f"the file has {', '.join(known)}")
        if names.count(name) > 1:
            raise InputError("joints", name, "is named twice")
    if not set(names) & set(host.names):
        if len(names) > host.axis_count:
            text = f"the kernel has {host.axis_count} axes: --joints picks some"
            raise InputError("joints", names, text)
        return {name: i for i, name in enumerate(names)}
    for name in names:
        if name not in host.names:
            there = ", ".join(axis or f"axis {i}" for i, axis in enumerate(host.names))
            raise InputError("joints", name, f"the kernel has {there}: --joints picks some")
    return {name: host.names.index(name) for name in names}


def _fit(
    trajectory: Trajectory, axes: dict[str, int], units: Sequence[str], path: Path
) -> Trajectory:
    """Of these joints, in the units of their axes; bags are in radians and metres."""
    columns = [trajectory.joint_names.index(name) for name in axes]
    position, velocity, acceleration = (
        None if rows is None else rows[:, columns]
        for rows in (trajectory.position, trajectory.velocity, trajectory.acceleration)
    )
    assert position is not None
    way = Trajectory(list(axes), trajectory.time, position, velocity, acceleration)
    if path.suffix.lower() == ".csv":
        return way
    return Joints.of(list(axes), [units[i] for i in axes.values()]).trajectory(way)


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


def _result(
    options: argparse.Namespace, host: Host, goal: GoalHandle, played: Sequence[int]
) -> None:
    if not options.json:
        print(file=sys.stderr)
    axes = host.feedback().axes
    show(
        options,
        {
            "status": goal.status.value,
            "code": int(goal.code),
            "result": ResultCode(goal.code).name,
            "text": goal.text,
            "stretch_s": goal.stretch,
            "positions": [
                {"axis": i, "position": axes[i].position, "unit": axes[i].unit} for i in played
            ],
        },
    )
