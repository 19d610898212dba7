"""Round trip of 256 bytes between two processes: the dual-port RAM beside what one would else take.

All in one run, in turns, each pair on two processors; read the ratios, not the microseconds. Asked
in Python everywhere but in the spin on one cache line, which is the limit. The kernel's side of the
dual-port RAM is C, as in the library; a row with Python on both sides stands beside it.
"""

from __future__ import annotations

import ctypes
import importlib.util
import mmap
import multiprocessing
import os
import secrets
import shutil
import socket
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from conftest import Report
from sjerk._binding import ffi, lib
from sjerk.handshake import Layout, Segment

ROOT = Path(__file__).resolve().parent.parent
BYTES = 256
ROUNDS = 11  # each mechanism is measured so often, in turns
BLOCK = 20  # round trips between two looks at the clock
PATIENCE_NS = 2_000_000_000  # of one measurement
LAYOUT = Layout(command_bytes=BYTES, feedback_bytes=BYTES, abi=BYTES)
ICEORYX = "iceoryx2, polled from Python"
LIMIT = "C spin on a cache line"
OURS = "dual-port RAM, polled from Python"
PAYLOAD = bytes(range(256))

Ask = Callable[[int], list[float]]  # so many round trips, ns each


def processors() -> tuple[int, int]:
    """One for each side; the same if there is but one."""
    allowed = sorted(os.sched_getaffinity(0))
    return allowed[0], allowed[-1]


def timed(ask: Callable[[int], object], count: int) -> list[float]:
    """Nanoseconds per round trip, block by block; fewer blocks if the machine is busy."""
    ask(1)
    now = time.perf_counter_ns
    took = []
    end = now() + PATIENCE_NS
    while len(took) < count // BLOCK and (begun := now()) < end:
        ask(BLOCK)
        took.append((now() - begun) / BLOCK)
    return took


# ---- the other side: answers until it is told to stop -------------------------------------------


def receive(connection: socket.socket) -> bytes:
    """One whole message, or nothing at the end."""
    data = connection.recv(BYTES)
    while data and len(data) < BYTES:
        data += connection.recv(BYTES - len(data))
    return data


def answer_socket(family: int, address: Any) -> None:
    with socket.socket(family, socket.SOCK_STREAM) as connection:
        connection.connect(address)
        if family == socket.AF_INET:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        while data := receive(connection):
            connection.sendall(data)


def answer_pipe(pipe: Any) -> None:
    while data := pipe.recv_bytes():
        pipe.send_bytes(data)


def answer_queue(there: Any, back: Any) -> None:
    while data := there.get():
        back.put(data)


def answer_python(name: str, ready: Any) -> None:
    memory = ffi.new("char[]", BYTES)
    with Segment.attach(name, LAYOUT, role="kernel") as segment:
        base, out = segment.base, ffi.cast("void *", memory)
        collect, publish = lib.sj_command_collect, lib.sj_feedback_publish
        ready.send_bytes(b"ready")
        while memory[0] != b"\xff":
            if collect(base, out) == 1:
                publish(base, out)


def answer_c(name: str, peer: str, flag: str, ready: Any) -> None:
    with (
        Segment.attach(name, LAYOUT, role="kernel") as segment,
        Path(flag).open("r+b") as file,
        mmap.mmap(file.fileno(), 4096) as stop,
        ffi.from_buffer("char[]", stop) as at,
    ):
        ready.send_bytes(b"ready")
        base = int(ffi.cast("uintptr_t", segment.base))
        where = int(ffi.cast("uintptr_t", at))
        ctypes.CDLL(peer).peer_echo(ctypes.c_void_p(base), ctypes.c_void_p(where))


def answer_spin(peer: str, flag: str, count: int) -> None:
    with (
        Path(flag).open("r+b") as file,
        mmap.mmap(file.fileno(), 4096) as line,
        ffi.from_buffer("char[]", line) as at,
    ):
        where = int(ffi.cast("uintptr_t", at))
        ctypes.CDLL(peer).spin_echo(ctypes.c_void_p(where), ctypes.c_uint64(count))


class Message(ctypes.Structure):
    """What iceoryx2 carries."""

    _fields_ = (("number", ctypes.c_uint64), ("rest", ctypes.c_uint8 * (BYTES - 8)))


def iceoryx_ends(iox2: Any, out: str, back: str) -> tuple[Any, Any, Any]:
    """A node, a publisher and a subscriber."""
    iox2.set_log_level(iox2.LogLevel.Fatal)
    node = iox2.NodeBuilder.new().create(iox2.ServiceType.Ipc)

    def service(name: str) -> Any:
        builder = node.service_builder(iox2.ServiceName.new(name))
        return builder.publish_subscribe(Message).open_or_create()

    publisher = service(out).publisher_builder().create()
    subscriber = service(back).subscriber_builder().create()
    return node, publisher, subscriber


