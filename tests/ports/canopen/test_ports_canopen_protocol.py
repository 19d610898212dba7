"""The CANopen port frame by frame, with a clock that the test holds."""

from __future__ import annotations

import builtins
import signal
import struct
import subprocess
import sys
from pathlib import Path

import pytest

from helpers.canopen_wire import NODE, Frame, Wire
from sjerk.__main__ import main
from sjerk.cia402 import Drive, DriveState
from sjerk.drive.device import Device
from sjerk.drive.entries import Abort
from sjerk.drive.objects import DISABLED
from sjerk.ports.canopen import NmtState, SdoServer

REV = 16777216


def sdo(wire: Wire, *request: int) -> bytes:
    wire.put(0x600 + NODE, bytes(request).ljust(8, b"\0"))
    (response,) = wire.take(0x580 + NODE)
    return response


def abort_of(response: bytes) -> int:
    assert response[0] == 0x80
    return int.from_bytes(response[4:], "little")


def test_boot_up_is_the_first_frame() -> None:
    """700h + id with one zero byte, then Pre-operational."""
    wire = Wire()
    assert wire.sent == [(0x705, b"\0")]
    assert wire.node.nmt == NmtState.PRE_OPERATIONAL


def test_expedited_transfers() -> None:
    """Up and down, with and without the size given."""
    wire = Wire()
    assert sdo(wire, 0x40, 0x5A, 0x60, 0) == bytes.fromhex("4b5a600002000000")
    assert sdo(wire, 0x2B, 0x5A, 0x60, 0, 6, 0) == bytes.fromhex("605a600000000000")
    assert sdo(wire, 0x22, 0x5A, 0x60, 0, 5, 0) == bytes.fromhex("605a600000000000")
    assert wire.device.read(0x605A) == 5


def test_segmented_upload_gives_the_whole_string() -> None:
    """1008h in segments of seven bytes with a toggle."""
    wire = Wire()
    head = sdo(wire, 0x40, 0x08, 0x10, 0)
    assert head[0] == 0x41
    size = int.from_bytes(head[4:], "little")
    text, toggle = b"", 0
    while True:
        part = sdo(wire, 0x60 | toggle << 4)
        assert part[0] >> 4 & 1 == toggle
        text += part[1 : 8 - (part[0] >> 1 & 7)]
        toggle ^= 1
        if part[0] & 1:
            break
    assert text == b"sjerk simulated drive"
    assert len(text) == size
    assert abort_of(sdo(wire, 0x60)) == Abort.COMMAND


def test_segmented_download_writes_at_its_end() -> None:
    """Four bytes in two segments."""
    wire = Wire()
    assert sdo(wire, 0x21, 0x65, 0x60, 0, 4)[0] == 0x60
    assert sdo(wire, 0x00 | 5 << 1, 0x78, 0x56)[0] == 0x20
    assert wire.device.read(0x6065) != 0x12345678
    assert sdo(wire, 0x10 | 5 << 1 | 1, 0x34, 0x12)[0] == 0x30
    assert wire.device.read(0x6065) == 0x12345678


@pytest.mark.parametrize(
    ("requests", "abort"),
    [
        ([(0x40, 0xFF, 0x5F, 0)], Abort.NO_OBJECT),
        ([(0x40, 0x5A, 0x60, 1)], Abort.NO_SUBINDEX),
        ([(0x2B, 0x41, 0x60, 0)], Abort.READ_ONLY),
        ([(0x2F, 0x5A, 0x60, 0)], Abort.TOO_SHORT),
        ([(0x23, 0x5A, 0x60, 0)], Abort.TOO_LONG),
        ([(0x21, 0x5A, 0x60, 0, 9)], Abort.TOO_LONG),
        ([(0x21, 0x65, 0x60, 0, 3)], Abort.TOO_SHORT),
        ([(0x21, 0x08, 0x10, 0, 3)], Abort.READ_ONLY),
        ([(0x2B, 0x5A, 0x60, 0, 9)], Abort.RANGE),
        ([(0xA0, 0x08, 0x10, 0)], Abort.COMMAND),
        ([(0xC0, 0x08, 0x10, 0)], Abort.COMMAND),
        ([(0x00,)], Abort.COMMAND),
        ([(0x60,)], Abort.COMMAND),
        ([(0x40, 0x08, 0x10, 0), (0x70,)], Abort.TOGGLE),
        ([(0x21, 0x65, 0x60, 0, 4), (0x10,)], Abort.TOGGLE),
        ([(0x21, 0x65, 0x60, 0, 4), (0x01,)], Abort.TOO_LONG),
        ([(0x21, 0x65, 0x60, 0, 4), (0x0D,)], Abort.TOO_SHORT),
    ],
)
def test_bad_requests_are_aborted_with_their_code(
    requests: list[tuple[int, ...]], abort: Abort
) -> None:
    """The last request of each sequence gets its abort."""
    wire = Wire()
    for request in requests:
        response = sdo(wire, *request)
    assert abort_of(response) == abort


