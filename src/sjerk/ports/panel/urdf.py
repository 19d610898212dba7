"""A user's URDF as an arm: its chain of joints, its shape as capsules, its meshes to be seen.

URDF (wiki.ros.org/urdf/XML): a joint turns about any axis of its child's frame; here frame i has
joint i as its z axis, so B, the turn that brings z onto the axis, goes into the fixed part:

    T(i-1, i) = O B RotZ(theta),   O = origin,   Rot(axis, theta) = B RotZ(theta) B^-1.

A joint that no axis of the kernel moves is held at 0. Every element of a shape is held by one
capsule, so a distance is never larger than the truth. Never here: pages, distances.
"""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from sjerk.errors import ExtraMissingError, SjerkError
from sjerk.ports.panel.arm import Arm, Capsule
from sjerk.ports.panel.capsules import capsule_mesh, least_capsule

FloatArray = NDArray[np.float64]
Colour = tuple[int, int, int]

_TURNS = ("revolute", "continuous")
_KINDS = (*_TURNS, "fixed", "prismatic", "floating", "planar")
_GREY: Colour = (200, 200, 205)
_MOST_BYTES = 50_000_000
_SIDES = 24


class UrdfError(SjerkError):
    """A URDF that cannot be used: the file, and what is wrong where."""


@dataclass(frozen=True)
class Visual:
    """What is seen of a link (0: the base): vertices (n, 3) in its frame, m; triangles (m, 3)."""

    link: int
    vertices: FloatArray
    faces: NDArray[Any]
    colour: Colour


@dataclass(frozen=True)
class _Joint:
    name: str
    kind: str
    parent: str
    child: str
    origin: FloatArray
    axis: FloatArray
    mimics: bool


def read_urdf(
    path: Path, names: Sequence[str], *, tip: str | None = None
) -> tuple[Arm, tuple[Visual, ...]]:
    """The arm of a file whose joints are the axes ``names``, and what is seen of it.

    Joints are taken by name; where none has the name of an axis, in their order along the chain.
    ``tip``: the link that is the flange; None: the last one behind the last joint before the chain
    branches or moves. Raises UrdfError, ExtraMissingError.
    """
    return _Reader(path).arm(list(names), tip)


