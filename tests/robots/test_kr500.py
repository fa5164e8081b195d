"""The KR 500-3: forward kinematics and Jacobian against other codes, printed poses, and all branches of the inverse."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.linalg import expm

from gtmodel import Status, robots
from gtmodel.kinematics import chain_of, closed_form, postures
from gtmodel.results import ArgumentError

# Products of six rotations and sums of metres.
ROUND_OFF = 1e-12
# Next to a singularity angles are lost, the pose they give is not.
POSE = 1e-11
# Rounding of the printed angles to 0.01 deg moves the flange by up to 0.4 mm; the heights are printed to 0.01 mm.
PRINTED_MM = 0.01
LIMITS = robots.kr500_limits()
ROBOT = robots.kr500()
ORIGINS, AXES = np.array(ROBOT.origins), np.array(ROBOT.axes)
ARM = chain_of(ROBOT)
HOME = np.deg2rad([0.0, -90.0, 90.0, 0.0, 0.0, 0.0])
angles = st.tuples(*(st.floats(low, high) for low, high in LIMITS)).map(np.array)


@pytest.fixture(scope="module")
def forward():
    return ROBOT.causal(known="q", targets=["T", "R"])


def by_exponentials(q):
    """Flange pose (4, 4) by the product of exponentials of screws at q = 0, scipy's expm."""
    points = np.cumsum(ORIGINS, axis=0)
    pose = np.eye(4)
    for n, p, angle in zip(AXES, points, q, strict=True):
        screw = np.zeros((4, 4))
        screw[:3, :3] = np.cross(n, np.eye(3)).T
        screw[:3, 3] = -np.cross(n, p)
        pose = pose @ expm(screw * angle)
    end = np.eye(4)
    end[:3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]
    end[:3, 3] = points[-1]
    return pose @ end


def reachable(seed, count):
    return np.random.default_rng(seed).uniform(LIMITS[:, 0], LIMITS[:, 1], (count, 6))


def test_flange_at_zero_and_home(forward):
    for q, place in ((np.zeros(6), [3.115, 0.0, 0.990]), (HOME, [1.815, 0.0, 2.290])):
        T, R, status = forward(q)
        assert status is Status.OK
        np.testing.assert_allclose(T, place, atol=ROUND_OFF)
        np.testing.assert_allclose(R[:, 2], [1.0, 0.0, 0.0], atol=ROUND_OFF)


def test_forward_kinematics_is_the_product_of_exponentials(forward):
    q = reachable(1, 20)
    T, R, status = forward(q)
    assert not status.any()
    for k in range(len(q)):
        pose = by_exponentials(q[k])
        np.testing.assert_allclose(T[k], pose[:3, 3], atol=ROUND_OFF)
        np.testing.assert_allclose(R[k], pose[:3, :3], atol=ROUND_OFF)


def test_printed_poses_have_one_height(forward):
    """Fig. 42; a d4 wrong by 250 mm shows as 156 mm."""
    T, _, status = forward(np.deg2rad(robots.kr500_tables()["appendix_a"]["poses_deg"]))
    assert not status.any()
    np.testing.assert_allclose(1e3 * T[:, 2], [533.41, 533.36, 533.25], atol=PRINTED_MM)


def test_jacobian_against_pinocchio():
    pin = pytest.importorskip("pinocchio", reason="pinocchio, the oracle of serial arms, is not installed")
    model, parent = pin.Model(), 0
    for k in range(6):
        joint = pin.JointModelRevoluteUnaligned(*AXES[k])
        parent = model.addJoint(parent, joint, pin.SE3(np.eye(3), ORIGINS[k]), f"joint_{k}")
    work = model.createData()
    rates = ROBOT.causal(known="q", targets=["v", "w"])
    for q in reachable(2, 10):
        v, w, status = rates(np.tile(q, (6, 1)), np.eye(6))
        assert not status.any()
        pin.computeJointJacobians(model, work, q)
        expected = pin.getJointJacobian(model, work, 6, pin.LOCAL_WORLD_ALIGNED)
        np.testing.assert_allclose(np.hstack([v, w]).T, expected, atol=ROUND_OFF)


def test_torques_of_a_load_are_the_jacobian_transposed():
    """(6): statics from the same equations; motors hold against the load, hence the minus sign."""
    statics = ROBOT.causal(known=["q", "load.force", "load.torque"], targets="tau")
    rates = ROBOT.causal(known="q", targets=["v", "w"])
    q = reachable(3, 1)[0]
    v, w, _ = rates(np.tile(q, (6, 1)), np.eye(6))
    wrenches, rest = np.eye(6), np.zeros((6, 6))
    tau, status = statics(np.tile(q, (6, 1)), rest, rest, wrenches[:, :3], wrenches[:, 3:])
    assert not status.any()
    np.testing.assert_allclose(-tau.T, np.hstack([v, w]), atol=ROUND_OFF)


