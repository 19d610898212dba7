"""The C core under ASan and UBSan: the tests that drive it, again."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from helpers.root import ROOT, TESTS, program
from helpers.sanitized import build, library


def found(pattern: str) -> list[Path]:
    """The test files of a pattern; it must have some."""
    files = sorted(TESTS.glob(pattern))
    assert files, pattern
    return files


#: Of the planner: one axis by its short way, many rows at once in lanes.
MANY = (
    "test_an_axis_is_planned_alone_as_in_a_list",
    "test_a_plan_keeps_its_memory_for_c",
    "test_many_plans_are_one_by_one_whatever_the_number_and_survive_pickling",
    "test_rows_planned_at_once_have_the_bits_of_rows_planned_alone",
)
#: Tests of the C rooms that need no process of their own.
CHOSEN = [
    *(
        str(path)
        for chosen in (
            "planner/test_profile.py",
            "kernel/test_kernel.py",
            "base/test_interpolator.py",
            "trajectory/test_following.py",
            "trajectory/test_stretching.py",
            "trajectory/test_horizon.py",
            "trajectory/test_quadratic.py",
            "executor/test_playing.py",
            "cycle/test_ahead.py",
            "trajectory/test_pace.py",
            "cycle/test_hold.py",
            "kernel/test_rehearsal.py",
            "cycle/test_queue*.py",
            "drive/test_cia402*.py",
            "drive/test_servo*.py",
            "ports/ethercat/test_*.py",
        )
        for path in found(chosen)
    ),
    *(f"{TESTS}/planner/test_planning.py::{test}" for test in MANY),
    "-k",
    "not process and not killed and not leaving and not second_host and not million "
    "and not 10000000 and not random_ways and not panda and not shipped "
    "and not slowly and not bursts",
]


@pytest.fixture(scope="module")
def asan() -> str:
    """The library to preload."""
    found = library("libasan.so")
    if found is None:
        pytest.skip("the compiler has no libasan")
    return found


@pytest.fixture(scope="module")
def built(asan: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the package with sanitizers."""
    folder = tmp_path_factory.mktemp("sanitized")
    build(folder)
    return folder


def test_c_core_is_clean_under_asan_and_ubsan(asan: str, built: Path) -> None:
    """No overrun, no undefined behaviour in anything that the chosen tests do."""
    run = subprocess.run(
        program("helpers.sanitized", str(built), *CHOSEN),
        env={
            **os.environ,
            "LD_PRELOAD": asan,
            "ASAN_OPTIONS": "detect_leaks=0",
            "UBSAN_OPTIONS": "print_stacktrace=1",
            "SJERK_HYPOTHESIS": "small",
        },
        capture_output=True,
        text=True,
        cwd=ROOT,
        timeout=900,
    )
    assert run.returncode == 0, run.stdout[-8000:] + run.stderr[-8000:]
    assert " passed" in run.stdout


def test_the_sanitizers_are_seen_to_bite(asan: str, built: Path) -> None:
    """An overrun in the same build does end the program: the check above can fail."""
    text = (
        "import sys; sys.meta_path[:] = [f for f in sys.meta_path "
        "if 'editable' not in type(f).__module__]; "
        f"sys.path.insert(0, {str(built)!r}); from sjerk._binding import ffi, lib; "
        "plan = ffi.new('sj_plan *'); plan.cycles = 3; t = ffi.new('sj_table *'); "
        "c = ffi.new('double[2]'); t.rows = 4000; "
        "t.time = t.position = t.velocity = t.acceleration = t.jerk = c; "
        "ip = ffi.new('sj_interpolator *'); lib.sj_interpolator_fill(ip, 1.0, 0, t)"
    )
    run = subprocess.run(
        [sys.executable, "-c", text],
        env={**os.environ, "LD_PRELOAD": asan, "ASAN_OPTIONS": "detect_leaks=0"},
        capture_output=True,
        text=True,
    )
    assert run.returncode != 0
    assert "heap-buffer-overflow" in run.stderr
