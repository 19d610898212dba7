"""What all browsers share: the goal, the scene, poses, the plan; and the orders that use them.

Every order names the browser that gives it and is checked here, whatever its page allows. Never
here: pages, drawing.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sjerk.errors import InputError, SjerkError
from sjerk.host import Feedback
from sjerk.host import Path as PlayedPath
from sjerk.limits import Limits
from sjerk.ports.panel.clearance import Clearance
from sjerk.ports.panel.inverse import solve
from sjerk.ports.panel.journal import Journal
from sjerk.ports.panel.lead import Lead, NotLeadingError
from sjerk.ports.panel.planning import Planned, plan
from sjerk.ports.panel.settings import PanelSettings, name_of
from sjerk.ports.panel.shapes import Scene, Shape
from sjerk.ports.panel.taking import Taking
from sjerk.ports.panel.watching import Watching

FloatArray = NDArray[np.float64]

#: The commanded position may differ by so much (axis unit) from where a plan begins.
_SAME = 1e-9
_MOST_SHAPES = 32
_WORKERS = 16


class AskAgainError(SjerkError):
    """The plan collides: executing it needs a second click."""


def number(what: str, value: Any, low: float, high: float) -> float:
    """A number of a browser within its range; raises InputError."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(what, value, "must be a number")
    if not low <= value <= high:
        raise InputError(what, value, f"must be {low:g} .. {high:g}")
    return float(value)


def numbers(what: str, values: Any, names: Sequence[str], low: float, high: float) -> list[float]:
    """As many numbers as names; raises InputError."""
    if not isinstance(values, list | tuple) or len(values) != len(names):
        raise InputError(what, values, f"must be {len(names)} numbers: {', '.join(names)}")
    return [number(f"{what}.{n}", v, low, high) for n, v in zip(names, values, strict=True)]


@dataclass(frozen=True)
class Proposal:
    """A plan, and the scene that it is for."""

    plan: Planned
    scene: Scene
    made: float


