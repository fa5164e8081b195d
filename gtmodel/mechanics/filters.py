"""Filters that make an inverse model causal."""

from __future__ import annotations

from .. import lang as gt


class LowPass(gt.Model):
    """Three equal first-order lags in a row: y follows u with unit gain and can be differentiated three times.

    An inverse model needs the acceleration of its reference; behind this filter it is a function of the
    filter's states, and u needs no derivative (Dressler 2012, Fig. 3.2).
    """

    bandwidth = gt.parameter(100.0, unit="1/s", positive=True, description="corner frequency of each lag [rad/s]")
    u = gt.variable(unit="m", description="what is to be followed")
    y = gt.variable(unit="m", description="what follows")
    x = gt.variable(3, unit="m", prefer=10, description="outputs of the lags")

    def equations(self):
        before = self.u
        for k in range(3):
            yield gt.der(self.x[k]) == self.bandwidth * (before - self.x[k])
            before = self.x[k]
        yield self.y == self.x[2]
