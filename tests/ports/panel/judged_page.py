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

from helpers.panel_bench import PANDA, SETTINGS
from helpers.panel_client import PanelProcess, panel
from helpers.panel_page import PROGRAM, Seen, chromium
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
    with panel("robot.toml", name=f"page-{time.time_ns()}", folder=folder) as process:
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
    seen.until(lambda: not monitor.feedback().moving, "at rest")


def pose(seen: Seen, name: str) -> None:
    """Make a pose the goal."""
    if not seen.page.get_by_text("To goal", exact=True).locator("visible=true").count():
        seen.label("Poses")
    seen.choose("Pose", name)
    seen.label("Set goal")


def arrives(seen: Seen, monitor: Monitor, name: str) -> None:
    """Go to a pose, to the last bit; again where a busy machine made the kernel halt on the way."""
    goal = list(SETTINGS.poses[name])

    def there() -> bool:
        return [axis.position for axis in monitor.feedback().axes] == goal

    def over() -> bool:
        return there() or (not monitor.feedback().moving and "stopped" in seen.said)

    for _ in range(10):
        if there():
            break
        pose(seen, name)
        seen.press("Plan & Execute")
        seen.until(lambda: "through" in seen.said or "motion" in seen.said, "planned")
        seen.until(over, "arrives")
    assert there()
    rests(seen, monitor)


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
    pose(seen, "left")
    seen.press("Plan", "s through")
    picture(seen, "planned")
    seen.press("Execute", "in motion")
    seen.until(lambda: monitor.feedback().moving, "motion")
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
    pose(seen, "right")
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
    pose(seen, "left")
    for _ in range(10):  # out of it, the way that it came
        if monitor.feedback().axes[0].position == 0.9:
            break
        seen.press("Plan", "COLLIDES")
        seen.press("Execute all the same", "click again")
        seen.press("Really: it collides", "in motion")
        rests(seen, monitor)
    seen.tab("Scene")
    picture(seen, "scene")
    seen.tab("Signals")


def test_hold_to_run_and_speed(seen: Seen, monitor: Monitor) -> None:
    """Rests on the path when let go, and goes on when pressed again."""
    seen.lead()
    arrives(seen, monitor, "ready")
    pose(seen, "left")
    seen.press("Plan", "s through")
    button = seen.button("Hold to run")
    button.scroll_into_view_if_needed()
    box = button.bounding_box()
    assert box is not None
    seen.page.mouse.move(box["x"] + 40, box["y"] + 8)
    seen.page.mouse.down()
    seen.until(lambda: monitor.feedback().path.state.name == "RUNS", "runs")
    seen.page.mouse.up()
    seen.until(lambda: monitor.feedback().path.state.name == "PAUSED", "rests on the path")
    at = monitor.feedback().axes[0].position
    seen.page.mouse.down()
    seen.until(lambda: monitor.feedback().axes[0].position != at, "goes on")
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
    pose(seen, "left" if there < 0.5 else "ready")
    seen.press("Plan & Execute")
    seen.until(lambda: monitor.feedback().moving, "motion")
    viewer.press("STOP", "halt")
    rests(seen, monitor)
    picture(viewer, "viewer")
    for one in (viewer, other):
        one.page.close()


def pressed(seen: Seen, monitor: Monitor) -> None:
    """Jog: press a button until the axis moves."""
    seen.tab("Jog")
    button = seen.button("panda_joint1 +")
    button.scroll_into_view_if_needed()
    picture(seen, "jog")
    box = button.bounding_box()
    assert box is not None
    seen.page.mouse.move(box["x"] + 40, box["y"] + 8)

    def moves() -> bool:
        seen.page.mouse.down()
        end = time.monotonic() + 2.0
        while time.monotonic() < end:
            if monitor.feedback().moving:
                return True
            seen.page.wait_for_timeout(20)
        seen.page.mouse.up()
        return False

    seen.until(moves, "moves")


@pytest.mark.parametrize("case", ["released", "blur", "hidden", "loop", "closed"])
def test_a_jog_ends_with_its_hand(
    browser: Browser, running: PanelProcess, monitor: Monitor, case: str
) -> None:
    """Let go, another window in front, a page in an endless loop, a page that is closed."""
    seen = Seen(browser, running.lead)
    seen.lead()
    pressed(seen, monitor)
    if case == "released":
        seen.page.mouse.up()
    elif case == "blur":
        seen.page.evaluate("() => dispatchEvent(new Event('blur'))")
    elif case == "hidden":
        seen.page.evaluate(
            "() => { Object.defineProperty(document, 'hidden', {value: true});"
            " document.dispatchEvent(new Event('visibilitychange')); }"
        )
    elif case == "loop":
        seen.page.evaluate(
            "() => setTimeout(() => { const end = Date.now() + 4000; while (Date.now() < end); })"
        )
    else:
        seen.page.close()
    end = time.monotonic() + 30
    while monitor.feedback().moving:
        assert time.monotonic() < end
        time.sleep(0.02)
    if case != "closed":
        seen.page.close()


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
    seen.press("Play", "in motion")
    seen.until(lambda: "succeeded" in seen.said.lower() or "aborted" in seen.said, "played")
    picture(seen, "trajectories")


def test_no_text_is_cut(browser: Browser, running: PanelProcess) -> None:
    """At 1280 x 800 and 950, dark and light, in every tab."""
    for height in (800, 950):
        seen = Seen(browser, running.lead, height=height)
        for theme in ("dark", "light"):
            if theme == "light":
                seen.label("Dark")
            for tab in ("Signals", "Timing", "Events", "Plan", "Jog", "Scene", "Trajectories"):
                seen.tab(tab)
                seen.page.wait_for_timeout(400)
                assert seen.cut_texts() == [], f"{tab}, {theme}, {height}"
                if tab == "Timing" and height == 950:
                    picture(seen, f"timing_{theme}")
        seen.page.close()


def test_the_panel_ends_its_kernel_and_leaves_nothing(running: PanelProcess) -> None:
    """By Ctrl-C; the last test here."""
    assert running.close() == 0
    assert not list(Path("/dev/shm").glob(f"sjerk-{running.name}*"))
