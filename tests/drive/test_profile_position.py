"""The way to a set-point in mode 1: linear, rotary by 60F2h, always within 607Dh."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sjerk.cia402 import Drive, DriveConfig, DriveConfigError, DriveFeedback, Mode, StatusWord

REV = 16777216
PP = Mode.PROFILE_POSITION
ACK, REACHED, LIMIT = StatusWord.FOLLOWS, StatusWord.TARGET_REACHED, StatusWord.INTERNAL_LIMIT
NEGATIVE, POSITIVE, SHORTEST = 0x40, 0x80, 0xC0
FAST = DriveConfig(
    profile_velocity=90 * REV,
    profile_acceleration=250 * REV,
    profile_deceleration=250 * REV,
    profile_jerk_rev_s3=1e5,
    following_window=0xFFFFFFFF,
    period_s=4e-3,
)
TABLE = FAST.changed(
    feed=3600,
    profile_velocity=50 * 3600,
    profile_acceleration=250 * 3600,
    profile_deceleration=250 * 3600,
    max_profile_velocity=90 * 3600,
    range_min=0,
    range_max=3599,
)


class Axis:
    """A drive in mode 1 and the way its demand has gone, in increments without a wrap."""

    def __init__(self, config: DriveConfig) -> None:
        self.drive = Drive(config)
        self.feedback = self.drive.enable(mode=PP)
        self.way = 0
        self.least = self.most = 0

    def step(self, bits: int = 0, target: int = 0) -> DriveFeedback:
        before = self.feedback.demand_internal
        self.feedback = self.drive.cycle(0xF | bits, target, mode=PP)
        self.way += (self.feedback.demand_internal - before + 2**31) % 2**32 - 2**31
        self.least, self.most = min(self.least, self.way), max(self.most, self.way)
        return self.feedback

    def offer(self, target: int, bits: int = 0) -> DriveFeedback:
        """A set-point by bits 4 and 12; the feedback of the period that took it."""
        taken = self.step(0x10 | bits, target)
        assert taken.statusword & ACK
        self.step(bits)
        return taken

    def rest(self, seconds: float = 20.0) -> None:
        """Until the demand stands; a set-point is not shown as reached before."""
        still = 0
        for _ in range(round(seconds / self.drive.config.period_s)):
            before = self.way
            self.step()
            still = still + 1 if self.way == before else 0
            if still == 5:
                return
        raise AssertionError("does not come to rest")

    def go(self, target: int, bits: int = 0) -> int:
        """The way of one set-point, in increments."""
        before = self.way
        self.offer(target, bits)
        self.rest()
        return self.way - before


def test_a_set_point_on_the_other_side_is_gone_to_through_zero() -> None:
    """607Bh = default: from +100 to -100 revolutions the motor turns -200."""
    axis = Axis(FAST)
    assert axis.go(100 * REV) == 100 * REV
    assert axis.go(-100 * REV) == -200 * REV
    assert axis.feedback.position_demand == -100 * REV


@pytest.mark.parametrize("feed", [7, 36, 3600])
def test_a_move_in_coarse_units_ends_without_a_step(feed: int) -> None:
    """The demand goes to the middle of its unit along the plan, from anywhere in its own unit."""
    axis = Axis(
        DriveConfig(
            feed=feed,
            profile_velocity=10 * feed,
            profile_acceleration=100 * feed,
            profile_deceleration=100 * feed,
            following_window=0xFFFFFFFF,
        )
    )
    for goal in (2 * feed + 1, -feed, feed // 2):
        ways, before = [], axis.way
        axis.offer(goal)
        for _ in range(1500):
            axis.step()
            ways.append(axis.way)
        assert axis.way == pytest.approx(goal * REV / feed, abs=1)
        assert axis.way != before
        changes = [c - 2 * b + a for a, b, c in zip(ways, ways[1:], ways[2:], strict=False)]
        assert max(map(abs, changes)) <= 100 * REV * 1e-6 + 3


def test_a_relative_set_point_longer_than_the_range_is_done() -> None:
    """607Bh = one revolution: 2.5 revolutions are 2.5 revolutions, and the word wraps."""
    axis = Axis(TABLE)
    assert axis.go(9000, bits=0x40) == pytest.approx(2.5 * REV, abs=1)
    assert axis.feedback.position_demand == 1800
    assert axis.go(-12600, bits=0x40) == pytest.approx(-3.5 * REV, abs=1)
    assert axis.feedback.position_demand == 0


def test_relative_set_points_add_up_beyond_int32() -> None:
    """Three times 100 revolutions, each taken at once: 300, more than a word of 24 bits holds."""
    axis = Axis(FAST)
    for _ in range(3):
        axis.offer(100 * REV, bits=0x60)
        for _ in range(20):
            axis.step()
    axis.rest()
    assert axis.way == 300 * REV
    assert axis.feedback.position_demand == 300 * REV - 2**32


WORDS = st.integers(0, 3599)


@settings(max_examples=60)
@given(
    option=st.sampled_from((0, NEGATIVE, POSITIVE, SHORTEST)),
    polarity=st.sampled_from((0, 0x80)),
    goals=st.lists(st.tuples(st.booleans(), st.integers(-9000, 9000)), min_size=1, max_size=4),
)
def test_60f2_says_on_which_way(option: int, polarity: int, goals: list[tuple[bool, int]]) -> None:
    """Bits 7, 6: linear, only negative, only positive, the shorter one; words, not motor turns."""
    axis = Axis(TABLE.changed(positioning_option=option, polarity=polarity))
    at = 0
    for relative, goal in goals:
        word = (at + goal if relative else goal) % 3600
        expected = {
            0: goal if relative else word - at,
            NEGATIVE: -((at - word) % 3600),
            POSITIVE: (word - at) % 3600,
            SHORTEST: (word - at + 1800) % 3600 - 1800,
        }[option]
        way = axis.go(goal, bits=0x40 if relative else 0)
        sign = -1 if polarity else 1
        assert way * sign == pytest.approx(expected * REV / 3600, abs=2)
        assert axis.feedback.position_demand == word
        at = word


@settings(max_examples=40)
@given(
    option=st.sampled_from((NEGATIVE, POSITIVE)),
    after=st.integers(1, 250),
    goals=st.tuples(WORDS, WORDS),
)
def test_a_rotary_axis_does_not_turn_back_for_a_set_point_at_once(
    option: int, after: int, goals: tuple[int, int]
) -> None:
    """Too fast to stop there: a turn more instead of a way back."""
    axis = Axis(TABLE.changed(positioning_option=option))
    sign = 1 if option == POSITIVE else -1
    axis.offer(goals[0])
    for _ in range(after):
        axis.step()
    axis.offer(goals[1], bits=0x20)
    furthest = 0
    for _ in range(1500):
        axis.step()
        assert axis.way * sign >= furthest - 2
        furthest = max(furthest, axis.way * sign)
    assert axis.feedback.position_demand == goals[1]


@settings(max_examples=60)
@given(
    option=st.sampled_from((0, NEGATIVE, POSITIVE, SHORTEST)),
    polarity=st.sampled_from((0, 0x80)),
    low=st.integers(1, 1700),
    high=st.integers(1900, 3598),
    goals=st.lists(st.tuples(st.booleans(), st.integers(-9000, 9000)), min_size=1, max_size=4),
)
def test_no_way_leaves_the_software_limits(
    option: int, polarity: int, low: int, high: int, goals: list[tuple[bool, int]]
) -> None:
    """607Dh: linear and rotary, absolute and relative; bit 11 where a set-point is held."""
    axis = Axis(TABLE.changed(positioning_option=option, polarity=polarity, home_offset=1800))
    axis.drive.cycle(0xF, mode=Mode.HOMING)
    for _ in range(3):
        axis.drive.cycle(0x1F, mode=Mode.HOMING)
    axis.feedback = axis.drive.cycle(0xF, mode=PP)
    assert axis.feedback.position_actual == 1800
    axis.drive.configure(software_min=low, software_max=high)
    for relative, goal in goals:
        before = axis.feedback.position_demand
        taken = axis.offer(goal, bits=0x40 if relative else 0)
        axis.rest()
        at = axis.feedback.position_demand
        assert low <= at <= high
        asked = (before + goal if relative else goal) % 3600
        if at != asked:
            assert at in (low, high)
            assert taken.statusword & LIMIT
            assert axis.feedback.statusword & LIMIT
    ways = sorted((axis.least, axis.most))
    span = [1800 + way * (-1 if polarity else 1) * 3600 / REV for way in ways]
    assert low - 0.01 <= min(span)
    assert max(span) <= high + 0.01


@pytest.mark.parametrize("option", [3, 4, 0x10, 0x43, 0x100])
def test_60f2_refuses_what_the_drive_does_not_do(option: int) -> None:
    """Bits 2 to 5 and a reserved base."""
    with pytest.raises(DriveConfigError, match="positioning_option"):
        DriveConfig(positioning_option=option)


def test_a_following_error_of_more_than_half_the_range_is_not_taken_for_a_small_one() -> None:
    """607Bh = one revolution: 60F4h = v / Kp, 1.25 revolutions at 50 per second without
    feed-forward.
    """
    axis = Axis(TABLE.changed(velocity_feedforward=0.0, period_s=1e-3))
    axis.offer(100 * 3600, bits=0x40)
    for _ in range(700):
        axis.step()
    assert axis.feedback.following_error == pytest.approx(50 / 40 * 3600, rel=0.01)


@settings(max_examples=40)
@given(
    after=st.integers(0, 120),
    first=st.integers(REV // 10, 5 * REV),
    second=st.integers(-5 * REV, 5 * REV),
)
def test_change_on_set_point_passes_the_first_where_the_way_goes_on(
    after: int, first: int, second: int
) -> None:
    """Bit 9: no stop at the first set-point, which is met; a way back stops there."""
    config = FAST.changed(period_s=1e-3, profile_velocity=10 * REV)
    axis = Axis(config)
    axis.offer(first)
    for _ in range(after):
        axis.step()
    busy = axis.way != first
    axis.step(0x210, first + second)
    way, speeds, ways = axis.way, [], [axis.way]
    for _ in range(4000):
        axis.step()
        speeds.append(axis.way - way)
        ways.append(axis.way)
        way = axis.way
    assert axis.feedback.position_demand == first + second
    largest = max(abs(b - a) for a, b in pairwise(speeds))
    assert largest <= 2 * 250 * REV * 1e-6 + 2 or not busy
    crossing = next((k for k, w in enumerate(ways) if w >= first), None)
    assert crossing is not None
    if second > REV // 2 and busy and ways[0] < first - REV:
        assert speeds[crossing - 1] > 0.5 * REV * 1e-3  # at least half a revolution per second
    if second < 0:
        assert max(ways) <= first + 1


def test_change_on_set_point_keeps_the_profile_velocity() -> None:
    """Set-points in a row, each given in time: the axis goes through them at 6081h."""
    axis = Axis(FAST.changed(period_s=1e-3, profile_velocity=10 * REV))
    axis.offer(4 * REV)
    goal, speeds, way = 4 * REV, [], 0
    for k in range(2500):
        if k % 300 == 200 and goal < 20 * REV:
            goal += 4 * REV
            axis.step(0x210, goal)
        else:
            axis.step(0x200)
        speeds.append((axis.way - way) * 1e3 / REV)
        way = axis.way
    assert axis.way == 20 * REV
    cruise = [v for v, w in zip(speeds, range(2500), strict=True) if 150 <= w <= 1900]
    assert min(cruise) > 9.9
