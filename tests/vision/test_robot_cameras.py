"""A robot and cameras calibrated together, on synthetic pictures whose truth is known."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.geometry.quaternions import quaternion_matrix, quaternion_of
from gtmodel.inference import binomial_band
from gtmodel.inference.bundle import bundle_fit
from gtmodel.vision.robot_cameras import joint as joint_module, joint as motions
from gtmodel.vision.robot_cameras.joint import Prepared
from gtmodel.vision.robot_cameras.projection import robot_side

V = gt.vision.robot_cameras

ROBOT = gt.robots.gantry_tau("l1_tape")
SMALL = V.SyntheticRobotCameras(counts=[4, 4, 4])
HALF = 0.3e-3  # m: held-out error at 0.1 pixel, of the issue
EVEN = 1e-10  # another order of the same data: rounding


def halves(p: V.RobotPictures) -> tuple[V.RobotPictures, V.RobotPictures]:
    rows = np.arange(len(p.poses))
    return p.part(rows[::2]), p.part(rows[1::2])


def held_out(fit: V.JointFit | V.TwoStepFit, unseen: V.RobotPictures, scale: bool = False) -> float:
    assert unseen.truth is not None
    return float(V.aligned_errors(fit.positions(unseen.actuators), unseen.truth, scale).mean())


def true_starts(made: V.MadePictures, off: tuple[float, float] = (0.0, 0.0)) -> list[V.CameraStart]:
    """The true cameras, their principal points off along u [pixel]."""
    return [
        replace(c, focal_pixel=float(t[0]), principal_point_pixel=[float(t[2]) + d, float(t[3])],
                distortion=t[4:9].tolist())
        for c, t, d in zip(made.cameras, made.true_cameras, off, strict=True)
    ]  # fmt: skip


@pytest.fixture(scope="module")
def small() -> tuple[V.MadePictures, V.JointFit]:
    made = V.made_pictures(SMALL)
    return made, V.joint_fit(ROBOT, made.pictures, made.cameras)


def test_pictures_without_noise_give_the_true_robot_and_cameras():
    made = V.made_pictures(replace(SMALL, pixel_noise=0.0, actuator_noise=0.0))
    p = replace(made.pictures, sigma=np.full(len(made.pictures), 0.1))
    joint = V.joint_fit(ROBOT, p, made.cameras)
    assert joint.fit.status.ok
    np.testing.assert_allclose(joint.residuals, 0.0, atol=1e-6)
    for name, value in joint.parameters.items():
        assert value == pytest.approx(made.true_parameters[name], abs=1e-8), name
    np.testing.assert_allclose(joint.fit.values["camera"][:, :4], made.true_cameras[:, :4], atol=1e-4)
    np.testing.assert_allclose(joint.fit.values["camera"][:, 13:], made.true_cameras[:, 13:], atol=1e-7)


@pytest.mark.parametrize(("scene", "setting"), [
    ({}, {}),
    ({}, {"scale": "actuators"}),
    ({"second_device": 6}, {"scale": "second_device"}),
    ({"cameras": 1}, {}),
    ({"mounted": "plate", "cameras": 1, "distance": 2.5}, {"mounted": "plate"}),
    ({"mounted": "plate", "baseline": 0.3, "distance": 2.5}, {"mounted": "plate"}),
], ids=["two", "actuators", "second device", "one camera", "camera on the plate", "two on the plate"])  # fmt: skip
def test_every_arrangement_is_calibrated_within_three_tenths_of_a_millimetre(scene, setting):
    made = V.made_pictures(replace(SMALL, counts=[6, 5, 5], **scene))
    fitted, unseen = halves(made.pictures)
    joint = V.joint_fit(ROBOT, fitted, made.cameras, V.RobotCameras(**setting))
    assert joint.fit.status.ok
    assert held_out(joint, unseen) < HALF
    # positions of the truth within the error that the covariance predicts, times three
    assert held_out(joint, unseen) < 3 * V.predicted_positions(joint, unseen.actuators).rms


def test_residuals_have_the_size_of_the_noise(small):
    _, joint = small
    e = joint.estimate
    rows, unknowns = joint.residuals.size + 3 * 64, len(e.names) + 3 * 64
    white = (joint.residuals / 0.1) ** 2
    links = joint.fit.residuals["links"] ** 2
    assert (white.sum() + links.sum()) / (rows - unknowns) == pytest.approx(1.0, abs=5 * np.sqrt(2 / (rows - unknowns)))
    assert e.degrees_of_freedom == rows - unknowns


def test_order_of_poses_cameras_and_marks_changes_nothing(small):
    made, joint = small
    p = made.pictures
    rng = np.random.default_rng(4)
    order = rng.permutation(len(p))
    poses, marks = rng.permutation(len(p.poses)), rng.permutation(len(p.marks))
    where, place = np.argsort(poses), np.argsort(marks)
    mixed = V.RobotPictures(
        p.cameras[::-1], [p.poses[k] for k in poses], [p.marks[k] for k in marks], 1 - p.camera[order],
        where[p.pose[order]], place[p.mark[order]], p.uv[order], p.sigma[order], p.actuators[poses], p.target[marks],
    )  # fmt: skip
    other = V.joint_fit(ROBOT, mixed, made.cameras[::-1])
    own = np.array(list(joint.parameters.values()))
    np.testing.assert_allclose(list(other.parameters.values()), own, atol=EVEN)
    np.testing.assert_allclose(other.fit.values["camera"][::-1, :4], joint.fit.values["camera"][:, :4], rtol=EVEN)


def test_a_wrong_picture_and_wrong_corners_are_named():
    """One picture of 125 counted from the other end, and 5 % of the corners 2 to 20 pixels off."""
    clean = V.made_pictures(V.SyntheticRobotCameras(counts=[5, 5, 5], seed=3))
    made = V.made_pictures(V.SyntheticRobotCameras(counts=[5, 5, 5], seed=3, turned_pictures=[17], wrong_corners=0.05))
    joint = V.joint_fit(ROBOT, made.pictures, made.cameras)
    assert joint.wrong_pictures == ("pose 18 in left",)
    p, q = made.pictures, clean.pictures
    true = {p.where(int(k)) for k in np.flatnonzero(np.abs(p.uv - q.uv).max(axis=1) > 1.0)}
    true = {w for w in true if "of pose 18 in left" not in w}
    named = set(joint.wrong_corners)
    assert len(true) > 150
    assert true <= named
    assert len(named - true) <= 0.005 * len(p)
    inside = [abs(v - made.true_parameters[n]) < 3 * joint.estimate.std[joint.estimate.names.index(f"robot.{n}")]
              for n, v in joint.parameters.items()]  # fmt: skip
    assert np.mean(inside) > 0.9
    fx = joint.estimate
    for name in ("left.fx", "right.fx"):
        assert abs(fx.value(name) - 1400) < 3 * fx.std[fx.names.index(name)]


def test_a_late_clock_of_the_cameras_is_estimated_with_the_rest():
    scene = replace(SMALL, counts=[5, 4, 4], delay=0.02, speed=0.1)
    made = V.made_pictures(scene)
    fitted, unseen = halves(made.pictures)
    joint = V.joint_fit(ROBOT, fitted, made.cameras, V.RobotCameras(late=True))
    low, high = joint.estimate.interval("clock.delay", 0.999)
    assert low < 0.02 < high
    assert high - low < 0.002
    assert unseen.rates is not None and unseen.truth is not None
    late = joint.positions(unseen.actuators + joint.delay * unseen.rates)
    assert V.aligned_errors(late, unseen.truth).mean() < HALF
    blind = V.joint_fit(ROBOT, fitted, made.cameras, V.RobotCameras(removal=0.0))
    ratio = np.sqrt(np.mean(blind.fit.residuals["links"] ** 2))
    assert ratio > 10  # 2 mm of displacement against 13 um: what is ignored is seen
    with pytest.raises(gt.results.ArgumentError) as error:
        V.joint_fit(ROBOT, replace(fitted, rates=None), made.cameras, V.RobotCameras(late=True))
    assert error.value.argument == "rates"


# --- what is left open ------------------------------------------------------------------------------------------------


def free(ready: Prepared, p: V.RobotPictures, cameras: bool, target: bool, scale: bool):
    """The bundle with nothing of the robot held, and of the others what is asked."""
    ready = replace(
        ready,
        camera_fixed=np.where(np.arange(15) >= 9, not cameras, ready.camera_fixed),
        target_fixed=np.array([False] * 3 + [not target] * 3 + [not scale]),
    )
    kept = {}

    def keep(groups, blocks, **more):
        kept["fit"] = bundle_fit(groups, blocks, **{**more, "hold_undetermined": True, "covariance": True})
        return kept["fit"]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(joint_module, "bundle_fit", keep)
        ready.fit(p)
    return kept["fit"]


@pytest.mark.parametrize(("cameras", "target", "scale", "expected"), [
    (True, True, True, 10), (True, True, False, 9), (True, False, False, 6), (False, False, False, 0),
])  # fmt: skip
def test_redundancies_between_robot_and_cameras_are_counted_and_named(cameras, target, scale, expected):
    """Six of the base against the cameras, three of the tool centre point against the target, one of the scale."""
    made = V.made_pictures(replace(SMALL, counts=[3, 3, 3]))
    setting = V.RobotCameras(hold=[], scale="actuators")
    ready = Prepared.of(ROBOT, made.pictures, made.cameras, setting)
    assert len(ready.side.unknowns.names) == 21
    fit = free(ready, made.pictures, cameras, target, scale)
    assert fit.undetermined == expected
    assert len(fit.notes) == expected
    words = " ".join(fit.notes)
    assert ("the robot's base and the cameras move together" in words) == cameras
    assert ("everything grows by one factor" in words) == scale
    assert ("the tool centre point moves along" in words) == target


def test_metres_are_refused_without_a_length():
    made = V.made_pictures(replace(SMALL, counts=[3, 3, 3]))
    hold = ["A[2]", "v[2,1]", "v[2,2]", "A[0,1]"]  # the base frame, and no unit
    with pytest.raises(gt.results.ArgumentError, match="grows by one factor: give one known length"):
        V.joint_fit(ROBOT, made.pictures, made.cameras, V.RobotCameras(scale="actuators", hold=hold))


def test_motions_are_those_of_a_finite_turn():
    """The direction of a turn about z against a small turn of everything, by central differences."""
    made = V.made_pictures(replace(SMALL, counts=[3, 3, 3]))
    setting = V.RobotCameras(hold=[], scale="actuators")
    ready = Prepared.of(ROBOT, made.pictures, made.cameras, setting)
    turn = motions.redundancies(ready.side, made.pictures.actuators, True)[5]
    step = turn.direction(ready.start)
    h = 1e-4

    def turned(angle: float) -> np.ndarray:
        R = quaternion_matrix(np.array([np.cos(angle / 2), 0, 0, np.sin(angle / 2)]))
        return ready.start["camera"][:, 13:] @ R.T

    np.testing.assert_allclose(step["camera"][:, 12:], (turned(h) - turned(-h)) / (2 * h), atol=1e-7)
    # parameters of the robot turn too: cart joints and directions
    names = ready.side.unknowns.names
    A = ready.start["robot"][0][[names.index(f"A[1,{k}]") for k in range(3)]]
    moved = step["robot"][0][[names.index(f"A[1,{k}]") for k in range(3)]]
    np.testing.assert_allclose(moved - moved[2] * np.eye(3)[2], np.cross([0, 0, 1], A), atol=1e-2)


# --- refusals ---------------------------------------------------------------------------------------------------------


def test_what_cannot_be_calibrated_is_refused_by_argument():
    made = V.made_pictures(replace(SMALL, counts=[3, 3, 3]))
    p = made.pictures

    def refused(call, argument: str) -> None:
        with pytest.raises(gt.results.ArgumentError) as error:
            call()
        assert error.value.argument == argument

    refused(lambda: V.joint_fit(ROBOT, p, made.cameras[:1]), "cameras")
    refused(lambda: V.joint_fit(ROBOT, p, made.cameras, V.RobotCameras(estimate=["distortion"])), "cameras")
    refused(lambda: V.joint_fit(ROBOT, p, made.cameras, V.RobotCameras(scale="second_device")), "device")
    refused(lambda: replace(p, uv=p.uv[:5]), "corners")
    refused(lambda: replace(p, pose=np.where(np.arange(len(p)) == 25, 0, p.pose)), "corners")  # seen twice
    refused(lambda: V.joint_fit(ROBOT, replace(p, actuators=1000 * p.actuators), made.cameras), "q")
    refused(lambda: V.two_step_fit(ROBOT, p, made.cameras, V.RobotCameras(mounted="plate")), "mounted")
    mirrored = replace(p, uv=np.column_stack([1599 - p.uv[:, 0], p.uv[:, 1]]))
    refused(lambda: V.joint_fit(ROBOT, mirrored, made.cameras), "corners")


# --- the experiment of the thesis -------------------------------------------------------------------------------------


def experiment(seed: int):
    """282 poses, half held out, five squares; principal points held 3 pixels off in opposite directions."""
    made = V.made_pictures(V.SyntheticRobotCameras(poses=282, seed=seed))
    fitted, unseen = halves(made.pictures)
    return made, fitted, unseen, true_starts(made, (3.0, -3.0))


@pytest.mark.parametrize("seed", [1, 2])
def test_the_joint_fit_reaches_three_tenths_of_a_millimetre(seed):
    made, fitted, unseen, _ = experiment(seed)
    joint = V.joint_fit(ROBOT, fitted, made.cameras)
    assert held_out(joint, unseen) < HALF
    assert V.picture_map(joint.pictures, joint.residuals).fires() == ()


@pytest.mark.parametrize("seed", [1, 2])
def test_a_principal_point_held_wrong_explains_the_printed_error(seed):
    """An explanation and no proof: 1.5 to 2 mm on held-out poses, scale fitted as to the tracker, by the way of section
    5.5; its own residuals show nothing, those of the joint fit do, and not along the radius."""
    _, fitted, unseen, wrong = experiment(seed)
    held = V.RobotCameras(estimate=[], scale="actuators")
    two = V.two_step_fit(ROBOT, fitted, wrong, held)
    assert 1.5e-3 < held_out(two, unseen, scale=True) < 2.0e-3
    assert V.picture_map(fitted, two.residuals).fires() == ()
    joint = V.joint_fit(ROBOT, fitted, wrong, held)
    test = V.picture_map(joint.pictures, joint.residuals)
    assert test.fires() == ("left", "right")
    assert test.radius.min() > 1e-3
    assert held_out(joint, unseen) < held_out(two, unseen)


def test_two_steps_with_right_cameras_reach_the_noise():
    made, fitted, unseen, _ = experiment(1)
    two = V.two_step_fit(ROBOT, fitted, true_starts(made), V.RobotCameras(estimate=[]))
    assert held_out(two, unseen) < 0.1e-3
    assert fitted.truth is not None
    errors = V.aligned_errors(two.centres, fitted.truth)
    assert 0.1e-3 < errors.mean() < 0.3e-3  # corner noise of 0.1 pixel: 0.14 mm by the note's simulation


# --- proof over many runs ---------------------------------------------------------------------------------------------

RUNS = V.SyntheticRobotCameras(counts=[3, 4, 3], seed=5)


@lru_cache(maxsize=16)
def calibrated(run: int):
    """The pictures of one draw of noise, and the calibration by them."""
    made = V.made_pictures(replace(RUNS, noise_seed=run))
    return made.pictures, V.joint_fit(ROBOT, made.pictures, made.cameras, V.RobotCameras(removal=0.0))


def repeated(runs: int, both: bool):
    """One robot and cameras under so many draws of noise: hits of 95 % intervals by name, and positions."""
    made = V.made_pictures(replace(RUNS, noise_seed=0))
    truth = {f"robot.{n}": v for n, v in made.true_parameters.items()}
    for name, camera in zip(("left", "right"), made.true_cameras, strict=True):
        truth |= {f"{name}.fx": camera[0], f"{name}.fy": camera[1]}
    hits: dict[str, list[bool]] = {}
    positions: dict[str, list[np.ndarray]] = {"joint": [], "two": []}
    q = made.pictures.actuators[::5]
    held = V.RobotCameras(estimate=[], removal=0.0)
    for run in range(runs):
        p, joint = calibrated(run)
        e = joint.estimate
        for name in e.names:
            if name in truth:
                low, high = e.interval(name)
                hits.setdefault(name, []).append(low < truth[name] < high)
        # the target's places are eliminated; the frame of the fit is that of the truth
        assert p.truth is not None
        error = np.abs(joint.fit.values["pose"][:, :3] - p.truth)
        std = np.sqrt(np.einsum("nii->ni", joint.fit.local_covariance))[:, :3]
        for k in range(0, len(p.poses), 5):
            for a, axis in enumerate("xyz"):
                hits.setdefault(f"pose {p.poses[k]}.{axis}", []).append(bool(error[k, a] < 1.96 * std[k, a]))
        baseline = _baseline(joint)
        hits.setdefault("baseline", []).append(abs(baseline[0] - 1.5) < 1.96 * baseline[1])
        if both:
            starts = true_starts(made)
            positions["joint"].append(V.joint_fit(ROBOT, p, starts, held).positions(q))
            positions["two"].append(V.two_step_fit(ROBOT, p, starts, held).positions(q))
    return hits, positions


def _baseline(joint: V.JointFit) -> tuple[float, float]:
    c = joint.fit.values["camera"][:, 13:]
    d = (c[1] - c[0]) / np.linalg.norm(c[1] - c[0])
    weights = {f"{n}.{a}": s * float(x) for n, s in (("left", -1), ("right", 1)) for a, x in zip("xyz", d, strict=True)}
    value, *_ = joint.estimate.combination(weights)
    names = list(joint.estimate.names)
    w = np.zeros(len(names))
    for n, x in weights.items():
        w[names.index(n)] = x
    assert value == pytest.approx(float(np.linalg.norm(c[1] - c[0])), abs=1e-9)
    return value, float(np.sqrt(w @ joint.estimate.covariance @ w))


def test_intervals_of_a_few_runs_are_not_far_off():
    hits, _ = repeated(12, both=False)
    pooled = np.mean([h for each in hits.values() for h in each])
    assert 0.85 < pooled <= 1.0  # parameters of a run are correlated: a rough band


@pytest.mark.proof
def test_intervals_of_400_runs_hold_the_truth_as_often_as_they_say():
    hits, _ = repeated(400, both=False)
    low, high = binomial_band(400)
    outside = {n: sum(h) for n, h in hits.items() if not low <= sum(h) <= high}
    assert outside == {}
    assert 0.94 < np.mean([h for each in hits.values() for h in each]) < 0.96


def scatter(runs: int) -> tuple[float, float]:
    _, positions = repeated(runs, both=True)
    spread = {}
    for name, rows in positions.items():
        T = np.array(rows)
        # the frame of each run is no error: by the intersected positions it is another one each time
        mean = T.mean(axis=0)
        spread[name] = float(np.sqrt(np.mean([V.aligned_errors(t, mean) ** 2 for t in T])))
    return spread["joint"], spread["two"]


@pytest.mark.proof
def test_the_joint_scatter_is_never_larger_than_that_of_two_steps():
    joint, two = scatter(400)
    assert joint <= two


def test_the_joint_scatter_of_a_few_runs_is_not_much_larger():
    joint, two = scatter(10)
    assert joint < 1.15 * two


# --- prediction -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("runs", [15, pytest.param(30, marks=pytest.mark.proof)])
def test_the_predicted_error_is_that_of_repeated_calibrations(runs):
    made = V.made_pictures(replace(RUNS, noise_seed=0))
    q = made.pictures.actuators
    assert made.pictures.truth is not None
    errors = []
    for run in range(runs):
        _, joint = calibrated(run)
        errors.append(V.aligned_errors(joint.positions(q), made.pictures.truth) ** 2)
    predicted = V.predicted_positions(V.joint_fit(ROBOT, made.pictures, made.cameras), q).rms
    assert np.sqrt(np.mean(errors)) == pytest.approx(predicted, rel=0.25)  # runs of few strong directions


def test_the_best_place_is_the_one_with_the_least_predicted_error():
    places = V.CameraPlaces(baselines=[0.5, 1.5], distances=[1.2, 3.2])
    rows = V.camera_places(ROBOT, replace(SMALL, counts=[3, 3, 3]), places)
    errors = [r.predicted.rms for r in rows if r.predicted is not None]
    assert errors == sorted(errors)
    lost = [r for r in rows if r.predicted is None]
    assert lost and all(r.distance == 1.2 and r.why for r in lost)
    assert rows[-1] in lost


# --- studies and files ------------------------------------------------------------------------------------------------


def test_the_study_fails_its_check_where_a_camera_is_held_wrong():
    _, _, _, wrong = experiment(1)
    scene = V.SyntheticRobotCameras(poses=282)
    s = V.study(ROBOT, scene, wrong, V.RobotCameras(estimate=[]))
    assert s.status is gt.SolveStatus.CHECK_FAILED
    assert not s.checks["residuals_over_picture"].passed
    assert any("quadratic map" in note for note in s.notes)
    assert "synthetic" in s.title and s.synthetic


def test_pictures_are_written_and_read_again(tmp_path):
    from gtmodel.vision.detection import FiveSquares

    p = V.made_pictures(replace(SMALL, counts=[3, 3, 3])).pictures
    V.write_pictures(p, tmp_path / "corners.csv", tmp_path / "carts.csv")
    q = V.read_pictures(tmp_path / "corners.csv", tmp_path / "carts.csv", FiveSquares(side=0.04), "m")
    assert q.cameras == tuple(p.cameras) and q.synthetic.startswith("synthetic")
    np.testing.assert_allclose(q.uv, p.uv, atol=1e-5)
    np.testing.assert_array_equal(q.mark, p.mark)
    carts = (tmp_path / "carts.csv").read_text()
    (tmp_path / "twice.csv").write_text(carts + carts.splitlines()[5] + "\n")
    with pytest.raises(gt.results.ArgumentError, match="line 29"):
        V.read_pictures(tmp_path / "corners.csv", tmp_path / "twice.csv", FiveSquares(side=0.04), "m")
    text = (tmp_path / "corners.csv").read_text().replace(",0.0,", ",9.9,", 1)
    (tmp_path / "wrong.csv").write_text(text)
    with pytest.raises(gt.results.ArgumentError, match="line 3"):
        V.read_pictures(tmp_path / "wrong.csv", tmp_path / "carts.csv", FiveSquares(side=0.04), "m")


def test_a_file_of_measured_pictures_is_solved(tmp_path):
    """What a technician has: corners, carts with rates, a second device; through the problem file."""
    made = V.made_pictures(replace(SMALL, delay=0.01, speed=0.1, second_device=20))
    p = made.pictures
    assert p.device is not None
    V.write_pictures(p, tmp_path / "corners.csv", tmp_path / "carts.csv")
    rows = [f"{p.poses[k]},{','.join(f'{x:.7f}' for x in T)}" for k, T in zip(p.device.pose, p.device.T, strict=True)]
    (tmp_path / "tracker.csv").write_text("\n".join(["pose,x,y,z", *rows, ""]))
    (tmp_path / "problem.toml").write_text(
        """kind = "robot_cameras"
