"""Attacks from a page of somebody else in the user's own browser, and by a browser that lies.

Each is seen to succeed with the door off, or with viser as it comes.
"""

from __future__ import annotations

import json
import math
import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
import viser
from playwright.sync_api import Browser

from helpers.panel_bench import RANGES
from helpers.panel_client import Client, PanelProcess, panel, until
from helpers.panel_page import needs_browser
from sjerk import Monitor

ON, OFF = "door", "no door"


@pytest.fixture(scope="module")
def panels(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, PanelProcess]]:
    """Two panels on one kernel each."""
    folder = tmp_path_factory.mktemp("panels")
    with (
        panel(name=f"attack-on-{time.time_ns()}", folder=folder) as one,
        panel(name=f"attack-off-{time.time_ns()}", folder=folder, door=False) as two,
    ):
        yield {ON: one, OFF: two}


class Evil:
    """A web server of somebody else: one page, and who knocks for a websocket."""

    def __init__(self) -> None:
        self.page = ""
        self.knocks = 0
        evil = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                if self.headers.get("Upgrade", "").lower() == "websocket":
                    evil.knocks += 1
                self.send_response(200)
                self.send_header("Content-Type", "text/html")
                self.end_headers()
                self.wfile.write(evil.page.encode())

            def log_message(self, *_: object) -> None:
                """Nothing."""

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.port = self.server.server_address[1]
        threading.Thread(target=self.server.serve_forever, daemon=True).start()


@pytest.fixture
def evil() -> Iterator[Evil]:
    """Another origin: another port of this machine."""
    one = Evil()
    yield one
    one.server.shutdown()
    one.server.server_close()


def commanded(browser: Browser, evil: Evil, target: PanelProcess) -> bool:
    """Its script opens a websocket to the panel; it has even seen the secret."""
    split = urlsplit(target.lead)
    where = json.dumps([f"ws://{split.netloc}{split.path}", f"viser-v{viser.__version__}"])
    evil.page = f"""<script>
        const it = new WebSocket(...{where});
        it.onopen = () => {{ document.title = 'open'; }};
        it.onerror = () => {{ document.title = 'refused'; }};
    </script>"""
    page = browser.new_page()
    page.goto(f"http://127.0.0.1:{evil.port}/")
    title = until(page.title, "an answer")
    page.close()
    return bool(title == "open")


def framed(browser: Browser, evil: Evil, target: PanelProcess) -> bool:
    """It shows the panel in a frame, to have its buttons clicked."""
    evil.page = f"<iframe src='{target.view}' width='600' height='400'></iframe>"
    page = browser.new_page()
    page.goto(f"http://127.0.0.1:{evil.port}/", wait_until="load")
    frame = until(lambda: page.frames[1:], "a frame")[0]
    found = until(lambda: frame.evaluate("() => document.readyState") == "complete", "it is loaded")
    found = bool(frame.evaluate("() => document.getElementById('root') !== null"))
    page.close()
    return found


def drawn_away(browser: Browser, evil: Evil, target: PanelProcess) -> bool:
    """A link to the panel names another server, whose messages would run in our page."""
    before = evil.knocks
    page = browser.new_page()
    page.goto(f"{target.view}?websocket=ws://127.0.0.1:{evil.port}")
    end = time.monotonic() + 60.0
    while time.monotonic() < end:  # it knocks there, or is at home
        if evil.knocks > before:
            break
        if page.get_by_role("button", name="STOP").count():
            break
        page.wait_for_timeout(50)
    page.close()
    return evil.knocks > before


@needs_browser
@pytest.mark.parametrize("attack", [commanded, framed, drawn_away], ids=lambda one: one.__name__)
def test_a_page_of_somebody_else_is_held_and_succeeds_without_the_door(
    browser: Browser, evil: Evil, panels: dict[str, PanelProcess], attack: Any
) -> None:
    """In a real browser; both are seen, so that the attack is one."""
    assert attack(browser, evil, panels[OFF])
    assert not attack(browser, evil, panels[ON])


