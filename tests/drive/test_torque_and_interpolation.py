"""Profile torque (mode 4) and interpolated position (mode 7)."""

from __future__ import annotations

import struct
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.streams import scurve_at
from sjerk.cia402 import Drive, DriveConfig, DriveFeedback, DriveState, Mode, StatusWord
from sjerk.drive import Abort, Device, SdoError, entry

REV = 1 << 24
PT, IP = Mode.PROFILE_TORQUE, Mode.INTERPOLATED_POSITION
REACHED, LIMIT, FOLLOWS = (
    StatusWord.TARGET_REACHED,
    StatusWord.INTERNAL_LIMIT,
    StatusWord.FOLLOWS,
)


# ---- profile torque ----


@settings(max_examples=30, deadline=None)
@given(
    targets=st.lists(st.integers(-3000, 3000), min_size=1, max_size=6),
    slope=st.integers(100, 3_000_000),
    period=st.sampled_from([250e-6, 1e-3, 4e-3]),
    polarity=st.sampled_from([0, 0x20, 0xE0]),
    rated=st.floats(0.1, 50.0),
)
def test_the_torque_goes_along_its_slope(
    targets: list[int], slope: int, period: float, polarity: int, rated: float
) -> None:
    """6074h changes by 6087h times the time, to each target; bit 10 there, bit 12 never."""
    drive = Drive(
        DriveConfig(
            period_s=period,
            rated_torque_nm=rated,
            peak_torque_nm=4 * rated,
            inertia_kg_m2=rated,  # so that no speed limit is near
            torque_slope=slope,
            polarity=polarity,
            friction_nm=0.0,
        )
    )
    feedback = drive.enable(mode=PT)
    demand = 0.0
    for target in targets:
        for _ in range(60):
            demand += max(-slope * period, min(slope * period, target - demand))
            feedback = drive.cycle(0xF, mode=PT, target_torque=target)
            assert feedback.torque_demand == pytest.approx(demand, abs=0.51)
            assert feedback.mode_display == PT
            assert not feedback.statusword & FOLLOWS
            if abs(demand - target) > 1e-6 * slope * period:
                assert not feedback.statusword & REACHED
        if demand == target and abs(feedback.torque_actual - target) <= 9:
            assert feedback.statusword & REACHED


@settings(max_examples=25, deadline=None)
@given(
    speed=st.floats(-40.0, 40.0),
    target=st.integers(-500, 500),
    slope=st.integers(1000, 100_000),
    load=st.floats(-0.5, 0.5),
)
def test_profile_torque_begins_with_the_torque_at_hand(
    speed: float, target: int, slope: int, load: float
) -> None:
    """From a motion in CSP, and after halt: no step in torque but the slope's."""
    drive = Drive(DriveConfig(torque_slope=slope, load_torque_nm=load, following_window=2**31))
    feedback = drive.enable()
    for _ in range(300):
        feedback = drive.cycle(0xF, feedback.position_demand)
    at = float(feedback.position_demand)
    for k in range(600):
        at += speed * REV * 1e-3 * min(1.0, k / 300)
        feedback = drive.cycle(0xF, round(at))
    demands = [feedback.torque_demand]
    for _ in range(20):
        feedback = drive.cycle(0xF, mode=PT, target_torque=target)
        demands.append(feedback.torque_demand)
    assert max(abs(b - a) for a, b in pairwise(demands)) <= slope * 1e-3 + 2
    for _ in range(1500):
        feedback = drive.cycle(0x10F, mode=PT, target_torque=target)
    assert feedback.statusword & REACHED
    assert abs(feedback.velocity_actual) < REV // 100
    demands = [feedback.torque_demand]
    for _ in range(20):
        demands.append(drive.cycle(0xF, mode=PT, target_torque=target).torque_demand)
    assert max(abs(b - a) for a, b in pairwise(demands)) <= slope * 1e-3 + 2


def test_an_enabled_drive_begins_without_torque() -> None:
    """The target before it was disabled is none any more."""
    drive = Drive(DriveConfig(torque_slope=1000))
    drive.enable(mode=PT)
    for _ in range(200):
        feedback = drive.cycle(0xF, mode=PT, target_torque=200)
    assert feedback.torque_demand == 200
    for _ in range(20):
        drive.cycle(0x0, mode=PT, target_torque=200)
    for word in (0x6, 0x7, 0xF):
        feedback = drive.cycle(word, mode=PT, target_torque=200)
    assert abs(feedback.torque_demand) <= 1


