"""Recordings: every cycle, every bit, whatever happens to host, kernel and recorder."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sjerk import (
    Axis,
    DriveConfig,
    Host,
    InputError,
    Limits,
    MotionKernel,
    Reactions,
    Recorder,
    Recording,
    follow_path,
    replay,
    simulate,
)
from sjerk._binding import ffi, lib
from sjerk.cycle.states import AxisState
from sjerk.handshake import Layout, Segment
from sjerk.host import EventKind
from sjerk.kernel.trace import Trace, command_dtype, event_dtype, row_dtype
from sjerk.recording import files

T = 1e-3
COUNTS = 2**24 / 360.0
LIMITS = Limits(90.0, 500.0, 5000.0, deceleration=300.0, position=(-170.0, 170.0))
AXIS = Axis(LIMITS, COUNTS, unit="deg", stop_limits=Limits(90.0, 2000.0, 40000.0))
SUFFIXES = ("parquet", "mcap")


def moved(kernel: MotionKernel) -> None:
    """Some motion in an own loop."""
    with kernel.host() as host:
        host.enable()
        kernel.step(10)
        host.move([10.0 * (i + 1) for i in range(len(kernel.axes))])
        kernel.step(300)
        host.halt()
        kernel.step(200)


# ---- files ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", SUFFIXES)
@given(data=st.data())
@settings(max_examples=25, deadline=None)
def test_a_file_gives_every_bit_back(
    tmp_path_factory: pytest.TempPathFactory, suffix: str, data: st.DataObject
) -> None:
    """Doubles with their signs of zero, infinities and payloads of nan, integers, texts."""
    path = tmp_path_factory.mktemp("files") / f"a.{suffix}"
    n = data.draw(st.integers(1, 40))
    raw = st.binary(min_size=8 * 3 * n, max_size=8 * 3 * n)
    doubles = np.frombuffer(data.draw(raw), np.float64).reshape(n, 3).copy()
    doubles[0, :2] = 0.0, -0.0
    cycle = np.arange(5, 5 + n, dtype=np.uint64)
    told = np.sort(data.draw(st.lists(st.sampled_from(cycle.tolist()), max_size=9)))
    tables: files.Tables = {
        "frames": {
            "cycle": cycle,
            "time_ns": cycle * 1000,
            "x": doubles,
            "n": np.frombuffer(data.draw(st.binary(min_size=2 * n, max_size=2 * n)), np.int16),
        },
        "events": {
            "cycle": np.array(told, np.uint64),
            "data": np.array([bytes([i] * 5) for i in range(len(told))], dtype="V5"),
        },
    }
    file = files.writer(path, "what it is: ü")
    file.write(tables)
    file.close()
    back = files.reader(path)
    assert back.description == "what it is: ü"
    (found,) = list(back.tables())
    for name, table in tables.items():
        for column, values in table.items():
            assert found[name][column].tobytes() == values.tobytes(), (name, column)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_recording_is_what_the_host_saw(tmp_path: Path, suffix: str) -> None:
    """Each cycle of an own loop: positions, states, counts as in the feedback of that cycle."""
    path = tmp_path / f"a.{suffix}"
    kernel = MotionKernel([AXIS] * 3, T)
    seen = []
    with Recorder(kernel, path) as recorder, kernel.host() as host:
        host.enable()
        for cycle in range(400):
            if cycle == 20:
                host.move([30.0, -20.0, 10.0])
            kernel.step()
            seen.append(host.feedback())
    assert (recorder.cycles, recorder.missed) == (400, 0)
    found = Recording.open(path)
    assert found.axes == kernel.axes
    assert found.gaps == ()
    assert found.from_the_beginning
    assert found.cycle.tolist() == list(range(1, 401))
    for name in ("position", "velocity", "acceleration", "jerk", "goal", "actual_position"):
        expected = [[getattr(a, name) for a in f.axes] for f in seen]
        assert getattr(found, name).tolist() == expected, name
    for name in ("target_counts", "actual_counts", "statusword", "state", "goal_id"):
        expected = [[getattr(a, name) for a in f.axes] for f in seen]
        assert found.column(name).tolist() == expected, name
    states = [e.code for e in found.events if e.kind is EventKind.STATE and e.axis == 0]
    assert states == [AxisState.STANDSTILL, AxisState.DISCRETE_MOTION]
    assert found.commands["cycle"].tolist() == [1, 21]
    taken = np.frombuffer(found.commands["data"][1].tobytes(), command_dtype(3))
    assert taken["axis"]["goal"]["goal"][0].tolist() == [30.0, -20.0, 10.0]


def test_the_configuration_comes_back_whole(tmp_path: Path) -> None:
    """Axes, drives, limits, reactions; every field, so that a recording runs without its kernel."""
    axes = [
        Axis(Limits(1.0, 2.0, 3.0, deceleration=1.5), 1e5, DriveConfig(load_torque_nm=0.1)),
        Axis(Limits(9.0, 90.0, 900.0), 2.0, "ideal", unit="mm", gear=3.0, wrap=360.0),
        Axis(LIMITS, COUNTS, "external", stop_limits=LIMITS, following_error=0.5),
    ]
    kernel = MotionKernel(axes, 5e-4, reactions=Reactions(overrun="halt"))
    with Recorder(kernel, tmp_path / "a.mcap"):
        kernel.step(3)
    found = Recording.open(tmp_path / "a.mcap")
    assert found.axes == tuple(axes)
    assert found.reactions == Reactions(overrun="halt")
    assert found.cycle_time == 5e-4


def test_a_file_in_former_words_is_read(tmp_path: Path) -> None:
    """Reactions to corrupt commands were called ``spoilt`` in files."""
    kernel = MotionKernel([AXIS], reactions=Reactions(corrupt="quick stop"))
    with Recorder(kernel, tmp_path / "a.mcap"):
        kernel.step(10)
    recording = Recording.open(tmp_path / "a.mcap")
    assert recording.reactions.corrupt == "quick stop"
    former = recording.description["reactions"]
    former["spoilt"] = former.pop("corrupt")
    recording.save(tmp_path / "b.mcap")
    assert Recording.open(tmp_path / "b.mcap").reactions == kernel.reactions


def test_what_is_no_recording_is_refused_by_its_name(tmp_path: Path) -> None:
    """Another suffix, nothing there, other content, a Parquet file without its end."""
    for name, content in (
        ("a.csv", b""),
        ("b.parquet", None),
        ("c.mcap", b"x"),
        ("d.parquet", b""),
    ):
        if content is not None:
            (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=name):
            Recording.open(tmp_path / name)
    with pytest.raises(InputError, match=r"a\.csv"):
        Recorder(MotionKernel([AXIS]), tmp_path / "a.csv")


def test_an_mcap_file_whose_recorder_was_killed_is_read_to_where_it_came(tmp_path: Path) -> None:
    """Kill -9 in the middle of recording; whole cycles from the first on."""
    path = tmp_path / "a.mcap"
    code = """
        import os, signal, sys
        from sjerk import Axis, Limits, MotionKernel, Recorder
        kernel = MotionKernel([Axis(Limits(90.0, 500.0, 5000.0), 2**24 / 360)] * 7)
        Recorder(kernel, sys.argv[1]).__enter__()
        with kernel.host() as host:
            host.enable()
            kernel.step(30_000)
        os.kill(os.getpid(), signal.SIGKILL)
    """
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(code), str(path)], timeout=600)
    assert done.returncode == -signal.SIGKILL
    found = Recording.open(path)
    assert len(found) > 1000
    assert found.gaps == ()
    assert replay(found).identical


# ---- the trace -----------------------------------------------------------------------------------


def test_a_late_reader_loses_the_oldest_and_knows_how_many() -> None:
    """More cycles than the trace keeps, unread: the gap and the items lost are exact."""
    kernel = MotionKernel([AXIS], T)
    told = kernel.trace_to(None)
    trace = Trace.of(told)
    kernel.step(10)
    first = trace.read()
    capacity = told.layout.event_capacity
    kernel.step(3 * capacity)
    chunks = []
    while (chunk := trace.read()) is not None:
        chunks.append(chunk)
    assert first is not None
    assert first.frames["head"]["cycle"].tolist() == list(range(1, 11))
    cycles = np.concatenate([c.frames["head"]["cycle"] for c in chunks])
    missed = np.concatenate([c.missed for c in chunks])
    assert cycles[-1] == 10 + 3 * capacity
    assert (np.diff(cycles) == 1).all()
    assert missed[0] == cycles[0] - 11
    assert missed[1:].sum() == 0


def test_a_reader_of_a_full_trace_begins_where_nothing_is_overwritten_meanwhile() -> None:
    """The oldest eighth is left to the kernel: what comes before the first read loses nothing."""
    kernel = MotionKernel([AXIS], T)
    told = kernel.trace_to(None)
    capacity = told.layout.event_capacity
    kernel.step(2 * capacity)
    trace = Trace.of(told)
    kernel.step(capacity // 16)
    chunk = trace.read()
    assert chunk is not None
    assert chunk.missed.sum() == 0
    assert chunk.frames["head"]["cycle"][0] == 2 * capacity - capacity * 7 // 8 + 1


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_gaps_are_stored(tmp_path: Path, suffix: str) -> None:
    """A recorder that was kept away: the file says where and how much, and is not replayed."""
    path = tmp_path / f"a.{suffix}"
    kernel = MotionKernel([AXIS], T)
    with Recorder(kernel, path) as recorder:
        kernel.step(100)
        kernel.release_trace()
        kernel.step(20_000)
        kernel.trace_to(recorder.drain)
        kernel.step(100)
    found = Recording.open(path)
    assert recorder.missed > 0
    (gap,) = found.gaps
    assert gap.after == 100
    assert gap.items == recorder.missed == gap.before - gap.after - 1
    assert found.cycle[-1] == 20_200
    with pytest.raises(InputError, match=f"gap before cycle {gap.before}"):
        replay(found)


def test_a_trace_of_another_version_is_refused() -> None:
    """A segment of the name with another layout is not read."""
    name = f"kernel-{os.getpid()}-odd"
    text = json.dumps({"axes": [{}], "cycle_time": 1e-3}).encode()
    odd = Layout(
        command_bytes=8, feedback_bytes=len(text), event_bytes=64, event_capacity=256, abi=1
    )
    with Segment.create(f"{name}.trace", odd) as segment:
        lib.sj_feedback_publish(segment.base, text)
        with pytest.raises(Exception, match="another version"):
            Trace.attach(name)


def test_names_of_companions_are_not_kernels() -> None:
    """The trace goes by its kernel's name; both go with it."""
    with MotionKernel([AXIS], T) as kernel:
        names = {p.name for p in Path("/dev/shm").iterdir() if kernel.name in p.name}
        assert names == {f"sjerk-{kernel.name}", f"sjerk-{kernel.name}.trace"}
    assert not [p for p in Path("/dev/shm").iterdir() if kernel.name in p.name]


