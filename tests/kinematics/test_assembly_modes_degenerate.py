"""Assembly modes of platforms that are not general, and of data that are none: a status and a sentence, never 40."""

from __future__ import annotations

import numpy as np
import pytest

from gtmodel.kinematics.assembly_modes import AssemblyModes, assembly_modes, assembly_modes_batch
from gtmodel.lang.source import ModelError
from gtmodel.results import ModesStatus
from tests.kinematics.support.platforms import (
    Platforms,
    collinear_platforms,
    griffis_duffy_platforms,
    in_poses,
    random_platforms,
    singular_platforms,
    six_three_platforms,
)

SEED = 4


def assert_no_modes(modes: AssemblyModes) -> None:
    assert not modes.ok
    assert len(modes.R) == len(modes.T) == len(modes.R_complex) == modes.certificate.finite == 0


def test_a_six_three_platform_has_sixteen_finite_modes_and_says_so() -> None:
    platforms = six_three_platforms(4, SEED)
    for modes, R, T in zip(assembly_modes_batch(*platforms.legs), platforms.R, platforms.T, strict=True):
        c = modes.certificate
        assert modes.status is ModesStatus.FEWER_FINITE and modes.ok
        assert (c.finite, c.infinite, c.lost) == (16, 24, 0)
        assert c.real + 2 * c.conjugate_pairs == 16
        assert c.start_systems == 2 and c.retries == 40  # two searches agree
        assert "found 16 finite modes; 24 paths ended at infinity" in modes.message
        assert modes.nearest(R, T)[1] < 1e-9
        assert len(modes.infinite) == 24
        assert np.max(np.abs(np.sum(modes.infinite**2, axis=1))) < 1e-9


@pytest.mark.parametrize(
    ("base", "platform", "finite"),
    [
        ([0, 1, 2, 3, 4, 5], [0, 0, 1, 1, 2, 3], 32),
        ([0, 1, 1, 2, 2, 0], [0, 0, 1, 1, 2, 2], 16),
        ([0, 1, 2, 3, 4, 5], [0, 0, 1, 2, 3, 4], 40),
    ],
    ids=["6-4", "3-3", "6-5"],
)
def test_platforms_with_coincident_joints_have_the_known_numbers(
    base: list[int], platform: list[int], finite: int
) -> None:
    """Faugere and Lazard, "Combinatorial classes of parallel manipulators", Mech. Mach. Theory 30 (1995)."""
    p = random_platforms(2, SEED)
    q = in_poses(p.A[:, base], p.B[:, platform], p.R, p.T)
    for modes, R, T in zip(assembly_modes_batch(*q.legs), q.R, q.T, strict=True):
        assert modes.ok, modes.message
        assert modes.certificate.finite == finite and modes.certificate.lost == 0
        assert modes.nearest(R, T)[1] < 1e-9


@pytest.mark.parametrize("make", [griffis_duffy_platforms, collinear_platforms])
def test_architecturally_singular_platforms(make) -> None:
    for modes in assembly_modes_batch(*make(2, SEED).legs):
        assert modes.status is ModesStatus.SELF_MOTION
        assert "linearly dependent in every pose" in modes.message
        assert_no_modes(modes)


