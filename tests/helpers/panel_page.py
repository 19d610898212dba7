"""A real browser at the panel: Debian's Chromium, driven by playwright."""

from __future__ import annotations

import os
import re
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, BrowserType, Page, sync_playwright

from sjerk import Monitor
from sjerk.host import PathState

#: Program and folders of libraries, as tools/chromium.sh tells them.
PROGRAM = os.environ.get("SJERK_CHROMIUM", "")
needs_browser = pytest.mark.skipif(not PROGRAM, reason="no chromium, and none by apt")
#: viser's sorter of splats wants to compile text; the policy refuses, and it is not needed.
KNOWN = "Evaluating a string as JavaScript violates"
#: A folder for pictures of the page, made by the tests for the documentation; "": none are made.
PICTURES = os.environ.get("SJERK_PICTURES", "")
#: Answers of an order that is not over.
ON_THE_WAY = r".* s through|in motion|point \d"
#: Where the browser draws in software it takes all processors that there are, from the kernel and
#: from the page's own scripts; four pictures a second are enough to see what it does.
FEWER_PICTURES = """
    const asked = new Map();
    let last = 0;
    window.requestAnimationFrame = (draw) => {
        asked.set(++last, setTimeout(((id) => () => {
            asked.delete(id);
            draw(performance.now());
        })(last), 250));
        return last;
    };
    window.cancelAnimationFrame = (id) => { clearTimeout(asked.get(id)); asked.delete(id); };
"""
#: Where no picture is wanted nothing is drawn: the scene is judged by its nodes. What draws in
#: software is a processor's work for a second each time, which the page's scripts would wait for.
NO_DRAWING = """
    for (const kind of [WebGLRenderingContext, WebGL2RenderingContext])
        for (const name of Object.getOwnPropertyNames(kind.prototype))
            if (/^draw(Arrays|Elements|Range)/.test(name)) kind.prototype[name] = () => {};
"""


@contextmanager
def chromium() -> Iterator[Browser]:
    """A browser without a screen, which renders in software."""
    with sync_playwright() as driver:
        browser = launched(driver.chromium)
        try:
            yield browser
        finally:
            browser.close()