def answer_iceoryx(there: str, back: str, ready: Any) -> None:
    import iceoryx2 as iox2

    _node, publisher, subscriber = iceoryx_ends(iox2, back, there)
    ready.send_bytes(b"ready")
    number = 1
    while number:
        sample = subscriber.receive()
        if sample is not None:
            number = sample.payload().contents.number
            loan = publisher.loan_uninit()
            loan.write_payload(sample.payload().contents).send()


def child(target: Callable[..., None], processor: int, *arguments: Any) -> None:
    """The first function of every other side."""
    os.sched_setaffinity(0, {processor})
    target(*arguments)


# ---- this side ----------------------------------------------------------------------------------


class Bench:
    """Starts the other sides and asks them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.ours, self.theirs = processors()
        self.context = multiprocessing.get_context("spawn")
        self.peer = folder / "peer.so"
        compiler = shutil.which("cc") or shutil.which("gcc")
        assert compiler, "a C compiler is needed"
        files = [
            ROOT / "tests" / "stress" / "handshake_peer.c",
            *sorted((ROOT / "src" / "sjerk" / "dpram").glob("_*.c")),
        ]
        flags = ["-std=c11", "-O2", "-shared", "-fPIC", "-pthread", f"-I{ROOT / 'src' / 'sjerk'}"]
        subprocess.run([compiler, *flags, *map(str, files), "-o", str(self.peer)], check=True)

    def start(self, target: Callable[..., None], *arguments: Any) -> Any:
        process = self.context.Process(
            target=child, args=(target, self.theirs, *arguments), daemon=True
        )
        process.start()
        return process

    def flag(self) -> Path:
        path = self.folder / secrets.token_hex(4)
        path.write_bytes(bytes(4096))
        return path

    def sockets(self, family: int, address: Any, count: int) -> list[float]:
        with socket.socket(family, socket.SOCK_STREAM) as server:
            server.bind(address)
            server.listen(1)
            process = self.start(answer_socket, family, server.getsockname())
            connection, _ = server.accept()
        with connection:
            if family == socket.AF_INET:
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

            def some(count: int) -> None:
                for _ in range(count):
                    connection.sendall(PAYLOAD)
                    receive(connection)

            took = timed(some, count)
        process.join()
        return took

    def tcp(self, count: int) -> list[float]:
        return self.sockets(socket.AF_INET, ("127.0.0.1", 0), count)

    def unix(self, count: int) -> list[float]:
        return self.sockets(socket.AF_UNIX, str(self.folder / secrets.token_hex(4)), count)

    def pipe(self, count: int) -> list[float]:
        ours, theirs = self.context.Pipe()
        process = self.start(answer_pipe, theirs)

        def some(count: int) -> None:
            for _ in range(count):
                ours.send_bytes(PAYLOAD)
                ours.recv_bytes()

        took = timed(some, count)
        ours.send_bytes(b"")
        process.join()
        ours.close()
        theirs.close()
        return took

    def queue(self, count: int) -> list[float]:
        there, back = self.context.Queue(), self.context.Queue()
        process = self.start(answer_queue, there, back)

        def some(count: int) -> None:
            for _ in range(count):
                there.put(PAYLOAD)
                back.get()

        took = timed(some, count)
        there.put(b"")
        process.join()
        for queue in (there, back):
            queue.close()
            queue.join_thread()
        return took

    def ram(
        self,
        count: int,
        answer: Callable[..., None],
        *more: Any,
        flag: Path | None,
        ask: Callable[[Any, int], list[float]],
    ) -> list[float]:
        name = f"bench-{secrets.token_hex(6)}"
        ours, theirs = self.context.Pipe()
        with Segment.create(name, LAYOUT):
            process = self.start(answer, name, *more, theirs)
            assert ours.recv_bytes() == b"ready"
            with Segment.attach(name, LAYOUT, role="host") as host:
                took = ask(host.base, count)
                if flag is None:
                    lib.sj_command_publish(host.base, b"\xff" * BYTES)
                else:
                    with flag.open("r+b") as file:
                        file.write(b"\1")
                process.join()
        ours.close()
        theirs.close()
        return took

    @staticmethod
    def ask_python(base: Any, count: int) -> list[float]:
        memory, payload = ffi.new("char[]", BYTES), ffi.new("char[]", PAYLOAD)
        frame, command = ffi.cast("void *", memory), ffi.cast("void *", payload)
        number = ffi.new("uint64_t *")
        publish, read, latest = lib.sj_command_publish, lib.sj_feedback_read, lib.sj_feedback_latest

        def some(count: int) -> None:
            first = latest(base) + 1
            for expected in range(first, first + count):
                publish(base, command)
                while latest(base) != expected:
                    pass
                read(base, frame, number)

        return timed(some, count)

    def ask_c(self, base: Any, count: int) -> list[float]:
        took = (ctypes.c_uint32 * (count // BLOCK))()
        where = ctypes.c_void_p(int(ffi.cast("uintptr_t", base)))
        blocks, block = ctypes.c_uint64(count // BLOCK), ctypes.c_uint64(BLOCK)
        ctypes.CDLL(str(self.peer)).peer_ask(where, blocks, block, took)
        return [ns / BLOCK for ns in took]

    def ram_c(self, count: int) -> list[float]:
        flag = self.flag()
        more = (str(self.peer), str(flag))
        return self.ram(count, answer_c, *more, flag=flag, ask=self.ask_python)

    def ram_c_c(self, count: int) -> list[float]:
        flag = self.flag()
        more = (str(self.peer), str(flag))
        return self.ram(count, answer_c, *more, flag=flag, ask=self.ask_c)

    def ram_python(self, count: int) -> list[float]:
        return self.ram(count, answer_python, flag=None, ask=self.ask_python)

    def spin(self, count: int) -> list[float]:
        flag = self.flag()
        process = self.start(answer_spin, str(self.peer), str(flag), count)
        took = (ctypes.c_uint32 * (count // BLOCK))()
        with (
            flag.open("r+b") as file,
            mmap.mmap(file.fileno(), 4096) as line,
            ffi.from_buffer("char[]", line) as at,
        ):
            where = ctypes.c_void_p(int(ffi.cast("uintptr_t", at)))
            blocks, block = ctypes.c_uint64(count // BLOCK), ctypes.c_uint64(BLOCK)
            ctypes.CDLL(str(self.peer)).spin_ask(where, blocks, block, took)
        process.join()
        return [ns / BLOCK for ns in took]

    def iceoryx(self, count: int) -> list[float]:
        import iceoryx2 as iox2

        names = [f"sjerk-{secrets.token_hex(6)}" for _ in range(2)]
        ours, theirs = self.context.Pipe()
        _node, publisher, subscriber = iceoryx_ends(iox2, *names)
        process = self.start(answer_iceoryx, *names, theirs)
        assert ours.recv_bytes() == b"ready"
        message = Message(number=1)

        def some(count: int) -> None:
            for _ in range(count):
                publisher.loan_uninit().write_payload(message).send()
                while subscriber.receive() is None:
                    pass

        took = timed(some, count)
        publisher.loan_uninit().write_payload(Message(number=0)).send()
        process.join()
        ours.close()
        theirs.close()
        return took


def test_round_trips(tmp_path: Path, capsys: pytest.CaptureFixture[str], report: Report) -> None:
    """A table of medians and ratios; only their order is asserted."""
    bench = Bench(tmp_path)
    ways: dict[str, tuple[Ask, int]] = {
        LIMIT: (bench.spin, 2000),
        "dual-port RAM, C on both sides": (bench.ram_c_c, 2000),
        OURS: (bench.ram_c, 4000),
        "dual-port RAM, Python on both": (bench.ram_python, 2000),
        ICEORYX: (bench.iceoryx, 1500),
        "Unix socket": (bench.unix, 1000),
        "multiprocessing.Pipe": (bench.pipe, 1000),
        "TCP loopback": (bench.tcp, 1000),
        "multiprocessing.Queue": (bench.queue, 1000),
    }
    absent = importlib.util.find_spec("iceoryx2") is None
    if absent:
        del ways[ICEORYX]
    before = os.sched_getaffinity(0)
    medians: dict[str, list[float]] = {way: [] for way in ways}
    try:
        for _ in range(ROUNDS):
            for way, (ask, count) in ways.items():
                with capsys.disabled():
                    sys.stderr.write(f"\r{way:40}\r")
                os.sched_setaffinity(0, {bench.ours})
                medians[way].append(statistics.median(ask(count)) / 1000)
                os.sched_setaffinity(0, before)
    finally:
        os.sched_setaffinity(0, before)
    # Ratios within a round, so that both sides of each met the machine in the same mood.
    ratios = {
        way: statistics.median(v / o for v, o in zip(values, medians[OURS], strict=True))
        for way, values in medians.items()
    }
    head = (
        f"round trip of {BYTES} bytes, {ROUNDS} rounds: median of the medians [lowest .. highest]"
    )
    for way, values in medians.items():
        middle, spread = statistics.median(values), f"[{min(values):.2f} .. {max(values):.2f}]"
        report.line(head, f"{way:34}{middle:9.2f} us  {spread:20}{ratios[way]:7.2f} times ours")
    report.line(
        head,
        f"ours against TCP 1 : {ratios['TCP loopback']:.0f}, "
        + ("" if absent else f"against iceoryx2 1 : {ratios[ICEORYX]:.1f}, ")
        + f"against the limit {1 / ratios[LIMIT]:.1f} : 1",
    )
    if absent:
        report.line(head, "iceoryx2 is not installed (extra `bench`)")
    assert ratios[LIMIT] < 1 < ratios["TCP loopback"]
