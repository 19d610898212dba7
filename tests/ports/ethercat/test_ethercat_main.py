"""A kernel as main device of emulated drives, both in one process, in virtual time."""

from __future__ import annotations

import random
import struct
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.ethercat_joined import AXIS, COUNTS, Joined
from sjerk import Axis, InputError, Limits, MotionKernel
from sjerk._binding import ffi, lib
from sjerk.cycle.states import AxisState
from sjerk.ports.ethercat import BusError, DriveSettings, Line, MainDevice

INT32 = st.one_of(
    st.sampled_from([-(2**31), -(2**31) + 5, -1, 0, 1, 2**31 - 5, 2**31 - 1]),
    st.integers(-(2**31), 2**31 - 1),
)


@pytest.mark.parametrize(("drives", "cycle_time"), [(1, 1e-3), (7, 1e-3), (7, 250e-6), (3, 125e-6)])
def test_moves_end_on_the_goal_to_the_increment(drives: int, cycle_time: float) -> None:
    """Goals arrive in 607Ah to the bit; the drives find nothing; every working counter is right."""
    draw = random.Random(drives)
    with Joined(drives, cycle_time, drift_ppm=20) as joined:
        joined.enable()
        for _ in range(3):
            goals = [draw.randrange(-5 * COUNTS, 5 * COUNTS) / COUNTS for _ in range(drives)]
            move = joined.host.move(goals)
            joined.until(lambda move=move: move.done, 40_000)
            joined.cycles(round(0.3 / cycle_time))
            wanted = [round(goal * COUNTS) for goal in goals]
            words = [device.controller.rx for device in joined.line.devices]
            assert [word.target_position for word in words] == wanted
            ends = [device["position"] for device in joined.line.status()["devices"]]
            assert wanted == pytest.approx(ends, abs=COUNTS / 5000)  # the motor's friction
        assert joined.findings() == [{}] * drives
        assert [joined.c.drive[k].told.wrong for k in range(drives)] == [0] * drives
        assert joined.c.told.lost == joined.c.told.stray == 0
        assert all(device["syncs_missed"] == 0 for device in joined.line.status()["devices"])


@settings(max_examples=15, deadline=None)
@given(st.lists(INT32, min_size=2, max_size=2))
def test_a_drive_may_stand_anywhere(places: list[int]) -> None:
    """Whatever 6064h is at the start, no target differs from it before a move, and none jumps."""
    with Joined(2, at=places) as joined:
        seen = []
        joined.host.enable()
        for _ in range(60):
            joined.main.exchange()
            seen += [
                (esc.rx.target_position, place)
                for device, place in zip(joined.line.devices, places, strict=True)
                for esc in (device.controller,)
                if esc.tx.statusword & 0x27 == 0x27
            ]
        assert seen
        # the motor stands under its loop: within an increment or two of where it was
        assert all(abs((target - place + 2**31) % 2**32 - 2**31) <= 2 for target, place in seen)
        move = joined.host.move([axis.position + 0.25 for axis in joined.axes])
        joined.until(lambda: move.done)
        assert joined.findings() == [{}, {}]


def test_two_runs_are_equal_to_the_bit(tmp_path: Path) -> None:
    """The same drives, moves and faults twice: every word of every drive is the same."""

    def run() -> list[bytes]:
        rows = []
        with Joined(3, 1e-3, drift_ppm=30, at=[5, -7, 2**30]) as joined:
            joined.line.lose(every=37)
            joined.enable()
            move = joined.host.move([1.0, -2.0, 64.5])
            for _ in range(400):
                joined.main.exchange()
                rows.append(joined.kernel.image.inputs.tobytes())
                rows.append(joined.kernel.image.outputs.tobytes())
                rows.append(struct.pack("<qq", joined.line.now, joined.c.told.phase_ns))
            assert move.done
        return rows

    assert run() == run()


def test_one_lrw_for_all_drives_moves_them_too() -> None:
    """As benchmarks compare it: the counter is that of all, none is told apart from the others."""
    joined = Joined(3, drift_ppm=20)
    joined.c.together = 1
    with joined:
        joined.enable()
        move = joined.host.move([1.0, -2.0, 3.0])
        joined.until(lambda: move.done)
        assert [joined.c.drive[k].told.counter for k in range(3)] == [9, 9, 9]
        assert joined.findings() == [{}] * 3
        joined.line.cut(2)
        joined.cycles(joined.c.lost + 8)
        assert [axis.state for axis in joined.axes] == [AxisState.ERROR_STOP] * 3


