"""The object dictionary: its table, its data sheet, and what it refuses."""

from __future__ import annotations

import doctest
import io
import struct

import canopen
import pytest

import sjerk.cia402
import sjerk.drive.device
import sjerk.drive.entries
import sjerk.drive.objects
from sjerk.cia402 import Drive, DriveConfig, DriveFault, DriveState, Finding, Mode
from sjerk.drive.device import LOAD, SAVE, Device
from sjerk.drive.eds import eds
from sjerk.drive.entries import Abort, SdoError, Type
from sjerk.drive.objects import DISABLED, OBJECTS, entry


def refused(device: Device, index: int, sub: int, data: bytes) -> Abort:
    with pytest.raises(SdoError) as caught:
        device.download(index, sub, data)
    assert (caught.value.index, caught.value.sub) == (index, sub)
    assert f"{index:04X}h" in str(caught.value)
    return caught.value.abort


@pytest.mark.parametrize(
    "module", [sjerk.cia402, sjerk.drive.entries, sjerk.drive.objects, sjerk.drive.device]
)
def test_the_examples_in_the_docstrings_run(module: object) -> None:
    """Documentation that runs."""
    assert doctest.testmod(module, optionflags=doctest.IGNORE_EXCEPTION_DETAIL).failed == 0  # type: ignore[arg-type]


def test_every_row_is_readable_and_its_default_is_the_value() -> None:
    """At power-up the dictionary is what the table and the data sheet say."""
    device = Device(node_id=5)
    moving = {0x6041, 0x60FD}
    for thing in OBJECTS.values():
        for row in thing.entries:
            data = device.upload(row.index, row.sub)
            if row.type.size:
                assert len(data) == row.type.size
            if row.index not in moving and (row.index, row.sub) not in (
                (0x1003, 0),
                (0x2100, 2),
            ):
                expected = sjerk.drive.objects.default(row, 5)
                assert device.read(row.index, row.sub) == expected, (hex(row.index), row.sub)


def test_the_data_sheet_is_accepted_and_tells_the_same() -> None:
    """Canopen reads it: every object, its type, its access, its default, its mapping."""
    sheet = io.StringIO(eds(node_id=5))
    sheet.name = "drive.eds"
    dictionary = canopen.import_od(sheet, 5)
    for thing in OBJECTS.values():
        for row in thing.entries:
            read = dictionary[row.index] if thing.code == 7 else dictionary[row.index][row.sub]
            assert read.name == row.name
            assert read.data_type == row.type.code
            assert read.writable is (row.access != "ro")
            assert read.pdo_mappable is bool(row.pdo)
            assert (
                read.default == pytest.approx(sjerk.drive.objects.default(row, 5))
                if (row.type is not Type.VISIBLE_STRING)
                else read.default == row.default
            )


def test_the_data_sheet_of_another_motor_has_its_values() -> None:
    """Rated torque, current and the like are the device's, not the table's."""
    drive = Drive(DriveConfig.for_motor("SGM7A-30A", quick_stop_option=6))
    sheet = io.StringIO(Device(drive, node_id=9).data_sheet("big.eds"))
    sheet.name = "big.eds"
    dictionary = canopen.import_od(sheet, 9)
    assert dictionary[0x6076].default == 9800
    assert dictionary[0x605A].default == 6
    assert dictionary[0x1801][1].default & 0x7FF == 0x289


def test_supported_modes_are_true() -> None:
    """6502h has a bit for each mode that 6060h takes, and no other."""
    device = Device()
    taken = 0
    for mode in range(-1, 32):
        data = struct.pack("<b", mode)
        if mode in tuple(Mode):
            device.download(0x6060, 0, data)
            taken |= (1 << mode) >> 1
        else:
            assert refused(device, 0x6060, 0, data) is Abort.RANGE
    assert device.read(0x6502) == taken


def test_supported_homing_methods_are_true() -> None:
    """60E3h lists each method that 6098h takes, once, and no other."""
    device = Device()
    listed = [device.read(0x60E3, row.sub) for row in OBJECTS[0x60E3].entries[1:]]
    assert device.read(0x60E3) == len(listed) == len(set(listed))
    for method in range(-128, 128):
        data = struct.pack("<b", method)
        if method in listed:
            device.download(0x6098, 0, data)
        else:
            assert refused(device, 0x6098, 0, data) is Abort.RANGE


