"""The plots of one browser: every cycle of an axis, or all axes in shares of their limits.

Never here: how cycles are kept (``scope.py``).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sjerk.ports.panel.desk import Desk
from sjerk.ports.panel.scope import Scope

_ALL = "all axes, % of limit"
_BLUE, _ORANGE = "#228be6", "#fd7e14"
_COLOURS = ("#228be6", "#fd7e14", "#37b24d", "#e64980", "#7950f2", "#15aabf", "#fab005", "#868e96")
_LIMIT = {"stroke": "#868e96", "dash": [6, 4], "width": 1}
_TITLES = {
    "position": "position [{}]",
    "velocity": "velocity [{}/s]",
    "acceleration": "acceleration [{}/s²]",
    "jerk": "jerk [{}/s³]",
    "following error": "following error [m{}]",
}


class Signals:
    """In a tab that all share; ``download`` sends a file to this browser."""

    def __init__(
        self, gui: Any, desk: Desk, tab: Any, download: Callable[[str, bytes], None]
    ) -> None:
        self._desk, self._download = desk, download
        self._frozen = False
        flat, ends = np.zeros(2), np.array([-8.0, 0.0])
        with tab:
            self._axis = gui.add_dropdown("Axis", (*desk.names, _ALL), initial_value=desk.names[0])
            self._bounds = gui.add_checkbox("Limits", True, hint="off: the scale fits the signal")
            self._act = gui.add_button_group("Picture", ("Freeze", "Go on", "Save CSV"))
            self._plots = {}
            for key, title in _TITLES.items():
                series: list[dict[str, Any]] = [
                    {"label": "s"},
                    {"label": "commanded", "stroke": _BLUE, "width": 1.5},
                ]
                if key in ("position", "velocity"):
                    series.append({"label": "actual", "stroke": _ORANGE, "width": 1})
                if key != "following error":
                    series += [{"label": "limit", **_LIMIT}, {"label": "-limit", **_LIMIT}]
                self._plots[key] = gui.add_uplot(
                    (ends, *[flat] * (len(series) - 1)),
                    tuple(series),
                    title=title.format(desk.units[0]),
                    height=128,
                    scales={"x": {"time": False}, "y": {"auto": True}},
                    legend={"show": False},
                    padding=(10, 24, 0, 0),
                )
            self._shares = {}
            for key in ("velocity", "acceleration", "jerk"):
                lines = [
                    {"label": name, "stroke": _COLOURS[i % len(_COLOURS)], "width": 1}
                    for i, name in enumerate(desk.names)
                ]
                self._shares[key] = gui.add_uplot(
                    (ends, *[flat] * desk.axes),
                    ({"label": "s"}, *lines),
                    title=f"{key}, % of its limit",
                    height=200,
                    scales={"x": {"time": False}, "y": {"auto": True}},
                    legend={"show": False},
                    padding=(10, 24, 0, 0),
                    visible=False,
                )
        self._act.on_click(lambda _: self._acted())
        self._axis.on_update(lambda _: self._chosen())

    def _chosen(self) -> None:
        everyone = self._axis.value == _ALL
        for plot in self._plots.values():
            plot.visible = not everyone
        for plot in self._shares.values():
            plot.visible = everyone

    def _number(self) -> int:
        said = self._axis.value  # a browser's word
        return self._desk.names.index(said) if said in self._desk.names else 0

    def _acted(self) -> None:
        word = self._act.value
        self._frozen = word == "Freeze" or (self._frozen and word != "Go on")
        scope = self._desk.watching.scope
        if word == "Save CSV" and scope is not None:
            everyone = self._axis.value == _ALL
            axes = list(range(self._desk.axes)) if everyone else [self._number()]
            stamp = time.strftime("%Y%m%d-%H%M%S")
            self._download(f"sjerk-{stamp}.csv", scope.csv(axes, self._desk.names))

    def draw(self, scope: Scope) -> None:
        """Show the last seconds."""
        if self._frozen:
            return
        if self._axis.value == _ALL:
            for key, plot in self._shares.items():
                rows = [
                    100.0 * scope.drawn(i, key) / getattr(self._desk.limits[i], key)
                    for i in range(self._desk.axes)
                ]
                plot.data = (scope.time, *rows)
            return
        i = self._number()
        for key, plot in self._plots.items():
            plot.data = (scope.time, *self._rows(scope, i, key))

    def _rows(self, scope: Scope, i: int, key: str) -> list[NDArray[Any]]:
        rows = [scope.drawn(i, key)]
        if key == "following error":
            return [1e3 * rows[0]]
        if key in ("position", "velocity"):
            rows.append(scope.drawn(i, f"actual {key}"))
        if key == "position":
            bounds = [float(self._desk.upper[i]), float(self._desk.lower[i])]
        else:
            most = float(getattr(self._desk.limits[i], key))
            bounds = [most, -most]
        shown = bool(self._bounds.value) and bool(np.isfinite(bounds).all())
        return rows + [np.full(len(scope.time), b if shown else np.nan) for b in bounds]
