"""Plan: where to, how fast, and the buttons that go there.

Never here: planning.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from sjerk.errors import InputError, SjerkError
from sjerk.ports.panel.desk import AskAgainError, Proposal, numbers, turn_of
from sjerk.ports.panel.holding import Press

if TYPE_CHECKING:
    from sjerk.ports.panel.page import Page

_HZ = 20.0
#: Sliders have so many places to a unit; the goal itself is as it was set, to the last bit.
_GRID = 1000.0
#: Scaling begins here, and stays as it is set.
_FIRST = 0.3
#: Without position limits a slider has so many axis units either way.
_WIDE = 1000.0


class PlanTab:
    """Of one browser."""

    def __init__(self, page: Page, gui: Any) -> None:
        self._page, self._desk = page, page.desk
        desk = self._desk
        self._agreed: Proposal | None = None
        self._over = True
        self._sliders = []
        for i, name in enumerate(desk.names):
            low = float(max(desk.lower[i], -_WIDE))
            high = float(min(desk.upper[i], _WIDE))
            at = min(high, max(low, float(desk.goal[i])))
            slider = gui.add_slider(
                name,
                min=_up(low),
                max=_down(high),
                step=0.001,
                initial_value=_within(at, low, high),
            )
            self._bind(slider, i)
            self._sliders.append(slider)
        self._near = gui.add_html("")
        with gui.add_folder("Poses", expand_by_default=False):
            self._pose = gui.add_dropdown("Pose", tuple(desk.poses) or ("-",))
            self._go = gui.add_button_group("To goal", ("Set goal", "Measured"))
            self._name = gui.add_text("Name", "")
            self._keep = gui.add_button_group("Keep", ("Save goal", "Rename"))
        if desk.arm is not None:
            with gui.add_folder("Flange", expand_by_default=False):
                pose = desk.arm.tip(desk.goal + desk.zero)[0]
                self._place = gui.add_vector3("at [m]", _rounded(pose[:3, 3]), step=0.001)
                self._turn = gui.add_vector3(
                    "rpy [deg]", _rounded(np.degrees(turn_of(pose[:3, :3])), 2), step=0.1
                )
                self._reach = gui.add_button("Set goal to flange pose")
                page.on_input(self._reach, self._reached)
        with gui.add_folder("Scaling", expand_by_default=True):
            self._scale = [
                gui.add_slider(name, min=0.01, max=1.0, step=0.01, initial_value=_FIRST)
                for name in ("Velocity", "Acceleration", "Jerk")
            ]
            self._avoid = gui.add_checkbox("Avoid collisions", True)
        self._plan = gui.add_button("Plan")
        self._run = gui.add_button("Execute", color="green")
        self._both = gui.add_button("Plan & Execute", color="green")
        self._hold = gui.add_button(
            "Hold to run", color="teal", hint="moves while held, rests on the path when let go"
        )
        self._speed = gui.add_slider("Speed now", min=0.0, max=2.0, step=0.01, initial_value=1.0)
        page.on_input(self._go, self._posed)
        self._keep.on_click(lambda _: page.do(self._kept))
        page.on_press(self._plan, lambda _: self._planned(), plans=True)
        page.on_press(self._run, self._executed)
        page.on_press(self._both, self._planned_and_executed, plans=True)
        page.on_input(self._speed, self._sped)

        async def held(_: Any) -> None:
            page.do(self._held)

        async def let_go(_: Any) -> None:
            desk.lead.let_go(page.browser)

        self._hold.on_hold(held, callback_hz=_HZ)
        self._hold.on_click(let_go)
        self.locked = [*self._sliders, self._plan, self._run, self._both, self._hold, self._speed]
        if desk.arm is not None:
            self.locked.append(self._reach)

    # ---- the goal

    def _bind(self, slider: Any, axis: int) -> None:
        async def moved(event: Any) -> None:
            if event.client_id is not None:  # by a person
                self._page.do(lambda: self._dragged(axis))

        slider.on_update(moved)

    def _dragged(self, axis: int) -> None:
        """One slider was moved: the other axes stay where the goal has them, to the last bit."""
        if self._desk.lead.browser != self._page.browser:
            return  # the goal that is shown is the leader's
        goal, slider = self._desk.goal.tolist(), self._sliders[axis]
        if slider.value != _within(goal[axis], float(slider.min), float(slider.max)):
            goal[axis] = slider.value
            self._desk.set_goal(self._page.browser, goal)

    def show_goal(self) -> None:
        """Bring the sliders to the goal, which stays as it is to the last bit."""
        for slider, at in zip(self._sliders, self._desk.goal.tolist(), strict=True):
            slider.value = _within(at, float(slider.min), float(slider.max))

    def _posed(self) -> None:
        desk, browser = self._desk, self._page.browser
        if self._go.value == "Measured":
            desk.set_goal(browser, np.clip(desk.commanded(), desk.lower, desk.upper).tolist())
        else:
            desk.go_to_pose(browser, self._pose.value)
        self.show_goal()

    def _kept(self) -> None:
        before = self._pose.value if self._keep.value == "Rename" else None
        self._desk.save_pose(self._page.browser, str(self._name.value).strip(), before=before)
        self._page.say(f"pose {self._name.value} is saved")

    def _reached(self) -> None:
        names = ("roll", "pitch", "yaw")
        degrees = numbers("rpy", self._turn.value, names, -360.0, 360.0)
        turn = [math.radians(angle) for angle in degrees]
        self._desk.reach(self._page.browser, self._place.value, turn)
        self.show_goal()
        self._page.say("the goal is set: these angles bring the flange there")

    # ---- orders

    def _planned(self) -> None:
        self._agreed = None
        scale = [one.value for one in self._scale]
        self._run.label = "Execute"
        made = self._desk.plan(self._page.browser, scale, avoid=bool(self._avoid.value)).plan
        v, a, j = (100.0 * made.shares).tolist()
        near = "" if not math.isfinite(made.clearance) else f", nearest: {made.nearest}"
        text = (
            f"{made.duration:.3f} s through {len(made.points)} points{near}. Of the limits: "
            f"velocity {v:.0f} %, acceleration {a:.0f} %, jerk {j:.0f} %."
        )
        if made.collides:
            self._run.label = "Execute all the same"
            text = f"COLLIDES. {text}"
        self._page.say(text, bad=made.collides)

    def _executed(self, stops: int, *, hold: bool = False) -> None:
        page, desk = self._page, self._desk
        proposal, agreed = desk.proposal, self._agreed
        over, self._over = self._over, False
        page.say("in motion")
        try:
            desk.execute(
                page.browser,
                agreed=agreed,
                speed=self._speed.value,
                hold=hold,
                then=self._ended,
                stops=stops,
            )
        except AskAgainError:
            self._agreed, self._over = proposal, over
            self._run.label = "Really: it collides"
            raise
        except BaseException:
            self._over = over
            raise
        self._agreed = None
        self._run.label = "Execute"

    def _ended(self, why: str) -> None:
        self._over = True
        self._page.say(why or "on the goal", bad=bool(why))

    def _planned_and_executed(self, stops: int) -> None:
        self._planned()
        self._executed(stops)

    def _held(self) -> None:
        lead = self._desk.lead
        press = lead.keep(self._page.browser)
        if press is not Press.BEGINS or not self._over:
            return
        try:
            self._executed(lead.stops, hold=True)
        except SjerkError:
            lead.refuse(self._page.browser)
            raise

    def _sped(self) -> None:
        if self._desk.lead.browser == self._page.browser:
            value = self._speed.value
            if not isinstance(value, int | float):
                raise InputError("speed", value, "must be a number")
            self._desk.lead.speed(self._page.browser, float(value))

    def tick(self) -> None:
        """How near the goal is to anything, and the poses that there are."""
        desk = self._desk
        names = tuple(desk.poses) or ("-",)
        if tuple(self._pose.options) != names:
            self._pose.options = names
        clear = desk.clear
        if clear is None:
            return
        nearest = clear.nearest(desk.goal + desk.zero)
        colour = "#e03131" if nearest.distance <= 0.0 else "inherit"
        self._near.content = (
            f"<div style='padding:0 10px;font-size:12px;color:{colour}'>At the goal "
            f"{nearest.one} {'touches' if nearest.distance <= 0 else 'is nearest to'} "
            f"{nearest.other}: {1e3 * nearest.distance:.0f} mm</div>"
        )


def _up(value: float) -> float:
    return math.ceil(value * _GRID - 1e-6) / _GRID


def _down(value: float) -> float:
    return math.floor(value * _GRID + 1e-6) / _GRID


def _within(value: float, low: float, high: float) -> float:
    return min(_down(high), max(_up(low), round(value * _GRID) / _GRID))


def _rounded(values: Any, digits: int = 4) -> tuple[float, ...]:
    return tuple(round(float(v), digits) for v in values)