@pytest.mark.parametrize("way", [-1, 1])
def test_profile_torque_keeps_the_speed_limit(way: int) -> None:
    """607Fh: bit 11, the target is not reached, the motor turns on."""
    drive = Drive(DriveConfig(max_profile_velocity=20 * REV))
    drive.enable(mode=PT)
    for _ in range(1500):
        feedback = drive.cycle(0xF, mode=PT, target_torque=way * 300)
    assert feedback.velocity_actual == pytest.approx(way * 20 * REV, rel=0.05)
    assert feedback.statusword & LIMIT
    assert not feedback.statusword & REACHED


@pytest.mark.parametrize(
    ("torque_max", "target"), [(100, 300), (100, -300), (0, 300), (3500, 20_000)]
)
def test_a_torque_beyond_its_limits_is_not_reached(torque_max: int, target: int) -> None:
    """6072h, and the motor's peak: bit 11."""
    drive = Drive(DriveConfig(max_torque=torque_max, inertia_kg_m2=1.0, torque_slope=10**7))
    drive.enable(mode=PT)
    for _ in range(50):
        feedback = drive.cycle(0xF, mode=PT, target_torque=target)
    assert abs(feedback.torque_actual) <= torque_max + 1
    assert feedback.statusword & LIMIT
    assert not feedback.statusword & REACHED


@pytest.mark.parametrize("load", [0.0, 0.2, -0.2])
@pytest.mark.parametrize("end", ["switch_positive_rev", "software_max"])
def test_profile_torque_stops_at_an_end_and_comes_away(end: str, load: float) -> None:
    """A limit switch or 607Dh: it stands there, held against a load, bit 11; away is free."""
    fields: dict[str, float] = {end: 2.0 if end == "switch_positive_rev" else 2 * REV}
    drive = Drive(DriveConfig(load_torque_nm=load, software_min=-100 * REV, **fields))  # type: ignore[arg-type]
    drive.enable(mode=PT)
    for _ in range(3000):
        feedback = drive.cycle(0xF, mode=PT, target_torque=250)
    places = []
    for _ in range(300):
        feedback = drive.cycle(0xF, mode=PT, target_torque=250)
        places.append(feedback.position_actual)
    assert feedback.statusword & LIMIT
    assert not feedback.statusword & REACHED
    assert max(places) - min(places) < REV // 10_000
    for _ in range(600):
        feedback = drive.cycle(0xF, mode=PT, target_torque=-250)
    assert feedback.position_actual < places[-1] - REV // 4


def test_the_torque_slope_is_an_object() -> None:
    """6087h: mapped, never 0."""
    device = Device()
    device.write(0x6087, 0, 500)
    assert device.drive.config.torque_slope == 500
    with pytest.raises(SdoError) as caught:
        device.download(0x6087, 0, bytes(4))
    assert caught.value.abort is Abort.TOO_LOW
    assert entry(0x6087, 0).pdo == "R"


# ---- interpolated position ----


def stream(
    mode: int, targets: list[int], config: DriveConfig, missed: set[int]
) -> list[DriveFeedback]:
    """Targets in either mode, some of their SYNCs lost."""
    drive = Drive(config)
    drive.enable(mode=mode)
    word = 0x1F if mode == IP else 0xF
    seen = [drive.cycle(word, mode=mode)]
    for k, target in enumerate(targets):
        seen.append(
            drive.cycle(
                word,
                0 if mode == IP else target,
                mode=mode,
                interpolated_position=target if mode == IP else -12345,
                sync_missed=k in missed,
            )
        )
    return seen


