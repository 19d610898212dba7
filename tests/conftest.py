"""Hypothesis profiles: deterministic by default, bigger on demand."""

from __future__ import annotations

import os

import pytest
from hypothesis import HealthCheck, settings

settings.register_profile(
    "default",
    derandomize=True,
    deadline=None,
    max_examples=200,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.register_profile(
    "big", derandomize=False, deadline=None, max_examples=20_000, print_blob=True
)
settings.register_profile("small", settings.get_profile("default"), max_examples=30)
settings.load_profile(os.environ.get("SJERK_HYPOTHESIS", "default"))


def pytest_addoption(parser: pytest.Parser) -> None:
    """Bigger runs on demand."""
    parser.addoption(
        "--planner-states",
        type=int,
        default=3000,
        help="random states per unit, kind and symmetry in the planner's long run",
    )