def test_a_request_of_wrong_length_and_an_abort_end_a_transfer() -> None:
    """Seven bytes are no request; an abort is not answered."""
    server = SdoServer(Device())
    answer = server.answer(bytes(7))
    assert answer is not None
    assert abort_of(answer) == Abort.COMMAND
    server.answer(bytes((0x40, 0x08, 0x10, 0, 0, 0, 0, 0)))
    assert server.answer(bytes((0x80, 0, 0, 0, 0, 0, 0, 0))) is None
    answer = server.answer(bytes((0x60, 0, 0, 0, 0, 0, 0, 0)))
    assert answer is not None
    assert abort_of(answer) == Abort.COMMAND


def test_network_management_moves_the_node() -> None:
    """Start, stop, pre-operational, both resets; other nodes' commands are not ours."""
    wire = Wire()
    for command, state in (
        (0x01, NmtState.OPERATIONAL),
        (0x80, NmtState.PRE_OPERATIONAL),
        (0x02, NmtState.STOPPED),
        (0x82, NmtState.PRE_OPERATIONAL),
    ):
        wire.put(0, bytes((command, NODE)))
        assert wire.node.nmt == state
    wire.put(0, bytes((0x01, NODE + 1)))
    wire.put(0, bytes((0x55, NODE)))
    wire.put(0, b"\1")
    assert wire.node.nmt == NmtState.PRE_OPERATIONAL
    wire.write(0x605A, 0, 6)
    wire.write(0x1017, 0, 500)
    wire.put(0, bytes((0x82, 0)))
    assert (wire.device.read(0x605A), wire.device.read(0x1017)) == (6, 0)
    wire.put(0, bytes((0x81, 0)))
    assert wire.device.read(0x605A) == 2
    assert len(wire.take(0x705)) == 4


def test_a_stopped_node_answers_nothing_and_its_drive_reacts() -> None:
    """No SDO, no SYNC; an enabled drive has lost its master (6007h)."""
    wire = Wire()
    wire.enable()
    wire.put(0, bytes((2, NODE)))
    wire.put(0x600 + NODE, bytes((0x40, 0, 0x10, 0, 0, 0, 0, 0)))
    assert not wire.take(0x585)
    wire.pass_time(1.0)
    assert wire.device.feedback.state is DriveState.FAULT
    assert wire.device.feedback.error_code == 0x8130


def test_heartbeat_is_produced_at_its_interval() -> None:
    """1017h = 20 ms: fifty a second, telling the NMT state; 0: none."""
    wire = Wire()
    wire.sent.clear()
    wire.pass_time(0.5)
    assert not wire.take(0x705)
    wire.write(0x1017, 0, 20)
    wire.pass_time(1.0)
    beats = wire.take(0x705)
    assert 49 <= len(beats) <= 51
    assert set(beats) == {b"\x7f"}


def test_a_silent_master_is_a_lost_link() -> None:
    """1016h: the first heartbeat starts the watch, its absence is 8130h and an emergency."""
    wire = Wire()
    wire.write(0x1016, 1, 1 << 16 | 100)
    wire.pass_time(0.5)
    assert wire.device.feedback.error_code == 0
    wire.put(0x701, b"\5")
    wire.pass_time(0.09)
    wire.put(0x701, b"\5")
    wire.put(0x702, b"\5")
    wire.pass_time(0.09)
    assert wire.device.feedback.error_code == 0
    wire.pass_time(0.02)
    assert wire.device.feedback.error_code == 0x8130
    assert wire.take(0x85)[0][:3] == b"\x30\x81\x11"


