"""What two checkouts call by different names; everything else here uses the public names of sjerk.

Names are told as the older checkout has them, so that a new word is no difference.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator
from dataclasses import fields
from enum import Enum
from functools import cache
from types import ModuleType
from typing import Any

import sjerk
from sjerk import MotionKernel, Reactions, Recording

#: New word -> old word: members of enums, classes of errors.
OLD_WORDS: dict[str, str] = {"CORRUPT": "SPOILT"}

#: Columns of a recorded frame that are motion, each by the names it has had.
COLUMNS: dict[str, tuple[str, ...]] = {
    name: (name,)
    for name in (
        *("position", "velocity", "acceleration", "jerk", "goal", "limits", "goal_id"),
        *("target_counts", "actual_counts", "velocity_actual", "following_error"),
        *("statusword", "error_code", "torque_actual", "mode_display", "state", "flags"),
    )
}


@cache
def _modules() -> tuple[ModuleType, ...]:
    found = []
    for entry in pkgutil.walk_packages(sjerk.__path__, "sjerk."):
        if entry.name.startswith(("sjerk.cli", "sjerk.ports", "sjerk.__main__")):
            continue
        try:
            found.append(importlib.import_module(entry.name))
        except ImportError:  # of an extra that is not installed
            continue
    return tuple(found)


@cache
def find(*names: str) -> Any:
    """What the package calls by one of these names, at its top or in the module that defines it."""
    for name in names:
        if hasattr(sjerk, name):
            return getattr(sjerk, name)
    for module in _modules():
        for name in names:
            found = getattr(module, name, None)
            if getattr(found, "__module__", None) == module.__name__:
                return found
    raise LookupError(f"this checkout has none of {', '.join(names)}")


def word(member: Enum | type) -> str:
    """The old name of a member of an enum, or of a class."""
    name = member.name if isinstance(member, Enum) else member.__name__
    return OLD_WORDS.get(name, name)


def reactions(*values: str) -> Reactions:
    """Reactions by their order: host death, silence, drive fault, following error, overrun, ..."""
    options: dict[str, Any] = dict(zip((f.name for f in fields(Reactions)), values, strict=False))
    return Reactions(**options)


def columns(recording: Recording) -> Iterator[tuple[str, Any]]:
    """The columns of a recording that this checkout has."""
    for column, names in COLUMNS.items():
        for name in names:
            try:
                yield column, recording.column(name)
                break
            except (KeyError, ValueError):
                continue


def inject(kernel: MotionKernel, axis: int, fault: int, present: bool) -> None:
    """Make the cause of a fault of a simulated drive in a kernel appear or go."""
    binding = importlib.import_module("sjerk._binding")
    drive = binding.ffi.addressof(kernel._kernel.axis[axis], "drive")
    binding.lib.sj_drive_inject(drive, fault, present)
