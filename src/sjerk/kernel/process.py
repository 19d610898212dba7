"""The process of a kernel, from outside: started, waited for, ended.

What runs in it is ``sjerk.kernel.__main__``. It reads an ``Order`` from its standard input, then
the word to end. It also ends with the process that started it, whoever else holds the other end of
its input by then. Never here: the cycle, shared memory.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import subprocess
import sys
import sysconfig
from dataclasses import asdict, dataclass
from pathlib import Path

from sjerk.dpram.shortage import shortage
from sjerk.errors import KernelGoneError

#: What the process says once its cycle runs, and what it is told at the end.
RUNNING, END = b"running\n", b"end\n"
#: Bytes before an order: its length.
LENGTH = 8
_LOOK_MS = 50  # how often it is looked whether the process lives while it starts

#: Its first lines: the import path of its parent, then the answers' descriptor.
_BEGIN = (
    "import sys, json; sys.path[:] = json.loads(sys.argv[2]); "
    "from sjerk.kernel.__main__ import main; main(int(sys.argv[1]))"
)


@dataclass(frozen=True)
class Port:
    """What exchanges the external drives of a kernel inside its process.

    ``module`` has ``connect(core, cycle_ns, table)``; what that gives has ``exchange``
    (``sj_exchange *``), and is told to ``start`` once the cycle runs, to ``release`` the drives
    when all is at rest, and to ``close`` after the cycle. ``table``: plain data, for the module.
    """

    module: str
    table: dict[str, object]


@dataclass(frozen=True)
class Order:
    """What the process of a kernel needs to know, as data: it imports nothing of its parent's.

    ``description``: the kernel as its trace has it. ``clock``: the table of its ``Clock``.
    ``port``: the fields of its ``Port``, if it has one.
    ``parent``: the process that ends the kernel when it ends itself.
    """

    name: str
    description: str
    clock: dict[str, object]
    parent: int
    port: dict[str, object] | None = None

    def to_bytes(self) -> bytes:
        """As it is sent."""
        text = json.dumps(asdict(self)).encode()
        return len(text).to_bytes(LENGTH, "little") + text

    @classmethod
    def from_bytes(cls, text: bytes) -> Order:
        """What was sent, without its length."""
        return cls(**json.loads(text))


def import_path() -> list[str]:
    """Where the process imports from: as this one does now, but never from a working directory.

    The standard library comes first, so that no file beside a script takes its place.
    """
    library = {sysconfig.get_path("stdlib"), sysconfig.get_path("platstdlib")}
    library |= {f"{folder}/lib-dynload" for folder in library}
    archive = f"python{sys.version_info.major}{sys.version_info.minor}.zip"
    try:
        here = os.path.realpath(os.curdir)
    except FileNotFoundError:  # it has been removed: nothing is imported from there
        here = ""
    own = [p for p in sys.path if p in library or os.path.basename(p) == archive]
    rest = [p for p in sys.path if p not in own and p and os.path.realpath(p) != here]
    root = str(Path(__file__).resolve().parents[2])
    return [*own, *rest, *([] if root in rest else [root])]


def _site_options() -> list[str]:
    """What this process was told of its site, where import hooks come from."""
    told = {"-S": sys.flags.no_site, "-s": sys.flags.no_user_site}
    return [option for option, given in told.items() if given]


class KernelProcess:
    """A process that runs the cycle of one kernel."""

    def __init__(self) -> None:
        """Start it; it waits for its order. Raises KernelGoneError where that cannot be."""
        self._owner = os.getpid()
        try:
            self._start()
        except OSError as error:
            missing = shortage(error, "/") or f"{sys.executable}: {error.strerror}"
            raise KernelGoneError(f"no process for the kernel: {missing}") from error

    def _start(self) -> None:
        answers, for_it = os.pipe()
        self._answers = os.fdopen(answers, "rb", buffering=0)
        try:
            self._process = subprocess.Popen(
                [
                    *(sys.executable, "-P", *_site_options(), "-c", _BEGIN),
                    *(str(for_it), json.dumps(import_path())),
                ],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,  # whatever is printed there is not for the parent's
                pass_fds=[for_it],
                env={k: v for k, v in os.environ.items() if k != "PYTHONPATH"},  # it is in the path
                start_new_session=True,  # Ctrl-C is the host's to turn into a stop
            )
        except BaseException:
            self._answers.close()
            raise
        finally:
            os.close(for_it)
        assert self._process.stdin is not None
        self._stdin = self._process.stdin

    @property
    def pid(self) -> int:
        """Its number."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether it runs."""
        return self._process.poll() is None

    def run(self, order: Order) -> None:
        """Return when its cycle runs; raises KernelGoneError."""
        with contextlib.suppress(BrokenPipeError):
            self._stdin.write(order.to_bytes())
            self._stdin.flush()
        # not its end of file alone: a process forked meanwhile may hold the other end
        found, poll = b"", select.poll()
        poll.register(self._answers, select.POLLIN)
        while not found.endswith(b"\n"):
            if not poll.poll(_LOOK_MS):
                if self.alive:
                    continue
                break
            more = self._answers.read(1)
            if not more:
                break
            found += more
        if found != RUNNING:
            code = self._process.wait()
            why = (
                found.decode(errors="replace").strip() or f"its process ended with exit code {code}"
            )
            raise KernelGoneError(f"kernel {order.name!r} did not start: {why}")

    def end(self) -> None:
        """Let it stop the motion and end; returns when it has.

        In a process that was forked from the owner it does nothing: the kernel is not its own.
        """
        if os.getpid() != self._owner:
            self._process.returncode = 0  # nothing for this one to wait for
            for pipe in (self._stdin, self._answers):
                with contextlib.suppress(OSError):
                    os.close(pipe.fileno())
            return
        with contextlib.suppress(BrokenPipeError), self._stdin:
            self._stdin.write(END)
        self._answers.close()
        self._process.wait()
