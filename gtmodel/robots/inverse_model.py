"""The inverse robot model with its filters: an input-output block from cart references to motor forces."""

from __future__ import annotations

from .. import lang as gt
from ..mechanics.filters import LowPass
from .three_link import GantryTau


class InverseModel(gt.Model):
    """Motor forces that move the carts along filtered references (Dressler 2012, Fig. 3.2 and section 3.4).

    The forward model with inputs and outputs exchanged: `reference` [m] is the input, `tau` [N] the output, the
    filters' outputs are the states. `causal(known="reference", targets=["tau", "der(filter[0].x)", ...])` is the block.
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
