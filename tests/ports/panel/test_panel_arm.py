"""The panel's arm: kinematics, shape, distances, settings; judged by code that shares nothing."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers import panel_judge as judge
from helpers.panel_bench import PANDA, RANGES, SETTINGS
from sjerk.errors import ConfigError, InputError, SjerkError
from sjerk.kernel import load
from sjerk.ports.panel.arm import Arm
from sjerk.ports.panel.clearance import Clearance, segment_distances
from sjerk.ports.panel.inverse import UnreachableError, solve
from sjerk.ports.panel.settings import PanelSettings, with_tables
from sjerk.ports.panel.shapes import Scene, Shape

ARM: Arm = SETTINGS.arm
BARE = Clearance(ARM, *RANGES.T, Scene({}, floor=None))

poses = st.tuples(*[st.floats(low, high) for low, high in RANGES.tolist()])
metres = st.floats(-2.0, 2.0)
shapes = st.builds(
    lambda kind, sizes, centre, yaw: Shape(
        kind, sizes[: {"sphere": 1, "cylinder": 2, "box": 3}[kind]], centre, yaw=yaw
    ),
    st.sampled_from(["box", "sphere", "cylinder"]),
    st.tuples(*[st.floats(0.01, 1.0)] * 3),
    st.tuples(metres, metres, metres),
    st.floats(-4.0, 4.0),
)


@given(poses)
def test_the_links_are_where_the_published_parameters_have_them(q: tuple[float, ...]) -> None:
    """Every frame and the flange, to rounding, by Craig's matrix entry by entry."""
    wanted = np.array(judge.frames(q))
    assert np.abs(ARM.frames([q])[0] - wanted).max() < 1e-14
    assert np.abs(ARM.tip([q])[0, :3, 3] - judge.tip(q)).max() < 1e-14


def test_the_stretched_arm_ends_where_its_maker_says() -> None:
    """0.088 m in front, 0.926 m up."""
    assert ARM.tip(np.zeros((1, 7)))[0, :3, 3].round(12).tolist() == [0.088, 0.0, 0.926]


@settings(max_examples=50)
@given(poses, poses, st.integers(0, 6))
def test_no_point_moves_further_than_reach_times_angle(
    one: tuple[float, ...], two: tuple[float, ...], joint: int
) -> None:
    """The bound that lets samples be left out, for each joint alone."""
    moved = list(one)
    moved[joint] = two[joint]
    clear = BARE
    ends = [np.concatenate(clear._ends(ARM.frames([q])), axis=1) for q in (one, moved)]
    most = float(np.linalg.norm(ends[1] - ends[0], axis=-1).max())
    assert most <= abs(moved[joint] - one[joint]) * clear.reach[joint] + 1e-12


points = st.tuples(*[st.floats(-1.0, 1.0)] * 3)


@settings(max_examples=50)
@given(points, points, points, points, st.sampled_from(["", "point", "parallel", "same"]))
def test_the_distance_of_two_lines_is_the_least_of_all_their_points(
    a: Any, b: Any, c: Any, d: Any, special: str
) -> None:
    """Also of lines that are points, parallel or the same; by a search that is convex."""
    a, b, c, d = map(np.array, (a, b, c, d))
    if special == "point":
        b = a
    elif special == "parallel":
        d = c + 0.7 * (b - a)
    elif special == "same":
        c, d = a, b
    found = float(segment_distances(a[None], b[None], c[None], d[None])[0])
    assert found == pytest.approx(judge.line_distance(a, b, c, d), abs=2e-6)


@settings(max_examples=50)
@given(shapes, st.integers(0, 2**32 - 1))
def test_a_point_is_inside_a_shape_where_its_distance_is_negative(shape: Shape, seed: int) -> None:
    """And no surface is nearer than the distance: a step of it arrives nowhere else."""
    random = np.random.default_rng(seed)
    at = np.array(shape.centre) + random.uniform(-1.5, 1.5, (200, 3))
    distance = shape.distances(at)
    truth = judge.inside(at, shape.kind, shape.size, shape.centre, shape.yaw)
    clear = np.abs(distance) > 1e-9
    assert ((distance < 0) == truth)[clear].all()
    out = random.normal(size=at.shape)
    out *= (np.abs(distance) * 0.999 / np.linalg.norm(out, axis=1))[:, None]
    moved = judge.inside(at + out, shape.kind, shape.size, shape.centre, shape.yaw)
    assert (moved == truth)[clear].all()