@pytest.mark.parametrize(
    ("index", "sub", "data", "abort"),
    [
        (0x5FFF, 0, b"\0", Abort.NO_OBJECT),
        (0x6040, 1, b"\0\0", Abort.NO_SUBINDEX),
        (0x6041, 0, b"\0\0", Abort.READ_ONLY),
        (0x607B, 0, b"\2", Abort.READ_ONLY),
        (0x1008, 0, b"x", Abort.READ_ONLY),
        (0x6040, 0, b"\0", Abort.TOO_SHORT),
        (0x6040, 0, b"\0\0\0", Abort.TOO_LONG),
        (0x605A, 0, b"\x09\0", Abort.RANGE),
        (0x605D, 0, b"\0\0", Abort.RANGE),
        *((0x6098, 0, struct.pack("<b", n), Abort.RANGE) for n in (-128, -5, 15, 31, 36, 38, 127)),
        (0x6091, 1, b"\0\0\0\0", Abort.TOO_LOW),
        (0x10F1, 2, b"\0\0", Abort.TOO_LOW),
        (0x1010, 1, b"evil", Abort.CANNOT_STORE),
        (0x1011, 1, b"evil", Abort.CANNOT_STORE),
        (0x1003, 0, b"\1", Abort.RANGE),
        (0x2100, 5, struct.pack("<f", float("nan")), Abort.RANGE),
        (0x2101, 1, b"\1\0\0\0", Abort.RANGE),
        (0x1400, 2, b"\xfa", Abort.RANGE),
        (0x1800, 2, b"\xf8", Abort.RANGE),
        (0x1400, 1, struct.pack("<I", 0x581), Abort.RANGE),
        (0x1400, 1, struct.pack("<I", 0x305), Abort.DEVICE_STATE),
        (0x1600, 0, b"\0", Abort.DEVICE_STATE),
        (0x1800, 3, b"\1\0", Abort.DEVICE_STATE),
        (0x60C2, 1, b"\0", Abort.RANGE),
        (0x60C2, 2, b"\1", Abort.RANGE),
        (0x1005, 0, struct.pack("<I", 0x7FF), Abort.RANGE),
    ],
)
def test_a_bad_request_gets_its_abort_code(index: int, sub: int, data: bytes, abort: Abort) -> None:
    """Each refusal has the code of CiA 301 and leaves the value."""
    device = Device()
    try:
        before = device.upload(index, sub)
    except SdoError:
        before = None
    assert refused(device, index, sub, data) is abort
    if before is not None:
        assert device.upload(index, sub) == before


def test_scaling_objects_are_refused_while_enabled() -> None:
    """Gear, feed, polarity, range and period belong to a drive at rest."""
    device = Device()
    for word in (0x06, 0x0F):
        device.write(0x6040, 0, word)
        device.cycle()
    assert device.feedback.state is DriveState.OPERATION_ENABLED
    for index, sub in ((0x6091, 1), (0x6092, 1), (0x607E, 0), (0x607B, 1), (0x60C2, 1)):
        data = device.upload(index, sub)
        assert refused(device, index, sub, data) is Abort.DEVICE_STATE


def remap(device: Device, number: int, words: list[int], *, receive: bool) -> None:
    way = (0x1400 if receive else 0x1800) + number
    cob = device.read(way, 1)
    assert isinstance(cob, int)
    device.write(way, 1, cob | DISABLED)
    device.write(way + 0x200, 0, 0)
    for sub, word in enumerate(words, 1):
        device.write(way + 0x200, sub, word)
    device.write(way + 0x200, 0, len(words))
    device.write(way, 1, cob & ~DISABLED)


def test_process_data_can_be_mapped_anew() -> None:
    """Disable, clear, write, count, enable; dummies are skipped."""
    device = Device()
    remap(device, 1, [0x00060010, 0x60B00020, 0x60400010], receive=True)
    device.receive(1, struct.pack("<HiH", 0xFFFF, -7, 6))
    assert device.read(0x60B0) == -7
    assert device.read(0x6040) == 6
    remap(device, 2, [0x60640020, 0x60F40020], receive=False)
    assert device.transmit(2) == struct.pack("<ii", 0, 0)
    with pytest.raises(SdoError):
        device.receive(1, b"\0")


@pytest.mark.parametrize(
    ("word", "abort"),
    [
        (0x60410010, Abort.NOT_MAPPABLE),
        (0x60400020, Abort.NOT_MAPPABLE),
        (0x60840010, Abort.NOT_MAPPABLE),
        (0x5FFF0010, Abort.NO_OBJECT),
        (0x00010001, Abort.NOT_MAPPABLE),
    ],
)
def test_what_cannot_be_mapped_is_refused(word: int, abort: Abort) -> None:
    """Wrong direction, wrong length, no object."""
    device = Device()
    device.write(0x1401, 1, 0x301 | DISABLED)
    device.write(0x1601, 0, 0)
    assert refused(device, 0x1601, 1, struct.pack("<I", word)) is abort


