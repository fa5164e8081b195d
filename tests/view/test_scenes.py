"""Scenes of results, and what pages, pictures and films show of them."""

from __future__ import annotations

import io
import json
import re
import shutil
import subprocess
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.view import pictures
from tests.support.commands import Commands
from tests.view.test_view import LARGEST, SAME, decoded, l1

NODE = shutil.which("node")
DIGITS = 6e-3  # of a number with three digits
ROUNDED = 1e-9  # of sums of a dozen products of numbers that are not rounded in the scene


@cache
def cameras() -> Any:
    V = gt.vision.robot_cameras
    return V.study(gt.robots.gantry_tau("l1_tape"), V.SyntheticRobotCameras(counts=[3, 3, 3]))


@cache
def workspace() -> Any:
    W = gt.kinematics.workspace
    return gt.kinematics.workspace_study(
        gt.robots.gantry_tau("l1_tape"), W.WorkspaceLimits(cone=0.7), section=W.CrossSection(step=0.1),
        obstacles=[W.Box(low=[-0.2, -0.4, 1.5], high=[0.3, 0.2, 1.7])],
    )  # fmt: skip


@cache
def compliance() -> Any:
    springs = gt.compliance.Springs(links=gt.compliance.RodSprings(stiffness=2e7),
                                    carts=gt.compliance.CartSprings(drive=1e7))  # fmt: skip
    return gt.compliance.study(heavy(), springs, map=gt.compliance.ComplianceMap(step=0.4))


def heavy() -> Any:
    """The L1 with links of mass, which couple plate and carts: else the mass matrix is diagonal and hides faults."""
    return gt.robots.gantry_tau("l1_tape", m_a=[1.0, 2.0, 3.0])


@cache
def postures() -> Any:
    arm = gt.robots.serial_arm(a=[0.4, 0.3, 0.0], alpha=[0.0, np.pi, 0.0], joints="rrp")
    return gt.kinematics.postures_study(arm, gt.kinematics.ToolPose([0.5, 0.3, -0.1]))


def test_cameras_see_the_poses_that_they_are_said_to_see() -> None:
    study = cameras()
    scene = study.view()
    bodies = {body.name: body for body in scene.bodies}
    seen = next(body for name, body in bodies.items() if name.startswith("seen by left and right"))
    for camera in ("left", "right"):
        row = next(c for c in study.cameras if c["name"] == camera)
        centre = bodies[camera].vertices[0]
        assert np.allclose(centre, [row[n]["value"] for n in "xyz"])
        assert np.allclose(bodies[f"camera {camera}"].vertices, centre)
        axis = np.mean(bodies[camera].vertices[1:], axis=0) - centre
        towards = seen.vertices - centre
        cosines = towards @ axis / np.linalg.norm(axis) / np.linalg.norm(towards, axis=1)
        assert cosines.min() > 0.8
    assert "enlarged" in scene.note and sum(body.opacity < 1 for body in scene.bodies) > 5


def test_the_workspace_is_marked_by_reason() -> None:
    study = workspace()
    scene = study.view()
    groups = {body.name.rpartition(":")[0]: body for body in scene.bodies if body.marker}
    shown = {name: len(body.vertices) for name, body in groups.items()}
    assert shown == study.reasons and len({body.marker for body in groups.values()}) == len(groups)
    robot = gt.robots.gantry_tau("l1_tape")
    inverse = robot.causal(known="T", targets="q")
    assert not np.any(inverse(groups["reachable"].vertices)[-1])
    assert np.all(inverse(groups["the input lies outside the range where a solution exists"].vertices)[-1])
    (obstacle,) = [body for body in scene.bodies if body.name == "obstacle"]
    assert np.allclose(obstacle.vertices.min(axis=0), [-0.2, -0.4, 1.5])


