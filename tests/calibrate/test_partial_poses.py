"""Poses known in part, and measurements of several kinds that share a robot's parameters, against equations by hand."""

import sys
from pathlib import Path

import numpy as np
import pytest
import scipy

import gtmodel as gt
from gtmodel.calibrate import Choice, FixedPoint, Measurements, Pose, calibrate, prepare
from gtmodel.calibrate.measurements import Correction
from tests.calibrate.synthetic import disturbed, geometry, poses, true_robot

PROBLEMS = Path(__file__).resolve().parents[2] / "problems"
RECORDED = PROBLEMS / "data" / "klipper_v400"
# of phnxdrgn536/FLSun-v400: radius, two tower angles [deg], arms and end stops, in mm
KLIPPER = [162.769280, 210.128266, 329.914363, 345.511546, 346.790457, 346.713602, 418.721720, 417.979258, 419.036135]
# Klipper weighs a squared height 12 / (0.5 * 7) times as a squared distance
HEIGHT, DISTANCE = 18e-6, 18e-6 * np.sqrt(12 / 3.5)
MOVED = Choice(fixed=["angle[2]"])
RECOVERED = 1e-8  # m


@pytest.fixture(scope="module")
def delta():
    sys.path.insert(0, str(PROBLEMS / "models"))
    try:
        from delta import Delta
    finally:
        sys.path.pop(0)
    return Delta()


def columns(name, *names):
    table = np.genfromtxt(RECORDED / f"{name}.csv", delimiter=",", names=True)
    return 1e-3 * np.column_stack([table[n] for n in names])


@pytest.fixture(scope="module")
def recorded():
    q, z = columns("heights", "a", "b", "c"), columns("heights", "height")
    one, two = columns("dist", "a1", "b1", "c1"), columns("dist", "a2", "b2", "c2")
    heights = Measurements({"q": q, "T[2]": z}, {"T[2]": HEIGHT}, name="heights")
    bars = Measurements({"q": one, "q@2": two, "bar": columns("dist", "dist")}, {"bar": DISTANCE}, name="distances",
                        distances={"bar": ("T", "T@2")})  # fmt: skip
    return heights, bars


@pytest.fixture(scope="module")
def together(delta, recorded):
    return calibrate(delta, recorded, MOVED, cost="forward")


def trilateration(p, q):
    """Nozzle positions (N, 3) of travels q, the equations of Klipper's kinematics/delta.py: lower intersection of
    three spheres. p: radius, angles of two towers, arms, end stops; SI."""
    angle, arm = np.array([p[1], p[2], np.pi / 2]), p[3:6]
    towers = p[0] * np.column_stack([np.cos(angle), np.sin(angle)])
    found = []
    for row in q:
        c = np.column_stack([towers, p[6:9] + np.sqrt(arm**2 - p[0] ** 2) - row])
        d = np.linalg.norm(c[1] - c[0])
        ex = (c[1] - c[0]) / d
        i = ex @ (c[2] - c[0])
        ey = c[2] - c[0] - i * ex
        ey /= np.linalg.norm(ey)
        j = ey @ (c[2] - c[0])
        x = (arm[0] ** 2 - arm[1] ** 2 + d**2) / (2 * d)
        y = (arm[0] ** 2 - arm[2] ** 2 - x**2 + (x - i) ** 2 + j**2) / (2 * j)
        z = np.sqrt(arm[0] ** 2 - x**2 - y**2)
        up, down = (c[0] + x * ex + y * ey + s * z * np.cross(ex, ey) for s in (1, -1))
        found.append(min(up, down, key=lambda T: T[2]))
    return np.array(found)


def by_hand(recorded):
    """Residuals in units of their noise, of the eliminated equations."""
    heights, bars = (m.values for m in recorded)

    def residuals(p):
        one, two = trilateration(p, bars["q"]), trilateration(p, bars["q@2"])
        distance = np.linalg.norm(one - two, axis=1) - bars["bar"][:, 0]
        return np.r_[(trilateration(p, heights["q"])[:, 2] - heights["T[2]"][:, 0]) / HEIGHT, distance / DISTANCE]

    return residuals


def test_heights_and_distances_together_are_the_optimum_of_equations_by_hand(recorded, together):
    c = together
    assert c.status.ok and len(c.x) == 9 and c.estimate is not None and c.estimate.degrees_of_freedom == 10
    residuals = by_hand(recorded)
    optimum = scipy.optimize.least_squares(residuals, c.problem.unknowns.start, x_scale="jac", xtol=1e-15, ftol=1e-15,
                                           gtol=1e-15)  # fmt: skip
    assert np.max(np.abs(c.x - optimum.x) / c.estimate.std) < 1e-5
    # the covariance of least squares, in the size of the residuals
    size = np.sum(residuals(c.x) ** 2) / 10
    np.testing.assert_allclose(c.estimate.covariance, size * np.linalg.inv(optimum.jac.T @ optimum.jac), rtol=1e-3)


