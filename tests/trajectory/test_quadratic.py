"""The banded quadratic programme beside another solver, and the conditions of an optimum."""

from __future__ import annotations

from dataclasses import dataclass

import daqp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from sjerk.trajectory.quadratic import Optimum, Rows, minimise

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Problem:
    """A dense problem; ``inside`` is a point that keeps all its rows."""

    H: Array
    g: Array
    A: Array
    lower: Array
    upper: Array
    inside: Array
    band: int

    def solve(self, **options: float) -> Optimum:
        """By the band."""
        n = len(self.g)
        banded = np.zeros((n, self.band + 1))
        for i in range(n):
            for j in range(max(0, i - self.band), i + 1):
                banded[i, self.band + j - i] = self.H[i, j]
        at = [np.nonzero(row)[0] for row in self.A]
        rows = Rows(
            np.cumsum([0, *map(len, at)], dtype=np.int32),
            np.concatenate(at, dtype=np.int32),
            np.concatenate([row[k] for row, k in zip(self.A, at, strict=True)]),
        )
        start = np.zeros(n)
        return minimise(banded, self.g, rows, self.lower, self.upper, start, **options)  # type: ignore[arg-type]

    def value(self, x: Array) -> float:
        return float(0.5 * x @ self.H @ x + self.g @ x)


def drawn(seed: int) -> Problem:
    """1 to 60 variables, bands of 0 to 8, bounds of which some are tight, equal or none."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 60))
    band, m = int(rng.integers(0, min(n, 8))), int(rng.integers(1, 3 * n + 2))
    B = np.tril(np.triu(rng.normal(size=(n, n)), -band))
    H = B @ B.T + 10.0 ** rng.uniform(-6, 0) * np.eye(n)
    A = np.zeros((m, n))
    for row in A:
        first = int(rng.integers(0, n))
        last = min(n, first + band + 1)
        row[first:last] = rng.normal(size=last - first)
    inside = rng.normal(size=n)
    at = A @ inside
    lower = at - rng.choice([0.0, 1.0, 1.0, 1.0], size=m) * rng.exponential(size=m)
    upper = at + rng.choice([0.0, 1.0, 1.0, 1.0], size=m) * rng.exponential(size=m)
    lower[rng.random(m) < 0.2] = -1e30
    equal = rng.random(m) < 0.03
    lower[equal] = upper[equal] = at[equal]
    g = rng.normal(size=n) * 10.0 ** rng.uniform(-1, 1.5)
    return Problem(H, g, A, lower, upper, inside, band)


@settings(max_examples=200)
@given(st.integers(0, 2**32 - 1))
def test_no_better_point_is_known(seed: int) -> None:
    """Rows kept to 1e-6, never better than possible, never worse than an active-set solver's."""
    problem = drawn(seed)
    found = problem.solve()
    size = np.abs(problem.A).max(axis=1)
    scaled = (problem.A @ found.x) / size
    assert (scaled >= problem.lower / size - 1e-6).all()
    assert (scaled <= problem.upper / size + 1e-6).all()
    value = problem.value(found.x)
    assert value <= problem.value(problem.inside) + 1e-6 * (1.0 + abs(value))
    sense = np.where(problem.lower == problem.upper, 5, 0).astype(np.int32)
    other, _, flag, _ = daqp.solve(
        problem.H, problem.g, problem.A, problem.upper, problem.lower, sense, primal_tol=1e-11
    )
    if flag > 0:  # it gives up on some
        assert value == pytest.approx(problem.value(other), rel=1e-6, abs=1e-6)


def test_most_are_solved_in_few_iterations() -> None:
    """Of 500 problems at least 98 % are solved to 1e-9; half of them in 15 iterations."""
    found = [drawn(seed).solve() for seed in range(500)]
    assert sum(one.solved for one in found) >= 490
    assert np.median([one.iterations for one in found]) <= 15


def test_equal_input_gives_equal_bits() -> None:
    """Twice the same."""
    one, two = drawn(7).solve(), drawn(7).solve()
    np.testing.assert_array_equal(one.x, two.x)


def test_the_iterations_are_bounded() -> None:
    """No more than asked, also where nothing keeps the rows."""
    rows = Rows(np.array([0, 1, 2], np.int32), np.zeros(2, np.int32), np.ones(2))
    found = minimise(
        np.ones((1, 1)),
        np.zeros(1),
        rows,
        np.array([1.0, -9.0]),
        np.array([9.0, -1.0]),
        np.zeros(1),
    )
    assert not found.solved
    assert found.outside >= 0.9
    assert drawn(3).solve(most=2).iterations <= 2
