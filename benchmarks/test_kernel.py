"""The kernel as a program: computing time, wake-up, cost per axis, Python's loop beside ruckig's.

Times of cycles are CLOCK_THREAD_CPUTIME_ID, as in the kernel's own report; each reading of that
clock is part of them, and its own cost is printed beside.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from conftest import Report
from sjerk import Axis, Clock, DriveConfig, Host, Limits, MotionKernel
from sjerk._binding import ffi, lib
from sjerk.cli.cyclictest import Cyclictest
from sjerk.cli.demo import AFTER_S, COUNTS_PER_DEGREE, LIMITS, play, single_move, streamed
from sjerk.host import Distribution
from sjerk.kernel.memory import rehearsal
from sjerk.trajectory import read_recording, shipped_recording

HERE = Path(__file__).parent
COUNTS = 2**24 / 360.0
FAST = Limits(90.0, 500.0, 5000.0)
REAL_TIME = Clock(priority=80, lock_memory=True)
AXES = 7
COMPUTING = "computing time of a cycle of 7 axes, us"
WAKING = "wake-up latency of a kernel of 7 axes beside cyclictest, same seconds, us"
LOOP = "seven axes from Python, drives and positions; ratio to ruckig's update loop (goal: 1.0)"

Times = Callable[..., np.ndarray]


@pytest.fixture(scope="module")
def cycle_times(tmp_path_factory: pytest.TempPathFactory) -> Times:
    """CPU time (ns) of each of so many cycles, run by a loop in C."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("no C compiler")
    made = tmp_path_factory.mktemp("times") / "cycle_times.so"
    order = [compiler, "-O2", "-std=c11", "-shared", "-fPIC", f"-I{HERE.parent / 'src' / 'sjerk'}"]
    subprocess.run([*order, str(HERE / "cycle_times.c"), "-o", str(made)], check=True)
    run = ctypes.CDLL(str(made)).cycle_times
    pointer, count = ctypes.c_void_p, ctypes.c_uint64
    run.argtypes = [
        *(pointer, pointer, count, count, count, ctypes.c_int32, pointer, pointer, pointer)
    ]
    cycle, rehearse = (
        int(ffi.cast("uintptr_t", ffi.addressof(lib, name)))
        for name in ("sj_kernel_cycle", "sj_kernel_rehearse")
    )

    def times(
        kernel: MotionKernel,
        cycles: int,
        *,
        period_us: int = 0,
        spin_us: int = 0,
        empty: bool = False,
    ) -> np.ndarray:
        out = np.zeros(cycles, dtype=np.uint64)
        external = int(kernel.axes[0].drive == "external")
        at = int(ffi.cast("uintptr_t", kernel.core))
        copy, memory = rehearsal(len(kernel.axes), kernel.cycle_time, clocked=False)
        pair = (rehearse, int(ffi.cast("uintptr_t", copy))) if spin_us else (None, None)
        waits = period_us * 1000, spin_us * 1000
        run(None if empty else cycle, at, cycles, *waits, external, *pair, out.ctypes.data)
        memory.close()
        return out

    return times


def ready(times: Times, axes: int, drive: Any, limits: Limits = FAST) -> tuple[MotionKernel, Host]:
    """A kernel at 250 us in this process whose drives follow."""
    kernel = MotionKernel([Axis(limits, COUNTS, drive)] * axes, 250e-6)
    host = kernel.host()
    host.enable()
    kernel.step()
    times(kernel, 20)
    assert all(axis.follows for axis in host.feedback().axes)
    return kernel, host


def percentiles(times: np.ndarray) -> str:
    cuts = np.percentile(times, (50, 99, 99.9, 100)) / 1e3
    return " ".join(
        f"{n} {x:8.2f}" for n, x in zip(("median", "p99", "p99.9", "worst"), cuts, strict=True)
    )


def row(times: Distribution) -> str:
    cuts = (times.median, times.p99, times.p999, times.worst)
    return " ".join(
        f"{n} {x * 1e6:8.2f}"
        for n, x in zip(("median", "p99", "p99.9", "worst"), cuts, strict=True)
    )


