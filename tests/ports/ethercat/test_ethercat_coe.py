"""CoE by the rules: transfers, complete access, aborts, SDO information, mails."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.ethercat_bench import MS, Bench, MailFaultError, SdoAbortError
from sjerk.drive import DriveFault
from sjerk.drive.objects import OBJECTS
from sjerk.ports.ethercat import BEHAVIOURS, Behaviour, Line

CANOPEN_ONLY = {0x1005, 0x1006, 0x1014, 0x1016, 0x1017}


def preop(**options: object) -> Bench:
    """A device with its mailbox open."""
    bench = Bench(**options)
    bench.to_preop(0)
    return bench


def test_every_object_of_the_drive_reads_as_the_device_has_it() -> None:
    """Through the wire as from the dictionary of the drive, byte for byte."""
    bench = preop()
    device = bench.line.devices[0].device
    own = {0x1008, 0x1018}
    for index, thing in OBJECTS.items():
        if index in CANOPEN_ONLY or index in own or 0x1400 <= index < 0x1C00:
            continue
        for row in thing.entries:
            device.pull()
            assert bench.upload(0, index, row.sub) == device.upload(index, row.sub)


def test_expedited_and_normal_downloads_and_uploads() -> None:
    """The same value both ways; the drive has it."""
    bench = preop()
    bench.download(0, 0x6065, 0, struct.pack("<I", 123456))
    assert bench.upload(0, 0x6065, 0) == struct.pack("<I", 123456)
    bench.download(0, 0x6065, 0, struct.pack("<I", 654321), expedited=False)
    assert bench.line.devices[0].device.drive.config.following_window == 654321
    bench.sdo(0, struct.pack("<BHBI", 0x22, 0x6065, 0, 77))  # expedited, size not indicated
    assert bench.upload(0, 0x6065, 0) == struct.pack("<I", 77)


@given(st.integers(32, 1024).map(lambda n: n & ~1), st.integers(1, 64))
def test_long_transfers_go_in_segments_through_any_mailbox(size: int, count: int) -> None:
    """A mapping of many words by complete access, down and up again, whatever a mail holds."""
    words = [0x00000008] * (count - 1) + [0x60400010]
    behaviour = Behaviour(mailbox=size, entries=64)
    bench = preop(behaviour=behaviour)
    data = struct.pack(f"<H{count}I", count, *words)
    bench.download(0, 0x1600, 0, data, complete=True)
    assert bench.upload(0, 0x1600, 0, complete=True) == data
    assert bench.upload(0, 0x1600, 1, complete=True) == data[2:]


ABORTS = {
    "no object": (lambda b: b.upload(0, 0x5000, 0), 0x06020000),
    "CANopen's object": (lambda b: b.upload(0, 0x1017, 0), 0x06020000),
    "no sub-index": (lambda b: b.upload(0, 0x6040, 1), 0x06090011),
    "a hole": (lambda b: b.upload(0, 0x1C32, 7), 0x06090011),
    "read-only": (lambda b: b.download(0, 0x6041, 0, b"\0\0"), 0x06010002),
    "read-only, own": (lambda b: b.download(0, 0x1018, 1, bytes(4)), 0x06010002),
    "read-only, long": (lambda b: b.download(0, 0x1008, 0, bytes(300)), 0x06010002),
    "too long": (lambda b: b.download(0, 0x6040, 0, bytes(4)), 0x06070012),
    "too short": (lambda b: b.download(0, 0x6065, 0, bytes(2)), 0x06070013),
    "too long, own": (lambda b: b.download(0, 0x1C12, 0, bytes(4)), 0x06070012),
    "out of range": (lambda b: b.download(0, 0x6060, 0, b"\x63"), 0x06090030),
    "no such kind of synchronisation": (lambda b: b.download(0, 0x1C32, 1, b"\7\0"), 0x06090030),
    "word while the mapping is closed": (
        lambda b: b.download(0, 0x1600, 1, struct.pack("<I", 0x60400010)), 0x08000022),
    "no such PDO": (
        lambda b: (b.download(0, 0x1C12, 0, b"\0"), b.download(0, 0x1C12, 1, b"\x99\x99")),
        0x06090030),
    "an input among the outputs": (
        lambda b: (b.download(0, 0x1601, 0, b"\0"),
                   b.download(0, 0x1601, 1, struct.pack("<I", 0x60410010))), 0x06040041),
    "an unknown object mapped": (
        lambda b: (b.download(0, 0x1601, 0, b"\0"),
                   b.download(0, 0x1601, 1, struct.pack("<I", 0x50000010))), 0x06020000),
    "a wrong length mapped": (
        lambda b: (b.download(0, 0x1601, 0, b"\0"),
                   b.download(0, 0x1601, 1, struct.pack("<I", 0x60400020))), 0x06040041),
    "more words than there are": (lambda b: b.download(0, 0x1601, 0, b"\x40"), 0x06040042),
    "an empty word counted": (lambda b: b.download(0, 0x1601, 0, b"\x08"), 0x06040041),
    "the same PDO twice": (
        lambda b: (b.download(0, 0x1C12, 0, b"\0"), b.download(0, 0x1C12, 1, b"\1\x16"),
                   b.download(0, 0x1C12, 2, b"\1\x16"), b.download(0, 0x1C12, 0, b"\2")),
        0x06040041),
    "complete access to a variable": (lambda b: b.upload(0, 0x6040, 0, complete=True), 0x06010000),
    "complete access from sub-index 2": (
        lambda b: b.upload(0, 0x1018, 2, complete=True), 0x06010000),
    "complete access, odd end": (
        lambda b: b.download(0, 0x1600, 0, bytes((1, 0, 0x10, 0)), complete=True), 0x06070013),
    "complete access, too much": (
        lambda b: b.download(0, 0x1C12, 0, bytes(100), complete=True), 0x06070012),
    "an unknown command": (lambda b: b.sdo(0, bytes((0xE0, 0, 0, 0, 0, 0, 0, 0))), 0x05040001),
    "a segment out of the blue": (lambda b: b.sdo(0, b"\x60" + bytes(7)), 0x05040001),
    "a segment down out of the blue": (lambda b: b.sdo(0, bytes(8)), 0x05040001),
}  # fmt: skip


@pytest.mark.parametrize("name", ABORTS)
def test_what_is_not_possible_is_aborted_by_its_code(name: str) -> None:
    """And the next access works."""
    do, code = ABORTS[name]
    bench = preop()
    with pytest.raises(SdoAbortError) as caught:
        do(bench)
    assert caught.value.code == code
    assert bench.upload(0, 0x1000, 0) == struct.pack("<I", 0x00020192)


def test_a_wrong_toggle_ends_the_transfer() -> None:
    """Up and down: 05030000h, and the transfer is gone."""
    bench = preop(behaviour=Behaviour(mailbox=32))
    bench.sdo(0, struct.pack("<BHB4x", 0x50, 0x1600, 0))
    with pytest.raises(SdoAbortError) as caught:
        bench.sdo(0, b"\x70" + bytes(7))
    assert caught.value.code == 0x05030000
    with pytest.raises(SdoAbortError) as caught:
        bench.sdo(0, b"\x60" + bytes(7))
    assert caught.value.code == 0x05040001
    bench.sdo(0, struct.pack("<BHBI", 0x31, 0x1600, 0, 60) + bytes(16))
    with pytest.raises(SdoAbortError) as caught:
        bench.sdo(0, b"\x10" + bytes(7))
    assert caught.value.code == 0x05030000


@pytest.mark.parametrize(("sizes", "code"), [([10, 20], 0x06070012), ([10], 0x06070013)])
def test_segments_that_do_not_add_up(sizes: list[int], code: int) -> None:
    """More than announced, or less at the end."""
    bench = preop(behaviour=Behaviour(mailbox=64))
    bench.sdo(0, struct.pack("<BHBI", 0x31, 0x1600, 0, 60) + bytes(48))
    *before, last = sizes
    for toggle, size in enumerate(before):
        bench.sdo(0, bytes((toggle << 4,)) + bytes(size))
    with pytest.raises(SdoAbortError) as caught:
        bench.sdo(0, bytes((len(before) << 4 | 1,)) + bytes(last))
    assert caught.value.code == code


def test_an_abort_of_the_main_device_ends_a_transfer_without_an_answer() -> None:
    """Command 80h."""
    bench = preop(behaviour=Behaviour(mailbox=32))
    bench.sdo(0, struct.pack("<BHB4x", 0x50, 0x1600, 0))
    body = struct.pack("<HBHBI", 0x2000, 0x80, 0x1600, 0, 0)
    assert bench.post(0, struct.pack("<HHBB", len(body), 0, 0, 0x13) + body) == 1
    assert bench.fetch(0) is None
    with pytest.raises(SdoAbortError):
        bench.sdo(0, b"\x60" + bytes(7))


MAILS = {
    "FoE": (struct.pack("<HHBB", 10, 0, 0, 0x14) + bytes(10), 0x0002),
    "EoE": (struct.pack("<HHBB", 10, 0, 0, 0x12) + bytes(10), 0x0002),
    "protocol 0": (struct.pack("<HHBB", 10, 0, 0, 0x10) + bytes(10), 0x0002),
    "longer than the mailbox": (struct.pack("<HHBB", 200, 0, 0, 0x13), 0x0008),
    "no data": (struct.pack("<HHBB", 0, 0, 0, 0x13), 0x0008),
    "CoE of one byte": (struct.pack("<HHBB", 1, 0, 0, 0x13), 0x0008),
    "SDO without a command": (struct.pack("<HHBBH", 2, 0, 0, 0x13, 0x2000), 0x0008),
    "SDO cut off": (struct.pack("<HHBBH", 6, 0, 0, 0x13, 0x2000) + b"\x40\x00\x10\x00", 0x0008),
    "information cut off": (struct.pack("<HHBBH", 4, 0, 0, 0x13, 0x8000) + b"\3\0", 0x0008),
    "another service": (struct.pack("<HHBBH", 10, 0, 0, 0x13, 0x5000) + bytes(8), 0x0004),
}


@pytest.mark.parametrize("name", MAILS)
def test_a_mail_that_is_not_understood_gets_an_error_mail(name: str) -> None:
    """Protocol 0 with the code; the mailbox works on."""
    mail, code = MAILS[name]
    bench = preop()
    assert bench.post(0, mail) == 1
    answer = bench.fetch(0)
    assert answer is not None
    assert answer[5] & 15 == 0
    assert struct.unpack_from("<HH", answer, 6) == (1, code)
    assert bench.upload(0, 0x1000, 0)
    with pytest.raises(MailFaultError):
        bench.ask(0, bytes(10), protocol=4)


def test_the_last_mail_is_repeated_when_it_is_asked_for() -> None:
    """080Eh bit 1 toggles, 080Fh bit 1 follows, the same mail is there again."""
    bench = preop()
    mail = struct.pack("<HHBBH", 10, 0, 0, 0x13, 0x2000) + struct.pack("<BHB4x", 0x40, 0x1000, 0)
    bench.post(0, mail)
    first = bench.fetch(0)
    for toggle in (2, 0, 2):
        assert bench.fetch(0) is None
        bench.write(0, 0x080E, bytes((1 | toggle,)))
        assert bench.read(0, 0x080F, 1)[0] & 2 == toggle
        assert bench.fetch(0) == first


@pytest.mark.parametrize("lost", range(4))
def test_a_lost_fragment_is_repeated_and_those_behind_it_follow(lost: int) -> None:
    """The list of objects in fragments; one of them never arrives and is asked for again."""
    bench = preop()
    body = struct.pack("<HBBHH", 0x8000, 1, 0, 0, 1)
    asking = struct.pack("<HHBB", len(body), 0, 0, 0x13) + body
    bench.post(0, asking)
    whole = []
    while (mail := bench.fetch(0)) is not None:
        whole.append(mail[6:])
    assert len(whole) == 2  # 95 objects
    bench.post(0, asking)
    got, toggle = [], 0
    for number in range(len(whole)):
        mail = bench.fetch(0)
        if number == lost or lost == 3:  # the main device did not get it
            toggle ^= 2
            bench.write(0, 0x080E, bytes((1 | toggle,)))
            mail = bench.fetch(0)
        assert mail is not None
        got.append(mail[6:])
    assert got == whole
    assert bench.fetch(0) is None


def test_mails_of_the_device_count_from_1_to_7() -> None:
    """The counter that main devices use to tell a new mail from a repeated one."""
    bench = preop()
    counters = []
    for _ in range(9):
        bench.post(0, struct.pack("<HHBBH", 10, 0, 0, 0x13, 0x2000) + b"\x40\x00\x10\0\0\0\0\0")
        mail = bench.fetch(0)
        assert mail is not None
        counters.append(mail[5] >> 4)
    assert counters == [1, 2, 3, 4, 5, 6, 7, 1, 2]


def test_information_describes_every_object_that_can_be_read() -> None:
    """List, object and entry descriptions agree with what uploads give."""
    for name in BEHAVIOURS:
        bench = preop(behaviour=name)
        lists = struct.unpack("<6H", bench.information(0, 1, b"\0\0"))
        kinds = {}
        for kind in range(1, 6):
            data = bench.information(0, 1, struct.pack("<H", kind))
            assert struct.unpack_from("<H", data)[0] == kind
            kinds[kind] = struct.unpack(f"<{len(data) // 2 - 1}H", data[2:])
            assert len(kinds[kind]) == lists[kind]
        assert list(kinds[1]) == sorted(set(kinds[1]))
        for index in kinds[1]:
            data = bench.information(0, 3, struct.pack("<H", index))
            found, _, highest, code = struct.unpack_from("<HHBB", data)
            assert (found, code == 7) == (index, highest == 0)
            assert data[6:].decode("ascii").strip()
            for sub in range(highest + 1):
                data = bench.information(0, 5, struct.pack("<HBB", index, sub, 7))
                found, told, _, kind, bits, access = struct.unpack_from("<HBBHHH", data)
                assert (found, told) == (index, sub)
                if kind == 0:
                    with pytest.raises(SdoAbortError):
                        bench.upload(0, index, sub)
                    continue
                assert len(bench.upload(0, index, sub)) * 8 == bits
                assert bool(access & 0x40) <= (index in kinds[2])
                assert bool(access & 0x80) <= (index in kinds[3])


@pytest.mark.parametrize(
    ("opcode", "body", "code"),
    [
        (3, struct.pack("<H", 0x5000), 0x06020000),
        (5, struct.pack("<HBB", 0x5000, 0, 7), 0x06020000),
        (5, struct.pack("<HBB", 0x6040, 1, 7), 0x06090011),
        (1, struct.pack("<H", 6), 0x06090030),
        (9, bytes(4), 0x05040001),
    ],
)
def test_information_about_nothing_is_refused(opcode: int, body: bytes, code: int) -> None:
    """With an abort code."""
    bench = preop()
    with pytest.raises(SdoAbortError) as caught:
        bench.information(0, opcode, body)
    assert caught.value.code == code


def test_mapping_is_closed_outside_of_preop() -> None:
    """1600h and 1C12h in Safe-operational: 08000022h."""
    bench = Bench()
    bench.to_safeop(0)
    for index in (0x1600, 0x1A00, 0x1C12, 0x1C13):
        with pytest.raises(SdoAbortError) as caught:
            bench.download(0, index, 0, b"\0")
        assert caught.value.code == 0x08000022


def test_a_failed_complete_access_leaves_the_mapping_as_it_was() -> None:
    """All or nothing."""
    bench = preop()
    before = bench.upload(0, 0x1600, 0, complete=True)
    with pytest.raises(SdoAbortError):
        bench.download(0, 0x1600, 0, struct.pack("<HII", 2, 0x60400010, 0x60410010), complete=True)
    assert bench.upload(0, 0x1600, 0, complete=True) == before


RX = {0x6040: (16, "H"), 0x607A: (32, "i"), 0x60FF: (32, "i"), 0x6071: (16, "h"), 0x60B1: (32, "i"),
      0x60B2: (16, "h"), 0x6060: (8, "b"), 0x6072: (16, "H"), 0x6081: (32, "I"),
      0x60E0: (16, "H")}  # fmt: skip
TX = {0x6041: 16, 0x6064: 32, 0x606C: 32, 0x6077: 16, 0x603F: 16, 0x6061: 8, 0x60F4: 32, 0x1001: 8}


@given(st.data())
def test_any_mapping_carries_its_objects_at_any_bit(data: st.DataObject) -> None:
    """Random PDOs with padding of any number of bits: outputs arrive, inputs are what SDOs read."""
    bench = preop()
    sent = data.draw(
        st.permutations(list(RX)).flatmap(lambda p: st.integers(1, 6).map(lambda n: p[:n]))
    )
    seen = data.draw(
        st.permutations(list(TX)).flatmap(lambda p: st.integers(1, 6).map(lambda n: p[:n]))
    )
    placed: dict[int, list[tuple[int, int]]] = {0x1600: [], 0x1A00: []}
    for index, objects in ((0x1600, sent), (0x1A00, seen)):
        words, bit = [], 0
        for thing in objects:
            if gap := data.draw(st.integers(0, 13)):
                words.append(gap)
                bit += gap
            bits = RX[thing][0] if index == 0x1600 else TX[thing]
            placed[index].append((thing, bit))
            words.append(thing << 16 | bits)
            bit += bits
        bench.download(
            0, index, 0, struct.pack(f"<H{len(words)}I", len(words), *words), complete=True
        )
    bench.to_op(0)
    values, image = {}, 0
    for thing, bit in placed[0x1600]:
        width, kind = RX[thing]
        value = {
            0x6040: 0x0006, 0x6060: 8, 0x6072: data.draw(st.integers(0, 3500)),
            0x60E0: data.draw(st.integers(0, 3500)), 0x6081: data.draw(st.integers(1, 2**31)),
        }.get(thing)  # fmt: skip
        if value is None:
            value = data.draw(st.integers(-(2 ** (width - 1)), 2 ** (width - 1) - 1))
        values[thing] = struct.pack("<" + kind, value)
        image |= (value & ((1 << width) - 1)) << bit
    size = bench.layout[0][1]
    for _ in range(3):
        answer = bench.exchange(0, image.to_bytes(size, "little"))
        assert answer.wkc == 3
    for thing, data_sent in values.items():
        assert bench.upload(0, thing, 0) == data_sent
    bench.line.advance(MS // 2)
    inputs = int.from_bytes(bench.read(0, 0x2400, bench.lengths(0)[1]), "little")
    for thing, bit in placed[0x1A00]:
        width = TX[thing]
        got = (inputs >> bit & ((1 << width) - 1)).to_bytes(width // 8, "little")
        assert got == bench.upload(0, thing, 0)


def test_faults_come_as_emergencies_and_go_as_their_end() -> None:
    """603Fh and 1001h in the emergency; code 0000h when the fault is reset; 1003h keeps it."""
    bench = Bench()
    bench.to_op(0)
    bench.line.inject(0, DriveFault.OVER_CURRENT)
    for _ in range(3):
        bench.exchange(0, b"")
    mail = bench.fetch(0)
    assert mail is not None
    assert struct.unpack_from("<HHB", mail, 6)[:2] == (0x1000, DriveFault.OVER_CURRENT.code)
    assert mail[10] == bench.upload(0, 0x1001, 0)[0] != 0
    bench.line.inject(0, DriveFault.OVER_CURRENT, False)
    for word in (0x0000, 0x0080, 0x0000):
        for _ in range(3):
            bench.exchange(0, struct.pack("<Hb", word, 8))
    mail = bench.fetch(0)
    assert mail is not None
    assert struct.unpack_from("<HHB", mail, 6) == (0x1000, 0, 0)
    assert bench.upload(0, 0x1003, 1)[:2] == struct.pack("<H", DriveFault.OVER_CURRENT.code)


def test_nobody_reads_and_nothing_grows() -> None:
    """A drive that faults a thousand times while its mailbox is not read."""
    line = Line()
    bench = Bench(line)
    bench.to_op(0)
    for _ in range(700):
        line.inject(0, DriveFault.OVER_CURRENT)
        bench.exchange(0, struct.pack("<Hb", 0, 8))
        line.inject(0, DriveFault.OVER_CURRENT, False)
        bench.exchange(0, struct.pack("<Hb", 0x80, 8))
    mails = 0
    while bench.fetch(0) is not None:
        mails += 1
    assert 8 <= mails <= 513
    assert bench.upload(0, 0x1000, 0)
