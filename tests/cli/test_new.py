"""``sjerk new``: what it writes is a kernel, and what is none is not written."""

from __future__ import annotations

import math
import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sjerk.__main__ import main
from sjerk.cli.new import checked, description
from sjerk.kernel import load

NEEDED = ["--velocity", "90", "--acceleration", "500", "--jerk", "5000"]
SANE = st.floats(min_value=1e-6, max_value=1e6)
WORDS = st.text(st.characters(codec="utf-8"), min_size=1, max_size=15).filter(
    lambda text: text.isprintable() and len(text.encode()) <= 15
)


@given(
    st.lists(
        st.tuples(WORDS, SANE, SANE, SANE, SANE), min_size=1, max_size=7, unique_by=lambda r: r[0]
    ),
    WORDS,
)
def test_every_value_arrives(rows: list[tuple[str, float, float, float, float]], unit: str) -> None:
    """Names and units of any signs, numbers of any size: to the bit, each at its axis."""
    names, velocities, accelerations, jerks, turns = zip(*rows, strict=True)
    words = {
        "names": list(names),
        "unit": [unit],
        "per_turn": [repr(value) for value in turns],
        "increments": ["16777216"],
        "gear": ["1"],
        "velocity": [repr(value) for value in velocities],
        "acceleration": [repr(value) for value in accelerations],
        "jerk": [repr(value) for value in jerks],
        "low": ["-"],
        "high": ["-"],
        "drive": ["ideal"],
    }
    kernel = checked(Path("robot.toml"), description(words, cycle_time=1e-3))
    for axis, row in zip(kernel.axes, rows, strict=True):
        assert (axis.name, axis.unit) == (row[0], unit)
        assert (axis.limits.velocity, axis.limits.acceleration, axis.limits.jerk) == row[1:4]
        assert axis.counts_per_unit == 16777216 / row[4]


def test_options_alone_write_a_file_that_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One value for all axes, or one for each; the next command is told, and works."""
    file = tmp_path / "arm.toml"
    own = ["--velocity", "1", "0.5", "--acceleration", "4", "--jerk", "40"]
    ranged = ["--low", "-3.1", "-1e-1", "--high", "3.1"]
    names = ["--names", "base", "elbow", "--unit", "rad"]
    assert main(["new", str(file), *names, *own, *ranged, "--priority", "80"]) == 0
    assert f"next: sjerk kernel {file}" in capsys.readouterr().out
    kernel = load(file)
    assert [axis.limits.velocity for axis in kernel.axes] == [1.0, 0.5]
    assert [axis.limits.position for axis in kernel.axes] == [(-3.1, 3.1), (-0.1, 3.1)]
    assert kernel.axes[0].counts_per_unit == 16777216 / (2 * math.pi)
    assert kernel.clock.priority == 80
    assert main(["kernel", str(file), "--name", f"new-{os.getpid()}", "--seconds", "0.1"]) == 0


def test_what_is_no_kernel_is_not_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Missing options, wrong values, a wrong number of them, a file that is there."""
    file = tmp_path / "robot.toml"
    for words, told in (
        (["--yes"], "--names --velocity --acceleration --jerk"),
        (["--names", "a", "b", *NEEDED, "--gear", "1", "2", "3"], "one for each of 2 axes"),
        (["--names", "a", *NEEDED, "--gear", "fast"], "gear = 'fast': must be a number"),
        (["--names", "a", *NEEDED, "--jerk", "-1"], "jerk = '-1'"),
        (["--names", "a", *NEEDED, "--low", "5"], "needs both of its ends"),
        (["--names", "a", *NEEDED, "--low", "5", "--high", "3"], "low must be below high"),
        (["--names", "a", *NEEDED, "--unit", "mm"], "--per-turn"),
        (["--names", "a", *NEEDED, "--drive", "real"], "drive = 'real'"),
        (["--names", "a", *NEEDED, "--cycle-time", "1"], "cycle_time"),
    ):
        assert main(["new", str(file), *words]) == 1
        assert told in capsys.readouterr().err
        assert not file.exists()
    file.write_text("mine")
    assert main(["new", str(file), "--names", "a", *NEEDED]) == 1
    assert "--force overwrites it" in capsys.readouterr().err
    assert file.read_text() == "mine"


def test_each_axis_has_the_turn_of_its_own_unit(tmp_path: Path) -> None:
    """Units that differ, none of them told: counts of one turn in each axis' own."""
    file = tmp_path / "robot.toml"
    assert main(["new", str(file), "--names", "a", "b", "--unit", "deg", "rad", *NEEDED]) == 0
    counts = [axis.counts_per_unit for axis in load(file).axes]
    assert counts == [16777216 / 360.0, 16777216 / (2 * math.pi)]


def test_it_asks_on_a_terminal(tmp_path: Path) -> None:
    """A real one: what is given is not asked, a word that is no number is asked again."""
    file = tmp_path / "robot.toml"
    ours, theirs = pty.openpty()
    order = [sys.executable, "-m", "sjerk", "new", str(file), "--names", "a", "b"]
    answers = ["", "", "", "-2", "", "fast", "90 45 3", "90 45", "500", "5000"]
    answers += ["down", "-170", "170", "real", ""]
    process = subprocess.Popen(order, stdin=theirs, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    os.write(ours, "".join(f"{answer}\n" for answer in answers).encode())
    out, err = process.communicate(timeout=120)
    os.close(ours)
    os.close(theirs)
    assert process.returncode == 0, err
    assert b"unit of the axes [deg]: " in out
    assert b"names of the axes" not in out
    assert out.count(b"largest velocity") == 3
    for asked_twice in (b"turns of the motor in one", b"lowest position", b"drives: "):
        assert out.count(asked_twice) == 2
    assert b"- for none; one for all axes" in err
    kernel = load(file)
    assert [axis.limits.velocity for axis in kernel.axes] == [90.0, 45.0]
    assert kernel.axes[1].limits.position == (-170.0, 170.0)
