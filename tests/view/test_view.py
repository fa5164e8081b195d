"""The page of a robot in space, decoded: its parts are where the kinematics put them."""

from __future__ import annotations

import io
import json
import re
import shutil
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.view import RobotScene, VisiblePart
from gtmodel.view.pictures import gif
from tests.support.commands import Commands
from tests.support.pages import read

PROBLEMS = Path(__file__).resolve().parents[2] / "problems"
SAME = 1e-6  # m; a page has 0.1 um
LARGEST = 6_000_000  # bytes
INSTANTS = (0, 17, 40)
TIME = np.linspace(0.0, 2.0, 41)


def decoded(page: str) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """The data of a page, and its points (n, 3) by name, also of those that stand still."""
    (data,) = re.findall(r'<script type="application/json" id="scene">(.*?)</script>', page, re.DOTALL)
    document = json.loads(data)
    count = len(document["time"])
    return document, {n: np.broadcast_to(p, (count, 3)) for n, p in document["points"].items()}


@cache
def l1() -> tuple[Any, gt.Trajectory]:
    robot = gt.robots.gantry_tau("l1_tape")
    way = np.array([0.0, -0.9, 0.1]) + TIME[:, None] / 2 * [0.9, 0.0, 0.35]
    tau = np.outer(np.sin(TIME), [100.0, -50.0, 20.0])
    return robot, gt.Trajectory(TIME, {"T": way, "tau": tau}, {"T": "m", "tau": "N"}, title="a line")


def test_rods_and_carts_of_the_l1_are_where_they_are() -> None:
    """Another way to the carts: the root of |T - A - q v| = L behind the plate."""
    robot, motion = l1()
    page = gt.view.scene(robot, motion, limits={"tau": (-700.0, 700.0)}).html()
    document, points = decoded(page)
    names = list(points)
    rods = [[names[k] for k in of] for shape, of, name, _ in document["parts"] if name.endswith(".rod")]
    carts = [names[of[0]] for shape, of, *_ in document["parts"] if shape == "cart"]
    assert len(rods) == 3 and sorted(carts) == sorted(ends[0] for ends in rods)
    for k, (cart, plate) in enumerate(rods):
        A, v, L = (np.asarray(x)[k] for x in (robot.A, robot.v, robot.L))
        for n in INSTANTS:
            T = motion["T"][n]
            roots = np.roots([v @ v, -2 * v @ (T - A), (T - A) @ (T - A) - L**2])
            q = float(np.min(roots.real))
            assert np.allclose(points[cart][n], A + q * v, rtol=0, atol=SAME)
            assert np.allclose(points[plate][n], T, rtol=0, atol=SAME)
    shapes = [part[0] for part in document["parts"]]
    assert shapes.count("guideway") == 3 and shapes.count("path") == 1
    assert document["time"] == pytest.approx(TIME.tolist())
    (force,) = [s for s in document["signals"] if s["name"] == "tau"]
    assert force["unit"] == "N" and force["limits"] == [-700.0, 700.0]
    assert np.allclose(np.transpose(force["values"]), motion["tau"], rtol=1e-5)