def test_one_new_heartbeat_clears_the_cause_of_a_lost_link() -> None:
    """After 8130h: the first heartbeat that comes again is enough for a fault reset."""
    wire = Wire()
    wire.write(0x1016, 1, 1 << 16 | 100)
    wire.put(0x701, b"\5")
    wire.pass_time(0.2)
    assert wire.device.feedback.state is DriveState.FAULT
    wire.sync(0x80)
    assert wire.device.feedback.state is DriveState.FAULT
    wire.put(0x701, b"\5")
    for word in (0, 0x80):
        wire.write(0x6040, 0, word)
        wire.sync()
    assert wire.device.feedback.state is DriveState.SWITCH_ON_DISABLED


def test_a_motor_does_not_wait_for_the_sync_of_a_master_that_is_lost() -> None:
    """1016h: the heartbeat stays away before the silence of SYNC counts; 6007h acts at once."""
    wire = Wire()
    wire.write(0x1016, 1, 1 << 16 | 50)
    wire.put(0x701, b"\5")
    moving(wire, 1.0)
    wire.pass_time(0.06)
    assert wire.device.feedback.error_code == 0x8130
    assert wire.device.feedback.velocity_actual < REV // 100


def test_a_heartbeat_consumer_that_is_switched_off_watches_nothing() -> None:
    """1016h = 0, or of no node: neither a new fault nor an old cause; node 129 is not node 1."""
    wire = Wire()
    wire.write(0x1016, 1, 1 << 16 | 100)
    wire.put(0x701, b"\5")
    wire.write(0x1016, 1, 0)
    wire.pass_time(0.3)
    assert wire.device.feedback.error_code == 0
    wire.write(0x1016, 1, 129 << 16 | 100)
    wire.put(0x701, b"\5")
    wire.pass_time(0.3)
    assert wire.device.feedback.error_code == 0
    wire.write(0x1016, 1, 1 << 16 | 100)
    wire.put(0x701, b"\5")
    wire.pass_time(0.3)
    assert wire.device.feedback.error_code == 0x8130
    wire.write(0x1016, 1, 0)
    wire.pass_time(0.01)
    for word in (0, 0x80):
        wire.write(0x6040, 0, word)
        wire.sync()
    assert wire.device.feedback.state is DriveState.SWITCH_ON_DISABLED


@pytest.mark.parametrize(
    ("index", "value", "taken"),
    [
        (0x1005, 0x40000080, False),  # bit 30: the drive would be the producer of SYNC
        (0x1005, 0x20000080, False),  # bit 29: identifiers of 29 bits
        (0x1005, 0x00000081, True),
        (0x1005, 0x80000080, True),  # bit 31 does not care
        (0x1014, 0x40000085, False),  # bit 30 is reserved
        (0x1014, 0x20000085, False),
        (0x1014, 0x80000085, True),  # bit 31: no emergencies
    ],
)
def test_identifiers_of_sync_and_emergency_refuse_what_the_drive_does_not_do(
    index: int, value: int, taken: bool
) -> None:
    """1005h and 1014h, 06090030h."""
    wire = Wire()
    answer = sdo(wire, 0x23, index & 0xFF, index >> 8, 0, *value.to_bytes(4, "little"))
    assert (answer[0] == 0x60) is taken
    if not taken:
        assert abort_of(answer) == Abort.RANGE


def test_the_defaults_of_the_pdos_are_those_of_the_profile() -> None:
    """Type 255 (CiA 402): received at once, sent on change, without any SYNC."""
    device = Device(Drive(), node_id=NODE)
    assert {int(device.read(base + n, 2)) for base in (0x1400, 0x1800) for n in range(4)} == {255}


def test_each_sync_is_a_period_and_a_tpdo() -> None:
    """Receive PDOs count from the SYNC on, transmit PDOs of type n come with every n-th."""
    wire = Wire()
    wire.put(0, bytes((1, 0)))
    wire.sync()
    wire.take(0x185)
    cycles = wire.device.drive.cycles
    wire.put(0x205, struct.pack("<Hbi", 6, 8, 0))
    assert wire.device.read(0x6040) == 0
    wire.sync()
    assert wire.device.drive.cycles == cycles + 1
    (tpdo,) = wire.take(0x185)
    word, mode, position = struct.unpack("<Hbi", tpdo)
    assert DriveState.of(word) is DriveState.READY_TO_SWITCH_ON
    assert (mode, position) == (8, 0)
    wire.write(0x1800, 2, 4)
    for _ in range(12):
        wire.sync()
    assert len(wire.take(0x185)) == 3


