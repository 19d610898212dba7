"""Words of the command line as numbers, checked by the parser: before anything is opened or sent.

Never here: what the numbers are for.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence

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


def by_axis(what: str, words: list[str]) -> list[float] | dict[int | str, float]:
    """Numbers in the order of the axes, or AXIS=NUMBER words, AXIS a number or a name.

    Raises InputError. Which axis has a name ``numbered`` knows.

    >>> by_axis("target", ["0=10", "elbow=-5"])
    {0: 10.0, 'elbow': -5.0}
    """
    found: dict[int | str, float] = {}
    words = [word.strip() for word in words]
    named = ["=" in word for word in words]
    if any(named) and not all(named):
        raise InputError(what, " ".join(words), "must be all numbers or all AXIS=NUMBER")
    for i, word in enumerate(words):
        name, _, number = word.rpartition("=")
        try:
            axis, value = axis_word(name) if named[i] else i, float(number)
        except ValueError as fault:
            raise InputError(what, word, "must be a number or AXIS=NUMBER") from fault
        if axis in found:
            raise InputError(what, word, f"axis {axis} is named twice")
        found[axis] = value
    return found if any(named) else list(found.values())


def axis_word(word: str) -> int | str:
    """An axis by its number, or by its name where the word is no number; raises ValueError.

    >>> axis_word("1"), axis_word("elbow")
    (1, 'elbow')
    """
    try:
        return int(word)
    except ValueError:
        if not word:
            raise
        return word


def number_of(axis: int | str, names: Sequence[str]) -> int:
    """The number of an axis, given as number or name; raises InputError that tells the names."""
    if isinstance(axis, int):
        return axis
    if axis not in names:
        known = ", ".join(name for name in names if name) or "no axis has a name"
        raise InputError("axis", axis, f"is no number 0 .. {len(names) - 1}, and no name: {known}")
    return names.index(axis)


def numbered(
    what: str, found: list[float] | dict[int | str, float], names: Sequence[str]
) -> list[float] | dict[int, float]:
    """What ``by_axis`` found, by the numbers of the axes of a kernel; raises InputError.

    >>> numbered("target", {0: 10.0, "elbow": -5.0}, ["shoulder", "elbow"])
    {0: 10.0, 1: -5.0}
    """
    if isinstance(found, list):
        return found
    axes: dict[int, float] = {}
    for word, value in found.items():
        axis = number_of(word, names)
        if axis in axes:
            raise InputError(what, f"{word}={value!r}", f"axis {axis} is named twice")
        axes[axis] = value
    return axes
