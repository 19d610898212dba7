"""What a machine grants a kernel: each thing tried, never guessed, with the line that mends it.

Never here: what a kernel does with it.
"""

from __future__ import annotations

import enum
import errno
import importlib.util
import os
import platform
import secrets
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from sjerk.errors import SjerkError
from sjerk.handshake import Layout, Segment
from sjerk.host import Grant, Monitor
from sjerk.kernel import Axis, Clock, MotionKernel
from sjerk.profile import Limits

#: What a kernel of real drives usually asks for.
PRIORITY = 80
_PERIOD = 1e-3


class Verdict(enum.StrEnum):
    """Whether a thing is there."""

    GRANTED = "granted"
    """It was tried, and works."""
    REFUSED = "refused"
    """A kernel runs without it, less punctually or without the port that needs it."""
    NEEDED = "needed"
    """No kernel runs without it."""


@dataclass(frozen=True)
class Finding:
    """One thing: its name, the verdict, what was found, and what mends it (else empty)."""

    of: str
    verdict: Verdict
    found: str
    mend: str = ""

    @classmethod
    def tried(cls, of: str, works: bool, found: str, mend: str) -> Finding:
        """Granted, or refused with what mends it."""
        verdict = Verdict.GRANTED if works else Verdict.REFUSED
        return cls(of, verdict, found, "" if works else mend)


def findings(seconds: float) -> Iterator[Finding]:
    """Everything, in the order in which a kernel needs it; a kernel is run for so long (s)."""
    memory = shared_memory()
    yield memory
    if memory.verdict is Verdict.GRANTED:
        yield from kernel(seconds)
    yield clocks()
    yield from system()
    yield cyclictest()
    yield namespaces()
    yield raw_sockets()
    yield from interfaces()
    yield from extras()


# ---- a kernel


def shared_memory() -> Finding:
    """A segment is made, as every kernel makes one."""
    try:
        layout = Layout(command_bytes=8, feedback_bytes=8)
        with Segment.create(f"doctor-{secrets.token_hex(4)}", layout):
            free = shutil.disk_usage("/dev/shm").free
    except (SjerkError, OSError) as fault:
        mend = "mount -t tmpfs -o size=64m tmpfs /dev/shm (in containers: --shm-size=64m)"
        return Finding("shared memory", Verdict.NEEDED, str(fault), mend)
    return Finding("shared memory", Verdict.GRANTED, f"/dev/shm, {free / 2**20:.0f} MiB free")


def kernel(seconds: float) -> Iterator[Finding]:
    """A kernel in its process, which asks for everything; and how punctual it was."""
    axis = Axis(Limits(90.0, 500.0, 5000.0), 2**24 / 360.0, drive="ideal")
    clock = Clock(priority=PRIORITY, lock_memory=True)
    name = f"doctor-{secrets.token_hex(4)}"
    try:
        with MotionKernel([axis], _PERIOD, name=name, clock=clock), Monitor.attach(name) as watch:
            before = watch.feedback()
            time.sleep(seconds)
            timing = watch.feedback().timing_since(before)
    except (SjerkError, OSError) as fault:
        mend = "sjerk clean; then, where that does not help, report it with this output"
        yield Finding("kernel", Verdict.NEEDED, str(fault), mend)
        return
    late = timing.latency
    found = (
        f"{late.count} cycles of {_PERIOD * 1e6:.0f} us, {timing.late} late; woken late by "
        f"{late.median * 1e6:.0f} us (median), {late.worst * 1e6:.0f} us (worst)"
    )
    yield Finding("kernel", Verdict.GRANTED, found)
    user = "*" if os.geteuid() == 0 else _user()
    yield _grant(
        "scheduler",
        timing.clock.scheduling,
        f"echo '{user} - rtprio 90' | sudo tee /etc/security/limits.d/sjerk.conf, then log in anew"
        " (in containers: --cap-add=sys_nice --ulimit rtprio=90)",
    )
    yield _grant(
        "memory locking",
        timing.clock.memory,
        f"echo '{user} - memlock unlimited' | sudo tee -a /etc/security/limits.d/sjerk.conf, then "
        "log in anew (in containers: --cap-add=ipc_lock --ulimit memlock=-1)",
    )


def _grant(of: str, grant: Grant, mend: str) -> Finding:
    full = grant.granted and not grant.reason
    return Finding.tried(of, full, ": ".join(filter(None, (grant.asked, grant.reason))), mend)


def _user() -> str:
    """Whose limits are to be raised; a user without a name by number, which limits.d takes too."""
    return os.environ.get("USER") or f"{os.geteuid()}:"


# ---- the system


def clocks() -> Finding:
    """The clock of the cycle: its step, and what it is read from."""
    step = time.clock_getres(time.CLOCK_MONOTONIC)
    source = _text("/sys/devices/system/clocksource/clocksource0/current_clocksource") or "unknown"
    found = f"CLOCK_MONOTONIC in steps of {step * 1e9:.0f} ns, from {source}"
    slow = source in ("hpet", "acpi_pm", "jiffies")
    mend = "boot a kernel with CONFIG_HIGH_RES_TIMERS, with clocksource=tsc where it is stable"
    return Finding.tried("clocks", step <= 1e-6 and not slow, found, mend)


