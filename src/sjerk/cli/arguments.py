"""Words of the command line as numbers, checked by the parser: before anything is opened or sent.

Never here: what the numbers are for.
"""

from __future__ import annotations

import argparse
import math

from sjerk.errors import InputError

#: Help of ``--seconds`` where it may be left out.
ENDLESS = "then end (default: never)"
_LONGEST = 1e9  # seconds: clocks of the system end not far above


def _number(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{word!r} is not a number") from None


def duration(word: str) -> float:
    """Seconds, greater than 0 and finite."""
    value = _number(word)
    if not 0.0 < value <= _LONGEST:
        raise argparse.ArgumentTypeError(f"{word} s must be greater than 0, up to {_LONGEST:g}")
    return value


def duration_or_inf(word: str) -> float:
    """Seconds, greater than 0; ``inf`` is without an end."""
    return math.inf if _number(word) == math.inf else duration(word)


def shielded(words: list[str]) -> list[str]:
    """Words of a command line in which argparse takes no negative number for an option.

    It knows -5 and -0.5, not -1e-3, which programs print, nor -5. and -inf; a space before such a
    number makes it an argument, and is no part of the number.

    >>> shielded(["move", "-1e-3", "--timeout", "5"])
    ['move', ' -1e-3', '--timeout', '5']
    """
    return [f" {word}" if word.startswith("-") and _is_number(word) else word for word in words]


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def by_axis(what: str, words: list[str]) -> list[float] | dict[int, float]:
    """Numbers in the order of the axes, or AXIS=NUMBER words; raises InputError."""
    found: dict[int, float] = {}
    words = [word.strip() for word in words]
    named = ["=" in word for word in words]
    if any(named) and not all(named):
        raise InputError(what, " ".join(words), "must be all numbers or all AXIS=NUMBER")
    for i, word in enumerate(words):
        name, _, number = word.rpartition("=")
        try:
            axis, value = int(name) if named[i] else i, float(number)
        except ValueError as fault:
            raise InputError(what, word, "must be a number or AXIS=NUMBER") from fault
        if axis in found:
            raise InputError(what, word, f"axis {axis} is named twice")
        found[axis] = value
    return found if any(named) else list(found.values())
