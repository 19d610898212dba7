"""An arm from a URDF: where its links are, what holds its shape, and what is refused."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from helpers import panel_judge, panel_urdf
from helpers.panel_bench import PANDA, RANGES, SETTINGS
from helpers.panel_urdf import panda
from sjerk.__main__ import main
from sjerk.errors import ConfigError
from sjerk.ports.panel.capsules import capsule_mesh, least_capsule
from sjerk.ports.panel.clearance import Clearance
from sjerk.ports.panel.inverse import solve
from sjerk.ports.panel.settings import PanelSettings
from sjerk.ports.panel.shapes import Scene
from sjerk.ports.panel.urdf import UrdfError, read_urdf

TABLE = tomllib.loads(PANDA.read_text())
NAMES = [row["name"] for row in TABLE["axes"]]
same_folder = settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])


@same_folder
@given(st.integers(0, 2**32 - 1), st.integers(1, 8))
def test_every_link_is_where_the_file_has_it(tmp_path: Path, seed: int, joints: int) -> None:
    """Any axes, joints that are held between and beside; by a judge that goes up to the root."""
    random = np.random.default_rng(seed)
    robot = panel_urdf.made(random, joints)
    file = tmp_path / "made.urdf"
    file.write_text(robot.text())
    by_name = bool(random.integers(2))
    names = robot.chain if by_name else [f"axis {i}" for i in range(joints)]
    arm, _ = read_urdf(file, names)
    q = random.uniform(-4.0, 4.0, joints)
    angles = dict(zip(robot.chain, q.tolist(), strict=True))
    assert np.abs(arm.tip(q)[0] - panel_urdf.place(robot, robot.tip, angles)).max() < 1e-12
    frames = arm.frames(q)[0]
    ends = {j.name: j.child for j in robot.joints}
    for i, name in enumerate(robot.chain, start=1):
        wanted = panel_urdf.place(robot, ends[name], angles)
        assert np.abs(frames[i][:3, 3] - wanted[:3, 3]).max() < 1e-12
        axis = next(j.axis for j in robot.joints if j.name == name)
        along = wanted[:3, :3] @ (axis / np.linalg.norm(axis))
        assert np.abs(frames[i][:3, 2] - along).max() < 1e-12


@same_folder
@given(st.integers(0, 2**32 - 1), st.integers(1, 5))
def test_every_shape_is_held_by_a_capsule(tmp_path: Path, seed: int, joints: int) -> None:
    """Each element by one of the link that carries it, in any configuration."""
    random = np.random.default_rng(seed)
    robot = panel_urdf.made(random, joints)
    file = tmp_path / "made.urdf"
    file.write_text(robot.text())
    arm, _ = read_urdf(file, robot.chain)
    q = random.uniform(-4.0, 4.0, joints)
    angles = dict(zip(robot.chain, q.tolist(), strict=True))
    frames = arm.frames(q)[0]
    for shape in robot.shapes:
        points = panel_urdf.skin(robot, shape, angles, random)
        least = np.inf
        for capsule in arm.capsules:
            at = frames[capsule.link]
            a, b = (at[:3, :3] @ np.array(e) + at[:3, 3] for e in (capsule.start, capsule.end))
            way = b - a
            share = ((points - a) @ way / max(float(way @ way), 1e-300)).clip(0.0, 1.0)
            far = np.linalg.norm(points - a - share[:, None] * way, axis=1).max() - capsule.radius
            least = min(least, float(far))
        assert least <= 1e-9


@given(
    st.integers(1, 200),
    st.integers(0, 2**32 - 1),
    st.tuples(*[st.sampled_from([0.0, 1e-6, 1e-3, 0.1, 1.0, 30.0])] * 3),
    st.floats(0.0, 0.5),
)
def test_the_least_capsule_holds_all_points(
    count: int, seed: int, sizes: tuple[float, ...], larger: float
) -> None:
    """One point, a line, a plane, a cloud; and its mesh is finite."""
    random = np.random.default_rng(seed)
    points = random.normal(size=(count, 3)) * sizes + random.uniform(-1.0, 1.0, 3)
    found = least_capsule(0, points, larger)
    a, way = np.array(found.start), np.subtract(found.end, found.start)
    share = ((points - a) @ way / max(float(way @ way), 1e-300)).clip(0.0, 1.0)
    assert (
        np.linalg.norm(points - a - share[:, None] * way, axis=1) + larger
    ).max() <= found.radius
    vertices, _ = capsule_mesh(found)
    assert np.isfinite(vertices).all()


def test_the_makers_description_and_the_parameters_say_the_same_arm(tmp_path: Path) -> None:
    """Flange and all frames, in random configurations; and it is planned with."""
    (tmp_path / "panda.urdf").write_text(panda())
    found = PanelSettings.of(PANDA, TABLE, 7, urdf=tmp_path / "panda.urdf")
    arm = found.arm
    assert arm is not None
    for q in np.random.default_rng(1).uniform(*RANGES.T, (100, 7)):
        wanted = np.array(panel_judge.frames(q.tolist()))
        assert np.abs(arm.frames(q)[0] - wanted).max() < 1e-12
        assert np.abs(arm.tip(q)[0, :3, 3] - panel_judge.tip(q.tolist())).max() < 1e-12
    start = np.array(SETTINGS.poses["ready"])
    goal = arm.tip(np.array(SETTINGS.poses["left"]))[0]
    assert np.abs(arm.tip(solve(arm, goal, start, *RANGES.T))[0] - goal).max() < 1e-4
    near = Clearance(arm, *RANGES.T, Scene({}, floor=0.0)).nearest(start)
    assert near.one.startswith("panda_link")


def test_a_mesh_is_found_scaled_and_held(tmp_path: Path) -> None:
    """Beside the file, in a package above it, in any format that is read; with its colour."""
    meshes = tmp_path / "robot_description" / "meshes"
    meshes.mkdir(parents=True)
    box = trimesh.creation.box((100.0, 20.0, 40.0))  # mm
    for suffix in ("stl", "obj", "dae"):
        box.export(meshes / f"box.{suffix}")
    folder = tmp_path / "robot_description" / "urdf"
    folder.mkdir()
    for filename in (
        "package://robot_description/meshes/box.stl",
        "../meshes/box.obj",
        f"file://{meshes}/box.dae",
    ):
        mesh = f"<mesh filename='{filename}' scale='0.001 0.001 0.001'/>"
        seen = (
            f"<link name='seen'><visual><geometry>{mesh}</geometry><material name='red'>"
            "<color rgba='1 0 0 1'/></material></visual></link><joint name='on' type='fixed'>"
            "<parent link='panda_link3'/><child link='seen'/></joint>"
        )
        (folder / "panda.urdf").write_text(panda(end=seen))
        arm, visuals = read_urdf(folder / "panda.urdf", NAMES)
        assert [(v.link, v.colour) for v in visuals] == [(3, (255, 0, 0))]
        assert np.ptp(visuals[0].vertices, axis=0) == pytest.approx([0.1, 0.02, 0.04])
        own = [c for c in arm.capsules if c.link == 3 and 0.04 < c.radius * 2 < 0.05]
        assert len(own) == 1


#: The first two joints have changed their names.
SWAPPED = panda().replace("joint1", "j").replace("joint2", "joint1").replace("_j'", "_joint2'")
BAD = [
    ("<robot", "no XML"),
    ("<model/>", "no URDF"),
    ("<!DOCTYPE a [<!ENTITY b 'c'>]><robot/>", "entities"),
    ("<robot name='x'/>", "one must have no parent, not 0"),
    ("<robot><link/></robot>", "has no name"),
    (panda().replace("'revolute'", "'screw'", 1), "'screw' must be one of"),
    (panda().replace("xyz='0 0 1'", "xyz='0 0 0'", 1), "has no direction"),
    (panda().replace("xyz='0 0 1'", "xyz='0 nan 1'", 1), "must be 3 numbers"),
    (
        panda().replace("panda_link2'/><child", "nowhere'/><child", 1),
        "there is no link 'nowhere'",
    ),
    (panda().replace("panda_joint7", "elbow"), "has the name of the axis panda_joint7"),
    (
        panda().replace("'revolute'", "'fixed'", 1),
        "has the name of the axis panda_joint1",
    ),
    (panda("<sphere radius='-1'/>"), "must be greater than 0"),
    (panda("<cone/>"), "no geometry that is known"),
    (panda("<mesh filename='none.stl'/>"), "there is no file 'none.stl'"),
    (panda("<mesh filename='robot.urdf'/>"), "cannot be read"),
    (
        panda().replace("joint1", "j").replace("joint2", "joint1").replace("_j'", "_joint2'"),
        "follow",
    ),
]


@pytest.mark.parametrize(("text", "why"), BAD, ids=[why for _, why in BAD])
def test_what_cannot_be_used_is_refused_with_its_place(tmp_path: Path, text: str, why: str) -> None:
    """Before anything is shown."""
    (tmp_path / "robot.urdf").write_text(text)
    with pytest.raises(UrdfError, match=why) as refused:
        read_urdf(tmp_path / "robot.urdf", NAMES)
    assert str(tmp_path / "robot.urdf") in str(refused.value)


def test_the_flange_is_a_link_behind_the_last_joint(tmp_path: Path) -> None:
    """By name; and the table of a robot may name file and link."""
    (tmp_path / "panda.urdf").write_text(panda())
    arm, _ = read_urdf(tmp_path / "panda.urdf", NAMES, tip="panda_link7")
    assert (arm.end == np.eye(4)).all()
    with pytest.raises(UrdfError, match="must be a link behind joint 'panda_joint7'"):
        read_urdf(tmp_path / "panda.urdf", NAMES, tip="panda_link6")
    own = {
        key: value for key, value in TABLE["panel"].items() if key not in ("dh", "radius", "flange")
    }
    table = TABLE | {"panel": own | {"urdf": "panda.urdf", "tip": "panda_link7"}}
    found = PanelSettings.of(tmp_path / "robot.toml", table, 7)
    assert found.arm is not None
    assert (found.arm.end == np.eye(4)).all()
    with pytest.raises(ConfigError, match="and dh exclude each other"):
        PanelSettings.of(
            tmp_path / "robot.toml", TABLE | {"panel": TABLE["panel"] | {"urdf": "x"}}, 7
        )
    with pytest.raises(ConfigError, match="is of a urdf"):
        PanelSettings.of(
            tmp_path / "robot.toml", TABLE | {"panel": TABLE["panel"] | {"tip": "x"}}, 7
        )


def test_the_command_line_refuses_a_file_that_is_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """And a flange without a URDF."""
    assert main(["panel", "--urdf", str(tmp_path / "none.urdf")]) == 1
    assert "is no file" in capsys.readouterr().err
    assert main(["panel", "--tip", "flange"]) == 1
    assert "is a link of --urdf" in capsys.readouterr().err
