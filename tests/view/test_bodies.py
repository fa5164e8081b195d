"""Bodies of a scene: what own parts and files say they look like, where it is, and what is refused."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.view import mesh_file
from gtmodel.view.mesh_file import MOST_DRAWN, read_mesh
from tests.view.test_view import INSTANTS, SAME, TIME, decoded

CORNERS = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)
SIDES = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
CUBE = np.array([t for a, b, c, d in SIDES for t in ((a, b, c), (a, c, d))])
ROUND = 0.03  # relative: 24 corners approximate a circle, 12 rings a sphere


class Lever(gt.Model):
    """A lever about y whose look depends on its length."""

    L = gt.parameter(0.5, unit="m")
    q = gt.variable(unit="rad")
    ground = gt.part(gt.mechanics.Ground)
    joint = gt.part(gt.mechanics.Revolute, axis=[0.0, 1.0, 0.0])
    arm = gt.part(gt.mechanics.FixedTranslation, d=lambda lever: [lever.L, 0.0, 0.0])
    body = gt.part(gt.mechanics.RigidBody, m=2.0, I=0.01 * np.eye(3))

    @property
    def visual(self) -> dict[str, Any]:
        rod = gt.view.Cylinder(0.02, self.L, xyz=(self.L / 2, 0.0, 0.0), rpy=(0.0, np.pi / 2, 0.0))
        return {"arm.a": rod, "body.frame": [gt.view.Cuboid((0.1, 0.08, 0.06), xyz=(0.0, 0.0, 0.2))]}

    def equations(self) -> Any:
        yield gt.connect([self.ground.frame, self.joint.b, self.arm.b], [self.joint.a, self.arm.a, self.body.frame])
        yield self.q == self.joint.shaft.phi


class Bench(gt.Model):
    """A lever as a part of a model, with a table in the world."""

    lever = gt.part(Lever, L=0.7)
    visual = {"world": gt.view.Cuboid((1.0, 1.0, 0.1), xyz=(0.0, 0.0, -0.5))}  # noqa: RUF012


def volume(body: gt.view.VisibleBody) -> float:
    """By the divergence theorem; positive if the faces look outwards."""
    a, b, c = np.moveaxis(body.vertices[body.faces], 1, 0)
    return float(np.sum(np.einsum("fi,fi->f", a, np.cross(b, c))) / 6)


def bodies_of(document: dict[str, Any]) -> dict[str, list[np.ndarray]]:
    """World positions (n, v, 3) of the vertices of each body at all instants, as a page has them, by frame."""
    frames, count = list(document["frames"]), len(document["time"])
    found: dict[str, list[np.ndarray]] = {}
    for at, *_, vertices, _, _ in document["bodies"]:
        local = np.reshape(vertices, (-1, 3))
        pose = np.reshape(document["frames"][frames[at]], (-1, 3, 4)) if at >= 0 else np.eye(3, 4)[None]
        world = np.einsum("nij,vj->nvi", pose[:, :, :3], local) + pose[:, None, :, 3]
        found.setdefault(frames[at] if at >= 0 else "", []).append(np.broadcast_to(world, (count, *world.shape[1:])))
    return found


@pytest.mark.parametrize(
    ("solid", "expected"),
    [
        (gt.view.Cuboid((0.1, 0.2, 0.3)), 0.1 * 0.2 * 0.3),
        (gt.view.Cylinder(0.1, 0.5, rpy=(0.3, 0.2, 0.1)), np.pi * 0.01 * 0.5),
        (gt.view.Sphere(0.2, xyz=(1.0, 2.0, 3.0)), 4 / 3 * np.pi * 0.008),
        (gt.view.Sphere(1.0, (0.1, 0.2, 0.3)), 4 / 3 * np.pi * 0.006),
        (gt.view.Capsule(0.1, 0.4), np.pi * 0.01 * 0.4 + 4 / 3 * np.pi * 0.001),
    ],
)
def test_solids_are_closed_and_look_outwards(solid: Any, expected: float) -> None:
    body = solid.body()
    assert body.closed and volume(body) == pytest.approx(expected, rel=ROUND)
    assert np.allclose((body.vertices.min(axis=0) + body.vertices.max(axis=0)) / 2, solid.xyz, atol=2e-3)


def test_an_own_part_is_where_its_frame_is() -> None:
    q = 0.8 * np.sin(3 * TIME)
    scene = gt.view.scene(Lever(L=0.4), gt.Trajectory(TIME, {"q": q}, {"q": "rad"}))
    document, points = decoded(scene.html())
    found = bodies_of(document)
    (rod,), (box,) = found["arm.a"], found["body.frame"]
    for n in INSTANTS:
        c, s = np.cos(q[n]), np.sin(q[n])
        R = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
        tip = R @ [0.4, 0.0, 0.0]
        assert np.allclose(box[n].mean(axis=0), tip + R @ [0.0, 0.0, 0.2], rtol=0, atol=SAME)
        assert np.allclose(np.ptp(box[n] @ R, axis=0), [0.1, 0.08, 0.06], rtol=0, atol=SAME)
        assert np.allclose(np.ptp(rod[n] @ R, axis=0), [0.4, 0.04, 0.04], rtol=0, atol=SAME)
        assert np.allclose(rod[n].mean(axis=0), tip / 2, rtol=0, atol=SAME)
        assert np.allclose(scene.vertices_at(scene.bodies[1], float(TIME[n])), box[n], rtol=0, atol=SAME)
    assert "bar" not in [part[0] for part in document["parts"]]  # the rod covers it
    assert np.allclose(points["ground.frame"], 0.0)


def test_a_point_has_all_its_names() -> None:
    """Frames that coincide are drawn once, and asked for by any of their names."""
    scene = gt.view.scene(Lever(L=0.4), still=True)
    for name in ("arm.b", "body.frame"):
        assert np.allclose(scene.at(name, 0.0), [0.4, 0.0, 0.0])
    with pytest.raises(gt.results.ArgumentError, match=r"did you mean 'body\.frame'"):
        scene.at("bodi.frame", 0.0)


def test_only_pages_and_pictures_of_gtmodel_are_written_over(tmp_path: Path) -> None:
    scene = gt.view.scene(Lever(), still=True)
    page = scene.write(tmp_path / "page.html")
    assert scene.write(page) == page
    own = tmp_path / "own.html"
    own.write_text("mine")
    for file in (own, tmp_path / "model.py", tmp_path / "lever.jpg"):
        with pytest.raises(gt.results.ArgumentError) as caught:
            scene.write(file)
        assert caught.value.argument == "path"
    assert own.read_text() == "mine" and not (tmp_path / "lever.jpg").exists()


def test_a_mesh_of_a_class_lies_beside_its_python_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "robots"
    folder.mkdir()
    loops = [" ".join(f"vertex {x} {y} {z}" for x, y, z in CORNERS[[*t]]) for t in CUBE]
    facets = " ".join(f"facet normal 0 0 0 outer loop {loop} endloop endfacet" for loop in loops)
    (folder / "cube.stl").write_text(f"solid cube {facets} endsolid cube")
    (folder / "beside.py").write_text(
        "import gtmodel as gt\nfrom tests.view.test_bodies import Lever\n\n\nclass Own(Lever):\n"
        '    visual = {"body.frame": gt.view.MeshFile("cube.stl", scale=0.1)}\n'
    )
    monkeypatch.chdir(tmp_path)
    (body,) = gt.view.scene(gt.load_robot("robots/beside.py:Own"), still=True).bodies
    assert np.allclose(body.corners()[-1], [0.1, 0.1, 0.1])


@pytest.mark.parametrize("colour", ["red", "#12345", "#0072b2ff", (0, 1, 2)])
def test_a_colour_that_no_browser_reads_is_refused(colour: Any) -> None:
    for make in (lambda: gt.view.Sphere(0.1, colour=colour), lambda: gt.view.dots([[0.0, 0.0, 0.0]], colour=colour),
                 lambda: gt.view.VisiblePart("joint", ("a",), colour=colour)):  # fmt: skip
        with pytest.raises(gt.results.ArgumentError) as caught:
            make()
        assert caught.value.argument == "colour"


def test_parts_of_a_model_and_the_world_have_a_look_too() -> None:
    """The lever has no drive: its free coordinate moves it."""
    scene = gt.view.scene(Bench(), visual={"lever.body.frame": gt.view.Sphere(0.03)})
    found = bodies_of(scene.document())
    assert [*found] == ["", "lever.arm.a", "lever.body.frame"] and len(found["lever.body.frame"]) == 2
    tips = found["lever.body.frame"][1].mean(axis=1)
    assert np.allclose(np.linalg.norm(tips, axis=1), 0.7, rtol=0, atol=SAME) and np.ptp(tips, axis=0)[2] > 0.3
    still = gt.view.scene(Bench(), still=True)
    assert len(still.time) == 1 and still.bodies[0].frame == ""


def test_a_loop_without_motors_moves_and_stays_closed() -> None:
    bars = "".join(
        f'<body name="{name}" pos="{x} 0 0"><joint name="j{name}" axis="0 -1 0" ref="1"/>'
        f'<geom type="capsule" fromto="0 0 0 0 0 .3" size=".01"/>{more}</body>'
        for name, x, more in (
            ("a", 0, '<body name="top" pos="0 0 .3"><joint name="elbow" axis="0 -1 0"/>'
             '<geom type="capsule" fromto="0 0 0 .5 0 0" size=".01"/></body>'), ("b", 0.5, ""))
    )  # fmt: skip
    text = (
        f'<mujoco model="parallelogram"><compiler angle="radian"/><worldbody>{bars}</worldbody>'
        '<equality><connect name="tip" body1="top" body2="b" anchor=".5 0 0"/></equality></mujoco>'
    )
    scene = gt.view.scene(gt.robots.mechanism(text, driven=[]))
    found = bodies_of(scene.document())
    assert len(scene.time) > 20 and np.ptp(found["top.frame"][0], axis=0).max() > 0.05
    (a,), (b,) = found["a.frame"], found["b.frame"]
    assert np.allclose(b - a, [0.5, 0.0, 0.0], rtol=0, atol=SAME)  # the bars of a parallelogram stay parallel


def stl(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    rows = [struct.pack("<12fH", 0, 0, 0, *vertices[f].ravel(), 0) for f in faces]
    return b"\0" * 80 + struct.pack("<I", len(faces)) + b"".join(rows)


def test_stl_and_obj_files_are_the_same_cube(tmp_path: Path) -> None:
    (tmp_path / "a.stl").write_bytes(stl(CORNERS, CUBE))
    facets = ["".join("vertex {:g} {:g} {:g}\n".format(*CORNERS[k]) for k in face) for face in CUBE]
    corners = "".join(f"facet normal 0 0 0\nouter loop\n{facet}endloop\nendfacet\n" for facet in facets)
    (tmp_path / "b.stl").write_text(f"solid cube\n{corners}endsolid\n")
    quads = "".join("f " + " ".join(f"{k + 1}/1/1" for k in side) + "\n" for side in SIDES)
    (tmp_path / "c.obj").write_text("# a cube\n" + "".join("v {:g} {:g} {:g}\n".format(*x) for x in CORNERS) + quads)
    (tmp_path / "d.stl").write_bytes(stl(CORNERS, CUBE[:, ::-1]))  # inside out
    for name in ("a.stl", "b.stl", "c.obj", "d.stl"):
        body = gt.view.MeshFile(tmp_path / name, scale=0.5).body()
        assert body.closed and len(body.faces) == 12 and volume(body) == pytest.approx(0.125)
    assert volume(gt.view.MeshFile(tmp_path / "a.stl", scale=(-1.0, 1.0, 2.0)).body()) == pytest.approx(2.0)  # mirrored


def test_a_large_mesh_is_drawn_with_fewer_triangles(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    u, v = np.meshgrid(np.linspace(0, 1, 101), np.linspace(0, 1, 101), indexing="ij")
    grid = np.column_stack([u.ravel(), v.ravel(), 0.1 * np.sin(6 * u.ravel())])
    k = (np.arange(100)[:, None] * 101 + np.arange(100)).ravel()
    faces = np.vstack([np.column_stack([k, k + 101, k + 1]), np.column_stack([k + 1, k + 101, k + 102])])
    (tmp_path / "wave.stl").write_bytes(stl(grid, faces))
    vertices, fewer = read_mesh(tmp_path / "wave.stl")
    assert 1000 < len(fewer) <= MOST_DRAWN < len(faces)
    assert np.abs(vertices[:, 2] - 0.1 * np.sin(6 * vertices[:, 0])).max() < 0.01
    monkeypatch.setattr(mesh_file, "MOST_READ", 100)
    (tmp_path / "more.stl").write_bytes(stl(grid, faces))
    with pytest.raises(gt.results.ArgumentError, match="20000 triangles"):
        read_mesh(tmp_path / "more.stl")


def test_what_is_wrong_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mm.stl").write_bytes(stl(400 * CORNERS, CUBE))
    (tmp_path / "no.stl").write_text("no mesh")
    (tmp_path / "part.step").write_text("")
    frame = "body.frame"
    wrong: list[tuple[dict[str, Any], str]] = [
        ({frame: gt.view.MeshFile(tmp_path / "mm.stl")}, r"needs scale=0\.001"),
        ({frame: gt.view.MeshFile(tmp_path / "missing.stl")}, "cannot be read: No such file"),
        ({frame: gt.view.MeshFile(tmp_path / "no.stl")}, "is no STL file"),
        ({frame: gt.view.MeshFile(tmp_path / "part.step")}, "neither STL nor OBJ"),
        ({"body.frme": gt.view.Sphere(0.1)}, r"did you mean 'body\.frame'"),
        ({frame: "a box"}, "expected gt.view.Cuboid"),
    ]  # fmt: skip
    for visual, words in wrong:
        with pytest.raises(gt.results.ArgumentError, match=words):
            gt.view.scene(Lever(), visual=visual, still=True)
    calls: list[tuple[Any, Any]] = [
        (gt.view.Cuboid, ((0.1, -0.2, 0.3),)), (gt.view.Cylinder, (0.0, 1.0)), (gt.view.Sphere, (np.inf,)),
        (gt.view.VisibleBody, ([[0, 0, 0]], [[0, 1, 2]])), (gt.view.ellipsoid, (-np.eye(3), [0, 0, 0])),
        (gt.view.RobotScene.of, ({"points": {}},)),
    ]  # fmt: skip
    for make, arguments in calls:
        with pytest.raises(gt.results.ArgumentError):
            make(*arguments)
    assert gt.view.scene(Lever(), visual={frame: gt.view.MeshFile(tmp_path / "mm.stl", 1e-3)}, still=True).bodies


URDF = """<robot name="r"><material name="blue"><color rgba="0 0.5 1 1"/></material>
<link name="base"/><link name="arm"><visual><origin xyz="0.25 0 0" rpy="0 1.5707963267948966 0"/>
<geometry><cylinder radius="0.04" length="0.5"/></geometry><material name="blue"/></visual>
<visual><geometry><mesh filename="package://parts/a.stl" scale="0.1 0.1 0.1"/></geometry></visual>
<visual><geometry><mesh filename="gone.stl"/></geometry></visual>
<inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint></robot>"""
SDF = """<sdf version="1.9"><model name="r"><link name="base"/><link name="arm"><visual name="v">
<pose>0.25 0 0 0 1.5707963267948966 0</pose><geometry><cylinder><radius>0.04</radius><length>0.5</length></cylinder>
</geometry><material><diffuse>0 0.5 1 1</diffuse></material></visual><visual name="m"><geometry><mesh>
<uri>model://parts/a.stl</uri><scale>0.1 0.1 0.1</scale></mesh></geometry></visual></link>
<joint name="j" type="continuous"><parent>base</parent><child>arm</child><axis><xyz>0 1 0</xyz></axis></joint>
</model></sdf>"""
MJCF = """<mujoco model="r"><compiler meshdir="parts"/><asset><mesh name="cube" file="a.stl" scale=".1 .1 .1"/></asset>
<worldbody><body name="arm"><joint name="j" axis="0 1 0"/><inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/>
<geom type="cylinder" fromto="0 0 0 .5 0 0" size=".04" rgba="0 .5 1 1"/><geom type="mesh" mesh="cube"/>
<geom type="sphere" size=".3" group="3"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize(("name", "text"), [("r.urdf", URDF), ("r.sdf", SDF), ("r.xml", MJCF)])
def test_visual_shapes_of_files_are_where_their_links_are(
    name: str, text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "a.stl").write_bytes(stl(CORNERS, CUBE))
    (tmp_path / "robots").mkdir()
    place = tmp_path if name == "r.xml" else tmp_path / "robots"
    (place / name).write_text(text)
    q = np.sin(TIME)
    monkeypatch.chdir(place)
    for robot in (gt.load_robot(name), gt.robots.mechanism(place / name, driven="j")):
        scene = gt.view.scene(robot, gt.Trajectory(TIME, {"q": q[:, None]}, {"q": "rad"}))
        (of_arm,) = bodies_of(scene.document()).values()
        rod, cube = of_arm
        assert scene.bodies[0].colour in ("#0080ff", "#007fff")
        for n in INSTANTS:
            c, s = np.cos(q[n]), np.sin(q[n])
            R = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
            assert np.allclose(rod[n].mean(axis=0), R @ [0.25, 0.0, 0.0], rtol=0, atol=SAME)
            assert np.allclose(np.ptp(rod[n] @ R, axis=0), [0.5, 0.08, 0.08], rtol=0, atol=SAME)
            assert np.allclose(cube[n].mean(axis=0), R @ [0.05, 0.05, 0.05], rtol=0, atol=SAME)
        notes = robot.graph.notes if hasattr(robot, "graph") else robot.structure.notes
        assert ("mesh files not found and not drawn: 'gone.stl' of link 'arm'" in notes) == (name == "r.urdf")