@settings(max_examples=50)
@given(shapes)
def test_what_is_attached_is_covered_by_its_spheres(shape: Shape) -> None:
    """Every point of it is in one of them."""
    random = np.random.default_rng(1)
    at = np.array(shape.centre) + random.uniform(-1.0, 1.0, (2000, 3)) * max(shape.size)
    at = at[judge.inside(at, shape.kind, shape.size, shape.centre, shape.yaw)]
    centres, radii = shape.cover()
    apart = np.linalg.norm(at[:, None] - centres, axis=2) - radii
    assert len(centres) <= 300
    assert not len(at) or apart.min(axis=1).max() <= 1e-9


@settings(max_examples=30)
@given(poses, shapes, st.integers(0, 2**32 - 1))
def test_a_clearance_is_never_larger_than_the_truth(
    q: tuple[float, ...], shape: Shape, seed: int
) -> None:
    """No point of the skin is inside what it is said to be clear of, nor nearer than told."""
    clear = Clearance(ARM, *RANGES.T, Scene({"it": shape}))
    told = float(clear.distances([q])[0])
    at, links = judge.skin(q, 300, np.random.default_rng(seed))
    at = at[links > 0]
    if told > 0:
        assert not judge.inside(at, shape.kind, shape.size, shape.centre, shape.yaw).any()
    assert told <= float(shape.distances(at).min()) + 1e-9
    assert told == clear.nearest(q).distance


@settings(max_examples=15)
@given(poses)
def test_links_that_overlap_are_told_by_name(q: tuple[float, ...]) -> None:
    """Of each pair that is judged, the distance is at most that of the bones between frames."""
    clear = BARE
    i, j = clear._pairs
    judged = {(ARM.capsules[a].link, ARM.capsules[b].link) for a, b in zip(i, j, strict=True)}
    assert {(0, 3), (0, 4), (1, 5), (2, 6), (0, 6), (0, 7), (2, 7)} <= judged
    rows = [
        judge.line_distance(a, b, c, d) - r - s
        for one, a, b, r in judge.bones(q)
        for two, c, d, s in judge.bones(q)
        if (one, two) in judged
    ]
    told = float(clear.distances([q])[0])
    assert told <= min(rows) + 1e-5
    links, names = clear.touching(q)
    assert bool(links) == (told <= 0)
    assert names == set()


def test_what_the_tool_holds_touches_too() -> None:
    """A rod in the tool, near a wall that the arm itself is clear of."""
    wall = Shape("box", (0.05, 1.0, 2.0), (0.70, 0.0, 1.0))
    rod = Shape("cylinder", (0.02, 0.4), (0.0, 0.0, 0.2), attached=True)
    q = SETTINGS.poses["ready"]
    q = (*q[:5], q[5] + 1.2, q[6])
    free = Clearance(ARM, *RANGES.T, Scene({"wall": wall}))
    held = Clearance(ARM, *RANGES.T, Scene({"wall": wall, "rod": rod}))
    assert free.distances([q])[0] > 0.05
    nearest = held.nearest(q)
    assert nearest.distance < 0.0
    assert (nearest.one, nearest.other) == ("rod", "wall")
    assert held.touching(q) == (set(), {"rod", "wall"})


@settings(max_examples=10)
@given(poses, poses)
def test_the_flange_is_brought_to_a_pose_that_it_can_reach(
    goal: tuple[float, ...], start: tuple[float, ...]
) -> None:
    """Within the joints' ranges, where the pose is one of the arm's own."""
    wanted = ARM.tip([goal])[0]
    try:
        found = solve(ARM, wanted, start, *RANGES.T)
    except UnreachableError:
        return  # counted below
    assert ((found >= RANGES[:, 0]) & (found <= RANGES[:, 1])).all()
    assert np.abs(judge.tip(found) - wanted[:3, 3]).max() < 1e-5
    assert np.abs(ARM.tip([found])[0] - wanted).max() < 1e-4


