"""The states of the application layer against a table written from the rules, in virtual time."""

from __future__ import annotations

import itertools
import struct

import pytest

from helpers.ethercat_bench import MS, Bench

INIT, PREOP, BOOT, SAFEOP, OP = 1, 2, 3, 4, 8
ERROR = 0x10


def bench_in(state: int) -> Bench:
    """One device in a state, SM-synchronous."""
    bench = Bench()
    if state == PREOP:
        bench.to_preop(0)
        bench.map(0, *bench.lengths(0))
    elif state == SAFEOP:
        bench.to_safeop(0)
    elif state == OP:
        bench.to_op(0)
    return bench


def expected(state: int, wanted: int) -> tuple[int, int]:
    """ETG.1000.6: what a request of a state makes of 0130h and 0134h, as a table."""
    steps = {
        (INIT, INIT), (INIT, PREOP),
        (PREOP, INIT), (PREOP, PREOP), (PREOP, SAFEOP),
        (SAFEOP, INIT), (SAFEOP, PREOP), (SAFEOP, SAFEOP), (SAFEOP, OP),
        (OP, INIT), (OP, PREOP), (OP, SAFEOP), (OP, OP),
    }  # fmt: skip
    if (state, wanted) in steps:
        return wanted, 0
    if wanted == BOOT:
        return state | ERROR, 0x0013
    if wanted in (INIT, PREOP, SAFEOP, OP):
        return state | ERROR, 0x0011
    return state | ERROR, 0x0012


def settle(bench: Bench, state: int, wanted: int) -> None:
    """Safe-operational to Operational waits for outputs."""
    if state in (SAFEOP, OP):
        for _ in range(3):
            bench.line.advance(MS)
            if bench.al(0)[0] & 15 in (SAFEOP, OP):
                bench.exchange(0, b"")


@pytest.mark.parametrize("state", [INIT, PREOP, SAFEOP, OP])
@pytest.mark.parametrize("wanted", range(16))
@pytest.mark.parametrize("acknowledge", [0, ERROR])
def test_every_request_from_every_state(state: int, wanted: int, acknowledge: int) -> None:
    """4 states x 16 requests x acknowledge bit: 128 rows."""
    bench = bench_in(state)
    if (state, wanted) == (INIT, PREOP):  # the mailboxes must be there
        out, out_length, inp, in_length = bench.mailbox(0)
        bench.manager(0, 0, out, out_length, 0x26)
        bench.manager(0, 1, inp, in_length, 0x22)
    bench.request(0, wanted | acknowledge)
    settle(bench, state, wanted)
    assert bench.al(0) == expected(state, wanted)


@pytest.mark.parametrize("state", [INIT, PREOP, SAFEOP])
@pytest.mark.parametrize("wanted", [INIT, PREOP, SAFEOP, OP, BOOT, 0, 15])
@pytest.mark.parametrize("acknowledge", [0, ERROR])
def test_after_an_error_only_lower_states_come_without_acknowledge(
    state: int, wanted: int, acknowledge: int
) -> None:
    """The error bit stays until it is acknowledged or a lower state is entered."""
    bench = bench_in(state)
    bench.request(0, 15)
    before = bench.al(0)
    assert before == (state | ERROR, 0x0012)
    if state == INIT:
        out, out_length, inp, in_length = bench.mailbox(0)
        bench.manager(0, 0, out, out_length, 0x26)
        bench.manager(0, 1, inp, in_length, 0x22)
    bench.request(0, wanted | acknowledge)
    settle(bench, state, wanted)
    if acknowledge or wanted < state:
        assert bench.al(0) == expected(state, wanted)
    else:
        assert bench.al(0) == before


def test_operational_waits_for_outputs_and_is_refused_after_five_seconds() -> None:
    """No outputs: 001Bh. The state stays Safe-operational all the while."""
    bench = bench_in(SAFEOP)
    bench.request(0, OP)
    bench.line.advance(4_990 * MS)
    assert bench.al(0) == (SAFEOP, 0)
    bench.line.advance(20 * MS)
    assert bench.al(0) == (SAFEOP | ERROR, 0x001B)


