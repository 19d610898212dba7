"""What has become of a stream's goals, by what was handed out.

Never here: goals, plans.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sjerk.profile import FloatArray
from sjerk.trajectory.known import IntArray


@dataclass(frozen=True, eq=False)
class StreamReport:
    """What has become of the goals, by what was handed out.

    ``goals`` given, ``passed`` so far; ``deviation`` (N,): largest distance from a goal when it was
    passed. ``lag``, ``largest_lag`` (s): behind time plus delay, now and at most. ``starved``: how
    often the goals ran out in motion; ``starving``: now; ``beyond`` (N,): how far from the last
    goal then. ``reversals`` (N,): turns that the goals do not have. ``kept``: knots for which no
    better plan than the one before was found. ``iterations``: most that one solution took.
    """

    goals: int
    passed: int
    deviation: FloatArray
    lag: float
    largest_lag: float
    starved: int
    starving: bool
    beyond: FloatArray
    reversals: IntArray
    kept: int
    iterations: int


class Ledger:
    """Counts of a stream of N joints."""

    def __init__(self, joints: int) -> None:
        self.goals = 0
        self._passed = self._starved = 0
        self._lag = self._worst = 0.0
        self._starving = False
        self._beyond, self._deviation = np.zeros(joints), np.zeros(joints)

    def starve(self, out: bool) -> None:
        """Whether goals have run out."""
        self._starved += out and not self._starving
        self._starving = out

    def passing(self, goals: int, off: FloatArray, lag: float) -> None:
        """So many goals are passed, ``off`` (goals, N), with this lag (s)."""
        self._passed += goals
        self._deviation = np.maximum(self._deviation, np.abs(off).max(axis=0, initial=0.0))
        self._lag = max(0.0, lag)
        self._worst = max(self._worst, self._lag)

    def rests(self, gap: FloatArray) -> None:
        """So far from the last goal (N,), where goals have run out."""
        if self._starving:
            self._beyond = np.maximum(self._beyond, gap)

    def report(self, reversals: IntArray, kept: int, iterations: int) -> StreamReport:
        """All of it, with what the planner counts."""
        return StreamReport(
            self.goals,
            self._passed,
            self._deviation.copy(),
            self._lag,
            self._worst,
            self._starved,
            self._starving,
            self._beyond.copy(),
            reversals,
            kept,
            iterations,
        )
