"""Point to point: one axis from rest to rest, in whole control cycles.

    python examples/01_point_to_point.py [picture.png]

The plan is never longer than the paper's closed form, and its last sample is the goal, bit for bit.
"""

import sys
from pathlib import Path

from sjerk import Limits, plan, scurve
from sjerk.cli.pictures import Curve, panels

T = 1e-3
limits = Limits(velocity=90.0, acceleration=500.0, jerk=5000.0)

profile = plan(0.0, 160.0, limits, T)
samples = profile.sample()
print(f"{profile.cycles} cycles; the paper's closed form takes {scurve(160.0, limits, T).cycles}")
for phase in profile.phases:
    print(f"  {phase.cycles:5d} cycles of jerk {phase.jerk:10.3f}")
print("last sample is the goal:", samples.position[-1] == 160.0)

out = Path(sys.argv[1] if len(sys.argv) > 1 else "01_point_to_point.png")
panels(
    out,
    "160 degrees from rest to rest",
    {
        name: [Curve("what the drive gets", samples.time, getattr(samples, name))]
        for name in ("position", "velocity", "acceleration", "jerk")
    },
    {"velocity": 90.0, "acceleration": 500.0, "jerk": 5000.0},
)