# ---- computing time ------------------------------------------------------------------------------


@pytest.mark.parametrize("drive", ["simulated", "external"])
def test_cycles_by_a_loop_in_c(report: Report, cycle_times: Times, drive: str) -> None:
    """In motion; back to back, every 250 us with the processor asleep between, and that rehearsed.

    Rehearsed: the last 150 us are watched, not slept, as by ``Clock(spin_us=150)``; a usual process
    wakes up some 60 us late. A round in which the timer's interrupt falls into the cycles has
    its time too.
    """
    kernel, host = ready(cycle_times, AXES, "external" if drive == "external" else DriveConfig())
    host.move([1e4] * AXES)
    cycle_times(kernel, 100)
    goal = f"(goal: p99 {3 if drive == 'external' else 15})"
    for period_us, spin_us, name in (
        (0, 0, "back to back"),
        (250, 0, "each 250 us"),
        (250, 150, "each 250 us, rehearsed"),
    ):
        rounds = [cycle_times(kernel, 2000, period_us=period_us, spin_us=spin_us) for _ in range(6)]
        p99 = sorted(np.percentile(seen, 99) / 1e3 for seen in rounds)
        report.line(
            COMPUTING,
            f"{drive:9} {name:22} {percentiles(np.concatenate(rounds))} "
            f"p99 by rounds {p99[0]:.2f} .. {p99[-1]:.2f} {goal}",
        )
    assert host.feedback().moving
    if drive == "external":
        seen = cycle_times(kernel, 8000, period_us=250, empty=True)
        report.line(COMPUTING, f"of these the clock's own, 250 us {percentiles(seen)}")


@pytest.mark.parametrize("synchronization", ["none", "time"])
@pytest.mark.parametrize("kept", ["warm", "long ago"])
def test_the_cycle_that_plans_all_axes(
    report: Report, cycle_times: Times, synchronization: Any, kept: str
) -> None:
    """New goals for all axes in mid-motion, right after the last ones or 200 cycles later."""
    kernel, host = ready(cycle_times, AXES, "external")
    rng = np.random.default_rng(1)
    seen = []
    for _ in range(1000):
        host.move(rng.uniform(-60.0, 60.0, AXES).tolist(), synchronization=synchronization)
        seen.append(cycle_times(kernel, 1)[0])
        assert host.link.frame().result == lib.SJ_RESULT_ACCEPTED
        cycle_times(kernel, 2 if kept == "warm" else 200)
    name = f"planning all, sync {synchronization}, planned last {kept}"
    report.line(COMPUTING, f"{name:45} {percentiles(np.array(seen))} (goal: 20)")


def frames(host: Host, seconds: float) -> Iterator[tuple[int, int, np.ndarray]]:
    """Cycle, newest goal and histogram of computing time of every frame that is seen."""
    end, last = time.monotonic() + seconds, 0
    while time.monotonic() < end:
        frame = host.link.frame()
        if frame.cycle != last:
            last = frame.cycle
            histogram = ffi.buffer(ffi.addressof(frame.computing, "bucket"))
            yield last, frame.result_goal_id, np.frombuffer(bytes(histogram), np.uint32)


def edge_ns(bucket: int) -> float:
    """Upper edge of a bucket of a histogram."""
    octave, step = divmod(bucket + 1, 16)
    return 64.0 * 2.0**octave * (1.0 + step / 16.0)


