"""Hypothesis profiles, deterministic by default, bigger on demand; names of segments."""

from __future__ import annotations

import os
import secrets
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# A shell that runs the tests in the background lets them ignore Ctrl-C, and all that they start.
signal.signal(signal.SIGINT, signal.default_int_handler)

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


@pytest.fixture
def name() -> Iterator[str]:
    """A kernel name of this test alone; whatever it leaves behind is an error."""
    name = f"test-{secrets.token_hex(6)}"
    yield name
    left = list(Path("/dev/shm").glob(f"sjerk-{name}*"))
    for path in left:
        path.unlink()
    assert not left
