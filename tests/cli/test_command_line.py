"""The command line: what scripts depend on."""

from __future__ import annotations

import json
import math
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.root import ROOT
from sjerk import Axis, InputError, Limits, Monitor, MotionKernel, Recording
from sjerk.__main__ import arguments, main
from sjerk.cli import common
from sjerk.cli.arguments import by_axis, duration, duration_or_inf, numbered, shielded
from sjerk.handshake import Layout, Segment
from sjerk.host import EventKind, Feedback, StopKind
from sjerk.kernel import load

LEAVE = (
    "import os, sys; from sjerk.handshake import *; "
    "s = Segment.create(sys.argv[1], Layout(command_bytes=8, feedback_bytes=8)); "
    "os._exit(0)"
)


def sjerk(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "sjerk", *arguments], capture_output=True, text=True, timeout=600
    )


def test_clean_removes_the_segments_of_the_dead_and_never_one_in_use() -> None:
    """A dead creator's segment is listed, then removed; a living one is left alone."""
    dead, living = f"dead-{os.getpid()}", f"living-{os.getpid()}"
    subprocess.run([sys.executable, "-c", LEAVE, dead], check=True)
    with Segment.create(living, Layout(command_bytes=8, feedback_bytes=8)):
        dry = sjerk("clean", "--dry-run")
        assert f"{dead}:" in dry.stdout
        done = sjerk("clean")
        assert done.returncode == 0
        lines = {line.split(":")[0]: line for line in done.stdout.splitlines()}
        assert lines[dead].endswith("removed")
        assert lines[living].endswith("in use")
        names = [entry.name for entry in Path("/dev/shm").iterdir()]
        assert not [name for name in names if dead in name]
        assert [name for name in names if living in name]


def test_wrong_arguments_exit_with_2() -> None:
    """No verb, or one that does not exist; the message names the help."""
    for words in ((), ("dance",)):
        done = sjerk(*words)
        assert done.returncode == 2
        assert "verb" in done.stderr
        assert "`sjerk --help` explains" in done.stderr