def test_a_process_at_250_us(report: Report) -> None:
    """Simulated drives in a kernel process: cycles in motion, and those that plan, told apart.

    A frame carries the histogram up to the cycle before: the difference of the frames of a goal's
    cycle and of the next is what that one cycle took, to the bucket.
    """
    with (
        MotionKernel([Axis(FAST, COUNTS)] * AXES, 250e-6, clock=REAL_TIME) as kernel,
        kernel.host() as host,
    ):
        host.enable()
        host.move([170.0] * AXES, limits=Limits(20.0, 500.0, 5000.0))
        time.sleep(0.2)
        before = host.feedback()
        time.sleep(6.0)
        after = host.feedback()
        assert before.moving
        assert after.moving
        timing = after.timing_since(before)
        report.line(COMPUTING, f"process, simulated    {row(timing.computing)} (goal: p99 15)")
        rng = np.random.default_rng(2)
        planning = []
        for _ in range(600):
            host.move(rng.uniform(-60.0, 60.0, AXES).tolist())
            for a, b, c in triples(frames(host, 3e-3)):
                if a[0] + 2 == b[0] + 1 == c[0] and a[1] != b[1]:
                    planning.append(edge_ns(int(np.argmax(c[2] - b[2]))))
            time.sleep(5e-3)
    assert planning
    name = f"process, simulated, planning all, {len(planning)} seen"
    report.line(COMPUTING, f"{name:45} {percentiles(np.array(planning))}")


def triples(rows: Iterator[Any]) -> Iterator[tuple[Any, Any, Any]]:
    """Every three neighbours."""
    seen = list(rows)
    return zip(seen, seen[1:], seen[2:], strict=False)


@pytest.mark.parametrize("drive", ["external", "simulated"])
def test_cost_per_axis(report: Report, cycle_times: Times, drive: str) -> None:
    """1, 7, 16 and 64 axes in motion, by turns: best medians beside a straight line."""
    counts = np.array([1, 7, 16, 64])
    kernels = []
    for axes in counts:
        own = "external" if drive == "external" else DriveConfig()
        kernel, host = ready(cycle_times, int(axes), own)
        host.move([1e4] * axes if axes > 1 else 1e4)
        cycle_times(kernel, 200)
        kernels.append(kernel)
    best = np.full(len(counts), np.inf)
    empty = np.inf
    for _ in range(60):
        for i, kernel in enumerate(kernels):
            best[i] = min(best[i], np.median(cycle_times(kernel, 150)))
        empty = min(empty, np.median(cycle_times(kernels[0], 150, empty=True)))
    cost = (best - empty) / 1e3
    slope, base = np.polyfit(counts, cost, 1, w=1.0 / cost)  # relative deviations count
    off = cost / (base + slope * counts) - 1.0
    figures = ", ".join(
        f"{n}: {c:.2f} us ({d:+.1%})" for n, c, d in zip(counts, cost, off, strict=True)
    )
    report.line(
        "cost of a cycle by axes, back to back, off a straight line (goal: 20 %)",
        f"{drive:9} {figures}; {slope * 1e3:.0f} ns per axis",
    )


# ---- wake-up -------------------------------------------------------------------------------------


@pytest.mark.parametrize("spin_us", [0.0, 80.0])
@pytest.mark.parametrize("period_us", [1000, 250, 100])
def test_waking_beside_cyclictest(report: Report, period_us: int, spin_us: float) -> None:
    """A kernel in motion and cyclictest at once, under the same priority where it is granted."""
    clock = Clock(priority=80, lock_memory=True, spin_us=spin_us)
    axis = Axis(FAST, COUNTS)
    with (
        MotionKernel([axis] * AXES, period_us * 1e-6, clock=clock) as kernel,
        kernel.host() as host,
    ):
        host.enable()
        host.move([170.0] * AXES, limits=Limits(20.0, 500.0, 5000.0))
        granted = host.feedback().timing.clock.scheduling.granted
        before = host.feedback()
        judge = Cyclictest.start(period_us * 1e-6, 4.0, priority=80 if granted else 0)
        time.sleep(4.0)
        verdict = judge.result() if judge is not None else None
        after = host.feedback()
    timing = after.timing_since(before)
    cycles = after.cycle - before.cycle + timing.late
    name = f"{period_us:4} us, spin {spin_us:3.0f}"
    report.line(WAKING, f"{name} kernel     {row(timing.latency)} late {timing.late} of {cycles}")
    if verdict is not None:
        report.line(WAKING, f"{name} cyclictest {row(verdict.latency)}")
    else:
        report.line(WAKING, f"{name} cyclictest not installed (Debian: rt-tests)")
    assert timing.latency.count > 1000


