"""A call at one point skips the map over rows: numbers and status are those of the same point among many."""

from __future__ import annotations

import numpy as np

import gtmodel as gt


class Arm(gt.Model):
    """A link between two carts: a root, a pivot and a sum of large numbers."""

    length = gt.parameter(1.0, unit="m", positive=True)
    x = gt.variable(unit="m", start=0.6)
    y = gt.variable(unit="m", start=0.8)

    def equations(self):
        yield self.x**2 + self.y**2 == self.length**2
        yield gt.branch("up", self.y)


def test_a_call_at_one_point_is_that_of_its_row() -> None:
    """Numbers and status, of what has an answer, is out of reach, singular, too large or no number."""
    f = Arm().causal(known="x", targets=["y", "der(y)"])
    rng = np.random.default_rng(2)
    x = np.array([0.0, 0.6, -0.6, 1.0, -1.0, 1.0 - 1e-16, 1.5, 1e9, 1e30, 1e200, np.nan, np.inf, -np.inf])
    x = np.concatenate([x, rng.uniform(-1.2, 1.2, 50)])
    dx = np.concatenate([rng.normal(size=len(x) - 4), [np.nan, np.inf, 1e200, 1e18]])
    with np.errstate(all="ignore"):
        *many, codes = f(x, dx)
        ones = [f(float(a), float(b)) for a, b in zip(x, dx, strict=True)]
    assert len(set(codes.tolist())) >= 4
    assert [int(one[-1]) for one in ones] == codes.tolist()
    for k, rows in enumerate(many):
        np.testing.assert_array_equal([one[k] for one in ones], rows)
