"""Homing methods of 6098h against the pages of CiA 402: where home is, and the way to it."""

from __future__ import annotations

import math
from fractions import Fraction
from math import ceil, floor

import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from helpers.homing import ATTAINED, ERROR, REACHED, search
from helpers.homing import home as home_of
from sjerk.cia402 import Drive, DriveConfig, DriveFeedback, Mode
from sjerk.drive import DriveConfigError, DriveFault

# From the figures of the standard, left is negative: at which edge of which switch home lies, on
# which side of it the index pulse, and which way the axis sets out with the switch open and closed.
PAGE = {
    1: ("negative limit", "right", "left", "right"),
    2: ("positive limit", "left", "right", "left"),
    3: ("left edge", "left", "right", "left"),
    4: ("left edge", "right", "right", "left"),
    5: ("right edge", "right", "left", "right"),
    6: ("right edge", "left", "left", "right"),
    7: ("left edge", "left", "right", "left"),
    8: ("left edge", "right", "right", "left"),
    9: ("right edge", "left", "right", "right"),
    10: ("right edge", "right", "right", "right"),
    11: ("right edge", "right", "left", "right"),
    12: ("right edge", "left", "left", "right"),
    13: ("left edge", "right", "left", "left"),
    14: ("left edge", "left", "left", "left"),
}
SIGN = {"left": -1, "right": 1}
BY_SWITCH = sorted([*PAGE, *(n + 16 for n in PAGE)])


def setting_out(seen: list[DriveFeedback]) -> int:
    """The direction in which the motor is first to turn: 60FCh, in increments."""
    begin = seen[0].demand_internal
    first = next((f.demand_internal for f in seen if f.demand_internal != begin), begin)
    return (first > begin) - (first < begin)


def check_home(seen: list[DriveFeedback], config: DriveConfig, home: int) -> None:
    """6064h is 607Ch at home, and counts from there, to the unit."""
    last = seen[-1]
    assert not seen[0].statusword & (ATTAINED | REACHED | ERROR)  # in the period that starts
    assert last.statusword & (ATTAINED | REACHED | ERROR) == ATTAINED | REACHED
    ratio = (
        Fraction(config.feed, config.feed_shaft)
        * Fraction(config.gear_shaft, config.gear_motor)
        * Fraction(config.encoder_revolutions, config.encoder_increments)
    )
    way = (last.position_internal - home) * ratio * (-1 if config.polarity & 0x80 else 1)
    assert abs(last.position_actual - config.home_offset - way) <= (0 if ratio == 1 else 1)


class Machine:
    """An encoder, and places on its way in increments; place n lies between n - 1 and n."""

    def __init__(self, increments: int, revolutions: int) -> None:
        self.increments, self.revolutions = increments, revolutions
        self.turn = Fraction(increments, revolutions)

    def rev(self, place: int) -> float:
        """The middle of the increment below, in revolutions: no rounding moves it."""
        return float((place - Fraction(1, 2)) / self.turn)

    def pulse(self, place: int, direction: int) -> int:
        """The first index pulse beyond a place."""
        k = floor(place / self.turn) + direction * 2
        while direction * (ceil((k - direction) * self.turn) - place) > 0:
            k -= direction
        return ceil(k * self.turn)


@st.composite
def machines(draw: st.DrawFn) -> tuple[Machine, dict[str, object]]:
    """Resolutions, units, polarity, speeds and ramps."""
    machine = Machine(draw(st.sampled_from([2000, 10_000, 65_536, 1 << 20, 1_000_003])), 1)
    machine = Machine(machine.increments, draw(st.sampled_from([1, 1, 2, 3, 7])))
    unit: dict[str, int] = {"feed": machine.increments, "feed_shaft": machine.revolutions}
    if draw(st.booleans()):  # 36 000 or 10 000 units a turn of the shaft behind a gear
        unit = {
            "feed": draw(st.sampled_from([36_000, 10_000, 360])),
            "gear_motor": draw(st.sampled_from([1, 5, 101])),
            "gear_shaft": draw(st.sampled_from([1, 3])),
        }
    per_turn = Fraction(unit["feed"], unit.get("feed_shaft", 1)) * Fraction(
        unit.get("gear_shaft", 1), unit.get("gear_motor", 1)
    )

    def units(low: float, high: float) -> int:
        return max(1, round(draw(st.floats(low, high)) * per_turn))

    return machine, {
        "encoder_increments": machine.increments,
        "encoder_revolutions": machine.revolutions,
        **unit,
        "polarity": draw(st.sampled_from([0, 0x80, 0x40, 0xC0, 0xE0])),
        "home_offset": draw(st.integers(-5000, 5000)),
        "homing_speed_switch": units(1.0, 12.0),
        "homing_speed_zero": units(0.5, 3.0),
        "homing_acceleration": units(10.0, 400.0),
        "following_window": 0xFFFFFFFF,
    }