# ---- Python's loop beside ruckig's ---------------------------------------------------------------


def ruckig_loop() -> Callable[[], Any]:
    """One update of seven degrees of freedom: positions read, output passed to input."""
    ruckig = pytest.importorskip("ruckig")
    otg = ruckig.Ruckig(AXES, 1e-3)
    inp, out = ruckig.InputParameter(AXES), ruckig.OutputParameter(AXES)
    inp.current_position = inp.current_velocity = inp.current_acceleration = [0.0] * AXES
    inp.target_position = [5e3] * AXES
    inp.max_velocity, inp.max_acceleration, inp.max_jerk = [1.0] * AXES, [2.0] * AXES, [10.0] * AXES

    def update() -> Any:
        otg.update(inp, out)
        positions = out.new_position
        out.pass_to_input(inp)
        return positions

    return update


def kernel_loops(times: Times, drive: Any) -> tuple[dict[str, Callable[[], Any]], Host]:
    """kernel.step() of seven axes on the same move; all positions as a list, as the live array."""
    kernel, host = ready(times, AXES, drive, Limits(1.0, 2.0, 10.0))
    host.move([5e3] * AXES)
    kernel.step(10)
    positions = kernel.positions

    def as_list() -> Any:
        kernel.step()
        return positions.tolist()

    def as_array() -> Any:
        kernel.step()
        return positions

    kind = "external" if drive == "external" else "simulated"
    return {f"{kind:9} list": as_list, f"{kind:9} array": as_array}, host


def test_step_and_read_beside_ruckig(report: Report, cycle_times: Times) -> None:
    """The same motion in both loops, by turns on one processor; ruckig has no drives."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(before)})
    external, host = kernel_loops(cycle_times, "external")
    simulated, other = kernel_loops(cycle_times, DriveConfig())
    loops = {"ruckig": ruckig_loop(), **external, **simulated}
    best = dict.fromkeys(loops, float("inf"))
    for _ in range(150):
        for name, loop in loops.items():
            start = time.perf_counter()
            for _ in range(500):
                loop()
            best[name] = min(best[name], (time.perf_counter() - start) / 500)
    os.sched_setaffinity(0, before)
    assert host.feedback().moving
    assert other.feedback().moving
    for name in (*external, *simulated):
        own, their = best[name] * 1e9, best["ruckig"] * 1e9
        report.line(LOOP, f"{name:15} {own:6.0f} ns / ruckig {their:6.0f} ns = {own / their:5.2f}")


# ---- the paper's experiment ----------------------------------------------------------------------


@pytest.mark.parametrize("period_us", [1000, 250])
def test_the_experiment_of_the_paper(report: Report, period_us: int) -> None:
    """One move over the recorded path, and every recorded point streamed, as the demo does."""
    recording = read_recording(shipped_recording(), joint=None)
    start, end = float(recording.position[0]), float(recording.position[-1])
    runs = []
    with (
        MotionKernel([Axis(LIMITS, COUNTS_PER_DEGREE)], period_us * 1e-6) as kernel,
        kernel.host() as host,
        contextlib.redirect_stderr(None),
    ):
        host.enable()
        for label, goals in (
            ("one move", single_move(host, end)),
            ("streamed", streamed(host, recording)),
        ):
            host.move(start).wait()
            runs.append(play(host, label, goals, end))
        timing = host.feedback().timing
    for run in runs:
        report.line(
            f"the paper's experiment: error {AFTER_S:g} s after the end, increments of 2^24 a turn",
            f"{period_us:4} us {run.label:9} period {timing.period.median * 1e6:7.1f} us, "
            f"computing median {timing.computing.median * 1e6:5.1f} p99 "
            f"{timing.computing.p99 * 1e6:5.1f} us, final error {run.error(end):2}, "
            f"largest velocity {run.peak('velocity'):.4f} of {LIMITS.velocity:g} deg/s",
        )
        assert run.peak("velocity") <= LIMITS.velocity * (1 + 1e-9)
