"""The parts of the search for assembly modes, each against something independent."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gtmodel.geometry.rotations import angle_between
from gtmodel.kinematics.assembly_modes import start_systems
from gtmodel.kinematics.assembly_modes.platform import (
    HomotopyParameters,
    basis,
    gradients,
    leg_rows,
    rotation_and_position,
    straight_line,
)
from gtmodel.kinematics.assembly_modes.sorting import BASIS_MATRICES, isolate, on_a_curve, residuals
from gtmodel.kinematics.assembly_modes.start_system import FILE, SEEDS, from_text, make, to_text
from gtmodel.kinematics.assembly_modes.tracker import (
    ORDER,
    _Line,
    distance_to_conjugate,
    distances,
    newton_step,
    refined,
    solve_rows,
    track,
)
from gtmodel.results import ModesStatus
from tests.kinematics.support.platforms import griffis_duffy_platforms

SEED = 5


def study_point(R: Rotation, T: np.ndarray) -> np.ndarray:
    """The point z (8,) of a pose: x its quaternion, y = T x / 2."""
    x = np.roll(R.as_quat(), 1)
    return np.concatenate([x, [-T @ x[1:] / 2], (x[0] * T + np.cross(T, x[1:])) / 2])


def test_a_pose_goes_to_study_coordinates_and_back_at_any_scale() -> None:
    random = np.random.default_rng(SEED)
    R, T = Rotation.random(rng=random), random.normal(size=3)
    for scale in (1.0, -3.0, 2.0 - 1.0j):
        R_back, T_back = rotation_and_position(scale * study_point(R, T))
        np.testing.assert_allclose(R_back, R.as_matrix(), atol=1e-14)
        np.testing.assert_allclose(T_back, T, atol=1e-14)


def test_leg_equations_are_the_squared_length_less_its_square() -> None:
    random = np.random.default_rng(SEED)
    R, T = Rotation.random(rng=random), random.normal(size=3)
    A, B, L = random.normal(size=(6, 3)), random.normal(size=(6, 3)), random.uniform(1, 2, 6)
    z = 1.7 * study_point(R, T)
    rows = leg_rows(A, B, np.sum(A * A, 1) + np.sum(B * B, 1) - L * L)
    d = T + B @ R.as_matrix().T - A
    np.testing.assert_allclose(rows @ basis(z), 1.7**2 * (np.sum(d * d, axis=1) - L * L), atol=1e-12)


def test_gradients_are_the_derivatives_of_the_basis() -> None:
    random = np.random.default_rng(SEED)
    z = random.normal(size=8) + 1j * random.normal(size=8)
    central = np.array([(basis(z + 1e-6 * e) - basis(z - 1e-6 * e)) / 2e-6 for e in np.eye(8)]).T
    np.testing.assert_allclose(gradients(z), central, atol=1e-9)
    np.testing.assert_allclose(BASIS_MATRICES @ z, gradients(z), atol=1e-14)
    np.testing.assert_array_equal(BASIS_MATRICES, np.swapaxes(BASIS_MATRICES, 1, 2))


def test_the_line_between_two_platforms() -> None:
    random = np.random.default_rng(SEED)
    draws = [
        HomotopyParameters(*(random.normal(size=s) + 1j for s in ((1, 6, 3), (1, 6, 3), (1, 6)))) for _ in range(2)
    ]
    C = straight_line(*draws)[0]
    for t in (0.0, 0.3, 1.0):
        between = HomotopyParameters(
            *((1 - t) * a + t * b for a, b in zip(vars(draws[0]).values(), vars(draws[1]).values(), strict=True))
        )
        np.testing.assert_allclose(C[0] + t * (C[1] + t * C[2]), between.system()[0], atol=1e-13)


def test_stored_start_systems_are_whole() -> None:
    assert [s.seed for s in start_systems()] == list(SEEDS)
    for s in start_systems():
        C = np.repeat(s.parameters.system()[None], 40, axis=0)
        assert s.z.shape == (40, 8)
        assert np.max(residuals(C, s.z)) < 1e-14
        assert np.min(distances(s.z)) > 1e-2
        assert np.all(isolate(C, s.z).certified)
        assert np.min(distance_to_conjugate(s.z)) > 1e-2  # the system is not real


def test_stored_start_systems_are_what_monodromy_makes() -> None:
    """The same platforms to the last digit, and the same 40 solutions, in whatever order."""
    fresh, stored = make(SEEDS[:1])[0], start_systems()[0]
    np.testing.assert_array_equal(fresh.parameters.A, stored.parameters.A)
    np.testing.assert_allclose(fresh.parameters.c, stored.parameters.c, rtol=1e-14)
    gaps = distances(np.concatenate([stored.z, fresh.z]))[:40, 40:]
    assert np.max(gaps.min(axis=1)) < 1e-10 and len(set(gaps.argmin(axis=1).tolist())) == 40


def test_the_file_reads_back_exactly_and_is_json() -> None:
    text = FILE.read_text(encoding="utf-8")
    assert to_text(from_text(text)) == text
    assert "start_system" in json.loads(text)["note"]


def test_tracking_there_and_back_returns_every_solution() -> None:
    a, b = start_systems()[:2]
    to_b = straight_line(
        a.parameters, HomotopyParameters(b.parameters.A[None], b.parameters.B[None], b.parameters.c[None])
    )
    pose = np.zeros(40, dtype=np.intp)
    there = track(to_b, pose, a.z)
    assert np.all(there.arrived) and np.all(there.steps > 5)
    gaps = distances(np.concatenate([there.z, b.z]))[:40, 40:]
    assert np.max(gaps.min(axis=1)) < 1e-8 and len(set(gaps.argmin(axis=1).tolist())) == 40
    to_a = straight_line(
        b.parameters, HomotopyParameters(a.parameters.A[None], a.parameters.B[None], a.parameters.c[None])
    )
    back = track(to_a, pose, there.z)
    assert np.max(np.diagonal(distances(np.concatenate([back.z, a.z]))[:40, 40:])) < 1e-8


def test_paths_do_not_depend_on_their_company() -> None:
    a, b = start_systems()[:2]
    line = straight_line(
        a.parameters, HomotopyParameters(b.parameters.A[None], b.parameters.B[None], b.parameters.c[None])
    )
    together = track(line, np.zeros(40, dtype=np.intp), a.z)
    alone = track(line, np.zeros(1, dtype=np.intp), a.z[11:12])
    np.testing.assert_allclose(alone.z[0], together.z[11], atol=1e-12)
    assert alone.steps[0] == together.steps[11]


def test_the_series_of_a_path_solves_the_equations_to_its_order() -> None:
    """F of the truncated series falls by 2^(ORDER + 1) when the step is halved."""
    a, b = start_systems()[:2]
    line = straight_line(
        a.parameters, HomotopyParameters(b.parameters.A[None], b.parameters.B[None], b.parameters.c[None])
    )
    paths, t = np.zeros(40, dtype=np.intp), 0.01
    z = refined(line[0, 0] + t * line[0, 1] + t**2 * line[0, 2], a.z, 12)
    series, first, _ = _Line(line, 40).corrected(z, np.full(40, t), paths)
    assert np.max(first) < 1e-20
    np.testing.assert_allclose(series[:, ORDER], z, atol=1e-10)

    def left(step: float) -> np.ndarray:
        w = np.einsum("k,mki->mi", step ** np.arange(ORDER, -1.0, -1.0), series[:, : ORDER + 1])
        C = line[0, 0] + (t + step) * line[0, 1] + (t + step) ** 2 * line[0, 2]
        return residuals(C, w)

    step = 0.02
    orders = np.log2(left(step) / left(step / 2))[left(step / 2) > 1e-12]  # above rounding errors
    assert len(orders) > 10 and np.abs(np.median(orders) - (ORDER + 1)) < 0.3


def test_one_singular_matrix_does_not_spoil_the_batch() -> None:
    random = np.random.default_rng(SEED)
    J, patch, right = random.normal(size=(3, 7, 8)), random.normal(size=(3, 8)), random.normal(size=(3, 7, 1))
    J[1] = 0
    dz = solve_rows(J, patch, right)[..., 0]
    assert np.all(np.isnan(dz[1])) and np.all(np.isfinite(dz[[0, 2]]))
    np.testing.assert_allclose(J[2] @ dz[2], right[2, :, 0], atol=1e-12)
    np.testing.assert_allclose(patch[2] @ dz[2], 0, atol=1e-12)


def test_kantorovich_refuses_points_that_are_no_solutions() -> None:
    s = start_systems()[0]
    C = np.repeat(s.parameters.system()[None], 40, axis=0)
    random = np.random.default_rng(SEED)
    z = s.z + 0.1 * random.normal(size=s.z.shape)
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    assert not np.any(isolate(C, z).certified)


def test_newton_stays_within_the_radius_of_uniqueness() -> None:
    """From anywhere within half of the certified radius, Newton returns to the same solution."""
    s = start_systems()[0]
    C = np.repeat(s.parameters.system()[None], 40, axis=0)
    rho = isolate(C, s.z).rho
    random = np.random.default_rng(SEED)
    push = random.normal(size=(40, 8)) + 1j * random.normal(size=(40, 8))
    push *= 0.4 * rho[:, None] / np.linalg.norm(push, axis=1, keepdims=True)
    z = s.z + push
    for _ in range(8):
        z = z + newton_step(C, z, np.conj(s.z))
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    assert np.max(np.diagonal(distances(np.concatenate([z, s.z]))[:40, 40:])) < 1e-10


def test_a_regular_solution_is_on_no_curve() -> None:
    s = start_systems()[0]
    assert not any(on_a_curve(s.parameters.system(), z) for z in s.z[:3])


def test_the_pose_of_a_self_motion_is_on_a_curve() -> None:
    p = griffis_duffy_platforms(1, SEED)
    z = study_point(Rotation.from_matrix(p.R[0]), p.T[0])
    c = np.sum(p.A**2, axis=2) + np.sum(p.B**2, axis=2) - p.L**2
    assert on_a_curve(HomotopyParameters(p.A, p.B, c).system()[0], z / np.linalg.norm(z))


def test_rotation_angles_are_accurate_near_zero_and_at_half_a_turn() -> None:
    for angle in (0.0, 1e-9, 1.0, np.pi):
        R = Rotation.from_rotvec([0.0, angle, 0.0]).as_matrix()
        assert angle_between(R, np.eye(3)) == pytest.approx(angle, rel=1e-6, abs=1e-15)


def test_words_of_the_status_are_fixed() -> None:
    words = ["complete", "fewer_finite", "multiple", "self_motion", "incomplete", "interrupted", "bad_input"]
    assert [s.value for s in ModesStatus] == words
    assert [s for s in ModesStatus if s.ok] == [ModesStatus.COMPLETE, ModesStatus.FEWER_FINITE]
    assert all(s.message for s in ModesStatus)
