"""Unmodified EtherCAT main devices judge the drives: ``./run test-ethercat``, ``./run judges``.

`kernel` is no judge of another make: the kernel's own process as main device of the same drives.

Each judge is a program of its own beside the emulator's process, both on a pair of virtual cables
in a network namespace of their own, without root. A machine that refuses namespaces skips with its
reason. A judge whose software is missing fails: the environment is to have it.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

LONGEST_S = 120
SESSIONS = 4
STALL_S = 0.010
#: Sleeps 2 ms until its input ends; prints by how much the latest wake-up was late, in s.
METER = """
import select, sys, time
worst = 0.0
while True:
    before = time.monotonic()
    if select.select([sys.stdin], [], [], 0.002)[0]:
        break
    worst = max(worst, time.monotonic() - before - 0.002)
print(worst)
"""
JUDGES = Path(__file__).with_name("judges")
CABLE = (
    "ip link add ecm type veth peer name ecs && ip link set lo up && "
    "for i in ecm ecs; do "
    "sysctl -qw net.ipv6.conf.$i.disable_ipv6=1 2>/dev/null; ip link set $i up || exit 1; done"
)
NAMESPACE = ["unshare", "-Urn", "sh", "-c"]
#: Which judges this environment has: those of the permissive licences, or the others too.
GROUP = os.environ.get("SJERK_JUDGES", "permissive")

CHECKS = {
    "pysoem": (
        "scan", "transfers", "segments", "refused accesses", "object dictionary", "SII",
        "refusal 11h", "refusal 12h", "refusal 13h", "Safe-operational", "Operational",
        "operation enabled", "targets", "SDO beside", "fault and emergency", "watchdog", "clocks",
        "end",
    ),
    "kernel": (
        "refusals", "start", "moves", "requests beside", "a second kernel", "cable", "power",
        "drop", "end", "taken",
    ),
    "kickcat": ("scan", "SDO", "mapping", "Operational", "targets", "end"),
    "ebpfcat": ("scan", "SII", "dictionary"),
    "soemx": ("scan", "Operational", "targets", "end"),
    "ethercrab": ("session", "states", "clocks"),
}  # fmt: skip
RUNS = {
    "permissive": [
        ("pysoem", 1),
        ("pysoem", 2),
        ("pysoem", 7),
        ("kickcat", 2),
        ("kickcat", 7),
        ("kernel", 2),
        ("kernel", 7),
    ],
    "copyleft": [
        ("ebpfcat", 1),
        ("ebpfcat", 2),
        ("soemx", 1),
        ("soemx", 7),
        ("ethercrab", 1),
        ("ethercrab", 3),
    ],
}
#: Sessions whose frames an independent decoder reads afterwards.
CAPTURED = ("ebpfcat", "soemx")
ROWS = [(*run, check) for run in RUNS[GROUP] for check in CHECKS[run[0]]]


@pytest.fixture(scope="session")
def cable() -> None:
    """A namespace with a cable can be had here."""
    try:
        made = subprocess.run([*NAMESPACE, CABLE], capture_output=True, text=True)
    except FileNotFoundError as error:
        pytest.skip(f"no unshare: {error}")
    if made.returncode:
        pytest.skip(f"no network namespace with a pair of cables: {made.stderr.strip()}")


@functools.cache
def _folder() -> Path:
    """Where captures go; it is removed at the end."""
    folder = Path(tempfile.mkdtemp(prefix="sjerk-judges-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


@functools.cache
def _packet_library() -> Path:
    """A folder with libpcap under the name that wheels link to; Debian has it under another."""
    link = _folder() / "libpcap.so.1"
    for found in sorted(Path("/usr/lib").glob("*/libpcap.so.*")):
        link.symlink_to(found)
        break
    return link.parent


@functools.cache
def _first(name: str = "") -> list[str]:
    """Before other programs of the machine, where that is allowed: main devices have deadlines.

    The kernel's process sleeps between its cycles and may have a real-time priority.
    """
    wanted = [["chrt", "-f", "20"]] if name == "kernel" else []
    for command in (*wanted, ["nice", "-n", "-15"]):
        if shutil.which(command[0]) is not None:
            done = subprocess.run([*command, "true"], capture_output=True)
            if done.returncode == 0 and not done.stderr:
                return command
    return []


@functools.cache
def verdict(name: str, drives: int) -> dict[str, str]:
    """What became of every check of a judge: "" or where it failed.

    Main devices have time-outs of milliseconds. A session that failed while the machine gave a
    program of the same priority no processor for longer than `STALL_S` begins anew; one that failed
    without such a stall has failed.
    """
    for _ in range(SESSIONS):
        outcome, stall = session(name, drives)
        failed = {check: text for check, text in outcome.items() if text}
        if not failed or stall < STALL_S:
            break
    return outcome | {
        check: f"{text}(the machine stood still for {stall * 1e3:.0f} ms)"
        for check, text in failed.items()
    }


def session(name: str, drives: int) -> tuple[dict[str, str], float]:
    """One run of a judge and the longest stall of the machine meanwhile, in s."""
    program = f'"{sys.executable}" "{JUDGES / name}_judge.py" {drives}'
    environment = {**os.environ, "LD_LIBRARY_PATH": str(_packet_library())}
    if name in CAPTURED:
        environment["SJERK_JUDGE_CAPTURE"] = str(_folder() / f"{name}-{drives}.pcapng")
    meter = subprocess.Popen(
        [*_first(), sys.executable, "-c", METER],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    with subprocess.Popen(
        [*_first(name), *NAMESPACE, f"{CABLE} && exec {program}"],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
        env=environment,
    ) as process:
        try:
            said = process.communicate(timeout=LONGEST_S)[0]
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            said = f"it did not end within {LONGEST_S} s"
    stall = float(meter.communicate()[0])
    lines = [line for line in said.splitlines() if line.startswith("{")]
    if lines:
        return dict(json.loads(lines[-1])), stall
    return dict.fromkeys(CHECKS[name], f"{name} said: {said[-4000:]}"), stall


@pytest.mark.usefixtures("cable")
@pytest.mark.parametrize(("name", "drives", "check"), ROWS)
def test_an_unmodified_main_device_is_satisfied(name: str, drives: int, check: str) -> None:
    """One check of one judge on a line of so many drives."""
    outcome = verdict(name, drives)[check]
    assert not outcome, outcome


def _emulator(out: Path) -> int | None:
    """The process of the drives of a demo that writes this picture."""
    found: dict[int, tuple[int, bytes]] = {}
    for entry in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            found[int(entry.name)] = parent, (entry / "cmdline").read_bytes()
    for pid, (parent, command) in found.items():
        above = found.get(parent, (0, b""))[1]
        if b"--ethercat\0ecs" in command and b"--on-cable" in above and bytes(out) in above:
            return pid
    return None


@pytest.mark.usefixtures("cable")
@pytest.mark.skipif(GROUP != "permissive", reason="once is enough")
def test_the_demo_begins_a_run_anew_where_the_machine_stood_still(
    tmp_path: Path,
) -> None:
    """Its drives are suspended for longer than their watchdog: told; all runs end on the goal."""
    out = tmp_path / "demo.png"
    with subprocess.Popen(
        [sys.executable, "-m", "sjerk", "demo", "--ethercat", "--out", str(out)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as demo:
        assert demo.stderr is not None
        said = ""
        while " 50 %" not in said and (letter := demo.stderr.read(1)):
            said += letter
        emulator = _emulator(out)
        assert emulator is not None, said
        os.kill(emulator, signal.SIGSTOP)
        time.sleep(0.5)
        os.kill(emulator, signal.SIGCONT)
        table, rest = demo.communicate(timeout=LONGEST_S)
    assert demo.returncode == 0, said + rest
    assert "cycles did not reach the drive; the run begins anew" in rest
    errors = next(line for line in table.splitlines() if line.startswith("final error"))
    assert [abs(int(word)) <= 10 for word in errors[46:].split()[::2]] == [True] * 4


def malformed(capture: Path) -> tuple[int, int]:
    """Frames of a capture, and how many of them Wireshark calls malformed."""
    counts = []
    for only in ("ecat", "_ws.malformed"):
        done = subprocess.run(
            ["tshark", "-r", str(capture), "-Y", only, "-T", "fields", "-e", "frame.number"],
            capture_output=True,
            text=True,
            check=True,
        )
        counts.append(len(done.stdout.splitlines()))
    return counts[0], counts[1]


if CAPTURES := [run for run in RUNS[GROUP] if run[0] in CAPTURED]:

    @pytest.mark.skipif(
        shutil.which("tshark") is None, reason="no tshark (on Debian: apt install tshark)"
    )
    @pytest.mark.usefixtures("cable")
    @pytest.mark.parametrize(("name", "drives"), CAPTURES)
    def test_an_independent_decoder_finds_nothing_malformed(name: str, drives: int) -> None:
        """Tshark over the whole session of a judge; in a copy with spoilt lengths it finds some."""
        verdict(name, drives)
        capture = _folder() / f"{name}-{drives}.pcapng"
        frames, bad = malformed(capture)
        assert frames > 100
        assert bad == 0
        data, at, spoilt = bytearray(capture.read_bytes()), 0, 0
        while at < len(data) and spoilt < 20:
            kind, size = int.from_bytes(data[at : at + 4], "little"), data[at + 4 : at + 8]
            if kind == 6 and data[at + 28 + 12 : at + 28 + 14] == b"\x88\xa4":
                data[at + 28 + 22] = 0xFF  # the length of the first datagram
                spoilt += 1
            at += int.from_bytes(size, "little")
        copy = capture.with_suffix(".spoilt.pcapng")
        copy.write_bytes(data)
        assert malformed(copy)[1] > 0
