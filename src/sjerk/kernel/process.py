"""The process of a kernel, from outside: started, waited for, ended.

What runs in it is ``python -m sjerk.kernel`` (``__main__.py``): it reads an ``Order`` from its
standard input, and the end of that input is the order to end. Never here: the cycle, shared memory.
"""

from __future__ import annotations

import pickle
import subprocess
import sys
from dataclasses import dataclass

from sjerk.errors import KernelGoneError
from sjerk.kernel.axis import Axis
from sjerk.kernel.clock import Clock
from sjerk.kernel.reactions import Reactions

#: What the process says once its cycle runs.
RUNNING = b"running\n"


@dataclass(frozen=True)
class Order:
    """What the process of a kernel needs to know; ``description`` goes into its trace."""

    name: str
    axes: tuple[Axis, ...]
    cycle_time: float
    clock: Clock
    reactions: Reactions
    description: bytes


class KernelProcess:
    """A process that runs the cycle of one kernel."""

    def __init__(self) -> None:
        """Start it; it waits for its order."""
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "sjerk.kernel"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,  # Ctrl-C is the host's to turn into a stop
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._stdin, self._stdout = self._process.stdin, self._process.stdout

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
        pickle.dump(order, self._stdin)
        self._stdin.flush()
        if self._stdout.readline() != RUNNING:
            raise KernelGoneError(f"kernel {order.name!r} did not start")

    def end(self) -> None:
        """Let it stop the motion and end; returns when it has."""
        with self._stdin, self._stdout:
            pass  # the end of its input is the order
        self._process.wait()