def test_a_tpdo_of_type_0_comes_when_it_changed() -> None:
    """Acyclic, but on a SYNC."""
    wire = Wire()
    wire.put(0, bytes((1, 0)))
    wire.write(0x1800, 2, 0)
    for _ in range(5):
        wire.sync()
    assert len(wire.take(0x185)) == 1
    wire.sync(0x06)
    wire.sync()
    assert len(wire.take(0x185)) == 1


def test_event_driven_pdos_need_no_sync() -> None:
    """Types 254 and 255: received at once, sent on change, on the timer, not within the inhibit."""
    wire = Wire()
    wire.write(0x1400, 2, 255)
    wire.write(0x1800, 2, 254)
    wire.put(0, bytes((1, 0)))
    wire.pass_time(0.01)
    assert len(wire.take(0x185)) == 1
    wire.put(0x205, struct.pack("<Hbi", 6, 8, 0))
    wire.pass_time(0.01)
    (tpdo,) = wire.take(0x185)
    assert DriveState.of(tpdo[0] | tpdo[1] << 8) is DriveState.READY_TO_SWITCH_ON
    wire.write(0x1800, 5, 100)
    wire.pass_time(1.0)
    assert 9 <= len(wire.take(0x185)) <= 11
    wire.write(0x1800, 5, 0)
    wire.write(0x1800, 1, 0x185 | DISABLED)
    wire.write(0x1800, 3, 5000)
    wire.write(0x1800, 1, 0x185)
    wire.pass_time(1.0)
    wire.take(0x185)
    for word in (7, 6, 7, 6, 7):
        wire.put(0x205, struct.pack("<Hbi", word, 8, 0))
        wire.pass_time(0.02)
    assert len(wire.take(0x185)) <= 1
    wire.pass_time(1.0)
    assert len(wire.take(0x185)) <= 1


def test_remote_frames_are_answered_where_allowed() -> None:
    """Types 252 and 253 on request; bit 30 of the COB-ID forbids it."""
    wire = Wire()
    wire.put(0, bytes((1, 0)))
    wire.write(0x1800, 2, 253)
    wire.put(0x185, remote=True)
    assert not wire.take(0x185)
    wire.write(0x1800, 1, 0x185)
    wire.put(0x185, remote=True)
    assert len(wire.take(0x185)) == 1
    wire.write(0x1800, 2, 252)
    wire.sync()
    sampled = wire.device.transmit(0)
    wire.put(0x205, struct.pack("<Hbi", 6, 8, 0))
    wire.put(0x185, remote=True)
    assert wire.take(0x185) == [sampled]


def test_process_data_of_wrong_length_is_one_emergency() -> None:
    """Too short: 8210h and ignored; too long: 8220h and used; once, with 1001h and 1003h, and
    0000h when a right one comes.
    """
    for bad, code in ((b"\6\0", 0x8210), (struct.pack("<Hbi", 6, 8, 0) + b"\0", 0x8220)):
        wire = Wire()
        wire.put(0, bytes((1, 0)))
        for _ in range(5):
            wire.put(0x205, bad)
            wire.sync()
        assert wire.take(0x85) == [code.to_bytes(2, "little") + b"\x11" + bytes(5)]
        assert (wire.device.read(0x1003, 0), wire.device.read(0x1003, 1)) == (1, code)
        assert wire.device.read(0x1001) == 0x11
        assert wire.device.read(0x6040) == (0 if code == 0x8210 else 6)
        for _ in range(5):
            wire.put(0x205, struct.pack("<Hbi", 6, 8, 0))
            wire.sync()
        assert wire.take(0x85) == [bytes(8)]
        assert (wire.device.read(0x1003, 0), wire.device.read(0x1001)) == (1, 0)
        wire.put(0x205, bad)
        assert len(wire.take(0x85)) == 1
        assert wire.device.read(0x1003, 0) == 2