def test_a_link_with_an_unreadable_mesh_shows_its_collision_shape() -> None:
    text = URDF.replace('<cylinder radius="0.04" length="0.5"/>', '<mesh filename="arm.dae"/>')
    text = text.replace("package://parts/a.stl", "a.dae").replace("gone.stl", "b.dae")
    shape = '<collision><origin xyz="0 0 1"/><geometry><box size="1 2 3"/></geometry></collision>'
    arm = gt.robots.from_urdf(text.replace("<inertial>", f"{shape}<inertial>"))
    assert arm.visual == {"link_1.after": [gt.view.Cuboid((1.0, 2.0, 3.0), xyz=(0.0, 0.0, 1.0))]}
    (note,) = arm.structure.notes
    assert note.startswith("not used: 3 visual shapes (STL, OBJ")


def test_an_ellipsoid_has_one_distance_and_a_stated_scale() -> None:
    rng = np.random.default_rng(3)
    A = rng.normal(size=(3, 3))
    C, centre = A @ A.T, rng.normal(size=3)
    body = gt.view.ellipsoid(C, centre, scale=2.0)
    e = body.vertices - centre
    assert np.allclose(np.einsum("vi,ij,vj->v", e, np.linalg.inv(C), e), 4.0)
    assert body.closed and volume(body) == pytest.approx(4 / 3 * np.pi * 8 * np.sqrt(np.linalg.det(C)), rel=0.12)
    T = rng.normal(size=(200, 3))
    drawn, note = gt.view.ellipsoids(T, np.tile(1e-8 * np.eye(3), (200, 1, 1)))
    enlarged = float(note.partition("enlarged ")[2].partition(" ")[0])
    assert len(drawn) == 50 and "50 of 200 positions" in note
    assert np.allclose(np.linalg.norm(drawn[1].vertices - T[4], axis=1), 1e-4 * enlarged)
    assert gt.view.ellipsoids(np.full((2, 3), np.nan), np.zeros((2, 3, 3))) == ([], "")


def test_a_frustum_ends_at_the_corners_of_the_picture() -> None:
    K = np.array([[800.0, 0, 320], [0, 790, 240], [0, 0, 1]])
    pixels = np.array([[0.0, 0.0], [640, 0], [640, 480], [0, 480]])
    rays = np.column_stack([pixels, np.ones(4)]) @ np.linalg.inv(K).T
    R = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    body = gt.view.frustum(rays, R, [1.0, 2.0, 3.0], 2.5)
    seen = (body.vertices[1:] - [1.0, 2.0, 3.0]) @ R @ K.T
    assert np.allclose(seen[:, :2] / seen[:, 2:], pixels) and np.allclose(seen[:, 2], 2.5)
