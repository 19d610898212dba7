"""An arm in the scene of a page: nested frames, so that one angle is one message.

Never here: kinematics, colours of anything else.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sjerk.ports.panel.arm import Arm
from sjerk.ports.panel.capsules import capsule_mesh
from sjerk.ports.panel.urdf import Colour, Visual

RED: Colour = (224, 49, 49)
_PLAIN: Colour = (225, 225, 230)
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


def _seen(
    arm: Arm, visuals: Sequence[Visual], link: int, colour: Colour | None
) -> Iterator[tuple[NDArray[Any], NDArray[Any], Colour]]:
    """Vertices, triangles, colour of all that is seen of a link."""
    for one in visuals:
        if one.link == link:
            yield one.vertices, one.faces, colour or one.colour
    if not visuals:
        for k, capsule in enumerate(c for c in arm.capsules if c.link == link):
            r, g, b = (int(v * (_SHADE if k else 1.0)) for v in colour or _PLAIN)
            yield *capsule_mesh(capsule), (r, g, b)


class Figure:
    """One arm at ``root`` of a server's scene."""

    def __init__(
        self,
        scene: Any,
        arm: Arm,
        root: str,
        colour: Colour | None,
        *,
        opacity: float | None = None,
        visuals: Sequence[Visual] = (),
    ) -> None:
        """``colour`` None: each of ``visuals`` has its own; without those its capsules are seen."""
        self._arm = arm
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
            for k, (vertices, faces, own) in enumerate(_seen(arm, visuals, link, colour)):
                handle = scene.add_mesh_simple(
                    f"{name}/shape{k}",
                    vertices,
                    faces,
                    color=own,
                    opacity=opacity,
                    flat_shading=False,
                )
                self._meshes[link].append((handle, own))
        #: The frame of the flange, with what the tool holds.
        self.tool = f"{name}/tool"
        scene.add_frame(
            self.tool,
            show_axes=False,
            position=arm.end[:3, 3],
            wxyz=quaternion(arm.end[:3, :3]),
        )

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
