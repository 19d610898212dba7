"""Jog: buttons that move one axis while they are held, or by a step.

Never here: dead-man's switches (``holding.py``).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sjerk.limits import Limits
from sjerk.ports.panel.desk import number

if TYPE_CHECKING:
    from sjerk.ports.panel.page import Page

_HZ = 20.0
_HELD, _STEP = "While held", "Step"


class JogTab:
    """Of one browser."""

    def __init__(self, page: Page, gui: Any) -> None:
        self._page, self._desk = page, page.desk
        desk = self._desk
        self._mode = gui.add_dropdown("Moves", (_HELD, _STEP))
        self._share = gui.add_slider(
            "Velocity", min=0.01, max=1.0, step=0.01, initial_value=0.1, hint="of the limit"
        )
        self._step = gui.add_number("Step", 0.01, step=0.001, hint=f"in {desk.units[0]}")
        self.locked = []
        for i, name in enumerate(desk.names):
            for sign, mark in ((-1.0, "−"), (1.0, "+")):
                button = gui.add_button(f"{name} {mark}", hint="moves while held")
                self._bind(button, i, sign)
                self.locked.append(button)

    def _bind(self, button: Any, axis: int, sign: float) -> None:
        # on the event loop, so that a message cannot overtake the release that comes after it
        async def held(_: Any) -> None:
            if self._mode.value == _HELD:
                self._page.do(lambda: self._jog(axis, sign))

        async def let_go(_: Any) -> None:
            self._desk.lead.release(self._page.browser, axis)

        def stepped(stops: int) -> None:
            if self._mode.value == _STEP:
                self._moved(axis, sign, stops)

        button.on_hold(held, callback_hz=_HZ)
        button.on_click(let_go)
        self._page.on_press(button, stepped)

    def _jog(self, axis: int, sign: float) -> None:
        share = number("velocity", self._share.value, 0.0, 1.0)
        velocity = sign * share * self._desk.limits[axis].velocity
        self._desk.lead.jog(self._page.browser, axis, velocity)

    def _moved(self, axis: int, sign: float, stops: int) -> None:
        own = self._desk.limits[axis]
        share = number("velocity", self._share.value, 0.01, 1.0)
        step = number("step", self._step.value, 0.0, 1e6)
        slower = Limits(share * own.velocity, own.acceleration, own.jerk)
        self._desk.lead.order(
            self._page.browser,
            lambda host: host.move({axis: sign * step}, relative=True, limits={axis: slower}),
            stops=stops,
        )

    def tick(self) -> None:
        """Nothing follows by itself."""
