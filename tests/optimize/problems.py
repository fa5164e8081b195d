"""Optimal control problems with known optima, written in the language; tests/suites/conformance.toml names them.

Several are written in more than one way; the ways must agree.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

import gtmodel as gt
from gtmodel import der
from gtmodel.results import Trajectory


class Oscillator(gt.Model):
    """Van der Pol's oscillator with an input."""

    x1 = gt.variable(start=0.0, fixed=True)
    x2 = gt.variable(start=1.0, fixed=True)
    u = gt.input()

    def equations(self):
        yield der(self.x1) == (1 - self.x2**2) * self.x1 - self.x2 + self.u
        yield der(self.x2) == self.x1


class VanDerPol(Oscillator, gt.Optimization):
    """int x1^2 + x2^2 + u^2 dt over 20 s with u <= 0.75."""

    u = gt.input(max=0.75)
    final_time = 20.0

    def objective(self):
        return gt.integral(self.x1**2 + self.x2**2 + self.u**2)


class VanDerPolMayer(VanDerPol):
    """The cost as a state, valued at the end."""

    cost = gt.variable(start=0.0, fixed=True)

    def equations(self):
        yield from super().equations()
        yield der(self.cost) == self.x1**2 + self.x2**2 + self.u**2

    def objective(self):
        return self.cost.at(self.final_time)


class VanDerPolPath(Oscillator, gt.Optimization):
    """No bound on u, but u^4 <= 0.1 + x1^2 x2^2 all along."""

    final_time = 20.0

    def objective(self):
        return gt.integral(self.x1**2 + self.x2**2 + self.u**2)

    def constraints(self):
        yield self.u**4 <= 0.1 + self.x1**2 * self.x2**2


class VanDerPolTime(Oscillator, gt.Optimization):
    """To the origin in least time, abs(u) <= 1."""

    u = gt.input(min=-1.0, max=1.0)
    final_time = gt.free(guess=2.0, min=0.2)

    def objective(self):
        return self.final_time

    def constraints(self):
        yield self.x1.at(self.final_time) == 0
        yield self.x2.at(self.final_time) == 0


class StirredTank(gt.Optimization):
    """Concentration c [mol/m3] and temperature T [K] of a cooled reactor; scaled by its nominals."""

    F0 = gt.parameter(100.0 / 1000.0 / 60.0)
    c0 = gt.parameter(1000.0)
    T0 = gt.parameter(350.0)
    V = gt.parameter(100.0, positive=True)
    k0 = gt.parameter(7.2e10 / 60.0)
    E = gt.parameter(8750.0)
    r = gt.parameter(0.219, positive=True)
    U = gt.parameter(915.6)
    rho = gt.parameter(1000.0, positive=True)
    Cp = gt.parameter(239.0, positive=True)
    dH = gt.parameter(-5e4)
    c = gt.variable(start=956.271065, fixed=True, nominal=1000.0)
    T = gt.variable(start=250.051971, fixed=True, max=350.0, nominal=300.0)
    Tc = gt.input(min=230.0, max=370.0, nominal=300.0)
    final_time = 150.0

    def equations(self):
        reaction = self.k0 * self.c * gt.exp(-self.E / self.T)
        yield der(self.c) == self.F0 * (self.c0 - self.c) / self.V - reaction
        yield der(self.T) == (
            self.F0 * (self.T0 - self.T) / self.V
            - self.dH / (self.rho * self.Cp) * reaction
            + 2 * self.U / (self.r * self.rho * self.Cp) * (self.Tc - self.T)
        )

    def objective(self):
        return 1e-4 * gt.integral((338.775766 - self.c) ** 2 + (280.099198 - self.T) ** 2 + (280.0 - self.Tc) ** 2)


class StirredTankUnscaled(StirredTank):
    """The same without nominals."""

    c = gt.variable(start=956.271065, fixed=True)
    T = gt.variable(start=250.051971, fixed=True, max=350.0)
    Tc = gt.input(min=230.0, max=370.0)


class StirredTankTime(StirredTank):
    """Least time to c = 338.775766, T = 280.099198."""

    final_time = gt.free(guess=150.0, min=1.0)

    def objective(self):
        return self.final_time

    def constraints(self):
        yield self.c.at(self.final_time) == 338.775766
        yield self.T.at(self.final_time) == 280.099198


def stirred_tank_guess() -> Trajectory:
    """Simulation with the cooling at 280 K; synthetic."""

    def rate(_: float, x: np.ndarray) -> list[float]:
        c, T = x
        flow = 100.0 / 1000.0 / 60.0 / 100.0
        reaction = 7.2e10 / 60.0 * c * np.exp(-8750.0 / T)
        heat = flow * (350.0 - T) + 5e4 / 239e3 * reaction + 2 * 915.6 / (0.219 * 239e3) * (280.0 - T)
        return [flow * (1000.0 - c) - reaction, heat]

    t = np.linspace(0.0, 150.0, 301)
    run = solve_ivp(rate, (0.0, 150.0), [956.271065, 250.051971], "LSODA", t, rtol=1e-9, atol=1e-9)
    values = {"c": run.y[0], "T": run.y[1], "Tc": np.full(t.size, 280.0)}
    return Trajectory(t, values, synthetic="simulated with Tc = 280 K, no noise, no seed")


