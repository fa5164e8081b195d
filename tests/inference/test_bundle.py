"""Fits with local unknowns: against dense algebra, SciPy and themselves in another order. All data are synthetic."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
import scipy
from scipy.spatial.transform import Rotation

from gtmodel.geometry.quaternions import logarithm
from gtmodel.geometry.rotations import inverse_right_jacobian
from gtmodel.inference.bundle import GaugeMotion, ResidualBlock, UnknownGroup, bundle_fit
from gtmodel.inference.bundle.elimination import along, normal_equations, reduced, step_solver
from gtmodel.inference.bundle.residual_block import BlockEvaluation
from gtmodel.inference.bundle.structure import structure
from gtmodel.results.refusal import ArgumentError
from gtmodel.results.status import SolveStatus
from tests.inference.synthetic_bundle import LABELS, Scene, projection, scene

STEP = 1e-10  # of a step by elimination against one by QR of all rows: the square of a condition of 1e3 in rounding
COVARIANCE = 1e-8
SAME = 1e-10  # of two orders of one problem
FREE = 7  # directions of a bundle that nothing ties to the world


def at_start(groups, blocks, dense=None):
    s = structure(groups, blocks, dense)
    names = {g.name: g for g in groups}
    values = {g.name: g.start for g in groups}
    rows = [BlockEvaluation(r.block, names, r.pick).linearised(values) for r in s.rows]
    return s, rows


def dense_rows(s, rows):
    """J and r of all unknowns, shared first, by columns of the identity."""
    locals_ = s.local.moves * len(s.eliminated)
    every = np.eye(s.columns + locals_)
    z = every[s.columns :].reshape(len(s.eliminated), s.local.moves, -1)
    J = np.concatenate([a.reshape(-1, len(every)) for a in along(s, rows, every[: s.columns], z)])
    return J, np.concatenate([lin.r.reshape(-1) for lin in rows])


@pytest.fixture(scope="module")
def small() -> Scene:
    return scene()


@pytest.mark.parametrize("dense", [True, False])
@pytest.mark.parametrize("heavy", [False, True])
def test_elimination_gives_the_dense_step(small: Scene, dense: bool, heavy: bool, monkeypatch) -> None:
    if heavy:
        monkeypatch.setattr("gtmodel.inference.bundle.structure.HEAVY", 0)
    s, rows = at_start(small.groups(small.anchored()), small.blocks(), dense)
    J, r = dense_rows(s, rows)
    length = np.linalg.norm(J, axis=0)
    used = length > 0
    step = np.zeros(J.shape[1])
    step[used] = np.linalg.lstsq(J[:, used] / length[used], -r, rcond=None)[0] / length[used]
    red = reduced(s, normal_equations(s, rows), 0.0, dense)
    x = -step_solver(s, rows, red)(red.g)
    own = np.concatenate([x, red.back(x).reshape(-1)])
    # above so many cameras S is damped by 1e-9 of its diagonal, which the step shows
    tolerance = STEP if dense else 1e-4
    assert np.abs((own - step) * np.where(used, length, 1.0)).max() <= tolerance * np.abs(step * length).max()


def test_a_damped_step_is_the_dense_one(small: Scene) -> None:
    s, rows = at_start(small.groups(), small.blocks())
    J, r = dense_rows(s, rows)
    H = J.T @ J
    step = np.linalg.solve(H + 0.1 * np.diag(np.diag(H)), -J.T @ r)
    red = reduced(s, normal_equations(s, rows), 0.1)
    x = -step_solver(s, rows, red)(red.g)
    own = np.concatenate([x, red.back(x).reshape(-1)])
    assert np.abs(own - step).max() <= STEP * np.abs(step).max()


def test_covariances_are_the_dense_ones(small: Scene) -> None:
    groups, blocks = small.groups(small.anchored()), small.blocks(sigma=0.5)
    fit = bundle_fit(groups, blocks)
    s, rows = at_start(small.groups(small.anchored(), **{f"{k}s": v for k, v in fit.values.items()}), blocks)
    J, _ = dense_rows(s, rows)
    used = np.flatnonzero(np.linalg.norm(J, axis=0) > 0)
    length = np.linalg.norm(J[:, used], axis=0)
    R = np.linalg.qr(J[:, used] / length, mode="r")
    inverse = np.linalg.inv(R)
    C = np.zeros((J.shape[1], J.shape[1]))
    C[np.ix_(used, used)] = inverse @ inverse.T / np.outer(length, length)
    free = [k for k in range(54) if not small.anchored().reshape(-1)[k]]
    flat = [k for k in free if k % 9 > 2]  # rotations are reported otherwise
    assert fit.estimate is not None
    own = fit.estimate.covariance[np.ix_([free.index(k) for k in flat], [free.index(k) for k in flat])]
    size = np.sqrt(np.diag(C))
    assert np.abs(own - C[np.ix_(flat, flat)]).max(initial=0) > 0 or len(flat)
    assert np.all(np.abs(own - C[np.ix_(flat, flat)]) <= COVARIANCE * np.outer(size[flat], size[flat]))
    for k in (0, 17, 39):
        at = slice(54 + 3 * k, 57 + 3 * k)
        bound = COVARIANCE * np.outer(size[at], size[at])
        assert np.all(np.abs(fit.local_covariance[k] - C[at, at]) <= bound)
        joint = fit.joint_covariance(k)
        assert np.all(np.abs(joint[:54, 54:] - C[:54, at]) <= COVARIANCE * np.outer(size[:54], size[at]))


@pytest.mark.parametrize(("apart", "dense"), [(1e-3, True), (1e-3, False), (1e-5, True), (1e-6, True)])
def test_unknowns_that_the_square_of_the_jacobian_cannot_tell_apart_have_the_variance_that_the_jacobian_gives(
    apart: float, dense: bool
) -> None:
    """A sum is seen well and a difference `apart` times as well: the normal equations have it squared."""
    n, lines = 12, 3
    a, z, data = ca.SX.sym("a", 3), ca.SX.sym("z"), ca.SX.sym("data", 2)
    f = ca.Function("f", [a, z, data],
                    [a[0] + a[1] + apart * (a[0] - a[1]) * data[0] + a[2] * data[0] ** 2 + z - data[1]])  # fmt: skip
    rng = np.random.default_rng(3)
    u, which = np.tile(np.linspace(-1.0, 1.0, n), lines), np.repeat(np.arange(lines), n)
    y = 3.0 + 0.4 * u**2 + 0.1 * rng.standard_normal(len(u))
    fit = bundle_fit(
        [UnknownGroup("a", np.zeros((1, 3)), ["sum", "other", "bend"]),
         UnknownGroup("line", np.zeros((lines, 1)), ["z"], fixed=np.array([[True], [False], [False]]), local=True)],
        [ResidualBlock("points", f, [("a", 0), ("line", which)], np.column_stack([u, y]), sigma=0.1)], dense=dense,
    )  # fmt: skip
    J = np.column_stack([1 + apart * u, 1 - apart * u, u**2, *(which == k for k in (1, 2))]) / 0.1
    _, sizes, Vt = np.linalg.svd(J, full_matrices=False)
    expected = np.sqrt(np.diag((Vt.T / sizes**2) @ Vt))[:3]
    assert fit.estimate is not None and fit.undetermined == 0, fit.message
    assert fit.estimate.std == pytest.approx(expected, rel=1e-3)


def test_slopes_are_those_of_the_moves(small: Scene) -> None:
    groups, blocks = small.groups(), small.blocks()
    s, rows = at_start(groups, blocks)
    h = 1e-6
    for number, k in ((0, 0), (0, 1), (0, 2), (1, 4), (2, 7), (3, 8)):
        step = np.zeros((6, 9))
        step[number, k] = h
        ahead, behind = (
            at_start(small.groups(cameras=groups[0].moved(small.cameras, sign * step)), blocks)[1][0].r
            for sign in (1, -1)
        )
        x = np.zeros((s.columns, 1))
        x[9 * number + k] = 1.0
        exact = along(s, rows, x, np.zeros((40, 3, 1)))[0][:, :, 0]
        assert np.abs((ahead - behind) / (2 * h) - exact).max() <= 1e-6 * np.abs(exact).max()


def test_memory_grows_linearly_with_the_observations() -> None:
    peaks = []
    bundle_fit(scene(8, 50).groups(), scene(8, 50).blocks(), covariance=False, limit=2)
    for points in (2000, 4000, 8000):
        one = scene(8, points)
        tracemalloc.start()
        bundle_fit(one.groups(), one.blocks(), covariance=False, limit=2)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    more, yet_more = np.diff(peaks)
    assert yet_more <= 2.2 * more  # twice as many more observations
    assert peaks[-1] / 32000 <= 4000  # bytes an observation: 1e6 in 4 GB


def test_many_cameras_and_points_arrive_at_the_expected_noise_in_few_steps() -> None:
    big = scene(49, 7776)
    fit = bundle_fit(big.groups(), big.blocks(), covariance=False)
    unknowns = 49 * 9 + 3 * 7776 - FREE
    rms = np.sqrt(2 * fit.cost / 62208)
    assert fit.status.ok and fit.iterations <= 10
    # the standard deviation of the rms of the residuals: 0.5 / sqrt(2 * 62208 - ...)
    assert abs(rms - 0.5 * np.sqrt(1 - unknowns / 62208)) <= 4 * 0.5 / np.sqrt(2 * 62208)


def test_scipy_ends_in_the_same_minimum(small: Scene) -> None:
    fixed = small.anchored()
    fit = bundle_fit(small.groups(fixed), small.blocks())
    cameras, points = small.groups(fixed)
    free = int((~fixed).sum())
    f = projection().map(len(small.camera))

    def residuals(v: np.ndarray) -> np.ndarray:
        step = np.zeros((6, 9))
        step[~fixed] = v[:free]
        c, p = cameras.moved(small.cameras, step), points.start + v[free:].reshape(-1, 3)
        return f(c[small.camera].T, p[small.point].T, small.uv.T)[0].full().T.reshape(-1)

    rival = scipy.optimize.least_squares(residuals, np.zeros(free + 120), method="lm", x_scale="jac")
    assert abs(fit.cost - rival.cost) <= 1e-6 * rival.cost


def shuffled(one: Scene, rng: np.random.Generator) -> tuple[Scene, np.ndarray, np.ndarray]:
    c, p, order = rng.permutation(len(one.cameras)), rng.permutation(len(one.points)), rng.permutation(len(one.uv))
    new = replace(one, cameras=one.cameras[c], points=one.points[p], camera=np.argsort(c)[one.camera][order],
                  point=np.argsort(p)[one.point][order], uv=one.uv[order])  # fmt: skip
    return new, c, p


def test_the_order_of_cameras_points_and_observations_changes_nothing(small: Scene) -> None:
    fixed = small.anchored()
    fit = bundle_fit(small.groups(fixed), small.blocks())
    other, c, p = shuffled(small, np.random.default_rng(4))
    again = bundle_fit(other.groups(fixed[c]), other.blocks())
    assert np.abs(again.values["camera"] - fit.values["camera"][c]).max() <= SAME * 1000
    assert np.abs(again.values["point"] - fit.values["point"][p]).max() <= SAME * 10
    assert fit.estimate is not None and again.estimate is not None
    names = {n: k for k, n in enumerate(fit.estimate.names)}
    for k, n in enumerate(again.estimate.names):
        key, label = n.removeprefix("camera ").split(".")
        own = names[f"camera {c[int(key) - 1] + 1}.{label}"]
        assert abs(again.estimate.std[k] / fit.estimate.std[own] - 1) <= 1e-8


def shifts() -> list[GaugeMotion]:
    def along_axis(axis: int):
        def direction(values):
            point = np.zeros_like(values["point"])
            point[:, axis] = 1.0
            moved = np.zeros((len(values["camera"]), 9))  # p_C = R p + t
            q = values["camera"][:, [1, 2, 3, 0]]
            moved[:, 3:6] = -Rotation.from_quat(q).apply(np.eye(3)[axis])
            return {"camera": moved, "point": point}

        return direction

    return [GaugeMotion(f"all cameras and points move together along {a}", "fix a camera", along_axis(k))
            for k, a in enumerate("xyz")]  # fmt: skip


def test_a_free_bundle_has_seven_null_directions_and_known_ones_have_names(small: Scene) -> None:
    fit = bundle_fit(small.groups(), small.blocks(), motions=shifts(), hold_undetermined=True)
    assert fit.undetermined == FREE == len(fit.notes)
    assert [n for n in fit.notes if n.startswith("all cameras")] == [
        f"all cameras and points move together along {a}: fix a camera" for a in "xyz"
    ]
    assert fit.estimate is not None and np.isinf(fit.estimate.std[3])
    assert np.isfinite(fit.estimate.std[list(fit.estimate.names).index("camera 1.k1")])
    with pytest.raises(ArgumentError, match="fix a camera"):
        bundle_fit(small.groups(), small.blocks(), motions=shifts())


def test_more_columns_than_all_eigenvectors_are_computed_of_give_the_same(small: Scene, monkeypatch) -> None:
    few = bundle_fit(small.groups(), small.blocks(sigma=0.5), motions=shifts(), hold_undetermined=True)
    monkeypatch.setattr("gtmodel.inference.bundle.elimination.SMALL", 10)
    many = bundle_fit(small.groups(), small.blocks(sigma=0.5), motions=shifts(), hold_undetermined=True)
    assert few.undetermined == many.undetermined == FREE and few.notes == many.notes
    deviations = [np.sqrt(np.diag(fit.shared_covariance)) for fit in (few, many)]
    # steps are damped by 1e-9 and S by as much, of eigenvalues from 1e-7 on
    assert deviations[1] == pytest.approx(deviations[0], rel=0.01)
    assert many.cost == pytest.approx(few.cost, rel=1e-9)


def length_block(a: int, b: int, length: float, sigma: float) -> ResidualBlock:
    p, q, d = ca.SX.sym("p", 3), ca.SX.sym("q", 3), ca.SX.sym("d")
    f = ca.Function("length", [p, q, d], [ca.norm_2(q - p) - d])
    return ResidualBlock("length", f, [("point", a), ("point", b)], [length], sigma=sigma)


def test_a_length_between_local_unknowns_fixes_the_scale(small: Scene) -> None:
    true = float(np.linalg.norm(small.true_points[3] - small.true_points[8]))
    blocks = [*small.blocks(sigma=0.5), length_block(3, 8, true, 1e-4)]
    fit = bundle_fit(small.groups(), blocks, motions=shifts(), hold_undetermined=True)
    assert fit.undetermined == FREE - 1
    assert abs(np.linalg.norm(fit.values["point"][3] - fit.values["point"][8]) - true) <= 1e-3
    assert np.isnan(fit.local_covariance[3]).all() and np.isfinite(fit.local_covariance[4]).all()
    fixed = np.zeros((6, 9), bool)
    fixed[0, :6] = True
    assert bundle_fit(small.groups(fixed), blocks).undetermined == 0


def test_a_point_that_one_camera_sees_is_named(small: Scene) -> None:
    keep = (small.point != 5) | (np.arange(len(small.point)) == 20)
    one = replace(small, camera=small.camera[keep], point=small.point[keep], uv=small.uv[keep])
    with pytest.raises(ArgumentError, match=r"point 6\.z"):
        bundle_fit(one.groups(one.anchored()), one.blocks())
    fit = bundle_fit(one.groups(one.anchored()), one.blocks(), hold_undetermined=True)
    assert fit.undetermined == 1 and fit.estimate is not None and np.all(np.isfinite(fit.estimate.std))


def test_a_sparse_system_gives_the_same_fit(small: Scene) -> None:
    groups, blocks = small.groups(small.anchored()), small.blocks()
    one, other = (bundle_fit(groups, blocks, dense=d) for d in (True, False))
    assert abs(one.cost - other.cost) <= 1e-10 * one.cost
    assert np.abs(one.values["camera"] - other.values["camera"]).max() <= 1e-6
    assert one.estimate is not None and other.estimate is not None
    assert np.allclose(one.estimate.std, other.estimate.std, rtol=1e-4)
    free = bundle_fit(small.groups(), blocks, dense=False, hold_undetermined=True)
    assert free.undetermined == FREE


def test_a_robust_loss_bears_gross_errors(small: Scene) -> None:
    uv = small.uv.copy()
    wrong = np.random.default_rng(2).choice(len(uv), 8, replace=False)
    uv[wrong] += 60.0
    bad = replace(small, uv=uv)
    truth = bundle_fit(small.groups(small.anchored()), small.blocks(sigma=0.5)).values["camera"]
    plain = bundle_fit(bad.groups(bad.anchored()), bad.blocks(sigma=0.5)).values["camera"]
    fit = bundle_fit(bad.groups(bad.anchored()), bad.blocks(sigma=0.5, loss="huber"))
    assert np.abs(fit.values["camera"] - truth)[:, 7].max() < 0.2 * np.abs(plain - truth)[:, 7].max()
    length = np.linalg.norm(fit.residuals["pixels"], axis=1)
    assert set(np.argsort(length)[-8:]) == set(wrong)


def test_without_a_compiler_the_fit_is_the_same(monkeypatch) -> None:
    one = scene(6, 400)  # rows enough for a kernel, and for a compiler where there is one
    first = bundle_fit(one.groups(one.anchored()), one.blocks())
    monkeypatch.setenv("CC", "no-such-compiler")
    again = bundle_fit(one.groups(one.anchored()), one.blocks())
    assert np.array_equal(first.values["camera"], again.values["camera"]) and first.cost == again.cost


def test_perfect_data_are_fitted_to_rounding() -> None:
    one = scene(noise=0.0)
    fit = bundle_fit(one.groups(one.anchored()), one.blocks(sigma=1.0))
    assert fit.status.ok and fit.cost < 1e-18


def test_statuses(small: Scene) -> None:
    groups = small.groups(small.anchored())
    assert bundle_fit(groups, small.blocks(), limit=1).status is SolveStatus.ITERATION_LIMIT
    assert bundle_fit(groups, small.blocks(), stop=lambda: True).status is SolveStatus.INTERRUPTED
    behind = small.points.copy()
    behind[4, 2] = 40.0
    fit = bundle_fit(small.groups(points=behind), small.blocks())
    assert fit.status is SolveStatus.NOT_FINITE and "4 of 'pixels'" in fit.message and fit.estimate is None


def test_rotation_vectors_and_how_they_move() -> None:
    turns = Rotation.from_rotvec(np.array([[0.3, -1.2, 2.0], [1e-7, 0, 0], [0, 0, 0], [0.0, 3.0, 0.0]]))
    vectors = logarithm(turns.as_quat()[:, [3, 0, 1, 2]])
    slopes = inverse_right_jacobian(vectors)
    assert np.allclose(vectors, turns.as_rotvec(), atol=1e-12)
    h = 1e-6
    for k in range(3):
        d = np.eye(3)[k] * h
        ahead, behind = ((turns * Rotation.from_rotvec(s * d)).as_rotvec() for s in (1, -1))
        assert np.allclose((ahead - behind) / (2 * h), slopes[:, :, k], atol=1e-8)


@pytest.mark.parametrize("wrong", ["name", "number", "two local", "labels", "length", "noise", "twice", "inputs"])
def test_refusals(small: Scene, wrong: str) -> None:
    cameras, points = small.groups()
    blocks = small.blocks(sigma=1.0)
    with pytest.raises(ArgumentError):
        if wrong == "name":
            bundle_fit([cameras], blocks)
        elif wrong == "number":
            bundle_fit([cameras, replace(points, start=points.start[:5])], blocks)
        elif wrong == "two local":
            bundle_fit([replace(cameras, local=True), points], blocks)
        elif wrong == "labels":
            UnknownGroup("camera", small.cameras, LABELS[:4])
        elif wrong == "length":
            UnknownGroup("camera", 2 * small.cameras, LABELS, turn=0)
        elif wrong == "noise":
            bundle_fit([cameras, points], [*blocks, replace(length_block(0, 1, 1.0, 1.0), sigma=None)])
        elif wrong == "twice":
            bundle_fit([cameras, points], [*blocks, length_block(1, 1, 1.0, 1.0)])
        else:
            ResidualBlock("pixels", projection(), [("camera", small.camera)], small.uv)
