"""A start whose unknowns have nominals far from their values."""

from __future__ import annotations

import math

import pytest

import gtmodel as gt

ROUND_OFF = 1e-9


@pytest.mark.parametrize("nominal", [1e-4, 1e-11, 1e-13])
def test_a_consistent_start_does_not_hang_on_a_nominal(nominal: float) -> None:
    """As in the drives of the Modelica library, a relative angle of nominal 1e-4 beside speeds of 100."""

    class Pair(gt.Model):
        a = gt.variable(start=90.0, fixed=True)
        b = gt.variable(start=89.5, fixed=True)
        y = gt.variable(nominal=nominal)
        z = gt.variable(start=0.0)

        def equations(self):
            yield gt.der(self.a) == -1.0
            yield gt.der(self.b) == -1.0
            yield self.y == self.a - self.b
            yield self.z + gt.exp(self.z) == self.y

    z = float(gt.simulate(Pair(), 0.1).trajectory["z"][0])
    assert abs(z + math.exp(z) - 0.5) <= ROUND_OFF
