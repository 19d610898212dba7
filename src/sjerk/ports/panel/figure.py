"""An arm in the scene of a page: nested frames, so that one angle is one message.

Never here: kinematics, colours of anything else.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from sjerk.ports.panel.arm import Arm, Capsule

Colour = tuple[int, int, int]
RED: Colour = (224, 49, 49)
_SHADE = 0.72


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


def capsule_mesh(capsule: Capsule) -> Any:
    """Triangles of a capsule, in its link's frame."""
    start, end = np.array(capsule.start), np.array(capsule.end)
    length = float(np.linalg.norm(end - start))
    mesh = trimesh.creation.capsule(height=length, radius=capsule.radius, count=[16, 10])
    turn = trimesh.geometry.align_vectors([0.0, 0.0, 1.0], (end - start) / length)
    turn[:3, 3] = start
    mesh.apply_transform(turn)
    return mesh


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
                mesh = capsule_mesh(capsule)
                r, g, b = (int(v * (_SHADE if k else 1.0)) for v in colour)
                handle = scene.add_mesh_simple(
                    f"{name}/shape{k}",
                    mesh.vertices,
                    mesh.faces,
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
