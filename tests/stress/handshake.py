"""Stress of the dual-port RAM: full speed, kill -9, and a variant that does tear.

Run it with ``./run stress handshake [--seconds N]``. Without ``--seconds`` it does the whole
measure: 10 million commands of 16 axes, 1000 kills of either side, 10 million ring records across
1000 restarts of the producer, 10 million events, 8 monitors. With it, every part stops after its
share of the time. The loops are C (handshake_peer.c, built here beside the same C of dpram/), the
processes, locks and epochs those of the library. Exit status 0 if every promise held and the naive
variants tore.
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import functools
import mmap
import multiprocessing
import os
import random
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sjerk import errors
from sjerk._binding import ffi, lib
from sjerk.handshake import Layout, Segment

HERE = Path(__file__).resolve().parent
SOURCES = HERE.parents[1] / "src" / "sjerk"
LAYOUT = Layout(
    command_bytes=512,  # 16 axes of four doubles
    feedback_bytes=512,
    record_bytes=64,
    record_capacity=1024,
    event_bytes=64,
    event_capacity=256,
    abi=16,
)
COUNTERS = (
    "stop", "sent", "got", "torn", "corrupt", "backwards", "wrong", "lost", "doubled", "missed",
    "last", "cycles", "lapped", "readdressed", "retries",
)  # fmt: skip
BLOCK = 16  # counters of one peer
STUCK_S = 30.0  # a side that makes no progress for so long is counted as stuck
# Imported once by the server that forks the peers, so that a restart costs a fork.
PRELOAD = ["argparse", "ctypes", "statistics", "tempfile", "subprocess", "sjerk.handshake"]


# ---- the other processes ------------------------------------------------------------------------


def build(folder: Path) -> None:
    """Compile the loops beside the same C that the library holds."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        raise SystemExit("stress: a C compiler is needed (on Debian: apt install gcc libc6-dev)")
    files = [HERE / "handshake_peer.c", *sorted((SOURCES / "dpram").glob("_*.c"))]
    flags = ["-std=c11", "-O2", "-ffp-contract=off", "-shared", "-fPIC", "-pthread", f"-I{SOURCES}"]
    subprocess.run([compiler, *flags, *map(str, files), "-o", str(folder / "peer.so")], check=True)


def peer(
    folder: str, block: int, name: str, role: str, job: str, arguments: tuple[Any, ...]
) -> None:
    """A child: attach in a role and run one C loop until it is told to stop, or killed."""
    processors = sorted(os.sched_getaffinity(0))
    os.sched_setaffinity(0, {processors[block % len(processors)]})  # the two sides side by side
    loops = ctypes.CDLL(f"{folder}/peer.so")
    with contextlib.ExitStack() as stack:
        counters = stack.enter_context(shared(Path(folder) / "counters"))
        r = address(counters) + 8 * block * BLOCK
        if role == "naive":
            base = address(stack.enter_context(shared(Path(folder) / "naive")))
        else:
            segment = stack.enter_context(Segment.attach(name, LAYOUT, role=role))  # type: ignore[arg-type]
            base = int(ffi.cast("uintptr_t", segment.base))
        took = (ctypes.c_uint32 * (arguments[0] if job == "peer_paced" else 0))()
        if job == "peer_paced":
            arguments = (ctypes.addressof(took), *arguments)
        getattr(loops, job)(*map(ctypes.c_uint64, (base, r, *arguments)))
        if job == "peer_paced":
            (Path(folder) / f"took-{block}").write_bytes(bytes(took))
        if role in ("host", "kernel"):
            segment.close()  # an orderly end
        os._exit(0)  # the maps go with the process


def address(memory: mmap.mmap) -> int:
    """Where a map begins."""
    return int(ffi.cast("uintptr_t", ffi.from_buffer(memory)))


@contextlib.contextmanager
def shared(path: Path) -> Iterator[mmap.mmap]:
    """A file of counters, mapped by whoever asks."""
    with path.open("r+b") as file:
        memory = mmap.mmap(file.fileno(), 0)
        yield memory


# ---- the director -------------------------------------------------------------------------------


@dataclass
class Row:
    """One line of the table; None where a column has no meaning."""

    what: str
    messages: int
    torn: int | None = None
    lost: int | None = None
    doubled: int | None = None
    kills: int | None = None
    good: bool = True
    notes: list[str] = field(default_factory=list)


