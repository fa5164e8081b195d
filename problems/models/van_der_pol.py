"""The Van der Pol oscillator, first example of JModelica.org: brought to rest with minimum effort."""

import gtmodel as gt
from gtmodel import der


class VanDerPol(gt.Optimization):
    """Minimise int x1^2 + x2^2 + u^2 dt over 20 s with u <= 0.75; all quantities are dimensionless."""

    x1 = gt.variable(start=0.0, fixed=True)
    x2 = gt.variable(start=1.0, fixed=True)
    u = gt.input(max=0.75)
    final_time = 20.0

    def equations(self):
        yield der(self.x1) == (1 - self.x2**2) * self.x1 - self.x2 + self.u
        yield der(self.x2) == self.x1

    def objective(self):
        return gt.integral(self.x1**2 + self.x2**2 + self.u**2)