@settings(max_examples=60, deadline=None)
@given(angles)
def test_every_branch_gives_the_pose_back(q):
    forward = ROBOT.causal(known="q", targets=["T", "R"])
    T, R, _ = forward(q)
    found = postures(ARM, T, R)
    there = found.status[0] != Status.OUT_OF_RANGE
    assert there.any()  # at least the one it came from
    T2, R2, status = forward(found.q[0, there])
    assert not status.any()
    np.testing.assert_allclose(T2, np.tile(T, (len(T2), 1)), atol=2e-8)  # an arm stretched to 1e-16 of its reach
    regular = found.status[0, there] == Status.OK
    np.testing.assert_allclose(T2[regular], np.tile(T, (regular.sum(), 1)), atol=1e-9)
    np.testing.assert_allclose(R2, np.tile(R, (len(R2), 1, 1)), atol=POSE)


def test_the_angles_it_came_from_are_among_the_turns(forward):
    q = reachable(4, 300)
    q = q[np.abs(np.sin(q[:, 4])) > 0.05]
    T, R, _ = forward(q)
    found = postures(ARM, T, R)
    missed = []
    for k in range(len(q)):
        turns, branch = found.within(LIMITS, k)
        assert np.all((turns >= LIMITS[:, 0] - 1e-8) & (turns <= LIMITS[:, 1] + 1e-8))
        nearest = np.abs(turns - q[k]).max(axis=1)
        missed.append(nearest.min())
        assert len(branch) == len(turns)
    assert np.max(missed) < 1e-9 and len(missed) > 250
    # eight branches where arm and wrist are well inside
    assert (found.status == Status.OK).sum(axis=1).max() == 8


def test_windows_of_axes_4_and_6(forward):
    """Within 350 degrees each angle comes in two turns, in one near zero."""
    q = np.deg2rad([10.0, -60.0, 100.0, 40.0, 50.0, -70.0])
    T, R, _ = forward(q)
    turns, branch = postures(ARM, T, R).within(LIMITS)
    same = turns[branch == branch[np.abs(turns - q).max(axis=1).argmin()]]
    np.testing.assert_allclose(np.rad2deg(sorted({round(a, 9) for a in same[:, 3]})), [-320.0, 40.0], atol=1e-6)
    np.testing.assert_allclose(np.rad2deg(sorted({round(a, 9) for a in same[:, 5]})), [-70.0, 290.0], atol=1e-6)
    small = q * [1, 1, 1, 0.1, 1, 0.1]  # 4 and -7 degrees have no second turn
    T, R, _ = forward(small)
    turns, branch = postures(ARM, T, R).within(LIMITS)
    assert np.sum(branch == branch[np.abs(turns - small).max(axis=1).argmin()]) == 1


def test_singular_and_out_of_reach(forward):
    straight = np.deg2rad([20.0, -60.0, 90.0, 30.0, 0.0, 40.0])
    T, R, _ = forward(straight)
    found = postures(ARM, T, R)
    # the elbow and shoulder it came from, both wrists; the others have an OK wrist
    came = np.abs(found.q[0, :, :3] - straight[:3]).max(axis=1) < 1e-9
    assert came.sum() == 2 and np.all(found.status[0, came] == Status.SINGULAR)
    T2, R2, _ = forward(found.q[0, found.status[0] == Status.SINGULAR])
    np.testing.assert_allclose(T2, np.tile(T, (len(T2), 1)), atol=POSE)
    np.testing.assert_allclose(R2, np.tile(R, (len(R2), 1, 1)), atol=POSE)
    # wrist centre on axis 1: shoulder
    above = postures(ARM, [0.0, 0.0, 2.6], np.eye(3))
    assert (above.status == Status.SINGULAR).any() and not (above.status == Status.OK).any()
    far = postures(ARM, [4.0, 0.0, 1.0], np.eye(3))
    assert np.all(far.status == Status.OUT_OF_RANGE) and np.isnan(far.q).all()
    assert far.within(LIMITS)[0].shape == (0, 6)
    bad = postures(ARM, [np.nan, 0.0, 1.0], np.eye(3))
    assert np.all(bad.status == Status.NOT_FINITE)
    # the name R2830: from axis 1 to the wrist centre, without the flange
    assert round(1e3 * (ARM.size - 0.29)) == 2826


def test_structure_and_refusals():
    assert closed_form(ARM).structure == "axes 4 5 6 meet in a point, axes 2 and 3 parallel"
    with pytest.raises(ArgumentError) as caught:
        postures(ARM, np.zeros((2, 3)), np.eye(3))
    assert caught.value.argument == "R"
    with pytest.raises(ArgumentError) as caught:
        chain_of(robots.gantry_tau("l1_tape"))
    assert caught.value.argument == "robot"
