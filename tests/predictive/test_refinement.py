"""The stages of a controller refined: their optimum approaches that of collocation with the order of the scheme."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import Status, der
from gtmodel.predictive import ControlHorizon, controller

ORDER = 1.0  # the input is held and the cost of a stage is that at its beginning: both are of first order
NEAR = 0.15  # of the mean order over two halvings


class VanDerPol(gt.Optimization):
    x1 = gt.variable(start=0.0, fixed=True)
    x2 = gt.variable(start=1.0, fixed=True)
    u = gt.input(max=0.75)
    final_time = 6.0

    def equations(self) -> Any:
        yield der(self.x1) == (1 - self.x2**2) * self.x1 - self.x2 + self.u
        yield der(self.x2) == self.x1

    def objective(self) -> Any:
        return gt.integral(self.x1**2 + self.x2**2 + self.u**2)


class CartPole(gt.Optimization):
    M = gt.parameter(1.0, unit="kg")
    m = gt.parameter(0.2, unit="kg")
    length = gt.parameter(0.5, unit="m")
    g = gt.parameter(9.81, unit="m/s2")
    far = gt.parameter(0.3, unit="m")
    fast = gt.parameter(2.0, unit="m/s")
    tilted = gt.parameter(0.3, unit="rad")
    turning = gt.parameter(4.0, unit="rad/s")
    strong = gt.parameter(10.0, unit="N")
    x = gt.variable(unit="m", start=0.0, fixed=True)
    v = gt.variable(unit="m/s", start=0.0, fixed=True)
    angle = gt.variable(unit="rad", start=0.6, fixed=True)
    turn = gt.variable(unit="rad/s", start=0.0, fixed=True)
    force = gt.input(unit="N", min=-6.0, max=6.0)
    final_time = 1.5

    def equations(self) -> Any:
        yield der(self.x) == self.v
        yield der(self.angle) == self.turn
        swing = der(self.turn) * gt.cos(self.angle) - self.turn**2 * gt.sin(self.angle)
        yield (self.M + self.m) * der(self.v) - self.m * self.length * swing == self.force
        yield self.length * der(self.turn) == self.g * gt.sin(self.angle) + der(self.v) * gt.cos(self.angle)

    def objective(self) -> Any:
        effort = (self.force / self.strong) ** 2 + (self.turn / self.turning) ** 2 + (self.v / self.fast) ** 2
        return gt.integral(effort + (self.x / self.far) ** 2 + (self.angle / self.tilted) ** 2)


@pytest.mark.parametrize(("model", "stages"), [(VanDerPol, 30), pytest.param(CartPole, 20, marks=pytest.mark.proof)])
def test_the_cost_approaches_that_of_collocation_with_the_first_order(model: Any, stages: int) -> None:
    exact = gt.solve(model(), mesh=gt.optimize.Mesh(elements=60, points=3)).objective
    errors = []
    for count in (stages, 4 * stages):
        horizon = ControlHorizon(period=model.final_time / count, stages=count, terminal=False)
        law = controller(model(), horizon)
        plan = law.converge(law.program.statement.start)
        assert plan.status == Status.OK
        at = law.program.statement.forces.numel() - 1
        limit = law.program.statement.force_high[at]
        assert np.max(np.abs(plan.inputs)) == pytest.approx(limit, rel=1e-6)  # a limit is active
        errors.append(abs(plan.cost - exact))
    assert abs(np.log(errors[0] / errors[1]) / np.log(4) - ORDER) < NEAR
