"""The panel in a real browser: what a person does, what they see, and who dies.

Pictures of it are made here, for the documentation: ``SJERK_PICTURES`` is the folder.
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from playwright.sync_api import Browser
from pyarrow import parquet

from helpers import panel_judge, panel_urdf
from helpers.panel_bench import PANDA, RANGES, SETTINGS
from helpers.panel_client import Client, PanelProcess, panel, until
from helpers.panel_page import PICTURES, Seen, at_rest, needs_browser
from sjerk import Monitor, Recorder
from sjerk.ports.panel.experiment import in_unit
from sjerk.trajectory import read_recording, shipped_recording

TABS = ("Signals", "Timing", "Events", "Plan", "Jog", "Scene", "Trajectories", "Demo")

pytestmark = needs_browser


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


@pytest.fixture(scope="module")
def pages(browser: Browser) -> Iterator[list[Seen]]:
    """The page that leads, opened once: a new one takes longer than most tests."""
    kept: list[Seen] = []
    yield kept
    for one in kept:
        one.page.close()


@pytest.fixture
def seen(
    request: pytest.FixtureRequest, browser: Browser, running: PanelProcess, pages: list[Seen]
) -> Iterator[Seen]:
    """A page that leads; a fresh one after a test that failed."""
    if not pages:
        pages.append(Seen(browser, running.lead))
    one, failed = pages[0], request.session.testsfailed
    yield one
    if request.session.testsfailed != failed or one.faults or one.page.is_closed():
        pages.clear()
        one.page.close()
    assert one.faults == []


def rests(seen: Seen, monitor: Monitor) -> None:
    """Wait until nothing moves."""
    seen.until(lambda: at_rest(monitor), "at rest")


def arrives(seen: Seen, monitor: Monitor, name: str) -> None:
    """Go to a pose, to the last bit."""
    goal = list(SETTINGS.poses[name])
    if [axis.position for axis in monitor.feedback().axes] != goal:
        seen.pose(name)
        assert seen.over("Plan & Execute") == "on the goal"
        rests(seen, monitor)
    assert [axis.position for axis in monitor.feedback().axes] == goal


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
    seen.picture("planned")
    seen.press("Execute", "in motion|on the goal")
    seen.picture("motion")
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
    seen.picture("collides")
    seen.press("Execute all the same", "click again")
    assert not monitor.feedback().moving
    seen.press("Really: it collides", "in motion")
    seen.press("STOP")
    rests(seen, monitor)
    seen.tab("Events")
    seen.until(lambda: "a plan that collides" in seen.text(".sjerk-events"), "the event")
    seen.picture("events")
    seen.pose("left")  # out of it, the way that it came
    if "COLLIDES" in seen.press("Plan", "s through"):
        seen.press("Execute all the same", "click again")
        seen.over("Really: it collides")
    else:
        seen.over("Execute")
    rests(seen, monitor)
    assert monitor.feedback().axes[0].position == 0.9
    seen.label("Avoid collisions")


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
    other = Client(running.lead)
    other.order("Take the lead", " leads")
    assert re.fullmatch(r"browser \d+ leads", other.said)
    there = monitor.feedback().axes[0].position
    seen.pose("left" if there < 0.5 else "ready")
    seen.press("Plan & Execute")
    seen.until(lambda: monitor.feedback().moving, "motion")
    viewer.press("STOP", "halt")
    rests(seen, monitor)
    viewer.picture("viewer")
    other.close()
    viewer.page.close()


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
    browser: Browser, running: PanelProcess, monitor: Monitor, pages: list[Seen]
) -> None:
    """Let go, another window in front, a page in an endless loop, a page that is closed."""
    for one in pages:
        one.give_back()
    seen = Seen(browser, running.lead)
    seen.lead()
    seen.tab("Jog")
    for number, case in enumerate(["released", *LETS_GO, "closed"]):
        sign = "−" if number % 2 else "+"
        seen.hold(f"panda_joint1 {sign}", lambda: monitor.feedback().moving, f"moves: {case}")
        if case == "released":
            seen.picture("jog", held=True)
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


SCENE = """() => {
    const nodes = window.__viserMutable.nodeRefFromName, found = [];
    let name = '/robot';
    for (let i = 1; i <= 7; i++) {
        name += '/' + i;
        const q = nodes[name].quaternion;
        found.push([q.w, q.x, q.y, q.z]);
    }
    return found;
}"""


def angle(number: int, wxyz: list[float]) -> float:
    """Of a joint, by the rotation of its frame: Rx(alpha) Rz(theta)."""
    alpha = -panel_judge.PANDA[number][2]
    w, x, y, z = wxyz
    c, s = math.cos(alpha / 2), math.sin(alpha / 2)
    w, x, y, z = c * w - s * x, c * x + s * w, c * y - s * z, c * z + s * y
    assert abs(x) + abs(y) < 1e-5  # it turns about its own axis
    return math.remainder(2.0 * math.atan2(z, w), 2.0 * math.pi)


def test_the_arm_in_the_scene_stands_as_the_kernel_says_while_it_moves(
    seen: Seen, monitor: Monitor, running: PanelProcess
) -> None:
    """All angles of one look are those of one cycle, within 1e-4 rad, in order."""
    seen.lead()
    looks: list[Any] = []
    with Recorder(running.name, None) as recorder:
        seen.pose("ready" if monitor.feedback().axes[0].position > 0.5 else "left")
        seen.press("Plan", "s through")
        seen.press("Execute", "in motion|on the goal")
        while not at_rest(monitor) or len(looks) < 5:
            looks.append(seen.page.evaluate(SCENE))
            seen.page.wait_for_timeout(20)
    actual = recorder.recording.actual_position
    cycles = [0]
    for look in looks:
        shown = np.array([angle(i, row) for i, row in enumerate(look)])
        same = np.flatnonzero(np.abs(actual - shown).max(axis=1) < 1e-4)
        later = same[same >= cycles[-1]]
        assert len(later), look
        cycles.append(int(later[0]))
    assert len(set(cycles)) > 5


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
    assert "succeeded" in seen.over("Play")
    seen.picture("trajectories")


def test_speed_now_acts_in_motion(seen: Seen, monitor: Monitor) -> None:
    """0: at rest on the path; 2: on, and to the goal."""
    seen.lead()
    arrives(seen, monitor, "ready")
    seen.pose("left")
    seen.press("Plan", "s through")
    seen.press("Execute", "in motion|on the goal")
    seen.slide("Speed now", "Home")
    seen.until(lambda: monitor.feedback().path.speed == 0.0, "the speed is asked for")
    rests(seen, monitor)
    at = monitor.feedback().axes[0].position
    assert 0.0 < at < 0.9
    seen.slide("Speed now", "End")
    seen.until(lambda: monitor.feedback().axes[0].position > at, "goes on")
    rests(seen, monitor)
    seen.fill("Speed now", 1)
    arrives(seen, monitor, "left")


def test_the_flange_is_brought_to_a_place(seen: Seen, monitor: Monitor) -> None:
    """By its coordinates; the table shows them once it is there."""
    seen.lead()
    arrives(seen, monitor, "ready")
    seen.label("Flange")
    seen.fill("at [m]", 0.35, 0.2, 0.6)
    seen.press("Set goal to flange pose", "these angles bring")
    seen.label("Flange")
    assert seen.over("Plan & Execute") == "on the goal"
    rests(seen, monitor)
    axes = monitor.feedback().axes
    at = panel_judge.tip([axis.position for axis in axes])
    assert np.abs(at - [0.35, 0.2, 0.6]).max() < 1e-3
    seen.until(lambda: "flange +0.350" in seen.text("#sjerk-axes"), "the place")


@pytest.fixture
def scene_kept(request: pytest.FixtureRequest, seen: Seen, running: PanelProcess) -> Iterator[None]:
    """After a test that failed its wall goes all the same: no other test plans around it."""
    failed = request.session.testsfailed
    yield
    if request.session.testsfailed != failed:
        seen.page.close()
        tidy = Client(running.lead)
        tidy.order("Take the lead", "this browser leads")
        tidy.set("Name", "wall", nth=1)
        tidy.order("Remove", "wall")
        tidy.close()


@pytest.mark.usefixtures("scene_kept")
def test_a_shape_is_added_and_voids_the_plan(seen: Seen, monitor: Monitor) -> None:
    """A wall in the way: what was planned before is refused, the goal turns red; then it goes."""
    seen.lead()
    arrives(seen, monitor, "ready")
    seen.pose("left")
    seen.press("Plan", "s through")
    seen.tab("Scene")
    seen.choose("Shape", "(new)")
    seen.fill("Name", "wall")
    seen.fill("Size [m]", 0.05, 0.6, 0.8)
    seen.fill("Place [m]", 0.31, 0.4, 0.4)
    seen.press("Add or change", "wall is in the scene")
    seen.picture("scene")
    seen.tab("Plan")
    seen.press("Execute", "the scene has changed since")
    assert not monitor.feedback().moving
    seen.until(lambda: "touches wall" in seen.text("body"), "the goal is red")
    seen.tab("Scene")
    seen.press("Remove", "wall is removed")
    seen.tab("Plan")
    seen.until(lambda: "touches wall" not in seen.text("body"), "the goal is free")


def test_the_demo_is_played_in_the_page(seen: Seen, monitor: Monitor) -> None:
    """The paper's Figures 6 and 7: to the last bit, within its velocity; STOP ends it."""
    seen.lead()
    arrives(seen, monitor, "ready")
    end = float(in_unit(read_recording(shipped_recording()), "rad").position[-1])

    def begin() -> None:
        seen.tab("Demo")
        seen.press("Play the demo", "demo is in motion")

    def ended() -> str:
        seen.until(lambda: re.search("demo (is at its end|has ended)", seen.said), "the end")
        rests(seen, monitor)
        return seen.said

    begin()
    seen.until(lambda: monitor.feedback().axes[0].position > 0.3, "on its way")
    seen.press("STOP")
    assert "has ended" in ended()
    assert monitor.feedback().axes[0].position < end
    assert "bring it there first" in seen.press("Play the demo", ".")
    seen.tab("Plan")
    arrives(seen, monitor, "ready")
    begin()
    if PICTURES:
        seen.until(lambda: monitor.feedback().axes[0].position > 1.5, "on its way")
        seen.picture("demo_motion")
    assert "at its end" in ended()
    assert monitor.feedback().axes[0].position == end
    shares = re.search(r"velocity ([\d.]+) %", seen.text(".sjerk-demo"))
    assert shares is not None
    assert 10.0 < float(shares.group(1)) <= 100.0
    seen.picture("demo")


