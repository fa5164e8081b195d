"""All assembly modes: Dietmaier's platform, the F1, random platforms; invariance and independent roads."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gtmodel.kinematics.assembly_modes import AssemblyModes, assembly_modes, assembly_modes_batch, start_systems
from gtmodel.kinematics.assembly_modes.platform import read_legs, scale
from gtmodel.kinematics.assembly_modes.sorting import first_of_each, residuals
from gtmodel.kinematics.assembly_modes.start_system import StartSystem, random_start_system
from gtmodel.kinematics.assembly_modes.tracker import refined
from gtmodel.results import ModesStatus
from tests.kinematics.support.compare import leg_lengths, newton_forward, pair_up
from tests.kinematics.support.f1 import Poses, random_f1_poses
from tests.kinematics.support.platforms import (
    DIETMAIER_A,
    DIETMAIER_B,
    DIETMAIER_L,
    Platforms,
    exact_tau_platforms,
    planar_platforms,
    random_platforms,
)

MODES = 40
RESIDUAL = 1e-12  # of the scaled equations and leg lengths; measured 1e-15
POSE = 1e-9  # a pose comes back to that, in metres and entries of R; its condition number stands between
SEED = 20121


@cache
def dietmaier() -> AssemblyModes:
    return assembly_modes(DIETMAIER_A, DIETMAIER_B, DIETMAIER_L)


def faults(modes: AssemblyModes) -> list[str]:
    """What is wrong where 40 different modes, certified, in real ones and conjugate pairs, must each close the legs."""
    c = modes.certificate
    held = {
        modes.message: modes.status is ModesStatus.COMPLETE,
        "number of modes": c.finite == c.distinct == c.paths == MODES,
        "number of real modes": c.real == len(modes.R) == len(modes.T) == len(modes.quaternion),
        "conjugate pairs": c.real % 2 == 0 and c.real + 2 * c.conjugate_pairs == MODES,
        "number of complex modes": len(modes.R_complex) == len(modes.T_complex) == MODES,
        "residual": c.worst_residual <= RESIDUAL and c.worst_closure <= RESIDUAL,
        "separation": c.least_separation > 1e-6,
    }
    return [what for what, right in held.items() if not right]


def recovers(modes: AssemblyModes, R: np.ndarray, T: np.ndarray) -> bool:
    k, distance, angle_deg = modes.nearest(R, T)
    return k >= 0 and distance < POSE * modes.size and np.radians(angle_deg) < POSE


def test_all_of_dietmaiers_forty_are_real() -> None:
    modes = dietmaier()
    assert faults(modes) == []
    assert modes.certificate.real == MODES
    assert modes.certificate.certified == MODES
    for R, T in zip(modes.R, modes.T, strict=True):
        np.testing.assert_allclose(leg_lengths(DIETMAIER_A, DIETMAIER_B, R, T), DIETMAIER_L, rtol=0, atol=1e-13)
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)
        assert np.linalg.det(R) > 0


def test_dietmaiers_numbers_are_lengths_and_not_their_squares() -> None:
    misread = assembly_modes(DIETMAIER_A, DIETMAIER_B, np.sqrt(DIETMAIER_L))
    assert misread.certificate.real < MODES


def f1_faults(poses: Poses) -> list[tuple[int, str]]:
    """Number of the pose and what is wrong with its modes: not complete, the pose not among them, too many are real."""
    found = []
    for n, modes in enumerate(assembly_modes_batch(poses.A, poses.B, poses.L)):
        found += [(n, what) for what in faults(modes)]
        if not recovers(modes, poses.R[n], poses.T[n]):
            found.append((n, "pose not found"))
        if not 2 <= modes.certificate.real <= 8:
            found.append((n, "number of real modes"))
    return found


def random_faults(platforms: Platforms) -> tuple[int, list[tuple[int, str]]]:
    """How many platforms are not complete, and say so; number and fault of those that say what is wrong."""
    lost, found = 0, []
    for n, modes in enumerate(assembly_modes_batch(platforms.A, platforms.B, platforms.L)):
        if modes.ok:
            found += [(n, what) for what in faults(modes)]
            if not recovers(modes, platforms.R[n], platforms.T[n]):
                found.append((n, "pose not found"))
        elif modes.status in (ModesStatus.INCOMPLETE, ModesStatus.MULTIPLE):
            lost += 1
        else:
            found.append((n, modes.message))
    return lost, found


def test_twelve_poses_of_the_f1_are_complete_and_come_back() -> None:
    assert f1_faults(random_f1_poses(12, SEED)) == []


@pytest.mark.slow
def test_random_platforms_are_complete() -> None:
    assert random_faults(random_platforms(25, SEED + 1)) == (0, [])


@pytest.mark.proof
def test_two_thousand_random_platforms_are_complete() -> None:
    lost, found = random_faults(random_platforms(2000, SEED))
    assert lost <= 2 and found == []


@pytest.mark.proof
def test_two_hundred_more_poses_of_the_f1_are_complete() -> None:
    assert f1_faults(random_f1_poses(200, SEED + 2)) == []


@pytest.mark.parametrize("make", [planar_platforms, exact_tau_platforms])
def test_special_platforms_are_complete(make) -> None:
    """Planar joints, and exact Tau clusters, which have two modes that are nearly infinite."""
    assert random_faults(make(6, SEED)) == (0, [])


# Equivalent platforms have equivalent modes.


@pytest.fixture(scope="module")
def one() -> tuple[Platforms, AssemblyModes]:
    """A random platform with at least four real modes."""
    platforms = random_platforms(12, SEED)
    results = assembly_modes_batch(*platforms.legs)
    k = next(k for k, modes in enumerate(results) if modes.certificate.real >= 4)
    return Platforms(*(a[k] for a in (*platforms.legs, platforms.R, platforms.T))), results[k]


def test_rigid_motions_of_base_and_platform(one: tuple[Platforms, AssemblyModes]) -> None:
    platform, modes = one
    turns = Rotation.random(2, rng=np.random.default_rng(SEED)).as_matrix()
    shifts = np.array([[3.0, -1.0, 2.0], [-0.3, 0.2, 0.5]])
    moved = assembly_modes(
        platform.A @ turns[0].T + shifts[0], platform.B @ turns[1].T + shifts[1], platform.L
    )  # T' + R' (Q B + s) = Q0 (T + R B) + s0
    R = turns[0] @ modes.R @ turns[1].T
    T = modes.T @ turns[0].T + shifts[0] - R @ shifts[1]
    assert pair_up(R, T, moved.R, moved.T) < 1e-11
    assert moved.certificate.nearest_distance == pytest.approx(modes.certificate.nearest_distance, rel=1e-9)


@pytest.mark.parametrize("unit", [1000.0, 1e-6, 1e9])
def test_a_change_of_unit(one: tuple[Platforms, AssemblyModes], unit: float) -> None:
    platform, modes = one
    other = assembly_modes(platform.A * unit, platform.B * unit, platform.L * unit)
    assert pair_up(modes.R, modes.T, other.R, other.T / unit) < 1e-11
    np.testing.assert_allclose(other.nearest_distance / unit, modes.nearest_distance, rtol=1e-9)
    assert other.size == pytest.approx(unit * modes.size)


def test_a_permutation_of_the_legs(one: tuple[Platforms, AssemblyModes]) -> None:
    platform, modes = one
    order = [3, 0, 5, 1, 4, 2]
    other = assembly_modes(platform.A[order], platform.B[order], platform.L[order])
    assert pair_up(modes.R, modes.T, other.R, other.T) < 1e-11
    np.testing.assert_allclose(other.T, modes.T, atol=1e-9)  # and in the same order


def test_exchanging_base_and_platform_inverts_the_modes(one: tuple[Platforms, AssemblyModes]) -> None:
    platform, modes = one
    other = assembly_modes(platform.B, platform.A, platform.L)
    R = np.swapaxes(modes.R, 1, 2)
    T = -(R @ modes.T[:, :, None])[..., 0]
    assert pair_up(R, T, other.R, other.T) < 1e-11


def test_batch_equals_one_by_one() -> None:
    platforms = random_platforms(3, SEED)
    for modes, A, B, L in zip(assembly_modes_batch(*platforms.legs), *platforms.legs, strict=True):
        alone = assembly_modes(A, B, L)
        np.testing.assert_allclose(alone.T, modes.T, atol=1e-12)
        assert alone.certificate.real == modes.certificate.real


def test_the_same_input_gives_the_same_output() -> None:
    again = assembly_modes(DIETMAIER_A, DIETMAIER_B, DIETMAIER_L)
    np.testing.assert_array_equal(again.T, dietmaier().T)
    assert again.certificate == dietmaier().certificate


# The modes come from the tracker.


def test_newton_from_the_stored_solutions_does_not_do() -> None:
    """The start solutions are far from Dietmaier's, and Newton alone finds but some of them."""
    C = scale(read_legs(DIETMAIER_A, DIETMAIER_B, DIETMAIER_L)).parameters().system().astype(complex)
    C, z = np.repeat(C, MODES, axis=0), start_systems()[0].z
    assert np.min(residuals(C, z)) > 1e-3
    with np.errstate(all="ignore"):
        w = refined(C, z, 30)
        solutions = (residuals(C, w) < RESIDUAL) & (np.abs(np.sum(w[:, :4] ** 2, axis=1)) > 1e-6)
    w = w[solutions]  # the others end on x = 0, which is no pose
    assert len(first_of_each(w, np.zeros(len(w)))) < MODES / 2


