"""A rehearsed cycle: the kernel does not notice, and the copy does what the kernel then does."""

from __future__ import annotations

from typing import Any, Literal

from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.loops import enabled
from sjerk import Axis, DriveConfig, Limits
from sjerk._binding import ffi, lib
from sjerk.kernel.memory import rehearsal

AXES = 3
LIMITS = Limits(90.0, 500.0, 5000.0)

ORDERS = st.one_of(
    st.tuples(st.just("move"), st.lists(st.floats(-50, 50), min_size=AXES, max_size=AXES)),
    st.tuples(st.just("jog"), st.floats(-80, 80)),
    st.tuples(st.just("halt"), st.none()),
    st.tuples(st.just("override"), st.floats(0, 2)),
    st.tuples(st.just("disable"), st.none()),
    st.tuples(st.just("nothing"), st.none()),
)


def give(host: Any, order: str, value: Any) -> None:
    if order == "move":
        host.move(value)
    elif order == "jog":
        host.jog([value] * AXES)
    elif order == "override":
        host.override(value)
    elif order == "halt":
        host.halt()
    elif order == "disable":
        host.disable(axes=[0])


@settings(max_examples=30)
@given(
    st.sampled_from([DriveConfig(), "ideal"]),
    st.lists(st.tuples(ORDERS, st.integers(1, 60)), min_size=1, max_size=6),
)
def test_a_rehearsal_is_the_next_cycle_and_changes_nothing(
    drive: DriveConfig | Literal["ideal"], script: list[Any]
) -> None:
    """Not a bit of kernel and segment; the copy commands what the kernel does in the next cycle."""
    kernel, host = enabled([Axis(LIMITS, 2**24 / 360, drive)] * AXES, 1e-3)
    copy, memory = rehearsal(AXES, 1e-3, clocked=False)
    raw, at = kernel.core, ffi.offsetof("sj_kernel", "axis")
    segment = host.link.segment
    shared = ffi.buffer(segment.base, segment.layout.size)
    for order, cycles in script:
        give(host, *order)
        kernel.step()
        before = bytes(ffi.buffer(raw)), bytes(shared)
        lib.sj_kernel_rehearse(raw, copy)
        assert (bytes(ffi.buffer(raw)), bytes(shared)) == before
        for _ in range(cycles):
            lib.sj_kernel_rehearse(raw, copy)
            kernel.step()
            own, told = (
                bytes(ffi.buffer(k)[at : at + AXES * ffi.sizeof("sj_axis")]) for k in (raw, copy)
            )
            assert own == told
    memory.close()
