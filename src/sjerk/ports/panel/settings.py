"""The table ``[panel]`` of a robot's TOML file: read, checked, and written back.

What a person saves in the page (poses, the scene) goes into the same file; the rest of it stays as
it is, with its comments. Never here: pages, kernels.
"""

from __future__ import annotations

import json
import os
import re
import tempfile
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from sjerk.errors import ConfigError, InputError, SjerkError, real
from sjerk.ports.panel.arm import Arm
from sjerk.ports.panel.shapes import Scene, Shape
from sjerk.ports.panel.urdf import Visual, read_urdf

#: Names of poses and shapes: they stand in pages and files.
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9 _.-]{0,31}")
_KNOWN = ("dh", "flange", "radius", "urdf", "tip", "floor", "zero", "poses", "shapes")
_MOST = 64


@dataclass(frozen=True)
class PanelSettings:
    """What ``[panel]`` says. ``arm`` None: the axes are no arm that it could draw.

    ``zero`` (N,): angle of the model (rad) where the kernel's position is 0. ``poses``: positions
    of all axes by name, as the kernel counts. ``path``: the file; None: it is not to be changed.
    ``visuals``: what is seen of the arm, where that is not its capsules.
    """

    arm: Arm | None
    zero: tuple[float, ...]
    poses: Mapping[str, tuple[float, ...]]
    scene: Scene
    path: Path | None = None
    names: tuple[str, ...] = field(default=())
    visuals: tuple[Visual, ...] = field(default=())

    @classmethod
    def of(
        cls,
        path: Path,
        table: Mapping[str, Any],
        axes: int,
        *,
        fixed: bool = False,
        urdf: Path | None = None,
        tip: str | None = None,
    ) -> Self:
        """Read the table of a file for so many axes; ``fixed``: the file is not to be changed.

        ``urdf``, ``tip``: the arm is that of a URDF, whatever the table says. Raises ConfigError
        with the place, UrdfError, ExtraMissingError.
        """
        own = table.get("panel", {})
        read = _Reader(path, own, axes)
        rows = table.get("axes", [])
        names = tuple(str(row.get("name", "")) or f"axis {i}" for i, row in enumerate(rows))
        visuals: tuple[Visual, ...] = ()
        if urdf is None:
            urdf, tip = read.urdf(tip)
        if urdf is None:
            arm = read.arm(names)
        else:
            arm, visuals = read_urdf(urdf, names, tip=tip)
        return cls(
            arm=arm,
            visuals=visuals,
            zero=read.numbers("zero", own.get("zero", [0.0] * axes)),
            poses=read.poses(),
            scene=read.scene(),
            path=None if fixed else path,
            names=names,
        )

    def save(self, poses: Mapping[str, Sequence[float]], scene: Scene) -> None:
        """Write poses and scene into the file. Raises SjerkError where there is none to change."""
        if self.path is None:
            raise SjerkError(
                "the robot that comes with sjerk is not changed: copy its file and start "
                "`sjerk panel FILE`"
            )
        text = self.path.read_text(encoding="utf-8")
        made = with_tables(
            text,
            {
                "panel.poses": {name: list(map(float, q)) for name, q in poses.items()},
                "panel.shapes": {name: shape.table() for name, shape in scene.shapes.items()},
            },
        )
        handle, name = tempfile.mkstemp(dir=self.path.parent, prefix=f".{self.path.name}.")
        try:
            with os.fdopen(handle, "w", encoding="utf-8") as file:
                file.write(made)
            os.chmod(name, self.path.stat().st_mode)
            os.replace(name, self.path)
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise


def name_of(text: object) -> str:
    """A name for a pose or a shape; raises InputError."""
    if not isinstance(text, str) or not NAME.fullmatch(text):
        raise InputError("name", text, "must be 1 to 32 letters, digits, spaces, _ . -")
    return text