def test_a_fresh_start_system_finds_the_same_modes() -> None:
    fresh = StartSystem(77, *random_start_system(77))
    modes = assembly_modes(DIETMAIER_A, DIETMAIER_B, DIETMAIER_L, systems=(fresh,))
    assert pair_up(modes.R, modes.T, dietmaier().R, dietmaier().T) < 1e-9


def crippled() -> StartSystem:
    """A start system that has one solution twice and lacks another."""
    good = start_systems()[0]
    z = good.z.copy()
    z[7] = z[3]
    return StartSystem(good.seed, good.parameters, z)


def test_a_duplicated_path_is_repeated_from_the_next_start_system_and_counted() -> None:
    modes = assembly_modes(DIETMAIER_A, DIETMAIER_B, DIETMAIER_L, systems=(crippled(), start_systems()[1]))
    assert faults(modes) == []
    assert modes.certificate.start_systems == 2
    assert modes.certificate.retries == MODES
    assert dietmaier().certificate.retries == 0


def test_a_lost_mode_shows_in_the_status() -> None:
    modes = assembly_modes(DIETMAIER_A, DIETMAIER_B, DIETMAIER_L, systems=(crippled(),))
    assert modes.status is ModesStatus.INCOMPLETE and not modes.ok
    assert modes.certificate.finite == MODES - 1 and modes.certificate.lost == 1
    assert "1 were lost" in modes.message