class Stress:
    """Starts peers, kills them, watches their counters."""

    def __init__(self, folder: Path, seconds: float | None) -> None:
        self.folder = folder
        self.seconds = seconds
        self.context = multiprocessing.get_context("forkserver")
        self.context.set_forkserver_preload(PRELOAD)
        (folder / "counters").write_bytes(bytes(8 * BLOCK * 16))
        (folder / "naive").write_bytes(bytes(8 * 64 * 4))
        self.file = (folder / "counters").open("r+b")
        self.counters = memoryview(mmap.mmap(self.file.fileno(), 0)).cast("Q")
        self.children: list[Any] = []
        self.random = random.Random(2026)
        self.name = ""
        self.deadline = float("inf")
        self.told = 0.0

    # -- peers

    def start(self, block: int, role: str, job: str, *arguments: Any) -> Any:
        child = self.context.Process(
            target=peer,
            args=(str(self.folder), block, self.name, role, job, arguments),
            daemon=True,
        )
        child.start()
        self.children.append(child)
        return child

    def kill(self, child: Any) -> None:
        os.kill(child.pid, signal.SIGKILL)
        child.join()
        self.children.remove(child)

    def stop(self, *blocks: int) -> None:
        """Tell these peers to stop, and wait for all children."""
        for block in blocks:
            self.counters[block * BLOCK] = 1
        for child in self.children:
            child.join(STUCK_S)
            if child.is_alive():
                raise SystemExit(f"stress: a process did not stop: {child}")
        self.children.clear()

    def get(self, block: int, what: str) -> int:
        return self.counters[block * BLOCK + COUNTERS.index(what)]

    def reset(self) -> None:
        for i in range(len(self.counters)):
            self.counters[i] = 0

    def beyond(self, block: int, what: str, mark: int) -> Callable[[], bool]:
        """Whether this counter has passed the mark, to be asked again and again."""
        return lambda: self.get(block, what) > mark

    def wait(self, ready: Callable[[], bool]) -> bool:
        """Until ready: True; False if the time of this part is over or nothing moves any more."""
        begun = time.monotonic()
        while not ready():
            now = time.monotonic()
            if now > self.deadline or now - begun > STUCK_S:
                return False
            time.sleep(0.0002)
        return True

    # -- parts

    @contextlib.contextmanager
    def part(self, share: float) -> Iterator[Segment]:
        """A fresh segment and cleared counters, for this share of the time."""
        self.reset()
        self.name = f"stress-{os.getpid()}-{time.monotonic_ns()}"
        self.deadline = float("inf")
        if self.seconds is not None:
            self.deadline = time.monotonic() + share * self.seconds
        with Segment.create(self.name, LAYOUT) as segment:
            yield segment

    def over(self) -> bool:
        return time.monotonic() > self.deadline

    def say(self, what: str, done: int, most: int, last: bool = False) -> None:
        """Progress, about once a second."""
        now = time.monotonic()
        if now - self.told >= 1.0 or last:
            self.told = now
            of = f" of {most:,}" if most else ""
            print(f"stress: {what}: {done:,}{of}", file=sys.stderr, flush=True)

    def commands(self, most: int) -> Row:
        """Commands back to back, and whether the last of them arrives."""
        with self.part(0.2):
            self.start(1, "kernel", "peer_kernel")
            if not self.wait(lambda: self.get(1, "cycles") > 0):
                raise SystemExit("stress: the kernel did not start")
            host = self.start(0, "host", "peer_host", most)
            while host.is_alive() and not self.over():
                host.join(0.2)
                self.say("commands", self.get(0, "sent"), most)
            self.counters[0] = 1
            host.join()
            arrived = self.wait_last()
            self.stop(0, 1)
        row = self.row("commands, 16 axes, back to back", self.get(0, "sent"), (0, 1))
        row.lost = 0 if arrived else 1
        row.good &= arrived
        row.notes.append(f"{self.get(1, 'got'):,} collected, the last one among them: {arrived}")
        return row

    def wait_last(self) -> bool:
        """Whether the kernel comes to hold the newest command."""
        self.deadline = max(self.deadline, time.monotonic() + 5.0)
        return self.wait(lambda: self.get(1, "last") >= self.get(0, "sent") > 0)

    def host_kills(self, most: int) -> Row:
        """The host is killed in mid-write, again and again; the kernel goes on."""
        refused = attempts = half = stuck = done = 0
        recovery: list[float] = []
        with self.part(0.2) as segment:
            self.start(1, "kernel", "peer_kernel")
            self.wait(lambda: self.get(1, "cycles") > 0)
            while done < most and not self.over():
                writes = self.beyond(0, "sent", self.get(0, "sent"))
                arrives = self.beyond(1, "got", self.get(1, "got"))
                host = self.start(0, "host", "peer_host", 2**63)
                if not (self.wait(writes) and self.wait(arrives)):
                    if self.over():
                        self.kill(host)
                        break
                    print(f"stress: stuck: {host}, {list(self.counters[: 2 * BLOCK])}")
                    self.kill(host)
                    stuck += 1
                    continue
                attempts += 1
                try:
                    Segment.attach(self.name, LAYOUT, role="host").close()
                except errors.HostTakenError:
                    refused += 1
                time.sleep(self.random.uniform(0.0, 0.001))
                goes_on = self.beyond(1, "cycles", self.get(1, "cycles") + 100)
                begun = time.perf_counter()
                os.kill(host.pid, signal.SIGKILL)
                while segment.host_lives():
                    time.sleep(0.00005)  # leave the processor to the dying
                recovery.append(time.perf_counter() - begun)
                host.join()
                self.children.remove(host)
                if not self.wait(goes_on):
                    stuck += not self.over()
                half += lib.sj_command_published(segment.base) > self.get(1, "last")
                done += 1
                self.say("kills of the host", done, most)
            self.stop(1)
        row = self.row("host killed, kernel lives", self.get(0, "sent"), (0, 1))
        row.kills = done
        row.good &= stuck == 0 and refused == attempts
        row.notes.append(f"{stuck} stuck, {half} of the kills left a command half-written")
        row.notes.append(f"second writers refused: {refused} of {attempts}")
        recovery.sort()
        if not recovery:
            row.good = False
            return row
        row.notes.append(
            f"lock free after the kill: median {1e3 * statistics.median(recovery):.2f} ms, "
            f"p99 {1e3 * recovery[int(0.99 * len(recovery))]:.2f} ms"
        )
        return row

    def kernel_kills(self, most: int) -> Row:
        """The kernel is killed while the host writes; its successor obeys nothing meant for it."""
        stuck = done = 0
        with self.part(0.2):
            self.start(0, "host", "peer_host", 2**63)
            while done < most and not self.over():
                arrives = self.beyond(1, "got", self.get(1, "got"))
                kernel = self.start(1, "kernel", "peer_kernel")
                if not self.wait(arrives):
                    stuck += not self.over()
                time.sleep(self.random.uniform(0.0, 0.001))
                self.kill(kernel)
                done += 1
                self.say("kills of the kernel", done, most)
            self.stop(0)
        row = self.row("kernel killed, host lives", self.get(0, "sent"), (0, 1))
        row.kills = done
        row.good &= stuck == 0
        row.notes.append(
            f"{stuck} stuck, {self.get(1, 'wrong')} wrong goals, "
            f"host told of {self.get(0, 'readdressed')} restarts"
        )
        return row

    def ring(self, most: int, kills: int) -> Row:
        """Records in order across restarts of the producer."""
        done = 0
        with self.part(0.2) as segment:
            base = segment.base
            self.start(1, "kernel", "peer_consumer", most)
            self.wait(lambda: lib.sj_shm_kernel_epoch(base) > 0)
            while not self.over():
                mark = most * (done + 1) // (kills + 1)
                producer = self.start(0, "host", "peer_producer", most)
                if done == kills:
                    while producer.is_alive() and not self.over():
                        producer.join(0.2)
                    break
                self.wait(functools.partial(ring_holds, base, mark))
                self.kill(producer)
                done += 1
                self.say("ring records", lib.sj_ring_published(base), most)
            self.counters[0] = 1
            sent = lib.sj_ring_published(base)
            self.deadline = float("inf")
            drained = self.wait(lambda: self.get(1, "last") >= lib.sj_ring_published(base))
            sent = lib.sj_ring_published(base)
            self.stop(0, 1)
        row = self.row("ring records, producer killed", sent, (0, 1))
        row.kills = done
        row.lost = self.get(1, "lost") + (sent - self.get(1, "got") if drained else 1)
        row.doubled = self.get(1, "doubled")
        row.good &= drained and row.lost == 0 and row.doubled == 0 and self.get(1, "got") == sent
        return row

    def events(self, most: int) -> Row:
        """Events at full speed, one reader that cannot keep up."""
        with self.part(0.05) as segment:
            base = segment.base
            self.start(1, "monitor", "peer_listener", 2**63)
            kernel = self.start(0, "kernel", "peer_events", most)
            while kernel.is_alive() and not self.over():
                kernel.join(0.2)
                self.say("events", self.get(0, "sent"), most)
            self.counters[0] = 1
            kernel.join()
            sent = lib.sj_event_latest(base)
            self.deadline = float("inf")
            self.wait(lambda: self.get(1, "last") >= sent)
            self.stop(0, 1)
        row = self.row("events, slow reader", sent, (0, 1))
        got, missed = self.get(1, "got"), self.get(1, "missed")
        row.good &= got + missed == sent and self.get(1, "wrong") == 0
        row.notes.append(
            f"{got:,} read + {missed:,} missed = {got + missed:,}; gaps counted wrongly: "
            f"{self.get(1, 'wrong')}"
        )
        return row

    def monitors(self, cycles: int, count: int = 8) -> list[Row]:
        """Monitors at full speed beside a kernel at full speed, then beside a cyclic one."""
        with self.part(0.1):
            self.start(0, "kernel", "peer_kernel")
            for i in range(count):
                self.start(1 + i, "monitor", "peer_monitor")
            begun = time.monotonic()
            end = begun + (5.0 if self.seconds is None else 0.05 * self.seconds)
            while time.monotonic() < end:
                time.sleep(0.2)
                self.say("frames read", sum(self.get(1 + i, "got") for i in range(count)), 0)
            self.stop(*range(1 + count))
        blocks = tuple(range(1, 1 + count))
        full = self.row(
            f"frames, {count} monitors", sum(self.get(b, "got") for b in blocks), blocks
        )

        quiet: list[int] = []
        busy: list[int] = []
        for _ in range(2):  # in turns, so that a drift of the machine meets both
            quiet += self.paced(cycles // 2, 0)
            busy += self.paced(cycles // 2, count)
        return [full, self.compare(f"cyclic kernel, {count} monitors", quiet, busy)]

    def dying(self, cycles: int) -> Row:
        """The cycle of a kernel whose host lives, and of one whose hosts are killed."""
        living: list[int] = []
        killed: list[int] = []
        kills = 0
        for _ in range(2):
            living += self.paced(cycles // 2, 0, "host")
            begun = self.kills
            killed += self.paced(cycles // 2, 0, "mortal host")
            kills += self.kills - begun
        row = self.compare("cyclic kernel, hosts die", living, killed)
        row.kills = kills
        row.good &= kills > 0
        return row

    def compare(self, what: str, before: list[int], beside: list[int]) -> Row:
        """Computing times alone and beside others: moved by less than their own spread?"""
        (a50, a99), (b50, b99) = quantiles(before), quantiles(beside)
        row = Row(what, len(before) + len(beside), torn=self.torn)
        row.good = row.torn == 0 and abs(b50 - a50) < a99 - a50
        row.notes.append(
            f"computing time per cycle, median and p99: without {a50:.2f} and {a99:.2f} us, "
            f"with {b50:.2f} and {b99:.2f} us"
        )
        row.notes.append(f"median moved by {b50 - a50:+.2f} us, own spread {a99 - a50:.2f} us")
        return row

    torn = 0
    kills = 0

    def paced(self, cycles: int, monitors: int, host: str = "") -> list[int]:
        """Computing times of a kernel that wakes every 500 us, beside monitors or a host."""
        with self.part(0.05):
            for i in range(monitors):
                self.start(1 + i, "monitor", "peer_monitor")
            time.sleep(0.1)
            kernel = self.start(0, "kernel", "peer_paced", cycles, 500_000)
            self.deadline = float("inf")
            if host == "host":
                self.start(1, "host", "peer_host", 2**63)
            while kernel.is_alive():
                if host == "mortal host":
                    writes = self.beyond(1, "sent", self.get(1, "sent"))
                    child = self.start(1, "host", "peer_host", 2**63)
                    self.wait(writes)
                    self.kill(child)
                    self.kills += 1
                else:
                    kernel.join(0.1)
            self.stop(*range(1 + max(1, monitors)))
            self.torn += sum(self.get(b, "torn") for b in range(1 + monitors))
            done = self.get(0, "cycles")
        took = memoryview((self.folder / "took-0").read_bytes()).cast("I")
        return list(took[:done])[10:]

    def naive(self, what: str, twice: int, most: int) -> Row:
        """The variant that tears."""
        with self.part(0.03):
            self.start(1, "naive", "naive_reader", twice)
            self.start(0, "naive", "naive_writer", 2**63, twice)
            share = 10.0 if self.seconds is None else 0.03 * self.seconds
            self.deadline = time.monotonic() + STUCK_S
            self.wait(self.beyond(1, "got", 0))
            self.deadline = time.monotonic() + share
            self.wait(self.beyond(1, "got", most))
            self.stop(0, 1)
        row = Row(what, self.get(0, "sent"), torn=self.get(1, "torn"))
        row.good = bool(row.torn)
        share = 100.0 * self.get(1, "torn") / max(1, self.get(1, "got"))
        row.notes.append(f"{share:.1f} % of {self.get(1, 'got'):,} reads torn, as it should be")
        return row

    def row(self, what: str, messages: int, blocks: tuple[int, ...]) -> Row:
        """The counters that must be 0 in every part."""
        total = {k: sum(self.get(b, k) for b in blocks) for k in COUNTERS}
        row = Row(what, messages, torn=total["torn"], lost=0, doubled=total["backwards"])
        row.good = not any(total[k] for k in ("torn", "corrupt", "backwards", "wrong"))
        row.good &= messages > 0
        if total["corrupt"]:
            row.notes.append(f"{total['corrupt']} checksums or words wrong")
        return row


def ring_holds(base: Any, mark: int) -> bool:
    """Whether so many records have been published."""
    return bool(lib.sj_ring_published(base) >= mark)


def quantiles(values: list[int]) -> tuple[float, float]:
    """Median and 99th percentile, ns to us."""
    values = sorted(values)
    return values[len(values) // 2] / 1e3, values[int(0.99 * len(values))] / 1e3


def table(rows: list[Row]) -> str:
    """The rows as text, each with its notes below."""
    lines = [
        f"{'':34}{'messages':>12}{'torn':>10}{'lost':>6}{'doubled':>9}{'kills':>7}  held",
    ]
    for row in rows:
        cells = [f"{row.what:34}", f"{row.messages:>12,}"]
        for value, width in ((row.torn, 10), (row.lost, 6), (row.doubled, 9), (row.kills, 7)):
            cells.append(f"{'-' if value is None else format(value, ','):>{width}}")
        lines.append("".join(cells) + ("  yes" if row.good else "  NO"))
        lines += [f"    {note}" for note in row.notes]
    return "\n".join(lines)


def main() -> int:
    """Run all parts and print the table; 0 if all held."""
    parser = argparse.ArgumentParser(prog="./run stress handshake", description=__doc__)
    parser.add_argument("--seconds", type=float, help="about so long in all (default: the measure)")
    arguments = parser.parse_args()
    if arguments.seconds is not None and not arguments.seconds > 0:
        parser.error(f"--seconds {arguments.seconds} must be > 0")
    begun = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="sjerk-stress-") as name:
        build(Path(name))
        stress = Stress(Path(name), arguments.seconds)
        million = 1_000_000
        cycles = 8000 if arguments.seconds is None else max(400, int(arguments.seconds * 100))
        rows = []
        try:
            rows.append(stress.commands(10 * million))
            rows.append(stress.host_kills(1000))
            rows.append(stress.kernel_kills(1000))
            rows.append(stress.ring(10 * million, 1000))
            rows.append(stress.events(10 * million))
            rows += stress.monitors(cycles)
            rows.append(stress.dying(cycles))
            rows.append(stress.naive("naive: memcpy", 0, million))
            rows.append(stress.naive("naive: two buffers, an index", 1, million))
        except KeyboardInterrupt:
            print("stress: interrupted", file=sys.stderr)
        finally:
            for child in stress.children:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(child.pid, signal.SIGKILL)
                child.join()
            stress.counters.release()
            stress.file.close()
    print(table(rows))
    left = [p.name for p in Path("/dev/shm").glob(f"sjerk-stress-{os.getpid()}-*")]
    alive = len(multiprocessing.active_children())
    print(f"segments and lock files left: {len(left)}; processes left: {alive}")
    print(f"took {time.monotonic() - begun:.0f} s")
    complete = len(rows) == 10
    return 0 if complete and not left and not alive and all(row.good for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