def test_an_element_that_all_share_can_be_changed_by_any_browser_in_viser() -> None:
    """Which is why the panel shares none (as judged_door has it)."""
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        shared = server.gui.add_slider("Shared", min=0.0, max=1.0, step=0.1, initial_value=0.3)
        one, two = (Client(f"http://127.0.0.1:{server.get_port()}/") for _ in range(2))
        uuid = two.find("Shared")
        one.find("Shared")
        two.send(type="GuiUpdateMessage", uuid=uuid, updates={"value": 1e9})
        until(lambda: shared.value == 1e9, "far beyond its end")
        until(lambda: one.props[uuid]["value"] == 1e9, "the other page shows it")
        one.close()
        two.close()
    finally:
        server.stop()


@pytest.fixture
def target(tmp_path: Path) -> Iterator[PanelProcess]:
    """A panel of a test's own: what is done to its scene is done to no other test."""
    with panel(name=f"liar-{time.time_ns()}", folder=tmp_path) as process:
        yield process


#: None is a value of any input.
LIES = [math.nan, math.inf, -1e9, 1e9, "1e9", "", None, [], {}, [1e9, math.nan, "x"], b"\0"]
UPDATES = [
    {"removed": True},
    {"disabled": False, "visible": True},
    {"min": -1e9, "max": 1e9, "value": 1e9},
    {"options": ["<script>"], "value": "<script>"},
    {"label": 7, "value": 7},
    {"nothing": 1},
]
ORDERS = (
    "Plan", "Execute", "Plan & Execute", "Set goal to flange pose", "Add or change", "Remove",
    "Go to its start", "Play", "To its first point", "Save the scene to the file",
)  # fmt: skip


def test_a_browser_that_lies_moves_nothing_and_harms_no_other(target: PanelProcess) -> None:
    """Every input, every value that is none; then every order. The page of the others lives."""
    liar, other = Client(target.lead), Client(target.view)
    other.told("cycle")
    liar.order("Take the lead", "this browser leads")
    liar.order("Drives", "drives follow", "Enable")
    buttons = {"GuiButtonMessage", "GuiButtonGroupMessage"}
    with Monitor.attach(target.name) as monitor:
        before = [axis.position for axis in monitor.feedback().axes]
        inputs = [uuid for kind, _, uuid in list(liar.elements) if kind not in buttons]
        assert len(inputs) > 20
        for lie in [{"value": value} for value in LIES] + UPDATES:
            for uuid in inputs:
                liar.send(type="GuiUpdateMessage", uuid=uuid, updates=lie)
            for label in ORDERS:
                if liar.has(label):
                    liar.click(label)
            assert not liar.closed.is_set()
        other.set("STOP", True)
        other.told("STOP, halt")  # of the events: refusals may be said after it
        frame = monitor.feedback()
        for axis, (low, high) in zip(frame.axes, RANGES.tolist(), strict=True):
            assert low <= axis.position <= high
        until(lambda: not monitor.feedback().moving, "at rest")
        moved = max(
            abs(axis.position - at)
            for axis, at in zip(monitor.feedback().axes, before, strict=True)
        )
        assert moved == 0.0
        other.told("a browser sent what is no value: refused")
        shown = other.html
        until(lambda: other.html != shown, "the page of the other lives")
        assert "<script>" not in other.html
    for one in (liar, other):
        one.close()
    later = Client(target.lead)
    later.told("leads no longer: it has left")
    later.order("Take the lead", "this browser leads")
    later.close()


def test_a_stop_is_not_behind_orders_that_take_their_time(target: PanelProcess) -> None:
    """A hundred plans are asked for; the stop of another browser is answered before they are.

    Nor is what comes then behind them: who asked has left, and they are made no more.
    """
    busy, other = Client(target.lead), Client(target.view)
    busy.told("leads: <b>nobody</b>")
    busy.order("Take the lead", "this browser leads")
    busy.order("Drives", "drives follow", "Enable")
    busy.set("Pose", "left")
    busy.set("To goal", "Set goal")
    other.told("cycle")
    for _ in range(100):
        busy.click("Plan")
    other.order("STOP", "asked for")
    assert busy.answers < 50  # where it waits for a free thread, most plans are made before
    busy.close()
    other.told("leads: <b>nobody</b>")
    later = Client(target.lead)
    later.order("Take the lead", "this browser leads")
    later.order("Plan", " s through")
    for one in (other, later):
        one.close()
