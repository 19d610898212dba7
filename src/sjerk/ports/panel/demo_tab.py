"""Demo: the paper's Figures 6 and 7, live, on an axis of this robot.

Never here: how the points are commanded.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sjerk.errors import InputError, SjerkError
from sjerk.limits import Limits
from sjerk.ports.panel.experiment import Experiment, Method, in_unit, paper_limits
from sjerk.ports.panel.scope import SIGNALS, Snapshot
from sjerk.trajectory import RecordedPath, read_recording, shipped_recording

if TYPE_CHECKING:
    from sjerk.ports.panel.page import Page

_GREY, _BLUE, _ORANGE = "#868e96", "#228be6", "#fd7e14"
#: The axis is at the path's first point, axis units.
_THERE = 1e-9
#: Seconds that a run is shown after its end: the motor settles.
_AFTER = 0.5
_SAMPLES = 200


@dataclass(frozen=True)
class _Run:
    """One run, and what it is compared with, in the unit of its axis."""

    experiment: Experiment
    axis: int
    recorded: RecordedPath
    limits: Limits


class DemoTab:
    """Of one browser."""

    def __init__(self, page: Page, gui: Any) -> None:
        self._page, self._desk = page, page.desk
        self._run: _Run | None = None
        self._why: str | None = None  # of a run that is over, until it is told
        self._last = 0  # the cycle until which it is shown
        self._path = read_recording(shipped_recording())
        gui.add_html(
            "<div style='padding:0 10px;font-size:12px'>A recorded path of one joint, 0 to 160°: "
            f"{len(self._path.time)} points in {self._path.time[-1]:.1f} s, as one move, every "
            "point at its time, or with look-ahead. Signals shows the joint beside it.</div>"
        )
        self._joint = gui.add_dropdown("Axis", tuple(self._desk.names))
        self._how = gui.add_dropdown(
            "Commanded", tuple(m.value for m in Method), initial_value=Method.INTERRUPTED.value
        )
        self._start = gui.add_button("To its first point", hint="as the goal of Plan")
        self._play = gui.add_button("Play the demo", color="green")
        self._cancel = gui.add_button("End the demo: halt")
        self._position = self._plot(gui, "position", "points of the path")
        self._velocity = self._plot(gui, "velocity", "limit")
        self._told = gui.add_html("")
        self._start.on_click(lambda _: page.do(self._first))
        page.on_press(self._play, self._played)
        self._cancel.on_click(lambda _: page.do(self._cancelled))
        self.locked = [self._start, self._play, self._cancel]

    def _plot(self, gui: Any, what: str, third: str) -> Any:
        unit = self._desk.units[0]
        points = {"label": third, "stroke": _GREY, "width": 1}
        if what == "position":
            points |= {"spanGaps": True, "points": {"show": True, "size": 4}}
        else:
            points |= {"dash": [6, 4]}
        return gui.add_uplot(
            (np.array([0.0, 1.0]), *[np.zeros(2)] * 3),
            (
                {"label": "s"},
                {"label": "commanded", "stroke": _BLUE, "width": 1.5},
                {"label": "actual", "stroke": _ORANGE, "width": 1},
                points,
            ),
            title=f"{what} [{unit}{'/s' if what == 'velocity' else ''}]",
            height=150,
            padding=(10, 24, 0, 0),
            scales={"x": {"time": False}, "y": {"auto": True}},
            legend={"show": False},
        )

    # ---- orders

    def _axis(self) -> tuple[int, RecordedPath]:
        """The axis that is chosen, and the path in its unit; raises InputError."""
        name = self._joint.value
        if name not in self._desk.names:
            raise InputError("axis", name, "is not known")
        i = self._desk.names.index(name)
        recorded = in_unit(self._path, self._desk.units[i])
        low, high = float(self._desk.lower[i]), float(self._desk.upper[i])
        for value in (float(recorded.position.min()), float(recorded.position.max())):
            if not low <= value <= high:
                raise InputError(name, round(value, 4), f"of the path must be {low:g} .. {high:g}")
        return i, recorded

    def _first(self) -> None:
        i, recorded = self._axis()
        goal = self._desk.commanded()
        goal[i] = recorded.position[0]
        self._desk.set_goal(self._page.browser, goal.tolist())
        self._page.plan.show_goal()
        self._page.say("the goal is the path's first point: plan and execute in Plan")

    def _played(self, stops: int) -> None:
        desk, page = self._desk, self._page
        host = desk.lead.of(page.browser)
        i, recorded = self._axis()
        method = next((m for m in Method if m.value == self._how.value), None)
        if method is None:
            raise InputError("commanded", self._how.value, "is not known")
        if self._run is not None and self._run.experiment.running:
            raise SjerkError("the demo runs")
        if host.feedback().moving:
            raise SjerkError("the axes move")
        at = desk.commanded()
        if abs(at[i] - recorded.position[0]) > _THERE:
            where = f"{at[i]:.4f}, not at the path's first point {recorded.position[0]:g}"
            raise SjerkError(f"{desk.names[i]} is at {where}: bring it there first")
        self._clear(i, recorded)
        own = desk.limits[i]
        self._why = None
        desk.lead.check_stops(stops)
        experiment = Experiment(
            host, i, recorded, method, stops=lambda: desk.lead.stops, first=stops, over=self._over
        )
        desk.lead.use(experiment.close)
        self._run = _Run(experiment, i, recorded, paper_limits(desk.units[i], own))
        self._last = 0
        page.signals.look_at(i)
        page.say("the demo is in motion")

    def _clear(self, axis: int, recorded: RecordedPath) -> None:
        """Raise SjerkError where the arm would touch something on the way."""
        if (clear := self._desk.clear) is None:
            return
        rows = np.tile(self._desk.commanded(), (_SAMPLES, 1))
        ends = float(recorded.position.min()), float(recorded.position.max())
        rows[:, axis] = np.linspace(*ends, _SAMPLES)
        distances = clear.distances(rows + self._desk.zero)
        if distances.min() <= 0.0:
            worst = clear.nearest(rows[int(distances.argmin())] + self._desk.zero)
            raise SjerkError(f"on the way {worst}: move the other joints, or the scene, first")

    def _cancelled(self) -> None:
        self._desk.lead.of(self._page.browser)
        if self._run is None or not self._run.experiment.running:
            raise SjerkError("no demo runs")
        self._run.experiment.close()

    def _over(self, why: str) -> None:
        """In the thread of the run."""
        self._why = why

    # ---- what is seen

    def tick(self) -> None:
        """Draw what has been played so far."""
        run, scope = self._run, self._desk.watching.scope
        if run is None or scope is None:
            return
        seen = scope.snapshot([run.axis], after=run.experiment.begin)
        if not len(seen.cycles):
            return
        self._draw(run, seen)
        if self._why is None:
            return
        now = int(seen.cycles[-1])
        if not self._last:
            self._last = now + round(_AFTER / seen.cycle_time)
        if now >= self._last or self._why:
            self._run = None
            self._report(run, seen)

    def _draw(self, run: _Run, seen: Snapshot) -> None:
        begin = run.experiment.begun_ns
        at, position = seen.drawn(0, "position", origin=begin)
        _, actual = seen.drawn(0, "actual position", origin=begin)
        points = np.full(len(at), np.nan)
        due = run.recorded.time[run.recorded.time <= at[-1]]
        points[np.searchsorted(at, due).clip(0, len(at) - 1)] = run.recorded.position[: len(due)]
        self._position.data = (at, position, actual, points)
        at, velocity = seen.drawn(0, "velocity", origin=begin)
        _, actual = seen.drawn(0, "actual velocity", origin=begin)
        self._velocity.data = (at, velocity, actual, np.full(len(at), run.limits.velocity))

    def _report(self, run: _Run, seen: Snapshot) -> None:
        """What the paper's figures show, in numbers."""
        shares = []
        for name in ("velocity", "acceleration", "jerk"):
            most = float(np.abs(seen.rows[:, 0, SIGNALS.index(name)]).max())
            shares.append(f"{name} {100.0 * most / getattr(run.limits, name):.1f} %")
        actual = float(seen.rows[-1, 0, SIGNALS.index("actual position")])
        error = actual - float(run.recorded.position[-1])
        if self._why:
            self._page.say(f"the demo has ended: {self._why}", bad=True)
        else:
            unit = self._desk.units[run.axis]
            self._page.say(f"the demo is at its end; the motor is {1e3 * error:+.4f} m{unit} off")
        self._told.content = (
            "<div class='sjerk-demo' style='padding:0 10px;font-size:12px'>Most of the paper's "
            f"limits: {', '.join(shares)}.</div>"
        )
