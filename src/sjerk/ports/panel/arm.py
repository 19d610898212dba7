"""An arm from a table of Denavit-Hartenberg parameters: where its links are, and their shape.

Modified parameters (J. J. Craig, Introduction to Robotics, 3.4): frame i sits on joint i, and

    T(i-1, i) = RotX(alpha) TransX(a) RotZ(theta) TransZ(d),   theta = the joint's angle.

The shape is capsules along the links, so nothing of anybody's meshes is needed. All vectorised over
configurations. Never here: obstacles, limits, motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sjerk.errors import InputError, positive, real

FloatArray = NDArray[np.float64]

#: Half the length of the drum about each joint's axis, in its radii.
_DRUM = 0.8


@dataclass(frozen=True)
class Capsule:
    """All points within ``radius`` of a line, in the frame of ``link`` (0: the base); metres."""

    link: int
    start: tuple[float, float, float]
    end: tuple[float, float, float]
    radius: float


class Arm:
    """Kinematics and shape of an arm of N revolute joints.

    ``dh`` (N, 3): a (m), d (m), alpha (rad) of each joint; ``flange`` (m): from the last frame
    along its z axis to the flange; ``radius`` (N + 1,): of each link, the base first (m). ``names``
    (N,): of the joints. Raises InputError.

    >>> elbow = Arm([[0.0, 0.3, 0.0], [0.0, 0.0, -np.pi / 2]], flange=0.2, radius=[0.05] * 3)
    >>> elbow.tip([[0.0, 0.0]])[0, :3, 3].round(9).tolist()
    [0.0, 0.2, 0.3]
    """

    def __init__(
        self,
        dh: ArrayLike,
        *,
        flange: float,
        radius: Sequence[float],
        names: Sequence[str] = (),
    ) -> None:
        try:
            table = np.array(dh, dtype=np.float64)
        except (TypeError, ValueError):
            raise InputError("dh", dh, "must be rows of three numbers: a, d, alpha") from None
        if table.ndim != 2 or table.shape[1:] != (3,) or not len(table):
            raise InputError("dh", dh, "must be rows of three numbers: a, d, alpha")
        if not np.isfinite(table).all():
            raise InputError("dh", dh, "must be finite")
        self.joints = len(table)
        #: The flange in the last frame, (4, 4).
        self.end = np.eye(4)
        self.end[2, 3] = real("flange", flange)
        if not isinstance(radius, Sequence) or len(radius) != self.joints + 1:
            raise InputError("radius", radius, f"needs {self.joints + 1} numbers, the base first")
        radii = [positive(f"radius[{i}]", r) for i, r in enumerate(radius)]
        self.names = tuple(names) or tuple(f"joint {i + 1}" for i in range(self.joints))
        self.links = ("base", *(f"link {i + 1}" for i in range(self.joints)))
        #: Frame i in frame i - 1 at angle 0, (N, 4, 4).
        self.fixed: FloatArray = np.stack([_fixed(*row) for row in table.tolist()])
        self.capsules = self._shape(radii)

    @classmethod
    def of(
        cls,
        fixed: FloatArray,
        *,
        end: FloatArray,
        capsules: Sequence[Capsule],
        names: Sequence[str],
        links: Sequence[str],
    ) -> Self:
        """An arm of any frames: ``fixed`` (N, 4, 4), each before its joint turns about z.

        ``end`` (4, 4): the flange in the last frame; ``links`` (N + 1): how texts call them.
        """
        made = cls.__new__(cls)
        made.joints, made.fixed, made.end = len(fixed), fixed, end
        made.capsules, made.names, made.links = tuple(capsules), tuple(names), tuple(links)
        return made

    def link_name(self, link: int) -> str:
        """How texts call a link; the one behind the last joint has the flange."""
        return self.links[link]

    def frames(self, q: ArrayLike) -> FloatArray:
        """Every link in the base's frame, (n, N + 1, 4, 4), of angles ``q`` (n, N) in rad.

        Link 0 is the base itself.
        """
        angles = np.atleast_2d(np.asarray(q, dtype=np.float64))
        found = np.empty((len(angles), self.joints + 1, 4, 4))
        found[:, 0] = np.eye(4)
        turn = np.zeros((len(angles), 4, 4))
        turn[:, 2, 2] = turn[:, 3, 3] = 1.0
        for i in range(self.joints):
            cos, sin = np.cos(angles[:, i]), np.sin(angles[:, i])
            turn[:, 0, 0] = turn[:, 1, 1] = cos
            turn[:, 1, 0], turn[:, 0, 1] = sin, -sin
            found[:, i + 1] = found[:, i] @ self.fixed[i] @ turn
        return found

    def tip(self, q: ArrayLike) -> FloatArray:
        """The flange in the base's frame, (n, 4, 4)."""
        return self.tip_of(self.frames(q))

    def tip_of(self, frames: FloatArray) -> FloatArray:
        """The flange of ``frames``."""
        found: FloatArray = frames[:, -1] @ self.end
        return found

    def reach(self, beyond: float = 0.0) -> FloatArray:
        """How far from each joint's axis any point of the arm can be, (N,), m.

        ``beyond``: of an attached object, from the last frame. The bound is that of the stretched
        arm; it is met by no more than rounding.
        """
        lengths = np.linalg.norm(self.fixed[:, :3, 3], axis=1)
        own = np.zeros(self.joints + 1)
        for capsule in self.capsules:
            ends = np.linalg.norm([capsule.start, capsule.end], axis=1)
            own[capsule.link] = max(own[capsule.link], float(ends.max()) + capsule.radius)
        own[-1] = max(own[-1], beyond)
        found = np.empty(self.joints)
        for i in range(self.joints):
            way = np.concatenate([[0.0], np.cumsum(lengths[i + 1 :])])
            found[i] = (way + own[i + 1 :]).max()
        return found

    def _shape(self, radii: Sequence[float]) -> tuple[Capsule, ...]:
        """One capsule per link from its frame to the next, and a drum about each joint's axis."""
        found = []
        for i in range(self.joints + 1):
            r = radii[i]
            end = (0.0, 0.0, float(self.end[2, 3]))
            if i < self.joints:
                x, y, z = self.fixed[i, :3, 3].tolist()
                end = (x, y, z)
            if max(map(abs, end)) > 1e-9:
                found.append(Capsule(i, (0.0, 0.0, 0.0), end, r))
            if i > 0:
                found.append(Capsule(i, (0.0, 0.0, -_DRUM * r), (0.0, 0.0, _DRUM * r), 0.95 * r))
        return tuple(found)


def _fixed(a: float, d: float, alpha: float) -> Any:
    c, s = np.cos(alpha), np.sin(alpha)
    return np.array([[1, 0, 0, a], [0, c, -s, -s * d], [0, s, c, c * d], [0, 0, 0, 1.0]])
