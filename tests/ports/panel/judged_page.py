"""The panel in a real browser: what a person does, what they see, and who dies.

Pictures of it are made here, for the documentation: ``SJERK_PICTURES`` is the folder.
"""

from __future__ import annotations

import os
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser

from helpers.panel_bench import PANDA, RANGES, SETTINGS
from helpers.panel_client import PanelProcess, panel, until
from helpers.panel_page import PROGRAM, Seen, at_rest, chromium
from sjerk import Monitor

PICTURES = os.environ.get("SJERK_PICTURES", "")

pytestmark = pytest.mark.skipif(not PROGRAM, reason="no chromium, and none by apt")


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """One for all."""
    with chromium() as one:
        yield one


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PanelProcess]:
    """A panel on a robot of one's own: a copy of the one that is shipped."""
    folder = tmp_path_factory.mktemp("panel")
    (folder / "robot.toml").write_text(PANDA.read_text())
    names = [f"panda_joint{i}" for i in range(1, 8)]
    start = np.array([0.0, -0.785398, 0.0, -2.356194, 0.0, 1.570796, 0.785398])
    rows = [",".join(["time", *names])]
    for k in range(41):
        at = start + 0.3 * np.sin(np.linspace(0, 2 * np.pi, 41))[k] * np.linspace(0, 1, 7)
        rows.append(",".join(repr(v) for v in [0.1 * k, *at.tolist()]))
    (folder / "wave.csv").write_text("\n".join(rows) + "\n")
    name = "panel" if PICTURES else f"page-{time.time_ns()}"
    with panel("robot.toml", name=name, folder=folder) as process:
        yield process


@pytest.fixture
def monitor(running: PanelProcess) -> Iterator[Monitor]:
    """The kernel, seen past the panel."""
    with Monitor.attach(running.name) as one:
        yield one


@pytest.fixture
def seen(browser: Browser, running: PanelProcess) -> Iterator[Seen]:
    """A page that leads."""
    one = Seen(browser, running.lead)
    yield one
    assert one.faults == []
    one.page.close()


def picture(seen: Seen, name: str) -> None:
    """Keep what is seen."""
    if PICTURES:
        seen.page.wait_for_timeout(700)
        seen.page.screenshot(path=str(Path(PICTURES) / f"panel_{name}.png"))


def rests(seen: Seen, monitor: Monitor) -> None:
    """Wait until nothing moves."""
    seen.until(lambda: at_rest(monitor), "at rest")


def arrives(seen: Seen, monitor: Monitor, name: str) -> None:
    """Go to a pose, to the last bit; again where a busy machine made the kernel halt on the way."""
    goal = list(SETTINGS.poses[name])

    def there() -> bool:
        return [axis.position for axis in monitor.feedback().axes] == goal

    for _ in range(10):
        if there():
            break
        seen.pose(name)
        seen.over("Plan & Execute")
        rests(seen, monitor)
    assert there()


def test_the_page_comes_whole_and_asks_nobody_else(seen: Seen, running: PanelProcess) -> None:
    """At most 1 MB, only its own host, no error in the console."""
    own = re.compile(rf"(http|ws)://127\.0\.0\.1:{running.port}/|blob:|data:")
    assert seen.requests
    assert [url for url in seen.requests if not own.match(url)] == []
    assert seen.bytes <= 1_000_000
    print(f"page: {seen.bytes / 1e6:.3f} MB")


def test_a_whole_round(seen: Seen, monitor: Monitor) -> None:
    """Lead, enable, plan, preview, execute; arrives on the goal; then by both in one."""
    seen.lead()
    seen.pose("left")
    seen.press("Plan", "s through")
    picture(seen, "planned")
    seen.press("Execute", "in motion|on the goal")
    picture(seen, "motion")
    rests(seen, monitor)
    arrives(seen, monitor, "left")
    arrives(seen, monitor, "ready")


def test_the_table_has_the_angles_of_the_kernel(seen: Seen, monitor: Monitor) -> None:
    """Of the motors at rest, within 1e-4 rad."""
    seen.lead()
    arrives(seen, monitor, "left")

    def shown() -> Any:
        rows = seen.page.locator("#sjerk-axes tr[data-axis] td:nth-child(2)").all_inner_texts()
        return np.array([float(row) for row in rows])

    def off() -> float:
        """The motors settle for some time after the command rests."""
        actual = np.array([axis.actual_position for axis in monitor.feedback().axes])
        return float(np.abs(shown() - actual).max())

    seen.until(lambda: off() < 1e-4, "the angles")


def test_what_collides_is_red_and_needs_a_second_click(seen: Seen, monitor: Monitor) -> None:
    """And the events say so."""
    seen.lead()
    arrives(seen, monitor, "left")
    seen.pose("right")
    seen.label("Avoid collisions")
    seen.press("Plan", "COLLIDES")
    picture(seen, "collides")
    seen.press("Execute all the same", "click again")
    assert not monitor.feedback().moving
    seen.press("Really: it collides", "in motion")
    seen.press("STOP")
    rests(seen, monitor)
    seen.tab("Events")
    seen.until(lambda: "a plan that collides" in seen.text(".sjerk-events"), "the event")
    picture(seen, "events")
    for _ in range(10):  # out of it, the way that it came
        if monitor.feedback().axes[0].position == 0.9:
            break
        seen.pose("left")
        if "COLLIDES" in seen.press("Plan", "s through"):
            seen.press("Execute all the same", "click again")
            seen.over("Really: it collides")
        else:
            seen.over("Execute")
        rests(seen, monitor)
    assert monitor.feedback().axes[0].position == 0.9
    seen.tab("Scene")
    picture(seen, "scene")
    seen.tab("Signals")