def test_a_mode_moves_as_its_name_says() -> None:
    """The slowest mode moves the plate mostly along its softest direction, which follows from the springs alone."""
    study = compliance()
    assert [*study.scenes] == ["mode_1", "mode_2", "mode_3", "section_softest", "section_frequency"]
    scene = study.view("mode_1")
    rest, most = scene.at("tool centre point", 0.0), scene.at("tool centre point", 0.5)
    direction = (most - rest) / np.linalg.norm(most - rest)
    assert abs(direction @ study.directions[0]) > 0.8
    ends = [
        scene.at(f"{end} joint {k}", 0.5) - scene.at(f"{end} joint {k}", 0.0)
        for end in ("cart", "plate")
        for k in (1, 2, 3)
    ]
    largest = max(np.linalg.norm(x) for x in (*ends, most - rest))
    assert f"drawn as {1e3 * largest:.0f} mm" in scene.note
    assert f"{study.frequencies[0]:.4g} Hz" in scene.title


def test_what_a_mode_shows_vibrates_at_its_frequency() -> None:
    """Rayleigh's quotient of the drawn motion, from the springs and masses declared: rods, drives, carts on rails."""
    study, robot = compliance(), heavy()
    rods, rail = np.array([1, 2, 3]), np.asarray(robot.v)[0]  # parallel rods of each link; all guideways are parallel
    for k, name in enumerate(n for n in study.scenes if n.startswith("mode")):
        scene = study.view(name)
        plate, carts = (
            np.array([[scene.at(f"{end} joint {n}", t) for n in (1, 2, 3)] for t in (0.0, 0.5)])
            for end in ("plate", "cart")
        )
        u, c = plate[1] - plate[0], carts[1] - carts[0]
        assert np.abs(np.cross(c, rail)).max() < SAME  # the guideways are rigid
        along = (plate[0] - carts[0]) / np.linalg.norm(plate[0] - carts[0], axis=1)[:, None]
        stretch = np.sum(along * (u - c), axis=1)
        stiffness = np.sum(2e7 * rods * stretch**2) + 1e7 * np.sum(c**2)
        masses = (
            robot.m_p * u[0] @ u[0] + robot.m_c @ np.sum(c**2, axis=1) + robot.m_a @ np.sum((u + c) ** 2, axis=1) / 4
        )
        assert np.isclose(np.sqrt(stiffness / masses) / (2 * np.pi), study.frequencies[k], rtol=ROUNDED), name


def test_the_section_is_marked_by_stiffness() -> None:
    """One pose at a time, with the springs of the map, lies in the range of its mark and along its line."""
    scene, k = compliance().view("section_softest"), 2
    marks = [body for body in scene.bodies if "N/µm" in body.name]
    (softest,) = [body for body in scene.bodies if body.name == "softest direction"]
    starts, ends = softest.vertices.reshape(2, -1, 3)
    assert sum(len(body.vertices) for body in marks) == len(starts) > 10
    springs = gt.compliance.Springs(links=gt.compliance.RodSprings(stiffness=2e7),
                                    carts=gt.compliance.CartSprings(drive=1e7))  # fmt: skip
    for body in (marks[0], marks[-1]):
        T = body.vertices[k]
        alone = gt.compliance.study(heavy(), springs, pose=T.tolist(), map=gt.compliance.ComplianceMap(step=1.0))
        low, high = (float(x) for x in re.findall(r"([\d.]+) to ([\d.]+) N/µm", body.name)[0])
        assert low * (1 - DIGITS) <= 1e-6 * alone.stiffness[0] <= high * (1 + DIGITS)
        (n,) = np.flatnonzero(np.linalg.norm((starts + ends) / 2 - T, axis=1) < SAME)
        way = (ends[n] - starts[n]) / np.linalg.norm(ends[n] - starts[n])
        assert abs(way @ alone.directions[0]) > 1 - SAME


