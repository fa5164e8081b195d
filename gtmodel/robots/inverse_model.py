"""The inverse robot model with reference filters: an input-output block from cart references to motor forces."""

from __future__ import annotations

from .. import lang as gt
from .three_link import GantryTau


class LowPass(gt.Model):
    """Three equal first-order lags in series: y follows u with unit gain and can be differentiated three times.

    An inverse model needs the acceleration of its reference. With this filter it is a function of the filter's states,
    and u needs no derivative (Dressler 2012, Fig. 3.2).
    """

    bandwidth = gt.parameter(100.0, unit="1/s", positive=True, description="corner frequency of each lag [rad/s]")
    u = gt.variable(unit="m", description="filter input")
    y = gt.variable(unit="m", description="filter output")
    x = gt.variable(3, unit="m", prefer=10, description="outputs of the lags")

    def equations(self):
        before = self.u
        for k in range(3):
            yield gt.der(self.x[k]) == self.bandwidth * (before - self.x[k])
            before = self.x[k]
        yield self.y == self.x[2]


class InverseModel(gt.Model):
    """Motor forces that move the carts along filtered references (Dressler 2012, Fig. 3.2 and section 3.4).

    The forward model with inputs and outputs exchanged: `reference` [m] is the input, `tau` [N] the output, the
    filters' outputs are the states. `causal(known="reference", targets=["tau", "der(filter[0].x)", ...])` is the block.

    >>> model = gt.robots.InverseModel(robot=gt.robots.gantry_tau("l1_tape"))
    >>> block = model.causal(known="reference", targets=["tau", "robot.q"])
    >>> block
    CausalFunction(filter[0].x, filter[1].x, filter[2].x -> tau, robot.q)
    """

    reference = gt.input(3, unit="m", description="cart positions to follow")
    tau = gt.variable(3, unit="N", nominal=100.0, description="motor forces")
    robot = gt.part(GantryTau)
    filter = gt.parts(3, LowPass)

    def equations(self):
        yield self.tau == self.robot.tau
        for i, f in enumerate(self.filter):
            yield f.u == self.reference[i]
            yield f.y == self.robot.q[i]
