"""Distributed clocks: receive times, the control loop, SYNC0 and SYNC1, what a missed one does."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.ethercat_bench import BWR, FRMW, MS, Bench
from sjerk.ports.ethercat import BEHAVIOURS, Behaviour

HOP = 700


def system_time(bench: Bench, k: int) -> int:
    return int(struct.unpack("<q", bench.read(k, 0x0910, 8))[0])


def set_clocks(bench: Bench) -> None:
    """Delays from the receive times, offsets from the local times: what every main device does."""
    bench.one(BWR, 0, 0x0900, bytes(4))
    ports = [struct.unpack("<II", bench.read(k, 0x0900, 8)) for k in range(bench.count)]
    local = [struct.unpack("<q", bench.read(k, 0x0918, 8))[0] for k in range(bench.count)]
    delay = 0
    for k in range(bench.count):
        if k:
            before = (ports[k - 1][1] - ports[k - 1][0]) % 2**32
            behind = (ports[k][1] - ports[k][0]) % 2**32 if k < bench.count - 1 else 0
            delay += (before - behind) // 2
        bench.write(k, 0x0928, struct.pack("<I", delay))
        bench.write(k, 0x0920, struct.pack("<q", local[0] - local[k] + delay))
        bench.write(k, 0x0930, struct.pack("<H", 0x1000))


@pytest.mark.parametrize("count", [1, 2, 3, 7])
def test_receive_times_give_the_delay_of_every_hop(count: int) -> None:
    """Halved differences of the port times are the delays of the cable."""
    bench = Bench(drives=count, hop_ns=HOP)
    set_clocks(bench)
    for k in range(count):
        assert struct.unpack("<I", bench.read(k, 0x0928, 4))[0] == k * HOP


@pytest.mark.parametrize("ppm", [0.0, 20.0, 60.0, 300.0])
def test_clocks_follow_the_reference(ppm: float) -> None:
    """Clocks that are twice as much apart stay within 100 ns once the loop has settled."""
    bench = Bench(drives=3, drift_ppm=ppm, hop_ns=HOP)
    set_clocks(bench)
    for _ in range(8000):
        bench.line.advance(MS)
        bench.one(FRMW, 0x1001, 0x0910, bytes(8))
    reference = system_time(bench, 0)
    for k in (1, 2):
        assert abs(system_time(bench, k) - reference - k * HOP) < 100
        deviation = struct.unpack("<I", bench.read(k, 0x092C, 4))[0]
        assert deviation & 0x7FFFFFFF < 100


def test_without_the_loop_the_clocks_drift_apart() -> None:
    """The test above can fail: 40 ppm are 120 us in 3 s."""
    bench = Bench(drives=2, drift_ppm=20.0)
    set_clocks(bench)
    bench.line.advance(3000 * MS)
    assert 115_000 < abs(system_time(bench, 1) - system_time(bench, 0)) < 125_000


def test_many_frames_at_once_settle_the_loop() -> None:
    """As a main device does at the start: thousands of frames 30 us apart."""
    bench = Bench(drives=2, drift_ppm=60.0)
    set_clocks(bench)
    for _ in range(10_000):
        bench.line.advance(30_000)
        bench.one(FRMW, 0x1001, 0x0910, bytes(8))
    assert struct.unpack("<I", bench.read(1, 0x092C, 4))[0] & 0x7FFFFFFF < 200


@given(st.binary(min_size=8, max_size=8), st.binary(min_size=8, max_size=8),
       st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1), st.sampled_from([0, 1, 3, 5, 7]),
       st.booleans())  # fmt: skip
def test_any_times_on_the_wire_do_no_harm(
    offset: bytes, start: bytes, cycle0: int, cycle1: int, activation: int, wide: bool
) -> None:
    """Any offset, start and cycle, and a jump of the clock after it: time passes, bounded work."""
    bench = Bench(behaviour=Behaviour(clock_64=wide, assign_activate=0x0700))
    bench.to_preop(0)
    bench.write(0, 0x0920, offset)
    bench.write(0, 0x09A0, struct.pack("<II", cycle0, cycle1))
    bench.write(0, 0x0990, start)
    bench.write(0, 0x0980, bytes((0, activation)))
    bench.line.advance(10 * MS)
    bench.write(0, 0x0920, start)
    bench.line.advance(10 * MS)
    bench.write(0, 0x0910, offset)
    bench.line.advance(MS)
    assert bench.al(0) == (2, 0)
    assert bench.line.status()["devices"][0]["syncs"] < 2000


def test_a_32_bit_clock_shows_32_bits_and_its_sync0_comes() -> None:
    """The upper half of 0910h is zero, and SYNC0 crosses the wrap."""
    bench = Bench(behaviour="maps")
    now = system_time(bench, 0)
    assert now < 2**32
    bench.write(0, 0x0920, struct.pack("<q", 2**32 - now - 20 * MS))
    bench.to_op(0, sync0=MS)
    for _ in range(50):
        bench.exchange(0, b"")
        bench.line.advance(MS)
    status = bench.line.status()["devices"][0]
    assert status["syncs"] >= 50
    assert bench.al(0) == (8, 0)


@pytest.mark.parametrize("missed", [0, 1, 3, 4, 12])
def test_missed_outputs_are_bridged_and_then_end_operational(missed: int) -> None:
    """10F1h:2 = 12: three in a row are bridged, the fourth is 8700h, an emergency and 001Ah."""
    bench = Bench()
    bench.write(0, 0x0420, b"\0\0")
    bench.to_op(0, sync0=MS)
    word = {0x40: 6, 0x21: 7, 0x23: 15, 0x27: 15}
    status = 0
    for _ in range(20):
        answer = bench.exchange(0, struct.pack("<Hbxi", word.get(status & 0x6F, 0), 8, 0))
        status = struct.unpack_from("<H", answer.data)[0]
        bench.line.advance(MS)
    assert status & 0x106F == 0x1027
    before = bench.line.status()["devices"][0]["syncs_missed"]
    bench.line.advance(missed * MS)
    after = bench.line.status()["devices"][0]["syncs_missed"]
    for _ in range(5):
        answer = bench.exchange(0, struct.pack("<Hbxi", 15, 8, 0))
        bench.line.advance(MS)
    assert after - before == min(missed, 4)
    if missed < 4:
        assert bench.al(0) == (8, 0)
        assert bench.fetch(0) is None
        return
    assert bench.al(0) == (0x14, 0x001A)
    mail = bench.fetch(0)
    assert mail is not None
    assert struct.unpack_from("<HH", mail, 6) == (0x1000, 0x8700)


@pytest.mark.parametrize("late", [-400_000, -1, 0, 1, 400_000])
def test_outputs_count_for_the_next_sync0_whatever_its_phase(late: int) -> None:
    """A frame just before SYNC0 is this period's, one just after it the next one's."""
    bench = Bench()
    bench.to_op(0, sync0=MS)
    start = struct.unpack("<q", bench.read(0, 0x0990, 8))[0]
    bench.line.advance(start - system_time(bench, 0) + late + (MS if late < 0 else 0))
    before = bench.line.status()["devices"][0]
    for _ in range(30):
        bench.exchange(0, struct.pack("<Hbxi", 6, 8, 0))
        bench.line.advance(MS)
    after = bench.line.status()["devices"][0]
    assert after["syncs"] - before["syncs"] == 30
    assert after["syncs_missed"] == before["syncs_missed"]


@pytest.mark.parametrize("cycle", [125_000, 250_000, 500_000, MS, 2 * MS])
def test_sync1_is_the_period_of_a_drive_with_a_fixed_sync0(cycle: int) -> None:
    """SYNC0 every 62.5 us; 09A4h = cycle less one SYNC0; one period of the drive per cycle."""
    bench = Bench(behaviour="sync1")
    bench.to_op(0, sync0=62_500, sync1=cycle - 62_500, cycle=cycle)
    before = bench.line.status()["devices"][0]
    for _ in range(40):
        bench.exchange(0, struct.pack("<Hbxi", 6, 8, 0))
        bench.line.advance(cycle)
    after = bench.line.status()["devices"][0]
    assert after["periods"] - before["periods"] == 40
    assert after["syncs_missed"] == before["syncs_missed"]
    assert struct.unpack("<H", bench.upload(0, 0x1C32, 1))[0] == 3
    assert struct.unpack("<I", bench.upload(0, 0x1C32, 2))[0] == cycle


REFUSALS = [
    ("fixed", 0, None, 0x28), ("fixed", MS, None, 0), ("fixed", 100_000, None, 0x36),
    ("sync1", 62_500, MS - 62_500, 0), ("sync1", 62_500, None, 0x30), ("sync1", MS, 0, 0x36),
    ("sync1", 62_500, 62_500 * 2, 0x37), ("sync1", 0, None, 0),
    ("deaf", 0, None, 0), ("deaf", MS, None, 0),
    ("maps", 125_000, None, 0x36), ("maps", 250_000, None, 0), ("maps", 0, None, 0),
    ("free", 125_000, None, 0), ("free", 0, None, 0),
]  # fmt: skip


@pytest.mark.parametrize(("behaviour", "sync0", "sync1", "code"), REFUSALS)
def test_every_behaviour_takes_its_own_clocks(
    behaviour: str, sync0: int, sync1: int | None, code: int
) -> None:
    """On the way to Safe-operational."""
    bench = Bench(behaviour=behaviour)
    bench.to_preop(0)
    bench.map(0, *bench.lengths(0))
    if sync0:
        bench.start_sync(0, sync0, sync1)
    bench.request(0, 4)
    assert bench.al(0) == ((0x12, code) if code else (4, 0))


@pytest.mark.parametrize("behaviour", BEHAVIOURS)
def test_every_behaviour_follows_its_targets_and_the_deaf_one_does_not_without_sync0(
    behaviour: str,
) -> None:
    """Enabled by its own PDOs: a smooth motion arrives to the increment, or nothing moves."""
    clocks = {"fixed": (MS, None), "sync1": (62_500, MS - 62_500), "maps": (MS, None)}
    sync0, sync1 = clocks.get(behaviour, (0, None))
    bench = Bench(behaviour=behaviour)
    kind = BEHAVIOURS[behaviour]
    bench.to_preop(0)
    bench.download(0, 0x6060, 0, b"\x08")
    bench.to_op(0, sync0=sync0, sync1=sync1)
    out = dict(places(kind.rx_pdos, kind.rx_assigned))
    inp = dict(places(kind.tx_pdos, kind.tx_assigned))
    size, status, position, sent = bench.layout[0][1], 0, 0, 0
    for _ in range(2000):
        word = {0x40: 6, 0x21: 7, 0x23: 15, 0x27: 15}.get(status & 0x6F, 0)
        sent = min(sent + 1, 1000) if status & 0x106F == 0x1027 else 0
        x = sent / 1000
        target = round(100_000 * x**4 * (35 - 84 * x + 70 * x**2 - 20 * x**3))
        image = bytearray(size)
        struct.pack_into("<H", image, out[0x6040], word)
        struct.pack_into("<i", image, out[0x607A], target)
        if 0x6060 in out:
            image[out[0x6060]] = 8
        answer = bench.exchange(0, bytes(image))
        assert answer.wkc == 3
        status = struct.unpack_from("<H", answer.data, inp[0x6041])[0]
        position = struct.unpack_from("<i", answer.data, inp[0x6064])[0]
        bench.line.advance(MS)
    assert status & 0x6F == 0x27
    if behaviour == "deaf":
        assert position == 0
        assert bench.upload(0, 0x1C32, 1) == b"\0\0"
    else:
        assert abs(position - 100_000) <= 1
        assert bench.line.report().clean


def places(pdos: object, assigned: tuple[int, ...]) -> list[tuple[int, int]]:
    """Object and byte of the first appearance of everything that is assigned."""
    found, bit = [], 0
    for pdo in assigned:
        for word in pdos[pdo]:  # type: ignore[index]
            found.append((word >> 16, bit // 8))
            bit += word & 0xFF
    return found
