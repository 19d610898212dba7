"""SII, ESI file, dictionary and capture agree; the command line and its refusals."""

from __future__ import annotations

import struct
import subprocess
import sys
import xml.etree.ElementTree as Xml
from pathlib import Path

import pytest

from helpers.ethercat_bench import Bench, compose
from sjerk.__main__ import main
from sjerk.errors import InputError
from sjerk.ports.ethercat import BEHAVIOURS, Behaviour, Line
from sjerk.ports.ethercat.command import apply


def read_sii(bench: Bench) -> bytes:
    """The whole SII over the wire."""
    size = (struct.unpack_from("<H", bench.sii(0, 0x3E))[0] + 1) * 128
    return b"".join(bench.sii(0, word) for word in range(0, size // 2, 4))


def categories(memory: bytes) -> dict[int, bytes]:
    """The categories by number; the last is FFFFh."""
    found, at = {}, 0x80
    while True:
        kind, words = struct.unpack_from("<HH", memory, at)
        if kind == 0xFFFF:
            return found
        found[kind] = memory[at + 4 : at + 4 + 2 * words]
        at += 4 + 2 * words


def number(text: str | None) -> int:
    assert text
    return int(text[2:], 16) if text.startswith("#x") else int(text)


def words_of(data: bytes) -> dict[int, list[int]]:
    """PDOs of a category: index to mapping words."""
    pdos, at = {}, 0
    while at < len(data):
        index, count = struct.unpack_from("<HB", data, at)
        entries = [struct.unpack_from("<HBBBBH", data, at + 8 + 8 * n) for n in range(count)]
        pdos[index] = [e[0] << 16 | e[1] << 8 | e[4] for e in entries]
        at += 8 + 8 * count
    return pdos


@pytest.mark.parametrize("behaviour", BEHAVIOURS)
def test_sii_esi_and_dictionary_tell_the_same(behaviour: str) -> None:
    """Identity, SyncManagers, PDOs, AssignActivate, and every object with its length and access."""
    bench = Bench(behaviour=behaviour)
    bench.to_preop(0)
    memory = read_sii(bench)
    root = Xml.fromstring(bench.line.esi())
    device = root.find("Descriptions/Devices/Device")
    assert device is not None
    found = categories(memory)
    assert set(found) == {10, 30, 40, 41, 50, 51, 60}

    kind = device.find("Type")
    assert kind is not None
    vendor, product, revision = struct.unpack_from("<III", memory, 16)
    assert number(root.findtext("Vendor/Id")) == vendor
    assert number(kind.get("ProductCode")) == product
    assert number(kind.get("RevisionNo")) == revision
    for sub, value in enumerate((vendor, product, revision), 1):
        assert bench.upload(0, 0x1018, sub) == struct.pack("<I", value)
    assert bench.upload(0, 0x1008, 0).decode() == kind.text
    assert bytes.fromhex(device.findtext("Eeprom/ConfigData") or "") == memory[:14]
    assert found[10][1 : 2 + found[10][1]][1:].decode() == kind.text

    managers = [struct.unpack_from("<HHB", found[41], 8 * n) for n in range(4)]
    told = [
        (
            number(sm.get("StartAddress")),
            number(sm.get("DefaultSize")),
            number(sm.get("ControlByte")),
        )
        for sm in device.findall("Sm")
    ]
    assert told == managers
    assert [m[1] for m in managers[2:]] == list(bench.lengths(0))
    assert struct.unpack_from("<HHHH", memory, 0x30) == (*managers[0][:2], *managers[1][:2])

    for tag, category in (("RxPdo", 51), ("TxPdo", 50)):
        pdos = words_of(found[category])
        for pdo in device.findall(tag):
            words = [
                number(e.findtext("Index")) << 16 | int(e.findtext("SubIndex") or 0) << 8
                | int(e.findtext("BitLen") or 0)
                for e in pdo.findall("Entry")
            ]  # fmt: skip
            index = number(pdo.findtext("Index"))
            assert pdos.pop(index) == words
            assert [
                struct.unpack("<I", bench.upload(0, index, sub))[0]
                for sub in range(1, bench.upload(0, index, 0)[0] + 1)
            ] == words
        assert not pdos
    activate = [number(mode.findtext("AssignActivate")) for mode in device.findall("Dc/OpMode")]
    assert activate == [
        struct.unpack_from("<H", found[60], 24 * n + 14)[0] for n in range(len(activate))
    ]

    types = {t.findtext("Name"): t for t in device.findall("Profile/Dictionary/DataTypes/DataType")}
    data = bench.information(0, 1, b"\1\0")
    indices = struct.unpack(f"<{len(data) // 2 - 1}H", data[2:])
    objects = device.findall("Profile/Dictionary/Objects/Object")
    assert [number(o.findtext("Index")) for o in objects] == list(indices)
    for thing in objects:
        index = number(thing.findtext("Index"))
        items = types[thing.findtext("Type")].findall("SubItem")
        names = [item.findtext("Name") for item in items]
        assert len(set(names)) == len(names)
        at = 0
        for item in items:
            assert int(item.findtext("BitOffs") or -1) == at
            sub, bits = int(item.findtext("SubIdx") or 0), int(item.findtext("BitSize") or 0)
            assert len(bench.upload(0, index, sub)) * 8 == bits
            at += 16 if sub == 0 else bits
        assert int(thing.findtext("BitSize") or 0) == (at or 8 * len(bench.upload(0, index, 0)))


def test_the_sii_is_written_only_when_it_is_enabled_and_inside() -> None:
    """Error bits of 0503h; the alias counts after a reload."""
    bench = Bench()
    for control, word, error in ((0x0200, 4, 0x4000), (0x0201, 1024, 0x2000), (0x0300, 4, 0x2000)):
        bench.write(0, 0x0508, b"\x34\x12")
        bench.write(0, 0x0502, struct.pack("<HI", control, word))
        assert bench.word(0, 0x0502) & 0x7800 == error
    bench.write(0, 0x0508, b"\x34\x12")
    bench.write(0, 0x0502, struct.pack("<HI", 0x0201, 4))
    assert bench.sii(0, 4)[:2] == b"\x34\x12"
    assert bench.word(0, 0x0012) == 0
    bench.write(0, 0x0502, struct.pack("<HI", 0x0400, 0))
    assert bench.word(0, 0x0012) == 0x1234
    bench.line.power_cycle(0)
    assert Bench(bench.line).word(0, 0x0012) == 0


def test_a_kept_sii_survives_power_cycles_and_programs(tmp_path: Path) -> None:
    """``memory``: a file."""
    path = tmp_path / "sii"
    for expected in (0, 0x0102, 0x0102):
        with Line(drives=2, memory=path) as line:
            bench = Bench(line)
            assert bench.sii(1, 4)[:2] == struct.pack("<H", expected)
            bench.write(1, 0x0508, b"\x02\x01")
            bench.write(1, 0x0502, struct.pack("<HI", 0x0201, 4))
            line.power_cycle(1)
            assert Bench(line).word(1, 0x0012) == 0x0102


def test_a_capture_holds_every_frame_and_its_time(tmp_path: Path) -> None:
    """pcapng, block by block."""
    path = tmp_path / "frames.pcapng"
    asking = compose((7, 0, 0x0130, b"\0\0"))
    with Line(capture=path) as line:
        line.advance(5_000_000_000)
        answer = line.frame(asking)
    data, at, packets = path.read_bytes(), 0, []
    while at < len(data):
        kind, size = struct.unpack_from("<II", data, at)
        assert struct.unpack_from("<I", data, at + size - 4)[0] == size
        if kind == 6:
            _, high, low, length, _ = struct.unpack_from("<IIIII", data, at + 8)
            packets.append((high << 32 | low, data[at + 28 : at + 28 + length]))
        at += size
    assert packets == [(5_000_000_000, asking), (5_000_000_000, answer)]


def test_esi_by_the_command_line(tmp_path: Path) -> None:
    """``sjerk drive --esi F.xml`` writes the file and ends."""
    path = tmp_path / "drive.xml"
    assert main(["drive", "--esi", str(path), "--behaviour", "fixed"]) == 0
    assert "fixed PDOs" in path.read_text()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--ethercat", "nowhere0"], "nowhere0"),
        (["--ethercat", "lo", "--drives", "0"], "drives = 0"),
        (["--ethercat", "lo", "--drives", "65"], "drives = 65"),
        (["--ethercat", "lo", "--behaviour", "odd"], "behaviour = 'odd'"),
        (["--ethercat", "lo", "--drift-ppm", "5000"], "drift_ppm = 5000"),
        (["--ethercat", "lo", "--drives", "3", "--behaviour", "free,fixed"], "behaviour"),
        (["--fault", "heal"], "--control"),
        (["--fault", "heal", "--control", "/nonexistent/socket"], "No such file"),
    ],
)
def test_mistakes_of_a_process_are_told_in_one_line(arguments: list[str], told: str) -> None:
    """Before anything moves, with an exit code."""
    done = subprocess.run(
        [sys.executable, "-m", "sjerk", "drive", *arguments], capture_output=True, text=True
    )
    assert done.returncode in (1, 2)
    assert told in done.stderr
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    "words",
    ["", "cut", "cut x", "cut 9", "heal 1", "state 0 3", "state 0 0x31", "power 2", "lose -1",
     "inject 0 NOTHING", "inject 0 FOLLOWING_ERROR", "explode 1"],
)  # fmt: skip
def test_faults_that_do_not_exist_are_refused(words: str) -> None:
    """By the control socket's own language; the line goes on."""
    line = Line(drives=2)
    with pytest.raises(ValueError, match=r".+"):
        apply(line, words.split())
    assert Bench(line).al(0) == (1, 0)


