"""Exceptions of sjerk, each with the data that a program needs to react, and the checks of input.

Never here: decisions about motion.
"""

from __future__ import annotations

import math
from numbers import Real


class SjerkError(Exception):
    """Base of every error that sjerk raises on purpose."""


class InputError(SjerkError, ValueError):
    """A value that cannot be used: names the ``field``, the ``value`` and the ``limit``."""

    def __init__(self, field: str, value: object, limit: str) -> None:
        super().__init__(f"{field} = {value!r}: {limit}")
        self.field = field
        self.value = value
        self.limit = limit


class InfeasibleError(SjerkError, ValueError):
    """No forward profile in whole cycles covers the distance.

    ``distance`` is what was asked, ``works`` one that has a profile under the same limits.
    """

    def __init__(self, distance: float, works: float, why: str) -> None:
        super().__init__(f"distance = {distance!r}: {why}; {works!r} works")
        self.distance = distance
        self.works = works


#: Magnitudes up to this, and limits down to its inverse, leave room for squares and cubes.
LARGEST = 1e60


def real(field: str, value: object) -> float:
    """Return ``value`` as a float; refuse what is not a finite real number of sane size."""
    if isinstance(value, bool) or not isinstance(value, Real):
        raise InputError(field, value, "must be a real number")
    number = float(value)
    if not math.isfinite(number):
        raise InputError(field, value, "must be finite")
    if abs(number) > LARGEST:
        raise InputError(field, value, f"must lie within {LARGEST:g} in magnitude")
    return number


def positive(field: str, value: object) -> float:
    """Return ``value`` as a float greater than zero."""
    number = real(field, value)
    if number <= 0.0:
        raise InputError(field, value, "must be greater than 0")
    if number < 1.0 / LARGEST:
        raise InputError(field, value, f"must be at least {1.0 / LARGEST:g}")
    return number
