"""Sections across guideways of any direction."""

import numpy as np
import pytest

from gtmodel.kinematics.section import across_guideways

ROUND_OFF = 1e-12
A = np.array([[0.04, 0.0, 1.44], [0.25, -1.31, 1.46], [0.0, 0.0, 0.0]])


def test_along_x_the_coordinates_are_y_and_z() -> None:
    s = across_guideways(A, [[1.0, 0, 0]] * 3, [0.7, 5.0, 5.0])
    assert s.names == ("y", "z")
    np.testing.assert_allclose(s.points([[0.2, 0.3]]), [[0.7, 0.2, 0.3]], atol=ROUND_OFF)
    np.testing.assert_allclose(s.pierced(A, [[1.0, 0, 0]] * 3), A[:, 1:], atol=ROUND_OFF)
    np.testing.assert_allclose(s.points([[0.2, 0.3]], 0.1), [[0.8, 0.2, 0.3]], atol=ROUND_OFF)


def test_lengths_and_signs_of_directions_do_not_matter() -> None:
    v = np.array([[0.05, -1.0, 0.0], [0.04, -1.0, 0.01], [0.045, -0.98, 0.0]])
    one = across_guideways(A, v, [0, 0, 0])
    two = across_guideways(A, v * [[0.5], [-2.0], [1.0]], [0, 0, 0])
    for x, y in zip((one.across, one.up, one.normal), (two.across, two.up, two.normal), strict=True):
        np.testing.assert_allclose(x, y, atol=ROUND_OFF)
    basis = np.stack([one.across, one.up, one.normal])
    np.testing.assert_allclose(basis @ basis.T, np.eye(3), atol=ROUND_OFF)
    # what pierces the plane lies on its line
    uv = one.pierced(A, v)
    d = one.points(uv) - A
    np.testing.assert_allclose(np.cross(d, v), 0.0, atol=ROUND_OFF)


def test_what_has_no_section() -> None:
    with pytest.raises(ValueError, match="deg from the mean direction"):
        across_guideways(A, np.eye(3), [0, 0, 0])
    with pytest.raises(ValueError, match="upward direction"):
        across_guideways(A, [[0, 0, 1.0]] * 3, [0, 0, 0])
