"""Distances from singular poses as lengths and angles: exact cases, invariance, robots near their singularities."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import eigh

import gtmodel as gt
from gtmodel import Status
from gtmodel.kinematics import MotionMaps, singularity
from tests.oracle.six_link import SixLinkByHand, rotation
from tests.support.compare import relative_error
from tests.support.strategies import columns, random_states

ROUND_OFF = 1e-12
# an arc sine near 0 or a quotient of singular values loses nothing; cross products of metres lose two digits
ANGLE = 1e-13


def rotated(seed: int) -> np.ndarray:
    e = np.random.default_rng(seed).normal(size=4)
    return rotation(e / np.linalg.norm(e))


class TestInverse:
    def test_a_link_that_leans_by_a_known_angle(self):
        lean = np.array([-0.3, 0.0, 0.2, np.pi / 2])
        d = 2.0 * np.column_stack([np.sin(lean), np.cos(lean), 0 * lean])
        found = singularity.inverse(d, [0.96, 0.0, 0.0])  # |v| is a scale and plays no part
        assert relative_error(found.angle_rad, lean) < 1e-7  # at a right angle the arc sine has half of the digits
        assert relative_error(found.along_m, 2.0 * np.sin(lean)) < ROUND_OFF

    def test_rows_and_nan(self):
        d = np.ones((3, 3, 3))
        d[1, 2, 0] = np.nan
        found = singularity.inverse(d, np.eye(3))
        assert np.isnan(found.along_m[1]).tolist() == [False, False, True]
        assert np.isfinite(found.angle_rad[[0, 2]]).all()


class TestForward:
    def test_a_tripod_of_known_height(self):
        # three links of a flat pyramid: the third rises by h from the plane of the other two
        for h in (0.5, 1e-3, 0.0):
            d = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.6, -0.8, h]])
            found = singularity.forward(d)
            heights = [h, h / np.hypot(h, 0.8), h / np.hypot(h, 0.6)]
            assert abs(found.height_m - min(heights)) < ANGLE
            lengths = [np.linalg.norm(d[2]), 1.0, 1.0]
            angles = [np.arcsin(x / y) for x, y in zip(heights, lengths, strict=True)]
            assert abs(found.angle_rad - min(angles)) < ANGLE

    def test_turning_and_order_change_nothing(self):
        d = np.random.default_rng(1).normal(size=(20, 3, 3))
        a, b = singularity.forward(d), singularity.forward(d[:, [2, 0, 1]] @ rotated(1).T)
        assert relative_error(a.height_m, b.height_m) < ROUND_OFF and relative_error(a.angle_rad, b.angle_rad) < 1e-11

    def test_the_plate_near_the_plane_of_the_carts(self):
        # height h over the plane through the cart joints: the measures go to zero in proportion to h
        p = np.random.default_rng(2).normal(size=(3, 3))
        normal = np.cross(p[1] - p[0], p[2] - p[0])
        h = np.array([1e-2, 1e-4, 1e-6, 0.0])
        T = p[0] + 0.3 * (p[1] - p[0]) + 0.4 * (p[2] - p[0]) + np.outer(h, normal / np.linalg.norm(normal))
        found = singularity.forward(T[:, None] - p)
        for measure in found:
            assert np.all(np.diff(measure) < 0) and measure[-1] < 1e-15
            assert abs(measure[1] / measure[2] - 100.0) < 0.1

    def test_flat_links_and_wrong_shapes(self):
        assert singularity.forward([[1, 0, 0], [2, 0, 0], [3, 0, 0]]).height_m == 0.0
        with pytest.raises(ValueError, match=r"forward\(\) takes three links, .*\(6, 3\)"):
            singularity.forward(np.ones((6, 3)))


class TestPlatform:
    @staticmethod
    def six(seed: int) -> tuple[np.ndarray, np.ndarray]:
        rng = np.random.default_rng(seed)
        return rng.normal(size=(6, 3)), rng.normal(size=(6, 3))

    def test_frame_unit_and_reference_point_do_not_matter(self):
        d, arms = self.six(3)
        R = rotated(3)
        expected = singularity.platform(d, arms)
        assert 0.0 < expected < np.pi / 2
        assert abs(singularity.platform(d @ R.T, arms @ R.T) - expected) < ROUND_OFF
        assert abs(singularity.platform(d, arms + np.array([0.3, -5.0, 2.0])) - expected) < ROUND_OFF
        assert abs(singularity.platform(1000 * d, 1000 * arms) - expected) < ROUND_OFF

    def test_least_over_all_motions(self):
        # the joints' motion under each unit twist, and the pencil of the two quadratic forms
        d, arms = self.six(4)
        u = d / np.linalg.norm(d, axis=1)[:, None]
        moves = np.array([t[:3] + np.cross(t[3:], arms) for t in np.eye(6)])
        changes = np.sum(moves * u, axis=2)
        least = eigh(changes @ changes.T, np.einsum("akc,bkc->ab", moves, moves), eigvals_only=True)[0]
        assert abs(np.sin(singularity.platform(d, arms)) - np.sqrt(least)) < 1e-10

    def test_parallel_links_are_singular(self):
        _, arms = self.six(6)
        assert singularity.platform(np.tile([0.0, 0.0, 2.0], (6, 1)), arms) < 1e-12

    def test_collinear_joints_are_singular(self):
        d, _ = self.six(7)
        assert singularity.platform(d, np.outer(np.arange(6.0), [1.0, 2.0, 3.0])) == 0.0

    def test_rows(self):
        cases = [self.six(k) for k in range(4)]
        d, arms = (np.array(x) for x in zip(*cases, strict=True))
        d[2, 1, 1] = np.nan
        found = singularity.platform(d, arms)
        assert np.isnan(found[2])
        for k in (0, 1, 3):
            assert found[k] == singularity.platform(d[k], arms[k])


class TestMaps:
    def test_velocity_and_acceleration_of_three_links(self):
        # T'' = J q'' + b against the twice differentiated closure in NumPy
        robot = gt.robots.gantry_tau("l1_camera")
        T, Td, Tdd, q = columns(random_states(robot, 20, seed=8))
        d = T[:, None] - np.asarray(robot.A) - q[:, :, None] * np.asarray(robot.v)
        dv = np.sum(d * np.asarray(robot.v), axis=2)
        qd = np.einsum("nij,nj->ni", d, Td) / dv
        w = Td[:, None] - qd[:, :, None] * np.asarray(robot.v)
        qdd = (np.einsum("nij,nj->ni", d, Tdd) + np.sum(w * w, axis=2)) / dv
        maps = MotionMaps(robot, "q", "T")
        J, bias, status = maps.acceleration(q, qd)
        assert not status.any()
        assert relative_error(np.einsum("nij,nj->ni", J, qd), Td) < 1e-11
        assert relative_error(np.einsum("nij,nj->ni", J, qdd) + bias, Tdd) < 1e-11
        inverse = MotionMaps(robot, "T", "q")
        back, status = inverse.velocity(T)
        assert not status.any() and relative_error(back @ J, np.broadcast_to(np.eye(3), J.shape)) < 1e-11
        one, alone, ok = maps.acceleration(q[0], qd[0])
        assert ok is Status.OK and np.array_equal(one, J[0]) and np.array_equal(alone, bias[0])

    def test_exact_parallelograms_make_the_six_link_robot_a_three_link_one(self):
        three = gt.robots.gantry_tau("l1_tape")
        arm = [0, 1, 1, 2, 2, 2]
        rng = np.random.default_rng(9)
        B = 0.1 * rng.normal(size=(6, 3))
        A, v, L = (np.asarray(getattr(three, k), float)[arm] for k in "AvL")
        six = gt.robots.six_link_gantry_tau(A=A + B, v=v, L=L, B=B, home=three.home, home_e=[1.0, 0, 0, 0])
        q = columns(random_states(three, 5, seed=10))[3]
        assert (
            relative_error(MotionMaps(six, "q", "T").velocity(q)[0], MotionMaps(three, "q", "T").velocity(q)[0]) < 1e-9
        )

    def test_what_needs_more_is_a_sentence(self):
        with pytest.raises(gt.ModelError, match="'der\\(T\\)'; it depends on q, der\\(q\\)"):
            MotionMaps(gt.robots.gantry_tau("l1_tape"), "q", "der(T)")


def test_amplification_grows_towards_the_edge_of_reach():
    # link 1 turns across its guideway: dq/dT without bound, and its angle to the plane across goes to zero
    robot = gt.robots.gantry_tau("l1_tape")
    inverse = robot.causal("T", "q")
    A, L = np.asarray(robot.A[0]), float(robot.L[0])
    lean = np.array([0.3, 0.1, 0.01])
    down = np.array([0.0, -np.sin(0.6), -np.cos(0.6)])
    T = A + np.outer(L * np.cos(lean), down)
    q, status = inverse(T)
    assert not status.any()
    d = T - A - q[:, :1] * [1.0, 0.0, 0.0]
    assert relative_error(singularity.inverse(d, [1.0, 0.0, 0.0]).angle_rad, lean) < 1e-9
    largest, smallest, status = singularity.amplification(inverse, T)
    assert not status.any() and np.all(np.diff(largest) > 0) and largest[-1] > 50.0
    forward, _, _ = singularity.amplification(robot.causal("q", "T"), q)
    assert relative_error(forward * smallest, np.ones(3)) < 1e-9
    beyond, _, code = singularity.amplification(inverse, A + 1.1 * L * down)
    assert code is Status.OUT_OF_RANGE and np.isnan(beyond)


def test_platform_of_the_d1():
    robot = gt.robots.six_link_gantry_tau()
    names = ("A", "v", "L", "B", "m_p", "c_p", "I_p", "m_c", "m_a", "coulomb", "viscous", "velocity_scale")
    by_hand = SixLinkByHand(**{k: np.array(getattr(robot, k), dtype=float) for k in names})
    q, e, status = robot.causal("T", ["q", "e"])(robot.home)
    assert status is Status.OK
    R = rotation(e)
    angle = singularity.platform(by_hand.links(q, np.asarray(robot.home), R), by_hand.B @ R.T)
    assert np.radians(2.0) < angle < np.radians(45.0)


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: singularity.inverse([[0, 0, 0.0]], [[1, 0, 0]]), "link vector 1 has zero length"),
        (lambda: singularity.inverse([[1, 0, 0.0]], [[0, 0, 0]]), "guideway direction 1 has zero length"),
        (lambda: singularity.forward([np.eye(3), [[1, 0, 0], [0, 0, 0], [0, 0, 1]]]), "link vector 2 in row 1"),
        (lambda: singularity.platform(np.zeros((6, 3)), np.ones((6, 3))), "link vector 1 has zero length"),
    ],
)
def test_what_has_no_direction_is_refused(call, sentence):
    with pytest.raises(gt.ModelError, match=sentence):
        call()