class _Reader:
    def __init__(self, path: Path, own: object, axes: int) -> None:
        self.path, self.axes = path, axes
        if not isinstance(own, dict):
            raise self._error("", own, "must be a table")
        self.own: dict[str, Any] = own
        for key, value in self.own.items():
            if key not in _KNOWN:
                raise self._error(key, value, f"unknown; known are {', '.join(_KNOWN)}")

    def _error(self, key: str, value: object, why: str) -> ConfigError:
        return ConfigError(str(self.path), f"panel.{key}".rstrip("."), value, why)

    def arm(self, names: Sequence[str]) -> Arm | None:
        if "dh" not in self.own:
            return None
        try:
            arm = Arm(
                self.own["dh"],
                flange=self.own.get("flange", 0.0),
                radius=self.own.get("radius", [0.05] * (len(self.own["dh"]) + 1)),
                names=names[: len(self.own["dh"])],
            )
        except InputError as fault:
            raise self._error(fault.field, fault.value, fault.limit) from fault
        except TypeError as fault:
            raise self._error("dh", self.own["dh"], "must be rows of three numbers") from fault
        if arm.joints != self.axes:
            raise self._error("dh", arm.joints, f"has this many joints, the kernel {self.axes}")
        return arm

    def urdf(self, tip: str | None) -> tuple[Path | None, str | None]:
        """The file that the table names, beside its own, and the link that is the flange."""
        for key in ("urdf", "tip"):
            if not isinstance(self.own.get(key, ""), str):
                raise self._error(key, self.own[key], "must be a text")
        if "urdf" not in self.own:
            if "tip" in self.own:
                raise self._error("tip", self.own["tip"], "is of a urdf; of dh it is flange")
            return None, tip
        if "dh" in self.own:
            raise self._error("urdf", self.own["urdf"], "and dh exclude each other")
        return self.path.parent / self.own["urdf"], tip or self.own.get("tip")

    def numbers(self, key: str, values: object) -> tuple[float, ...]:
        if not isinstance(values, list) or len(values) != self.axes:
            raise self._error(key, values, f"must be {self.axes} numbers")
        try:
            return tuple(real(f"{key}[{i}]", v) for i, v in enumerate(values))
        except InputError as fault:
            raise self._error(fault.field, fault.value, fault.limit) from fault

    def _named(self, key: str) -> dict[str, Any]:
        table = self.own.get(key, {})
        if not isinstance(table, dict) or len(table) > _MOST:
            raise self._error(key, table, f"must be a table of at most {_MOST}")
        for name in table:
            if not NAME.fullmatch(name):
                raise self._error(f"{key}.{name}", name, "is no name of 1 to 32 letters")
        return table

    def poses(self) -> dict[str, tuple[float, ...]]:
        return {n: self.numbers(f"poses.{n}", v) for n, v in self._named("poses").items()}

    def scene(self) -> Scene:
        shapes = {}
        for name, row in self._named("shapes").items():
            place = f"shapes.{name}"
            if not isinstance(row, dict):
                raise self._error(place, row, "must be a table")
            known = ("kind", "size", "centre", "yaw", "attached")
            for key in row:
                if key not in known:
                    raise self._error(f"{place}.{key}", row[key], f"known are {', '.join(known)}")
            try:
                shapes[name] = Shape(
                    row.get("kind", "box"),
                    row.get("size", ()),
                    row.get("centre", ()),
                    yaw=row.get("yaw", 0.0),
                    attached=row.get("attached", False),
                )
            except InputError as fault:
                raise self._error(f"{place}.{fault.field}", fault.value, fault.limit) from fault
        floor = self.own.get("floor", 0.0)
        if floor is False:
            return Scene(shapes, None)
        try:
            return Scene(shapes, real("floor", floor))
        except InputError as fault:
            raise self._error("floor", floor, "must be a height in m, or false") from fault


# ---- writing -------------------------------------------------------------------------------------

_HEADER = re.compile(r"^\s*\[{1,2}\s*([^\[\]]+?)\s*\]{1,2}\s*(#.*)?$")


def with_tables(text: str, tables: Mapping[str, Mapping[str, Any]]) -> str:
    r"""A TOML text with these tables (of dotted names) in place of those that it has.

    What was written is read again; raises SjerkError where anything else would have changed.

    >>> print(with_tables("a = 1 # one\n[p.q]\nx = 2\n[z]\n", {"p.q": {"y": [1.0]}}))
    a = 1 # one
    [z]
    <BLANKLINE>
    [p.q]
    y = [1.0]
    <BLANKLINE>
    """
    before = tomllib.loads(text)
    kept, inside = [], False
    for line in text.splitlines():
        header = _HEADER.match(line)
        if header:
            name = re.sub(r"\s*\.\s*", ".", header.group(1))
            inside = any(name == own or name.startswith(own + ".") for own in tables)
        if not inside:
            kept.append(line)
    made = "\n".join(kept).rstrip() + "\n"
    for name, rows in tables.items():
        made += f"\n[{name}]\n" + "".join(f"{_key(k)} = {_value(v)}\n" for k, v in rows.items())
    wanted = json.loads(json.dumps(before))
    for name, rows in tables.items():
        place = wanted
        *above, last = name.split(".")
        for part in above:
            place = place.setdefault(part, {})
        place[last] = json.loads(json.dumps(dict(rows)))
    try:
        same = json.loads(json.dumps(tomllib.loads(made))) == wanted
    except tomllib.TOMLDecodeError:
        same = False
    if not same:
        names = ", ".join(f"[{name}]" for name in tables)
        raise SjerkError(f"the file is not changed: write {names} as tables of their own first")
    return made


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else json.dumps(name)


def _value(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, str):
        return json.dumps(value)
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(k)} = {_value(v)}" for k, v in value.items()) + " }"
    if isinstance(value, Sequence):
        return "[" + ", ".join(map(_value, value)) + "]"
    return str(value)