class LinearAlgebraic(gt.Optimization):
    """Two algebraic variables in a linear block."""

    x = gt.variable(start=1.0, fixed=True)
    y1 = gt.variable(min=-2.0)
    y2 = gt.variable()
    u = gt.input()
    final_time = 5.0

    def equations(self):
        yield der(self.x) == self.y1 + self.y2
        yield self.y1 + self.y2 == self.x + self.u
        yield self.y1 + 2 * self.y2 == gt.sqrt(self.x + 1) + self.x + self.u

    def objective(self):
        return gt.integral(self.x**2 + self.u**2)


class Implicit(gt.Optimization):
    """Base of the implicit problem; its algebraic equations stand in the classes below."""

    x1 = gt.variable(start=1.0, fixed=True)
    x2 = gt.variable(start=1.0, fixed=True)
    u = gt.input()
    final_time = 4.0

    def objective(self):
        return gt.integral((self.x1 - 0.647) ** 2 + self.x2**2 + (self.u - 0.0595) ** 2)


class ImplicitDae(Implicit):
    """Four algebraic variables are free and their equations constraints along the path."""

    y1 = gt.input(start=1.0, min=0.01)
    y2 = gt.input(start=1.0, min=0.01)
    y3 = gt.input(start=1.0, min=0.01)
    y4 = gt.variable(start=1.0)
    y5 = gt.input(start=1.0, min=0.01)

    def equations(self):
        yield der(self.x1) == self.x2
        yield der(self.x2) + self.y1 + self.y2 - self.y3 == self.u
        yield self.y4 == gt.sqrt(self.y5)

    def constraints(self):
        yield self.x1 * self.y3 + self.y2 - gt.sqrt(self.x1) - 2 == 0
        yield 2 * self.y1 * self.y2 * self.y4 == gt.sqrt(self.x1)
        yield self.y1 * self.y4 + gt.sqrt(self.y3) - self.x1 - self.y4 == self.u
        yield self.y5**2 == self.x1


class ImplicitTorn(Implicit):
    """Torn: y3 is free and one equation a constraint; the others give y1, y2, y4 and y5 one after the other."""

    y1 = gt.variable(start=1.0)
    y2 = gt.variable(start=1.0)
    y3 = gt.input(start=1.0, min=0.01)
    y4 = gt.variable(start=1.0)
    y5 = gt.variable(start=1.0)

    def equations(self):
        yield der(self.x1) == self.x2
        yield der(self.x2) + self.y1 + self.y2 - self.y3 == self.u
        yield self.x1 * self.y3 + self.y2 - gt.sqrt(self.x1) - 2 == 0
        yield 2 * self.y1 * self.y2 * self.y4 == gt.sqrt(self.x1)
        yield self.y4 == gt.sqrt(self.y5)
        yield self.y5**2 == self.x1
        yield gt.branch("positive", self.y5)

    def constraints(self):
        yield self.y1 * self.y4 + gt.sqrt(self.y3) - self.x1 - self.y4 == self.u


class ImplicitBlock(Implicit):
    """All equations are given to the compiler: y1, y2 and y3 form a block without a closed form."""

    y1 = gt.variable(start=1.0)
    y2 = gt.variable(start=1.0)
    y3 = gt.variable(start=1.0)
    y4 = gt.variable(start=1.0)
    y5 = gt.variable(start=1.0)

    def equations(self):
        yield from ImplicitTorn.equations(self)
        yield from ImplicitTorn.constraints(self)


class DoubleIntegrator(gt.Optimization):
    """x'' = u from 1 to 0 at rest in least time, abs(u) <= 1."""

    x = gt.variable(start=1.0, fixed=True)
    v = gt.variable(start=0.0, fixed=True)
    u = gt.input(min=-1.0, max=1.0)
    final_time = gt.free(guess=1.0, min=0.1)

    def equations(self):
        yield der(self.x) == self.v
        yield der(self.v) == self.u

    def objective(self):
        return self.final_time - self.start_time

    def constraints(self):
        yield self.x.at(self.final_time) == 0
        yield self.v.at(self.final_time) == 0


class DoubleIntegratorStart(DoubleIntegrator):
    """The start is free instead."""

    start_time = gt.free(guess=-1.0, max=-0.1)
    final_time = 0.0


class DoubleIntegratorBoth(DoubleIntegrator):
    """Both ends are free."""

    start_time = gt.free(guess=0.0, min=-5.0, max=5.0)
    final_time = gt.free(guess=3.0, min=-5.0, max=9.0)

    def constraints(self):
        yield from super().constraints()
        yield self.final_time - self.start_time >= 0.1