def test_a_process_data_object_ends_at_eight_bytes() -> None:
    """More than 64 bits: 06040042h."""
    device = Device()
    device.write(0x1401, 1, 0x301 | DISABLED)
    device.write(0x1601, 0, 0)
    for sub in (1, 2, 3):
        device.write(0x1601, sub, 0x607A0020)
    assert refused(device, 0x1601, 0, b"\3") is Abort.PDO_LENGTH


def test_stored_values_come_back_after_power_off() -> None:
    """'save' keeps, 'load' forgets at the next reset; the axis stays where it is."""
    device = Device()
    device.write(0x605A, 0, 6)
    device.write(0x1017, 0, 500)
    device.write(0x1010, 1, SAVE)
    device.write(0x605A, 0, 5)
    device.reset()
    assert (device.read(0x605A), device.read(0x1017)) == (6, 500)
    device.write(0x1011, 1, LOAD)
    device.reset()
    assert (device.read(0x605A), device.read(0x1017)) == (2, 0)


def test_a_reset_leaves_the_axis_where_it_is() -> None:
    """The encoder is absolute: 6064h is the same before and after."""
    drive = Drive()
    feedback = drive.enable()
    for k in range(1500):
        feedback = drive.cycle(0xF, min(k, 500) * 10_000)
    device = Device(drive)
    assert device.feedback.position_actual == pytest.approx(feedback.position_actual, abs=5)


def test_an_unwritten_target_is_the_actual_position() -> None:
    """A master that never writes 607Ah enables where the axis is."""
    drive = Drive()
    drive.enable()
    for k in range(1500):
        drive.cycle(0xF, min(k, 500) * 10_000)
    device = Device(drive)
    device.write(0x6060, 0, 8)
    for word in (6, 7, 0xF, 0xF, 0xF):
        device.write(0x6040, 0, word)
        feedback = device.cycle()
    assert feedback.follows
    assert device.read(0x607A) == pytest.approx(5_000_000, abs=10)


def test_the_period_counts_once_value_and_index_fit() -> None:
    """60C2h in two writes: 250 us by way of an impossible 250 ms."""
    device = Device()
    device.write(0x60C2, 1, 250)
    assert device.drive.config.period_s == 1e-3
    device.write(0x60C2, 2, -6)
    assert device.drive.config.period_s == 250e-6
    finer = Device(Drive(DriveConfig(period_s=250e-6)))
    assert (finer.read(0x60C2, 1), finer.read(0x60C2, 2)) == (25, -5)


def test_the_verdict_is_in_the_dictionary() -> None:
    """2101h tells what Drive.report() tells."""
    device = Device()
    device.write(0x6060, 0, 8)
    for word in (6, 7, 0xF, 0xF, 0xF):
        device.write(0x6040, 0, word)
        device.cycle()
    for k in range(100):
        device.write(0x607A, 0, 500_000 * k)
        device.cycle()
    report = device.drive.report()
    assert device.read(0x2101, 10) == report.findings[Finding.STEP] == 1
    assert device.read(0x2101, 2) == report.velocity_rev_s
    device.write(0x2101, 1, 0)
    assert device.read(0x2101, 10) == 0


def test_errors_are_remembered_newest_first() -> None:
    """1003h keeps eight; writing 0 to sub 0 clears."""
    device = Device()
    for fault in (3, 5):
        device.drive.inject(DriveFault(fault))
        device.cycle()
        device.drive.inject(DriveFault(fault), False)
        for word in (0, 0, 0x80, 0):
            device.write(0x6040, 0, word)
            device.cycle()
    assert [device.read(0x1003, sub) for sub in range(4)] == [2, 0x4310, 0x3210, 0]
    device.write(0x1003, 0, 0)
    assert device.read(0x1003, 0) == 0


def test_an_entry_knows_where_it_is() -> None:
    """Lookups by index and sub-index, with the abort codes of a bad one."""
    assert entry(0x607D, 2).name == "Max"
    with pytest.raises(SdoError) as caught:
        entry(0x607D, 3)
    assert caught.value.abort is Abort.NO_SUBINDEX


def test_the_profile_jerk_has_a_fine_and_a_coarse_object() -> None:
    """60A4h:1 in pu/s^3, 2100h:6 in rev/s^3: one value."""
    device = Device()
    assert device.read(0x60A4, 1) == 0xFFFFFFFF
    device.write(0x60A4, 1, 100 * 16777216)
    assert device.read(0x2100, 6) == 100.0
    device.write(0x2100, 6, 50.0)
    assert device.read(0x60A4, 1) == 50 * 16777216
