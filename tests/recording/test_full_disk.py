"""A disk that is full: said at once, by the name of the file, and nothing else ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from sjerk import Axis, InputError, Limits, MotionKernel, Recorder

AXIS = Axis(Limits(90.0, 500.0, 5000.0), 2**24 / 360.0)
SUFFIXES = ["parquet", "mcap"]
FULL = "/dev/full"
pytestmark = pytest.mark.skipif(not os.path.exists(FULL), reason="needs a device that is full")
FILE = """
[[axes]]
counts_per_unit = 46603.37777777778
limits = { velocity = 90, acceleration = 500, jerk = 5000 }
"""


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_disk_that_is_full_is_told_before_a_cycle_is_recorded(
    tmp_path: Path, suffix: str
) -> None:
    """With the name of the file, and the kernel can go on."""
    file = tmp_path / f"a.{suffix}"
    file.symlink_to(FULL)
    kernel = MotionKernel([AXIS])
    with pytest.raises(InputError, match=rf"'{file}': cannot be written after 0 cycles: "):
        Recorder(kernel, file)
    kernel.step(10)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_disk_that_becomes_full_is_told_while_the_kernel_runs(
    tmp_path: Path, suffix: str
) -> None:
    """`sjerk kernel --record`: a line at once, the kernel goes on, exit code 1 at its end."""
    toml, file = tmp_path / "robot.toml", tmp_path / f"a.{suffix}"
    toml.write_text(FILE)
    limit = 50_000
    text = (
        "import resource, sys; from sjerk.__main__ import main; "
        f"from sjerk.kernel.process import KernelProcess as K; begin = K.run\n"
        "def run(self, order):\n"
        "    begin(self, order)\n"
        f"    resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}))\n"
        "K.run = run\n"
        "sys.exit(main(sys.argv[1:]))"
    )
    program = [sys.executable, "-c", text, "kernel", str(toml), "--name", f"full-{os.getpid()}"]
    with subprocess.Popen(
        [*program, "--record", str(file)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as kernel:
        assert kernel.stderr is not None
        said = kernel.stderr.readline()
        assert said.startswith(f"sjerk: file = '{file}': cannot be written after ")
        assert said.endswith("; the kernel goes on\n")
        assert f"is {limit} (`ulimit -f`" in said
        assert kernel.poll() is None
        kernel.send_signal(signal.SIGTERM)
        assert kernel.stderr.read().startswith(f"sjerk: file = '{file}': cannot be written after ")
        assert kernel.wait() == 1
