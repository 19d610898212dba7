"""A kernel from a TOML file or a table: axes, drives, clock, reactions; faults with their place.

Never here: motion, processes.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

from sjerk.cia402 import DriveConfig, DriveConfigError
from sjerk.errors import ConfigError, InputError
from sjerk.kernel.axis import Axis
from sjerk.kernel.clock import Clock
from sjerk.kernel.kernel import MotionKernel
from sjerk.kernel.reactions import Reactions
from sjerk.profile import Limits


class _Place:
    """One table of the file: knows where it is, refuses what it does not know."""

    def __init__(self, path: str, place: str, table: object) -> None:
        self.path, self.place = path, place
        if not isinstance(table, dict):
            raise self.error("", table, "must be a table")
        self.table: dict[str, Any] = table

    def error(self, key: str, value: object, why: str) -> ConfigError:
        place = ".".join(part for part in (self.place, key) if part) or "description"
        return ConfigError(self.path, place, value, why)

    def known(self, *names: str) -> None:
        for key, value in self.table.items():
            if key not in names:
                raise self.error(key, value, f"unknown; known are {', '.join(names)}")

    def make(self, kind: Callable[..., Any], required: tuple[str, ...], values: Any) -> Any:
        """Construct ``kind``; its own complaint is raised with the place."""
        for name in required:
            if name not in values:
                raise self.error(name, None, "is missing")
        try:
            return kind(**values)
        except (InputError, DriveConfigError) as fault:
            why = fault.limit if isinstance(fault, InputError) else str(fault)
            raise self.error(fault.field, fault.value, why) from fault


def load(path: Path | str, *, name: str | None = None) -> MotionKernel:
    """Read a kernel from a TOML file; ``name`` of the segment, else the file's, else the file stem.

    Raises ConfigError with the file and the place in it, OSError.

    A file: ``cycle_time`` (s), ``name``, tables ``[clock]`` (``Clock``) and ``[reactions]``
    (``Reactions``), and for each axis ``[[axes]]`` with the fields of ``Axis``: ``limits`` and
    ``stop_limits`` are tables of ``Limits``, ``drive`` a table of ``DriveConfig``, "ideal" or
    "external".

    >>> load("/dev/null")
    Traceback (most recent call last):
    sjerk.errors.ConfigError: /dev/null: axes = None: needs at least one [[axes]]
    """
    try:
        table = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as fault:  # also of text that is not UTF-8, of long numbers
        raise ConfigError(str(path), "syntax", None, str(fault)) from fault
    return described(path, table, name=name)


def described(path: Path | str, table: object, *, name: str | None = None) -> MotionKernel:
    """The kernel that a table describes, laid out as in ``load``; ``path`` is where it is from.

    Raises ConfigError.
    """
    top = _Place(str(path), "", table)
    table = top.table
    top.known("name", "cycle_time", "clock", "reactions", "axes")
    rows = table.get("axes")
    if not isinstance(rows, list) or not rows:
        raise top.error("axes", rows, "needs at least one [[axes]]")
    values: dict[str, Any] = {
        "axes": [_axis(_Place(str(path), f"axes[{i}]", row)) for i, row in enumerate(rows)],
        "clock": _plain(_Place(str(path), "clock", table.get("clock", {})), Clock),
        "reactions": _plain(_Place(str(path), "reactions", table.get("reactions", {})), Reactions),
        "name": table.get("name", Path(path).stem) if name is None else name,
    }
    if "cycle_time" in table:
        values["cycle_time"] = table["cycle_time"]
    kernel: MotionKernel = top.make(MotionKernel, (), values)
    return kernel


def _names(kind: type[Any]) -> list[str]:
    return [field.name for field in fields(kind) if field.init]


def _plain(place: _Place, kind: type[Any]) -> Any:
    place.known(*_names(kind))
    return place.make(kind, (), place.table)


def _axis(place: _Place) -> Axis:
    place.known(*_names(Axis))
    values = dict(place.table)
    for key in ("limits", "stop_limits"):
        if key in values:
            values[key] = _limits(_Place(place.path, f"{place.place}.{key}", values[key]))
    if "drive" in values and not isinstance(values["drive"], str):
        below = _Place(place.path, f"{place.place}.drive", values["drive"])
        values["drive"] = _plain(below, DriveConfig)
    axis: Axis = place.make(Axis, ("limits", "counts_per_unit"), values)
    return axis


def _limits(place: _Place) -> Limits:
    place.known(*_names(Limits))
    values = dict(place.table)
    if isinstance(values.get("position"), list):
        values["position"] = tuple(values["position"])
    limits: Limits = place.make(Limits, ("velocity", "acceleration", "jerk"), values)
    return limits
