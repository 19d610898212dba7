"""Profile position and profile velocity: planned by sjerk's planner, executed by the drive."""

from __future__ import annotations

from itertools import pairwise

import pytest

from sjerk.cia402 import Drive, DriveConfig, DriveFeedback, Mode, StatusWord

REV = 16777216
ACK, REACHED, LIMIT = StatusWord.FOLLOWS, StatusWord.TARGET_REACHED, StatusWord.INTERNAL_LIMIT
PP, PV = Mode.PROFILE_POSITION, Mode.PROFILE_VELOCITY
CONFIG = DriveConfig(
    profile_velocity=10 * REV,
    profile_acceleration=100 * REV,
    profile_deceleration=50 * REV,
    profile_jerk_rev_s3=5000.0,
)


class Positioner:
    """A drive in mode 1, and all demands it had."""

    def __init__(self, config: DriveConfig = CONFIG) -> None:
        self.drive = Drive(config)
        self.feedback = self.drive.enable(mode=PP)
        self.demands: list[int] = []

    def step(self, bits: int = 0, target: int = 0) -> DriveFeedback:
        self.feedback = self.drive.cycle(0xF | bits, target, mode=PP)
        self.demands.append(self.feedback.demand_internal)
        return self.feedback

    def go(self, target: int, bits: int = 0) -> None:
        """Offer a set-point until it is taken, then let bit 4 fall."""
        for _ in range(5):
            if self.step(0x10 | bits, target).statusword & ACK:
                self.step(bits, target)
                return
        raise AssertionError("not acknowledged")

    def until_reached(self, periods: int = 10_000) -> int:
        for k in range(periods):
            if self.step().statusword & REACHED:
                return k
        raise AssertionError(f"not reached: {self.feedback}")


def check_limits(demands: list[int], config: DriveConfig = CONFIG) -> None:
    """The demand keeps velocity, acceleration and jerk, to the rounding of its increments."""
    period = config.period_s
    v = [b - a for a, b in pairwise(demands)]
    a = [y - x for x, y in pairwise(v)]
    j = [y - x for x, y in pairwise(a)]
    assert max(map(abs, v)) <= config.profile_velocity * period + 1
    assert max(map(abs, a)) <= 100 * REV * period**2 + 2
    assert max(map(abs, j)) <= 5000 * REV * period**3 + 4


def test_a_set_point_is_acknowledged_and_reached() -> None:
    """Bit 4 up: bit 12; bit 4 down: bit 12 falls; bit 10 at the goal, exactly."""
    axis = Positioner()
    assert not axis.feedback.statusword & (ACK | REACHED)
    axis.go(5 * REV + 1)
    assert not axis.feedback.statusword & ACK
    axis.until_reached()
    # 5 revolutions at 10 /s with ramps of 0.1 and 0.2 s and their jerk phases of 20 and 10 ms
    seconds = axis.demands.index(5 * REV + 1) * 1e-3
    assert seconds == pytest.approx(0.5 + 0.15 + 0.015, abs=0.01)
    assert axis.feedback.position_demand == 5 * REV + 1
    assert abs(axis.feedback.following_error) <= 10
    check_limits(axis.demands)


