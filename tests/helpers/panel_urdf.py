"""URDF files made at random, and a judge of them that shares no code with what reads them.

Each link is placed by going up to the root, joint by joint: a product of 4 x 4 matrices, a turn
about an axis by quaternions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

#: Of the maker's description of the Panda: name, parent, origin xyz, rpy; all turn about z.
PANDA = [
    ("panda_joint1", (0.0, 0.0, 0.333), (0.0, 0.0, 0.0)),
    ("panda_joint2", (0.0, 0.0, 0.0), (-math.pi / 2, 0.0, 0.0)),
    ("panda_joint3", (0.0, -0.316, 0.0), (math.pi / 2, 0.0, 0.0)),
    ("panda_joint4", (0.0825, 0.0, 0.0), (math.pi / 2, 0.0, 0.0)),
    ("panda_joint5", (-0.0825, 0.384, 0.0), (-math.pi / 2, 0.0, 0.0)),
    ("panda_joint6", (0.0, 0.0, 0.0), (math.pi / 2, 0.0, 0.0)),
    ("panda_joint7", (0.088, 0.0, 0.0), (math.pi / 2, 0.0, 0.0)),
]


def panda(
    shape: str = "<sphere radius='0.05'/>", element: str = "collision", *, end: str = ""
) -> str:
    """The maker's description, with one shape for all links."""
    solid = f"<{element}><geometry>{shape}</geometry></{element}>"
    rows = ["<robot name='panda'>", f"<link name='panda_link0'>{solid}</link>"]
    for i, (name, xyz, rpy) in enumerate(PANDA, start=1):
        x, y = " ".join(map(repr, xyz)), " ".join(map(repr, rpy))
        rows.append(
            f"<link name='panda_link{i}'>{solid}</link><joint name='{name}' type='revolute'>"
            f"<parent link='panda_link{i - 1}'/><child link='panda_link{i}'/>"
            f"<origin xyz='{x}' rpy='{y}'/><axis xyz='0 0 1'/></joint>"
        )
    rows.append(
        "<link name='flange'/><joint name='panda_joint8' type='fixed'><parent link='panda_link7'/>"
        "<child link='flange'/><origin xyz='0 0 0.107'/></joint>"
    )
    return "\n".join([*rows, end, "</robot>"])


@dataclass
class Joint:
    """One joint of a made robot."""

    name: str
    kind: str
    parent: str
    child: str
    xyz: Any
    rpy: Any
    axis: Any


@dataclass
class Shape:
    """One element of a link: kind, numbers, where."""

    link: str
    kind: str
    numbers: Any
    xyz: Any
    rpy: Any


@dataclass
class Made:
    """A robot; ``chain``: its turning joints, from the base on."""

    joints: list[Joint] = field(default_factory=list)
    shapes: list[Shape] = field(default_factory=list)
    chain: list[str] = field(default_factory=list)
    tip: str = ""

    @property
    def links(self) -> list[str]:
        """By name."""
        return ["base", *(joint.child for joint in self.joints)]

    def text(self) -> str:
        """The file."""
        rows = ["<robot name='made'>"]
        for link in self.links:
            rows.append(f"<link name='{link}'>")
            rows += [_element(s) for s in self.shapes if s.link == link]
            rows.append("</link>")
        for j in self.joints:
            rows.append(
                f"<joint name='{j.name}' type='{j.kind}'><parent link='{j.parent}'/>"
                f"<child link='{j.child}'/>{_origin(j.xyz, j.rpy)}<axis xyz='{_words(j.axis)}'/>"
                "<limit lower='-3' upper='3' effort='1' velocity='1'/></joint>"
            )
        return "\n".join([*rows, "</robot>"])


def _words(numbers: Any) -> str:
    return " ".join(repr(float(v)) for v in numbers)


def _origin(xyz: Any, rpy: Any) -> str:
    return f"<origin xyz='{_words(xyz)}' rpy='{_words(rpy)}'/>"


