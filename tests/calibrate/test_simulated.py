"""Synthetic robots and what is said of predictions: true poses, guideway errors, sensitivity, outliers."""

import numpy as np
import pytest

from gtmodel.calibrate import Measurements, prepare
from gtmodel.calibrate.measured.column_checks import aligned
from gtmodel.calibrate.prediction import Prediction, outliers
from gtmodel.calibrate.sensitivity import rows_of, sensitivity, true_poses
from gtmodel.calibrate.synthetic.measurements import GuidewayError
from gtmodel.geometry.quaternions import quaternion_matrix
from tests.calibrate.synthetic import poses, true_robot

SAME = 1e-12  # m: rounding of lengths of metres
CARTS = {"three_link": ("A", [1]), "six_link": ("A", [1, 2])}


@pytest.mark.parametrize("kind", ["three_link", "six_link"])
def test_true_poses_close_on_the_deviating_points(kind: str) -> None:
    """Closed by hand; without deviation they are the forward kinematics."""
    robot, p = true_robot(kind), poses(kind, 20)
    near = {n: a + (2e-3 if n == "T" else 0.0) for n, a in p.items() if n != "q"}
    name, rows = CARTS[kind]
    still = true_poses(robot, p["q"], near, rows_of(np.zeros((20, 3)), name, rows))
    assert max(np.abs(still[n] - p[n]).max() for n in near) < SAME
    off = 1e-3 * np.random.default_rng(1).standard_normal((20, 3))
    stands = true_poses(robot, p["q"], near, rows_of(off, name, rows))
    A, v, L = (np.array(getattr(robot, n)) for n in "AvL")
    arm = [0, 1, 2] if kind == "three_link" else [0, 1, 1, 2, 2, 2]
    joints = A + p["q"][:, arm, None] * v
    joints[:, rows] += off[:, None]
    tips = np.repeat(stands["T"][:, None], len(arm), axis=1)
    if kind == "six_link":
        tips = tips + np.einsum("kij,mj->kmi", [quaternion_matrix(e) for e in stands["e"]], np.array(robot.B))
    assert np.abs(np.linalg.norm(tips - joints, axis=2) - L).max() < SAME
    assert np.abs(stands["T"] - p["T"]).max() > 1e-3


def test_a_pose_out_of_reach_is_no_number() -> None:
    p = poses("three_link", 3)
    far = np.array([[0.0, 0, 0], [9.0, 0, 0], [0, 0, 0]])
    stands = true_poses(true_robot("three_link"), p["q"], {"T": p["T"]}, rows_of(far, "A", [0]))
    assert np.isfinite(stands["T"]).all(axis=1).tolist() == [True, False, True]


def test_guideway_errors_have_the_sizes_that_they_say_and_no_line_in_them() -> None:
    v, q = np.array([0.998, -0.03, 0.01]), np.linspace(-0.7, 1.1, 4001)
    make = lambda seed, cyclic: GuidewayError(v, -0.7, 1.1, 4e-5, 1e-4, cyclic, 0.05, np.random.SeedSequence(seed))  # noqa: E731
    e, again, other = (make(s, 0.0)(q) for s in (5, 5, 6))
    u = v / np.linalg.norm(v)
    along = e @ u
    assert np.array_equal(e, again) and np.abs(e - other).max() > 1e-5
    assert np.abs(along).mean() == pytest.approx(4e-5, rel=1e-2)  # means over another grid
    assert np.linalg.norm(e - np.outer(along, u), axis=1).mean() == pytest.approx(1e-4, rel=1e-2)
    assert np.abs(np.polyfit(q, e, 1)).max() < 1e-6
    cycle = (make(5, 2e-5)(q) - e) @ u
    assert np.abs(cycle).max() == pytest.approx(2e-5, rel=1e-2)
    assert np.abs(cycle[:-112] - (make(5, 2e-5)(q + 0.05) - make(5, 0.0)(q + 0.05))[:-112] @ u).max() < 1e-10


def test_sensitivity_is_that_of_forward_kinematics() -> None:
    """(5.8) by changing the robot and moving it: poses of the first order, cost as it is."""
    robot, p = true_robot("three_link"), poses("three_link", 15)
    problem = prepare(robot, Measurements(p))
    s = sensitivity(problem, problem.unknowns.start, 5e-5)
    for name, index in (("L", 1), ("v", (2, 0))):
        total = 0.0
        for sign in (1, -1):
            a = np.array(getattr(robot, name), float)
            a[index] += sign * 5e-5
            total += np.linalg.norm(robot.with_(**{name: a}).causal("q", "T")(p["q"])[0] - p["T"], axis=1).sum()
        k = s.names.index(f"{name}[{','.join(map(str, np.atleast_1d(index)))}]")
        assert s.pose["T"][k] == pytest.approx(total, rel=1e-3)  # second order in the step
    k = s.names.index("L[1]")
    assert s.cost[k] == pytest.approx(2 * 15 * (2 * float(np.array(robot.L)[1]) * 5e-5) ** 2, rel=1e-3)


def test_per_link_lengths_move_the_tool_most() -> None:
    """D1, model 3: per link L above B_x and A_x, these above their y and z; link 1 hardly turns the plate."""
    problem = prepare(true_robot("six_link"), Measurements(poses("six_link", 40)))
    s = sensitivity(problem, problem.unknowns.start)
    for sums in (s.cost, s.pose["T"]):
        at = dict(zip(s.names, sums, strict=True))
        for link in range(6):
            x = [at[f"{n}[{link},0]"] for n in "AB"]
            yz = [at[f"{n}[{link},{k}]"] for n in "AB" for k in (1, 2)]
            assert at[f"L[{link}]"] > max(x) and min(x) > max(yz)
    turns = dict(zip(s.names, s.pose["e"], strict=True))
    assert 50 * turns["L[0]"] < min(turns[f"L[{link}]"] for link in range(1, 6))


def test_principal_directions_and_sizes_of_errors() -> None:
    rng = np.random.default_rng(3)
    R = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    e = rng.standard_normal((4000, 3)) * [1e-4, 2e-4, 5e-4] @ R
    e[7] = np.nan
    p = Prediction(e)
    sizes, directions = p.principal()
    assert sizes == pytest.approx([1e-4, 2e-4, 5e-4], rel=0.05)
    assert np.abs(directions @ R.T) == pytest.approx(np.eye(3), abs=0.05)
    assert p.rms == pytest.approx(np.sqrt(np.sum(sizes**2))) and p.sizes[p.worst] == p.greatest


def test_outliers_are_rare_in_noise_and_found_in_it() -> None:
    rng = np.random.default_rng(8)
    alarms = [len(outliers(rng.standard_normal((100, 3)))) for _ in range(200)]
    assert sum(a > 0 for a in alarms) < 30  # robust deviations of 100 scatter; 1 % with the true ones
    r = rng.standard_normal((100, 3))
    r[31, 2] += 30
    first = outliers(r)[0]
    assert (first.pose, first.link) == (31, 2) and first.times > 20


def test_alignment_gives_the_frame_back() -> None:
    rng = np.random.default_rng(2)
    a = rng.standard_normal((10, 3))
    R = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    R *= np.linalg.det(R)
    t, turned, rms = aligned(a, a @ R.T + [1.0, 2, 3])
    assert t == pytest.approx([1, 2, 3]) and turned == pytest.approx(R) and rms < SAME