def test_a_fault_is_one_emergency_whatever_the_node_goes_through() -> None:
    """Operational, stopped, pre-operational, reset of the communication: 8611h is told once."""
    wire = Wire()
    wire.enable()
    wire.write(0x6065, 0, 0)
    wire.write(0x60B1, 0, REV)
    for _ in range(20):
        wire.sync()
    for command in (2, 0x80, 1, 0x82, 1):
        wire.put(0, bytes((command, NODE)))
        wire.pass_time(0.05)
    codes = [data[:2] for data in wire.take(0x85)]
    assert codes == [b"\x11\x86"]
    assert wire.device.read(0x1003, 0) == 1


def test_no_process_data_before_operational() -> None:
    """In Pre-operational SYNC is a period of the drive, PDOs do not exist."""
    wire = Wire()
    wire.sync(0x06)
    assert not wire.take(0x185)
    assert wire.device.read(0x6040) == 0


def test_a_lost_sync_is_bridged_and_then_a_fault() -> None:
    """1006h = 1 ms: three periods go by, the fourth is 8700h; an emergency tells it."""
    wire = Wire()
    wire.write(0x1006, 0, 1000)
    wire.enable()
    wire.pass_time(0.0035, 0.0005)
    assert wire.device.feedback.error_code == 0
    wire.pass_time(0.003, 0.0005)
    assert wire.device.feedback.error_code == 0x8700
    assert wire.take(0x85)[0][:3] == b"\x00\x87\x11"


def moving(wire: Wire, speed: float = 10.0) -> None:
    """CSP at this many revolutions per second, SYNC each ms."""
    wire.enable()
    target = 0.0
    for k in range(400):
        target += speed * REV * 1e-3 * min(1.0, k / 300)
        wire.put(0x701, b"\5")
        wire.sync(0x0F, round(target))
    assert wire.device.feedback.velocity_actual == pytest.approx(speed * REV, rel=0.01)


@pytest.mark.parametrize("silence", [5, 50, 200, 500])
@pytest.mark.parametrize("counter", [12, 0xFFFF])
@pytest.mark.parametrize("reaction", [0, 1, 2])
def test_a_motor_does_not_freeze_when_sync_stops(silence: int, counter: int, reaction: int) -> None:
    """1006h = 0: all of the silence passes for the motor; it stops by 605Eh, or without a fault
    (10F1h:2 = FFFFh) by 6085h. Never 606Ch at speed beside a 6064h that stands.
    """
    wire = Wire()
    wire.write(0x2100, 7, silence)
    wire.write(0x10F1, 2, counter)
    wire.write(0x605E, 0, reaction)
    moving(wire)
    stopped = wire.now
    before = last = wire.device.feedback.position_actual
    while wire.now - stopped < 1.5:
        wire.pass_time(1e-3)
        feedback = wire.device.feedback
        if wire.now - stopped > silence * 1e-3 + 2e-3:
            travelled = (feedback.position_actual - last) * 1e3
            assert feedback.velocity_actual == pytest.approx(travelled, abs=0.15 * REV)
        last = feedback.position_actual
    assert wire.device.drive.cycles >= 1500
    assert (wire.device.feedback.error_code == 0x8700) is (counter == 12)
    # bridged for 3 ms, then v^2 / 2a; friction alone brings a motor that coasts to rest
    ramp = {1: 100.0, 2: 250.0}.get(reaction) if counter == 12 else 250.0
    way = (wire.device.feedback.position_actual - before) / REV
    if ramp is None:
        assert way > 0.4
    else:
        assert way == pytest.approx(10.0 * 0.004 + 10.0**2 / (2 * ramp), abs=0.03)
        assert abs(wire.device.feedback.velocity_actual) < REV / 100


@pytest.mark.parametrize(("period", "found"), [(1e-3, 0), (1.1e-3, 0), (2e-3, 1), (0.5e-3, 1)])
def test_sync_that_does_not_come_in_the_period_of_60c2_is_a_finding(
    period: float, found: int
) -> None:
    """60C2h = 1 ms: told by bit 7 and 2101h:14, jitter of single SYNCs is not."""
    wire = Wire()
    wire.enable()
    for k in range(40):
        wire.now += period - 1e-3 + (2e-3 if k % 8 == 0 else 0.0)
        wire.sync(0x0F)
    assert (int(wire.device.read(0x2101, 14)) > 0) is bool(found)
    assert bool(wire.device.feedback.statusword & 0x80) is bool(found)
    assert (wire.device.drive.report().clean) is not bool(found)