def test_possible_errors_are_boxes_about_the_section() -> None:
    """Each corner of a box changes each link by its largest error, up or down, and lies on the outside."""
    robot, largest = gt.robots.gantry_tau("d1_nominal"), np.array([2e-5, 5e-5, 3e-5])
    A = gt.kinematics.accuracy
    case = A.LinkErrors("links", length=largest.tolist())
    study = gt.kinematics.accuracy_study(robot, [case], section=A.ErrorSection(step=0.2))
    scene = study.view("error_1")
    factor = float(re.findall(r"enlarged (\d+) times", scene.note)[0])
    boxes = [body for body in scene.bodies if body.opacity < 1]
    assert len(boxes) == 49 and all(body.closed for body in boxes)
    inverse, worst = robot.causal(known="T", targets="q"), []
    for body in boxes:
        T = body.vertices.mean(axis=0)
        u = T - (np.asarray(robot.A) + inverse(T)[0][:, None] * np.asarray(robot.v))
        u /= np.linalg.norm(u, axis=1)[:, None]
        errors = (body.vertices - T) / factor
        assert np.allclose(np.abs(errors @ u.T), largest, rtol=ROUNDED)
        a, b, c = np.moveaxis((body.vertices - T)[body.faces], 1, 0)
        assert np.all(np.einsum("fi,fi->f", a, np.cross(b, c)) > 0)
        worst.append(np.linalg.norm(errors, axis=1).max())
    ranges = re.findall(r"([\d.]+) to ([\d.]+) µm", " ".join(body.name for body in scene.bodies))
    assert np.isclose(1e6 * min(worst), float(ranges[0][0]), rtol=DIGITS)
    assert np.isclose(1e6 * max(worst), float(ranges[-1][1]), rtol=DIGITS)


def test_the_best_cameras_stand_where_the_table_says() -> None:
    V = gt.vision.robot_cameras
    scene, places = V.SyntheticRobotCameras(counts=[3, 3, 3]), V.CameraPlaces(baselines=[0.5, 1.5], distances=[3.2])
    study = V.places_study(gt.robots.gantry_tau("l1_tape"), scene, places)
    assert study.places is not None
    drawn = study.view()
    bodies = {body.name: body.vertices[0] for body in drawn.bodies}
    assert np.isclose(np.linalg.norm(bodies["left"] - bodies["right"]), study.places[0]["baseline_m"], atol=SAME)
    assert "baseline 1.5 m, distance 3.2 m" in drawn.title and any(body.opacity < 1 for body in drawn.bodies)


def test_postures_reach_the_same_pose() -> None:
    study = postures()
    scene = study.view()
    tool = next(part for part in scene.parts if part.shape == "path").points[0]
    count = len(study.each)
    assert scene.unit == "posture" and len(scene.time) == count > 1
    where = [scene.at(tool, float(k)) for k in scene.time]
    assert np.allclose(where, where[0], rtol=0, atol=SAME)
    elbow = np.asarray(scene.points["link_1.after"])
    assert np.ptp(elbow, axis=0).max() > 0.1  # by different ways


def test_a_path_of_an_arm_plays_in_the_chosen_postures() -> None:
    arm = gt.robots.serial_arm(a=[0.4, 0.3, 0.0], alpha=[0.0, np.pi, 0.0], joints="rrp")
    way = np.column_stack([np.linspace(0.4, 0.6, 5), np.full(5, 0.3), np.full(5, -0.1)])
    scene = gt.kinematics.postures_study(arm, gt.kinematics.ToolPoses(way), path=True).view("path")
    tool = next(part for part in scene.parts if part.shape == "path").points[0]
    assert scene.unit == "pose" and np.allclose([scene.at(tool, k) for k in scene.time], way, rtol=0, atol=SAME)


