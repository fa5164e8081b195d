"""ZYZ angles and rotation vectors against scipy; D1's orientation over a grid as printed."""

from __future__ import annotations

import tomllib
from functools import cache
from importlib.resources import files

import numpy as np
import pytest
from scipy.optimize import fsolve
from scipy.spatial.transform import Rotation

import gtmodel as gt
from gtmodel.geometry.rotations import matrices
from gtmodel.kinematics import grid, orientation_map, rotation_vector, zyz
from gtmodel.kinematics.orientation import OrientationMap
from gtmodel.robots.six_link import D1_ZYZ_DEG, six_link_gantry_tau

ROUND_OFF = 1e-12
# Dressler 2012, Fig. 4.7 and section 4.2 print 0.1 to 0.5 deg; over +-0.5 m these three follow from Table 5.9
RANGE_DEG = np.array([0.18, 0.55, 0.24])
PRINTED = 0.1
# of the range: the six printed v differ by 1e-4, which turns the links a little along the guideways too
REPEATED = 0.05
RNG = np.random.default_rng(8)


def quaternion(r: Rotation) -> np.ndarray:
    """Scalar first."""
    return r.as_quat()[..., [3, 0, 1, 2]]


class TestAngles:
    R = Rotation.random(200, rng=np.random.default_rng(1))

    def test_zyz_is_that_of_scipy(self):
        for orientation in (quaternion(self.R), 3.0 * quaternion(self.R), self.R.as_matrix()):
            angles, singular = zyz(orientation)
            assert not np.any(singular)
            assert np.max(np.abs(angles - self.R.as_euler("ZYZ"))) < ROUND_OFF

    def test_about_keeps_neighbours_together(self):
        near = Rotation.from_euler("ZYZ", [[3.1, 1.0, -3.1], [3.2, 1.0, -3.2]])
        angles = zyz(near.as_matrix(), about=[3.15, 1.0, -3.15])[0]
        assert np.max(np.abs(angles - [[3.1, 1.0, -3.1], [3.2, 1.0, -3.2]])) < ROUND_OFF
        assert np.ptp(zyz(near.as_matrix())[0][:, 0]) > 6  # torn apart without it

    @pytest.mark.parametrize("beta", [0.0, np.pi, 1e-8])
    def test_singular_beta_is_flagged_and_the_angles_still_give_the_rotation(self, beta):
        R = Rotation.from_euler("ZYZ", [0.7, beta, 0.4])
        angles, singular = zyz(R.as_matrix()[None])
        assert singular[0] and angles[0, 2] == 0.0
        assert np.max(np.abs(Rotation.from_euler("ZYZ", angles[0]).as_matrix() - R.as_matrix())) < 1e-7

    def test_a_half_turn_has_one_of_its_two_axes(self):
        for axis in ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.6, -0.8], [0.36, -0.48, 0.8]):
            for sign in (1, -1):
                turn = Rotation.from_rotvec(sign * np.pi * np.array(axis)).as_matrix()
                np.testing.assert_allclose(rotation_vector(turn, np.eye(3)), np.pi * np.array(axis), atol=ROUND_OFF)
        near = (np.pi - 1e-6) * np.array([0.0, -0.6, 0.8])
        np.testing.assert_allclose(rotation_vector(Rotation.from_rotvec(near).as_matrix(), np.eye(3)), near, atol=1e-9)

    def test_rotation_vectors_are_those_of_scipy(self):
        reference = Rotation.random(rng=np.random.default_rng(2))
        size = np.geomspace(1e-9, 3.0, 200)[:, None]
        turn = Rotation.from_rotvec(size * RNG.normal(size=(200, 3)) / 4)
        found = rotation_vector((turn * reference).as_matrix(), reference.as_matrix())
        assert np.max(np.abs(found - turn.as_rotvec())) < 1e-11  # some digits go near half a turn
        assert np.array_equal(rotation_vector(np.eye(3), np.eye(3)), np.zeros(3))

    def test_rotation_vectors_keep_their_digits_up_to_half_a_turn(self):
        # 7e-5 rad were lost where the skew part of the matrix is round-off
        axes = np.array([[1, 2, 3], [1, -1, 1], [0, 1e-3, 1], [-3, 1, 0.1]]) / 1.0
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        for left in np.geomspace(1e-14, 1e-1, 27):
            vectors = (np.pi - left) * axes
            found = rotation_vector(Rotation.from_rotvec(vectors).as_matrix(), np.eye(3))
            assert np.max(np.abs(found - vectors)) < 1e-14

    def test_what_is_not_finite_stays_so_and_shapes_are_checked(self):
        angles, singular = zyz(np.array([[np.nan, 0, 0, 1], [1.0, 0, 0, 0], [0, 0, 0, 0]]))
        assert (
            np.all(np.isnan(angles[[0, 2]]))
            and np.all(np.isfinite(angles[1]))
            and list(singular) == [False, True, False]
        )
        with pytest.raises(ValueError, match=r"quaternions \(..., 4\) or rotation matrices .* found shape \(5, 3\)"):
            zyz(np.zeros((5, 3)))