# Independent roads.


@pytest.mark.parametrize("source", ["dietmaier", "f1"])
def test_newton_in_position_and_quaternion_returns_each_mode_itself(source: str) -> None:
    if source == "dietmaier":
        A, B, L, modes = DIETMAIER_A, DIETMAIER_B, DIETMAIER_L, dietmaier()
    else:
        poses = random_f1_poses(1, SEED)
        A, B, L = poses.A[0], poses.B, poses.L
        modes = assembly_modes(A, B, L)
    for R, T in zip(modes.R, modes.T, strict=True):
        nearby = Rotation.from_rotvec([1e-4, -5e-5, 8e-5]).as_matrix() @ R
        R_back, T_back = newton_forward(A, B, L, nearby, T + np.array([1e-4, 5e-5, -1e-4]))
        np.testing.assert_allclose(R_back, R, atol=1e-9)
        np.testing.assert_allclose(T_back, T, atol=1e-9)


def test_fifty_digits_move_no_mode() -> None:
    """Newton with 50 digits from each real mode: the legs close to 1e-45, and the mode was right to 1e-11."""
    mp = pytest.importorskip("mpmath", reason="mpmath is the oracle; pip install 'gtmodel[oracle]'")
    with mp.workdps(50):
        for q, T in list(zip(dietmaier().quaternion, dietmaier().T, strict=True))[::5]:
            start = [*map(mp.mpf, T.tolist()), *map(mp.mpf, q.tolist())]

            def equations(*u):
                a, b, c, d = u[3:]
                R = [
                    [a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)],
                    [2 * (b * c + a * d), a * a - b * b + c * c - d * d, 2 * (c * d - a * b)],
                    [2 * (b * d - a * c), 2 * (c * d + a * b), a * a - b * b - c * c + d * d],
                ]
                rows = [a * a + b * b + c * c + d * d - 1]
                for A, B, L in zip(DIETMAIER_A.tolist(), DIETMAIER_B.tolist(), DIETMAIER_L.tolist(), strict=True):
                    gap = [u[i] + sum(R[i][j] * mp.mpf(B[j]) for j in range(3)) - mp.mpf(A[i]) for i in range(3)]
                    rows.append(sum(g * g for g in gap) - mp.mpf(L) ** 2)
                return rows

            root = mp.findroot(equations, start, tol=1e-80)
            assert max(abs(f) for f in equations(*root)) < mp.mpf(10) ** -45
            assert max(abs(root[i] - start[i]) for i in range(7)) < 1e-11


def test_complex_modes_close_the_legs_too(one: tuple[Platforms, AssemblyModes]) -> None:
    platform, modes = one
    d = modes.T_complex[:, None] + platform.B @ np.swapaxes(modes.R_complex, 1, 2) - platform.A
    size = np.abs(modes.T_complex).max(axis=1) + np.abs(modes.R_complex).max(axis=(1, 2))
    error = np.abs(np.sum(d * d, axis=2) - platform.L**2).max(axis=1)
    assert np.all(error < 1e-10 * size**2)
    identity = modes.R_complex @ np.swapaxes(modes.R_complex, 1, 2)
    assert np.all(np.abs(identity - np.eye(3)).max(axis=(1, 2)) < 1e-10 * size**2)
    m = modes.certificate.real
    first, second = modes.T_complex[m::2], modes.T_complex[m + 1 :: 2]
    np.testing.assert_allclose(second, np.conj(first), rtol=1e-7, atol=1e-9)


def test_nearest_other_mode_is_measured_between_poses_of_the_platform() -> None:
    modes, B = dietmaier(), DIETMAIER_B
    centre = modes.T + modes.R @ B.mean(axis=0)
    for k, j in enumerate(modes.nearest_other):
        assert np.linalg.norm(centre[k] - centre[j]) == pytest.approx(modes.nearest_distance[k], rel=1e-9)
        angle = Rotation.from_matrix(modes.R[k].T @ modes.R[j]).magnitude()
        assert np.degrees(angle) == pytest.approx(modes.nearest_angle_deg[k], rel=1e-9)
    assert modes.certificate.nearest_distance in modes.nearest_distance


def test_the_certificate_reads_well() -> None:
    text = dietmaier().certificate.text()
    assert "40 of 40, 40 distinct, 40 certified" in text and " mm and " in text
    assert "furlong" in dietmaier().certificate.text(unit="furlong")