@settings(max_examples=25, deadline=None)
@given(
    length=st.floats(1.51, 5.0),
    way=st.sampled_from([-1, 1]),
    period=st.sampled_from([250e-6, 1e-3, 2e-3]),
    gear=st.sampled_from([(1, 1 << 24), (5, 36_000), (3, 1 << 20)]),
    polarity=st.sampled_from([0, 0x80, 0xC0]),
    missed=st.sets(st.integers(50, 400), max_size=6),
    spoilt=st.one_of(st.none(), st.integers(20, 300)),
)
def test_interpolated_position_follows_as_csp_does(
    length: float,
    way: int,
    period: float,
    gear: tuple[int, int],
    polarity: int,
    missed: set[int],
    spoilt: int | None,
) -> None:
    """The same stream and units, lost SYNCs and bad targets: the same motor, the same words."""
    config = DriveConfig(period_s=period, gear_motor=gear[0], feed=gear[1], polarity=polarity)
    unit = gear[1] / gear[0]
    v, a, j = 10.0, 100.0, 2000.0
    targets = [round(way * unit * scurve_at((k + 1) * period, length, v, a, j)) for k in range(400)]
    if spoilt is not None:
        targets[spoilt] += 2**30
    csp = stream(Mode.CSP, targets, config, missed)
    ip = stream(IP, targets, config, missed)
    # CSP has judged targets for one period more before the stream begins
    assert [f._replace(mode_display=0) for f in ip[1:]] == [
        f._replace(mode_display=0) for f in csp[1:]
    ]


def test_bit_4_enables_the_interpolation() -> None:
    """Without it the axis stands; taken away at speed it stops along 6084h."""
    config = DriveConfig(profile_deceleration=50 * REV)
    drive = Drive(config)
    feedback = drive.enable(mode=IP)
    for _ in range(20):
        feedback = drive.cycle(0xF, mode=IP, interpolated_position=10 * REV)
        assert not feedback.statusword & FOLLOWS
    assert abs(feedback.position_actual) < 100
    at = float(feedback.position_actual)
    for k in range(400):
        at += 10 * REV * 1e-3 * min(1.0, k / 200)
        feedback = drive.cycle(0x1F, mode=IP, interpolated_position=round(at))
        assert bool(feedback.statusword & FOLLOWS) is (k > 0)
    demands = [feedback.velocity_demand]
    for k in range(1700):
        word = 0xF if k < 30 else 0x1F  # given again while the axis slows down: it comes to rest
        at = feedback.position_demand if feedback.velocity_demand == 0 else at
        feedback = drive.cycle(word, mode=IP, interpolated_position=round(at))
        demands.append(feedback.velocity_demand)
        assert not feedback.statusword & FOLLOWS or feedback.velocity_demand == 0
    steps = {round((b - a) / REV * 1e3) for a, b in pairwise(demands[1:190])}
    assert steps == {-50}
    assert feedback.state is DriveState.OPERATION_ENABLED
    assert feedback.statusword & FOLLOWS
    assert feedback.statusword & REACHED


def test_missed_syncs_are_of_no_concern_while_interpolation_is_off() -> None:
    """Mode 7 lives of targets only with bit 4."""
    drive = Drive()
    drive.enable(mode=IP)
    for _ in range(50):
        feedback = drive.cycle(0xF, mode=IP, sync_missed=True)
    assert feedback.error_code == 0
    for _ in range(50):
        feedback = drive.cycle(0x1F, mode=IP, sync_missed=True)
    assert feedback.error_code == 0x8700


def test_a_set_point_that_nobody_wrote_is_where_the_axis_is() -> None:
    """60C1h:1 follows 6064h until it is written, as 607Ah does; only linear is offered in 60C0h."""
    device = Device()
    device.write(0x6060, 0, Mode.CSP)
    for word in (6, 7, 0xF, 0xF, 0xF):
        device.write(0x6040, 0, word)
        device.cycle()
    for k in range(500):
        device.write(0x607A, 0, 20_000 * min(k, 300))
        device.cycle()
    device.write(0x6040, 0, 0)
    device.cycle()
    device.write(0x6060, 0, IP)
    for word in (6, 7, 0x1F, 0x1F, 0x1F):
        device.write(0x6040, 0, word)
        feedback = device.cycle()
    assert feedback.statusword & FOLLOWS
    assert device.read(0x60C1, 1) == pytest.approx(6_000_000, abs=REV // 1000)
    assert abs(feedback.position_actual - int(device.read(0x60C1, 1))) < REV // 10_000
    device.download(0x60C0, 0, struct.pack("<h", 0))
    for value in (1, -1):
        with pytest.raises(SdoError) as caught:
            device.download(0x60C0, 0, struct.pack("<h", value))
        assert caught.value.abort is Abort.RANGE
