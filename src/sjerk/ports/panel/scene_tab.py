"""Scene: boxes, spheres and cylinders, around the arm or in its tool.

Never here: distances.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from sjerk.ports.panel.desk import number, numbers
from sjerk.ports.panel.settings import name_of
from sjerk.ports.panel.shapes import FURTHEST, SIZES, Shape

if TYPE_CHECKING:
    from sjerk.ports.panel.page import Page

_NEW = "(new)"


class SceneTab:
    """Of one browser: one shape at a time."""

    def __init__(self, page: Page, gui: Any) -> None:
        self._page, self._desk = page, page.desk
        names = tuple(self._desk.scene.shapes)
        self._which = gui.add_dropdown("Shape", (*names, _NEW), initial_value=(*names, _NEW)[0])
        self._name = gui.add_text("Name", "")
        self._kind = gui.add_dropdown("Kind", tuple(SIZES))
        self._size = gui.add_vector3("Size [m]", (0.1, 0.1, 0.1), step=0.01)
        self._what = gui.add_html("")
        self._centre = gui.add_vector3("Place [m]", (0.5, 0.0, 0.1), step=0.01)
        self._yaw = gui.add_number("Yaw [deg]", 0.0, step=1.0)
        self._attached = gui.add_checkbox("In the tool", False, hint="moves with the flange")
        self._set = gui.add_button("Add or change")
        self._remove = gui.add_button("Remove")
        self._save = gui.add_button("Save the scene to the file")
        page.on_input(self._which, self._chosen)
        page.on_input(self._kind, self._hint)
        page.on_input(self._set, self._changed)
        page.on_input(self._remove, self._removed)
        self._save.on_click(lambda _: page.do(self._saved))
        self.locked = [self._set, self._remove, self._save]
        self._chosen()

    def _chosen(self) -> None:
        """Show a shape that there is."""
        shape = self._desk.scene.shapes.get(str(self._which.value))
        if shape is not None:
            self._name.value = str(self._which.value)
            self._kind.value = shape.kind
            self._size.value = (*shape.size, *(0.1,) * (3 - len(shape.size)))
            self._centre.value = shape.centre
            self._yaw.value = round(math.degrees(shape.yaw), 6)
            self._attached.value = shape.attached
        self._hint()

    def _hint(self) -> None:
        words = ", ".join(SIZES.get(str(self._kind.value), ()))
        self._what.content = f"<div style='padding:0 10px;font-size:12px'>size: {words}</div>"

    def _changed(self) -> None:
        name, kind = name_of(str(self._name.value).strip()), str(self._kind.value)
        n = len(SIZES.get(kind, ()))
        x, y, z = numbers("place", self._centre.value, "xyz", -FURTHEST, FURTHEST)
        shape = Shape(
            kind,  # type: ignore[arg-type]  # checked there
            tuple(numbers("size", self._size.value, "xyz", 0.0, FURTHEST)[:n]),
            (x, y, z),
            yaw=math.radians(number("yaw", self._yaw.value, -360.0, 360.0)),
            attached=bool(self._attached.value),
        )
        self._desk.set_shape(self._page.browser, name, shape)
        self._page.say(f"{name} is in the scene")

    def _removed(self) -> None:
        name = name_of(str(self._name.value).strip())
        self._desk.set_shape(self._page.browser, name, None)
        self._page.say(f"{name} is removed")

    def _saved(self) -> None:
        self._desk.save_scene(self._page.browser)
        self._page.say("the scene is saved")

    def tick(self) -> None:
        """The shapes that there are."""
        names = (*self._desk.scene.shapes, _NEW)
        if tuple(self._which.options) != names:
            self._which.options = names