class _Reader:
    def __init__(self, path: Path) -> None:
        self.path = path
        self.root = self._parsed()
        self.links = {self._name(e): e for e in self.root.findall("link")}
        self.joints = [self._joint(e) for e in self.root.findall("joint")]
        self.colours: dict[str, Colour] = {}
        for element in self.root.findall("material"):
            if (found := self._rgba(element)) is not None:
                self.colours[element.get("name", "")] = found
        self._children: dict[str, list[_Joint]] = {name: [] for name in self.links}
        held: set[str] = set()
        for joint in self.joints:
            for end in (joint.parent, joint.child):
                if end not in self.links:
                    raise self._error(f"joint {joint.name!r}", f"there is no link {end!r}")
            if joint.child in held:
                raise self._error(f"link {joint.child!r}", "has two parents")
            held.add(joint.child)
            self._children[joint.parent].append(joint)
        roots = [name for name in self.links if name not in held]
        if len(roots) != 1:
            raise self._error("links", f"one must have no parent, not {len(roots)}")
        self.base = roots[0]

    def _error(self, where: str, why: str) -> UrdfError:
        return UrdfError(f"{self.path}: {where}: {why}")

    def _parsed(self) -> ET.Element:
        try:
            data = self.path.read_bytes()
        except OSError as fault:
            raise UrdfError(f"{self.path}: {fault.strerror or fault}") from fault
        if len(data) > _MOST_BYTES or b"<!ENTITY" in data:
            raise self._error("file", "is too large, or has entities")
        try:
            root = ET.fromstring(data)
        except ET.ParseError as fault:
            raise self._error("file", f"is no XML: {fault}") from fault
        if root.tag != "robot":
            raise self._error("file", f"is no URDF: its root is <{root.tag}>, not <robot>")
        return root

    # ---- elements

    def _name(self, element: ET.Element) -> str:
        name = element.get("name")
        if not name:
            raise self._error(f"<{element.tag}>", "has no name")
        return name

    def _numbers(self, text: str | None, count: int, where: str, default: str) -> FloatArray:
        words = (default if text is None else text).split()
        try:
            found = np.array([float(word) for word in words])
        except ValueError:
            found = np.empty(0)
        if len(found) != count or not np.isfinite(found).all():
            raise self._error(where, f"{text!r} must be {count} numbers")
        return found

    def _origin(self, element: ET.Element, where: str) -> FloatArray:
        """Of <origin xyz rpy>: roll, pitch, yaw about the fixed axes x, y, z."""
        found, own = np.eye(4), element.find("origin")
        if own is not None:
            roll, pitch, yaw = self._numbers(own.get("rpy"), 3, f"{where}, rpy", "0 0 0").tolist()
            cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
            cy, sy = np.cos(yaw), np.sin(yaw)
            found[:3, :3] = [
                [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                [-sp, cp * sr, cp * cr],
            ]
            found[:3, 3] = self._numbers(own.get("xyz"), 3, f"{where}, xyz", "0 0 0")
        return found

    def _joint(self, element: ET.Element) -> _Joint:
        name = self._name(element)
        where, kind = f"joint {name!r}", element.get("type", "")
        if kind not in _KINDS:
            raise self._error(where, f"type {kind!r} must be one of {', '.join(_KINDS)}")
        ends = []
        for which in ("parent", "child"):
            own = element.find(which)
            if own is None or not own.get("link"):
                raise self._error(where, f"has no {which}")
            ends.append(str(own.get("link")))
        own = element.find("axis")
        given = None if own is None else own.get("xyz")
        axis = self._numbers(given, 3, f"{where}, axis", "1 0 0")
        length = float(np.linalg.norm(axis))
        if length < 1e-9 and kind in _TURNS:
            raise self._error(where, "its axis has no direction")
        return _Joint(
            name,
            kind,
            ends[0],
            ends[1],
            self._origin(element, where),
            axis / length if length > 0.0 else axis,
            element.find("mimic") is not None,
        )

    def _rgba(self, element: ET.Element | None) -> Colour | None:
        own = None if element is None else element.find("color")
        if own is None:
            return None
        rgba = self._numbers(own.get("rgba"), 4, "rgba", "0.8 0.8 0.8 1")
        r, g, b = (np.clip(rgba[:3], 0.0, 1.0) * 255.0).round().astype(int).tolist()
        return r, g, b

    # ---- the chain

    def arm(self, names: list[str], tip: str | None) -> tuple[Arm, tuple[Visual, ...]]:
        chain = self._chain(names)
        number = {joint.name: i for i, joint in enumerate(chain, start=1)}
        fixed = np.empty((len(chain), 4, 4))
        place: dict[str, tuple[int, FloatArray]] = {self.base: (0, np.eye(4))}
        waiting = [self.base]
        while waiting:
            link = waiting.pop()
            owner, at = place[link]
            for joint in self._children[link]:
                i = number.get(joint.name)
                if i is None:
                    place[joint.child] = owner, at @ joint.origin
                else:
                    turned = np.eye(4)
                    turned[:3, :3] = onto(joint.axis)
                    fixed[i - 1] = at @ joint.origin @ turned
                    place[joint.child] = i, turned.T
                waiting.append(joint.child)
        end = self._tip(chain, place, tip)
        capsules, visuals = self._shapes(place)
        labels = [self.base, *(joint.child for joint in chain)]
        arm = Arm.of(fixed, end=end, capsules=capsules, names=names, links=labels)
        return arm, tuple(visuals)

    def _chain(self, names: list[str]) -> list[_Joint]:
        """The joint of each axis; they follow each other on one chain."""
        turning = {j.name: j for j in self.joints if j.kind in _TURNS and not j.mimics}
        known = [name for name in names if name in turning]
        if not known:
            found = [j for j in self._order(self.base) if j.name in turning]
            if len(found) != len(names):
                joints = ", ".join(j.name for j in found) or "none"
                raise self._error("joints", f"{joints} turn; the kernel's axes: {', '.join(names)}")
        elif len(known) < len(names):
            missing = ", ".join(name for name in names if name not in turning)
            raise self._error("joints", f"none that turns has the name of the axis {missing}")
        else:
            found = [turning[name] for name in names]
        above: dict[str, _Joint] = {j.child: j for j in self.joints}
        for one, other in zip([None, *found[:-1]], found, strict=True):
            way, link = [], other.parent
            while link in above:
                way.append(above[link])
                link = above[link].parent
            moved = [j for j in way if j in found]
            if moved[:1] != ([] if one is None else [one]):
                before = "the base" if one is None else f"joint {one.name!r}"
                raise self._error(f"joint {other.name!r}", f"does not follow {before} on one chain")
        return found

    def _order(self, link: str) -> Iterator[_Joint]:
        waiting = [link]
        while waiting:
            own = self._children[waiting.pop(0)]
            yield from own
            waiting += [j.child for j in own]

    def _tip(
        self, chain: list[_Joint], place: dict[str, tuple[int, FloatArray]], tip: str | None
    ) -> FloatArray:
        if tip is None:
            tip = chain[-1].child
            while len(own := self._children[tip]) == 1 and own[0].kind == "fixed":
                tip = own[0].child
        owner, at = place.get(tip, (-1, np.eye(4)))
        if owner != len(chain):
            raise self._error(f"tip {tip!r}", f"must be a link behind joint {chain[-1].name!r}")
        return at

    # ---- the shape

    def _shapes(
        self, place: dict[str, tuple[int, FloatArray]]
    ) -> tuple[list[Capsule], list[Visual]]:
        capsules, visuals = [], []
        for name, element in self.links.items():
            owner, at = place[name]
            seen = element.findall("visual")
            visuals += [self._visual(owner, at, one, f"link {name!r}") for one in seen]
            for one in element.findall("collision") or seen:
                where = f"link {name!r}, {one.tag}"
                vertices, _, _, larger = self._geometry(one, where)
                found = at @ self._origin(one, where)
                capsules.append(least_capsule(owner, _moved(found, vertices), larger))
        if not any(capsule.link > 0 for capsule in capsules):
            raise self._error("links", "none that moves has a shape")
        return capsules, visuals

    def _visual(self, owner: int, at: FloatArray, element: ET.Element, where: str) -> Visual:
        vertices, faces, own, radius = self._geometry(element, f"{where}, visual")
        if radius:
            (x, y, z), (u, v, w) = vertices.tolist()
            vertices, faces = capsule_mesh(Capsule(0, (x, y, z), (u, v, w), radius))
        found = at @ self._origin(element, f"{where}, visual")
        material = element.find("material")
        named = None if material is None else self.colours.get(material.get("name", ""))
        colour = self._rgba(material) or named or own or _GREY
        return Visual(owner, _moved(found, vertices), faces, colour)

    def _geometry(
        self, element: ET.Element, where: str
    ) -> tuple[FloatArray, NDArray[Any], Colour | None, float]:
        """Vertices, triangles, the mesh's own colour; and by how much it is larger than those.

        That is 0, but for spheres and capsules: their vertices are the ends of a line.
        """
        own = element.find("geometry")
        shape = None if own is None or not len(own) else own[0]
        if shape is None:
            raise self._error(where, "has no geometry")
        if shape.tag == "mesh":
            return self._mesh(shape, where)
        if shape.tag == "box":
            size = self._numbers(shape.get("size"), 3, f"{where}, size", "")
            made = trimesh.creation.box(size)
            return np.asarray(made.vertices, float), np.asarray(made.faces), None, 0.0
        if shape.tag not in ("sphere", "cylinder", "capsule"):
            raise self._error(where, f"<{shape.tag}> is no geometry that is known")
        radius = self._length(shape, "radius", where)
        length = 0.0 if shape.tag == "sphere" else self._length(shape, "length", where)
        if shape.tag == "cylinder":
            # a polygon around the circle, so that what holds it holds the cylinder
            out = radius / np.cos(np.pi / _SIDES)
            made = trimesh.creation.cylinder(out, length, sections=_SIDES)
            return np.asarray(made.vertices, float), np.asarray(made.faces), None, 0.0
        line = np.array([[0.0, 0.0, -length / 2.0], [0.0, 0.0, length / 2.0]])
        return line, np.empty((0, 3), int), None, radius

    def _length(self, shape: ET.Element, name: str, where: str) -> float:
        found = float(self._numbers(shape.get(name), 1, f"{where}, {name}", "")[0])
        if found <= 0.0:
            raise self._error(where, f"{name} {found:g} must be greater than 0")
        return found

    def _mesh(
        self, shape: ET.Element, where: str
    ) -> tuple[FloatArray, NDArray[Any], Colour | None, float]:
        name = shape.get("filename", "")
        file = self._file(name)
        if file is None:
            raise self._error(where, f"there is no file {name!r}")
        try:
            made = trimesh.load(file, force="mesh")
            vertices, faces = np.asarray(made.vertices, float), np.asarray(made.faces)
        except ImportError as fault:
            raise ExtraMissingError(f"a reader of {file.suffix}", "panel-urdf") from fault
        except Exception as fault:  # decoders meet damaged bytes with any type
            raise self._error(where, f"{file} cannot be read: {fault}") from fault
        if not len(vertices) or not np.isfinite(vertices).all():
            raise self._error(where, f"{file} has no finite vertices")
        scale = self._numbers(shape.get("scale"), 3, f"{where}, scale", "1 1 1")
        colour = None
        with_colour = getattr(made.visual, "main_color", None)
        if with_colour is not None and made.visual.kind in ("face", "vertex"):
            r, g, b = (int(v) for v in with_colour[:3])
            colour = r, g, b
        if np.prod(scale) < 0.0:
            faces = faces[:, ::-1]
        return vertices * scale, faces, colour, 0.0

    def _file(self, name: str) -> Path | None:
        """A mesh: beside the URDF, or in a package that is one of the folders above, or in a path.

        ``ROS_PACKAGE_PATH`` and ``AMENT_PREFIX_PATH`` are looked at, as ROS does.
        """
        if name.startswith("package://"):
            package, _, rest = name.removeprefix("package://").partition("/")
            above = [self.path.resolve().parent, *self.path.resolve().parent.parents]
            places = [folder / rest for folder in above if folder.name == package]
            places += [folder / package / rest for folder in above]
            for variable, share in (("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share")):
                for folder in filter(None, os.environ.get(variable, "").split(os.pathsep)):
                    places.append(Path(folder) / share / package / rest)
        else:
            places = [self.path.parent / name.removeprefix("file://")]
        return next((place for place in places if place.is_file()), None)


def onto(axis: FloatArray) -> FloatArray:
    """The turn (3, 3) that brings z onto a direction, by the shortest way.

    R = 1 + K + K^2 / (1 + c), K the cross product with z x axis, c = z . axis.

    >>> (onto(np.array([0.0, 1.0, 0.0])) @ [0.0, 0.0, 1.0]).tolist()
    [0.0, 1.0, 0.0]
    """
    x, y, c = float(axis[0]), float(axis[1]), float(axis[2])
    if c < -0.9:  # its opposite is near: by a half turn about x first
        half = np.diag([1.0, -1.0, -1.0])
        return half @ onto(np.array([x, -y, -c]))
    K = np.array([[0.0, 0.0, x], [0.0, 0.0, y], [-x, -y, 0.0]])
    found: FloatArray = np.eye(3) + K + K @ K / (1.0 + c)
    return found


def _moved(frame: FloatArray, points: FloatArray) -> FloatArray:
    found: FloatArray = points @ frame[:3, :3].T + frame[:3, 3]
    return found