def test_operational_is_refused_when_sync0_never_comes() -> None:
    """Outputs come, SYNC0 was started for a time far away: 002Dh."""
    bench = Bench()
    bench.to_preop(0)
    bench.map(0, *bench.lengths(0))
    bench.start_sync(0, MS)
    far = struct.unpack("<q", bench.read(0, 0x0910, 8))[0] + 3600 * 10**9
    bench.write(0, 0x0980, b"\0\0")
    bench.write(0, 0x0990, struct.pack("<q", far))
    bench.write(0, 0x0980, b"\0\3")
    bench.request(0, SAFEOP)
    assert bench.al(0) == (SAFEOP, 0)
    bench.request(0, OP)
    for _ in range(510):
        bench.exchange(0, b"")
        bench.line.advance(10 * MS)
    assert bench.al(0) == (SAFEOP | ERROR, 0x002D)


def flaw(name: str, bench: Bench, outputs: int, inputs: int) -> None:
    """One mistake in an otherwise right configuration."""
    out, _, inp, _ = bench.mailbox(0)
    start, end = 0x1800, 0x2400
    managers = {
        "outputs short": (2, start, outputs - 1, 0x64),
        "outputs long": (2, start, outputs + 1, 0x64),
        "inputs short": (3, end, inputs - 1, 0x20),
        "inputs long": (3, end, inputs + 1, 0x20),
        "outputs odd": (2, start + 1, outputs, 0x64),
        "inputs odd": (3, end + 1, inputs, 0x20),
        "outputs in a mailbox": (2, out + 2, outputs, 0x64),
        "inputs in a mailbox": (3, inp + 2, inputs, 0x20),
        "outputs reach a mailbox": (2, out - 2 * outputs, outputs, 0x64),
        "outputs below the memory": (2, 0x0F00, outputs, 0x64),
        "inputs leave the memory": (3, 0x3000 - 2 * inputs, inputs, 0x20),
        "inputs in the buffers of the outputs": (3, start + 2 * outputs, inputs, 0x20),
        "outputs the wrong way": (2, start, outputs, 0x60),
        "inputs the wrong way": (3, end, inputs, 0x24),
        "outputs as a mailbox": (2, start, outputs, 0x66),
        "inputs as a mailbox": (3, end, inputs, 0x22),
    }
    if name in managers:
        bench.manager(0, *managers[name])
    elif name == "outputs off":
        bench.write(0, 0x0816, b"\0")
    elif name == "inputs off":
        bench.write(0, 0x081E, b"\0")
    elif name == "SYNC0 without its bit":
        bench.start_sync(0, MS)
        bench.write(0, 0x0980, b"\0\1")
    elif name.startswith("SYNC0 of "):
        bench.start_sync(0, int(name.split()[2]))
    elif name == "SYNC0 asked for, not started":
        bench.download(0, 0x1C32, 1, struct.pack("<H", 2))
    elif name == "period of 1C32h:2 too short":
        bench.download(0, 0x1C32, 2, struct.pack("<I", 1000))
    else:
        raise ValueError(name)


FLAWS = {
    "outputs short": 0x1D, "outputs long": 0x1D, "outputs off": 0x1D,
    "inputs short": 0x1E, "inputs long": 0x1E, "inputs off": 0x1E,
    "outputs odd": 0x17, "inputs odd": 0x17, "outputs in a mailbox": 0x17,
    "inputs in a mailbox": 0x17, "outputs reach a mailbox": 0x17, "outputs below the memory": 0x17,
    "inputs leave the memory": 0x17, "inputs in the buffers of the outputs": 0x17,
    "outputs the wrong way": 0x17, "inputs the wrong way": 0x17, "outputs as a mailbox": 0x17,
    "inputs as a mailbox": 0x17, "SYNC0 without its bit": 0x30, "SYNC0 of 100000 ns": 0x36,
    "SYNC0 of 62500 ns": 0x36, "SYNC0 of 300000 ns": 0x36, "SYNC0 of 1000001 ns": 0x36,
    "SYNC0 asked for, not started": 0x30, "period of 1C32h:2 too short": 0x35,
}  # fmt: skip


@pytest.mark.parametrize("name", FLAWS)
def test_a_wrong_configuration_is_refused_by_its_code(name: str) -> None:
    """Pre-operational stays, with the code; the right configuration is accepted afterwards."""
    bench = Bench()
    bench.to_preop(0)
    lengths = bench.lengths(0)
    bench.map(0, *lengths)
    flaw(name, bench, *lengths)
    bench.request(0, SAFEOP)
    assert bench.al(0) == (PREOP | ERROR, FLAWS[name])
    bench.request(0, PREOP | ERROR)
    assert bench.al(0) == (PREOP, 0)
    bench.write(0, 0x0980, b"\0\0")
    bench.download(0, 0x1C32, 1, struct.pack("<H", 1))
    bench.download(0, 0x1C32, 2, struct.pack("<I", MS))
    bench.map(0, *lengths)
    bench.request(0, SAFEOP)
    assert bench.al(0) == (SAFEOP, 0)


