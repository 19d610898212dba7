"""How well streams by topic are followed, in virtual time: what a busy machine cannot blur.

The same classes as in the nodes, messages by their fields, a kernel in steps whose clock is the
time. Over the wire the judges of ROS 2 and ROS 1 look at the same.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace as Fields
from typing import Any

import numpy as np
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from sjerk import Axis, Limits, MotionKernel
from sjerk.ports.ros.following import Following
from sjerk.ports.ros.joints import Joints
from sjerk.ports.ros.messages import stamp_of
from sjerk.ports.ros.parameters import CONTROL, CONTROLLER
from sjerk.ports.ros.topic import TopicMotion

NAMES = ("shoulder", "elbow")
#: In rad; the first axis is in degrees.
LIMITS = Limits(2.0, 8.0, 400.0)
DEG = 180.0 / np.pi
#: Between the samples that are looked at, s; messages come and are late by whole ones.
T = 5e-3


#: One run takes a second: what is found is told as it is.
TRIED = (Phase.explicit, Phase.reuse, Phase.generate)


class Bench:
    """A kernel in steps, whose commands are kept; ``turn`` is called each 10 ms."""

    def __init__(self) -> None:
        scaled = Limits(*(x * DEG for x in (LIMITS.velocity, LIMITS.acceleration, LIMITS.jerk)))
        self.kernel = MotionKernel(
            [Axis(scaled, 1e5, "ideal", unit="deg"), Axis(LIMITS, 1e7, "ideal", unit="rad")]
        )
        self.host = self.kernel.host()
        self.host.enable()
        self.kernel.step(5)
        self.joints = Joints.of(NAMES, ["deg", "rad"])
        self.turn: Callable[[float], None] = lambda now: None
        self.now = 0.0
        self._rows: list[list[float]] = []

    def step(self, samples: int) -> None:
        """So many, with a turn at each second one."""
        for _ in range(samples):
            self.kernel.step(5)
            self.now += T
            if round(self.now / T) % 2 == 0:
                self.turn(self.now)
            axes = self.host.feedback().axes
            self._rows.append(
                [axes[1].position, axes[1].velocity, axes[1].acceleration, axes[0].position / DEG]
            )

    @property
    def commands(self) -> np.ndarray:
        """Position, velocity, acceleration of the elbow, position of the shoulder: (n, 4)."""
        return np.array(self._rows)


def message(names: Any, begin: float, times: Any, rows: Any, velocities: Any = None) -> Any:
    """A JointTrajectory by its fields."""

    def stamp(t: float) -> Any:
        sec, nanosec = stamp_of(t)
        return Fields(sec=sec, nanosec=nanosec)

    points = [
        Fields(
            positions=list(row),
            velocities=[] if velocities is None else list(velocities[i]),
            accelerations=[],
            time_from_start=stamp(float(times[i])),
        )
        for i, row in enumerate(rows)
    ]
    return Fields(header=Fields(stamp=stamp(begin)), joint_names=list(names), points=points)


class Wave:
    """A cosine from rest to rest and on: position and velocity at a time."""

    def __init__(self, amplitude: float, pace: float) -> None:
        self.amplitude, self.pace = amplitude, pace

    def at(self, t: Any) -> np.ndarray:
        """Position."""
        return self.amplitude * (1 - np.cos(self.pace * np.maximum(t, 0.0)))

    def speed(self, t: Any) -> np.ndarray:
        """Velocity."""
        return self.amplitude * self.pace * np.sin(self.pace * np.maximum(t, 0.0))

    @property
    def acceleration(self) -> float:
        """Its largest one."""
        return self.amplitude * self.pace**2


def lag(commands: np.ndarray, wave: Wave, most: float = 1.0) -> float:
    """The delay (s) at which the commands are nearest to the wave."""
    t = np.arange(1, len(commands) + 1) * T
    steady = t > 1.5
    delays = np.arange(-0.1, most, 1e-3)
    off = [np.square(commands[steady, 0] - wave.at(t[steady] - d)).sum() for d in delays]
    return float(delays[int(np.argmin(off))])


def controller(bench: Bench, **changed: Any) -> TopicMotion:
    """What follows trajectories by topic."""
    values = {parameter.name: parameter.default for parameter in CONTROLLER} | changed
    topic = TopicMotion(bench.host, bench.joints, values.__getitem__)
    bench.turn = topic.turn
    return topic


waves = st.tuples(st.floats(0.05, 0.6), st.floats(0.3, 1.0)).map(lambda x: Wave(*x))


@given(waves, st.integers(0, 2**32 - 1))
@settings(max_examples=8, phases=TRIED)
def test_windows_of_a_servo_node_are_tracked(wave: Wave, seed: int) -> None:
    """Windows of 0.1 s at 100 Hz, up to 5 ms late: acceptance test 7.

    Off by 1 % of the amplitude, behind by two periods, the velocity off by 5 % of its largest.
    """
    draw, bench = np.random.default_rng(seed), Bench()
    topic = controller(bench, topic_mode="track")
    for _ in range(400):
        late = int(draw.integers(0, 2))
        sent = bench.now
        bench.step(late)
        at = 0.01 * np.arange(11)
        rows = np.repeat(wave.at(sent + at)[:, None], 2, axis=1)
        speeds = np.repeat(wave.speed(sent + at)[:, None], 2, axis=1)
        topic.take(message(NAMES[::-1], sent, at, rows, speeds), sent, bench.now)
        bench.step(2 - late)
    t = np.arange(1, len(bench.commands) + 1) * T
    steady = t > 1.0
    off = np.abs(bench.commands[:, 0] - wave.at(t))[steady].max()
    ripple = np.abs(bench.commands[:, 1] - wave.speed(t))[steady].max()
    assert off <= 0.01 * wave.amplitude
    assert ripple <= 0.05 * wave.amplitude * wave.pace
    assert abs(lag(bench.commands, wave)) <= 0.02


@given(waves, st.integers(0, 2**32 - 1))
@settings(max_examples=3, phases=TRIED)
def test_chunks_of_a_policy_are_a_smooth_stream(wave: Wave, seed: int) -> None:
    """Twelve positions at 20 Hz, a chunk each 0.2 s, without velocities: acceptance test 8.

    Followed on the wave itself, some time behind it, with at most 1.2 of its own acceleration.
    """
    draw = np.random.default_rng(seed)

    bench = Bench()
    topic = controller(bench, topic_mode="stream", **{"stream.period": 0.05, "stream.delay": 8})
    for _ in range(25):
        late = int(draw.integers(0, 2))
        sent = bench.now
        bench.step(late)
        at = 0.05 * np.arange(12)
        rows = np.repeat(wave.at(sent + at)[:, None], 2, axis=1)
        topic.take(message(NAMES, sent, at, rows), sent, bench.now)
        bench.step(40 - late)
    commands = bench.commands
    steady = commands[200:]
    assert np.abs(steady[:, 2]).max() <= 1.2 * wave.acceleration
    delay = lag(commands, wave)
    t = np.arange(1, len(commands) + 1) * T
    off = np.abs(commands[:, 0] - wave.at(t - delay))[t > 1.5].max()
    assert off <= 0.01 * wave.amplitude
    assert delay <= 8 * 0.05 + 0.2


@given(st.floats(0.3, 1.2), st.integers(0, 2**32 - 1))
@settings(max_examples=8, phases=TRIED)
def test_the_far_end_of_a_topic_interface_stays_near_and_arrives(reach: float, seed: int) -> None:
    """A hardware interface's commands at 100 Hz, up to 5 ms late: acceptance test 9.

    Tracked they are a fifth as far off as when each interrupts, and at the end below 1e-5, where
    the interface falls silent.
    """
    lateness = np.random.default_rng(seed).integers(0, 2, 400)

    def farthest(mode: str) -> tuple[float, float]:
        bench = Bench()
        values = {parameter.name: parameter.default for parameter in CONTROL} | {"mode": mode}
        told: list[str] = []
        following = Following(bench.host, bench.joints, values.__getitem__, told.append)
        bench.turn = following.turn
        most, seconds = 0.0, 3.0
        for k in range(400):
            sent = bench.now
            share = min(1.0, sent / seconds)
            command = reach * share**2 * (3 - 2 * share)
            state = bench.commands[-1, 0] if k else 0.0
            most = max(most, abs(state - command))
            bench.step(int(lateness[k]))
            # the interface is silent where nothing changes
            if 2 * abs(state - command) > 1e-5:
                following.take(NAMES, [command] * 2, [], sent=sent, now=bench.now)
            bench.step(2 - int(lateness[k]))
        bench.step(400)
        assert told == []
        return most, abs(bench.commands[-1, 0] - reach)

    tracked, off = farthest("track")
    interrupted, _ = farthest("interrupt")
    assert tracked <= 0.2 * interrupted
    assert off <= 1e-5
