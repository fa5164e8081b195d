"""Cameras, boards, starts and intersections: against closed forms, central differences and themselves."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gtmodel as gt
from gtmodel.geometry.rotations import composed, inverse_poses, matrices_of, poses_of
from gtmodel.inference.bundle import bundle_fit
from gtmodel.results import ArgumentError, Status
from gtmodel.vision import (
    Board,
    board_pose,
    focal_length,
    homography,
    intersect,
    project,
    similarity_motions,
    undistort,
)
from gtmodel.vision.stereo.calibration import pose_group
from gtmodel.vision.views import MOVES, board_view
from tests.inference.synthetic_bundle import scene

LENS = np.array([812.0, 805.0, 331.0, 228.0, -0.28, 0.09, 1.2e-3, -7e-4, 0.02])
SIDE = np.array([[1.0, 0, 0, 0, 0, 0, 0], [0.99875026, 0.0, 0.04997917, 0.0, -0.4, 0.01, 0.02]])
SIDE = np.hstack([SIDE[:, :4] / np.linalg.norm(SIDE[:, :4], axis=1, keepdims=True), SIDE[:, 4:]])


def points(n: int = 200, seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(-0.6, 0.6, n), rng.uniform(-0.5, 0.5, n), rng.uniform(1.2, 3.0, n)])


def test_undistort_undoes_project() -> None:
    p = points()
    uv, status = project(p, LENS)
    assert not status.any()
    xy, status = undistort(uv, LENS)
    assert not status.any()
    assert np.abs(xy - p[:, :2] / p[:, 2:]).max() < 1e-12


def test_behind_the_camera_and_beyond_the_fold_have_a_status_and_no_pixel() -> None:
    lens = np.array([500.0, 500, 320, 240, -0.2, 0, 0, 0, 0])
    fold = np.sqrt(1 / 0.6)  # where 1 - 3 0.2 r^2 = 0
    p = np.array([[fold - 1e-6, 0, 1], [fold + 1e-6, 0, 1], [0.1, 0, -1], [0, 0, 0], [np.nan, 0, 1]])
    uv, status = project(p, lens)
    assert list(status) == [Status.OK, Status.OUT_OF_RANGE, Status.OUT_OF_RANGE, Status.OUT_OF_RANGE, Status.NOT_FINITE]
    assert np.all(np.isfinite(uv[0])) and np.all(np.isnan(uv[1:]))
    # a polynomial that folds over and back again: outside, its derivative is positive
    back = np.array([500.0, 500, 320, 240, -0.5, 0.0, 0, 0, 0.06])
    r = np.linspace(0.1, 3.0, 300)
    slope = 1 - 1.5 * r**2 + 0.42 * r**6
    first = r[np.argmax(slope <= 0)]
    _, status = project(np.column_stack([r, 0 * r, 1 + 0 * r]), back)
    assert slope[-1] > 0 and slope.min() < 0
    assert np.array_equal(status == Status.OK, r < first)
    # the farthest pixel that any direction reaches
    far = fold * (1 - 0.2 * fold**2) * 500 + 320
    assert list(undistort(np.array([[far - 0.1, 240], [far + 0.1, 240]]), lens)[1]) == [Status.OK, Status.NOT_CONVERGED]


def test_the_component_sees_the_same_pixels() -> None:
    values = dict(zip(gt.vision.LENS, LENS, strict=True))
    bench = gt.Builder("bench")
    ground = bench.part("ground", gt.mechanics.Ground())
    mount = bench.part(
        "mount", gt.mechanics.Fixed(d=[0.3, -0.2, -1.0], R=Rotation.from_rotvec([0.1, 0.2, -0.1]).as_matrix())
    )
    camera = bench.part("camera", gt.vision.PinholeCamera(**values))
    mark = bench.part("mark", gt.mechanics.PointLoad())
    bench.add(gt.connect([ground.frame, mount.b, mark.frame], [mount.a, camera.frame, camera.point]))
    f = bench.causal(known="camera.point.r", targets=["camera.u", "camera.v"])
    p = points(40)
    p[0, 2] = -3.0
    R = Rotation.from_rotvec([0.1, 0.2, -0.1]).as_matrix()
    uv, status = project((p - [0.3, -0.2, -1.0]) @ R, LENS)
    u, v, own = f(p)
    assert np.allclose(np.column_stack([u, v]), uv, rtol=1e-12, equal_nan=True)
    assert np.array_equal(own, status) and status[0] == Status.OUT_OF_RANGE


def test_derivatives_of_a_view_against_central_differences() -> None:
    """Central differences of sixth order, whose error is below 1e-9 of the largest derivative."""
    import casadi as ca

    f = board_view()
    x = [ca.SX.sym("x", f.size1_in(k)) for k in range(4)]
    J = ca.Function("J", x, [ca.jacobian(f.call(x)[0], ca.vertcat(*x[:3]))])
    board = poses_of(Rotation.from_rotvec([[0.3, -0.4, 0.1]]).as_matrix(), np.array([[0.1, -0.05, 1.6]]))[0]
    data = np.array([0.12, -0.08, 0.02, 300.0, 200.0])
    exact = J(LENS, SIDE[1], board, data).full()
    every = np.concatenate([LENS, SIDE[1], board])
    for k in range(len(every)):
        h = 2e-3 * max(abs(every[k]), 0.5)
        total = np.zeros(2)
        for steps, weight in ((1, 45.0), (2, -9.0), (3, 1.0)):
            for sign in (1, -1):
                moved = every.copy()
                moved[k] += sign * steps * h
                error = f(moved[:9], moved[9:16], moved[16:], data)[0].full().ravel()
                total += sign * weight * error
        assert np.abs(total / (60 * h) - exact[:, k]).max() <= 1e-9 * max(1.0, np.abs(exact).max()), k


def test_poses_compose_and_undo() -> None:
    rng = np.random.default_rng(3)
    R = Rotation.from_rotvec(rng.normal(size=(20, 3)) * 2).as_matrix()
    a = poses_of(R, rng.normal(size=(20, 3)))
    assert np.allclose(matrices_of(a), R, atol=1e-12)
    still = composed(a, inverse_poses(a))
    assert np.allclose(still, [1, 0, 0, 0, 0, 0, 0], atol=1e-12)


def test_starts_are_exact_on_perfect_data() -> None:
    board = Board(9, 6, square=0.03)
    plain = np.array([700.0, 700.0, 320, 240, 0, 0, 0, 0, 0])
    poses = poses_of(
        Rotation.from_rotvec([[0.5, 0.1, 0], [-0.2, 0.6, 0.3]]).as_matrix(), np.array([[0, 0, 0.6], [0.1, 0, 0.9]])
    )
    H = []
    for pose in poses:
        p = board.points @ matrices_of(pose[None])[0].T + pose[4:]
        uv, _ = project(p, plain)
        H.append(homography(board.points[:, :2], uv))
        assert np.allclose(board_pose(board.points, uv, plain), pose, atol=1e-9)
    assert abs(focal_length(H, [320, 240]) - 700) < 1e-6
    solid = np.random.default_rng(0).uniform([0.9, 1.9, 2.9], [1.1, 2.1, 3.1], (12, 3))
    pose = poses_of(Rotation.from_rotvec([[0.2, 0.1, -0.3]]).as_matrix(), np.array([[-1.0, -1.5, 0.3]]))[0]
    uv, status = project(solid @ matrices_of(pose[None])[0].T + pose[4:], plain)
    assert not status.any()
    assert np.allclose(board_pose(solid, uv, plain), pose, atol=1e-8)


def test_a_board_that_faces_the_camera_determines_no_focal_length() -> None:
    p = Board(9, 6).points
    H = [homography(p[:, :2], 500 / z * p[:, :2] + 100) for z in (8.0, 10.0, 13.0)]
    with pytest.raises(ArgumentError, match="tilt"):
        focal_length(H, [100, 100])


@pytest.mark.parametrize("size", [(8, 6), (7, 5), (6, 6)])
def test_boards_that_look_the_same_from_both_ends_are_refused(size) -> None:
    with pytest.raises(ArgumentError) as error:
        Board(*size)
    assert error.value.argument == "board"
    assert Board(*size, identified=True).points.shape == (size[0] * size[1], 3)


@pytest.mark.parametrize("count", [120, pytest.param(400, marks=pytest.mark.proof)])
def test_intersection_and_its_covariance_against_many_runs(count: int) -> None:
    rng = np.random.default_rng(8)
    p = points(12) @ np.diag([0.4, 0.4, 1.0]) + [0.2, 0, 0]
    lenses = np.stack([LENS, LENS])
    exact = np.stack([project(p @ matrices_of(c[None])[0].T + c[4:], LENS)[0] for c in SIDE], axis=1)
    assert np.abs(intersect(exact, lenses, SIDE, 0.1).p - p).max() < 1e-10
    one = intersect(exact, lenses, SIDE, 0.2)
    runs = np.stack([intersect(exact + rng.normal(0, 0.2, exact.shape), lenses, SIDE, 0.2).p for _ in range(count)])
    spread = np.einsum("rni,rnj->nij", runs - p, runs - p) / count
    ratio = np.sqrt(np.einsum("nii->ni", spread) / np.einsum("nii->ni", one.covariance))
    assert np.all(np.abs(ratio - 1) < 4 / np.sqrt(2 * count))  # four standard deviations of a standard deviation


def test_cameras_own_errors_enter_the_covariance() -> None:
    p = points(5) @ np.diag([0.4, 0.4, 1.0]) + [0.2, 0, 0]
    lenses = np.stack([LENS, LENS])
    exact = np.stack([project(p @ matrices_of(c[None])[0].T + c[4:], LENS)[0] for c in SIDE], axis=1)
    C = np.zeros((2 * MOVES, 2 * MOVES))
    C[2, 2] = 0.5**2  # cx of the first
    C[MOVES + 10, MOVES + 10] = 1e-3**2  # the second turned about its y
    more = intersect(exact, lenses, SIDE, 1e-6, C)
    moved = lenses.copy()
    moved[0, 2] += 0.5
    turned = SIDE.copy()
    turned[1] = pose_group("c", SIDE).moved(SIDE[1:], np.array([[0, 1e-3, 0, 0, 0, 0]]))[0]
    a = intersect(exact, moved, SIDE, 1.0).p - p
    b = intersect(exact, lenses, turned, 1.0).p - p
    expected = a[:, :, None] * a[:, None] + b[:, :, None] * b[:, None]
    assert np.abs(more.covariance - expected).max() <= 0.02 * np.abs(expected).max()  # to first order


def test_depth_is_worse_as_the_baseline_is_shorter() -> None:
    """The standard deviation of the depth falls as 1 / baseline: slope -1 within 0.05."""
    base = np.geomspace(0.02, 0.2, 8)
    plain = np.array([800.0, 800.0, 320, 240, 0, 0, 0, 0, 0])
    std = []
    for b in base:
        pair = np.array([[1.0, 0, 0, 0, 0, 0, 0], [1.0, 0, 0, 0, -b, 0, 0]])
        uv = np.array([[[320.0, 240.0], [320.0 - 800 * b / 3.0, 240.0]]])
        std.append(np.sqrt(intersect(uv, np.stack([plain, plain]), pair, 0.1).covariance[0, 2, 2]))
    assert abs(np.polyfit(np.log(base), np.log(std), 1)[0] + 1) < 0.05


def test_statuses_of_points_that_are_not_there() -> None:
    plain = np.array([500.0, 500.0, 320, 240, 0, 0, 0, 0, 0])
    pair = np.array([[1.0, 0, 0, 0, 0, 0, 0], [1.0, 0, 0, 0, -0.5, 0, 0]])
    uv = np.array(
        [
            [[345.0, 240], [220, 240]],
            [[345.0, 240], [np.nan, np.nan]],
            [[345.0, 240], [345, 240]],
            [[345.0, 240], [380, 240]],
        ]
    )
    seen = intersect(uv, np.stack([plain, plain]), pair, 0.1)
    assert list(seen.status) == [Status.OK, Status.SINGULAR, Status.SINGULAR, Status.OUT_OF_RANGE]
    assert np.all(np.isnan(seen.p[1:]))


def test_seven_motions_have_names_and_remedies() -> None:
    one = scene()
    motions = similarity_motions(["camera"], points=["point"])
    fit = bundle_fit(one.groups(), one.blocks(), motions=motions, hold_undetermined=True)
    assert fit.undetermined == 7
    assert sorted(fit.notes) == sorted(f"{m.words}: {m.remedy}" for m in motions)
    fixed = np.zeros((6, 9), bool)
    fixed[0, :6] = True
    only = bundle_fit(one.groups(fixed), one.blocks(), motions=motions, hold_undetermined=True)
    assert only.undetermined == 1 and "one known length" in only.notes[0]


def test_a_free_scene_of_boards_has_six_motions() -> None:
    """Boards of known size give the length."""
    board = Board(4, 3, square=0.05)
    rng = np.random.default_rng(5)
    poses = poses_of(
        Rotation.from_rotvec(rng.normal(0, 0.4, (5, 3))).as_matrix(), np.array([0, 0, 1.2]) + rng.normal(0, 0.1, (5, 3))
    )
    picture, k = np.repeat(np.arange(5), 12), np.tile(np.arange(12), 5)
    X = board.points[k]
    world = np.einsum("nij,nj->ni", matrices_of(poses)[picture], X) + poses[picture, 4:]
    plain = np.array([500.0, 500.0, 320, 240, 0, 0, 0, 0, 0])
    from gtmodel.inference.bundle import ResidualBlock, UnknownGroup

    blocks = []
    for c in range(2):
        uv, status = project(world @ matrices_of(SIDE[c][None])[0].T + SIDE[c, 4:], plain)
        assert not status.any()
        uv = uv + rng.normal(0, 0.1, uv.shape)
        sees = [("lens", 0), ("camera", c), ("board", picture)]
        blocks.append(ResidualBlock(f"camera {c + 1}", board_view(), sees, np.hstack([X, uv]), sigma=0.1))
    lens = UnknownGroup("lens", plain[None], gt.vision.LENS, fixed=np.ones(9, bool))
    groups = [lens, pose_group("camera", SIDE), pose_group("board", poses, local=True)]
    fit = bundle_fit(groups, blocks, motions=similarity_motions(["camera"], ["board"]), hold_undetermined=True)
    assert fit.undetermined == 6 and all("cameras and boards" in n for n in fit.notes)


def test_bal_files_come_back_as_they_were(tmp_path) -> None:
    one = scene(3, 10, 2)
    first = gt.vision.BundleFile(one.cameras, one.points, one.camera, one.point, one.uv)
    gt.vision.write_bal(tmp_path / "a.txt", first)
    again = gt.vision.read_bal(tmp_path / "a.txt")
    assert np.abs(again.cameras - first.cameras).max() < 1e-13 and np.array_equal(again.uv, first.uv)
    fit = bundle_fit(again.groups(), again.blocks(), covariance=False)
    assert fit.status.ok
    (tmp_path / "b.txt").write_text("3 10 20 1 2 3")
    with pytest.raises(ArgumentError):
        gt.vision.read_bal(tmp_path / "b.txt")


def test_corner_tables_in_both_forms(tmp_path) -> None:
    wide, long = tmp_path / "wide.csv", tmp_path / "long.csv"
    wide.write_text("pair,corner,X,Y,u_left,v_left,u_right,v_right\n01,0,0,0,1,2,3,4\n01,1,1,0,5,6,,\n")
    long.write_text(
        "camera,picture,mark,X,Y,Z,u,v,sigma\nleft,01,0,0,0,0,1,2,0.1\nleft,01,1,1,0,0,5,6,0.1\nright,01,0,0,0,0,3,4,0.2\n"
    )
    a, b = gt.vision.read_corners(wide), gt.vision.read_corners(long)
    assert a.cameras == b.cameras == ("left", "right") and a.n == b.n == 3
    assert np.array_equal(a.uv, b.uv) and np.array_equal(a.camera, b.camera) and b.sigma is not None
    assert a.label(2) == "corner 0 of picture 01 in right"
    for text in (
        "pair,corner,X,u_left,v_left\n1,0,0,1,2\n",
        "pair,corner,X,Y\n1,0,0,0\n",
        "pair,corner,X,Y,u_a,v_a\n1,0,0,x,1,2\n",
        "pair,corner,X,Y,u_a,v_a\n1,0,0,0,1,\n",  # half a pixel
        "pair,corner,X,Y,u_a,v_a\n1,0,0,0,1,2,3\n",  # more cells than names
        "pair,corner,X,Y,u_a,v_a,v_b\n1,0,0,0,1,2,3\n",  # b has no u
        "pair,corner,X,Y,u_a,v_a,u_a,v_a\n1,0,0,0,1,2,3,4\n",
        "camera,picture,corner,X,Y,v\na,1,0,0,0,1\n",
        "camera,picture,corner,X,Y,u,v,sigma\na,1,0,0,0,1,2,0\n",
        "",
    ):
        wide.write_text(text)
        with pytest.raises(ArgumentError) as error:
            gt.vision.read_corners(wide)
        assert error.value.argument == "corners"
