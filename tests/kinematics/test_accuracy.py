"""Accuracy: corners by first order, by the model's equations and by Newton; ellipsoids, shape, draws; bad rows."""

import tomllib
from functools import cache
from importlib.resources import files

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

import gtmodel as gt
from gtmodel.kinematics.accuracy import (
    SIGNS,
    Ellipsoids,
    ErrorCase,
    ForwardWithLengths,
    base_point_cloud,
    common_point,
    exact_corners,
    first_order_corners,
    largest,
    length_cloud,
    map_errors,
    parallelepiped,
    projected_corners,
)
from gtmodel.kinematics.workspace import InverseKinematics
from gtmodel.results import Status
from tests.kinematics.by_hand import ByHand

TABLES = tomllib.loads(files("gtmodel.robots").joinpath("data", "gantry_tau.toml").read_text(encoding="utf-8"))
PRINTED, ERRORS = TABLES["d1_nominal"], TABLES["actuator_errors"]
D1 = ByHand(*(np.array(PRINTED[k]) for k in ("A_m", "v", "L_m")))
R1 = 1e-6 * np.array(ERRORS["case_1_um"])
CASE_2 = Ellipsoids.about_guideways(
    D1.v, 1e-6 * np.array(ERRORS["case_2_along_um"]), 1e-6 * np.array(ERRORS["case_2_across_um"])
)
HOME = D1.A.mean(axis=0) + 0.7 * D1.L.mean() * D1.v.mean(axis=0)
# r / L is some 4e-5, magnified up to three times
SECOND_ORDER = 2e-4
ROUND_OFF = 1e-12
TWO_ROADS = 1e-12  # [m]


@cache
def poses(n: int = 200):
    T = HOME + np.random.default_rng(4).uniform(-0.5, 0.5, (n, 3))
    found = InverseKinematics(D1)(T)
    assert not found.status.any()
    return found


class TestCorners:
    def test_the_model_itself_agrees_with_first_order_and_newton(self) -> None:
        p = poses()
        forward = gt.robots.gantry_tau("d1_nominal").causal("q", "T")
        exact, status = exact_corners(ForwardWithLengths(forward, ["L[0]", "L[1]", "L[2]"]), p.q, p.a, D1.L, R1)
        assert not status.any()
        lengths = (D1.L + SIGNS * R1)[None].repeat(len(p.T), axis=0).reshape(-1, 3)
        newton, met = common_point(p.a.repeat(8, axis=0), lengths, p.T.repeat(8, axis=0))
        assert not met.any()
        np.testing.assert_allclose(exact.reshape(-1, 3), newton, atol=TWO_ROADS, rtol=0)
        errors, status = first_order_corners(p.directions, R1)
        assert not status.any()
        np.testing.assert_allclose(errors, exact - p.T[:, None], atol=SECOND_ORDER * R1.max())
        # halving the errors quarters what first order leaves out
        half, _ = exact_corners(ForwardWithLengths(forward, ["L[0]", "L[1]", "L[2]"]), p.q, p.a, D1.L, R1 * 500)
        full, _ = exact_corners(ForwardWithLengths(forward, ["L[0]", "L[1]", "L[2]"]), p.q, p.a, D1.L, R1 * 1000)
        rest = [np.abs(x - p.T[:, None] - k * errors).max() for x, k in ((half, 500), (full, 1000))]
        assert rest[1] / rest[0] == pytest.approx(4.0, rel=0.2)

    def test_no_point_within_the_bounds_is_further_away(self) -> None:
        """The farthest point of |U x| <= r lies at a corner: linear programmes in many directions find none beyond."""
        u = poses().directions[0]
        corners = first_order_corners(u[None], R1)[0][0]
        rng = np.random.default_rng(1)
        for direction in [*rng.normal(size=(20, 3)), corners[np.argmax(np.linalg.norm(corners, axis=1))]]:
            n = direction / np.linalg.norm(direction)
            scaled = linprog(-n, A_ub=np.vstack([u, -u]), b_ub=np.tile(R1, 2) * 1e6, bounds=(None, None))
            assert -scaled.fun == pytest.approx(1e6 * (corners @ n).max(), rel=1e-6)
            assert -scaled.fun <= 1e6 * largest(corners[None])[0] * (1 + 1e-9)

    def test_bad_rows_have_a_status_and_harm_no_other(self) -> None:
        u = poses().directions[:5].copy()
        expected, _ = first_order_corners(u, R1)
        u[1] = np.nan
        u[3, 2] = u[3, 0] + u[3, 1]  # in the plane of the others
        errors, status = first_order_corners(u, R1)
        assert status.tolist() == [0, Status.NOT_FINITE, 0, Status.SINGULAR, 0]
        np.testing.assert_array_equal(errors[[0, 2, 4]], expected[[0, 2, 4]])
        assert np.isnan(errors[[1, 3]]).all()

    def test_links_that_do_not_meet(self) -> None:
        p = poses()
        a, T = p.a[:3], p.T[:3].copy()
        lengths = np.tile(D1.L, (3, 1))
        lengths[1] = [0.3, 3.0, 0.3]
        T[2] = np.nan
        found, status = common_point(a, lengths, T)
        assert status[0] == Status.OK and status[1] in (Status.NOT_CONVERGED, Status.SINGULAR)
        assert status[2] == Status.NOT_FINITE and np.isnan(found[1:]).all()
        np.testing.assert_allclose(found[0], T[0], atol=TWO_ROADS)
        forward = ForwardWithLengths(gt.robots.gantry_tau("d1_nominal").causal("q", "T"), ["L[0]", "L[1]", "L[2]"])
        found, status = forward(p.q[:3], lengths)
        assert status.tolist() == [Status.OK, Status.OUT_OF_RANGE, Status.OK]

    def test_unknown_parameter(self) -> None:
        with pytest.raises(gt.ModelError, match=r"'l\[0\]' is not a parameter of the model; there are A\[0,0\]"):
            ForwardWithLengths(gt.robots.gantry_tau("d1_nominal").causal("q", "T"), ["l[0]"])