@pytest.mark.parametrize(
    "words",
    ["cut 1", "heal", "power 1", "lose 50", "wkc 20", "late 10 500", "state 1 0x14 0x1a",
     "inject 0 OVER_CURRENT", "clear 0 OVER_CURRENT", "status"],
)  # fmt: skip
def test_faults_that_exist_are_taken(words: str) -> None:
    """Every one of them."""
    apply(Line(drives=2), words.split())


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({"drives": 0}, "drives"), ({"drives": 2, "at": [1]}, "at"), ({"hop_ns": -1}, "hop_ns"),
        ({"alias": 70000}, "alias"), ({"behaviour": "x"}, "behaviour"),
    ],
)  # fmt: skip
def test_a_line_names_what_is_wrong(options: dict[str, object], field: str) -> None:
    """Field, value and limit."""
    with pytest.raises(InputError, match=f"{field} = "):
        Line(**options)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({"mailbox": 31}, "mailbox"), ({"entries": 0}, "entries"), ({"rx_bytes": 1025}, "rx_bytes"),
        ({"rx_assigned": (0x1666,)}, "rx_assigned"), ({"sync_types": (2,)}, "sync_type"),
    ],
)  # fmt: skip
def test_a_behaviour_names_what_is_wrong(options: dict[str, object], field: str) -> None:
    """Field, value and limit."""
    with pytest.raises(InputError, match=f"{field} = "):
        Behaviour(**options)  # type: ignore[arg-type]


@pytest.mark.parametrize("counts", [-(2**31) + 5, -1, 0, 2**31 - 5])
def test_drives_stand_where_they_are_told(counts: int) -> None:
    """6064h from the first read; enabled without a jump."""
    bench = Bench(at=counts)
    bench.to_preop(0)
    assert bench.upload(0, 0x6064, 0) == struct.pack("<i", counts)
    bench.to_op(0)
    status, position = 0, counts
    for _ in range(30):
        word = {0x40: 6, 0x21: 7, 0x23: 15, 0x27: 15}.get(status & 0x6F, 0)
        answer = bench.exchange(0, struct.pack("<Hbxi", word, 8, position))
        status, position = struct.unpack_from("<Hxxi", answer.data)
    assert status & 0x106F == 0x1027
    assert position == counts
    assert bench.line.report().clean
