"""The verdict on the stream: a good one is clean, each kind of bad one is named."""

from __future__ import annotations

import math
from collections.abc import Iterable

import pytest

from helpers.streams import back_and_forth
from sjerk.cia402 import Drive, DriveConfig, Finding, Jump, Report, StatusWord

LIMITS = {"v": 40.0, "a": 300.0, "j": 20000.0}
NINETY = {name: 0.9 * value for name, value in LIMITS.items()}


def judge(targets: Iterable[int], period: float = 1e-3, **changes: object) -> tuple[Report, Drive]:
    drive = Drive(
        DriveConfig(
            period_s=period,
            max_profile_velocity=round(LIMITS["v"] * 16777216),
            stream_acceleration_rev_s2=LIMITS["a"],
            stream_jerk_rev_s3=LIMITS["j"],
            **changes,  # type: ignore[arg-type]
        )
    )
    drive.enable()
    drive.clear_report()
    for target in targets:
        feedback = drive.cycle(0xF, target)
        assert feedback.error_code in (0, 0x8612)
        if not drive.report().findings:
            assert not feedback.statusword & StatusWord.WARNING
    return drive.report(), drive


@pytest.mark.parametrize("period", [1e-3, 250e-6])
def test_a_plan_at_ninety_percent_is_clean_for_a_minute(period: float) -> None:
    """60 s of jerk-limited moves at 90 % of the limits: no finding, limits seen."""
    report, _ = judge(back_and_forth(60.0, period, 30.0, **NINETY), period)
    assert report.clean, str(report)
    assert report.velocity_rev_s == pytest.approx(36.0, rel=1e-4)
    assert report.acceleration_rev_s2 == pytest.approx(270.0, rel=1e-3)
    assert 0.7 * 18000 < report.jerk_rev_s3 <= 18000
    assert "no findings" in str(report)


@pytest.mark.parametrize("at", [40, 300, 700])
@pytest.mark.parametrize("period", [1e-3, 250e-6])
def test_one_sample_dropped_is_named_skipped(period: float, at: int) -> None:
    """In a ramp and in the cruise, where it is a jump too: one finding, at the right cycle."""
    stream = list(back_and_forth(1.5, period, 30.0, **NINETY))
    at = round(at * 1e-3 / period)
    del stream[at]
    report, _ = judge(stream, period)
    assert report.findings == {Finding.SKIPPED: 1}
    assert report.first[Finding.SKIPPED] == 6 + at


@pytest.mark.parametrize("at", [40, 300, 700])
@pytest.mark.parametrize("period", [1e-3, 250e-6])
def test_one_sample_doubled_is_named_stale(period: float, at: int) -> None:
    """The same target twice while moving: one finding."""
    stream = list(back_and_forth(1.5, period, 30.0, **NINETY))
    at = round(at * 1e-3 / period)
    stream.insert(at, stream[at])
    report, _ = judge(stream, period)
    assert report.findings == {Finding.STALE: 1}


def test_one_sample_shifted_by_the_jump_limit_is_named_a_jump() -> None:
    """Jump limit + 1 from the target before: a finding and, by default, a fault."""
    stream = list(back_and_forth(1.5, 1e-3, 30.0, **NINETY))
    limit = judge([0])[1].jump_limit
    stream[300] = stream[299] + limit + 1
    report, drive = judge(stream)
    assert report.findings == {Finding.JUMP: 1}
    assert drive.cycle(0xF).error_code == 0x8612
    report, drive = judge(stream, jump_option=Jump.OFF)
    assert report.findings[Finding.JUMP] == 1
    assert drive.cycle(0xF, stream[-1]).error_code == 0


def test_a_trapezoid_is_named_by_its_jerk() -> None:
    """The same move without jerk limit: jerk, and nothing else."""
    trapezoid = dict(NINETY, j=math.inf)
    report, _ = judge(back_and_forth(10.0, 1e-3, 30.0, **trapezoid))
    assert set(report.findings) == {Finding.JERK}


def test_a_faster_move_is_named_by_its_velocity_and_acceleration() -> None:
    """Limits passed by a tenth have their names."""
    fast = {"v": 42.0, "a": 270.0, "j": 18000.0}
    assert set(judge(back_and_forth(3.0, 1e-3, 30.0, **fast))[0].findings) == {Finding.VELOCITY}
    steep = {"v": 36.0, "a": 330.0, "j": 18000.0}
    assert set(judge(back_and_forth(3.0, 1e-3, 30.0, **steep))[0].findings) == {
        Finding.ACCELERATION
    }


def test_a_step_in_velocity_is_named() -> None:
    """From rest to 5 revolutions per second in one period."""
    report, _ = judge([round(5.0 * 16777.216 * k) for k in range(100)])
    assert report.findings[Finding.STEP] == 1
    assert not set(report.findings) - {Finding.STEP, Finding.JERK}


def test_rounding_to_increments_is_no_finding() -> None:
    """A slow ramp whose targets differ by 0 or 1 increment has no acceleration to speak of."""
    report, _ = judge([k // 3 for k in range(3000)], 250e-6)
    assert report.clean, str(report)


def test_a_new_report_begins_empty() -> None:
    """clear_report() forgets findings and maxima."""
    _, drive = judge([round(5.0 * 16777.216 * k) for k in range(100)])
    drive.clear_report()
    assert drive.report().samples == 0
    assert drive.report().clean


def test_deceleration_has_its_own_limit() -> None:
    """60C5h judges speeding up, 60C6h slowing down."""
    stream = list(back_and_forth(1.5, 1e-3, 8.0, v=8.0, a=100.0, j=5000.0))
    for changes, named in (
        ({"max_acceleration": 120 * 16777216, "max_deceleration": 120 * 16777216}, False),
        ({"max_acceleration": 80 * 16777216, "max_deceleration": 120 * 16777216}, True),
        ({"max_acceleration": 120 * 16777216, "max_deceleration": 80 * 16777216}, True),
    ):
        report, _ = judge(stream, **changes)
        assert (Finding.ACCELERATION in report.findings) is named
