"""Without a kernel: the planner over the whole range of its input, and one drive by itself."""

from __future__ import annotations

from random import Random
from typing import Any

import numpy as np

from sjerk import (
    Drive,
    DriveConfig,
    Limits,
    State,
    plan,
    plan_many,
    plan_velocity,
    scurve,
)
from told import Told
from watched import _INJECTED, fault_config, homing_config

SAMPLED = 20_000  # cycles up to which every sample is compared


# ---- plans ---------------------------------------------------------------------------------------


def _limits(draw: Random, unit: float) -> Limits:
    velocity = 10.0 ** draw.uniform(-2, 2) * unit
    acceleration = velocity * 10.0 ** draw.uniform(-1, 3)
    jerk = acceleration * 10.0 ** draw.uniform(-1, 4)
    other = draw.random() < 0.5
    room = velocity * 10.0 ** draw.uniform(-1, 2)
    return Limits(
        velocity,
        acceleration,
        jerk,
        deceleration=acceleration * 10.0 ** draw.uniform(-1, 1) if other else None,
        deceleration_jerk=jerk * 10.0 ** draw.uniform(-1, 1) if other else None,
        position=(-room, room) if draw.random() < 0.2 else None,
    )


def _state(draw: Random, own: Limits, moving: float, accelerating: bool) -> State:
    return State(
        draw.choice([0.0, draw.uniform(-1, 1) * own.velocity * 10.0 ** draw.uniform(-4, 2)]),
        draw.choice([0.0, draw.uniform(-moving, moving)]) * own.velocity,
        draw.choice([0.0, draw.uniform(-1.2, 1.2)]) * own.acceleration if accelerating else 0.0,
    )


def _tell_profile(told: Told, profile: Any) -> None:
    if profile is None:
        return
    told.motion("cycles", [phase.cycles for phase in profile.phases])
    told.motion("jerks", [phase.jerk for phase in profile.phases])
    told.event("leaves range", profile.leaves_range)
    if profile.cycles <= SAMPLED:
        told.samples(profile.sample())
        told.motion("extrema", np.array(profile.extrema().position))


def planner(draw: Random, told: Told) -> None:
    """One axis, several, many, to a velocity, and the paper's own plan."""
    for _ in range(6):
        T = draw.choice([50e-6, 250e-6, 1e-3, 1e-3, 2e-3, 10e-3, draw.uniform(50e-6, 10e-3)])
        unit = draw.choice([1.0, 57.3, 1e3, 2670176.85, 1e-3])
        own = _limits(draw, unit)
        start, target = _state(draw, own, 1.3, True), _state(draw, own, 1.0, False)
        _tell_profile(told, told.attempt(plan, start, target, own, T))
        velocity = draw.choice([0.0, draw.uniform(-1, 1) * own.velocity])
        _tell_profile(told, told.attempt(plan_velocity, start, velocity, own, T))
        _tell_profile(
            told,
            told.attempt(
                scurve,
                target.position,
                own,
                T,
                v_start=draw.choice([0.0, draw.random() * own.velocity]),
                v_end=draw.choice([0.0, draw.random() * own.velocity]),
                rounding=draw.choice(["up", "nearest"]),
            ),
        )
        each = [_limits(draw, unit) for _ in range(draw.randint(2, 7))]
        starts = [_state(draw, limit, 1.3, draw.random() < 0.5) for limit in each]
        targets = [_state(draw, limit, draw.choice([0.0, 1.0]), False) for limit in each]
        motion = told.attempt(
            plan,
            starts,
            targets,
            each,
            T,
            synchronization=draw.choice(["time", "phase", "none"]),
            min_duration=draw.choice([0.0, draw.uniform(0.0, 5.0)]),
        )
        for profile in motion or ():
            _tell_profile(told, profile)
        free = [Limits(x.velocity, x.acceleration, x.jerk) for x in each]
        plans = told.attempt(
            plan_many,
            [[s.position, s.velocity, s.acceleration] for s in starts],
            [[s.position, s.velocity] for s in targets],
            free,
            T,
        )
        if plans is not None:
            told.motion("many", plans.cycles)
            for i in range(len(plans)):
                for part in plans.phases(i):
                    told.motion("many phases", part)


# ---- a drive -------------------------------------------------------------------------------------


def drive(draw: Random, told: Told) -> None:
    """Controlwords of a master that climbs, falls and errs; targets in every mode."""
    fields = fault_config(draw) | homing_config(draw)
    fields["period_s"] = draw.choice([250e-6, 1e-3, 1e-3, 4e-3])
    fields["positioning_option"] = draw.randint(0, 2)
    fields["profile_velocity"] = int(16777216 * draw.uniform(0.1, 10.0))
    one = Drive(DriveConfig(**fields))
    rows: list[tuple[int, ...]] = []
    mode, target, velocity, torque = 8, 0, 0, 0
    word, held = 0, 0
    speed = 0.0
    for _ in range(draw.randint(500, 3000)):
        if held == 0:
            held = draw.choice([1, 2, 5, 40, 200])
            if draw.random() < 0.25:
                mode = draw.choice([8, 8, 8, 1, 3, 6, 9, 10, 0])
            word = {0x40: 6, 0x21: 7, 0x08: 0x80}.get(rows[-1][0] & 0x6F if rows else 0, 0xF)
            word |= draw.choice([0, 0, 0x10, 0x30, 0x50, 0x70, 0x100]) if word == 0xF else 0
            if draw.random() < 0.08:
                word = draw.choice([0, 2, 6, 7, 0x80, draw.getrandbits(16)])
            speed = draw.uniform(-1.0, 1.0) * 16777216 * fields["period_s"]
            velocity = draw.randint(-(2**25), 2**25)
            torque = draw.randint(-1500, 1500)
            if mode == 1:
                target = draw.randint(-(2**25), 2**25)
            if draw.random() < 0.05:
                one.inject(draw.choice(_INJECTED), draw.random() < 0.3)
            if draw.random() < 0.05:
                for kind in _INJECTED:
                    one.inject(kind, False)
            if draw.random() < 0.03:
                told.attempt(one.configure, load_torque_nm=draw.uniform(0.0, 1.0))
            if draw.random() < 0.01:
                one.restart()
        held -= 1
        if mode == 8 and rows:
            target = rows[-1][8] + round(speed) if draw.random() < 0.98 else draw.getrandbits(32)
        found = one.cycle(
            word,
            target,
            mode=mode,
            target_velocity=velocity,
            target_torque=torque,
            velocity_offset=draw.choice([0, 0, 0, draw.randint(-(2**20), 2**20)]),
            digital_outputs=draw.choice([0, 1]),
            sync_missed=draw.random() < 0.02,
        )
        rows.append(tuple(int(word) for word in found))
        told.event("state", one.state, *one.transitions) if one.transitions else None
    table = np.array(rows)
    for k, name in enumerate(found._fields):
        told.motion(name, table[:, k])
    told.event("verdict", one.report())