class Desk:
    """Of one robot: ``feedback`` is the first one of its kernel, ``folder`` where files are."""

    def __init__(
        self,
        settings: PanelSettings,
        watching: Watching,
        lead: Lead,
        journal: Journal,
        feedback: Feedback,
        *,
        folder: Path,
        any_owner: bool = False,
    ) -> None:
        self.settings, self.watching, self.lead, self.journal = settings, watching, lead, journal
        #: Where files are read and recordings written.
        self.folder = folder
        self.taking = Taking(watching.name, journal, any_owner=any_owner, folder=folder)
        self.cycle_time = feedback.cycle_time
        self.axes = len(feedback.axes)
        self.units = [axis.unit or "unit" for axis in feedback.axes]
        self.names = [axis.name or f"axis {i}" for i, axis in enumerate(feedback.axes)]
        self.limits: list[Limits] = [axis.limits for axis in feedback.axes]
        self.zero = np.array(settings.zero)
        ranges = [one.position or (-math.inf, math.inf) for one in self.limits]
        self.lower, self.upper = np.array(ranges).T
        arm = settings.arm
        if arm is not None and set(self.units) != {"rad"}:
            raise SjerkError("panel.dh: an arm is drawn of axes in rad")
        if arm is not None and not np.isfinite(ranges).all():
            raise SjerkError("panel.dh: an arm is drawn of axes with position limits")
        self.arm = arm
        self.poses: dict[str, tuple[float, ...]] = dict(settings.poses)
        self.scene = settings.scene
        self._clear: tuple[Scene, Clearance] | None = None
        self.goal = np.array([axis.position for axis in feedback.axes])
        self.proposal: Proposal | None = None
        self.preview = False
        self._planning = threading.Lock()
        #: Where orders that take some time are worked on; and plans, which are made one by one:
        #: no other order is behind them, and nobody who leaves.
        self.workers = ThreadPoolExecutor(_WORKERS, thread_name_prefix="order")
        self.planner = ThreadPoolExecutor(1, thread_name_prefix="plan")

    # ---- what is there

    @property
    def clear(self) -> Clearance | None:
        """Distances of the arm to the scene of now."""
        if self.arm is None:
            return None
        scene, known = self.scene, self._clear
        if known is None or known[0] is not scene:
            low, high = self.lower + self.zero, self.upper + self.zero
            known = scene, Clearance(self.arm, low, high, scene)
            self._clear = known
        return known[1]

    def commanded(self) -> FloatArray:
        """Where the kernel has the axes now; raises SjerkError where it has ended."""
        return np.array(self.watching.positions())

    # ---- the goal, poses, the scene: of the browser that leads

    def set_goal(self, browser: int, q: Sequence[Any]) -> None:
        """Where to; raises InputError for what is outside the ranges."""
        self.lead.of(browser)
        self._goal_at(q)

    def _goal_at(self, q: Sequence[Any] | FloatArray) -> None:
        values = q.tolist() if isinstance(q, np.ndarray) else list(q)
        if len(values) != self.axes:
            raise InputError("goal", len(values), f"must be {self.axes} numbers")
        found = [
            number(name, value, low, high)
            for name, value, low, high in zip(
                self.names, values, self.lower.tolist(), self.upper.tolist(), strict=True
            )
        ]
        self.goal = np.array(found)
        self.proposal, self.preview = None, False

    def reach(self, browser: int, place: Sequence[Any], turn: Sequence[Any] | None = None) -> None:
        """Set the goal so that the flange is at a place (m), turned by roll, pitch, yaw (rad).

        ``turn`` None: as it is at the goal now. Raises UnreachableError, InputError.
        """
        self.lead.of(browser)
        if self.arm is None:
            raise SjerkError("there is no arm")
        angles = self.goal + self.zero
        pose = self.arm.tip(angles)[0]
        pose[:3, 3] = numbers("place", place, "xyz", -10.0, 10.0)
        if turn is not None:
            pose[:3, :3] = rotation(numbers("turn", turn, ("roll", "pitch", "yaw"), -7.0, 7.0))
        low, high = self.lower + self.zero, self.upper + self.zero
        found = solve(self.arm, pose, angles, low, high) - self.zero
        self._goal_at(np.clip(found, self.lower, self.upper))

    def go_to_pose(self, browser: int, name: object) -> None:
        """Set the goal to a pose of this name."""
        self.lead.of(browser)
        if not isinstance(name, str) or name not in self.poses:
            raise InputError("pose", name, "is not known")
        self._goal_at(self.poses[name])

    def save_pose(self, browser: int, name: object, *, before: object = None) -> None:
        """Keep the goal under a name, or rename the pose ``before``; into the TOML file."""
        self.lead.of(browser)
        new = name_of(name)
        poses = dict(self.poses)
        if before is None:
            poses[new] = tuple(self.goal.tolist())
        elif isinstance(before, str) and before in poses:
            poses = {new if key == before else key: q for key, q in poses.items()}
        else:
            raise InputError("pose", before, "is not known")
        self.settings.save(poses, self.scene)
        self.poses = poses
        self.journal.tell(f"pose {new!r} is saved")

    def set_shape(self, browser: int, name: object, shape: Shape | None) -> None:
        """Add, change or remove (None) what stands around; a plan for the old scene is void."""
        self.lead.of(browser)
        known = name_of(name)
        full = len(self.scene.shapes) >= _MOST_SHAPES and known not in self.scene.shapes
        if shape is not None and full:
            raise InputError("shapes", known, f"there are {_MOST_SHAPES} already")
        self.scene = self.scene.with_shape(known, shape)

    def save_scene(self, browser: int) -> None:
        """Keep the scene in the TOML file."""
        self.lead.of(browser)
        self.settings.save(self.poses, self.scene)
        self.journal.tell("the scene is saved")

    # ---- planning and executing

    def plan(self, browser: int, scale: Sequence[Any], *, avoid: bool) -> Proposal:
        """From the commanded state to the goal; raises NoWayError, PlanError, InputError."""
        self.lead.of(browser)
        names = ("velocity", "acceleration", "jerk")
        v, a, j = (number(n, s, 0.01, 1.0) for n, s in zip(names, scale, strict=True))
        with self._planning:
            self.lead.of(browser)  # it may have left while others planned
            scene, clear = self.scene, self.clear
            self.proposal, self.preview = None, False
            made = plan(
                clear,
                self.commanded(),
                self.goal,
                self.limits,
                self.cycle_time,
                zero=self.zero,
                scale=(v, a, j),
                avoid=avoid,
            )
            self.proposal = Proposal(made, scene, time.monotonic())
            self.preview = True
            return self.proposal

    def execute(
        self,
        browser: int,
        *,
        agreed: Proposal | None,
        speed: Any = 1.0,
        hold: bool = False,
        then: Callable[[str], None] | None = None,
        stops: int | None = None,
    ) -> PlayedPath:
        """Play the plan; refused where the arm or the scene has changed since.

        ``agreed``: the proposal that was clicked before; ``then`` and ``stops`` as of
        ``Lead.play``. Raises NotLeadingError, AskAgainError.
        """
        self.lead.of(browser)
        factor = number("speed", speed, 0.0, 2.0)
        proposal = self.proposal
        if proposal is None:
            raise NotLeadingError("nothing is planned")
        if proposal.scene is not self.scene:
            raise NotLeadingError("the scene has changed since: plan again")
        gap = np.abs(self.commanded() - proposal.plan.position[0])
        if gap.max() > _SAME:
            which = int(gap.argmax())
            raise NotLeadingError(
                f"{self.names[which]} has moved since by {gap[which]:.4g} {self.units[which]}: "
                "plan again"
            )
        if proposal.plan.collides:
            if agreed is not proposal:
                raise AskAgainError("the plan collides: click again to execute it all the same")
            self.journal.tell(
                f"browser {browser} executes a plan that collides: {proposal.plan.nearest}",
                bad=True,
            )
        self.preview = False
        blocks = proposal.plan.blocks
        path = self.lead.play(browser, blocks, speed=factor, hold=hold, then=then, stops=stops)
        self.proposal = None
        return path

    def record(self, browser: int) -> str:
        """Begin a recording, or end the one that goes on; what has become of it."""
        self.lead.of(browser)
        if self.taking.browser is None:
            return f"records to {self.taking.begin(browser)}"
        self.taking.end()
        return "the recording is whole"

    def left(self, browser: int, why: str) -> None:
        """A browser is gone, or no longer leads: what it started ends."""
        self.lead.give_back(browser, why)
        if self.taking.browser == browser:
            try:
                self.taking.end()
            except (SjerkError, OSError) as fault:
                self.journal.tell(str(fault), bad=True)

    def close(self) -> None:
        """End."""
        for pool in (self.workers, self.planner):
            pool.shutdown(wait=False, cancel_futures=True)
        self.lead.close()
        if self.taking.browser is not None:
            self.left(self.taking.browser, "the panel ends")


