"""``sjerk drive --ethercat IF``: simulated drives on a network interface, and faults on demand.

A control socket (``--control``, a datagram socket in the file system) takes the lines of
``--fault``: ``cut 2``, ``heal``, ``power 6``, ``lose 50``, ``wkc 20``, ``late 10 500`` (us),
``state 3 0x14 0x1a``, ``inject 0 OVER_CURRENT``, ``clear 0 OVER_CURRENT``, ``status``.
The answer is a line of JSON.

Never here: frames, states.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable
from pathlib import Path

from sjerk.drive import DriveConfig, DriveFault
from sjerk.errors import InputError, SjerkError
from sjerk.ports.ethercat.behaviours import BEHAVIOURS
from sjerk.ports.ethercat.capture import InterfaceCapture
from sjerk.ports.ethercat.line import Line

_LONGEST = 65536
_ANSWER_S = 3.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of ``sjerk drive`` that belong to EtherCAT."""
    group = parser.add_argument_group(
        "EtherCAT (whoever is on the cable commands the drives; an emulator for tests)"
    )
    group.add_argument("--ethercat", metavar="IF", help="be a line of drives on this interface")
    group.add_argument("--drives", type=int, default=1, help="how many (%(default)s)")
    group.add_argument(
        "--behaviour",
        default="free",
        metavar="NAME[,NAME...]",
        help=f"of all drives or of each: {', '.join(BEHAVIOURS)} (%(default)s)",
    )
    group.add_argument("--at", type=int, default=0, metavar="COUNTS", help="where they stand")
    group.add_argument("--drift-ppm", type=float, default=20.0, help="of the clocks (%(default)s)")
    group.add_argument("--alias", type=int, default=0, help="of the first drive, others count on")
    group.add_argument("--sii", type=Path, metavar="F", help="keep the SII in this file")
    group.add_argument(
        "--esi", type=Path, metavar="F.xml", help="write the ESI file; alone: no more"
    )
    group.add_argument("--capture", type=Path, metavar="F.pcapng", help="write every frame here")
    group.add_argument("--control", type=Path, metavar="SOCKET", help="take faults here")
    group.add_argument("--fault", metavar="WORDS", help='tell a running line: "cut 2", "status"')


def wanted(options: argparse.Namespace) -> bool:
    """Whether the arguments ask for EtherCAT, not CANopen."""
    return bool(options.ethercat or options.esi or options.fault)


def run(options: argparse.Namespace) -> int:
    """Be a line of drives until SIGINT or SIGTERM, or tell a running one a fault."""
    if options.fault:
        return _ask(options.control, options.fault)
    config = DriveConfig.for_motor(options.motor, load_inertia_ratio=options.load_inertia)
    names = options.behaviour.split(",")
    line = Line(
        options.ethercat,
        drives=options.drives,
        behaviour=names[0] if len(names) == 1 else names,
        config=config,
        at=options.at,
        drift_ppm=options.drift_ppm,
        alias=options.alias,
        memory=options.sii,
        tell=_tell,
    )
    if options.esi:
        options.esi.write_text(line.esi(), encoding="utf-8")
    if not options.ethercat:
        return 0
    ended = threading.Event()
    for ending in (signal.SIGINT, signal.SIGTERM):
        signal.signal(ending, lambda *_: ended.set())
    with contextlib.ExitStack() as stack:
        if options.capture:
            stack.enter_context(InterfaceCapture(options.ethercat, options.capture))
        control = _Control(options.control, line) if options.control else None
        if control:
            stack.callback(control.close)
        stack.enter_context(line)
        print(f"{options.drives} drives are ready on {options.ethercat}", flush=True)
        while line.serving and not ended.wait(0.1):
            pass
    for number in range(options.drives):
        print(f"{number}: {line.report(number)}", flush=True)
    return 0


def _tell(number: int, what: str) -> None:
    print(f"{number}: {what}", flush=True)


def _ask(path: Path | None, words: str) -> int:
    """Send a line to the control socket and print the answer."""
    if path is None:
        print(
            "sjerk: --fault needs --control SOCKET, the one the line was started with",
            file=sys.stderr,
        )
        return 2
    own = path.with_name(f"{path.name}.{os.getpid()}")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as asking:
        try:
            asking.bind(str(own))
            asking.settimeout(_ANSWER_S)
            asking.sendto(words.encode(), str(path))
            answer = json.loads(asking.recv(_LONGEST))
        except (FileNotFoundError, ConnectionError, PermissionError) as fault:
            why = f"no line of drives listens there ({fault.strerror})"
            raise InputError("--control", str(path), why) from fault
        finally:
            own.unlink(missing_ok=True)
    if "error" in answer:
        print(f"sjerk: {answer['error']}", file=sys.stderr)
        return 1
    print(json.dumps(answer))
    return 0


def apply(line: Line, words: list[str]) -> None:
    """Do what a line of the control socket says; `ValueError` when it says nothing known."""
    numbers = [int(word, 0) for word in words[1:] if word[:1].isdigit()]
    jobs: dict[tuple[str, int], Callable[..., None]] = {
        ("cut", 1): line.cut,
        ("heal", 0): line.heal,
        ("power", 1): line.power_cycle,
        ("lose", 1): line.lose,
        ("wkc", 1): line.wkc,
        ("late", 2): lambda every, us: line.late(every, ns=us * 1000),
        ("state", 2): line.state,
        ("state", 3): line.state,
        ("status", 0): lambda: None,
    }
    if (
        words[:1] in (["inject"], ["clear"])
        and len(words) == 3
        and words[2] in DriveFault.__members__
    ):
        line.inject(numbers[0], DriveFault[words[2]], words[0] == "inject")
        return
    job = jobs.get((words[0] if words else "", len(numbers)))
    if job is None or len(numbers) != len(words) - 1:
        known = "cut N, heal, power N, lose N, wkc N, late N US, state N STATUS [CODE], "
        raise ValueError(f"{' '.join(words)!r} is not one of {known}inject N FAULT, status")
    job(*numbers)


class _Control:
    """The control socket and the thread that answers it."""

    def __init__(self, path: Path, line: Line) -> None:
        self._path, self._line = path, line
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(path))
        self._socket.settimeout(0.2)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        self._socket.close()
        self._path.unlink(missing_ok=True)

    def _run(self) -> None:
        while not self._ended.is_set():
            try:
                words, sender = self._socket.recvfrom(_LONGEST)
            except TimeoutError:
                continue
            try:
                apply(self._line, words.decode("ascii", "replace").split())
                answer = self._line.status()
            except (SjerkError, ValueError) as error:
                answer = {"error": str(error)}
            if sender:
                with contextlib.suppress(OSError):
                    self._socket.sendto(json.dumps(answer).encode(), sender)