def test_a_self_motion_that_the_tracker_must_notice(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the test beforehand, the endpoints of the paths show that they lie on a curve."""
    name = "gtmodel.kinematics.assembly_modes.solve.architecturally_singular"
    monkeypatch.setattr(name, lambda scaled: np.zeros(len(scaled.legs), dtype=bool))
    for modes in assembly_modes_batch(*griffis_duffy_platforms(2, SEED).legs):
        assert modes.status is ModesStatus.SELF_MOTION
        assert "on a curve of solutions" in modes.message


def test_a_self_motion_of_a_platform_that_is_not_architecturally_singular() -> None:
    """Base and platform congruent, legs parallel and equal: the platform translates on a sphere."""
    A = np.random.default_rng(SEED).normal(size=(1, 6, 3))
    platform = in_poses(A, A, np.eye(3)[None], np.array([[0.3, 0.2, 1.0]]))
    (modes,) = assembly_modes_batch(*platform.legs)
    assert modes.status is ModesStatus.SELF_MOTION, modes.message


def test_a_singular_pose_is_a_multiple_mode() -> None:
    platforms = singular_platforms(3, SEED)
    for modes, R, T in zip(assembly_modes_batch(*platforms.legs), platforms.R, platforms.T, strict=True):
        c = modes.certificate
        assert modes.status is ModesStatus.MULTIPLE and not modes.ok
        assert (c.finite, c.multiple, c.lost) == (38, 2, 0)
        assert "coincide" in modes.message
        assert len(modes.R_multiple) == 1
        np.testing.assert_allclose(modes.R_multiple[0], R, atol=1e-4)
        np.testing.assert_allclose(modes.T_multiple[0], T, atol=1e-4 * modes.size)


@pytest.mark.parametrize("gap", [1e-3, 1e-4])
def test_modes_close_to_each_other_stay_two(gap: float) -> None:
    platforms = singular_platforms(3, SEED)
    A = platforms.A.copy()
    A[:, 5, 0] += gap
    near = in_poses(A, platforms.B, platforms.R, platforms.T)
    for modes, R, T in zip(assembly_modes_batch(*near.legs), near.R, near.T, strict=True):
        assert modes.status is ModesStatus.COMPLETE, modes.message
        assert modes.nearest(R, T)[1] < 1e-7


def test_lengths_that_cannot_be_met_leave_complex_modes_only() -> None:
    p = random_platforms(1, SEED)
    modes = assembly_modes(p.A[0], p.B[0], p.L[0] * [1, 1, 1, 1, 1, 10])
    assert modes.status is ModesStatus.COMPLETE
    assert modes.certificate.real == 0 and modes.certificate.conjugate_pairs == 20
    assert modes.nearest(np.eye(3), np.zeros(3)) == (-1, np.inf, np.inf)
    assert "nearest" not in modes.certificate.text()


@pytest.mark.parametrize("factor", [1e-2, 1e2])
def test_platforms_much_smaller_or_larger_than_the_base(factor: float) -> None:
    p = random_platforms(2, SEED)
    q = in_poses(p.A, p.B * factor, p.R, p.T)
    assert all(modes.status is ModesStatus.COMPLETE for modes in assembly_modes_batch(*q.legs))


def test_nearly_a_point_as_platform_is_not_called_complete() -> None:
    p = random_platforms(1, SEED)
    (modes,) = assembly_modes_batch(*in_poses(p.A, p.B * 1e-7, p.R, p.T).legs)
    assert modes.status is ModesStatus.INCOMPLETE
    assert "modes may be missing" in modes.message


# Data that are no platform.


def spoiled(name: str, index: tuple[int, ...], value: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    p = random_platforms(1, SEED)
    legs = {"A": p.A[0].copy(), "B": p.B[0].copy(), "L": p.L[0].copy()}
    legs[name][index] = value
    return legs["A"], legs["B"], legs["L"]


@pytest.mark.parametrize(
    ("name", "index", "value", "sentence"),
    [
        ("A", (2, 1), np.nan, "A of leg 3 is not finite"),
        ("B", (5, 0), np.inf, "B of leg 6 is not finite"),
        ("L", (0,), np.nan, "L of leg 1 is not finite"),
        ("L", (3,), -1.5, "the length of leg 4 is -1.5; a length must be positive"),
        ("L", (3,), 0.0, "the length of leg 4 is 0; a length must be positive"),
    ],
)
def test_numbers_that_are_no_lengths(name: str, index: tuple[int, ...], value: float, sentence: str) -> None:
    modes = assembly_modes(*spoiled(name, index, value))
    assert modes.status is ModesStatus.BAD_INPUT
    assert sentence in modes.message
    assert_no_modes(modes)


@pytest.mark.parametrize("same_length", [True, False])
def test_two_identical_legs(same_length: bool) -> None:
    A, B, L = spoiled("A", (0, 0), 0.0)
    A[4], B[4] = A[1], B[1]
    L[4] = L[1] if same_length else 2 * L[1]
    modes = assembly_modes(A, B, L)
    assert modes.status is ModesStatus.BAD_INPUT
    assert "legs 2 and 5 join the same two points" in modes.message


def test_all_joints_in_one_point() -> None:
    modes = assembly_modes(np.ones((6, 3)), np.random.default_rng(SEED).normal(size=(6, 3)), np.ones(6))
    assert modes.status is ModesStatus.SELF_MOTION


def test_a_bad_pose_does_not_harm_the_others() -> None:
    p = random_platforms(3, SEED)
    L = p.L.copy()
    L[1, 2] = np.nan
    before, bad, after = assembly_modes_batch(p.A, p.B, L)
    assert before.status is after.status is ModesStatus.COMPLETE
    assert bad.status is ModesStatus.BAD_INPUT
    np.testing.assert_allclose(after.T, assembly_modes(p.A[2], p.B[2], p.L[2]).T, atol=1e-12)


def shapes() -> Platforms:
    return random_platforms(2, SEED)


def test_wrong_shapes_are_errors_with_a_sentence() -> None:
    p = shapes()
    with pytest.raises(ModelError, match=r"A has shape \(3, 6\); expected \(6, 3\)"):
        assembly_modes(p.A[0].T, p.B[0], p.L[0])
    with pytest.raises(ModelError, match=r"L has shape \(5,\); expected \(6,\)"):
        assembly_modes(p.A[0], p.B[0], p.L[0, :5])
    with pytest.raises(ModelError, match="number of poses; found 2, 3"):
        assembly_modes_batch(p.A, np.zeros((3, 6, 3)), p.L)
    with pytest.raises(ModelError, match="B must be an array of real numbers"):
        assembly_modes(p.A[0], p.B[0] + 1j, p.L[0])
    with pytest.raises(ModelError, match="L must be an array of real numbers"):
        assembly_modes(p.A[0], p.B[0], ["one"] * 6)
    with pytest.raises(ModelError, match="assembly_modes_batch"):
        assembly_modes(*p.legs)


def test_a_misspelt_keyword_raises() -> None:
    p = shapes()
    with pytest.raises(TypeError, match="progres"):
        assembly_modes_batch(*p.legs, progres=print)


def test_without_a_start_system_nothing_is_claimed() -> None:
    p = shapes()
    modes = assembly_modes(p.A[0], p.B[0], p.L[0], systems=())
    assert modes.status is ModesStatus.INCOMPLETE and "no start system" in modes.message
    assert_no_modes(modes)


def test_no_poses() -> None:
    assert assembly_modes_batch(np.zeros((0, 6, 3)), np.zeros((6, 3)), np.ones(6)) == []


def test_progress_is_shown_and_may_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gtmodel.kinematics.assembly_modes.solve.POSES_AT_ONCE", 1)
    p = random_platforms(3, SEED)
    seen: list[tuple[int, int]] = []
    assembly_modes_batch(*p.legs, progress=lambda done, total: seen.append((done, total)))
    assert seen == [(1, 3), (2, 3), (3, 3)]
    results = assembly_modes_batch(*p.legs, progress=lambda done, total: done == 2)
    assert [modes.status for modes in results] == [
        ModesStatus.COMPLETE,
        ModesStatus.COMPLETE,
        ModesStatus.INTERRUPTED,
    ]
