"""One thread that does everything: jobs from any thread, what is due by time, what is waited for.

rospy calls back from threads of its own; a node hands all of it over to its one loop, so that
nothing of it happens at the same time. Never here: ROS.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass
class _Due:
    """A job that comes again and again."""

    every: float
    job: Callable[[], Any]
    at: float


class Turns:
    """The jobs of one loop, in the order in which they came.

    >>> turns = Turns()
    >>> told = []
    >>> turns.post(lambda: told.append("came"))
    >>> turns.turn(0.0)
    >>> told
    ['came']
    """

    def __init__(self) -> None:
        """None so far."""
        self._jobs: queue.SimpleQueue[Callable[[], Any]] = queue.SimpleQueue()
        self._due: list[_Due] = []
        self._waiting: list[tuple[Callable[[], bool], float, Callable[[bool], Any]]] = []

    def post(self, job: Callable[[], Any]) -> None:
        """Do this in the loop; from any thread."""
        self._jobs.put(job)

    def ask(self, job: Callable[[Callable[[Any], None]], Any], timeout: float) -> Any:
        """What ``job`` answers by the function that it gets, at once or later; from another thread.

        Raises TimeoutError where no answer came within the time (s).
        """
        answers: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self.post(lambda: job(answers.put))
        try:
            return answers.get(timeout=timeout)
        except queue.Empty:
            raise TimeoutError(f"no answer within {timeout:g} s") from None

    def every(self, period: float, job: Callable[[], Any]) -> None:
        """Do this each so many seconds; what is late is done once."""
        self._due.append(_Due(period, job, time.monotonic() + period))

    def until(
        self, condition: Callable[[], bool], timeout: float, then: Callable[[bool], Any]
    ) -> None:
        """Call ``then`` once, in the loop: whether the condition came within the time (s)."""
        self._waiting.append((condition, time.monotonic() + timeout, then))

    def turn(self, longest: float) -> None:
        """Do what has come and what is due; wait for it ``longest`` seconds at most."""
        now = time.monotonic()
        next_ = min((due.at for due in self._due), default=now + longest)
        wait = min(longest, max(0.0, next_ - now))
        if self._waiting:
            wait = min(wait, 5e-3)
        try:
            job = self._jobs.get(timeout=wait) if wait > 0.0 else self._jobs.get_nowait()
            while True:
                job()
                job = self._jobs.get_nowait()
        except queue.Empty:
            pass
        now = time.monotonic()
        for due in self._due:
            if now >= due.at:
                due.at = max(due.at + due.every, now)
                due.job()
        waiting, self._waiting = self._waiting, []
        for condition, end, then in waiting:
            came = condition()
            if came or now > end:
                then(came)
            else:
                self._waiting.append((condition, end, then))


class Drained:
    """A queue of what came, from any thread, taken by a poll: everything since the poll before."""

    def __init__(self, depth: int) -> None:
        """Of at most ``depth``; the oldest are dropped."""
        self._came: list[Any] = []
        self._depth = depth
        self._lock = threading.Lock()
        self.lost = 0

    def put(self, one: Any) -> None:
        """From any thread."""
        with self._lock:
            self._came.append(one)
            if len(self._came) > self._depth:
                del self._came[0]
                self.lost += 1

    def take(self) -> list[Any]:
        """All of it, oldest first."""
        with self._lock:
            came, self._came = self._came, []
        return came
