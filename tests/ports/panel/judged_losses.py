"""Who is lost, and what the panel does then: a browser is frozen or killed, a kernel ends.

Judged by the kernel's own trace of every cycle. The arm that is seen is judged there, too.
"""

from __future__ import annotations

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

from helpers.panel_bench import PANDA, ROBOT
from helpers.panel_client import PATIENCE, Client, PanelProcess, panel, until
from helpers.panel_page import Seen, at_rest, mortal, needs_browser
from sjerk import Monitor, Recorder, Recording
from sjerk.errors import SjerkError

LAST = 6
#: A pose that is reached by turning the last joint only, for some seconds.
TURNED = np.array([0.0, -0.785398, 0.0, -2.356194, 0.0, 1.570796, -2.7])


def slower(folder: Path) -> None:
    """A robot of one's own in a folder, slower, with one more pose."""
    text = re.sub(r"velocity = [\d.]+", "velocity = 0.5", PANDA.read_text())
    back = [*TURNED[:LAST].tolist(), -float(TURNED[LAST])]
    pose = f"[panel.poses]\nturned = {TURNED.tolist()}\nback = {back}\n"
    text = text.replace("[panel.poses]\n", pose)
    (folder / "robot.toml").write_text(text)


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PanelProcess]:
    """A panel, and the kernel that it has started."""
    folder = tmp_path_factory.mktemp("loss")
    slower(folder)
    with panel("robot.toml", name=f"loss-{time.time_ns()}", folder=folder) as process:
        yield process


def within_limits(recording: Recording) -> None:
    """Every commanded sample of all axes; no cycle is missing."""
    assert recording.gaps == ()
    for i, axis in enumerate(ROBOT.axes):
        for name in ("velocity", "acceleration", "jerk"):
            most = float(np.abs(getattr(recording, name)[:, i]).max())
            assert most <= getattr(axis.limits, name) * (1.0 + 1e-6), (name, i)


def away(at: float) -> float:
    """The last joint's end of the way to go, on the other side."""
    return -abs(float(TURNED[LAST])) if at > 0.0 else abs(float(TURNED[LAST]))


def moves(seen: Seen, monitor: Monitor) -> bool:
    """Plan and execute; a panel without a processor for half a second is halted by the kernel."""
    seen.press("Plan", "through 2 points")
    seen.press("Execute", ".")
    end = time.monotonic() + 3.0
    while time.monotonic() < end:
        if monitor.feedback().moving:
            return True
        time.sleep(0.01)
    return False


def judged(recording: Recording, what: str, goal: float) -> None:
    """At rest before the goal, on the path and never back on it, within limits."""
    within_limits(recording)
    assert abs(recording.position[-1, LAST] - goal) > 0.05
    start = recording.position[0]
    moved = recording.position - start
    way = np.eye(len(TURNED))[LAST] * (goal - start[LAST])
    if what == "path":
        way = TURNED * 1.0
        way[LAST] = goal
        way -= start
    share = moved @ way / (way @ way)
    assert np.abs(moved - share[:, None] * way).max() < 1e-9
    assert (np.diff(share) >= -1e-12).all()
    assert (recording.velocity[-1] == 0.0).all()


@needs_browser
@pytest.mark.parametrize("death", [signal.SIGSTOP, signal.SIGKILL])
@pytest.mark.parametrize("what", ["jog", "path"])
def test_what_a_browser_started_does_not_outlive_it(
    browser: Browser, running: PanelProcess, what: str, death: signal.Signals
) -> None:
    """All its processes at once: at rest by the kernel's own halt, and the lead is free."""
    with Monitor.attach(running.name) as monitor, mortal(browser) as (doomed, die):
        seen = Seen(doomed, running.lead)
        seen.lead()
        goal = away(monitor.feedback().axes[LAST].position)
        if what == "path":
            seen.pose("turned" if goal < 0.0 else "back")
        with Recorder(running.name, None) as recorder:
            if what == "path":
                until(lambda: moves(seen, monitor), "moves")
            else:
                seen.tab("Jog")
                sign = "−" if goal < 0.0 else "+"
                seen.hold(f"panda_joint7 {sign}", lambda: monitor.feedback().moving, "moves")
            assert die(death) > 1
            until(lambda: at_rest(monitor), "at rest")
            until(lambda: monitor.host_pid is None, "the lead is free")
        judged(recorder.recording, what, goal)
    later = Client(running.lead)
    later.order("Take the lead", "this browser leads")
    later.told("leads no longer")
    later.close()


def kernel_process(name: str, folder: Path, robot: Path = PANDA) -> subprocess.Popen[bytes]:
    """``sjerk kernel`` on a robot, the shipped one where none is named."""
    words = ["kernel", str(robot), "--name", name]
    command = [sys.executable, "-m", "sjerk", *words]
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL)

    def attached() -> bool:
        try:
            Monitor.attach(name).close()
        except (SjerkError, TimeoutError):
            return False
        return True

    until(attached, "a kernel")
    return process


@pytest.mark.parametrize("death", [signal.SIGSTOP, signal.SIGKILL])
@pytest.mark.parametrize("what", ["jog", "path"])
def test_what_a_panel_started_does_not_outlive_it(
    tmp_path: Path, what: str, death: signal.Signals
) -> None:
    """It is frozen: the kernel's own watch halts; it is killed: its host is gone."""
    slower(tmp_path)
    name = f"death-{time.time_ns()}"
    kernel = kernel_process(name, tmp_path, tmp_path / "robot.toml")
    process = PanelProcess("robot.toml", name=name, folder=tmp_path)
    try:
        with Monitor.attach(name) as monitor:
            client = Client(process.lead)
            client.order("Take the lead", "this browser leads")
            client.order("Drives", "drives follow", "Enable")
            client.set("Pose", "turned")
            client.set("To goal", "Set goal")

            def begins() -> bool:
                """Again where a busy machine let the hand go, or made the kernel halt."""
                if what == "path":
                    client.click("Plan & Execute")
                end = time.monotonic() + 10.0
                while time.monotonic() < end:
                    if what == "jog":
                        client.hold("panda_joint7 −")
                    time.sleep(0.03)
                    if monitor.feedback().moving:
                        return True
                return False

            with Recorder(name, None) as recorder:
                until(begins, "moves", 120.0)
                process.process.send_signal(death)
                until(lambda: at_rest(monitor), "at rest")
            judged(recorder.recording, what, float(TURNED[LAST]))
    finally:
        process.kill()
        client.close()
        kernel.terminate()
        kernel.wait(PATIENCE)


@needs_browser
def test_a_kernel_that_ends_is_told_and_one_that_comes_is_taken_without_a_lead(
    browser: Browser, tmp_path: Path
) -> None:
    """In the same page, ended or killed; what is ordered meanwhile is refused."""
    name = f"again-{time.time_ns()}"
    kernel = kernel_process(name, tmp_path)
    try:
        with panel(name=name, folder=tmp_path) as process:
            seen = Seen(browser, process.lead)
            for death in (signal.SIGTERM, signal.SIGKILL):
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
            assert seen.faults == []
            seen.page.close()
    finally:
        kernel.terminate()
        kernel.wait(PATIENCE)