class TestGrid:
    def test_layers_are_along_the_first_direction(self):
        points = grid([1.0, 2.0, 3.0], [0.6, 0.5, 0.25], [3, 2, 1], [[2, 0, 0], [0, 0, 5], [0, 1, 0]])
        assert points.shape == (3, 2, 1, 3)
        assert np.allclose(points[:, 0, 0, 0], [0.4, 1.0, 1.6]) and np.allclose(points[0, :, 0, 2], [2.5, 3.5])
        assert np.allclose(points[..., 1], 2.0)  # one point stands in the middle

    def test_what_makes_no_grid(self):
        with pytest.raises(ValueError, match="linearly independent"):
            grid(np.zeros(3), np.ones(3), [2, 2, 2], [[1, 0, 0], [1, 0, 0], [0, 0, 1]])
        with pytest.raises(ValueError, match="at least 1; found"):
            grid(np.zeros(3), np.ones(3), [2, 0, 2])
        with pytest.raises(ValueError, match="three counts"):
            grid(np.zeros(3), np.ones(3), [2, 2])


@cache
def d1() -> gt.Model:
    return six_link_gantry_tau()


@cache
def tcp_at_zero() -> np.ndarray:
    T, status = d1().causal("q", "T")(np.zeros(3))
    assert status == gt.Status.OK
    return T


@cache
def printed_map() -> OrientationMap:
    along = np.mean(d1().v, axis=0)
    return orientation_map(d1(), grid(tcp_at_zero(), [0.6, 0.5, 0.5], [6, 9, 9], [along, [0, 1, 0], [0, 0, 1]]))


