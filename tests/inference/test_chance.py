"""Chances against scipy.stats and their limits."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.stats

from gtmodel.inference.chance import chi_squared_bound, chi_squared_chance, f_bound, f_chance, f_test


def test_chances_are_those_of_scipy_stats() -> None:
    F = np.array([0.0, 0.3, 1.0, 4.0, 50.0])
    assert f_chance(F, 3, 17) == pytest.approx(scipy.stats.f.sf(F, 3, 17), rel=1e-12)
    assert chi_squared_chance(F, 5) == pytest.approx(scipy.stats.chi2.sf(F, 5), rel=1e-12)
    assert f_chance(f_bound(0.02, 3, 17), 3, 17) == pytest.approx(0.02, rel=1e-9)
    assert chi_squared_chance(chi_squared_bound(0.02, 5), 5) == pytest.approx(0.02, rel=1e-9)


def test_a_ratio_that_is_unknown_has_an_unknown_chance_and_an_infinite_one_has_none() -> None:
    assert np.isnan(f_chance(np.nan, 2, 9)) and f_chance(np.inf, 2, 9) == 0.0
    assert f_test(3.0, 0.0, 1, 5) == (np.inf, 0.0)
    assert np.isnan(f_test(0.0, 0.0, 1, 5)).all()
