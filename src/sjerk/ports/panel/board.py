"""What every browser sees: the scene, the first line, the table of axes, events.

Outputs only: a shared input could be changed by any browser. Texts of others are escaped. Never
here: inputs, orders.
"""

from __future__ import annotations

import html
import math
import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sjerk.cycle.states import AxisState
from sjerk.host import AxisFeedback, Feedback
from sjerk.host.reasons import fault_words
from sjerk.ports.panel.desk import Desk, Proposal
from sjerk.ports.panel.figure import RED, Figure
from sjerk.ports.panel.shapes import Shape
from sjerk.ports.panel.urdf import Colour

_GREEN: Colour = (81, 164, 103)
_ARM: Colour = (225, 225, 230)
_GHOST: Colour = (70, 140, 250)
_YELLOW: Colour = (250, 176, 5)
_WAY_POINTS = 80
#: Of PLCopen's states those that are too long for a table.
_SHORT = {
    AxisState.SYNCHRONIZED_MOTION: "on path",
    AxisState.DISCRETE_MOTION: "moves",
    AxisState.CONTINUOUS_MOTION: "jogs",
}


class Board:
    """On a viser server; ``name``: of the kernel."""

    def __init__(self, server: Any, desk: Desk) -> None:
        self._server, self._desk = server, desk
        self._lock = threading.Lock()
        gui, scene = server.gui, server.scene
        gui.configure_theme(
            show_share_button=False, show_logo=False, dark_mode=True, control_width="large"
        )
        server.initial_camera.position = (1.45, -1.45, 1.15)
        server.initial_camera.look_at = (0.2, 0.0, 0.4)
        # shadows, the environment map and the endless grid cost most frames where there is no GPU
        scene.configure_default_lights(cast_shadow=False)
        scene.configure_environment_map(None)
        scene.add_light_ambient("/light", intensity=0.7)
        _floor(scene)
        self._robot = self._ghost = None
        if desk.arm is not None:
            seen = desk.settings.visuals
            self._robot = Figure(scene, desk.arm, "/robot", None, visuals=seen)
            self._ghost = Figure(scene, desk.arm, "/goal", _GHOST, opacity=0.35, visuals=seen)
        else:
            self._rails = Rails(scene, desk)
        self._shapes: dict[str, tuple[Shape, Any]] = {}
        self._way: Any = None
        self._drawn: Proposal | None = None
        self._goal: NDArray[Any] | None = None
        top, left = gui.add_panel(), gui.add_panel()
        with top.add_tab("Now") as self.now:  # with STOP of each browser: never scrolled away
            self.first = gui.add_html("", order=0.0)
            self.table = gui.add_html("", order=2.0)
        with left.add_tab("Signals") as self.signals:
            pass
        with left.add_tab("Timing") as self.timing:
            pass
        with left.add_tab("Events"):
            self._events = gui.add_html("")
        left.dock_left()
        left.set_width(390)
        top.dock_right()
        top.set_width(400)
        gui.main_panel.dock_below(top)
        self._told = -1

    # ---- as often as there are frames

    def follow(self, feedback: Feedback, preview: NDArray[Any] | None) -> None:
        """Turn the arm to where the kernel has it; the ghost to the goal, or along the plan."""
        desk = self._desk
        actual = np.array([axis.actual_position for axis in feedback.axes])
        if self._robot is None or self._ghost is None:
            self._rails.show(actual)
            return
        self._robot.show(actual + desk.zero)
        shown = desk.goal if preview is None else preview
        if self._goal is None or (shown != self._goal).any():
            self._goal = shown.copy()
            self._ghost.show(shown + desk.zero)

    # ---- some times a second

    def tell(self, feedback: Feedback, *, seen: int) -> None:
        """First line, table of axes, what touches what, events; ``seen``: browsers that look."""
        with self._lock:
            self.first.content = self._first_line(feedback, seen)
            self.table.content = self._table(feedback)
            self._mark(feedback)
            self._journal()

    def gone(self, why: str) -> None:
        """The kernel is not there."""
        with self._lock:
            words = html.escape(f"{self._desk.watching.name}: {why}")
            self.first.content = (
                "<div id='sjerk-first' style='padding:6px 10px;color:#e03131;font-weight:600'>"
                f"{words}</div>"
            )
            self._journal()

    def _first_line(self, feedback: Feedback, seen: int) -> str:
        desk = self._desk
        pid = desk.watching.host_pid
        browser = desk.lead.browser
        if browser is not None:
            who = f"browser {browser}"
        else:
            who = "nobody" if pid is None else f"process {pid}"
        late = feedback.timing.late
        colour = " style='color:#e8590c'" if late else ""
        hold = " · <b>feed hold</b>" if feedback.hold else ""
        return (
            "<div id='sjerk-first' style='padding:6px 10px 2px;font-size:13px;line-height:1.45' "
            f"data-cycle='{feedback.cycle}' data-late='{late}'>"
            f"<b>{html.escape(desk.watching.name)}</b> · cycle {feedback.cycle} · "
            f"<span{colour}>late {late}</span><br>leads: <b>{who}</b> · "
            f"override {100 * feedback.override:.0f} %{hold} · {seen} look on</div>"
        )

    def _table(self, feedback: Feedback) -> str:
        rows = [
            self._row(i, axis, float(self._desk.lower[i]), float(self._desk.upper[i]))
            for i, axis in enumerate(feedback.axes)
        ]
        tip = ""
        if self._desk.arm is not None:
            q = np.array([axis.actual_position for axis in feedback.axes]) + self._desk.zero
            x, y, z = self._desk.arm.tip(q)[0, :3, 3]
            tip = f"<div>flange {x:+.4f} {y:+.4f} {z:+.4f} m</div>"
        unit = html.escape(self._desk.units[0])
        degrees = "<th>deg</th>" if unit == "rad" else ""
        return (
            "<div id='sjerk-axes' style='font-size:12px;padding:2px 10px 6px;"
            "font-variant-numeric:tabular-nums'><table style='width:100%;border-spacing:0'>"
            f"<tr style='opacity:.6;text-align:right'><th></th><th>{unit}</th>{degrees}"
            f"<th>range</th><th>{unit}/s</th></tr>" + "".join(rows) + f"</table>{tip}</div>"
        )

    def _row(self, i: int, axis: AxisFeedback, low: float, high: float) -> str:
        full = axis.state.name.lower().replace("_", " ")
        state = _SHORT.get(axis.state, full)
        if axis.fault:
            state = full = f"fault {fault_words(axis.error_code)}"
        colour = "color:#e03131" if axis.fault or axis.state.name == "ERROR_STOP" else "opacity:.75"
        at = axis.actual_position
        bar = ""
        if math.isfinite(low) and math.isfinite(high):
            share = min(100.0, max(0.0, 100.0 * (at - low) / (high - low)))
            bar = (
                "<div style='background:#868e9655;height:6px;width:56px;margin-left:8px'>"
                f"<div style='margin-left:{0.96 * share:.1f}%;width:3px;height:6px;"
                "background:#228be6'></div></div>"
            )
        cell = "style='text-align:right;padding-left:6px'"
        degrees = f"<td {cell}>{math.degrees(at):+.2f}</td>" if self._desk.units[0] == "rad" else ""
        name = html.escape(self._desk.names[i])
        return (
            f"<tr data-axis='{i}'><td style='overflow-wrap:anywhere'>{name} "
            f"<span style='{colour}' title='{html.escape(full)}'>{html.escape(state)}</span></td>"
            f"<td {cell}>{at:+.4f}</td>{degrees}<td>{bar}</td><td {cell}>{axis.velocity:+.3f}</td>"
            "</tr>"
        )

    def _mark(self, feedback: Feedback) -> None:
        """Red is what touches: at the goal, or anywhere on the plan."""
        desk, proposal = self._desk, self._desk.proposal
        self._draw_shapes()
        clear = desk.clear
        if clear is None or self._ghost is None:
            return
        links, names = clear.touching(desk.goal + desk.zero)
        if proposal is not None and proposal.plan.collides:
            names = names | {proposal.plan.nearest.one, proposal.plan.nearest.other}
        self._ghost.mark(links)
        for name, (_, handle) in self._shapes.items():
            handle.color = RED if name in names else _GREEN
        actual = np.array([axis.actual_position for axis in feedback.axes])
        self._ghost.visible = bool(proposal is not None or np.abs(desk.goal - actual).max() > 1e-3)
        if proposal is not self._drawn:
            self._drawn = proposal
            self._draw_way(proposal)

    def _draw_way(self, proposal: Proposal | None) -> None:
        """The way of the flange along the plan."""
        if self._way is not None:
            self._way.remove()
            self._way = None
        arm = self._desk.arm
        if proposal is None or arm is None:
            return
        rows = proposal.plan.position
        some = rows[np.linspace(0, len(rows) - 1, min(len(rows), _WAY_POINTS)).astype(int)]
        self._way = self._server.scene.add_spline_catmull_rom(
            "/way",
            points=arm.tip(some + self._desk.zero)[:, :3, 3],
            color=RED if proposal.plan.collides else _YELLOW,
            line_width=4,
        )

    def _draw_shapes(self) -> None:
        wanted = self._desk.scene.shapes
        for name in [n for n in self._shapes if self._shapes[n][0] is not wanted.get(n)]:
            self._shapes.pop(name)[1].remove()
        for name, shape in wanted.items():
            if name not in self._shapes:
                self._shapes[name] = shape, self._added(name, shape)

    def _added(self, name: str, shape: Shape) -> Any:
        scene, root = self._server.scene, "/scene"
        if shape.attached and self._robot is not None:
            root = self._robot.tool
        common: dict[str, Any] = {
            "position": shape.centre,
            "wxyz": (math.cos(shape.yaw / 2.0), 0.0, 0.0, math.sin(shape.yaw / 2.0)),
            "color": _GREEN,
        }
        place = f"{root}/{name.replace(' ', '_')}"
        if shape.kind == "box":
            return scene.add_box(place, dimensions=shape.size, **common)
        if shape.kind == "sphere":
            return scene.add_icosphere(place, radius=shape.size[0], **common)
        radius, height = shape.size
        return scene.add_cylinder(place, radius=radius, height=height, **common)

    def _journal(self) -> None:
        journal = self._desk.journal
        if journal.changes != self._told:
            self._told = journal.changes
            self._events.content = journal.html()