@pytest.mark.parametrize(
    ("words", "verb"),
    [
        (["move", "0=1", "--fast"], "sjerk move"),
        (["new", "robot.toml", "--axes", "2"], "sjerk new"),
        (["ethercat", "scan", "eth0", "eth1"], "sjerk ethercat scan"),
    ],
)
def test_an_unknown_word_is_told_with_the_usage_of_its_verb(
    words: list[str], verb: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of a verb's own verb too; not with the list of all verbs."""
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 2
    told = capsys.readouterr().err
    assert told.startswith(f"usage: {verb} ")
    assert f"`{verb} --help` explains" in told
    assert "unrecognized" in told


@pytest.mark.parametrize(
    "arguments",
    [
        *(("move", "0=30", "--timeout", word) for word in ("nan", "-1", "0", "inf", "soon")),
        *(("follow", "way.csv", "--timeout", word) for word in ("nan", "-1")),
        *(("report", "--seconds", word) for word in ("nan", "-1", "inf")),
        *(("monitor", "--seconds", word) for word in ("nan", "-1")),
        *(("record", "a.mcap", "--seconds", word) for word in ("nan", "-1")),
        *(("kernel", "robot.toml", "--seconds", word) for word in ("nan", "-1", "0")),
    ],
)
def test_durations_are_checked_by_the_parser(
    arguments: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    """Before a kernel is looked for: exit code 2, the option is named."""
    with pytest.raises(SystemExit) as ended:
        main(list(arguments))
    assert ended.value.code == 2
    assert f"argument {arguments[-2]}: " in capsys.readouterr().err


@given(st.floats(min_value=1e-9, max_value=1e9))
def test_a_duration_is_its_number(seconds: float) -> None:
    """Every sane number of seconds is taken as it is; inf where it is allowed."""
    assert duration(repr(seconds)) == duration_or_inf(repr(seconds)) == seconds
    assert duration_or_inf("inf") == math.inf


@given(st.dictionaries(st.integers(0, 63), st.floats(allow_nan=False), min_size=1))
def test_words_by_axis(wanted: dict[int, float]) -> None:
    """AXIS=NUMBER words name axes, numbers alone are in order; never both, no axis twice."""
    words = [f"{axis}={value!r}" for axis, value in wanted.items()]
    assert by_axis("target", words) == wanted
    assert by_axis("target", [repr(value) for value in wanted.values()]) == list(wanted.values())
    for wrong in ([*words, "1.0"], [*words, words[0]], [*words, "=1"], ["x"]):
        with pytest.raises(InputError, match="target"):
            by_axis("target", wrong)


NAMES = st.text(st.characters(codec="utf-8"), min_size=1, max_size=15).filter(
    lambda text: text == text.strip() and not text.lstrip("+-").isdigit()
)


@given(
    st.lists(NAMES, min_size=1, max_size=8, unique=True),
    st.lists(st.floats(allow_nan=False), min_size=8, max_size=8),
    st.data(),
)
def test_an_axis_goes_by_its_name(
    names: list[str], values: list[float], data: st.DataObject
) -> None:
    """Whatever is in it, an "=" too; by number and name twice, or by none, it is refused."""
    wanted = {i: values[i] for i in range(len(names))}
    by_name = data.draw(st.lists(st.booleans(), min_size=len(names), max_size=len(names)))
    words = [f"{names[i] if by_name[i] else i}={value!r}" for i, value in wanted.items()]
    assert numbered("target", by_axis("target", words), names) == wanted
    twice = by_axis("target", ["0=1", f"{names[0]}=2"])
    with pytest.raises(InputError, match="axis 0 is named twice"):
        numbered("target", twice, names)
    with pytest.raises(InputError, match="no name: "):
        numbered("target", {"".join(names) + "x": 1.0}, names)


@given(st.floats(max_value=-1e-300, allow_nan=False), st.sampled_from(["{!r}", "{:e}", "{:g}"]))
def test_every_way_to_write_a_negative_number_is_a_target(value: float, form: str) -> None:
    """Also -1e-05, as programs print it, and -inf: argparse takes those for options."""
    word = form.format(value)
    given_words = arguments().parse_args(shielded(["move", word, "3", "--timeout", "5"]))
    assert by_axis("target", given_words.target) == [float(word), 3.0]
    assert given_words.timeout == 5.0


def test_a_file_that_cannot_be_opened_is_told_by_its_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """No number of the system's error; a folder, a file that is not there, a socket nobody has."""
    missing = tmp_path / "robot.toml"
    assert main(["kernel", str(missing)]) == 1
    assert capsys.readouterr().err == (
        f"sjerk: {missing}: No such file or directory; `sjerk new {missing}` writes one\n"
    )
    assert main(["kernel", str(tmp_path)]) == 1
    assert capsys.readouterr().err == f"sjerk: {tmp_path}: Is a directory\n"
    nowhere = tmp_path / "none"
    assert main(["drive", "--control", str(nowhere), "--fault", "status"]) == 1
    assert capsys.readouterr().err.startswith(f"sjerk: --control = '{nowhere}': no line of drives")
    assert main(["drive", "--control", str(nowhere / "deep"), "--fault", "status"]) == 1
    assert "no line of drives" in capsys.readouterr().err


@given(st.floats(min_value=-1e12, max_value=1e12))
def test_small_units_lose_no_digits(position: float) -> None:
    """A position in metres or in turns is as exact as one in degrees; JSON has every bit."""
    assert math.isclose(float(common.word(position)), position, rel_tol=1e-11)
    axis = Axis(Limits(1e-6, 1e-5, 1e-4), counts_per_unit=1e12, unit="m", drive="ideal")
    kernel = MotionKernel(axes=[axis])
    kernel.step()
    axes = kernel.host().feedback().axes
    moved = SimpleNamespace(axes=[replace(axes[0], position=position)])
    (row,) = common.axis_rows(cast(Feedback, moved))
    assert json.loads(json.dumps(row))["position"] == position


FILE = """
cycle_time = 1e-3
[[axes]]
unit = "deg"
counts_per_unit = 46603.37777777778
limits = { velocity = 90, acceleration = 500, jerk = 5000, position = [-170, 170] }
[[axes]]
name = "elbow"
unit = "deg"
counts_per_unit = 46603.37777777778
limits = { velocity = 90, acceleration = 400, jerk = 4000, position = [-170, 170] }
"""


def test_a_person_runs_a_kernel_by_commands(tmp_path: Path) -> None:
    """Start, enable, move, refuse, jog, stop, look, end by SIGTERM; the exit codes tell."""
    file, name = tmp_path / "robot.toml", f"line-{os.getpid()}"
    file.write_text(FILE)
    kernel = subprocess.Popen(
        [sys.executable, "-m", "sjerk", "kernel", str(file), "--name", name, "--json"],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert kernel.stdout is not None

    def say(job: str, *arguments: str) -> tuple[int, dict]:
        done = sjerk(job, *arguments, "--name", name, "--json")
        return done.returncode, json.loads(done.stdout) if done.stdout else {}

    with kernel.stdout:
        started = json.loads(kernel.stdout.readline())
        assert (started["kernel"], started["axes"]) == (name, 2)
        assert sjerk("move", "1", "2", "--name", name).returncode == 3  # not enabled
        assert say("enable")[0] == 0
        code, after = say("move", "0=10", "1=-5", "--synchronization", "phase")
        assert code == 0
        assert [axis["position"] for axis in after["axes"]] == [10.0, -5.0]
        assert sjerk("move", "0=171", "--name", name).returncode == 1  # beyond the limits
        assert sjerk("move", "0=x", "--name", name).returncode == 1
        alone = sjerk("move", "10", "--name", name)
        assert alone.returncode == 1
        assert "one target per axis (2)" in alone.stderr
        code, after = say("move", "0=11", "1=-6", "--velocity", "20")  # axis 1 accelerates less
        assert code == 0
        assert [axis["position"] for axis in after["axes"]] == [11.0, -6.0]
        late = sjerk("move", "0=160", "--timeout", "0.05", "--name", name)
        assert late.returncode == 5
        assert late.stderr == "sjerk: move of axis 0 to 160.0: not within 0.05 s\n"
        code, after = say("stop", "--quick")
        assert code == 0
        assert after["axes"][0]["velocity"] == 0.0
        assert say("move", "0=-10", "--no-wait")[0] == 0
        assert say("move", "0=-12", "--buffer", "blend low", "--no-wait")[0] == 0
        code, after = say("move", "0=-13", "--buffer", "buffered")
        assert code == 0
        assert after["axes"][0]["position"] == -13.0
        assert sjerk("move", "0=1", "--buffer", "sometime", "--name", name).returncode == 2
        code, after = say("jog", "0=-2", "1=2")
        assert code == 0
        code, after = say("status")
        assert [axis["state"] for axis in after["axes"]] == ["CONTINUOUS_MOTION"] * 2
        assert say("stop")[0] == 0
        code, after = say("report", "--seconds", "0.2")
        assert [row["of"] for row in after["times_us"]] == ["latency", "period", "computing"]
        assert {row["count"] for row in after["times_us"]} == {after["cycles"]}
        judged = after["cyclictest_us"]
        assert judged == "not installed" or judged["count"] > 100
        code, after = say("move", "elbow=-4")
        assert code == 0
        assert after["axes"][1]["position"] == -4.0
        assert say("stop", "elbow")[0] == say("jog", "elbow=0", "0=0")[0] == 0
        for words in (("stop", "wrist"), ("enable", "wrist"), ("move", "wrist=1")):
            unknown = sjerk(*words, "--name", name)
            assert unknown.returncode == 1
            assert "'wrist': is no number 0 .. 1, and no name: elbow" in unknown.stderr
        beside = sjerk("kernel", str(file), "--name", name)
        assert beside.returncode == 1
        assert f"`sjerk status --name {name}` shows it" in beside.stderr
        code, after = say("disable", "elbow")
        assert code == 0
        assert [axis["state"] for axis in after["axes"]] == ["STANDSTILL", "DISABLED"]
        assert say("disable")[0] == 0
        waits = sjerk("move", "1", "2", "--buffer", "buffered", "--name", name)
        assert waits.returncode == 3
        assert "refused by axis 0: the drive does not follow" in waits.stderr
        kernel.terminate()
        assert kernel.wait(timeout=600.0) == 0
    assert sjerk("status", "--name", name).returncode == 6
    assert not [entry for entry in Path("/dev/shm").iterdir() if name in entry.name]


STUCK = """
[[axes]]
name = "shoulder"
counts_per_unit = 46603.37777777778
following_error = 1.0
limits = { velocity = 60, acceleration = 300, jerk = 6000 }
drive = { hard_stop_positive_rev = 0.08333333 }
"""


def test_an_axis_in_error_stop_is_told_until_it_is_none(tmp_path: Path) -> None:
    """A motor that something holds: the move, enable and reset say so, and what they say helps."""
    file, name = tmp_path / "stuck.toml", f"stuck-{os.getpid()}"
    file.write_text(STUCK)
    with load(file, name=name):

        def say(*words: str) -> tuple[int, str]:
            done = sjerk(*words, "--name", name)
            return done.returncode, done.stderr

        assert say("enable")[0] == 0
        code, told = say("move", "shoulder=60")
        assert code == 4
        assert "in ErrorStop (axis 0 (shoulder))" in told
        assert "`sjerk reset` resets faults" in told
        for verb, helps in (
            ("enable", "`sjerk reset`"),
            ("reset", "`sjerk disable`, `sjerk reset`"),
        ):
            code, told = say(verb)
            assert code == 1
            assert "in ErrorStop: axis 0 (shoulder)" in told
            assert helps in told
        for verb in ("disable", "reset", "enable"):
            assert say(verb)[0] == 0
        assert say("move", "shoulder=10")[0] == 0


def test_a_kernel_with_drives_outside_is_refused_in_a_line(tmp_path: Path) -> None:
    """Nobody would exchange their image in a process of its own: said before anything runs."""
    file = tmp_path / "robot.toml"
    file.write_text(FILE + 'drive = "external"\n')
    done = sjerk("kernel", str(file), "--name", f"outside-{os.getpid()}")
    assert done.returncode == 1
    assert "external drives are for step()" in done.stderr
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize("order", [b"", b"\x80\x05"])
def test_a_kernel_process_without_its_order_ends_quietly(order: bytes) -> None:
    """Whoever started it was ended before, or while, it said what to run."""
    program = [sys.executable, "-P", "-m", "sjerk.kernel"]
    done = subprocess.run(program, input=order, capture_output=True, timeout=600)
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")


def test_a_kernel_that_is_ended_before_it_runs_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C while it starts: exit code 130, not that of a kernel that ran."""
    file = tmp_path / f"early-{os.getpid()}.toml"
    file.write_text(FILE)
    start = MotionKernel.__enter__

    def interrupted(kernel: MotionKernel) -> MotionKernel:
        start(kernel)
        kernel.__exit__()
        raise KeyboardInterrupt

    monkeypatch.setattr(MotionKernel, "__enter__", interrupted)
    assert main(["kernel", str(file)]) == 130


def test_a_picture_of_an_unknown_kind_is_refused_first(capsys: pytest.CaptureFixture[str]) -> None:
    """Before the recording is read: the kinds there are."""
    assert main(["plot", "none.mcap", "--out", "x.abc"]) == 1
    told = capsys.readouterr().err
    assert told.startswith("sjerk: out = 'x.abc': must end in ")
    assert ".png" in told


def test_points_before_and_after_resampling_are_drawn(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As many as ``resample`` keeps; what is no trajectory is refused with its file."""
    file = tmp_path / "way.csv"
    rows = [f"{0.1 * k},{0.2 * k},{0.1 * k}" for k in range(9)]
    file.write_text("\n".join(["time,a,b", *rows]) + "\n")
    assert main(["plot", str(file), "--resample", "0.5"]) == 0
    assert "9 points, 3 kept" in capsys.readouterr().out
    assert file.with_suffix(".png").stat().st_size > 1000
    assert main(["plot", str(file), "--resample", "-1"]) == 1
    assert "delta" in capsys.readouterr().err
    assert main(["plot", str(file), "--resample", "0.5", "--axes", "2"]) == 1
    assert "0 .. 1" in capsys.readouterr().err
    file.write_text("no numbers")
    assert main(["plot", str(file), "--resample", "0.5"]) == 1
    assert "way.csv" in capsys.readouterr().err


def test_a_panel_is_refused_before_anything_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A robot that is no file, a table that says something unknown, a port that is none."""
    assert main(["panel", "none.toml"]) == 1
    assert "none.toml" in capsys.readouterr().err
    assert main(["panel", "--port", "70000"]) == 1
    assert "65535" in capsys.readouterr().err
    file = tmp_path / "robot.toml"
    file.write_text(FILE + "\n[panel]\nmeshes = 1\n")
    assert main(["panel", str(file)]) == 1
    assert "panel.meshes" in capsys.readouterr().err


def test_a_missing_extra_is_named_with_its_module(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """One line, and what to install."""
    file = tmp_path / "robot.toml"
    file.write_text(FILE)
    monkeypatch.setitem(sys.modules, "pyarrow", None)  # also where it has been imported before
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    monkeypatch.delitem(sys.modules, "sjerk.recording.parquet", raising=False)
    assert main(["kernel", str(file), "--record", "a.parquet", "--seconds", "1"]) == 1
    told = capsys.readouterr().err
    assert told == "sjerk: module 'pyarrow' is not installed: pip install 'sjerk[record]'\n"


def test_where_no_kernel_runs_is_told_like_an_unknown_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 6, with a name and without; where many run it is to be named."""
    monkeypatch.setattr(common, "clean", lambda dry_run: [])
    for job in ("status", "enable", "monitor", "report"):
        assert main([job]) == 6
        assert capsys.readouterr().err.startswith("sjerk: no kernel runs; `sjerk kernel ")
    assert main(["status", "--name", f"nobody-{os.getpid()}"]) == 6
    capsys.readouterr()
    assert main(["status", "--name", ""]) == 1
    assert "kernel name ''" in capsys.readouterr().err


def test_a_recording_is_not_overwritten_without_force(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of a kernel from its begin, and of one that runs; refused before anything runs."""
    file, out = tmp_path / "robot.toml", tmp_path / "out.mcap"
    file.write_text(FILE)
    name = f"force-{os.getpid()}"
    axis = Axis(Limits(90.0, 500.0, 5000.0), 2**24 / 360.0)
    with MotionKernel([axis], 1e-3) as kernel:
        for job in (
            ["kernel", str(file), "--name", name, "--record", str(out), "--seconds", "0.2"],
            ["record", str(out), "--name", kernel.name, "--seconds", "0.2"],
        ):
            out.write_bytes(b"precious")
            assert main(job) == 1
            told = capsys.readouterr().err
            assert told == f"sjerk: file = '{out}': exists: --force overwrites it\n"
            assert out.read_bytes() == b"precious"
            assert main([*job, "--force"]) == 0
            assert len(Recording.open(out)) > 0


def test_a_bad_name_is_told_as_it_was_given(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Without the suffix of what goes with a kernel."""
    file = tmp_path / "robot.toml"
    file.write_text(FILE)
    assert main(["kernel", str(file), "--name", "bad name"]) == 1
    assert "kernel name 'bad name' must be" in capsys.readouterr().err


def test_exit_codes_are_in_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    """Each of them."""
    with pytest.raises(SystemExit):
        main(["--help"])
    assert "Exit codes: 0 done" in capsys.readouterr().out


def test_who_is_host_already_is_named_with_what_halts_it() -> None:
    """An order beside a host of this process: its process, and the orders that stop its move."""
    axis = Axis(Limits(90.0, 500.0, 5000.0), 2**24 / 360.0, unit="deg")
    with MotionKernel([axis], 1e-3) as kernel, kernel.host():
        done = sjerk("enable", "--name", kernel.name)
        assert done.returncode == 1
        assert f"process {os.getpid()}: `sjerk stop` halts the axes beside it" in done.stderr


LEAD = """
import signal, sys, time
from sjerk import Host
if "--deaf" in sys.argv:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
with Host.attach(sys.argv[1]) as host:
    host.enable()
    host.jog(20.0).accepted()
    print("leads", flush=True)
    while True:
        time.sleep(1.0)
"""


@contextmanager
def leader(name: str, *options: str) -> Iterator[subprocess.Popen[str]]:
    """A program that is host and jogs, in a process of its own."""
    program = [sys.executable, "-c", LEAD, name, *options]
    pipe = subprocess.PIPE
    with subprocess.Popen(program, stdout=pipe, stderr=pipe, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "leads\n"
        try:
            yield process
        finally:
            process.kill()


def one_axis() -> Axis:
    return Axis(Limits(90.0, 500.0, 5000.0), 2**24 / 360.0, unit="deg")


@pytest.mark.parametrize("quick", [(), ("--quick",)])
def test_a_stop_works_while_another_program_leads(quick: tuple[str, ...]) -> None:
    """The axes are at rest, the program goes on, and the event names who asked."""
    with MotionKernel([one_axis()], 1e-3) as kernel, leader(kernel.name) as process:
        with Monitor.attach(kernel.name) as monitor:
            done = sjerk("stop", "--json", *quick, "--name", kernel.name)
            assert done.returncode == 0, done.stderr
            assert json.loads(done.stdout)["axes"][0]["velocity"] == 0.0
            assert monitor.host_pid == process.pid
            told = [e for e in monitor.events()[0] if e.kind is EventKind.STOP]
        assert [StopKind(event.code) for event in told] == [
            StopKind.QUICK_STOP if quick else StopKind.HALT
        ]
        assert told[0].pid not in (None, process.pid, os.getpid())
        assert process.poll() is None


def test_a_stop_with_interrupt_ends_the_program_that_leads() -> None:
    """Its Ctrl-C comes after the stop; where nobody leads it is a stop like any other."""
    with MotionKernel([one_axis()], 1e-3) as kernel:
        with leader(kernel.name) as process:
            done = sjerk("stop", "--interrupt", "--json", "--name", kernel.name)
            assert done.returncode == 0, done.stderr
            assert "KeyboardInterrupt" in process.communicate(timeout=600)[1]
        again = sjerk("stop", "--interrupt", "--name", kernel.name)
        assert again.returncode == 0, again.stderr
        with kernel.host() as host:
            assert host.feedback().axes[0].velocity == 0.0


def test_a_program_that_is_deaf_to_ctrl_c_is_stopped_and_named() -> None:
    """It still leads, which is an error; the axes are at rest all the same."""
    with MotionKernel([one_axis()], 1e-3) as kernel, leader(kernel.name, "--deaf") as process:
        done = sjerk("stop", "--interrupt", "--name", kernel.name)
        assert done.returncode == 1
        assert f"at rest, but process {process.pid} still leads" in done.stderr
        with Monitor.attach(kernel.name) as monitor:
            assert monitor.feedback().axes[0].velocity == 0.0


def test_the_live_table_needs_no_host(tmp_path: Path) -> None:
    """Monitor shows a row per axis and leaves by itself."""
    axis = Axis(Limits(90.0, 500.0, 5000.0), 2**24 / 360.0, unit="deg")
    with MotionKernel([axis], 1e-3) as kernel, kernel.host():
        shown = sjerk("monitor", "--seconds", "0.3", "--name", kernel.name)
        assert shown.returncode == 0, shown.stderr
        assert "DISABLED" in shown.stdout


def test_the_version_is_that_of_the_installation(capsys: pytest.CaptureFixture[str]) -> None:
    """One line: the version, what built the extension, what runs it; exit code 0."""
    with pytest.raises(SystemExit) as ended:
        main(["--version"])
    assert ended.value.code == 0
    told = capsys.readouterr().out
    assert told.startswith(f"sjerk {metadata.version('sjerk')} (")
    assert told.count("\n") == 1
    assert all(word in told for word in (platform.machine(), platform.python_version()))


def test_messages_name_the_next_step(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A goal for drives that are off, and none that runs: each names the verb that helps."""
    with MotionKernel([Axis(Limits(90.0, 500.0, 5000.0), 1e3, drive="ideal")]) as kernel:
        assert main(["move", "1", "--name", kernel.name]) == 3
        told = capsys.readouterr().err
        assert told.count("\n") == 1
        assert "`sjerk enable` enables them" in told
    assert main(["move", "1", "--name", kernel.name]) == 6
    assert "`sjerk kernel robot.toml` starts one" in capsys.readouterr().err


def test_a_soak_that_is_not_there_is_refused_before_anything_is_installed(tmp_path: Path) -> None:
    """In a copy of the script and the soaks, where an installation could only fail."""
    copy = tmp_path / "run"
    copy.write_bytes((ROOT / "run").read_bytes())
    shutil.copytree(ROOT / "tests" / "stress", tmp_path / "tests" / "stress")
    for words in (["stress"], ["stress", "kernel_host"], ["stress", "../drive"]):
        done = subprocess.run(["sh", str(copy), *words], capture_output=True, text=True)
        assert done.returncode == 1
        assert all(soak in done.stderr for soak in ("handshake", "kernel", "stop", "streams"))
        assert done.stderr.count("\n") == 1
    assert not (tmp_path / ".venv").exists()
