"""Joint stiffness by both methods: recovery, intervals, agreement, and defects that must be noticed."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import mpmath
import numpy as np
import pytest

from gtmodel.compliance import (
    Compensator,
    arm_poses,
    cartesian_stiffness,
    complementary_stiffness,
    complete_pose,
    decoupled,
    select,
    softest_and_stiffest,
    synthetic_tests,
    translational_compliance,
    with_compensator,
)
from gtmodel.compliance.joint_stiffness import predicted
from gtmodel.inference import coverage, monte_carlo
from tests.compliance.plants import ROBOT, SIGMA, TRUTH, one, planned, poses, tilting

# Least squares of 180 rows with a condition number below 100.
EXACT = 1e-11
# Central differences over 1e-5 rad of torques up to 1e4 N.m, third derivatives of the same size.
DIFFERENCE = 1e-5
SEED = 9
NAMES = {f"compliance[{j}]": c for j, c in enumerate(TRUTH)}


@pytest.mark.parametrize("wrist_target", [True, False])
def test_exact_recovery_without_noise(wrist_target):
    made = synthetic_tests(planned(wrist_target), TRUTH, None)
    for fit in (complete_pose(made), complete_pose(made, rotation_weight=10.0), decoupled(made)):
        np.testing.assert_allclose(fit.compliance, TRUTH, rtol=EXACT)


def test_displacements_are_those_of_springs_in_the_joints():
    """(3) and (7) by another road: the load by the Cartesian stiffness."""
    made = synthetic_tests(planned(), TRUTH, None)
    K = cartesian_stiffness(made.J, TRUTH)
    F = np.einsum("nij,nj->ni", K, made.displacement)
    np.testing.assert_allclose(F, made.wrench, atol=1e-7 * np.abs(made.wrench).max())
    C = translational_compliance(made.J, TRUTH)
    stiffness, directions = softest_and_stiffest(C)
    assert np.all(np.diff(stiffness, axis=1) >= 0)
    pulled = np.einsum("nij,nj->ni", C, directions[:, 0])
    np.testing.assert_allclose(pulled, directions[:, 0] / stiffness[:, :1], atol=1e-12)


@pytest.mark.parametrize("small", [1e-5, 1e-7, 1e-8, 1e-10])
def test_cartesian_stiffness_near_a_singular_pose_in_fifty_digits(small):
    """J^-T K J^-1 keeps what the condition of J leaves; the inverse of the compliance at the tool loses twice that."""
    rng = np.random.default_rng(3)
    U, V = (np.linalg.qr(rng.normal(size=(6, 6)))[0] for _ in range(2))
    J = np.stack([U @ np.diag([2.0, 1.5, 1.0, 0.8, 0.5, s]) @ V for s in (small, 0.0, 0.3)])
    J[1] = J[0]
    J[1, :, 4] = J[1, :, 3]  # two axes in one line
    J = np.concatenate([J, np.full((1, 6, 6), np.nan)])
    found = cartesian_stiffness(J, TRUTH)
    assert np.all(np.isnan(found[[1, 3]])) and np.all(np.isfinite(found[[0, 2]]))
    with mpmath.workdps(50):
        for pose in (0, 2):
            inverse = mpmath.inverse(mpmath.matrix(J[pose].tolist()))
            exact = np.array((inverse.T * mpmath.diag([1 / mpmath.mpf(c) for c in TRUTH]) * inverse).tolist(), float)
            assert np.abs(found[pose] - exact).max() < 1e-15 / small * np.abs(exact).max()
    np.testing.assert_array_equal(cartesian_stiffness(J[2], TRUTH), found[2])
    with pytest.raises(ValueError, match="expected positive numbers"):
        cartesian_stiffness(J, -np.array(TRUTH))
    with pytest.raises(ValueError, match="expected"):
        cartesian_stiffness(J, TRUTH[:5])


@pytest.mark.parametrize(("method", "wrist_target"), [("complete", True), ("decoupled", True), ("decoupled", False)])
def test_intervals_hold_the_truth(method, wrist_target):
    runs = monte_carlo(partial(one, method=method, wrist_target=wrist_target), 40, SEED, processes=0)
    found = coverage(runs.results, NAMES)
    assert not found.outside and not found.biased, str(found)


@pytest.mark.proof
@pytest.mark.parametrize(("method", "wrist_target"), [("complete", True), ("decoupled", True), ("decoupled", False)])
def test_intervals_over_200_seeds(method, wrist_target):
    runs = monte_carlo(partial(one, method=method, wrist_target=wrist_target), 200, SEED)
    found = coverage(runs.results, NAMES)
    print(f"\n{method}, wrist target {wrist_target}\n{found}")
    assert not found.outside and not found.biased, str(found)


def test_both_methods_agree_within_their_intervals():
    made = synthetic_tests(planned(), TRUTH, np.random.default_rng(SEED))
    fits = [complete_pose(made), decoupled(made), complete_pose(made, rotation_weight=10.0)]
    for j in range(6):
        low, high = np.transpose([f.interval(f"stiffness[{j}]") for f in fits])
        assert low.max() < high.min(), j
    assert fits[0].adequacy.passed and fits[1].adequacy.passed
    # scaling of rotations does not help: it widens
    assert np.all(fits[2].estimate.std > fits[0].estimate.std)


def test_leaving_out_the_moment_about_the_wrist_biases_the_arm():
    made = synthetic_tests(planned(), TRUTH, None)
    without = decoupled(made, moment=False)
    error = without.compliance / TRUTH - 1
    assert 0.02 < np.abs(error[:3]).max() < 0.5
    assert not without.adequacy.passed


@pytest.mark.parametrize("method", [complete_pose, decoupled])
def test_bearing_tilt_is_noticed(method):
    rng = np.random.default_rng(SEED)
    assert method(synthetic_tests(planned(), TRUTH, rng)).adequacy.passed
    seen = method(tilting(planned(), rng)).adequacy
    assert not seen.passed and "the model lacks an effect" in seen.message and seen.p < 1e-6


def test_complementary_stiffness_is_the_slope_of_the_joint_torques():
    q = poses().q[3]
    wrench = np.array([[300.0, -500.0, -4000.0, 200.0, 100.0, -300.0]])
    h = 1e-5
    around = arm_poses(ROBOT, np.vstack([q + h * np.eye(6), q - h * np.eye(6)]))
    torque = np.einsum("nik,i->nk", around.J, wrench[0])
    slope = (torque[:6] - torque[6:]).T / (2 * h)
    found = complementary_stiffness(arm_poses(ROBOT, q).J, wrench)[0]
    np.testing.assert_allclose(found, slope, atol=DIFFERENCE * np.abs(slope).max())
    assert not np.allclose(found, found.T)


def test_complementary_stiffness_in_identification():
    """K_c of the load and of a compensator: recovered with it, biased without."""
    spring = Compensator(base=0.3, lever=0.25, rate=8e5, rest=0.2, angle=0.4)
    plain = planned()
    K_c = spring.added(complementary_stiffness(plain.J, plain.wrench), poses().q)
    made = synthetic_tests(planned(K_c=K_c), TRUTH, None)
    np.testing.assert_allclose(complete_pose(made).compliance, TRUTH, rtol=1e-9)
    error = complete_pose(replace(made, K_c=None)).compliance / TRUTH - 1
    assert 1e-3 < np.abs(error).max() < 0.1
    np.testing.assert_allclose(decoupled(made).compliance, TRUTH, rtol=1e-9)
    with pytest.raises(ValueError, match="moment=False cannot be combined with the complementary stiffness"):
        decoupled(made, moment=False)


def test_rate_of_the_compensator_is_found_beside_the_stiffness():
    true, start = (Compensator(base=0.3, lever=0.25, rate=k, rest=0.2, angle=0.4) for k in (8e5, 3e5))
    plain = planned()
    K_c = complementary_stiffness(plain.J, plain.wrench)
    exact = replace(synthetic_tests(replace(plain, K_c=true.added(K_c, poses().q)), TRUTH, None), K_c=K_c)
    fit = with_compensator(exact, start, poses().q)
    np.testing.assert_allclose([*fit.compliance, fit.estimate.values[6]], [*TRUTH, 8e5], rtol=1e-7)
    assert fit.estimate.names[6] == "rate" and len(fit.stiffness) == 6
    # the deviation that one noisy run states holds the truth
    noisy = synthetic_tests(replace(plain, K_c=true.added(K_c, poses().q)), TRUTH, np.random.default_rng(SEED))
    seen = with_compensator(replace(noisy, K_c=K_c), start, poses().q)
    assert abs(seen.estimate.values[6] - 8e5) < 3 * seen.estimate.std[6] and seen.adequacy.passed


def test_compensator_torque_and_slope_come_from_its_energy():
    spring, q2, h = Compensator(base=0.3, lever=0.25, rate=8e5, rest=0.2, angle=0.4), np.linspace(-2.2, 0.3, 9), 1e-5

    def energy(x):
        return spring.rate / 2 * (spring.length(x) - spring.rest) ** 2

    torque = -(energy(q2 + h) - energy(q2 - h)) / (2 * h)
    np.testing.assert_allclose(spring.torque(q2), torque, atol=DIFFERENCE * np.abs(torque).max())
    slope = (spring.torque(q2 + h) - spring.torque(q2 - h)) / (2 * h)
    np.testing.assert_allclose(spring.stiffness(q2), slope, atol=DIFFERENCE * np.abs(slope).max())


def test_chosen_tests_beat_tests_in_order():
    candidates = planned()
    found = select(candidates, 8, TRUTH)
    assert len(set(found.chosen)) == 8
    first = select(_only(candidates, range(8)), 8, TRUTH)
    assert found.indices.o1 > 1.2 * first.indices.o1
    assert select(candidates, 30, TRUTH).indices.o3 == pytest.approx(found.of_all.o3)
    with pytest.raises(ValueError, match="expected 1 to 30, the number of candidates"):
        select(candidates, 31, TRUTH)
    with pytest.raises(ValueError, match="the tests determine 5 of 6 compliances; add poses"):
        select(_vertical(), 12, TRUTH)


def test_refusals():
    made = planned()
    with pytest.raises(ValueError, match=r"wrench has the shape \(30, 3\); expected \(30, 6\) for 30 tests"):
        replace(made, wrench=made.wrench[:, :3])
    with pytest.raises(ValueError, match="displacement is not finite in test 4"):
        replace(made, displacement=np.where(np.arange(30)[:, None] == 4, np.nan, made.displacement))
    with pytest.raises(ValueError, match="or neither"):
        replace(made, wrist_covariance=None)
    with pytest.raises(ValueError, match=r"do not determine compliance\[0\]"):
        complete_pose(_vertical())
    with pytest.raises(ValueError, match="every displacement is zero"):
        complete_pose(replace(made, displacement=np.zeros_like(made.displacement)))
    with pytest.raises(ValueError, match="tilt needs the origins"):
        synthetic_tests(made, TRUTH, None, tilt=TRUTH)


def _only(tests, rows):
    rows = list(rows)
    names = ("J", "J_wrist", "wrench", "displacement", "covariance", "lever", "wrist_displacement", "wrist_covariance")
    return replace(tests, **{name: getattr(tests, name)[rows] for name in names})


def _vertical():
    """Vertical loads alone never turn axis 1."""
    p = poses()
    tests = p.tests(np.tile([0, 0, -4000.0, 0, 0, 0], (len(p.q), 1)), sigma=SIGMA)
    return replace(tests, displacement=np.full_like(tests.displacement, 1e-5))


def test_a_load_that_the_joints_do_not_carry_is_refused():
    made = synthetic_tests(planned(), TRUTH, None)
    heavy = np.tile(np.diag(1 / np.array(TRUTH)), (len(made.J), 1, 1))
    predicted(replace(made, K_c=0.5 * heavy), TRUTH)
    with pytest.raises(ValueError, match="not positive definite"):
        predicted(replace(made, K_c=1.5 * heavy), TRUTH)
