"""Datagrams, working counters, FMMUs and buffers against the rules, in virtual time."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.ethercat_bench import (
    APRD,
    APRW,
    APWR,
    ARMW,
    BRD,
    BRW,
    BWR,
    FPRD,
    FPRW,
    FPWR,
    FRMW,
    LRD,
    LRW,
    LWR,
    MS,
    NOP,
    Bench,
    compose,
    take_apart,
)  # fmt: skip
from sjerk.ports.ethercat import Line

RAM = 0x1900  # process RAM that no SyncManager owns


def bench(count: int = 3) -> Bench:
    """Devices whose RAM holds their number, twice."""
    made = Bench(drives=count)
    for k in range(count):
        made.write(k, RAM, bytes((0x10 << k, 0x01 << k)))
    return made


# command: (address, working counter, data read, devices written); sent are the bytes 80h 08h
TABLE = {
    NOP: (0x1002, 0, b"\x80\x08", []),
    APRD: (-1, 1, b"\x20\x02", []),
    APWR: (-1, 1, b"\x80\x08", [1]),
    APRW: (-1, 3, b"\x20\x02", [1]),
    FPRD: (0x1002, 1, b"\x20\x02", []),
    FPWR: (0x1002, 1, b"\x80\x08", [1]),
    FPRW: (0x1002, 3, b"\x20\x02", [1]),
    BRD: (0, 3, b"\xf0\x0f", []),
    BWR: (0, 3, b"\x80\x08", [0, 1, 2]),
    BRW: (0, 9, b"\xf0\x0f", [0, 1, 2]),
    ARMW: (-1, 3, b"\x20\x02", [0, 2]),
    FRMW: (0x1002, 3, b"\x20\x02", [0, 2]),
}


@pytest.mark.parametrize("command", TABLE)
def test_every_command_reads_writes_and_counts(command: int) -> None:
    """Read +1, written +1, read-write 3; a broadcast ORs; a multiple write spares the one it reads.

    A multiple write gives those behind the addressed device what it read, those before it what was
    sent; a broadcast read-write gives each what had been gathered before it.
    """
    address, wkc, data, written = TABLE[command]
    made = bench()
    answer = made.one(command, address, RAM, b"\x80\x08")
    assert (answer.wkc, answer.data) == (wkc, data)
    for k in range(3):
        old = bytes((0x10 << k, 0x01 << k))
        new = b"\x20\x02" if command in (ARMW, FRMW) and k == 2 else b"\x80\x08"
        if command == BRW:
            new = (b"\x80\x08", b"\x90\x09", b"\xb0\x0b")[k]
        assert made.read(k, RAM, 2) == (new if k in written else old)


@pytest.mark.parametrize("command", [c for c in TABLE if c != NOP])
def test_nobody_addressed_nothing_counted(command: int) -> None:
    """Beyond the line, an unknown station, or outside of the memory."""
    made = bench()
    if command not in (BRD, BWR, BRW):
        nobody = {APRD: -3, APWR: -3, APRW: -3, ARMW: -3}.get(command, 0x2000)
        answer = made.one(command, nobody, RAM, b"\0\0")
        assert answer.wkc == (3 if command in (ARMW, FRMW) else 0)
    assert made.one(command, TABLE[command][0], 0x2FFF, b"\0\0").wkc == 0
    assert made.one(command, TABLE[command][0], 0x0FFF, b"\0\0").wkc == 0


def test_positions_count_on_and_the_second_address_is_the_alias() -> None:
    """Auto-increment addresses count every device; 0012h answers once 0103h says so."""
    made = Bench(drives=3, alias=500)
    frame = made.line.frame(compose((APRD, 5, 0x10, b"\0\0")))
    assert frame is not None
    assert struct.unpack_from("<H", frame, 18)[0] == 8
    assert made.one(FPRD, 501, 0x0012, b"\0\0").wkc == 0
    made.write(1, 0x0103, b"\1")
    assert made.one(FPRD, 501, 0x0012, b"\0\0") == (struct.pack("<H", 501), 1)


@given(st.data())
def test_logical_addresses_go_through_the_fmmus_bit_by_bit(data: st.DataObject) -> None:
    """Any two FMMUs at any bits against a model that moves single bits."""
    made = Bench(drives=1)
    memory = bytearray(data.draw(st.binary(min_size=64, max_size=64), label="memory"))
    made.write(0, RAM, bytes(memory))
    maps = []
    for n in range(2):
        length = data.draw(st.integers(1, 6))
        first, last = data.draw(st.integers(0, 7)), data.draw(st.integers(0, 7))
        if length == 1 and last < first:
            first, last = last, first
        logical = data.draw(st.integers(0x1000, 0x1010))
        physical, bit = data.draw(st.integers(RAM, RAM + 40)), data.draw(st.integers(0, 7))
        kind = data.draw(st.sampled_from([1, 2, 3]))
        made.fmmu(0, n, logical, length, physical, kind, (first, last, bit))
        maps.append(
            (logical * 8 + first, length * 8 - 8 - first + last + 1, physical * 8 + bit, kind)
        )
    command = data.draw(st.sampled_from([LRD, LWR, LRW]))
    origin = data.draw(st.integers(0x0FFC, 0x1012))
    sent = data.draw(st.binary(min_size=1, max_size=24))
    answer = made.one(command, origin, 0, sent)

    read, written = bytearray(sent), False
    reads = False
    for start, count, physical, kind in maps:
        bits = range(max(start, origin * 8), min(start + count, (origin + len(sent)) * 8))
        if kind & 2 and command != LRD and bits:
            written = True
            for x in bits:
                at, source = physical + x - start - RAM * 8, x - origin * 8
                value = sent[source // 8] >> source % 8 & 1
                memory[at // 8] = memory[at // 8] & ~(1 << at % 8) | value << at % 8
        if kind & 1 and command != LWR and bits:
            reads = True
            for x in bits:
                at, target = physical + x - start - RAM * 8, x - origin * 8
                value = memory[at // 8] >> at % 8 & 1
                read[target // 8] = read[target // 8] & ~(1 << target % 8) | value << target % 8
    assert made.read(0, RAM, 64) == bytes(memory)
    assert answer.data == bytes(read)
    assert answer.wkc == reads + written * (2 if command == LRW else 1)


@pytest.mark.parametrize(("command", "wkc"), [(LRD, 1), (LWR, 1), (LRW, 3)])
def test_working_counters_tell_the_drives_apart(command: int, wkc: int) -> None:
    """Two drives at addresses of their own: each counts for itself, together for both."""
    made = Bench(drives=2)
    for k in (0, 1):
        made.to_op(k)
    for k in (0, 1):
        assert made.one(command, made.layout[k][0], 0, bytes(24)).wkc == wkc
    assert made.one(command, made.layout[0][0], 0, bytes(64 + 24)).wkc == 2 * wkc


def test_half_a_write_of_outputs_is_never_seen() -> None:
    """The drive gets the outputs when their last byte is written, whole."""
    made = Bench()
    made.to_op(0)
    start, target = 0x1800, struct.pack("<Hbxi", 0x0006, 8, 1000)
    whole = target + bytes(6)
    made.exchange(0, whole)
    assert made.upload(0, 0x607A, 0) == target[4:8]
    made.write(0, start, struct.pack("<Hbxi", 0x000F, 8, 2000))
    made.line.advance(5 * MS)
    assert made.upload(0, 0x607A, 0) == target[4:8]
    made.write(0, start + 8, bytes(6))
    made.line.advance(5 * MS)
    assert made.upload(0, 0x607A, 0) == struct.pack("<i", 2000)


def test_inputs_change_only_when_their_first_byte_is_read() -> None:
    """A read that begins in the middle goes on in the buffer that was begun."""
    made = Bench()
    made.to_op(0)
    end = 0x2400
    before = made.read(0, end, 24)
    for _ in range(5):
        made.exchange(0, struct.pack("<Hbx", 0x0006, 8) + bytes(10))
    first = made.read(0, end, 2)
    assert first != before[:2]
    rest = made.read(0, end + 2, 22)
    for _ in range(5):
        made.exchange(0, struct.pack("<Hbx", 0x0000, 8) + bytes(10))  # LRW reads the first byte
    assert made.read(0, end, 24)[:2] != first
    assert len(rest) == 22


@pytest.mark.parametrize("offset", [0x0000, 0x0008, 0x0110, 0x0130, 0x0134, 0x0440, 0x092C, 0x0804])
def test_what_only_the_device_writes_is_not_written(offset: int) -> None:
    """Information, states, counters: a write counts and changes nothing."""
    made = Bench()
    made.to_preop(0)
    before = made.read(0, offset, 2)
    made.write(0, offset, bytes(b ^ 0xFF for b in before))
    assert made.read(0, offset, 2) == before


def test_a_sync_manager_is_changed_only_while_it_is_off() -> None:
    """Start, length and control keep their values while bit 0 of the activation is set."""
    made = Bench()
    made.to_preop(0)
    before = made.read(0, 0x0800, 8)
    made.write(0, 0x0800, struct.pack("<HHB", 0x1700, 64, 0x20))
    assert made.read(0, 0x0800, 8) == before
    made.write(0, 0x0806, b"\0")
    made.write(0, 0x0800, struct.pack("<HHB", 0x1700, 64, 0x20))
    assert made.read(0, 0x0800, 5) == struct.pack("<HHB", 0x1700, 64, 0x20)


def test_an_empty_mailbox_and_a_full_one_count_nothing() -> None:
    """Reading nothing, writing twice: working counter 0; the status says which."""
    made = Bench()
    made.to_preop(0)
    assert made.fetch(0) is None
    asking = struct.pack("<HHBBH", 10, 0, 0, 0x13, 0x2000) + struct.pack("<BHB4x", 0x40, 0x1000, 0)
    accepted = 0
    while made.post(0, asking):
        accepted += 1
        assert made.read(0, 0x080D, 1)[0] & 8
    assert 2 < accepted < 20
    answers = 0
    while made.fetch(0) is not None:
        answers += 1
    assert answers == accepted
    assert not made.read(0, 0x080D, 1)[0] & 8
    assert made.post(0, asking) == 1


@pytest.mark.parametrize(
    "spoil",
    [
        lambda f: f[:20],
        lambda f: f[:12] + b"\x08\x00" + f[14:],
        lambda f: f[:14] + b"\xff\x17" + f[16:],
        lambda f: f[:14] + b"\x0e\x20" + f[16:],
        lambda f: f[:22] + b"\xff\x07" + f[24:],
        lambda f: f[:22] + b"\x02\x80" + f[24:],
        lambda f: b"",
        lambda f: f + bytes(1600),
    ],
)
def test_a_broken_frame_is_not_answered(spoil: object) -> None:
    """Too short, another protocol, lengths that do not fit: no answer, nothing changes."""
    made = Bench()
    frame = compose((BWR, 0, 0x0010, b"\x55\x55"))
    assert made.line.frame(spoil(frame)) is None  # type: ignore[operator]
    assert made.word(0, 0x0010) == 0x1001


def test_faults_of_frames_on_demand() -> None:
    """Every third frame is lost on its way back; every second has a logical counter too small."""
    made = Bench(Line(drives=2))
    for k in (0, 1):
        made.to_op(k)
    made.line.lose(3)
    asking = compose((BRD, 0, 0x0130, b"\0\0"))
    lost = [made.line.frame(asking) is None for _ in range(30)]
    assert sum(lost) == 10
    made.line.lose(0)
    made.line.wkc(2)
    logical = compose((LRW, made.layout[0][0], 0, bytes(24)), (BRD, 0, 0x0130, b"\0\0"))
    counters = [take_apart(made.line.frame(logical) or b"") for _ in range(10)]
    assert sorted(answers[0].wkc for answers in counters) == [2] * 5 + [3] * 5
    assert all(answers[1].wkc == 2 for answers in counters)


def test_a_cut_cable_and_a_power_cycle() -> None:
    """Behind the cut nobody answers; a device that was switched off has lost its address."""
    made = Bench(drives=4)
    made.line.cut(2)
    assert made.one(BRD, 0, 0x0130, b"\0\0").wkc == 2
    assert made.word(1, 0x0110) & 0x0C20 == 0x0400  # port 1: no link, loop closed
    assert made.read(1, 0x0311, 1) == b"\1"
    made.line.heal()
    assert made.word(1, 0x0110) & 0x0C20 == 0x0820
    assert made.one(BRD, 0, 0x0130, b"\0\0").wkc == 4
    made.line.power_cycle(3)
    assert made.one(FPRD, 0x1004, 0x0130, b"\0\0").wkc == 0
    assert made.one(APRD, -3, 0x0010, b"\0\0") == (b"\0\0", 1)


def test_the_watchdog_of_the_outputs() -> None:
    """0400h and 0420h: 100 ms by default; then Safe-operational with 001Bh, counted in 0442h."""
    made = Bench()
    made.to_op(0)
    made.line.advance(99 * MS)
    assert made.al(0) == (8, 0)
    made.exchange(0, b"")
    made.line.advance(99 * MS)
    assert made.al(0) == (8, 0)
    made.line.advance(2 * MS)
    assert made.al(0) == (0x14, 0x001B)
    assert made.word(0, 0x0440) & 1 == 0
    assert made.read(0, 0x0442, 1) == b"\1"


@pytest.mark.parametrize(("units", "ms"), [(0, 0), (10, 1), (250, 25)])
def test_the_watchdog_is_what_the_main_device_sets(units: int, ms: int) -> None:
    """0 switches it off."""
    made = Bench()
    made.write(0, 0x0420, struct.pack("<H", units))
    made.to_op(0, cycle=MS // 4)
    made.exchange(0, b"")
    made.line.advance(max(0, ms * MS - 1000))
    assert made.al(0)[0] == 8
    made.line.advance(300 * MS)
    assert made.al(0)[0] == (8 if units == 0 else 0x14)