@settings(max_examples=90, deadline=None)
@given(
    setting=machines(),
    method=st.sampled_from(BY_SWITCH),
    ways=st.lists(st.floats(0.001, 1.6), min_size=3, max_size=3),
    start=st.floats(-0.1, 1.1),
)
def test_home_is_where_the_page_of_the_method_has_it(
    setting: tuple[Machine, dict[str, object]], method: int, ways: list[float], start: float
) -> None:
    """From any place, at any speed, in any unit: the edge, or the pulse beside it, exactly."""
    machine, fields = setting
    turn = float(machine.turn)
    width = [max(3, round(way * turn)) for way in ways]
    negative = -round(start * sum(width))  # the motor starts at 0
    left, right = negative + width[0], negative + width[0] + width[1]
    positive = right + width[2]
    edge_name, side, out_open, out_closed = PAGE[method if method < 17 else method - 16]
    place = {
        "negative limit": negative,
        "positive limit": positive,
        "left edge": left,
        "right edge": right,
    }[edge_name]
    endless = method % 16 in (3, 4, 5, 6)  # closed up to the end of the way
    config = DriveConfig(
        homing_method=method,
        switch_negative_rev=machine.rev(negative),
        switch_positive_rev=machine.rev(positive),
        switch_home_rev=-1e9 if endless and edge_name == "right edge" else machine.rev(left),
        switch_home_end_rev=1e9 if endless and edge_name == "left edge" else machine.rev(right),
        **fields,  # type: ignore[arg-type]
    )
    closed = {
        "negative limit": negative > 0,
        "positive limit": positive <= 0,
        "left edge": left <= 0 and (endless or right > 0),
        "right edge": right > 0 and (endless or left <= 0),
    }[edge_name]
    seen = home_of(Drive(config))
    home = place if method >= 17 else machine.pulse(place, SIGN[side])
    if method < 17:  # a pulse on the edge itself is on either side; one behind a limit is none
        assume(machine.pulse(place - SIGN[side], SIGN[side]) != place)
        period = config.period_s * 13.0 * turn
        assume(min(abs(home - negative), abs(home - positive)) > period)
        if not negative < home < positive:
            assert seen[-1].statusword & (ATTAINED | ERROR) == ERROR
            return
    check_home(seen, config, home)
    if negative <= 0 < positive:  # else a limit switch turns it back at once
        assert setting_out(seen) == SIGN[out_closed if closed else out_open]


@settings(max_examples=40, deadline=None)
@given(setting=machines(), method=st.sampled_from([33, 34]), turned=st.floats(-2.0, 2.0))
@example(
    setting=(
        Machine(2000, 1),
        {
            "encoder_increments": 2000,
            "feed": 360,
            "gear_shaft": 3,
            "homing_speed_switch": 1080,
            "homing_speed_zero": 1838,
            "homing_acceleration": 372482,
            "following_window": 0xFFFFFFFF,
        },
    ),
    method=33,
    turned=1.01953125,
)
def test_home_is_the_next_index_pulse(
    setting: tuple[Machine, dict[str, object]], method: int, turned: float
) -> None:
    """Methods 33 (left) and 34 (right), from anywhere in a turn; then a second time."""
    machine, fields = setting
    config = DriveConfig(homing_method=method, **fields)  # type: ignore[arg-type]
    drive = Drive(config)
    drive.c_drive.servo.encoder = drive.c_drive.actual.increments = round(turned * machine.turn)
    for _ in range(2):
        drive.enable(mode=Mode.HOMING)
        for _ in range(
            200
        ):  # what the search before has left comes to rest: else it sets out first
            at = drive.cycle(0x0F, mode=Mode.HOMING).position_internal
        home = machine.pulse(at, 1) if method == 34 else machine.pulse(at + 1, -1)
        seen = search(drive)
        if home != at:  # else it is there already
            assert setting_out(seen) == (1 if method == 34 else -1)
        check_home(seen, config, home)