def test_hold_to_run_and_speed(seen: Seen, monitor: Monitor) -> None:
    """Rests on the path when let go, and goes on when pressed again."""
    seen.lead()
    arrives(seen, monitor, "ready")
    seen.pose("left")
    seen.press("Plan", "s through")
    seen.hold("Hold to run", lambda: monitor.feedback().path.state.name == "RUNS", "runs")
    seen.page.mouse.up()
    seen.until(lambda: monitor.feedback().path.state.name == "PAUSED", "rests on the path")
    rests(seen, monitor)
    at = monitor.feedback().axes[0].position
    assert at not in (0.0, 0.9)
    seen.hold("Hold to run", lambda: monitor.feedback().axes[0].position != at, "goes on")
    seen.page.mouse.up()
    rests(seen, monitor)


def test_a_viewer_stops_and_gives_no_order(
    seen: Seen, monitor: Monitor, browser: Browser, running: PanelProcess
) -> None:
    """The second to lead is refused with the first; the lead is free once its tab is closed."""
    seen.lead()
    viewer = Seen(browser, running.view)
    assert not viewer.page.get_by_role("button", name="Take the lead").count()
    other = Seen(browser, running.lead)
    other.button("Take the lead").click()
    other.until(lambda: re.search(r"browser \d+ leads", other.said), "refused by name")
    there = monitor.feedback().axes[0].position
    seen.pose("left" if there < 0.5 else "ready")
    seen.press("Plan & Execute")
    seen.until(lambda: monitor.feedback().moving, "motion")
    viewer.press("STOP", "halt")
    rests(seen, monitor)
    picture(viewer, "viewer")
    for one in (viewer, other):
        one.page.close()


LETS_GO = {
    "blur": "() => dispatchEvent(new Event('blur'))",
    "hidden": """() => {
        Object.defineProperty(document, 'hidden', {value: true, configurable: true});
        document.dispatchEvent(new Event('visibilitychange'));
        delete document.hidden;
    }""",
    "loop": """() => {
        setTimeout(() => { const end = Date.now() + 4000; while (Date.now() < end); });
    }""",
}


def test_a_jog_ends_with_its_hand(
    browser: Browser, running: PanelProcess, monitor: Monitor
) -> None:
    """Let go, another window in front, a page in an endless loop, a page that is closed."""
    seen = Seen(browser, running.lead)
    seen.lead()
    seen.tab("Jog")
    for number, case in enumerate(["released", *LETS_GO, "closed"]):
        sign = "−" if number % 2 else "+"
        seen.hold(f"panda_joint1 {sign}", lambda: monitor.feedback().moving, f"moves: {case}")
        if case == "released":
            picture(seen, "jog")
            seen.page.mouse.up()
        elif case == "closed":
            seen.page.close()
        else:
            seen.page.evaluate(LETS_GO[case])
        until(lambda: at_rest(monitor), f"at rest: {case}")
        low, high = RANGES[0]
        assert low + 0.01 < monitor.feedback().axes[0].position < high - 0.01, case
        if case != "closed":
            seen.page.mouse.up()
    until(lambda: monitor.host_pid is None, "the lead is free")


def test_trajectories_are_shown_resampled_and_played(seen: Seen, monitor: Monitor) -> None:
    """Points before and after, then to the end."""
    seen.lead()
    arrives(seen, monitor, "ready")
    seen.tab("Trajectories")
    seen.choose("File", "wave.csv")
    seen.choose("Joint", "panda_joint7")
    field = seen.page.get_by_label("Delta", exact=True).locator("visible=true").first
    field.fill("0.05")
    field.press("Enter")
    seen.label("Show")
    seen.until(lambda: "41 points" in seen.text(".sjerk-points"), "points")
    kept = re.search(r"(\d+) after", seen.text(".sjerk-points"))
    assert kept is not None
    assert 2 < int(kept.group(1)) < 41
    for _ in range(10):  # again where a busy machine made the kernel halt on the way
        if "succeeded" in seen.over("Play"):
            break
        rests(seen, monitor)
        seen.tab("Plan")
        arrives(seen, monitor, "ready")
        seen.tab("Trajectories")
    assert "succeeded" in seen.said
    picture(seen, "trajectories")


def test_no_text_is_cut(seen: Seen) -> None:
    """At 1280 x 800 and 950, dark and light, in every tab."""
    for theme in ("dark", "light"):
        if theme == "light":
            seen.label("Dark")
        for tab in ("Signals", "Timing", "Events", "Plan", "Jog", "Scene", "Trajectories"):
            seen.tab(tab)
            for height in (800, 950):
                seen.page.set_viewport_size({"width": 1280, "height": height})
                seen.page.wait_for_timeout(300)
                assert seen.cut_texts() == [], f"{tab}, {theme}, {height}"
            if tab in ("Plan", "Timing"):
                picture(seen, f"{tab.lower()}_{theme}")


def test_the_panel_ends_its_kernel_and_leaves_nothing(running: PanelProcess) -> None:
    """By Ctrl-C; the last test here."""
    assert running.close() == 0
    assert not list(Path("/dev/shm").glob(f"sjerk-{running.name}*"))
