"""Modes of printed and synthetic matrices; the question of the signs."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh

from gtmodel.results import ArgumentError
from gtmodel.vibration import definite_form, modes, sign_question
from tests.vibration.structures import D, K, M, relative

PROBLEM = Path(__file__).parents[2] / "problems/vibration_table_6_15.toml"
PRINTED = tomllib.loads(PROBLEM.read_text(encoding="utf-8"))["matrices"]
M_P, D_P, K_P = (np.array(PRINTED[k]) for k in ("M_kg", "D_kg_s", "K_N_m"))
ROUNDING = 1e-10  # relative


def test_the_printed_matrices_give_the_two_frequencies() -> None:
    found = modes(M_P, D_P, K_P)
    # by hand: det(M lambda + K) is a quadratic in lambda
    (a, b), (c, d) = M_P
    (e, f), (g, h) = K_P
    lam = np.roots([a * d - b * c, a * h + e * d - b * g - f * c, e * h - f * g])
    np.testing.assert_allclose(np.sort(np.sqrt(lam)) / (2 * np.pi), found.frequency_Hz, rtol=ROUNDING)
    np.testing.assert_allclose(found.frequency_Hz, [13.826, 103.337], atol=5e-4)
    assert not found.stable and found.poles.real.max() > 600
    assert "M^-1 K has 2 of 2 eigenvalues that are not positive: without damping they diverge" in found.notes
    assert "M s^2 + D s + K is unstable: 2 of 4 poles grow, by up to 672.1 1/s" in found.notes
    assert any(
        w.startswith("K is not symmetric; its symmetric part is indefinite, its eigenvalues are -1588.3-")
        for w in found.notes
    )


def test_flipping_d_and_k_is_the_one_choice_that_is_stable() -> None:
    said = sign_question(M_P, D_P, K_P)
    assert said[3] == "D and K flipped: stable, poles at 14.21, 100.6 Hz" and sum(": stable" in s for s in said) == 1
    flipped = modes(M_P, -D_P, -K_P)
    assert flipped.stable
    # the characteristic polynomial by its determinant at four points is a road of its own
    for s in flipped.poles:
        X = M_P * s**2 - D_P * s - K_P
        assert abs(np.linalg.det(X)) < ROUNDING * np.linalg.norm(X) ** 2
    np.testing.assert_allclose(np.unique(flipped.pole_Hz.round(9)), [14.21, 100.56], atol=5e-3)


def test_a_passive_structure_has_the_modes_of_the_symmetric_problem() -> None:
    found = modes(M, D, K)
    w2, V = eigh(K, M)
    np.testing.assert_allclose(found.frequency_Hz, np.sqrt(w2) / (2 * np.pi), rtol=ROUNDING)
    for k in range(2):
        assert abs(V[:, k] @ M @ found.shapes[:, k]) ** 2 == pytest.approx(found.shapes[:, k] @ M @ found.shapes[:, k])
    assert found.stable and np.all(found.damping > 0)
    assert found.notes[:3] == tuple(f"{X} is symmetric and positive definite" for X in "MDK")
    # without damping the pencil's poles are the modes
    free = modes(M, 0 * D, K)
    np.testing.assert_allclose(free.pole_Hz[::2], free.frequency_Hz, rtol=1e-9)
    assert free.notes[1] == "D is zero"


def test_words_for_every_definiteness() -> None:
    one, zero = np.eye(2), np.diag([1.0, 0.0])
    for X, text in ((-one, "negative definite"), (zero, "positive semidefinite"), (-zero, "negative semidefinite")):
        assert modes(one, one, X).notes[2] == f"K is symmetric and {text}"
    turning = modes(one, one, [[0.0, 1.0], [-1.0, 0.0]])
    assert "M^-1 K has complex eigenvalues: no undamped modes exist" in turning.notes


def test_the_passive_form_keeps_what_is_passive_and_says_what_is_not() -> None:
    same = definite_form(M, D, K)
    assert max(relative(same.M, M), relative(same.D, D), relative(same.K, K)) < 1e-8 and len(same.notes) == 1
    printed = definite_form(M_P, -D_P, -K_P)
    for X in (printed.M, printed.K):
        assert np.linalg.eigvalsh(X)[0] > 0 and relative(X, X.T) < ROUNDING
    assert np.linalg.eigvalsh(printed.D)[0] > -1e-9 * np.abs(printed.D).max()
    np.testing.assert_allclose(modes(printed.M, printed.D, printed.K).frequency_Hz, [13.826, 103.337], atol=5e-4)
    # det(M^-1 D) < 0: no positive definite D belongs to any positive definite M
    assert np.linalg.det(np.linalg.solve(M_P, D_P)) < 0 and printed.raised > 0.1
    assert "the damping is not passive: 61.1 % was added" in printed.notes[1]
    with pytest.raises(ArgumentError, match="check the signs of M and K"):
        definite_form(M_P, D_P, K_P)


def test_matrices_are_checked() -> None:
    with pytest.raises(ArgumentError, match=r"the matrices have the shapes \(2, 2\), \(2, 2\), \(1, 1\)"):
        modes(M, D, [[1.0]])
    with pytest.raises(ArgumentError, match="M is singular: a coordinate has no inertia"):
        modes(np.diag([1.0, 0.0]), D, K)
    with pytest.raises(ArgumentError, match="a matrix has a number that is not finite"):
        modes(M, D * np.nan, K)


def test_a_structure_without_damping_neither_grows_nor_is_stable() -> None:
    M, K = np.diag([2.0, 2.0, 3.0]), np.array([[800.0, -100, 0], [-100, 800, -50], [0, -50, 900]])
    found = modes(M, np.zeros((3, 3)), K)
    assert not found.stable and any("undamped: 6 of 6 poles neither grow nor decay" in w for w in found.notes)
    assert modes(M, 1e-6 * K, K).stable and not modes(M, -1e-6 * K, K).stable
    assert any("6 of 6 poles grow" in w for w in modes(M, -1e-6 * K, K).notes)


def test_a_free_body_has_no_damping() -> None:
    K = np.array([[1.0, -1.0], [-1.0, 1.0]])
    found = modes(np.eye(2), 0.1 * K, K)
    assert found.damping[:2] == pytest.approx([0.0, 0.0]) and found.damping[2] == pytest.approx(0.1 / np.sqrt(2))
    assert any("2 of 4 poles neither grow nor decay" in w for w in found.notes)
