"""The obviously right oracle: the paper's equations in rational arithmetic.

Written from the paper's text and shared with no line of the library: plain Eqs. (1)-(6) for the
continuous motion and (15)-(17) for the samples, over fractions.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction


@dataclass
class Sample:
    """State of the bilinear integrator in cycle units."""

    q: Fraction
    v: Fraction
    a: Fraction
    j: Fraction = Fraction(0)

    def step(self, jerk: Fraction) -> Sample:
        """Eqs. (15)-(17) with T_s = 1."""
        a = self.a + (jerk + self.j) / 2
        v = self.v + (a + self.a) / 2
        q = self.q + (v + self.v) / 2
        return Sample(q, v, a, jerk)

    def plan(self) -> tuple[Fraction, Fraction, Fraction]:
        """The half-cycle lemma: the continuous P, V, A that belong to this sample."""
        A = self.a + self.j / 2
        V = self.v + self.a / 2
        P = self.q + self.v / 2 - A / 12
        return P, V, A


def bilinear(start: Sample, phases: Sequence[tuple[int, Fraction]]) -> Iterator[Sample]:
    """Row 0 .. N + 1 of a motion."""
    yield start
    for cycles, jerk in phases:
        for _ in range(cycles):
            start = start.step(jerk)
            yield start
    yield start.step(Fraction(0))


@dataclass
class Node:
    """Continuous state at the end of a phase, and the extremes inside it."""

    P: Fraction
    V: Fraction
    A: Fraction
    V_peak: float


def continuous(
    P: Fraction, V: Fraction, A: Fraction, phases: Sequence[tuple[Fraction, Fraction]]
) -> list[Node]:
    """Eqs. (1)-(6) along phases of (time, jerk); V_peak is the largest |V| inside the phase."""
    nodes = []
    for t, J in phases:
        peak = max(abs(V), abs(V + A * t + J * t * t / 2))
        if J != 0 and 0 < -A / J < t:  # A = 0 inside
            peak = max(peak, abs(V - A * A / (2 * J)))
        P += V * t + A * t * t / 2 + J * t * t * t / 6
        V += A * t + J * t * t / 2
        A += J * t
        nodes.append(Node(P, V, A, float(peak)))
    return nodes
