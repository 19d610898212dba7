"""The process of a kernel, from inside; started by ``process.py``.

Builds the kernel in its shared memory and runs its cycle in a thread, wholly in C, until it is told
to end, SIGTERM comes, or its parent has ended. Never here: equations, what a cycle does.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import select
import signal
import threading
import time
from typing import Any

from sjerk._binding import ffi, lib
from sjerk.errors import SjerkError
from sjerk.handshake import TRACE, HostWatch, Segment
from sjerk.host.reader import layout
from sjerk.kernel import trace
from sjerk.kernel.clock import Clock
from sjerk.kernel.memory import build, rehearsal
from sjerk.kernel.process import LENGTH, RUNNING, Order
from sjerk.kernel.tables import kernel_fields

_STDIN = 0
_REST_S = 10.0  # longest wait for drives outside to come to rest
_LOOK_MS = 100  # how often it is looked whether the parent lives, where the system does not tell


class _Ends:
    """All that ends the kernel but its own faults: the word, SIGTERM, the end of the parent.

    A signal is a byte in a pipe, so that it interrupts nothing half done.
    """

    def __init__(self) -> None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signals, wake = os.pipe()
        os.set_blocking(wake, False)
        signal.set_wakeup_fd(wake, warn_on_full_buffer=False)
        signal.signal(signal.SIGTERM, lambda *_: None)
        self._signals = signals
        self._parent: int | None = None
        self._handle: int | None = None

    def of(self, parent: int) -> None:
        """Its number; from now on its end counts."""
        self._parent = parent
        with contextlib.suppress(OSError):  # an old kernel, or a filter of system calls
            self._handle = os.pidfd_open(parent)

    def _orphaned(self) -> bool:
        """A number may be another's by now, but the parent of this process is one process."""
        return self._parent is not None and os.getppid() != self._parent

    def wait(self) -> bool:
        """Until there is something to read (True) or it is to end by other reasons (False)."""
        poll = select.poll()
        for fd in (_STDIN, self._signals, self._handle):
            if fd is not None:
                poll.register(fd, select.POLLIN)
        timeout = _LOOK_MS if self._parent is not None and self._handle is None else None
        while not self._orphaned():
            ready = [fd for fd, _ in poll.poll(timeout)]
            if ready:
                return ready == [_STDIN]
        return False

    def read(self, count: int) -> bytes:
        """So many bytes of the standard input; fewer where it ends, or the kernel is to end."""
        found = b""
        while len(found) < count and self.wait():
            more = os.read(_STDIN, count - len(found))
            if not more:
                break
            found += more
        return found


def _order(ends: _Ends) -> Order | None:
    length = ends.read(LENGTH)
    count = int.from_bytes(length, "little")
    text = ends.read(count) if len(length) == LENGTH else b""
    return Order.from_bytes(text) if text and len(text) == count else None


class _Outside:
    """What exchanges the drives outside, by the order's port; nothing where there is none."""

    def __init__(self, order: Order, kernel: Any, cycle_time: float) -> None:
        self._connection: Any = None
        if order.port is not None:
            module = importlib.import_module(str(order.port["module"]))
            cycle_ns = round(cycle_time * 1e9)
            self._connection = module.connect(kernel, cycle_ns, order.port["table"])

    @property
    def exchange(self) -> Any:
        return ffi.NULL if self._connection is None else self._connection.exchange

    def start(self) -> None:
        if self._connection is not None:
            self._connection.start()

    def rest(self, end: Any) -> None:
        """Let the kernel stop and disable its drives, then let the drives go."""
        if self._connection is None:
            return
        lib.sj_clock_order(end, lib.SJ_END_REST)
        until = time.monotonic() + _REST_S
        while not lib.sj_clock_at_rest(end) and time.monotonic() < until:
            time.sleep(0.002)
        self._connection.release()

    def close(self) -> None:
        if self._connection is not None:
            self._connection.close()


def _say(answers: int, text: bytes) -> None:
    with contextlib.suppress(BrokenPipeError):
        os.write(answers, text)
    os.close(answers)


def main(answers: int) -> None:
    """Run one kernel, as its order says, and tell the descriptor ``answers`` when it runs."""
    ends = _Ends()
    order = _order(ends)
    if order is None:
        return  # who wanted the kernel was ended before it could say which
    ends.of(order.parent)
    text = order.description.encode()
    _, values = kernel_fields(order.name, json.loads(text))
    axes, cycle_time = values["axes"], values["cycle_time"]
    trace_layout = trace.layout(len(axes), cycle_time, len(text))
    with (
        Segment.attach(order.name + TRACE, trace_layout, role="kernel") as traced,
        Segment.attach(order.name, layout(len(axes)), role="kernel") as segment,
    ):
        kernel = build(axes, cycle_time, values["reactions"], segment.base)
        lib.sj_feedback_publish(traced.base, text)
        trace.touch(traced)
        kernel.trace = traced.base
        end = ffi.new("sj_clock_end *")
        options = Clock(**order.clock).to_c(cycle_time)  # type: ignore[arg-type]
        copy, _memory = rehearsal(len(axes), cycle_time) if options.spin_ns else (ffi.NULL, None)
        try:
            outside = _Outside(order, kernel, cycle_time)
        except (SjerkError, OSError) as error:
            _say(answers, f"{error}\n".encode())
            return

        def run() -> None:
            report = ffi.addressof(kernel.feedback, "clock")
            lib.sj_clock_prepare(kernel, layout(len(axes)).size, options, report)
            lib.sj_clock_run(kernel, copy, options, outside.exchange, end)

        cycle = threading.Thread(target=run)
        with HostWatch(segment, period_s=0.01):
            cycle.start()
            try:
                outside.start()
            except (SjerkError, OSError) as error:
                _say(answers, f"{error}\n".encode())
            else:
                _say(answers, RUNNING)
                ends.read(1)
                outside.rest(end)
            lib.sj_clock_order(end, lib.SJ_END_LEAVE)
            cycle.join()
        outside.close()
        for mine in (segment, traced):
            lib.sj_shm_leave_kernel(mine.base)
            mine.unlink()  # for a parent that died


if __name__ == "__main__":
    main(1)