def test_nearly_all_poses_of_the_arm_are_found_and_none_that_is_too_far() -> None:
    """From the ready pose."""
    ready, found = SETTINGS.poses["ready"], 0
    random = np.random.default_rng(4)
    for q in random.uniform(*RANGES.T, (12, 7)):
        try:
            solve(ARM, ARM.tip([q])[0], ready, *RANGES.T)
            found += 1
        except UnreachableError:
            pass
    assert found >= 11
    far = ARM.tip([ready])[0]
    far[:3, 3] = 2.0, 0.0, 0.5
    with pytest.raises(UnreachableError, match=r"cannot be brought to \(2\.000"):
        solve(ARM, far, ready, *RANGES.T)


@pytest.mark.parametrize(
    ("text", "place", "why"),
    [
        ("[panel]\nbox = 1\n", "panel.box", "unknown"),
        ("[panel]\ndh = [[1.0, 2.0]]\n", "panel.dh", "rows of three"),
        ("[panel]\ndh = [[1.0, 2.0, nan]]\n", "panel.dh", "finite"),
        ("[panel]\ndh = [[1.0, 2.0, 0.0]]\n", "panel.dh", "the kernel 2"),
        ("[panel]\nzero = [1.0]\n", "panel.zero", "2 numbers"),
        ("[panel.poses]\na = [1.0, 'x']\n", "panel.poses.a[1]", "number"),
        ("[panel.poses]\n'<b>' = [1.0, 2.0]\n", "panel.poses.<b>", "no name"),
        ("[panel.shapes]\na = { size = [1, 1, 0], centre = [0, 0, 0] }\n", "shapes.a.size.z", ""),
        ("[panel.shapes]\na = { kind = 'cone' }\n", "panel.shapes.a.kind", "one of"),
        ("[panel]\nfloor = 'low'\n", "panel.floor", "height"),
    ],
)
def test_a_wrong_table_is_refused_with_its_place(text: str, place: str, why: str) -> None:
    """Before anything is shown."""
    with pytest.raises(ConfigError) as told:
        PanelSettings.of(Path("robot.toml"), tomllib.loads(text), 2)
    assert place in str(told.value)
    assert why in str(told.value)


@settings(max_examples=50)
@given(shapes)
def test_a_saved_scene_is_read_again_and_the_rest_stays(shape: Shape) -> None:
    """To the last bit, with the comments of the file."""
    text = PANDA.read_text()
    made = with_tables(text, {"panel.poses": {}, "panel.shapes": {"it one": shape.table()}})
    again = PanelSettings.of(PANDA, tomllib.loads(made), 7)
    assert again.scene.shapes == {"it one": shape}
    assert made.split("[panel.poses]")[0] == text.split("[panel.poses]")[0].rstrip() + "\n\n"


def test_saving_changes_the_file_and_never_the_shipped_one(tmp_path: Path) -> None:
    """Poses and scene go into a person's own file."""
    mine = tmp_path / "mine.toml"
    mine.write_text(PANDA.read_text())
    own = PanelSettings.of(mine, tomllib.loads(mine.read_text()), 7)
    own.save({"home": (0.0,) * 7}, Scene({}))
    again = PanelSettings.of(mine, tomllib.loads(mine.read_text()), 7)
    assert again.poses == {"home": (0.0,) * 7}
    assert again.scene.shapes == {}
    assert len(load(mine).axes) == 7
    with pytest.raises(SjerkError, match="copy its file"):
        SETTINGS.save({}, Scene({}))
    with pytest.raises(SjerkError, match="not changed"):
        with_tables("panel.poses.a = [1.0]\n", {"panel.poses": {}})


def test_sizes_are_checked_where_a_shape_is_made() -> None:
    """With the field, the value and what it must be."""
    with pytest.raises(InputError, match="within 100 m"):
        Shape("sphere", (1.0,), (1e9, 0.0, 0.0))
    with pytest.raises(InputError, match="2 numbers"):
        Shape("cylinder", (1.0,), (0.0, 0.0, 0.0))
    with pytest.raises(InputError, match="radius"):
        Arm([[0.0, 0.0, 0.0]], flange=0.1, radius=[0.1])
