"""Jog and stop: changes of velocity without a target position.

    python examples/02_jog_and_stop.py [picture.png]

Each plan starts from the state in which the one before it is left.
"""

import sys
from pathlib import Path

import numpy as np

from sjerk import Limits, State, plan_velocity
from sjerk.cli.pictures import Curve, panels

T = 1e-3
limits = Limits(90.0, 500.0, 5000.0, deceleration=300.0)

state = State(0.0)
time, velocity, acceleration = [], [], []
start = 0.0
for wanted, cruise_s in ((60.0, 0.3), (-90.0, 0.2), (0.0, 0.1)):
    profile = plan_velocity(state, wanted, limits, T)
    samples = profile.sample()
    print(
        f"to {wanted:6.1f} deg/s: {profile.cycles} cycles, ends at {profile.end.position:.6f} deg"
    )
    time += [start + samples.time, [start + samples.time[-1] + cruise_s]]
    velocity += [samples.velocity, [wanted]]
    acceleration += [samples.acceleration, [0.0]]
    start += float(samples.time[-1]) + cruise_s
    state = State(profile.end.position + wanted * cruise_s, wanted)

out = Path(sys.argv[1] if len(sys.argv) > 1 else "02_jog_and_stop.png")
t = np.concatenate(time)
panels(
    out,
    "jog at 60, turn to -90, stop; braking is gentler than accelerating",
    {
        "velocity": [Curve("commanded", t, np.concatenate(velocity))],
        "acceleration": [Curve("commanded", t, np.concatenate(acceleration))],
    },
    {"velocity": 90.0, "acceleration": 500.0},
)
