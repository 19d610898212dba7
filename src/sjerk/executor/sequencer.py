"""The motion of an executor: one path after the other, each from where the one before is left.

``Sequencer`` starts a motion from rest or lets it take over from the one in play, and knows what to
do where the kernel says no. Never here: planning, goals.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sjerk.errors import InputError
from sjerk.executor.history import Cut, History
from sjerk.host import Feedback, Host, Path, PathFeedback, PathState, Progress
from sjerk.trajectory.segments import Followed, Knot

#: Cycles for an order to be taken by the kernel; and to begin with for planning too.
_TAKEN, _LEAD = 20, 32
#: A path that is passed more slowly is brought to rest instead.
_SLOWEST = 0.1


@dataclass(frozen=True, eq=False)
class Place:
    """Where a motion is to take over: ``lead`` cycles after the frame of ``cycle``."""

    path: Path
    cut: Cut
    lead: float
    cycle: int


class Sequencer:
    """The paths of one host, of which one is in play."""

    def __init__(self, host: Host) -> None:
        """None is in play."""
        self._host, self._T = host, host.cycle_time
        self.path: Path | None = None
        self.first = 1  # number of the first way-point of the newest motion
        self._history = History()
        self._before: tuple[Path, History] | None = None  # until the kernel has answered
        self._lead = _LEAD
        self._stopped = False  # by ``cancel``

    def update(self) -> None:
        """Feed it, in a caller's own loop, and forget what was passed."""
        if self.path is not None and not self._host.clocked:
            self.path.pump()
        if self.path is not None:
            self._history.forget(self.path.progress.point)

    @property
    def over(self) -> bool:
        """Whether nothing is in play."""
        return self.path is None or self.path.state.ended

    @property
    def lead(self) -> float:
        """Seconds before a motion takes over in which it is to be planned."""
        return self._lead * self._T

    @property
    def progress(self) -> Progress:
        """Of the path in play, in its own numbers."""
        assert self.path is not None
        return self.path.progress

    def time(self, progress: Progress) -> float:
        """Seconds of the newest motion that are over, as planned; 0 before it has taken over."""
        if progress.point < self.first:
            return 0.0
        return self._history.passed(progress.point) * self._T + progress.time

    def other(self, frame: Feedback) -> PathFeedback | None:
        """The path of another hand that the kernel has in play; None: there is none."""
        path, mine = frame.path, [self.path, *(self._before or ())[:1]]
        if path.state.ended or not path.axes:
            return None
        return None if any(own and own.goal_id == path.goal_id for own in mine) else path

    @property
    def plays(self) -> bool:
        """Whether the newest motion is known to be in play."""
        return self._before is None and self.path is not None and not self.path.state.ended

    # ---- motions

    def start(self, blocks: Iterator[Followed], axes: Sequence[int]) -> None:
        """From rest; raises what ``Host.follow`` does."""
        history = History()
        self.path = self._host.follow(history.keep(blocks), axes=axes)
        self._history, self._before, self.first = history, None, 1
        self._stopped = False

    def leads(self, axes: Sequence[int]) -> bool:
        """Whether a motion of these axes can take over: one of theirs is under way."""
        path = self.path
        return (
            path is not None
            and path.state is PathState.RUNS
            and list(path.axes) == list(axes)
            and not path.paused
            and path.progress.speed >= _SLOWEST
        )

    def place(self, ahead: float) -> Place | None:
        """Where a motion takes over in so many seconds, or as soon as it can be.

        None: the motion in play ends before.
        """
        assert self.path is not None
        frame, progress = self._host.feedback(), self.path.progress
        lead = max(self._lead / min(1.0, progress.speed), ahead / self._T)
        cycles = progress.time / self._T
        cut = self._history.find(progress.point, cycles, progress.speed * lead)
        return None if cut is None else Place(self.path, cut, lead, frame.cycle)

    def join(self, blocks: Iterator[Followed], place: Place) -> bool:
        """Take over there; False: it has been planned too late, or that place is none any more."""
        cut, path = place.cut, place.path
        spent = self._host.feedback().cycle - place.cycle
        if spent + _TAKEN > place.lead:
            self._lead = 2 * spent + _LEAD
            return False
        history = cut.before
        try:
            new = path.splice(history.keep(blocks), cut.at, after=cut.after)
        except InputError:
            self._lead *= 2
            return False
        self._before, self.path = (path, self._history), new
        self._history, self.first = history, cut.first
        self._stopped = False
        return True

    def verdict(self) -> bool | None:
        """Whether the newest motion is in play; None: not known yet. False: the one before is."""
        if self._before is None:
            return True
        assert self.path is not None
        state = self.path.state
        if state is PathState.SENT:
            return None
        before, self._before = self._before, None
        if state is not PathState.REFUSED:
            return True
        self.path.pump()  # so that the one before goes on
        self.path, self._history = before
        self._lead *= 2
        return False

    def cancel(self) -> None:
        """Come to rest on the path."""
        if self.path is not None:
            self._stopped = True
            self.path.cancel()

    def settle(self) -> None:
        """What another hand has stopped by now is of the past: a motion may begin after it."""
        path = self.path
        if path is not None and (
            path.state.ended or path.state is PathState.STOPS or self._host.link.ending(path.axes)
        ):
            self._stopped = True

    def disturbed(self, axes: Sequence[int]) -> bool:
        """Whether a stop or a goal of another hand is being taken, or carried out on the path."""
        path = self.path
        if path is not None and path.state is PathState.STOPS and not self._stopped:
            return True
        return self._host.link.ending({*axes, *(() if path is None else path.axes)})

    def check(self) -> None:
        """Raise where another hand has ended the newest motion: nothing is to begin after it.

        But for what had been ended when ``settle`` was called.
        """
        if self.path is not None and not self._stopped and self.over:
            self.path.check()

    def rests(self, frame: Feedback, axes: Sequence[int]) -> bool:
        """Whether these axes are at rest, and nothing is in play."""
        return self.over and not any(frame.axes[i].moving for i in axes)


def positions(frame: Feedback, axes: Sequence[int]) -> Knot:
    """Rest at the commanded positions."""
    return Knot.rest(np.array([frame.axes[i].position for i in axes]))


def counted(blocks: Iterator[Followed], add: Callable[[int], None]) -> Iterator[Followed]:
    """Blocks as they are taken; their stretches are added up."""
    for block in blocks:
        add(int(block.stretch.sum()))
        yield block
