"""Copies are found wherever they stand, and nothing else is called one."""

from __future__ import annotations

import numpy as np
import pytest

from gtmodel.measurements import copied_stretch, copies


@pytest.mark.parametrize("seed", range(5))
def test_a_copied_row_is_found_after_means_were_taken(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(30, 4)) * [1e-3, 1.0, 1e3, 1e-9] + [5.0, 0.0, -1e4, 0.0]
    assert not len(copies(rows)) and not len(copies(rows, 1e-9))
    again = np.vstack([rows, rows[[3, 7]]])
    assert copies(again).tolist() == [[30, 3], [31, 7]]
    moved = again * (1 + 1e-15)
    moved[:30] = rows
    assert {tuple(p) for p in copies(moved, 1e-9).tolist()} == {(30, 3), (31, 7)}


@pytest.mark.parametrize("seed", range(8))
def test_a_copied_stretch_is_found_with_its_places(seed: int) -> None:
    rng = np.random.default_rng(seed)
    quantised = np.round(np.cumsum(rng.normal(size=(2000, 3)), axis=0), 2)
    one, other = quantised[:1200], quantised[1200:].copy()
    assert copied_stretch([one, other]) is None
    length, of, at = int(rng.integers(40, 200)), int(rng.integers(0, 900)), int(rng.integers(0, 500))
    other[at : at + length] = one[of : of + length]
    found = copied_stretch([one, other])
    assert found is not None and (found.again, found.at, found.first, found.of) == (1, at, 0, of)
    assert found.rows >= length


def test_within_one_recording_too_and_not_at_rest() -> None:
    rng = np.random.default_rng(1)
    noise = rng.normal(size=(300, 2))
    assert copied_stretch([np.tile(noise, (2, 1))]) == (0, 300, 0, 0, 300)
    # standing still, quantised: one reading for seconds, twice
    still = np.concatenate([np.zeros((500, 1)), np.round(np.cumsum(rng.normal(size=(500, 1)), axis=0), 3)])
    assert copied_stretch([still, -still]) is None
    assert copied_stretch([np.ones((5, 1)), np.ones((5, 1))]) is None


def test_a_coarse_reading_that_goes_to_and_fro_is_no_copy() -> None:
    toggling = np.tile([[1.0], [2.0]], (200, 1))
    assert copied_stretch([toggling]) is not None
    assert copied_stretch([toggling], distinct=0.5) is None
    noise = np.random.default_rng(0).normal(size=(200, 1))
    assert copied_stretch([np.vstack([toggling, noise, noise])], distinct=0.5) == (0, 600, 0, 400, 200)