def saved(seen: Seen, kind: str, folder: Path) -> dict[str, list[float]]:
    """What the browser is given by a button, by columns."""
    with seen.page.expect_download() as waiting:
        seen.label(kind)
    file = folder / waiting.value.suggested_filename
    waiting.value.save_as(file)
    if kind == "Parquet":
        return parquet.read_table(file).to_pydict()
    head, *rows = file.read_text().splitlines()
    columns = zip(*([float(word) for word in row.split(",")] for row in rows), strict=True)
    return dict(zip(head.split(","), map(list, columns), strict=True))


def test_what_is_frozen_is_saved_as_it_is_seen(seen: Seen, tmp_path: Path) -> None:
    """The same cycles again and again, all of them, in both formats; then fewer of them."""
    seen.lead()
    seen.label("Freeze")
    first = saved(seen, "CSV", tmp_path)
    assert len(first["cycle"]) > 500
    assert len(first) == 2 + 7
    assert saved(seen, "CSV", tmp_path) == first
    assert saved(seen, "Parquet", tmp_path) == first
    seen.fill("Seconds", -2)
    fewer = saved(seen, "CSV", tmp_path)
    assert fewer["cycle"] == first["cycle"][-len(fewer["cycle"]) :]
    assert len(fewer["cycle"]) < len(first["cycle"])
    seen.picture("signals")
    seen.fill("Seconds", -8)
    seen.label("Go on")
    assert saved(seen, "CSV", tmp_path)["cycle"][-1] > first["cycle"][-1]