def test_an_arm_is_the_product_of_its_transformations() -> None:
    robot = gt.load_robot(PROBLEMS / "models" / "six_axis_arm.toml")
    q = 0.4 * np.sin(TIME[:, None] + np.arange(6))
    document, points = decoded(gt.view.scene(robot, gt.Trajectory(TIME, {"q": q}, {"q": "rad"})).html())
    (axes,) = [of for shape, of, *_ in document["parts"] if shape == "axes"]
    origin, *ends = (points[list(points)[k]] for k in axes)
    for n in INSTANTS:
        pose = np.eye(4)
        for j in range(6):
            c, s = np.cos(robot.theta[j] + q[n, j]), np.sin(robot.theta[j] + q[n, j])
            ca, sa = np.cos(robot.alpha[j]), np.sin(robot.alpha[j])
            a, d = robot.a[j], robot.d[j]
            pose = pose @ [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
        tool = pose @ [*robot.tool_xyz, 1.0]
        assert np.allclose(origin[n], tool[:3], rtol=0, atol=SAME)
        lengths = [np.linalg.norm(end[n] - origin[n]) for end in ends]
        directions = np.stack([(end[n] - origin[n]) / x for end, x in zip(ends, lengths, strict=True)], axis=1)
        assert np.allclose(directions, pose[:3, :3], rtol=0, atol=1e-5)  # 0.1 um at the ends of axes of 10 cm


def test_without_a_motion_the_drives_move_and_rods_keep_their_lengths() -> None:
    robot = gt.load_robot(f"{PROBLEMS / 'models' / 'mechanisms.py'}:ThreeArms")
    scene = gt.view.scene(robot)
    assert len(scene.time) > 3 * 20 and scene.html() == gt.view.scene(robot).html()
    document, points = decoded(scene.html())
    names = list(points)
    rods = [of for shape, of, name, _ in document["parts"] if shape == "bar" and name.startswith("rod[")]
    assert len(rods) == 3
    for of, L in zip(rods, robot.lower, strict=True):
        a, b = (points[names[k]] for k in of)
        assert np.allclose(np.linalg.norm(b - a, axis=1), L, rtol=0, atol=SAME)
        assert np.ptp(a, axis=0).max() > 0.01


def test_a_page_asks_nothing_of_a_network_and_is_small() -> None:
    robot, motion = l1()
    page = gt.view.scene(robot, motion, title="</script> & <b>").html()
    assert read(page).asked == [] and "://" not in page and len(page.encode()) < LARGEST
    assert decoded(page)[0]["title"] == "</script> & <b>"
    assert 'srcdoc="' in gt.view.scene(robot, motion)._repr_html_()


def test_a_motion_as_an_animated_picture() -> None:
    from PIL import Image

    scene = gt.view.scene(*l1())
    content = gif(scene, width=160, height=120)
    assert content == gif(scene, width=160, height=120)
    with Image.open(io.BytesIO(content)) as picture:
        assert getattr(picture, "n_frames", 1) == 41 and picture.info["duration"] == 50  # 2 s
        first = np.asarray(picture.convert("RGB"))
        picture.seek(40)
        assert np.mean(first != np.asarray(picture.convert("RGB"))) > 0.005


def test_what_is_wrong_is_refused() -> None:
    robot, motion = l1()
    with pytest.raises(gt.results.ArgumentError, match="does not determine") as caught:
        gt.view.scene(robot, gt.Trajectory(TIME, {"T": motion["T"] + 9.0}, {"T": "m"}))
    assert caught.value.argument == "motion"
    with pytest.raises(gt.results.ArgumentError) as caught:
        gt.view.scene(gt.load_robot(f"{PROBLEMS / 'models' / 'pendulum.py'}:Pendulum"))
    assert caught.value.argument == "robot"
    for points, parts, argument in (({"a": [0.0, 0.0]}, [], "points"), ({}, [VisiblePart("joint", ("b",))], "parts")):
        with pytest.raises(gt.results.ArgumentError) as caught:
            RobotScene(points, parts)
        assert caught.value.argument == argument
    with pytest.raises(gt.results.ArgumentError, match="there is no view ''; there are none"):
        gt.results.Study(status=gt.SolveStatus.SOLVED).view()


def test_the_command_shows_a_robot_and_a_result(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    gtmodel = Commands(capsys)
    assert gtmodel("solve", "l1_drop", "--set", "final_time_s=0.1", "--out", "drop").code == 0
    assert gtmodel("view", "drop").code == 0 and gtmodel("view", "drop").code == 0
    document, points = decoded(Path("drop.html").read_text())
    motion = gt.results.read("drop").trajectory
    assert motion is not None and document["title"] == "Drop of the L1 prototype, motors off"
    for n in (0, 20, 50):
        assert np.allclose(points["arm[0].tip"][n], motion["T"][n], atol=SAME)
    view = gt.load("l1_drop", "final_time_s=0.1")().view()
    assert np.allclose(view.at("arm[0].tip", 0.1), motion["T"][-1], atol=SAME)
    assert gtmodel("view", "kr500", "-o", "arm.html").code == 0 and Path("arm.html").stat().st_size < LARGEST
    Path("mine.html").write_text("mine")
    assert gtmodel("view", "kr500", "-o", "mine.html").code == 2 and Path("mine.html").read_text() == "mine"
    assert gtmodel("view", "nonsense").code == 2
    Path("mine.gif").write_text("mine")
    assert gtmodel("view", "drop", "-o", "mine.gif").code == 2 and Path("mine.gif").read_text() == "mine"
    assert gtmodel("view", "drop/result.json", "-o", "drop.gif").code == gtmodel("view", "drop", "-o", "drop.gif").code
    assert gtmodel("view", "drop", "-o", "drop.jpg").code == 2 and not Path("drop.jpg").exists()
    for file in ("drop.png", "drop.png"):  # its own picture is written over
        assert gtmodel("view", "drop", "-o", file).code == 0
    Path("mine.png").write_text("mine")
    assert gtmodel("view", "drop", "-o", "mine.png").code == 2 and Path("mine.png").read_text() == "mine"
    gtmodel("solve", "van_der_pol", "--out", "not a robot")
    assert gtmodel("view", "not a robot").code == 2
    assert "wrote FiveBar.html" in gtmodel("view", f"{PROBLEMS / 'models' / 'mechanisms.py'}:FiveBar").out
    done = gtmodel("view", "l1_drop")
    assert done.code == 2 and "gtmodel solve l1_drop --out DIR" in done.sentence


@pytest.mark.proof
def test_a_browser_shows_it(tmp_path: Path) -> None:
    """No console message, which a request to a network would cause, the first frame is not blank, and another instant
    is another picture."""
    browser = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("no Chromium here")
    matplotlib_image = pytest.importorskip("matplotlib.image")
    robot, motion = l1()
    ball = {"plate.frame": gt.view.Sphere(0.1)}
    marks = gt.view.dots(motion["T"], marker="cross", name="way")
    scene = gt.view.scene(robot, motion, visual=ball)
    page = scene.with_(bodies=[*scene.bodies, marks]).write(tmp_path / "l1.html")
    pictures = []
    for instant in ("", "#2.0"):
        file = tmp_path / f"shot{len(pictures)}.png"
        options = ["--headless", "--no-sandbox", "--disable-gpu", "--window-size=800,600", "--enable-logging=stderr"]
        command = [browser, *options, f"--screenshot={file}", f"file://{page}{instant}"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120)
        assert "CONSOLE" not in done.stderr
        pictures.append(matplotlib_image.imread(file)[..., :3])
    first, second = pictures
    assert np.mean(first[50:500] < 0.9) > 0.01  # a hundredth of the middle is drawn on
    assert np.mean(np.abs(first - second).max(axis=2) > 0.1) > 0.005