def test_a_folder_of_a_closed_loop_moves_as_it_was_simulated(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    gtmodel = Commands(capsys)
    assert gtmodel("solve", "loop_simulation", "--out", "loop").code == 0
    assert not Path("loop/loop.scene.json").exists()  # nobody asked for it: the page is made when it is
    assert gtmodel("view", "loop").code == 0
    _, points = decoded(Path("loop.html").read_text())
    table = np.loadtxt("loop/trajectory.csv", delimiter=",", comments=("#", "time"))
    robot = gt.robots.gantry_tau("l1_tape")
    T, _ = robot.causal(known="q", targets="T")(table[[0, -1], 4:7])
    assert np.allclose(np.asarray(points["arm[0].tip"])[[0, -1]], T, atol=1e-6)


def test_a_document_gives_the_scene_again() -> None:
    for scene in (
        cameras().view(),
        workspace().view(),
        postures().view(),
        gt.view.scene(*l1(), limits={"tau": (-7.0, 7.0)}),
    ):
        document = scene.document()
        again = gt.view.RobotScene.of(json.loads(json.dumps(document)))
        assert again.document() == document and len(again.html().encode()) < LARGEST
        assert again.html() == scene.html() and "://" not in again.html()


def test_result_folders_are_shown(capsys: pytest.CaptureFixture[str], tmp_path: Path,
                                  monkeypatch: pytest.MonkeyPatch) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    gtmodel = Commands(capsys)
    compliance().write("modes", plot=True)
    assert {p.name for p in Path("modes").glob("*.scene.json")} == {
        f"{name}.scene.json" for name in compliance().scenes
    }
    done = gtmodel("view", "modes", "-o", "first.html")
    assert done.code == 0 and "gtmodel view modes/mode_2\n" in done.err
    assert gtmodel("view", "modes/mode_2.scene.json", "-o", "second.html").code == 0
    titles = [decoded(Path(f"{name}.html").read_text())[0]["title"] for name in ("first", "second")]
    assert "mode 1" in titles[0] and "mode 2" in titles[1]
    assert gtmodel("view", "modes", "-o", "at.png", "--at", "0.5").code == 0
    assert gtmodel("view", "modes", "-o", "at.png", "--at", "9").code == 2
    assert gtmodel("view", "modes", "-o", "at.html", "--at", "0.5").code == 2
    Path("broken.scene.json").write_text("[1]")
    assert gtmodel("view", "broken.scene.json").code == 2
    coarse = ("--set", "mesh.elements=5")
    assert gtmodel("solve", "delta_motion", "--out", "delta", *coarse).code < 2  # an optimisation with a robot inside
    assert gtmodel("view", "delta").code == 0
    document, points = decoded(Path("delta.html").read_text())
    motion = gt.results.read("delta").trajectory
    (tool,) = [part[1][0] for part in document["parts"] if part[0] == "path"]
    assert motion is not None and np.allclose(points[[*points][tool]][-1], motion["robot.T"][-1], atol=SAME)


def test_a_scene_that_was_not_kept_is_made_again(capsys: pytest.CaptureFixture[str], tmp_path: Path,
                                                  monkeypatch: pytest.MonkeyPatch) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    gtmodel = Commands(capsys)
    coarse = ("--set", "section.step_m=0.5")
    for folder, option in (("bare", ()), ("kept", ("--plot",))):
        assert gtmodel("solve", "compliance_l1", *coarse, "--out", folder, *option).code == 0
        for name in ("mode_2", "mode_2.scene.json"):
            assert gtmodel("view", f"{folder}/{name}", "-o", f"{folder}.{name}.html").code == 0
    assert not list(Path("bare").glob("*.scene.json")) and Path("kept/mode_2.scene.json").exists()
    assert len({p.read_bytes() for p in Path().glob("*.html")}) == 1
    assert gtmodel("view", "bare/mode_9").code == 2
    stored = json.loads(Path("bare/result.json").read_text())
    stored["values"]["stiffness_N_m"][0] *= 1.001  # as if a file that it read had been another one
    Path("bare/result.json").write_text(json.dumps(stored))
    assert "--plot" in gtmodel("view", "bare").err


def test_what_must_not_be_used_says_so_in_space_too(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    gtmodel = Commands(capsys)
    bar = gt.view.RobotScene({"a": [0.0, 0.0, 0.0]}, [], note="A bar.")
    for status in gt.SolveStatus:
        study = gt.results.Study(status=status, scenes={"bar": lambda: bar})
        note = study.view().note
        assert note.endswith("A bar.") and status.ok == (note == "A bar.") and (status.ok or status.message in note)
        study.write(status.value, plot=True)
        stored = json.loads(Path(status.value, "bar.scene.json").read_text())
        assert stored["note"] == note
    assert gtmodel("solve", "l1_drop", "--set", "final_time_s=0.2", "--set", "tolerance=1e-3", "--out", "drop").code < 2
    result = json.loads(Path("drop/result.json").read_text())
    Path("drop/result.json").write_text(json.dumps(result | {"status": "interrupted"}))
    assert gtmodel("view", "drop").code == 0
    assert "the run was stopped early" in decoded(Path("drop.html").read_text())[0]["note"]


def test_a_scene_that_cannot_be_drawn_loses_no_result(tmp_path: Path) -> None:
    def broken() -> None:
        raise RuntimeError("not today")

    study = gt.results.Study(status=gt.SolveStatus.SOLVED, scenes={"broken": broken, "motion": broken})
    study.write(tmp_path / "out", plot=True)
    assert json.loads((tmp_path / "out" / "broken.scene.json").read_text()) == {"fault": "RuntimeError: not today"}
    assert not (tmp_path / "out" / "motion.scene.json").exists()


def test_pictures_and_films(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from PIL import Image

    scene = gt.view.scene(*l1())
    first, last = (pictures.png(scene, t, width=200, height=150) for t in (0.0, 2.0))
    assert first == pictures.png(scene, 0.0, width=200, height=150) and first != last
    with Image.open(io.BytesIO(first)) as picture:
        assert picture.size == (200, 150) and np.mean(np.asarray(picture.convert("L")) < 200) > 0.005
    marked = scene.with_(bodies=[gt.view.dots([scene.at("arm[0].tip", 0.0)], name="here", colour="#ff00ff")])
    pixels = np.asarray(Image.open(io.BytesIO(pictures.png(marked, 0.0, width=200, height=150))).convert("RGB"), int)
    assert np.sum(np.abs(pixels - [255, 0, 255]).sum(axis=2) < 60) > 10
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(gt.results.ArgumentError, match="needs the program ffmpeg"):
        scene.write(tmp_path / "film.mp4")


def test_a_picture_says_what_it_shows_within_its_width() -> None:
    """Without a page around it: title, which of the poses, note and width of the grid, in lines."""
    from PIL import Image

    def dark(scene: Any, time: float) -> Any:
        content = pictures.png(scene, time, width=200, height=240)
        return np.asarray(Image.open(io.BytesIO(content)).convert("L")) < 130

    empty = gt.view.RobotScene({"a": [0.0, 0.0, 0.0], "b": [0.1, 0.1, 0.1]}, [], time=[1.0, 2.0], unit="mode")
    first, second = (dark(empty.with_(title="Modes"), t) for t in (1.0, 2.0))
    assert first[:40].any() and np.any(first != second)  # by the number of the mode alone
    one, many = (dark(empty.with_(note=note), 1.0) for note in ("A note.", "Words of a long note. " * 10))
    assert not many[:, -8:].any() and not one[:-30].any(axis=1)[40:].any() and many[:-60].any(axis=1)[40:].any()


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="no ffmpeg here")
def test_a_film_is_the_same_each_time() -> None:
    scene = gt.view.scene(*l1())
    film = pictures.mp4(scene, width=64, height=48, rate=5.0)
    assert film[4:8] == b"ftyp" and film == pictures.mp4(scene, width=64, height=48, rate=5.0)


def played(scene: Any, folder: Path) -> dict[str, Any]:
    """What the script of the page does on a canvas that counts."""
    assert NODE is not None
    page = scene.write(folder / "page.html")
    command = [NODE, str(Path(__file__).with_name("fake_browser.js")), str(page)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.skipif(NODE is None, reason="no node here")
@pytest.mark.parametrize(
    "make",
    [lambda: gt.view.scene(*l1()), lambda: cameras().view(), lambda: workspace().view(), lambda: postures().view()],
)
def test_the_script_draws_turns_and_plays(make: Callable[[], Any], tmp_path: Path) -> None:
    scene = make()
    seen = played(scene, tmp_path)
    assert seen["strokes"] > 100 and seen["finite"] and seen["focusable"]
    assert all(seen["keys"].values()), seen["keys"]
    assert str(len(scene.parts) + len(scene.bodies)) in seen["label"]
    assert seen["legend"] == [body.name for body in scene.bodies if body.marker and body.name]
    if len(scene.time) > 1:
        assert seen["slider"] and seen["plays"] and seen["ends"]


@pytest.mark.skipif(NODE is None, reason="no node here")
def test_the_script_places_bodies_where_points_are(tmp_path: Path) -> None:
    """Two roads to the same pixel: a point given in the world, and a mark given in a turning frame."""
    angle = 0.7
    R = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    r, own = np.array([0.3, -0.2, 0.5]), np.array([0.4, 0.1, -0.2])
    corners = {f"corner {k}": x for k, x in enumerate(np.eye(3))}
    scene = gt.view.RobotScene(
        {**corners, "point": R @ own + r}, [gt.view.VisiblePart("joint", ("point",))],
        frames={"frame": np.column_stack([R, r])}, bodies=[gt.view.VisibleBody([own], marker="ring", frame="frame")],
    )  # fmt: skip
    arcs = np.array(played(scene, tmp_path)["arcs"])
    assert len(arcs) == 3  # joint, its highlight, and the ring
    gaps = np.linalg.norm(arcs[:, None] - arcs, axis=2) + np.eye(3)
    assert gaps.min() < 1e-3  # pixels


def test_boards_lie_where_the_cameras_see_them() -> None:
    """From the drawn boards and pyramids, with the lenses' distortion, back to the pixels that were measured."""
    from gtmodel.geometry.pinhole import distorted
    from gtmodel.vision.stereo.synthetic import SyntheticBoards, made_corners

    board = gt.vision.BoardPictures(width_pixel=640, height_pixel=480, columns=9, rows=6, square=0.03)
    table = made_corners(SyntheticBoards(pictures=8), board)[0]
    study = gt.vision.stereo_study(table, board)
    bodies = {body.name: body.vertices for body in study.view().bodies if not body.marker}
    low, high = table.X[:, :2].min(axis=0), table.X[:, :2].max(axis=0)
    for c, camera in enumerate(table.cameras):
        centre, *corners = bodies[f"camera {camera}"]
        first, right, _, below = (corner - centre for corner in corners)
        across = np.column_stack([(right - first) / 639.0, (below - first) / 479.0, first])  # of a pixel, and to (0, 0)
        lens = study.lens[camera]
        for p in (0, 5):
            rows = (table.camera == c) & (table.picture == p)
            origin, along, _, up = bodies[f"picture {table.pictures[p]}"]
            part = (table.X[rows, :2] - low) / (high - low)
            corners_in_space = origin + part @ np.array([along - origin, up - origin])
            u, v, scale = np.linalg.solve(across, (corners_in_space - centre).T)
            x, y = (u / scale - lens["cx"]) / lens["fx"], (v / scale - lens["cy"]) / lens["fy"]
            x, y = distorted(x, y, [lens[k] for k in ("k1", "k2", "p1", "p2", "k3")])
            pixels = np.column_stack([lens["fx"] * x + lens["cx"], lens["fy"] * y + lens["cy"]])
            assert np.abs(pixels - table.uv[rows]).max() < 1.0  # noise of 0.1 to 0.2 pixel
