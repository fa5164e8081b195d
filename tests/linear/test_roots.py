"""Roots of one variable, against functions whose roots are known."""

from __future__ import annotations

import numpy as np
import pytest

from gtmodel.linear.roots import crossing


@pytest.mark.parametrize("rtol", [1e-3, 1e-9])
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("function", [
    lambda x: x - 1.25,  # Brent meets its zero exactly: the other end stays where it began
    lambda x: np.log(x / 1.3), lambda x: np.expm1(20 * (x - 1.7)), lambda x: np.copysign(1.0, x - 1.1),
])  # fmt: skip
def test_both_sides_of_a_root_are_near(function, sign, rtol) -> None:
    below, above = crossing(lambda x: sign * function(x), 1.0, 2.0, rtol)
    assert below <= above <= below * (1 + 3 * rtol)
    assert function(below) <= 0 <= function(above)


def test_ends_of_one_sign_are_refused() -> None:
    with pytest.raises(ValueError):
        crossing(lambda x: x, 1.0, 2.0, 1e-3)
