"""The process of a kernel, from inside: ``python -P -m sjerk.kernel``, started by ``process.py``.

Builds the kernel in its shared memory and runs its cycle in a thread, wholly in C, until the
standard input ends. Never here: equations, what a cycle does.
"""

from __future__ import annotations

import pickle
import signal
import sys
import threading

from sjerk._binding import ffi, lib
from sjerk.handshake import TRACE, HostWatch, Segment
from sjerk.host.reader import layout
from sjerk.kernel import trace
from sjerk.kernel.memory import build, rehearsal
from sjerk.kernel.process import RUNNING, Order


class _EndError(Exception):
    """SIGTERM came."""


def main() -> None:
    """Run one kernel, as its order says, until the input ends or SIGTERM comes."""

    def terminate(*_: object) -> None:
        raise _EndError

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, terminate)
    try:
        order: Order = pickle.load(sys.stdin.buffer)
    except (EOFError, pickle.UnpicklingError, _EndError):
        return  # who wanted the kernel was ended before it could say which
    name, axes, cycle_time, text = order.name, order.axes, order.cycle_time, order.description
    trace_layout = trace.layout(len(axes), cycle_time, len(text))
    with (
        Segment.attach(name + TRACE, trace_layout, role="kernel") as traced,
        Segment.attach(name, layout(len(axes)), role="kernel") as segment,
    ):
        kernel = build(axes, cycle_time, order.reactions, segment.base)
        lib.sj_feedback_publish(traced.base, text)
        trace.touch(traced)
        kernel.trace = traced.base
        end = ffi.new("int32_t *")
        options = order.clock.to_c(cycle_time)
        copy, _memory = rehearsal(len(axes), cycle_time) if options.spin_ns else (ffi.NULL, None)

        def run() -> None:
            report = ffi.addressof(kernel.feedback, "clock")
            lib.sj_clock_prepare(kernel, layout(len(axes)).size, options, report)
            lib.sj_clock_run(kernel, copy, options, end)

        cycle = threading.Thread(target=run)
        with HostWatch(segment, period_s=0.01):
            cycle.start()
            try:
                sys.stdout.buffer.write(RUNNING)
                sys.stdout.buffer.flush()
                sys.stdin.buffer.read()
            except (_EndError, BrokenPipeError):
                pass
            lib.sj_clock_end(end)
            cycle.join()
        for mine in (segment, traced):
            lib.sj_shm_leave_kernel(mine.base)
            mine.unlink()  # for a parent that died


if __name__ == "__main__":
    main()
