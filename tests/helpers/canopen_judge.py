"""An unmodified `canopen.BaseNode402` as the judge: demands C1 to C13, a function each.

`Bench` is a master with its network, SYNC and process data; the drive is a thread on a `virtual`
bus or another process on any bus. Run as a program it judges a drive process on udp_multicast and
prints one JSON object of outcomes: `python -m helpers.canopen_judge PDO|SDO`.
"""

from __future__ import annotations

import io
import json
import logging
import os
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable
from pathlib import Path

import can
import canopen
from canopen.profiles.p402 import BaseNode402

from helpers.streams import scurve_at

NODE = 5
PERIOD = 0.002
REV = 16777216
CSP = "CYCLIC SYNCHRONOUS POSITION"


class Bench:
    """A master that sends its receive PDO and then SYNC every 2 ms or slower, from a thread."""

    def __init__(self, interface: str, channel: str, sheet: Path, *, by_pdo: bool) -> None:
        self.by_pdo = by_pdo
        self.network = canopen.Network()
        self.network.NOTIFIER_CYCLE = 0.02  # only how soon disconnect() returns
        self.network.connect(interface=interface, channel=channel)
        self.node = BaseNode402(NODE, str(sheet))
        self.network.add_node(self.node)
        # multicast echoes the master's own NMT commands: one that comes late must not be taken for
        # a change of the drive's state
        self.network.unsubscribe(0, self.node.nmt.on_command)
        self.node.sdo.RESPONSE_TIMEOUT = 2.0
        self.words: list[int] = []
        self.states: list[str] = []
        self.targets: list[int] = []
        self._answered = threading.Event()
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def boot(self) -> None:
        """A drive just reset, in Pre-operational."""
        booted = threading.Event()
        self.node.nmt.add_heartbeat_callback(lambda state: state == 0 and booted.set())
        self.node.nmt.state = "RESET"
        assert booted.wait(5), "no boot-up"
        self.wait(lambda: self.node.nmt.state == "PRE-OPERATIONAL")

    def start(self, option: int = 6) -> None:
        """Set up as a user does: option codes by SDO, PDOs read, SYNC on, Operational."""
        self.boot()
        self.node.sdo[0x605A].raw = option
        self.node.sdo[0x60C2][1].raw = 2
        self.node.sdo[0x10F1][2].raw = 0xFFFF  # a test machine that stalls is no lost master
        self.node.sdo[0x2100][7].raw = 2000
        for index in (0x1400, 0x1800):
            self.node.sdo[index][2].raw = 1  # with each SYNC
        self.switch_pdos_off_for_sdo()
        self.node.setup_402_state_machine()
        self.node.nmt.state = "OPERATIONAL"
        if self.by_pdo:
            self.node.tpdo[1].add_callback(self._see)
            self.node.rpdo[1]["Target position"].raw = self.node.sdo[0x6064].raw
            self.ignore_echo()
            self._thread = threading.Thread(target=self._cycle, daemon=True)
            self._thread.start()
            assert self.node.tpdo[1].wait_for_reception(2) is not None

    def ignore_echo(self) -> None:
        """Multicast echoes the master's own frames: they must not undo what was set since."""
        rpdo = self.node.rpdo[1]
        self.network.unsubscribe(rpdo.cob_id, rpdo.on_message)

    def switch_pdos_off_for_sdo(self) -> None:
        """The master finds no process data and speaks SDO alone, unless it is to use them."""
        if not self.by_pdo:
            for index in (0x1400, 0x1800):
                self.node.sdo[index][1].raw = self.node.sdo[index][1].raw | 0x80000000

    def _see(self, frame: canopen.pdo.base.PdoMap) -> None:
        self._answered.set()
        self.words.append(frame["Statusword"].raw)
        state = self.node.state
        if not self.states or self.states[-1] != state:
            self.states.append(state)

    def _cycle(self) -> None:
        rpdo = self.node.rpdo[1]
        due = time.monotonic()
        while not self._stop.is_set():
            if self.targets:
                rpdo["Target position"].raw = self.targets.pop(0)
            self._answered.clear()
            rpdo.transmit()
            self.network.sync.transmit()
            # never ahead of the answers: on a busy machine both queues would only grow
            self._answered.wait(0.1)
            due = max(due + PERIOD, time.monotonic())
            time.sleep(max(0.0, due - time.monotonic()))

    def enable(self, mode: str = CSP) -> None:
        self.node.op_mode = mode
        assert self.node.op_mode == mode
        self.node.state = "OPERATION ENABLED"

    def fault(self) -> None:
        """A target no axis can reach: 8612h."""
        self.enable()
        if self.by_pdo:
            self.targets.append(2**30)
        else:
            self.node.sdo[0x607A].raw = 2**30
        self.wait(lambda: self.node.sdo[0x603F].raw == 0x8612)
        self.wait(lambda: self.node.sdo[0x6041].raw & 0x4F == 0x08)
        if self.by_pdo:
            self.wait(self.node.is_faulted)
            self.targets.append(self.node.sdo[0x6064].raw)
            self.wait(lambda: not self.targets)
        else:
            self.node.sdo[0x607A].raw = self.node.sdo[0x6064].raw

    @staticmethod
    def wait(condition: Callable[[], bool], seconds: float = 5.0) -> None:
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, "waited too long"
            time.sleep(0.005)

    def close(self) -> None:
        self._stop.set()
        if self._thread:
            self._thread.join()
        self.network.disconnect()


