"""Seven axes in phase: rest to rest on a straight line in joint space.

    python examples/04_seven_axes_in_phase.py [picture.png]

Each axis has the limits of its joint (Panda arm, rad). In phase, all share their phases;
synchronised in time only, they arrive together but leave the line.
"""

import sys
from pathlib import Path

import numpy as np

from sjerk import Limits, plan
from sjerk.cli.pictures import Curve, panels
from sjerk.planner import Motion

T = 1e-3
velocity = [2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61]
acceleration = [3.75, 1.875, 2.5, 3.125, 3.75, 5.0, 5.0]
limits = [Limits(v, a, 500.0) for v, a in zip(velocity, acceleration, strict=True)]
start = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
goal = [1.2, -0.2, 0.9, -1.5, -0.6, 2.4, -0.8]


def off_the_line(motion: Motion) -> float:
    """Largest distance of any sample from the line between start and goal, rad."""
    line = np.array(goal) - np.array(start)
    way = motion.sample().position - np.array(start)
    along = way @ line / (line @ line)
    return float(np.max(np.linalg.norm(way - np.outer(along, line), axis=1)))


in_phase = plan(start, goal, limits, T, synchronization="phase")
in_time = plan(start, goal, limits, T, synchronization="time")
for motion in (in_phase, in_time):
    print(
        f"{motion.synchronization:5}: {motion.cycles} cycles, {off_the_line(motion):.3g} rad off"
        " the line"
    )

samples = in_phase.sample()
panels(
    Path(sys.argv[1] if len(sys.argv) > 1 else "04_seven_axes_in_phase.png"),
    "seven joints in phase",
    {
        name: [
            Curve(f"joint {i + 1}", samples.time, getattr(samples, name)[:, i]) for i in range(7)
        ]
        for name in ("position", "velocity", "acceleration")
    },
    {},
)
