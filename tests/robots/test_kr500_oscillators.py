"""Cvitanic 2021, Table 16, against the text."""

from __future__ import annotations

import numpy as np
import pytest

from gtmodel.robots.kuka import table_16

# Cvitanic 2021, Table 4, natural frequency range of each location over all A [Hz], by number of a test there
RANGES = {1: (10, 68), 5: (9, 67), 9: (11, 25), 11: (7, 18)}
# the tabulated poses are the optimal ones: 5.98 Hz of tests 11 and 19.13 Hz of test 12 lie outside of 7..18
AGREES_HZ = 1.2


def test_table_16_against_the_ranges_of_the_text() -> None:
    printed = table_16()
    assert printed.tests == ((1, 3), (2,), (4,), (5, 7), (6, 8), (9,), (10,), (11,), (12,))
    location = {test: sum(test >= first for first in RANGES) - 1 for test in range(1, 13)}
    for n, (first, (low, high)) in enumerate(RANGES.items()):
        rows = [k for k, tests in enumerate(printed.tests) if location[tests[0]] == n]
        fn = printed.fn[rows]
        assert abs(fn.min() - low) < AGREES_HZ, first  # lower ends agree
        assert fn.max() < high + AGREES_HZ, first  # upper ends belong to poses that are not tabulated
    assert printed.fn[0] == pytest.approx([17.0, 58.2, 10.4], abs=0.05)
    assert printed.fn[7] == pytest.approx([5.98, 19.08, 8.27], abs=0.01)


def test_the_missing_damping_is_the_mean_of_the_others() -> None:
    printed = table_16()
    np.testing.assert_allclose(printed.zeta[:, 2], printed.zeta[:, :2].mean(axis=1))
    assert printed.zeta[0, 2] == pytest.approx(0.0705, abs=5e-4)
    assert np.all(printed.c[:, 2] > 5 * printed.m[:, 2])  # printed: equal numbers
