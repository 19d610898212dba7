"""Who is lost, and what the panel does then: a browser is frozen or killed, a kernel ends.

Judged by the kernel's own trace of every cycle. The arm that is seen is judged there, too.
"""

from __future__ import annotations

import math
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser

from helpers import panel_judge as judge
from helpers.panel_bench import PANDA, RANGES, ROBOT
from helpers.panel_client import PATIENCE, Client, PanelProcess, panel, until
from helpers.panel_page import PROGRAM, Seen, at_rest, chromium, mortal
from sjerk import Monitor, Recorder, Recording
from sjerk.errors import HandshakeError

pytestmark = pytest.mark.skipif(not PROGRAM, reason="no chromium, and none by apt")

LAST = 6
#: A pose that is reached by turning the last joint only, for some seconds.
TURNED = np.array([0.0, -0.785398, 0.0, -2.356194, 0.0, 1.570796, -2.7])


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """One for all."""
    with chromium() as one:
        yield one


@pytest.fixture
def running(tmp_path: Path) -> Iterator[PanelProcess]:
    """A panel on a robot of one's own, slower, with one more pose."""
    text = re.sub(r"velocity = [\d.]+", "velocity = 0.5", PANDA.read_text())
    pose = f"[panel.poses]\nturned = {TURNED.tolist()}\n"
    text = text.replace("[panel.poses]\n", pose)
    (tmp_path / "robot.toml").write_text(text)
    with panel("robot.toml", name=f"loss-{time.time_ns()}", folder=tmp_path) as process:
        yield process


def within_limits(recording: Recording) -> None:
    """Every commanded sample of all axes; no cycle is missing."""
    assert recording.gaps == ()
    for i, axis in enumerate(ROBOT.axes):
        for name in ("velocity", "acceleration", "jerk"):
            most = float(np.abs(getattr(recording, name)[:, i]).max())
            assert most <= getattr(axis.limits, name) * (1.0 + 1e-6), (name, i)


@pytest.mark.parametrize("death", [signal.SIGSTOP, signal.SIGKILL])
@pytest.mark.parametrize("what", ["jog", "path"])
def test_what_a_browser_started_does_not_outlive_it(
    browser: Browser, running: PanelProcess, what: str, death: signal.Signals
) -> None:
    """All its processes at once: at rest by the kernel's own halt, and the lead is free."""
    with Monitor.attach(running.name) as monitor, mortal(browser) as (doomed, die):
        seen = Seen(doomed, running.lead)
        seen.lead()
        goal = float(RANGES[LAST][0])
        if what == "path":
            goal = float(TURNED[LAST])
            seen.pose("turned")
            seen.press("Plan", "through 2 points")
        with Recorder(running.name, None) as recorder:
            if what == "path":
                seen.press("Execute", "in motion")
                until(lambda: monitor.feedback().moving, "moves")
            else:
                seen.tab("Jog")
                seen.hold("panda_joint7 −", lambda: monitor.feedback().moving, "moves")
            assert die(death) > 1
            until(lambda: at_rest(monitor), "at rest")
            until(lambda: monitor.host_pid is None, "the lead is free")
        rest = monitor.feedback().axes[LAST].position
        assert rest > goal + 0.05
        recording = recorder.recording
        within_limits(recording)
        moved = recording.position - recording.position[0]
        way = TURNED - recording.position[0] if what == "path" else -np.eye(len(TURNED))[LAST]
        share = moved @ way / (way @ way)
        assert np.abs(moved - share[:, None] * way).max() < 1e-9  # on the path
        assert (np.diff(share) >= -1e-12).all()  # and never back
    later = Client(running.lead)
    later.order("Take the lead", "this browser leads")
    later.told("leads no longer")
    later.close()


def kernel_process(name: str, folder: Path) -> subprocess.Popen[bytes]:
    """``sjerk kernel`` on the shipped robot."""
    words = ["kernel", str(PANDA), "--name", name]
    command = [sys.executable, "-m", "sjerk", *words]
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL)

    def attached() -> bool:
        try:
            Monitor.attach(name).close()
        except HandshakeError:
            return False
        return True

    until(attached, "a kernel")
    return process


@pytest.mark.parametrize("death", [signal.SIGTERM, signal.SIGKILL])
def test_a_kernel_that_ends_is_told_and_one_that_comes_is_taken_without_a_lead(
    browser: Browser, tmp_path: Path, death: signal.Signals
) -> None:
    """In the same page; what is ordered meanwhile is refused."""
    name = f"again-{time.time_ns()}"
    kernel = kernel_process(name, tmp_path)
    try:
        with panel(name=name, folder=tmp_path) as process:
            seen = Seen(browser, process.lead)
            seen.lead()
            kernel.send_signal(death)
            kernel.wait(PATIENCE)
            seen.until(lambda: "cycle" not in seen.text("#sjerk-first"), "the page says so")
            assert name in seen.text("#sjerk-first")
            seen.until(lambda: seen.button("Take the lead").count(), "nobody leads")
            seen.press("STOP", "no kernel runs")
            kernel = kernel_process(name, tmp_path)
            seen.until(lambda: "cycle" in seen.text("#sjerk-first"), "the new one is seen")
            assert "nobody" in seen.text("#sjerk-first")
            seen.lead()
            seen.tab("Jog")
            with Monitor.attach(name) as monitor:
                seen.hold("panda_joint7 −", lambda: monitor.feedback().moving, "moves")
                seen.page.mouse.up()
                until(lambda: at_rest(monitor), "at rest")
            seen.page.close()
    finally:
        kernel.terminate()
        kernel.wait(PATIENCE)


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
    alpha = -judge.PANDA[number][2]
    w, x, y, z = wxyz
    c, s = math.cos(alpha / 2), math.sin(alpha / 2)
    w, x, y, z = c * w - s * x, c * x + s * w, c * y - s * z, c * z + s * y
    assert abs(x) + abs(y) < 1e-5  # it turns about its own axis
    return math.remainder(2.0 * math.atan2(z, w), 2.0 * math.pi)


def test_the_arm_in_the_scene_stands_as_the_kernel_says_while_it_moves(
    browser: Browser, running: PanelProcess
) -> None:
    """All angles of one look are those of one cycle, within 1e-4 rad, in order."""
    seen = Seen(browser, running.lead)
    seen.lead()
    seen.pose("left")
    seen.press("Plan", "s through")
    looks = []
    with Monitor.attach(running.name) as monitor, Recorder(running.name, None) as recorder:
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
    seen.page.close()