@pytest.mark.parametrize("cycle", [125_000, 250_000, 375_000, 500_000, MS, 2 * MS, 4 * MS])
def test_multiples_of_125_us_are_accepted_and_are_the_drives_period(cycle: int) -> None:
    """One period of the drive per SYNC0, to the last."""
    bench = Bench()
    bench.to_op(0, sync0=cycle, cycle=cycle)
    before = bench.line.status()["devices"][0]
    for _ in range(50):
        bench.exchange(0, b"")
        bench.line.advance(cycle)
    after = bench.line.status()["devices"][0]
    assert after["periods"] - before["periods"] == after["syncs"] - before["syncs"] == 50


@pytest.mark.parametrize(("number", "part"), [*itertools.product((0, 1), range(4))])
def test_preop_needs_the_mailboxes_of_the_sii(number: int, part: int) -> None:
    """A wrong start, length, control or an inactive SyncManager: 0016h."""
    bench = Bench()
    out, out_length, inp, in_length = bench.mailbox(0)
    right = [[out, out_length, 0x26, 1], [inp, in_length, 0x22, 1]]
    right[number][part] ^= (2, 4, 4, 1)[part]
    for n, values in enumerate(right):
        bench.manager(0, n, *values)
    bench.request(0, PREOP)
    assert bench.al(0) == (INIT | ERROR, 0x0016)


def test_what_a_device_does_by_itself_is_seen_and_acknowledged() -> None:
    """A drop to Safe-operational with a code; the way back to Operational."""
    bench = bench_in(OP)
    bench.line.state(0, SAFEOP | ERROR, 0x001A)
    assert bench.al(0) == (SAFEOP | ERROR, 0x001A)
    bench.request(0, OP)
    assert bench.al(0) == (SAFEOP | ERROR, 0x001A)
    bench.request(0, SAFEOP | ERROR)
    assert bench.al(0) == (SAFEOP, 0)
    bench.request(0, OP)
    bench.exchange(0, b"")
    assert bench.al(0) == (OP, 0)


@pytest.mark.parametrize(("option", "error", "state"), [(1, 0x8130, 0x08), (0, 0, 0x23)])
@pytest.mark.parametrize("target", [INIT, PREOP, SAFEOP])
def test_a_drive_that_leaves_operational_enabled_does_what_6007h_says(
    option: int, error: int, state: int, target: int
) -> None:
    """1: error 8130h and its emergency; 0: operation is disabled with its ramp. Never goes on."""
    bench = Bench()
    bench.to_op(0)
    bench.download(0, 0x6007, 0, struct.pack("<h", option))
    word = {0x40: 6, 0x21: 7, 0x23: 15, 0x27: 15}
    status = 0
    for _ in range(20):
        answer = bench.exchange(0, struct.pack("<Hbxi", word.get(status & 0x6F, 0), 8, 0))
        status = struct.unpack_from("<H", answer.data)[0]
    assert status & 0x6F == 0x27
    bench.request(0, target)
    assert bench.al(0) == (target, 0)
    bench.line.advance(1000 * MS)
    shown = bench.line.status()["devices"][0]["statusword"]
    assert shown & 0x6F & (0x4F if state == 0x08 else 0x6F) == state
    if target != INIT and error:
        mail = bench.fetch(0)
        assert mail is not None
        assert struct.unpack_from("<HH", mail, 6) == (0x1000, error)
    if target != INIT:
        assert bench.upload(0, 0x603F, 0) == struct.pack("<H", error)


def test_no_outputs_below_safeop_no_mail_in_init() -> None:
    """Working counters: mailbox from Pre-operational on, process data from Safe-operational on."""
    bench = bench_in(PREOP)
    assert bench.exchange(0, b"").wkc == 0
    bench.request(0, SAFEOP)
    assert bench.exchange(0, b"").wkc == 3
    bench.request(0, PREOP)
    assert bench.exchange(0, b"").wkc == 0
    assert len(bench.upload(0, 0x1000, 0)) == 4
    bench.request(0, INIT)
    bench.post(
        0, struct.pack("<HHBBH", 10, 0, 0, 0x13, 0x2000) + struct.pack("<BHB4x", 0x40, 0x1000, 0)
    )
    assert bench.fetch(0) is None
