"""Bit 10 rises once: the window 6067h, its time 6068h, and where the limits 607Dh begin."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sjerk.cia402 import Drive, DriveConfig, Mode, StatusWord

REV = 16777216
PP = Mode.PROFILE_POSITION
REACHED, LIMIT = StatusWord.TARGET_REACHED, StatusWord.INTERNAL_LIMIT


def edges(words: list[int]) -> tuple[int, int]:
    """How often bit 10 rose and fell."""
    shown = [bool(word & REACHED) for word in words]
    return (
        sum(b and not a for a, b in pairwise(shown)),
        sum(a and not b for a, b in pairwise(shown)),
    )


@settings(max_examples=40)
@given(
    speed=st.floats(0.1, 60.0),
    acceleration=st.floats(10.0, 250.0),
    distance=st.floats(-3.0, 3.0),
    feedforward=st.sampled_from((0.0, 0.5, 1.0)),
    load=st.floats(0.0, 8.0),
    torque=st.sampled_from((0.0, 0.2)),
    friction=st.sampled_from((0.0, 0.04)),
)
def test_bit_10_of_profile_position_rises_once_by_default(
    speed: float,
    acceleration: float,
    distance: float,
    feedforward: float,
    load: float,
    torque: float,
    friction: float,
) -> None:
    """Through the window by overshoot is not in the window: 6068h of the default outlasts it."""
    config = DriveConfig(
        profile_velocity=round(speed * REV),
        profile_acceleration=round(acceleration * REV),
        profile_deceleration=round(acceleration * REV),
        velocity_feedforward=feedforward,
        load_inertia_ratio=load,
        load_torque_nm=torque,
        friction_nm=friction,
        following_window=0xFFFFFFFF,
    )
    drive = Drive(config)
    drive.enable(mode=PP)
    for _ in range(600):
        drive.cycle(0xF, mode=PP)
    words = [int(drive.cycle(0x1F, round(distance * REV), mode=PP).statusword)]
    seconds = 3.0 + abs(distance) / speed + speed / acceleration
    words += [int(drive.cycle(0xF, mode=PP).statusword) for _ in range(round(seconds * 1e3))]
    rises, falls = edges(words)
    assert (rises, falls) == (1, 0)


@pytest.mark.parametrize("time_ms", [0, 1, 20, 300])
@pytest.mark.parametrize("mode", [PP, Mode.CSP])
def test_bit_10_comes_6068h_after_the_window_is_entered(mode: Mode, time_ms: int) -> None:
    """The timer runs inside 6067h of a target that stands, and begins anew when it is left."""
    config = DriveConfig(position_window=1000, position_time_ms=time_ms, velocity_feedforward=0.0)
    drive = Drive(config)
    drive.enable(mode=mode)
    goal = REV // 50
    inside, seen = 0, False
    for k in range(1200):
        word = 0x1F if mode is PP and k == 0 else 0xF
        target = min(goal, (k + 1) * goal // 40) if mode is Mode.CSP else goal
        feedback = drive.cycle(word, target, mode=mode)
        stands = feedback.position_demand == goal and feedback.velocity_demand == 0
        inside = inside + 1 if stands and abs(feedback.position_actual - goal) <= 1000 else 0
        expected = inside > 0 and inside >= time_ms
        assert bool(feedback.statusword & REACHED) is expected
        seen |= expected
    assert seen


def test_bit_10_of_csp_does_not_flicker_in_motion() -> None:
    """With feed-forward the axis is in the window all the time: reached is a target that stands."""
    drive = Drive(DriveConfig(position_time_ms=0))
    target = drive.enable().position_demand
    for k in range(1500):
        target += round(REV * 1e-3 * min(1.0, (k + 1) / 300))
        assert not drive.cycle(0xF, target).statusword & REACHED


@settings(max_examples=40)
@given(
    offset=st.integers(-2000, 2000),
    from_home=st.booleans(),
    goal=st.integers(-6000, 6000),
    polarity=st.sampled_from((0, 0x80)),
)
def test_software_limits_count_from_the_machine_where_that_is_chosen(
    offset: int, from_home: bool, goal: int, polarity: int
) -> None:
    """2100h:8 = 1: 607Dh less 607Ch is compared with the target (CiA 402); 0: 607Dh itself."""
    drive = Drive(
        DriveConfig(
            feed=3600,
            polarity=polarity,
            home_offset=offset,
            software_min=-2500,
            software_max=3000,
            software_from_home=int(from_home),
            max_profile_velocity=3600 * 90,
            profile_velocity=3600 * 50,
            profile_acceleration=3600 * 250,
            profile_deceleration=3600 * 250,
        )
    )
    drive.enable(mode=PP)
    taken = drive.cycle(0x1F, goal, mode=PP)
    for _ in range(1000):
        feedback = drive.cycle(0xF, mode=PP)
    home = offset if from_home else 0
    low, high = min(0, -2500 - home), max(0, 3000 - home)
    expected = min(max(goal, low), high)
    assert feedback.position_demand == expected
    assert bool(taken.statusword & LIMIT) is (expected != goal)


@pytest.mark.parametrize("polarity", [0, 0x80])
def test_csp_does_not_go_the_short_way_through_a_forbidden_range(polarity: int) -> None:
    """607Bh 0..3599 and 607Dh 100..3500: from 3500 to 100 is no step of 200 across the wrap."""
    drive = Drive(
        DriveConfig(
            feed=3600,
            range_min=0,
            range_max=3599,
            polarity=polarity,
            jump_option=2,
            following_window=0xFFFFFFFF,
        )
    )
    target = drive.enable().position_demand
    for _ in range(700):
        target = (target - 1) % 3600  # the short way down to 2900
        drive.cycle(0xF, target)
    drive.configure(software_min=100, software_max=3500)
    for _ in range(600):
        target += 1
        drive.cycle(0xF, target)
    assert drive.cycle(0xF, target).position_demand == 3500
    for _ in range(10):
        feedback = drive.cycle(0xF, 100)
    assert feedback.position_demand == 3500
    assert feedback.statusword & LIMIT
    assert not feedback.follows
