"""Names of axes, where simulated ones start, events in words, stops that are not waited for."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.loops import enabled
from sjerk import (
    Axis,
    DriveConfig,
    InputError,
    Limits,
    Monitor,
    MotionKernel,
    MotionStoppedError,
    Recorder,
    RefusedError,
    SupersededError,
)
from sjerk._binding import lib
from sjerk.cli.common import axis_rows
from sjerk.cycle.states import AxisState
from sjerk.host import Event, EventKind, PathState, StopKind
from sjerk.kernel import load

LIMITS = Limits(2.0, 8.0, 60.0, position=(-3.0, 3.0))
T = 1e-3


def arm() -> list[Axis]:
    return [Axis(LIMITS, 1e6, "ideal", name=name) for name in ("shoulder", "", "elbow")]


def test_a_name_goes_through_the_toml_the_frame_and_the_status(tmp_path: Path) -> None:
    """As it was written, UTF-8 included; an axis without a name has none."""
    file = tmp_path / "arm.toml"
    row = "counts_per_unit = 1e6\nlimits = { velocity = 2, acceleration = 8, jerk = 60 }\n"
    file.write_text(f'[[axes]]\nname = "Hüfte"\nstart = 1.25\n{row}[[axes]]\n{row}', "utf-8")
    kernel = load(file)
    host = kernel.host()
    assert host.names == ("Hüfte", "")
    kernel.step()
    axes = host.feedback().axes
    assert [axis.name for axis in axes] == ["Hüfte", ""]
    assert [axis.position for axis in axes] == [1.25, 0.0]
    assert axes[0].counts_per_unit == 1e6
    assert [row.get("name") for row in axis_rows(host.feedback())] == ["Hüfte", ""]
    assert "name" not in axis_rows(enabled([Axis(LIMITS, 1e6)])[1].feedback())[0]


def test_refusals_and_stops_name_the_axis() -> None:
    """By number and name; by number alone where there is no name."""
    kernel, host = enabled(arm(), T)
    refused = host.move({2: 9.0}, relative=True)
    kernel.step()
    with pytest.raises(RefusedError, match=r"refused by axis 2 \(elbow\): it would leave"):
        refused.check()
    refused = host.move({1: 9.0}, relative=True)
    kernel.step()
    with pytest.raises(RefusedError, match="refused by axis 1: it would leave"):
        refused.check()
    move = host.move({0: 1.0, 1: 0.5})
    kernel.step(200)
    host.halt()
    kernel.step(2000)
    text = r"commanded positions: axis 0 \(shoulder\) 0\.\d+, axis 1 0\.\d+$"
    with pytest.raises(MotionStoppedError, match=text):
        move.check()
    move = host.move({0: 1.0})
    kernel.step(20)
    host.move({0: 0.0})
    kernel.step(2)
    with pytest.raises(SupersededError, match=r"axis 0 \(shoulder\)"):
        move.check()


def test_names_are_checked_where_they_are_given() -> None:
    """Length, kind, and that they differ."""
    for name in (3, None, "a\0b", "a\nb", "x" * 64, "ü" * 32):
        with pytest.raises(InputError, match="name"):
            Axis(LIMITS, 1e6, name=name)  # type: ignore[arg-type]
    longest = "ü" * 31 + "x"
    assert MotionKernel([Axis(LIMITS, 1e6, name=longest)]).host().names == (longest,)
    with pytest.raises(InputError, match=r"axes\[2\].name = 'a': is that of axis 0 already"):
        MotionKernel([Axis(LIMITS, 1e6, name=name) for name in ("a", "b", "a")])


# ---- where it starts -----------------------------------------------------------------------------


@given(
    start=st.floats(-3.0, 3.0),
    counts=st.floats(1e2, 1e8),
    gear=st.sampled_from([1.0, 100.0]),
    ideal=st.booleans(),
    polarity=st.sampled_from([0, 0x80]),
    feed=st.sampled_from([(2**24, 1), (10_000, 1), (1_000_003, 7)]),
)
def test_a_simulated_axis_stands_at_its_start(
    start: float, counts: float, gear: float, ideal: bool, polarity: int, feed: tuple[int, int]
) -> None:
    """To the nearest increment, in the first frame and when it is enabled; and moves from there."""
    if abs(start * counts * gear) > 2**31 - 1:
        with pytest.raises(InputError, match="start"):
            Axis(LIMITS, counts, gear=gear, start=start)
        return
    drive: Any = "ideal"
    if not ideal:
        drive = DriveConfig(polarity=polarity, feed=feed[0], feed_shaft=feed[1])
    axis = Axis(Limits(1e-9, 1e-6, 1e-3), counts, drive, gear=gear, start=start)
    kernel = MotionKernel([axis], T)
    host = kernel.host()
    assert abs(kernel.positions[0] - start) <= 0.5001 / (counts * gear)
    at = float(kernel.positions[0])
    kernel.step()
    assert host.feedback().axes[0].position == at
    host.enable()
    kernel.step(50)
    assert host.feedback().axes[0].follows
    assert host.feedback().axes[0].position == pytest.approx(at, abs=3.0 / (counts * gear))


def test_a_start_moves_and_homes_as_any_other_place() -> None:
    """A simulated motor far from 0: the motion is within the limits, nothing jumps."""
    axis = Axis(LIMITS, 1e6, start=-2.5)
    kernel, host = enabled([axis], T)
    move = host.move(2.5)
    rows = []
    while not move.done:
        kernel.step()
        rows.append(host.feedback().axes[0])
    assert max(abs(row.position - row.actual_position) for row in rows) < 0.05
    assert min(row.position for row in rows) >= -2.5


def test_a_start_is_checked_where_it_is_given() -> None:
    """Outside the range, no number, of an external drive."""
    for start in (3.5, math.nan, math.inf, "here"):
        with pytest.raises(InputError, match="start"):
            Axis(LIMITS, 1e6, start=start)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="external"):
        Axis(LIMITS, 1e6, "external", start=0.5)


def test_names_and_starts_are_in_a_recording() -> None:
    """So that a replay begins there, and its events tell the names."""
    kernel = MotionKernel([Axis(LIMITS, 1e6, "ideal", name="elbow", start=-1.5)], T)
    with Recorder(kernel, None) as recorder:
        host = kernel.host()
        host.enable()
        kernel.step(20)
    recording = recorder.recording
    assert (recording.axes[0].name, recording.axes[0].start) == ("elbow", -1.5)
    assert any("axis 0 (elbow): standstill" in str(event) for event in recording.events)


# ---- events in words -----------------------------------------------------------------------------


def test_every_kind_of_event_has_words() -> None:
    """Numbers that mean something are told as that."""
    accepted, limit = lib.SJ_RESULT_ACCEPTED, lib.SJ_RESULT_LIMIT
    names = ["base", "elbow"]
    cases: list[tuple[EventKind, int, int, float, str]] = [
        (EventKind.GOAL, -1, accepted, 0.0, "goal 5 is accepted"),
        (EventKind.GOAL, 1, limit, 0.0, "goal 5 is refused by axis 1 (elbow): it would leave"),
        (EventKind.GOAL, -1, lib.SJ_RESULT_SUPERSEDED, 0.0, "goal 5 is superseded"),
        (EventKind.GOAL, -1, lib.SJ_RESULT_STOPPED, 0.0, "goal 5 is dropped"),
        (EventKind.STATE, 0, AxisState.ERROR_STOP, 4.0, "axis 0 (base): error stop, before"),
        (EventKind.HOST, -1, lib.SJ_HOST_DEAD, 1.0, "the host has died"),
        (EventKind.CORRUPT, -1, -3, 0.0, "corrupt"),
        (EventKind.FAULT, 1, 0x8611, 0.0, "axis 1 (elbow): drive fault 8611h (following error)"),
        (EventKind.FAULT, 1, -1, 0.0, "axis 1 (elbow): homing has failed"),
        (EventKind.FOLLOWING, 1, 0, 0.25, "axis 1 (elbow): following error 0.25"),
        (EventKind.LATE, -1, 0, 1.0, "1 cycle left out"),
        (EventKind.LATE, -1, 0, 3.0, "3 cycles left out"),
        (EventKind.ANCHOR, 1, 0, 0.0, "its drive left in motion"),
        (EventKind.LIMITS, 1, accepted, 0.0, "axis 1 (elbow): a set of limits is accepted"),
        (EventKind.PATH, -1, PathState.PAUSED, 7.0, "path 5 is paused, ahead is way-point 7"),
        (EventKind.REACHED, -1, 0, 0.0, "goal 5 is reached"),
        (EventKind.SYNC, 1, 0, 0.0, "axis 1 (elbow): nothing came from its drive"),
        (EventKind.SYNC, 1, 0x8130, 0.0, "axis 1 (elbow): link lost, 8130h"),
        (EventKind.SWITCH, 1, 1, 0.0, "axis 1 (elbow): limit switch closed, negative"),
        (EventKind.SWITCH, 1, 3, 1.0, "limit switch closed, negative and positive"),
        (EventKind.SWITCH, 1, 0, 1.0, "axis 1 (elbow): limit switches are open"),
        (EventKind.STOP, -1, StopKind.HALT, 77.0, "halt of all axes by process 77"),
        (EventKind.STOP, 1, StopKind.QUICK_STOP, 0.0, "quick stop of axis 1 (elbow) by a process"),
    ]
    assert {case[0] for case in cases} == set(EventKind)
    for kind, axis, code, value, words in cases:
        event = Event.of(12, kind, axis, code, value, 5, names)
        assert words in event.words
        assert str(event) == f"cycle 12: {event.words}"
    for kind in EventKind:
        for code in range(-3, 40):
            if kind not in (EventKind.STATE, EventKind.PATH, EventKind.STOP):
                assert Event.of(1, kind, -1, code, 0.0, 1).words


def test_events_of_a_host_carry_names() -> None:
    """What a panel prints."""
    _, host = enabled(arm(), T)
    told = [str(event) for event in host.events()[0]]
    assert any("axis 2 (elbow): standstill, before disabled" in text for text in told)
    assert any("axis 1: standstill, before disabled" in text for text in told)


# ---- stops that return at once -------------------------------------------------------------------


def test_a_stop_with_timeout_0_is_sent_and_not_waited_for() -> None:
    """By host and monitor: they return while the axes still move, and the axes come to rest."""
    slow = Axis(Limits(2.0, 1.0, 10.0), 1e6, "ideal", name="lift")
    with (
        MotionKernel([slow], T) as kernel,
        kernel.host() as host,
        Monitor.attach(kernel.name) as monitor,
    ):
        host.enable()
        for stop in (
            lambda: host.halt(0),
            lambda: host.quick_stop(0.0),
            lambda: monitor.halt(0),
            lambda: host.disable(0),
        ):
            jog = host.jog(0.5)
            jog.accepted()
            while host.feedback().axes[0].velocity < 0.3:
                pass
            stop()
            assert host.feedback().axes[0].moving  # it needs 0.4 s
            while host.feedback().moving:
                pass
            assert jog.state.name == "STOPPED"
        while host.feedback().axes[0].enabled:
            pass