# ---- processes -----------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_process_with_a_real_host_replays_bit_for_bit(tmp_path: Path, suffix: str) -> None:
    """From the first cycle to the halt at the end; commands when they come, at 250 us."""
    path = tmp_path / f"a.{suffix}"
    kernel = MotionKernel([AXIS] * 7, 250e-6)
    files.ready(path)
    recorder = None
    with kernel:
        recorder = Recorder(kernel, path).__enter__()
        with kernel.host() as host:
            host.enable()
            host.move([20.0, -20.0, 10.0, 5.0, 1.0, -1.0, 0.5]).accepted()
            host.override(0.5)
            host.jog({2: -8.0}).accepted()
            host.halt(axes=0)
            host.quick_stop(axes=[1, 2])
            host.set_limits(Limits(40.0, 300.0, 3000.0), axes=3)
            host.move({3: -9.0}).wait(30.0)
            host.jog({4: 30.0}).accepted()
    recorder.__exit__()
    found = Recording.open(path)
    assert found.gaps == ()
    assert found.from_the_beginning
    assert (found.column("velocity")[-1] == 0.0).all()
    enabled = lib.SJ_SW_OPERATION_ENABLED
    assert (found.column("statusword")[-1] & enabled == 0).all()
    done = replay(found)
    assert done.identical, done.difference
    assert done.cycles == len(found)