def system() -> Iterator[Finding]:
    """The kernel of the system: preemption, its share for real time, how deep it sleeps."""
    release, version = platform.release(), platform.version()
    preempt = _text("/sys/kernel/realtime") == "1" or "PREEMPT_RT" in version
    found = f"{release}, {'PREEMPT_RT' if preempt else 'not PREEMPT_RT'}"
    yield Finding.tried("preemption", preempt, found, "apt install linux-image-rt-amd64 (Debian)")
    runtime = _number("/proc/sys/kernel/sched_rt_runtime_us")
    period = _number("/proc/sys/kernel/sched_rt_period_us")
    if runtime is not None and period:
        whole = runtime < 0 or runtime >= period
        share = "all of the time" if whole else f"{runtime / period:.0%} of the time"
        enough = whole or runtime > 0.5 * period
        mend = "sudo sysctl kernel.sched_rt_runtime_us=950000"
        yield Finding.tried("real-time share", enough, share, mend)
    governor = _text("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")
    if governor is not None:
        mend = "sudo cpupower frequency-set -g performance"
        yield Finding.tried("frequency", governor == "performance", governor, mend)
    held = os.access("/dev/cpu_dma_latency", os.W_OK)
    what = "/dev/cpu_dma_latency can be held" if held else "deep sleep cannot be held off"
    yield Finding.tried("sleep states", held, what, "sudo chmod a+rw /dev/cpu_dma_latency")


def cyclictest() -> Finding:
    """The judge that ``sjerk report`` compares with."""
    tool = shutil.which("cyclictest")
    return Finding.tried(
        "cyclictest", tool is not None, tool or "not installed", "apt install rt-tests (Debian)"
    )


def namespaces() -> Finding:
    """A network of one's own, in which tests join main devices and emulated drives."""
    tool = shutil.which("unshare")
    if tool is None:
        return Finding(
            "namespaces", Verdict.REFUSED, "no unshare", "apt install util-linux (Debian)"
        )
    order = [tool, "--user", "--map-root-user", "--net", "true"]
    done = subprocess.run(order, capture_output=True, text=True, check=False)
    said = done.stderr.strip().splitlines()
    found = "a user's own network" if done.returncode == 0 else "; ".join(said) or "refused"
    mend = "sudo sysctl kernel.unprivileged_userns_clone=1 user.max_user_namespaces=15000"
    return Finding.tried("namespaces", done.returncode == 0, found, mend)


# ---- the network


def raw_sockets() -> Finding:
    """What EtherCAT needs of the system."""
    try:
        socket.socket(socket.AF_PACKET, socket.SOCK_RAW, 0).close()
    except OSError as fault:
        found = os.strerror(fault.errno or errno.EPERM)
        mend = f"sudo setcap cap_net_raw+ep {os.path.realpath(sys.executable)}"
        return Finding("raw sockets", Verdict.REFUSED, found, mend)
    return Finding("raw sockets", Verdict.GRANTED, "opened one")


def interfaces() -> Iterator[Finding]:
    """Each Ethernet interface with a cable's other end, or without."""
    folder = Path("/sys/class/net")
    names = sorted(path.name for path in folder.iterdir()) if folder.is_dir() else []
    wired = [
        name
        for name in names
        if _number(f"{folder}/{name}/type") == 1 and not (folder / name / "wireless").exists()
    ]
    if not wired:
        yield Finding("interface", Verdict.REFUSED, "no Ethernet", "a network card for EtherCAT")
    for name in wired:
        carrier = _text(f"{folder}/{name}/carrier") == "1"
        found = f"{name}, {_speed(name)}" if carrier else f"{name}, no link"
        mend = f"sudo ip link set {name} up, and a cable with a device at its end"
        yield Finding.tried("interface", carrier, found, mend)


def _speed(name: str) -> str:
    speed = _number(f"/sys/class/net/{name}/speed")
    return "link" if speed is None or speed <= 0 else f"link at {speed} Mbit/s"


# ---- the installation


def extras() -> Iterator[Finding]:
    """The optional parts of sjerk, by what they install."""
    modules = {
        "demo": ("matplotlib", "rosbags"),
        "monitor": ("rich",),
        "record": ("pyarrow", "mcap"),
        "canopen": ("can", "msgpack"),
        "panel": ("viser", "ompl"),
        "panel-urdf": ("viser", "ompl", "collada"),
        "studies": ("distributed",),
    }
    for extra, wanted in modules.items():
        missing = [name for name in wanted if importlib.util.find_spec(name) is None]
        found = f"without {', '.join(missing)}" if missing else ", ".join(wanted)
        mend = f"pip install 'sjerk[{extra}]'"
        yield Finding.tried(f"extra {extra}", not missing, found, mend)


def _text(path: str) -> str | None:
    try:
        return Path(path).read_text(encoding="ascii", errors="replace").strip()
    except OSError:
        return None


def _number(path: str) -> int | None:
    try:
        return int(_text(path) or "")
    except ValueError:
        return None