def test_timing_is_counted_from_now(seen: Seen) -> None:
    """In this page; its plots are drawn from the first cycle on."""

    def counted() -> int:
        where = "() => document.querySelector('.sjerk-times')?.dataset.count ?? -1"
        return int(seen.page.evaluate(where))

    seen.tab("Timing")
    seen.until(lambda: counted() > 2000, "cycles")
    before = counted()
    seen.press("Count from now")
    seen.until(lambda: 0 <= counted() < before, "from now")
    now = counted()
    seen.until(lambda: counted() > now, "on")
    seen.tab("Signals")


def test_a_robot_of_ones_own_is_seen_by_its_urdf(running: PanelProcess, tmp_path: Path) -> None:
    """A second panel on the same kernel: its meshes, in frames that turn as the kernel says."""
    box = trimesh.creation.box((0.1, 0.1, 0.3))
    box.export(tmp_path / "box.dae")
    (tmp_path / "panda.urdf").write_text(panel_urdf.panda("<mesh filename='box.dae'/>", "visual"))
    (tmp_path / "robot.toml").write_text(PANDA.read_text())
    with panel("robot.toml", "--urdf", "panda.urdf", name=running.name, folder=tmp_path) as process:
        assert process.links["it was"] == "found running"
        client = Client(process.view)
        shapes = until(
            lambda: [n for n in client.nodes if re.fullmatch(r"/robot(/\d)*/shape\d", n)], "shapes"
        )
        until(
            lambda: len([n for n in client.nodes if n.startswith("/robot") and "shape" in n]) == 8,
            "8",
        )
        assert shapes
        client.close()


def test_no_text_is_cut(seen: Seen) -> None:
    """At 1280 x 800 and 950, dark and light, in every tab: not by its place, nor by a neighbour."""
    for height in (800, 950):
        seen.page.set_viewport_size({"width": 1280, "height": height})
        for theme in ("dark", "light"):
            for tab in TABS:
                seen.tab(tab)
                seen.page.wait_for_timeout(100)
                assert seen.cut_texts() == [], f"{tab}, {theme}, {height}"
                if tab in ("Plan", "Jog", "Timing"):
                    seen.picture(f"{tab.lower()}_{theme}_{height}")
            seen.label("Dark")


def test_the_panel_ends_its_kernel_and_leaves_nothing(
    running: PanelProcess, pages: list[Seen]
) -> None:
    """By Ctrl-C; the last test here."""
    while pages:
        pages.pop().page.close()
    assert running.close() == 0
    assert not list(Path("/dev/shm").glob(f"sjerk-{running.name}*"))