def test_a_relative_set_point_counts_from_the_one_before() -> None:
    """Bit 6: the sum of the set-points, not of where the axis was."""
    axis = Positioner()
    for _ in range(3):
        axis.go(REV // 3, bits=0x40)
        axis.until_reached()
    assert axis.feedback.position_demand == 3 * (REV // 3)


def test_a_second_set_point_waits_for_the_first() -> None:
    """Bit 5 = 0: taken, bit 12 stays until it begins, and the axis stops between."""
    axis = Positioner()
    axis.go(2 * REV)
    for _ in range(50):
        axis.step()
    assert axis.step(0x10, REV).statusword & ACK
    assert axis.step().statusword & ACK
    turning = 0
    while axis.step().statusword & ACK:
        turning = max(turning, axis.feedback.position_demand)
    axis.until_reached()
    assert turning == 2 * REV
    assert axis.feedback.position_demand == REV
    check_limits(axis.demands)


@pytest.mark.parametrize("at", [3, 40, 90, 200, 400, 500])
@pytest.mark.parametrize("goal", [-REV, 0, 3 * REV, 20 * REV])
def test_a_set_point_can_change_at_once(at: int, goal: int) -> None:
    """Bit 5 = 1, at any moment of a move: within the limits, without a step, to the new goal."""
    axis = Positioner()
    axis.go(5 * REV)
    for _ in range(at):
        axis.step()
    axis.go(goal, bits=0x20)
    axis.until_reached()
    assert axis.feedback.position_demand == goal
    check_limits(axis.demands)


@pytest.mark.parametrize("held", [10, 400])
def test_a_set_point_is_kept_under_halt(held: int) -> None:
    """Bit 8 slows down, bit 10 shows standstill; released, also in mid-ramp, the move goes on."""
    axis = Positioner()
    axis.go(20 * REV)
    for _ in range(300):
        axis.step()
    for _ in range(held):
        feedback = axis.step(0x100)
    stands = held == 400
    assert (feedback.velocity_demand == 0) is stands
    assert bool(feedback.statusword & REACHED) is stands
    axis.until_reached()
    assert axis.feedback.position_demand == 20 * REV


def test_a_set_point_given_under_halt_is_taken_and_begins_when_halt_ends() -> None:
    """Bit 12 answers under halt; at once with bit 5, behind the first one without."""
    for bits, turning in ((0x20, -REV), (0, 20 * REV)):
        axis = Positioner()
        axis.go(20 * REV)
        for _ in range(300):
            axis.step()
        for _ in range(400):
            axis.step(0x100)
        stood = axis.feedback.position_demand
        assert axis.step(0x110 | bits, -REV).statusword & ACK
        for _ in range(50):
            assert axis.step(0x100).position_demand == stood
        furthest = stood
        for _ in range(8000):
            furthest = max(furthest, axis.step().position_demand)
        assert axis.feedback.position_demand == -REV
        assert axis.feedback.statusword & REACHED
        assert furthest == max(stood, turning)


def test_software_limits_hold_a_set_point() -> None:
    """Beyond 607Dh: the move ends at the limit, bit 11 when it is taken."""
    axis = Positioner(CONFIG.changed(software_min=-REV, software_max=REV))
    assert axis.step(0x10, 5 * REV).statusword & LIMIT
    axis.until_reached()
    assert axis.feedback.position_demand == REV


def test_a_limit_switch_ends_a_move() -> None:
    """Bit 11, standing past the switch; a set-point back is obeyed."""
    axis = Positioner(CONFIG.changed(switch_positive_rev=2.0))
    axis.go(10 * REV)
    for _ in range(1000):
        axis.step()
    assert axis.feedback.velocity_demand == 0
    assert 2 * REV < axis.feedback.position_actual < 3 * REV
    axis.go(0)
    axis.until_reached()
    assert axis.feedback.digital_inputs == 0


@pytest.mark.parametrize(
    "scale",
    [{"feed": 36000}, {"gear_motor": 50, "feed": 360000}, {"polarity": 0xC0}],
)
def test_set_points_are_in_user_units(scale: dict[str, int]) -> None:
    """Gear, feed and polarity hold in mode 1 as in CSP."""
    units = scale.get("feed", REV) / scale.get("gear_motor", 1)
    axis = Positioner(
        CONFIG.changed(
            **scale,
            profile_velocity=round(10 * units),
            profile_acceleration=round(100 * units),
            profile_deceleration=round(50 * units),
        )
    )
    goal = round(3.3 * units)
    axis.go(goal)
    axis.until_reached()
    assert axis.feedback.position_demand == goal
    turns = axis.feedback.demand_internal / REV
    assert turns == pytest.approx(-3.3 if "polarity" in scale else 3.3, rel=1e-4)


def test_profile_velocity_goes_to_its_target() -> None:
    """60FFh: bit 12 while it stands, bit 10 at the speed, jerk-limited on the way, also back."""
    drive = Drive(CONFIG.changed(profile_velocity=1 << 31))
    feedback = drive.enable(mode=PV)
    assert feedback.statusword & ACK
    demands = []
    for target, periods in ((20 * REV, 600), (-5 * REV, 900), (0, 400)):
        for _ in range(periods):
            feedback = drive.cycle(0xF, mode=PV, target_velocity=target)
            demands.append(feedback.demand_internal)
        assert feedback.velocity_demand == target
        assert feedback.statusword & REACHED
    assert feedback.statusword & ACK
    check_limits(demands, CONFIG.changed(profile_velocity=20 * REV))


def test_profile_velocity_comes_back_after_halt() -> None:
    """Bit 8 stops, released it accelerates again."""
    drive = Drive(CONFIG)
    drive.enable(mode=PV)
    for word, speed in ((0xF, 10 * REV), (0x10F, 0), (0xF, 10 * REV)):
        for _ in range(600):
            feedback = drive.cycle(word, mode=PV, target_velocity=10 * REV)
        assert feedback.velocity_demand == speed


def test_a_mode_change_into_a_profile_while_running_is_smooth() -> None:
    """From CSP at 5 revolutions per second into mode 3 at 8 and mode 1 to a goal."""
    drive = Drive(CONFIG)
    target = float(drive.enable().position_demand)
    for k in range(500):
        target += 5 * REV * 1e-3 * min(1.0, k / 300)
        feedback = drive.cycle(0xF, round(target))
    for _ in range(300):
        before = feedback
        feedback = drive.cycle(0xF, mode=PV, target_velocity=8 * REV)
        assert feedback.velocity_demand - before.velocity_demand < 0.2 * REV
    assert feedback.velocity_demand == 8 * REV
    drive.cycle(0xF, mode=PP)
    drive.cycle(0x1F, 30 * REV, mode=PP)
    for _ in range(6000):
        feedback = drive.cycle(0xF, mode=PP)
    assert feedback.position_demand == 30 * REV
    assert feedback.error_code == 0


@pytest.mark.parametrize(("option", "base"), [(0, 2 * REV), (1, "demand"), (2, "actual")])
def test_60f2_says_what_a_relative_set_point_counts_from(option: int, base: int | str) -> None:
    """In the middle of a move: the target before, the demand, or the actual position."""
    axis = Positioner(CONFIG.changed(positioning_option=option))
    axis.go(2 * REV)
    for _ in range(200):
        before = axis.step()
    from_ = {"demand": before.position_demand, "actual": before.position_actual}.get(
        str(base), base
    )
    axis.step(0x70, REV)
    axis.until_reached()
    assert axis.feedback.position_demand == from_ + REV


def test_the_velocity_window_and_threshold_have_their_times() -> None:
    """606Dh for 606Eh before bit 10 rises, 606Fh for 6070h before bit 12 falls."""
    seen = {}
    for time_ms in (0, 50):
        drive = Drive(CONFIG.changed(velocity_time_ms=time_ms, threshold_time_ms=time_ms))
        drive.enable(mode=PV)
        words = [drive.cycle(0xF, mode=PV, target_velocity=5 * REV).statusword for _ in range(600)]
        seen[time_ms] = (
            next(k for k, word in enumerate(words) if word & REACHED),
            next(k for k, word in enumerate(words) if not word & ACK),
        )
    assert seen[50][0] - seen[0][0] >= 49
    assert seen[50][1] - seen[0][1] == 50