def test_nine_parameters_of_the_printer_are_those_that_klipper_saved(together):
    """By Klipper's own coordinate descent, which ends within 1e-4 mm of the optimum."""
    c = together
    ours = np.where([n.startswith("angle") for n in c.problem.unknowns.names], np.degrees(c.x), 1e3 * c.x)
    np.testing.assert_allclose(ours, KLIPPER, atol=2e-4)  # mm, deg
    heights, distances = (np.sqrt(np.mean(part.residuals**2)) for part in c.parts)
    assert heights == pytest.approx(18.35e-6, abs=0.01e-6) and distances == pytest.approx(35.64e-6, abs=0.01e-6)


def test_heights_alone_determine_seven_of_nine(delta, recorded):
    c = calibrate(delta, recorded[0], MOVED, cost="forward")
    assert c.status.ok and c.estimate is None and c.identifiability is not None
    assert c.identifiability.rank == 7 and c.identifiability.redundant == 2
    assert any(s.startswith("angle[0] moves with") for s in c.identifiability.notes)
    assert "7 of 9" in c.message
    np.testing.assert_allclose(c.residuals, 0.0, atol=RECOVERED)
    # with the noise of all that was read there is an estimate of what is determined
    noisy = Measurements(recorded[0].values, {"q": 1e-9, "T[2]": HEIGHT})
    stated = calibrate(delta, noisy, MOVED, cost="orthogonal").estimate
    assert stated is not None and stated.null_space.shape == (9, 2)


@pytest.mark.parametrize("large", [0.1, 1.0, 10.0, 100.0])
def test_a_large_noise_for_what_is_absent_comes_to_leaving_it_out(delta, recorded, together, large):
    """Zeros stand for what nobody measured: x and y of heights, both positions of distances."""
    heights, bars = (dict(m.values) for m in recorded)
    z = heights.pop("T[2]")
    filled = [
        Measurements({**heights, "T": np.column_stack([0 * z, 0 * z, z])}, {"T": [large, large, HEIGHT]}, name="h"),
        Measurements({**bars, "T": np.zeros((12, 3)), "T@2": np.zeros((12, 3))},
                     {"bar": DISTANCE, "T": large, "T@2": large}, distances={"bar": ("T", "T@2")}, name="d"),
    ]  # fmt: skip
    c = calibrate(delta, filled, MOVED, cost="forward")
    assert c.status.ok
    assert np.max(np.abs(c.x - together.x) / together.estimate.std) < 1e-2


def test_an_absent_orientation_is_a_latent_one():
    true, data = true_robot("six_link"), poses("six_link", 60)
    start, noise = disturbed(true, ("L",), 5e-4, 9), {"q": 1e-6, "T": 1e-6}
    rng = np.random.default_rng(2)
    T = data["T"] + 1e-6 * rng.standard_normal(data["T"].shape)
    free = Choice(free=("L",))
    named = Measurements({"q": data["q"], "T": T}, noise, latent=["e"])
    whole = calibrate(start, named, free, cost="orthogonal")
    # the same positions coordinate by coordinate, as in a table with one of them a column of its own
    parts = {f"T[{k}]": T[:, k] for k in range(3)}
    split = Measurements({"q": data["q"], **parts}, {"q": 1e-6} | dict.fromkeys(parts, 1e-6), latent=["e"])
    apart = calibrate(start, split, free, cost="orthogonal")
    assert whole.status.ok and apart.status.ok and whole.estimate is not None
    assert np.max(np.abs(apart.x - whole.x) / whole.estimate.std) < 1e-6


def test_a_ball_bar_finds_its_post_and_its_length():
    """Its fixed end and what the bar's gauge reads at length zero are unknown beside the robot's link lengths."""
    true, data = true_robot("three_link"), poses("three_link", 40)
    post, gauge = np.array([0.6, -0.4, 0.1]), 0.3
    bar = np.linalg.norm(data["T"] - post, axis=1)
    m = Measurements(
        {"q": data["q"], "bar": bar + gauge}, points={"post": FixedPoint(post + 0.01, free=True)},
        distances={"bar": ("T", "post")}, corrections=[Correction("bar", offset=True)],
    )  # fmt: skip
    c = calibrate(true.with_(L=np.add(true.L, [1e-4, 0.0, 0.0])), m, Choice(free=("L[0]",)), cost="forward")
    assert c.status.ok
    np.testing.assert_allclose([c.values[f"post.at[{k}]"] for k in range(3)], post, atol=1e-6)
    assert c.values["bar.offset[0]"] == pytest.approx(gauge, abs=1e-6)
    assert c.values["L[0]"] == pytest.approx(geometry(true, ("L",))["L[0]"], abs=1e-6)