def _element(shape: Shape) -> str:
    n = shape.numbers
    inner = {
        "box": lambda: f"<box size='{_words(n[:3])}'/>",
        "sphere": lambda: f"<sphere radius='{n[0]!r}'/>",
        "cylinder": lambda: f"<cylinder radius='{n[0]!r}' length='{n[1]!r}'/>",
        "capsule": lambda: f"<capsule radius='{n[0]!r}' length='{n[1]!r}'/>",
    }[shape.kind]()
    where = _origin(shape.xyz, shape.rpy)
    return f"<collision>{where}<geometry>{inner}</geometry></collision>"


def made(random: np.random.Generator, turning: int) -> Made:
    """So many turning joints on one chain, with fixed and sliding ones between and beside."""
    robot, link, number = Made(), "base", 0

    def grow(parent: str, kind: str, name: str) -> str:
        nonlocal number
        number += 1
        child = f"link_{number}"
        axis = random.normal(size=3) if random.random() < 0.5 else np.eye(3)[random.integers(3)]
        if random.random() < 0.3:
            axis = -axis
        turn = random.uniform(-math.pi, math.pi, 3)
        xyz = random.uniform(-0.4, 0.4, 3)
        robot.joints.append(
            Joint(name, kind, parent, child, xyz, turn, axis * random.uniform(0.5, 2))
        )
        return child

    for i in range(turning):
        if random.random() < 0.4:
            link = grow(link, str(random.choice(["fixed", "prismatic"])), f"held_{i}")
        if random.random() < 0.3:
            grow(link, "prismatic", f"finger_{i}")
        kind = str(random.choice(["revolute", "continuous"]))
        link = grow(link, kind, f"turn_{i}")
        robot.chain.append(f"turn_{i}")
    if random.random() < 0.5:
        link = grow(link, "fixed", "flange")
    robot.tip = link
    for name in robot.links:
        for _ in range(random.integers(0, 3)):
            kind = str(random.choice(["box", "sphere", "cylinder", "capsule"]))
            numbers = random.uniform(0.01, 0.5, 3)
            turn = random.uniform(-math.pi, math.pi, 3)
            robot.shapes.append(
                Shape(name, kind, numbers.tolist(), random.uniform(-0.3, 0.3, 3), turn)
            )
    robot.shapes.append(Shape(link, "sphere", [0.05], np.zeros(3), np.zeros(3)))
    return robot


def _turn(axis: Any, angle: float) -> Any:
    """A rotation matrix by a quaternion."""
    u = np.asarray(axis, float) / math.sqrt(math.fsum(float(v) ** 2 for v in axis))
    w, (x, y, z) = math.cos(angle / 2), math.sin(angle / 2) * u
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def _frame(xyz: Any, rpy: Any) -> Any:
    found = np.eye(4)
    found[:3, :3] = _turn([0, 0, 1], rpy[2]) @ _turn([0, 1, 0], rpy[1]) @ _turn([1, 0, 0], rpy[0])
    found[:3, 3] = xyz
    return found


def place(robot: Made, link: str, angles: Mapping[str, float]) -> Any:
    """Where a link is in the base's frame, (4, 4)."""
    above = {joint.child: joint for joint in robot.joints}
    found = np.eye(4)
    while link in above:
        joint = above[link]
        own = _frame(joint.xyz, joint.rpy)
        turned = np.eye(4)
        turned[:3, :3] = _turn(joint.axis, angles.get(joint.name, 0.0))
        found = own @ turned @ found
        link = joint.parent
    return found


def skin(
    robot: Made, shape: Shape, angles: Mapping[str, float], random: np.random.Generator
) -> Any:
    """Points of the surface of a shape, (n, 3), in the base's frame."""
    n, way = shape.numbers, random.normal(size=(60, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    if shape.kind == "box":
        at = np.sign(way) * np.array(n[:3]) / 2  # its corners are furthest
    elif shape.kind == "sphere":
        at = n[0] * way
    elif shape.kind == "cylinder":
        flat = way[:, :2] / np.linalg.norm(way[:, :2], axis=1)[:, None]
        at = np.column_stack([n[0] * flat, np.sign(way[:, 2]) * n[1] / 2])
    else:
        at = n[0] * way + np.column_stack([np.zeros((60, 2)), np.sign(way[:, 2]) * n[1] / 2])
    whole = place(robot, shape.link, angles) @ _frame(shape.xyz, shape.rpy)
    return at @ whole[:3, :3].T + whole[:3, 3]