class TestEllipsoids:
    def test_support_is_the_greatest_of_many_points(self) -> None:
        u = poses().directions[:3]
        s = np.random.default_rng(0).normal(size=(200_000, 3))
        s /= np.linalg.norm(s, axis=1, keepdims=True)
        for i in range(3):
            surface = (s * CASE_2.half[i]) @ CASE_2.axes[i]
            drawn = (surface @ u[:, i].T).max(axis=0)
            np.testing.assert_allclose(drawn, CASE_2.support(u)[:, i], rtol=1e-3)
            assert (drawn <= CASE_2.support(u)[:, i] * (1 + ROUND_OFF)).all()

    def test_axes_are_right_handed_and_lie_along_the_guideways(self) -> None:
        for axes, v in zip(CASE_2.axes, D1.v, strict=True):
            np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=ROUND_OFF)
            assert np.linalg.det(axes) == pytest.approx(1.0)
            np.testing.assert_allclose(axes[0], v / np.linalg.norm(v), atol=ROUND_OFF)

    def test_spheres_give_the_corners_of_length_errors(self) -> None:
        p = poses()
        spheres = Ellipsoids.about_guideways(D1.v, R1, R1)
        corners, converged = projected_corners(p.a, p.T, D1.L, spheres)
        lengths = (D1.L + SIGNS * R1)[None].repeat(len(p.T), axis=0).reshape(-1, 3)
        newton, _ = common_point(p.a.repeat(8, axis=0), lengths, p.T.repeat(8, axis=0))
        assert converged.all()
        np.testing.assert_allclose(corners.reshape(-1, 3), newton, atol=1e-11)

    def test_projected_corners_lie_on_their_three_ellipsoids(self) -> None:
        p = poses(40)
        corners, converged = projected_corners(p.a, p.T, D1.L, CASE_2)
        assert converged.all()
        for j, signs in enumerate(SIGNS):
            for i in range(3):
                own = (corners[:, j] - p.a[:, i]) @ CASE_2.axes[i].T
                level = ((own / (D1.L[i] + signs[i] * CASE_2.half[i])) ** 2).sum(axis=1)
                np.testing.assert_allclose(level, 1.0, atol=ROUND_OFF)

    def test_projection_is_a_little_less_than_the_bound(self) -> None:
        p = poses()
        projected = largest(projected_corners(p.a, p.T, D1.L, CASE_2)[0] - p.T[:, None])
        bound = largest(first_order_corners(p.directions, CASE_2.support(p.directions))[0])
        assert (projected < bound).all() and (projected > 0.9 * bound).all()

    def test_projection_near_a_singularity_gives_up(self) -> None:
        a = np.array([[[-1.0, -1, 0], [-1, 0, 0], [-1, 1, 0]]])
        T = np.zeros((1, 3))
        lengths = np.linalg.norm(a[0], axis=1)
        corners, converged = projected_corners(a, T, lengths, Ellipsoids.about_guideways(np.eye(3), R1, R1))
        assert not converged.any() and np.isnan(corners).all()