@settings(max_examples=30, deadline=None)
@given(
    setting=machines(),
    method=st.sampled_from([-1, -2, -3, -4]),
    way=st.floats(0.05, 3.0),
    inertia=st.floats(0.0, 20.0),
    torque=st.integers(150, 1000),
)
def test_a_hard_stop_is_found_by_the_torque_it_takes(
    setting: tuple[Machine, dict[str, object]], method: int, way: float, inertia: float, torque: int
) -> None:
    """-1 and -3 to the right, -2 and -4 to the left; -1 and -2 back to the first index pulse."""
    machine, fields = setting
    right = method in (-1, -3)
    stop = round(way * machine.turn) * (1 if right else -1)
    at = float((stop + Fraction(1, 4) * (1 if right else -1)) / machine.turn)
    config = DriveConfig(
        homing_method=method,
        load_inertia_ratio=inertia,
        hard_stop_torque=torque,
        max_torque=3500,
        **{"hard_stop_positive_rev" if right else "hard_stop_negative_rev": at},
        **fields,  # type: ignore[arg-type]
    )
    seen = home_of(Drive(config))
    # from the page: the loop's answer to one increment in one inner step, by the share that the
    # velocity filter lets through, is not to be above half of the torque that tells
    inner = config.period_s / ceil(config.period_s * config.inner_rate_hz)
    speed = (
        2.0 * math.pi / machine.turn / inner * (1.0 - math.exp(-inner / config.velocity_filter_s))
    )
    gain = 2.0 * math.pi * config.velocity_bandwidth_hz * config.inertia_kg_m2 * (1.0 + inertia)
    if gain * speed > torque * 1e-3 * config.rated_torque_nm / 2.0:
        assert seen[-1].statusword & (ATTAINED | ERROR) == ERROR
        assert {f.position_internal for f in seen} == {0}
        return
    assert setting_out(seen) == (1 if right else -1)
    home = stop
    if method == -1:
        home = machine.pulse(stop + 1, -1)
    elif method == -2:
        home = machine.pulse(stop, 1)
    check_home(seen, config, home)
    ends = [f.position_internal for f in seen]
    assert (max(ends) if right else min(ends)) == stop  # nothing goes through
    until = ends.index(stop)
    assert all(abs(f.torque_demand) <= torque + 1 for f in seen[:until])


@pytest.mark.parametrize("method", [7, 10, 11, 14, 23, 26, 27, 30])
def test_a_switch_between_two_periods_is_seen(method: int) -> None:
    """A cam of one increment, passed at 3000 increments a period."""
    machine = Machine(1 << 20, 1)
    config = DriveConfig(
        encoder_increments=1 << 20,
        feed=1 << 20,
        homing_method=method,
        homing_speed_switch=3 << 20,
        homing_speed_zero=1 << 19,
        homing_acceleration=100 << 20,
        switch_home_rev=machine.rev(500_000),
        switch_home_end_rev=machine.rev(500_001),
        switch_negative_rev=-0.8,
        switch_positive_rev=1.4,
    )
    edge_name, side, *_ = PAGE[method if method < 17 else method - 16]
    place = 500_000 if edge_name == "left edge" else 500_001
    home = place if method >= 17 else machine.pulse(place, SIGN[side])
    check_home(home_of(Drive(config)), config, home)


@pytest.mark.parametrize("method", BY_SWITCH)
def test_a_method_without_its_switch_is_an_error(method: int) -> None:
    """Bit 13 in the period after the start, not in it; the next start clears it."""
    drive = Drive(DriveConfig(homing_method=method))
    seen = home_of(drive, 1.0)
    assert not seen[0].statusword & (ATTAINED | REACHED | ERROR)
    assert seen[-1].statusword & (ATTAINED | ERROR) == ERROR
    drive.configure(homing_method=37)
    drive.cycle(0xF, mode=Mode.HOMING)
    assert not drive.cycle(0x1F, mode=Mode.HOMING).statusword & ERROR


@pytest.mark.parametrize("method", [3, 4, 5, 6, 19, 20, 21, 22, 33, 34, -1, -2, -3, -4])
@pytest.mark.parametrize("end", ["switch_negative_rev", "switch_positive_rev"])
def test_a_limit_switch_ends_a_search_that_knows_no_turn(method: int, end: str) -> None:
    """Bit 13 at the switch that lies on the way; the other one is of no concern."""
    right = PAGE.get(method % 16, (0, 0, "right", 0))[2] == "right" if method < 33 else method == 34
    if method < 0:
        right = method in (-1, -3)
    drive = Drive(
        DriveConfig(
            homing_method=method,
            switch_home_rev=1.5 if right else -1e9,
            switch_home_end_rev=1e9 if right else -1.5,
            hard_stop_negative_rev=-1.6 if method < 0 else -1e9,
            hard_stop_positive_rev=1.6 if method < 0 else 1e9,
            homing_speed_switch=3 << 24,
            homing_speed_zero=1 << 24,
            **{end: 0.1 if "negative" in end else 0.4},
        )
    )
    drive.c_drive.servo.encoder = drive.c_drive.actual.increments = round(0.2 * (1 << 24))
    word = home_of(drive)[-1].statusword
    assert bool(word & ERROR) is (right == ("positive" in end))