def c1_pdo_parameters_are_readable_in_pre_operational(bench: Bench) -> None:
    bench.boot()
    assert bench.node.nmt.state == "PRE-OPERATIONAL"
    bench.node.setup_402_state_machine()
    assert [v.index for v in bench.node.rpdo[1]] == [0x6040, 0x6060, 0x607A]
    assert [v.index for v in bench.node.tpdo[1]] == [0x6041, 0x6061, 0x6064]
    assert bench.node.tpdo[1].cob_id == 0x180 + NODE
    assert not bench.node.tpdo[4].enabled


def c2_tpdos_keep_coming_in_every_state(bench: Bench) -> None:
    bench.start()
    if not bench.by_pdo:
        bench.enable()  # nothing periodic: every poll is an SDO
        assert bench.node.check_statusword() & 0x6F == 0x27
        return
    visited = []
    for state in (
        "SWITCH ON DISABLED",
        "READY TO SWITCH ON",
        "SWITCHED ON",
        "OPERATION ENABLED",
        "QUICK STOP ACTIVE",
    ):
        if state == "OPERATION ENABLED":
            bench.node.op_mode = CSP
        bench.node.state = state
        assert all(bench.node.check_statusword() is not None for _ in range(20))
        visited.append(bench.node.state)
    bench.node.state = "OPERATION ENABLED"
    bench.fault()
    assert all(bench.node.check_statusword() & 0x4F == 0x08 for _ in range(20))
    assert visited[-1] == "QUICK STOP ACTIVE"


def c3_statusword_is_the_same_by_sdo(bench: Bench) -> None:
    bench.start()
    bench.enable()
    same = 0x6F | 0x0200
    assert bench.node.sdo[0x6041].raw & same == bench.node.check_statusword() & same == 0x227
    assert bench.node.sdo[0x6061].raw == 8


def c4_states_are_decoded(bench: Bench) -> None:
    bench.start()
    for state in ("SWITCH ON DISABLED", "READY TO SWITCH ON", "SWITCHED ON", "OPERATION ENABLED"):
        bench.node.state = state
        assert bench.node.state == state
    bench.node.state = "SWITCHED ON"
    bench.node.state = "READY TO SWITCH ON"
    bench.node.state = "SWITCH ON DISABLED"
    assert bench.node.state == "SWITCH ON DISABLED"


def c5_the_way_up_is_seen_step_by_step(bench: Bench) -> None:
    bench.start()
    bench.enable()
    if bench.by_pdo:
        way = ["SWITCH ON DISABLED", "READY TO SWITCH ON", "SWITCHED ON", "OPERATION ENABLED"]
        assert bench.states[-4:] == way
    assert bench.node.state == "OPERATION ENABLED"


def c6_changes_fit_the_masters_timeouts(bench: Bench) -> None:
    bench.start()
    for _ in range(5):
        bench.enable()
        bench.node.state = "SWITCH ON DISABLED"
        bench.node.op_mode = "NO MODE"
        assert bench.node.op_mode == "NO MODE"


