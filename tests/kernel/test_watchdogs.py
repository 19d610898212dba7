"""Watchdogs: each cause with its reaction and its event, in an own loop and with real processes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from sjerk import Axis, DriveConfig, Host, InputError, Limits, MotionKernel, Reactions, SjerkError
from sjerk._binding import lib
from sjerk.cycle.states import AxisState
from sjerk.host import EventKind, Monitor, MoveState
from sjerk.recording import Recorder, Recording, files, replay

T = 1e-3
COUNTS = 2**24 / 360.0
LIMITS = Limits(90.0, 500.0, 5000.0)
FOLLOWS = 0x1237


class Loop:
    """A caller's own loop over external drives that are where they are told to be."""

    def __init__(self, axes: int, record: Path | None = None, **more: object) -> None:
        self.kernel = MotionKernel([Axis(LIMITS, COUNTS, "external")] * axes, T, **more)  # type: ignore[arg-type]
        self.recorder = Recorder(self.kernel, record).__enter__() if record else None
        self.host = self.kernel.host()
        self.silent: set[int] = set()
        self.kernel.image.inputs["statusword"] = FOLLOWS
        self.kernel.image.inputs["mode_display"] = 8
        self.host.enable()
        self.rows: list[list[float]] = []
        self.step(3)

    def step(self, cycles: int = 1) -> None:
        image = self.kernel.image
        for _ in range(cycles):
            for i in range(len(image.stale)):
                image.stale[i] = i in self.silent
                if i not in self.silent:
                    image.inputs["position_actual"][i] = image.outputs["target_position"][i]
            self.kernel.step()
            self.rows.append(self.kernel.positions.tolist())

    def states(self) -> list[AxisState]:
        return [axis.state for axis in self.host.feedback().axes]

    def events(self, kind: EventKind) -> list[tuple[int | None, int]]:
        return [(e.axis, e.code) for e in self.host.events()[0] if e.kind is kind]


def kept(positions: np.ndarray) -> None:
    """No n-th difference exceeds its limit."""
    ulp = np.spacing(np.max(np.abs(positions)))
    for n, limit in enumerate((90.0, 500.0, 5000.0), start=1):
        most = limit * T**n * (1 + 1e-9) + 2**n * ulp
        assert np.max(np.abs(np.diff(positions, n, axis=0))) <= most


def test_a_stale_image_is_a_lost_axis_and_the_others_stop_along_their_ramp() -> None:
    """Its own event, ErrorStop there until a reset, a halt here, and no step when it comes back."""
    loop = Loop(3)
    move = loop.host.move([60.0, 50.0, -40.0])
    loop.step(400)
    loop.silent = {1}
    lost = loop.kernel.image.outputs["target_position"][1]
    loop.step(800)
    # it may still hear us: its quick stop, and no step back to where it was seen last
    assert not loop.kernel.image.outputs["controlword"][1] & 0x0004
    assert loop.states()[1] is AxisState.ERROR_STOP
    assert loop.events(EventKind.SYNC) == [(1, 0)]
    assert move.state is MoveState.STOPPED
    assert not loop.host.feedback().moving
    kept(np.array(loop.rows)[:, [0, 2]])
    assert loop.kernel.image.outputs["target_position"][1] == lost
    refused = loop.host.move({1: 0.0})
    loop.silent = set()
    loop.step(5)
    assert refused.state is MoveState.REFUSED
    assert loop.states()[1] is AxisState.ERROR_STOP  # there again, but nobody has asked
    loop.host.reset()
    loop.step(3)
    assert loop.states() == [AxisState.STANDSTILL] * 3
    assert loop.kernel.image.outputs["target_position"][1] == lost
    again = loop.host.move([0.0, 0.0, 0.0])
    loop.step(4000)
    assert again.done


def test_a_lost_axis_is_in_the_recording_and_comes_out_again(tmp_path: Path) -> None:
    """Staleness is an input of the cycle as the image is: the replay is the same bit for bit."""
    path = tmp_path / "lost.parquet"
    files.ready(path)
    loop = Loop(2, path)
    assert loop.recorder is not None
    loop.host.move([60.0, 50.0])
    loop.step(300)
    loop.silent = {1}
    loop.step(700)
    loop.recorder.__exit__()
    found = Recording.open(path)
    assert [e.axis for e in found.events if e.kind is EventKind.SYNC] == [1]
    done = replay(found)
    assert done.cycles == len(found) == 1003
    assert done.identical, done.difference


