"""A real browser at the panel: Debian's Chromium, driven by playwright."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from playwright.sync_api import Browser, Page, sync_playwright

#: Program and folders of libraries, as tools/chromium.sh tells them.
PROGRAM = os.environ.get("SJERK_CHROMIUM", "")
#: viser's sorter of splats wants to compile text; the policy refuses, and it is not needed.
KNOWN = "Evaluating a string as JavaScript violates"


@contextmanager
def chromium() -> Iterator[Browser]:
    """A browser without a screen, which renders in software."""
    program, _, libraries = PROGRAM.partition(" ")
    before = os.environ.get("LD_LIBRARY_PATH")
    with sync_playwright() as driver:
        browser = driver.chromium.launch(
            executable_path=program,
            args=["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
            env=dict(os.environ) | ({"LD_LIBRARY_PATH": libraries} if libraries else {}),
        )
        try:
            yield browser
        finally:
            browser.close()
    assert os.environ.get("LD_LIBRARY_PATH") == before


class Seen:
    """A page of the panel, what it asked for, and what went wrong in it."""

    def __init__(self, browser: Browser, link: str, *, height: int = 950) -> None:
        self.page: Page = browser.new_page(viewport={"width": 1280, "height": height})
        self.page.set_default_timeout(60_000)
        self.requests: list[str] = []
        self.faults: list[str] = []
        self.bytes = 0
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("websocket", lambda socket: self.requests.append(socket.url))
        self.page.on("console", self._console)
        self.page.on("pageerror", self._error)
        answer = self.page.goto(link)
        assert answer is not None
        self.bytes = int(answer.headers["content-length"])
        self.page.get_by_role("button", name="STOP").wait_for()
        self.until(lambda: "cycle" in self.text("#sjerk-first"), "the first line")
        close = self.page.locator(".mantine-Notification-closeButton")
        if close.count():
            close.first.click()

    def _console(self, message: Any) -> None:
        if message.type == "error":
            self.faults.append(message.text)

    def _error(self, error: Any) -> None:
        if KNOWN not in str(error):
            self.faults.append(str(error))

    def until(self, what: Callable[[], Any], why: str, patience: float = 60.0) -> Any:
        """Wait for something to be true; the policy lets nobody wait in the page itself."""
        end = time.monotonic() + patience
        while not (found := what()):
            assert time.monotonic() < end, f"not within {patience} s: {why}; said {self.said!r}"
            self.page.wait_for_timeout(30)
        return found

    def text(self, where: str) -> str:
        """Of an element."""
        found = self.page.locator(where)
        return found.first.inner_text() if found.count() else ""

    @property
    def said(self) -> str:
        """The last answer."""
        return self.text(".sjerk-said")

    def button(self, name: str) -> Any:
        """A button that is seen."""
        return self.page.get_by_role("button", name=name, exact=True).locator("visible=true").first

    def press(self, name: str, answer: str = "") -> None:
        """Click, and wait for an answer."""
        self.button(name).click()
        if answer:
            self.until(lambda: answer in self.said, f"{answer!r} after {name}")

    def label(self, name: str) -> None:
        """Click one of a group of buttons, or a tab."""
        self.page.get_by_text(name, exact=True).locator("visible=true").first.click()

    def tab(self, name: str) -> None:
        """Open a tab."""
        self.page.get_by_role("tab", name=name).click()

    def choose(self, field: str, option: str) -> None:
        """Choose in a list."""
        self.page.get_by_label(field, exact=True).locator("visible=true").first.click()
        self.page.get_by_role("option", name=option, exact=True).locator("visible=true").click()

    def lead(self) -> None:
        """Take the lead, and let the drives follow."""
        self.press("Take the lead", "this browser leads")
        self.label("Enable")
        self.until(lambda: "drives follow" in self.said, "drives")

    def cut_texts(self) -> list[str]:
        """Texts that are wider than their place, and so are cut."""
        found = self.page.evaluate(
            """() => [...document.querySelectorAll(
            'button, label, td, th, input, div[class*=sjerk]')]
            .filter(e => e.offsetParent && e.clientWidth > 0 && e.scrollWidth > e.clientWidth + 1)
            .map(e => (e.innerText || e.value || '') + ' ' + e.scrollWidth + ' in ' + e.clientWidth)
            .filter(text => text.trim())"""
        )
        return [str(text) for text in found if "ws://" not in str(text)]  # viser's settings
