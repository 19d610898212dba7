"""Hypothesis profiles: deterministic by default, bigger on demand."""

from __future__ import annotations

import os

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