def test_a_killed_host_is_in_the_recording_and_is_replayed(tmp_path: Path) -> None:
    """The death is an input of the cycle that saw it: the halt comes out again."""
    code = """
        import os, signal, sys
        from sjerk import Host
        host = Host.attach(sys.argv[1])
        host.enable()
        host.jog({0: 50.0, 1: -20.0}).accepted()
        os.kill(os.getpid(), signal.SIGKILL)
    """
    path = tmp_path / "a.parquet"
    files.ready(path)
    with MotionKernel([AXIS] * 2, T) as kernel, Recorder(kernel, path):
        host = [sys.executable, "-c", textwrap.dedent(code), kernel.name]
        assert subprocess.run(host, timeout=600).returncode == -signal.SIGKILL
        with kernel.host() as after:
            after.link.wait_until(lambda frame: not frame.axis[0].moving, 30.0, "the halt")
    found = Recording.open(path)
    dead = [e for e in found.events if e.kind is EventKind.HOST and e.code == lib.SJ_HOST_DEAD]
    assert len(dead) == 1
    assert replay(found).identical


def test_the_command_line_records_plots_and_simulates(tmp_path: Path) -> None:
    """Kernel --record, plot and simulate of what came out, in one line each."""
    toml, out = tmp_path / "robot.toml", tmp_path / "out.parquet"
    toml.write_text(
        "[[axes]]\ncounts_per_unit = 46603.4\n"
        "limits = { velocity = 90, acceleration = 500, jerk = 5000 }\n"
    )
    name = f"kernel-{os.getpid()}-recorded"
    job = [sys.executable, "-m", "sjerk"]
    kernel = subprocess.Popen(
        [*job, "kernel", str(toml), "--name", name, "--record", str(out), "--json"],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert kernel.stdout is not None
    with kernel.stdout:
        assert json.loads(kernel.stdout.readline())["kernel"] == name
        for command in (["enable"], ["move", "5"]):
            subprocess.run([*job, *command, "--name", name], check=True, timeout=600)
        beside = subprocess.run(
            [*job, "record", str(tmp_path / "b.mcap"), "--name", name, "--seconds=0.2", "--json"],
            capture_output=True,
            text=True,
            timeout=600,
            check=True,
        )
        assert json.loads(beside.stdout)["missed"] == 0
        kernel.send_signal(signal.SIGTERM)
        assert kernel.wait(600) == 0
    again = subprocess.run(
        [*job, "simulate", str(out), "--json"], capture_output=True, text=True, timeout=600
    )
    assert json.loads(again.stdout)["identical"] is True
    subprocess.run([*job, "plot", str(out)], check=True, timeout=600, capture_output=True)
    assert (tmp_path / "out.png").stat().st_size > 10_000


# ---- virtual time --------------------------------------------------------------------------------


def random_script(seed: int, axes: int, cycles: int) -> list[tuple[int, object]]:
    """Commands of every kind at random cycles."""
    rng = np.random.default_rng(seed)
    script: list[tuple[int, object]] = [(1, lambda host: host.enable())]
    for cycle in sorted(rng.integers(20, cycles, 25).tolist()):
        axis, goal = int(rng.integers(axes)), float(rng.uniform(-150.0, 150.0))
        kind = int(rng.integers(13))
        action = [
            lambda host, g=goal, a=axis: host.move({a: g}),
            lambda host, g=goal: host.move([g / (i + 1) for i in range(axes)]),
            lambda host, g=goal: host.move(
                [g / (i + 1) for i in range(axes)], synchronization="phase"
            ),
            lambda host, g=goal, a=axis: host.jog({a: g / 2}),
            lambda host, a=axis: host.halt(axes=a),
            lambda host: host.quick_stop(),
            lambda host, g=goal: host.override(abs(g) / 75.0),
            lambda host: host.hold(),
            lambda host: host.resume(),
            lambda host, a=axis: host.disable(axes=a) if a else host.enable(),
            lambda host, g=goal, a=axis: host.move({a: g}, buffer="buffered"),
            lambda host, g=goal: host.move([g] * axes, buffer="blend high"),
            lambda host, g=goal, a=axis: [
                host.move({a: g * n}, buffer="blend low") for n in (0.5, 0.7, 1.0)
            ][1].cancel(),
        ][kind]
        script.append((cycle, action))
    return script


@pytest.mark.parametrize("drive", [DriveConfig(), "ideal"])
@given(seed=st.integers(0, 2**32))
@settings(max_examples=15, deadline=None)
def test_a_simulation_is_deterministic_and_its_replay_identical(drive: object, seed: int) -> None:
    """Random commands: the same script gives the same bits, and so does the recording of it."""
    axes = [Axis(LIMITS, COUNTS, drive)] * 3  # type: ignore[arg-type]
    one, two = (
        simulate(MotionKernel(axes, T, name="same"), random_script(seed, 3, 3000), 3000)  # type: ignore[arg-type]
        for _ in range(2)
    )
    assert one.all.frames.tobytes() == two.all.frames.tobytes()
    done = replay(one)
    assert done.identical, done.difference
    assert done.cycles == 3000


def test_a_simulation_is_what_an_own_loop_does() -> None:
    """The same commands in the same cycles of step() give the same frames."""
    script = random_script(5, 3, 2000)
    found = simulate(MotionKernel([AXIS] * 3, T), script, 2000)  # type: ignore[arg-type]
    kernel = MotionKernel([AXIS] * 3, T)
    segment = kernel.trace_to(None)
    trace, rows = Trace.of(segment), []
    with kernel.host() as host:
        for cycle in range(1, 2001):
            for at, action in script:
                if at == cycle:
                    action(host)  # type: ignore[operator]
            kernel.step()
            chunk = trace.read()
            assert chunk is not None
            rows.append(chunk.frames)
    frames = np.concatenate(rows)
    frames["time_ns"] = found.all.frames["time_ns"]  # an own loop has no time
    assert frames.tobytes() == found.all.frames.tobytes()


def test_a_replay_names_the_first_difference() -> None:
    """One bit of one command, of one frame: cycle, axis, field and both values."""
    found = simulate(
        MotionKernel([AXIS] * 3, T),
        [(1, lambda host: host.enable()), (30, lambda host: host.move([1.0, 2.0, 3.0]))],
        200,
    )
    whole = found.all
    whole.frames["axis"]["target_counts"][120, 1] += 1
    done = replay(found)
    assert not done.identical
    assert done.cycles == 120
    assert done.difference is not None
    assert (done.difference.cycle, done.difference.axis) == (121, 1)
    assert done.difference.field == "target_counts"
    whole.frames["axis"]["target_counts"][120, 1] -= 1
    assert replay(found).identical
    command = whole.commands["data"][1:2].copy().view(command_dtype(3))
    command["axis"]["goal"]["goal"][0, 2] = np.nextafter(3.0, 4.0)
    whole.commands["data"][1] = command.view(whole.commands["data"].dtype)[0]
    done = replay(found)
    assert done.difference is not None
    assert done.difference.cycle == 30
    assert done.difference.axis == 2


def test_a_recording_that_begins_later_or_lacks_a_command_is_refused() -> None:
    """Clearly: only from the first cycle on is the state known."""
    found = simulate(MotionKernel([AXIS], T), [(9, lambda host: host.enable())], 100)
    whole = found.all

    def only(frames: np.ndarray, commands: np.ndarray) -> Recording:
        part = type(whole)(
            frames,
            np.zeros(len(frames), np.uint64),
            commands,
            whole.records,
            whole.events,
            whole.stops,
        )
        return Recording(found.description, lambda: iter((part,)))

    with pytest.raises(InputError, match="begins with cycle 11"):
        replay(only(whole.frames[10:], whole.commands[1:]))
    with pytest.raises(InputError, match="command is missing"):
        replay(only(whole.frames, whole.commands[:0]))
    with pytest.raises(InputError, match="gap before cycle 51"):
        replay(only(np.delete(whole.frames, slice(40, 50)), whole.commands))


def test_knots_of_a_path_are_planned_where_they_are_commanded() -> None:
    """Recorded with their cycles: the commanded position of that cycle, bit for bit."""
    axis = Axis(LIMITS, COUNTS, "ideal")
    rng = np.random.default_rng(1)
    points = np.vstack([np.zeros(2), np.cumsum(rng.normal(0.0, 3.0, (10, 2)), axis=0)])
    plan = list(follow_path(points, [axis.limits] * 2, T))
    played: list[Any] = []

    def act(cycle: int, host: Host) -> None:
        if cycle == 1:
            host.enable()
        if cycle == 30:
            played.append(host.follow(plan))
        for path in played:
            path.pump()

    found = simulate(MotionKernel([axis] * 2, T), act, 4000)
    for i in range(2):
        cycles, positions = found.knots(i)
        given = [block.position[1:, i] for block in plan]
        assert positions.tolist() == np.concatenate(given).tolist()
        assert found.position[cycles - 1, i].tolist() == positions.tolist()
    assert replay(found).identical


def test_external_drives_are_replayed_from_what_they_said(tmp_path: Path) -> None:
    """The process image of each cycle is an input: an external drive that lags comes out again."""
    axis = Axis(LIMITS, COUNTS, "external")
    kernel = MotionKernel([axis], T)
    drive = ffi.new("sj_drive *")
    config = DriveConfig().to_c()
    assert lib.sj_drive_init(drive, config) == 0
    with Recorder(kernel, tmp_path / "a.parquet"), kernel.host() as host:
        host.enable()
        for cycle in range(800):
            lib.sj_drive_cycle(
                drive,
                ffi.addressof(kernel.core, "rx")[0],
                ffi.addressof(kernel.core, "tx")[0],
            )
            if cycle == 30:
                host.move(12.0)
            kernel.step()
        assert host.feedback().axes[0].position == 12.0
    done = replay(tmp_path / "a.parquet")
    assert done.identical, done.difference


@given(seed=st.integers(0, 2**32))
@settings(max_examples=10, deadline=None)
def test_records_of_the_ring_are_inputs_too(seed: int) -> None:
    """Taken in the same cycles, dropped by the same stops, flushed: the replay gives the same."""
    rng = np.random.default_rng(seed)

    def feed(cycle: int, host: Host) -> None:
        if cycle == 1:
            host.enable()
        elif rng.random() < 0.2:
            size = int(lib.sj_record_bytes(3))
            many = int(rng.integers(1, 12))
            data = ffi.new("char[]", size * many)
            for i in range(many):
                record = ffi.cast("sj_record *", data + i * size)
                record.goal_id, record.kind = host.link.next_goal(), int(rng.integers(0, 3))
                record.axis[int(rng.integers(3))].goal.kind = lib.SJ_GOAL_ABSOLUTE
            host.link.publish_records(data, many)
        elif rng.random() < 0.1:
            host.halt()
        elif rng.random() < 0.1:
            lib.sj_ring_flush(host.link.segment.base)
        elif rng.random() < 0.1:
            host.move([float(x) for x in rng.uniform(-150.0, 150.0, 3)])

    found = simulate(MotionKernel([AXIS] * 3, T), feed, 400)
    assert len(found.records) > 20
    done = replay(found)
    assert done.identical, done.difference


def test_a_script_out_of_order_or_beyond_the_end_is_refused() -> None:
    """Before it does harm: with the place in the script."""
    enable = lambda host: host.enable()  # noqa: E731
    for script, place in (
        ([(5, enable), (4, enable)], r"script\[1\]"),
        ([(0, enable)], r"script\[0\]"),
        ([(101, enable)], r"script\[0\]"),
        ([(1, "enable")], r"script\[0\]"),
    ):
        with pytest.raises(InputError, match=place):
            simulate(MotionKernel([AXIS], T), script, 100)  # type: ignore[arg-type]
    kernel = MotionKernel([AXIS], T)
    kernel.step()
    with pytest.raises(InputError, match="run already"):
        simulate(kernel, [], 10)


def test_an_ideal_drive_is_on_its_target_and_obeys_the_words() -> None:
    """Disabled until enabled; then it is seen on its target in the next cycle, without error."""
    kernel = MotionKernel([Axis(LIMITS, COUNTS, "ideal")], T)
    found = simulate(
        kernel,
        [
            (1, lambda host: host.enable()),
            (50, lambda host: host.move(20.0)),
            (900, lambda host: host.disable()),
        ],
        1000,
    )
    state = found.column("state")[:, 0]
    assert state[0] == AxisState.DISABLED
    assert AxisState.DISCRETE_MOTION in state
    assert state[-1] == AxisState.DISABLED
    assert (found.column("target_counts")[:-1] == found.column("actual_counts")[1:]).all()
    assert found.position[800, 0] == 20.0


def test_layouts_of_python_and_c_agree() -> None:
    """Sizes of the rows as C has them."""
    for axes in (1, 7, 64):
        assert row_dtype(axes, "command")["data"].itemsize == lib.sj_command_bytes(axes)
        assert row_dtype(axes, "record")["data"].itemsize == lib.sj_record_bytes(axes)
        assert command_dtype(axes).itemsize == lib.sj_command_bytes(axes)
    assert event_dtype().itemsize == ffi.sizeof("sj_kernel_event")


def test_moved_kernels_can_be_recorded_from_the_middle(tmp_path: Path) -> None:
    """A recorder that comes later begins with its cycle; the arrays are those of the rest."""
    kernel = MotionKernel([AXIS] * 2, T)
    moved(kernel)
    before = kernel.core.feedback.cycle
    with Recorder(kernel, tmp_path / "a.mcap"):
        kernel.step(50)
    found = Recording.open(tmp_path / "a.mcap")
    assert found.cycle.tolist() == list(range(before + 1, before + 51))
    assert not found.from_the_beginning
