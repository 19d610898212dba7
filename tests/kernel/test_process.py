"""The process of a kernel: what it is started from, and that it ends with whoever started it."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import sysconfig
import textwrap
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sjerk import Axis, Clock, DriveConfig, InputError, KernelGoneError, Limits, MotionKernel, _core
from sjerk.host import KernelState, Monitor
from sjerk.kernel import process
from sjerk.kernel.process import import_path
from sjerk.recording import Recorder

LIMITS = Limits(90.0, 500.0, 5000.0)
COUNTS = 2**24 / 360.0
AXIS = Axis(LIMITS, COUNTS)
BEGIN = f"""
import os, signal, sys, time
from sjerk import *
AXIS = Axis(Limits(90.0, 500.0, 5000.0), {COUNTS!r})
"""


def script(text: str, *arguments: str, **more: Any) -> subprocess.CompletedProcess[str]:
    """A program of its own; its end is waited for, not that of what it has forked."""
    program = [sys.executable, "-c", BEGIN + textwrap.dedent(text), *arguments]
    return subprocess.run(program, capture_output=True, text=True, timeout=300, **more)


def gone(pid: int) -> bool:
    """Whether the process ends; a zombie has."""
    end = time.monotonic() + 60.0
    stat = Path(f"/proc/{pid}/stat")
    while time.monotonic() < end:
        try:
            if stat.read_text().rpartition(")")[2].split()[0] == "Z":
                return True
        except FileNotFoundError:
            return True
        time.sleep(0.01)
    return False


# ---- its end


FORKS = {
    "os.fork": """
        child = os.fork()
        if child == 0:
            time.sleep(200)
            os._exit(0)
        children = [child]
    """,
    "a pool": """
        import multiprocessing
        pool = multiprocessing.get_context("fork").Pool(2)
        pool.map(abs, [1, 2])
        children = [process.pid for process in pool._pool]
    """,
    "an executor": """
        import multiprocessing
        from concurrent.futures import ProcessPoolExecutor
        pool = ProcessPoolExecutor(2, multiprocessing.get_context("fork"))
        list(pool.map(abs, [1, 2]))
        children = list(pool._processes)
    """,
}


@pytest.mark.parametrize("fork", FORKS)
def test_leaving_ends_a_kernel_whose_pipes_a_forked_child_holds(fork: str) -> None:
    """The kernel is at its end before the children are."""
    text = f"""
with MotionKernel([AXIS]) as kernel:
    pid = kernel.pid
{textwrap.indent(textwrap.dedent(FORKS[fork]), "    ")}
print("left", not os.path.exists(f"/proc/{{pid}}"), flush=True)
for child in children:
    os.kill(child, signal.SIGKILL)
os._exit(0)
"""
    done = script(text)
    assert done.stdout == "left True\n", done.stderr


def test_the_death_of_the_program_ends_the_kernel_while_its_child_lives() -> None:
    """Kill -9 of the parent: the motion stops, the segments go, the child holds nothing up."""
    name = f"forked-{os.getpid()}"
    text = """
        with MotionKernel([AXIS], name=sys.argv[1]) as kernel, kernel.host() as host:
            host.enable()
            host.jog(20.0).accepted()
            child = os.fork()
            if child == 0:
                time.sleep(200)
                os._exit(0)
            print(child, kernel.pid, flush=True)
            os.kill(os.getpid(), signal.SIGKILL)
    """
    program = [sys.executable, "-c", BEGIN + textwrap.dedent(text), name]
    with subprocess.Popen(program, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        child, kernel = (int(word) for word in parent.stdout.readline().split())
        try:
            assert gone(kernel)
            assert not [entry for entry in Path("/dev/shm").iterdir() if name in entry.name]
            os.kill(child, 0)
        finally:
            os.kill(child, signal.SIGKILL)


def test_a_forked_child_that_leaves_does_not_end_the_kernel_of_its_parent() -> None:
    """Its own end of the with block is not the kernel's."""
    done = script(
        """
        with MotionKernel([AXIS]) as kernel:
            child = os.fork()
            if child == 0:
                kernel.__exit__()
                os._exit(0)
            os.waitpid(child, 0)
            time.sleep(0.3)
            with kernel.host() as host:
                host.enable()
                host.move(1.0).wait()
                print(kernel.alive, host.feedback().axes[0].position)
        """
    )
    assert done.stdout == "True 1.0\n", done.stderr