robot = "l1_tape"
[pictures]
corners = "corners.csv"
actuators = "carts.csv"
second_device = "tracker.csv"
unit = "m"
[target]
kind = "five_squares"
side_mm = 40.0
[[camera]]
name = "left"
width_pixel = 1600
height_pixel = 1200
[[camera]]
name = "right"
width_pixel = 1600
height_pixel = 1200
[calibration]
scale = "second_device"
late = true
"""
    )
    s = gt.load(tmp_path / "problem.toml")()
    assert s.status.ok
    assert abs(s.delay["value"] - 0.01) < 4 * s.delay["std"]
    assert s.held_out is None and s.held_out_pixel == pytest.approx(0.1, rel=0.15)
    text = (tmp_path / "problem.toml").read_text().replace("late = true", 'late = true\nmounted = "wall"')
    (tmp_path / "problem.toml").write_text(text)
    with pytest.raises(ValueError, match="mounted"):
        gt.load(tmp_path / "problem.toml")


def test_quaternions_turn_as_their_matrices():
    rng = np.random.default_rng(1)
    q = rng.standard_normal(4)
    q /= np.linalg.norm(q) * np.sign(q[0])
    np.testing.assert_allclose(quaternion_of(quaternion_matrix(q)), q, atol=1e-12)
    w, x, y, z = q
    np.testing.assert_allclose(
        quaternion_matrix(q)[0], [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)]
    )


def test_the_robots_side_closes_where_its_causal_function_does():
    side = robot_side(ROBOT, gt.calibrate.Choice())
    T = np.array([[1.4, -0.4, 0.9], [1.2, -0.6, 0.7]])
    q, _ = ROBOT.causal(known="T", targets="q")(T)
    r, *_ = side.at(side.unknowns.start, T, q)
    np.testing.assert_allclose(r, 0.0, atol=1e-12)
    np.testing.assert_allclose(side.forward(side.unknowns.start, q, T + 0.05), T, atol=1e-10)
