"""The paper's experiment, one mode of the control node after the other, recorded cycle by cycle.

Never here: pictures, the command line.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sjerk import Host, Monitor, Recorder, SjerkError
from sjerk.cli import demo
from sjerk.trajectory import shipped_recording
from sjerk.trajectory.files import read_bag

HERE = Path(__file__).parent
TOPIC = "/joint_states"
#: Of the control node, and what the paper calls them.
MODES = {"interrupt": "interrupted", "stream": "look-ahead"}
READ_HZ = 500.0
_LONGEST_S = 30.0
#: Drawn before the first goal, and after all joints rest.
_BEFORE_S, _AFTER_S = 0.2, demo.AFTER_S
FloatArray = NDArray[np.float64]


class AwayError(SjerkError):
    """The machine stood still for longer than a drive on the cable waits."""


@dataclass(frozen=True, eq=False)
class Plan:
    """Joints, moments (n,) in s and positions (n, 7) in radians, as a motion planner has them."""

    names: list[str]
    time: FloatArray
    position: FloatArray

    @classmethod
    def shipped(cls) -> Plan:
        """The TOPP-RA plan of a Panda that sjerk ships, begun at zero."""
        names, moments, position, *_ = read_bag(shipped_recording().parent / "panda.mcap")
        rows = np.asarray(position)
        return cls(list(names), np.asarray(moments) - moments[0], rows - rows[0])

    def save(self, file: Path) -> None:
        """For the publisher."""
        rows = {"time": self.time.tolist(), "position": self.position.tolist()}
        file.write_text(json.dumps({"names": self.names, **rows}))


@dataclass(frozen=True, eq=False)
class Played:
    """What one mode has done.

    ``run``: joint 1, cycle by cycle. ``time`` (m,) of these cycles and ``sent`` (n,) of the goals,
    both in s from the first goal. ``command``, ``encoder`` (m, 7) in degrees. ``goals``: how many
    the node has read; ``age_ms``: of the oldest of them when it was read.
    """

    run: demo.Run
    time: FloatArray
    sent: FloatArray
    command: FloatArray
    encoder: FloatArray
    goals: int
    age_ms: float


def robot(folder: Path, plan: Plan, name: str, interface: str | None) -> Path:
    """The kernel's file: each joint under the paper's limits; joint 1 on the bus where one is."""
    limits = demo.LIMITS
    rows = [f'name = "{name}"', "cycle_time = 0.001"]
    if interface is not None:
        rows += ["[ethercat]", f'interface = "{interface}"', "lost = 100"]
    for k, joint in enumerate(plan.names):
        rows += [
            "[[axes]]",
            f'name = "{joint}"',
            'unit = "deg"',
            f"counts_per_unit = {demo.COUNTS_PER_DEGREE!r}",
            f"limits = {{ velocity = {limits.velocity}, acceleration = {limits.acceleration!r}, "
            f"jerk = {limits.jerk!r} }}",
        ]
        if k == 0 and interface is not None:
            # this machine is hardly a real-time one: as the demo, the drive bridges 3 ms by itself
            bridged = round(demo.BRIDGED_S / 0.001)
            startup = f'[["10F1:2", "u16", 65535], ["2100:3", "u16", {bridged}]]'
            rows += ["[axes.ethercat]", "position = 0", f"startup = {startup}"]
    file = folder / "panda.toml"
    file.write_text("\n".join(rows) + "\n")
    return file


def _behind_the_kernel() -> None:
    """ROS runs before all else where the system allows that, but for kernel and drive."""
    if os.sched_getscheduler(0) == os.SCHED_FIFO:
        before = os.sched_getparam(0).sched_priority
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(max(1, before // 2)))


@contextmanager
def program(
    words: Sequence[str], log: Path, prepare: Callable[[], None] | None = None
) -> Iterator[subprocess.Popen[bytes]]:
    """A program of its own until the end; ended by SIGTERM."""
    with log.open("ab") as file:
        process = subprocess.Popen(words, stdout=file, stderr=subprocess.STDOUT, preexec_fn=prepare)
    try:
        yield process
    finally:
        process.terminate()
        process.wait(_LONGEST_S)


def attached(name: str, process: subprocess.Popen[bytes]) -> Monitor:
    """Of a kernel that is starting; raises AwayError where it has ended instead."""
    end = time.monotonic() + _LONGEST_S
    while True:
        try:
            return Monitor.attach(name)
        except SjerkError as fault:
            if process.poll() is not None or time.monotonic() > end:
                raise AwayError(f"the kernel did not start: {fault}") from fault
            time.sleep(0.05)


def at_the_start(kernel: str, plan: Plan) -> None:
    """Every drive enabled, every joint at the first row; drives that were lost come back."""
    end = time.monotonic() + _LONGEST_S
    with Host.attach(kernel, wait=_LONGEST_S) as host:
        while True:
            try:
                host.reset()
                host.enable()
                host.move(np.degrees(plan.position[0])).wait(_LONGEST_S)
            except (SjerkError, TimeoutError) as fault:
                if time.monotonic() > end:
                    raise AwayError(f"not at the start: {fault}") from fault
                time.sleep(0.05)
            else:
                return


def play(kernel: str, plan: Plan, mode: str, ros: str, folder: Path) -> Played:
    """One mode, from the plan's first row to rest on its last.

    Raises AwayError where a drive on the cable was lost, SjerkError for what is a fault.
    """
    at_the_start(kernel, plan)
    log = folder / f"{mode}.log"
    words = ["-m", "sjerk", ros, "control", "--kernel", kernel, "--ros-args"]
    for key, value in (("mode", mode), ("read_rate", READ_HZ), ("goal_topic", TOPIC)):
        words += ["-p", f"{key}:={value}"] if ros == "ros2" else [f"_{key}:={value}"]
    publisher = [str(HERE / f"{ros}_publisher.py"), str(folder / "plan.json"), TOPIC]
    told = folder / f"{mode}.json"
    told.unlink(missing_ok=True)
    with (
        program([sys.executable, *words], log, _behind_the_kernel) as node,
        Monitor.attach(kernel) as monitor,
        Recorder(kernel, None) as recorder,
        program([sys.executable, *publisher], told, _behind_the_kernel) as planner,
    ):
        first = monitor.feedback()
        _until_rest(monitor, [node, planner], np.degrees(plan.position[-1]), log, told)
        time.sleep(_AFTER_S)
        skipped = monitor.feedback().timing.late - first.timing.late
    lines = [json.loads(line) for line in told.read_text().splitlines()]
    sent = np.array([line["sent"] for line in lines if "sent" in line])
    found = recorder.recording
    # from shortly before the first goal on
    ahead = (sent[0] - first.time_ns * 1e-9 - _BEFORE_S) / found.cycle_time
    after = first.cycle + max(0, int(ahead))
    run = demo.Run.of(
        MODES[mode],
        found,
        after,
        missed=recorder.missed,
        skipped=skipped,
        told=first.bus is not None,
    )
    rows = found.cycle > after
    began = found.all.frames["time_ns"][rows] * 1e-9
    return Played(
        run,
        began - sent[0],
        sent - sent[0],
        found.position[rows],
        found.actual_position[rows],
        int(lines[-1]["goals"]),
        max(float(line["age_max_ms"]) for line in lines if "age_max_ms" in line),
    )


def _until_rest(
    monitor: Monitor,
    programs: Sequence[subprocess.Popen[bytes]],
    last: FloatArray,
    *logs: Path,
) -> None:
    """Until the planner has ended and all joints rest on the plan's last row."""
    node, planner = programs
    end = time.monotonic() + _LONGEST_S
    while True:
        frame = monitor.feedback()
        off = max(abs(axis.position - q) for axis, q in zip(frame.axes, last, strict=True))
        rests = off < 1e-9 and all(axis.settled for axis in frame.axes)
        if rests and planner.poll() == 0:
            return
        codes = [axis.error_code for axis in frame.axes if axis.fault]
        if frame.bus is not None and codes and all(code in demo.AWAY for code in codes):
            raise AwayError(f"the drive was without its main device: {codes[0]:04X}h")
        if codes or node.poll() is not None or planner.poll() or time.monotonic() > end:
            said = "\n".join(log.read_text(errors="replace") for log in logs)
            raise SjerkError(f"{off:g} deg from the plan's end; the programs say:\n{said}")
        time.sleep(0.01)