@pytest.mark.parametrize(("reaction", "moves"), [("none", True), ("halt", False)])
def test_what_follows_a_lost_sync_is_as_set(reaction: str, moves: bool) -> None:
    """The others go on, or stop; a lost sync is no drive fault, whose reaction is another."""
    other = "halt" if reaction == "none" else "none"
    loop = Loop(2, reactions=Reactions(sync_lost=reaction, drive_fault=other))  # type: ignore[arg-type]
    loop.host.move([60.0, 50.0], synchronization="none")
    loop.step(300)
    loop.silent = {1}
    loop.step(3000)
    assert (loop.host.feedback().axes[0].position == 60.0) == moves


@pytest.mark.parametrize(
    ("code", "kind"),
    [(0x8130, "SYNC"), (0x8700, "SYNC"), (0x8611, "FAULT"), (0x2310, "FAULT")],
)
def test_a_drive_tells_why_it_faulted(code: int, kind: str) -> None:
    """603Fh of communication and synchronisation is a lost sync, any other a fault."""
    loop = Loop(2)
    loop.host.move([60.0, 50.0])
    loop.step(200)
    inputs = loop.kernel.image.inputs
    inputs["statusword"][1], inputs["error_code"][1] = 0x0218, code
    loop.step(10)
    events, _ = loop.host.events()
    told = [(e.kind.name, e.axis, e.code) for e in events if e.kind.name in ("SYNC", "FAULT")]
    assert told == [(kind, 1, code)]


def test_the_simulated_drive_that_misses_its_sync_is_lost() -> None:
    """8700h of the drive itself, by its own supervision."""
    axis = Axis(LIMITS, COUNTS, DriveConfig(sync_extrapolation=0, sync_error_limit=3))
    kernel = MotionKernel([axis] * 2, T)
    host = kernel.host()
    host.enable()
    kernel.step(10)
    host.move([60.0, 50.0])
    kernel.step(200)
    kernel.image.outputs["sync_missed"][1] = 1
    kernel.step(400)
    events, _ = host.events()
    assert [(e.axis, e.code) for e in events if e.kind is EventKind.SYNC] == [(1, 0x8700)]
    assert not host.feedback().moving


def test_a_drive_at_its_own_limit_is_anchored_and_no_step_follows() -> None:
    """Held at 607Dh (bit 11, bit 12 = 0) the command is where the drive is, at rest."""
    stop = round(5.0 * COUNTS)
    drive = DriveConfig(software_min=-stop, software_max=stop)
    kernel = MotionKernel([Axis(LIMITS, COUNTS, drive)], T)
    host = kernel.host()
    host.enable()
    kernel.step(10)
    move = host.move(20.0)
    targets = []
    for _ in range(2000):
        kernel.step()
        targets.append(host.feedback().axes[0].target_counts)
    at = host.feedback().axes[0]
    assert move.state is MoveState.STOPPED
    assert EventKind.ANCHOR in {e.kind for e in host.events()[0]}
    assert 4.5 < at.position <= 5.0
    assert abs(at.target_counts - at.actual_counts) <= 0.1 * COUNTS
    assert max(targets) <= stop + 0.1 * COUNTS


# ---- processes -----------------------------------------------------------------------------------


def until(met: object, what: str, seconds: float = 30.0) -> None:
    end = time.monotonic() + seconds
    while not met():  # type: ignore[operator]
        assert time.monotonic() < end, what
        time.sleep(1e-3)


def moving(host: Host) -> None:
    host.link.wait_until(lambda frame: abs(frame.axis[0].velocity) > 0.02, 30.0, "some speed")


