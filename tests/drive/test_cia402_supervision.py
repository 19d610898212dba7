"""What the drive does with stops, faults, limits and missing SYNCs."""

from __future__ import annotations

import pytest

from sjerk.cia402 import (
    Drive,
    DriveConfig,
    DriveConfigError,
    DriveFault,
    DriveFeedback,
    DriveState,
    StatusWord,
)

REV = 16777216
FOLLOWS, LIMIT = StatusWord.FOLLOWS, StatusWord.INTERNAL_LIMIT


class Runner:
    """A drive that follows a stream of constant velocity, in revolutions per second."""

    def __init__(self, speed: float = 20.0, **changes: object) -> None:
        self.drive = Drive(DriveConfig(**changes))  # type: ignore[arg-type]
        self.feedback = self.drive.enable()
        self.target = float(self.feedback.position_demand)
        self.speed = speed
        self.word = 0xF

    def run(self, periods: int, **words: object) -> DriveFeedback:
        for _ in range(periods):
            self.target += self.speed * REV * self.drive.config.period_s
            self.feedback = self.drive.cycle(self.word, round(self.target), **words)  # type: ignore[arg-type]
        return self.feedback

    def accelerate(self) -> Runner:
        speed = self.speed
        for k in range(200):
            self.speed = speed * (k + 1) / 200
            self.run(1)
        assert self.feedback.follows
        return self


def stop_and_measure(
    runner: Runner, word: int, periods: int = 600
) -> tuple[list[DriveState], float]:
    """States until the motor stands, and the deceleration of the demand in revolutions/s^2."""
    states, speeds = [], []
    runner.word = word
    for _ in range(periods):
        feedback = runner.run(1)
        if not states or states[-1] is not feedback.state:
            states.append(feedback.state)
        assert not feedback.follows
        speeds.append(feedback.velocity_demand / REV)
    return states, (speeds[0] - speeds[1]) / runner.drive.config.period_s


S = DriveState
TORQUE_LIMITED = 3.5 * 1.27 / (2 * 0.486e-4) / 6.283185307179586


@pytest.mark.parametrize(
    ("option", "rate", "states"),
    [
        (0, None, [S.QUICK_STOP_ACTIVE, S.SWITCH_ON_DISABLED]),
        (1, 100.0, [S.QUICK_STOP_ACTIVE, S.SWITCH_ON_DISABLED]),
        (2, 250.0, [S.QUICK_STOP_ACTIVE, S.SWITCH_ON_DISABLED]),
        (3, TORQUE_LIMITED, [S.QUICK_STOP_ACTIVE, S.SWITCH_ON_DISABLED]),
        (4, TORQUE_LIMITED, [S.QUICK_STOP_ACTIVE, S.SWITCH_ON_DISABLED]),
        (5, 100.0, [S.QUICK_STOP_ACTIVE]),
        (6, 250.0, [S.QUICK_STOP_ACTIVE]),
        (7, TORQUE_LIMITED, [S.QUICK_STOP_ACTIVE]),
        (8, TORQUE_LIMITED, [S.QUICK_STOP_ACTIVE]),
    ],
)
def test_quick_stop_by_605a(option: int, rate: float | None, states: list[DriveState]) -> None:
    """At speed: the ramp of the option, bit 12 = 0 throughout, and the state it ends in."""
    runner = Runner(quick_stop_option=option).accelerate()
    seen, deceleration = stop_and_measure(runner, 0x02)
    assert seen == states
    if rate is not None:
        assert deceleration == pytest.approx(rate, rel=2e-3)
    if option >= 5:
        for _ in range(20):
            assert runner.run(1).state is S.QUICK_STOP_ACTIVE  # while 0002 stays
        runner.target, runner.speed, runner.word = runner.feedback.position_actual, 0.0, 0xF
        assert runner.run(1).state is S.OPERATION_ENABLED
        assert runner.drive.transitions == (16,)
        assert runner.run(2).follows


