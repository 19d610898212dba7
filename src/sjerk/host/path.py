"""The handle of a path in a kernel: its orders, its progress, and waiting for its end.

``Host.follow`` makes a ``Path``. The kernel plays it in its cycle (``_path.c``); its segments are
fed as the ring takes them, so a path of any length needs constant memory. Never here: planning,
feeding, the layout of the memory.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import Any

from sjerk._binding import lib
from sjerk.errors import InputError, SupersededError
from sjerk.host.answers import refusal, stopped
from sjerk.host.arguments import check_factor
from sjerk.host.feedback import PathState, limits_of
from sjerk.host.link import Link
from sjerk.host.path_feeder import PathFeeder
from sjerk.host.path_goal import PathGoal
from sjerk.host.path_records import Blocks
from sjerk.host.turns import Turns

_NAMES = ("velocity", "acceleration", "jerk")


@dataclass(frozen=True)
class Progress:
    """How far a path is, by the newest feedback.

    ``point``: the way-point ahead; ``time`` (s): passed since the one before, in the path's own
    time; ``speed``: 1 as planned; ``known``: the last way-point that the kernel has; ``fed``: the
    last one that was sent to it; ``complete``: whether that is the path's end.
    """

    point: int
    time: float
    speed: float
    known: int
    fed: int
    complete: bool


class Path:
    """Handle of a followed trajectory in a kernel; ``await path`` does what ``wait`` does.

    Its axes are ``AxisState.SYNCHRONIZED_MOTION``. At full speed the commanded samples are those of
    ``Followed.sample()`` bit for bit. ``pause``, ``speed`` and ``cancel`` change the speed *on the
    path*, within the limits of all axes in every cycle: the stop does not leave it, and after
    ``resume`` the samples are those of ``sample()`` again. Where segments do not come in time the
    motion comes to rest on the path and goes on by itself when they do.

    >>> from sjerk import Axis, Limits, MotionKernel, Trajectory, follow
    >>> limits = Limits(2.0, 20.0, 500.0)
    >>> way_points = Trajectory(["elbow"], [0.0, 0.5, 1.0], [[0.0], [0.3], [0.5]])
    >>> kernel = MotionKernel([Axis(limits, 1e6, "ideal")])
    >>> host = kernel.host()
    >>> host.enable()
    >>> kernel.step(5)
    >>> path = host.follow(follow(way_points, [limits], kernel.cycle_time))
    >>> while not path.done:
    ...     _ = path.pump()
    ...     kernel.step(10)
    >>> host.feedback().axes[0].position
    0.5
    """

    def __init__(self, link: Link, goal: PathGoal, feeder: PathFeeder) -> None:
        """Not for callers: ``Host.follow`` makes it, or ``splice``."""
        self._link, self._goal, self._feeder = link, goal, feeder

    def pump(self) -> bool:
        """Send as many segments as the ring has room for; whether all have been sent.

        For a caller's own loop: call it now and then between ``MotionKernel.step``. With a process
        a thread does it. Raises what the source of the blocks raises, once; the path is cancelled.
        """
        return self._feeder.pump()

    # ---- commanding

    def pause(self) -> None:
        """Come to rest on the path; ``resume`` goes on."""
        self._goal.paused = True
        self._goal.order()

    def resume(self) -> None:
        """Go on along the path, up to the speed that was set."""
        self._goal.paused = False
        self._goal.order()

    def speed(self, factor: float) -> None:
        """Pass the path at another speed, 0 .. 2; 1 is as planned. Times the kernel's override.

        Above 1 as far and as long as the limits of all axes allow it. 0 waits as ``pause`` does.
        Raises InputError.
        """
        check_factor(factor)
        self._goal.speed = factor
        self._goal.order()

    def cancel(self) -> None:
        """Come to rest on the path and drop the rest of it; nothing if it is over."""
        self._goal.cancel()

    def splice(self, blocks: Blocks, at: int, *, after: int = 0) -> Path:
        """Go on along other segments; this path is superseded by the new one.

        They take over at way-point ``at - 1`` of this path, or so many cycles ``after`` it on the
        way to ``at``, in the state in which it passes there (velocity, acceleration, jerk of the
        cycle before): its own, or that of a plan with the same way-points around it. The place
        where they take over is a way-point then; numbers go on from there. Speed and pause are
        kept; until the kernel has answered, orders to either path are for both. Raises InputError
        where the place has been passed, or has not been sent. Where the kernel finds that it has
        been passed or is counted on, the new path is refused, and this one goes on as it was.
        """
        progress = self.progress
        for name, value in (("at", at), ("after", after)):
            if isinstance(value, bool) or not isinstance(value, int) or value < 0:
                raise InputError(name, value, "must be an int, not negative")
        if after > lib.SJ_CYCLES_MAX:
            raise InputError("after", after, f"must be up to {lib.SJ_CYCLES_MAX} cycles")
        if at < progress.point + (after == 0):
            raise InputError("at", at, f"the way-point ahead is {progress.point}")
        if at > progress.fed + (after == 0):
            raise InputError("at", at, f"sent are way-points up to {progress.fed}")
        if self._feeder.yields:
            raise InputError("at", at, "another path is to take over already")
        self._link.cancels_taken()
        goal = PathGoal(self._link, self._goal.axes, before=self._goal)
        feeder = PathFeeder(self._link, goal, blocks, before=self._feeder, at=at, after=after)
        return Path(self._link, goal, feeder)

    # ---- what has become of it

    @property
    def axes(self) -> tuple[int, ...]:
        """Axis numbers, in the order of the joints."""
        return tuple(self._goal.axes)

    @property
    def goal_id(self) -> int:
        """Number of this goal in feedback and events."""
        return self._goal.goal_id

    @property
    def factor(self) -> float:
        """The speed that was asked for last; 1 is as planned."""
        return self._goal.speed

    @property
    def paused(self) -> bool:
        """Whether a pause was asked for last, and not ``resume``."""
        return self._goal.paused

    @property
    def state(self) -> PathState:
        """What has become of it, by the newest feedback."""
        return self._goal.state(self._link.frame())

    @property
    def done(self) -> bool:
        """Whether the command is on the last way-point."""
        return self.state is PathState.DONE

    @property
    def progress(self) -> Progress:
        """How far it is."""
        reported = self._link.frame().path
        mine = reported.goal_id == self._goal.goal_id
        return Progress(
            point=int(reported.number) if mine else 0,
            time=float(reported.cycle) * self._link.cycle_time if mine else 0.0,
            speed=float(reported.speed) if mine else 0.0,
            known=int(reported.known) if mine else 0,
            fed=self._feeder.fed,
            complete=self._feeder.complete,
        )

    def wait(self, timeout: float | None = None) -> None:
        """Return when the command is on the last way-point.

        Raises RefusedError (with the reason), SupersededError (another path took over),
        MotionStoppedError (stopped, or left the path), what the source of the blocks raised,
        KernelGoneError, TimeoutError.
        """
        what = f"path {self._goal.goal_id}"
        self._link.wait_until(lambda frame: self._goal.state(frame).ended, timeout, what)
        self.check()

    def stopped(self, timeout: float | None = None) -> None:
        """Return when it is over or at rest on the path, whatever the reason."""
        self._link.wait_until(self._at_rest, timeout, f"path {self._goal.goal_id} to rest")

    def _at_rest(self, frame: Any) -> bool:
        state = self._goal.state(frame)
        if state is PathState.STARVES:
            return bool(frame.path.speed == 0.0)
        return state.ended or state is PathState.PAUSED

    def __await__(self) -> Generator[Any, None, None]:
        return self._settle().__await__()

    async def _settle(self) -> None:
        await self._link.until(lambda: self.state.ended, "a path")
        self.check()

    def check(self) -> None:
        """Raise what ``wait`` would, where the path has ended otherwise than at its end."""
        frame = self._link.frame()
        state = self._goal.state(frame)
        if self._feeder.error is not None:
            raise self._feeder.error
        if state is PathState.DONE or not state.ended:
            return
        position = {i: float(frame.axis[i].position) for i in self._goal.axes}
        if state is PathState.REFUSED:
            code, axis = self._link.answers.result(self._goal.goal_id, frame) or (0, -1)
            if code in (lib.SJ_RESULT_NONE, lib.SJ_RESULT_ACCEPTED):
                code = frame.path.result
            axis, detail = self._reason(code, frame, axis)
            raise refusal(code, axis, detail, names=self._link.names)
        if state is PathState.SUPERSEDED:
            raise SupersededError(position, names=self._link.names)
        raise stopped(frame, self._goal.axes, names=self._link.names)

    def _reason(self, code: int, frame: Any, axis: int) -> tuple[int, str]:
        """The axis that a refusal is about, or -1, and the values, as far as they are known here.

        Where the kernel names no ``axis`` it is the one that is furthest off.
        """
        found: list[tuple[float, int, str]] = []
        for k, i in enumerate(self._goal.axes):
            if axis not in (-1, i):
                continue
            raw = frame.axis[i]
            if code == lib.SJ_RESULT_START and self._feeder.records.start:
                asked, now = self._feeder.records.start[k], float(raw.position)
                [apart] = Turns.nearest([asked], [now], [raw.wrap]).onto([asked]) - now
                text = f"it begins at {asked!r}, the axis is at {now!r}"
                found.append((abs(float(apart)), i, text))
            elif code == lib.SJ_RESULT_LIMITS:
                own = limits_of(raw, self._link.cycle_time)
                least = (
                    own.velocity,
                    min(own.acceleration, own.deceleration or own.acceleration),
                    min(own.jerk, own.deceleration_jerk or own.jerk),
                )
                for name, value, most in zip(
                    _NAMES, self._feeder.records.peaks[:, k].tolist(), least, strict=True
                ):
                    text = f"{name} {value:g} on the path, the axis has {most:g}"
                    found.append((value / most - 1.0 - 1e-9, i, text))
        off, which, detail = max(found, default=(0.0, axis, ""))
        return (which, detail) if off > 0.0 else (axis, "")


def play(link: Link, blocks: Blocks, axes: Sequence[int]) -> Path:
    """A path of its own; ``axes``: one per joint. Raises as ``Host.follow`` does."""
    goal = PathGoal(link, axes)
    return Path(link, goal, PathFeeder(link, goal, blocks))