def test_reflectors_on_the_plate_seen_by_a_tracker_that_stands_anywhere():
    """Three of them, no orientation: the device's frame and one reflector's place are found with the link lengths."""
    true, data = true_robot("f1"), poses("f1", 30)
    turn = scipy.spatial.transform.Rotation.from_rotvec([0.0, 0.1, 0.6])
    stands, at = np.array([2.0, -1.0, 0.5]), np.array([[0.1, 0.0, 0.05], [-0.05, 0.1, 0.0], [0.0, -0.1, 0.02]])
    plate = scipy.spatial.transform.Rotation.from_quat(data["e"], scalar_first=True)
    seen = {f"ball_{k}": turn.inv().apply(data["T"] + plate.apply(p) - stands) for k, p in enumerate(at)}
    near = turn * scipy.spatial.transform.Rotation.from_rotvec([1e-3, 2e-3, -1e-3])
    device = (stands + 1e-3, near.as_quat(scalar_first=True))
    points = {f"ball_{k}": FixedPoint(p + (2e-3 if k == 2 else 0.0), "T", "e", free=k == 2) for k, p in enumerate(at)}
    noise = dict.fromkeys(seen, 1e-5)
    m = Measurements({"q": data["q"], **seen}, noise, None, [Pose("T", "e", True, device_start=device)], points=points)
    c = calibrate(disturbed(true, ("L",), 1e-4, 2), m, Choice(free=("L",)), cost="forward")
    assert c.status.ok
    np.testing.assert_allclose([c.values[f"T.device.t[{k}]"] for k in range(3)], stands, atol=1e-7)
    np.testing.assert_allclose([c.values[f"ball_2.at[{k}]"] for k in range(3)], at[2], atol=1e-7)
    assert max(abs(c.values[n] - v) for n, v in geometry(true, ("L",)).items()) < 1e-7


def test_one_coordinate_in_the_frame_of_a_tilted_device():
    """A height gauge on a plate that is not level sees a turned coordinate."""
    true, data = true_robot("three_link"), poses("three_link", 40)
    turn = scipy.spatial.transform.Rotation.from_rotvec([0.02, -0.03, 0.0])
    stands = np.array([0.0, 0.0, 0.2])
    height = turn.inv().apply(data["T"] - stands)[:, 2]
    m = Measurements({"q": data["q"], "T[2]": height}, poses=[Pose("T", device=True)])
    c = calibrate(true, m, Choice(free=("L[0]",), fixed=("T.device.t[0]", "T.device.t[1]")), cost="forward")
    assert c.status.ok and c.identifiability is not None and c.identifiability.redundant == 1  # its own turn about z
    np.testing.assert_allclose(c.residuals, 0.0, atol=RECOVERED)
    assert c.values["T.device.t[2]"] == pytest.approx(0.2, abs=1e-7)


def test_a_pose_that_cannot_be_closed_is_named(delta, recorded):
    heights, bars = recorded
    q = heights.values["q"].copy()
    q[4, 0] += 0.9  # the arm does not reach so far
    lost = Measurements({**heights.values, "q": q}, heights.noise, name="heights",
                        places=[f"heights.csv, line {k}" for k in range(2, 9)])  # fmt: skip
    c = calibrate(delta, [lost, bars], MOVED, cost="forward")
    assert not c.status.ok and c.message.startswith("the pose of heights.csv, line 6 cannot be closed")


def test_what_does_not_go_together_gets_a_sentence(delta, recorded):
    heights, bars = recorded
    with pytest.raises(gt.ModelError, match=r"cost 'length' needs all lengths, but T is latent; choose 'forward'"):
        calibrate(delta, heights, MOVED)
    bare = Measurements(heights.values, name="heights")
    with pytest.raises(gt.ModelError, match=r"weighted by their noise: state that of T\[2\] of heights"):
        calibrate(delta, [bare, bars], MOVED, cost="forward")
    gap = Measurements({**heights.values, "q@3": heights.values["q"]})
    with pytest.raises(gt.ModelError, match="numbered from 1 without gaps; found 1, 3"):
        prepare(delta, gap)
    with pytest.raises(gt.ModelError, match="'q@b' does not name a pose of its row"):
        prepare(delta, Measurements({**heights.values, "q@b": heights.values["q"]}))
    wide = Measurements({**heights.values, "T[2]": np.zeros((7, 2))})
    with pytest.raises(gt.ModelError, match=r"'T\[2\]' has 2 columns; expected 1"):
        prepare(delta, wide)