def test_without_any_sync_the_clock_runs_the_drive() -> None:
    """A master that only speaks SDO gets an enabled drive that stays enabled."""
    wire = Wire()
    wire.write(0x6060, 0, 8)
    for word in (6, 7, 0xF):
        assert sdo(wire, 0x2B, 0x40, 0x60, 0, word)[0] == 0x60
    wire.pass_time(2.0)
    assert wire.device.feedback.follows
    wire.now += 10.0  # a debugger's pause is not made up for
    cycles = wire.device.drive.cycles
    wire.node.tick(wire.now)
    assert wire.device.drive.cycles - cycles < 100


def test_an_emergency_tells_a_fault_and_its_end() -> None:
    """80h + id: code, error register, and code 0 when it is reset."""
    wire = Wire()
    wire.enable()
    wire.sync(0x0F, 2**30)
    assert wire.take(0x85) == [b"\x12\x86\x21" + bytes(5)]
    for _ in range(20):
        wire.sync(0x0F)
    wire.sync(0x80)
    assert wire.take(0x85) == [bytes(8)]
    wire.write(0x1014, 0, 0x85 | DISABLED)
    wire.enable()
    wire.sync(0x0F, 2**30)
    assert not wire.take(0x85)


def test_states_are_announced() -> None:
    """The present one and each that follows, once."""
    wire = Wire()
    seen: list[DriveState] = []
    wire.node.announce(seen.append)
    wire.enable()
    wire.sync(0x0F)
    assert seen == [
        DriveState.SWITCH_ON_DISABLED,
        DriveState.READY_TO_SWITCH_ON,
        DriveState.SWITCHED_ON,
        DriveState.OPERATION_ENABLED,
    ]


def test_foreign_frames_are_ignored() -> None:
    """Extended identifiers and error frames are not CANopen."""
    wire = Wire()
    wire.node.take(Frame(0, bytearray((1, 0)), is_extended_id=True), 0.0)
    wire.node.take(Frame(0, bytearray((1, 0)), is_error_frame=True), 0.0)
    assert wire.node.nmt == NmtState.PRE_OPERATIONAL


def command(*more: str) -> list[str]:
    return [sys.executable, "-m", "sjerk", "drive", "--interface", "virtual", *more]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_command_writes_its_data_sheet_says_ready_and_stops(
    number: signal.Signals, tmp_path: Path
) -> None:
    """EDS first, one flushed line, a clean end with the verdict."""
    sheet = tmp_path / "drive.eds"
    with subprocess.Popen(
        command("--node", "9", "--motor", "SGM7A-15A", "--eds", str(sheet)),
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert "ready" in line
        assert "SGM7A-15A" in line
        assert "0x189" in sheet.read_text() or "0x40000189" in sheet.read_text()
        process.send_signal(number)
        rest = process.stdout.read()
        assert process.wait(20) == 0
    assert "no findings" in rest


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--node", "128"], "128"),
        (["--load-inertia", "-1"], "load_inertia_ratio = -1.0"),
        (["--interface", "socketcand", "--channel", "nowhere"], "no bus"),
        (["--interface", "nonsense"], "no bus"),
    ],
)
def test_the_command_refuses_what_cannot_be(more: list[str], message: str) -> None:
    """A message that names the value, an exit code, no traceback."""
    done = subprocess.run(command(*more), capture_output=True, text=True, timeout=60)
    assert done.returncode in (1, 2)
    assert message in done.stderr
    assert "Traceback" not in done.stderr


def test_without_the_extra_the_command_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """No python-can: a sentence and the exit code of every missing extra."""
    real = builtins.__import__

    def refuse(name: str, *rest: object) -> object:
        if name == "can":
            raise ImportError(name)
        return real(name, *rest)  # type: ignore[arg-type]

    monkeypatch.delitem(sys.modules, "sjerk.ports.canopen.bus", raising=False)
    monkeypatch.setattr(builtins, "__import__", refuse)
    assert main(["drive"]) == 1
    assert "sjerk[canopen]" in capsys.readouterr().err
