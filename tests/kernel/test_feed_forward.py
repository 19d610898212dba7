"""60B1h and 60B2h: exact in every motion, refused where they cannot be, good for the motor."""

from __future__ import annotations

import contextlib
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.forward_check import check
from helpers.strategies import limits, units
from sjerk import (
    Axis,
    Host,
    InputError,
    Limits,
    MotionKernel,
    QueueFullError,
    Recording,
    StreamPlayer,
    follow_path,
    replay,
    simulate,
)
from sjerk.cia402 import MOTORS, DriveConfig
from sjerk.kernel import FeedForward, load

REV = 2**24
COUNTS = REV / 360.0
LIMITS = Limits(90.0, 500.0, 5000.0)
OPEN = 2**32 - 1


@st.composite
def drives(draw: Any) -> DriveConfig:
    """A motor, its mechanics, gear, feed and polarity; homing where it is, as 37 has it."""
    ratio = st.integers(1, 50)
    motor = MOTORS[draw(st.sampled_from(sorted(MOTORS)))]
    return DriveConfig.for_motor(
        motor,
        polarity=draw(st.sampled_from(range(0, 256, 0x20))),
        gear_motor=draw(ratio),
        gear_shaft=draw(ratio),
        feed=draw(st.sampled_from([REV, 360_000, 10_000, 4096])),
        feed_shaft=draw(st.integers(1, 3)),
        load_inertia_ratio=draw(st.sampled_from([0.0, 1.0, 7.5])),
        friction_nm=draw(st.sampled_from([0.0, 0.04])),
        viscous_nm_s=draw(st.sampled_from([0.0, 2e-5, 1e-3])),
        load_torque_nm=draw(st.floats(-0.3, 0.3)) * motor.rated_torque_nm,
        following_window=OPEN,
        home_offset=draw(st.integers(-1000, 1000)),
    )


@st.composite
def axes(draw: Any) -> Axis:
    """An axis in any unit whose limits its drive can follow, with less than 20 times its torque."""
    drive = draw(drives())
    scale = draw(units)
    wanted = draw(limits(scale=scale))
    turn = drive.feed * drive.gear_shaft / (drive.feed_shaft * drive.gear_motor)
    fastest = min(drive.max_speed_rpm / 60.0 * turn, drive.max_profile_velocity)
    counts = draw(st.floats(1e-3, 0.9)) * fastest / wanted.velocity
    inertia = drive.inertia_kg_m2 * (1.0 + drive.load_inertia_ratio)
    hardest = max(wanted.acceleration, wanted.braking[0])
    torque = inertia * hardest * 2.0 * math.pi * counts / turn
    less = min(1.0, 20.0 * drive.rated_torque_nm / torque)
    gear = draw(st.sampled_from([1.0, 100.0, 0.37]))
    return Axis(
        Limits(wanted.velocity, wanted.acceleration * less, wanted.jerk * less),
        counts / gear,
        drive,
        gear=gear,
        wrap=draw(st.sampled_from([None, 360.0 * scale])),
        feed_forward=draw(st.sampled_from(["velocity", "torque"])),
    )


def script(rng: np.random.Generator, own: list[Axis], T: float, cycles: int) -> Any:
    """Everything a host can do, at random cycles; distances that are driven in some hundred."""
    reach = [axis.limits.velocity * T * cycles / 6 for axis in own]

    def act(cycle: int, host: Host) -> None:
        if cycle == 1:
            host.enable()
        if cycle < 15 or rng.random() > 30 / cycles:
            return
        i = int(rng.integers(len(own)))
        part = rng.uniform(0.2, 1.0)
        low = own[i].limits
        actions = (
            lambda: host.move({i: float(rng.uniform(-1, 1) * reach[i])}),
            lambda: host.move([float(rng.uniform(-1, 1) * r) for r in reach]),
            lambda: host.move([float(rng.uniform(-1, 1) * r) for r in reach], relative=True),
            lambda: host.move({i: float(rng.uniform(-1, 1) * reach[i])}, buffer="blend high"),
            lambda: host.jog({i: float(rng.uniform(-1, 1) * low.velocity)}),
            lambda: host.halt(axes=i),
            lambda: host.quick_stop(),
            lambda: host.override(float(rng.choice([0.0, 0.3, 1.0, 1.0]))),
            lambda: host.hold(),
            lambda: host.resume(),
            lambda: host.home(axes=i),
            lambda: host.disable(axes=i),
            lambda: (host.reset(), host.enable()),
            lambda: host.set_limits(
                Limits(low.velocity * part, low.acceleration * part, low.jerk * part), axes=i
            ),
            lambda: path(host),
        )
        with contextlib.suppress(InputError, QueueFullError):  # limits may be lower by now
            actions[int(rng.integers(len(actions)))]()

    def path(host: Host) -> None:
        frame = host.feedback()
        if any(axis.moving or not axis.follows for axis in frame.axes):
            return
        begin = np.array([axis.position for axis in frame.axes])
        way = np.cumsum(rng.uniform(-0.1, 0.2, (5, len(own))) * reach, axis=0)
        plan = follow_path(np.vstack([begin, begin + way]), [a.limits for a in own], T)
        host.follow(plan).speed(float(rng.uniform(0.3, 1.4)))

    return act


