"""Judge of what a kernel feeds forward, from a recording alone: in rationals.

60B1h must be the first difference of the commanded positions to the nearest unit, 60B2h what the
motor needs for the first and second one: a word never further off than one unit, their sum never
further than half a unit. Positions are judged as they are recorded, doubles: what their own
rounding allows is added (`ulp`).
"""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np

from sjerk import Axis, Recording
from sjerk._binding import lib
from sjerk.cia402 import DriveConfig

PI = Fraction(math.pi)
GRID = 2**160  # fractions that are summed up would grow without end


def short(value: Fraction) -> Fraction:
    """The nearest one on a grid far below all that is judged."""
    return Fraction(round(value * GRID), GRID)


def sign(drive: DriveConfig, bit: int) -> int:
    """Of a word of this kind, for a motion that is positive in the words of the position."""
    return -1 if bool(drive.polarity & 0x80) != bool(drive.polarity & bit) else 1


def check(recording: Recording, axis: int, drive: DriveConfig, *, torque: bool = True) -> int:
    """Judge one axis that is fed forward for the motor of ``drive``; how many cycles moved."""
    own: Axis = recording.axes[axis]
    T = Fraction(recording.cycle_time)
    counts = Fraction(own.counts_per_unit) * Fraction(own.gear)
    turn = Fraction(drive.feed * drive.gear_shaft, drive.feed_shaft * drive.gear_motor)
    rad = 2 * PI * counts / turn  # of the motor, per axis unit
    unit = sign(drive, 0x20) * 1000 / Fraction(drive.rated_torque_nm)
    inertia = Fraction(drive.inertia_kg_m2) * (1 + Fraction(drive.load_inertia_ratio))
    load = Fraction(drive.load_torque_nm) * 1000 / Fraction(drive.rated_torque_nm)
    load = round(-load if drive.polarity & 0x20 else load)
    friction, w0 = Fraction(drive.friction_nm), Fraction(drive.friction_speed_rad_s)
    viscous = Fraction(drive.viscous_nm_s)

    position = recording.position[:, axis]
    follows = (recording.column("flags")[:, axis] & lib.SJ_TRACE_FOLLOWS) != 0
    velocity_word = recording.column("velocity_offset")[:, axis]
    torque_word = recording.column("torque_offset")[:, axis]
    before = last = Fraction(float(position[0]))
    total, slack, moved = Fraction(0), Fraction(0), 0
    for k in range(len(position)):
        now = Fraction(float(position[k]))
        said = f"cycle {recording.cycle[k]} axis {axis}"
        if not follows[k]:
            last = before = now
            total = slack = Fraction(0)
            assert velocity_word[k] == 0, said
            assert torque_word[k] == (load if torque else 0), said
            continue
        step, change = now - last, now - 2 * last + before
        before, last = last, now
        moved += step != 0
        ulp = 3 * Fraction(max(float(np.spacing(abs(position[k]))), 2.0**-200))
        exact = sign(drive, 0x40) * step * counts / T
        off = abs(int(velocity_word[k]) - exact)
        assert off <= Fraction(1, 2) + ulp * counts / T + abs(exact) / 2**48, (said, float(off))
        if not torque:
            assert torque_word[k] == 0, said
            continue
        w = step * rad / T
        exact = unit * (inertia * change * rad / T**2 + friction * w / (abs(w) + w0) + viscous * w)
        off = abs(int(torque_word[k]) - load - exact)
        noise = abs(unit) * ulp * rad / T
        here = noise * (inertia / T + friction / w0 + viscous) + abs(exact) / 2**44
        assert off <= 1 + 4 * here, (said, float(off))
        # the sum of the second differences is the first: its noise does not add up
        slack = short(slack + noise * (friction / w0 + viscous) + abs(exact) / 2**44)
        total = short(total + int(torque_word[k]) - load - exact)
        assert abs(total) <= Fraction(1, 2) + slack + 4 * noise * inertia / T, (said, float(total))
    return moved