class TestD1:
    def test_range_over_the_grid_is_the_printed_one(self):
        found = printed_map()
        assert np.all(found.ok) and not np.any(found.singular)
        assert np.max(np.abs(np.degrees(found.range()) / RANGE_DEG - 1)) < PRINTED

    def test_the_pattern_repeats_by_layer(self):
        # "varies only little for positions with the same yz-coordinates", not at all if all v were equal
        found = printed_map()
        assert np.max(found.layer_difference()) < REPEATED
        assert np.min(found.layer_range() / found.range()) > 0.9

    def test_orientations_are_those_of_the_six_closures(self):
        """Six link lengths by scipy's solver, from angles and carts of its own."""
        r, found = d1(), printed_map()
        arm = [0, 1, 1, 2, 2, 2]
        for place in [(0, 0, 0), (5, 8, 0), (2, 4, 4), (3, 1, 7)]:
            T = found.T[place]

            def closure(x, T=T):
                tip = T + Rotation.from_euler("ZYZ", x[3:]).apply(np.array(r.B))
                cart = np.array(r.A) + x[:3][arm][:, None] * np.array(r.v)
                return np.sum((tip - cart) ** 2, axis=1) - np.array(r.L) ** 2

            x = fsolve(closure, [0.0, 0.0, 0.0, *np.radians(D1_ZYZ_DEG)], xtol=1e-12)
            assert np.max(np.abs(closure(x))) < 1e-12
            assert np.max(np.abs(found.zyz[place] - x[3:])) < 1e-9

    def test_turns_from_the_middle(self):
        found = printed_map()
        turn = found.rotation_vector[0, 0, 0]
        assert np.allclose(Rotation.from_rotvec(turn).as_matrix() @ found.reference, found.R[0, 0, 0], atol=ROUND_OFF)
        # the spread of ZYZ angles and of the turns is of one size, beta being far from 0 and pi
        assert 0.3 < np.max(np.degrees(np.ptp(found.rotation_vector.reshape(-1, 3), axis=0))) < 1.0

    def test_points_out_of_reach_and_nan_do_not_harm_the_others(self):
        T = np.stack([printed_map().T[0, :2, 0], printed_map().T[1, :2, 0]])
        T[0, 0, 1] += 9.0
        T[1, 1, 2] = np.nan
        found = orientation_map(d1(), T)
        assert found.ok.tolist() == [[False, True], [True, False]]
        assert found.status[1, 1] == gt.Status.NOT_FINITE and found.status[0, 0] != gt.Status.NOT_FINITE
        assert np.all(np.isnan(found.zyz[~found.ok])) and np.all(np.isfinite(found.range()))
        assert np.max(np.abs(found.R[1, 0] - printed_map().R[1, 0, 0])) < ROUND_OFF
        assert np.all(np.isnan(found.layer_difference()))  # no place is ok in both layers

    def test_reach_is_that_of_the_three_link_robot(self):
        d = tomllib.loads(files("gtmodel.robots").joinpath("data", "gantry_tau.toml").read_text())["d1_nominal"]
        A, v, L = (np.array(d[k]) for k in ("A_m", "v", "L_m"))
        found = orientation_map(d1(), grid(tcp_at_zero(), [0.0, 1.6, 1.6], [1, 11, 11]))
        offset = found.T[..., None, :] - A
        dv, vv = np.sum(offset * v, axis=-1), np.sum(v * v, axis=-1)
        root = np.min(dv**2 - vv * (np.sum(offset**2, axis=-1) - L**2), axis=-1)
        clear = np.abs(root) > 0.02  # m2; nearer to the border a millimetre between the two robots may decide
        assert np.array_equal(found.ok[clear], root[clear] > 0)
        assert np.sum(clear) > 100 and 0.2 < np.mean(found.ok) < 0.6

    def test_nothing_in_reach(self):
        found = orientation_map(d1(), np.full((2, 1, 1, 3), 50.0))
        assert not np.any(found.ok) and np.all(np.isnan(found.range()))


def test_exact_parallelograms_keep_their_orientation():
    A, v, L = (np.array(getattr(gt.robots.gantry_tau("l1_tape"), k)) for k in "AvL")
    arm = [0, 1, 1, 2, 2, 2]
    B = 0.1 * np.random.default_rng(1).normal(size=(6, 3))
    robot = gt.robots.SixLink(
        A=A[arm] + B, v=v[arm], L=L[arm], B=B, I_p=np.eye(3), m_p=1.0, m_c=[1.0, 1.0, 1.0], home=[1.4, -0.9, 0.3]
    )
    found = orientation_map(robot, grid([1.4, -0.9, 0.3], [0.3, 0.2, 0.2], [2, 3, 3]))
    assert np.all(found.ok) and np.max(np.abs(found.R - np.eye(3))) < 1e-10
    assert np.all(found.singular)  # R = 1: ZYZ says nothing here, the rotation vector does
    assert np.max(np.abs(found.rotation_vector)) < 1e-10
    assert np.max(np.abs(matrices(found.R) - np.eye(3))) < 1e-10