@given(
    own=st.lists(axes(), min_size=1, max_size=3),
    T=st.sampled_from([2.5e-4, 1e-3, 2e-3, 4e-3]),
    seed=st.integers(0, 2**32),
)
@settings(max_examples=20)
def test_every_word_is_the_exact_difference_of_what_is_commanded(
    own: list[Axis], T: float, seed: int
) -> None:
    """Units, gears, polarities, wraps; moves cut short, paths, holds, homing, stops, power off."""
    cycles = 800
    found = simulate(
        MotionKernel(own, T), script(np.random.default_rng(seed), own, T, cycles), cycles
    )
    for i, axis in enumerate(own):
        assert isinstance(axis.drive, DriveConfig)
        check(found, i, axis.drive, torque=axis.feed_forward == "torque")
    done = replay(found)
    assert done.identical, done.difference


def test_a_stream_of_goals_is_fed_forward_too() -> None:
    """A goal every 100 ms: every word is that of the position played."""
    drive = DriveConfig(load_torque_nm=-0.05)
    own = [Axis(Limits(90.0, 900.0, 20_000.0), COUNTS, drive, feed_forward="torque")]
    players: list[StreamPlayer] = []

    def act(cycle: int, host: Host) -> None:
        if cycle == 1:
            host.enable()
        if cycle == 20:
            players.append(StreamPlayer(host, period=0.1))
        k, rest = divmod(cycle - 20, 100)
        if players and rest == 0 and k < 5:
            players[0].push([20.0 * (1.0 - math.cos(0.25 * k))])
        if players and k == 5 and rest == 0:
            players[0].end()
        if players and cycle % 50 == 0 and not players[0].done:
            players[0].update()

    found = simulate(MotionKernel(own), act, 1400)
    assert check(found, 0, drive) > 400
    assert not found.column("velocity_offset")[-1].any()
    assert replay(found).identical


def followed(own: list[Axis], goal: float, T: float = 1e-3) -> tuple[Any, Any, Recording]:
    """One move of all: the largest 60F4h over v / Kp, and the overshoot in parts of the way."""
    cycles = 200 + round(
        (goal / own[0].limits.velocity + 10 * own[0].limits.velocity / own[0].limits.acceleration)
        / T
    )
    moved = [(1, lambda host: host.enable()), (20, lambda host: host.move([goal] * len(own)))]
    found = simulate(MotionKernel(own, T), moved, cycles)
    assert (found.position[-1] == goal).all()
    counts = np.array([axis.counts_per_unit * axis.gear for axis in own])
    law = np.abs(np.diff(found.position, axis=0)).max(axis=0) / T * counts
    law /= [axis.drive.position_gain_per_s for axis in own]  # type: ignore[union-attr]
    error = np.abs(found.column("following_error")).max(axis=0)
    return error / law, (found.actual_position.max(axis=0) - goal) / goal, found


@pytest.mark.parametrize("goal", [160.0, 10.0])
@pytest.mark.parametrize("friction", [0.0, 0.04])
@pytest.mark.parametrize("own", [LIMITS, Limits(90.0, 200.0, 2000.0), Limits(90.0, 2000.0, 5e4)])
def test_a_fed_motor_is_where_it_is_to_be(own: Limits, friction: float, goal: float) -> None:
    """Below 1 % of v / Kp with friction and without; 10 degrees overshoot by 0.3 % at most."""
    drive = DriveConfig(friction_nm=friction, following_window=OPEN)
    error, overshoot, _ = followed([Axis(own, COUNTS, drive, feed_forward="torque")], goal)
    assert error[0] < 0.01
    assert overshoot[0] <= 0.003
    plain, beyond, _ = followed([Axis(own, COUNTS, drive)], goal)
    if friction:
        assert plain[0] > 0.06
        assert goal > 10.0 or beyond[0] > 0.01


@pytest.mark.parametrize("polarity", range(0, 256, 0x20))
@pytest.mark.parametrize("geared", [False, True])
def test_the_drive_agrees_about_units_and_signs(polarity: int, geared: bool) -> None:
    """Any polarity, gear and load: a tenth of the error of a drive that is fed nothing."""
    more: dict[str, Any] = {"gear_motor": 7, "gear_shaft": 3, "feed": 360_000} if geared else {}
    drive = DriveConfig(
        polarity=polarity,
        load_torque_nm=0.1,
        following_window=OPEN,
        velocity_feedforward=0.0,
        acceleration_feedforward=0.0,
        **more,
    )
    turn = drive.feed * drive.gear_shaft / (drive.feed_shaft * drive.gear_motor)
    own = [Axis(LIMITS, turn / 30.0, drive, feed_forward=f) for f in (None, "torque")]  # type: ignore[arg-type]
    error, _, _ = followed(own, 160.0)
    assert error[1] < 0.1 * error[0]


