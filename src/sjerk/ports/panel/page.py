"""What one browser has: its own inputs, which no other browser reaches, and its plots.

Each order is checked by the desk, whatever this page shows. Never here: planning, leading.
"""

from __future__ import annotations

import html
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import viser

from sjerk.errors import SjerkError
from sjerk.host import Host
from sjerk.ports.panel.demo_tab import DemoTab
from sjerk.ports.panel.desk import Desk
from sjerk.ports.panel.door import Role
from sjerk.ports.panel.jogging import JogTab
from sjerk.ports.panel.plan_tab import PlanTab
from sjerk.ports.panel.playing import PlayTab
from sjerk.ports.panel.scene_tab import SceneTab
from sjerk.ports.panel.signals import Signals
from sjerk.ports.panel.timing_tab import TimingTab

#: Seconds until drives must follow, and between two looks.
_PATIENCE, _LOOK = 3.0, 0.02


def _enable(host: Host) -> None:
    """Ask for it, and wait for nothing."""
    with suppress(TimeoutError):
        host.enable(timeout=1e-6)


class Page:
    """Of one viser client; ``role``: what its link may; ``now`` and the others: tabs of all."""

    def __init__(
        self, desk: Desk, client: Any, role: Role, *, now: Any, signals: Any, timing: Any
    ) -> None:
        self._locked: list[Any]
        self._answers, self._saying = 0, threading.Lock()
        self.desk, self.client, self.role = desk, client, role
        self.browser: int = client.client_id
        gui = client.gui
        with now:
            self.stop = gui.add_button(
                "STOP",
                color="red",
                icon=viser.Icon.HAND_STOP,
                order=1.0,
                hint="jerk-limited halt of all axes, whoever leads; again within 2 s: quick stop",
            )

        async def stop(_: Any) -> None:  # on the event loop: no order that waits is before it
            self._stop()

        self.stop.on_click(stop)
        self.signals = Signals(gui, desk, signals, download=self._download, page=self)
        self.timing = TimingTab(gui, timing)
        if role == "lead":
            with signals:
                record = gui.add_button("Record every cycle", hint="begins, or ends it: Parquet")
            record.on_click(lambda _: self.do(lambda: self.say(desk.record(self.browser))))
            self._locked = [record]
        else:
            self._locked = []
        with now:
            self.said = gui.add_html("", order=5.0, visible=False)
        self.tabs: list[Any] = []
        if role == "lead":
            self._orders(gui, now)
        else:
            gui.add_html(
                "<div style='padding:4px 10px'>This link only views; STOP works.</div>", order=0.3
            )
        dark = gui.add_checkbox("Dark", True, order=9.0)
        self.on_input(dark, lambda: self._theme(bool(dark.value)))
        self.refresh()

    def _orders(self, gui: Any, now: Any) -> None:
        with now:
            self.take = gui.add_button("Take the lead", icon=viser.Icon.STEERING_WHEEL, order=3.0)
            self.power = gui.add_button_group("Drives", ("Enable", "Disable", "Reset"), order=4.0)
        self.take.on_click(lambda _: self.do(self._toggle))

        async def powered(_: Any) -> None:
            stops, word = self.desk.lead.stops, str(self.power.value)
            with suppress(RuntimeError):  # the panel ends
                self.desk.workers.submit(self.do, lambda: self._power(stops, word))

        self.power.on_click(powered)
        group = gui.add_tab_group(order=0.4)
        with group.add_tab("Plan"):
            self.plan = PlanTab(self, gui)
        with group.add_tab("Jog"):
            self.jog = JogTab(self, gui)
        if self.desk.arm is not None:
            with group.add_tab("Scene"):
                self.scene = SceneTab(self, gui)
                self.tabs.append(self.scene)
        with group.add_tab("Trajectories"):
            self.play = PlayTab(self, gui)
        with group.add_tab("Demo"):
            self.demo = DemoTab(self, gui)
        self.tabs += [self.plan, self.jog, self.play, self.demo]
        for tab in self.tabs:
            self._locked += tab.locked

    # ---- what all parts use

    def do(self, work: Callable[[], object]) -> None:
        """Run an order of this browser; what is refused is told in its page."""
        try:
            work()
        except (SjerkError, TimeoutError, OSError) as fault:
            self.say(str(fault), bad=True)
            self.desk.journal.refuse(f"browser {self.browser}: {fault}")
        except RuntimeError as fault:  # of viser
            self.desk.journal.refuse(f"browser {self.browser}: {fault}")

    def on_input(self, handle: Any, work: Callable[[], object]) -> None:
        """What follows an input, or a press that takes no time: at once, in the order of both.

        On the event loop: what is typed next is not before it, and no press overtakes it.
        """

        async def came(_: Any) -> None:
            self.do(work)

        (handle.on_click if hasattr(handle, "on_click") else handle.on_update)(came)

    def on_press(self, button: Any, work: Callable[[int], object], *, plans: bool = False) -> None:
        """A button that moves something: ``work`` gets the number of stops when it was pressed.

        So that nothing begins to move after a stop that was pressed later, however long it waits.
        ``plans``: it waits for the plans that were ordered before.
        """
        pool = self.desk.planner if plans else self.desk.workers

        async def pressed(_: Any) -> None:
            stops = self.desk.lead.stops
            with suppress(RuntimeError):  # the panel ends
                pool.submit(self.do, lambda: work(stops))

        button.on_click(pressed)

    def say(self, text: str, *, bad: bool = False) -> None:
        """One line under the buttons."""
        colour = "#e03131" if bad else "#2f9e44"
        # The last one stays. A browser may have left meanwhile: viser refuses its elements.
        with suppress(RuntimeError), self._saying, self.client.atomic():
            self._answers += 1
            self.said.content = (
                f"<div class='sjerk-said' data-answer='{self._answers}' "
                f"style='padding:4px 10px;font-size:13px;overflow-wrap:anywhere;color:{colour}'>"
                f"{html.escape(text)}</div>"
            )
            self.said.visible = bool(text)

    def refresh(self) -> None:
        """Buttons that move are open only while this browser leads; the server checks again."""
        if self.role != "lead":
            return
        leads = self.desk.lead.browser == self.browser
        self.take.label = "Give back the lead" if leads else "Take the lead"
        for one in self._locked:
            one.disabled = not leads

    def tick(self) -> None:
        """Some times a second: what follows the kernel by itself."""
        for tab in self.tabs:
            tab.tick()

    # ---- orders

    def _stop(self) -> None:
        def stop() -> None:
            what = self.desk.lead.stop()
            self.desk.workers.submit(self.do, self.desk.lead.let_all_go)
            self.say(f"{what} asked for")
            self.desk.journal.tell(f"browser {self.browser}: STOP, {what}")

        self.do(stop)

    def _toggle(self) -> None:
        lead = self.desk.lead
        if lead.browser == self.browser:
            self.desk.left(self.browser, "given back")
            self.refresh()
            self.say("the lead is given back")
        else:
            lead.take(self.browser)
            self.refresh()
            self.say("this browser leads")

    def _power(self, stops: int, word: str) -> None:
        lead = self.desk.lead
        if word == "Reset":
            lead.reset(self.browser)
            self.say("faults are reset")
        elif word == "Disable":
            lead.order(self.browser, lambda host: host.disable(timeout=0.0))
            self.say("drives stop")
        elif word == "Enable":
            lead.order(self.browser, _enable, stops=stops)
            until = time.monotonic() + _PATIENCE
            while not self.desk.watching.follow():
                if time.monotonic() > until:
                    raise TimeoutError(f"the drives do not follow within {_PATIENCE:g} s")
                time.sleep(_LOOK)
            self.say("drives follow")

    def _download(self, name: str, data: bytes) -> None:
        self.client.send_file_download(name, data, save_immediately=True)

    def _theme(self, dark: bool) -> None:
        self.client.gui.configure_theme(
            show_share_button=False, show_logo=False, dark_mode=dark, control_width="large"
        )