@pytest.mark.parametrize("option", [1, 2, 3, 4])
def test_quick_stop_is_shown_even_at_standstill(option: int) -> None:
    """Quick stop active is reported for a period before transition 12."""
    drive = Drive(DriveConfig(quick_stop_option=option))
    drive.enable()
    assert drive.cycle(0x02).state is S.QUICK_STOP_ACTIVE
    assert drive.cycle(0x02).state is S.SWITCH_ON_DISABLED


@pytest.mark.parametrize("option", [0, 1])
def test_shutdown_and_disable_operation_by_605b_and_605c(option: int) -> None:
    """0 leaves the state at once, 1 first slows down in Operation enabled."""
    for word, target in ((0x06, S.READY_TO_SWITCH_ON), (0x07, S.SWITCHED_ON)):
        runner = Runner(shutdown_option=option, disable_option=option).accelerate()
        states, deceleration = stop_and_measure(runner, word)
        assert states == ([S.OPERATION_ENABLED, target] if option else [target])
        if option:
            assert deceleration == pytest.approx(100.0, rel=1e-3)


@pytest.mark.parametrize(
    ("option", "rate"), [(1, 100.0), (2, 250.0), (3, TORQUE_LIMITED), (4, TORQUE_LIMITED)]
)
def test_halt_by_605d(option: int, rate: float) -> None:
    """Bit 8 slows down, stays enabled, shows standstill in bit 10; released, it follows again."""
    runner = Runner(halt_option=option).accelerate()
    before = runner.feedback.velocity_demand / REV
    runner.word = 0x10F
    feedback = runner.run(1)
    assert not feedback.follows
    assert (before - feedback.velocity_demand / REV) / 1e-3 == pytest.approx(rate, rel=2e-3)
    feedback = runner.run(600)
    assert feedback.state is S.OPERATION_ENABLED
    assert feedback.velocity_demand == 0
    assert feedback.statusword & StatusWord.TARGET_REACHED
    runner.target, runner.speed, runner.word = feedback.position_actual, 0.0, 0xF
    assert not runner.run(1).follows  # the demand becomes the actual position
    assert runner.run(1).follows
    assert runner.feedback.error_code == 0


CODES = {
    DriveFault.OVER_CURRENT: (0x2310, "coast"),
    DriveFault.EARTH: (0x2330, "coast"),
    DriveFault.OVER_VOLTAGE: (0x3210, "coast"),
    DriveFault.UNDER_VOLTAGE: (0x3220, "coast"),
    DriveFault.OVER_TEMPERATURE: (0x4310, "ramp"),
    DriveFault.ENCODER: (0x7305, "coast"),
    DriveFault.SAFE_TORQUE_OFF: (0xFF80, "coast"),
    DriveFault.BRAKE: (0x7110, "ramp"),
    DriveFault.LOST_LINK: (0x8130, "ramp"),
    DriveFault.RPDO_TIMEOUT: (0x8250, "ramp"),
}


@pytest.mark.parametrize("fault", CODES)
def test_a_fault_by_name_has_its_code_and_its_reaction(fault: DriveFault) -> None:
    """603Fh and 1001h tell it; the motor ramps down where it can still be controlled."""
    code, reaction = CODES[fault]
    runner = Runner().accelerate()
    runner.drive.inject(fault)
    feedback = runner.run(1)
    assert feedback.state is S.FAULT_REACTION_ACTIVE
    assert feedback.error_code == code
    assert feedback.error_register & 1
    assert bool(feedback.statusword & StatusWord.VOLTAGE_ENABLED) is (
        fault is not DriveFault.UNDER_VOLTAGE
    )
    feedback = runner.run(5)
    assert (feedback.state is S.FAULT) is (reaction == "coast")
    assert (feedback.torque_actual == 0) is (reaction == "coast")
    feedback = runner.run(1000)
    assert feedback.state is S.FAULT
    runner.word = 0x80
    assert runner.run(1).state is S.FAULT
    runner.drive.inject(fault, False)
    runner.word = 0
    runner.run(1)
    runner.word = 0x80
    assert runner.run(1).state is S.SWITCH_ON_DISABLED
    assert runner.feedback.error_register == 0


