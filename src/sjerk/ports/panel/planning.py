"""A collision-free motion: a way by OMPL, timed by ``follow_path``, checked as it will be played.

OMPL's RRT-Connect (J. J. Kuffner, S. M. LaValle, 2000) gives way-points; what counts is judged
last: every sample that the kernel will command. Never here: pages, kernels.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from ompl import base, geometric, util

from sjerk.errors import SjerkError
from sjerk.limits import Limits
from sjerk.ports.panel.clearance import Clearance, Nearest
from sjerk.trajectory import follow_path
from sjerk.trajectory.segments import Followed

FloatArray = NDArray[np.float64]
Free = Callable[[FloatArray, FloatArray], bool]

util.setLogLevel(util.LogLevel.LOG_ERROR)

#: The way keeps this clearance (m), so that the smoothed motion still is clear.
GAP = 0.02
#: Of a way, configurations so far apart (rad, the largest of all joints) are checked.
STEP = 0.04
#: The motion stays so near to the lines of the way (rad, Euclidean).
CORRIDOR = 0.05
_RANGE = 0.8
_STRIDE = 8
_SHORTCUTS = 80
_UNKNOWN = Nearest(np.inf, "the axes", "nothing that is known")


class NoWayError(SjerkError):
    """There is no plan, with the reason."""


@dataclass(frozen=True, eq=False)
class Planned:
    """A motion that is planned: what the kernel will play, and what it comes near to.

    ``blocks``: for ``Host.follow``. ``position`` to ``jerk`` (n, N): its samples, one a cycle.
    ``clearance`` (m): the least of all samples, ``nearest`` who it is. ``shares`` (3,): of the
    axes' own limits of velocity, acceleration, jerk. ``spent``: seconds to find, to time, to check.
    """

    points: FloatArray
    blocks: tuple[Followed, ...]
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray
    duration: float
    nearest: Nearest
    shares: FloatArray
    spent: dict[str, float] = field(default_factory=dict)

    @property
    def clearance(self) -> float:
        """The least distance of all samples, m."""
        return self.nearest.distance

    @property
    def collides(self) -> bool:
        """Whether any sample touches anything."""
        return self.clearance <= 0.0


def plan(
    clear: Clearance | None,
    start: ArrayLike,
    goal: ArrayLike,
    limits: Sequence[Limits],
    cycle_time: float,
    *,
    zero: ArrayLike = 0.0,
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0),
    avoid: bool = True,
    seconds: float = 5.0,
) -> Planned:
    """A motion from ``start`` to ``goal`` (N,), as the kernel counts; the arm is at ``zero`` more.

    ``scale``: shares of the limits of velocity, acceleration, jerk. ``avoid`` False: the straight
    line, whatever it touches. The first way-point is ``start`` and the last one ``goal``, to the
    last bit. ``clear`` None: nothing is known of shapes, so it is the straight line. Raises
    NoWayError, PlanError.
    """
    first, last, offset = np.array(start, float), np.array(goal, float), np.asarray(zero, float)
    begun = time.perf_counter()
    _check_ends(clear, limits, first, last, offset, avoid)
    way = np.array([first, last])
    if avoid and clear is not None:
        way = find(clear, first + offset, last + offset, seconds=seconds) - offset
        way[0], way[-1] = first, last
    found = time.perf_counter()
    own = [
        Limits(one.velocity * scale[0], one.acceleration * scale[1], one.jerk * scale[2])
        for one in limits
    ]
    blocks = tuple(follow_path(way, own, cycle_time, corridor=CORRIDOR))
    if not blocks:
        raise NoWayError("the arm is at the goal")
    samples = [block.sample() for block in blocks]
    position, velocity, acceleration, jerk = (
        np.concatenate([getattr(one, name) for one in samples])
        for name in ("position", "velocity", "acceleration", "jerk")
    )
    timed = time.perf_counter()
    nearest = _UNKNOWN if clear is None else closest(clear, position + offset)
    most = [[one.velocity, one.acceleration, one.jerk] for one in limits]
    rows = (velocity, acceleration, jerk)
    shares = np.array([np.abs(row).max(axis=0) for row in rows]).T / np.array(most)
    spent = {
        "find": found - begun,
        "time": timed - found,
        "check": time.perf_counter() - timed,
    }
    return Planned(
        points=way,
        blocks=blocks,
        position=position,
        velocity=velocity,
        acceleration=acceleration,
        jerk=jerk,
        duration=len(position) * cycle_time,
        nearest=nearest,
        shares=shares.max(axis=0),
        spent=spent,
    )


def _check_ends(
    clear: Clearance | None,
    limits: Sequence[Limits],
    first: FloatArray,
    last: FloatArray,
    zero: FloatArray,
    avoid: bool,
) -> None:
    for what, q in (("start", first), ("goal", last)):
        if not np.isfinite(q).all():
            raise NoWayError(f"the {what} is no configuration")
        for i, (value, one) in enumerate(zip(q.tolist(), limits, strict=True)):
            low, high = one.position or (-np.inf, np.inf)
            if not low <= value <= high:
                name = f"axis {i}" if clear is None else clear.arm.names[i]
                raise NoWayError(
                    f"the {what} lies outside the range of {name}: {value:.4f}, "
                    f"it has {low:.4f} .. {high:.4f}"
                )
        if avoid and clear is not None:
            nearest = clear.nearest(q + zero)
            if nearest.distance <= GAP:
                raise NoWayError(f"the {what} leaves less than {1e3 * GAP:.0f} mm: {nearest}")


def find(
    clear: Clearance, start: FloatArray, goal: FloatArray, *, seconds: float = 5.0
) -> FloatArray:
    """Way-points (n, N) of a way that keeps ``GAP``, in angles of the arm; raises NoWayError."""

    def free(one: FloatArray, two: FloatArray) -> bool:
        n = max(2, int(np.ceil(np.abs(two - one).max() / STEP)) + 1)
        line = one + np.linspace(0.0, 1.0, n)[:, None] * (two - one)
        return bool((clear.distances(line) > GAP).all())

    if free(start, goal):
        return np.array([start, goal])
    n = len(start)
    ends = np.array([start, goal])
    low, high = np.minimum(clear.lower, ends.min(axis=0)), np.maximum(clear.upper, ends.max(axis=0))
    space = base.RealVectorStateSpace(n)
    bounds = base.RealVectorBounds(n)
    for i in range(n):
        bounds.setLow(i, float(low[i]))
        bounds.setHigh(i, float(high[i]))
    space.setBounds(bounds)
    setup = geometric.SimpleSetup(space)
    about = setup.getSpaceInformation()

    def read(state: Any) -> FloatArray:
        return np.array([state[i] for i in range(n)])

    def state_of(q: FloatArray) -> Any:
        state = space.allocState()
        for i in range(n):
            state[i] = float(q[i])
        return state

    def valid(state: Any) -> bool:
        return bool(clear.distances(read(state))[0] > GAP)

    setup.setStateValidityChecker(valid)
    about.setStateValidityCheckingResolution(STEP / float(np.linalg.norm(high - low)))
    setup.setStartAndGoalStates(state_of(start), state_of(goal))
    planner = geometric.RRTConnect(about)
    planner.setRange(_RANGE)
    setup.setPlanner(planner)
    setup.setup()
    if not setup.solve(seconds) or not setup.haveExactSolutionPath():
        raise NoWayError(f"no way is found in {seconds:g} s that keeps {1e3 * GAP:.0f} mm")
    way = np.array([read(state) for state in setup.getSolutionPath().getStates()])
    way[0], way[-1] = start, goal
    return _seen(_shortened(way, free), free)


def _shortened(way: FloatArray, free: Free) -> FloatArray:
    """With straight lines between random places of it, where these are free."""
    random = np.random.default_rng(1)
    for _ in range(_SHORTCUTS):
        if len(way) < 3:
            break
        at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))])
        one, two = np.sort(random.uniform(0.0, at[-1], 2))
        i, j = (int(np.searchsorted(at, x, "right")) - 1 for x in (one, two))
        if i == j or j + 1 >= len(way):
            continue
        a, b = (
            way[k] + (x - at[k]) / (at[k + 1] - at[k]) * (way[k + 1] - way[k])
            for k, x in ((i, one), (j, two))
        )
        if free(a, b):
            way = np.concatenate([way[: i + 1], [a, b], way[j + 1 :]])
    return way


def _seen(way: FloatArray, free: Free) -> FloatArray:
    """Without points that are not needed: from each the furthest one that can be gone to."""
    kept, at = [0], 0
    while at < len(way) - 1:
        to = len(way) - 1
        while to > at + 1 and not free(way[at], way[to]):
            to -= 1
        kept.append(to)
        at = to
    return way[kept]


def closest(clear: Clearance, q: FloatArray) -> Nearest:
    """What comes nearest of all samples ``q`` (n, N) in rad, none left out.

    One of some is measured. Between two of them no point of the arm moves further than the sum of
    angle times reach of its joints; only samples that this does not rule out are measured, too.
    """
    coarse = np.arange(0, len(q), _STRIDE)
    distances = np.full(len(q), np.inf)
    distances[coarse] = clear.distances(q[coarse])
    owner = np.minimum(np.arange(len(q)) // _STRIDE, len(coarse) - 1)
    moved = np.abs(q - q[coarse[owner]]) @ clear.reach
    least = distances[coarse].min()
    open_ = np.flatnonzero((distances[coarse[owner]] - moved < least) & np.isinf(distances))
    for part in np.array_split(open_, max(1, len(open_) // 512)):
        if len(part):
            distances[part] = clear.distances(q[part])
    return clear.nearest(q[int(distances.argmin())])
