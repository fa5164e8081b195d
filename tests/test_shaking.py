"""The plugin that shakes linear algebra."""

import numpy as np

from tests.shaking import shaken


def test_numbers_move_by_one_place_at_most_and_by_the_seed():
    x = np.random.default_rng(0).normal(size=300)
    x[0] = 0.0
    first = shaken(x, 1)
    places = np.round((first - x) / np.spacing(np.abs(x)))
    assert set(places) == {-1.0, 0.0, 1.0} and first[0] == 0.0
    np.testing.assert_array_equal(first, shaken(x, 1))
    assert np.any(first != shaken(x, 2))
    assert shaken((x, 3), 1)[1] == 3