@pytest.mark.parametrize("drives", [1, 41])
def test_process_data_find_room_in_several_frames(drives: int) -> None:
    """So many drives that one frame does not hold them still move, all in one cycle."""
    with Joined(drives, drift_ppm=10) as joined:
        assert (joined.c.frames > 1) == (drives > 40)
        joined.enable()
        move = joined.host.move([0.01 * (k + 1) for k in range(drives)])
        joined.until(lambda: move.done)
        assert joined.findings() == [{}] * drives
        assert joined.c.told.present == drives


@pytest.mark.parametrize(
    ("behaviour", "cycle_time", "setup"),
    [
        ("free", 1e-3, {}),
        ("free", 1e-3, {"activate": 0}),
        ("free", 1e-3, {"receive": ("6040", "607A"), "transmit": ("6041", "6064")}),
        ("free", 5e-4, {"receive": ("6040", "6060", "-8", "607A", "60FE:1"),
                        "transmit": ("6064", "6041", "6061", "-8", "603F")}),
        ("fixed", 1e-3, {}),
        ("fixed", 1e-3, {"rx_pdos": [0x1702], "tx_pdos": [0x1B02]}),
        ("sync1", 1e-3, {"activate": 0x0700, "sync0_us": 62.5}),
        ("deaf", 2e-3, {}),
        ("maps", 1e-3, {}),
    ],
)  # fmt: skip
def test_every_kind_of_drive_is_set_up_and_moves(
    behaviour: str, cycle_time: float, setup: dict[str, object]
) -> None:
    """Each behaviour under a configuration that suits it, beside a drive of another kind."""
    with Joined(
        2, cycle_time, behaviour=[behaviour, "free"], drift_ppm=20,
        setup={0: DriveSettings(0, **setup), 1: 1},
    ) as joined:  # fmt: skip
        joined.enable()
        move = joined.host.move([1.5, -1.5])
        joined.until(lambda: move.done)
        joined.cycles(200)
        assert joined.axes[0].target_counts == 3 * COUNTS // 2
        assert joined.axes[0].actual_position == pytest.approx(1.5, abs=2e-3)
        assert joined.findings() == [{}, {}]


@pytest.mark.parametrize(
    ("line", "setup", "cycle_time", "words"),
    [
        ({"drives": 2}, {0: 0}, 1e-3, ["device 1", "others"]),
        ({"drives": 1}, {0: 3}, 1e-3, ["axis 0", "position 3", "1 devices"]),
        ({"drives": 2}, {0: 0, 1: 0}, 1e-3, ["device 0", "two axes"]),
        ({"drives": 1}, {0: DriveSettings(alias=7)}, 1e-3, ["alias 7"]),
        ({"drives": 1}, {0: DriveSettings(0, identity=(1, 2))}, 1e-3,
         ["device 0", "identity", "0x1, 0x2"]),
        ({"drives": 1}, {0: DriveSettings(0, receive=("6040",))}, 1e-3, ["device 0", "607Ah"]),
        ({"drives": 1}, {0: DriveSettings(0, receive=("6040", "607A", "6502"))}, 1e-3,
         ["device 0", "1600h:3", "06040041h"]),
        ({"drives": 1}, {0: DriveSettings(0, startup=[["6041", "u16", 1]])}, 1e-3,
         ["device 0", "6041h:0", "06010002h", "read only"]),
        ({"drives": 1, "behaviour": "fixed"}, {0: DriveSettings(0, activate=0)}, 1e-3,
         ["device 0", "SAFEOP", "0028h"]),
        ({"drives": 1, "behaviour": "fixed"}, {0: DriveSettings(0, receive=("6040", "607A"))},
         1e-3, ["device 0", "1600h:0"]),
        ({"drives": 1, "behaviour": "sync1"}, {0: 0}, 1e-3, ["device 0", "SAFEOP", "0030h"]),
        ({"drives": 1, "behaviour": "maps"}, {0: 0}, 125e-6, ["device 0", "SAFEOP", "0036h"]),
    ],
)  # fmt: skip
def test_a_refusal_names_device_and_object(
    line: dict[str, object], setup: dict[int, object], cycle_time: float, words: list[str]
) -> None:
    """What is not as configured is one line, before anything moves."""
    kernel = MotionKernel([AXIS] * 2, cycle_time)
    with pytest.raises(BusError) as refused, MainDevice(kernel, Line(**line), setup):
        raise AssertionError("it was accepted")
    text = str(refused.value)
    assert all(word in text for word in words), text
    assert "\n" not in text