def test_a_silent_host_is_noticed_only_if_it_asked_for_it() -> None:
    """Halt and event while it says nothing; its next word counts again."""
    with (
        MotionKernel([Axis(LIMITS, COUNTS)], T) as kernel,
        kernel.host() as host,
        Monitor.attach(kernel.name) as monitor,
    ):
        host.enable()
        host.move(20.0)
        until(lambda: monitor.feedback().axes[0].settled, "a silent host that did not ask")
        move = host.move(170.0)
        host.watch(0.1)
        moving(host)
        until(lambda: not monitor.feedback().moving, "the halt")
        told = [e.code for e in monitor.events()[0] if e.kind is EventKind.HOST]
        assert told[-1] == lib.SJ_HOST_SILENT
        assert 20.0 < monitor.feedback().axes[0].position < 170.0
        assert move.state is MoveState.STOPPED
        host.move(21.0).wait(30.0)
        host.watch(None)
        host.move(25.0)
        until(lambda: monitor.feedback().axes[0].position == 25.0, "no longer watched")
        with pytest.raises(InputError, match="timeout"):
            host.watch(0.0)
    own = MotionKernel([Axis(LIMITS, COUNTS)], T)
    with pytest.raises(SjerkError, match="own loop"):
        own.host().watch(1.0)


@pytest.mark.parametrize(("reaction", "goes_on"), [("none", True), ("halt", False)])
def test_an_overrun_is_answered_as_set(reaction: str, goes_on: bool) -> None:
    """The kernel's process suspended for cycles in mid-motion: counted, told, halted if asked."""
    # a busy machine makes overruns of its own: where they halt, only the end counts
    reactions = Reactions(overrun=reaction)  # type: ignore[arg-type]
    with (
        MotionKernel([Axis(LIMITS, COUNTS)], T, reactions=reactions) as kernel,
        kernel.host() as host,
    ):
        host.enable()
        move = host.move(100.0)
        move.accepted()
        assert kernel.pid is not None
        os.kill(kernel.pid, signal.SIGSTOP)
        os.waitid(os.P_PID, kernel.pid, os.WSTOPPED)
        stopped = lib.sj_clock_now_ns()
        while lib.sj_clock_now_ns() < stopped + 20e6:
            os.sched_yield()
        os.kill(kernel.pid, signal.SIGCONT)
        rest = AxisState.STANDSTILL
        host.link.wait_until(lambda frame: frame.axis[0].state == rest, 30.0, "an end")
        events, _ = host.events()
        late = [e for e in events if e.kind is EventKind.LATE]
        assert max(e.value for e in late) >= 10
        assert (move.state is MoveState.DONE) == goes_on


FILE = """
cycle_time = 1e-3
[[axes]]
unit = "deg"
counts_per_unit = 46603.37777777778
limits = { velocity = 90, acceleration = 500, jerk = 5000 }
"""


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("whom", ["command", "kernel"])
def test_ctrl_c_and_sigterm_halt_first(tmp_path: Path, end: signal.Signals, whom: str) -> None:
    """Every cycle until the end is recorded: within the limits to a rest, then disabled."""
    file, out = tmp_path / "robot.toml", tmp_path / "out.parquet"
    file.write_text(FILE)
    name = f"end-{os.getpid()}-{int(end)}-{whom}"
    order = [sys.executable, "-m", "sjerk", "kernel", str(file), "--name", name]
    run = subprocess.Popen([*order, "--record", str(out)], stdout=subprocess.PIPE, text=True)
    assert run.stdout is not None
    with run.stdout:
        run.stdout.readline()
        with Host.attach(name) as host:
            host.enable()
            host.move(5000.0)
            moving(host)
            if whom == "command":
                run.send_signal(end)
            else:  # the kernel's own process ignores Ctrl-C: it is its parent's
                child = Path(f"/proc/{run.pid}/task/{run.pid}/children").read_text().split()
                os.kill(int(child[0]), signal.SIGTERM)
            code = run.wait(60.0)
    assert code == (0 if whom == "command" else 6)
    found = Recording.open(out)
    assert found.gaps == ()
    positions = found.position
    kept(positions)
    assert 0.0 < positions[-1, 0] < 5000.0
    assert found.velocity[-1, 0] == 0.0
    enabled = lib.SJ_SW_OPERATION_ENABLED
    assert (found.column("statusword")[-1] & enabled == 0).all()
