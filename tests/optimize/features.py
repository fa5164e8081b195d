"""Small optimisations, one for each feature of the language of optimal control."""

from __future__ import annotations

import gtmodel as gt
from gtmodel import der


class Tank(gt.Optimization):
    """A stable nonlinear level x with inflow u: the base of the others."""

    rate = gt.parameter(1.0, unit="1/s")
    x = gt.variable(start=1.0, fixed=True, nominal=2.0)
    u = gt.input(min=-1.0, max=1.0, nominal=0.5)
    final_time = 2.0

    def equations(self):
        yield der(self.x) == -(self.x**3) + gt.cos(self.x) * self.u

    def objective(self):
        return gt.integral(self.x**2 + 0.1 * self.u**2)


class Lagrange(Tank):
    """Cost an integral, time in it."""

    def objective(self):
        return 2 * gt.integral(gt.exp(-self.rate * self.time) * self.x**2) - 0.5 * gt.integral(self.u * self.x)


class Mayer(Tank):
    """Cost a nonlinear function of end values."""

    def objective(self):
        end = self.x.at(self.final_time)
        return (end - 0.3) ** 2 + gt.exp(end) * self.u.at(self.final_time) + gt.integral(0.1 * self.u**2)


class BoundedEnergy(Tank):
    """An integral in a constraint: it becomes a state."""

    def objective(self):
        return self.x.at(self.final_time) ** 2

    def constraints(self):
        yield gt.integral(self.u**2) <= 0.5


class FunctionOfIntegral(Tank):
    """Nonlinear functions and products of integrals in the cost."""

    def objective(self):
        energy, level = gt.integral(self.u**2), gt.integral(self.x)
        return gt.sqrt(1 + level**2) + energy * level + gt.integral(self.x**2)


class InteriorPoints(Tank):
    """Values within the horizon, on and off the mesh, of states, rates and controls."""

    def objective(self):
        return (self.x.at(0.7) - 0.2) ** 2 + self.u.at(0.31) * self.x.at(1.0) + gt.integral(self.u**2)

    def constraints(self):
        yield self.x.at(0.5) * self.x.at(1.3) <= 0.4
        yield gt.between(-2, der(self.x).at(0.9), 0.5)


class FreeTimes(Tank):
    """Both ends free, time in rates and cost."""

    start_time = gt.free(guess=0.5, min=0.0, max=0.9)
    final_time = gt.free(guess=2.0, min=1.0)

    def equations(self):
        yield der(self.x) == -(self.x**3) + gt.cos(self.x + self.rate * self.time) * self.u

    def objective(self):
        running = gt.integral(self.rate * self.time * self.x**2 + self.u**2)
        return self.rate * self.final_time**2 - self.start_time + running

    def constraints(self):
        yield self.x.at(self.final_time) * self.final_time <= 0.8


class FreeConstants(Tank):
    """A free scalar and a free vector, in rates, bounds of the path and cost."""

    k = gt.free(guess=1.0, min=0.2, max=3.0)
    w = gt.free(guess=[0.4, -0.3])

    def equations(self):
        yield der(self.x) == -self.k * self.x**3 + self.w[0] * gt.sin(self.x * self.w[1]) + self.u

    def objective(self):
        distance = gt.integral((self.x - self.k) ** 2) * self.k + gt.integral(0.1 * self.u**2)
        return distance + self.w[0] ** 2 * (1 + self.w[1] ** 4) + self.w[0] * self.k

    def constraints(self):
        yield self.x <= self.k * (1 + self.u**2)
        yield self.w[0] * self.w[1] >= -self.k


class NoControl(gt.Optimization):
    """A rate constant from two measured levels: nothing but constants to choose; synthetic, k = 0.7."""

    k = gt.free(guess=0.3, min=0.01, max=5.0)
    x = gt.variable(start=1.0, fixed=True)
    final_time = 2.0

    def equations(self):
        yield der(self.x) == -self.k * self.x

    def objective(self):
        return sum((self.x.at(t) - x) ** 2 for t, x in ((1.0, 0.4965853037914095), (2.0, 0.24659696394160646)))


class PathConstraints(Tank):
    """Inequalities and an equation along the path, bounds on what is eliminated."""

    y = gt.variable(max=1.2)
    v = gt.input()

    def equations(self):
        yield from super().equations()
        yield self.y == self.x**2 + self.u * self.v

    def constraints(self):
        yield gt.between(-0.5, self.x * self.u, 0.5)
        yield self.u + self.v + 0.1 * self.x * self.v == 0.1


class TwoCarts(gt.Optimization):
    """Fully actuated, masses coupled: inverse form; acceleration bounded and fixed at the end."""

    m = gt.parameter([1.0, 2.0], positive=True)
    q = gt.variable(2, start=[0.0, 0.5], nominal=0.5)
    f = gt.input(2, min=-4.0, max=4.0, nominal=2.0)
    final_time = gt.free(guess=1.2, min=0.3)

    def equations(self):
        gap = self.q[1] - self.q[0]
        yield self.m[0] * der(self.q[0], 2) + 0.3 * gt.sin(gap) * der(self.q[1], 2) == self.f[0] - der(self.q[0]) ** 3
        yield self.m[1] * der(self.q[1], 2) + 0.3 * gt.sin(gap) * der(self.q[0], 2) == self.f[1] + gap

    def objective(self):
        return self.final_time + 0.01 * gt.integral(gt.dot(self.f, self.f))

    def constraints(self):
        yield self.q.at(self.start_time) == [0.0, 0.5]
        yield der(self.q).at(self.start_time) == 0
        yield self.q.at(self.final_time) == [1.0, 1.2]
        yield der(self.q).at(self.final_time) == 0
        yield der(self.q[0], 2).at(self.final_time) == 0
        yield der(self.q[1], 2) ** 2 <= 30 + self.q[0] ** 2


FEATURES: tuple[type[gt.Optimization], ...] = (
    Lagrange, Mayer, BoundedEnergy, FunctionOfIntegral, InteriorPoints, FreeTimes, FreeConstants, NoControl,
    PathConstraints, TwoCarts,
)  # fmt: skip