def test_nothing_counts_twice() -> None:
    """What the kernel sends, the drive does not add by itself; the rest it does as it is set."""
    drive = DriveConfig(velocity_feedforward=0.7, acceleration_feedforward=0.6)
    for fed, own in (("velocity", (0.0, 0.6)), ("torque", (0.0, 0.0)), (None, (0.7, 0.6))):
        kernel = MotionKernel([Axis(LIMITS, COUNTS, drive, feed_forward=fed)])  # type: ignore[arg-type]
        config = kernel.core.axis[0].drive.config
        assert (config.velocity_feedforward, config.acceleration_feedforward) == own


def test_a_given_motor_and_a_velocity_unit() -> None:
    """An external drive: words in its own units, the motor's from the FeedForward."""
    motor = FeedForward(
        velocity_unit=REV / 60.0,  # rpm
        rated_torque_nm=1.0,
        counts_per_revolution=REV,
        inertia_kg_m2=1e-3,
        load_torque_nm=0.25,
    )
    kernel = MotionKernel([Axis(LIMITS, COUNTS * 30, "external", feed_forward=motor)])
    image, host = kernel.image, kernel.host()
    host.enable()
    words, frames = [], []
    image.inputs["statusword"], image.inputs["mode_display"] = 0x1237, 8
    kernel.step(5)
    host.move(60.0)
    for _ in range(1200):
        kernel.step()
        words.append((int(image.outputs["velocity_offset"][0]), image.outputs["torque_offset"][0]))
        frames.append(host.feedback().axes[0])
        image.inputs["position_actual"] = image.outputs["target_position"]
    shown = [(axis.velocity_offset, axis.torque_offset) for axis in frames]
    assert shown == words
    assert max(v for v, _ in words) == 90.0 * 30 / 360 * 60
    heaviest = 1e-3 * 500.0 * 30 / 360 * 2 * math.pi / 1e-3
    assert max(t for _, t in words) == pytest.approx(250 + heaviest, abs=1)
    assert words[-1] == (0, 250)


@pytest.mark.parametrize(
    ("wrong", "field"),
    [
        ({"feed_forward": "all"}, "feed_forward"),
        ({"feed_forward": "velocity", "drive": "ideal"}, "feed_forward"),
        ({"feed_forward": "torque", "drive": "external"}, "feed_forward"),
    ],
)
def test_what_cannot_be_fed_is_refused(wrong: dict[str, Any], field: str) -> None:
    """Before anything moves, with the field."""
    with pytest.raises(InputError) as told:
        Axis(LIMITS, COUNTS, **wrong)
    assert told.value.field == field


@pytest.mark.parametrize(
    ("wrong", "field"),
    [
        ({"velocity_unit": 0.0}, "velocity_unit"),
        ({"friction_nm": -1.0, "rated_torque_nm": 1.0}, "friction_nm"),
        ({"inertia_kg_m2": 1e-4}, "rated_torque_nm"),
        ({"rated_torque_nm": 1.0}, "counts_per_revolution"),
        ({"polarity": 1}, "polarity"),
        ({"polarity": True}, "polarity"),
    ],
)
def test_a_motor_that_is_not_whole_is_refused(wrong: dict[str, Any], field: str) -> None:
    """With the field that is missing or wrong."""
    with pytest.raises(InputError) as told:
        FeedForward(**wrong)
    assert told.value.field == field


def test_limits_beyond_the_words_are_refused() -> None:
    """60B1h has 32 bits, 60B2h 16."""
    coarse = FeedForward(velocity_unit=1e-3)
    with pytest.raises(InputError, match=r"axes\[0\].limits.velocity.*60B1h"):
        MotionKernel([Axis(LIMITS, COUNTS, "external", feed_forward=coarse)])
    heavy = FeedForward(rated_torque_nm=1.0, counts_per_revolution=REV, inertia_kg_m2=100.0)
    with pytest.raises(InputError, match=r"axes\[0\].feed_forward.*60B2h"):
        MotionKernel([Axis(LIMITS, COUNTS, "external", feed_forward=heavy)])


def test_a_file_can_say_it(tmp_path: Any) -> None:
    """By word, or as a table; a fault with its place."""
    text = """
    cycle_time = 1e-3
    [[axes]]
    counts_per_unit = 46603.37
    limits = { velocity = 90.0, acceleration = 500.0, jerk = 5000.0 }
    feed_forward = "torque"
    [[axes]]
    counts_per_unit = 46603.37
    limits = { velocity = 90.0, acceleration = 500.0, jerk = 5000.0 }
    drive = "external"
    [axes.feed_forward]
    rated_torque_nm = 1.27
    counts_per_revolution = 16777216
    inertia_kg_m2 = 1e-4
    """
    file = tmp_path / "robot.toml"
    file.write_text(text)
    own = load(file).axes
    assert own[0].feed_forward == "torque"
    assert own[1].feed_forward == FeedForward(
        rated_torque_nm=1.27, counts_per_revolution=REV, inertia_kg_m2=1e-4
    )
    file.write_text(text.replace("= 1e-4", "= -1.0"))
    with pytest.raises(InputError, match=r"axes\[1\].feed_forward.inertia_kg_m2"):
        load(file)