def c7_quick_stop_active_is_reached(bench: Bench) -> None:
    bench.start(option=6)
    bench.enable()
    bench.node.state = "QUICK STOP ACTIVE"
    assert bench.node.state == "QUICK STOP ACTIVE"


def c8_quick_stop_active_stays_while_0002_repeats(bench: Bench) -> None:
    bench.start(option=6)
    bench.enable()
    bench.node.state = "QUICK STOP ACTIVE"
    for _ in range(50):
        if not bench.by_pdo:
            bench.node.controlword = 0x0002
        assert bench.node.check_statusword() & 0x6F == 0x07
    bench.node.state = "OPERATION ENABLED"
    assert bench.node.state == "OPERATION ENABLED"


def c9_reset_from_fault(bench: Bench) -> None:
    bench.start()
    bench.fault()
    assert bench.node.state == "FAULT"
    bench.node.reset_from_fault()
    assert bench.node.state == "OPERATION ENABLED"
    assert bench.node.sdo[0x603F].raw == 0
    bench.wait(lambda: any(e.code == 0x8612 for e in bench.node.emcy.log))
    bench.wait(lambda: bench.node.emcy.log[-1].code == 0)


def c10_homing_succeeds_and_moves(bench: Bench) -> None:
    bench.start()
    bench.node.sdo[0x6098].raw = 34
    bench.node.sdo[0x6099][2].raw = 4 * REV
    bench.node.sdo[0x609A].raw = 40 * REV
    bench.node.sdo[0x607C].raw = 777
    before = bench.node.sdo[0x6063].raw
    assert bench.node.homing(timeout=20)
    assert bench.node.sdo[0x6063].raw - before > 1000

    def home_is_the_pulse() -> bool:
        """Home, a whole turn, became 607Ch; three SDOs that saw the same settling axis."""
        internal = bench.node.sdo[0x6063].raw
        actual = bench.node.sdo[0x6064].raw
        return bench.node.sdo[0x6063].raw == internal and (internal - actual + 777) % REV == 0

    bench.wait(home_is_the_pulse)


def c11_is_homed_tells_whether_a_reference_exists(bench: Bench) -> None:
    bench.start()
    assert not bench.node.is_homed()
    bench.node.sdo[0x6098].raw = 37
    assert bench.node.homing(timeout=10)
    bench.node.state = "SWITCHED ON"
    bench.node.op_mode = CSP
    assert bench.node.is_homed(restore_op_mode=True)
    assert bench.node.op_mode == CSP


def c12_unsupported_modes_are_refused_by_the_master(bench: Bench) -> None:
    bench.start()
    for mode in (
        "PROFILED POSITION",
        "PROFILED VELOCITY",
        "PROFILED TORQUE",
        "INTERPOLATED POSITION",
        "HOMING",
        CSP,
        "CYCLIC SYNCHRONOUS VELOCITY",
        "CYCLIC SYNCHRONOUS TORQUE",
    ):
        assert bench.node.is_op_mode_supported(mode)
    try:
        bench.node.op_mode = "VELOCITY"
    except TypeError:
        return
    raise AssertionError("mode vl is not in 6502h")


def c13_boot_up_and_heartbeat_are_sent(bench: Bench) -> None:
    bench.boot()
    bench.node.sdo[0x1017].raw = 20
    bench.node.nmt.wait_for_heartbeat(5)
    assert bench.node.nmt.state == "PRE-OPERATIONAL"
    bench.node.setup_pdos()
    bench.node.nmt.send_command(1)
    for _ in range(3):
        bench.node.nmt.wait_for_heartbeat(5)
    assert bench.node.nmt.state == "OPERATIONAL"