@pytest.mark.parametrize(
    ("option", "rate"),
    [(0, None), (1, 100.0), (2, 250.0), (3, TORQUE_LIMITED), (4, TORQUE_LIMITED)],
)
def test_fault_reaction_by_605e(option: int, rate: float | None) -> None:
    """A fault that leaves the motor under control stops it as 605Eh says."""
    runner = Runner(fault_option=option).accelerate()
    runner.drive.inject(DriveFault.OVER_TEMPERATURE)
    states, deceleration = stop_and_measure(runner, 0xF)
    assert states == [S.FAULT_REACTION_ACTIVE, S.FAULT]
    if rate is not None:
        assert deceleration == pytest.approx(rate, rel=2e-3)


def test_an_event_cannot_be_injected() -> None:
    """Following error and the like come from the motion."""
    with pytest.raises(ValueError, match="FOLLOWING_ERROR"):
        Drive().inject(DriveFault.FOLLOWING_ERROR)


@pytest.mark.parametrize(
    ("option", "states"),
    [
        (0, [S.OPERATION_ENABLED]),
        (1, [S.FAULT_REACTION_ACTIVE, S.FAULT]),
        (2, [S.SWITCH_ON_DISABLED]),
        (3, [S.QUICK_STOP_ACTIVE, S.SWITCH_ON_DISABLED]),
    ],
)
@pytest.mark.parametrize("cause", [DriveFault.LOST_LINK, DriveFault.RPDO_TIMEOUT])
def test_a_lost_link_acts_by_6007(option: int, states: list[DriveState], cause: DriveFault) -> None:
    """0 nothing, 1 fault, 2 disable voltage, 3 quick stop."""
    runner = Runner(speed=0.0, abort_option=option)
    runner.drive.inject(cause)
    seen: list[DriveState] = []
    for _ in range(10):
        state = runner.run(1).state
        if state not in seen:
            seen.append(state)
    assert seen == states


def test_safe_torque_off_keeps_a_disabled_drive_disabled_without_a_fault() -> None:
    """No power: transition 2 waits, 60FDh shows the interlock."""
    drive = Drive()
    drive.inject(DriveFault.SAFE_TORQUE_OFF)
    for _ in range(3):
        feedback = drive.cycle(0x06)
    assert feedback.state is S.SWITCH_ON_DISABLED
    assert feedback.digital_inputs == 8
    drive.inject(DriveFault.SAFE_TORQUE_OFF, False)
    assert drive.cycle(0x06).state is S.READY_TO_SWITCH_ON


@pytest.mark.parametrize("time_ms", [0, 5])
def test_following_error_window_and_time_are_sharp(time_ms: int) -> None:
    """|60F4h| = 6065h is inside; one increment more for longer than 6066h is 8611h, bit 13."""
    free = Runner(velocity_feedforward=0.0, following_window=0xFFFFFFFF).accelerate()
    free.run(1000)
    errors = [free.run(1).following_error for _ in range(200)]
    for window, faulted in ((max(errors) + 2, False), (min(errors) - 2, True)):
        runner = Runner(velocity_feedforward=0.0, following_window=0xFFFFFFFF).accelerate()
        runner.run(1000)
        runner.drive.configure(following_window=window, following_time_ms=time_ms)
        feedback = runner.run(time_ms)
        assert feedback.error_code == 0
        feedback = runner.run(1)
        assert (feedback.error_code == 0x8611) is faulted
        assert bool(feedback.statusword & StatusWord.FOLLOWING_ERROR) is faulted
        assert (feedback.state is S.FAULT_REACTION_ACTIVE) is faulted


