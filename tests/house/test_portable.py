"""Elsewhere than on Linux: what plans works there, and what is missing says so in one line.

Neither macOS nor Windows runs here. The C is built without the rooms that need Linux, the system
calls itself by another name, and the modules that Windows does not have are refused.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from helpers.sanitized import build

FLAGS = ("-std=c11", "-O1", "-ffp-contract=off", "-fPIC", "-shared")
MISSING = ("fcntl", "grp", "pwd", "resource", "termios", "_posixshmem", "_curses", "syslog")
#: What the module os has on Linux only, or not on Windows.
ABSENT = ("sched_getaffinity", "sched_setaffinity", "getuid", "geteuid", "fork", "posix_fallocate")
BEGIN = f"""
import os, sys, cffi, numpy
class Refused:
    def find_spec(self, name, path=None, target=None):
        if name in {MISSING}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path[:] = [Refused(), *(f for f in sys.meta_path if "editable" not in type(f).__module__)]
for name in {MISSING}:
    sys.modules.pop(name, None)
sys.platform = PLATFORM
for name in {ABSENT}:
    delattr(os, name)
sys.path.insert(0, FOLDER)
import sjerk
assert sjerk.__file__.startswith(FOLDER)
from sjerk import Limits, State, plan, plan_many, plan_velocity, scurve, follow, follow_path
from sjerk import Drive, GoalStream, Trajectory, resample
limits = Limits(90.0, 500.0, 5000.0)
assert scurve(160.0, limits, 1e-3).sample().position[-1] == 160.0
assert plan([0.0, 0.0], [160.0, 20.0], limits, 1e-3).cycles == 2058
assert len(plan_many([0.0, 0.0], [160.0, 20.0], limits, 1e-3)) == 2
assert plan_velocity(State(0.0, velocity=90.0), 0.0, limits, 1e-3).end.velocity == 0.0
times = numpy.linspace(0.0, 10.0, 21)
way = Trajectory(["a"], times, 100.0 * (1 - numpy.cos(times * numpy.pi / 10))[:, None])
assert [*follow(way, [limits], 1e-3)]
assert [*follow_path([[0.0], [10.0]], limits, 1e-3)]
assert len(resample(way.position, 50.0)) > 2
assert GoalStream([limits], 1e-3, [0.0], period=0.1) is not None
assert Drive().enable().state
for name in ("Host", "Monitor", "MotionKernel", "TrajectoryExecutor", "Recorder", "simulate"):
    try:
        getattr(sjerk, name)
    except ImportError as told:
        said = f"sjerk.{{name}} needs Linux and this is {{sys.platform}};"
        assert str(told).startswith(said), told
    else:
        raise AssertionError(name)
for room in ("host", "kernel", "executor", "recording"):
    try:
        __import__(f"sjerk.{{room}}")
    except sjerk.errors.PlatformError as told:
        assert "needs Linux" in str(told)
    else:
        raise AssertionError(room)
assert not hasattr(sjerk, "no_such_name")
print("works")
"""


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the package without what needs Linux."""
    folder = tmp_path_factory.mktemp("portable")
    build(folder, FLAGS, portable=True)
    return folder


@pytest.mark.parametrize("platform", ["darwin", "win32"])
def test_planning_works_and_the_rest_says_what_it_needs(built: Path, platform: str) -> None:
    """Everything public that needs no Linux runs once; everything else is told by its name."""
    text = BEGIN.replace("PLATFORM", repr(platform)).replace("FOLDER", repr(str(built)))
    run = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True)
    assert run.stdout == "works\n", run.stderr