def rotation(turn: Sequence[float]) -> FloatArray:
    """Of roll, pitch, yaw (rad) about the fixed axes x, y, z.

    >>> rotation([0.0, 0.0, np.pi / 2]).round(9)[0].tolist()
    [0.0, -1.0, 0.0]
    """
    found: FloatArray = np.eye(3)
    for k, angle in enumerate(turn):
        c, s = np.cos(angle), np.sin(angle)
        one = np.eye(3)
        i, j = (k + 1) % 3, (k + 2) % 3
        one[i, i] = one[j, j] = c
        one[i, j], one[j, i] = -s, s
        found = one @ found
    return found


def turn_of(R: FloatArray) -> tuple[float, float, float]:
    """Roll, pitch, yaw (rad) of a rotation; yaw is 0 where the pitch is a right angle.

    >>> [round(a, 9) for a in turn_of(rotation([0.1, -0.2, 0.3]))]
    [0.1, -0.2, 0.3]
    """
    pitch = float(np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0])))
    if np.hypot(R[0, 0], R[1, 0]) < 1e-9:
        return float(np.arctan2(-R[1, 2], R[1, 1])), pitch, 0.0
    return float(np.arctan2(R[2, 1], R[2, 2])), pitch, float(np.arctan2(R[1, 0], R[0, 0]))
