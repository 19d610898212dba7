"""A new target in flight: the kernel plans in the cycle in which the goal comes.

    python examples/03_change_of_target.py [picture.png]

The kernel runs in this process, cycle by cycle, with a simulated servo drive. Every new goal
replaces the motion; the commanded path stays continuous in position, velocity and acceleration.
"""

import sys
from pathlib import Path

import numpy as np

from sjerk import Axis, Limits, MotionKernel
from sjerk.cli.pictures import Curve, panels

T = 1e-3
axis = Axis(Limits(velocity=90.0, acceleration=500.0, jerk=5000.0), counts_per_unit=2**24 / 360)
kernel = MotionKernel(axes=[axis], cycle_time=T)
host = kernel.host()
host.enable()
kernel.step(10)

goals = {0: 100.0, 600: 150.0, 900: -20.0, 1400: 40.0}
rows = []
for cycle in range(3000):
    if cycle in goals:
        host.move(goals[cycle])
    kernel.step()
    rows.append(host.feedback().axes[0])

print("arrived at", rows[-1].position, "and the encoder at", rows[-1].actual_position)
position = np.array([row.position for row in rows])
for n, limit in enumerate((90.0, 500.0, 5000.0), start=1):
    used = np.max(np.abs(np.diff(position, n))) / (limit * T**n)
    print(f"difference {n} of the commanded positions: {used:.4f} of its limit")

out = Path(sys.argv[1] if len(sys.argv) > 1 else "03_change_of_target.png")
t = np.arange(len(rows)) * T
panels(
    out,
    "three changes of the target in flight",
    {
        "position": [
            Curve("commanded", t, position),
            Curve("actual", t, np.array([row.actual_position for row in rows]), "k:"),
            Curve("new goal", np.array(list(goals)) * T, np.array(list(goals.values())), "o"),
        ],
        "velocity": [Curve("commanded", t, np.array([row.velocity for row in rows]))],
        "acceleration": [Curve("commanded", t, np.array([row.acceleration for row in rows]))],
    },
    {"velocity": 90.0, "acceleration": 500.0},
)