def launched(kind: BrowserType) -> Browser:
    """One that is started now."""
    program, _, libraries = PROGRAM.partition(" ")
    return kind.launch(
        executable_path=program,
        args=["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
        env=dict(os.environ) | ({"LD_LIBRARY_PATH": libraries} if libraries else {}),
    )


@contextmanager
def mortal(browser: Browser) -> Iterator[tuple[Browser, Callable[[signal.Signals], int]]]:
    """One more, and what sends a signal to all its processes and tells how many there were."""
    before = set(processes())
    one = launched(browser.browser_type)

    def die(by: signal.Signals) -> int:
        own = [pid for pid in processes() if pid not in before]
        for pid in own:
            with suppress(ProcessLookupError):  # with the one before
                os.kill(pid, by)
        return len(own)

    try:
        yield one, die
    finally:
        die(signal.SIGKILL)
        one.close()


def processes() -> list[int]:
    """All browsers that this process has started, with what they have started."""
    parents = {}
    for entry in Path("/proc").iterdir():
        with suppress(OSError, ValueError):
            fields = (entry / "stat").read_text().rpartition(")")[2].split()
            parents[int(entry.name)] = int(fields[1])
    found = []
    for pid in parents:
        line, up = [pid], pid
        while (up := parents.get(up, 0)) > 0:
            line.append(up)
        with suppress(OSError):
            if os.getpid() in line[1:] and "chromium" in os.readlink(f"/proc/{pid}/exe"):
                found.append(pid)
    return found


def at_rest(monitor: Monitor) -> bool:
    """Whether nothing moves: at a goal, by a halt, or on a path that is held."""
    now = monitor.feedback()
    still = all(axis.velocity == 0.0 for axis in now.axes)
    return not now.moving or (still and now.path.state is PathState.PAUSED)


class Seen:
    """A page of the panel, what it asked for, and what went wrong in it."""

    def __init__(self, browser: Browser, link: str, *, height: int = 950) -> None:
        self.page: Page = browser.new_page(
            viewport={"width": 1280, "height": height},
            # drawing in software takes as long as there are pixels; texts stay where they are
            device_scale_factor=1.0 if PICTURES else 0.5,
        )
        self.page.set_default_timeout(60_000)
        self.page.add_init_script(FEWER_PICTURES + ("" if PICTURES else NO_DRAWING))
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

    def picture(self, name: str, *, held: bool = False) -> None:
        """Keep what is seen, where pictures are wanted; ``held``: the mouse stays where it is."""
        if PICTURES:
            if not held:
                self.page.mouse.move(640, 20)  # off what it has pressed, whose hint hides another
            self.page.wait_for_timeout(700)
            self.page.screenshot(path=str(Path(PICTURES) / f"panel_{name}.png"))

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
        script = "where => document.querySelector(where)?.textContent ?? ''"
        return str(self.page.evaluate(script, where))

    @property
    def answer(self) -> tuple[int, str]:
        """How many answers there were, and the last one."""
        number, words = self.page.evaluate(
            "() => { const e = document.querySelector('.sjerk-said');"
            " return e ? [Number(e.dataset.answer), e.textContent] : [0, '']; }"
        )
        return int(number), str(words)

    @property
    def said(self) -> str:
        """The last answer."""
        return self.answer[1]

    def button(self, name: str) -> Any:
        """A button that is seen."""
        return self.page.get_by_role("button", name=name, exact=True).locator("visible=true").first

    def press(self, name: str, answer: str = "") -> str:
        """Click, and wait for a new answer that has this pattern; returns it."""
        before = self.answer[0]
        self.button(name).click()
        return self.answered(before, answer, name) if answer else ""

    def answered(self, before: int, answer: str, why: str) -> str:
        """Wait for an answer after the first ``before``."""

        def found() -> str:
            number, words = self.answer
            return words if number > before and re.search(answer, words) else ""

        return str(self.until(found, f"{answer!r} after {why}"))

    def over(self, name: str) -> str:
        """Click what moves, and wait until that is over or refused: the last answer."""
        return self.press(name, rf"^(?!{ON_THE_WAY})")

    def hold(self, name: str, what: Callable[[], Any], why: str) -> None:
        """Press a button until something is true; it is held then.

        Again where the dead-man's switch was first: a busy machine sends too few messages.
        """
        button = self.button(name)
        button.scroll_into_view_if_needed()
        box = button.bounding_box()
        assert box is not None
        self.page.mouse.move(box["x"] + 40, box["y"] + 8)

        def held() -> bool:
            self.page.mouse.down()
            end = time.monotonic() + 2.0
            while time.monotonic() < end:
                if what():
                    return True
                self.page.wait_for_timeout(20)
            self.page.mouse.up()
            return False

        self.until(held, why)

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
        """Take the lead where this page has it not, let the drives follow, open what plans."""
        if self.button("Take the lead").count():
            self.press("Take the lead", "this browser leads")
        self.tab("Signals")
        self.tab("Plan")
        before = self.answer[0]
        self.label("Enable")
        self.answered(before, "drives follow", "Enable")

    def give_back(self) -> None:
        """Lead no longer."""
        if self.button("Give back the lead").count():
            self.press("Give back the lead", "given back")

    def beside(self, label: str, what: str) -> Any:
        """Inputs (a role or a tag) in the row of a label."""
        row = f"xpath=ancestor::*[.//{what}][1]//{what}"
        seen = self.page.get_by_text(label, exact=True).locator("visible=true").first
        return seen.locator(row)

    def slide(self, label: str, key: str, times: int = 1) -> None:
        """Press a key (Home: the least, End: the most) on a slider, or on the first of two."""
        for _ in range(times):
            self.beside(label, "*[@role='slider']").first.press(key)

    def fill(self, label: str, *values: object) -> None:
        """Type into the fields of a row."""
        fields = self.beside(label, "input[not(@type='hidden')]")
        for k, value in enumerate(values):
            fields.nth(k).fill(str(value))
            fields.nth(k).press("Enter")

    def pose(self, name: str) -> None:
        """Make a pose the goal."""
        if not self.page.get_by_text("To goal", exact=True).locator("visible=true").count():
            self.label("Poses")
        self.choose("Pose", name)
        self.label("Set goal")

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