@pytest.mark.parametrize("cycle_time", [1.1e-3, 60e-6, 1e-3 + 1e-6])
def test_a_cycle_that_drives_cannot_run_is_refused(cycle_time: float) -> None:
    """Cycles are multiples of 125 us."""
    kernel = MotionKernel([AXIS], cycle_time)
    with pytest.raises(InputError, match="125e-6"):
        MainDevice(kernel, Line(), {0: 0})


def test_only_external_axes_are_exchanged() -> None:
    """An axis with a simulated drive is refused."""
    kernel = MotionKernel([Axis(Limits(1.0, 10.0, 100.0), COUNTS)], 1e-3)
    with pytest.raises(InputError, match="external"):
        MainDevice(kernel, Line(), {0: 0})


@settings(max_examples=10, deadline=None)
@given(st.integers(4, 11), st.integers(0, 2**32 - 1), st.booleans())
def test_requests_survive_lost_frames(every: int, value: int, during: bool) -> None:
    """SDO of every length come through whole, whatever answers are lost on their way."""
    with Joined(1) as joined:
        joined.line.lose(every=every)
        if during:
            joined.host.enable()
        main = joined.main
        data = struct.pack("<I", value)
        main.write(0, 0x6065, 0, data)
        assert main.read(0, 0x6065) == data
        name = main.read(0, 0x1008)
        assert name == b"sjerk drive"
        joined.line.lose(every=0)
        assert main.read(0, 0x1008) == name


def test_reads_beside_the_cycle_lose_none() -> None:
    """SDO beside the cycle: the cyclic frames of all drives come back, each in its cycle."""
    with Joined(2, drift_ppm=20) as joined:
        joined.enable()
        move = joined.host.move([2.0, -2.0])
        for _ in range(400):
            joined.main.exchange()
            for _ in range(3):
                assert len(joined.main.read(0, 0x6064)) == 4
        assert move.done
        assert joined.c.told.lost == 0
        assert joined.axes[0].follows


def test_the_end_disables_each_drive_first() -> None:
    """In mid-motion: halt, disabled, Safe-operational, Init; no drive has had an error."""
    with Joined(3, drift_ppm=20) as joined:
        joined.enable()
        joined.host.move([50.0, -50.0, 10.0])
        joined.cycles(150)
    for device in joined.line.devices:
        assert [state for state, _ in device.changes][-2:] == [0x04, 0x01]
        assert all(code == 0 for _, code in device.changes)
    for device in joined.line.status()["devices"]:
        assert device["statusword"] & 0x6F not in (0x27, 0x0F, 0x08)
    assert joined.findings() == [{}, {}, {}]


@pytest.fixture(scope="module")
def fuzzed() -> Iterator[Joined]:
    """Three drives in Operational."""
    with Joined(3) as joined:
        yield joined


@settings(max_examples=300, deadline=None)
@given(st.data())
def test_no_answer_from_the_wire_does_harm(fuzzed: Joined, data: st.DataObject) -> None:
    """Random, spoilt and forged answers: only the answer to what was sent changes the image.

    Whoever knows the bytes of the frame on its way can still forge one: a wire has no
    authentication.
    """
    bus, kernel = fuzzed.c, fuzzed.kernel
    lib.sj_bus_settle(bus)
    lib.sj_bus_compose(bus, 0, 0)
    sent = bytes(ffi.buffer(bus.flight[0].bytes, bus.flight[0].length))
    image = kernel.image.inputs.tobytes()
    frame = bytearray(sent)
    frame[6] |= 2
    kind = data.draw(st.sampled_from(["random", "head", "short", "long"]))
    if kind == "random":
        frame[:] = data.draw(st.binary(max_size=1600))
    elif kind == "head":  # of any datagram: command, index, register, length
        at, heads = 16, []
        while at < len(sent) - 12:
            heads += [at, at + 1, at + 4, at + 5, at + 6]
            at += 12 + (struct.unpack_from("<H", sent, at + 6)[0] & 0x7FF)
        frame[data.draw(st.sampled_from(heads))] ^= data.draw(st.integers(1, 255))
    elif kind == "short":
        del frame[data.draw(st.integers(0, len(sent) - 1)) :]
    stray = bus.told.stray
    if kind == "long":
        frame += data.draw(st.binary(max_size=86))
        assert lib.sj_bus_accept(bus, bytes(frame), len(frame)) == 1
        assert lib.sj_bus_accept(bus, bytes(frame), len(frame)) == 0  # twice is a stray one
    elif bytes(frame) != sent:
        assert lib.sj_bus_accept(bus, bytes(frame), len(frame)) == 0
    assert bus.told.stray > stray
    assert kernel.image.inputs.tobytes() == image  # no working counter was right
