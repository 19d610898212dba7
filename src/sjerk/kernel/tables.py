"""Tables with the fields of axes, drives, clock and reactions, as objects; faults with their place.

Tables come from TOML files, from recordings, and from the order of a kernel's process. Never here:
files, kernels, motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from sjerk.cia402 import DriveConfig, DriveConfigError
from sjerk.errors import ConfigError, InputError
from sjerk.kernel.axis import Axis
from sjerk.kernel.clock import Clock
from sjerk.kernel.feed_forward import FeedForward
from sjerk.kernel.reactions import Reactions
from sjerk.profile import Limits

#: Tables of ports: of the whole file, and of its axes. They are the ports' own, and not read here.
PORTS = ("ethercat",)
#: Tables of the whole file that say nothing of the kernel: who shows it reads them.
SHOWN_BY = ("panel",)
_FEW = 16  # names that are read through


class Place:
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
                raise self.error(key, value, _unknown(key, names))

    def make(self, kind: Callable[..., Any], required: tuple[str, ...], values: Any) -> Any:
        """Construct ``kind``; its own complaint is raised with the place."""
        for name in required:
            if name not in values:
                raise self.error(name, None, "is missing")
        try:
            return kind(**values)
        except (InputError, DriveConfigError) as fault:
            why = fault.limit if isinstance(fault, InputError) else fault.reason
            raise self.error(fault.field, fault.value, why) from fault


def kernel_fields(path: Path | str, table: object) -> tuple[Place, dict[str, Any]]:
    """The place of a whole kernel, and the arguments of ``MotionKernel`` that its table has.

    Raises ConfigError.
    """
    top = Place(str(path), "", table)
    table = top.table
    top.known("name", "cycle_time", "clock", "reactions", "axes", *PORTS, *SHOWN_BY)
    rows = table.get("axes")
    if not isinstance(rows, list) or not rows:
        raise top.error("axes", rows, "needs at least one [[axes]]")
    values: dict[str, Any] = {
        "axes": [_axis(Place(str(path), f"axes[{i}]", row)) for i, row in enumerate(rows)],
        "clock": _plain(Place(str(path), "clock", table.get("clock", {})), Clock),
        "reactions": _plain(Place(str(path), "reactions", table.get("reactions", {})), Reactions),
    }
    for name in ("name", "cycle_time"):
        if name in table:
            values[name] = table[name]
    return top, values


def port_tables(table: object, port: str) -> tuple[object, dict[int, object]] | None:
    """The table of a port and those of the axes that have one, by axis; None without.

    >>> port_tables({"ethercat": {}, "axes": [{}, {"ethercat": {"position": 0}}]}, "ethercat")
    ({}, {1: {'position': 0}})
    """
    if not isinstance(table, dict) or port not in table:
        return None
    axes = table.get("axes", [])
    return table[port], {i: axis[port] for i, axis in enumerate(axes) if port in axis}


def without_ports(table: object) -> object:
    """The table without those of ports: drives that were on a bus are simulated ones.

    >>> without_ports({"ethercat": {}, "axes": [{"unit": "deg", "ethercat": {"position": 0}}]})
    {'axes': [{'unit': 'deg'}]}
    """
    if not isinstance(table, dict) or not isinstance(table.get("axes"), list):
        return table
    rows = []
    for row in table["axes"]:
        own = row if isinstance(row, dict) else {}
        plain = {key: value for key, value in own.items() if key not in PORTS}
        if any(key in own for key in PORTS) and plain.get("drive") in (*PORTS, "external"):
            del plain["drive"]
        rows.append(plain if isinstance(row, dict) else row)
    rest = {key: value for key, value in table.items() if key not in (*PORTS, "axes")}
    return rest | {"axes": rows}


def _unknown(key: str, names: Sequence[str]) -> str:
    """Why a key is refused: what is known, and of many names the ones that look like it.

    >>> _unknown("jrk", ["velocity", "jerk"])
    'unknown; known are velocity, jerk'
    """
    if len(names) <= _FEW:
        return f"unknown; known are {', '.join(names)}"
    close = get_close_matches(key, names, n=3, cutoff=0.5)
    like = f"; like it are {', '.join(close)}" if close else ""
    return f"unknown{like}; known are {', '.join(names)}"


def _names(kind: type[Any]) -> list[str]:
    return [field.name for field in fields(kind) if field.init]


def _plain(place: Place, kind: type[Any]) -> Any:
    place.known(*_names(kind))
    return place.make(kind, (), place.table)


def _axis(place: Place) -> Axis:
    place.known(*_names(Axis), *PORTS)
    values = {key: value for key, value in place.table.items() if key not in PORTS}
    if any(key in place.table for key in PORTS) and values.get("drive", "ethercat") in PORTS:
        values["drive"] = "external"
    for key in ("limits", "stop_limits"):
        if key in values:
            values[key] = _limits(Place(place.path, f"{place.place}.{key}", values[key]))
    if "drive" in values and not isinstance(values["drive"], str):
        below = Place(place.path, f"{place.place}.drive", values["drive"])
        values["drive"] = _plain(below, DriveConfig)
    if isinstance(values.get("feed_forward"), dict):
        below = Place(place.path, f"{place.place}.feed_forward", values["feed_forward"])
        values["feed_forward"] = _plain(below, FeedForward)
    axis: Axis = place.make(Axis, ("limits", "counts_per_unit"), values)
    return axis


def _limits(place: Place) -> Limits:
    place.known(*_names(Limits))
    values = dict(place.table)
    if isinstance(values.get("position"), list):
        values["position"] = tuple(values["position"])
    limits: Limits = place.make(Limits, ("velocity", "acceleration", "jerk"), values)
    return limits
