"""Plans of the panel: whole motions, judged sample by sample."""

from __future__ import annotations

import numpy as np
import pytest

from helpers import panel_judge as judge
from helpers.panel_bench import RANGES, ROBOT, SETTINGS
from sjerk.ports.panel.clearance import Clearance
from sjerk.ports.panel.planning import NoWayError, closest, plan
from sjerk.ports.panel.shapes import Scene, Shape

LIMITS = [axis.limits for axis in ROBOT.axes]
SCENE = Scene(
    {
        "table": Shape("box", (0.6, 1.6, 0.1), (0.55, 0.0, 0.05)),
        "wall": Shape("box", (1.6, 0.05, 1.2), (0.3, -0.55, 0.6)),
        "post": Shape("cylinder", (0.05, 0.9), (0.4, 0.35, 0.45)),
    }
)
CLEAR = Clearance(SETTINGS.arm, *RANGES.T, SCENE)


def touches(q: np.ndarray, random: np.random.Generator) -> bool:
    """Whether a point of the skin is inside an obstacle or under the floor."""
    at, links = judge.skin(q.tolist(), 40, random)
    inside = (at[links > 1, 2] < 0).any()
    for one in SCENE.shapes.values():
        inside |= judge.inside(at[links > 0], one.kind, one.size, one.centre, one.yaw).any()
    return bool(inside)


@pytest.mark.parametrize("number", range(6))
def test_a_plan_is_within_limits_and_no_sample_of_it_touches(number: int) -> None:
    """Random queries: bit for bit from start to goal; by a judge of its own."""
    random = np.random.default_rng(number)
    free = [q for q in random.uniform(*RANGES.T, (60, 7)) if CLEAR.distances(q)[0] > 0.03]
    start, goal = free[:2]
    made = plan(CLEAR, start, goal, LIMITS, 1e-3)
    assert made.position[0].tolist() == start.tolist()
    assert made.position[-1].tolist() == goal.tolist()
    assert not made.collides
    assert made.shares.max() <= 1.0 + 1e-9
    assert made.shares.max() > 0.98
    for q in made.position[::20]:
        assert not touches(q, random)


def test_the_straight_line_is_told_to_collide_with_whom() -> None:
    """Where nothing is avoided: by every sample, whoever is nearest."""
    start = np.array(SETTINGS.poses["left"])
    goal = np.array(SETTINGS.poses["right"])
    scene = Scene({"box": Shape("box", (0.1, 0.3, 0.4), (0.45, 0.0, 0.2))})
    clear = Clearance(SETTINGS.arm, *RANGES.T, scene)
    through = plan(clear, start, goal, LIMITS, 1e-3, avoid=False)
    around = plan(clear, start, goal, LIMITS, 1e-3)
    assert through.collides
    assert through.nearest.other == "box"
    assert not around.collides
    assert through.clearance == clear.distances(through.position).min()


def test_the_nearest_of_all_samples_is_found_though_not_all_are_measured() -> None:
    """A thin rod between two coarse samples."""
    q = np.linspace(SETTINGS.poses["left"], SETTINGS.poses["right"], 400)
    for k in range(100, 300, 17):
        x, y, z = judge.tip(q[k].tolist())
        rod = Scene({"rod": Shape("cylinder", (0.001, 0.1), (x, y, z))})
        clear = Clearance(SETTINGS.arm, *RANGES.T, rod)
        assert closest(clear, q).distance == clear.distances(q).min()


def test_what_cannot_be_planned_is_told_with_its_reason() -> None:
    """Before anything moves."""
    ready = np.array(SETTINGS.poses["ready"])
    beyond, low = ready.copy(), ready.copy()
    beyond[3] = 0.5
    low[1], low[3] = 1.7, -0.5
    with pytest.raises(NoWayError, match=r"goal lies outside the range of panda_joint4: 0.5000"):
        plan(CLEAR, ready, beyond, LIMITS, 1e-3)
    with pytest.raises(NoWayError, match=r"goal leaves less than 20 mm: .* touches"):
        plan(CLEAR, ready, low, LIMITS, 1e-3)
    with pytest.raises(NoWayError, match="at the goal"):
        plan(CLEAR, ready, ready, LIMITS, 1e-3)
    with pytest.raises(NoWayError, match="no configuration"):
        plan(CLEAR, ready, ready * np.nan, LIMITS, 1e-3)


def test_the_angle_where_the_kernel_counts_from_moves_the_model_only() -> None:
    """The first way-point is the kernel's own to the last bit."""
    ready = np.array(SETTINGS.poses["ready"])
    shifted = [
        type(one)(one.velocity, one.acceleration, one.jerk, position=(low - z, high - z))
        for one, (low, high), z in zip(LIMITS, RANGES.tolist(), ready.tolist(), strict=True)
    ]
    goal = np.array([0.0, -0.5, 0.3, 0.2, 0.0, 0.5, 1.0])
    start = np.full(7, 0.1) / 3.0
    made = plan(CLEAR, start, goal, shifted, 1e-3, zero=ready)
    assert made.position[0].tolist() == start.tolist()
    assert made.clearance == CLEAR.distances(made.position + ready).min()
