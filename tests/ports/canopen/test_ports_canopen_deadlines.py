"""The deadline of receive PDOs, 140xh:5: error 8250h, and what 6007h says."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.canopen_wire import NODE, Wire
from sjerk.cia402 import DriveState
from sjerk.drive import SdoError
from sjerk.drive.eds import eds
from sjerk.drive.entries import Abort
from sjerk.drive.objects import OBJECTS
from sjerk.ports.canopen import NmtState

GAP_MS = 20


def watched(option: int = 1, *, enabled: bool = True) -> Wire:
    """A drive whose first receive PDO has 20 ms, in a stream of SYNCs that goes on."""
    wire = Wire()
    wire.write(0x6007, 0, option)
    wire.write(0x10F1, 2, 0xFFFF)
    wire.write(0x1400, 5, GAP_MS)
    if enabled:
        wire.enable()
    wire.sent.clear()
    return wire


def silence(wire: Wire, ms: int) -> None:
    """SYNCs without process data."""
    for _ in range(ms):
        wire.sync()
        wire.node.tick(wire.now)


def emergencies(wire: Wire) -> list[str]:
    return [data[:3].hex() for data in wire.take(0x080 + NODE)]


def test_a_receive_pdo_that_stays_away_is_a_fault() -> None:
    """8250h once, 1001h and 1003h with it; the next PDO ends the cause, a reset the fault."""
    wire = watched()
    silence(wire, GAP_MS - 1)
    assert wire.device.feedback.state is DriveState.OPERATION_ENABLED
    silence(wire, 400)
    assert wire.device.feedback.state is DriveState.FAULT
    assert emergencies(wire) == ["508211"]
    assert (wire.device.read(0x603F), wire.device.read(0x1001)) == (0x8250, 0x11)
    assert (wire.device.read(0x1003, 0), wire.device.read(0x1003, 1)) == (1, 0x8250)
    wire.write(0x6040, 0, 0x80)
    wire.sync()
    assert wire.device.feedback.state is DriveState.FAULT  # the cause is still there
    for word in (0x00, 0x80, 0x06):
        wire.sync(word)
    assert wire.device.feedback.state is DriveState.READY_TO_SWITCH_ON
    assert emergencies(wire) == ["000000"]


@pytest.mark.parametrize(
    ("option", "state"),
    [
        (0, DriveState.OPERATION_ENABLED),
        (2, DriveState.SWITCH_ON_DISABLED),
        (3, DriveState.SWITCH_ON_DISABLED),
    ],
)
def test_6007_says_what_a_missed_deadline_causes(option: int, state: DriveState) -> None:
    """Nothing, disable voltage, quick stop: no fault, but an emergency, and one at its end."""
    wire = watched(option)
    silence(wire, 500)
    assert wire.device.feedback.state is state
    assert wire.device.read(0x603F) == 0
    assert emergencies(wire) == ["508211"]
    assert wire.device.read(0x1001) == 0x11
    wire.sync(0x0F)
    assert emergencies(wire) == ["000000"]
    assert wire.device.read(0x1001) == 0
    silence(wire, 500)
    assert emergencies(wire) == ["508211"]


def test_the_watch_begins_with_the_first_pdo() -> None:
    """A master that has not begun misses nothing; nor does one outside Operational."""
    wire = watched(enabled=False)
    wire.put(0, bytes((1, NODE)))
    silence(wire, 200)
    assert emergencies(wire) == []
    wire.sync(0x06)
    wire.put(0, bytes((0x80, NODE)))
    assert wire.node.nmt == NmtState.PRE_OPERATIONAL
    silence(wire, 200)
    assert emergencies(wire) == []


@pytest.mark.parametrize("how", ["time 0", "disabled", "pre-operational", "reset"])
def test_a_watch_that_is_switched_off_misses_nothing(how: str) -> None:
    """And what was missed before is over."""
    for late in (False, True):
        wire = watched(0)
        if late:
            silence(wire, 2 * GAP_MS)
            assert emergencies(wire) == ["508211"]
        if how == "time 0":
            wire.write(0x1400, 5, 0)
        elif how == "disabled":
            wire.write(0x1400, 1, 0x80000205)
        else:
            wire.put(0, bytes((0x80 if how == "pre-operational" else 0x82, NODE)))
        wire.node.tick(wire.now)
        assert wire.device.read(0x1001) == 0
        silence(wire, 200)
        assert emergencies(wire) in ([], ["000000"])


def test_a_pdo_that_is_too_short_does_not_keep_the_deadline() -> None:
    """It is no process data, 8210h."""
    wire = watched()
    for _ in range(2 * GAP_MS):
        wire.put(0x200 + NODE, b"\x0f\x00")
        silence(wire, 1)
    assert emergencies(wire) == ["108211", "508211"]


@settings(max_examples=40, deadline=None)
@given(
    gaps=st.lists(st.integers(1, 60), min_size=1, max_size=12),
    deadline=st.integers(2, 50),
    others=st.booleans(),
)
def test_each_gap_longer_than_the_deadline_is_one_event(
    gaps: list[int], deadline: int, others: bool
) -> None:
    """Whatever other PDOs, SYNCs and frames come meanwhile."""
    wire = watched(0)
    wire.write(0x1400, 5, deadline)
    wire.sync(0x0F)
    for gap in gaps:
        for _ in range(gap - 1):
            if others:
                wire.put(0x300 + NODE, struct.pack("<ih", 0, 0))
            silence(wire, 1)
        wire.put(0x200 + NODE, struct.pack("<Hbi", 0x0F, 8, 0))
        wire.now += 1e-3
        wire.node.tick(wire.now)
    told = emergencies(wire)
    assert told == ["508211", "000000"] * (len(told) // 2)
    late = sum(gap > deadline for gap in gaps)
    assert late <= len(told) // 2 <= late + sum(gap == deadline for gap in gaps)


def test_without_sync_and_frames_the_node_acts_at_the_deadline() -> None:
    """`tick` tells when it is due, and a lone node needs nothing else."""
    wire = watched()
    due = wire.node.tick(wire.now)
    assert due <= wire.now + GAP_MS * 1e-3 + 1e-9
    while wire.now < 101.0 and not wire.device.read(0x603F):
        wire.now = max(wire.node.tick(wire.now), wire.now + 1e-6)
    assert wire.now - 100.0 < 0.05 + GAP_MS * 1e-3
    assert emergencies(wire) == ["508211"]


def test_the_record_has_no_entries_between_its_type_and_its_timer() -> None:
    """Sub-indices 3 and 4 of 140xh are none (06090011h), in the data sheet neither."""
    wire = Wire()
    for number in range(4):
        assert wire.device.read(0x1400 + number, 0) == 5
        assert [row.sub for row in OBJECTS[0x1400 + number].entries] == [0, 1, 2, 5]
        for sub in (3, 4, 6):
            with pytest.raises(SdoError) as caught:
                wire.device.read(0x1400 + number, sub)
            assert caught.value.abort is Abort.NO_SUBINDEX
    sheet = eds()
    assert "[1400sub5]" in sheet
    assert "[1400sub3]" not in sheet