class Rails:
    """One rail per axis, where nothing is known of an arm."""

    def __init__(self, scene: Any, desk: Desk) -> None:
        self._low = np.where(np.isfinite(desk.lower), desk.lower, -1.0)
        high = np.where(np.isfinite(desk.upper), desk.upper, self._low + 2.0)
        self._span = high - self._low
        ends = []
        self._balls = []
        for i in range(desk.axes):
            y = 0.15 * (i - (desk.axes - 1) / 2.0)
            ends.append([[-0.5, y, 0.4], [0.5, y, 0.4]])
            self._balls.append(
                scene.add_icosphere(f"/axis/{i}", radius=0.04, color=_ARM, position=(0.0, y, 0.4))
            )
        scene.add_line_segments("/rails", points=np.array(ends), colors=(134, 142, 150))

    def show(self, q: NDArray[Any]) -> None:
        """Move the balls; an axis that turns for ever goes round."""
        share = (q - self._low) / self._span
        for ball, x in zip(self._balls, share.tolist(), strict=True):
            ball.position = ((x if 0.0 <= x <= 1.0 else x % 1.0) - 0.5, ball.position[1], 0.4)


def _floor(scene: Any) -> None:
    at = np.linspace(-1.0, 1.0, 11)
    ends = np.stack([np.full(11, -1.0), np.full(11, 1.0)], axis=1)
    across = np.stack([ends, np.repeat(at[:, None], 2, 1), np.zeros((11, 2))], axis=2)
    lines = np.concatenate([across, across[..., [1, 0, 2]]])
    scene.add_line_segments("/floor", points=lines, colors=(134, 142, 150), line_width=1)
