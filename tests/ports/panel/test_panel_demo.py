"""The paper's experiment as the panel plays it, judged by a recording of every cycle."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from helpers.panel_bench import ONE, Bench, ideal_kernel
from helpers.panel_client import until
from sjerk import Limits, MotionKernel, Recorder
from sjerk.errors import InputError, SjerkError
from sjerk.ports.panel.experiment import Experiment, Method, in_unit, paper_limits
from sjerk.profile import FloatArray
from sjerk.trajectory import RecordedPath, read_recording, shipped_recording

RAW = read_recording(shipped_recording())
PATH = in_unit(RAW, "rad")
#: The first second and a half of it.
SHORT = replace(PATH, time=PATH.time[:16], position=PATH.position[:16])


@pytest.fixture(scope="module")
def kernel() -> Iterator[MotionKernel]:
    """One process for all tests here."""
    with ideal_kernel() as running:
        yield running


def to_start(bench: Bench) -> None:
    """Joint 1 to the path's first point; again where a busy machine made the kernel halt."""
    start = float(PATH.position[0])

    def there() -> bool:
        with suppress(SjerkError):
            bench.lead.of(ONE).move({0: start}).wait(60.0)
        bench.rests()
        return bool(bench.desk.commanded()[0] == start)

    until(there, "at the start")


@pytest.fixture
def bench(kernel: MotionKernel, tmp_path: Path) -> Iterator[Bench]:
    """A desk for one test; joint 1 at the path's first point."""
    with Bench(kernel, tmp_path) as made:
        made.ready()
        to_start(made)
        yield made


SIGNALS = ("position", "velocity", "acceleration", "jerk")


def played(
    bench: Bench, method: Method, recorded: RecordedPath = PATH, *, stop_at: float = np.inf
) -> tuple[dict[str, FloatArray], str]:
    """The cycles of a run, and why it has ended; stopped where the axis passes ``stop_at``."""
    ended: list[str] = []
    over = threading.Event()

    def told(why: str) -> None:
        ended.append(why)
        over.set()

    with Recorder(bench.kernel.name, None) as recorder:
        run = Experiment(
            bench.lead.of(ONE),
            0,
            recorded,
            method,
            stops=lambda: bench.lead.stops,
            first=bench.lead.stops,
            over=told,
        )
        bench.lead.use(run.close)
        if stop_at < np.inf:
            until(lambda: bench.monitor.feedback().axes[0].position > stop_at, "on its way")
            bench.lead.stop()
        until(over.is_set, "over")
        bench.rests()
    recording = recorder.recording
    own = recording.cycle > run.begin
    return {name: getattr(recording, name)[own] for name in SIGNALS}, ended[0]


@pytest.mark.parametrize("method", Method)
def test_the_path_is_played_to_its_end(bench: Bench, method: Method) -> None:
    """To the last bit, within the limits, by one axis only."""
    for _ in range(10):  # again where a busy machine made the kernel halt on the way
        recording, why = played(bench, method, SHORT)
        if why == "":
            break
        to_start(bench)
    assert why == ""
    assert recording["position"][-1, 0] == SHORT.position[-1]
    assert (recording["position"][:, 1:] == recording["position"][0, 1:]).all()
    own = bench.desk.limits[0]
    most = own if method in (Method.LOOK_AHEAD, Method.STOP_WITHIN) else paper_limits("rad", own)
    for name in ("velocity", "acceleration", "jerk"):
        peak = float(np.abs(recording[name][:, 0]).max())
        assert peak <= getattr(most, name) * (1 + 1e-9), name
        assert peak > 0.0


@pytest.mark.parametrize("method", [Method.INTERRUPTED, Method.LOOK_AHEAD])
def test_a_stop_ends_it_and_nothing_moves_again(bench: Bench, method: Method) -> None:
    """Whatever is due: once at rest it stays there."""
    recording, why = played(bench, method, stop_at=0.4)
    assert why != ""
    assert recording["position"][-1, 0] < PATH.position[-1] - 0.1
    moving = np.flatnonzero(np.diff(recording["position"][:, 0]))
    still = np.diff(moving) - 1
    assert still.max(initial=0) == 0  # no second motion after a rest
    at = bench.monitor.feedback().axes[0].position
    for _ in range(100):
        assert bench.monitor.feedback().axes[0].position == at


def test_a_browser_that_leaves_ends_it(bench: Bench) -> None:
    """And the lead is free."""
    over = threading.Event()
    run = Experiment(
        bench.lead.of(ONE),
        0,
        PATH,
        Method.INTERRUPTED,
        stops=lambda: bench.lead.stops,
        first=bench.lead.stops,
        over=lambda _: over.set(),
    )
    bench.lead.use(run.close)
    until(lambda: bench.monitor.feedback().axes[0].position > 0.2, "on its way")
    bench.desk.left(ONE, "it has left")
    assert over.is_set()
    bench.rests()
    assert bench.monitor.feedback().axes[0].position < PATH.position[-1] - 0.1
    assert bench.monitor.host_pid is None


@settings(max_examples=4, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 2**32 - 1), st.integers(2, 12), st.floats(0.02, 0.1))
def test_any_path_is_played_by_any_method(
    bench: Bench, seed: int, points: int, period: float
) -> None:
    """Random points at random times: it ends on the last one, and no sample leaves the limits."""
    random = np.random.default_rng(seed)
    time = np.concatenate([[0.0], np.cumsum(period * random.uniform(0.5, 1.5, points))])
    method = list(Method)[seed % 4]
    for _ in range(10):  # again where a busy machine made the kernel halt on the way
        start = bench.monitor.feedback().axes[0].position
        goals = np.concatenate([[start], random.uniform(-0.5, 0.5, points)])
        recording, why = played(bench, method, RecordedPath("joint", time, goals))
        if why == "":
            break
    assert why == ""
    assert recording["position"][-1, 0] == goals[-1]
    own = bench.desk.limits[0]
    for name in ("velocity", "acceleration", "jerk"):
        assert np.abs(recording[name][:, 0]).max() <= getattr(own, name) * (1 + 1e-9)


@given(st.sampled_from(["rad", "deg"]), st.floats(0.1, 10.0), st.floats(0.1, 50.0))
def test_limits_and_path_are_of_the_unit_of_the_axis(unit: str, v: float, a: float) -> None:
    """Never above the axis' own; 160 degrees at most 90 degrees a second."""
    degrees = np.degrees(1.0) if unit == "rad" else 1.0
    own = Limits(v, a, 5000.0)
    found = paper_limits(unit, own)
    assert found.velocity <= min(v, 90.0 / degrees * (1 + 1e-12))
    assert found.acceleration <= a
    assert in_unit(RAW, unit).position * degrees == pytest.approx(RAW.position)
    with pytest.raises(InputError, match="unit"):
        in_unit(RAW, "mm")
