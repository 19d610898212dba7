"""The plots of one browser: every cycle of an axis, or all axes in shares of their limits.

What is frozen stays as it is, to be looked at closely and saved: every cycle that is seen.

Never here: how cycles are kept (``scope.py``).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sjerk.errors import InputError, SjerkError
from sjerk.extras import load
from sjerk.ports.panel.desk import Desk, numbers
from sjerk.ports.panel.scope import Scope, Snapshot

if TYPE_CHECKING:
    from sjerk.ports.panel.page import Page

_ALL = "all axes, % of limit"
#: Seconds that a picture has at least.
_LEAST = 0.05
_BLUE, _ORANGE = "#228be6", "#fd7e14"
_COLOURS = ("#228be6", "#fd7e14", "#37b24d", "#e64980", "#7950f2", "#15aabf", "#fab005", "#868e96")
#: Seconds and values of a signal of an axis.
_Rows = Callable[[int, str], tuple[NDArray[Any], NDArray[Any]]]
_LIMIT = {"stroke": "#868e96", "dash": [6, 4], "width": 1}
_TITLES = {
    "position": "position [{}]",
    "velocity": "velocity [{}/s]",
    "acceleration": "acceleration [{}/s²]",
    "jerk": "jerk [{}/s³]",
    "following error": "following error [m{}]",
}


class Signals:
    """In a tab that all share; ``download`` sends a file to the browser of ``page``."""

    def __init__(
        self,
        gui: Any,
        desk: Desk,
        tab: Any,
        *,
        download: Callable[[str, bytes], None],
        page: Page,
    ) -> None:
        self._desk, self._download = desk, download
        self._frozen: Snapshot | None = None
        self._changed = False
        with tab:
            self._axis = gui.add_dropdown("Axis", (*desk.names, _ALL), initial_value=desk.names[0])
            self._bounds = gui.add_checkbox("Limits", True, hint="off: the scale fits the signal")
            self._act = gui.add_button_group("Picture", ("Freeze", "Go on"))
            self._span = gui.add_vector2(
                "Seconds",
                (-8.0, 0.0),
                min=(-8.0, -8.0),
                max=(0.0, 0.0),
                step=0.1,
                hint="from, to: before now, or before it was frozen",
            )
            self._save = gui.add_button_group(
                "Save it", ("CSV", "Parquet"), hint="every cycle of what is seen"
            )
            self._plots = self._one_axis(gui)
            self._shares = self._all_axes(gui)
        page.on_input(self._act, self._acted)
        self._save.on_click(lambda _: page.do(self._saved))
        page.on_input(self._axis, self._chosen)
        page.on_input(self._span, self._touched)
        page.on_input(self._bounds, self._touched)

    def _one_axis(self, gui: Any) -> dict[str, Any]:
        flat, ends = np.zeros(2), np.array([-8.0, 0.0])
        found = {}
        for key, title in _TITLES.items():
            series: list[dict[str, Any]] = [
                {"label": "s"},
                {"label": "commanded", "stroke": _BLUE, "width": 1.5},
            ]
            if key in ("position", "velocity"):
                series.append({"label": "actual", "stroke": _ORANGE, "width": 1})
            if key != "following error":
                series += [{"label": "limit", **_LIMIT}, {"label": "-limit", **_LIMIT}]
            found[key] = gui.add_uplot(
                (ends, *[flat] * (len(series) - 1)),
                tuple(series),
                title=title.format(self._desk.units[0]),
                height=128,
                scales={"x": {"time": False}, "y": {"auto": True}},
                legend={"show": False},
                padding=(10, 24, 0, 0),
            )
        return found

    def _all_axes(self, gui: Any) -> dict[str, Any]:
        flat, ends = np.zeros(2), np.array([-8.0, 0.0])
        lines = [
            {"label": name, "stroke": _COLOURS[i % len(_COLOURS)], "width": 1}
            for i, name in enumerate(self._desk.names)
        ]
        return {
            key: gui.add_uplot(
                (ends, *[flat] * self._desk.axes),
                ({"label": "s"}, *lines),
                title=f"{key}, % of its limit",
                height=200,
                scales={"x": {"time": False}, "y": {"auto": True}},
                legend={"show": False},
                padding=(10, 24, 0, 0),
                visible=False,
            )
            for key in ("velocity", "acceleration", "jerk")
        }

    # ---- what a person chooses

    def look_at(self, axis: int) -> None:
        """Show this axis, as it goes on."""
        self._frozen = None
        self._axis.value = self._desk.names[axis]
        self._chosen()

    def _chosen(self) -> None:
        everyone = self._axis.value == _ALL
        for plot in self._plots.values():
            plot.visible = not everyone
        for plot in self._shares.values():
            plot.visible = everyone
        self._touched()

    def _touched(self) -> None:
        self._changed = True

    def _number(self) -> int:
        said = self._axis.value  # a browser's word
        return self._desk.names.index(said) if said in self._desk.names else 0

    def _seconds(self) -> tuple[float, float]:
        """From when to when, before now, or before the cycle at which it was frozen."""
        begin, end = numbers("seconds", self._span.value, ("from", "to"), -8.0, 0.0)
        return min(begin, -_LEAST), max(end, min(begin, -_LEAST) + _LEAST)

    def _whole(self) -> Snapshot:
        """Of all axes, what is frozen, or the last seconds."""
        if self._frozen is not None:
            return self._frozen
        scope = self._desk.watching.scope
        if scope is None:
            raise SjerkError("no cycle has been seen")
        return scope.snapshot(list(range(self._desk.axes)))

    def _acted(self) -> None:
        self._frozen = self._whole() if self._act.value == "Freeze" else None
        self._touched()

    def _saved(self) -> None:
        everyone = self._axis.value == _ALL
        axes = list(range(self._desk.axes)) if everyone else [self._number()]
        seen = self._whole().between(*self._seconds()).of(axes)
        names = [self._desk.names[i] for i in axes]
        name = f"sjerk-{time.strftime('%Y%m%d-%H%M%S')}"
        if self._save.value == "Parquet":
            made = load("sjerk.ports.panel.parquet_export", extra="record")
            self._download(f"{name}.parquet", made.parquet_of(seen.columns(names)))
        else:
            self._download(f"{name}.csv", seen.csv(names))

    # ---- drawing

    def draw(self, scope: Scope) -> None:
        """Show the last seconds, or what is frozen where that was changed."""
        frozen = self._frozen
        if frozen is not None and not self._changed:
            return
        self._changed = False
        try:
            begin, end = self._seconds()
        except InputError:
            begin, end = -8.0, 0.0
        if frozen is None:
            inside = (scope.time >= begin - 1e-9) & (scope.time <= end + 1e-9)

            def rows(axis: int, signal: str) -> tuple[NDArray[Any], NDArray[Any]]:
                return scope.time[inside], scope.drawn(axis, signal)[inside]

        else:
            seen = frozen.between(begin, end)
            last = int(frozen.stamps[-1]) if len(frozen.stamps) else 0

            def rows(axis: int, signal: str) -> tuple[NDArray[Any], NDArray[Any]]:
                return seen.drawn(axis, signal, origin=last)

        if self._axis.value == _ALL:
            self._draw_shares(rows)
        else:
            self._draw_one(self._number(), rows)

    def _draw_shares(self, rows: _Rows) -> None:
        for key, plot in self._shares.items():
            found = [rows(i, key) for i in range(self._desk.axes)]
            shares = [
                100.0 * values / getattr(limits, key)
                for (_, values), limits in zip(found, self._desk.limits, strict=True)
            ]
            plot.data = (found[0][0], *shares)

    def _draw_one(self, i: int, rows: _Rows) -> None:
        for key, plot in self._plots.items():
            at, values = rows(i, key)
            if key == "following error":
                plot.data = (at, 1e3 * values)
                continue
            lines = [values]
            if key in ("position", "velocity"):
                lines.append(rows(i, f"actual {key}")[1])
            if key == "position":
                bounds = [float(self._desk.upper[i]), float(self._desk.lower[i])]
            else:
                most = float(getattr(self._desk.limits[i], key))
                bounds = [most, -most]
            shown = bool(self._bounds.value) and bool(np.isfinite(bounds).all())
            plot.data = (at, *lines, *(np.full(len(at), b if shown else np.nan) for b in bounds))