def c2_without_sync_the_machine_is_set_up_and_led(bench: Bench) -> None:
    """Defaults of CiA 402, nobody sends SYNC: every state, a mode, a move in profile position."""
    bench.boot()
    bench.switch_pdos_off_for_sdo()
    bench.node.setup_402_state_machine()
    assert [p.trans_type for p in (bench.node.rpdo[1], bench.node.tpdo[1])] == [255, 255]
    bench.node.nmt.state = "OPERATIONAL"
    if bench.by_pdo:
        bench.ignore_echo()
    bench.node.op_mode = "PROFILED POSITION"
    bench.node.state = "OPERATION ENABLED"
    assert bench.node.state == "OPERATION ENABLED"
    if bench.by_pdo:  # goes out with the controlword
        bench.node.rpdo[1]["Target position"].raw = REV // 2
    bench.node.sdo[0x607A].raw = REV // 2
    bench.node.controlword = 0x001F
    bench.wait(lambda: bench.node.sdo[0x6041].raw & 0x1000 != 0)
    bench.node.controlword = 0x000F
    bench.wait(lambda: bench.node.sdo[0x6041].raw & 0x1400 == 0x0400)
    assert abs(bench.node.sdo[0x6064].raw - REV // 2) <= 10
    bench.node.state = "SWITCH ON DISABLED"
    assert bench.node.state == "SWITCH ON DISABLED"


def stream_of_2000_targets_arrives(bench: Bench) -> None:
    """From Switch on disabled through 2000 targets of an s-curve to the position window."""
    bench.start()
    bench.node.sdo[0x6068].raw = 100  # in the window to stay, not in passing
    bench.enable()
    start = bench.node.sdo[0x6064].raw
    seconds = 2000 * PERIOD
    length, v, a, j = 1.5, 0.6, 3.0, 30.0
    moving = length / v + v / a + a / j
    assert moving < seconds
    curve = [start + round(REV * scurve_at((k + 1) * PERIOD, length, v, a, j)) for k in range(2000)]
    if bench.by_pdo:
        bench.targets = list(curve)
        bench.wait(lambda: not bench.targets, 60)
        try:
            bench.wait(lambda: bench.words[-1] & 0x1400 == 0x1400, 10)
        except AssertionError as error:
            code = bench.node.sdo[0x603F].raw
            raise AssertionError(f"6041h {bench.words[-1]:04X}h, 603Fh {code:04X}h") from error
    else:
        # SDOs make no stream: a step, once the last is done
        for target in (*curve[::20], curve[-1]):
            bench.node.sdo[0x607A].raw = target
            bench.wait(lambda goal=target: bench.node.sdo[0x6062].raw == goal)
        bench.wait(lambda: bench.node.sdo[0x6041].raw & 0x1400 == 0x1400, 10)
    assert abs(bench.node.sdo[0x6064].raw - curve[-1]) <= bench.node.sdo[0x6067].raw
    assert bench.node.sdo[0x603F].raw == 0
    if bench.by_pdo:
        # the master's own clock may be late, its targets are what is judged
        assert [bench.node.sdo[0x2101][sub].raw for sub in range(7, 14)] == [0] * 7


DEMANDS: dict[str, Callable[[Bench], None]] = {
    name: thing
    for name, thing in list(globals().items())
    if callable(thing) and name.partition("_")[0] in {f"c{n}" for n in range(1, 14)} | {"stream"}
}


def main(path: str) -> None:
    """Judge one drive process by every demand; JSON of name: "" or what went wrong."""
    sheet = Path(os.environ.get("TMPDIR", "/tmp")) / f"sjerk-judge-{os.getpid()}.eds"
    bus = ["--interface", "udp_multicast", "--channel", "239.74.163.2"]
    command = [sys.executable, "-m", "sjerk", "drive", *bus, "--node", str(NODE)]
    drive = subprocess.Popen([*command, "--eds", str(sheet)], stdout=subprocess.PIPE, text=True)
    outcomes = {}
    said = io.StringIO()
    logging.basicConfig(stream=said, level=logging.INFO)
    try:
        assert drive.stdout is not None
        assert "is ready" in drive.stdout.readline()
        for name, demand in DEMANDS.items():
            bench = Bench("udp_multicast", "239.74.163.2", sheet, by_pdo=path == "PDO")
            try:
                demand(bench)
                outcomes[name] = ""
            except Exception:  # an outcome like any other: reported, not raised
                outcomes[name] = traceback.format_exc() + said.getvalue()[-2000:]
            finally:
                bench.close()
        drive.terminate()
        rest = drive.stdout.read()
        assert drive.wait(10) == 0
        assert "operation enabled" in rest
    finally:
        drive.kill()
        sheet.unlink(missing_ok=True)
    print(json.dumps(outcomes))


def open_bus(interface: str, channel: str) -> can.BusABC:
    """A bus of python-can, for the drive's side."""
    return can.Bus(interface=interface, channel=channel)


if __name__ == "__main__":
    main(sys.argv[1])
