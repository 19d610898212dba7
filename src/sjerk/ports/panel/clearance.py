"""How near an arm comes to its scene and to itself.

Against the scene each capsule is a row of spheres, inflated by what lies between two of them; its
own links are compared as capsules, by the distance of two line segments (C. Ericson, Real-Time
Collision Detection, 5.1.9). A distance that is told is never larger than that of the model. Never
here: planning.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sjerk.ports.panel.arm import Arm
from sjerk.ports.panel.shapes import Scene

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]
_Label = Callable[[int], tuple[str, str]]

#: Spheres of a row are so far apart, in radii.
_SPACING = 0.5
#: Links that overlap in more than this share of all configurations are joined, not in collision.
_JOINED = 0.5
_PROBES = 400


@dataclass(frozen=True)
class Nearest:
    """What comes nearest: the distance (m, negative: they overlap), and who it is."""

    distance: float
    one: str
    other: str

    def __str__(self) -> str:
        verb = "touches" if self.distance <= 0.0 else "is near"
        return f"{self.one} {verb} {self.other} ({1e3 * self.distance:.0f} mm)"


class Clearance:
    """Distances of an arm to a scene, for ranges of its joints (N,) in rad.

    >>> import numpy as np
    >>> from sjerk.ports.panel.shapes import Shape
    >>> arm = Arm([[0.0, 0.3, 0.0], [0.0, 0.0, -np.pi / 2]], flange=0.2, radius=[0.05] * 3)
    >>> ball = Scene({"ball": Shape("sphere", (0.1,), (0.0, 0.5, 0.3))}, floor=None)
    >>> near = Clearance(arm, [-3.0, -3.0], [3.0, 3.0], ball)
    >>> print(near.nearest([0.0, 0.0]))
    link 2 is near ball (148 mm)
    """

    def __init__(self, arm: Arm, lower: ArrayLike, upper: ArrayLike, scene: Scene) -> None:
        self.arm, self.scene = arm, scene
        self.lower, self.upper = np.asarray(lower, float), np.asarray(upper, float)
        links, at, radius = _rows(arm)
        self._links, self._at, self._radius = links, at, radius
        tool, tool_radius, owner = [], [], []
        for name, shape in scene.shapes.items():
            if shape.attached:
                centres, radii = shape.cover()
                tool.append(centres @ arm.end[:3, :3].T + arm.end[:3, 3])
                tool_radius.append(radii)
                owner += [name] * len(radii)
        #: Spheres of what is attached, in the last link's frame.
        self._tool = np.concatenate(tool) if tool else np.empty((0, 3))
        self._tool_radius = np.concatenate(tool_radius) if tool else np.empty(0)
        self._owner = owner
        self._obstacles = [(n, s) for n, s in scene.shapes.items() if not s.attached]
        self._pairs = self._free_pairs()

    @property
    def reach(self) -> FloatArray:
        """How far from each joint's axis any point of the arm and its tool is, (N,), m."""
        far = np.linalg.norm(self._tool, axis=1) + self._tool_radius
        return self.arm.reach(float(far.max()) if len(far) else 0.0)

    def distances(self, q: ArrayLike) -> FloatArray:
        """Least distance (n,) to the scene and to itself, m, of configurations (n, N) in rad."""
        frames = self.arm.frames(q)
        found = np.full(len(frames), np.inf)
        for part in self._parts(frames):
            if part.shape[1]:
                np.minimum(found, part.min(axis=1), out=found)
        return found

    def nearest(self, q: ArrayLike) -> Nearest:
        """What comes nearest in one configuration (N,)."""
        frames = self.arm.frames(q)
        best = Nearest(np.inf, "arm", "nothing")
        for part, label in zip(self._parts(frames), self._labels(), strict=True):
            if part.shape[1]:
                k = int(part[0].argmin())
                if part[0, k] < best.distance:
                    best = Nearest(float(part[0, k]), *label(k))
        return best

    def touching(self, q: ArrayLike) -> tuple[set[int], set[str]]:
        """Links and shapes that touch something in one configuration (N,)."""
        frames = self.arm.frames(q)
        links: set[int] = set()
        names: set[str] = set()
        for part, label in zip(self._parts(frames), self._labels(), strict=True):
            for k in np.flatnonzero(part[0] <= 0.0) if part.shape[1] else ():
                for who in label(int(k)):
                    names.add(who)
        for link in range(self.arm.joints + 1):
            if self.arm.link_name(link) in names:
                links.add(link)
        return links, names & set(self.scene.shapes)

    # ---- parts: each (n, m) distances, and who the m are

    def _parts(self, frames: FloatArray) -> list[FloatArray]:
        centres = _placed(frames[:, self._links], self._at)
        tool = _placed(frames[:, [-1] * len(self._tool)], self._tool)
        moving = self._links > 0
        parts = []
        for _, shape in self._obstacles:
            parts.append(shape.distances(centres[:, moving]) - self._radius[moving])
            parts.append(shape.distances(tool) - self._tool_radius)
        if self.scene.floor is not None:
            above = self._links > 1  # the base stands on it
            parts.append(centres[:, above, 2] - self.scene.floor - self._radius[above])
            parts.append(tool[:, :, 2] - self.scene.floor - self._tool_radius)
        starts, ends = self._ends(frames)
        i, j = self._pairs
        radii = np.array([c.radius for c in self.arm.capsules])
        gap = segment_distances(starts[:, i], ends[:, i], starts[:, j], ends[:, j])
        parts.append(gap - radii[i] - radii[j])
        parts.append(self._tool_parts(tool, starts, ends, radii))
        return parts

    def _tool_parts(
        self, tool: FloatArray, starts: FloatArray, ends: FloatArray, radii: FloatArray
    ) -> FloatArray:
        """What is attached against the links that cannot hold it: (n, spheres * capsules)."""
        far = self._far
        if not len(self._tool) or not len(far):
            return np.empty((len(tool), 0))
        point = tool[:, :, None]
        gap = segment_distances(point, point, starts[:, None, far], ends[:, None, far])
        gap = gap - self._tool_radius[:, None] - radii[far]
        return gap.reshape(len(tool), -1)

    @property
    def _far(self) -> IntArray:
        links = np.array([c.link for c in self.arm.capsules])
        return np.flatnonzero(links < self.arm.joints - 1)

    def _labels(self) -> list[_Label]:
        link, arm = self.arm.link_name, self.arm
        moving, above = np.flatnonzero(self._links > 0), np.flatnonzero(self._links > 1)

        def arm_and(name: str) -> _Label:
            return lambda k: (link(int(self._links[moving[k]])), name)

        def tool_and(name: str) -> _Label:
            return lambda k: (self._owner[k], name)

        labels: list[_Label] = []
        for name, _ in self._obstacles:
            labels += [arm_and(name), tool_and(name)]
        if self.scene.floor is not None:
            labels.append(lambda k: (link(int(self._links[above[k]])), "the floor"))
            labels.append(tool_and("the floor"))
        i, j = self._pairs
        capsule, far = arm.capsules, self._far
        labels.append(lambda k: (link(capsule[i[k]].link), link(capsule[j[k]].link)))
        labels.append(lambda k: (self._owner[k // len(far)], link(capsule[far[k % len(far)]].link)))
        return labels

    def _ends(self, frames: FloatArray) -> tuple[FloatArray, FloatArray]:
        links = [c.link for c in self.arm.capsules]
        starts = np.array([c.start for c in self.arm.capsules])
        ends = np.array([c.end for c in self.arm.capsules])
        return _placed(frames[:, links], starts), _placed(frames[:, links], ends)

    def _free_pairs(self) -> tuple[IntArray, IntArray]:
        """Pairs of capsules of links that are not joined: neither neighbours nor always together.

        Of links with a common neighbour the drums overlap by design; others are tried in many
        configurations, the same ones each time.
        """
        links = np.array([c.link for c in self.arm.capsules])
        i, j = np.triu_indices(len(links), 1)
        apart = np.abs(links[i] - links[j]) > 1
        i, j = i[apart], j[apart]
        probes = np.random.default_rng(0).uniform(
            self.lower, self.upper, (_PROBES, self.arm.joints)
        )
        starts, ends = self._ends(self.arm.frames(probes))
        radii = np.array([c.radius for c in self.arm.capsules])
        gap = segment_distances(starts[:, i], ends[:, i], starts[:, j], ends[:, j])
        hit = gap < radii[i] + radii[j]
        keep = np.ones(len(i), bool)
        for pair in {(int(a), int(b)) for a, b in zip(links[i], links[j], strict=True)}:
            own = (links[i] == pair[0]) & (links[j] == pair[1])
            if hit[:, own].any(axis=1).mean() > _JOINED:
                keep &= ~own
        return i[keep], j[keep]


def _placed(frames: FloatArray, at: FloatArray) -> FloatArray:
    """Points (m, 3) of frames (n, m, 4, 4), in the base's frame: (n, m, 3)."""
    found: FloatArray = (frames[..., :3, :3] @ at[..., None])[..., 0] + frames[..., :3, 3]
    return found


def _rows(arm: Arm) -> tuple[IntArray, FloatArray, FloatArray]:
    """Spheres that contain the capsules: link, centre in its frame, radius of each."""
    links, at, radii = [], [], []
    for capsule in arm.capsules:
        start, end = np.array(capsule.start), np.array(capsule.end)
        length = float(np.linalg.norm(end - start))
        n = max(2, int(np.ceil(length / (_SPACING * capsule.radius))) + 1)
        # between two centres the capsule's surface is at most this far from the nearer one
        radius = float(np.hypot(capsule.radius, length / (n - 1) / 2.0))
        for share in np.linspace(0.0, 1.0, n):
            links.append(capsule.link)
            at.append(start + share * (end - start))
            radii.append(radius)
    return np.array(links), np.array(at), np.array(radii)


def segment_distances(
    start: FloatArray, end: FloatArray, other_start: FloatArray, other_end: FloatArray
) -> FloatArray:
    """Distances (...) of line segments from each other, given by their ends (..., 3).

    Minimise |P(s) - Q(t)| over 0 <= s, t <= 1: s of the lines, t for it, cut off, s for that.
    """
    one, two, between = end - start, other_end - other_start, start - other_start
    a, e = (one * one).sum(-1), (two * two).sum(-1)
    b, c, f = (one * two).sum(-1), (one * between).sum(-1), (two * between).sum(-1)
    least = np.finfo(np.float64).tiny
    across = a * e - b * b
    s = np.clip(np.where(across > 1e-12 * a * e, (b * f - c * e), 0.0) / _not_0(across), 0.0, 1.0)
    t = np.clip((b * s + f) / np.maximum(e, least), 0.0, 1.0)
    s = np.clip((b * t - c) / np.maximum(a, least), 0.0, 1.0)
    apart = between + s[..., None] * one - t[..., None] * two
    found: FloatArray = np.sqrt((apart * apart).sum(-1))
    return found


def _not_0(values: FloatArray) -> FloatArray:
    return np.where(values > 0.0, values, 1.0)