def test_both_limit_switches_without_a_home_switch_between_them_are_an_error() -> None:
    """Methods 7 to 14 turn at one limit switch, and end at the other."""
    drive = Drive(
        DriveConfig(
            homing_method=23,
            switch_home_rev=50.0,
            switch_home_end_rev=51.0,
            switch_negative_rev=-0.5,
            switch_positive_rev=0.5,
        )
    )
    seen = home_of(drive)
    assert seen[-1].statusword & (ATTAINED | ERROR) == ERROR
    assert {f.digital_inputs & 3 for f in seen} >= {0, 1, 2}


def test_a_reference_is_kept_to_the_method_that_began() -> None:
    """6098h written during a search counts from the next start on."""
    drive = Drive(DriveConfig(homing_method=34))
    drive.enable(mode=Mode.HOMING)
    drive.cycle(0x1F, mode=Mode.HOMING)
    drive.configure(homing_method=37)
    for _ in range(50):
        assert not drive.cycle(0x1F, mode=Mode.HOMING).statusword & ATTAINED


@pytest.mark.parametrize("method", [-5, 15, 16, 31, 32, 36, 38])
def test_reserved_methods_are_refused(method: int) -> None:
    """The field is named, nothing changes."""
    drive = Drive()
    with pytest.raises(DriveConfigError, match="homing_method"):
        drive.configure(homing_method=method)
    assert drive.config.homing_method == 37


def test_hard_stops_have_an_order() -> None:
    """The negative one lies below the positive one."""
    with pytest.raises(DriveConfigError, match="hard_stop_positive_rev"):
        DriveConfig(hard_stop_negative_rev=1.0, hard_stop_positive_rev=1.0)


@pytest.mark.parametrize("mode", [Mode.CSP, Mode.CSV, Mode.CST, Mode.PROFILE_VELOCITY])
@pytest.mark.parametrize("end", [-1, 1])
def test_no_mode_turns_the_motor_through_a_hard_stop(mode: Mode, end: int) -> None:
    """It stands there under torque; a torque that leads away takes it away at once."""
    rev = 1 << 24
    drive = Drive(
        DriveConfig(
            hard_stop_negative_rev=-0.5, hard_stop_positive_rev=0.25, following_window=0xFFFFFFFF
        )
    )
    drive.enable(mode=mode)
    low, high = -rev // 2, rev // 4
    for k in range(2000):
        way = end if k < 1500 else -end
        feedback = drive.cycle(
            0xF,
            way * rev // 1000 * (k if k < 1500 else 3000 - 2 * (k - 1500) - 1500),
            mode=mode,
            target_velocity=way * rev,
            target_torque=way * 100,
        )
        assert low <= feedback.position_internal <= high
        if 1200 < k < 1500:
            assert feedback.position_internal == (high if end > 0 else low)
        if k == 1520 and mode is Mode.CST:
            assert low < feedback.position_internal < high


@settings(max_examples=20, deadline=None)
@given(
    words=st.lists(st.sampled_from([0xF, 0x1F, 0x1F, 0x11F, 0x0B, 0x06]), max_size=30),
    data=st.data(),
)
def test_whatever_interrupts_a_search_the_next_one_finds_home(
    words: list[int], data: st.DataObject
) -> None:
    """Halt, quick stop, bit 4 taken away, a disabled drive, a fault."""
    method = data.draw(st.sampled_from([8, 11, 25, 1, 34, -2]))
    config = DriveConfig(
        homing_method=method,
        switch_home_rev=0.3,
        switch_home_end_rev=0.5,
        switch_negative_rev=-0.4 if method != -2 else -1e9,
        switch_positive_rev=1.4,
        hard_stop_negative_rev=-0.6,
        homing_speed_switch=5 << 24,
        homing_speed_zero=1 << 24,
        homing_acceleration=50 << 24,
    )
    drive = Drive(config)
    drive.enable(mode=Mode.HOMING)
    for word in words:
        for _ in range(data.draw(st.integers(1, 120))):
            feedback = drive.cycle(word, mode=Mode.HOMING)
        if data.draw(st.integers(0, 9)) == 0:
            drive.inject(DriveFault.OVER_TEMPERATURE)
            drive.cycle(word, mode=Mode.HOMING)
            drive.inject(DriveFault.OVER_TEMPERATURE, False)
    for word in (0x0,) * 600 + (0x80, 0x0):  # at rest, and no fault is left
        feedback = drive.cycle(word, mode=Mode.HOMING)
    at = feedback.position_internal
    seen = home_of(drive)
    rev = 1 << 24
    edge = {8: ceil(0.3 * rev), 11: floor(0.5 * rev) + 1, 25: floor(0.5 * rev) + 1}
    home = {
        8: rev,
        11: rev,
        25: edge[25],
        1: 0,
        34: (at // rev + 1) * rev,
        -2: 0,
    }[method]
    check_home(seen, config, home)
