"""The demo's path in virtual time: streams that nothing holds up, and the time-optimal bound.

On a machine that leaves out cycles a stream makes up what it has lost as fast as the limits allow,
at all of its jerk. What the stream itself asks for is seen where no cycle is left out. Never here:
kernels, clocks, pictures.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sjerk.planner import plan
from sjerk.profile import FloatArray, Limits, State
from sjerk.trajectory import GoalStream, RecordedPath


@dataclass(frozen=True)
class Motion:
    """Samples of one joint, one per cycle; arrays (cycles,), axis units, s."""

    label: str
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray

    @property
    def cycles(self) -> int:
        """From the first commanded change to the last."""
        changed = np.flatnonzero(np.diff(self.position) != 0.0)
        return int(changed[-1] + 1 - changed[0]) if len(changed) else 0

    def back(self, way: FloatArray) -> int:
        """How often it turns more than positions (n,) do."""
        return max(0, _turns(self.position) - _turns(way))


def stream(
    recording: RecordedPath,
    limits: Limits,
    cycle_time: float,
    *,
    delay: int,
    margin: float,
    stop_within: bool,
) -> Motion:
    """The recording, each goal at its time, followed with look-ahead."""
    period = float(np.median(np.diff(recording.time)))
    way = recording.position
    follower = GoalStream(
        limits,
        cycle_time,
        way[:1],
        period=period,
        delay=delay,
        margin=margin,
        stop_within=stop_within,
    )
    blocks = []
    for due, goal in zip(recording.time[1:], way[1:], strict=True):
        follower.push([float(goal)], float(due))
        blocks += follower.take(max(1, round(float(due) / cycle_time)))
    follower.end()
    while not follower.done:
        blocks += follower.take(follower.cycle + 1)
    samples = [block.sample() for block in blocks]
    columns = (
        np.concatenate([getattr(one, name)[:, 0] for one in samples])
        for name in ("position", "velocity", "acceleration", "jerk")
    )
    return Motion("stop within" if stop_within else "look-ahead", *columns)


def time_optimal(recording: RecordedPath, limits: Limits, cycle_time: float) -> Motion:
    """Through the same points as fast as the limits allow; at rest only where the path turns.

    One joint passes all points between two turns on its way: no motion that keeps the limits, and
    rests there, is sooner at the end.
    """
    way = recording.position
    begin, parts = float(way[0]), list[FloatArray]()
    for end in way[[*_tops(way), len(way) - 1]].tolist():
        made = plan(State(begin), State(end), limits, cycle_time).sample()
        rows = np.stack([made.position, made.velocity, made.acceleration, made.jerk])
        parts.append(rows[:, 1:] if parts else rows)
        begin = end
    return Motion("time-optimal", *np.concatenate(parts, axis=1))


def motions(
    recording: RecordedPath, limits: Limits, cycle_time: float, *, delay: int, margin: float
) -> list[Motion]:
    """Both streams, and the fastest motion last."""
    streams = [
        stream(recording, limits, cycle_time, delay=delay, margin=margin, stop_within=stop_within)
        for stop_within in (True, False)
    ]
    return [*streams, time_optimal(recording, limits, cycle_time)]


def table(
    recording: RecordedPath,
    found: Sequence[Motion],
    limits: Limits,
    cycle_time: float,
    dips: Callable[[FloatArray], int],
) -> str:
    """The figures of motions in virtual time; ``dips`` of a velocity are counted."""
    last = float(recording.time[-1])
    rows = [
        ("in virtual time, no cycle left out", [motion.label for motion in found]),
        (
            "largest jerk, of its limit",
            [f"{np.abs(motion.jerk).max() / limits.jerk:.2%}" for motion in found],
        ),
        ("dips of the velocity > 10 %", [str(dips(motion.velocity)) for motion in found]),
        (
            "turns that the path does not have",
            [str(motion.back(recording.position)) for motion in found],
        ),
        (
            f"in motion, compared with the path's {last:.2f} s",
            [f"{motion.cycles * cycle_time - last:+.3f} s" for motion in found],
        ),
    ]
    return "\n".join(f"{name:46}" + "".join(f"{cell:>24}" for cell in row) for name, row in rows)


def _tops(way: FloatArray) -> list[int]:
    """Where positions turn: the last of equal ones."""
    step = np.sign(np.diff(way))
    moves = np.flatnonzero(step)
    return [int(i) for i in moves[1:][step[moves[1:]] != step[moves[:-1]]]]


def _turns(way: FloatArray) -> int:
    return len(_tops(way))