@pytest.mark.parametrize("again", [1, 5])
def test_sigterm_ends_the_kernel_in_order_however_often_it_comes(again: int) -> None:
    """It stops along its ramp, disables, and leaves in order."""
    with MotionKernel([AXIS]) as kernel, kernel.host() as host:
        host.enable()
        host.jog(20.0).accepted()
        assert kernel.pid is not None
        for _ in range(again):
            os.kill(kernel.pid, signal.SIGTERM)
            time.sleep(0.01)
        assert gone(kernel.pid)
        last = host.link.copy()
        assert (last.axis[0].velocity, last.axis[0].enabled) == (0.0, 0)


def test_a_process_that_does_not_start_is_told_with_its_exit_code(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """And nothing is left of the attempt."""
    name = f"unstarted-{os.getpid()}"
    monkeypatch.setattr(sys, "executable", shutil.which("false"))
    with pytest.raises(KernelGoneError, match=f"'{name}' did not start: .* exit code 1"):
        MotionKernel([AXIS], name=name).__enter__()
    assert not [entry for entry in Path("/dev/shm").iterdir() if name in entry.name]


# ---- what it imports


SHADOWS = ("json", "pickle", "threading", "numpy", "cffi", "dataclasses", "sitecustomize", "enum")
RUNS = """
    with MotionKernel([AXIS]) as kernel, kernel.host() as host:
        host.enable()
        host.move(1.0).wait()
        print(host.feedback().axes[0].position)
"""


def test_it_imports_nothing_from_the_working_directory(tmp_path: Path) -> None:
    """Also where PYTHONPATH has an empty entry, which means that directory."""
    text = f"import os; os.chdir({str(tmp_path)!r}); sys.path.insert(0, '')\n" + textwrap.dedent(
        RUNS
    )
    for name in SHADOWS:
        (tmp_path / f"{name}.py").write_text("raise SystemExit('shadowed')")
    done = script(text, cwd="/")
    assert done.stdout == "1.0\n", done.stderr
    assert "shadowed" not in done.stderr


def test_it_imports_what_its_parent_imports_by_a_path_of_run_time(tmp_path: Path) -> None:
    """A copy of sjerk that only the parent's sys.path knows runs in the kernel too."""
    package = tmp_path / "vendored" / "sjerk"
    shutil.copytree(Path(process.__file__).parents[1], package)
    extension = Path(_core.__file__)
    shutil.copy(extension, package / extension.name)
    library = [sysconfig.get_path(kind) for kind in ("stdlib", "purelib")]
    text = f"""
import sys
sys.path[:] = [{str(package.parent)!r}, *sys.path, *{library!r}]
{BEGIN}
with MotionKernel([AXIS]) as kernel:
    print(open(f"/proc/{{kernel.pid}}/maps").read().count({str(package)!r}) > 0)
"""
    done = subprocess.run(
        [sys.executable, "-S", "-c", text], capture_output=True, text=True, timeout=300, cwd="/"
    )
    assert done.stdout == "True\n", done.stderr


def test_its_path_has_the_standard_library_first_and_no_working_directory(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Whatever the order in the parent."""
    monkeypatch.chdir(tmp_path)
    extra = str(tmp_path / "extra")
    monkeypatch.setattr(sys, "path", [extra, "", ".", str(tmp_path), *sys.path])
    found = import_path()
    assert not {"", ".", str(tmp_path)} & set(found)
    assert found.index(sysconfig.get_path("stdlib")) < found.index(extra)


def test_a_sitecustomize_that_prints_does_no_harm(tmp_path: Path) -> None:
    """What it says is not taken for an answer of the kernel."""
    (tmp_path / "sitecustomize.py").write_text("print('hello from site', flush=True)")
    done = script(RUNS, env={**os.environ, "PYTHONPATH": str(tmp_path)})
    assert done.stdout == "hello from site\n1.0\n", done.stderr


# ---- what it is told


class Joint(Axis):
    """A kind of axis with its own defaults, as scripts make them."""

    def __init__(self, name: str) -> None:
        super().__init__(LIMITS, COUNTS, unit="deg")
        object.__setattr__(self, "name", name)


@dataclass(frozen=True)
class Labelled(Axis):
    """With a field that the kernel does not know."""

    label: str = ""


class Doubled(Axis):
    """That does something else than its fields say."""

    def to_c(self, T: float) -> Any:
        config = super().to_c(T)
        config.counts_per_unit *= 2
        return config


def test_axes_of_a_script_run_where_their_fields_say_all() -> None:
    """The process needs none of their classes; a recording is read without them."""
    local = type("Local", (Axis,), {})  # nobody can import this one
    axes = [Joint("a"), Labelled(LIMITS, COUNTS, label="b"), local(LIMITS, np.float32(COUNTS))]
    with MotionKernel(axes, clock=Clock(spin_us=np.float32(5.0))) as kernel:
        with Recorder(kernel.name, None) as recorder, kernel.host() as host:
            host.enable()
            host.move([1.0, 2.0, 3.0]).wait()
        assert [axis.unit for axis in recorder.recording.axes] == ["deg", "", ""]


def test_an_axis_that_does_more_than_its_fields_say_is_refused_before_anything_starts() -> None:
    """It names the axis and its class; in an own loop it works."""
    kernel = MotionKernel([AXIS, Doubled(LIMITS, COUNTS)], name=f"doubled-{os.getpid()}")
    with pytest.raises(InputError, match=r"axes\[1\] = .*a Doubled does what its fields do"):
        kernel.__enter__()
    assert kernel.pid is None
    assert not [e for e in Path("/dev/shm").iterdir() if kernel.name in e.name]
    kernel.step()


def test_what_cannot_be_pickled_does_not_matter() -> None:
    """The order is data."""

    class Config(DriveConfig):
        def __reduce__(self) -> str:
            raise TypeError("cannot be pickled")

    with MotionKernel([Axis(LIMITS, COUNTS, Config(velocity_feedforward=0.5))]) as kernel:
        assert kernel.alive


# ---- whether it works


def comes(monitor: Monitor, state: KernelState) -> bool:
    """Whether the kernel comes to be seen like this."""
    end = time.monotonic() + 60.0
    while monitor.kernel_state is not state:
        if time.monotonic() > end:
            return False
        time.sleep(0.01)
    return True


def test_a_suspended_kernel_is_told_from_one_that_runs_and_one_that_is_gone() -> None:
    """By the age of its newest frame, which grows while no cycle runs."""
    with MotionKernel([AXIS]) as kernel, Monitor.attach(kernel.name) as monitor:
        assert kernel.pid is not None
        assert comes(monitor, KernelState.RUNNING)
        os.kill(kernel.pid, signal.SIGSTOP)
        assert comes(monitor, KernelState.SUSPENDED)
        ages = [monitor.feedback() for _ in range(3)]
        assert len({frame.cycle for frame in ages}) == 1
        assert 0.1 < ages[0].age < ages[1].age < ages[2].age  # type: ignore[operator]
        with pytest.raises(TimeoutError, match="not taken by the kernel"):
            monitor.halt(0.2)
        os.kill(kernel.pid, signal.SIGCONT)
        assert comes(monitor, KernelState.RUNNING)
        monitor.halt()
        os.kill(kernel.pid, signal.SIGKILL)
        assert comes(monitor, KernelState.GONE)
    loop = MotionKernel([AXIS])
    host = loop.host()
    loop.step()
    assert host.feedback().age is None
    assert host.kernel_state is KernelState.RUNNING
