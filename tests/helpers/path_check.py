"""A kernel that plays a path in the tests' own loop, and judges that look at positions only."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from helpers.following_check import PANDA, T, recording, toppra_plan
from sjerk import Axis, Host, Limits, MotionKernel, Path
from sjerk.host import PathState
from sjerk.trajectory.segments import Followed
from sjerk.trajectory.stretching import stretched

Array = NDArray[np.float64]
ENDED = (
    PathState.DONE,
    PathState.STOPPED,
    PathState.LEFT,
    PathState.REFUSED,
    PathState.SUPERSEDED,
)


def blocks_of(seed: int = 0, period: float = 0.1) -> list[Followed]:
    """TOPP-RA's plan of the Panda's seven joints, followed."""
    return list(stretched(toppra_plan(period, seed), PANDA, T, use_velocities=False))


class Bench:
    """A kernel with simulated drives, enabled, its axes at a position."""

    def __init__(self, at: Sequence[float], limits: Sequence[Limits] = PANDA) -> None:
        self.kernel = MotionKernel([Axis(limit, 1e6) for limit in limits], T)
        self.host: Host = self.kernel.host()
        self.host.enable()
        self.kernel.step(10)
        if any(at):
            move = self.host.move(list(at))
            while not move.done:
                self.kernel.step(50)
        self.kernel.step(5)
        self.limits = limits
        self.rows = [self.now()]

    def now(self) -> list[float]:
        frame = self.host.link.frame()
        return [frame.axis[i].position for i in range(frame.axes)]

    def play(self, blocks: Followed | Iterable[Followed | None]) -> Path:
        return self.host.follow(blocks)

    def run(
        self, path: Path, until: Callable[[], bool] = lambda: False, most: int = 40_000
    ) -> Array:
        """Step until the path is over, or as told; all positions so far."""
        for _ in range(most):
            path.pump()
            self.kernel.step()
            self.rows.append(self.now())
            if until() or path.state in ENDED:
                return self.positions
        raise AssertionError(f"still {path.state!r} after {most} cycles: {path.progress}")

    def skip(self, path: Path, cycles: int) -> None:
        """Step without a record; only where the motion is known."""
        path.pump()
        self.kernel.step(cycles)
        self.rows = []

    @property
    def positions(self) -> Array:
        return np.array(self.rows)


def begin_of(positions: Array) -> int:
    """The last row before anything moves."""
    return int(np.flatnonzero((positions != positions[0]).any(axis=1))[0]) - 1


def curve(position: Array, parts: int = 16) -> Array:
    """The path that the samples of an undisturbed motion lie on, by cubics through four of them."""
    whole = np.concatenate([position[:1], position, position[-1:]])
    t = np.arange(parts)[:, None, None] / parts
    p0, p1, p2, p3 = whole[:-3], whole[1:-2], whole[2:-1], whole[3:]
    points = (
        -t * (t - 1) * (t - 2) / 6 * p0
        + (t + 1) * (t - 1) * (t - 2) / 2 * p1
        - (t + 1) * t * (t - 2) / 2 * p2
        + (t + 1) * t * (t - 1) / 6 * p3
    )
    dense = points.transpose(1, 0, 2).reshape(-1, position.shape[1])
    return np.concatenate([dense, position[-1:]])


def along(dense: Array, rows: Array, begin: int, reach: int) -> tuple[Array, Array]:
    """Place on the curve (in its points) and distance from it, for rows that follow each other."""
    places, gaps = [], []
    at = begin
    for row in rows:
        low, high = max(at - reach, 0), min(at + reach, len(dense) - 1)
        start, way = dense[low:high], dense[low + 1 : high + 1] - dense[low:high]
        square = (way**2).sum(axis=1)
        share = ((row - start) * way).sum(axis=1) / np.where(square > 0.0, square, 1.0)
        share = np.clip(share, 0.0, 1.0)
        gap = np.sqrt(((row - start - share[:, None] * way) ** 2).sum(axis=1))
        i = int(np.argmin(gap))
        places.append(low + i + share[i])
        gaps.append(gap[i])
        at = low + i
    return np.array(places), np.array(gaps)


def keeps(position: Array, limits: Sequence[Limits], cycle_time: float = T) -> None:
    """First to third differences of consecutive positions, wherever they begin and end."""
    noise = 16 * np.finfo(float).eps * np.abs(position).max()
    for order, name in enumerate(("velocity", "acceleration", "jerk"), start=1):
        most = np.abs(np.diff(position, order, axis=0)).max(axis=0)
        for joint, limit in enumerate(limits):
            allowed = getattr(limit, name) * cycle_time**order
            assert most[joint] <= allowed * (1 + 1e-9) + noise * 2**order, (name, joint)


__all__ = [
    "ENDED",
    "PANDA",
    "Bench",
    "T",
    "along",
    "begin_of",
    "blocks_of",
    "curve",
    "keeps",
    "recording",
]