@pytest.mark.parametrize("k", [1, 3])
def test_missed_syncs_are_bridged_and_then_a_fault(k: int) -> None:
    """K - 1 and k missed SYNCs go by at the last velocity; one more is 8700h."""
    for missed in (k - 1, k, k + 1):
        runner = Runner(sync_extrapolation=k, sync_error_limit=3 * (k + 1)).accelerate()
        runner.run(50)
        for _ in range(missed):
            feedback = runner.run(1, sync_missed=True)
            assert not feedback.statusword & StatusWord.SYNC
            assert feedback.follows is (feedback.state is S.OPERATION_ENABLED)
        if missed <= k:
            if missed:
                assert feedback.position_demand == pytest.approx(runner.target, abs=2)
            feedback = runner.run(20)
            assert feedback.follows
            assert feedback.state is S.OPERATION_ENABLED
            assert runner.drive.report().missed_syncs == missed
            assert not runner.drive.report().findings
        else:
            assert feedback.error_code == 0x8700
            assert feedback.state is S.FAULT_REACTION_ACTIVE


def test_seldom_missed_syncs_are_forgiven_and_frequent_ones_are_not() -> None:
    """+3 for a missed, -1 for a good one: 1 in 4 is held for ever, 1 in 3 is a fault in the end."""
    for spacing, faulted in ((4, False), (3, True)):
        runner = Runner(speed=0.0)
        for k in range(200):
            feedback = runner.run(1, sync_missed=k % spacing == 0)
        assert (feedback.error_code == 0x8700) is faulted


def test_with_the_counter_off_a_lost_master_is_a_stop() -> None:
    """10F1h:2 = FFFFh: after the bridge the axis slows down and waits, without a fault."""
    runner = Runner(sync_error_limit=0xFFFF).accelerate()
    feedback = runner.run(300, sync_missed=True)
    assert feedback.state is S.OPERATION_ENABLED
    assert feedback.velocity_demand == 0
    assert not feedback.follows


