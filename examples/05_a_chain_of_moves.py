"""A chain of queued moves: one after the other, or passing the goals in between.

    python examples/05_a_chain_of_moves.py [picture.png]

Four goals with velocities of their own, given at once to a kernel in this program's own loop.
Buffered, each move begins where the one before has come to rest; a blend passes each goal, exactly,
at the lower or the higher of both velocities as far as the ways allow.
"""

import sys
from pathlib import Path

import numpy as np

from sjerk import Axis, Limits, MotionKernel
from sjerk.cli.pictures import Curve, panels
from sjerk.host import Buffer

T = 1e-3
limits = Limits(90.0, 500.0, 5000.0)
chain = [(15.0, 60.0), (40.0, 30.0), (60.0, 80.0), (50.0, 40.0)]  # goal, velocity
content: dict[str, list[Curve]] = {"position": [], "velocity": [], "acceleration": []}
modes: list[Buffer] = ["buffered", "blend low", "blend high"]

for buffer in modes:
    kernel = MotionKernel([Axis(limits, 2**24 / 360)], T)
    host = kernel.host()
    host.enable()
    kernel.step(10)
    moves = [
        host.move(goal, limits=Limits(velocity, 500.0, 5000.0), buffer=buffer)
        for goal, velocity in chain
    ]
    rows, met = [], []
    while not moves[-1].done:
        kernel.step()
        axis = host.feedback().axes[0]
        rows.append((axis.position, axis.velocity, axis.acceleration))
        if len(met) < len(chain) and moves[len(met)].done:
            met.append(f"{axis.velocity:.1f} deg/s at {axis.position:g}")
    print(f"{buffer:10}: {len(rows)} cycles, {', '.join(met)}")
    table = np.array(rows)
    time = np.arange(len(rows)) * T
    for name, column in zip(content, table.T, strict=True):
        content[name].append(Curve(buffer, time, column))

panels(
    Path(sys.argv[1] if len(sys.argv) > 1 else "05_a_chain_of_moves.png"),
    "four queued moves: to 15, 40, 60 and back to 50 deg",
    content,
    {"acceleration": 500.0},
)
