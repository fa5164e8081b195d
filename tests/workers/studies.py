"""Models and tasks that worker processes import."""

import numpy as np

import gtmodel as gt


class Wells(gt.Optimization):
    """Two places to rest, x = -1 and x = 1."""

    x = gt.free(-0.2, min=-2.0, max=2.0)
    y = gt.variable(start=0.0, fixed=True)

    def equations(self):
        yield gt.der(self.y) == (self.x**2 - 1.0) ** 2 - 0.1 * self.x

    def objective(self):
        return self.y.at(self.final_time)


class Cart(gt.Model):
    """A cart with viscous friction."""

    m, d = gt.parameter(2.0, unit="kg"), gt.parameter(5.0, unit="kg/s")
    q, tau = gt.variable(unit="m"), gt.variable(unit="N")

    def equations(self):
        v = gt.der(self.q)
        yield self.tau == self.m * gt.der(v) + self.d * v


class Sine:
    """A run of Monte Carlo: one number."""

    def __call__(self, rng: np.random.Generator, k: int) -> float:
        return float(np.sin(rng.normal()) + k)
