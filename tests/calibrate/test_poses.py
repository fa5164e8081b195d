"""Which poses to measure: what they determine before they are taken, and whether calibrations then behave so."""

import itertools

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.calibrate import (
    Choice,
    Measurements,
    condition_removal,
    error_curve,
    exchange,
    grid_point,
    pose_information,
    positioning,
    prepare,
    seen_by_distance,
    seen_by_plane,
    spread,
    sufficient_number,
)
from gtmodel.inference import Prior, monte_carlo
from tests.calibrate.pose_runs import NOISE, box, grid_information, l1, one, problem, thirty, workspace
from tests.calibrate.synthetic import poses, true_robot

SEED = 20261121  # chosen before the first run
WITHIN = 0.10  # the issue's
ROUNDING = 1e-9


def by_hand(T: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slopes of the lengths of the L1 in A, v, L and in T, written out."""
    A, v, L = (np.array(getattr(l1(), n), float) for n in "AvL")
    J, B = np.zeros((len(T), 3, 21)), np.zeros((len(T), 3, 3))
    for i in range(3):
        d = T - A[i]
        along, square = d @ v[i], np.sum(d * d, axis=1) - L[i] ** 2
        root = np.sqrt(along**2 - v[i] @ v[i] * square)
        q = l1().causal(known="T", targets="q")(T)[0][:, i]
        assert np.allclose(np.abs(q - along), root)
        u = (d - q[:, None] * v[i]) / L[i]
        J[:, i, 3 * i : 3 * i + 3], J[:, i, 9 + 3 * i : 12 + 3 * i], J[:, i, 18 + i] = -u, -q[:, None] * u, -1.0
        B[:, i] = u
    return J, B


def test_information_and_positioning_are_those_written_out():
    T = box((3, 3, 2))
    J, B = by_hand(T)
    info = pose_information(problem(T, {"T": 2e-5}))
    expected = sum(j.T @ np.linalg.solve(b @ b.T, j) for j, b in zip(J, B, strict=True)) / 4e-10
    information = sum(r.T @ r for r in info.rows) / np.outer(info.sizes, info.sizes)
    np.testing.assert_allclose(information, expected, rtol=1e-7, atol=1e-7 * np.abs(expected).max())
    np.testing.assert_allclose(positioning(problem(T, {})).jacobian, -np.linalg.solve(B, J), atol=ROUNDING)
    C = info.covariance()
    np.testing.assert_allclose(C @ expected, np.eye(21), atol=1e-5)
    e = positioning(problem(T, {})).errors(info)
    p = -np.linalg.solve(B, J)
    np.testing.assert_allclose(e.covariance, p @ np.linalg.inv(expected) @ p.transpose(0, 2, 1), rtol=1e-5, atol=1e-14)


def test_thirty_selected_poses_are_as_good_as_forty_of_a_grid_and_sixty_within_a_tenth_of_a_hundred():
    """Issue 7, point 5; the notes have 1.50 (1.36 in the maximum) and 1.05 (0.91) times the error of 100 grid poses."""
    info, target = grid_information((7, 7, 7)), workspace()
    forty = min(grid_point(grid_information(s), target).rms for s in ((5, 4, 2), (5, 2, 4), (10, 2, 2)))
    hundred = grid_point(grid_information((5, 5, 4)), target)
    curve = error_curve(info, target, [60, 30])
    few, many = curve.points
    assert [p.poses for p in curve.points] == [30, 60] and curve.complete
    assert few.rms <= forty
    assert many.rms <= (1 + WITHIN) * hundred.rms
    assert few.rms / hundred.rms == pytest.approx(1.50, abs=0.03)
    assert few.greatest / hundred.greatest == pytest.approx(1.36, abs=0.05)
    assert many.rms / hundred.rms == pytest.approx(1.05, abs=0.05)
    # nobody beats the number of poses by choice alone
    assert few.rms > hundred.rms


@pytest.mark.parametrize("criterion", ["D", "E", "I"])
def test_exchange_ends_where_no_swap_helps(criterion):
    info = grid_information((5, 3, 3))
    moment = workspace().moment(info)

    def score(chosen):
        own = info.matrix(chosen)
        if criterion == "D":
            return np.linalg.det(own / 1e6) ** (-1 / 21)
        return 1 / np.linalg.eigvalsh(own)[0] if criterion == "E" else np.trace(np.linalg.inv(own) @ moment)

    s = exchange(info, 12, criterion, moment, repeats=1)
    assert len(set(s.indices)) == 12 and len(s.starts) == 3 and s.score == min(s.starts)
    best = score(s.indices)
    swapped = [
        score([*s.indices[:k], j, *s.indices[k + 1 :]])
        for k, j in itertools.product(range(12), sorted(set(range(45)) - set(s.indices)))
    ]
    # E looks at a short list
    assert min(swapped) > (1 - (2e-2 if criterion == "E" else 1.01e-4)) * best
    assert best < score(spread(info, 12).indices)
    again = exchange(info, 12, criterion, moment, repeats=1)
    np.testing.assert_array_equal(again.indices, s.indices)


def test_condition_removal_keeps_the_poses_without_which_the_condition_is_worst():
    info = grid_information((4, 3, 3))
    J = info.rows
    C = [np.linalg.cond(np.delete(J, k, axis=0).reshape(-1, 21)) for k in range(len(J))]
    s = condition_removal(info, 15)
    assert set(s.indices) == set(np.argsort(C)[-15:])
    assert s.score == pytest.approx(np.linalg.cond(J[s.indices].reshape(-1, 21)), rel=1e-5)
    slower = condition_removal(info, 15, one_by_one=True)
    assert len(slower) == 15 and slower.score < s.score
    assert set(condition_removal(info, 35, one_by_one=True).indices) == set(range(36)) - {int(np.argmin(C))}


def test_a_stop_keeps_what_is_there():
    info = grid_information((5, 3, 3))
    moment = workspace().moment(info)
    s = exchange(info, 12, "I", moment, stop=lambda fraction: True)
    assert not s.complete and len(s) == 12
    r = condition_removal(info, 12, one_by_one=True, stop=lambda fraction: True)
    assert not r.complete and len(r) == 44
    curve = error_curve(info, workspace(), [10, 20, 30], stop=lambda fraction: fraction > 0.5)
    assert not curve.complete and [p.poses for p in curve.points] == [10, 20]


def test_how_many_poses_suffice():
    info, target = grid_information((5, 3, 3)), workspace()
    number = sufficient_number(info, target, 60e-6, starts=1)
    assert number is not None
    rms = [p.rms for p in error_curve(info, target, [number - 1, number], starts=1).points]
    assert rms[1] <= 60e-6 < rms[0]
    assert sufficient_number(info, target, 1e-6, starts=1) is None


def test_predicted_covariance_matches_monte_carlo():
    """The smaller draw: 80 runs, parameters and positions as a whole."""
    own, predicted = _compared(80, whole_only=True)
    assert own == pytest.approx(predicted, rel=WITHIN)


@pytest.mark.proof
def test_predicted_covariance_of_each_parameter_and_place_matches_monte_carlo():
    own, predicted = _compared(2000, whole_only=False)
    np.testing.assert_allclose(own, predicted, rtol=WITHIN)


def _compared(runs: int, whole_only: bool) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviations in Monte Carlo and predicted: [all parameters, all positions], or one by one."""
    errors = np.array(monte_carlo(one, runs, SEED, processes=0 if whole_only else None).results)
    info, target = pose_information(thirty()), workspace()
    C = info.covariance()
    moved = np.einsum("mij,kj->kmi", target.jacobian, errors)
    if whole_only:
        size = np.sqrt(np.mean(np.sum(errors * np.linalg.solve(C, errors.T).T, axis=1) / 21))
        return np.array([size, np.sqrt(np.mean(np.sum(moved**2, axis=2)))]), np.array([1.0, target.errors(info).rms])
    each = np.sqrt(np.mean(np.sum(moved**2, axis=2), axis=0))
    own = np.concatenate([np.sqrt(np.mean(errors**2, axis=0)), each])
    return own, np.concatenate([np.sqrt(np.diag(C)), target.errors(info).each])


def test_one_distance_leaves_three_turns_open_and_one_coordinate_two_directions():
    T = box((5, 4, 3))
    q = l1().causal(known="T", targets="q")(T)[0]
    at = np.array([3.0, -3.0, 1.0])
    wire = Measurements({"q": q, "distance": np.linalg.norm(T - at, axis=1)}, {"q": 1e-5, "distance": 1e-5})
    free = Choice(fixed=("device_at",))
    info = pose_information(prepare(seen_by_distance(l1(), at), wire, free, latent=("T",)))
    assert info.rows.shape[1] == 1 and info.rank == 18  # a turn about the device changes no distance
    with pytest.raises(gt.ModelError, match="depends on combinations that no pose determines"):
        workspace().errors(info)
    assert all(np.isinf(s) for n, s in info.std().items() if n.startswith("A["))
    gauge = Measurements({"q": q, "height": T[:, 0]}, {"q": 1e-5, "height": 1e-5})
    fixed = Choice(fixed=("plane_normal", "plane_point"))
    plane = prepare(seen_by_plane(l1(), [2.0, 0, 0]), gauge, fixed, latent=("T",))
    assert pose_information(plane).rank == 18


def test_priors_count_as_what_is_known():
    T = box((2, 2, 2))
    p = prepare(l1(), problem(T, NOISE).measurements, Choice(priors=[Prior(f"L[{i}]", 1.8, 1e-5) for i in range(3)]))
    info = pose_information(p)
    assert len(info.priors) == 3 and info.std()["L[0]"] < 1e-5 < pose_information(problem(T, NOISE)).std()["L[0]"]


def test_wrong_calls_get_a_sentence():
    info = grid_information((4, 3, 3))
    with pytest.raises(gt.ModelError, match=r"5 poses with 3 equations each cannot determine 21 .* at least 7"):
        exchange(info, 5, "D")
    with pytest.raises(gt.ModelError, match="40 poses from 36 candidates"):
        condition_removal(info, 40)
    with pytest.raises(gt.ModelError, match="no criterion 'A'; choose one of: D, E, I"):
        exchange(info, 10, "A")
    with pytest.raises(gt.ModelError, match="needs the moment"):
        exchange(info, 10, "I")
    with pytest.raises(gt.ModelError, match="must be positive"):
        sufficient_number(info, workspace(), 0.0)
    with pytest.raises(gt.ModelError, match="3 poses determine fewer than the 21"):
        info.covariance([0, 1, 2])
    with pytest.raises(gt.ModelError, match="normal of the plane is zero"):
        seen_by_plane(l1(), [0, 0, 0])
    fixed = prepare(l1(), problem(box((4, 3, 3)), NOISE).measurements, Choice(fixed=("L",)))
    with pytest.raises(gt.ModelError, match=r"depends on 'L\[0\]'"):
        workspace().errors(pose_information(fixed))


def test_the_f1_is_planned_within_what_its_poses_determine():
    """69 unknowns with unit quaternions, of which six combinations are determined by no pose (Table 5.4)."""
    choice = Choice(unit=("u1_2", "u1_3", "u2_3"))
    robot = true_robot("f1_unit")
    info = pose_information(prepare(robot, Measurements(poses("f1_unit", 185), {"T": 5e-5, "e": 1e-4}), choice))
    assert (len(info.names), info.rank, info.rows.shape[1]) == (69, 63, 6)
    assert any(np.isinf(s) for s in info.std().values())
    # what is undetermined does not move the tool: its errors are predicted all the same
    target = positioning(prepare(robot, Measurements(poses("f1_unit", 60, seed=5)), choice))
    chosen = exchange(info, 60, "I", target.moment(info), starts=1)
    evenly, best = (target.errors(info, s.indices).rms for s in (spread(info, 60), chosen))
    assert target.errors(info).rms < best < 0.8 * evenly
    with pytest.raises(gt.ModelError, match="at least 11"):
        condition_removal(info, 10)
