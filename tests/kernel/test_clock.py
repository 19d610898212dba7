"""The cyclic loop: what is asked of the system, what it grants, and what is counted."""

from __future__ import annotations

import os
import resource
from pathlib import Path

import pytest

from sjerk import Axis, Clock, InputError, Limits, MotionKernel
from sjerk._binding import ffi, lib
from sjerk.host import Grant

T = 1e-3
AXIS = Axis(Limits(90.0, 500.0, 5000.0), counts_per_unit=2**24 / 360.0)


def test_nothing_asked_nothing_refused() -> None:
    """Without a Clock the loop runs under the process's own scheduling and says so."""
    with MotionKernel([AXIS], T) as kernel, kernel.host() as host:
        clock = host.feedback().timing.clock
    assert clock.spin == 0.0
    for grant in (clock.scheduling, clock.pinning, clock.memory):
        assert (grant.asked, grant.granted, grant.reason) == ("nothing", True, "")


def test_each_wish_is_granted_or_refused_with_the_reason_and_the_cycle_runs() -> None:
    """Real-time scheduling, a processor that exists or not, locked memory: all are answered."""
    mine = min(os.sched_getaffinity(0))
    for cpu in (mine, 1023):
        wish = Clock(spin_us=100.0, priority=10, cpu=cpu, lock_memory=True)
        with MotionKernel([AXIS], T, clock=wish) as kernel, kernel.host() as host:
            host.enable()
            host.move(1.0).wait(timeout=60.0)
            timing = host.feedback().timing
            assert kernel.pid is not None
            status = Path(f"/proc/{kernel.pid}/status").read_text()
        clock = timing.clock
        assert clock.pinning.granted == (cpu == mine)
        for grant in (clock.scheduling, clock.pinning, clock.memory):
            assert grant.asked != "nothing"
            assert grant.granted or grant.reason
        if clock.memory.granted and not clock.memory.reason:
            assert "VmLck:\t       0 kB" not in status
        assert clock.spin == clock.spin_asked == pytest.approx(100e-6)
        assert timing.period.count > 100


@pytest.mark.parametrize("share", [1.0, 0.95, 0.5])
def test_spinning_and_computing_together_leave_the_system_its_share(share: float) -> None:
    """However long the wait that is asked: busy time per cycle stays below the real-time share."""
    for spin_us in (0.0, 50.0, 900.0, 1e5):
        options = Clock(spin_us=spin_us).to_c(T)
        for computing in (0, 10_000, 400_000, 2_000_000):
            spin = lib.sj_clock_spin_ns(options, share, computing)
            assert spin <= options.spin_ns
            assert spin == 0 or spin + computing <= share * T * 1e9
    assert lib.sj_clock_spin_ns(Clock(spin_us=50.0).to_c(T), 1.0, 10_000) == 50_000


def test_a_suspended_kernel_counts_what_it_missed_and_makes_no_burst() -> None:
    """Stopped for 40 cycles: they are late, and as many frames are not made up for."""
    with MotionKernel([AXIS], T) as kernel, kernel.host() as host:
        link = host.link
        before = host.feedback()
        link.wait_until(lambda frame: frame.cycle > before.cycle, 30.0, "a cycle")
        known = host.feedback()  # a frame does not know its own latency, the next one does
        assert kernel.pid is not None
        os.kill(kernel.pid, 19)
        os.waitid(os.P_PID, kernel.pid, os.WSTOPPED)
        for _ in range(10):
            os.sched_yield()
        lapse = host.feedback()
        while lib.sj_clock_now_ns() < lapse.time_ns + 40e6:
            os.sched_yield()
        os.kill(kernel.pid, 18)
        link.wait_until(lambda frame: frame.cycle > lapse.cycle + 2, 30.0, "cycles")
        resumed = host.feedback()
        link.wait_until(lambda frame: frame.cycle > resumed.cycle + 10, 30.0, "cycles")
        after = host.feedback()
        link.wait_until(lambda frame: frame.cycle > after.cycle, 30.0, "a cycle")
        last = host.feedback()
    missed = after._frame.late - before._frame.late
    assert missed >= 39
    elapsed = (after.time_ns - before.time_ns) / (T * 1e9)
    # both frames tell when their cycle really began, which is late by what the latencies say
    worst = known.timing.latency.worst + last.timing_since(resumed).latency.worst
    assert after.cycle - before.cycle + missed == pytest.approx(elapsed, abs=1.0 + worst / T)


def test_the_report_of_some_cycles_leaves_out_those_before() -> None:
    """Counts, percentiles and the worst are those of the cycles between two frames."""
    with MotionKernel([AXIS], T) as kernel, kernel.host() as host:
        host.link.wait_until(lambda frame: frame.cycle > 2, 30.0, "a period")
        before = host.feedback()
        lib.sj_histogram_add(ffi.addressof(before._frame.latency), 2**40)  # a worst long ago
        host.link.wait_until(lambda frame: frame.cycle > before.cycle + 200, 30.0, "cycles")
        after = host.feedback()
    lib.sj_histogram_add(ffi.addressof(after._frame.latency), 2**40)
    timing = after.timing_since(before)
    assert timing.late == after.timing.late - before.timing.late
    for row in (timing.latency, timing.period, timing.computing):
        assert row.count == after.cycle - before.cycle
        assert 0.0 < row.median <= row.p99 <= row.p999 <= row.worst
    assert after.timing.latency.worst > 1000.0 > timing.latency.worst


@pytest.mark.parametrize(
    ("field", "wish"),
    [
        ("spin_us", {"spin_us": -1.0}),
        ("spin_us", {"spin_us": float("nan")}),
        ("priority", {"priority": 100}),
        ("priority", {"priority": True}),
        ("cpu", {"cpu": -1}),
        ("cpu", {"cpu": 1.5}),
        ("lock_memory", {"lock_memory": 1}),
    ],
)
def test_wishes_that_make_no_sense_are_refused_at_once(field: str, wish: dict) -> None:
    """Field, value and limit."""
    with pytest.raises(InputError, match=field):
        Clock(**wish)


def test_a_refusal_carries_the_words_of_the_system() -> None:
    """An errno becomes its text; a part is told as a part."""
    assert Grant.of("SCHED_FIFO 80", -1) == Grant("SCHED_FIFO 80", False, os.strerror(1))
    assert "cycle only" in Grant.of("locked memory", lib.SJ_GRANT_PART).reason


def test_memory_beyond_the_limit_is_locked_in_part_or_refused() -> None:
    """Under a limit that the process exceeds, what the cycle touches is locked, or it says why."""
    kernel = MotionKernel([AXIS], T)
    host = kernel.host()
    child = os.fork()
    if child == 0:  # its own limit, and no capability to ignore it: the report is the exit code
        code = 99
        try:
            resource.setrlimit(resource.RLIMIT_MEMLOCK, (0, 0))
            if os.getuid() == 0:
                os.setuid(65534)
            report = ffi.new("sj_clock_report *")
            options = Clock(lock_memory=True).to_c(T)
            lib.sj_clock_prepare(kernel.core, 4096, options, report)
            code = -report.memory if report.memory < 0 else 77
        finally:
            os._exit(code)
    _, status = os.waitpid(child, 0)
    assert os.strerror(os.waitstatus_to_exitcode(status)) in (os.strerror(1), os.strerror(12))
    del host
