"""Noise-free recovery of every identifiable combination, and what is undetermined, for each model."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from gtmodel.calibrate import COSTS, Choice, Measurements, calibrate, prepare
from tests.calibrate.synthetic import GEOMETRY, disturbed, geometry, measured, poses, true_robot

RECOVERED = 1e-9  # m or 1: the issue's; the condition of these problems leaves two digits more
ARMS = (
    ("A0[0", "B[0", "v[0", "L[0"),
    ("A0[1", "A[1", "A[2", "u1_2"),
    ("A0[2", "A[3", "A[4", "A[5", "r3", "u1_3", "u2_3"),
)
QUATERNIONS = ("u1_2", "u1_3", "u2_3")
IDEAL = Choice(tied={"v[1]": "v[0]", "v[2]": "v[0]"})


def held_out(kind: str) -> Measurements:
    return Measurements(poses(kind, 30, seed=77))


@pytest.mark.parametrize("cost", COSTS)
def test_the_modified_model_has_21_parameters_and_finds_them(cost):
    m = Measurements(poses("three_link", 60), noise={"q": 1e-5, "T": 5e-5})
    c = calibrate(disturbed(true_robot("three_link"), GEOMETRY["three_link"], 5e-3, 3), m, cost=cost)
    true = geometry(true_robot("three_link"), GEOMETRY["three_link"])
    assert c.status.ok and len(c.x) == 21
    assert max(abs(c.values[n] - v) for n, v in true.items()) < RECOVERED
    assert np.abs(c.on(held_out("three_link"))).max() < RECOVERED


def test_the_ideal_model_has_15_and_finds_them_on_a_robot_with_one_direction():
    true = true_robot("three_link").with_(v=np.tile(np.array(true_robot("three_link").v)[0], (3, 1)))
    q = np.random.default_rng(5).uniform(-0.5, 0.5, (60, 3))
    T, status = true.causal(known="q", targets="T")(q)
    c = calibrate(disturbed(true, ("A", "v", "L"), 5e-3, 3), Measurements({"q": q, "T": T}), IDEAL)
    assert np.all(status == 0) and len(c.x) == 15 and len(c.blocks) == 1
    assert max(abs(c.values[n] - v) for n, v in geometry(true, ("A", "v", "L")).items()) < RECOVERED


def test_arms_and_links_are_solved_apart_where_they_share_nothing():
    three = prepare(true_robot("three_link"), Measurements(poses("three_link", 20)))
    assert [len(b.columns) for b in three.lengths] == [7, 7, 7]
    assert len(three.orthogonal) == 1  # errors of T belong to all arms
    six = prepare(true_robot("six_link"), Measurements(poses("six_link", 20)))
    assert [len(b.columns) for b in six.lengths] == [10] * 6
    f1 = prepare(true_robot("f1"), Measurements(poses("f1", 60)))
    assert [len(b.columns) for b in f1.lengths] == [10, 24, 38]


def test_six_links_with_all_their_60_parameters():
    m = Measurements(poses("six_link", 60))
    c = calibrate(disturbed(true_robot("six_link"), GEOMETRY["six_link"], 1e-3, 3), m)
    true = geometry(true_robot("six_link"), GEOMETRY["six_link"])
    assert c.identifiability is not None and c.identifiability.rank == 60
    # the plate hardly turns: singular values spread over seven decades, which rounding of the poses shares
    assert max(abs(c.values[n] - v) for n, v in true.items()) < 1e-7
    assert np.abs(c.on(held_out("six_link"))).max() < RECOVERED
    errors = c.positioning_errors(held_out("six_link"))
    assert set(errors) == {"T", "e"} and max(np.abs(e).max() for e in errors.values()) < RECOVERED


@pytest.mark.parametrize(("unit", "unknowns", "redundant"), [((), 72, 9), (QUATERNIONS, 69, 6)])
def test_the_f1_has_nine_redundant_parameters_with_raw_quaternions_and_six_with_unit_ones(unit, unknowns, redundant):
    # the measured robot has unit quaternions: what raw ones add is in the plates' joints, which are scaled
    start = disturbed(true_robot("f1"), GEOMETRY["f1"], 2e-3, 3)
    c = calibrate(start, Measurements(poses("f1", 185)), Choice(unit=unit))
    identified = c.identifiability
    assert c.status.ok and identified is not None and c.estimate is not None
    assert len(c.x) == unknowns and identified.redundant == redundant
    assert {identified.ranks[t] for t in (1e-12, 1e-10, 1e-8, 1e-6)} == {63}
    assert np.abs(c.on(held_out("f1"))).max() < RECOVERED
    dependent = list(identified.dependencies.coefficients)
    arm = [sum(d.startswith(begin) for d in dependent) for begin in ARMS]
    assert arm == ([0, 3, 6] if not unit else [0, 2, 4])  # Table 5.4


def test_the_thesiss_fixed_parameters_leave_the_f1_nearly_undetermined():
    """Section 5.4 fixes five and ties one. r3(z) hardly moves when the frame turns about the axis of q5, for r3(x) is
    0.2 mm, so that it holds this turn only in principle; fixing the turn itself holds it in practice."""
    fixed = ("A[2,1]", "r3[1]", "r3[2]", "A[5,0]", "A[5,2]")
    m, tied = Measurements(poses("f1_unit", 100)), {"A[2,2]": "A[1,2]"}
    thesis = prepare(true_robot("f1_unit"), m, Choice(fixed=fixed, tied=tied, unit=QUATERNIONS))
    turn = Choice(fixed=(*fixed[:2], "u1_3 turned about y", *fixed[3:]), tied=tied, unit=QUATERNIONS)
    theirs, ours = (p.identifiability(sigma=6e-5) for p in (thesis, prepare(true_robot("f1_unit"), m, turn)))
    assert theirs.rank == ours.rank == 63 == len(theirs.names)
    worst = theirs.near[-1]
    assert worst.std > 100 and list(worst.weights)[:2] == ["u1_3 turned about y", "u2_3 turned about z"]
    assert all(d.std < 10 for d in ours.near) and theirs.condition > 20 * ours.condition


def test_the_optimum_is_scipys():
    m = measured("three_link", 80, {"q": 1e-5, "T": 1e-4}, seed=11)
    start = disturbed(true_robot("three_link"), GEOMETRY["three_link"], 3e-3, 4)
    c = calibrate(start, m, cost="squared")
    q, T = m.values["q"], m.values["T"]

    def residual(x):
        A, v, L = x[:9].reshape(3, 3), x[9:18].reshape(3, 3), x[18:]
        return (np.sum((T[:, None] - A - q[:, :, None] * v) ** 2, axis=2) - L**2).reshape(-1)

    x0 = np.concatenate([np.array(getattr(start, n)).reshape(-1) for n in "AvL"])
    other = least_squares(residual, x0, x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    np.testing.assert_allclose(c.x, other.x, atol=1e-8)  # finite differences leave that
    assert sum(np.sum(b.evaluate(c.problem.reading.data, c.x[b.columns])[0] ** 2) for b in c.problem.squared) <= (
        2 * other.cost * (1 + 1e-12)
    )


@pytest.mark.parametrize("cost", ["inverse", "forward", "orthogonal"])
def test_implicit_costs_are_minima_of_what_they_say(cost):
    """Second road: errors by causal functions, and each pose closed by multipliers written out by hand."""
    m = measured("three_link", 25, {"q": 3e-4, "T": 5e-4}, seed=8)
    c = calibrate(true_robot("three_link"), m, cost=cost)
    q, T = m.values["q"], m.values["T"]
    calibrated = true_robot("three_link").with_(**c.parameters())
    if cost == "inverse":
        errors = calibrated.causal(known="T", targets="q")(T)[0] - q
    elif cost == "forward":
        errors = calibrated.causal(known="q", targets="T")(q)[0] - T
        np.testing.assert_allclose(c.positioning_errors()["T"], errors, atol=1e-10)
    else:
        errors = None
    fit = c.estimate
    assert fit is not None
    base = _cost(c, cost, m)
    if errors is not None:
        assert base == pytest.approx(np.sum((errors / {"inverse": 3e-4, "forward": 5e-4}[cost]) ** 2), rel=1e-8)
    rng = np.random.default_rng(0)
    for _ in range(3):  # no neighbour is better, whatever the direction
        step = 0.3 * rng.multivariate_normal(np.zeros(21), fit.covariance)
        assert _cost(c, cost, m, c.x + step) > base and _cost(c, cost, m, c.x - step) > base


def _cost(c, cost, m, x=None):
    """Sum of squared errors at x by hand-written Newton, in units of the noise."""
    x = c.x if x is None else x
    A, v, L = x[:9].reshape(3, 3), x[9:18].reshape(3, 3), x[18:]
    y = np.hstack([m.values["q"], m.values["T"]])
    S = np.diag({"inverse": [9e-8] * 3 + [0] * 3, "forward": [0] * 3 + [25e-8] * 3,
                 "orthogonal": [9e-8] * 3 + [25e-8] * 3}[cost])  # fmt: skip
    total = 0.0
    for measured_pose in y:
        p = measured_pose.copy()
        for _ in range(20):
            d = p[3:] - A - p[:3, None] * v
            n = np.linalg.norm(d, axis=1)
            B = np.hstack([np.diag(-np.sum(d * v, axis=1) / n), d / n[:, None]])
            k = np.linalg.solve(B @ S @ B.T, (n - L) + B @ (measured_pose - p))
            p = measured_pose - S @ B.T @ k
        total += float(((n - L) + B @ (measured_pose - p)) @ k)
    return total