class DoubleIntegratorBack(DoubleIntegrator):
    """From (-1, 2): it must overshoot and come back."""

    x = gt.variable(start=-1.0, fixed=True)
    v = gt.variable(start=2.0, fixed=True)
    final_time = gt.free(guess=4.0, min=0.1)


def back_guess() -> Trajectory:
    """Simulation with constant u = -0.5: to rest in 4 s."""
    t = np.linspace(0.0, 4.0, 41)
    return Trajectory(t, {"x": -1 + 2 * t - t**2 / 4, "v": 2 - t / 2, "u": np.full(41, -0.5)})


class LongWay(gt.Optimization):
    """q'' = u in [-2, 1] from 0 to 300 at rest in least time."""

    q = gt.variable(start=0.0, nominal=100.0)
    u = gt.input(min=-2.0, max=1.0)
    final_time = gt.free(guess=20.0, min=1.0)

    def equations(self):
        yield der(self.q, 2) == self.u

    def objective(self):
        return self.final_time

    def constraints(self):
        yield self.q.at(self.start_time) == 0
        yield der(self.q).at(self.start_time) == 0
        yield self.q.at(self.final_time) == 300
        yield der(self.q).at(self.final_time) == 0


class Forward(gt.Optimization):
    """q'' = u - sign(q') while q' >= 0."""

    side = 1.0
    q = gt.variable(start=0.0, fixed=True)
    v = gt.variable(start=1.0, fixed=True, min=0.0)
    u = gt.input(min=-2.0, max=2.0)
    final_time = gt.free(guess=1.0, min=0.01)

    def equations(self):
        yield der(self.q) == self.v
        yield der(self.v) == self.u - self.side

    def objective(self):
        return self.final_time - self.start_time


class Backward(Forward):
    """The same while q' <= 0, to rest at q = -1."""

    side = -1.0
    q = gt.variable()
    v = gt.variable(max=0.0)
    start_time = gt.free(guess=1.0)
    final_time = gt.free(guess=2.0)

    def constraints(self):
        yield self.final_time - self.start_time >= 0.01
        yield self.q.at(self.final_time) == -1
        yield self.v.at(self.final_time) == 0


def two_phases() -> gt.Phases:
    """q'' = u - sign(q') from q = 0, q' = 1 to rest at q = -1 in least time; q' = 0 where the phases meet."""
    return gt.Phases({"forward": Forward(), "backward": Backward()})


class Bilinear(gt.Optimization):
    """Catalyst mixing: the control enters linearly, the second rate contains the first."""

    x1 = gt.variable(start=1.0, fixed=True)
    x2 = gt.variable(start=0.0, fixed=True)
    u = gt.input(min=0.0, max=1.0)
    final_time = 1.0

    def equations(self):
        yield der(self.x1) == self.u * (10 * self.x2 - self.x1)
        yield der(self.x2) == -der(self.x1) - (1 - self.u) * self.x2

    def objective(self):
        return -1 + self.x1.at(self.final_time) + self.x2.at(self.final_time)


class StateConstraint(gt.Optimization):
    """A velocity below a parabola in time."""

    x1 = gt.variable(start=0.0, fixed=True)
    x2 = gt.variable(start=-1.0, fixed=True)
    u = gt.input(min=-20.0, max=20.0)
    final_time = 1.0

    def equations(self):
        yield der(self.x1) == self.x2
        yield der(self.x2) == -self.x2 + self.u

    def objective(self):
        return gt.integral(self.x1**2 + self.x2**2 + 0.005 * self.u**2)

    def constraints(self):
        yield 8 * (self.time - 0.5) ** 2 - 0.5 - self.x2 >= 0


class Brachistochrone(gt.Optimization):
    """A bead slides without friction from (0, 10) to (10, 5) in least time; the control is the slope's angle."""

    g = gt.parameter(9.80665, unit="m/s2")
    x = gt.variable(start=0.0, fixed=True, unit="m")
    y = gt.variable(start=10.0, fixed=True, unit="m")
    v = gt.variable(start=0.0, fixed=True, unit="m/s")
    slope = gt.input(unit="1", min=0.0, max=np.pi, start=1.0)
    final_time = gt.free(guess=2.0, min=0.1, unit="s")

    def equations(self):
        yield der(self.x) == self.v * gt.sin(self.slope)
        yield der(self.y) == -self.v * gt.cos(self.slope)
        yield der(self.v) == self.g * gt.cos(self.slope)

    def objective(self):
        return self.final_time

    def constraints(self):
        yield self.x.at(self.final_time) == 10
        yield self.y.at(self.final_time) == 5


def brachistochrone_guess() -> Trajectory:
    """A straight line at growing speed."""
    s = np.linspace(0.0, 1.0, 21)
    values: dict[str, Any] = {"x": 10 * s, "y": 10 - 5 * s, "v": 9.9 * s, "slope": 0.5 + s}
    return Trajectory(2.0 * s, values)
