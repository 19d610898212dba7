"""Obstacles: boxes, spheres, cylinders, and how far points are from them.

Signed distances: negative inside, the depth there. A shape may be attached to the tool: it moves
with the flange then. Never here: arms, files.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from sjerk.errors import InputError, positive, real

FloatArray = NDArray[np.float64]
Kind = Literal["box", "sphere", "cylinder"]

#: What ``size`` of each kind is, metres.
SIZES: dict[str, tuple[str, ...]] = {
    "box": ("x", "y", "z"),
    "sphere": ("radius",),
    "cylinder": ("radius", "height"),
}
#: No place and no size beyond it, metres: a robot of a room.
FURTHEST = 100.0
#: An attached box is covered by no more spheres than about this.
_MOST_SPHERES = 64


@dataclass(frozen=True)
class Shape:
    """An obstacle; ``size`` as ``SIZES`` has it, ``centre`` (m), ``yaw`` about the z axis (rad).

    ``attached``: it is fixed to the tool, and ``centre`` counts from the flange, z outward.
    Raises InputError.

    >>> Shape("sphere", (0.1,), (0.5, 0.0, 0.2)).distances(np.array([[0.5, 0.0, 0.5]])).round(9)
    array([0.2])
    """

    kind: Kind
    size: tuple[float, ...]
    centre: tuple[float, float, float]
    _: KW_ONLY
    yaw: float = 0.0
    attached: bool = False

    def __post_init__(self) -> None:
        if self.kind not in get_args(Kind):
            raise InputError("kind", self.kind, f"must be one of {', '.join(get_args(Kind))}")
        names = SIZES[self.kind]
        for name, wanted in (("size", len(names)), ("centre", 3)):
            value = getattr(self, name)
            if not isinstance(value, Sequence) or isinstance(value, str) or len(value) != wanted:
                raise InputError(name, value, f"must be {wanted} numbers, metres")
        size = tuple(positive(f"size.{n}", v) for n, v in zip(names, self.size, strict=True))
        centre = tuple(real(f"centre.{n}", v) for n, v in zip("xyz", self.centre, strict=True))
        for name, values in (("size", size), ("centre", centre)):
            if max(map(abs, values)) > FURTHEST:
                raise InputError(name, list(values), f"must be within {FURTHEST:g} m")
        object.__setattr__(self, "size", size)
        object.__setattr__(self, "centre", centre)
        object.__setattr__(self, "yaw", real("yaw", self.yaw))
        if not isinstance(self.attached, bool):
            raise InputError("attached", self.attached, "must be true or false")

    def local(self, points: FloatArray) -> FloatArray:
        """Points (..., 3) as seen from the shape's centre, unturned."""
        moved: FloatArray = points - np.array(self.centre)
        if self.yaw == 0.0:
            return moved
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        turned: FloatArray = moved @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        return turned

    def distances(self, points: FloatArray) -> FloatArray:
        """Signed distance (...) of points (..., 3) to its surface, m."""
        at = self.local(points)
        if self.kind == "sphere":
            found: FloatArray = np.linalg.norm(at, axis=-1) - self.size[0]
            return found
        if self.kind == "box":
            beyond = np.abs(at) - np.array(self.size) / 2.0
        else:
            radius, height = self.size
            across = np.hypot(at[..., 0], at[..., 1]) - radius
            beyond = np.stack([across, np.abs(at[..., 2]) - height / 2.0], axis=-1)
        outside: FloatArray = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)
        signed: FloatArray = outside + np.minimum(beyond.max(axis=-1), 0.0)
        return signed

    def cover(self) -> tuple[FloatArray, FloatArray]:
        """Spheres that contain it: centres (n, 3) from the flange where attached, radii (n,), m."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        if self.kind == "sphere":
            at, radius = np.zeros((1, 3)), self.size[0]
        elif self.kind == "cylinder":
            own, height = self.size
            n = min(_MOST_SPHERES, max(1, int(np.ceil(height / own))))
            at = np.zeros((n, 3))
            at[:, 2] = height * ((np.arange(n) + 0.5) / n - 0.5)
            radius = float(np.hypot(own, height / n / 2.0))
        else:
            size = np.array(self.size)
            side = max(size.min(), float(np.prod(size) / _MOST_SPHERES) ** (1.0 / 3.0))
            n = np.maximum(1, np.ceil(size / side)).astype(int)
            n = np.minimum(n, _MOST_SPHERES)
            rows = [(np.arange(k) + 0.5) / k - 0.5 for k in n]
            at = np.stack(np.meshgrid(*rows, indexing="ij"), axis=-1).reshape(-1, 3) * size
            radius = float(np.linalg.norm(size / n)) / 2.0
        return at @ turn + np.array(self.centre), np.full(len(at), radius)

    def table(self) -> dict[str, Any]:
        """As a table of a TOML file."""
        found: dict[str, Any] = {
            "kind": self.kind,
            "size": list(self.size),
            "centre": list(self.centre),
        }
        if self.yaw:
            found["yaw"] = self.yaw
        if self.attached:
            found["attached"] = True
        return found


@dataclass(frozen=True)
class Scene:
    """What stands around an arm: shapes by name, and a floor at z = ``floor`` (m), or None.

    A scene does not change: another one is made of it, so that a plan knows the one it is for.
    """

    shapes: Mapping[str, Shape]
    floor: float | None = 0.0

    def with_shape(self, name: str, shape: Shape | None) -> Scene:
        """With this shape, or without it."""
        shapes = {key: one for key, one in self.shapes.items() if key != name}
        if shape is not None:
            shapes[name] = shape
        return Scene(shapes, self.floor)
