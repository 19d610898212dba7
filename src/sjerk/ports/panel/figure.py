"""An arm in the scene of a page: nested frames, so that one angle is one message.

Never here: kinematics, colours of anything else.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sjerk.ports.panel.arm import Arm, Capsule

Colour = tuple[int, int, int]
RED: Colour = (224, 49, 49)
_SHADE = 0.72
_RINGS, _SIDES = 6, 18


def quaternion(rotation: NDArray[Any]) -> tuple[float, float, float, float]:
    """w, x, y, z of a rotation matrix (3, 3), by the largest of them (S. W. Shepperd, 1978).

    >>> quaternion(np.diag([1.0, -1.0, -1.0]))
    (0.0, 1.0, 0.0, 0.0)
    """
    R = np.asarray(rotation, float)
    squares = np.array(
        [
            1.0 + R[0, 0] + R[1, 1] + R[2, 2],
            1.0 + R[0, 0] - R[1, 1] - R[2, 2],
            1.0 - R[0, 0] + R[1, 1] - R[2, 2],
            1.0 - R[0, 0] - R[1, 1] + R[2, 2],
        ]
    )
    k = int(np.argmax(squares))
    rows = np.array(
        [
            [squares[0], R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]],
            [R[2, 1] - R[1, 2], squares[1], R[1, 0] + R[0, 1], R[0, 2] + R[2, 0]],
            [R[0, 2] - R[2, 0], R[1, 0] + R[0, 1], squares[2], R[2, 1] + R[1, 2]],
            [R[1, 0] - R[0, 1], R[0, 2] + R[2, 0], R[2, 1] + R[1, 2], squares[3]],
        ]
    )
    w, x, y, z = (rows[k] / (2.0 * np.sqrt(squares[k]))).tolist()
    return w, x, y, z


def capsule_mesh(capsule: Capsule) -> tuple[NDArray[Any], NDArray[Any]]:
    """Vertices (n, 3) and triangles (m, 3) of a capsule, in its link's frame.

    Rings around its line: those of a half sphere at either end.
    """
    start, end = np.array(capsule.start), np.array(capsule.end)
    along = (end - start) / np.linalg.norm(end - start)
    side = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    side /= np.linalg.norm(side)
    up = np.cross(along, side)
    latitude = np.linspace(-np.pi / 2.0, np.pi / 2.0, 2 * _RINGS)
    turn = np.linspace(0.0, 2.0 * np.pi, _SIDES, endpoint=False)
    around = np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * up
    rows = [
        (start if angle < 0.0 else end)
        + capsule.radius * (np.sin(angle) * along + np.cos(angle) * around)
        for angle in latitude
    ]
    ring, k = np.meshgrid(np.arange(2 * _RINGS - 1), np.arange(_SIDES), indexing="ij")
    one, two = ring * _SIDES + k, ring * _SIDES + (k + 1) % _SIDES
    faces = [[one, two, one + _SIDES], [two, two + _SIDES, one + _SIDES]]
    triangles = np.concatenate([np.stack(f, axis=-1).reshape(-1, 3) for f in faces])
    return np.concatenate(rows), triangles


class Figure:
    """One arm at ``root`` of a server's scene."""

    def __init__(
        self, scene: Any, arm: Arm, root: str, colour: Colour, opacity: float | None = None
    ) -> None:
        self._arm, self._colour = arm, colour
        self._root = scene.add_frame(root, show_axes=False)
        self._frames: list[Any] = []
        self._meshes: dict[int, list[tuple[Any, Colour]]] = {}
        self._red: set[int] = set()
        name = root
        for link in range(arm.joints + 1):
            if link > 0:
                name = f"{name}/{link}"
                fixed = arm.fixed[link - 1]
                self._frames.append(
                    scene.add_frame(
                        name,
                        show_axes=False,
                        position=fixed[:3, 3],
                        wxyz=quaternion(fixed[:3, :3]),
                    )
                )
            self._meshes[link] = []
            for k, capsule in enumerate(c for c in arm.capsules if c.link == link):
                vertices, faces = capsule_mesh(capsule)
                r, g, b = (int(v * (_SHADE if k else 1.0)) for v in colour)
                handle = scene.add_mesh_simple(
                    f"{name}/shape{k}",
                    vertices,
                    faces,
                    color=(r, g, b),
                    opacity=opacity,
                    flat_shading=False,
                )
                self._meshes[link].append((handle, (r, g, b)))
        #: The name under which what the tool holds is added.
        self.last = name

    def show(self, q: ArrayLike) -> None:
        """Turn the joints, rad."""
        for frame, fixed, angle in zip(
            self._frames, self._arm.fixed, np.asarray(q, float).tolist(), strict=True
        ):
            c, s = np.cos(angle), np.sin(angle)
            turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
            frame.wxyz = quaternion(fixed[:3, :3] @ turn)

    def mark(self, red: set[int]) -> None:
        """Show these links in red."""
        for link in red ^ self._red:
            for mesh, colour in self._meshes[link]:
                mesh.color = RED if link in red else colour
        self._red = set(red)

    @property
    def visible(self) -> bool:
        """Whether it is shown."""
        return bool(self._root.visible)

    @visible.setter
    def visible(self, shown: bool) -> None:
        self._root.visible = shown