def test_software_limits_hold_the_target() -> None:
    """Beyond 607Dh the demand stays at the limit, bit 11 = 1, bit 12 = 0, until it comes back."""
    runner = Runner(speed=0.5, software_min=-REV // 100, software_max=REV // 4)
    feedback = runner.run(2000)
    assert feedback.position_demand == REV // 4
    assert feedback.statusword & LIMIT
    assert not feedback.follows
    runner.speed = -0.5
    feedback = runner.run(2000)
    assert feedback.follows
    assert not feedback.statusword & LIMIT
    feedback = runner.run(1000)
    assert feedback.position_demand == -REV // 100
    assert feedback.error_code == 0


def test_an_axis_outside_its_software_limits_may_come_back() -> None:
    """The limit closer to the inside counts from where the axis is: no jump, no fault."""
    runner = Runner(speed=1.0)
    runner.run(1000)
    runner.drive.configure(software_min=-REV, software_max=REV // 2)
    held = runner.feedback.position_demand
    assert runner.run(10).position_demand == held
    assert runner.feedback.statusword & LIMIT
    runner.speed = -1.0
    feedback = runner.run(200)
    assert feedback.follows
    assert feedback.position_demand == round(runner.target)


def test_a_limit_switch_stops_and_lets_the_axis_away() -> None:
    """60FDh bit 1: the ramp of 605Ah, bit 11, no way on, the way back open."""
    runner = Runner(speed=1.0, switch_positive_rev=0.5)
    feedback = runner.run(700)
    assert feedback.digital_inputs == 2
    assert feedback.statusword & LIMIT
    assert not feedback.follows
    assert feedback.velocity_demand == 0
    assert feedback.state is S.OPERATION_ENABLED
    assert 0.5 * REV < feedback.position_actual < 0.51 * REV
    runner.speed = -1.0
    feedback = runner.run(400)
    assert feedback.follows
    assert feedback.digital_inputs == 0
    assert feedback.error_code == 0


def test_polarity_turns_positions_velocities_and_torques() -> None:
    """607Eh bits 7, 6, 5: the words are the same, the motor turns the other way."""
    plain = Runner(speed=10.0).accelerate()
    turned = Runner(speed=10.0, polarity=0xE0).accelerate()
    a, b = plain.run(100), turned.run(100)
    assert b.position_demand == a.position_demand
    assert b.position_internal == pytest.approx(-a.position_internal, abs=20)
    assert b.velocity_actual == pytest.approx(a.velocity_actual, rel=1e-3)
    assert b.torque_actual == pytest.approx(a.torque_actual, abs=2)


@pytest.mark.parametrize(
    ("gear_motor", "gear_shaft", "feed"),
    [(1, 1, 36000), (50, 1, 360000), (101, 7, 1 << 20), (1, 3, 1 << 26)],
)
def test_gear_and_feed_make_the_unit(gear_motor: int, gear_shaft: int, feed: int) -> None:
    """Pu = increments x feed x shaft / (encoder x motor), both ways, to the nearest."""
    runner = Runner(gear_motor=gear_motor, gear_shaft=gear_shaft, feed=feed, speed=0.0)
    ratio = feed * gear_shaft / (REV * gear_motor)
    step = ratio * 5.0 * REV * 1e-3
    target = 0.0
    for k in range(1000):
        target += step * min(1.0, k / 200, (999 - k) / 200)
        runner.drive.cycle(0xF, round(target))
    for _ in range(1500):
        feedback = runner.drive.cycle(0xF, round(target))
    assert feedback.error_code == 0
    assert feedback.position_demand == round(target)
    assert feedback.demand_internal == pytest.approx(round(target) / ratio, abs=0.51)
    assert feedback.position_internal == pytest.approx(feedback.demand_internal, abs=10)
    assert feedback.position_actual == pytest.approx(feedback.position_internal * ratio, abs=0.51)


def test_a_modulo_axis_takes_the_short_way() -> None:
    """607Bh 0..35999: targets wrap there, the motor turns on."""
    runner = Runner(speed=0.0, feed=36000, range_min=0, range_max=35999)
    for k in range(1, 4001):
        feedback = runner.drive.cycle(0xF, (30 * k) % 36000)
        assert 0 <= feedback.position_actual <= 35999
    assert feedback.error_code == 0
    assert feedback.position_demand == 120000 % 36000
    assert feedback.demand_internal == round(120000 / 36000 * REV)


def test_position_offset_is_added_to_the_target() -> None:
    """60B0h is absolute and wraps with 607Ah."""
    runner = Runner(speed=0.0)
    feedback = runner.run(1, position_offset=1234)
    assert feedback.position_demand == 1234


def test_torque_offset_takes_the_transient_of_an_acceleration_away() -> None:
    """60B2h = J a makes what acceleration feed-forward would, from outside."""
    worst = {}
    for name, feed, offset in (("none", 0.0, 0), ("inside", 1.0, 0), ("60B2h", 0.0, 1)):
        runner = Runner(speed=0.0, acceleration_feedforward=feed)
        inertia = 2 * 0.486e-4
        errors = []
        for k in range(300):
            rate = 100.0 if 50 <= k < 250 else 0.0
            runner.speed += rate * 1e-3
            per_mille = round(inertia * rate * 6.283185307179586 / 1.27 * 1000)
            feedback = runner.run(1, torque_offset=offset * per_mille)
            errors.append(abs(feedback.following_error))
        worst[name] = max(errors)
    assert worst["60B2h"] < 0.4 * worst["none"]
    assert worst["inside"] < 0.4 * worst["none"]


def test_velocity_offset_replaces_feed_forward() -> None:
    """60B1h = the target's velocity takes the following error of a loop without feed-forward."""
    runner = Runner(velocity_feedforward=0.0, following_window=0xFFFFFFFF).accelerate()
    runner.run(1000)
    without = runner.feedback.following_error
    feedback = runner.run(1000, velocity_offset=20 * REV)
    assert without == pytest.approx(20 * REV / 40, rel=1e-4)
    assert abs(feedback.following_error) < 1e-4 * without


@pytest.mark.parametrize("name", ["max_torque", "torque_limit_positive"])
def test_torque_limits_hold_and_are_shown(name: str) -> None:
    """6072h, 60E0h: the torque stays inside, bit 11 = 1 while it does."""
    runner = Runner(speed=0.0, following_window=0xFFFFFFFF, **{name: 100})
    peak, limited = 0, False
    for _ in range(100):
        runner.speed += 0.3
        feedback = runner.run(1)
        peak = max(peak, feedback.torque_demand)
        limited |= bool(feedback.statusword & LIMIT)
    assert peak == 100
    assert limited


def test_the_negative_torque_limit_is_its_own() -> None:
    """60E1h holds braking and backward torque only."""
    runner = Runner(speed=0.0, following_window=0xFFFFFFFF, torque_limit_negative=60)
    peaks = [0, 0]
    for k in range(200):
        runner.speed += 0.3 if k < 100 else -0.3
        torque = runner.run(1).torque_demand
        peaks = [min(peaks[0], torque), max(peaks[1], torque)]
    assert peaks[0] == -60
    assert peaks[1] > 120


def test_a_jump_may_be_clamped() -> None:
    """Jump option clamp: the demand goes at the limit, bit 11, until it has caught up."""
    runner = Runner(speed=0.0, jump_option=1, following_window=0xFFFFFFFF)
    limit = runner.drive.jump_limit
    feedback = runner.drive.cycle(0xF, 3 * limit - 5)
    assert feedback.position_demand == limit
    assert feedback.statusword & LIMIT
    assert not feedback.follows
    runner.drive.cycle(0xF, 3 * limit - 5)
    feedback = runner.drive.cycle(0xF, 3 * limit - 5)
    assert feedback.position_demand == 3 * limit - 5
    assert feedback.follows


def test_a_closed_brake_holds_a_hanging_load() -> None:
    """With a load torque the axis falls when power goes, unless it has a brake."""
    for brake, falls in ((0.0, True), (2.0, False)):
        runner = Runner(speed=0.0, load_torque_nm=0.5, brake_torque_nm=brake)
        start = runner.run(1000).position_actual
        runner.word = 0
        moved = runner.run(200).position_actual - start
        assert (moved < -REV) is falls
        assert (abs(moved) < REV // 1000) is not falls


def test_scaling_at_run_time_tells_the_position_anew() -> None:
    """A new feed changes the unit, not the axis."""
    runner = Runner(speed=1.0)
    runner.run(500)
    runner.word = 0
    before = runner.run(500).position_internal
    runner.drive.configure(feed=360000)
    feedback = runner.run(1)
    assert feedback.position_actual == pytest.approx(before * 360000 / REV, abs=2)


@pytest.mark.parametrize(
    "changes",
    [
        {"feed": 4294967291, "gear_motor": 4294967279},
        {"friction_nm": 100.0},
        {"homing_method": 15},
        {"switch_negative_rev": 2.0, "switch_positive_rev": 1.0},
        {"max_speed_rpm": 1e5, "encoder_increments": 2**30, "period_s": 0.1},
    ],
)
def test_fields_that_do_not_fit_each_other_are_refused(changes: dict[str, float]) -> None:
    """Each inside its own range, together impossible."""
    with pytest.raises(DriveConfigError, match="does not fit"):
        DriveConfig(**changes)  # type: ignore[arg-type]


def test_an_output_closes_the_brake_by_hand() -> None:
    """60FEh bit 0 counts only with its mask: the motor then works against the brake."""
    for mask, held in ((0, False), (1, True)):
        runner = Runner(speed=0.0, brake_torque_nm=3.0, following_window=0xFFFFFFFF)
        runner.run(10)
        runner.speed = 0.2
        feedback = runner.run(200, digital_outputs=1, output_mask=mask)
        assert (feedback.position_actual < REV // 1000) is held
