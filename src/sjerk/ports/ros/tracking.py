"""Tracking: where the newest message says that the joints are to be, a horizon from now.

Windows of a servo node, chunks of a learned policy and single goals are all rows over time. A timer
samples the newest of them; ``Host.move`` to the state it gives, over the horizon, follows it. Never
here: clocks, ROS, a kernel.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike

from sjerk.errors import InputError, positive, real
from sjerk.limits import State
from sjerk.profile import FloatArray

#: Share of what the axes can at which tracked velocities are cut: a plan needs room to catch up.
SHARE = 0.95


class Rest(Enum):
    """How the motion ends when no message comes any more."""

    HALT = "halt"  #: The last state had a velocity: come to rest ahead, never go back.


@dataclass(frozen=True, eq=False)
class Window:
    """Rows over time: ``time`` (n,) in s of one clock, rising; ``position`` (n, N).

    ``velocity`` (n, N), or None: differences of the positions, and rest at the last.

    >>> way = Window.of([0.0, 1.0], [[0.0], [2.0]])
    >>> [x.tolist() for x in way.at(0.5)]
    [[1.0], [2.0]]
    >>> [x.tolist() for x in way.at(9.0)]
    [[2.0], [0.0]]
    """

    time: FloatArray
    position: FloatArray
    velocity: FloatArray | None

    @classmethod
    def of(cls, time: ArrayLike, position: ArrayLike, velocity: ArrayLike | None = None) -> Window:
        """Checked; raises InputError."""
        moments = np.asarray(time, dtype=np.float64)
        rows = np.asarray(position, dtype=np.float64)
        if moments.ndim != 1 or len(moments) == 0 or rows.shape[:1] != moments.shape:
            raise InputError("position", rows.shape, f"must be one row per time: {moments.shape}")
        if not (np.diff(moments) > 0.0).all():
            raise InputError("time", moments.tolist(), "must rise")
        speeds = None if velocity is None else np.asarray(velocity, dtype=np.float64)
        if speeds is not None and speeds.shape != rows.shape:
            raise InputError("velocity", speeds.shape, f"must be of shape {rows.shape}")
        for name, values in (("time", moments), ("position", rows), ("velocity", speeds)):
            if values is not None and not np.isfinite(values).all():
                raise InputError(name, values.tolist(), "must be finite")
        return cls(moments, rows, speeds)

    @property
    def end(self) -> float:
        """Time of the last row, s."""
        return float(self.time[-1])

    def at(self, t: float) -> tuple[FloatArray, FloatArray]:
        """Position and velocity (N,) at a time: the first row before, straight on behind.

        Between rows: a cubic through positions and velocities, straight lines without velocities.
        """
        own = self.velocity
        if t >= self.end:
            v = np.zeros(self.position.shape[1]) if own is None else own[-1]
            return self.position[-1] + v * (t - self.end), v
        if t < self.time[0] or len(self.time) == 1:
            return self.position[0], np.zeros(self.position.shape[1]) if own is None else own[0]
        i = int(np.searchsorted(self.time, t, side="right")) - 1
        h = float(self.time[i + 1] - self.time[i])
        s = (t - float(self.time[i])) / h
        way = self.position[i + 1] - self.position[i]
        if own is None:
            return self.position[i] + s * way, way / h
        # The cubic of Hermite: its ends have these positions and velocities.
        a, b = own[i] * h - way, way - own[i + 1] * h
        position = self.position[i] + s * way + s * (1 - s) * ((1 - s) * a + s * b)
        velocity = (way + (1 - 2 * s) * ((1 - s) * a + s * b) + s * (1 - s) * (b - a)) / h
        return position, velocity


class Tracker:
    """The newest window, and what it asks for from moment to moment.

    ``horizon`` (s): from now to the state aimed at. ``timeout`` (s): so long after its newest
    message a source is taken for silent. ``most`` (N,): velocities are cut to these.
    ``rest_on_last``: a silent source's last position is where to rest, whatever its velocity there.

    >>> tracker = Tracker(horizon=0.1, timeout=0.2, most=[1.0])
    >>> tracker.take(Window.of([0.0, 1.0], [[0.0], [0.5]]), now=0.0)
    >>> [goal] = tracker.aim(now=0.3)
    >>> round(goal.position, 3), goal.velocity
    (0.2, 0.5)
    """

    def __init__(
        self, *, horizon: float, timeout: float, most: ArrayLike, rest_on_last: bool = False
    ) -> None:
        """Raises InputError."""
        self.horizon = positive("horizon", horizon)
        self._timeout = positive("timeout", timeout)
        self._most = np.asarray(most, dtype=np.float64)
        self._rest_on_last = rest_on_last
        self._window: Window | None = None
        self._came = 0.0

    @property
    def active(self) -> bool:
        """Whether there is a window that has not been followed to its end."""
        return self._window is not None

    def take(self, window: Window, now: float) -> None:
        """This window is the newest; raises InputError for another number of joints."""
        if window.position.shape[1] != len(self._most):
            what = f"must have {len(self._most)} columns"
            raise InputError("position", window.position.shape, what)
        self._window, self._came = window, real("now", now)

    def drop(self) -> None:
        """Follow nothing: another hand moves."""
        self._window = None

    def aim(self, now: float) -> list[State] | Rest | None:
        """One state per joint to be reached a horizon from now; None: there is nothing to do.

        Where the source is silent and its window is over, the last aim is rest: at the window's
        last position, or ahead of it where it ended with a velocity; then there is nothing to do.
        """
        window = self._window
        if window is None:
            return None
        t = now + self.horizon
        silent = now > self._came + self._timeout and now > window.end
        if silent:
            self._window = None
            if self._rest_on_last or window.velocity is None:
                return [State(float(q)) for q in window.position[-1]]
            if window.velocity[-1].any():
                return Rest.HALT
        position, velocity = window.at(t)
        velocity = np.clip(velocity, -self._most, self._most)
        return [State(float(q), float(v)) for q, v in zip(position, velocity, strict=True)]