class TestParallelepiped:
    def test_by_the_hull_of_the_corners(self) -> None:
        u = poses().directions[:6]
        shape, corners = parallelepiped(u, R1), first_order_corners(u, R1)[0]
        for n in range(6):
            hull = ConvexHull(corners[n] * 1e6)
            assert 1e18 * shape.volume[n] == pytest.approx(hull.volume, rel=1e-9)
            assert 2e12 * shape.faces[n].sum() == pytest.approx(hull.area, rel=1e-9)
            between = np.linalg.norm(corners[n][:, None] - corners[n][None], axis=2)
            assert shape.longest[n] == pytest.approx(between.max(), rel=1e-12)
            assert shape.longest[n] == pytest.approx(2 * largest(corners[[n]])[0], rel=1e-12)
            # faces F_i: distance 2 r_i, orthogonal to link i
            np.testing.assert_allclose(shape.edges[n] @ u[n].T, np.diag(2 * R1), atol=1e-15)

    def test_angles_by_spherical_trigonometry(self) -> None:
        """Law of cosines of the pyramid's top: cos a1 = cos a2 cos a3 + sin a2 sin a3 cos b1."""
        shape = parallelepiped(poses().directions, R1)
        a, b = shape.link_angles, shape.pyramid_angles
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            right = np.cos(a[:, j]) * np.cos(a[:, k]) + np.sin(a[:, j]) * np.sin(a[:, k]) * np.cos(b[:, i])
            np.testing.assert_allclose(np.cos(a[:, i]), right, atol=ROUND_OFF)

    def test_beta_is_an_angle_of_the_face(self) -> None:
        shape = parallelepiped(poses().directions, R1)
        e = shape.edges
        for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
            cosine = (e[:, j] * e[:, k]).sum(axis=1) / np.linalg.norm(e[:, j], axis=1) / np.linalg.norm(e[:, k], axis=1)
            np.testing.assert_allclose(np.abs(cosine), np.abs(np.cos(shape.pyramid_angles[:, i])), atol=1e-9)

    def test_orthogonal_links_make_a_box_and_the_least_error(self) -> None:
        shape = parallelepiped(np.eye(3)[None], np.array([1.0, 2.0, 3.0]))
        np.testing.assert_allclose(shape.faces, [[24, 12, 8]])
        np.testing.assert_allclose(shape.diagonals, 2 * np.sqrt(14.0))
        others = parallelepiped(poses().directions, np.array([1.0, 2.0, 3.0]))
        assert (others.longest > shape.longest).all()


class TestDraws:
    @pytest.mark.parametrize("n", [0, 17, 42])
    def test_corners_bound_the_cloud_tightly(self, n: int) -> None:
        p = poses()
        pose = (p.a[n], p.T[n], D1.L)
        for cloud, r in (
            (length_cloud(*pose, R1, 20_000, seed=n), R1),
            (base_point_cloud(*pose, CASE_2, 20_000, seed=n), CASE_2.support(p.directions[[n]])),
        ):
            bound = largest(first_order_corners(p.directions[[n]], r)[0])[0]
            assert 0.93 < np.linalg.norm(cloud, axis=1).max() / bound < 1 + SECOND_ORDER
            # every draw lies between the six faces
            assert np.abs(cloud @ p.directions[n].T / r).max() < 1 + SECOND_ORDER

    def test_seeds(self) -> None:
        p = poses()
        draw = lambda seed: length_cloud(p.a[0], p.T[0], D1.L, R1, 100, seed)  # noqa: E731
        np.testing.assert_array_equal(draw(1), draw(1))
        assert not np.array_equal(draw(1), draw(2))

    def test_robots_that_cannot_be_assembled(self) -> None:
        p = poses()
        with pytest.raises(ValueError, match=r"of 100 drawn robots cannot be assembled"):
            length_cloud(p.a[0], p.T[0], D1.L, np.array([1.5, 1.5, 1.5]), 100, seed=1)


class TestMap:
    def test_chunks_bad_rows_and_stops(self) -> None:
        def base_points(T):
            found = InverseKinematics(D1)(T)
            return found.a, found.status

        case = ErrorCase(D1.L, radius=R1)
        T = poses(30).T.copy()
        T[3], T[7] = np.nan, T[7] + [0, 9.0, 0]
        whole, parts = map_errors(case, base_points, T), map_errors(case, base_points, T, chunk=4)
        np.testing.assert_array_equal(whole.error, parts.error)
        assert whole.status[[3, 7]].tolist() == [Status.NOT_FINITE, Status.OUT_OF_RANGE]
        assert np.isnan(whole.error[[3, 7]]).all() and np.isfinite(np.delete(whole.error, [3, 7])).all()
        one = map_errors(case, base_points, T[[5]])
        assert one.error[0] == whole.error[5]
        stopped = map_errors(case, base_points, T, chunk=4, progress=lambda fraction: fraction > 0.4)
        assert not stopped.complete and np.isnan(stopped.error[-4:]).all() and np.isfinite(stopped.error[0])
